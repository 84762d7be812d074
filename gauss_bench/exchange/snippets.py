"""Programs for users to copy: each runs a linkage in an engine, by calls of the engine's library or of this package."""

from gauss_bench.engines.base import Choice
from gauss_bench.engines.shared import unsteady
from gauss_bench.exchange.export import OWNED, write_model
from gauss_bench.exchange.scripts import write_program
from gauss_bench.exchange.text import python_comment
from gauss_bench.mechanism.model import Mechanism

# engines for which `to_ENGINE.py` of this folder writes programs; others may write their own (`program` in `engines/base.py`)
WRITERS = ("mujoco", "pinocchio", "exudyn", "casadi")


def holds(engine: str, integrator: str, stabilization: str, code: str = "") -> bool:
    """Tell whether an exported program can use this integrator and stabilisation; `code` is how CasADi evaluates functions."""
    if engine == "pinocchio":  # the suite's own projection is not a part of scripts
        return stabilization != "projection"
    if engine == "casadi":  # a script integrates by CVODES, or in CasADi's virtual machine, and never as compiled C
        return stabilization == "none" and (integrator.startswith("cvodes") or code == "virtual machine")
    return True


def snippet(mechanism: Mechanism, linkage: str, engine: str, choice: Choice, until: float, remarks: tuple[str, ...] = ()) -> str:
    """Return a Python program that runs a linkage: by an engine's library alone if it is one of WRITERS, else by this package.

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
    return write_model(f"to_{engine}", mechanism, choice, write_head(mechanism, remarks), refusal, reason)


def write_head(mechanism: Mechanism, remarks: tuple[str, ...]) -> list[str]:
    """Return the sentences on the linkage for the comment at the beginning of a program that uses an engine's library."""
    return [f"Linkage {mechanism.name}, scenario {mechanism.scenario}. Units are SI.", *remarks, OWNED]


def with_head(mechanism: Mechanism, program: str, remarks: tuple[str, ...]) -> str:
    """Return a Python program that an engine wrote, preceded by the same comment that begins the programs of this module."""
    return f"{python_comment(write_head(mechanism, remarks))}\n{program}"
