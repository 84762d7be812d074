"""The loops of one mechanism under one plan, the machine code made of them, and the way of numbers into it and out."""

import ctypes
import threading
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from gauss_bench.compiler.chains.steps import Sizes, module
from gauss_bench.compiler.elimination.formulations import Plan
from gauss_bench.compiler.elimination.partition import Study
from gauss_bench.compiler.elimination.rounds import generate_in_rounds
from gauss_bench.compiler.machine import native_code
from gauss_bench.compiler.machine.loops import WIDEST, Groups, Loop, Memory, grouped, loops, memory
from gauss_bench.compiler.stepping.runners import Flags, address, in_lanes, out_of_lanes
from gauss_bench.terms import Array


def aligned(size: int) -> Array:
    """Zeros (size,) that begin at a multiple of 64 bytes, so that no vector straddles two lines of the cache."""
    room = np.zeros(size + WIDEST)
    start = -(address(room) // room.itemsize) % WIDEST
    return room[start : start + size]


class Single(threading.local):
    """Memory for one trajectory, of each thread its own: arrays, views of them in the order of the mechanism, addresses."""

    def __init__(self, m: Memory, guards: int):
        self.y, self.out, self.t, self.report = aligned(m.state), aligned(m.out), np.zeros(1), np.zeros(3)
        self.work = aligned(Sizes(m, guards).total)
        self.q, self.v = (x[:, : m.links].T for x in self.y.reshape(2, 3, m.stride))
        self.a = self.out[: 3 * m.stride].reshape(3, m.stride)[:, : m.links].T
        self.addresses = [ctypes.c_void_p(address(x)) for x in (self.y, self.work, self.t, self.out, self.report)]


@dataclass(frozen=True, eq=False)
class LargeProgram:
    """Loops of one mechanism under one plan, and the machine code made of them so far."""

    plan: Plan
    groups: Groups
    loops: list[Loop]
    memory: Memory
    guards: int
    dropped: tuple[str, ...]
    cache: bool
    loaded: dict[tuple[str, int], native_code.NativeCode]

    @property
    def operations(self) -> int:
        return self.groups.operations

    def native(self, name: str, lanes: int) -> native_code.NativeCode:
        """One of the functions of large_steps.py, for so many trajectories at once."""
        if (name, lanes) not in self.loaded:
            across = native_code.best_lanes() if lanes == 1 else 1
            text = module(self.groups, self.loops, self.memory, self.guards, across, lanes, name)
            self.loaded[name, lanes] = native_code.compile_text(text, name, 0, self.cache)
        return self.loaded[name, lanes]

    def packed(self, states: Array) -> Array:
        """States (k, 2n) in the order of memory (k, state)."""
        m = self.memory
        out = np.zeros((len(states), 2, 3, m.stride))
        out[..., : m.links] = states.reshape(-1, 2, m.links, 3).swapaxes(2, 3)
        return out.reshape(len(states), m.state)

    def unpacked(self, x: Array) -> Array:
        """The order of the mechanism (k, parts n) from that of memory (k, parts 3 stride)."""
        m = self.memory
        return x.reshape(len(x), -1, 3, m.stride)[..., : m.links].swapaxes(2, 3).reshape(len(x), -1)

    def accelerations(self, t: Array, states: Array, lanes: int) -> tuple[Array, Flags]:
        """Accelerations (k, n), and whether all guards hold (k,), of states (k, 2n) at times (k,)."""
        m, lanes = self.memory, 1 if len(states) == 1 else lanes
        y, at = in_lanes(self.packed(states), lanes), in_lanes(t[:, None], lanes)
        out, work = np.empty((len(y), m.out, lanes)), self._work(lanes)
        self.native("accelerate", lanes).call(address(y), address(work), address(at), address(out), len(y))
        found = out_of_lanes(out, len(states))
        return self.unpacked(found[:, : 3 * m.stride]), found[:, m.coordinate(3 * m.links)] == self.guards

    def advance(self, states: Array, t0: float, h: float, n: int, lanes: int) -> tuple[Array, Array]:
        """States (k, 2n) after the steps that count, and how many these are (k,)."""
        lanes = 1 if len(states) == 1 else lanes
        y, work = in_lanes(self.packed(states), lanes), self._work(lanes)
        report = np.empty((len(y), 3, lanes))
        empty = address(report)
        self.native("rollout", lanes).call(address(y), address(work), h, t0, n, n, empty, empty, 1, len(y))
        return self.unpacked(out_of_lanes(y, len(states))), out_of_lanes(report, len(states))[:, 0].astype(int)

    @cached_property
    def single(self) -> Single:
        return Single(self.memory, self.guards)

    def acceleration(self, t: float, q: Array, v: Array) -> tuple[Array, bool]:
        """As `accelerations`, for one state (n,) by the shortest way."""
        x, m = self.single, self.memory
        x.q[...], x.v[...] = q.reshape(m.links, 3), v.reshape(m.links, 3)
        x.t[0] = t
        y, work, at, out, _ = x.addresses
        self.native("accelerate", 1).call(y, work, at, out, 1)
        return x.a.flatten(), bool(x.out[3 * m.stride] == self.guards)

    def advance_one(self, q: Array, v: Array, t0: float, h: float, n: int) -> tuple[Array, Array, int]:
        """As `advance`, for one state (n,) by the shortest way."""
        x, m = self.single, self.memory
        x.q[...], x.v[...] = q.reshape(m.links, 3), v.reshape(m.links, 3)
        y, work, _, _, report = x.addresses
        self.native("rollout", 1).call(y, work, h, t0, n, n, None, report, 1, 1)
        return x.q.flatten(), x.v.flatten(), int(x.report[0])

    def _work(self, lanes: int) -> Array:
        return aligned(Sizes(self.memory, self.guards).total * lanes)


def generate_large(found: Study, plan: Plan, cache: bool = True) -> LargeProgram:
    """The program of a mechanism under a plan.

    Raises:
        KernelError: no pivots are usable.
    """
    made = generate_in_rounds(found, plan)
    groups = grouped(made)
    order = loops(groups)
    return LargeProgram(plan, groups, order, memory(made, groups, order), made.guards, found.dropped, cache, {})
