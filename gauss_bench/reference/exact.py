"""Motions known in closed form: the N-four-bar as a pendulum, and Chaplygin's sleigh."""

from collections.abc import Callable

import numpy as np
from scipy.integrate import quad
from scipy.special import ellipj, ellipk

from gauss_bench.terms import Array


def n_four_bar(count: int, t: Array, gravity: float = 9.81, speed: float = 1.0) -> tuple[Array, Array]:
    """Angle of the verticals from upright, clockwise [rad], and its rate [rad/s], at times t (k,) [s].

    On the parallelogram branch phi'' = k sin(phi) with k = ((N+1)/2 + N) g / ((N+1)/3 + N) for bars of 1 m; with s^2 = w0^2 + 4 k
    and m = 4 k / s^2 the quarter-turned half angle is Jacobi's amplitude of period 4 K(m) / s for a full turn.
    """
    k = ((count + 1) / 2 + count) * gravity / ((count + 1) / 3 + count)
    s = np.sqrt(speed**2 + 4 * k)
    m = 4 * k / s**2
    period = 4 / s * ellipk(m)
    turns = np.floor(t / period)
    sn, cn, _, _ = ellipj(s / 2 * (t - turns * period - period / 2), m)
    phi = 2 * np.arctan2(sn, cn) + np.pi + 2 * np.pi * turns
    return phi, np.sqrt(speed**2 + 4 * k * np.sin(phi / 2) ** 2)


def sleigh(t: Array, mass: float, inertia: float, lead: float, speed: float, omega: float) -> tuple[Array, Array, Array]:
    """Angle [rad], place of the edge (k, 2) [m] and forward speed [m/s] of Chaplygin's sleigh, released at the origin along x.

    `lead` is the distance [m] of the centre of mass ahead of the edge. With b^2 = (I + m a^2) / m and V^2 = v^2 + b^2 w^2,

        v = V tanh(kappa t + c),   b w = V sech(kappa t + c),   kappa = a V / b^2

    so that the angle is a Gudermannian; the place is a quadrature of it. Source: Neimark and Fufaev, Dynamics of Nonholonomic
    Systems (1972), section III.2.
    """
    b = np.sqrt((inertia + mass * lead**2) / mass)
    V = np.hypot(speed, b * omega)
    kappa, c = lead * V / b**2, np.arctanh(speed / V)

    def angle(x: float | Array) -> Array:
        return np.asarray(2 * b / lead * np.sign(omega) * (np.arctan(np.tanh((kappa * x + c) / 2)) - np.arctan(np.tanh(c / 2))))

    def forward(x: float) -> float:
        return float(V * np.tanh(kappa * x + c))

    def place(until: float, turn: Callable[[Array], Array]) -> float:
        return float(quad(lambda x: forward(x) * turn(angle(x)), 0.0, until, epsabs=1e-13, epsrel=1e-13, limit=500)[0])

    places = np.array([[place(float(x), np.cos), place(float(x), np.sin)] for x in t])
    return angle(t), places, np.array([forward(float(x)) for x in t])
