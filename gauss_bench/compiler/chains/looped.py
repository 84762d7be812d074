"""Programs of large linkages: their loops as they run.

Straight-line code is the fastest for linkages of a few loops. It outgrows the instruction cache at about a thousand operations, and
takes half a minute to generate and compile at thirty thousand. Here equal operations of different links are lanes of one loop,
found in the expressions themselves, so that no linkage is told to be a chain; one without any repetition merely gathers its
operands.
"""

from collections.abc import Iterator

import numpy as np

from gauss_bench.compiler.chains.functions import LoopedProgram, MemoryBody, accelerate, looped_program
from gauss_bench.compiler.elimination.rounds import RoundsProgram
from gauss_bench.compiler.machine.native_code import Flags
from gauss_bench.compiler.machine.running import Loaded, Target
from gauss_bench.compiler.machine.source import C_HEADER, in_c
from gauss_bench.compiler.stepping.programs import Evaluator, Stepper
from gauss_bench.compiler.stepping.rollout import rollout
from gauss_bench.terms import Array


class LoopedPrograms:
    """The looped programs of one mechanism: the best first, further ones when they are asked for."""

    def __init__(self, programs: Iterator[RoundsProgram], target: Target):
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
        self.add(looped_program(program))
        return True

    def add(self, code: LoopedProgram) -> None:
        self.codes.append(code)
        self.evaluators.append(Evaluator(Loaded(lambda many: accelerate(code, library=False), self.target), code.size))

    def levels(self, integrator: str) -> int:
        """One: all sines are computed from nothing."""
        return 1

    def level(self, integrator: str, h: float, v: Array) -> int:
        return 0

    def runner(self, k: int, integrator: str, level: int) -> Stepper:
        """Steps by one program."""
        if (k, integrator) not in self.runners:
            code = self.codes[k]
            made = Loaded(lambda many: rollout(MemoryBody(code, integrator, library=False), many), self.target)
            self.runners[k, integrator] = Stepper(made, code.size)
        return self.runners[k, integrator]

    def margin(self, k: int, t: float, state: Array, p: Array) -> float:
        """Infinite where all guards of a program hold at a state, else 0."""
        return np.inf if self.evaluators[k].one(t, state[: self.n], state[self.n :], p) is not None else 0.0

    def accelerations(self, k: int, t: Array, q: Array, v: Array, p: Array) -> tuple[Array, Flags]:
        """Accelerations (k, n) by one program, and where it serves (k,)."""
        return self.evaluators[k].accelerations(t, np.concatenate([q, v], axis=1), p)

    def acceleration(self, t: float, q: Array, v: Array) -> Array | None:
        """Accelerations (n,) at one state by the shortest way, or None where another must be gone."""
        return self.evaluators[0].one(t, q, v, self.values)

    def multipliers(self, k: int, t: Array, q: Array, v: Array, p: Array) -> tuple[Array, Flags]:
        """None: these programs compute accelerations and corrections alone."""
        return np.zeros((len(q), 0)), np.zeros(len(q), bool)

    @property
    def partitions(self) -> tuple[tuple[int, ...], ...]:
        """Independent coordinates of every program generated so far; () for Lagrange's."""
        return tuple(code.source.plan.independent for code in self.codes)

    def c_source(self, integrator: str) -> str:
        """The best program in plain C."""
        first = self.codes[0]
        steps = in_c(rollout(MemoryBody(first, integrator, library=True), many=False))
        return C_HEADER + in_c(accelerate(first, library=True)) + "\n" + steps

    def loaded(self) -> list[tuple[float, bool]]:
        """Seconds to compile or load each piece of machine code so far, and whether it was in the cache."""
        codes = [code for x in (*self.evaluators, *self.runners.values()) for code in x.loaded.codes.values()]
        return [(code.seconds, code.from_cache) for code in codes]

    def prepare(self, integrator: str, many: bool, levels: int | None = None) -> None:
        """Compile what steps of one state, or of many, may need, or the first `levels` variants of it."""
        self.runner(0, integrator, 0).loaded.call(self.target.lanes if many else 1)
