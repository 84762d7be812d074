"""The interface of every engine: how a mechanism is built, how it is stepped, and how the samples are read.

The bench measures time: it times `run`, and never `prepare` and `read`. An engine alone translates between its own coordinates and
the absolute coordinates of the mechanism. It reports failures as RunFailure; whether its results are right is judged elsewhere.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from gauss_bench.mechanism.model import Mechanism
from gauss_bench.terms import Array
from gauss_bench.trajectory import RunFailure, Status, Trajectory

NOT_TOLD = "not told"
EMPTY: Mapping[str, Any] = {}
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
    """A mechanism built in an engine; it can run any number of times, each time after `prepare`.

    It may have the further members of `ModelDefaults`.
    """

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

        The trajectory's `steps` is None if the library does not count the steps that it chooses.

        Raises:
            RunFailure: the samples must not be used; it carries a status and a sentence.
        """
        ...


class Engine(Protocol):
    """An engine, which builds models of mechanisms. It may have the further members of `EngineDefaults`.

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


@dataclass(frozen=True, eq=False)
class LibraryCall:
    """One evaluation of a library's right-hand side, in its own coordinates, as an expert of the library would call it.

    Attributes:
        call: the function that is timed.
        acceleration: (n,) result of the call, translated to absolute coordinates.
        ready: preparation before every call, not timed; by default it does nothing.
        count: number of right-hand sides, or implicit steps, in one call.
    """

    call: Callable[[], object]
    acceleration: Array
    ready: Callable[[], object] = lambda: None
    count: int = 1


class EngineDefaults:
    """All optional members of an engine, each as the suite takes it where an engine lacks it; `ask` reads them.

    An engine need not inherit from this class.

    Attributes:
        adaptive: integrators that choose their own steps; the tolerance of a choice is meant for them.
        variants: name -> `Variant`, the candidates of a search; without any, a search tries every setting, integrator and
            stabilisation.
        knobs: name -> object with `meaning`, `source` and `values`, as `variants.read_variants` returns them; each can be given by
            itself (`--settings KNOB=VALUE`).
        options: names that can be given by themselves, of an engine without knobs.
        first: names of the variants that a search tries first if its time is short.
        soft: name of settings or of a variant -> why J a = gamma holds only roughly under it.
        unfinished: name of a variant -> why its solver stops before it has converged.
        resizable: whether a model takes another step or tolerance if its attribute `choice` is replaced between two runs.
        library_calls: name -> function (mechanism, q, v) -> `LibraryCall`, at a state q, v (n,); `growth` times each.
        packages: names of installed packages whose versions belong to the provenance of a run.
    """

    adaptive: Sequence[str] = ("dop853",)
    variants: Mapping[str, Variant] = EMPTY
    knobs: Mapping[str, Any] = EMPTY
    options: Sequence[str] = ()
    first: Sequence[str] = ()
    soft: Mapping[str, str] = EMPTY
    unfinished: Mapping[str, str] = EMPTY
    resizable: bool = False
    library_calls: Mapping[str, Callable[[Mechanism, Array, Array], LibraryCall]] = EMPTY
    packages: Sequence[str] = ()

    def in_python(self, mechanism: Mechanism, choice: Choice) -> str:
        """Name the Python code besides the library that runs inside the timed part of a run; empty if there is none."""
        return NOT_TOLD

    def unbuilt(self, settings: str) -> str:
        """Name the code that these settings need and that is not compiled yet; empty if there is none."""
        return ""

    def build_once(self) -> None:
        """Compile, before anything is timed, the code that is stored for all later runs."""

    def program(self, mechanism: Mechanism, choice: Choice) -> str:
        """Return a program in Python that runs the scenario over its duration with this choice, without this package.

        `export` and `recommend --out` write it below a head of comments, which they add.

        Raises:
            RunFailure: no program can be written for this mechanism or choice.
        """
        raise RunFailure(Status.SKIP, "the engine writes no programs")


class ModelDefaults:
    """All optional members of a model, each as the suite takes it where a model lacks it; `ask` reads them."""

    def joint_forces(self, t: float, q: Array, v: Array) -> Mapping[str, Array]:
        """Return name of a joint -> (3,) the engine's own fx, fy [N] on its second link and moment [N m] about its point.

        The state q, v (n,) is in absolute coordinates. Joints that the engine cannot tell are left out.

        Raises:
            RunFailure: the engine has no forces there.
        """
        return {}

    def bare_calls(self) -> tuple[Callable[[], object], Callable[[], object]]:
        """Return the bare library call, and a call that does nothing else; asked of engines that a suite lists as `bare`.

        Raises:
            RunFailure: there are none.
        """
        raise RunFailure(Status.SKIP, "the engine has no bare call of its library")

    def batch(self, q: Array, v: Array, steps: int) -> Callable[[], Array]:
        """Return a call that steps many trajectories at once; asked of engines that a suite lists as `batch`.

        Raises:
            RunFailure: there is none.
        """
        raise RunFailure(Status.SKIP, "the engine has no steps of many trajectories at once")


def _list_members(defaults: type) -> dict[str, type]:
    """Return member -> the class that holds its default."""
    return {name: defaults for name in vars(defaults) if not name.startswith("_")}


OPTIONAL = {**_list_members(EngineDefaults), **_list_members(ModelDefaults)}
REQUIRED = ("version", "skip", "build")  # methods without which an object is no engine


def ask(asked: object, member: str) -> Any:
    """Return an optional member of an engine or model, or the default where it has none.

    Raises:
        KeyError: there is no optional member of that name.
    """
    return getattr(asked, member, getattr(OPTIONAL[member](), member))


def has_own(asked: object, member: str) -> bool:
    """Tell whether an engine or model has an optional member of its own, which is not the inherited default.

    Raises:
        KeyError: there is no optional member of that name.
    """
    default = getattr(OPTIONAL[member], member)
    return hasattr(asked, member) and getattr(type(asked), member, None) is not default


def list_lacking(engine: object) -> list[str]:
    """List the required methods that an object lacks."""
    return [x for x in REQUIRED if not callable(getattr(engine, x, None))]
