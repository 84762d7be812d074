"""Export for Exudyn: the calls with which the adapter builds its system, and a run."""

from typing import Any

from gauss_bench.engines.base import Choice
from gauss_bench.engines.transcript import Script, name_laws, python
from gauss_bench.exchange.scripts import write_program
from gauss_bench.mechanism.model import GROUND, AngleDriver, LengthDriver, Mechanism, SlideDriver
from gauss_bench.mechanism.motion_laws import MotionLaw

STATEMENTS = {  # function of Exudyn -> variable of the script for its result (see `Script`)
    "SystemContainer": "container",
    "AddSystem": "mbs",
    "AddNode": "node_",
    "AddObject": "object_",
    "AddMarker": "marker_",
    "AddLoad": "load_",
    "SimulationSettings": "settings",
}


def write(mechanism: Mechanism, choice: Choice, head: list[str]) -> str:
    """Return a Python script that builds the mechanism in Exudyn by the recorded calls of the adapter, and simulates it.

    `head` are lines of comment at the top of the script.

    Raises:
        RunFailure: Exudyn rejects the model, or the model differs from the linkage.
        ImportError: Exudyn is not installed.
    """
    from gauss_bench.engines.exudyn.adapter import ExudynModel

    built = ExudynModel(mechanism, choice)  # raises if the real model differs from the linkage
    return write_program(
        "exudyn.py.jinja",
        mechanism,
        choice,
        [*head, f"Settings: {choice.settings}, {choice.integrator}. Joints are algebraic equations, solved by Exudyn."],
        a0=built.acceleration(0.0, mechanism.q0, mechanism.v0).tolist() if mechanism.drivers else None,
        follows=any(not isinstance(x, AngleDriver) for x in mechanism.drivers),
        model=_record_model(mechanism, choice),
    )


def _record_model(mechanism: Mechanism, choice: Choice) -> list[str]:
    """Return the lines of the script that build the model and its settings: the adapter's calls, made with stand-ins for Exudyn."""
    from gauss_bench.engines.exudyn.adapter import make_settings
    from gauss_bench.engines.exudyn.items import System, span

    script, laws = Script(STATEMENTS), name_laws(mechanism)

    class Transcribed(System):
        """The adapter's system; `script` records its calls of Exudyn, with a comment for each link and joint."""

        def _add_link(self, i: int) -> None:
            script.comment(f"link {self.mechanism.links[i].name}")
            super()._add_link(i)

        def _add_joint(self, joint: Any) -> None:
            script.comment(f"joint {joint.name}")
            super()._add_joint(joint)

        def _make_equation(self, driver: SlideDriver | LengthDriver) -> tuple[Any, Any]:
            """Define the equation of a driven slide or length and its Jacobian in the script, and return stand-ins for both."""
            # for both ends [is on the ground, x, y]
            a, b = ([x.link == GROUND, *map(float, x.local)] for x in span(driver))
            angle = float(driver.joint.angle) if isinstance(driver, SlideDriver) else None
            law = laws[id(driver.law)]
            script.lines.append(f"equation, jacobian = driven({python(a)}, {python(b)}, {python(angle)}, {law})")
            return script.stand_in("equation"), script.stand_in("jacobian")

        def _make_offset(self, law: MotionLaw, rate: int, start: float) -> Any:
            """Return a stand-in for the offset of a driven angle: derivative number `rate` of its law, less the value `start`."""
            return script.stand_in(f"lambda mbs, t, item, offset: {laws[id(law)]}(t)[{rate}] - {python(start)}")

    exu = script.stand_in("exu")
    Transcribed(exu, script.stand_in("items"), mechanism)
    script.comment("settings")
    make_settings(exu, mechanism, choice)
    return script.lines
