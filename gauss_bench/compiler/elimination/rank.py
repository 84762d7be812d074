"""Accelerations at single states; a singular value decomposition decides the rank of the constraint Jacobian J.

    a = M^-1 Q + M^-1/2 (J M^-1/2)^+ (gamma - J M^-1 Q)

is the acceleration without constraints plus a correction: of all corrections for which J a = gamma, the smallest in the mass
metric. At a change point J loses rank, and the constraints allow velocities in one more direction; the motion continues with its
present velocity.

Generated programs are checked against these accelerations, which are derived independently of them, and which replace them where no
program can be used.
Source: Udwadia and Kalaba, Analytical Dynamics (1996), section 3.3 and eq. (3.17).
"""

from collections.abc import Callable
from functools import cached_property, partial

import numpy as np
from numpy.typing import NDArray

from gauss_bench.compiler.equations.sampling import DENSE, manifold_states, scales, shortest_solution
from gauss_bench.integrate.fixed_step import ROUNDING, STEPS, held_back
from gauss_bench.mechanism.close import minimum_norm
from gauss_bench.mechanism.evaluate import Evaluator
from gauss_bench.mechanism.model import Mechanism
from gauss_bench.terms import Array, Terms, baumgarte
from gauss_bench.trajectory import States

CHECKS, FEW = 9, 2  # number of states at which a program is checked: for a usual linkage, and for a large one
OFF = 0.1  # [rad, typical lengths] size of the change of coordinates to a state at which residuals and energy are checked
CHECKED = 1e-9  # largest relative error of a program: correct ones have 1e-12, and a wrong sign or a lost term gives far more

Accelerate = Callable[[Array, Array, Array], tuple[Array, NDArray[np.bool_]]]  # t (k, 1), q, v (k, n) -> a (k, n), usable (k,)


def _constrain(terms: Terms, mass: Array, solve: Callable[[Array, Array], Array], passes: int) -> Array:
    """Return the acceleration (n,) M^-1 Q + M^-1/2 (J M^-1/2)^+ (gamma - J M^-1 Q); its second term is a correction.

    Args:
        solve: function (K, r) -> the minimum-norm x of K x = r, the pseudo-inverse.
        passes: number of corrections; a second one, for the remaining residual, reduces rounding errors.
    """
    root = np.sqrt(mass)
    K, weighted = terms.J / root, terms.Q / root  # J M^-1/2, and M^1/2 a, which begins with the acceleration a without constraints
    for _ in range(passes):
        weighted = weighted + solve(K, terms.gamma - K @ weighted)
    return np.asarray(weighted / root)


class RankDecision:
    """Accelerations, multipliers and integration steps of a mechanism, for one state at a time and any rank of J."""

    def __init__(self, mechanism: Mechanism, baumgarte: tuple[float, float] | None = None):
        """Set up a mechanism; `baumgarte` are alpha and beta [1/s] of Baumgarte's terms, None without such terms."""
        self.mechanism, self.baumgarte = mechanism, baumgarte

    @cached_property
    def evaluator(self) -> Evaluator:
        """The evaluation of M, J, Q and gamma in numpy."""
        return Evaluator(self.mechanism)

    def acceleration(self, t: float, q: Array, v: Array, damped: bool = False) -> Array:
        """Return accelerations (n,) at one state.

        Args:
            damped: whether gamma - 2 alpha phi_dot - beta^2 phi replaces gamma, if Baumgarte's alpha and beta are given.

        Raises:
            LinAlgError: the state is not finite.
        """
        if not (np.isfinite(q).all() and np.isfinite(v).all()):
            raise np.linalg.LinAlgError("a state that is not finite")
        terms = self.evaluator.terms(t, q, v)
        if damped and self.baumgarte:
            terms = baumgarte(terms, *self.baumgarte)
        return _constrain(terms, self.evaluator.mass, solve=minimum_norm, passes=1)

    def multipliers(self, t: float, q: Array, v: Array) -> Array:
        """Return the multipliers (m,) of least norm that satisfy M a + J^T lambda = Q."""
        terms = self.evaluator.terms(t, q, v)
        return minimum_norm(terms.J.T, terms.Q - self.evaluator.mass * self.acceleration(t, q, v))

    def step(self, integrator: str, t: float, q: Array, v: Array, h: float) -> tuple[Array, Array]:
        """Return q, v (n,) after one step of size h [s], projected; a force may jump at the end of the step, not within it."""
        # stages at the end of the step are evaluated just before it, so that a force that jumps there still has its old value
        last = (t + h) * (1 - ROUNDING) if self.mechanism.varying else np.inf
        return self.project(t + h, *STEPS[integrator](held_back(partial(self.acceleration, damped=True), last), t, q, v, h))

    def project(self, t: float, q: Array, v: Array) -> tuple[Array, Array]:
        """Return the nearest q, v (n,) that satisfy the constraints."""
        return self.evaluator.project(t, q, v)


def acceleration_error(evaluator: Evaluator, t: float, q: Array, v: Array, a: Array) -> float:
    """Return the largest relative error of an acceleration a (n,).

    The error is divided by the largest component of the true acceleration or of the acceleration without constraints, whichever is
    larger, because the true acceleration may vanish, as at rest in equilibrium.
    """
    terms = evaluator.terms(t, q, v)
    truth = _constrain(terms, evaluator.mass, shortest_solution, passes=2)
    free = terms.Q / evaluator.mass
    size = max(float(np.abs(truth).max(initial=0.0)), float(np.abs(free).max(initial=0.0)))
    error = float(np.abs(a - truth).max(initial=0.0))
    return error / size if size > 0 else error


def _states_to_check(mechanism: Mechanism) -> States:
    """Return states on the constraints at which programs are checked; pivots are chosen at other states."""
    return manifold_states(mechanism, CHECKS if mechanism.n <= DENSE else FEW, seed=1)


def error_on_constraints(mechanism: Mechanism, accelerate: Accelerate) -> tuple[float, int]:
    """Check accelerations at states on the constraints: return the largest relative error, and the number of valid states.

    The error is NaN if it is NaN at one state.
    """
    evaluator, states = Evaluator(mechanism), _states_to_check(mechanism)
    a, sound = accelerate(states.t[:, None], states.q, states.v)
    errors = [acceleration_error(evaluator, float(states.t[k]), states.q[k], states.v[k], a[k]) for k in np.flatnonzero(sound)]
    return float(np.max(errors, initial=0.0)), len(errors)


def error_off_constraints(mechanism: Mechanism, evaluate: Callable[[float, Array, Array], Array]) -> float:
    """Return the largest error of residuals, their rates and the energy at a state that violates the constraints.

    `evaluate` (t, q, v) returns phi of holonomic rows, phi_dot of all rows and the energy as one vector. Each error is relative to
    the larger of the quantity's magnitude and 1 in SI units.
    """
    evaluator, states = Evaluator(mechanism), _states_to_check(mechanism)
    t, v = float(states.t[-1]), states.v[-1]
    q = states.q[-1] + OFF * scales(mechanism) * np.random.default_rng(0).normal(size=mechanism.n)
    terms = evaluator.terms(t, q, v)
    expected = np.concatenate([terms.phi[: evaluator.constraints.holonomic], terms.phi_dot, [evaluator.energy(q, v)]])
    return float(np.abs((evaluate(t, q, v) - expected) / np.maximum(np.abs(expected), 1.0)).max())
