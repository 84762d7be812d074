"""Exudyn: `items` builds the model, `adapter` runs it, `accelerations` computes accelerations at a given state.

`library_calls` times the library alone.
"""
