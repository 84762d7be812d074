"""Everything that closing a linkage at one sample needs, as expressions.

x are the unknown loop variables, u the known ones with rates w and second rates b, and the next sample is at u + g:

    correction     J z = -A
    one input      J d = -B,  J e = -bias(d),     x' = d w,  x'' = d b + e w^2,     the next guess is x + g (d + g e / 2)
    several        J x' = -B w,  J x'' = -B b - bias(x', w);     the next guess likewise, with g for w and 0 for b

Inputs of the expressions: "x", "u", "w", "b", "g", and "p" for open parameters.

J z = b of a linkage's loops in expressions, group by group (Assur groups: loops that only together determine their unknowns).

A loop has two rows, so pivots are taken two by two. With the columns c1, c2 of a loop and b on its right, Cramer's rule

    c1 z1 + c2 z2 = b,    z1 = (b x c2)/D,   z2 = (c1 x b)/D,   D = c1 x c2

divides by what vanishes where the dyad is stretched, and nowhere else: the code needs no other pivot and no second choice. In a
group of more loops the further columns of the pivot's loop are expressed by its two, c = alpha c1 + beta c2, and eliminated from
the other loops; which loop and columns go first is chosen so that D keeps its sign and stays large at the samples. The sign of D
names the assembly, and the product of a group's D is the determinant of its J.

A group with more equations than unknowns (a redundant loop) is solved by its normal equations C^T C z = C^T b: what is left over of
b vanishes where the loops close. Their condition is that of J squared, which costs rates digits but positions none.
Source: Golub and Van Loan, Matrix Computations (4th ed., 2013), sections 3.2 and 4.1 (block elimination, L D L^T) and 5.3 (normal
equations).
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Protocol

import numpy as np

from gauss_bench.compiler.elimination.function import Function, function
from gauss_bench.compiler.equations.links import open_parameters
from gauss_bench.compiler.equations.loops import LoopExpressions
from gauss_bench.compiler.equations.sampling import manifold_states, typical_length
from gauss_bench.compiler.errors import KernelError
from gauss_bench.compiler.expressions.node import ExpressionGraph, Node, Vector
from gauss_bench.kinematics.loop_equations import REGULAR, LoopEquations, LoopGroup
from gauss_bench.mechanism.coordinates import position, value
from gauss_bench.mechanism.model import LengthDriver, Mechanism, Point, Prismatic
from gauss_bench.terms import Array

SAMPLES = 48  # positions at which pivots are chosen
GOOD = 0.1  # sine of the angle between a pivot's columns at the worst sample: among such, the fewest operations decide

Columns = dict[int, Vector]  # of one loop, by unknown
Guard = tuple[Node, Node]  # D, and what D^2 must not fall below
LoopsAndUnknowns = tuple[list[int], list[int]]


class Solver(Protocol):
    """One factorised group."""

    def solve(self, b: dict[int, Vector]) -> dict[int, Node]:
        """z by unknown for b by loop; loops without b have none."""
        ...

    @property
    def guards(self) -> list[Guard]:
        """The divisors, with how large the square of each must be for rates to be exact to eight digits and more."""
        ...


@dataclass(frozen=True, eq=False)
class DyadPivot:
    """A loop, its two unknowns, their columns, D and 1/D, and the loop's other columns as (alpha, beta)."""

    loop: int
    unknowns: tuple[int, int]
    columns: tuple[Vector, Vector]
    D: Node
    inverse: Node
    others: dict[int, tuple[Node, Node]]

    def split(self, b: Vector) -> tuple[Node, Node]:
        """The parts of b along both columns."""
        c1, c2 = self.columns
        return b.cross(c2) * self.inverse, c1.cross(b) * self.inverse


def _pivot(loop: int, columns: Columns, unknowns: tuple[int, int]) -> DyadPivot:
    c1, c2 = (columns[k] for k in unknowns)
    D = c1.cross(c2)
    bare = DyadPivot(loop, unknowns, (c1, c2), D, D.graph.inverse(D), {})
    others = {k: bare.split(c) for k, c in columns.items() if k not in unknowns}
    return DyadPivot(loop, unknowns, (c1, c2), D, bare.inverse, others)


class Dyads:
    """A group with as many equations as unknowns: block elimination with pivots of two rows and columns."""

    def __init__(self, columns: dict[int, Columns]):
        self.columns = columns
        self.pivots: list[DyadPivot] = []
        self.eliminated: list[dict[int, tuple[Vector, Vector]]] = []
        left = dict(columns)
        while left:
            loop, unknowns = _best(left)
            pivot = _pivot(loop, left.pop(loop), unknowns)
            self.pivots.append(pivot)
            self.eliminated.append({m: _take(left[m], pivot) for m in left if set(unknowns) & left[m].keys()})
            left |= {m: _reduce(left[m], pivot, pair) for m, pair in self.eliminated[-1].items()}

    def solve(self, b: dict[int, Vector]) -> dict[int, Node]:
        b = dict(b)
        parts: list[tuple[Node, Node] | None] = []
        for pivot, eliminated in zip(self.pivots, self.eliminated, strict=True):
            if pivot.loop not in b:
                parts.append(None)
                continue
            p1, p2 = pivot.split(b[pivot.loop])
            parts.append((p1, p2))
            for m, (e1, e2) in eliminated.items():
                change = e1 * p1 + e2 * p2
                b[m] = b[m] - change if m in b else -change
        z: dict[int, Node] = {}
        for pivot, part in zip(reversed(self.pivots), reversed(parts), strict=True):
            known = [(pivot.others[k], z[k]) for k in pivot.others if k in z]
            for i, unknown in enumerate(pivot.unknowns):
                terms = [] if part is None else [part[i]]
                z[unknown] = pivot.D.graph.total([*terms, *(-(other[i] * x) for other, x in known)])
        return z

    @property
    def guards(self) -> list[Guard]:
        guards = []
        for p in self.pivots:
            c1, c2 = (self.columns[p.loop].get(k, c) for k, c in zip(p.unknowns, p.columns, strict=True))
            guards.append((p.D, c1.dot(c1) * c2.dot(c2) * REGULAR**2))
        return guards


def _take(columns: Columns, pivot: DyadPivot) -> tuple[Vector, Vector]:
    """The columns of another loop in a pivot's unknowns."""
    zero = pivot.D.graph.constant(0.0)
    first, second = (columns.get(k, Vector(zero, zero)) for k in pivot.unknowns)
    return first, second


def _reduce(columns: Columns, pivot: DyadPivot, pair: tuple[Vector, Vector]) -> Columns:
    """Another loop's columns without the pivot's unknowns."""
    reduced = {k: c for k, c in columns.items() if k not in pivot.unknowns}
    for k, (alpha, beta) in pivot.others.items():
        change = pair[0] * alpha + pair[1] * beta
        reduced[k] = reduced[k] - change if k in reduced else -change
    return {k: c for k, c in reduced.items() if not (c.x.zero and c.y.zero)}


def _best(left: dict[int, Columns]) -> tuple[int, tuple[int, int]]:
    """Loop and unknowns of the next pivot: steady in sign, then not small, then few other columns."""
    offers = []
    for loop, columns in left.items():
        for one, two in combinations(sorted(columns), 2):
            sine = _sines(columns[one], columns[two])
            worst = float(np.abs(sine).min())
            steady = bool((sine > 0).all() or (sine < 0).all())
            offers.append(((not steady, worst < GOOD, len(columns), -worst), loop, (one, two)))
    if not offers:
        raise KernelError("loops have fewer unknowns than equations in part, and more elsewhere")
    return min(offers)[1:]


def _values(c: Vector) -> Array:
    """Values (2, k) at the samples."""
    return np.array([c.x.at, c.y.at])[:, : c.x.graph.samples]


def _sizes(c: Vector) -> Array:
    return np.asarray(np.hypot(*_values(c)))


def _sines(a: Vector, b: Vector) -> Array:
    (ax, ay), (bx, by) = _values(a), _values(b)
    return np.asarray((ax * by - ay * bx) / np.maximum(_sizes(a) * _sizes(b), np.finfo(float).tiny))


class Redundant:
    """LoopSystem with more equations than unknowns: normal equations, C^T C = L D L^T, whose D is positive at regular positions."""

    def __init__(self, graph: ExpressionGraph, columns: dict[int, Columns], unknowns: Sequence[int]):
        self.graph, self.columns = graph, columns
        A = {(i, j): self._product(i, j) for i in unknowns for j in unknowns if i >= j}
        self.order: list[int] = []
        self.lower: dict[int, list[tuple[int, Node]]] = {}
        self.D: list[Node] = []
        left = list(unknowns)
        while left:
            k = min(left, key=lambda i: sum(not A[max(i, j), min(i, j)].zero for j in left))
            left.remove(k)
            below = {i: x for i in left if not (x := A[max(i, k), min(i, k)]).zero}
            inverse = graph.inverse(A[k, k])
            self.order.append(k)
            self.D.append(A[k, k])
            self.lower[k] = [(i, x * inverse) for i, x in below.items()]
            for i, factor in self.lower[k]:
                for j, x in below.items():
                    if i >= j:
                        A[i, j] = A[i, j] - factor * x

    def _product(self, i: int, j: int) -> Node:
        products = [columns[i].dot(columns[j]) for columns in self.columns.values() if i in columns and j in columns]
        return self.graph.total(x for x in products if not x.zero)

    def solve(self, b: dict[int, Vector]) -> dict[int, Node]:
        y = {i: [c[i].dot(b[l]) for l, c in self.columns.items() if i in c and l in b] for i in self.order}
        z: dict[int, Node] = {}
        for k in self.order:
            z[k] = self.graph.total(y[k])
            for i, factor in self.lower[k]:
                y[i].append(-(factor * z[k]))
        for k, D in zip(reversed(self.order), reversed(self.D), strict=True):
            known = [-(factor * z[i]) for i, factor in self.lower[k]]
            z[k] = self.graph.total([z[k] * self.graph.inverse(D), *known])
        return z

    @property
    def guards(self) -> list[Guard]:
        whole = {k: self._product(k, k) for k in self.order}
        return [(D, whole[k] * whole[k] * REGULAR**4) for k, D in zip(self.order, self.D, strict=True) if D.number is None]


class LoopSystem:
    """All groups, each solved with what those before it left.

    `columns` are those of the unknowns, by loop.
    """

    def __init__(self, graph: ExpressionGraph, groups: Sequence[LoopGroup], columns: Sequence[Columns]):
        self.graph, self.columns = graph, columns
        self.groups: list[tuple[tuple[int, ...], Solver | None]] = []
        solved: set[int] = set()
        for loops, unknowns in _merge([(sorted({row // 2 for row in g.rows}), sorted(g.columns)) for g in groups], columns):
            own = {l: {k: c for k, c in columns[l].items() if k not in solved} for l in loops}
            self.groups.append((tuple(loops), _solver(graph, own, unknowns)))
            solved |= set(unknowns)

    def solve(self, b: Sequence[Vector]) -> dict[int, Node]:
        """z by unknown for b by loop."""
        z: dict[int, Node] = {}
        for loops, solver in self.groups:
            if solver is not None:
                z |= solver.solve({l: self._remainder(b[l], self.columns[l], z) for l in loops})
        return z

    def _remainder(self, b: Vector, columns: Columns, z: dict[int, Node]) -> Vector:
        """b without the unknowns that are known by now."""
        known = [-(c * z[k]) for k, c in columns.items() if k in z]
        return Vector(self.graph.total([b.x, *(w.x for w in known)]), self.graph.total([b.y, *(w.y for w in known)]))

    @property
    def guards(self) -> list[Guard]:
        return [guard for _, solver in self.groups if solver is not None for guard in solver.guards]


def _merge(groups: list[LoopsAndUnknowns], columns: Sequence[Columns]) -> list[LoopsAndUnknowns]:
    """Groups with a redundant loop joined with all that it leans on: where one of its dyads is stretched, the others hold it."""
    joined: set[int] = set()
    for k, (loops, unknowns) in reversed(list(enumerate(groups))):
        if k in joined or len(unknowns) < 2 * len(loops):
            needed = {i for l in loops for i in columns[l]}
            joined |= {k} | {i for i, (_, own) in enumerate(groups[:k]) if needed & set(own)}
    if not joined:
        return groups
    loops = sorted(l for k in joined for l in groups[k][0])
    unknowns = sorted(i for k in joined for i in groups[k][1])
    return [(loops, unknowns), *(group for k, group in enumerate(groups) if k not in joined)]


def _solver(graph: ExpressionGraph, columns: dict[int, Columns], unknowns: Sequence[int]) -> Solver | None:
    """The solver of a group, or None where nothing is left to solve."""
    if len(unknowns) > 2 * len(columns):
        raise KernelError("loops leave an unknown undetermined, and others determined twice")
    if not unknowns:
        return None
    return Dyads(columns) if len(unknowns) == 2 * len(columns) else Redundant(graph, columns, unknowns)


@dataclass(frozen=True, eq=False)
class ClosureProgram:
    """Everything one linkage is closed with.

    Attributes:
        angles: which unknowns are angles; known_angles: which inputs are.
        lengths: what a change of each unknown is measured by.
        states: (x, u, w, b, g, p) -> A by row; (1,) sum of the squared lengths of all vectors in it [m^2]; z by unknown; guards,
        which
            must not change their signs; what their squares must not fall below; by unknown, the way from this sample to the guess
            at the next; q, v, a of all links, then x, y and rates and second rates of each point.
        path: the same without the last.
        n, points: coordinates of the linkage, points. open_names, values: of the open numbers, as in the file.
    """

    name: str
    n: int
    points: int
    open_names: tuple[str, ...]
    values: Array
    inputs: int
    angles: tuple[bool, ...]
    known_angles: tuple[bool, ...]
    lengths: tuple[float, ...]
    states: Function
    path: Function

    @property
    def parameters(self) -> int:
        """Open numbers."""
        return len(self.open_names)

    @property
    def unknowns(self) -> int:
        return len(self.angles)

    @property
    def guards(self) -> int:
        return len(self.states.outputs[3])

    @property
    def width(self) -> int:
        """Numbers stored at each sample."""
        return len(self.states.outputs[-1])


def closure_program(equations: LoopEquations, open_names: tuple[str, ...], points: Sequence[Point]) -> ClosureProgram:
    """The program of a linkage's loops.

    Raises:
        KernelError: loops that determine an unknown twice and another one not at all, or a name the mechanism does not have.
    """
    mechanism, parameters = equations.mechanism, open_parameters(equations.mechanism, open_names)
    free = replace(mechanism, drivers=()) if mechanism.dof == 1 else mechanism  # positions all over the motion
    samples = np.array([loop_values(equations, mechanism, q) for q in manifold_states(free, SAMPLES).q])
    graph = ExpressionGraph(len(samples))
    loops = LoopExpressions(graph, equations, parameters, samples)
    rates = _Rates(loops)
    length = typical_length(equations.mechanism)
    w, b, g = (rates.given(letter) for letter in "wbg")
    advance = rates.step(g)
    v, a = rates.both(w, b)
    correction = rates.groups.solve([-loop.residual() for loop in loops.loops])
    unknown = len(equations.unknown)
    residual = [x for loop in loops.loops for x in (loop.residual().x, loop.residual().y)]
    square = graph.total(loop.square for loop in loops.loops)
    z = [correction.get(k, graph.constant(0.0)) for k in range(unknown)]
    guards = rates.groups.guards
    stored = _outputs(loops, v, a, points)
    sizes = (unknown, *([len(equations.known)] * 4), len(parameters.names))
    inputs = list(zip("xuwbgp", sizes, strict=True))
    results = [residual, [square], z, [x for x, _ in guards], [least for _, least in guards], advance]
    return ClosureProgram(
        name=equations.mechanism.name,
        n=equations.mechanism.n,
        points=len(points),
        open_names=parameters.names,
        values=parameters.values,
        inputs=len(equations.known),
        angles=tuple(map(bool, equations.is_angle[:unknown])),
        known_angles=tuple(map(bool, equations.is_angle[unknown:])),
        lengths=tuple(np.where(equations.is_angle[:unknown], 1.0, length).tolist()),
        states=function(inputs, [*results, stored], None),
        path=function(inputs, [*results, []], None),
    )


class _Rates:
    """Rates and second rates of all loop variables for those of the inputs."""

    def __init__(self, loops: LoopExpressions):
        self.loops, self.graph = loops, loops.graph
        self.unknown = len(loops.equations.unknown)
        columns = [loop.columns() for loop in loops.loops]
        self.groups = LoopSystem(
            self.graph, loops.equations.groups, [{k: c for k, c in x.items() if k < self.unknown} for x in columns]
        )
        self.known = [{k: c for k, c in x.items() if k >= self.unknown} for x in columns]
        self.one = len(loops.x) == self.unknown + 1

    def given(self, letter: str) -> list[Node]:
        """An input for each known variable."""
        values = np.random.default_rng(ord(letter)).uniform(0.5, 1.5, (self.graph.samples, len(self.loops.x) - self.unknown))
        return [self.graph.input(letter, j, values[:, j], 1.0) for j in range(values.shape[1])]

    def _solve(self, b: list[Vector], known: list[Node]) -> list[Node]:
        z = self.groups.solve(b)
        return [*(z.get(k, self.graph.constant(0.0)) for k in range(self.unknown)), *known]

    def first(self, speeds: list[Node]) -> list[Node]:
        """J x' = -B u'."""
        return self._solve([self._move(l, speeds) for l in range(len(self.known))], speeds)

    def second(self, rates: list[Node], seconds: list[Node]) -> list[Node]:
        """J x'' = -B u'' - bias."""
        bias = [loop.bias(rates) for loop in self.loops.loops]
        return self._solve([self._move(l, seconds) - w for l, w in enumerate(bias)], seconds)

    def _move(self, l: int, speeds: list[Node]) -> Vector:
        """-B of a loop times speeds."""
        parts = [-(c * speeds[k - self.unknown]) for k, c in self.known[l].items()]
        return Vector(self.graph.total([w.x for w in parts]), self.graph.total([w.y for w in parts]))

    def _shape(self) -> tuple[list[Node], list[Node]]:
        """d and e of one input."""
        d = self.first([self.graph.constant(1.0)])
        return d, self.second(d, [self.graph.constant(0.0)])

    def step(self, g: list[Node]) -> list[Node]:
        """From x to the guess at u + g, by unknown."""
        if self.one:
            d, e = self._shape()
            return [g[0] * (d[k] + g[0] * (e[k] * 0.5)) for k in range(self.unknown)]
        slope = self.first(g)
        bend = self.second(slope, [self.graph.constant(0.0)] * len(g))
        return [slope[k] + bend[k] * 0.5 for k in range(self.unknown)]

    def both(self, w: list[Node], b: list[Node]) -> tuple[list[Node], list[Node]]:
        """x' and x''."""
        if self.one:
            d, e = self._shape()
            square = w[0] * w[0]
            return [x * w[0] for x in d], [x * b[0] + y * square for x, y in zip(d, e, strict=True)]
        rates = self.first(w)
        return rates, self.second(rates, b)


def _outputs(loops: LoopExpressions, v: list[Node], a: list[Node], points: Sequence[Point]) -> list[Node]:
    """q, v, a of all links, then x, y, rates and second rates of each point."""
    centres, links = loops.centres(v, a), range(len(loops.equations.mechanism.links))
    rows: list[Node] = []
    for level, values in (("at", loops.x), ("rate", v), ("second", a)):
        for i in links:
            centre: Vector = getattr(centres[i], level)
            rows += [centre.x, centre.y, loops.link_angle(i, values, phase=level == "at")]
    for point in points:
        place = loops.arm(point.link, loops.local(point), None, v, a)
        place = place + centres[point.link] if point.link >= 0 else place
        rows += [x for w in (place.at, place.rate, place.second) for x in (w.x, w.y)]
    return rows


def loop_values(equations: LoopEquations, mechanism: Mechanism, q: Array) -> Array:
    """x (TU + TK,) of an assembled state q (n,) of a mechanism with these loops, whatever its dimensions."""
    values: dict[str | int, float] = {i: float(theta) for i, theta in enumerate(q[2::3])}
    for joint in mechanism.joints:
        if isinstance(joint, Prismatic):
            values[joint.name] = float(value(joint.motion, q))
    names = [bar.name for bar in equations.bars]
    for bar in (d for d in mechanism.drivers if isinstance(d, LengthDriver) and d.name in names):
        x, y = position(q, bar.b) - position(q, bar.a)
        values[len(mechanism.links) + names.index(bar.name)] = float(np.arctan2(y, x))
        values[bar.name] = float(np.hypot(x, y))
    return np.array([values[key] for key in equations.column])
