"""Settings to paste: a choice of an engine, as a program in that engine's own language that runs without this package."""

from gauss_bench.engines.base import Choice
from gauss_bench.engines.shared import unsteady
from gauss_bench.exchange.export import OWNED, write_model
from gauss_bench.exchange.scripts import write_program
from gauss_bench.mechanism.model import Mechanism

WRITERS = {"mujoco": "to_mujoco", "pinocchio": "to_pinocchio", "exudyn": "to_exudyn", "casadi": "to_casadi"}


def holds(engine: str, integrator: str, stabilization: str, code: str = "") -> bool:
    """Tell whether a program of that engine can be written with these steps; `code` is CasADi's knob."""
    if engine == "pinocchio":
        return stabilization != "projection"
    if engine == "casadi":
        return stabilization == "none" and (integrator.startswith("cvodes") or code == "virtual machine")
    return True


def snippet(mechanism: Mechanism, linkage: str, engine: str, choice: Choice, until: float, remarks: tuple[str, ...] = ()) -> str:
    """The program, in Python: alone in the engine, or where the engine is this package's own, a call of it.

    Raises:
        ExchangeError: no program can hold the linkage with this choice; naming what.
        ImportError: the engine is not installed.
    """
    if engine not in WRITERS:
        settings = choice.settings
        if choice.tolerance is not None:
            own = f"dop853_rtol={choice.tolerance:g},dop853_atol={choice.tolerance / 100:g}"
            settings = own if settings == "default" else f"{settings},{own}"
        given = {"linkage": linkage, "engine": engine, "settings": settings, "until": until}
        return write_program("gauss_bench.py.jinja", mechanism, choice, list(remarks), **given)
    head = [f"Linkage {mechanism.name}, scenario {mechanism.scenario}. Units are SI.", *remarks, OWNED]
    refused, reason = f"{mechanism.source}: no program for {engine}", unsteady(mechanism, "such a program")
    return write_model(WRITERS[engine], mechanism, choice, head, refused, reason)
