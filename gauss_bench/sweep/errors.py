"""The error for a sweep that cannot be run as requested."""

from gauss_bench.untrusted import BadInput


class SweepError(BadInput, ValueError):
    """A sweep that cannot be run as requested; the message names the option or the path of the file."""
