"""Export for Exudyn: the calls with which the adapter builds its system, and a run."""

from typing import Any

from gauss_bench.engines.base import Choice
from gauss_bench.engines.transcript import Script, name_laws, python
from gauss_bench.exchange.scripts import write_program
from gauss_bench.mechanism.model import GROUND, AngleDriver, LengthDriver, Mechanism, SlideDriver
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


def write(mechanism: Mechanism, choice: Choice, head: list[str]) -> str:
    """Return the script.

    Raises:
        RunFailure: Exudyn rejects the model, or the model differs from the linkage.
        ImportError: Exudyn is not installed.
    """
    from gauss_bench.engines.exudyn.adapter import ExudynModel, simulation_settings
    from gauss_bench.engines.exudyn.items import System, span

    class Transcribed(System):
        """The adapter's system, with a comment in the script before each part, and with the script's names of user functions."""

        def _add_link(self, i: int) -> None:
            script.comment(f"link {self.mechanism.links[i].name}")
            super()._add_link(i)

        def _add_joint(self, joint: Any) -> None:
            script.comment(f"joint {joint.name}")
            super()._add_joint(joint)

        def _equation(self, driver: SlideDriver | LengthDriver) -> tuple[Any, Any]:
            """Record the script's own equation and Jacobian of a driven slide or length, and return their stand-ins."""
            a, b = ([x.link == GROUND, *map(float, x.local)] for x in span(driver))
            angle = float(driver.joint.angle) if isinstance(driver, SlideDriver) else None
            law = laws[id(driver.law)]
            script.lines.append(f"equation, jacobian = driven({python(a)}, {python(b)}, {python(angle)}, {law})")
            return script.stand_in("equation"), script.stand_in("jacobian")

        def _offset(self, law: MotionLaw, rate: int, start: float) -> Any:
            return script.stand_in(f"lambda mbs, t, item, offset: {laws[id(law)]}(t)[{rate}] - {python(start)}")

    built = ExudynModel(mechanism, choice)  # compares the real model with the linkage, so that the script need not
    script, laws = Script(STATEMENTS), name_laws(mechanism)
    exu = script.stand_in("exu")
    Transcribed(exu, script.stand_in("items"), mechanism)
    script.comment("settings")
    simulation_settings(exu, mechanism, choice)
    return write_program(
        "exudyn.py.jinja",
        mechanism,
        choice,
        [*head, f"Settings: {choice.settings}, {choice.integrator}. Joints are algebraic equations, solved by Exudyn."],
        a0=built.acceleration(0.0, mechanism.q0, mechanism.v0).tolist() if mechanism.drivers else None,
        follows=any(not isinstance(x, AngleDriver) for x in mechanism.drivers),
        model=script.lines,
    )
