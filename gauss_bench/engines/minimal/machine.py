"""The machine code of one equation of motion: routines that take steps, and functions of a state such as the links' motion."""

from collections.abc import Callable
from functools import cached_property
from math import ceil

import numpy as np

from gauss_bench.compiler.machine.code import Code
from gauss_bench.compiler.machine.graph import Graph, inline
from gauss_bench.compiler.machine.native_code import Loaded, Single, Target
from gauss_bench.compiler.machine.trigonometry import sincos
from gauss_bench.compiler.stepping.driver import count_before
from gauss_bench.compiler.stepping.programs import Course, integrate
from gauss_bench.compiler.stepping.rollout import adaptive, bodies, evaluation, rollout
from gauss_bench.compiler.stepping.steps import REACHES
from gauss_bench.engines.minimal.equation import Equation
from gauss_bench.terms import Array

TARGET = Target("llvm", 1, True)  # by LLVM, for one trajectory at a time, stored on disk


class Machine:
    """An equation of motion compiled together with one integrator.

    A state y (2n,) holds the coordinates q (n,) of the equation of motion (the independent one, then the angles integrated with
    it), followed by their rates v (n,).
    """

    def __init__(self, equation: Equation, integrator: str):
        """Compile the code that takes steps; `many` tells whether `Loaded` asks for code for several trajectories at once."""
        self.equation, self.n, self.is_adaptive = equation, equation.program.n, integrator == "dop853"
        code = Code(equation.program, "none")  # "none": without stabilisation of constraints
        if self.is_adaptive:
            self._code = Loaded(lambda many: adaptive(code), TARGET)
        else:
            self._code = Loaded(lambda many: rollout(bodies(code, integrator, REACHES[integrator]), many), TARGET)
        self._code.call(1)  # compiles the code for one lane, that is, for one trajectory
        self._memories: dict[int, Single] = {}  # number of samples -> memory of a rollout

    @cached_property
    def motion(self) -> Callable[[Array], list[Array]]:
        """`Equation.motion`, a function (t, q, v, p) that depends on neither t nor p, compiled as a function of a state y (2n,)."""
        graph, n = Graph(), self.n
        # the function's operations as a graph with the entries of y as leaves; the leaf of t is not used
        names = [f"%y{k}" for k in range(2 * n)]
        leaves = [graph.leaf(name) for name in names]
        results = inline(graph, self.equation.motion, ([graph.leaf("%t")], leaves[:n], leaves[n:], []), lambda x: sincos(graph, x))
        routine = evaluation("evaluate", graph, [x for row in results for x in row], {"y": names})
        loaded = Loaded(lambda many: routine, TARGET)  # `many` has no effect, because only one state is evaluated at a time
        loaded.call(1)  # compiles
        *cuts, size = np.cumsum([len(row) for row in results]).tolist()  # where each result ends in the array `out`

        def evaluate(y: Array) -> list[Array]:
            """Return the results of `Equation.motion`, one array for each, at a state y (2n,)."""
            call = loaded.single(2 * n, size)
            state, out = call.arrays
            state[:] = y
            call.run()
            return np.split(out.copy(), cuts)

        return evaluate

    def memory_for(self, slots: int) -> Single:
        """Return the memory of a rollout with `slots` samples, allocated on the first call."""
        if slots not in self._memories:
            # the arrays of the routine `rollout`: state y, parameters (none), samples, and a report of three numbers; codes[1] is
            # the machine code for one trajectory at a time
            self._memories[slots] = Single(self._code.codes[1], (2 * self.n, 0, slots * 2 * self.n, 3))
        return self._memories[slots]

    def steps(self, y: Array, t: float, h: float, count: int, every: int) -> tuple[Array, int, Array]:
        """Take up to `count` steps of h [s] from y at time t [s], with a sample after every `every`-th step.

        Return the samples (k, 2n), the number of valid steps and the state after them, as views of memory that the next call
        overwrites. Stepping ends before a step that brings a dyad's opening below its threshold.
        """
        slots = max(1, ceil(count / every))
        memory = self.memory_for(slots)
        start, _, samples, report = memory.arrays
        start[:] = y
        memory.numbers[:] = h, t
        memory.counts[:3] = count, every, slots
        memory.run()
        states = samples.reshape(slots, 2 * self.n)
        if report[1]:  # all steps were valid
            return states, count, states[-1]
        done = int(report[0])  # valid steps; `start` then holds the state after them
        return states[: count_before(done, every)], done, start

    def course(self, y: Array, times: Array, tolerances: tuple[float, float]) -> Course:
        """Integrate adaptively over the times (k,) [s], or until the opening of a dyad falls below its threshold."""
        return integrate(self._code, y, np.zeros(0), times, tolerances)
