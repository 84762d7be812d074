"""Expressions, stored with their values at sample states of a linkage."""
