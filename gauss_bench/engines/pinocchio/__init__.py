"""Pinocchio: `adapter` runs a mechanism, `tree` is its model, `forces` what Pinocchio does not have.

`library_calls` asks the library alone.
"""
