"""The interface of every engine: how a mechanism is built, how it is stepped, and how the samples are read.

The bench measures time: it times `run`, and never `prepare` and `read`. An engine alone translates between its own coordinates and
the absolute coordinates of the mechanism. It reports failures as RunFailure; whether its results are right is judged elsewhere.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from gauss_bench.mechanism.model import Mechanism
from gauss_bench.terms import Array
from gauss_bench.trajectory import Trajectory

CHOSEN = ("integrator", "stabilization")  # knobs that are fields of a Choice, so that settings have no value for them


@dataclass(frozen=True)
class Choice:
    """The setting of a run: names from the engine's own lists, the step size, and the tolerance of an adaptive integrator.

    Attributes:
        settings: name of settings or of a variant, or options as `own_options` describes them.
        integrator: "" stands for the engine's default.
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
        """Return the relative and absolute tolerance of this choice, or the two arguments if it has none."""
        return (relative, absolute) if self.tolerance is None else (self.tolerance, self.tolerance / 100)


@dataclass(frozen=True)
class Variant:
    """One candidate of a search: a complete setting, except for the step size or tolerance.

    Attributes:
        options: knob -> value, for every knob except `integrator` and `stabilization`.
        owner: the engine's authors if the setting is theirs; empty if it is the suite's.
    """

    name: str
    integrator: str
    stabilization: str
    options: Mapping[str, Any]
    owner: str = ""


def sample_arrays(times: Array, *start: Array) -> list[Array]:
    """Return one array (k, n) for each value (n,) at the start, with this value in the first row and NaN in the others."""
    arrays = [np.full((len(times), len(value)), np.nan) for value in start]
    for samples, value in zip(arrays, start, strict=True):
        samples[0] = value
    return arrays


class Model(Protocol):
    """A mechanism built in an engine; it can run any number of times, each time after `prepare`."""

    def acceleration(self, t: float, q: Array, v: Array) -> Array:
        """Return the engine's accelerations (n,) at a given state q, v (n,), all in absolute coordinates.

        Raises:
            RunFailure: the engine has no usable accelerations there.
        """
        ...

    def prepare(self, times: Array, native: bool = True) -> None:
        """Reset to q0, v0 at times[0], and allocate memory for samples at the times (k,); not timed.

        With `native` the engine's own loop takes the steps between samples; without it, Python calls the engine once per step.
        """
        ...

    def run(self) -> None:
        """Step from times[0] to times[-1]; timed, so it only takes steps and stores samples."""
        ...

    def read(self) -> Trajectory:
        """Return the samples in absolute coordinates, with their accelerations; not timed.

        Raises:
            RunFailure: the samples must not be used; it carries a status and a sentence.
        """
        ...


class Engine(Protocol):
    """An engine, which builds models of mechanisms.

    It may also have a method `in_python(mechanism, choice)`, which names the suite's own Python code that runs inside the timed
    part of a run; the text is empty if there is none.

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
        """Return the name and the version of the library that computes."""
        ...

    def skip(self, mechanism: Mechanism, choice: Choice) -> str | None:
        """Return the reason why this mechanism cannot be modelled with this choice, or None; it needs no foreign library."""
        ...

    def build(self, mechanism: Mechanism, choice: Choice) -> Model:
        """Return the model of a mechanism; the time to build it is measured apart from runs.

        Raises:
            RunFailure: the engine refuses the model.
        """
        ...
