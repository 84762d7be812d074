"""The steady turning of the crank-slider: speed, duration and energy of a turn once all turns are alike.

theta is the crank's angle and w its speed. With the travelled angle s = |theta| and the direction D = +-1 of the motion, the speed
u = |w| obeys du/ds = D w'/u. The time t, and the energy E lost in the damper with the coefficient c at the slider's place x3, are
integrated together with u:

    dt/ds = 1/u,    dE/ds = c (dx3/dtheta)^2 u

The secant method finds the speed u that a turn has both at its start and at its end. A constant torque tau does the work 2 pi |tau|
in every turn. If the speed u was constant, the damper would take the energy c u integral (dx3/dtheta)^2 dtheta in a turn.
"""

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import newton

from gauss_bench.papers.crank_motion import RTOL, CrankMotion
from gauss_bench.terms import Array

TURN = 2 * np.pi
SAMPLES = 2001  # in a turn: extremes of speed are then found to (2 pi / 2000)^2 / 8, about 1e-6 of their change
STEADY = 1e-2  # relative: a turn that starts within this of the steady speed counts as steady
TURNS = 500  # largest number of turns; the paper's example needs some 50 to become steady
POINTS = 4096  # in a turn, for the mean of a smooth periodic function: exact to rounding


def integrate_slope(motion: CrankMotion) -> float:
    """Return the integral of (dx3/dtheta)^2 over one turn of the crank [m^2]; x3 is the place of the slider."""
    theta = np.arange(POINTS) * TURN / POINTS
    slope = motion.positions(theta)[1][6]  # dx3/dtheta: item 1 has the derivatives, and x3 is coordinate 6
    # the mean at equally spaced angles (trapezoidal rule) is exact to rounding for a smooth periodic function
    return float((slope**2).mean() * TURN)


def balance_speed(motion: CrankMotion) -> float:
    """Return the constant crank speed [rad/s] at which the damper would take as much energy as the torque gives."""
    return TURN * motion.torque / (motion.c * integrate_slope(motion))


def first_turn(motion: CrankMotion, rtol: float = RTOL) -> tuple[float, float]:
    """Return time [s] and speed [rad/s] at the end of the first turn from rest.

    Raises:
        ArithmeticError: the crank does not complete the turn.
    """

    def angle_left(t: float, y: Array) -> float:
        """Return the angle [rad] by which the crank still has to turn to complete its first turn; y has its angle and speed."""
        return TURN - abs(float(y[0]))

    angle_left.terminal = True  # type: ignore[attr-defined]
    run = motion.run(10.0, rtol=rtol, event=angle_left)
    if not run.stopped:
        raise ArithmeticError("the crank does not complete a turn from rest")
    return float(run.t[-1]), float(run.w[-1])


def turn(motion: CrankMotion, w: float, rtol: float = RTOL, samples: int = 2) -> Array:
    """Integrate a turn that starts at theta = 0 with speed w [rad/s].

    Return speed |w| [rad/s], time [s] and energy lost in the damper [J] at equally spaced crank angles, as an array (3, samples).

    Raises:
        ArithmeticError: the crank does not complete the turn.
    """
    direction = float(np.sign(w))

    def rate(s: float, y: Array) -> list[float]:
        """Return the derivatives of y = (speed |w|, time, lost energy) with respect to the travelled angle s = |theta|."""
        theta, u = float(direction * s), float(y[0])
        slope = motion.positions(theta)[1][6]  # dx3/dtheta, of the slider with the damper c
        return [direction * motion.acceleration(theta, direction * u) / u, 1 / u, motion.c * slope**2 * u]

    start, places = [abs(w), 0.0, 0.0], np.linspace(0.0, TURN, samples)
    run = solve_ivp(rate, (0.0, TURN), start, method="DOP853", rtol=rtol, atol=rtol, t_eval=places)
    if not run.success:
        raise ArithmeticError(f"the crank does not complete the turn it starts with {w:.6g} rad/s")
    return np.asarray(run.y)


def regime(motion: CrankMotion, rtol: float = RTOL) -> dict[str, float]:
    """Return the characteristic values of the steady rotation that the crank reaches after a start from rest.

    A steady turn is one that ends with the speed with which it starts. The keys are:
        mean, slowest, fastest: crank speeds of a steady turn, with their sign [rad/s].
        period: duration of a steady turn [s].
        taken, lost: energy taken from the torque, and lost in the damper, in a steady turn [J].
        first_speed, first_time: speed [rad/s] and time [s] at the end of the first turn from rest.
        steady_after: time from rest [s] until a turn starts with the speed of a steady turn, within the relative difference STEADY.

    Raises:
        ArithmeticError: the crank does not complete a turn, or its motion does not become periodic.
    """
    first_time, first_speed = first_turn(motion, rtol)
    direction = float(np.sign(first_speed))

    def gain(u: float) -> float:
        """Return the change of speed [rad/s] in a turn that starts with the speed u."""
        return float(turn(motion, direction * u, rtol)[0, -1]) - u

    try:
        guess = abs(balance_speed(motion))
        steady = float(newton(gain, guess, x1=1.1 * guess, tol=10 * rtol * guess))
    except RuntimeError as error:
        raise ArithmeticError("no turn was found that starts and ends with the same speed") from error
    speeds, times, lost = turn(motion, direction * steady, rtol, SAMPLES)
    return {
        "mean": direction * TURN / float(times[-1]),
        "slowest": direction * float(speeds.min()),
        "fastest": direction * float(speeds.max()),
        "period": float(times[-1]),
        "taken": TURN * abs(motion.torque),
        "lost": float(lost[-1]),
        "first_speed": first_speed,
        "first_time": first_time,
        "steady_after": first_time + approach(motion, first_speed, steady, rtol),
    }


def approach(motion: CrankMotion, w: float, steady: float, rtol: float) -> float:
    """Return the time [s] from the end of the first turn until a turn begins with nearly the steady speed.

    A speed is nearly steady if its relative difference from `steady` is less than STEADY.

    Args:
        w: speed of the crank at the end of the first turn, with its sign [rad/s].
        steady: absolute speed of the crank at the start of a steady turn [rad/s], one that ends with the speed with which it
            starts.

    Raises:
        ArithmeticError: none of TURNS turns begins with nearly the steady speed.
    """
    t, direction, u = 0.0, float(np.sign(w)), abs(w)
    for _ in range(TURNS):
        if abs(u / steady - 1) < STEADY:
            return t
        speed, duration, _ = turn(motion, direction * u, rtol)[:, -1]
        t, u = t + float(duration), float(speed)
    raise ArithmeticError(f"the speed of the crank is not steady after {TURNS} turns")
