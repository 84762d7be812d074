"""The motion of the crank-slider in its crank angle alone, in closed form, with any torque, damper or inertia.

    sin th2 = -l1/l2 sin th,   q(th) of crank, rod and slider as in `crank_slider`,   d = dq/dth,   e = d2q/dth2

The true acceleration minimises a distance over all a = d w' + e w^2; the formulas of the paper that are wrong minimise another one
over the same set, because they too satisfy J a = g:

    w' = d . (R - W e w^2) / (d . W d)
    true                      W = M,      R = Q           nearest to M^-1 Q in the metric of M
    (16), Moore-Penrose       W = I,      R = M^-1 Q      nearest to M^-1 Q in the Euclidean metric
    (10), (11) as printed     W = M^-1,   R = M^-1 Q      nearest to Q in the metric of M^-1
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.integrate import solve_ivp

from gauss_bench.mechanism.model import AxisSpringDamper, Mechanism, Torque
from gauss_bench.papers.crank_slider import KEPT
from gauss_bench.terms import Array

RTOL, ATOL = 1e-10, 1e-12
TRUE, EQ_16, EQS_10_11 = "true", "(16) with Moore-Penrose inverses", "(10), (11) as printed"

Event = Callable[[float, Array], float]


@dataclass(frozen=True, eq=False)
class CrankMotion:
    """The linkage in the paper's coordinates: lengths [m], mass (7,), torque [N m], spring and damper of the slider, gravity."""

    l1: float
    l2: float
    mass: Array
    torque: float
    k: float
    c: float
    rest: float
    gravity: float
    formula: str = TRUE

    def positions(self, theta: Array | float) -> tuple[Array, Array, Array]:
        """q, dq/dtheta, d2q/dtheta2 (7, ...) at crank angles (...)."""
        l1, l2, one = self.l1, self.l2, np.ones_like(theta)
        s1, c1 = np.sin(theta), np.cos(theta)
        s2 = -l1 / l2 * s1
        c2 = np.sqrt(1 - s2 * s2)
        p = -l1 * c1 / (l2 * c2)
        pp = (l1 * s1 / l2 + s2 * p * p) / c2
        x, y = l1 * c1, l1 * s1
        X, dX, ddX = l2 * c2, -l2 * s2 * p, -l2 * (c2 * p * p + s2 * pp)
        q = np.array([x / 2, y / 2, theta, x + X / 2, y / 2, np.arcsin(s2), x + X])
        d = np.array([-y / 2, x / 2, one, -y + dX / 2, x / 2, p, -y + dX])
        e = np.array([-x / 2, -y / 2, 0 * one, -x + ddX / 2, -y / 2, pp, -x + ddX])
        return q, d, e

    def forces(self, q: Array, v: Array) -> Array:
        """Eq. (19): (7, ...)."""
        push = self.k * (self.rest - q[6]) - self.c * v[6]
        one = np.ones_like(push)
        m = self.mass
        return np.array(
            [0 * one, -m[1] * self.gravity * one, self.torque * one, 0 * one, -m[4] * self.gravity * one, 0 * one, push]
        )

    def acceleration(self, theta: Array | float, w: Array | float) -> Array:
        """Crank acceleration (...) [rad/s^2] by the formula."""
        q, d, e = self.positions(theta)
        mass = self.mass.reshape(-1, *[1] * np.ndim(theta))
        Q = self.forces(q, d * w)
        weighted = Q if self.formula == TRUE else Q / mass
        weight = mass if self.formula == TRUE else 1 / mass if self.formula == EQS_10_11 else np.ones_like(mass)
        return np.asarray((d * (weighted - weight * e * w * w)).sum(0) / (weight * d * d).sum(0))

    def static_torque(self, theta: Array | float) -> Array:
        """Generalised force (...) [N m] of gravity, spring and torque at rest."""
        q, d, _ = self.positions(theta)
        return np.asarray((d * self.forces(q, 0 * d)).sum(0))

    def run(
        self, t_end: float, start: tuple[float, float] = (0.0, 0.0), rtol: float = RTOL, event: Event | None = None
    ) -> "Course":
        """The motion from rest, or from an angle and a speed; stops at the event."""

        def rate(t: float, y: Array) -> list[float]:
            return [y[1], float(self.acceleration(y[0], y[1]))]

        found = solve_ivp(rate, (0.0, t_end), start, method="DOP853", rtol=rtol, atol=rtol * ATOL / RTOL, events=event)
        if not found.success and found.status != 1:
            raise ArithmeticError(
                f"the motion of the crank-slider cannot be integrated beyond {found.t[-1]:.6g} s: {found.message}"
            )
        return Course(found.t, found.y[0], found.y[1], found.status == 1)


@dataclass(frozen=True, eq=False)
class Course:
    """Times (k,) [s], crank angles [rad] and speeds [rad/s] of a run, and whether the event ended it."""

    t: Array
    theta: Array
    w: Array
    stopped: bool


def motion_of(mechanism: Mechanism) -> CrankMotion:
    """The closed form of the linkage file `crank_slider` in any scenario with its torque and its spring.

    Raises:
        ValueError: the linkage is another one.
    """
    torques = [f.value for f in mechanism.forces if isinstance(f, Torque)]
    springs = [f for f in mechanism.forces if isinstance(f, AxisSpringDamper)]
    if mechanism.name != "crank_slider" or len(springs) != 1 or len(torques) > 1:
        raise ValueError(f"{mechanism.name}, scenario {mechanism.scenario}: not the crank-slider with its spring")
    crank, rod, _ = mechanism.links
    l1, l2 = (float(np.linalg.norm(link.points[b] - link.points[a])) for link, (a, b) in ((crank, "OA"), (rod, "AB")))
    (spring,) = springs
    mass, gravity = mechanism.mass[list(KEPT)], -float(mechanism.gravity[1])
    return CrankMotion(l1, l2, mass, sum(torques), spring.k, spring.c, spring.rest, gravity)
