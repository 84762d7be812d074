"""The common parts of all exports: the kinds of files, the head of every file, and the list of parts that a file leaves out.

A snippet is a program for users to copy, with a shorter head. It runs a linkage in an engine by calls of the engine's library or of
this package.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from importlib import import_module

from gauss_bench import __version__
from gauss_bench.engines import get
from gauss_bench.engines.base import Choice
from gauss_bench.engines.shared import unsteady
from gauss_bench.exchange.errors import ExchangeError
from gauss_bench.exchange.scripts import write_program
from gauss_bench.exchange.text import python_comment
from gauss_bench.mechanism.model import Mechanism
from gauss_bench.trajectory import RunFailure, in_a_sentence


@dataclass(frozen=True)
class Kind:
    """A kind of exported file.

    Attributes:
        writer: module of this folder whose function `write` returns the text; "" if the engine writes its programs itself.
        engine: engine of the suite whose model the file holds.
        settings, integrator, stabilization, tolerance: the setting of that engine in the file.
        what: the kind of file in words, such as "a Python script".
        suffix: ending of the file's name, such as ".py".
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
        """Return the engine settings that an exported file contains if it is written for this step size [s]."""
        return Choice(self.settings, self.integrator, self.stabilization, step, self.tolerance)

    @property
    def is_program(self) -> bool:
        """Whether the file is a program that integrates the motion; an MJCF file is only a model, which MuJoCo integrates."""
        return self.writer != "to_mjcf"


KINDS: Mapping[str, Kind] = {  # name -> kind of file; an engine with a method `program` is a kind too
    "mujoco": Kind("to_mjcf", "mujoco", "tuned", "rk4", "none", "an MJCF model", ".xml"),
    "pinocchio": Kind("to_pinocchio", "pinocchio", "default", "rk4", "none", "a Python script", ".py"),
    "exudyn": Kind("to_exudyn", "exudyn", "tuned", "generalized_alpha", "none", "a Python script", ".py"),
    "casadi": Kind("to_casadi", "casadi", "default", "rk4", "none", "a Python script with a CasADi function", ".py"),
    "c": Kind("to_c", "gauss-native", "default", "rk4", "projection", "a C program", ".c"),
}
# engines for which `to_ENGINE.py` of this folder writes programs; other engines may have a method `program` (`engines/base.py`)
WRITERS = ("mujoco", "pinocchio", "exudyn", "casadi")
OWNED = "This file is yours: whoever exported it owns it and may use, change and pass it on as they like, without conditions."


@dataclass(frozen=True)
class Exported:
    """The text of a file to be written, and a phrase for each part of the linkage that the text leaves out."""

    text: str
    left_out: tuple[str, ...]


def export_linkage(
    mechanism: Mechanism, name: str, step: float, remarks: tuple[str, ...] = (), choice: Choice | None = None, warning: str = ""
) -> Exported:
    """Return a linkage as the text of a file of the kind `name`, which is a key of KINDS.

    Args:
        step: step size of the integration in the file [s]; ignored if `choice` is given.
        remarks: sentences for the head of the file, below the `warning`.
        choice: setting of the engine; by default that of KINDS.

    Raises:
        ExchangeError: files of this kind cannot express the linkage; the message names the part.
        ImportError: the library that builds the model is not installed.
    """
    kind = KINDS[name]
    choice = choice or kind.choose(step)
    left_out = list_left_out(mechanism)
    head = write_head(mechanism, remarks, warning, left_out)
    reason = unsteady(mechanism, kind.what) or get(kind.engine).skip(mechanism, choice)
    return Exported(write_model(kind.writer, mechanism, choice, head, describe_refusal(mechanism, kind), reason), left_out)


def describe_refusal(mechanism: Mechanism, kind: Kind) -> str:
    """Return the beginning of a message that says why a linkage cannot be exported as this kind of file."""
    return f"{mechanism.source}: {mechanism.name}, scenario {mechanism.scenario}: cannot become {kind.what}"


def list_left_out(mechanism: Mechanism) -> tuple[str, ...]:
    """Return a phrase for each part that the exported file leaves out: other scenarios, and dry friction with coefficient 0.

    A linkage with a larger coefficient is refused.
    """
    others = [x for x in mechanism.scenarios if x != mechanism.scenario]
    left_out = [f"{'scenarios' if len(others) > 1 else 'scenario'} {', '.join(others)}"] if others else []
    left_out += [f"force {f.name}, dry friction with coefficient 0" for f in mechanism.frictions if f.mu == 0]
    return tuple(left_out)


def write_head(mechanism: Mechanism, remarks: tuple[str, ...], warning: str, left_out: tuple[str, ...]) -> list[str]:
    """Return the sentences for the head of an exported file, with the `warning` first if there is one."""
    return [
        *([warning] if warning else []),
        f"Model of a closed-loop planar linkage, written by gauss-bench {__version__}.",
        OWNED,
        f"Linkage {mechanism.name}, scenario {mechanism.scenario}: {mechanism.title}",
        "Units are SI: m, kg, s, N, rad. The plane is x-y, and gravity is that of the linkage file.",
        *remarks,
        *(f"Not in this file: {x}" for x in left_out),
    ]


def export_program(mechanism: Mechanism, program: str, remarks: tuple[str, ...], warning: str) -> Exported:
    """Return a Python program that an engine wrote, below the head that every exported file has."""
    left_out = list_left_out(mechanism)
    return Exported(f"{python_comment(write_head(mechanism, remarks, warning, left_out))}\n{program}", left_out)


def write_model(writer: str, mechanism: Mechanism, choice: Choice, head: list[str], refusal: str, reason: str | None) -> str:
    """Return the text that the module `writer` of this folder writes.

    Args:
        head: sentences for the comment at the head of the file.
        refusal: beginning of the error message if the linkage cannot be exported.
        reason: why the linkage cannot be exported, if this is known beforehand.

    Raises:
        ExchangeError: `reason` is given, or the engine's adapter cannot model the linkage.
        ImportError: the library that builds the model is not installed.
    """
    if reason:
        raise ExchangeError(f"{refusal}: {in_a_sentence(reason)}")
    try:
        return str(import_module(f"gauss_bench.exchange.{writer}").write(mechanism, choice, head))
    except RunFailure as failure:
        raise ExchangeError(f"{refusal}: {in_a_sentence(failure)}") from failure


def can_export(engine: str, integrator: str, stabilization: str, code: str = "") -> bool:
    """Tell whether an exported program can use this integrator and stabilisation; `code` is the value of CasADi's option."""
    if engine == "pinocchio":  # the suite's own projection is not a part of scripts
        return stabilization != "projection"
    if engine == "casadi":  # a script integrates by CVODES or in CasADi's virtual machine, never by compiled C
        return stabilization == "none" and (integrator.startswith("cvodes") or code == "virtual machine")
    return True


def write_snippet(mechanism: Mechanism, linkage: str, engine: str, choice: Choice, until: float, remarks: tuple[str, ...]) -> str:
    """Return a Python program that runs a linkage: by the library of an engine in WRITERS, or by this package.

    Args:
        linkage, until: name or file of the linkage, and end time of the run [s], for a program that calls this package.
        remarks: sentences for the comment at the beginning of the program.

    Raises:
        ExchangeError: a program that calls the library cannot express the linkage with these settings.
        ImportError: the engine is not installed.
    """
    if engine not in WRITERS:
        variables = {"linkage": linkage, "engine": engine, "until": until}
        return write_program("gauss_bench.py.jinja", mechanism, choice, list(remarks), **variables)
    refusal, reason = f"{mechanism.source}: no program for {engine}", unsteady(mechanism, "such a program")
    return write_model(f"to_{engine}", mechanism, choice, write_snippet_head(mechanism, remarks), refusal, reason)


def write_snippet_head(mechanism: Mechanism, remarks: tuple[str, ...]) -> list[str]:
    """Return the sentences on the linkage for the comment at the beginning of a program that uses an engine's library."""
    return [f"Linkage {mechanism.name}, scenario {mechanism.scenario}. Units are SI.", *remarks, OWNED]


def add_head(mechanism: Mechanism, program: str, remarks: tuple[str, ...]) -> str:
    """Return a Python program that an engine wrote, below the comment with which programs of `write_snippet` begin."""
    return f"{python_comment(write_snippet_head(mechanism, remarks))}\n{program}"
