"""The one face of everything that runs a mechanism.

The bench owns the clock: `prepare` and `read` are never timed, `run` is. An engine translates to and from the absolute coordinates
of the mechanism, here and nowhere else, and reports failures as RunFailure; it never grades itself.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Protocol

from gauss_bench.mechanism.model import Mechanism
from gauss_bench.terms import Array
from gauss_bench.trajectory import Trajectory

CHOSEN = ("integrator", "stabilization")  # knobs that a run is given beside its settings


@dataclass(frozen=True)
class Choice:
    """The choices of a run: names from the engine's own lists, the step [s], and how exact an adaptive run is to be.

    Attributes:
        tolerance: relative, of an integrator that chooses its own steps (absolute: a hundredth of it, in SI units); None for that
            of the settings.
    """

    settings: str = "default"
    integrator: str = ""
    stabilization: str = "none"
    step: float = 1e-3
    tolerance: float | None = None

    def tolerances(self, relative: float, absolute: float) -> tuple[float, float]:
        """Relative and absolute tolerance: those asked for, else those of the settings."""
        return (relative, absolute) if self.tolerance is None else (self.tolerance, self.tolerance / 100)


@dataclass(frozen=True)
class Variant:
    """One point of the searched space: everything that is chosen but the step or tolerance.

    Attributes:
        options: knob -> value, all of them but `integrator` and `stabilization`.
    """

    name: str
    integrator: str
    stabilization: str
    options: Mapping[str, Any]


class Model(Protocol):
    """A mechanism built in an engine, ready to run."""

    def acceleration(self, t: float, q: Array, v: Array) -> Array:
        """Accelerations (n,) at a given state q, v (n,) in absolute coordinates: what the engine makes of the same state.

        Raises:
            RunFailure: the engine has no usable answer there.
        """
        ...

    def prepare(self, times: Array, native: bool = True) -> None:
        """Reset to q0, v0 at times[0] and allocate for samples at the times (k,); not timed.

        `native` asks for the engine's own loop between samples, else one call per step from Python.
        """
        ...

    def run(self) -> None:
        """Step from times[0] to times[-1]; timed, so nothing but stepping and keeping samples."""
        ...

    def read(self) -> Trajectory:
        """The samples in absolute coordinates, accelerations included; not timed.

        Raises:
            RunFailure: the run is not to be trusted, with a status and a sentence.
        """
        ...


class Engine(Protocol):
    """Builds models of mechanisms.

    It may have `in_python(mechanism, choice)` beside these: what of the suite's own runs in Python inside the time of a run, in
    words; empty where nothing does.

    Attributes:
        name: what the command line and the tables call it.
        integrators: names it offers; the first is its default.
        stabilizations: names it offers.
        settings: label -> options, as printed in the report; the first is its default.
        native_loop: whether it steps in a compiled loop of its own.
        python_loop: whether single steps can be called from Python.
    """

    @property
    def name(self) -> str: ...
    @property
    def integrators(self) -> tuple[str, ...]: ...
    @property
    def stabilizations(self) -> tuple[str, ...]: ...
    @property
    def settings(self) -> Mapping[str, Mapping[str, object]]: ...
    @property
    def native_loop(self) -> bool: ...
    @property
    def python_loop(self) -> bool: ...

    def version(self) -> str:
        """Name and version of the library that computes."""
        ...

    def skip(self, mechanism: Mechanism, choice: Choice) -> str | None:
        """The reason why this mechanism cannot be modelled with this choice, or None. Needs no foreign library."""
        ...

    def build(self, mechanism: Mechanism, choice: Choice) -> Model:
        """The model; timed apart, as build time.

        Raises:
            RunFailure: the engine refuses the model.
        """
        ...
