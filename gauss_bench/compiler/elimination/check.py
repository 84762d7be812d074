"""A program against the linkage's own evaluation: another evaluation of the terms, and another way to solve them.

In weighted coordinates b = M^(1/2) a the acceleration is the free one and the shortest correction that meets the constraints,

    b = f + K^+ (gamma - K f),    K = J M^(-1/2),    f = M^(-1/2) Q

by least squares, which takes redundant rows. Source: Udwadia and Kalaba, Analytical Dynamics (1996), eq. (3.17).
"""

import numpy as np

from gauss_bench.compiler.equations.sampling import shortest
from gauss_bench.mechanism.evaluate import Evaluator
from gauss_bench.mechanism.model import Mechanism
from gauss_bench.terms import Array


def library_acceleration(evaluator: Evaluator, t: float, q: Array, v: Array) -> Array:
    """a (n,) at a state on the constraints."""
    terms, root = evaluator.terms(t, q, v), np.sqrt(evaluator.mass)
    K, b = terms.J / root, terms.Q / root
    for _ in range(2):  # the second pass takes off what rounding left
        b = b + shortest(K, terms.gamma - K @ b)
    return np.asarray(b / root)


def acceleration_error(evaluator: Evaluator, t: float, q: Array, v: Array, a: Array) -> float:
    """Error of an acceleration relative to the larger of its true size and that of the free motion: near rest only that is left."""
    truth, free = library_acceleration(evaluator, t, q, v), evaluator.applied.generalised(q, v) / evaluator.mass
    size = max(float(np.abs(truth).max(initial=0.0)), float(np.abs(free).max(initial=0.0)))
    error = float(np.abs(a - truth).max(initial=0.0))
    return error / size if size > 0 else error


def worst_error(mechanism: Mechanism, accelerations: list[tuple[float, Array, Array, Array]]) -> float:
    """The largest relative error of accelerations (t, q, v, a); not a number where one of them is not."""
    evaluator = Evaluator(mechanism)
    return float(np.max([acceleration_error(evaluator, *state) for state in accelerations]))


def off_constraints_error(mechanism: Mechanism, t: float, q: Array, v: Array, phi: Array, phi_dot: Array, energy: float) -> float:
    """Error of residuals and energy at any state, relative to their own size or 1 (m, rad, their rates, J)."""
    evaluator = Evaluator(mechanism)
    terms, truth = evaluator.terms(t, q, v), float(evaluator.energy(q, v))
    found = np.concatenate([phi, phi_dot, [energy]])
    wanted = np.concatenate([terms.phi[: evaluator.constraints.holonomic], terms.phi_dot, [truth]])
    return float(np.abs((found - wanted) / np.maximum(np.abs(wanted), 1.0)).max())
