"""The common part of exports: the kinds of files, the head of every file, and the list of parts that a file leaves out."""

from collections.abc import Mapping
from dataclasses import dataclass
from importlib import import_module

from gauss_bench import __version__
from gauss_bench.engines import get
from gauss_bench.engines.base import Choice
from gauss_bench.engines.shared import unsteady
from gauss_bench.exchange.errors import ExchangeError
from gauss_bench.exchange.text import python_comment
from gauss_bench.mechanism.model import Mechanism
from gauss_bench.trajectory import RunFailure, in_a_sentence


@dataclass(frozen=True)
class Kind:
    """A kind of file.

    Attributes:
        writer: name of the module whose `write` makes the text; empty if the engine writes it itself.
        engine: the suite's engine whose model the file holds.
        settings, integrator, stabilization, tolerance: the setting of that engine in the file.
        what: the kind in words, such as "a Python script".
        suffix: the usual suffix of such files.
    """

    writer: str
    engine: str
    settings: str
    integrator: str
    stabilization: str
    what: str
    suffix: str
    tolerance: float | None = None

    def choose(self, step: float) -> Choice:
        """Return the choice of the engine in a file with this step [s]."""
        return Choice(self.settings, self.integrator, self.stabilization, step, self.tolerance)

    @property
    def is_program(self) -> bool:
        """Whether the file steps the linkage itself; MJCF is a model, which MuJoCo steps."""
        return self.writer != "to_mjcf"


KINDS: Mapping[str, Kind] = {  # those that this folder writes; an engine with a method `program` is one more
    "mujoco": Kind("to_mjcf", "mujoco", "tuned", "rk4", "none", "an MJCF model", ".xml"),
    "pinocchio": Kind("to_pinocchio", "pinocchio", "default", "rk4", "none", "a Python script", ".py"),
    "exudyn": Kind("to_exudyn", "exudyn", "tuned", "generalized_alpha", "none", "a Python script", ".py"),
    "casadi": Kind("to_casadi", "casadi", "default", "rk4", "none", "a Python script with a CasADi function", ".py"),
    "c": Kind("to_c", "gauss-native", "default", "rk4", "projection", "a C program", ".c"),
}
OWNED = "This file is yours: whoever exported it owns it and may use, change and pass it on as they like, without conditions."


@dataclass(frozen=True)
class Exported:
    """The text of a file that is not yet written, and sentences on the parts of the linkage that it leaves out."""

    text: str
    left_out: tuple[str, ...]


def export_linkage(
    mechanism: Mechanism, name: str, step: float, remarks: tuple[str, ...] = (), choice: Choice | None = None, warning: str = ""
) -> Exported:
    """Return a linkage as the text of a file of the kind `name`, one of KINDS.

    Args:
        step: step size of the integration in the file [s].
        remarks: sentences for the head of the file, such as measured errors.
        choice: the setting of the engine; that of the kind with `step` where not given.
        warning: the first sentence of the head.

    Raises:
        ExchangeError: files of this kind cannot express the linkage; the message names the part.
        ImportError: the library that builds the model is not installed.
    """
    kind = KINDS[name]
    choice = choice or kind.choose(step)
    head, missing = write_head(mechanism, remarks, warning)
    reason = unsteady(mechanism, kind.what) or get(kind.engine).skip(mechanism, choice)
    return Exported(write_model(kind.writer, mechanism, choice, head, describe_refusal(mechanism, kind), reason), missing)


def describe_refusal(mechanism: Mechanism, kind: Kind) -> str:
    """Return the beginning of the sentence that says why a linkage cannot become a file of a kind."""
    return f"{mechanism.source}: {mechanism.name}, scenario {mechanism.scenario}: cannot become {kind.what}"


def write_head(mechanism: Mechanism, remarks: tuple[str, ...], warning: str) -> tuple[list[str], tuple[str, ...]]:
    """Return the sentences for the head of a file, and those on the parts of the linkage that no file holds."""
    others = [x for x in mechanism.scenarios if x != mechanism.scenario]
    missing = [f"scenario{'s' * (len(others) > 1)} {', '.join(others)}"] if others else []
    missing += [f"force {f.name}, dry friction without a coefficient" for f in mechanism.frictions if f.mu == 0]
    head = [
        *([warning] if warning else []),
        f"Model of a closed-loop planar linkage, written by gauss-bench {__version__}.",
        OWNED,
        f"Linkage {mechanism.name}, scenario {mechanism.scenario}: {mechanism.title}",
        "Units are SI: m, kg, s, N, rad. The plane is x-y, gravity as the linkage file says.",
        *remarks,
        *(f"Not in this file: {x}" for x in missing),
    ]
    return head, tuple(missing)


def export_program(mechanism: Mechanism, program: str, remarks: tuple[str, ...], warning: str) -> Exported:
    """Return a program in Python that an engine wrote, below the head that every exported file has."""
    head, missing = write_head(mechanism, remarks, warning)
    return Exported(f"{python_comment(head)}\n{program}", missing)


def write_model(writer: str, mechanism: Mechanism, choice: Choice, head: list[str], refused: str, reason: str | None) -> str:
    """Return the text that a module of this folder writes.

    Raises:
        ExchangeError: a `reason` is given, or the adapter refuses the model; the message begins with `refused`.
        ImportError: the library that builds the model is not installed.
    """
    if reason:
        raise ExchangeError(f"{refused}: {in_a_sentence(reason)}")
    try:
        return str(import_module(f"gauss_bench.exchange.{writer}").write(mechanism, choice, head))
    except RunFailure as failure:
        raise ExchangeError(f"{refused}: {in_a_sentence(failure)}") from failure
