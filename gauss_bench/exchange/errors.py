"""The error of an export or import: a sentence that names the file, the element and the reason."""

from gauss_bench.untrusted import BadInput


class ExchangeError(BadInput, ValueError):
    """A linkage that cannot be written in a format, or a file that cannot be read."""
