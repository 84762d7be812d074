"""Elimination in rounds: in each as many pivots at once as do not touch one another.

Ordinary elimination of a chain of loops walks from one end to the other, every operation waiting for the one before. Two pivots
(r, c) and (s, d) can be eliminated side by side where A[r, d] = A[s, c] = 0. A round takes a maximal set of such pivots, cheapest
first by Markowitz's count, and goes as high in cost as it must to take a fair share of what is left. For loops in a chain this
comes to cyclic reduction: first the same few steps inside every loop, then two of every three unknowns, so that N loops take about
log N rounds of equal operations, which large_groups.py joins. It costs a few operations more than the walk, but eight at a time.
Sources: Calahan, Parallel solution of sparse simultaneous linear equations, Allerton Conference (1973), for compatible pivots;
Hockney, A fast direct solution of Poisson's equation using Fourier analysis, J. ACM 12 (1965), for cyclic reduction.

The right-hand sides are eliminated along with the matrix. Pivots are chosen, and guarded, as in elimination.py.

A pin through several links is several rows of J, and any independent combinations of them serve for accelerations. They are taken
relative to the link nearest to the ground, p_k - p_1 = 0, rather than along the list of links: then rows of neighbouring loops meet
in one link alone, and rounds find equal steps in all loops.
"""

from bisect import bisect_left
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import chain, islice

import numpy as np
from numpy.typing import NDArray

from gauss_bench.compiler.elimination.formulations import Plan, Workspace, bend, refuse, workspace
from gauss_bench.compiler.elimination.function import Function, number_nodes
from gauss_bench.compiler.elimination.lu import GUARD, RELATIVE, SMALLEST, Matrix, Right, fewer
from gauss_bench.compiler.elimination.partition import Study, covering, study
from gauss_bench.compiler.elimination.rank import CHECKED, error_on_constraints
from gauss_bench.compiler.equations.constraints import Row, combine, rate_of, rows_of
from gauss_bench.compiler.equations.links import open_parameters
from gauss_bench.compiler.errors import KernelError
from gauss_bench.compiler.expressions.node import ExpressionGraph, Node
from gauss_bench.mechanism.lines import with_lines
from gauss_bench.mechanism.model import GROUND, Mechanism, Revolute
from gauss_bench.terms import Array

SHARE = 10  # a round takes at least a tenth of the rows that are left, whatever the fill
SMALL = 8  # rows; so few are eliminated by least fill alone

Changes = dict[tuple[int, int], list[Node]]  # row, and column or number of a right-hand side -> what is added


@dataclass(frozen=True, eq=False)
class EliminatedRow:
    """A pivot that was eliminated, and its row then, on the left and on the right; divided by it already if `inverse` is None."""

    column: int
    inverse: Node | None
    row: dict[int, Node]
    right: dict[int, Node]


@dataclass(frozen=True, eq=False)
class Solution:
    """The result of an elimination.

    Attributes:
        x: solutions by right-hand side, then by column, zeros left out.
        guards: pivots that vary, and the smallest size of each to trust.
        phases: numbers of nodes before the first round, after each round, and after each round of the substitution.
    """

    x: list[Right]
    guards: list[tuple[Node, float]]
    phases: list[int]


class _Rounds:
    """One elimination in progress."""

    def __init__(self, graph: ExpressionGraph, A: Matrix, right: list[Right], rows: Iterable[int], columns: Iterable[int]):
        self.graph = graph
        self.rows: dict[int, dict[int, Node]] = {r: {} for r in rows}
        self.columns: dict[int, set[int]] = {c: set() for c in columns}
        for (r, c), node in A.items():
            if r in self.rows and c in self.columns and not node.zero:
                self.rows[r][c] = node
                self.columns[c].add(r)
        self.right: dict[int, dict[int, Node]] = {r: {} for r in self.rows}
        for k, b in enumerate(right):
            for r, node in b.items():
                self.right[r][k] = node
        self.scale = {c: self._largest_in(c) for c in self.columns}
        self.steps: list[EliminatedRow] = []
        self.guards: list[tuple[Node, float]] = []
        self.trusted = np.ones(graph.samples, bool)
        self.sizes: dict[int, tuple[Array, dict[int, Array]]] = {}

    def _largest_in(self, c: int) -> float:
        return max((float(self._values(self.rows[r][c]).max()) for r in self.columns[c]), default=1.0) or 1.0

    def _values(self, node: Node) -> Array:
        return np.abs(node.at[: self.graph.samples])

    def solution(self, count: int) -> Solution:
        phases = [self.graph.count]
        rounds: list[list[EliminatedRow]] = []
        while self.rows:
            before = len(self.steps)
            self._round()
            rounds.append(self.steps[before:])
            phases.append(self.graph.count)
        x: list[Right] = [{} for _ in range(count)]
        for steps in reversed(rounds):
            for step in steps:
                self._substitute(step, x)
            phases.append(self.graph.count)
        return Solution(x, self.guards, phases)

    def _substitute(self, step: EliminatedRow, x: list[Right]) -> None:
        for k, solution in enumerate(x):
            terms = [step.right[k]] if k in step.right else []
            terms += [-(u * solution[c]) for c, u in sorted(step.row.items()) if c in solution]
            value = add_to(self.graph, terms)
            if not value.zero:
                solution[step.column] = settle(self.graph, value if step.inverse is None else value * step.inverse)

    def _round(self) -> None:
        chosen = self._chosen()
        changes: Changes = {}
        right: Changes = {}
        for r, c in chosen:
            self._eliminate(r, c, changes, right)
        for (r, c), terms in changes.items():
            old = self.rows[r].get(c)
            self._put(r, c, add_to(self.graph, terms if old is None else [old, *terms]))
        for (r, k), terms in right.items():
            old = self.right[r].get(k)
            self.right[r][k] = add_to(self.graph, terms if old is None else [old, *terms])

    def _put(self, r: int, c: int, node: Node) -> None:
        self.sizes.pop(r, None)
        if node.zero:
            self.rows[r].pop(c, None)
            self.columns[c].discard(r)
        else:
            self.rows[r][c] = node
            self.columns[c].add(r)

    def _chosen(self) -> list[tuple[int, int]]:
        """Pivots of the next round, of one sign if possible; usable at as many samples as possible, elsewhere their guards tell."""
        while True:
            for steady in (True, False):
                pivots = list(self._compatible(steady))
                if pivots:
                    return pivots
            rows = ((np.array([self._values(x) for x in row.values()]), row) for row in self.rows.values() if row)
            self.trusted = fewer(((sizes, np.array([self.scale[c] for c in row])) for sizes, row in rows), self.trusted)
            self.sizes = {}

    def _compatible(self, steady: bool) -> Iterator[tuple[int, int]]:
        left = len(self.rows)
        enough = 1 if left <= SMALL else left / SHARE
        barred_rows: set[int] = set()
        barred_columns: set[int] = set()
        taken, level = 0, -1.0
        for cost, r, c in sorted((self._cost(r, c), r, c) for r, row in self.rows.items() for c in row):
            if cost > level and taken >= enough:
                return
            level = cost
            if r in barred_rows or c in barred_columns or not self._usable(r, c, steady):
                continue
            taken += 1
            barred_rows |= self.columns[c]
            barred_columns |= self.rows[r].keys()
            yield r, c

    def _cost(self, r: int, c: int) -> float:
        """Markowitz's count, and something for a division."""
        number = self.rows[r][c].number
        penalty = 0.5 if number is None else 0.25 if abs(number) != 1.0 else 0.0
        return (len(self.rows[r]) - 1) * (len(self.columns[c]) - 1) + penalty

    def _usable(self, r: int, c: int, steady: bool) -> bool:
        _, sizes = self._row_sizes(r)
        values = self.rows[r][c].at[: self.graph.samples][self.trusted]
        if steady and float(values.min()) < 0.0 < float(values.max()):
            return False
        return float(sizes[c].min()) >= RELATIVE and float(np.abs(values).min()) >= SMALLEST

    def _row_sizes(self, r: int) -> tuple[Array, dict[int, Array]]:
        """The largest entry of a row at each trusted sample, columns scaled, and all entries relative to it."""
        if r not in self.sizes:
            sizes = {c: self._values(x)[self.trusted] / self.scale[c] for c, x in self.rows[r].items()}
            largest = np.maximum(np.max(list(sizes.values()), axis=0), np.finfo(float).tiny)
            self.sizes[r] = largest, {c: x / largest for c, x in sizes.items()}
        return self.sizes[r]

    def _eliminate(self, r: int, c: int, changes: Changes, right: Changes) -> None:
        threshold = GUARD * self.scale[c] * float(np.median(self._row_sizes(r)[0]))
        row, b = self.rows.pop(r), self.right.pop(r)
        pivot = row.pop(c)
        others = sorted(self.columns.pop(c) - {r})
        inverse = None if pivot.number == 1.0 else self.graph.inverse(pivot)
        if inverse is not None and (inverse.number is not None or len(row) + len(b) <= len(others)):
            row, b = ({k: u * inverse for k, u in x.items()} for x in (row, b))
            inverse = None
        if pivot.number is None:
            self.guards.append((pivot, threshold))
        for k in row:
            self.columns[k].discard(r)
        for other in others:
            entry = self.rows[other].pop(c)
            self.sizes.pop(other, None)
            f = entry if inverse is None else entry * inverse
            for k, u in row.items():
                changes.setdefault((other, k), []).append(-(f * u))
            for k, u in b.items():
                right.setdefault((other, k), []).append(-(f * u))
        self.steps.append(EliminatedRow(c, inverse, row, b))


def add_to(graph: ExpressionGraph, terms: list[Node]) -> Node:
    """A sum in the order of its terms, whenever they are ready: equal sums of different loops remain equal."""
    total = graph.constant(0.0)
    for x in terms:
        total = total + x
    return total


def settle(graph: ExpressionGraph, x: Node) -> Node:
    """A solution as a value of its own, whatever its sign and form: those of different loops are then used alike."""
    return x if x.number is not None else graph.opaque("IS", (x,), x.at)


def solve(graph: ExpressionGraph, A: Matrix, right: list[Right], rows: Iterable[int], columns: Iterable[int]) -> Solution:
    """Solutions of A(rows, columns) x = b for several right-hand sides by row.

    Raises:
        KernelError: no pivot is left that is usable at all samples.
    """
    return _Rounds(graph, A, right, rows, columns).solution(len(right))


LONG = 12  # summands; longer sums run over arrays

Home = tuple[str, int]  # an array, and the place in it


@dataclass(frozen=True, eq=False)
class RoundsFunction:
    """The functions to be computed.

    Attributes:
        inputs: of "t", "q", "v", "t_new", "q_new", "p", those that it takes, in this order.
        function: of these -> one number for each coordinate (n,), number of guards that hold (1,).
        guards: how many there are.
        phases: how many values are known when each stage of the computation ends; values of a stage need no later ones.
        homes: value -> where it is kept, for solutions: by coordinate, so that links stand side by side.
    """

    inputs: tuple[str, ...]
    function: Function
    guards: int
    phases: list[int]
    homes: dict[int, Home]


@dataclass(frozen=True)
class Wanted:
    """The abilities asked of a program: numbers left open, Baumgarte's alpha and beta [1/s], and projection."""

    formulation: str = "gauss"
    open_parameters: tuple[str, ...] = ()
    baumgarte: tuple[float, float] | None = None
    projection: bool = False


PLAIN = Wanted()


@dataclass(frozen=True, eq=False)
class RoundsProgram:
    """Functions of one mechanism under a plan.

    Attributes:
        plan: formulation and partition.
        parameters, values: of the open numbers, as in `program.Program`.
        acceleration: (t, q, v, p) -> a; stabilized: the same with Baumgarte's terms, None unless asked for.
        position: (t, q, t_new, q_new, p) -> Newton's correction of q_new, with the Jacobian at q; velocity: (t, q, v, p) ->
            correction of v; both None unless they are wanted, or rows are redundant and nothing else takes back what those are off.
        dropped: names of redundant rows that were left out.
        projected: whether every step is to be corrected.
    """

    plan: Plan
    parameters: tuple[str, ...]
    values: Array
    acceleration: RoundsFunction
    stabilized: RoundsFunction | None
    position: RoundsFunction | None
    velocity: RoundsFunction | None
    dropped: tuple[str, ...]
    projected: bool


def programs_in_rounds(mechanism: Mechanism, wanted: Wanted) -> Iterator[RoundsProgram]:
    """The programs of a mechanism, the best first.

    Raises:
        KernelError: dry friction, an unknown formulation or number, no usable pivots, or a first program that is wrong.
    """
    refuse(mechanism, wanted.formulation)
    known = study(mechanism)
    made: list[RoundsProgram] = []
    for program in _cheapest_first(_generate(known, wanted), 2 if wanted.formulation == "auto" else 1):
        if not made:
            check(program, mechanism)
        made.append(program)
        yield program
    if not made:
        raise KernelError(f"{mechanism.name}: no partition of the coordinates has usable pivots")


def _generate(known: Study, wanted: Wanted) -> Iterator[RoundsProgram]:
    """Under the formulations that are open, then under the other, and last with other redundant rows dropped.

    Partitions are asked for late, as many freedoms make them slow to find.
    """
    lagrange = Plan("lagrange", ())
    open_parameters(known.mechanism, wanted.open_parameters)  # refuses a name the mechanism does not have
    formulation = wanted.formulation
    plans: Iterable[Plan] = (Plan("gauss", x) for x in covering(known))
    if formulation == "auto":
        plans = (plan for group in (islice(plans, 1), [lagrange], plans) for plan in group)
    else:
        plans = chain([lagrange], plans) if formulation == "lagrange" else chain(plans, [lagrange])
    met: list[Plan] = []
    for plan in plans:
        met.append(plan)
        yield from _if_usable(known, plan, wanted)
    for plan in [replace(x, drop=k) for k in range(1, len(known.drops)) for x in met]:
        yield from _if_usable(known, plan, wanted)


def _if_usable(known: Study, plan: Plan, wanted: Wanted) -> Iterator[RoundsProgram]:
    """The program of a plan, or none: not every partition can be eliminated everywhere."""
    try:
        program = generate_in_rounds(known, plan, wanted)
    except KernelError:
        return
    yield program


def _cheapest_first(programs: Iterator[RoundsProgram], compared: int) -> Iterator[RoundsProgram]:
    yield from sorted(islice(programs, compared), key=lambda p: p.acceleration.function.operations)
    yield from programs


def check(program: RoundsProgram, mechanism: Mechanism) -> None:
    """Compare with the linkage's own evaluation.

    Raises:
        KernelError: the program is off by more than CHECKED, or usable nowhere.
    """

    def accelerate(t: Array, q: Array, v: Array) -> tuple[Array, NDArray[np.bool_]]:
        a, held = program.acceleration.function(t, q, v, with_lines(mechanism, program.values, t[:, 0]))
        return a, held[:, 0] == program.acceleration.guards

    error, count = error_on_constraints(mechanism, accelerate)
    if not (count and error <= CHECKED):
        raise KernelError(f"{mechanism.name}: the {program.plan.formulation} kernel is off by {error:.1e} at {count} states")


def generate_in_rounds(known: Study, plan: Plan, wanted: Wanted = PLAIN) -> RoundsProgram:
    """The functions of a mechanism under a plan.

    Raises:
        KernelError: no pivots are usable.
    """
    work = workspace(known, wanted.open_parameters, plan)
    rows = _star(work.terms.graph, known.mechanism, work.keeping(work.rows))
    made = _Functions(work, rows)
    dropped = known.dropped(plan.drop)
    corrected = wanted.projection or (dropped and not wanted.baumgarte)
    there = work.keeping(rows_of(work.links_at_new())) if corrected else {}
    moved = _star(work.terms.graph, known.mechanism, there) if there else []
    phi = {r: row.phi for r, row in enumerate(moved) if row.phi is not None and not row.phi.zero}
    rates = {r: x for r, row in enumerate(rows) if not (x := rate_of(work.links, row)).zero}
    gamma = {r: row.gamma for r, row in enumerate(rows) if not row.gamma.zero}
    damped = (
        {r: x for r, row in enumerate(rows) if not (x := bend(work.links, row, *wanted.baumgarte)).zero} if wanted.baumgarte else {}
    )
    numbers = work.links.parameters
    return RoundsProgram(
        plan,
        numbers.names,
        numbers.values,
        made.acceleration(gamma),
        made.acceleration(damped) if wanted.baumgarte else None,
        made.correction(phi, ("t", "q", "t_new", "q_new", "p")) if corrected else None,
        made.correction(rates, ("t", "q", "v", "p")) if corrected else None,
        dropped,
        wanted.projection,
    )


class _Functions:
    """Functions of one workspace; what one of them made may serve the next."""

    def __init__(self, work: Workspace, rows: list[Row]):
        self.work, self.rows = work, len(rows)
        self.J: Matrix = {(r, c): e for r, row in enumerate(rows) for c, e in row.entries.items()}
        self.phases: list[int] = []

    def acceleration(self, gamma: Right) -> RoundsFunction:
        eliminated = _gauss if self.work.plan.formulation == "gauss" else _lagrange
        return self._function(*eliminated(self.work, self.J, gamma, self.rows), ("t", "q", "v", "p"))

    def correction(self, residual: Right, inputs: tuple[str, ...]) -> RoundsFunction:
        """The shortest change of the coordinates that takes a residual by row away."""
        terms, n, plan = self.work.terms, len(self.work.terms.mass), self.work.plan
        b = {r: -x for r, x in residual.items()}
        if plan.formulation == "gauss":
            return self._function(*_gauss(self.work, self.J, b, self.rows, loaded=False), inputs)
        size, right = n + self.rows, {n + r: x for r, x in b.items()}
        units = [terms.graph.constant(1.0)] * n
        solution = solve(terms.graph, _border(units, self.J), [right], range(size), range(size))
        return self._function([solution], {k: x for k, x in solution.x[0].items() if k < n}, inputs)

    def _function(self, solutions: list[Solution], result: Right, inputs: tuple[str, ...]) -> RoundsFunction:
        graph, n, names = self.work.terms.graph, len(self.work.terms.mass), self.work.links.parameters.names
        self.phases += [*(x for s in solutions for x in s.phases), graph.count]
        guards = [x for s in solutions for x in s.guards]
        holds = [_at_least(graph, pivot, self.work.caution * threshold) for pivot, threshold in guards]
        self.phases.append(graph.count)
        ends = [result.get(j, graph.constant(0.0)) for j in range(n)]
        sizes = tuple((x, len(names) if x == "p" else 1 if x[0] == "t" else n) for x in inputs)
        function, number = number_nodes(sizes, [ends, [total(graph, holds)]])
        made = sorted(number)
        homes = {
            number[node.index]: _home(k, c, n)
            for k, x in enumerate(solutions[0].x)
            for c, node in x.items()
            if node.op == "IS" and node.index in number
        }
        return RoundsFunction(inputs, function, len(guards), [bisect_left(made, x) for x in self.phases], homes)


def _home(number: int, unknown: int, n: int) -> Home:
    """Links stand side by side, and so do the multipliers of pairs of rows."""
    if unknown < n:
        return f"x{number}.{unknown % 3}", unknown // 3
    return f"x{number}.{3 + (unknown - n) % 2}", (unknown - n) // 2


def _at_least(graph: ExpressionGraph, pivot: Node, threshold: float) -> Node:
    """1 where |pivot| >= threshold, else 0."""
    square, least = pivot * pivot, graph.constant(threshold**2)
    return graph.opaque("LE", (least, square), (least.at <= square.at).astype(float))


def total(graph: ExpressionGraph, terms: Sequence[Node]) -> Node:
    """A sum; a long one stays one operation."""
    terms = [x for x in terms if not x.zero]
    if len(terms) <= LONG:
        return add_to(graph, terms)
    return graph.opaque("SUM", tuple(terms), sum((x.at for x in terms), start=0.0 * terms[0].at))


def _gauss(work: Workspace, J: Matrix, gamma: Right, m: int, loaded: bool = True) -> tuple[list[Solution], Right]:
    """Accelerations for a bias; not `loaded`, without forces and masses, the shortest change that meets it."""
    terms, graph, independent = work.terms, work.terms.graph, work.plan.independent
    weights = terms.mass if loaded else [graph.constant(1.0)] * len(terms.mass)
    dependent = [c for c in range(len(terms.mass)) if c not in independent]
    columns: list[Right] = [{r: -e for (r, c), e in J.items() if c == k} for k in independent]
    first = solve(graph, J, [gamma, *columns], range(m), dependent)
    a0, motions = first.x[0], [x | {k: graph.constant(1.0)} for k, x in zip(independent, first.x[1:], strict=True)]
    A: Matrix = {}
    for k, left in enumerate(motions):
        for l, other in enumerate(motions[: k + 1]):
            products = [weights[j] * left[j] * other[j] for j in sorted(left.keys() & other.keys())]
            A[k, l] = A[l, k] = total(graph, products)

    def force(j: int) -> Node:
        """Q_j - W_j a0_j."""
        load = terms.Q.get(j, graph.constant(0.0)) if loaded else graph.constant(0.0)
        return load - weights[j] * a0[j] if j in a0 else load

    b = {k: total(graph, [N[j] * force(j) for j in sorted(N)]) for k, N in enumerate(motions)}
    unknowns = range(len(motions))
    second = solve(graph, A, [b], unknowns, unknowns)
    h = second.x[0]
    a: Right = {}
    for j in range(len(terms.mass)):
        parts = [N[j] * h[k] for k, N in enumerate(motions) if j in N and k in h]
        a[j] = add_to(graph, [*([a0[j]] if j in a0 else []), *parts])
    return [first, second], a


def _lagrange(work: Workspace, J: Matrix, gamma: Right, m: int) -> tuple[list[Solution], Right]:
    terms, n = work.terms, len(work.terms.mass)
    b = {k: x for k, x in terms.Q.items() if not x.zero} | {n + r: x for r, x in gamma.items()}
    solution = solve(terms.graph, _border(terms.mass, J), [b], range(n + m), range(n + m))
    return [solution], {k: x for k, x in solution.x[0].items() if k < n}


def _border(mass: Sequence[Node], J: Matrix) -> Matrix:
    n, A = len(mass), {(i, i): x for i, x in enumerate(mass)}
    for (r, c), e in J.items():
        A[n + r, c] = A[c, n + r] = e
    return A


def _star(graph: ExpressionGraph, mechanism: Mechanism, kept: dict[int, Row]) -> list[Row]:
    """The kept rows by number, those of a pin through several links relative to the one nearest to the ground."""
    rows = dict(kept)
    distance = _distances(mechanism)
    for pairs in _pins(mechanism).values():
        links = [pairs[0][1].a.link, *(j.b.link for _, j in pairs)]
        centre = min(range(len(links)), key=lambda k: distance.get(links[k], len(distance)))
        for axis in (0, 1):
            chain = [2 * k + axis for k, _ in pairs]
            if len(chain) > 1 and all(k in rows for k in chain):
                old = [rows[k] for k in chain]
                rows |= dict(zip(chain, _relative(graph, old, centre), strict=True))
    return [rows[k] for k in kept]


def _pins(mechanism: Mechanism) -> dict[str, list[tuple[int, Revolute]]]:
    """Pairs of each pin, with their places among the joints."""
    pins: dict[str, list[tuple[int, Revolute]]] = {}
    for k, joint in enumerate(mechanism.joints):
        if isinstance(joint, Revolute):
            pins.setdefault(joint.joint, []).append((k, joint))
    return pins


def _distances(mechanism: Mechanism) -> dict[int, int]:
    """Joints between each link and the ground."""
    neighbours: dict[int, set[int]] = {}
    for joint in mechanism.joints:
        a, b = (joint.a.link, joint.b.link) if isinstance(joint, Revolute) else (joint.guide.link, joint.block.link)
        neighbours.setdefault(a, set()).add(b)
        neighbours.setdefault(b, set()).add(a)
    distances, front = {GROUND: 0}, [GROUND]
    for link in front:
        for other in sorted(neighbours.get(link, set()) - distances.keys()):
            distances[other] = distances[link] + 1
            front.append(other)
    return distances


def _relative(graph: ExpressionGraph, chain: list[Row], centre: int) -> list[Row]:
    """Rows p_k+1 - p_k as rows p_k - p_centre."""
    rows = []
    for k in range(len(chain) + 1):
        if k != centre:
            part, sign = (chain[centre:k], 1.0) if k > centre else (chain[k:centre], -1.0)
            rows.append(combine(graph, [(row, sign) for row in part]))
    return rows
