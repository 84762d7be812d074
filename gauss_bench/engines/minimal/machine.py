"""One equation as machine code: steps by the compiler's routines, and functions of a state, such as the motion of the links."""

from collections.abc import Callable
from math import ceil

import numpy as np

from gauss_bench.compiler.elimination.function import Function
from gauss_bench.compiler.machine.code import read_code
from gauss_bench.compiler.machine.graph import Graph, count_operations, inline
from gauss_bench.compiler.machine.native_code import Loaded, Single, Target
from gauss_bench.compiler.machine.rewrite import rewrite
from gauss_bench.compiler.machine.routine import Array as Rows
from gauss_bench.compiler.machine.routine import Compute, Load, Routine, Store
from gauss_bench.compiler.machine.schedule import order
from gauss_bench.compiler.machine.trigonometry import sincos
from gauss_bench.compiler.stepping.driver import count_before
from gauss_bench.compiler.stepping.programs import Course, integrate
from gauss_bench.compiler.stepping.rollout import adaptive, bodies, rollout
from gauss_bench.compiler.stepping.steps import REACHES
from gauss_bench.engines.minimal.equation import Equation
from gauss_bench.terms import Array

TARGET = Target("llvm", 1, True)


class Machine:
    """An equation compiled together with one integrator. A state y (2n,) has the program's q, then its v.

    Attributes:
        n: number of entries of the program's q.
        adaptive: whether the integrator chooses its own steps.
    """

    def __init__(self, equation: Equation, integrator: str):
        self.equation, self.n, self.adaptive = equation, equation.program.n, integrator == "dop853"
        code = read_code(equation.program, "none")
        if self.adaptive:
            self._adaptive = Loaded(lambda many: adaptive(code), TARGET)
            self._adaptive.call(1)  # compiles
        else:
            self._steps = Loaded(lambda many: rollout(bodies(code, integrator, REACHES[integrator]), many), TARGET)
            self._steps.call(1)  # compiles
        self._rooms: dict[int, Single] = {}

    def room(self, slots: int) -> Single:
        """Return the memory of a rollout with `slots` samples, allocated on the first call."""
        if slots not in self._rooms:
            self._rooms[slots] = Single(self._steps.codes[1], (2 * self.n, 0, slots * 2 * self.n, 3))
        return self._rooms[slots]

    def steps(self, y: Array, t: float, h: float, count: int, every: int) -> tuple[Array, int, Array]:
        """Take up to `count` steps of h [s] from y at time t [s], with a sample after each `every` steps.

        Return the samples (k, 2n), the number of valid steps and the state after them. A step is invalid if a dyad opens by less
        than its threshold; stepping ends before it. All results are views of memory that the next call overwrites.
        """
        slots = max(1, ceil(count / every))
        room = self.room(slots)
        start, _, samples, report = room.arrays
        start[:] = y
        room.numbers[:] = h, t
        room.counts[:3] = count, every, slots
        room.run()
        states = samples.reshape(slots, 2 * self.n)
        if report[1]:  # all steps were valid
            return states, count, states[-1]
        done = int(report[0])  # valid steps; `start` then holds the state after them
        return states[: count_before(done, every)], done, start

    def course(self, y: Array, times: Array, tolerances: tuple[float, float]) -> Course:
        """Integrate adaptively over the times, as far as the dyads are open wide enough."""
        return integrate(self._adaptive, y, np.zeros(0), times, tolerances)


def compile_function(function: Function) -> Callable[[Array], list[Array]]:
    """Compile a function (t, q, v, p) that depends on neither t nor p.

    Return a function of a state y (2n,) with the same results.
    """
    raw, n = Graph(), function.sizes[1]
    leaves = [raw.leaf(f"%y{k}") for k in range(2 * n)]
    results = inline(raw, function, ([raw.leaf("%t")], leaves[:n], leaves[n:], []), lambda x: sincos(raw, x))
    graph, roots = rewrite(raw, [x for row in results for x in row])
    values = order(graph, roots, {})
    load = Load("y", {graph.leaf(f"%y{k}"): k for k in range(2 * n)})
    arrays, steps = {"y": Rows(2 * n), "out": Rows(len(roots))}, (load, Compute(values), Store("out", roots))
    routine = Routine("evaluate", graph, arrays, (), (), steps, graph.all(True), count_operations(graph, values))
    loaded = Loaded(lambda many: routine, TARGET)
    loaded.call(1)  # compiles
    cuts = np.cumsum([len(row) for row in results])[:-1]

    def evaluate(y: Array) -> list[Array]:
        one = loaded.single(2 * n, len(roots))
        one.arrays[0][:] = y
        one.run()
        return np.split(one.arrays[1].copy(), cuts)

    return evaluate
