"""Exudyn: what the adapter builds its system with, call by call, and a run."""

from dataclasses import dataclass
from typing import Any

from gauss_bench.engines.base import Choice
from gauss_bench.exchange.laws import law_functions, law_names
from gauss_bench.exchange.scripts import HEADING, MAIN, PLAN, constants
from gauss_bench.exchange.text import python_comment
from gauss_bench.exchange.transcript import Script, python
from gauss_bench.mechanism.model import GROUND, LengthDriver, Mechanism, SlideDriver
from gauss_bench.mechanism.motion_laws import MotionLaw

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
SLIDE = '''

def driven(guide, block, angle, law):
    """Equation of a slide that follows a law, or without `angle` of a length, and its Jacobian; ends: on the ground?, x, y."""

    def seen(q):
        places, k = [], 0
        for grounded, x, y in (guide, block):
            X, Y, turn = (0.0, 0.0, 0.0) if grounded else q[k : k + 3]
            c, s = math.cos(turn), math.sin(turn)
            arm = np.array([c * x - s * y, s * x + c * y])
            places.append((np.array([X, Y]) + arm, np.array([-arm[1], arm[0]]), turn))
            k += 0 if grounded else 3
        (A, dA, turn), (B, dB, _) = places
        u = (B - A) / math.hypot(*(B - A)) if angle is None else np.array([math.cos(turn + angle), math.sin(turn + angle)])
        row = [] if guide[0] else [*-u, u[0] * (B - A)[1] - u[1] * (B - A)[0] - u @ dA]
        return u @ (B - A), np.array(row + ([] if block[0] else [*u, u @ dB]))

    def equation(mbs, t, item, q, v, velocity):
        x, row = seen(q)
        return [row @ np.array(v) - law(t)[1] if velocity else x - law(t)[0]]

    def jacobian(mbs, t, item, q, v, velocity):
        return seen(q)[1][None]

    return equation, jacobian

'''
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


def write_exudyn(mechanism: Mechanism, choice: Choice, head: list[str]) -> str:
    """The script.

    Raises:
        RunFailure: Exudyn refuses the model, or it differs from the linkage.
        ImportError: Exudyn is not installed.
    """
    from gauss_bench.engines.exudyn.adapter import ExudynModel, simulation_settings
    from gauss_bench.engines.exudyn.items import System, span

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

        def _equation(self, driver: SlideDriver | LengthDriver) -> tuple[Any, Any]:
            law = names[id(driver.law)]
            a, b = ([x.link == GROUND, *map(float, x.local)] for x in span(driver))
            angle = float(driver.joint.angle) if isinstance(driver, SlideDriver) else None
            script.lines.append(f"equation, jacobian = driven({python(a)}, {python(b)}, {angle}, {law})")
            return Written("equation"), Written("jacobian")

        def _load(self, load: Any) -> None:
            script.comment("a force")
            super()._load(load)

        def _offset(self, law: MotionLaw, rate: int, start: float) -> Any:
            return Written(f"lambda mbs, t, item, offset: {names[id(law)]}(t)[{rate}] - {python(start)}")

    laws = law_functions(mechanism.drivers)
    built = ExudynModel(mechanism, choice)  # which is compared with the linkage
    names = law_names(mechanism.drivers)
    script = Script(STATEMENTS)
    exu, items = script.thing("exu"), script.thing("items")
    Transcribed(exu, items, mechanism)
    script.comment("settings")
    simulation_settings(exu, mechanism, choice)
    a0 = built.acceleration(0.0, mechanism.q0, mechanism.v0).tolist() if mechanism.drivers else None
    slide = SLIDE if any(isinstance(d, (SlideDriver, LengthDriver)) for d in mechanism.drivers) else ""
    told = [*head, f"Settings: {choice.settings}, {choice.integrator}. Joints are algebraic equations, solved by Exudyn."]
    given = f"{constants(mechanism, choice)}A0 = {python(a0)}  # starting accelerations, if given\n"
    parts = [HEADING, python_comment(told), "\n", IMPORTS, "\n", given, laws, slide, "\n\n" if laws else "\n", script.text()]
    return "".join([*parts, PLAN, RUN, MAIN])
