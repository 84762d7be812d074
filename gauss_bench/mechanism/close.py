"""Assembly of a linkage: the nearest position that meets its constraints, by Gauss-Newton iteration.

Each correction is the shortest dq with J dq = -F. The caller chooses the solver for it (rank tolerance, units), the residual that
counts as closed, the correction that counts as converged, and the longest correction allowed.
"""

from collections.abc import Callable

import numpy as np

from gauss_bench.terms import Array

Residual = Callable[[Array], tuple[Array, Array]]  # q -> F, J

TINY = 1e-300  # keeps the division by the size of a zero correction finite


def never(*_: Array) -> bool:
    return False


def project(
    q: Array,
    residual: Residual,
    shortest: Callable[[Array, Array], Array],
    corrections: int,
    closed: Callable[[Array, Array, Array], bool] = never,
    still: Callable[[Array, Array], bool] = never,
    longest: float = np.inf,
) -> Array:
    """Return the position (n,), or positions (k, n), after at most `corrections` Gauss-Newton corrections.

    Args:
        q: first guess.
        residual: q -> F (..., m) and J (..., m, n).
        shortest: J, F -> the shortest x (..., n) of J x = F.
        corrections: largest number of corrections.
        closed: (q, F, J) before a correction -> True if the residual is small enough to stop.
        still: (q, size) after a correction, size (...) its largest entry before any shortening -> True to stop.
        longest: a correction with a larger entry is scaled down to this one, its direction kept.
    """
    for count in range(corrections + 1):
        F, J = residual(q)
        if count == corrections or closed(q, F, J):
            break
        step = shortest(J, F)
        size = np.abs(step).max(axis=-1, initial=0.0)
        q = q - (step if longest == np.inf else step * np.minimum(1.0, longest / np.maximum(size, TINY))[..., None])
        if still(q, size):
            break
    return q


def walk(advance: Callable[[float], None], shortest: float, longest: float = 1.0) -> None:
    """Go from 0 to 1 in steps: halve the step after `advance(share)` fails, double it after it succeeds.

    Raises:
        ArithmeticError: `advance` failed for a step as short as `shortest`.
    """
    done, part = 0.0, longest
    while done < 1.0:
        # a remainder below `shortest` joins the last step, so that no step is shorter
        ahead = done + part if done + part < 1.0 - shortest else 1.0
        try:
            advance(ahead)
        except ArithmeticError:
            if part <= shortest:
                raise
            part /= 2
        else:
            done, part = ahead, min(2 * part, longest)
