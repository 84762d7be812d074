"""Errors that prevent a report."""

from gauss_bench.untrusted import BadInput


class NoRun(BadInput, ValueError):
    """A folder that holds no run."""
