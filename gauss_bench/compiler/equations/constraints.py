"""Constraint rows of a linkage as expressions: the code of `mechanism/equations.py` is called with nodes instead of numbers.

Where the constraints hold, a driven distance equals the value L(t) of its law. L(t) is used instead of the distance, which saves a
square root and several products. At states that violate the constraints, L(t) changes the acceleration in proportion to the
violation, but no residual. For slides the actual distance from the axis is used: the constant offset would change the errors of
steps, because stages violate the constraints by amounts of the order of the squared step size.
"""

from collections.abc import Sequence
from dataclasses import replace

from gauss_bench.compiler.equations.links import Links
from gauss_bench.compiler.expressions.node import ExpressionGraph, Node
from gauss_bench.mechanism import equations
from gauss_bench.mechanism.equations import Row


def rows_of(links: Links) -> list[Row]:
    """Return all constraint rows: joints, couplings, drivers, knife edges, each in the file's order.

    The entries of a row of J are column -> node; zeros are left out. If `links.exact` is true, the rows are also valid at
    states that violate the constraints.
    """
    node, rows = links.graph.node, []
    for x in equations.rows(links.mechanism, links, on_constraints=not links.exact):
        entries = {k: node(entry) for k, entry in x.entries.items()}
        entries = {k: entry for k, entry in entries.items() if not entry.is_zero}
        phi = None if x.phi is None else node(x.phi)
        rows.append(replace(x, entries=entries, gamma=node(x.gamma), phi=phi, phi_t=node(x.phi_t)))
    return rows


def combine(graph: ExpressionGraph, parts: Sequence[tuple[Row, float]]) -> Row:
    """Return the linear combination of constraint rows: the sum of factor times row over all `parts`, named as the first row.

    A row that constrains velocities only, such as that of a knife edge, has no residual phi, so it adds nothing to the residual of
    the sum.
    """
    entries: dict[int, list[Node]] = {}
    for row, factor in parts:
        for c, e in row.entries.items():
            entries.setdefault(c, []).append(e * factor)
    sums = {c: graph.total(x) for c, x in entries.items()}
    gamma = graph.total([row.gamma * factor for row, factor in parts])
    phi_t = graph.total([row.phi_t * factor for row, factor in parts])
    phi = graph.total([row.phi * factor for row, factor in parts if row.phi is not None])
    return Row(parts[0][0].name, {c: x for c, x in sums.items() if not x.is_zero}, gamma, phi, phi_t)


def rate_of(links: Links, row: Row) -> Node:
    """Return the rate of a row's residual phi: J v plus the partial derivative of phi with respect to time."""
    products = [e * links.rate(k) for k, e in row.entries.items()]
    return links.graph.total([*products, row.phi_t])
