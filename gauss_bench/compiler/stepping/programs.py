"""Straight-line programs as they run: by native code, in groups of lanes and on several threads, or by arrays of numpy.

A runner knows one program, one integrator and one reach. It never decides what follows when a trajectory stops: driver.py does.
Without a compiler the step is taken in the variant that leaves every sine to the target; guards, projection and the order of the
operations are those of the native code, so that results agree to rounding.

A partition is usable where its pivots stay away from zero; which ones do changes along the motion (the crank of a slider-crank
always serves, its slider not at the dead centres).
"""

import math
import threading
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from gauss_bench.compiler.machine import native_code
from gauss_bench.compiler.machine.code import Code, Program, read_code
from gauss_bench.compiler.machine.native_code import Buffers, Flags, NativeCode, address, in_lanes, out_of_lanes, shared
from gauss_bench.compiler.machine.source import function, on_arrays
from gauss_bench.compiler.stepping.driver import Batch, Outcome, Runner
from gauss_bench.compiler.stepping.rollout import acceleration, rollout
from gauss_bench.compiler.stepping.steps import REACHES, STEPS, Reach, Step, c_source
from gauss_bench.terms import Array

CHUNK = 4096  # trajectories at a time: they share what a call of numpy costs, and a step has hundreds


class NativeRunner:
    """Machine code: one lane for a single trajectory, `lanes` of them for many.

    Attributes:
        loaded: the code that has been compiled or loaded so far, by lanes.
    """

    def __init__(self, code: Code, integrator: str, reach: Reach, lanes: int, cached: bool):
        self.code, self.integrator, self.reach, self.lanes, self.cached = code, integrator, reach, lanes, cached
        self.loaded: dict[int, NativeCode] = {}
        self._lock = threading.Lock()
        self._own = Buffers()

    def native(self, lanes: int) -> NativeCode:
        with self._lock:
            if lanes not in self.loaded:
                listing = rollout(self.code, self.integrator, self.reach, lanes)
                self.loaded[lanes] = native_code.compile_text(listing.text, "rollout", listing.operations, self.cached)
            return self.loaded[lanes]

    def run(self, batch: Batch, threads: int = 1) -> Outcome:
        count = len(batch.states)
        lanes = 1 if count == 1 else self.lanes
        y, p = in_lanes(batch.states, lanes), in_lanes(batch.parameters, lanes)
        groups, rows = y.shape[:2]
        samples, report = np.empty((groups, batch.slots, rows, lanes)), np.empty((groups, 3, lanes))
        call = self.native(lanes).call

        def part(low: int, high: int) -> None:
            arrays = [address(x[low:high]) for x in (y, p, samples, report)]
            call(*arrays[:2], batch.h, batch.t0, batch.n, batch.every, *arrays[2:], batch.slots, high - low)

        shared(part, groups, threads)
        done, complete, far = out_of_lanes(report, count).T
        return Outcome(out_of_lanes(y, count), out_of_lanes(samples, count), done.astype(int), complete > 0, far > 0)

    def run_one(self, q: Array, v: Array, parameters: Array, t0: float, h: float, n: int) -> Array | Outcome:
        """The state (2n,) after n steps of one trajectory, or what stopped it: the shortest way into the code."""
        own = self._own
        if not hasattr(own, "call"):
            own.put(self.native(1).call, 2 * len(q), len(parameters), 2 * len(q), 3)
        y, p, sample, report = own.arrays
        y[: len(q)], y[len(q) :], p[:] = q, v, parameters
        a = own.addresses
        own.call(a[0], a[1], h, t0, n, max(1, n), a[2], a[3], 1, 1)
        if report[1]:
            return sample.copy()
        done, complete, far = report[:, None].copy()
        return Outcome(y[None].copy(), np.full((1, 1, len(y)), np.nan), done.astype(int), complete > 0, far > 0)


class NativeEvaluator:
    """Accelerations of single states by machine code."""

    def __init__(self, code: Code, lanes: int, cached: bool):
        self.code, self.lanes, self.cached = code, lanes, cached
        self.loaded: dict[int, NativeCode] = {}
        self._own = Buffers()

    def native(self, lanes: int) -> NativeCode:
        if lanes not in self.loaded:
            listing = acceleration(self.code, lanes)
            self.loaded[lanes] = native_code.compile_text(listing.text, "accelerate", listing.operations, self.cached)
        return self.loaded[lanes]

    def accelerations(self, t: Array, states: Array, parameters: Array) -> tuple[Array, Flags]:
        """Accelerations (k, n), and whether all guards hold (k,), of states (k, 2n) at times (k,)."""
        count = len(states)
        lanes = 1 if count == 1 else self.lanes
        y, p, at = in_lanes(states, lanes), in_lanes(parameters, lanes), in_lanes(t[:, None], lanes)
        out = np.empty((len(y), y.shape[1] // 2 + 1, lanes))
        self.native(lanes).call(address(y), address(p), address(at), address(out), len(y))
        rows = out_of_lanes(out, count)
        return rows[:, :-1], rows[:, -1] > 0

    def one(self, t: float, q: Array, v: Array, parameters: Array) -> Array | None:
        """Accelerations (n,) of one state, or None where a guard fails."""
        own = self._own
        if not hasattr(own, "call"):
            own.put(self.native(1).call, 2 * len(q), len(parameters), 1, len(q) + 1)
        y, p, at, out = own.arrays
        y[: len(q)], y[len(q) :], p[:], at[0] = q, v, parameters, t
        own.call(*own.addresses, 1)
        return out[:-1].copy() if out[-1] else None


def plain_step(code: Code, integrator: str) -> Step:
    """The step without reach, its sines left to the target."""
    return STEPS[integrator](code, REACHES[integrator][-1], library=True)


class NumpyRunner:
    """Steps by generated source on arrays."""

    def __init__(self, code: Code, integrator: str):
        self.code, self.n = code, code.program.n
        step = plain_step(code, integrator)
        always = step.graph.make("le", step.graph.const(0.0), step.graph.const(1.0))
        masks = [always if m is None else m for m in (step.regular, step.regular_out, step.within)]
        names = {f"%{a}{i}": f"{a}[{i}]" for a in "qv" for i in range(self.n)} | {"%t": "t", "%h": "h"}
        names |= {f"%p{i}": f"p[{i}]" for i in range(code.program.n_parameters)}
        order = [f"%{a}{i}" for a in "qv" for i in range(self.n)]
        roots = [*(step.carried[k] for k in order), *step.out, *masks]
        self.evaluate = function(step.graph, roots, ("q", "v", "t", "h", "p"), names)

    def run(self, batch: Batch, threads: int = 1) -> Outcome:
        count = len(batch.states)
        parts = [self._part(batch, slice(k, k + CHUNK)) for k in range(0, count, CHUNK)]
        return Outcome(*(np.concatenate([getattr(p, f) for p in parts]) for f in ("states", "samples", "done", "complete", "far")))

    def run_one(self, q: Array, v: Array, parameters: Array, t0: float, h: float, n: int) -> Array | Outcome:
        """As a batch of one."""
        outcome = self.run(Batch(np.concatenate([q, v])[None], parameters[None], t0, h, n, max(1, n)))
        return outcome.samples[0, -1] if outcome.complete[0] else outcome

    def _part(self, batch: Batch, rows: slice) -> Outcome:
        y, p = np.ascontiguousarray(batch.states[rows].T), np.ascontiguousarray(batch.parameters[rows].T)
        count, size, n = y.shape[1], 2 * self.n, batch.n
        samples = np.full((batch.slots, size, count), np.nan)
        alive, complete, far = np.ones(count, bool), np.zeros(count, bool), np.zeros(count, bool)
        done = np.zeros(count, int)
        due, slot = min(batch.every, n), 0
        with np.errstate(all="ignore"):
            for i in range(n + 1):
                now = self.evaluate(y[: self.n], y[self.n :], batch.t0 + i * batch.h, batch.h, p)
                regular, regular_out, within = (np.broadcast_to(m, count) for m in now[-3:])
                if i == due:
                    samples[slot] = [np.broadcast_to(x, count) for x in now[size:-3]]
                    due, slot = min(due + batch.every, n), slot + 1
                if i == n:
                    complete = alive & regular_out
                    y = np.where(complete, samples[-1], y)
                far |= alive & regular & ~within
                alive = alive & regular & within
                if i == n or not alive.any():
                    break
                y = np.where(alive, np.array([np.broadcast_to(x, count) for x in now[:size]]), y)
                done += alive
        return Outcome(y.T.copy(), np.ascontiguousarray(samples.transpose(2, 0, 1)), done, complete, far & ~complete)


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

    def __init__(self, programs: Iterator[Program], stabilization: str, target: Target):
        self.target, self._more = target, (read_code(program, stabilization) for program in programs)
        self.codes: list[Code] = []
        self._evaluate: list[Callable[..., list[Array]]] = []
        self._multipliers: dict[int, Callable[..., list[Array]]] = {}
        self.runners: dict[tuple[int, str, int], Runner] = {}
        self.further()
        first = self.codes[0].program
        self.n, self.values, self.dropped = first.n, first.values, first.dropped
        self._angles = list(self.codes[0].angles)
        self.native = NativeEvaluator(read_code(first, "none"), target.lanes, target.cache)

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

    def c_source(self, integrator: str) -> str:
        """The best program in plain C."""
        return c_source(self.codes[0], integrator)

    def loaded(self) -> list[tuple[float, bool]]:
        """Seconds to compile or load each piece of machine code so far, and whether it was in the cache."""
        native: list[NativeEvaluator | NativeRunner] = [
            self.native,
            *(x for x in self.runners.values() if isinstance(x, NativeRunner)),
        ]
        return [(code.seconds, code.from_cache) for x in native for code in x.loaded.values()]

    def prepare(self, integrator: str, many: bool, levels: int | None = None) -> None:
        """Compile what steps of one state, or of many, may need, or the first `levels` variants of it."""
        for level in range(self.levels(integrator) if levels is None else levels):
            runner = self.runner(0, integrator, level)
            if isinstance(runner, NativeRunner):
                runner.native(self.target.lanes if many else 1)
