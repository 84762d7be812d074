"""Constraint rows of a linkage as expressions: the rows of `mechanism/equations.py` with nodes as numbers.

On the constraints a driven distance equals the value L(t) of its law, which takes its place. This saves a root and several
products. Off the constraints it changes the acceleration in proportion to the violation, and it changes no residual. Slides keep
their true distance: with their offset in its place a stage would have three operations less, but steps would have other errors,
because their stages violate the constraints by the square of the step size.
"""

from collections.abc import Sequence
from dataclasses import replace

from gauss_bench.compiler.equations.links import Links
from gauss_bench.compiler.expressions.node import ExpressionGraph, Node
from gauss_bench.mechanism import equations
from gauss_bench.mechanism.equations import Row


def rows_of(links: Links) -> list[Row]:
    """Return all rows in the file's order (joints, couplings, drivers, knife edges), without the entries of J that vanish."""
    node, rows = links.graph.node, []
    for x in equations.rows(links.mechanism, links, on_constraints=not links.exact):
        entries = {k: node(entry) for k, entry in x.entries.items()}
        entries = {k: entry for k, entry in entries.items() if not entry.zero}
        phi = None if x.phi is None else node(x.phi)
        rows.append(replace(x, entries=entries, gamma=node(x.gamma), phi=phi, phi_t=node(x.phi_t)))
    return rows


def combine(graph: ExpressionGraph, parts: Sequence[tuple[Row, float]]) -> Row:
    """Return the weighted sum of rows, with the name of the first; rows without a position level add nothing to its residual."""
    entries: dict[int, list[Node]] = {}
    for row, factor in parts:
        for c, e in row.entries.items():
            entries.setdefault(c, []).append(e * factor)
    sums = {c: graph.total(x) for c, x in entries.items()}
    gamma = graph.total([row.gamma * factor for row, factor in parts])
    phi_t = graph.total([row.phi_t * factor for row, factor in parts])
    phi = graph.total([row.phi * factor for row, factor in parts if row.phi is not None])
    return Row(parts[0][0].name, {c: x for c, x in sums.items() if not x.zero}, gamma, phi, phi_t)


def rate_of(links: Links, row: Row) -> Node:
    """Return the rate of a row's residual, J v + dphi/dt."""
    products = [e * links.rate(k) for k, e in row.entries.items()]
    return links.graph.total([*products, row.phi_t])
