"""Expressions that know their values."""
