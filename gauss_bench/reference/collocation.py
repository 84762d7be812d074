"""Gauss-Legendre collocation with 8 stages, order 16, for q'' = acceleration(t, q, v): the second integrator of the reference.

All stages are evaluated in one batch and found by fixed-point iteration, started from the last step's polynomial.
Source: Hairer, Lubich and Wanner, Geometric Numerical Integration (2006), sections II.1.3 and VIII.6.
"""

from collections.abc import Callable
from itertools import pairwise

import numpy as np
from numpy.polynomial import legendre

from gauss_bench.terms import Array

STAGES = 8
ITERATIONS = 40

BatchAcceleration = Callable[[Array, Array, Array], Array]


def tableau(stages: int) -> tuple[Array, Array, Array]:
    """Nodes c (s,), weights b (s,) and matrix A (s, s) of the Gauss method on 0..1."""
    x, w = legendre.leggauss(stages)
    c = (x + 1) / 2
    powers = np.arange(stages)
    V = c[:, None] ** powers
    integrals = c[:, None] ** (powers + 1) / (powers + 1)
    A: Array = np.linalg.solve(V.T, integrals.T).T
    return c, w / 2, A


class NoConvergence(ArithmeticError):
    """The fixed-point iteration of a step did not converge: the step is too long."""


def gauss_legendre(acceleration: BatchAcceleration, times: Array, q0: Array, v0: Array, step: float) -> tuple[Array, Array]:
    """States (k, n) at the times, in equal steps no longer than `step` between them.

    Raises:
        NoConvergence: the iteration of a step stalls above rounding.
    """
    c, b, A = tableau(STAGES)
    AA, bA = A @ A, b @ A
    q, v, qs, vs = q0.copy(), v0.copy(), [q0], [v0]
    forecast = extrapolation(c)
    a: Array = np.zeros((STAGES, len(q0)))
    for start, end in pairwise(times):
        count = max(1, int(np.ceil((end - start) / step * (1 - 1e-9))))
        h = (end - start) / count
        for k in range(count):
            t = start + (k + c) * h
            a = _stages(acceleration, t, q + np.outer(c * h, v), v, forecast @ a, h, A, AA)
            q = q + h * v + h**2 * (bA @ a)
            v = v + h * (b @ a)
        qs.append(q)
        vs.append(v)
    return np.array(qs), np.array(vs)


def extrapolation(c: Array) -> Array:
    """Matrix that continues the polynomial through the stages of one step to those of the next."""
    powers = np.arange(len(c))
    return np.asarray(np.linalg.solve((c[:, None] ** powers).T, ((1 + c)[:, None] ** powers).T).T)


def _stages(acceleration: BatchAcceleration, t: Array, drift: Array, v: Array, a: Array, h: float, A: Array, AA: Array) -> Array:
    previous = np.inf
    for _ in range(ITERATIONS):
        found = acceleration(t, drift + h**2 * (AA @ a), v + h * (A @ a))
        change = float(np.abs(found - a).max() / (1.0 + np.abs(found).max()))
        a = found
        if change < 1e-15 or (change < 1e-12 and change >= previous):
            return a
        previous = change
    raise NoConvergence(f"collocation at t = {float(t[0]):.6g} s stalls at a relative change of {previous:.1e}")
