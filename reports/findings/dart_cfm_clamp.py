"""The velocity after one step of DART on a closed loop, against the constrained accelerations of DART's own terms.

It needs dartpy and numpy alone: `python dart_cfm_clamp.py`.
"""

import dartpy as dart
import numpy as np

LENGTHS = (0.3, 0.7, 0.5)  # [m] of three rods with a mass of 1 kg per metre
POSE = (1.0, -0.6, 0.9)  # [rad] relative angles, at rest
STEP = 1e-5  # [s]
BALL = dart.constraint.BallJointConstraint  # whose options are static


def place(x):
    """Return the transform of a frame at x [m] along a rod."""
    frame = dart.math.Isometry3()
    frame.set_translation([x, 0.0, 0.0])
    return frame


def four_bar():
    """Return a world with a chain of three rods that hangs on the ground, its skeleton, and its last body."""
    world, skeleton, body = dart.simulation.World(), dart.dynamics.Skeleton("chain"), None
    world.setGravity([0.0, -9.81, 0.0])
    world.setTimeStep(STEP)
    for before, length in zip((0.0, *LENGTHS[:-1]), LENGTHS, strict=True):
        joint, body = skeleton.createRevoluteJointAndBodyNodePair(body)
        joint.setAxis([0.0, 0.0, 1.0])
        joint.setTransformFromParentBodyNode(place(before / 2))
        joint.setTransformFromChildBodyNode(place(-length / 2))
        body.setInertia(dart.dynamics.Inertia(length, np.zeros(3), length**3 / 12 * np.eye(3)))
    skeleton.setPositions(POSE)
    world.addSkeleton(skeleton)
    return world, skeleton, body


def run(cfm):
    """Return the option that DART takes, the relative error of the accelerations, and the rate at which the pin opens [m/s^2]."""
    world, skeleton, body = four_bar()
    tip = np.array([LENGTHS[-1] / 2, 0.0, 0.0])
    BALL.setErrorReductionParameter(0.0)
    BALL.setConstraintForceMixing(cfm)
    world.getConstraintSolver().addConstraint(BALL(body, body.getTransform().multiply(tip)))
    mass, rows = skeleton.getMassMatrix(), skeleton.getLinearJacobian(body, tip)[:2]
    system = np.block([[mass, rows.T], [rows, np.zeros((2, 2))]])  # at rest: M a - J^T f = -h, J a = 0
    true = np.linalg.solve(system, [*-skeleton.getCoriolisAndGravityForces(), 0.0, 0.0])[:3]
    world.step()
    found = skeleton.getVelocities() / STEP
    return BALL.getConstraintForceMixing(), abs(found - true).max() / abs(true).max(), abs(rows @ found).max()


print("DART", dart.__version__)
for cfm in (1e-3, 1e-6, 1e-9, 1e-12, 0.0):
    taken, off, opening = run(cfm)
    print(f"asked for {cfm:.0e}, taken {taken:.0e}: accelerations off by {off:.1e}, pin opens with {opening:.1e} m/s^2")
