"""The motion of the crank-slider as one equation for its crank angle th, in closed form, with any torque, damper or inertia.

The angle of the rod is th2, with sin th2 = -l1/l2 sin th. With the derivatives d = dq/dth and e = d2q/dth2 of the coordinates of
`crank_slider` and the crank's speed w, every acceleration that the constraints allow is a = d w' + e w^2. The true one is nearest
to M^-1 Q in the metric of M (Gauss's principle). Some wrong formulas of Yuan and Ge (2016) minimise another distance:

    w' = d . (R - W e w^2) / (d . W d)

    true:                          W = M,      R = Q;          a is nearest to M^-1 Q in the metric of M
    eq. (16), Moore-Penrose:       W = I,      R = M^-1 Q;     a is nearest to M^-1 Q in the Euclidean metric
    eqs. (10), (11) as printed:    W = M^-1,   R = M^-1 Q;     a is nearest to Q in the metric of M^-1
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp

from gauss_bench.mechanism.model import AxisSpringDamper, Mechanism, Torque
from gauss_bench.papers.crank_slider import KEPT
from gauss_bench.terms import Array

RTOL, ATOL = 1e-10, 1e-12
TRUE, EQ_16, EQS_10_11 = "true", "(16) with Moore-Penrose inverses", "(10), (11) as printed"

Seven = tuple[Any, ...]  # one entry for each of the paper's coordinates
Event = Callable[[float, Array], float]


@dataclass(frozen=True, eq=False)
class CrankMotion:
    """The crank-slider in the paper's seven coordinates, which are functions of the crank angle.

    Attributes:
        l1, l2: lengths of crank and rod [m].
        mass: diagonal of M in the seven coordinates [kg, kg m^2].
        torque: torque on the crank [N m].
        k, c, rest: stiffness [N/m], damping [N s/m] and rest position [m] of the slider.
        gravity: acceleration of gravity [m/s^2].
        formula: formula of the acceleration, TRUE, EQ_16 or EQS_10_11.
    """

    l1: float
    l2: float
    mass: Seven
    torque: float
    k: float
    c: float
    rest: float
    gravity: float
    formula: str = TRUE

    def positions(self, theta: Any) -> tuple[Seven, Seven, Seven]:
        """Return q, dq/dtheta and d2q/dtheta2 at crank angles theta [rad]: seven entries each, which have the shape of theta.

        For a single float `math` is used, because an integrator calls this a million times.
        """
        library = math if isinstance(theta, float) else np
        l1, l2, one = self.l1, self.l2, 0 * theta + 1.0  # one: the number 1, or ones in the shape of theta
        s1, c1 = library.sin(theta), library.cos(theta)
        s2 = -l1 / l2 * s1
        c2 = library.sqrt(1 - s2 * s2)  # s2, c2: sine and cosine of the rod's angle th2
        p = -l1 * c1 / (l2 * c2)  # d th2 / d th
        pp = (l1 * s1 / l2 + s2 * p * p) / c2  # d2 th2 / d th2
        x, y = l1 * c1, l1 * s1  # the pin A
        X, dX, ddX = l2 * c2, -l2 * s2 * p, -l2 * (c2 * p * p + s2 * pp)  # distance in x from A to the slider
        angle = library.asin(s2)
        q = (x / 2, y / 2, theta, x + X / 2, y / 2, angle, x + X)
        d = (-y / 2, x / 2, one, -y + dX / 2, x / 2, p, -y + dX)
        e = (-x / 2, -y / 2, 0 * one, -x + ddX / 2, -y / 2, pp, -x + ddX)
        return q, d, e

    def forces(self, x3: Any, x3_rate: Any) -> Seven:
        """Return the seven applied forces of eq. (19) at positions x3 [m] and speeds x3_rate [m/s] of the slider."""
        m1, m2 = self.mass[1], self.mass[4]  # of crank and rod
        push = self.k * (self.rest - x3) - self.c * x3_rate
        return (0.0, -m1 * self.gravity, self.torque, 0.0, -m2 * self.gravity, 0.0, push)

    def acceleration(self, theta: Any, w: Any) -> Any:
        """Return the crank's acceleration w' [rad/s^2] by `formula`, for crank angles theta and speeds w of any shape."""
        q, d, e = self.positions(theta)
        force = inertia = 0.0  # d . (R - W e w^2) and d . W d
        # q[6] is the slider's position x3, and d[6] * w is its speed
        for m, Q, di, ei in zip(self.mass, self.forces(q[6], d[6] * w), d, e, strict=True):
            R = Q if self.formula == TRUE else Q / m
            W = m if self.formula == TRUE else 1 / m if self.formula == EQS_10_11 else 1.0
            force = force + di * (R - W * ei * w * w)
            inertia = inertia + W * di * di
        return force / inertia

    def static_torque(self, theta: Any) -> Any:
        """Return the generalised force [N m] of gravity, spring and torque on the crank at rest, at angles theta of any shape."""
        q, d, _ = self.positions(theta)
        return sum(di * Q for di, Q in zip(d, self.forces(q[6], 0.0), strict=True))

    def run(
        self, t_end: float, start: tuple[float, float] = (0.0, 0.0), rtol: float = RTOL, event: Event | None = None
    ) -> "CrankRun":
        """Integrate from `start` (angle [rad], speed [rad/s]) to t_end [s], or until event(t, y) becomes 0, if it is `terminal`.

        Raises:
            ArithmeticError: the integrator fails.
        """

        def rate(t: float, y: Array) -> list[float]:
            """Return the time derivatives [w, w'] of the crank's angle and speed y."""
            theta, w = float(y[0]), float(y[1])
            return [w, self.acceleration(theta, w)]

        run = solve_ivp(rate, (0.0, t_end), start, method="DOP853", rtol=rtol, atol=rtol * ATOL / RTOL, events=event)
        if not run.success and run.status != 1:
            raise ArithmeticError(f"the motion of the crank-slider cannot be integrated beyond {run.t[-1]:.6g} s: {run.message}")
        return CrankRun(run.t, run.y[0], run.y[1], run.status == 1)


@dataclass(frozen=True, eq=False)
class CrankRun:
    """A run: times t (k,) [s], crank angles theta [rad], crank speeds w [rad/s], and whether its event function ended it."""

    t: Array
    theta: Array
    w: Array
    stopped: bool


def motion_of(mechanism: Mechanism) -> CrankMotion:
    """Return the closed form of the linkage file `crank_slider`, in a scenario that has the spring."""
    torque = sum(f.value for f in mechanism.forces if isinstance(f, Torque))
    (spring,) = (f for f in mechanism.forces if isinstance(f, AxisSpringDamper))
    crank, rod, _ = mechanism.links
    l1, l2 = (float(np.linalg.norm(link.points[b] - link.points[a])) for link, (a, b) in ((crank, "OA"), (rod, "AB")))
    mass, gravity = tuple(mechanism.mass[list(KEPT)].tolist()), -float(mechanism.gravity[1])
    return CrankMotion(l1, l2, mass, torque, spring.k, spring.c, spring.rest, gravity)
