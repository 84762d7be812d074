"""Sparse LU of a matrix of expressions, with pivots fixed at generation, and solutions.

Pivots are chosen by Markowitz's count, which is the largest fill that an entry can cause. The candidates are entries that are not
small in their row at any sample. Those that have one sign at all samples are preferred, because a pivot that changes its sign is
zero on the way. The code has no branches, and a guard on the pivots tells where it must not be used. A constant pivot +-1 needs no
division.

If a pivot p varies, either the entries of its column or those of its row are multiplied by 1/p, whichever are fewer. A short row
may instead be multiplied by p before p's row is subtracted from it, as in a determinant: the next pivot then does not wait for a
division. Entries are sums. Their summands are kept apart until the entry is needed, so that they can be added in the order in which
they become ready.

Row operations E make A upper triangular, E A = U, so that A x = b is solved by y = E b, U x = y.

If no remaining entry keeps its sign, for example because each is a sine or cosine of one angle that turns, the remaining matrix S
may be squared: S x = y becomes S^T S x = S^T y, whose diagonal is positive wherever S is regular. Its condition is squared too.

A right-hand side is a dict without zeros. Entries that are zero for structural reasons are absent from the solution too.
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

Sparse = dict[int, Node]  # index -> entry of a sparse vector


@dataclass(frozen=True, eq=False)
class Pivot:
    """One pivot p.

    Attributes:
        node, inverse: p and 1/p.
        row_divided: whether its row was multiplied by 1/p, and not its column.
        threshold: smallest |p| for which the code may be used.
    """

    row: int
    column: int
    node: Node
    inverse: Node
    row_divided: bool
    threshold: float


@dataclass(frozen=True, eq=False)
class RowOperation:
    """One row operation: row <- scale row - factor (pivot row), with None for the scale 1."""

    pivot_row: int
    factor: Node
    scale: Node | None


@dataclass(frozen=True, eq=False)
class Factors:
    """The factors of a matrix.

    Attributes:
        pivots: in the order of elimination.
        steps: row -> the operations on it, in their order.
        upper: row -> (column, entry) of U besides the pivot.
        rest: the remaining matrix if it was squared, else None.
    """

    graph: ExpressionGraph
    pivots: tuple[Pivot, ...]
    steps: dict[int, list[RowOperation]]
    upper: dict[int, list[tuple[int, Node]]]
    rest: "Squared | None" = None

    @property
    def guarded(self) -> tuple[Pivot, ...]:
        """All pivots by which the code divides."""
        return self.pivots if self.rest is None else (*self.pivots, *self.rest.factors.guarded)

    def solve(self, b: Sparse) -> Sparse:
        """Solve A x = b: b by row, x by column, zeros left out of both."""
        y: Sparse = {}
        for p in self.pivots:
            _put(y, p.row, self._reduce(b.get(p.row), self.steps[p.row], y), p.inverse if p.row_divided else None)
        x: Sparse = {}
        if self.rest is not None:
            for r in self.rest.rows:
                _put(y, r, self._reduce(b.get(r), self.steps[r], y), None)
            x = self.rest.solve(y)
        for p in reversed(self.pivots):
            right = _less(y.get(p.row), ((u, x.get(c)) for c, u in self.upper[p.row]))
            _put(x, p.column, right, None if p.row_divided else p.inverse)
        return x

    def _reduce(self, b: Node | None, steps: list[RowOperation], y: Sparse) -> Node | None:
        """Apply the operations of one row to an entry of the right-hand side; y are the entries of the pivots' rows."""
        products: list[tuple[Node, Node | None]] = []
        for step in steps:
            if step.scale is not None:
                b, products = _less(b, products), []
                b = None if b is None else b * step.scale
            products.append((step.factor, y.get(step.pivot_row)))
        return _less(b, products)


@dataclass(frozen=True, eq=False)
class Squared:
    """The remaining matrix S with its rows and columns, and factors of S^T S."""

    rows: tuple[int, ...]
    columns: tuple[int, ...]
    S: "Matrix"
    factors: Factors

    def solve(self, y: Sparse) -> Sparse:
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


def _put(where: Sparse, key: int, x: Node | None, factor: Node | None) -> None:
    """Enter x times a factor (None for 1) under a key, unless it is zero."""
    if x is not None and not x.zero:
        where[key] = x if factor is None else x * factor


RELATIVE = 0.05  # least size of a pivot relative to the largest entry in its row, with columns scaled
SMALLEST = 1e-9  # least size of a pivot
SHARE = 0.25  # least share of the samples at which a pivot must be usable
GUARD = 1e-3  # threshold relative to the largest entry in the pivot's row: a smaller pivot costs more than three digits
CROSSED = 3  # most entries of a row that is multiplied by a pivot; a row is multiplied once, because its size grows too
LOOKED_AT = 8  # number of rows and of columns, those with the fewest entries, among which a pivot is sought first

Matrix = dict[tuple[int, int], Node]


@dataclass(frozen=True)
class Search:
    """Settings of the search, which decide among pivots of similar Markowitz count.

    Attributes:
        seed: of the random numbers.
        noise: largest random number that is added to the count.
        patience: number added to the count for every 100 cycles until a pivot is ready.
        crossing: share of the steps that are done without a division where that is possible.
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
    """An entry under elimination, as the sum of nodes that are not added yet.

    Attributes:
        terms: the summands.
        generic: values of the sum at the random points.
        largest: largest absolute value of a summand at each random point.
    """

    __slots__ = ("_at", "_missing", "generic", "largest", "terms")

    def __init__(self, node: Node):
        self.terms, self.generic = [node], node.generic
        x, y, z = node.generic
        self.largest = abs(x), abs(y), abs(z)
        self._at: Array | None = None
        self._missing = [node]  # summands that are not in _at yet

    def add(self, node: Node) -> None:
        """Add a summand."""
        self.terms.append(node)
        self._missing.append(node)
        self.generic = sum_of(self.generic, node.generic)
        (a, b, c), (x, y, z) = self.largest, node.generic
        self.largest = max(a, abs(x)), max(b, abs(y)), max(c, abs(z))

    @property
    def at(self) -> Array:
        """Values of the sum at the samples, followed by those at the random points."""
        for node in self._missing:
            self._at = node.at if self._at is None else self._at + node.at
        self._missing = []
        return self._at  # type: ignore[return-value]

    @property
    def vanishes(self) -> bool:
        """True if the summands cancel, up to rounding, at all random points."""
        (x, y, z), (a, b, c) = self.generic, self.largest
        return abs(x) <= VANISHES * a and abs(y) <= VANISHES * b and abs(z) <= VANISHES * c

    def node(self) -> Node:
        """Return the sum as one node."""
        if len(self.terms) > 1:
            self.terms = [self.terms[0].graph.total(self.terms)]
        return self.terms[0]

    @property
    def penalty(self) -> float:
        """The number added to Markowitz's count for a division by the entry: 0 for +-1, 0.5 for another constant, else 1."""
        g = self.generic
        if len(self.terms) > 1 and abs(g[0] - g[1]) > 1e-9 * abs(g[0]):  # it varies: spare the addition
            return 1.0
        number = self.node().number
        if number is None:
            return 1.0
        return 0.0 if abs(number) == 1.0 else 0.5

    @property
    def ready(self) -> float:
        """Time [cycles] at which all summands are ready."""
        return max(x.ready for x in self.terms)


class _Sizes(NamedTuple):
    """Sizes of a row's entries at the samples.

    Attributes:
        largest: (samples,) size of the largest entry, with columns scaled.
        relative: column -> smallest size of its entry relative to `largest`.
        usable: column -> whether its entry is small at no sample.
        steady: column -> whether its entry is usable and also never changes its sign.
    """

    largest: Array
    relative: dict[int, float]
    usable: dict[int, bool]
    steady: dict[int, bool]


class _Markowitz:
    """One factorisation in progress.

    Attributes:
        trusted: (samples,) whether pivots must be usable at a sample.
        rows: row -> its entries by column, for rows without a pivot.
        columns: column -> rows with an entry in it, for columns without a pivot.
        scale: column -> its largest entry at the beginning.
        sizes: row -> sizes of its entries, for rows that have been examined and not changed since.
    """

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
        self.sizes: dict[int, _Sizes] = {}
        self.pivots: list[Pivot] = []
        self.steps: dict[int, list[RowOperation]] = {r: [] for r in self.rows}
        self.upper: dict[int, list[tuple[int, Node]]] = {}

    def _values(self, e: _Entry) -> Array:
        """Return the sizes (samples,) of an entry."""
        return np.abs(e.at[: self.graph.samples])

    def _largest_in(self, c: int) -> float:
        """Return the size of the largest entry of a column at any sample; 1 if it has none."""
        return max((float(self._values(self.rows[r][c]).max()) for r in self.columns[c]), default=1.0) or 1.0

    def factors(self, squares: bool) -> Factors:
        """Eliminate all rows; with `squares` the remaining matrix is squared as soon as no pivot keeps its sign."""
        rest = None
        while self.rows and rest is None:
            if squares and self._usable(steadily=True) is None:
                rest = self._square()
            else:
                self._eliminate(*self._choose())
        return Factors(self.graph, tuple(self.pivots), self.steps, self.upper, rest)

    def _square(self) -> Squared:
        """Square the remaining matrix, and factorise the square."""
        S = {(r, c): e.node() for r, row in self.rows.items() for c, e in row.items()}
        rows, columns = tuple(self.rows), tuple(self.columns)
        square: Matrix = {}
        for c, d in combinations_with_replacement(columns, 2):
            products = [S[r, c] * S[r, d] for r in rows if (r, c) in S and (r, d) in S]
            entry = self.graph.total(products)
            if not entry.zero:
                square[c, d] = square[d, c] = entry
        return Squared(rows, columns, S, lu(self.graph, square, columns, columns, Search(self.search.seed)))

    def _choose(self) -> tuple[int, int, Array]:
        """Return row and column of a pivot, and the largest entry of its row (samples,).

        It is usable at all samples or, if there is none, at as many as possible: its guard excludes the others at run time.
        """
        chosen = self._usable()
        while chosen is None:
            self._trust_fewer()
            chosen = self._usable()
        return chosen

    def _trust_fewer(self) -> None:
        """Trust only the samples at which the most widely usable pivot is not too small: other programs serve at the others."""
        best = np.zeros_like(self.trusted)
        for row in filter(None, self.rows.values()):
            sizes = np.array([self._values(e) for e in row.values()])
            scaled = sizes / np.array([self.scale[c] for c in row])[:, None]
            usable = (scaled >= RELATIVE * scaled.max(axis=0)) & (sizes >= SMALLEST) & self.trusted
            best = max([best, *usable], key=lambda x: int(x.sum()))
        if best.sum() < SHARE * len(best):
            raise KernelError("no pivot is usable at all samples: the dependent coordinates do not follow from the others")
        self.trusted, self.sizes = best, {}

    def _usable(self, steadily: bool = False) -> tuple[int, int, Array] | None:
        """Return the cheapest pivot, or None if none is usable; `steadily` allows only pivots that keep their sign.

        A pivot that keeps its sign is sought among few rows and columns, then among more, and then any pivot in the same way.
        """
        everywhere = len(self.rows)
        rounds = ((LOOKED_AT, True), (min(everywhere, LOOKED_AT**2), True), (LOOKED_AT, False), (everywhere, False))
        for reach, steady in rounds[: 2 if steadily else None]:
            found = self._cheapest(self._near(reach), steady)
            if found is not None:
                return *found, self._row_sizes(found[0]).largest
        return None

    def _near(self, reach: int) -> list[tuple[int, int]]:
        """Return the places (row, column) of entries in the `reach` rows and the `reach` columns with the fewest entries."""
        rows = nsmallest(reach, self.rows, lambda r: len(self.rows[r]))
        columns = nsmallest(reach, self.columns, lambda c: len(self.columns[c]))
        places = [(r, c) for r in rows for c in self.rows[r]]
        places += [(r, c) for c in columns for r in sorted(self.columns[c])]
        return list(dict.fromkeys(places))

    def _cheapest(self, places: list[tuple[int, int]], steady: bool) -> tuple[int, int] | None:
        """Return the place of the cheapest usable pivot, and of pivots that cost the same the largest; None if none is usable."""
        best, place = (np.inf, 0.0), None
        for r, c in places:
            count = (len(self.rows[r]) - 1) * (len(self.columns[c]) - 1)  # Markowitz's
            if count > best[0] + self.search.noise:
                continue
            sizes = self._row_sizes(r)
            allowed = sizes.steady if steady else sizes.usable
            if allowed[c]:
                offer = self._cost(r, c, count), -sizes.relative[c]
                if place is None or offer < best:
                    best, place = offer, (r, c)
        return place

    def _row_sizes(self, r: int) -> _Sizes:
        """Return the sizes of a row's entries at the trusted samples."""
        known = self.sizes.get(r)
        if known is None:
            row = self.rows[r]
            values = np.array([e.at[: self.graph.samples][self.trusted] for e in row.values()])  # (entries, samples)
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
        """Return Markowitz's count of a pivot with the additions of the search's settings."""
        entry = self.rows[r][c]
        cost = count + entry.penalty
        if self.search.patience:
            cost += self.search.patience * entry.ready / 100.0
        if self.search.noise:
            cost += self.search.noise * self.random.random()
        return cost

    def _eliminate(self, r: int, c: int, largest: Array) -> None:
        """Eliminate column c from all other rows with the pivot in row r, whose largest entry is given (samples,)."""
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
            self.rows[other] = self.rows.pop(other)  # a row that was changed is examined last: along a chain both ends meet late
        for k in row:
            self.columns[k] = self.columns.pop(k)
        threshold = GUARD * self.scale[c] * median(largest.tolist())
        self.pivots.append(Pivot(r, c, pivot, inverse, row_divided, threshold))
        self.upper[r] = list(row.items())

    def _is_crossed(self, pivot: Node, others: list[int]) -> bool:
        """Tell whether the step of a pivot is done without a division, by multiplying the other rows by the pivot."""
        if not self.search.crossing or pivot.number is not None or not others:
            return False
        few = all(len(self.rows[x]) - 1 <= CROSSED and not any(s.scale for s in self.steps[x]) for x in others)
        return few and self.random.random() < self.search.crossing

    def _subtract(self, other: int, f: Node, row: dict[int, Node]) -> None:
        """Subtract f times the pivot's row from another row."""
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
    """Factorise the rows and columns of A; with `squares` the remaining matrix is squared if no pivot keeps its sign.

    Raises:
        KernelError: no pivot is usable at the share SHARE of the samples.
    """
    return _Markowitz(graph, A, rows, columns, search).factors(squares)
