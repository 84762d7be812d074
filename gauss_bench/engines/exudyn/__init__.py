"""Exudyn: `adapter` runs a mechanism, `items` is its model, `accelerations` those at a given state."""
