"""Entries that are independent in every one of several bases, and how well.

Both questions of a linkage are of this kind: which rows may be dropped (bases of the left null space of J) and which coordinates
may be left independent (bases of the null space). As many entries are wanted as a basis has columns, such that those rows of the
basis are independent at all samples. They are picked one after another, each time the entry that is largest where it is smallest,
and what is picked is projected out: a column-pivoted QR of the transposed bases, all at once.
"""

from collections.abc import Iterable

import numpy as np

from gauss_bench.compiler.equations.sampling import RANK_TOLERANCE
from gauss_bench.terms import Array


def spread(bases: Array, count: int, allowed: Iterable[int], first: int | None = None) -> tuple[int, ...] | None:
    """`count` rows that are independent in every one of the bases (k, n, c), or None; `first` is the one to begin with."""
    if count == 0:
        return ()
    left, open_rows = bases.copy(), sorted(allowed)
    picked: list[int] = []
    largest = np.maximum(np.linalg.norm(bases, axis=2).max(axis=1, keepdims=True), np.finfo(float).tiny)
    for _ in range(count):
        sizes = np.linalg.norm(left, axis=2)
        worst = (sizes / largest).min(axis=0)
        worst[picked] = -1.0
        best = first if first is not None and not picked else max(open_rows, key=lambda k: float(worst[k]), default=None)
        if best is None or worst[best] < RANK_TOLERANCE:
            return None
        picked.append(best)
        direction = left[:, best, :] / sizes[:, best, None]
        left = left - (left @ direction[:, :, None]) * direction[:, None, :]
    return tuple(sorted(picked))


def smallest(bases: Array, rows: tuple[int, ...]) -> Array:
    """(k,) smallest singular value of some rows of each basis, relative to its largest row: 0 where they are dependent."""
    if not rows:
        return np.ones(len(bases))
    values = np.linalg.svd(bases[:, list(rows), :], compute_uv=False)[:, -1]
    return np.asarray(values / np.linalg.norm(bases, axis=2).max(axis=1))
