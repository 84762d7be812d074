"""Accelerations at a given state, found from Bullet's steps.

Bullet computes no accelerations of closed loops. From coordinates y and velocities v, a step of h [s] computes the new velocities
v1 = P(y) (v + h a_free). Here P(y) projects velocities onto those that the loop closures at y allow, J(y) v1 = 0, and a_free are
the accelerations without closures. In the limit of short steps, velocities change at the rate

    y'' = P(y) a_free + d/de P(y + e v) v        at e = 0

The first term is the change of v in one step at y, divided by the step length h; the result is the same for every h. The second
term is found by fourth-order finite differences of the function P(y + e v) v of e. Each value of this function is the result of a
step so short that forces have no effect and only the projection remains. So no step length causes an error, and neither does the
closing of gaps, because erp = 0. With the options CONVERGED, Bullet's solver iterates until it has converged; in runs it may stop
earlier, at the limit that the option `iterations` sets.

The function `tree_model.acceleration_by_steps` is unsuitable for Bullet, because it divides the error of the iterative solver by
the length of a very short step. The divisors here, STEP and e, are much larger.
"""

from collections.abc import Mapping

import numpy as np

from gauss_bench.engines.bullet.translate import Forces
from gauss_bench.engines.bullet.world import BodyWorld, TreeWorld
from gauss_bench.mechanism.motion_laws import MotionLaw
from gauss_bench.terms import Array

DIFFERENCE = 1e-3  # = d [rad, m] between points of the differences: truncation d^4/30 and rounding 1e-16/d are both near 1e-13
CONVERGED = {"iterations": 20_000, "erp": 0.0, "substeps": 0}
ROUNDING = 1e-15  # relative to the largest speed, or to 1: an iteration that changes speeds by less has converged
STEP = 1e-3  # [s] length of the step from which P a_free is found
INSTANT = 1e-15  # [s] length of a step that only projects


class Accelerations:
    """A function (t, y, dy) -> accelerations (n,) of a world's coordinates y, at a state that meets the constraints.

    Attributes:
        world: a world that no run uses, with the options CONVERGED.
        laws: index of a driven joint -> its motion law.
    """

    def __init__(self, world: TreeWorld | BodyWorld, forces: Forces, laws: Mapping[int, MotionLaw]):
        self.world, self.forces, self.laws = world, forces, laws

    def __call__(self, t: float, y: Array, dy: Array) -> Array:
        """Return P(y) a_free + d/de P(y + e v) v at e = 0 (n,), at time t [s] and the state y, v = dy (n,)."""
        tau = self.forces(t, y, dy)
        # speeds of the driven joints at the beginning and at the end of the step, which differ by law''(t) times STEP
        speeds_before = {joint: float(dy[joint]) for joint in self.laws}
        speeds_after = {joint: float(dy[joint] + STEP * law(t)[2]) for joint, law in self.laws.items()}
        # first term, P(y) a_free: the change of velocities in one step with forces, divided by STEP
        force_term: Array = (self._step_velocities(STEP, y, dy, tau, speeds_after) - dy) / STEP
        speed = float(np.abs(dy).max(initial=0.0))
        if speed == 0.0:  # the second term is quadratic in the speeds, so it is zero
            return force_term
        e = DIFFERENCE / speed
        # second term, the fourth-order difference of P(y + k e v) v at k = -2, -1, 1, 2; in a step of INSTANT, tau changes no speed
        moved = {k: self._step_velocities(INSTANT, y + k * e * dy, dy, tau, speeds_before) for k in (-2, -1, 1, 2)}
        return force_term + (8 * (moved[1] - moved[-1]) - (moved[2] - moved[-2])) / (12 * e)

    def _step_velocities(self, step: float, y: Array, dy: Array, tau: Array, driven: Mapping[int, float]) -> Array:
        """Return the velocities (n,) after one step of length `step` [s] from y, dy (n,) under the forces tau (n,).

        `driven` maps the index of a driven joint to the speed that its motor reaches in the step.
        """
        self.world.set_step(step)
        # Bullet's solver stops when the squared change of each speed in an iteration is below this
        self.world.set_residual((ROUNDING * max(1.0, float(np.abs(dy).max(initial=0.0)))) ** 2)
        self.world.put(y, dy)
        for joint, rate in driven.items():
            self.world.drive(joint, rate)
        self.world.step(tau.tolist())
        return self.world.state()[1]
