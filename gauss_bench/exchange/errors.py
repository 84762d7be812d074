"""The error of an exchange: a sentence that names the file, the element and the reason."""


class ExchangeError(ValueError):
    """What cannot be written in a format, or read from a file."""
