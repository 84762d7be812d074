"""Export for Pinocchio: the calls with which the adapter builds its model, its forces as tables, and an integrator.

Pinocchio has no springs and no integrator for constrained systems. Forces that are affine in the joints' coordinates are the
adapter's matrices; the others are tables that a function of the script reads.
"""

from typing import Any

import numpy as np

from gauss_bench.engines.base import Choice
from gauss_bench.engines.transcript import Script, name_laws, python
from gauss_bench.exchange.scripts import write_program
from gauss_bench.mechanism.model import GROUND, Along, Distance, Law, LengthDriver, Load, Mechanism, Point, PointForce, loads
from gauss_bench.trajectory import RunFailure, Status

STATEMENTS = {
    "Model": "model",
    "addJoint": "joint_",
    "appendBodyToJoint": "",
    "StdVec_RigidConstraintModel": "constraints",
    "RigidConstraintModel": "closure_",
    "append": "",
}
METHODS = {
    "rk4": "the classical method of Runge and Kutta",
    "semi_implicit_euler": "the semi-implicit Euler method",
    "dop853_fixed": "the twelve stages of DOP853, without error control",
    "dop853": "SciPy's DOP853",
}


def write(mechanism: Mechanism, choice: Choice, head: list[str]) -> str:
    """Return the script.

    Raises:
        RunFailure: Pinocchio rejects the model, the model differs from the linkage, or a length is prescribed.
        ImportError: Pinocchio is not installed.
    """
    from gauss_bench.engines.pinocchio.adapter import PinocchioModel
    from gauss_bench.engines.pinocchio.tree import Multibody
    from gauss_bench.engines.tree import Branch

    if choice.stabilization == "projection":
        raise RunFailure(Status.SKIP, "Pinocchio has no projection: the one of this suite is its own")
    if beyond := ", ".join(d.name for d in mechanism.drivers if isinstance(d, LengthDriver)):
        raise RunFailure(Status.SKIP, f"the script holds motion laws of angles and slides only, not of the length {beyond}")

    class Transcribed(Multibody):
        """The adapter's model, with a comment in the script before each link."""

        def _add_link(self, mechanism: Mechanism, b: Branch) -> None:
            script.comment(f"link {mechanism.links[b.link].name}")
            super()._add_link(mechanism, b)

    built = PinocchioModel(mechanism, choice)  # compares the real model with the linkage, so that the script need not
    options, forces, drive = built.options, built.forces, built.stabilized.drive
    script = Script(STATEMENTS)
    recorded = Transcribed(script.stand_in("pin"), mechanism, built.tree)
    script.comment("the pins that close the loops")
    stabilized = choice.stabilization == "baumgarte"
    kp, kd = (float(options[key]) if stabilized else 0.0 for key in ("baumgarte_Kp_per_s2", "baumgarte_Kd_per_s"))
    recorded.constraints((kp, kd))
    y0, dy0 = built.tree.relative(mechanism.q0, mechanism.v0)
    script.comment("links: the joint that carries each, and its centre of mass there; angles are ANGLES + TURNS y")
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
        numbers |= {"DRIVEN": drive.rows, "DRIVEN_AT_ZERO": drive.origin, "INERTIAS": drive.inertias}
    script.lines += [f"{name} = {python(x)}" for name, x in numbers.items()]
    accuracy = ", ".join(python(float(options[x])) for x in ("absolute_accuracy", "relative_accuracy", "mu"))
    script.lines.append(f"PROXIMAL = pin.ProximalSettings({accuracy}, {int(options['max_iter'])})")
    method, closed = METHODS[choice.integrator], "with Baumgarte's terms" if stabilized else "without stabilisation"
    others = list(loads(forces.others))
    rtol, atol = choice.tolerances(float(options["dop853_rtol"]), float(options["dop853_atol"]))
    return write_program(
        "pinocchio.py.jinja",
        mechanism,
        choice,
        [*head, f"Settings: {choice.settings}, {method}. Loops are opened at joints and closed by constraints, {closed}."],
        model=script.lines,
        others=tabulate(others) if others else None,
        algorithm=options["algorithm"],
        method=method,
        rtol=rtol,
        atol=atol,
    )


def tabulate(others: list[Load]) -> dict[str, list[Any]]:
    """Return the loads that are not affine, as the tables that the script's function `forces` reads.

    Raises:
        RunFailure: the script's function has no such kind of load.
    """
    tables: dict[str, list[Any]] = {"springs": [], "slides": [], "pushes": []}
    for load in others:
        match load:
            case Law(Distance(a, b), k, c, rest, 0.0):
                tables["springs"].append([spot(a), spot(b), k, c, rest])
            case Law(Along(origin, point, angle, across), k, c, rest, 0.0):
                tables["slides"].append([spot(origin), spot(point), angle + across * np.pi / 2, k, c, rest])
            case PointForce(_, point, force, frame):
                if point.link != GROUND:
                    tables["pushes"].append([spot(point), frame, *map(float, force)])
            case _:
                raise RunFailure(Status.SKIP, "a load of this kind is not written for Pinocchio")
    return tables


def spot(point: Point) -> list[float]:
    """Return [link, x, y]: the link's index (-1 for the ground) and the point in the frame of its centre of mass."""
    return [point.link, *map(float, point.local)]
