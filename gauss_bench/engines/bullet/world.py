"""The common base class of linkages in Bullet, modelled as trees of joints (`joints.py`) or as free bodies (`bodies.py`).

Traps of PyBullet 3.2.7, which reports none of them:

    changeDynamics     If one call sets linearDamping, angularDamping or maxJointVelocity together with mass or inertia, it sets
                       mass and inertia of the base, and frees the base. So damping and the limit of speeds are set in calls of
                       their own.
    damping            By default, damping of 0.04 slows every link of a tree, in proportion to the link's speed and to its square.
    speeds             By default, joints cannot be faster than 100 rad/s or m/s.
    motors             By default, a motor brakes every joint.
    inertias           The inertias of a body without a collision shape are zero until they are set.
    torques            Bullet forgets applied forces and torques after a step.
    rigid bodies       Rigid bodies feel no torque in their first step.
    closures           By default, a loop closure exerts an impulse of at most 500 N s in a step.
"""

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any
from weakref import finalize

from gauss_bench.engines.shared import spatial
from gauss_bench.mechanism.model import Mechanism

ORIGIN: Sequence[float] = (0.0, 0.0, 0.0)
NO_SHAPE = -1
FASTEST = 1e9  # [rad/s, m/s] limit of joint speeds, beyond every speed of a linkage
STRONGEST = 1e9  # [N s, N m s] limit of the impulse of a closure or motor in a step


class World:
    """A linkage in a world of Bullet: the base class of `TreeWorld` and `BodyWorld`.

    `set_step` must be called before the first step.

    Attributes:
        constraints: Bullet's numbers of the closures.
    """

    def __init__(self, pybullet: Any, mechanism: Mechanism, options: Mapping[str, Any]):
        """Make a new world without bodies, with the solver and gravity."""
        self.pybullet, self.options = pybullet, options
        self.client: int = pybullet.connect(pybullet.DIRECT)
        finalize(self, pybullet.disconnect, self.client)  # a world that is no longer used does not stay connected
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
        """Call a function of PyBullet for this world."""
        return function(*arguments, **keywords, physicsClientId=self.client)

    def _set_damping_and_limits(self, body: int) -> None:
        """Set the damping of all links of a Bullet multibody to the option `damping`, and its limit of joint speeds to FASTEST."""
        damping = self.options["damping"]
        # -1 is the base; but Bullet keeps these numbers once for the whole body, with all its links and joints
        self._call(self.pybullet.changeDynamics, body, -1, linearDamping=damping, angularDamping=damping)
        self._call(self.pybullet.changeDynamics, body, -1, maxJointVelocity=FASTEST)

    def _close(self, a: tuple[int, int], b: tuple[int, int], near: Sequence[float], far: Sequence[float]) -> None:
        """Make a point of one link coincide with a point of another.

        Args:
            a, b: Bullet's index of the body, and index of the link in this body, for each of the two links.
            near, far: (3,) the points relative to the links' centres of mass, in Bullet's frames [m].
        """
        kind = self.pybullet.JOINT_POINT2POINT
        self.constraints.append(self._call(self.pybullet.createConstraint, *a, *b, kind, ORIGIN, near, far))

    def set_step(self, step: float) -> None:
        """Set the step size [s], and the limit of forces so that the largest impulse of closures and motors stays the same."""
        self.strongest = STRONGEST / step
        self._call(self.pybullet.setTimeStep, step)
        for constraint in self.constraints:
            self._call(self.pybullet.changeConstraint, constraint, maxForce=self.strongest)

    def set_residual(self, residual: float) -> None:
        """Set the squared change of a relative speed [m^2/s^2] below which the solver's iteration ends."""
        self._call(self.pybullet.setPhysicsEngineParameter, solverResidualThreshold=residual)
