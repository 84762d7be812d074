"""Programs of large linkages: their loops as machine code, and the way of numbers into it and out.

Straight-line code is the fastest for linkages of a few loops. It outgrows the instruction cache at about a thousand operations, and
takes half a minute to generate and compile at thirty thousand. Here equal operations of different links are lanes of one loop,
found in the expressions themselves, so that no linkage is told to be a chain; one without any repetition merely gathers its
operands.
"""

import ctypes
import threading
from collections.abc import Iterator

import numpy as np

from gauss_bench.compiler.chains.functions import Sizes, module
from gauss_bench.compiler.machine.loops import WIDEST, LoopedProgram, Memory, RoundsProgram, looped
from gauss_bench.compiler.machine.native_code import Flags, NativeCode, address, best_lanes, compile_text, in_lanes, out_of_lanes
from gauss_bench.compiler.machine.source import c_loops
from gauss_bench.compiler.stepping.driver import Batch, Outcome
from gauss_bench.terms import Array


def aligned(size: int) -> Array:
    """Zeros (size,) that begin at a multiple of 64 bytes, so that no vector straddles two lines of the cache."""
    room = np.zeros(size + WIDEST)
    start = -(address(room) // room.itemsize) % WIDEST
    return room[start : start + size]


class Single(threading.local):
    """Memory for one trajectory, of each thread its own: arrays, views of them in the order of the mechanism, addresses."""

    def __init__(self, m: Memory):
        self.y, self.out, self.t, self.report = aligned(m.state), aligned(m.out), np.zeros(1), np.zeros(3)
        self.work = aligned(Sizes(m).total)
        self.q, self.v = (x[:, : m.links].T for x in self.y.reshape(2, 3, m.stride))
        self.a = self.out[: 3 * m.stride].reshape(3, m.stride)[:, : m.links].T
        self.addresses = [ctypes.c_void_p(address(x)) for x in (self.y, self.work, self.t, self.out, self.report)]


class LoopedCode:
    """Loops of one mechanism under one plan as machine code.

    Attributes:
        loaded: what has been compiled or loaded so far, by function and trajectories at once.
    """

    def __init__(self, program: LoopedProgram, cache: bool):
        self.program, self.memory, self.guards, self.cache = program, program.memory, program.guards, cache
        self.loaded: dict[tuple[str, int], NativeCode] = {}
        self.single = Single(self.memory)

    def native(self, name: str, lanes: int) -> NativeCode:
        """One of the functions of functions.py, for so many trajectories at once."""
        if (name, lanes) not in self.loaded:
            text = module(self.program, best_lanes() if lanes == 1 else 1, lanes, name)
            self.loaded[name, lanes] = compile_text(text, name.split("_")[0], 0, self.cache)
        return self.loaded[name, lanes]

    def _packed(self, states: Array) -> Array:
        """States (k, 2n) in the order of memory (k, state)."""
        m = self.memory
        out = np.zeros((len(states), 2, 3, m.stride))
        out[..., : m.links] = states.reshape(-1, 2, m.links, 3).swapaxes(2, 3)
        return out.reshape(len(states), m.state)

    def _unpacked(self, x: Array) -> Array:
        """The order of the mechanism (k, parts n) from that of memory (k, parts 3 stride)."""
        m = self.memory
        return x.reshape(len(x), -1, 3, m.stride)[..., : m.links].swapaxes(2, 3).reshape(len(x), -1)

    def _work(self, lanes: int) -> Array:
        return aligned(Sizes(self.memory).total * lanes)

    def accelerations(self, t: Array, states: Array, lanes: int) -> tuple[Array, Flags]:
        """Accelerations (k, n), and whether all guards hold (k,), of states (k, 2n) at times (k,)."""
        m, lanes = self.memory, 1 if len(states) == 1 else lanes
        y, at = in_lanes(self._packed(states), lanes), in_lanes(t[:, None], lanes)
        out, work = np.empty((len(y), m.out, lanes)), self._work(lanes)
        self.native("accelerate", lanes).call(address(y), address(work), address(at), address(out), len(y))
        rows = out_of_lanes(out, len(states))
        return self._unpacked(rows[:, : 3 * m.stride]), rows[:, m.coordinate(3 * m.links)] == self.guards

    def advance(self, integrator: str, states: Array, t0: float, h: float, n: int, lanes: int) -> tuple[Array, Array]:
        """States (k, 2n) after the steps that count, and how many these are (k,)."""
        lanes = 1 if len(states) == 1 else lanes
        y, work = in_lanes(self._packed(states), lanes), self._work(lanes)
        report = np.empty((len(y), 3, lanes))
        empty = address(report)
        call = self.native(f"rollout_{integrator}", lanes).call
        call(address(y), address(work), h, t0, n, n, empty, empty, 1, len(y))
        return self._unpacked(out_of_lanes(y, len(states))), out_of_lanes(report, len(states))[:, 0].astype(int)

    def acceleration(self, t: float, q: Array, v: Array) -> tuple[Array, bool]:
        """As `accelerations`, for one state (n,) by the shortest way."""
        x, m = self.single, self.memory
        x.q[...], x.v[...] = np.reshape(q, (m.links, 3)), np.reshape(v, (m.links, 3))
        x.t[0] = t
        y, work, at, out, _ = x.addresses
        self.native("accelerate", 1).call(y, work, at, out, 1)
        return x.a.flatten(), bool(x.out[3 * m.stride] == self.guards)

    def advance_one(self, integrator: str, q: Array, v: Array, t0: float, h: float, n: int) -> tuple[Array, int]:
        """As `advance`, for one state (n,) by the shortest way."""
        x, m = self.single, self.memory
        x.q[...], x.v[...] = q.reshape(m.links, 3), v.reshape(m.links, 3)
        y, work, _, _, report = x.addresses
        self.native(f"rollout_{integrator}", 1).call(y, work, h, t0, n, n, None, report, 1, 1)
        return np.concatenate([x.q.flatten(), x.v.flatten()]), int(x.report[0])


class LoopedRunner:
    """Steps by the loops of one program."""

    def __init__(self, code: LoopedCode, integrator: str, lanes: int):
        self.code, self.integrator, self.lanes = code, integrator, lanes

    def run(self, batch: Batch, threads: int = 1) -> Outcome:
        """Step a batch; `threads` make no difference."""
        count = len(batch.states)
        states, done, complete = batch.states.copy(), np.zeros(count, int), np.ones(count, bool)
        samples = np.full((count, batch.slots, states.shape[1]), np.nan)
        for slot in range(batch.slots):
            at = slot * batch.every
            steps, rows = min(batch.every, batch.n - at), np.flatnonzero(complete)
            if not len(rows):
                break
            after, moved = self.code.advance(self.integrator, states[rows], batch.t0 + at * batch.h, batch.h, steps, self.lanes)
            states[rows], done[rows] = after, at + moved
            complete[rows] = (moved == steps) & np.isfinite(after).all(axis=1)
            samples[complete, slot] = states[complete]
        return Outcome(states, samples, done, complete, np.zeros(count, bool))

    def run_one(self, q: Array, v: Array, parameters: Array, t0: float, h: float, n: int) -> Array | Outcome:
        """The state (2n,) after n steps of one trajectory, or what stopped it: the shortest way into the code."""
        state, done = self.code.advance_one(self.integrator, q, v, t0, h, n)
        if done == n and np.isfinite(state).all():
            return state
        void = np.full((1, 1, len(state)), np.nan)
        return Outcome(state[None], void, np.array([done]), np.zeros(1, bool), np.zeros(1, bool))


class LoopedPrograms:
    """The looped programs of one mechanism: the best first, further ones when they are asked for."""

    def __init__(self, programs: Iterator[RoundsProgram], lanes: int, cache: bool):
        self.lanes, self.cache, self._more = lanes, cache, programs
        self.codes: list[LoopedCode] = []
        self.runners: dict[tuple[int, str], LoopedRunner] = {}
        self.further()
        self.n, self.values, self.dropped = 3 * self.codes[0].memory.links, np.zeros(0), self.codes[0].program.source.dropped

    def __len__(self) -> int:
        return len(self.codes)

    def further(self) -> bool:
        """Generate one more program; False where there is none."""
        program = next(self._more, None)
        if program is None:
            return False
        self.codes.append(LoopedCode(looped(program), self.cache))
        return True

    def levels(self, integrator: str) -> int:
        """One: all sines are computed from nothing."""
        return 1

    def level(self, integrator: str, h: float, v: Array) -> int:
        return 0

    def runner(self, k: int, integrator: str, level: int) -> LoopedRunner:
        """Steps by one program."""
        return self.runners.setdefault((k, integrator), LoopedRunner(self.codes[k], integrator, self.lanes))

    def margin(self, k: int, t: float, state: Array, p: Array) -> float:
        """Infinite where all guards of a program hold at a state, else 0."""
        return np.inf if self.codes[k].acceleration(t, state[: self.n], state[self.n :])[1] else 0.0

    def accelerations(self, k: int, t: Array, q: Array, v: Array, p: Array) -> tuple[Array, Flags]:
        """Accelerations (k, n) by one program, and where it serves (k,)."""
        return self.codes[k].accelerations(t, np.concatenate([q, v], axis=1), self.lanes)

    def acceleration(self, t: float, q: Array, v: Array) -> Array | None:
        """Accelerations (n,) at one state by the shortest way, or None where another must be gone."""
        a, good = self.codes[0].acceleration(t, q, v)
        return a if good else None

    def multipliers(self, k: int, t: Array, q: Array, v: Array, p: Array) -> tuple[Array, Flags]:
        """None: these programs compute accelerations alone."""
        return np.zeros((len(q), 0)), np.zeros(len(q), bool)

    @property
    def partitions(self) -> tuple[tuple[int, ...], ...]:
        """Independent coordinates of every program generated so far; () for Lagrange's."""
        return tuple(code.program.source.plan.independent for code in self.codes)

    def c_source(self, integrator: str) -> str:
        """The accelerations of the best program in plain C; steps are the caller's."""
        return c_loops(self.codes[0].program)

    def loaded(self) -> list[tuple[float, bool]]:
        """Seconds to compile or load each piece of machine code so far, and whether it was in the cache."""
        return [(x.seconds, x.from_cache) for code in self.codes for x in code.loaded.values()]

    def prepare(self, integrator: str, many: bool, levels: int | None = None) -> None:
        """Compile what steps of one state, or of many, may need, or the first `levels` variants of it."""
        self.codes[0].native(f"rollout_{integrator}", self.lanes if many else 1)
