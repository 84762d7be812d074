"""Accelerations by a rank decision at each state. Programs are checked against them, and they serve where no program is usable.

    a = M^-1 Q + M^-1/2 (J M^-1/2)^+ (gamma - J M^-1 Q)

is the free acceleration with the shortest correction, in the mass metric, that meets the constraints. Singular values give the
pseudo-inverse. At a change point J loses rank and the free velocities gain a direction; the motion goes on along its velocity.
Terms are evaluated and solved in other ways than in the programs.
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

CHECKS, FEW = 9, 2  # numbers of states at which the program of a usual and of a large linkage is checked
OFF = 0.1  # [rad, lengths] distance from the constraints at which residuals and energy are checked
CHECKED = 1e-9  # largest relative error of a program: sound ones reach 1e-12, and a wrong sign or a lost term gives far more

Accelerate = Callable[[Array, Array, Array], tuple[Array, NDArray[np.bool_]]]  # t (k, 1), q, v (k, n) -> a (k, n), usable (k,)


def _by_singular_values(J: Array, r: Array) -> Array:
    """Return the minimum-norm x of J x = r; smaller singular values than RANK_TOLERANCE count as zero."""
    return np.asarray(np.linalg.lstsq(J, r, rcond=RANK_TOLERANCE)[0])


def _constrain(terms: Terms, mass: Array, gamma: Array, solve: Callable[[Array, Array], Array], passes: int) -> Array:
    """Return the acceleration (n,) by the formula above; `solve` is the pseudo-inverse, and more passes reduce rounding errors."""
    root = np.sqrt(mass)
    K, weighted = terms.J / root, terms.Q / root
    for _ in range(passes):
        weighted = weighted + solve(K, gamma - K @ weighted)
    return np.asarray(weighted / root)


class RankDecision:
    """Accelerations, multipliers and steps of a mechanism at single states, whatever the rank of its rows is there."""

    def __init__(self, mechanism: Mechanism, baumgarte: tuple[float, float] | None = None):
        self.mechanism, self.baumgarte = mechanism, baumgarte

    @cached_property
    def evaluator(self) -> Evaluator:
        return Evaluator(self.mechanism)

    def acceleration(self, t: float, q: Array, v: Array, damped: bool = False) -> Array:
        """Return accelerations (n,), with Baumgarte's terms if they are `damped`.

        Raises:
            LinAlgError: the state is not finite.
        """
        if not (np.isfinite(q).all() and np.isfinite(v).all()):
            raise np.linalg.LinAlgError("a state that is not finite")
        terms = self.evaluator.terms(t, q, v)
        gamma = terms.gamma
        if damped and self.baumgarte:
            gamma = gamma - 2 * self.baumgarte[0] * terms.phi_dot - self.baumgarte[1] ** 2 * terms.phi
        return _constrain(terms, self.evaluator.mass, gamma, _by_singular_values, 1)

    def multipliers(self, t: float, q: Array, v: Array) -> Array:
        """Return the shortest multipliers (m,) of M a + J^T lambda = Q."""
        terms = self.evaluator.terms(t, q, v)
        return _by_singular_values(terms.J.T, terms.Q - self.evaluator.mass * self.acceleration(t, q, v))

    def step(self, integrator: str, t: float, q: Array, v: Array, h: float) -> tuple[Array, Array]:
        """Return q, v (n,) after one step, projected onto the constraints; a force may jump at its end, but not within it."""

        def acceleration(t: float, q: Array, v: Array) -> Array:
            return self.acceleration(t, q, v, damped=True)

        last = (t + h) * (1 - ROUNDING) if self.mechanism.varying else np.inf
        return self.project(t + h, *STEPS[integrator](held_back(acceleration, last), t, q, v, h))

    def project(self, t: float, q: Array, v: Array) -> tuple[Array, Array]:
        """Return the nearest q, v (n,) that satisfy the constraints."""
        return self.evaluator.project(t, q, v)


def acceleration_error(evaluator: Evaluator, t: float, q: Array, v: Array, a: Array) -> float:
    """Return the error of an acceleration a (n,), relative to the larger of the true and the free acceleration.

    Near rest the true acceleration may vanish.
    """
    terms = evaluator.terms(t, q, v)
    truth = _constrain(terms, evaluator.mass, terms.gamma, shortest, passes=2)
    free = terms.Q / evaluator.mass
    size = max(float(np.abs(truth).max(initial=0.0)), float(np.abs(free).max(initial=0.0)))
    error = float(np.abs(a - truth).max(initial=0.0))
    return error / size if size > 0 else error


def _check_at(mechanism: Mechanism) -> States:
    """Return states on the constraints, other than those at which pivots are chosen."""
    return manifold_states(mechanism, CHECKS if mechanism.n <= DENSE else FEW, seed=1)


def error_on_constraints(mechanism: Mechanism, accelerate: Accelerate) -> tuple[float, int]:
    """Return the largest relative error of accelerations over the motion, NaN if one is NaN, and the number of usable states."""
    evaluator, states = Evaluator(mechanism), _check_at(mechanism)
    a, sound = accelerate(states.t[:, None], states.q, states.v)
    errors = [acceleration_error(evaluator, float(states.t[k]), states.q[k], states.v[k], a[k]) for k in np.flatnonzero(sound)]
    return float(np.max(errors, initial=0.0)), len(errors)


def error_off_constraints(mechanism: Mechanism, evaluate: Callable[[float, Array, Array], Array]) -> float:
    """Return the largest error of residuals, their rates and the energy, as `evaluate` returns them one after the other.

    Each error is relative to the larger of the quantity's magnitude and 1 in SI units.
    """
    evaluator, states = Evaluator(mechanism), _check_at(mechanism)
    t, v = float(states.t[-1]), states.v[-1]
    q = states.q[-1] + OFF * scales(mechanism) * np.random.default_rng(0).normal(size=mechanism.n)
    terms = evaluator.terms(t, q, v)
    wanted = np.concatenate([terms.phi[: evaluator.constraints.holonomic], terms.phi_dot, [evaluator.energy(q, v)]])
    return float(np.abs((evaluate(t, q, v) - wanted) / np.maximum(np.abs(wanted), 1.0)).max())
