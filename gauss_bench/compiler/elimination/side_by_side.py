"""Accelerations of a large linkage as expressions, by elimination in rounds; formulations and signs as in algebra.py.

A pin through several links is several rows of J, and any independent combinations of them serve for accelerations. They are taken
relative to the link nearest to the ground, p_k - p_1 = 0, rather than along the list of links: then rows of neighbouring loops meet
in one link alone, and rounds find equal steps in all loops.
"""

from collections.abc import Sequence
from dataclasses import dataclass

from gauss_bench.compiler.elimination.factors import Right
from gauss_bench.compiler.elimination.lu import Matrix
from gauss_bench.compiler.elimination.rounds import Solution, added, solve
from gauss_bench.compiler.elimination.workspace import Workspace
from gauss_bench.compiler.equations.constraints import Row
from gauss_bench.compiler.expressions.node import Graph, Node
from gauss_bench.mechanism.model import GROUND, Mechanism, Revolute

LONG = 12  # summands; longer sums run over arrays

Home = tuple[str, int]  # an array, and the place in it


@dataclass(frozen=True, eq=False)
class Equations:
    """What is to be computed.

    Attributes:
        a: (n) accelerations by coordinate.
        sound: number of pivots, of `guards`, that are large enough.
        phases: numbers of nodes made before each stage of the computation ended; nodes of a stage need no later ones.
        homes: index of a node -> where it is kept, for solutions: by coordinate, so that links stand side by side.
    """

    mechanism: Mechanism
    a: list[Node]
    sound: Node
    guards: int
    phases: list[int]
    homes: dict[int, Home]


def equations(work: Workspace) -> Equations:
    """The accelerations of a workspace's mechanism under its plan.

    Raises:
        KernelError: no pivots are usable.
    """
    graph, terms, mechanism = work.terms.graph, work.terms, work.links.mechanism
    rows = _starred(graph, mechanism, work)
    J: Matrix = {(r, c): e for r, row in enumerate(rows) for c, e in row.entries.items()}
    gamma = {r: row.gamma for r, row in enumerate(rows) if not row.gamma.zero}
    if work.plan.formulation == "gauss":
        solutions, a = _gauss(work, J, gamma, len(rows))
    else:
        solutions, a = _lagrange(work, J, gamma, len(rows))
    phases = [x for s in solutions for x in s.phases]
    guards = [x for s in solutions for x in s.guards]
    phases.append(graph.count)
    holds = [_at_least(graph, pivot, threshold) for pivot, threshold in guards]
    phases.append(graph.count)
    found = [a.get(j, graph.constant(0.0)) for j in range(len(terms.mass))]
    homes: dict[int, Home] = {}
    for number, x in enumerate(solutions[0].x):
        for c, node in x.items():
            if node.op == "IS":
                homes[node.index] = _home(number, c, len(terms.mass))
    return Equations(mechanism, found, total(graph, holds), len(guards), phases, homes)


def _home(number: int, unknown: int, n: int) -> Home:
    """Links stand side by side, and so do the multipliers of pairs of rows."""
    if unknown < n:
        return f"x{number}.{unknown % 3}", unknown // 3
    return f"x{number}.{3 + (unknown - n) % 2}", (unknown - n) // 2


def _at_least(graph: Graph, pivot: Node, threshold: float) -> Node:
    """1 where |pivot| >= threshold, else 0."""
    square, least = pivot * pivot, graph.constant(threshold**2)
    return graph.opaque("LE", (least, square), (least.at <= square.at).astype(float))


def total(graph: Graph, terms: Sequence[Node]) -> Node:
    """A sum; a long one stays one operation."""
    terms = [x for x in terms if not x.zero]
    if len(terms) <= LONG:
        return added(graph, terms)
    return graph.opaque("SUM", tuple(terms), sum((x.at for x in terms), start=0.0 * terms[0].at))


def _gauss(work: Workspace, J: Matrix, gamma: Right, m: int) -> tuple[list[Solution], Right]:
    terms, graph, independent = work.terms, work.terms.graph, work.plan.independent
    dependent = [c for c in range(len(terms.mass)) if c not in independent]
    columns: list[Right] = [{r: -e for (r, c), e in J.items() if c == k} for k in independent]
    first = solve(graph, J, [gamma, *columns], range(m), dependent)
    a0, motions = first.x[0], [x | {k: graph.constant(1.0)} for k, x in zip(independent, first.x[1:], strict=True)]
    A: Matrix = {}
    for k, left in enumerate(motions):
        for l, other in enumerate(motions[: k + 1]):
            products = [terms.mass[j] * left[j] * other[j] for j in sorted(left.keys() & other.keys())]
            A[k, l] = A[l, k] = total(graph, products)
    b = {k: total(graph, [N[j] * _force(work, a0, j) for j in sorted(N)]) for k, N in enumerate(motions)}
    unknowns = range(len(motions))
    second = solve(graph, A, [b], unknowns, unknowns)
    h = second.x[0]
    found: Right = {}
    for j in range(len(terms.mass)):
        parts = [N[j] * h[k] for k, N in enumerate(motions) if j in N and k in h]
        found[j] = added(graph, [*([a0[j]] if j in a0 else []), *parts])
    return [first, second], found


def _force(work: Workspace, a0: Right, j: int) -> Node:
    """Q_j - M_j a0_j."""
    force = work.terms.Q.get(j, work.terms.graph.constant(0.0))
    return force - work.terms.mass[j] * a0[j] if j in a0 else force


def _lagrange(work: Workspace, J: Matrix, gamma: Right, m: int) -> tuple[list[Solution], Right]:
    terms, n = work.terms, len(work.terms.mass)
    A: Matrix = {(i, i): x for i, x in enumerate(terms.mass)}
    for (r, c), e in J.items():
        A[n + r, c] = A[c, n + r] = e
    b = {k: x for k, x in terms.Q.items() if not x.zero} | {n + r: x for r, x in gamma.items()}
    found = solve(terms.graph, A, [b], range(n + m), range(n + m))
    return [found], {k: x for k, x in found.x[0].items() if k < n}


def _starred(graph: Graph, mechanism: Mechanism, work: Workspace) -> list[Row]:
    """The kept rows, those of a pin through several links relative to the one nearest to the ground."""
    found = {k: work.rows[k] for k in work.kept}
    distance = _distances(mechanism)
    for pairs in _pins(mechanism).values():
        links = [pairs[0][1].a.link, *(j.b.link for _, j in pairs)]
        centre = min(range(len(links)), key=lambda k: distance.get(links[k], len(distance)))
        for axis in (0, 1):
            chain = [2 * k + axis for k, _ in pairs]
            if len(chain) > 1 and all(k in found for k in chain):
                old = [found[k] for k in chain]
                found |= dict(zip(chain, _relative(graph, old, centre), strict=True))
    return [found[k] for k in work.kept]


def _pins(mechanism: Mechanism) -> dict[str, list[tuple[int, Revolute]]]:
    """Pairs of each pin, with their places among the joints."""
    found: dict[str, list[tuple[int, Revolute]]] = {}
    for k, joint in enumerate(mechanism.joints):
        if isinstance(joint, Revolute):
            found.setdefault(joint.joint, []).append((k, joint))
    return found


def _distances(mechanism: Mechanism) -> dict[int, int]:
    """Joints between each link and the ground."""
    neighbours: dict[int, set[int]] = {}
    for joint in mechanism.joints:
        a, b = (joint.a.link, joint.b.link) if isinstance(joint, Revolute) else (joint.guide.link, joint.block.link)
        neighbours.setdefault(a, set()).add(b)
        neighbours.setdefault(b, set()).add(a)
    found, front = {GROUND: 0}, [GROUND]
    for link in front:
        for other in sorted(neighbours.get(link, set()) - found.keys()):
            found[other] = found[link] + 1
            front.append(other)
    return found


def _relative(graph: Graph, chain: list[Row], centre: int) -> list[Row]:
    """Rows p_k+1 - p_k as rows p_k - p_centre."""
    found = []
    for k in range(len(chain) + 1):
        if k != centre:
            part, sign = (chain[centre:k], 1.0) if k > centre else (chain[k:centre], -1.0)
            entries: dict[int, list[Node]] = {}
            for row in part:
                for c, e in row.entries.items():
                    entries.setdefault(c, []).append(e * sign)
            sums = {c: graph.total(x) for c, x in entries.items()}
            gamma = graph.total([row.gamma * sign for row in part])
            found.append(Row(part[0].name, {c: x for c, x in sums.items() if not x.zero}, gamma, None, graph.constant(0.0)))
    return found
