"""Gaussian elimination with an order of pivots fixed beforehand, on sparse rows of numbers, arrays or symbols.

The order is chosen at one state, and used for all states near it. Among the entries that are not small in their row, the pivot is
the one with the least fill-in (Markowitz). In a system A x = b of full row rank with more unknowns than rows, the unknowns u
without a pivot are free, and the general solution is x = x0 + N u:

    x0:   the solution in which all free unknowns are zero
    N:    each column solves A N = 0 with one free unknown equal to one and all other free unknowns zero

Source: Duff, Erisman and Reid, Direct Methods for Sparse Matrices (2nd ed. 2017), sections 5.4 and 7.2.
"""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gauss_bench.reference.taylor.arithmetic import Value, vanishes
from gauss_bench.terms import Array

Entries = Mapping[int, Value]  # column -> value
Order = tuple[tuple[int, int], ...]  # (row, column) of every pivot
SMALL = 0.3  # least size of a pivot relative to the largest entry of its row
TINY = 0.1  # least size relative to the largest entry of all: of dependent rows, the one with the larger entries gets the pivot


class Pivots(NamedTuple):
    """An order of pivots.

    Attributes:
        order: (row, column) of every pivot.
        smallest: size of the smallest pivot; weakest: the row of this pivot.
        left: size of the largest entry that remains in the rows without a pivot.
    """

    order: Order
    smallest: float
    weakest: int
    left: float


def choose_pivots(A: Array, structure: NDArray[np.bool_], floor: float) -> Pivots:
    """Choose pivots for a matrix A (m, n) by the least fill-in, among entries that are large enough for an accurate elimination.

    Args:
        structure: (m, n) false for entries that are zero at every state.
        floor: rows whose remaining entries are at most this size get no pivot.
    """
    A, structure = A.astype(float).copy(), structure.copy()
    rows, columns = list(range(A.shape[0])), list(range(A.shape[1]))
    order: list[tuple[int, int]] = []
    smallest, weakest = np.inf, 0
    while rows:
        sizes = np.abs(A[np.ix_(rows, columns)])  # of the entries that remain
        largest = sizes.max(axis=1, initial=0.0)
        pattern = structure[np.ix_(rows, columns)]
        # Markowitz's bound for the number of new entries if an entry becomes the pivot
        fill = (pattern.sum(axis=1) - 1)[:, None] * (pattern.sum(axis=0) - 1)[None, :]
        usable = (sizes >= SMALL * largest[:, None]) & (sizes >= TINY * largest.max()) & (sizes > floor)
        if not usable.any():
            return Pivots(tuple(order), float(smallest), weakest, float(largest.max()))
        # `fill` is an integer, so that a summand below 0.5 only decides between equal fill-in, in favour of the larger entry
        cost = np.where(usable, fill + 0.5 / (1.0 + sizes), np.inf)
        i, j = np.unravel_index(int(cost.argmin()), cost.shape)
        r, c = rows.pop(int(i)), columns.pop(int(j))
        order.append((r, c))
        smallest, weakest = min((smallest, weakest), (float(abs(A[r, c])), r))  # pairs (size, row): the smaller size wins
        for other in rows:
            if structure[other, c]:
                A[other] -= A[other, c] / A[r, c] * A[r]
                structure[other] |= structure[r]
    return Pivots(tuple(order), float(smallest), weakest, 0.0)


class Factors(NamedTuple):
    """The triangular factors of a matrix.

    Attributes:
        order: (row, column) of every pivot, in the order of elimination.
        rows: for every pivot, column -> entry of its row after the elimination, without the pivot itself.
        pivots: the values of the pivots.
        steps: row operations (target, source, factor): the source row times the factor was subtracted from the target row, with
            rows numbered in the order of their pivots.
    """

    order: Order
    rows: list[dict[int, Value]]
    pivots: list[Value]
    steps: list[tuple[int, int, Value]]


def factorise(entries: Sequence[Entries], order: Order) -> Factors:
    """Factorise the rows that have a pivot, by forward elimination in the order of the pivots."""
    rows = [dict(entries[r]) for r, _ in order]
    pivots: list[Value] = []
    steps: list[tuple[int, int, Value]] = []
    for k, (_, c) in enumerate(order):
        pivots.append(rows[k].pop(c))
        for i in range(k + 1, len(rows)):
            if c in rows[i]:
                factor = rows[i].pop(c) / pivots[k]
                steps.append((i, k, factor))
                for j, value in rows[k].items():
                    rows[i][j] = rows[i].get(j, 0) - factor * value
    return Factors(order, rows, pivots, steps)


def particular(factors: Factors, b: Sequence[Value]) -> dict[int, Value]:
    """Return the solution x0, column -> value, for a right-hand side b (m,); the free unknowns, which are 0, are left out."""
    y = [b[r] for r, _ in factors.order]
    for i, k, factor in factors.steps:  # forward elimination
        y[i] = y[i] - factor * y[k]
    x: dict[int, Value] = {}
    for k in reversed(range(len(y))):  # back substitution
        value = y[k]
        for j, a in factors.rows[k].items():
            value = value - a * x.get(j, 0)
        x[factors.order[k][1]] = value / factors.pivots[k]
    return x


def null_space(factors: Factors, n: int) -> dict[int, dict[int, Value]]:
    """Return the basis N of the null space for n unknowns: free unknown -> its column, as unknown -> value."""
    bound = {c for _, c in factors.order}
    N: dict[int, dict[int, Value]] = {j: {j: 1} for j in range(n) if j not in bound}
    for k in reversed(range(len(factors.order))):  # back substitution; the right-hand side is zero
        for column in N.values():
            value: Value = 0
            for j, a in factors.rows[k].items():
                value = value + a * column.get(j, 0)
            if not vanishes(value):
                column[factors.order[k][1]] = -(value / factors.pivots[k])
    return N
