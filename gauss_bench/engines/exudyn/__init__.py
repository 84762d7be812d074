"""Exudyn: `items` builds the model, `adapter` runs it, `accelerations` computes accelerations at a given state.

`across_releases` deals with the differences between releases, and `library_calls` times the library alone.
"""
