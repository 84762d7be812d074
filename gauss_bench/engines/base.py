"""The interface of engines: an engine builds a model of a mechanism, and the model runs and returns its samples.

The bench times `run`, but not `prepare` and `read`, and judges whether results are right. Only the engine translates between its
own coordinates and the absolute coordinates of the mechanism. It reports failures as RunFailure.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from gauss_bench.mechanism.model import Mechanism
from gauss_bench.terms import Array
from gauss_bench.trajectory import RunFailure, Status, Trajectory

NOT_TOLD = "not told"  # the answer of an engine that does not say which Python code its timed runs execute
EMPTY: Mapping[str, Any] = {}
CHOSEN = ("integrator", "stabilization")  # options that are fields of `Choice`: settings give them no value


@dataclass(frozen=True)
class Choice:
    """The setting of a run.

    Attributes:
        settings: name of settings or of a variant of the engine, or options in the form of `own_options`.
        integrator: name of an integrator of the engine; "" stands for the engine's default.
        step: step size [s] of a fixed-step integrator.
        tolerance: relative tolerance of an integrator that chooses its own steps; the absolute tolerance is a hundredth of it, in
            SI units. If it is None, the settings give both tolerances.
    """

    settings: str = "default"
    integrator: str = ""
    stabilization: str = "none"
    step: float = 1e-3
    tolerance: float | None = None

    def tolerances(self, relative: float, absolute: float) -> tuple[float, float]:
        """Return the relative and absolute tolerance of this choice; if it has none, return the arguments."""
        return (relative, absolute) if self.tolerance is None else (self.tolerance, self.tolerance / 100)


@dataclass(frozen=True)
class Variant:
    """A candidate of a search: a setting without its step size or tolerance, which the search chooses.

    Attributes:
        options: knob -> value, for every knob except `integrator` and `stabilization`.
        owner: names of the engine's authors if they wrote the setting; empty if the suite's authors did.
    """

    name: str
    integrator: str
    stabilization: str
    options: Mapping[str, Any]
    owner: str = ""


def sample_arrays(times: Array, *start: Array) -> list[Array]:
    """Return an array (k, n) of samples for each start value (n,): the first row is the start value, and all others are NaN."""
    arrays = [np.full((len(times), len(value)), np.nan) for value in start]
    for samples, value in zip(arrays, start, strict=True):
        samples[0] = value
    return arrays


class Model(Protocol):
    """A mechanism built in an engine; it can run many times, each time after a call of `prepare`.

    A model may also have the members of `ModelDefaults`.
    """

    def acceleration(self, t: float, q: Array, v: Array) -> Array:
        """Return the engine's accelerations (n,) at time t [s] and a state q, v (n,), all in absolute coordinates.

        Raises:
            RunFailure: the engine finds no accelerations at that state.
        """
        ...

    def prepare(self, times: Array, native: bool = True) -> None:
        """Reset to q0, v0 at times[0], and allocate memory for the samples at `times` (k,) [s]; this call is not timed.

        Args:
            native: whether the engine's own loop takes the steps between samples; otherwise Python calls the engine for every step.
        """
        ...

    def run(self) -> None:
        """Step from times[0] to times[-1] and store the samples, without any other work, because this call is timed."""
        ...

    def read(self) -> Trajectory:
        """Return the samples in absolute coordinates, with their accelerations; this call is not timed.

        The trajectory's `steps` is None if the library chooses its steps and does not count them.

        Raises:
            RunFailure: the samples must not be used; the failure has a status and a sentence.
        """
        ...


class Engine(Protocol):
    """An engine builds models of mechanisms. An engine may also have the optional members of `EngineDefaults`.

    Attributes:
        integrators: names of the engine's integrators; the first is the default.
        stabilizations: names of the engine's constraint stabilisations, such as "none".
        settings: label of settings -> (name of an option -> value), as printed in the report; the first label is the default.
        native_loop: whether the engine has a compiled loop over steps.
        python_loop: whether Python can call the engine for single steps.
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
        """Return the name and the version of the library."""
        ...

    def skip(self, mechanism: Mechanism, choice: Choice) -> str | None:
        """Return the reason why the engine cannot simulate a mechanism with a given setting, or None if it can.

        This method is also called where the library is not installed, so it must not import the library.
        """
        ...

    def build(self, mechanism: Mechanism, choice: Choice) -> Model:
        """Return the model of a mechanism; the bench times this call apart from runs.

        Raises:
            RunFailure: the engine refuses the model.
        """
        ...


@dataclass(frozen=True, eq=False)
class LibraryCall:
    """One evaluation of a library's right-hand side, in the library's coordinates, as an expert of the library would call it.

    Attributes:
        acceleration: (n,) result of the call, translated to absolute coordinates.
        ready: function that is called, untimed, before every `call`; only if `count` is not 1.
        count: number of right-hand sides, or implicit steps, in one call.
    """

    call: Callable[[], object]
    acceleration: Array
    ready: Callable[[], object] = lambda: None
    count: int = 1


class EngineDefaults:
    """All optional members of an engine, each with its default, which `ask` returns if an engine lacks the member.

    An engine need not inherit from this class.

    Attributes:
        adaptive: names of the integrators that choose their own steps; they use `Choice.tolerance` in place of `Choice.step`.
        variants: name -> `Variant`, the candidates of a search; if there are none, a search tries every combination of settings,
            integrator and stabilisation.
        knobs: name of an option -> object with `meaning`, `source` and `values`, as `variants.read_variants` returns them; users
            can set each of these options alone (`--settings KNOB=VALUE`).
        options: names of options that users can set alone, for an engine that has no `knobs`.
        first: names of the variants to which a brief search is limited; `recommend` tries them before all others.
        soft: name of settings or of a variant -> the reason why its accelerations satisfy J a = gamma only approximately.
        unfinished: name of a variant -> the reason why the variant's solver stops before it has converged.
        resizable: whether models use a new step or tolerance after their attribute `choice` was replaced between two runs.
        library_calls: name of a call -> function (mechanism, q, v) that returns the `LibraryCall` at a state q, v (n,); the
            subcommand `growth` times each of these calls.
        packages: names of installed packages whose versions are recorded with a run.
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
        """Name the Python code that a timed run executes outside the library; an empty text if there is none."""
        return NOT_TOLD

    def unbuilt(self, settings: str) -> str:
        """Name the code that these settings need and that is not compiled yet; an empty text if there is none."""
        return ""

    def build_once(self) -> None:
        """Compile the code that is stored for all later runs; called before anything is timed."""

    def program(self, mechanism: Mechanism, choice: Choice) -> str:
        """Return a Python program, without this package, that runs the scenario over its duration with this choice.

        `export` and `recommend --out` write it to a file.

        Raises:
            RunFailure: the engine cannot write a program for this mechanism or choice.
        """
        raise RunFailure(Status.SKIP, "the engine writes no programs")


class ModelDefaults:
    """All optional members of a model, each with its default, which `ask` returns if a model lacks the member."""

    def joint_forces(self, t: float, q: Array, v: Array) -> Mapping[str, Array]:
        """Return name of a joint -> (3,) the engine's fx, fy [N] and moment [N m] on the joint's second link, about the joint.

        Joints whose forces the engine does not compute at this time [s] and absolute state q, v (n,) are left out, by default all.

        Raises:
            RunFailure: the engine cannot compute joint forces at this state.
        """
        return {}

    def bare_calls(self) -> tuple[Callable[[], object], Callable[[], object]]:
        """Return two functions: the library's own call alone, and a trivial call of the library, which measures the call overhead.

        Both are timed for the engines that a suite lists under `bare`.

        Raises:
            RunFailure: the engine does not provide these two functions.
        """
        raise RunFailure(Status.SKIP, "the engine cannot call its library alone")

    def batch(self, q: Array, v: Array, steps: int) -> Callable[[], Array]:
        """Return a function that takes `steps` steps from each of the states q, v (k, n), all in one call.

        It is timed for the engines that a suite lists under `batch`.

        Raises:
            RunFailure: the engine cannot step many trajectories in one call.
        """
        raise RunFailure(Status.SKIP, "the engine cannot step many trajectories in one call")


# name of an optional member -> the class that has its default
OPTIONAL = {name: kind for kind in (EngineDefaults, ModelDefaults) for name in vars(kind) if not name.startswith("_")}
REQUIRED = ("version", "skip", "build")  # methods without which an object is no engine


def ask(asked: object, member: str) -> Any:
    """Return an optional member of an engine or model, or the default if it lacks the member.

    Raises:
        KeyError: `member` is not the name of an optional member.
    """
    return getattr(asked, member, getattr(OPTIONAL[member](), member))


def has_own(asked: object, member: str) -> bool:
    """Tell whether an engine or model replaces the default of an optional member; a KeyError if there is no such member."""
    default = getattr(OPTIONAL[member], member)
    return hasattr(asked, member) and getattr(type(asked), member, None) is not default


def list_lacking(engine: object) -> list[str]:
    """List the methods of REQUIRED that an object lacks."""
    return [x for x in REQUIRED if not callable(getattr(engine, x, None))]
