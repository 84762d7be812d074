"""Whoever steps trajectories, and what they say of it: native code, by groups of lanes and on several threads, or arrays of numpy.

A runner knows one program, one integrator and one reach. It never decides what follows when a trajectory stops: driver.py does.
Without a compiler the step is taken in the variant that leaves every sine to the target; guards, projection and the order of the
operations are those of the native code, so that results agree to rounding.
"""

import threading
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from gauss_bench.compiler.machine import native_code
from gauss_bench.compiler.machine.code import Code
from gauss_bench.compiler.machine.native_code import Buffers, Flags, NativeCode, address, in_lanes, out_of_lanes, shared
from gauss_bench.compiler.machine.python import function
from gauss_bench.compiler.stepping import rollout as loops
from gauss_bench.compiler.stepping.steps import REACHES, STEPS, Reach, Step
from gauss_bench.terms import Array

CHUNK = 4096  # trajectories at a time: they share what a call of numpy costs, and a step has hundreds


@dataclass(frozen=True, eq=False)
class Batch:
    """What is to be stepped.

    Attributes:
        states: (k, 2n) q and v.
        parameters: (k, n_p).
        t0, h: start and step [s]; n: steps; every: steps between samples, at least 1.
    """

    states: Array
    parameters: Array
    t0: float
    h: float
    n: int
    every: int

    @property
    def slots(self) -> int:
        """Samples of each trajectory: every `every` steps and the last."""
        return max(1, -(-self.n // self.every))


@dataclass(frozen=True, eq=False)
class Outcome:
    """What became of a batch.

    Attributes:
        states: (k, 2n) last state; where a trajectory stopped early, the one it stopped at.
        samples: (k, slots, 2n); of a trajectory that stopped, those before the step it stopped at.
        done: (k,) steps that count.
        complete: (k,) whether that is all of them.
        far: (k,) whether it stopped because the angles moved further than the code can follow, and for no other reason.
    """

    states: Array
    samples: Array
    done: NDArray[np.integer[Any]]
    complete: Flags
    far: Flags


class Runner(Protocol):
    """Steps trajectories by one program, integrator and reach."""

    def run(self, batch: Batch, threads: int = 1) -> Outcome:
        """All trajectories of a batch as far as their guards hold."""
        ...

    def run_one(self, q: Array, v: Array, parameters: Array, t0: float, h: float, n: int) -> Array | Outcome:
        """The state (2n,) after n steps of one trajectory, or what stopped it: the shortest way into the code."""
        ...


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
                listing = loops.rollout(self.code, self.integrator, self.reach, lanes)
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
            listing = loops.acceleration(self.code, lanes)
            self.loaded[lanes] = native_code.compile_text(listing.text, "accelerate", listing.operations, self.cached)
        return self.loaded[lanes]

    def accelerations(self, t: Array, states: Array, parameters: Array) -> tuple[Array, Flags]:
        """Accelerations (k, n), and whether all guards hold (k,), of states (k, 2n) at times (k,)."""
        count = len(states)
        lanes = 1 if count == 1 else self.lanes
        y, p, at = in_lanes(states, lanes), in_lanes(parameters, lanes), in_lanes(t[:, None], lanes)
        out = np.empty((len(y), y.shape[1] // 2 + 1, lanes))
        self.native(lanes).call(address(y), address(p), address(at), address(out), len(y))
        found = out_of_lanes(out, count)
        return found[:, :-1], found[:, -1] > 0

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
