"""Sparse LU of a matrix of expressions, with pivots fixed at generation, and solutions.

Pivots are chosen by Markowitz's count, the fill an entry can cause at most, among entries that are not small in their row at any
sample and, where there are such, have one sign at all of them, because a pivot that changes sign is zero on the way. The code has
no branches, and a guard on the pivots tells where it must not be used. A constant +-1 costs no division.

Where a pivot p varies, either the entries of its column are multiplied by 1/p, or those of its row, whichever are fewer. A short
row may instead be multiplied by p before p's row is taken off it, as in a determinant: the next pivot then need not wait for a
division. Entries are sums whose summands are kept until the entry is needed, so that they can be added in the order in which they
become ready.

Row operations E make A upper triangular, E A = U, so that A x = b is y = E b, U x = y.

Where no entry that is left keeps its sign, as where every one is a sine or a cosine of one angle that turns, the rest S may be
squared: S x = y becomes S^T S x = S^T y, whose diagonal is positive wherever S is regular. Its condition is squared too.

A right-hand side is a dict without zeros; entries that are structurally zero stay absent from the solution too.
Source: Duff, Erisman and Reid, Direct Methods for Sparse Matrices (2nd ed., 2017), chapters 5 and 7.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from heapq import nsmallest
from itertools import combinations_with_replacement
from statistics import median
from typing import NamedTuple

import numpy as np

from gauss_bench.compiler.errors import KernelError
from gauss_bench.compiler.expressions.node import VANISHES, ExpressionGraph, Node, sum_of
from gauss_bench.terms import Array

Right = dict[int, Node]


@dataclass(frozen=True, eq=False)
class Pivot:
    """One step: its row and column, 1/p, whether the row (else the column) was divided, and the smallest |p| to trust."""

    row: int
    column: int
    node: Node
    inverse: Node
    row_divided: bool
    threshold: float


@dataclass(frozen=True, eq=False)
class RowOperation:
    """One row operation: row <- scale row - factor (pivot row), the scale None for 1."""

    pivot_row: int
    factor: Node
    scale: Node | None


@dataclass(frozen=True, eq=False)
class Factors:
    """The row operations that made A upper triangular, the triangle, and the pivots in order of elimination.

    Attributes:
        rest: the remaining submatrix if it was squared, else None.
    """

    graph: ExpressionGraph
    pivots: tuple[Pivot, ...]
    steps: dict[int, list[RowOperation]]
    upper: dict[int, list[tuple[int, Node]]]
    rest: "Squared | None" = None

    @property
    def guarded(self) -> tuple[Pivot, ...]:
        """Return all pivots that the code divides by."""
        return self.pivots if self.rest is None else (*self.pivots, *self.rest.factors.guarded)

    def solve(self, b: Right) -> Right:
        """Solve A x = b: b by row, x by column, zeros left out of both."""
        y: Right = {}
        for p in self.pivots:
            _put(y, p.row, self._reduce(b.get(p.row), self.steps[p.row], y), p.inverse if p.row_divided else None)
        x: Right = {}
        if self.rest is not None:
            for r in self.rest.rows:
                _put(y, r, self._reduce(b.get(r), self.steps[r], y), None)
            x = self.rest.solve(y)
        for p in reversed(self.pivots):
            known = _less(y.get(p.row), ((u, x.get(c)) for c, u in self.upper[p.row]))
            _put(x, p.column, known, None if p.row_divided else p.inverse)
        return x

    def _reduce(self, b: Node | None, steps: list[RowOperation], y: Right) -> Node | None:
        """Apply the row operations to an entry of the right-hand side."""
        products: list[tuple[Node, Node | None]] = []
        for step in steps:
            if step.scale is not None:
                b, products = _less(b, products), []
                b = None if b is None else b * step.scale
            products.append((step.factor, y.get(step.pivot_row)))
        return _less(b, products)


@dataclass(frozen=True, eq=False)
class Squared:
    """The remaining submatrix S (rows, columns), and factors of S^T S."""

    rows: tuple[int, ...]
    columns: tuple[int, ...]
    S: "Matrix"
    factors: Factors

    def solve(self, y: Right) -> Right:
        """Solve S x = y, x by column."""
        parts: dict[int, list[Node]] = {}
        for (r, c), e in self.S.items():
            if r in y:
                parts.setdefault(c, []).append(e * y[r])
        sums = {c: self.factors.graph.total(terms) for c, terms in parts.items()}
        return self.factors.solve({c: node for c, node in sums.items() if not node.zero})


def _less(b: Node | None, products: Iterable[tuple[Node, Node | None]]) -> Node | None:
    """Return b minus the sum of the products, None for zero."""
    terms = [-(f * x) for f, x in products if x is not None]
    if b is not None:
        terms.append(b)
    return terms[0].graph.total(terms) if terms else None


def _put(where: Right, key: int, x: Node | None, factor: Node | None) -> None:
    if x is not None and not x.zero:
        where[key] = x if factor is None else x * factor


RELATIVE = 0.05  # of the largest entry in the row, columns scaled: smaller pivots are not taken
SMALLEST = 1e-9
SHARE = 0.25  # of the samples, at least: there a pivot must be usable
GUARD = 1e-3  # of the largest entry in the pivot's row: below, a pivot costs more than three digits
CROSSED = 3  # entries of a row that are multiplied by a pivot at most; once per row, since sizes multiply too
LOOKED_AT = 8  # rows and columns with the fewest entries among which a pivot is sought

Matrix = dict[tuple[int, int], Node]


@dataclass(frozen=True)
class Search:
    """Settings of the search: the rules that decide among pivots of equal Markowitz count.

    Attributes:
        noise: added to the count at random.
        patience: charged per 100 cycles that a pivot is waited for.
        crossing: share of the steps done without division, where that is possible.
    """

    seed: int = 0
    noise: float = 0.0
    patience: float = 0.0
    crossing: float = 0.0

    @property
    def by_chance(self) -> bool:
        """True if another seed can make another choice."""
        return self.noise > 0.0 or 0.0 < self.crossing < 1.0


class _Entry:
    """An entry under elimination: summands, and the values of their sum at the samples and random points."""

    __slots__ = ("_at", "_open", "generic", "largest", "terms")

    def __init__(self, node: Node):
        self.terms, self.generic = [node], node.generic
        x, y, z = node.generic
        self.largest = abs(x), abs(y), abs(z)
        self._at: Array | None = None
        self._open = [node]  # summands that are not in _at yet

    def add(self, node: Node) -> None:
        self.terms.append(node)
        self._open.append(node)
        self.generic = sum_of(self.generic, node.generic)
        (a, b, c), (x, y, z) = self.largest, node.generic
        self.largest = max(a, abs(x)), max(b, abs(y)), max(c, abs(z))

    @property
    def at(self) -> Array:
        """Values of the sum at the samples, followed by those at the random points."""
        for node in self._open:
            self._at = node.at if self._at is None else self._at + node.at
        self._open = []
        return self._at  # type: ignore[return-value]

    @property
    def vanishes(self) -> bool:
        (x, y, z), (a, b, c) = self.generic, self.largest
        return abs(x) <= VANISHES * a and abs(y) <= VANISHES * b and abs(z) <= VANISHES * c

    def node(self) -> Node:
        if len(self.terms) > 1:
            self.terms = [self.terms[0].graph.total(self.terms)]
        return self.terms[0]

    @property
    def penalty(self) -> float:
        """The addition to an entry's count for a division by it."""
        g = self.generic
        if len(self.terms) > 1 and abs(g[0] - g[1]) > 1e-9 * abs(g[0]):
            return 1.0
        number = self.node().number
        return 1.0 if number is None else 0.0 if abs(number) == 1.0 else 0.5

    @property
    def ready(self) -> float:
        return max(x.ready for x in self.terms)


class _Sizes(NamedTuple):
    """Sizes of a row's entries at the samples.

    Attributes:
        largest: (samples,) the largest entry, columns scaled.
        relative: by column, the smallest size relative to `largest`.
        usable: by column, whether a pivot there is not small at any sample; steady: whether it has one sign besides.
    """

    largest: Array
    relative: dict[int, float]
    usable: dict[int, bool]
    steady: dict[int, bool]


class _Markowitz:
    """One factorisation in progress."""

    def __init__(self, graph: ExpressionGraph, A: Matrix, rows: Iterable[int], columns: Iterable[int], search: Search):
        self.graph, self.search = graph, search
        self.random = np.random.default_rng(search.seed)
        self.trusted = np.ones(graph.samples, bool)
        self.rows: dict[int, dict[int, _Entry]] = {r: {} for r in rows}
        self.columns: dict[int, set[int]] = {c: set() for c in columns}
        for (r, c), node in A.items():
            if r in self.rows and c in self.columns and not node.zero:
                self.rows[r][c] = _Entry(node)
                self.columns[c].add(r)
        self.scale = {c: self._largest_in(c) for c in self.columns}
        self.sizes: dict[int, _Sizes] = {}  # of rows that have been looked at and not changed since
        self.pivots: list[Pivot] = []
        self.steps: dict[int, list[RowOperation]] = {r: [] for r in self.rows}
        self.upper: dict[int, list[tuple[int, Node]]] = {}

    def _values(self, e: _Entry) -> Array:
        return np.abs(e.at[: self.graph.samples])

    def _largest_in(self, c: int) -> float:
        return max((float(self._values(self.rows[r][c]).max()) for r in self.columns[c]), default=1.0) or 1.0

    def factors(self, squares: bool) -> Factors:
        rest = None
        while self.rows and rest is None:
            if squares and self._usable(steadily=True) is None:
                rest = self._square()
            else:
                self._eliminate(*self._choose())
        return Factors(self.graph, tuple(self.pivots), self.steps, self.upper, rest)

    def _square(self) -> Squared:
        S = {(r, c): e.node() for r, row in self.rows.items() for c, e in row.items()}
        rows, columns = tuple(self.rows), tuple(self.columns)
        square: Matrix = {}
        for c, d in combinations_with_replacement(columns, 2):
            products = [S[r, c] * S[r, d] for r in rows if (r, c) in S and (r, d) in S]
            if products and not (entry := self.graph.total(products)).zero:
                square[c, d] = square[d, c] = entry
        return Squared(rows, columns, S, lu(self.graph, square, columns, columns, Search(self.search.seed)))

    def _choose(self) -> tuple[int, int, Array]:
        """Choose a pivot that is usable at all samples, else at as many as possible: its guard excludes the others at run time."""
        chosen = self._usable()
        while chosen is None:
            self._trust_fewer()
            chosen = self._usable()
        return chosen

    def _trust_fewer(self) -> None:
        """Drop the samples at which the most widely usable pivots are too small: other programs will cover them."""
        best = np.zeros_like(self.trusted)
        for row in filter(None, self.rows.values()):
            sizes = np.array([self._values(e) for e in row.values()])
            scaled = sizes / np.array([self.scale[c] for c in row])[:, None]
            usable = (scaled >= RELATIVE * scaled.max(axis=0)) & (sizes >= SMALLEST) & self.trusted
            best = max([best, *usable], key=lambda x: int(x.sum()))
        if best.sum() < SHARE * len(best):
            raise KernelError("no pivot is usable at all samples: the coordinates chosen as dependent are not")
        self.trusted, self.sizes = best, {}

    def _usable(self, steadily: bool = False) -> tuple[int, int, Array] | None:
        """The cheapest usable pivot near the emptiest rows and columns, else anywhere, else one that changes sign if it may."""
        everywhere = len(self.rows)
        places = ((LOOKED_AT, True), (min(everywhere, LOOKED_AT**2), True), (LOOKED_AT, False), (everywhere, False))
        for reach, steady in places[: 2 if steadily else None]:
            near = [(r, c) for r in nsmallest(reach, self.rows, lambda r: len(self.rows[r])) for c in self.rows[r]]
            emptiest = nsmallest(reach, self.columns, lambda c: len(self.columns[c]))
            near += [(r, c) for c in emptiest for r in sorted(self.columns[c])]
            best: tuple[float, float, int, int] | None = None
            for r, c in dict.fromkeys(near):
                count = (len(self.rows[r]) - 1) * (len(self.columns[c]) - 1)
                if best is not None and count > best[0] + self.search.noise:
                    continue
                sizes = self._row_sizes(r)
                if sizes.steady[c] if steady else sizes.usable[c]:
                    offer = self._cost(r, c, count), -sizes.relative[c]
                    if best is None or offer < best[:2]:
                        best = (*offer, r, c)
            if best is not None:
                return best[2], best[3], self._row_sizes(best[2]).largest
        return None

    def _row_sizes(self, r: int) -> _Sizes:
        """Return the sizes of a row's entries. A usable pivot is small at no sample; a steady one also never changes its sign."""
        known = self.sizes.get(r)
        if known is None:
            row = self.rows[r]
            values = np.array([e.at[: self.graph.samples][self.trusted] for e in row.values()])
            sizes = np.abs(values)
            scaled = sizes / np.array([self.scale[c] for c in row])[:, None]
            largest = np.maximum(scaled.max(axis=0), np.finfo(float).tiny)
            relative = (scaled / largest).min(axis=1)
            usable = (relative >= RELATIVE) & (sizes.min(axis=1) >= SMALLEST)
            steady = usable & ~((values.min(axis=1) < 0.0) & (values.max(axis=1) > 0.0))
            by_column = (dict(zip(row, x.tolist(), strict=True)) for x in (relative, usable, steady))
            known = self.sizes[r] = _Sizes(largest, *by_column)
        return known

    def _cost(self, r: int, c: int, count: int) -> float:
        entry = self.rows[r][c]
        cost = count + entry.penalty
        if self.search.patience:
            cost += self.search.patience * entry.ready / 100.0
        if self.search.noise:
            cost += self.search.noise * self.random.random()
        return cost

    def _eliminate(self, r: int, c: int, largest: Array) -> None:
        row = {k: e.node() for k, e in self.rows.pop(r).items()}
        pivot = row.pop(c)
        others = sorted(self.columns.pop(c) - {r})
        inverse = self.graph.inverse(pivot)
        crossed = self._is_crossed(pivot, others)
        row_divided = pivot.number is None and not crossed and len(row) < len(others)
        if row_divided:
            row = {k: u * inverse for k, u in row.items()}
        for k in row:
            self.columns[k].discard(r)
        for other in others:
            entry = self.rows[other].pop(c).node()
            self.sizes.pop(other, None)
            if crossed:
                self.rows[other] = {k: _Entry(e.node() * pivot) for k, e in self.rows[other].items()}
            f = entry if row_divided or crossed else entry * inverse
            self.steps[other].append(RowOperation(r, f, pivot if crossed else None))
            self._subtract(other, f, row)
            self.rows[other] = self.rows.pop(other)  # what was changed last is looked at last: along a chain, ends meet late
        for k in row:
            self.columns[k] = self.columns.pop(k)
        threshold = GUARD * self.scale[c] * median(largest.tolist())
        self.pivots.append(Pivot(r, c, pivot, inverse, row_divided, threshold))
        self.upper[r] = list(row.items())

    def _is_crossed(self, pivot: Node, others: list[int]) -> bool:
        """Tell whether this step is done without division, by multiplying the other rows by the pivot."""
        if not self.search.crossing or pivot.number is not None or not others:
            return False
        few = all(len(self.rows[x]) - 1 <= CROSSED and not any(s.scale for s in self.steps[x]) for x in others)
        return few and self.random.random() < self.search.crossing

    def _subtract(self, other: int, f: Node, row: dict[int, Node]) -> None:
        target = self.rows[other]
        for k, u in row.items():
            product = -(f * u)
            if k in target:
                target[k].add(product)
                if target[k].vanishes:
                    del target[k]
                    self.columns[k].discard(other)
            else:
                target[k] = _Entry(product)
                self.columns[k].add(other)


def lu(
    graph: ExpressionGraph, A: Matrix, rows: Iterable[int], columns: Iterable[int], search: Search, squares: bool = False
) -> Factors:
    """Factorise A(rows, columns). If no pivot keeps its sign, the rest is squared, or a pivot that changes sign is taken.

    Raises:
        KernelError: no pivot is left that is usable at a fair share of the samples.
    """
    return _Markowitz(graph, A, rows, columns, search).factors(squares)
