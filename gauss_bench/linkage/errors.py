"""The errors of a linkage file: every fault found, each with file, table and field."""

from dataclasses import dataclass

from gauss_bench.untrusted import BadInput


@dataclass(frozen=True, order=True)
class Fault:
    """One fault: the dotted path of the table and field, and a description."""

    path: str
    text: str

    def __str__(self) -> str:
        return f"{self.path}: {self.text}" if self.path else self.text


class LinkageError(BadInput, ValueError):
    """A linkage file that cannot be used; `faults` lists every independent fault found."""

    def __init__(self, source: str, faults: list[Fault]):
        self.source = source
        self.faults = faults
        super().__init__("\n".join(f"{source}: {fault}" for fault in faults))


class FaultError(ValueError):
    """One fault that only shows while a linkage is built or assembled."""

    def __init__(self, path: str, text: str):
        self.fault = Fault(path, text)
        super().__init__(str(self.fault))


class BuildError(FaultError):
    """A fault that only shows once points are resolved."""


class AssemblyError(FaultError):
    """The linkage does not close, or its start does not determine it."""


class NotPlaced(AssemblyError):
    """The sketch does not determine the places of some links; `links` names them."""

    def __init__(self, links: tuple[str, ...]):
        self.links = links
        names = ", ".join(links)
        super().__init__("assembly.sketch", f"not placed: {names}; give two points, or one point and an angle, of each")
