"""Three methods that find a root of F(x) = 0, with the same arguments and result, so that `basins` can compare them.

They do not use `mechanism/close.py`, because a comparison needs the reason why a search ended and the number of its steps.

Let J be the Jacobian of F at the present point x. Each method goes from x to x + h. The step h follows from

    Newton-Raphson:       J h = -F; the full step is taken
    Gauss-Newton:         J h = -F; the step is halved until |F|^2 falls enough (backtracking, Armijo's condition)
    Levenberg-Marquardt:  (J^T J + mu I) h = -J^T F; mu falls if the linear model predicts |F| well, else it grows (Nielsen's rule)

More equations than unknowns must be consistent; J h = -F is then solved in the least-squares sense.

Sources: Nocedal and Wright, Numerical Optimization (2006), sections 3.1, 10.3 and 11.1; Madsen, Nielsen, Tingleff, Methods for
Non-Linear Least Squares Problems (2004), algorithm 3.16.
"""

from collections.abc import Callable
from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from gauss_bench.mechanism.close import RANK_TOLERANCE, Residual
from gauss_bench.terms import Array, largest

TOLERANCE = 1e-13  # largest |F| at a root, in the unit of F
LIMIT = 100  # largest number of iterations
SUFFICIENT = 1e-4  # smallest decrease by a step, as a share of the predicted decrease: the usual constant of Armijo's condition
LENGTHS = 30  # number of lengths of a step that are tried, each half of the one before: the last is 2e-9 of the first
DAMPING = 1e-3  # first mu as a share of the largest diagonal entry of J^T J, for a fair first guess
FLAT = 1e-8  # largest |J^T F| / (|J| |F|) at a minimum that is no root; near a double root F is 1e-16 before the ratio is as small


class ExitFlag(StrEnum):
    """The reason why a search ended."""

    CONVERGED = "converged"
    STALLED = "stalled"  # no step reduces |F| (at a minimum that is no root), or F is not finite
    SINGULAR = "singular"  # J has lost rank, so that it does not determine the step
    TOO_MANY = "too many iterations"


@dataclass(frozen=True, eq=False)
class Root:
    """The end of a search: the last iterate x (n,), the reason why it ended, the number of tried steps, and max |F| at x."""

    x: Array
    flag: ExitFlag
    iterations: int
    residual: float


RootFinder = Callable[..., Root]


def at_rest(x: Array, h: Array) -> bool:
    """Tell whether a step h (n,) is smaller than the rounding of x (n,)."""
    eps = np.finfo(float).eps
    return bool(largest(h) <= eps * (largest(x) + eps))


def end_search(x: Array, F: Array, tolerance: float, iteration: int) -> Root | None:
    """Return the result of the search if x (n,) is a root, or F is not finite there; return None if the search goes on."""
    if largest(F) <= tolerance:
        return Root(x, ExitFlag.CONVERGED, iteration, largest(F))
    return None if np.isfinite(F).all() else Root(x, ExitFlag.STALLED, iteration, largest(F))


def full_step(F: Array, J: Array) -> Array | None:
    """Return the least-squares solution h (n,) of J h = -F; None if the columns of J are dependent."""
    if not J.size:
        return None if J.shape[1] else np.zeros(0)
    h, _, rank, _ = np.linalg.lstsq(J, -F, rcond=RANK_TOLERANCE)
    return None if rank < J.shape[1] else h


def newton_raphson(residual: Residual, x: Array, tolerance: float = TOLERANCE) -> Root:
    """Search for a root from x (n,) by at most LIMIT full steps of Newton's method, until max |F| <= `tolerance`."""
    return search_along(residual, x, tolerance, lengths=0)  # 0: no shorter step is tried


def gauss_newton(residual: Residual, x: Array, tolerance: float = TOLERANCE) -> Root:
    """Search as `newton_raphson` does, but halve each step until |F|^2 falls by a share of the predicted decrease."""
    return search_along(residual, x, tolerance, LENGTHS)


def search_along(residual: Residual, x: Array, tolerance: float, lengths: int) -> Root:
    """Search for a root from x (n,) by the first of `lengths` steps h, h/2, h/4, ... that reduces |F|^2 enough, with J h = -F.

    With lengths = 0 every step h is taken in full, even if |F| grows.
    """
    F, J = residual(x)
    for iteration in range(LIMIT):
        end = end_search(x, F, tolerance, iteration)
        if end:
            return end
        h = full_step(F, J)
        if h is None:
            return Root(x, ExitFlag.SINGULAR, iteration, largest(F))
        # Armijo's condition: to first order a step of share * h reduces |F|^2 by 2 share |J h|^2; it must reduce it by at least
        # SUFFICIENT times this
        size, required = float(F @ F), 2.0 * SUFFICIENT * float((J @ h) @ (J @ h))
        for share in 0.5 ** np.arange(max(1, lengths)):
            G, K = residual(x + share * h)  # F and J after the step
            if not lengths or size - share * required >= G @ G:
                break
        else:
            return Root(x, ExitFlag.STALLED, iteration, largest(F))
        if at_rest(x, share * h):  # the step changes x only within rounding
            return Root(x, ExitFlag.STALLED, iteration, largest(F))
        x, F, J = x + share * h, G, K
    # x may be a root by now
    return end_search(x, F, tolerance, LIMIT) or Root(x, ExitFlag.TOO_MANY, LIMIT, largest(F))


def levenberg_marquardt(residual: Residual, x: Array, tolerance: float = TOLERANCE) -> Root:
    """Search as `newton_raphson` does, but with damped steps, which are determined even if J loses rank."""
    F, J = residual(x)
    mu, growth = DAMPING * float((J * J).sum(axis=0).max(initial=0.0)), 2.0
    for iteration in range(LIMIT):
        end = end_search(x, F, tolerance, iteration)
        if end:
            return end
        gradient = J.T @ F
        if largest(gradient) <= FLAT * float(np.linalg.norm(J)) * float(np.linalg.norm(F)):
            return Root(x, ExitFlag.STALLED, iteration, largest(F))
        # least squares of J stacked on sqrt(mu) I has the same solution as (J^T J + mu I) h = -J^T F, at a lower condition number
        damped = np.vstack([J, np.sqrt(mu) * np.eye(len(x))])
        h = np.linalg.lstsq(damped, -np.concatenate([F, np.zeros(len(x))]), rcond=None)[0]
        if at_rest(x, h):
            return Root(x, ExitFlag.STALLED, iteration, largest(F))
        G, K = residual(x + h)
        gain = float(F @ F - G @ G) / float(h @ (mu * h - gradient))  # decrease of |F|^2, over that of the linear model
        if gain > 0:
            x, F, J = x + h, G, K
            mu, growth = mu * max(1 / 3, 1 - (2 * gain - 1) ** 3), 2.0
        else:
            mu, growth = mu * growth, 2 * growth
    return end_search(x, F, tolerance, LIMIT) or Root(x, ExitFlag.TOO_MANY, LIMIT, largest(F))


ROOT_FINDERS: dict[str, RootFinder] = {
    "newton_raphson": newton_raphson,
    "gauss_newton": gauss_newton,
    "levenberg_marquardt": levenberg_marquardt,
}
