"""The functions of a large linkage as routines: its accelerations, and a step of an integrator whose state stands in memory.

    accelerate(y, p, work, t, out)
    rollout(y, p, work, samples, report; h, t0; n, every, slots)

as in `stepping/rollout.py`, with memory to work in (`machine/loops.py`). With the stage at x, u the step is that of
`stepping/steps.py`, looped over its stages:

    a = a(t, x, u),   X += w u,   U += w a,   x = q + c u,   u = v + c a;      q' = q + h/6 X,   v' = v + h/6 U

Projection follows the last stage: q by Newton's chord at the uncorrected q', as long as any correction is not short, then v with the
Jacobian at the corrected one.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from gauss_bench.compiler.elimination.rounds import RoundsProgram
from gauss_bench.compiler.machine.graph import MASKS, Graph
from gauss_bench.compiler.machine.loops import WORK, Layout, LoopedFunction, looped
from gauss_bench.compiler.machine.routine import Array, Load, Loop, Over, Places, Routine, Statement, Store
from gauss_bench.compiler.stepping.rollout import Carried
from gauss_bench.compiler.stepping.steps import FINITE, LAST_CORRECTION

CORRECTIONS = 4  # of the positions at most, as in the exact variant of `steps.py`


@dataclass(frozen=True, eq=False)
class LoopedProgram:
    """The functions of one program as loops that share their memory; `acceleration` is what is stepped, with Baumgarte's terms."""

    source: RoundsProgram
    layout: Layout
    plain: LoopedFunction
    acceleration: LoopedFunction
    position: LoopedFunction | None
    velocity: LoopedFunction | None

    @property
    def n(self) -> int:
        return 3 * self.layout.links

    @property
    def size(self) -> int:
        """Elements of memory."""
        made = (self.plain, self.acceleration, self.position, self.velocity)
        return max(f.memory.size for f in made if f is not None)


def looped_program(source: RoundsProgram) -> LoopedProgram:
    """The loops of a program."""
    layout = Layout(len(source.acceleration.function.outputs[0]) // 3, len(source.parameters))
    plain = looped(source.acceleration, layout)
    more = (source.stabilized, source.position, source.velocity)
    stabilized, position, velocity = (None if f is None else looped(f, layout) for f in more)
    return LoopedProgram(source, layout, plain, stabilized or plain, position, velocity)


Formula = Callable[[Graph, list[int]], Sequence[int]]


class InMemory:
    """What both routines do with memory; with `library`, sines are left to the target's own functions."""

    def __init__(self, program: LoopedProgram, library: bool):
        self.program, self.layout, self.library, self.graph = program, program.layout, library, Graph()
        self.n = program.n
        self.arrays = {"p": Array(program.layout.parameters), WORK: Array(program.size, scratch=True)}
        self.state = [Places("y", tuple(range(k, k + self.n))) for k in (0, self.n)]

    def each(self, lanes: int, loads: Sequence[Places], stores: Sequence[Places], formula: Formula, *given: int) -> Over:
        """A formula of the elements of some arrays, and of values given."""
        g = Graph()
        leaves = [g.leaf(f"%{k}") for k in range(len(loads))]
        kinds = ["mask" if self.graph.operation[x] in MASKS else "leaf" for x in given]
        more = [g.make(kind, payload=f"%g{k}") for k, kind in enumerate(kinds)]
        results = formula(g, [*leaves, *more])
        pairs = list(zip(results, stores, strict=True))
        return Over(lanes, g, results, dict(zip(leaves, loads, strict=True)), dict(zip(more, given, strict=True)), pairs)

    def summed(self, name: str, first: int, count: int, leaf: str, square: bool) -> list[Statement]:
        """The sum of neighbouring elements, or of their squares, as a leaf."""
        g, at = Graph(), self.layout.starts[name] + first
        x, spare = g.leaf("%x"), self.program.size - 1
        value = g.mul(x, x) if square else x
        loads = {x: Places(WORK, tuple(range(at, at + count)), room=True)}
        return [Over(count, g, [value], loads, sums=[(value, Places(WORK, (spare,)))]), Load(WORK, {self.graph.leaf(leaf): spare})]

    def copied(self, lanes: int, loads: Sequence[Places], stores: Sequence[Places]) -> Over:
        return self.each(lanes, loads, stores, lambda g, x: x)

    def entered(self, names: Sequence[str]) -> list[Statement]:
        """State and parameters into memory."""
        into = [self.layout.places(name) for name in names]
        count, start = self.layout.parameters, self.layout.starts["p"]
        numbers = [Places("p", tuple(range(count)))], [Places(WORK, tuple(range(start, start + count)))]
        return [self.copied(self.n, self.state, into), *([self.copied(count, *numbers)] if count else [])]

    def at_time(self, t: int, *names: str) -> Over:
        places = [Places(WORK, (self.layout.starts[name],)) for name in names]
        return self.each(1, [], places, lambda g, x: x * len(places), t)

    def evaluated(self, function: LoopedFunction, leaf: str) -> tuple[list[Statement], int]:
        """Statements, and the mask where the guards hold; `leaf` names their number."""
        g, guards = self.graph, self.graph.leaf(leaf)
        load = Load(WORK, {guards: self.layout.place("out", self.n)})
        return [*function.statements(self.library), load], g.make("le", g.const(float(function.guards)), guards)


def accelerate(program: LoopedProgram, library: bool) -> Routine:
    """The routine that evaluates accelerations."""
    m = InMemory(program, library)
    g, t = m.graph, m.graph.leaf("%t")
    work, holds = m.evaluated(program.plain, "%guards")
    out = m.copied(m.n, [m.layout.places("out")], [Places("out", tuple(range(m.n)))])
    body = [*m.entered(("q", "v")), Load("t", {t: 0}), m.at_time(t, "t"), *work, out, Store("out", [g.flag(holds)], g.whole(m.n))]
    arrays = {"y": Array(2 * m.n), **m.arrays, "t": Array(1), "out": Array(m.n + 1)}
    return Routine("accelerate", g, arrays, (), (), body, holds, 0)


class MemoryBody(InMemory):
    """A step as a body of `stepping/rollout.py`."""

    def __init__(self, program: LoopedProgram, integrator: str, library: bool):
        super().__init__(program, library)
        g, self.rows, self.operations = self.graph, 2 * self.n, 0
        self.carried: Carried = {}
        self.entry = self.entered(("q_begin", "v_begin"))
        t, h = g.leaf("%t"), g.leaf("%h")
        end = g.add(t, h)
        steps, held = self._rk4(t, h) if integrator == "rk4" else self._euler(t, h)
        settled, kept = self._settled(end) if program.position and program.velocity else ([], [])
        finite = self.summed("v", 0, 3 * self.layout.stride, "%speeds", square=False)
        self.statements: list[Statement] = [*steps, *settled, *finite]
        self.regular, self.regular_out = g.both([held, *kept[:2]]), g.all(True)
        self.within = g.both([g.make("le", g.abs(g.leaf("%speeds")), g.const(FINITE)), *kept[2:]])

    def _whole(self, *names: str) -> list[Places]:
        return [self.layout.whole(name) for name in names]

    def _rk4(self, t: int, h: int) -> tuple[list[Statement], int]:
        g, lanes, j, held = self.graph, 3 * self.layout.stride, self.graph.count("%j"), self.graph.make("mask", payload="%held")
        way, weight, time = (g.leaf(f"%{x}") for x in ("way", "weight", "time"))
        half, one, two = g.mul(g.const(0.5), h), g.const(1.0), g.const(2.0)
        early, third = (g.make("everywhere", x) for x in (g.make("below", j, g.whole(1)), g.make("same", j, g.whole(2))))
        work, holds = self.evaluated(self.program.acceleration, "%guards")
        carried: Carried = {
            way: (half, g.make("select", early, half, h)),
            weight: (one, g.make("select", third, one, two)),
            time: (t, g.add(t, way)),
            held: (g.all(True), g.both([held, holds])),
            j: (g.whole(0), g.make("sum", j, g.whole(1))),
        }
        advance = self.each(
            lanes,
            self._whole("v", "out", "q_begin", "v_begin", "q_sum", "v_sum"),
            self._whole("q", "v", "q_sum", "v_sum"),
            lambda g, x: [g.fma(x[6], x[0], x[2]), g.fma(x[6], x[1], x[3]), g.fma(x[7], x[0], x[4]), g.fma(x[7], x[1], x[5])],
            way,
            weight,
        )
        begin = self._whole("q_begin", "v_begin")
        start = self.each(lanes, begin, self._whole("q", "v", "q_sum", "v_sum"), lambda g, x: [*x, g.const(0.0), g.const(0.0)])
        stages = Loop(carried, [], g.make("below", j, g.whole(4)), [self.at_time(time, "t"), *work, advance])
        finish = self.each(
            lanes,
            [*begin, *self._whole("q_sum", "v_sum")],
            self._whole("q", "v"),
            lambda g, x: [g.fma(x[4], x[2], x[0]), g.fma(x[4], x[3], x[1])],
            g.div(h, g.const(6.0)),
        )
        return [start, stages, finish], held

    def _euler(self, t: int, h: int) -> tuple[list[Statement], int]:
        lanes, begin = 3 * self.layout.stride, self._whole("q_begin", "v_begin")
        work, holds = self.evaluated(self.program.acceleration, "%guards")

        def formula(g: Graph, x: list[int]) -> list[int]:
            faster = g.fma(x[3], x[2], x[1])
            return [g.fma(x[3], faster, x[0]), faster]

        finish = self.each(lanes, [*begin, *self._whole("out")], self._whole("q", "v"), formula, h)
        return [self.copied(lanes, begin, self._whole("q", "v")), self.at_time(t, "t"), *work, finish], holds

    def _settled(self, t: int) -> tuple[list[Statement], list[int]]:
        """Positions and velocities onto the constraints; masks of the guards, and of short last corrections."""
        g, lanes, j, held = self.graph, 3 * self.layout.stride, self.graph.count("%c"), self.graph.make("mask", payload="%placed")
        assert self.program.position is not None
        assert self.program.velocity is not None
        moved, at_q = self.evaluated(self.program.position, "%guards_q")
        turned, at_v = self.evaluated(self.program.velocity, "%guards_v")
        angles = (2 * self.layout.stride, self.layout.stride)
        short = g.make("le", g.leaf("%moved"), g.const(LAST_CORRECTION**2))
        again = g.make("also", g.make("any", g.make("not", short)), g.make("below", j, g.whole(CORRECTIONS - 1)))
        carried: Carried = {held: (g.all(True), g.both([held, at_q])), j: (g.whole(0), g.make("sum", j, g.whole(1)))}

        def add(name: str) -> Over:
            return self.each(lanes, self._whole(name, "out"), self._whole(name), lambda g, x: [g.add(*x)])

        body = [*moved, add("q_new"), *self.summed("out", *angles, "%moved", square=True)]
        begin = [self.copied(lanes, self._whole("q"), self._whole("q_new")), self.at_time(t, "t", "t_new")]
        end = [self.copied(lanes, self._whole("q_new"), self._whole("q")), *turned, add("v")]
        return [*begin, Loop(carried, body, again), *end], [g.both([held, at_q]), at_v, short]

    def kept(self, alive: int) -> Sequence[Statement]:
        new = self._whole("q", "v", "q_begin", "v_begin")
        return [
            self.each(
                3 * self.layout.stride,
                new,
                new[2:],
                lambda g, x: [g.make("select", x[4], x[0], x[2]), g.make("select", x[4], x[1], x[3])],
                alive,
            )
        ]

    def _out(self, array: str, start: int | None) -> list[Statement]:
        into = [Places(array, p.by_lane, start=start) for p in self.state]
        return [self.copied(self.n, [self.layout.places(x) for x in ("q_begin", "v_begin")], into)]

    def sampled(self, start: int) -> Sequence[Statement]:
        return self._out("samples", start)

    def ended(self, complete: int) -> Sequence[Statement]:
        return self._out("y", None)
