"""Sparse LU of a matrix of expressions, with pivots that are fixed when code is generated, and solutions of linear equations.

Pivots are chosen by Markowitz's count, which is the largest fill that an entry can cause, from the entries that are not small in
their row at any sampled state of the linkage. Entries that have one sign at all samples are preferred, because a pivot that changes
its sign is zero somewhere between two samples. The code has no branches; where a pivot is smaller than its threshold, the code must
not be used. A constant pivot +-1 needs no division.

If a pivot p varies, either the entries of its column or those of its row are multiplied by 1/p, whichever are fewer. A row with few
entries may instead be multiplied by the pivot p before the pivot's row is subtracted from it, as in a determinant: the next pivot
then does not wait for a division. The summands of a matrix entry are kept apart until the entry is needed, so that they can be
added in the order in which they become ready.

Row operations E make the matrix A upper triangular, E A = U, so that A x = b is solved by y = E b, U x = y.

If no remaining entry keeps its sign, for example because each is a sine or cosine of one angle that turns, the remaining equations
S x = y may be replaced by their normal equations S^T S x = S^T y. The diagonal of S^T S is positive wherever the matrix S is
regular, but the condition number of S^T S is the square of that of S.

A right-hand side is a dict row -> node, a solution a dict column -> node; entries that are zero are left out.
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

Sparse = dict[int, Node]  # a sparse vector: index -> entry, without zeros


@dataclass(frozen=True, eq=False)
class Pivot:
    """One pivot p.

    Attributes:
        row, column: indices of p in the matrix.
        node, inverse: p and 1/p as expressions.
        row_divided: whether the other entries of the pivot's row were multiplied by 1/p; if not, those of its column were.
        threshold: smallest |p| for which the code is valid.
    """

    row: int
    column: int
    node: Node
    inverse: Node
    row_divided: bool
    threshold: float


@dataclass(frozen=True, eq=False)
class RowOperation:
    """One operation on a row of the matrix: row <- scale (row) - factor (row `pivot_row`); None stands for the scale 1."""

    pivot_row: int
    factor: Node
    scale: Node | None


@dataclass(frozen=True, eq=False)
class Factors:
    """The factors of a matrix.

    Attributes:
        steps: index of a matrix row -> the operations of the elimination on this row, in order.
        upper: row of a pivot -> (column, entry) for the entries of U in this row besides the pivot.
        rest: the normal equations of the rows without a pivot, or None if every row has a pivot.
    """

    graph: ExpressionGraph
    pivots: tuple[Pivot, ...]
    steps: dict[int, list[RowOperation]]
    upper: dict[int, list[tuple[int, Node]]]
    rest: "NormalEquations | None" = None

    @property
    def all_pivots(self) -> tuple[Pivot, ...]:
        """All pivots by which the code divides, also those of the normal equations."""
        return self.pivots if self.rest is None else (*self.pivots, *self.rest.factors.all_pivots)

    def solve(self, b: Sparse) -> Sparse:
        """Solve A x = b; b is a dict row -> node, x a dict column -> node, both without zeros."""
        # forward elimination, y = E b; if the pivot's row was divided by the pivot, its entry of y is divided too, otherwise the
        # division follows in the back substitution
        y: Sparse = {}
        for p in self.pivots:
            _enter(y, p.row, self._reduce(b.get(p.row), self.steps[p.row], y), p.inverse if p.row_divided else None)
        x: Sparse = {}
        if self.rest is not None:  # the rows without a pivot determine the columns without one
            for r in self.rest.rows:
                _enter(y, r, self._reduce(b.get(r), self.steps[r], y), None)
            x = self.rest.solve(y)
        for p in reversed(self.pivots):  # back substitution, U x = y
            right = _subtract_products(y.get(p.row), ((u, x.get(c)) for c, u in self.upper[p.row]))
            _enter(x, p.column, right, None if p.row_divided else p.inverse)
        return x

    def _reduce(self, b: Node | None, steps: list[RowOperation], y: Sparse) -> Node | None:
        """Apply the operations on one row to the row's entry b of the right-hand side; None stands for zero.

        An operation subtracts factor * y[pivot_row] from b or, if it has a scale, from scale * b.

        Args:
            y: the results for the rows of earlier pivots.
        """
        products: list[tuple[Node, Node | None]] = []  # to be subtracted from b in one sum
        for step in steps:
            if step.scale is not None:
                b, products = _subtract_products(b, products), []
                b = None if b is None else b * step.scale
            products.append((step.factor, y.get(step.pivot_row)))
        return _subtract_products(b, products)


@dataclass(frozen=True, eq=False)
class NormalEquations:
    """The normal equations S^T S x = S^T y of a matrix S.

    Attributes:
        rows, columns: indices, in the whole matrix A, of the rows and columns that make up the submatrix S.
        factors: the factorisation of S^T S.
    """

    rows: tuple[int, ...]
    columns: tuple[int, ...]
    S: "Matrix"
    factors: Factors

    def solve(self, y: Sparse) -> Sparse:
        """Solve S x = y as S^T S x = S^T y; y is a dict row -> node, x a dict column -> node."""
        summands: dict[int, list[Node]] = {}  # of S^T y, by column
        for (r, c), e in self.S.items():
            if r in y:
                summands.setdefault(c, []).append(e * y[r])
        sums = {c: self.factors.graph.total(terms) for c, terms in summands.items()}
        return self.factors.solve({c: node for c, node in sums.items() if not node.is_zero})


def _subtract_products(b: Node | None, products: Iterable[tuple[Node, Node | None]]) -> Node | None:
    """Return b minus the sum of the products f x over the pairs (f, x); None stands for zero in b, x and the result."""
    terms = [-(f * x) for f, x in products if x is not None]
    if b is not None:
        terms.append(b)
    return terms[0].graph.total(terms) if terms else None


def _enter(target: Sparse, index: int, x: Node | None, factor: Node | None) -> None:
    """Set an entry of a sparse vector to x times a factor (None: 1), unless x is zero or None."""
    if x is not None and not x.is_zero:
        target[index] = x if factor is None else x * factor


RELATIVE = 0.05  # smallest ratio of a pivot to the largest entry in its row, with columns scaled
SMALLEST = 1e-9  # smallest absolute value of a pivot
SHARE = 0.25  # smallest fraction of the samples at which a pivot must be usable
GUARD = 1e-3  # threshold relative to the largest entry in the pivot's row: a smaller pivot costs more than three digits
CROSSED = 3  # largest number of entries of a row that is multiplied by a pivot; at most once, because the entries grow
LOOKED_AT = 8  # number of rows and of columns, those with the fewest entries, among which a pivot is sought first

Matrix = dict[tuple[int, int], Node]


@dataclass(frozen=True)
class Search:
    """Settings of the search for pivots, which decide among pivots of similar Markowitz count.

    Attributes:
        noise: largest random number that is added to the Markowitz count of a pivot.
        patience: number added to the Markowitz count for every 100 cycles until the value of the pivot is available.
        crossing: probability that the other rows are multiplied by a pivot, where this is possible, instead of dividing by it.
    """

    seed: int = 0
    noise: float = 0.0
    patience: float = 0.0
    crossing: float = 0.0

    @property
    def is_random(self) -> bool:
        """True if the seed makes a difference: with random costs, or a crossing that is neither impossible nor certain."""
        return self.noise > 0.0 or 0.0 < self.crossing < 1.0


class _Entry:
    """A matrix entry during elimination: a sum, kept as a list of nodes that are not added yet.

    Its values at the graph's three random points off the constraints show whether summands cancel for all states.

    Attributes:
        generic: values of the sum at the three random points.
        largest: largest absolute value of a summand at each random point, which bounds the rounding error of the sum.
    """

    __slots__ = ("_not_yet_added", "_values", "generic", "largest", "terms")

    def __init__(self, node: Node):
        """Begin a sum with one summand, a node."""
        self.terms, self.generic = [node], node.generic
        x, y, z = node.generic
        self.largest = abs(x), abs(y), abs(z)
        self._values: Array | None = None
        self._not_yet_added = [node]  # summands that are not in _values yet

    def add(self, node: Node) -> None:
        """Add a summand; its values at the samples are added to those of the sum only when they are needed.

        `generic` and `largest` at the random points are updated at once: they show whether the sum cancels.
        """
        self.terms.append(node)
        self._not_yet_added.append(node)
        self.generic = sum_of(self.generic, node.generic)
        (a, b, c), (x, y, z) = self.largest, node.generic
        self.largest = max(a, abs(x)), max(b, abs(y)), max(c, abs(z))

    @property
    def values(self) -> Array:
        """Values of the sum at the samples, followed by those at the random points; new summands are added first."""
        for node in self._not_yet_added:
            self._values = node.values if self._values is None else self._values + node.values
        self._not_yet_added = []
        return self._values  # type: ignore[return-value]  # at least one summand has been added

    @property
    def vanishes(self) -> bool:
        """True if the summands cancel, up to rounding, at all random points."""
        (x, y, z), (a, b, c) = self.generic, self.largest
        return abs(x) <= VANISHES * a and abs(y) <= VANISHES * b and abs(z) <= VANISHES * c

    def node(self) -> Node:
        """Return the sum as one node of the graph; the node replaces the summands, so that it is formed only once."""
        if len(self.terms) > 1:
            self.terms = [self.terms[0].graph.total(self.terms)]
        return self.terms[0]

    @property
    def penalty(self) -> float:
        """The number added to Markowitz's count for a division by the entry: 0 for +-1, 0.5 for another constant, else 1."""
        first, second, _ = self.generic
        # different values at two random points: the entry is not constant, which is known without forming its sum
        if len(self.terms) > 1 and abs(first - second) > 1e-9 * abs(first):
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
    """Absolute values of the entries of one row at the trusted samples, each divided by the `scale` of its column.

    Attributes:
        largest: (trusted samples,) the largest of these values.
        relative: column -> smallest ratio, over the samples, of the entry in this column to `largest`.
        usable: column -> whether the entry in this column is large enough for a pivot at all samples.
        steady: column -> whether the entry in this column is usable and has the same sign at all samples.
    """

    largest: Array
    relative: dict[int, float]
    usable: dict[int, bool]
    steady: dict[int, bool]


class _Markowitz:
    """One factorisation in progress, with pivots chosen by Markowitz's count.

    Attributes:
        trusted: (samples,) true for the samples at which pivots must be usable.
        scale: column -> absolute value of its largest entry at any sample at the beginning.
    """

    def __init__(self, graph: ExpressionGraph, A: Matrix, rows: Iterable[int], columns: Iterable[int], search: Search):
        """Begin the factorisation of the given rows and columns of A; other entries are ignored."""
        self.graph, self.search = graph, search
        self.random = np.random.default_rng(search.seed)
        self.trusted = np.ones(graph.samples, bool)
        self.rows: dict[int, dict[int, _Entry]] = {r: {} for r in rows}
        self.columns: dict[int, set[int]] = {c: set() for c in columns}
        for (r, c), node in A.items():
            if r in self.rows and c in self.columns and not node.is_zero:
                self.rows[r][c] = _Entry(node)
                self.columns[c].add(r)
        self.scale = {}
        for c, entries in self.columns.items():  # 1 if all entries of the column are zero
            self.scale[c] = max((float(self._sizes_of(self.rows[r][c]).max()) for r in entries), default=1.0) or 1.0
        self.sizes: dict[int, _Sizes] = {}
        self.pivots: list[Pivot] = []
        self.steps: dict[int, list[RowOperation]] = {r: [] for r in self.rows}
        self.upper: dict[int, list[tuple[int, Node]]] = {}

    def _sizes_of(self, e: _Entry) -> Array:
        """Return the absolute values (samples,) of one entry of the matrix at all samples."""
        return np.abs(e.values[: self.graph.samples])

    def factors(self, normal_equations: bool) -> Factors:
        """Eliminate all rows and return the factors.

        With `normal_equations`, normal equations replace the rows that are left when no usable pivot keeps its sign at all samples.
        """
        rest = None
        while self.rows:
            if normal_equations and self._find_pivot(steady_only=True) is None:
                rest = self._normal_equations()
                break
            # if no pivot is usable at every sample, take one that is usable at the most samples; thresholds exclude other states
            while (chosen := self._find_pivot()) is None:
                self._trust_fewer()
            self._eliminate(*chosen)
        return Factors(self.graph, tuple(self.pivots), self.steps, self.upper, rest)

    def _normal_equations(self) -> NormalEquations:
        """Form S^T S of the matrix S of the rows and columns without a pivot, and factorise it, to solve S^T S x = S^T y."""
        S = {(r, c): e.node() for r, row in self.rows.items() for c, e in row.items()}
        rows, columns = tuple(self.rows), tuple(self.columns)
        normal: Matrix = {}  # S^T S
        for c, d in combinations_with_replacement(columns, 2):
            products = [S[r, c] * S[r, d] for r in rows if (r, c) in S and (r, d) in S]
            entry = self.graph.total(products)
            if not entry.is_zero:
                normal[c, d] = normal[d, c] = entry
        return NormalEquations(rows, columns, S, lu(self.graph, normal, columns, columns, Search(self.search.seed)))

    def _trust_fewer(self) -> None:
        """Find the entry that is large enough for a pivot at the most samples, and restrict `trusted` to these samples.

        At states near the other samples, programs with other pivots are used.

        Raises:
            KernelError: the samples that remain are fewer than the fraction SHARE of all samples.
        """
        best = np.zeros_like(self.trusted)  # samples at which the best entry so far is usable
        for row in filter(None, self.rows.values()):  # rows with entries
            sizes = np.array([self._sizes_of(e) for e in row.values()])  # (entries, samples)
            scaled = sizes / np.array([self.scale[c] for c in row])[:, None]
            usable = (scaled >= RELATIVE * scaled.max(axis=0)) & (sizes >= SMALLEST) & self.trusted
            best = max([best, *usable], key=lambda x: int(x.sum()))
        if best.sum() < SHARE * len(best):
            raise KernelError("no pivot is usable at enough samples: the dependent coordinates do not follow from the others")
        self.trusted, self.sizes = best, {}  # the stored sizes belong to the samples that were trusted before

    def _find_pivot(self, steady_only: bool = False) -> tuple[int, int, Array] | None:
        """Return row and column of the cheapest pivot, and `_Sizes.largest` of its row; None if no entry is usable as a pivot.

        First a pivot that has the same sign at all trusted samples is sought in a few rows and columns, then in more rows and
        columns; then, unless `steady_only`, a pivot of either sign.
        """
        rounds = [(LOOKED_AT, True), (LOOKED_AT**2, True)]  # (number of rows and of columns, steady)
        if not steady_only:
            rounds += [(LOOKED_AT, False), (len(self.rows), False)]
        for count, steady in rounds:
            place = self._cheapest(self._places_in_sparsest(count), steady)
            if place is not None:
                return *place, self._row_sizes(place[0]).largest
        return None

    def _places_in_sparsest(self, count: int) -> list[tuple[int, int]]:
        """Return the places (row, column) of all entries in the `count` rows and `count` columns with the fewest entries."""
        rows = nsmallest(count, self.rows, lambda r: len(self.rows[r]))
        columns = nsmallest(count, self.columns, lambda c: len(self.columns[c]))
        places = [(r, c) for r in rows for c in self.rows[r]]
        places += [(r, c) for c in columns for r in sorted(self.columns[c])]
        return list(dict.fromkeys(places))

    def _cheapest(self, places: list[tuple[int, int]], steady: bool) -> tuple[int, int] | None:
        """Return the place (row, column) of the cheapest usable pivot; None if none is usable.

        Among pivots of equal cost, the one that is largest relative to the other entries of its row is returned.
        """
        best, place = (np.inf, 0.0), None  # (cost, minus relative size) of the pivot at `place`
        for r, c in places:
            count = (len(self.rows[r]) - 1) * (len(self.columns[c]) - 1)  # Markowitz's count
            if count > best[0] + self.search.noise:
                continue  # the cost is at least `count`, and therefore not the lowest
            sizes = self._row_sizes(r)
            allowed = sizes.steady if steady else sizes.usable
            if allowed[c]:
                price = self._cost(r, c, count), -sizes.relative[c]
                if place is None or price < best:
                    best, place = price, (r, c)
        return place

    def _row_sizes(self, r: int) -> _Sizes:
        """Return the sizes of the entries of row r, and which of them can be pivots; they are stored until the row changes."""
        known = self.sizes.get(r)
        if known is None:
            row = self.rows[r]
            # (entries, trusted samples); after the samples, an entry has values at the graph's random points
            values = np.array([e.values[: self.graph.samples][self.trusted] for e in row.values()])
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
        """Return the cost of a pivot: Markowitz's count, plus a penalty for a division, plus two costs by the search's settings.

        With `patience`, an entry costs more the later its value is ready, because the division has to wait for it. With `noise`, a
        random cost varies the order of pivots between attempts.
        """
        entry = self.rows[r][c]
        cost = count + entry.penalty
        if self.search.patience:
            cost += self.search.patience * entry.ready / 100.0
        if self.search.noise:
            cost += self.search.noise * self.random.random()
        return cost

    def _eliminate(self, r: int, c: int, largest: Array) -> None:
        """Eliminate column c from all rows except r, with the pivot in row r and column c.

        With the pivot p and the pivot's row P, another row R with the entry e in column c becomes R - (e / p) P. It becomes
        p R - e P if `crossed`, and R - e P if P has first been divided by p (`row_divided`).

        Args:
            largest: (trusted samples,) largest entry in row r, with columns scaled; its median gives the pivot's threshold.
        """
        row = {k: e.node() for k, e in self.rows.pop(r).items()}
        pivot = row.pop(c)  # `row` keeps the other entries of the pivot's row, by column
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
            factor = entry if row_divided or crossed else entry * inverse
            self.steps[other].append(RowOperation(r, factor, pivot if crossed else None))
            self._subtract(other, factor, row)
            # move the row to the end of the dict, whose order decides between equal pivots: a changed row is examined last, so that
            # in a chain of links the elimination proceeds from both ends
            self.rows[other] = self.rows.pop(other)
        for k in row:
            self.columns[k] = self.columns.pop(k)
        threshold = GUARD * self.scale[c] * median(largest.tolist())
        self.pivots.append(Pivot(r, c, pivot, inverse, row_divided, threshold))
        self.upper[r] = list(row.items())

    def _is_crossed(self, pivot: Node, others: list[int]) -> bool:
        """Decide at random whether the rows `others` are multiplied by the pivot, which avoids a division.

        If all are short and none has been multiplied before, they are with the probability `search.crossing`; else they are not.
        """
        if not self.search.crossing or pivot.number is not None or not others:
            return False
        are_short = all(len(self.rows[x]) - 1 <= CROSSED for x in others)
        were_multiplied = any(step.scale for x in others for step in self.steps[x])
        return are_short and not were_multiplied and self.random.random() < self.search.crossing

    def _subtract(self, other: int, factor: Node, row: dict[int, Node]) -> None:
        """Subtract `factor` times the pivot's row (column -> node) from row `other`; entries that become zero are removed."""
        target = self.rows[other]
        for k, u in row.items():
            product = -(factor * u)
            if k in target:
                target[k].add(product)
                if target[k].vanishes:
                    del target[k]
                    self.columns[k].discard(other)
            else:
                target[k] = _Entry(product)
                self.columns[k].add(other)


def lu(
    graph: ExpressionGraph, A: Matrix, rows: Iterable[int], columns: Iterable[int], search: Search, normal_equations: bool = False
) -> Factors:
    """Factorise a matrix of expressions.

    Args:
        rows, columns: the rows and columns of A that are factorised; other entries are ignored.
        normal_equations: whether normal equations replace the rows that are left when every usable pivot changes its sign between
            samples.

    Raises:
        KernelError: at some step of the elimination there is no entry that is usable as a pivot at a fraction SHARE or more of the
            samples.
    """
    return _Markowitz(graph, A, rows, columns, search).factors(normal_equations)
