"""Everything that closing a linkage at one sample needs, as expressions.

x are the unknown loop variables, u the known ones with rates w and second rates b, and the next sample is at u + g:

    correction     J z = -A
    one input      J d = -B,  J e = -bias(d),     x' = d w,  x'' = d b + e w^2,     the next guess is x + g (d + g e / 2)
    several        J x' = -B w,  J x'' = -B b - bias(x', w);     the next guess likewise, with g for w and 0 for b

Inputs of the expressions: "x", "u", "w", "b", "g", and "p" for open parameters.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gauss_bench.compiler.elimination.loop_groups import Groups, Guard
from gauss_bench.compiler.equations.loops import LoopExpressions
from gauss_bench.compiler.equations.parameters import Parameters
from gauss_bench.compiler.equations.sampling import typical_length
from gauss_bench.compiler.expressions.node import Graph, Node
from gauss_bench.compiler.expressions.planar import Vector
from gauss_bench.kinematics.loop_equations import LoopEquations
from gauss_bench.mechanism.model import Point
from gauss_bench.terms import Array


@dataclass(frozen=True, eq=False)
class ClosureProgram:
    """The nodes of one linkage.

    Attributes:
        angles: which unknowns are angles; known_angles: which inputs are.
        lengths: what a change of each unknown is measured by.
        residual: A by row; square: [m^2] sum of the squared lengths of all vectors in it.
        correction: z by unknown.
        guards: what must not change its sign, and what its square must not fall below.
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
    residual: list[Node]
    square: Node
    correction: list[Node]
    guards: list[Guard]
    advance: list[Node]
    outputs: list[Node]

    @property
    def unknowns(self) -> int:
        return len(self.angles)

    @property
    def width(self) -> int:
        """Numbers stored at each sample."""
        return len(self.outputs)


def closure_program(equations: LoopEquations, parameters: Parameters, points: Sequence[Point], samples: Array) -> ClosureProgram:
    """The program of a linkage's loops, valued at states (k, TU + TK) of the loop variables.

    Raises:
        KernelError: loops that determine an unknown twice and another one not at all.
    """
    graph = Graph(len(samples))
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
        residual=[x for loop in loops.loops for x in (loop.residual().x, loop.residual().y)],
        square=graph.total(loop.square for loop in loops.loops),
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
