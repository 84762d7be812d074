"""The extra of the package that brings a library, and the sentence that says so where it is missing."""

from importlib.util import find_spec

from gauss_bench.untrusted import BadInput

EXTRAS = {
    "pinocchio": "pinocchio",
    "exudyn": "exudyn",
    "mujoco": "mujoco",
    "casadi": "casadi",
    "llvmlite": "kernel",
    "heyoka": "certify",
    "starlette": "studio",
    "uvicorn": "studio",
    "websockets": "studio",
    "tomlkit": "studio",
}


class MissingExtra(BadInput, ImportError):
    """A library of an extra that what was asked for cannot do without."""


def not_installed(error: ImportError) -> str:
    """Name the missing module, and how to install it where one of the extras has it."""
    if isinstance(error, MissingExtra):
        return str(error)
    library = (error.name or "").partition(".")[0]
    how = f"; pip install 'gauss-bench[{EXTRAS[library]}]'" if library in EXTRAS else ""
    return f"not installed: {error}{how}"


def require(library: str) -> None:
    """Nothing where a library of EXTRAS is there.

    Raises:
        MissingExtra: it is not; with the sentence of `not_installed`.
    """
    if find_spec(library) is None:
        raise MissingExtra(not_installed(ImportError(f"no package {library}", name=library)), name=library)
