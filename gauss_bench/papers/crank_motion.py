"""The motion of the crank-slider as one equation for the crank angle theta, in closed form, with any torque, damper or inertia.

The angle of the rod is theta2, with sin theta2 = -l1/l2 sin theta. With the derivatives d = dq/dtheta and e = d2q/dtheta2 of the
coordinates of `crank_slider` and the crank's speed w, every acceleration that the constraints allow is a = d w' + e w^2. The true
one is nearest to M^-1 Q in the metric of M (Gauss's principle). Some wrong formulas of Yuan and Ge (2016) minimise another
distance:

    w' = d . (R - W e w^2) / (d . W d)

    true:                          W = M,      R = Q;          a is nearest to M^-1 Q in the metric of M
    eq. (16), Moore-Penrose:       W = I,      R = M^-1 Q;     a is nearest to M^-1 Q in the Euclidean metric
    eqs. (10), (11) as printed:    W = M^-1,   R = M^-1 Q;     a is nearest to Q in the metric of M^-1

F(theta) = d . Q(q, 0) is the static torque of weight and spring on the crank. Under an applied torque tau, the crank is in
equilibrium where F + tau = 0; this equilibrium is stable if dF/dtheta < 0.

The equation of motion does not depend on time, so that two motions cannot cross in the plane of crank angle and speed. A crank that
starts at rest and completes a turn is therefore faster at each angle of every later turn, and never stops. A crank that turns back
earlier stays between two angles and comes to rest, because torque, weight and spring are conservative and the damper takes energy.

In steady turning, with the travelled angle s = |theta| and the direction D = +-1, the speed u = |w| obeys du/ds = D w'/u. The time
t, and the energy E lost in the damper c at the slider's position x3, are integrated together with u:

    dt/ds = 1/u,    dE/ds = c (dx3/dtheta)^2 u
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import bisect, brentq, minimize_scalar, newton

from gauss_bench.mechanism.model import AxisSpringDamper, Mechanism, Torque
from gauss_bench.papers.crank_slider import KEPT, derivative
from gauss_bench.terms import Array

RTOL, ATOL = 1e-10, 1e-12
TRUE, EQ_16, EQS_10_11 = "true", "(16) with Moore-Penrose inverses", "(10), (11) as printed"
GRID = 720  # intervals of a turn: the slope of the static torque changes sign only a few times in a turn
LONGEST = 60.0  # [s] longest first turn; it takes less than 1 s, unless the data are within rounding of a bound
WIDTH = 1e-9  # relative width of a bracket at which bisection ends, about the error of the integration
MARGIN = 100.0  # distance from the first threshold at which the second search begins, in widths of the last bracket
SECOND_TOLERANCE = 1e-2  # factor on the tolerance of a second search, which shows the error of the integration
TURN = 2 * np.pi
SAMPLES = 2001  # in a turn: extremes of speed are then found to (2 pi / 2000)^2 / 8, about 1e-6 of their change
STEADY = 1e-2  # relative difference from the steady speed up to which the start of a turn counts as steady
TURNS = 500  # largest number of turns; the paper's example needs about 50 to become steady
POINTS = 4096  # in a turn, for the mean of a smooth periodic function: exact to rounding

Seven = tuple[Any, ...]  # one entry for each of the paper's coordinates
Event = Callable[[float, Array], float]  # function of the time [s] and the state (crank angle, crank speed), whose zero is sought


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

        For a single float `math` is used, because an integrator calls this function a million times.
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
        """Integrate from `start` (angle [rad], speed [rad/s]) to t_end [s], or until a terminal event(t, y) becomes 0.

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
    """A run: times t (k,) [s], crank angles theta [rad], crank speeds w [rad/s], and whether an event ended the run."""

    t: Array
    theta: Array
    w: Array
    stopped: bool


def motion_of(mechanism: Mechanism) -> CrankMotion:
    """Return the motion in closed form of the linkage file `crank_slider`, in a scenario that has the spring."""
    torque = sum(f.value for f in mechanism.forces if isinstance(f, Torque))
    (spring,) = (f for f in mechanism.forces if isinstance(f, AxisSpringDamper))
    crank, rod, _ = mechanism.links
    l1, l2 = (float(np.linalg.norm(link.points[b] - link.points[a])) for link, (a, b) in ((crank, "OA"), (rod, "AB")))
    mass, gravity = tuple(mechanism.mass[list(KEPT)].tolist()), -float(mechanism.gravity[1])
    return CrankMotion(l1, l2, mass, torque, spring.k, spring.c, spring.rest, gravity)


class Extreme(NamedTuple):
    """Largest or smallest static torque [N m] on the crank, and the crank angle [rad] at which it acts."""

    torque: float
    theta: float


class Equilibrium(NamedTuple):
    """A crank angle [rad] in (-pi, pi] at which the crank can rest."""

    theta: float
    stable: bool


def torque_range(motion: CrankMotion) -> tuple[Extreme, Extreme]:
    """Return the smallest and the largest static torque of weight and spring on the crank during one turn of the crank."""
    idle = replace(motion, torque=0.0)
    theta, step = np.linspace(-np.pi, np.pi, GRID + 1), 2 * np.pi / GRID
    F, extremes = idle.static_torque(theta), []
    for sign in (1.0, -1.0):  # the largest F is the smallest -F
        nearest = float(theta[(sign * F).argmin()])
        ends, options = (nearest - step, nearest + step), {"xatol": 1e-10}
        best = minimize_scalar(lambda x, k=sign: k * idle.static_torque(float(x)), bounds=ends, method="bounded", options=options)
        extremes.append(Extreme(sign * float(best.fun), float(best.x)))
    return extremes[0], extremes[1]


def find_equilibria(motion: CrankMotion) -> tuple[Equilibrium, ...]:
    """Return the equilibria of the crank under gravity, spring and `motion.torque`, by ascending angle; empty if there are none."""
    theta = np.linspace(-np.pi, np.pi, GRID + 1)
    F = motion.static_torque(theta)
    equilibria = []
    for k in np.flatnonzero(F[:-1] * F[1:] < 0):  # intervals in which the torque changes its sign
        root = float(brentq(lambda x: float(motion.static_torque(x)), float(theta[k]), float(theta[k + 1]), xtol=1e-14))
        equilibria.append(Equilibrium(root, bool(derivative(motion.static_torque, root, 1.0) < 0)))
    return tuple(equilibria)


def settles(motion: CrankMotion, rtol: float = RTOL) -> bool:
    """Tell whether the crank, started at rest at theta = 0, turns back before it completes a turn, and so comes to rest.

    Raises:
        ArithmeticError: neither happens, see `first_turn`.
    """
    return first_turn(motion, rtol) is None


def first_turn(motion: CrankMotion, rtol: float = RTOL) -> tuple[float, float] | None:
    """Return time [s] and speed [rad/s] at the end of the first turn from rest at theta = 0; None if the crank turns back before.

    Raises:
        ArithmeticError: neither happens within LONGEST [s]: the parameters lie, within rounding, on the boundary between both.
    """
    torque_at_start = float(motion.static_torque(0.0))
    if torque_at_start == 0.0:
        return None

    def undecided(t: float, y: Array) -> float:
        """Return a number that is 0 at the start, then positive, and falls to 0 when the crank turns back or completes a turn."""
        return float(min(np.sign(torque_at_start) * y[1], TURN - abs(y[0])))

    undecided.terminal, undecided.direction = True, -1.0  # type: ignore[attr-defined]
    run = motion.run(LONGEST, rtol=rtol, event=undecided)
    if not run.stopped:
        raise ArithmeticError(f"whether the crank comes to rest is not decided within {LONGEST:g} s")
    has_turned = abs(run.theta[-1]) >= TURN * (1 - 1e-6)
    return (float(run.t[-1]), float(run.w[-1])) if has_turned else None


def find_bound(make: Callable[[float], CrankMotion], settled: float, running: float, width: float = WIDTH) -> tuple[float, float]:
    """Return the bound of a parameter between motions make(value) that come to rest and that turn for ever, and its uncertainty.

    The bisection begins with `settled` and `running`, a value of each kind, and ends when their relative distance is `width`. The
    uncertainty is half the last distance plus the change of the result with a smaller tolerance of the integration.

    Raises:
        ValueError: the crank comes to rest with both values, or with neither.
    """

    def side(value: float, rtol: float) -> float:
        """Return 1 if the crank comes to rest with this value of the parameter, else -1."""
        return 1.0 if settles(make(value), rtol) else -1.0

    ends = {"xtol": 1e-15, "rtol": width / 2}  # half the last bracket, whose middle `bisect` returns
    coarse = bisect(side, settled, running, (RTOL,), **ends)
    margin = MARGIN * width * abs(coarse)
    fine = bisect(side, coarse - margin, coarse + margin, (SECOND_TOLERANCE * RTOL,), **ends)
    return float(fine), width * abs(fine) / 2 + abs(fine - coarse)


def integrate_slope(motion: CrankMotion) -> float:
    """Return the integral of (dx3/dtheta)^2 over one turn of the crank [m^2]; x3 is the position of the slider."""
    theta = np.arange(POINTS) * TURN / POINTS
    slope = motion.positions(theta)[1][6]  # dx3/dtheta: item 1 has the derivatives, and x3 is coordinate 6
    # the mean at equally spaced angles (trapezoidal rule) is exact to rounding for a smooth periodic function
    return float((slope**2).mean() * TURN)


def balance_speed(motion: CrankMotion) -> float:
    """Return the constant crank speed [rad/s] at which the damper would take as much energy as the torque gives."""
    return TURN * motion.torque / (motion.c * integrate_slope(motion))


def integrate_turn(motion: CrankMotion, w: float, rtol: float = RTOL, samples: int = 2) -> Array:
    """Return speed |w| [rad/s], time [s] and energy lost [J] in a turn from theta = 0 at speed w [rad/s], as an array (3, samples).

    The samples are at equally spaced crank angles from 0 to a whole turn.

    Raises:
        ArithmeticError: the crank does not complete the turn.
    """
    direction = float(np.sign(w))

    def rate(s: float, y: Array) -> list[float]:
        """Return the derivatives of y = (speed |w|, time, lost energy) with respect to the travelled angle s = |theta|."""
        theta, u = float(direction * s), float(y[0])
        slope = motion.positions(theta)[1][6]  # dx3/dtheta, of the slider with the damper c
        return [direction * motion.acceleration(theta, direction * u) / u, 1 / u, motion.c * slope**2 * u]

    start, travelled = [abs(w), 0.0, 0.0], np.linspace(0.0, TURN, samples)
    run = solve_ivp(rate, (0.0, TURN), start, method="DOP853", rtol=rtol, atol=rtol, t_eval=travelled)
    if not run.success:
        raise ArithmeticError(f"the crank does not complete the turn it starts with {w:.6g} rad/s")
    return np.asarray(run.y)


def steady_rotation(motion: CrankMotion, rtol: float = RTOL) -> dict[str, float]:
    """Return the characteristic values of the steady rotation that the crank reaches after a start from rest.

    The keys are:
        mean, slowest, fastest: signed crank speeds of a steady turn, which ends with the speed with which it starts [rad/s].
        period: duration of a steady turn [s].
        taken, lost: energy taken from the torque, and lost in the damper, in a steady turn [J].
        first_speed, first_time: speed [rad/s] and time [s] at the end of the first turn from rest.
        steady_after: time from rest [s] until a turn starts within the relative difference STEADY of the steady speed.

    Raises:
        ArithmeticError: the crank does not complete a turn, or its motion does not become periodic.
    """
    if (first := first_turn(motion, rtol)) is None:
        raise ArithmeticError("the crank does not complete a turn from rest")
    first_time, first_speed = first
    direction = float(np.sign(first_speed))

    def gain(u: float) -> float:
        """Return the change of speed [rad/s] in a turn that starts with the speed u."""
        return float(integrate_turn(motion, direction * u, rtol)[0, -1]) - u

    try:
        guess = abs(balance_speed(motion))
        steady = float(newton(gain, guess, x1=1.1 * guess, tol=10 * rtol * guess))
    except RuntimeError as error:
        raise ArithmeticError("no turn was found that starts and ends with the same speed") from error
    speeds, times, lost = integrate_turn(motion, direction * steady, rtol, SAMPLES)
    return {
        "mean": direction * TURN / float(times[-1]),
        "slowest": direction * float(speeds.min()),
        "fastest": direction * float(speeds.max()),
        "period": float(times[-1]),
        "taken": TURN * abs(motion.torque),
        "lost": float(lost[-1]),
        "first_speed": first_speed,
        "first_time": first_time,
        "steady_after": first_time + time_to_steady(motion, first_speed, steady, rtol),
    }


def time_to_steady(motion: CrankMotion, w: float, steady: float, rtol: float) -> float:
    """Return the time [s] from the end of the first turn, at speed w [rad/s], until a turn begins nearly at the speed `steady` > 0.

    Raises:
        ArithmeticError: none of TURNS turns begins with nearly the steady speed.
    """
    t, direction, u = 0.0, float(np.sign(w)), abs(w)
    for _ in range(TURNS):
        if abs(u / steady - 1) < STEADY:
            return t
        speed, duration, _ = integrate_turn(motion, direction * u, rtol)[:, -1]
        t, u = t + float(duration), float(speed)
    raise ArithmeticError(f"the speed of the crank is not steady after {TURNS} turns")
