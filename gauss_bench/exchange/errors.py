"""The error of an exchange: a sentence that names the file, the element and the reason."""


class ExchangeError(ValueError):
    """A linkage that cannot be written in a format, or a file that cannot be read."""
