"""Close a linkage by Gauss-Newton iteration: find a nearby position that satisfies its constraints.

Each correction is the shortest dq with J dq = -F; a caller may solve for dq in its own way, with its own rank tolerance and units.
"""

from collections.abc import Callable

import numpy as np

from gauss_bench.terms import Array

Residual = Callable[[Array], tuple[Array, Array]]  # q -> F, J

RANK_TOLERANCE = 1e-9  # singular values below this share of the largest are zero: far above rounding, far below usable linkages
TINY = 1e-300  # keeps the division by the size of a zero correction finite


def minimum_norm(J: Array, F: Array, tolerance: float = RANK_TOLERANCE) -> Array:
    """Return the shortest x (n,) that minimises |J x - F|; singular values below `tolerance` times the largest count as zero."""
    return np.asarray(np.linalg.lstsq(J, F, rcond=tolerance)[0])


def never(*_: Array) -> bool:
    """Return False: the default test of `project`, which never stops the iteration."""
    return False


def project(
    q: Array,
    residual: Residual,
    shortest: Callable[[Array, Array], Array],
    corrections: int,
    stop_before: Callable[[Array, Array, Array], bool] = never,
    stop_after: Callable[[Array, Array], bool] = never,
    longest: float = np.inf,
) -> Array:
    """Return the position (n,), or positions (k, n), after at most `corrections` Gauss-Newton corrections of q.

    Args:
        residual: function of q that returns F (..., m) and J (..., m, n).
        shortest: function of J and F that returns the shortest vector x (..., n) with J x = F.
        stop_before: function of q, F and J, called before each correction; the iteration stops if it returns True.
        stop_after: function of the corrected q and the largest entry (...) of the correction; it also stops the iteration.
        longest: largest allowed entry of a correction; a longer correction is scaled down.
    """
    for count in range(corrections + 1):
        F, J = residual(q)  # also after the last correction: `Evaluator.project` uses the rows that its residual then has
        if count == corrections or stop_before(q, F, J):
            break
        step = shortest(J, F)
        size = np.abs(step).max(axis=-1, initial=0.0)
        q = q - (step if longest == np.inf else step * np.minimum(1.0, longest / np.maximum(size, TINY))[..., None])
        if stop_after(q, size):
            break
    return q


def walk(advance: Callable[[float], None], shortest: float, longest: float = 1.0) -> None:
    """Call `advance(share)` with increasing shares of a path, the last of which is 1.

    The step from one share to the next is halved after a failure and doubled after a success; it is at most `longest`.

    Raises:
        ArithmeticError: from `advance`, if even a step of `shortest` fails.
    """
    reached, step = 0.0, longest
    while reached < 1.0:
        # a remainder below `shortest` joins the last step, so that no step is shorter
        share = reached + step if reached + step < 1.0 - shortest else 1.0
        try:
            advance(share)
        except ArithmeticError:
            if step <= shortest:
                raise
            step /= 2
        else:
            reached, step = share, min(2 * step, longest)
