"""The share of an error that DART's constraints correct in one step, which should be the error reduction parameter.

It needs dartpy and numpy alone: `python dart_revolute_erp.py`.
"""

import dartpy as dart
import numpy as np

LENGTH = 0.5  # [m] of a rod of 1 kg, which turns about z on a hinge at its near end
OFF = 1e-3  # [rad] by which the rod is turned away from the pose in which a constraint holds it
HINGE, TIP = np.zeros(3), np.array([LENGTH, 0.0, 0.0])
CASES = (  # (title, what holds the rod)
    ("the tip: ball", lambda rod: dart.constraint.BallJointConstraint(rod, TIP)),
    ("the tip: revolute about z", lambda rod: dart.constraint.RevoluteJointConstraint(rod, TIP, [0.0, 0.0, 1.0])),
    ("the tip: cylindrical along z", lambda rod: dart.constraint.CylindricalJointConstraint(rod, TIP, [0.0, 0.0, 1.0])),
    ("the angle: weld", lambda rod: dart.constraint.WeldJointConstraint(rod)),
    ("the angle: revolute about y", lambda rod: dart.constraint.RevoluteJointConstraint(rod, HINGE, [0.0, 1.0, 0.0])),
    ("the angle: cylindrical along y", lambda rod: dart.constraint.CylindricalJointConstraint(rod, HINGE, [0.0, 1.0, 0.0])),
)
STEPS = ((1e-2, 0.01), (1e-3, 0.01), (1e-3, 0.1))  # step [s], error reduction parameter


def corrected(hold, step, erp):
    """Return the share of the error that is gone after one step, from rest and without gravity; negative if it has grown."""
    world, skeleton = dart.simulation.World(), dart.dynamics.Skeleton("rod")
    world.setGravity([0.0, 0.0, 0.0])
    world.setTimeStep(step)
    joint, rod = skeleton.createRevoluteJointAndBodyNodePair()
    joint.setAxis([0.0, 0.0, 1.0])
    near = dart.math.Isometry3()
    near.set_translation([-LENGTH / 2, 0.0, 0.0])
    joint.setTransformFromChildBodyNode(near)
    rod.setInertia(dart.dynamics.Inertia(1.0, np.zeros(3), LENGTH**2 / 12 * np.eye(3)))
    world.addSkeleton(skeleton)
    held = hold(rod)
    held.setErrorReductionParameter(erp)
    world.getConstraintSolver().addConstraint(held)
    skeleton.setPositions([OFF])
    world.step()
    return 1.0 - skeleton.getPositions()[0] / OFF


print("DART", dart.__version__, "".join(f"    step {step:g} s, erp {erp:g}" for step, erp in STEPS))
for title, hold in CASES:
    print(f"{title:32}" + "".join(f"{corrected(hold, step, erp):24.3f}" for step, erp in STEPS))
