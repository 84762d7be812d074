"""The interface of every engine: how a mechanism is built, stepped and read back.

The bench owns the clock: `prepare` and `read` are never timed, `run` is. An engine translates to and from the absolute coordinates
of the mechanism, here and nowhere else, and reports failures as RunFailure; it never grades itself.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from gauss_bench.mechanism.model import Mechanism
from gauss_bench.terms import Array
from gauss_bench.trajectory import Trajectory

CHOSEN = ("integrator", "stabilization")  # knobs that a run is given beside its settings


@dataclass(frozen=True)
class Choice:
    """The setting of a run: names from the engine's own lists, the step size, and the tolerance of an adaptive integrator.

    Attributes:
        step: step size [s] of a fixed-step integrator.
        tolerance: relative tolerance of an integrator that chooses its own steps; the absolute tolerance is a hundredth of it, in
            SI units. None takes both tolerances from the settings.
    """

    settings: str = "default"
    integrator: str = ""
    stabilization: str = "none"
    step: float = 1e-3
    tolerance: float | None = None

    def tolerances(self, relative: float, absolute: float) -> tuple[float, float]:
        """Return the relative and absolute tolerance: this choice's own where it has one, else the two that are passed in."""
        return (relative, absolute) if self.tolerance is None else (self.tolerance, self.tolerance / 100)


@dataclass(frozen=True)
class Variant:
    """One candidate of a search: a complete setting, except for the step size or tolerance.

    Attributes:
        options: knob -> value, for every knob except `integrator` and `stabilization`.
    """

    name: str
    integrator: str
    stabilization: str
    options: Mapping[str, Any]


def sample_arrays(times: Array, *start: Array) -> list[Array]:
    """Return an array (k, n) for each value (n,) at the start: it holds this value in its first row, and NaN until a run fills it."""
    arrays = [np.full((len(times), len(value)), np.nan) for value in start]
    for samples, value in zip(arrays, start, strict=True):
        samples[0] = value
    return arrays


class Model(Protocol):
    """A mechanism built in an engine, ready to run."""

    def acceleration(self, t: float, q: Array, v: Array) -> Array:
        """Return the engine's accelerations (n,) at a given state q, v (n,), all in absolute coordinates.

        Raises:
            RunFailure: the engine has no usable accelerations there.
        """
        ...

    def prepare(self, times: Array, native: bool = True) -> None:
        """Reset to q0, v0 at times[0] and allocate for samples at the times (k,); not timed.

        With `native` the engine's own loop takes the steps between samples; without it, Python calls the engine once per step.
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

    An engine may also have `in_python(mechanism, choice)`, which names the suite's own Python code that runs inside the timed part
    of a run; the text is empty if there is none.

    Attributes:
        name: its name on the command line and in the tables.
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
        """Return the reason why this mechanism cannot be modelled with this choice, or None. Needs no foreign library."""
        ...

    def build(self, mechanism: Mechanism, choice: Choice) -> Model:
        """Build the model; its build time is measured apart from runs.

        Raises:
            RunFailure: the engine refuses the model.
        """
        ...
