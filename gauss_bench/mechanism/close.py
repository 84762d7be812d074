"""Closing a linkage: the nearest position on its rows, by Gauss and Newton's shortest corrections.

Each correction is the shortest dq of J dq = -F. Who asks says how the shortest is found (its rank tolerance, its units), which
residual counts as closed, which correction as none, and how long one may be.
"""

from collections.abc import Callable

import numpy as np

from gauss_bench.terms import Array

Residual = Callable[[Array], tuple[Array, Array]]  # q -> F, J

TINY = 1e-300  # a correction of nothing is divided by it


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
    """Return the position (n,), or positions (k, n), that at most so many corrections lead to.

    Args:
        q: where to begin.
        residual: q -> F (..., m) and J (..., m, n).
        shortest: J, F -> the shortest x (..., n) of J x = F.
        corrections: the most of them.
        closed: (q, F, J) before a correction -> whether to end there.
        still: (q, size) after a correction, with the largest entry (...) of what was asked for -> whether to end there.
        longest: no entry of a correction is larger; the whole of it is shortened.
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
    """Go from 0 to 1 in parts: half as long where `advance(share)` cannot go on, twice as long where it can.

    Raises:
        ArithmeticError: that of the last part, as short as `shortest`.
    """
    done, part = 0.0, longest
    while done < 1.0:
        ahead = done + part if done + part < 1.0 - shortest else 1.0
        try:
            advance(ahead)
        except ArithmeticError:
            if part <= shortest:
                raise
            part /= 2
        else:
            done, part = ahead, min(2 * part, longest)
