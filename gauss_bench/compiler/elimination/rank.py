"""Accelerations by a rank decision at each state: what programs are checked against, and what serves where none of them does.

    a = M^-1 Q + M^-1/2 (J M^-1/2)^+ (gamma - J M^-1 Q)

the shortest correction in the mass metric that meets the constraints, with the pseudo-inverse by singular values. At a change point
J loses rank and the free velocities gain a direction; the motion goes on along its velocity. It is another evaluation of the terms
and another way to solve them than those of the programs.
Source: Udwadia and Kalaba, Analytical Dynamics (1996), section 3.3 and eq. (3.17).
"""

from collections.abc import Callable
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from gauss_bench.compiler.equations.sampling import DENSE, RANK_TOLERANCE, manifold_states, scales, shortest
from gauss_bench.integrate.fixed_step import ROUNDING, STEPS, held_back
from gauss_bench.mechanism.evaluate import Evaluator
from gauss_bench.mechanism.model import Mechanism
from gauss_bench.terms import Array, Terms
from gauss_bench.trajectory import States

CHECKS, FEW = 9, 2  # states at which a program is checked; few of a large linkage
OFF = 0.1  # [rad, lengths] from the constraints, where residuals and energy are checked
CHECKED = 1e-9  # relative error; sound programs reach 1e-12, and a wrong sign or a lost term is nowhere near

Accelerate = Callable[[Array, Array, Array], tuple[Array, NDArray[np.bool_]]]  # t (k, 1), q, v (k, n) -> a (k, n), usable (k,)


def _by_singular_values(J: Array, r: Array) -> Array:
    return np.asarray(np.linalg.lstsq(J, r, rcond=RANK_TOLERANCE)[0])


def _constrain(terms: Terms, mass: Array, gamma: Array, solve: Callable[[Array, Array], Array], passes: int) -> Array:
    """a (n,); each further pass takes off what rounding left."""
    root = np.sqrt(mass)
    K, weighted = terms.J / root, terms.Q / root
    for _ in range(passes):
        weighted = weighted + solve(K, gamma - K @ weighted)
    return np.asarray(weighted / root)


class RankDecision:
    """A mechanism at single states, whatever the rank of its rows."""

    def __init__(self, mechanism: Mechanism, baumgarte: tuple[float, float] | None = None):
        self.mechanism, self.baumgarte = mechanism, baumgarte

    @cached_property
    def evaluator(self) -> Evaluator:
        return Evaluator(self.mechanism)

    def acceleration(self, t: float, q: Array, v: Array, damped: bool = False) -> Array:
        """Accelerations (n,), with Baumgarte's terms where asked for.

        Raises:
            LinAlgError: a state that is not finite.
        """
        if not (np.isfinite(q).all() and np.isfinite(v).all()):
            raise np.linalg.LinAlgError("a state that is not finite")
        terms = self.evaluator.terms(t, q, v)
        gamma = terms.gamma
        if damped and self.baumgarte:
            gamma = gamma - 2 * self.baumgarte[0] * terms.phi_dot - self.baumgarte[1] ** 2 * terms.phi
        return _constrain(terms, self.evaluator.mass, gamma, _by_singular_values, 1)

    def multipliers(self, t: float, q: Array, v: Array) -> Array:
        """The shortest multipliers (m,) of M a + J^T lambda = Q."""
        terms = self.evaluator.terms(t, q, v)
        return _by_singular_values(terms.J.T, terms.Q - self.evaluator.mass * self.acceleration(t, q, v))

    def step(self, integrator: str, t: float, q: Array, v: Array, h: float) -> tuple[Array, Array]:
        """One step, projected onto the constraints; no force jumps within it, but one may at its end."""

        def acceleration(t: float, q: Array, v: Array) -> Array:
            return self.acceleration(t, q, v, damped=True)

        last = (t + h) * (1 - ROUNDING) if self.mechanism.varying else np.inf
        return self.project(t + h, *STEPS[integrator](held_back(acceleration, last), t, q, v, h))

    def project(self, t: float, q: Array, v: Array) -> tuple[Array, Array]:
        """The nearest consistent state."""
        return self.evaluator.project(t, q, v)


def acceleration_error(evaluator: Evaluator, t: float, q: Array, v: Array, a: Array) -> float:
    """Error of an acceleration relative to the larger of its true size and that of the free motion: near rest only that is left."""
    terms = evaluator.terms(t, q, v)
    truth, free = _constrain(terms, evaluator.mass, terms.gamma, shortest, 2), terms.Q / evaluator.mass
    size = max(float(np.abs(truth).max(initial=0.0)), float(np.abs(free).max(initial=0.0)))
    error = float(np.abs(a - truth).max(initial=0.0))
    return error / size if size > 0 else error


def _check_at(mechanism: Mechanism) -> States:
    """States on the constraints, other than those at which pivots are chosen."""
    return manifold_states(mechanism, CHECKS if mechanism.n <= DENSE else FEW, seed=1)


def error_on_constraints(mechanism: Mechanism, accelerate: Accelerate) -> tuple[float, int]:
    """The largest relative error of accelerations over the motion, not a number where one is not; and how many states served."""
    evaluator, states = Evaluator(mechanism), _check_at(mechanism)
    a, sound = accelerate(states.t[:, None], states.q, states.v)
    errors = [acceleration_error(evaluator, float(states.t[k]), states.q[k], states.v[k], a[k]) for k in np.flatnonzero(sound)]
    return float(np.max(errors, initial=0.0)), len(errors)


def error_off_constraints(mechanism: Mechanism, evaluate: Callable[[float, Array, Array], Array]) -> float:
    """Error of residuals, their rates and energy, one after the other, relative to their own size or 1 (m, rad, their rates, J)."""
    evaluator, states = Evaluator(mechanism), _check_at(mechanism)
    t, v = float(states.t[-1]), states.v[-1]
    q = states.q[-1] + OFF * scales(mechanism) * np.random.default_rng(0).normal(size=mechanism.n)
    terms = evaluator.terms(t, q, v)
    wanted = np.concatenate([terms.phi[: evaluator.constraints.holonomic], terms.phi_dot, [evaluator.energy(q, v)]])
    return float(np.abs((evaluate(t, q, v) - wanted) / np.maximum(np.abs(wanted), 1.0)).max())
