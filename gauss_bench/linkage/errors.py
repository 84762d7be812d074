"""The exceptions for faulty linkage files; a `LinkageError` lists every fault that was found, with file, table and field."""

from dataclasses import dataclass

from gauss_bench.untrusted import BadInput


@dataclass(frozen=True, order=True)
class Fault:
    """One fault of a linkage file at a path of keys, such as "links.rod.mass"; an empty path is the whole file."""

    path: str
    text: str

    def __str__(self) -> str:
        return f"{self.path}: {self.text}" if self.path else self.text


class LinkageError(BadInput, ValueError):
    """A linkage file cannot be used; `faults` lists all faults that were found."""

    def __init__(self, source: str, faults: list[Fault]):
        self.source = source
        self.faults = faults
        super().__init__("\n".join(f"{source}: {fault}" for fault in faults))


class FaultError(ValueError):
    """A fault that is found only while a linkage is built or assembled."""

    def __init__(self, path: str, text: str):
        self.fault = Fault(path, text)
        super().__init__(str(self.fault))


class BuildError(FaultError):
    """A fault that is found only when the mechanism is built from the file, such as a bar of zero length."""


class AssemblyError(FaultError):
    """The linkage cannot be closed, or its start or its table `expect` cannot be satisfied."""


class NotPlaced(AssemblyError):
    """The sketch does not determine the places of the links named in `links`."""

    def __init__(self, links: tuple[str, ...]):
        self.links = links
        text = f"not placed: {', '.join(links)}; give two points, or one point and an angle, of each"
        super().__init__("assembly.sketch", text)
