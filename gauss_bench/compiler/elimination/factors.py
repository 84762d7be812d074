"""Triangular factors of a matrix of expressions, and solutions of it and of its transpose.

Row operations E made A upper triangular, E A = U. With them

    A x = b:               y = E b,          U x = y
    A^T lambda = b:        U^T z = b,        lambda = E^T z

A right-hand side is a dict without zeros, and what is structurally zero in it stays absent.
"""

from collections.abc import Iterable
from dataclasses import dataclass

from gauss_bench.compiler.expressions.node import Graph, Node

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
class Step:
    """One row operation: row <- scale row - factor (pivot row), the scale None for 1."""

    pivot_row: int
    factor: Node
    scale: Node | None


@dataclass(frozen=True, eq=False)
class Factors:
    """The row operations that made A upper triangular, and what they made of it; pivots in order of elimination."""

    graph: Graph
    pivots: tuple[Pivot, ...]
    steps: dict[int, list[Step]]
    upper: dict[int, list[tuple[int, Node]]]

    def solve(self, b: Right) -> Right:
        """x by column, of A x = b by row; zeros are left out of both."""
        y: Right = {}
        for p in self.pivots:
            _put(y, p.row, self._reduced(b.get(p.row), self.steps[p.row], y), p.inverse if p.row_divided else None)
        x: Right = {}
        for p in reversed(self.pivots):
            known = _less(y.get(p.row), ((u, x.get(c)) for c, u in self.upper[p.row]))
            _put(x, p.column, known, None if p.row_divided else p.inverse)
        return x

    def _reduced(self, b: Node | None, steps: list[Step], y: Right) -> Node | None:
        """What the row operations make of an entry of the right-hand side."""
        products: list[tuple[Node, Node | None]] = []
        for step in steps:
            if step.scale is not None:
                b, products = _less(b, products), []
                b = None if b is None else b * step.scale
            products.append((step.factor, y.get(step.pivot_row)))
        return _less(b, products)

    def solve_transposed(self, b: Right) -> Right:
        """lambda by row, of A^T lambda = b by column: U^T z = b, then the row operations transposed, the last one first."""
        above: dict[int, list[tuple[int, Node]]] = {p.column: [] for p in self.pivots}
        for p in self.pivots:
            for c, u in self.upper[p.row]:
                above[c].append((p.row, u))
        z: Right = {}
        for p in self.pivots:
            known = _less(b.get(p.column), ((u, z.get(r)) for r, u in above[p.column]))
            _put(z, p.row, known, None if p.row_divided else p.inverse)
        pending: dict[int, list[tuple[Node, Node | None]]] = {p.row: [] for p in self.pivots}
        found: Right = {}
        for p in reversed(self.pivots):
            _put(found, p.row, _less(z.get(p.row), pending[p.row]), p.inverse if p.row_divided else None)
            load = found.get(p.row)
            for step in reversed(self.steps[p.row]):
                pending[step.pivot_row].append((step.factor, load))
                load = load if load is None or step.scale is None else load * step.scale
            _put(found, p.row, load, None)
        return found


def _less(b: Node | None, products: Iterable[tuple[Node, Node | None]]) -> Node | None:
    """b less the sum of the products, None for zero."""
    terms = [-(f * x) for f, x in products if x is not None]
    if b is not None:
        terms.append(b)
    return terms[0].graph.total(terms) if terms else None


def _put(where: Right, key: int, x: Node | None, factor: Node | None) -> None:
    if x is not None and not x.zero:
        where[key] = x if factor is None else x * factor
