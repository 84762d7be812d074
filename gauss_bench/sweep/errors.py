"""The error for a sweep that the user can correct."""

from gauss_bench.untrusted import BadInput


class SweepError(BadInput, ValueError):
    """A sweep that cannot be run as it is asked for; the message names the option or the path of the file."""
