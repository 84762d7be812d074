"""Exudyn: `adapter` runs a mechanism, `items` is its model, `accelerations` those at a given state.

`library_calls` asks the library alone.
"""
