"""Reasons for which a report is refused."""

from gauss_bench.untrusted import BadInput


class NoRun(BadInput, ValueError):
    """A folder that holds no run."""
