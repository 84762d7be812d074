"""Export for Pinocchio: the calls with which the adapter builds its model, the forces, and an integrator.

Pinocchio has no springs and no integrator for constrained systems. The script has the adapter's matrices for forces that are affine
in the joint coordinates, and tables for all others, which a function in the script evaluates.
"""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from gauss_bench.engines.base import Choice
from gauss_bench.engines.transcript import Script, name_laws, python
from gauss_bench.exchange.scripts import write_program
from gauss_bench.mechanism.model import GROUND, Along, Distance, Force, Law, LengthDriver, Mechanism, Point, PointForce, loads
from gauss_bench.trajectory import RunFailure, Status

if TYPE_CHECKING:
    from gauss_bench.engines.pinocchio.adapter import PinocchioModel

STATEMENTS = {  # function of Pinocchio -> variable of the script for its result (see `Script`)
    "Model": "model",
    "addJoint": "joint_",
    "StdVec_RigidConstraintModel": "constraints",
    "RigidConstraintModel": "closure_",
}
METHODS = {
    "rk4": "the classical method of Runge and Kutta",
    "semi_implicit_euler": "the semi-implicit Euler method",
    "dop853_fixed": "the twelve stages of DOP853, without error control",
    "dop853": "SciPy's DOP853",
}


def write(mechanism: Mechanism, choice: Choice, head: list[str]) -> str:
    """Return a Python script that simulates the mechanism with Pinocchio.

    Raises:
        RunFailure: Pinocchio rejects the model, the model differs, a driver prescribes a length, or projection is chosen.
        ImportError: Pinocchio is not installed.
    """
    from gauss_bench.engines.pinocchio.adapter import PinocchioModel

    if choice.stabilization == "projection":
        raise RunFailure(Status.SKIP, "Pinocchio has no projection, and the suite's own projection is not part of a script")
    if lengths := [driver.name for driver in mechanism.drivers if isinstance(driver, LengthDriver)]:
        reason = f"the script holds motion laws of angles and slides only, not of the length {', '.join(lengths)}"
        raise RunFailure(Status.SKIP, reason)
    built = PinocchioModel(mechanism, choice)  # raises if the real model differs from the linkage
    options = built.options
    method = METHODS[choice.integrator]
    stabilization = "with Baumgarte's terms" if choice.stabilization == "baumgarte" else "without stabilisation"
    others = built.forces.others  # forces that are not affine functions of the joint coordinates
    rtol, atol = choice.tolerances(float(options["dop853_rtol"]), float(options["dop853_atol"]))
    return write_program(
        "pinocchio.py.jinja",
        mechanism,
        choice,
        [*head, f"Settings: {choice.settings}, {method}. Loops are opened at joints and closed by constraints, {stabilization}."],
        model=transcribe(mechanism, built),
        others=tabulate(others) if others else None,
        algorithm=options["algorithm"],
        method=method,
        rtol=rtol,
        atol=atol,
    )


def transcribe(mechanism: Mechanism, built: "PinocchioModel") -> list[str]:
    """Return the lines of a script that build the adapter's model again and define the numbers that the rest of the script uses."""
    from gauss_bench.engines.pinocchio.tree import Multibody
    from gauss_bench.engines.tree import Branch

    # the method uses `script`, which is assigned below the class and before an object of it is created
    class Transcribed(Multibody):
        """The model that the adapter builds; its calls of Pinocchio are recorded as lines of `script`, with comments for links."""

        def _add_link(self, mechanism: Mechanism, b: Branch) -> None:
            script.comment(f"link {mechanism.links[b.link].name}")
            super()._add_link(mechanism, b)

    script, forces, drive = Script(STATEMENTS), built.forces, built.stabilized.drive
    recorded = Transcribed(script.stand_in("pin"), mechanism, built.tree)
    script.comment("the pins that close the loops")
    recorded.constraints(drive.gains)
    y0, dy0 = built.tree.relative(mechanism.q0, mechanism.v0)
    script.comment("LINKS: for each link the joint that carries it, and its centre of mass in that joint's frame")
    script.comment("the angles of the links are ANGLES + TURNS y")
    numbers: dict[str, Any] = {
        "LINKS": [[recorded.carriers[i][0], centre] for i, (_, centre) in enumerate(forces.motion.centres)],
        "ANGLES": forces.motion.theta0,
        "TURNS": forces.motion.turns,
        "CARRIED": forces.motion.carried,
        "CONSTANT": forces.constant,
        "STIFFNESS": forces.stiffness,
        "DAMPING": forces.damping,
        "Y0": y0,
        "DY0": dy0,
    }
    if drive.laws:
        numbers |= {"LAWS": list(name_laws(mechanism).values()), "KP": drive.gains[0], "KD": drive.gains[1]}
        numbers |= {"DRIVEN": drive.rows, "DRIVEN_AT_ZERO": drive.origin, "INERTIAS": drive.driver_inertias}
    script.lines += [f"{name} = {python(x)}" for name, x in numbers.items()]
    accuracy = ", ".join(python(float(built.options[x])) for x in ("absolute_accuracy", "relative_accuracy", "mu"))
    return [*script.lines, f"PROXIMAL = pin.ProximalSettings({accuracy}, {int(built.options['max_iter'])})"]


def tabulate(others: Sequence[Force]) -> dict[str, list[Any]]:
    """Return tables of forces that are not affine in the coordinates: the exported script's lists SPRINGS, SLIDES and PUSHES.

    Raises:
        RunFailure: the script cannot evaluate a load of this kind; the message names the force.
    """
    tables: dict[str, list[Any]] = {"springs": [], "slides": [], "pushes": []}
    for name, load in ((force.name, load) for force in others for load in loads([force])):
        match load:
            case Law(Distance(a, b), k, c, rest, 0.0):
                tables["springs"].append([spot(a), spot(b), k, c, rest])
            case Law(Along(origin, point, angle, across), k, c, rest, 0.0):
                tables["slides"].append([spot(origin), spot(point), angle + across * np.pi / 2, k, c, rest])
            case PointForce(_, point, force, frame):
                if point.link != GROUND:  # a force on the ground moves nothing
                    tables["pushes"].append([spot(point), frame, *map(float, force)])
            case _:
                raise RunFailure(Status.SKIP, f"scripts for Pinocchio do not support this kind of load ({name})")
    return tables


def spot(point: Point) -> list[float]:
    """Return [link, x, y]: the link's index (-1 for the ground) and the point in the frame of its centre of mass."""
    return [point.link, *map(float, point.local)]
