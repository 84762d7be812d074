"""Everything that closing a linkage at one sample needs, as a graph of machine arithmetic.

x are the unknown loop variables, u the known ones. Newton at the guess, with J z = -A at every iterate, moves x by z and rotates its
sines; sines at the guess come from nothing, so that no rounding is carried from sample to sample. With the next sample at u + g,

    one input      J d = -B,  J e = -bias(d),        x' = d u',  x'' = d u'' + e u'^2,     x + g (d + g e / 2)  is the next guess
    several        J x' = -B u',  J x'' = -B u'' - bias(x', u'),    the next guess likewise, with g for u' and nothing for u''

Leaves: %x0, %s0, %c0 ... iterate and sines of its angles, %X0 ... guess, %l0 ... the sample before, %u0, %w0, %b0 ... inputs with
their rates and second rates, %n0 ... the inputs at the next sample, %p0 ... open parameters.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from gauss_bench.kernels import trigonometry
from gauss_bench.kernels.closure_groups import Groups
from gauss_bench.kernels.closure_vectors import LoopExpressions
from gauss_bench.kernels.export import reachable
from gauss_bench.kernels.graph import Graph, Pair
from gauss_bench.kernels.node import Graph as NodeGraph
from gauss_bench.kernels.node import Node
from gauss_bench.kernels.parameters import Parameters
from gauss_bench.kernels.planar import Vector
from gauss_bench.kernels.sampling import typical_length
from gauss_bench.kinematics.loop_equations import LoopEquations
from gauss_bench.mechanism.model import Point
from gauss_bench.terms import Array

REACH = (
    0.0065  # [rad, lengths] norm of one correction: two terms of the rotation's series are exact so far, and no other assembly near
)
TURN = 0.3  # [rad, lengths] norm of the way to the guess: far less than lies between two assemblies

Outputs = Literal["states", "path"]


@dataclass(frozen=True, eq=False)
class ClosureProgram:
    """The nodes of one linkage.

    Attributes:
        angles: which unknowns are angles; known_angles: which inputs are.
        lengths: what a change of each unknown is measured by.
        size: [m] of the longest vector of a loop.
        residual: A by row.
        correction: z by unknown.
        guards: what must not change its sign nor fall below its threshold.
        advance: by unknown, from this sample to the guess at the next.
        outputs: q, v, a of all links, then x, y and rates and second rates of each point.
        n, points, parameters: coordinates of the linkage, points, open numbers.
    """

    name: str
    n: int
    points: int
    parameters: int
    inputs: int
    angles: tuple[bool, ...]
    known_angles: tuple[bool, ...]
    lengths: tuple[float, ...]
    size: float
    residual: list[Node]
    correction: list[Node]
    guards: list[tuple[Node, float]]
    advance: list[Node]
    outputs: list[Node]

    @property
    def unknowns(self) -> int:
        return len(self.angles)

    @property
    def thresholds(self) -> Array:
        return np.array([x for _, x in self.guards])

    @property
    def width(self) -> int:
        """Numbers stored at each sample."""
        return len(self.outputs)


def closure_program(equations: LoopEquations, parameters: Parameters, points: Sequence[Point], samples: Array) -> ClosureProgram:
    """The program of a linkage's loops, valued at states (k, TU + TK) of the loop variables.

    Raises:
        KernelError: loops that determine an unknown twice and another one not at all.
    """
    graph = NodeGraph(len(samples))
    loops = LoopExpressions(graph, equations, parameters, samples)
    rates = _Rates(loops)
    length = typical_length(equations.mechanism)
    w, b, g = (rates.given(letter) for letter in "wbg")
    advance = rates.step(g)
    v, a = rates.both(w, b)
    correction = rates.groups.solve([-loop.residual() for loop in loops.loops])
    unknown = len(equations.unknown)
    return ClosureProgram(
        name=equations.mechanism.name,
        n=equations.mechanism.n,
        points=len(points),
        parameters=len(parameters.names),
        inputs=len(equations.known),
        angles=tuple(map(bool, equations.is_angle[:unknown])),
        known_angles=tuple(map(bool, equations.is_angle[unknown:])),
        lengths=tuple(np.where(equations.is_angle[:unknown], 1.0, length).tolist()),
        size=max((loop.size() for loop in loops.loops), default=length),
        residual=[x for loop in loops.loops for x in (loop.residual().x, loop.residual().y)],
        correction=[correction.get(k, graph.constant(0.0)) for k in range(unknown)],
        guards=rates.groups.guards,
        advance=advance,
        outputs=_outputs(loops, v, a, points),
    )


class _Rates:
    """Rates and second rates of all loop variables for those of the inputs."""

    def __init__(self, loops: LoopExpressions):
        self.loops, self.graph = loops, loops.graph
        self.unknown = len(loops.equations.unknown)
        columns = [loop.columns() for loop in loops.loops]
        self.groups = Groups(
            self.graph, loops.equations.groups, [{k: c for k, c in x.items() if k < self.unknown} for x in columns]
        )
        self.known = [{k: c for k, c in x.items() if k >= self.unknown} for x in columns]
        self.one = len(loops.x) == self.unknown + 1

    def given(self, letter: str) -> list[Node]:
        """An input for each known variable."""
        values = np.random.default_rng(ord(letter)).uniform(0.5, 1.5, (self.graph.samples, len(self.loops.x) - self.unknown))
        return [self.graph.input(letter, j, values[:, j], 1.0) for j in range(values.shape[1])]

    def _solved(self, b: list[Vector], known: list[Node]) -> list[Node]:
        z = self.groups.solve(b)
        return [*(z.get(k, self.graph.constant(0.0)) for k in range(self.unknown)), *known]

    def first(self, speeds: list[Node]) -> list[Node]:
        """J x' = -B u'."""
        return self._solved([self._moved(l, speeds) for l in range(len(self.known))], speeds)

    def second(self, rates: list[Node], seconds: list[Node]) -> list[Node]:
        """J x'' = -B u'' - bias."""
        bias = [loop.bias(rates) for loop in self.loops.loops]
        return self._solved([self._moved(l, seconds) - w for l, w in enumerate(bias)], seconds)

    def _moved(self, l: int, speeds: list[Node]) -> Vector:
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
    found: list[Node] = []
    for level, values in (("at", loops.x), ("rate", v), ("second", a)):
        for i in links:
            centre: Vector = getattr(centres[i], level)
            found += [centre.x, centre.y, loops.link_angle(i, values, phase=level == "at")]
    for point in points:
        place = loops.arm(point.link, loops.local(point), None, v, a)
        place = place + centres[point.link] if point.link >= 0 else place
        found += [x for w in (place.at, place.rate, place.second) for x in (w.x, w.y)]
    return found


@dataclass(frozen=True, eq=False)
class Code:
    """A program in machine arithmetic.

    Attributes:
        start: sines and cosines of the guess's angles, by unknown.
        score: sum of squares of A.
        moved: by leaf of the iterate ("%x0", "%s0", "%c0" ...), its value after a correction.
        near: mask, the correction is short enough for that.
        turn: mask, the guess is not far from the sample before.
        guards: by guard, its value.
        guess: by unknown, at the next sample.
        outputs: the row to be stored.
    """

    graph: Graph
    start: dict[int, Pair]
    score: int
    moved: dict[str, int]
    near: int
    turn: int
    guards: list[int]
    guess: list[int]
    outputs: list[int]

    def roots(self) -> list[int]:
        """Everything that must be computed."""
        pairs = [x for pair in self.start.values() for x in pair]
        return [*pairs, self.score, *self.moved.values(), self.near, self.turn, *self.guards, *self.guess, *self.outputs]

    def replaced(self, graph: Graph, roots: list[int]) -> "Code":
        """The same code in another graph, for its roots there."""
        new = iter(roots)
        start = {k: (next(new), next(new)) for k in self.start}
        score, moved = next(new), {name: next(new) for name in self.moved}
        near, turn = next(new), next(new)
        guards, guess = [next(new) for _ in self.guards], [next(new) for _ in self.guess]
        return Code(graph, start, score, moved, near, turn, guards, guess, list(new))


def written(program: ClosureProgram, outputs: Outputs, library: bool = False) -> Code:
    """A program as code that stores states, or the unknowns x alone ("path"); with `library`, sines are left to the target."""
    g = Graph()

    def sincos(x: int) -> Pair:
        return (g.make("sin", x), g.make("cos", x)) if library else trigonometry.sincos(g, x)

    turning = [k for k, angle in enumerate(program.angles) if angle]
    x, guess, last = ([g.leaf(f"%{letter}{k}") for k in range(program.unknowns)] for letter in "xXl")
    u, following = ([g.leaf(f"%{letter}{j}") for j in range(program.inputs)] for letter in "un")
    pairs = {("x", k): (g.leaf(f"%s{k}"), g.leaf(f"%c{k}")) for k in turning}
    pairs |= {("u", j): sincos(u[j]) for j, angle in enumerate(program.known_angles) if angle}
    leaves = {("x", k): a for k, a in enumerate(x)} | {("u", j): a for j, a in enumerate(u)}
    leaves |= {("g", j): g.sub(b, a) for j, (a, b) in enumerate(zip(u, following, strict=True))}
    leaves |= {(letter, j): g.leaf(f"%{letter}{j}") for letter in "wb" for j in range(program.inputs)}
    leaves |= {("p", i): g.leaf(f"%p{i}") for i in range(program.parameters)}
    stored = program.outputs if outputs == "states" else []
    nodes = [*program.residual, *program.correction, *(x for x, _ in program.guards), *program.advance, *stored]
    value = lowered(g, nodes, leaves, pairs)
    z = [value(k) for k in program.correction]
    moved = {f"%x{k}": g.add(x[k], z[k]) for k in range(program.unknowns)}
    for k in turning:
        pair = sincos(moved[f"%x{k}"]) if library else trigonometry.rotated(g, pairs["x", k], z[k], REACH)
        moved |= {f"%s{k}": pair[0], f"%c{k}": pair[1]}
    scale = [g.const(1.0 / length) for length in program.lengths]
    way = [g.mul(c, g.sub(a, b)) for c, a, b in zip(scale, guess, last, strict=True)]
    return Code(
        g,
        {k: sincos(guess[k]) for k in turning},
        g.squares([value(k) for k in program.residual]),
        moved,
        _within(g, [g.mul(c, a) for c, a in zip(scale, z, strict=True)], REACH),
        _within(g, way, TURN),
        [value(k) for k, _ in program.guards],
        [g.add(a, value(k)) for a, k in zip(x, program.advance, strict=True)],
        [value(k) for k in stored] if stored else list(x),
    )


def _within(g: Graph, values: list[int], bound: float) -> int:
    """Mask where the norm of some values is at most a bound."""
    return g.make("le", g.squares(values), g.const(bound * bound))


def lowered(
    g: Graph, nodes: list[Node], leaves: dict[tuple[str, int], int], pairs: dict[tuple[str, int], Pair]
) -> Callable[[Node], int]:
    """Write nodes into a graph of machine arithmetic; `pairs` are the sines and cosines of inputs."""
    found: dict[int, int] = {}
    for node in reachable(nodes):
        if node.op == "CONST":
            found[node.index] = g.const(float(node.number or 0.0))
        elif node.op == "INPUT":
            found[node.index] = leaves[node.args]  # type: ignore[index]
        elif node.op in ("SIN", "COS"):
            found[node.index] = pairs[node.args[0].args][node.op == "COS"]
        else:
            found[node.index] = _lowered(g, node.op, [found[a.index] for a in node.args])
    return lambda node: found[node.index]


def _lowered(g: Graph, op: str, a: list[int]) -> int:
    match op:
        case "ADD":
            return g.add(*a)
        case "SUB":
            return g.sub(*a)
        case "MUL":
            return g.mul(*a)
        case "NEG":
            return g.neg(a[0])
        case "INV":
            return g.div(g.const(1.0), a[0])
    raise ValueError(f"no machine arithmetic for {op}")
