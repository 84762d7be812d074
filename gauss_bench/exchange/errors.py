"""The error of an export or import: a sentence that names the file, the element and the reason."""

from gauss_bench.untrusted import BadInput


class ExchangeError(BadInput, ValueError):
    """A linkage that cannot be written in a format, or a file that cannot be read."""


class FileReader:
    """The base of all that reads a model file, whose path for messages is `file`."""

    file: str

    def refuse(self, element: str, reason: str) -> ExchangeError:
        """Return the exception that reports why an element of the file cannot be imported."""
        return ExchangeError(f"{self.file}: {element}: {reason}")
