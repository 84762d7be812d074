"""Whoever steps trajectories, and what they say of it; here the native code, by groups of lanes and on several threads.

A runner knows one program, one integrator and one reach. It never decides what follows when a trajectory stops: driver.py does.
"""

import ctypes
import threading
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from gauss_bench.compiler.machine import native_code
from gauss_bench.compiler.machine.native_code import NativeCode
from gauss_bench.compiler.stepping import rollout as loops
from gauss_bench.compiler.stepping.steps import Code, Reach
from gauss_bench.terms import Array

Flags = NDArray[np.bool_]


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

    def run(self, batch: Batch, threads: int = 1) -> Outcome: ...


def in_lanes(x: Array, lanes: int) -> Array:
    """(k, rows) as (groups, rows, lanes); the last state is repeated to fill the last group."""
    missing = -len(x) % lanes
    full = np.concatenate([x, np.repeat(x[-1:], missing, axis=0)]) if missing else x
    return np.ascontiguousarray(full.reshape(len(full) // lanes, lanes, x.shape[1]).transpose(0, 2, 1))


def out_of_lanes(x: Array, count: int) -> Array:
    """(groups, ..., rows, lanes) as (k, ..., rows)."""
    moved = np.moveaxis(x, -1, 1)
    return np.ascontiguousarray(moved.reshape(-1, *moved.shape[2:])[:count])


def address(x: Array) -> int:
    return int(x.__array_interface__["data"][0])


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

        def part(bounds: tuple[int, int]) -> None:
            low, high = bounds
            arrays = [address(x[low:high]) for x in (y, p, samples, report)]
            call(*arrays[:2], batch.h, batch.t0, batch.n, batch.every, *arrays[2:], batch.slots, high - low)

        parts = list(pairwise(np.linspace(0, groups, min(threads, groups) + 1).astype(int).tolist()))
        if len(parts) == 1:
            part(parts[0])
        else:
            with ThreadPoolExecutor(len(parts)) as pool:
                list(pool.map(part, parts))
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


class Buffers(threading.local):
    """Arrays of one thread for one state, their addresses taken once: asking numpy for one costs as much as ten steps."""

    call: Any

    def put(self, call: Any, *sizes: int) -> None:
        self.arrays = [np.empty(size) for size in sizes]
        self.addresses = [ctypes.c_void_p(address(x)) for x in self.arrays]
        self.call = call


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
