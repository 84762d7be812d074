"""Whoever follows lanes of samples: native code in groups of W lanes, or generated source on arrays where there is no compiler.

A runner knows one program and what is stored. It stops a lane where a sample is not closed; closure_paths.py decides what follows.
"""

import threading
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from gauss_bench.compiler.elimination.loop_program import ClosureProgram
from gauss_bench.compiler.machine import native_code
from gauss_bench.compiler.machine.native_code import NativeCode
from gauss_bench.compiler.stepping.arrays import function
from gauss_bench.compiler.stepping.runners import address, in_lanes, out_of_lanes
from gauss_bench.compiler.turns import follow as closure_loops
from gauss_bench.compiler.turns.follow import Outputs, written
from gauss_bench.terms import Array

Counts = NDArray[np.integer[Any]]


@dataclass(frozen=True, eq=False)
class Course:
    """What lanes are to follow.

    Attributes:
        x: (lanes, U) guess at each lane's first sample.
        signs: (lanes, G) that the guards must keep; 0 for any.
        inputs: (lanes or 1, samples + 1, 3 K) values, rates, second rates; of the row after the last only the values count.
        parameters: (lanes, n_p).
        where: (lanes,) row of each lane's first sample in `rows`.
        rows: (any, R) where samples are stored.
        tolerance: |A|^2 of a closed sample, of the squared lengths of the vectors in it.
    """

    x: Array
    signs: Array
    inputs: Array
    parameters: Array
    where: Counts
    rows: Array
    tolerance: float

    @property
    def samples(self) -> int:
        return int(self.inputs.shape[1]) - 1


@dataclass(frozen=True, eq=False)
class Followed:
    """What became of the lanes: samples closed before the first that was not, x (lanes, U) and guards (lanes, G) at the last."""

    closed: Counts
    x: Array
    guards: Array


class Runner(Protocol):
    """Follows lanes."""

    def run(self, course: Course, threads: int = 1) -> Followed: ...


class NativeFollower:
    """Machine code, `lanes` lanes at a time."""

    def __init__(self, program: ClosureProgram, outputs: Outputs, lanes: int, cached: bool):
        self.program, self.outputs, self.lanes, self.cached = program, outputs, lanes, cached
        self._loaded: NativeCode | None = None
        self._lock = threading.Lock()

    @property
    def native(self) -> NativeCode:
        with self._lock:
            if self._loaded is None:
                listing = closure_loops.follow(self.program, self.outputs, self.lanes)
                self._loaded = native_code.compile_text(listing.text, "follow", listing.operations, self.cached)
            return self._loaded

    def run(self, course: Course, threads: int = 1) -> Followed:
        lanes, count = self.lanes, len(course.x)
        x = in_lanes(course.x.copy(), lanes)  # is written to; one lane would be a view
        signs, p = (in_lanes(a, lanes) for a in (course.signs, course.parameters))
        where = in_lanes(np.asarray(course.where, dtype=np.int64)[:, None] * course.rows.shape[1], lanes)
        inputs, shift = _input_lanes(course.inputs, lanes)
        report = np.empty((len(x), 1 + self.program.guards, lanes))
        call, rows, samples = self.native.call, address(course.rows), course.samples

        def part(bounds: tuple[int, int]) -> None:
            low, high = bounds
            given = address(inputs) + 8 * shift * low
            arrays = [address(a[low:high]) for a in (x, signs, p, where, report)]
            call(*arrays[:2], given, arrays[2], rows, *arrays[3:], course.tolerance, samples, shift, high - low)

        if min(threads, len(x)) < 2:
            part((0, len(x)))
        else:
            parts = list(pairwise(np.linspace(0, len(x), min(threads, len(x)) + 1).astype(int).tolist()))
            with ThreadPoolExecutor(len(parts)) as pool:
                list(pool.map(part, parts))
        found = out_of_lanes(report, count)
        last = out_of_lanes(x, count) if x.size else course.x  # an open chain has no unknowns
        return Followed(found[:, 0].astype(int), last, found[:, 1:])


def _input_lanes(inputs: Array, lanes: int) -> tuple[Array, int]:
    """(lanes or 1, rows, columns) as (groups, rows, columns, lanes), and the numbers between groups: 0 where one serves all."""
    count, rows, columns = inputs.shape
    if count == 1:
        return np.repeat(inputs[0][:, :, None], lanes, axis=2), 0
    missing = -count % lanes
    full = np.concatenate([inputs, np.repeat(inputs[-1:], missing, axis=0)]) if missing else inputs
    return np.ascontiguousarray(full.reshape(-1, lanes, rows, columns).transpose(0, 2, 3, 1)), rows * columns * lanes


class ArrayFollower:
    """Generated source on arrays, all lanes side by side."""

    def __init__(self, program: ClosureProgram, outputs: Outputs):
        self.program, self.lanes = program, 0
        code = written(program, outputs, library=True)
        names = {f"%{letter}{k}": f"{letter}[{k}]" for letter in "xXlsc" for k in range(program.unknowns)}
        names |= {f"%{letter}{j}": f"{letter}[{j}]" for letter in "uwbn" for j in range(program.inputs)}
        names |= {f"%p{i}": f"p[{i}]" for i in range(program.parameters)}
        turning = list(code.start)
        known = ("u", "p")
        self.turning = turning
        self._start = function(code.graph, [x for k in turning for x in code.start[k]], ("X",), names)
        self._score = function(code.graph, [code.score, code.square], ("x", "s", "c", *known), names)
        moved = [code.moved[f"%x{k}"] for k in range(program.unknowns)]
        moved += [code.moved[f"%{letter}{k}"] for letter in "sc" for k in turning]
        self._moved = function(code.graph, [*moved, code.near], ("x", "s", "c", *known), names)
        self._checks = function(code.graph, [code.turn, code.regular, *code.guards], ("x", "s", "c", "X", "l", *known), names)
        self._closed = function(code.graph, [*code.guess, *code.outputs], ("x", "s", "c", "w", "b", "n", *known), names)

    def run(self, course: Course, threads: int = 1) -> Followed:
        """Follow; `threads` make no difference."""
        lanes, U, K = len(course.x), self.program.unknowns, self.program.inputs
        inputs = np.broadcast_to(course.inputs, (lanes, *course.inputs.shape[1:])).transpose(1, 2, 0)
        guess, last, p = course.x.T.copy(), course.x.T.copy(), course.parameters.T
        guards, closed = np.zeros((self.program.guards, lanes)), np.zeros(lanes, int)
        alive = np.ones(lanes, bool)
        with np.errstate(all="ignore"):
            for i in range(course.samples):
                u, w, b = (inputs[i, k * K : (k + 1) * K] for k in range(3))
                x, s, c, good = self._newton(guess, u, p, course.tolerance, alive)
                turn, regular, *values = self._checks(x, s, c, guess, last, u, p)
                at = _stacked(values, lanes)
                alive = alive & good & turn & regular & (course.signs.T * at >= 0.0).all(axis=0)
                found = _stacked(self._closed(x, s, c, w, b, inputs[i + 1, :K], u, p), lanes)
                course.rows[course.where[alive] + i] = found[U:].T[alive]
                last, guards, guess = np.where(alive, x, last), np.where(alive, at, guards), found[:U]
                closed += alive
                if not alive.any():
                    break
        return Followed(closed, last.T.copy(), guards.T.copy())

    def _newton(self, guess: Array, u: Array, p: Array, tolerance: float, alive: Any) -> tuple[Array, Array, Array, Any]:
        """Iterate and sines, and which lanes are closed."""
        lanes, U = guess.shape[1], len(guess)
        x, s, c = guess, np.zeros_like(guess), np.zeros_like(guess)
        pairs = _stacked(self._start(guess), lanes)
        s[self.turning], c[self.turning] = pairs[::2], pairs[1::2]
        near = np.ones(lanes, bool)
        for _ in range(closure_loops.LIMIT + 1):
            score, square = self._score(x, s, c, u, p)
            closed = np.broadcast_to(score <= tolerance * square, lanes)
            if not (alive & near & ~closed).any():
                break
            *new, short = self._moved(x, s, c, u, p)
            moved, near = _stacked(new, lanes), near & short
            x, half = moved[:U], U + len(self.turning)
            s, c = s.copy(), c.copy()
            s[self.turning], c[self.turning] = moved[U:half], moved[half:]
        return x, s, c, near & closed


def _stacked(values: list[Any], lanes: int) -> Array:
    """Numbers and arrays of lanes as rows."""
    return np.array([np.broadcast_to(x, lanes) for x in values]).reshape(len(values), lanes)
