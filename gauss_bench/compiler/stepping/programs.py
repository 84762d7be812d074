"""The straight-line programs of one mechanism: the best first, further ones when they are asked for.

A partition is usable where its pivots stay away from zero; which ones do changes along the motion (the crank of a slider-crank
always serves, its slider not at the dead centres).
"""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from gauss_bench.compiler.machine.code import Code
from gauss_bench.compiler.machine.native_code import Flags
from gauss_bench.compiler.machine.python import on_arrays
from gauss_bench.compiler.stepping.runners import NativeEvaluator, NativeRunner, NumpyRunner, Runner
from gauss_bench.compiler.stepping.steps import REACHES
from gauss_bench.terms import Array

MARGIN = 1.2  # on the way of the angles in a step, when the reach is chosen
STEADY = 100.0  # thresholds: any fixed choice of rows to drop is singular somewhere, and digits go long before its pivots do


@dataclass(frozen=True)
class Target:
    """Where code is to run: backend "llvm" or "numpy", trajectories in one vector, whether object code is kept on disk."""

    backend: str
    lanes: int
    cache: bool


class StraightLinePrograms:
    """Programs whose operations are written out one after the other."""

    def __init__(self, codes: Iterator[Code], target: Target):
        self.target, self._more = target, codes
        self.codes: list[Code] = []
        self._evaluate: list[Callable[..., list[Array]]] = []
        self._multipliers: dict[int, Callable[..., list[Array]]] = {}
        self.runners: dict[tuple[int, str, int], Runner] = {}
        self.further()
        first = self.codes[0].program
        self.n, self.values, self.dropped = first.n, first.values, first.dropped
        self._angles = list(self.codes[0].angles)
        self.native = NativeEvaluator(self.codes[0], target.lanes, target.cache)

    def __len__(self) -> int:
        return len(self.codes)

    def further(self) -> bool:
        """Generate one more program; False where there is none."""
        code = next(self._more, None)
        if code is None:
            return False
        self.codes.append(code)
        self._evaluate.append(on_arrays(code.program.acceleration))
        return True

    def levels(self, integrator: str) -> int:
        """Variants of the code, by how far angles may move in one step; the last has no limit."""
        return len(REACHES[integrator])

    def level(self, integrator: str, h: float, v: Array) -> int:
        """The shortest reach that the speeds v (..., n) allow."""
        reaches = REACHES[integrator]
        if self.target.backend != "llvm":
            return len(reaches) - 1
        turning = np.asarray(v[..., self._angles])
        way = MARGIN * abs(h) * (math.hypot(*turning) if turning.ndim == 1 else np.hypot.reduce(turning, axis=-1).max(initial=0.0))
        return next((k for k, reach in enumerate(reaches) if way <= reach.step), len(reaches) - 1)

    def runner(self, k: int, integrator: str, level: int) -> Runner:
        """The code of one program and reach, made when it is first asked for."""
        key = (k, integrator, level)
        if key not in self.runners:
            code, target = self.codes[k], self.target
            if target.backend == "llvm":
                self.runners[key] = NativeRunner(code, integrator, REACHES[integrator][level], target.lanes, target.cache)
            else:
                self.runners[key] = NumpyRunner(code, integrator)
        return self.runners[key]

    def margins(self, k: int, t: Array, q: Array, v: Array, p: Array) -> tuple[Array, Array]:
        """Accelerations (k, n) by one program, and how many times above their thresholds its smallest pivots are (k,)."""
        a, guard = self._evaluate[k](t[:, None], q, v, p)
        with np.errstate(invalid="ignore"):
            margin = np.abs(guard) / self.codes[k].program.thresholds
        return a, np.nan_to_num(margin.min(axis=1, initial=np.inf), nan=0.0, posinf=np.inf)

    def margin(self, k: int, t: float, state: Array, p: Array) -> float:
        """How far one program is from failing at a state; below 1 it does."""
        return float(self.margins(k, np.array([t]), state[None, : self.n], state[None, self.n :], p[None])[1][0])

    def accelerations(self, k: int, t: Array, q: Array, v: Array, p: Array) -> tuple[Array, Flags]:
        """Accelerations (k, n) by one program, and where it serves (k,)."""
        if k == 0 and self.target.backend == "llvm" and not self.dropped:
            return self.native.accelerations(t, np.concatenate([q, v], axis=1), p)
        a, margin = self.margins(k, t, q, v, p)
        return a, margin >= (STEADY if self.dropped else 1.0)

    def acceleration(self, t: float, q: Array, v: Array) -> Array | None:
        """Accelerations (n,) at one state by the shortest way, or None where another must be gone."""
        if self.target.backend == "llvm" and not self.dropped:
            return self.native.one(t, q, v, self.values)
        return None

    def multipliers(self, k: int, t: Array, q: Array, v: Array, p: Array) -> tuple[Array, Flags]:
        """Multipliers (k, rows) by one program, and where it serves (k,)."""
        if k not in self._multipliers:
            self._multipliers[k] = on_arrays(self.codes[k].program.multipliers)
        return self._multipliers[k](t[:, None], q, v, p)[0], self.margins(k, t, q, v, p)[1] >= 1.0

    @property
    def partitions(self) -> tuple[tuple[int, ...], ...]:
        """Independent coordinates of every program generated so far; () for Lagrange's."""
        return tuple(code.program.independent for code in self.codes)

    def loaded(self) -> list[tuple[float, bool]]:
        """Seconds to compile or load each piece of machine code so far, and whether it was in the cache."""
        native = [self.native, *(x for x in self.runners.values() if isinstance(x, NativeRunner))]
        return [(code.seconds, code.from_cache) for x in native for code in x.loaded.values()]

    def prepare(self, integrator: str, many: bool, levels: int | None = None) -> None:
        """Compile what steps of one state, or of many, may need, or the first `levels` variants of it."""
        for level in range(self.levels(integrator) if levels is None else levels):
            runner = self.runner(0, integrator, level)
            if isinstance(runner, NativeRunner):
                runner.native(self.target.lanes if many else 1)
