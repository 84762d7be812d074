"""Drake: where a plant has a constraint, steps ignore forces that change the speeds little. This script needs pydrake alone.

Two equal wheels turn on one axis under equal torques. A ball constraint pins a point of one to the same point of the other, and has
nothing to do. Printed is the gain of speed in 0.02 s over torque / inertia * time, which should be 1.
"""

from importlib.metadata import version

import numpy as np
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import RevoluteJoint, SpatialInertia, UnitInertia
from pydrake.systems.analysis import Simulator

INERTIA, SPEED, DURATION = 1.0, 10.0, 0.02  # [kg m^2], [rad/s], [s]
STEPS = (1e-2, 1e-3, 1e-4, 1e-5)  # [s]
TORQUES = (1.0, 0.1, 0.01, 0.001)  # [N m]


def gain(step: float, torque: float, pinned: bool) -> float:
    """Return the gain of speed of the first wheel over the exact one."""
    plant = MultibodyPlant(step)
    inertia = SpatialInertia(1.0, np.zeros(3), UnitInertia.TriaxiallySymmetric(INERTIA))
    wheels = [plant.AddRigidBody(name, inertia) for name in ("first", "second")]
    axle = np.array([0.0, 0.0, 1.0])
    joints = [plant.AddJoint(RevoluteJoint(x.name(), plant.world_frame(), x.body_frame(), axle)) for x in wheels]
    if pinned:
        point = np.array([1.0, 0.0, 0.0])
        plant.AddBallConstraint(wheels[0], point, wheels[1], point)
    plant.Finalize()
    simulator = Simulator(plant)
    context = simulator.get_mutable_context()
    plant.get_applied_generalized_force_input_port().FixValue(context, np.full(2, torque))
    for joint in joints:
        joint.set_angular_rate(context, SPEED)
    simulator.AdvanceTo(DURATION)
    return (joints[0].get_angular_rate(context) - SPEED) / (torque / INERTIA * DURATION)


def threshold(step: float) -> tuple[float, float]:
    """Return the changes of speed in a step, over the speed, between which torques begin to act."""
    ignored, acts = 1e-9, 1e-3
    for _ in range(20):
        middle = float(np.sqrt(ignored * acts))
        if gain(step, middle * SPEED * INERTIA / step, pinned=True) > 0.5:
            acts = middle
        else:
            ignored = middle
    return ignored, acts


if __name__ == "__main__":
    print("Drake", version("drake"))
    for step in STEPS:
        for torque in TORQUES:
            free, pinned = (gain(step, torque, x) for x in (False, True))
            change = torque / INERTIA * step / SPEED
            print(
                f"step {step:g} s, torque {torque:g} N m, change {change:.0e}: without constraint {free:.4f}, with it {pinned:.4f}"
            )
    print("torques begin to act between the changes {:.6g} and {:.6g}".format(*threshold(1e-3)))
