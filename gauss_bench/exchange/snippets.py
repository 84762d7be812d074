"""Settings to paste: a choice of an engine, as a program in that engine's own language that runs without this package."""

from collections.abc import Callable
from importlib import import_module

from gauss_bench.engines.base import Choice
from gauss_bench.engines.shared import unsteady
from gauss_bench.exchange.errors import ExchangeError
from gauss_bench.exchange.export import OWNED
from gauss_bench.exchange.text import python_comment
from gauss_bench.mechanism.model import Mechanism
from gauss_bench.trajectory import RunFailure, in_a_sentence

WRITERS = {"mujoco": "to_mujoco", "pinocchio": "to_pinocchio", "exudyn": "to_exudyn", "casadi": "to_casadi"}
OURS = """import gauss_bench

run = gauss_bench.simulate(
    {linkage},
    engine={engine},
    scenario={scenario},
    settings={settings},
    integrator={integrator},
    stabilization={stabilization},
    step={step},{remark}
    at={at},
)
print(run.to_json())
"""


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
        return _ours(mechanism, linkage, engine, choice, until, remarks)
    if reason := unsteady(mechanism, "such a program"):
        raise ExchangeError(f"{mechanism.source}: no program for {engine}: {reason}")
    write: Callable[[Mechanism, Choice, list[str]], str]
    write = getattr(import_module(f"gauss_bench.exchange.{WRITERS[engine]}"), f"write_{engine}")
    head = [f"Linkage {mechanism.name}, scenario {mechanism.scenario}. Units are SI.", *remarks, OWNED]
    try:
        return write(mechanism, choice, head)
    except RunFailure as failure:
        raise ExchangeError(f"{mechanism.source}: no program for {engine}: {in_a_sentence(failure)}") from failure


def _ours(mechanism: Mechanism, linkage: str, engine: str, choice: Choice, until: float, remarks: tuple[str, ...]) -> str:
    settings, remark = choice.settings, ""
    if choice.tolerance is not None:
        own = f"dop853_rtol={choice.tolerance:g},dop853_atol={choice.tolerance / 100:g}"
        settings, remark = own if settings == "default" else f"{settings},{own}", "  # the distance of samples"
    named = {"linkage": linkage, "engine": engine, "scenario": mechanism.scenario, "settings": settings}
    named |= {"integrator": choice.integrator, "stabilization": choice.stabilization}
    texts = {key: ascii(x) for key, x in named.items()}
    return python_comment(remarks) + OURS.format(**texts, step=repr(choice.step), remark=remark, at=repr([0.0, until]))
