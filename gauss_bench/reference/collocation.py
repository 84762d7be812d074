"""Gauss-Legendre collocation with any number s of stages, order 2 s, in any type of number, for q'' = acceleration(t, q, v).

The coefficients are computed from Legendre polynomials P_k, because the linear system that defines them is badly conditioned. On
the interval -1..1, with the roots x_i of P_s as nodes, discrete orthogonality gives their Lagrange polynomials l_j:

    l_j(x) = b_j sum_k (2 k + 1) P_k(x_j) P_k(x),    k = 0 .. s - 1,    b_j = 1 / sum_k (2 k + 1) P_k(x_j)^2

The integrals of l_j are the matrix of the method, by (2 k + 1) int P_k = P_k+1 - P_k-1. The values of l_j at x > 1 continue the
polynomial of one step into the next step, as a first guess there.

Sources: Hairer, Lubich and Wanner, Geometric Numerical Integration (2006), sections II.1.3 and VIII.6; Davis and Rabinowitz,
Methods of Numerical Integration (1984), section 2.7.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.polynomial import legendre

from gauss_bench.terms import Array

STAGES = 8
ITERATIONS = 40  # largest number of fixed-point iterations in a step
NEWTON_STEPS = 3  # the first step, from roots in double precision, reaches long double; the others are a margin

BatchAcceleration = Callable[[Array, Array, Array], Array]  # t (k,), q, v (k, n) -> a (k, n)


@dataclass(frozen=True, eq=False)
class Tableau:
    """The coefficients of the Gauss method with s stages on the interval 0..1.

    Attributes:
        c, b, A: nodes (s,), weights (s,) and matrix (s, s) of the Runge-Kutta method.
        AA, bA: the products A A (s, s) and b A (s,), by which positions follow from accelerations.
        expansion: (s, s) matrix that turns values at the nodes into coefficients of Legendre polynomials.
    """

    c: Array
    b: Array
    A: Array
    AA: Array
    bA: Array
    expansion: Array

    def forecast(self, ratio: Any = 1) -> Array:
        """Return the matrix (s, s) that extrapolates values at the nodes of a step to those of the next, `ratio` times as long."""
        return np.asarray(legendre_values(1 + 2 * ratio * self.c, len(self.c)).T @ self.expansion)


@lru_cache
def gauss_tableau(stages: int, dtype: Any = np.float64) -> Tableau:
    """Compute the coefficients for `stages` stages, as numbers of the numpy type `dtype`."""
    x = legendre.leggauss(stages)[0].astype(dtype)  # roots of P_s, corrected by Newton's method
    for _ in range(NEWTON_STEPS):
        P = legendre_values(x, stages + 1)
        x = x - P[stages] * (x * x - 1) / (stages * (x * P[stages] - P[stages - 1]))
    x = (x - x[::-1]) / 2
    P = legendre_values(x, stages + 1)
    odd = 2 * np.arange(stages, dtype=dtype) + 1  # 2 k + 1
    b = 1 / (odd @ P[:-1] ** 2)
    below = np.concatenate([-np.ones_like(P[:1]), P[:-2]])  # P_-1 = -1 makes x + 1 the integral of P_0 from -1
    # A_ij: integral of l_j to the node i, half of that on -1..1
    A = (P[1:] - below).T @ P[:-1] * (b / 2)
    return Tableau(c=(1 + x) / 2, b=b, A=A, AA=A @ A, bA=b @ A, expansion=odd[:, None] * P[:-1] * b)


def legendre_values(x: Array, count: int) -> Array:
    """Return the Legendre polynomials P_0 to P_(count - 1) at x (s,), as an array (count, s) of the number type of x."""
    return np.asarray(legendre.legvander(x, count - 1).T)


class NoConvergence(ArithmeticError):
    """The fixed-point iteration of a step did not converge: the step is too long."""


def gauss_legendre(
    acceleration: BatchAcceleration, times: Array, q0: Array, v0: Array, step: float, stages: int = STAGES
) -> tuple[Array, Array]:
    """Integrate q'' = acceleration(t, q, v) by Gauss-Legendre collocation; return q, v (k, n) at the times, in the type of q0.

    Between two neighbouring times the steps are equal, and not longer than `step` [s].

    Raises:
        NoConvergence: a step does not converge within ITERATIONS iterations.
    """
    method = gauss_tableau(stages, q0.dtype)
    c, b, bA = method.c, method.b, method.bA
    q, v, qs, vs = q0.copy(), v0.copy(), [q0], [v0]
    forecast = method.forecast()
    a: Array = np.zeros((stages, len(q0)), dtype=q0.dtype)
    for start, end in pairwise(times):
        count = step_count(end - start, step)
        h = (end - start) / count
        for k in range(count):
            t = start + (k + c) * h
            a = _stages(acceleration, t, q + np.outer(c * h, v), v, forecast @ a, h, method)
            q = q + h * v + h**2 * (bA @ a)
            v = v + h * (b @ a)
        qs.append(q)
        vs.append(v)
    return np.array(qs), np.array(vs)


def step_count(span: Any, step: float) -> int:
    """Return the least number of equal steps that fill `span` and are not longer than `step`, up to rounding."""
    return max(1, int(np.ceil(float(span) / step * (1 - 1e-9))))


def _stages(acceleration: BatchAcceleration, t: Array, drift: Array, v: Array, a: Array, h: float, method: Tableau) -> Array:
    """Return the accelerations (s, n) at the nodes of a step of length h, found by fixed-point iteration from the guess a (s, n).

    `drift` (s, n) are the positions at the nodes without acceleration, q + c h v.
    """
    previous, eps = np.inf, float(np.finfo(a.dtype).eps)
    for _ in range(ITERATIONS):
        corrected = acceleration(t, drift + h**2 * (method.AA @ a), v + h * (method.A @ a))
        change = float(np.abs(corrected - a).max() / (1.0 + np.abs(corrected).max()))
        a = corrected
        # converged, or close to rounding and no longer shrinking
        if change < 5 * eps or (change < 5000 * eps and change >= previous):
            return a
        previous = change
    raise NoConvergence(f"collocation at t = {float(t[0]):.6g} s stalls at a relative change of {previous:.1e}")
