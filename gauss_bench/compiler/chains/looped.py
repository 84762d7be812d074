"""Large linkages: their functions as routines that work in memory, and programs of them as they run.

Straight-line code is the fastest for linkages of a few loops. It outgrows the instruction cache at about a thousand operations, and
takes half a minute to generate and compile at thirty thousand. Here equal operations of different links are lanes of one loop,
found in the expressions themselves, so that no linkage is told to be a chain; one without any repetition merely gathers its
operands.

    accelerate(y, p, work, t, out)
    rollout(y, p, work, samples, report; h, t0; n, every, slots)

as in `stepping/rollout.py`, with memory to work in (`machine/loops.py`). With the stage at x, u the step is that of
`stepping/steps.py`, looped over its stages:

    a = a(t, x, u),   X += w u,   U += w a,   x = q + c u,   u = v + c a;      q' = q + h/6 X,   v' = v + h/6 U

Projection follows the last stage: q by Newton's chord at the uncorrected q', as long as some correction is not short, then v with
the Jacobian at the corrected one. Where rows are redundant and nothing projects, that is done every so many steps.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence

import numpy as np

from gauss_bench.compiler.machine.graph import (
    MASKS,
    Array,
    Graph,
    Load,
    Loop,
    Over,
    Places,
    Routine,
    Statement,
    Store,
)
from gauss_bench.compiler.machine.loops import STAGES, WORK, LoopedFunction, LoopedProgram
from gauss_bench.compiler.machine.native_code import Flags, Loaded, Target, in_plain_c
from gauss_bench.compiler.stepping.programs import Evaluator, Stepper
from gauss_bench.compiler.stepping.rollout import Body, Carried, rollout
from gauss_bench.compiler.stepping.steps import FINITE, LAST_CORRECTION, order_eight
from gauss_bench.terms import Array as Floats

CORRECTIONS = 4  # of the positions at most, as in the exact variant of `steps.py`


Formula = Callable[[Graph, list[int]], Sequence[int]]


class InMemory:
    """Memory access of both routines; with `library`, sines are left to the target's own functions."""

    def __init__(self, program: LoopedProgram, library: bool):
        self.program, self.layout, self.library, self.graph = program, program.layout, library, Graph()
        self.n = program.n
        self.arrays: Mapping[str, Array] = {"p": Array(program.layout.parameters), WORK: Array(program.size, scratch=True)}
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

    def sum_up(self, name: str, first: int, count: int, leaf: str, square: bool) -> list[Statement]:
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


class MemoryBody(InMemory, Body):
    """A step as a body of `stepping/rollout.py`."""

    def __init__(self, program: LoopedProgram, integrator: str, library: bool):
        super().__init__(program, library)
        g, self.rows, self.operations = self.graph, 2 * self.n, 0
        self.carried: Carried = {}
        self.entry: list[Statement] = self.entered(("q_begin", "v_begin"))
        t, h = g.leaf("%t"), g.leaf("%h")
        end = g.add(t, h)
        steps, held = {"rk4": self._rk4, "semi_implicit_euler": self._euler, "dop853_fixed": self._dop853}[integrator](t, h)
        settled, kept = self._settle(end) if program.position and program.velocity else ([], [])
        if not program.source.projected:
            self.settling, settled, kept = settled, [], []
        finite = self.sum_up("v", 0, 3 * self.layout.stride, "%speeds", square=False)
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

    def _dop853(self, t: int, h: int) -> tuple[list[Statement], int]:
        """All stages by one loop: accelerations so far, and the weights of the next stage, or of the end of the step."""
        g, j, held = self.graph, self.graph.count("%j"), self.graph.make("mask", payload="%held")
        s, lanes, begin = STAGES, 3 * self.layout.stride, self._whole("q_begin", "v_begin")
        first, weights = (self.layout.starts[name] for name in ("stages", "weights"))
        method = order_eight()
        rows = [[c, *a, *b] for c, a, b in zip(method.c, method.A, method.twice, strict=True)]
        rows.append([1.0, *method.b, *method.end])
        numbers, places = Graph(), Places(WORK, tuple(range(weights, weights + len(rows) * (2 * s + 1))))
        w = numbers.leaf("%w")
        flat = tuple(x for row in rows for x in row)
        self.entry = [*self.entry, Over(len(flat), numbers, [w], {w: flat}, stores=[(w, places)])]
        work, holds = self.evaluated(self.program.acceleration, "%guards")
        following, time = g.make("sum", j, g.whole(1)), g.leaf("%time")
        node, *others = (g.leaf(f"%weight{k}") for k in range(2 * s + 1))
        given = [g.mul(h, node), *(g.mul(h, x) for x in others[:s]), *(g.mul(g.mul(h, h), x) for x in others[s:])]
        stages = [Places(WORK, tuple(range(at, at + lanes)), room=True) for at in range(first, first + s * lanes, lanes)]
        store = [Places(WORK, stages[0].by_lane, room=True, start=g.make("times", j, payload=lanes))]

        def formula(g: Graph, x: list[int]) -> list[int]:
            a, (c, *factors) = x[2 : 2 + s], x[2 + s :]
            q, v = g.fma(c, x[1], x[0]), x[1]
            for k in range(s):
                q, v = g.fma(factors[s + k], a[k], q), g.fma(factors[k], a[k], v)
            return [q, v]

        after = [
            self.at_time(time, "t"),
            *work,
            self.copied(lanes, self._whole("out"), store),
            Load(WORK, {x: weights + k for k, x in enumerate([node, *others])}, g.make("times", following, payload=2 * s + 1)),
            self.each(lanes, [*begin, *stages], self._whole("q", "v"), formula, *given),
        ]
        carried: Carried = {
            time: (t, g.add(t, g.mul(h, node))),
            held: (g.all(True), g.both([held, holds])),
            j: (g.whole(0), following),
        }
        start = self.copied(lanes, begin, self._whole("q", "v"))
        return [start, Loop(carried, [], g.make("below", j, g.whole(s)), after)], held

    def _euler(self, t: int, h: int) -> tuple[list[Statement], int]:
        lanes, begin = 3 * self.layout.stride, self._whole("q_begin", "v_begin")
        work, holds = self.evaluated(self.program.acceleration, "%guards")

        def formula(g: Graph, x: list[int]) -> list[int]:
            faster = g.fma(x[3], x[2], x[1])
            return [g.fma(x[3], faster, x[0]), faster]

        finish = self.each(lanes, [*begin, *self._whole("out")], self._whole("q", "v"), formula, h)
        return [self.copied(lanes, begin, self._whole("q", "v")), self.at_time(t, "t"), *work, finish], holds

    def _settle(self, t: int) -> tuple[list[Statement], list[int]]:
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

        body = [*moved, add("q_new"), *self.sum_up("out", *angles, "%moved", square=True)]
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


class LoopedPrograms:
    """The looped programs of one mechanism: the best first, further ones when they are asked for."""

    def __init__(self, programs: Iterator[LoopedProgram], target: Target):
        self.target, self._more = target, programs
        self.codes: list[LoopedProgram] = []
        self.evaluators: list[Evaluator] = []
        self.runners: dict[tuple[int, str], Stepper] = {}
        self.further()
        source = self.codes[0].source
        self.n, self.values, self.dropped = self.codes[0].n, source.values, source.dropped

    def __len__(self) -> int:
        return len(self.codes)

    def further(self) -> bool:
        """Generate one more program; False where there is none."""
        program = next(self._more, None)
        if program is None:
            return False
        self.add(program)
        return True

    def add(self, code: LoopedProgram) -> None:
        self.codes.append(code)
        self.evaluators.append(Evaluator(Loaded(lambda many: accelerate(code, library=False), self.target), (code.size,)))

    def runner(self, k: int, integrator: str) -> Stepper:
        """Steps by one program."""
        if (k, integrator) not in self.runners:
            code = self.codes[k]
            made = Loaded(lambda many: rollout([MemoryBody(code, integrator, library=False)], many), self.target)
            self.runners[k, integrator] = Stepper(made, work=(code.size,))
        return self.runners[k, integrator]

    def margin(self, k: int, t: float, state: Floats, p: Floats) -> float:
        """Infinite where all guards of a program hold at a state, else 0."""
        return np.inf if self.evaluators[k].one(t, state[: self.n], state[self.n :], p) is not None else 0.0

    def settled(self, k: int, t: float, state: Floats, p: Floats) -> None:
        """None: states are taken back onto the constraints within steps alone."""

    def accelerations(self, k: int, t: Floats, q: Floats, v: Floats, p: Floats) -> tuple[Floats, Flags]:
        """Accelerations (k, n) by one program, and where it serves (k,)."""
        return self.evaluators[k].accelerations(t, np.concatenate([q, v], axis=1), p)

    def acceleration(self, t: float, q: Floats, v: Floats, p: Floats) -> Floats | None:
        """Accelerations (n,) at one state by the shortest way, or None where another must be gone."""
        return self.evaluators[0].one(t, q, v, p)

    def multipliers(self, k: int, t: Floats, q: Floats, v: Floats, p: Floats) -> tuple[Floats, Flags]:
        """None: these programs compute accelerations and corrections alone."""
        return np.zeros((len(q), 0)), np.zeros(len(q), bool)

    @property
    def partitions(self) -> tuple[tuple[int, ...], ...]:
        """Independent coordinates of every program generated so far; () for Lagrange's."""
        return tuple(code.source.plan.independent for code in self.codes)

    def c_source(self, integrator: str) -> str:
        """The best program in plain C."""
        first = self.codes[0]
        return in_plain_c(accelerate(first, library=True), rollout([MemoryBody(first, integrator, library=True)], many=False))

    def loaded(self) -> list[tuple[float, bool]]:
        """Seconds to compile or load each piece of machine code so far, and whether it was in the cache."""
        running: list[Evaluator | Stepper] = [*self.evaluators, *self.runners.values()]
        codes = [code for x in running for code in x.loaded.codes.values()]
        return [(code.seconds, code.from_cache) for code in codes]

    def prepare(self, integrator: str, many: bool, extended: bool = True) -> None:
        """Compile what steps of one state, or of many, may need."""
        self.runner(0, integrator).loaded.call(self.target.lanes if many else 1)
