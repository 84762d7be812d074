"""Pinocchio: `adapter` runs a mechanism, `tree` is its model, `forces` what Pinocchio does not have."""
