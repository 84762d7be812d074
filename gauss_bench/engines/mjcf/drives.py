"""Motion laws in MuJoCo's model.

Trap: MuJoCo has no prescribed motion of a joint. A driven slide, or a driven hinge on the ground, gets an armature (rotor inertia)
A that is far larger than all masses, and the torque or force A law''(t). With the other inertia m that resists the coordinate
theta, the error of theta'' is about (load - m law'') / A, because

    (A + m) theta'' = A law''(t) + load

A driven length is a tendon between two sites with such an armature [kg], and a motor that exerts the force.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any
from xml.etree.ElementTree import tostring

from gauss_bench.engines.base import Choice
from gauss_bench.engines.mjcf.across_releases import compile_document, find_integrator
from gauss_bench.engines.mjcf.draft import Draft
from gauss_bench.engines.mjcf.settings import configure
from gauss_bench.engines.shared import drivers_by_coordinate
from gauss_bench.mechanism.motion_laws import MotionLaw


@dataclass(frozen=True)
class Drive:
    """A driven joint coordinate or a driven length.

    Attributes:
        law: motion law of the coordinate or length.
        armature: artificial inertia, [kg m^2] of a hinge, [kg] of a slide or length.
        at: MuJoCo's index of the joint coordinate, or of the tendon.
        motor: index of the tendon's motor; None for a joint coordinate.
    """

    law: MotionLaw
    armature: float
    at: int
    motor: int | None = None

    def push(self, data: Any, t: float) -> None:
        """Add the driving force at time t [s] to the joint's applied force in MuJoCo's data, or set it as the motor's control."""
        force = self.armature * float(self.law(t)[2])
        if self.motor is None:
            data.qfrc_applied[self.at] += force
        else:
            data.ctrl[self.motor] = force


def set_armatures(mujoco: Any, model: Any, drives: Sequence[Drive]) -> None:
    """Set the armatures of drives in a compiled model, and let MuJoCo recompute the constants that depend on inertia."""
    for drive in drives:
        armatures = model.dof_armature if drive.motor is None else model.tendon_armature
        armatures[drive.at] = drive.armature
    mujoco.mj_setConst(model, mujoco.MjData(model))


def find_drives(model: Any, draft: Draft, ratio: float) -> list[Drive]:
    """Return the drives of all hinges, slides and lengths that follow a law.

    Args:
        model: model that was compiled from the draft, without armatures.
        ratio: armature divided by the inertia that resists the driven coordinate in MuJoCo's reference pose.
    """
    driven = drivers_by_coordinate(draft.mechanism, draft.tree)
    drives = [Drive(driver.law, ratio * float(model.dof_M0[k]), k) for k, driver in driven.items()]
    for cylinder, tendon, motor in draft.cylinders:  # driven lengths; 1 / invweight0 is the inertia that resists the tendon
        index = [*draft.tendons].index(tendon)  # MuJoCo numbers elements in the order of the document
        mass = ratio / float(model.tendon_invweight0[index])
        drives.append(Drive(cylinder.law, mass, index, [*draft.actuators].index(motor)))
    return drives


def compile_model(
    mujoco: Any, draft: Draft, choice: Choice, options: Mapping[str, Any], driven: bool = True
) -> tuple[Any, Sequence[Drive]]:
    """Return the model that MuJoCo compiles from a draft, with the integrator and step of a choice, and the model's drives.

    Args:
        driven: whether driven coordinates get armatures (large artificial rotor inertias); otherwise the model has no drives.

    Raises:
        RunFailure: MuJoCo cannot compile the draft.
    """
    model = compile_document(mujoco, tostring(draft.root, encoding="unicode"))
    ratio = float(options["armature_of_a_driven_hinge_over_inertia"])
    drives = find_drives(model, draft, ratio) if driven else []
    if drives:
        set_armatures(mujoco, model, drives)
    configure(mujoco, model, options, choice.step)
    model.opt.timestep = choice.step
    model.opt.integrator = find_integrator(mujoco, choice.integrator or "rk4")
    return model, drives
