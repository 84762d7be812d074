"""Programs for users to copy: an engine with a setting, as a program that uses the engine's library without this package."""

from gauss_bench.engines.base import Choice
from gauss_bench.engines.shared import unsteady
from gauss_bench.exchange.export import OWNED, write_model
from gauss_bench.exchange.scripts import write_program
from gauss_bench.exchange.text import python_comment
from gauss_bench.mechanism.model import Mechanism

# engines whose programs this folder writes; others may write their own (`program` in `engines/base.py`)
WRITERS = {"mujoco": "to_mujoco", "pinocchio": "to_pinocchio", "exudyn": "to_exudyn", "casadi": "to_casadi"}


def holds(engine: str, integrator: str, stabilization: str, code: str = "") -> bool:
    """Tell whether a program for an engine can use this integrator and stabilisation; `code` is CasADi's option of that name."""
    if engine == "pinocchio":
        return stabilization != "projection"
    if engine == "casadi":
        return stabilization == "none" and (integrator.startswith("cvodes") or code == "virtual machine")
    return True


def snippet(mechanism: Mechanism, linkage: str, engine: str, choice: Choice, until: float, remarks: tuple[str, ...] = ()) -> str:
    """Return a program in Python that runs the linkage in an engine; for the suite's own engines it calls this package.

    Raises:
        ExchangeError: a program cannot express the linkage with this choice; the message gives the reason.
        ImportError: the engine is not installed.
    """
    if engine not in WRITERS:
        given = {"linkage": linkage, "engine": engine, "until": until}
        return write_program("gauss_bench.py.jinja", mechanism, choice, list(remarks), **given)
    head = write_head(mechanism, remarks)
    refused, reason = f"{mechanism.source}: no program for {engine}", unsteady(mechanism, "such a program")
    return write_model(WRITERS[engine], mechanism, choice, head, refused, reason)


def write_head(mechanism: Mechanism, remarks: tuple[str, ...]) -> list[str]:
    """Return the sentences for the head of a program that uses an engine's library."""
    return [f"Linkage {mechanism.name}, scenario {mechanism.scenario}. Units are SI.", *remarks, OWNED]


def with_head(mechanism: Mechanism, program: str, remarks: tuple[str, ...]) -> str:
    """Return a program in Python that an engine wrote, below the head of such programs."""
    return f"{python_comment(write_head(mechanism, remarks))}\n{program}"
