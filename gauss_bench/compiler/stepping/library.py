"""Where no partition serves: accelerations by a rank decision at each state, in absolute coordinates, one step at a time.

    a = M^-1 Q + M^-1/2 (J M^-1/2)^+ (gamma - J M^-1 Q)

with the pseudo-inverse by singular values (Udwadia and Kalaba, Analytical Dynamics, 1996, section 3.3). At a change point J loses
rank and the free velocities gain a direction; the shortest correction is taken there, and the motion goes on along its velocity.
"""

import numpy as np

from gauss_bench.mechanism.evaluate import Evaluator
from gauss_bench.mechanism.model import Mechanism
from gauss_bench.terms import Array, Terms

RANK_TOLERANCE = 1e-9  # of the largest singular value; rounding and drift leave less than 1e-12


class Library:
    """A mechanism at single states, whatever the rank of its rows."""

    def __init__(self, mechanism: Mechanism, baumgarte: tuple[float, float] | None = None):
        self.evaluator, self.baumgarte = Evaluator(mechanism), baumgarte

    def terms(self, t: float, q: Array, v: Array) -> Terms:
        return self.evaluator.terms(t, q, v)

    def acceleration(self, t: float, q: Array, v: Array, damped: bool = False) -> Array:
        """Accelerations (n,), with Baumgarte's terms where asked for."""
        terms = self.terms(t, q, v)
        gamma = terms.gamma
        if damped and self.baumgarte:
            gamma = gamma - 2 * self.baumgarte[0] * terms.phi_dot - self.baumgarte[1] ** 2 * terms.phi
        root = np.sqrt(self.evaluator.mass)
        free = terms.Q / root**2
        found: Array = free + np.linalg.lstsq(terms.J / root, gamma - terms.J @ free, rcond=RANK_TOLERANCE)[0] / root
        return found

    def multipliers(self, t: float, q: Array, v: Array) -> Array:
        """The shortest multipliers (m,) of M a + J^T lambda = Q."""
        terms = self.terms(t, q, v)
        force = terms.Q - self.evaluator.mass * self.acceleration(t, q, v)
        found: Array = np.linalg.lstsq(terms.J.T, force, rcond=RANK_TOLERANCE)[0]
        return found

    def step(self, integrator: str, t: float, q: Array, v: Array, h: float) -> tuple[Array, Array]:
        """One step, projected onto the constraints."""
        if integrator == "semi_implicit_euler":
            v = v + h * self.acceleration(t, q, v, True)
            return self.project(t + h, q + h * v, v)
        a1 = self.acceleration(t, q, v, True)
        v2 = v + h / 2 * a1
        a2 = self.acceleration(t + h / 2, q + h / 2 * v, v2, True)
        v3 = v + h / 2 * a2
        a3 = self.acceleration(t + h / 2, q + h / 2 * v2, v3, True)
        v4 = v + h * a3
        a4 = self.acceleration(t + h, q + h * v3, v4, True)
        return self.project(t + h, q + h / 6 * (v + 2 * v2 + 2 * v3 + v4), v + h / 6 * (a1 + 2 * a2 + 2 * a3 + a4))

    def project(self, t: float, q: Array, v: Array) -> tuple[Array, Array]:
        """The nearest consistent state."""
        return self.evaluator.project(t, q, v)
