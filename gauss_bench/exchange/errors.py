"""The error of an export or import: a sentence that names the file, the element and the reason."""

from gauss_bench.untrusted import BadInput


class ExchangeError(BadInput, ValueError):
    """A linkage that cannot be written in a format, or a file that cannot be read."""


class FileReader:
    """The base class of readers of model files; `file` is the path of the file, for messages."""

    file: str

    def refuse(self, element: str, reason: str) -> ExchangeError:
        """Return the exception that reports why an element of the file cannot be imported."""
        return ExchangeError(f"{self.file}: {element}: {reason}")
