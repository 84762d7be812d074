"""Constraint rows of a linkage as expressions, entry by entry: `mechanism/equations.py`, whose numbers are nodes.

On the constraints a driven L(t) stands for the distance it is equal to, which saves a root and several products; off the
constraints this changes the acceleration by as little as the state is off, and no row's zero. Slides do without: stages of a step
are off by its second power, and an offset in the place of the true distance would save three operations a stage and make steps err
otherwise than they should.
"""

from collections.abc import Sequence
from dataclasses import dataclass

from gauss_bench.compiler.equations.links import Links
from gauss_bench.compiler.expressions.node import ExpressionGraph, Node
from gauss_bench.mechanism import equations


@dataclass(frozen=True, eq=False)
class Row:
    """One constraint: name, entries of J by coordinate, bias, residual (None without a position level), explicit rate."""

    name: str
    entries: dict[int, Node]
    gamma: Node
    phi: Node | None
    phi_t: Node


def rows_of(links: Links) -> list[Row]:
    """All rows in the file's order: joints two each, drivers, knife edges."""
    node = links.graph.node
    rows = []
    for x in equations.rows(links.mechanism, links, on_constraints=not links.exact):
        entries = {k: y for k, entry in x.entries.items() if not (y := node(entry)).zero}
        rows.append(Row(x.name, entries, node(x.gamma), None if x.phi is None else node(x.phi), node(x.phi_t)))
    return rows


def combine(graph: ExpressionGraph, parts: Sequence[tuple[Row, float]]) -> Row:
    """The sum of some rows, each times a factor, under the name of the first; all have a position level."""
    entries: dict[int, list[Node]] = {}
    for row, factor in parts:
        for c, e in row.entries.items():
            entries.setdefault(c, []).append(e * factor)
    sums = {c: graph.total(x) for c, x in entries.items()}
    gamma, phi_t = (graph.total([getattr(row, x) * factor for row, factor in parts]) for x in ("gamma", "phi_t"))
    phi = graph.total([row.phi * factor for row, factor in parts if row.phi is not None])
    return Row(parts[0][0].name, {c: x for c, x in sums.items() if not x.zero}, gamma, phi, phi_t)


def rate_of(links: Links, row: Row) -> Node:
    """Rate of the residual, J v + dphi/dt."""
    return links.graph.total([*(e * links.rate(k) for k, e in row.entries.items()), row.phi_t])
