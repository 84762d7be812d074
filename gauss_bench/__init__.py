"""Validation and benchmarking of closed-loop planar linkage dynamics."""

__version__ = "0.1.0"
