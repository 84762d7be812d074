"""Exudyn: what the adapter builds its system with, call by call, and a run."""

from dataclasses import dataclass
from typing import Any

from gauss_bench.engines.base import Choice
from gauss_bench.exchange.laws import law_function
from gauss_bench.exchange.scripts import HEADING, MAIN, PLAN, constants
from gauss_bench.exchange.text import python_comment
from gauss_bench.exchange.transcript import Script, python
from gauss_bench.mechanism.model import AngleDriver, Mechanism
from gauss_bench.mechanism.motion_laws import MotionLaw
from gauss_bench.trajectory import RunFailure, Status

STATEMENTS = {
    "SystemContainer": "container",
    "AddSystem": "mbs",
    "AddNode": "node_",
    "AddObject": "object_",
    "AddMarker": "marker_",
    "AddLoad": "load_",
    "Assemble": "",
    "SimulationSettings": "settings",
}
IMPORTS = """import contextlib
import math
import sys

import numpy as np

sys.exudynFast = True  # the module without range checks; leave this line out while you change the model
with contextlib.redirect_stdout(None):
    import exudyn as exu
from exudyn import itemInterface as items

exu.config.printToConsole = False
"""
RUN = '''

def simulate(end=END, step=STEP):
    """Rows [t, *q, *v] at equally spaced times."""
    steps, every = plan(end, step)
    initial, clock = exu.ConfigurationType.Initial, settings.timeIntegration
    clock.startTime, clock.endTime, clock.numberOfSteps = 0.0, end, steps
    clock.generalizedAlpha.computeInitialAccelerations = A0 is None
    clock.generalizedAlpha.resetAccelerations = False
    mbs.systemData.SetTime(0.0, initial)
    mbs.systemData.SetODE2Coordinates(np.zeros(len(Q0)), initial)
    mbs.systemData.SetODE2Coordinates_t(np.array(V0), initial)
    mbs.systemData.SetODE2Coordinates_tt(np.zeros(len(Q0)) if A0 is None else np.array(A0), initial)
    rows, count = [[0.0, *Q0, *V0]], [-1]  # the first call comes before the first step

    def keep(mbs, t):
        count[0] += 1
        if count[0] and count[0] % every == 0:
            q, v = mbs.systemData.GetODE2Coordinates(), mbs.systemData.GetODE2Coordinates_t()
            rows.append([t, *(np.array(Q0) + q), *v])
        return True

    mbs.SetPostStepUserFunction(keep)
    if not mbs.SolveDynamic(settings):
        raise RuntimeError("Exudyn reports failure; try a smaller step")
    return rows
'''


@dataclass(frozen=True)
class Written:
    """A function, by what a script writes for it."""

    in_python: str


def written(mechanism: Mechanism, choice: Choice, head: list[str]) -> str:
    """The script.

    Raises:
        RunFailure: Exudyn refuses the model, or it differs from the linkage.
        ImportError: Exudyn is not installed.
    """
    from gauss_bench.engines.exudyn.adapter import ExudynModel, simulation_settings
    from gauss_bench.engines.exudyn.items import System

    class Transcribed(System):
        """The adapter's system, with a remark on each part."""

        def _link(self, i: int) -> None:
            script.comment(f"link {self.mechanism.links[i].name}")
            super()._link(i)

        def _joint(self, joint: Any) -> None:
            script.comment(f"joint {joint.name}")
            super()._joint(joint)

        def _driver(self, driver: Any) -> None:
            script.comment(f"driver of {driver.name}")
            super()._driver(driver)

        def _load(self, load: Any) -> None:
            script.comment("a force")
            super()._load(load)

        def _offset(self, law: MotionLaw, rate: int, start: float) -> Any:
            return Written(f"lambda mbs, t, item, offset: {names[id(law)]}(t)[{rate}] - {python(start)}")

    beyond = ", ".join(d.name for d in mechanism.drivers if not isinstance(d, AngleDriver))
    if beyond:
        raise RunFailure(Status.SKIP, f"the script holds motion laws of links only, not of the slide or length {beyond}")
    built = ExudynModel(mechanism, choice)  # which is compared with the linkage
    names = {id(d.law): f"law_{k}" for k, d in enumerate(mechanism.drivers, 1)}
    script = Script(STATEMENTS)
    exu, items = script.thing("exu"), script.thing("items")
    Transcribed(exu, items, mechanism)
    script.comment("settings")
    simulation_settings(exu, mechanism, choice)
    a0 = built.acceleration(0.0, mechanism.q0, mechanism.v0).tolist() if mechanism.drivers else None
    laws = [f"\n\n{law_function(d.law, names[id(d.law)])}" for d in mechanism.drivers]
    told = [*head, f"Settings: {choice.settings}, {choice.integrator}. Joints are algebraic equations, solved by Exudyn."]
    given = f"{constants(mechanism, choice)}A0 = {python(a0)}  # starting accelerations, if given\n"
    parts = [HEADING, python_comment(told), "\n", IMPORTS, "\n", given, *laws, "\n\n" if laws else "\n", script.text()]
    return "".join([*parts, PLAN, RUN, MAIN])
