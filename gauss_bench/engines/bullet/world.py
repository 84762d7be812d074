"""A world of Bullet: what linkages as trees of joints (`joints.py`) and as free bodies (`bodies.py`) share.

Traps of PyBullet 3.2.7, none of which it reports:

    changeDynamics     sends mass and inertia to the base, and frees it, if the same call sets linearDamping, angularDamping or
                       maxJointVelocity: these are set in calls of their own
    damping            of 0.04 slows every link of a tree, in proportion to the speed and to its square
    speeds             of joints are cut at 100 rad/s or m/s
    motors             brake every joint
    inertias           are zero without a collision shape, until they are set
    torques            are forgotten after a step
    rigid bodies       feel no torque in their first step
    closures           exert at most an impulse of 500 N s in a step
"""

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any
from weakref import finalize

from gauss_bench.engines.shared import spatial
from gauss_bench.mechanism.model import Mechanism

ORIGIN: Sequence[float] = (0.0, 0.0, 0.0)
NO_SHAPE = -1
FASTEST = 1e9  # [rad/s, m/s] beyond every speed of a linkage
STRONGEST = 1e9  # [N s, N m s] impulse that a closure or motor may exert in a step


class World:
    """A linkage in a world of Bullet of its own, which takes one step after another: what both kinds of worlds share.

    `set_step` must be called before the first step.

    Attributes:
        constraints: Bullet's numbers of the closures.
    """

    def __init__(self, pybullet: Any, mechanism: Mechanism, options: Mapping[str, Any]):
        self.pybullet, self.options = pybullet, options
        self.client: int = pybullet.connect(pybullet.DIRECT)
        finalize(self, pybullet.disconnect, self.client)
        self.constraints: list[int] = []
        self._call(
            pybullet.setPhysicsEngineParameter,
            numSolverIterations=options["iterations"],
            solverResidualThreshold=options["residual"],
            erp=options["erp"],
            numSubSteps=options["substeps"],
            constraintSolverType=getattr(pybullet, f"CONSTRAINT_SOLVER_LCP_{options['solver']}"),
        )
        self._call(pybullet.setGravity, *spatial(mechanism.gravity))
        self._advance = partial(pybullet.stepSimulation, physicsClientId=self.client)

    def _call(self, function: Callable[..., Any], *arguments: Any, **keywords: Any) -> Any:
        return function(*arguments, **keywords, physicsClientId=self.client)

    def _free_from_limits(self, body: int) -> None:
        """Set the damping of a body's links, and raise the limit of its speeds."""
        damping = self.options["damping"]
        self._call(self.pybullet.changeDynamics, body, -1, linearDamping=damping, angularDamping=damping)
        self._call(self.pybullet.changeDynamics, body, -1, maxJointVelocity=FASTEST)

    def _close(self, a: tuple[int, int], b: tuple[int, int], near: Sequence[float], far: Sequence[float]) -> None:
        """Let a point of a link coincide with one of another, both given relative to the centres of mass, in Bullet's frames.

        Args:
            a, b: Bullet's numbers of the body and of its link.
        """
        kind = self.pybullet.JOINT_POINT2POINT
        self.constraints.append(self._call(self.pybullet.createConstraint, *a, *b, kind, ORIGIN, near, far))

    def set_step(self, step: float) -> None:
        """Set the length of a step [s], and the forces that closures and motors may exert, which Bullet keeps as impulses."""
        self.strongest = STRONGEST / step
        self._call(self.pybullet.setTimeStep, step)
        for constraint in self.constraints:
            self._call(self.pybullet.changeConstraint, constraint, maxForce=self.strongest)

    def set_residual(self, residual: float) -> None:
        """Set the squared change of a relative speed [m^2/s^2] at which the iteration ends."""
        self._call(self.pybullet.setPhysicsEngineParameter, solverResidualThreshold=residual)
