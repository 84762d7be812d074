"""Kinematics of a linkage compiled for this machine: positions, velocities and accelerations over whole turns, many at once.

closure = compile_closure(mechanism)
turn = closure.turn(3600)             # derivatives by the crank angle
sweep = closure.sweep(angles, speeds, accelerations, parameters=lengths)
"""

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import ceil

import numpy as np
from numpy.typing import NDArray

from gauss_bench.compiler.elimination.loop_program import closure_program, loop_values
from gauss_bench.compiler.errors import KernelError
from gauss_bench.compiler.machine import native_code
from gauss_bench.compiler.machine.native_code import Target, in_plain_c
from gauss_bench.compiler.turns.follow import Follower, follow
from gauss_bench.compiler.turns.tracker import Judge, Loss, Lost, Motion, Start, Status, Tracker, deform_starts
from gauss_bench.kinematics.inputs import Input, inputs_of
from gauss_bench.kinematics.loop_equations import LoopEquations
from gauss_bench.mechanism.model import Mechanism, Point
from gauss_bench.mechanism.motion_laws import constant
from gauss_bench.terms import Array

__all__ = ["Closure", "Loss", "Status", "Sweep", "compile_closure"]

Statuses = NDArray[np.int8]

BACKENDS = ("llvm", "numpy")
PARTS = 32  # lanes of arrays: they share what a call of numpy costs


@dataclass(frozen=True, eq=False)
class Sweep:
    """States of one linkage at k samples, or of many.

    Attributes:
        q, v, a: (k, n) or (linkages, k, n) positions, velocities, accelerations of all links in the mechanism's absolute
            coordinates [m, rad]; angles are continuous from the start. NaN where lost.
        points, point_rates, point_seconds: (k, P, 2) or (linkages, k, P, 2) of the points asked for.
        status: (k,) or (linkages, k) of Status.
        losses: where and why motions ended, at most one for each linkage.
        rows: (k, 3 n + 6 P) or (linkages, k, 3 n + 6 P) all numbers, of which the others are views.
    """

    q: Array
    v: Array
    a: Array
    points: Array
    point_rates: Array
    point_seconds: Array
    status: Statuses
    losses: tuple[Loss, ...]
    rows: Array


def compile_closure(
    mechanism: Mechanism,
    lanes: int | None = None,
    open_parameters: tuple[str, ...] = (),
    backend: str | None = None,
    cache: bool = True,
    points: Sequence[Point] = (),
    inputs: Sequence[Input] | None = None,
) -> "Closure":
    """The closure of a mechanism.

    Args:
        lanes: samples or linkages in one vector, a power of 2; chosen for the host where None.
        open_parameters: names of dimensions that are given with each sweep, such as "points.rod.B.x", "links.rod.com.x" or
            "joints.guide.offset".
        backend: "llvm", or "numpy" without a compiler; None for the first that is installed.
        cache: whether object code is kept in the user's cache folder.
        points: whose positions and rates are wanted too.
        inputs: what drives the linkage; where None, the drivers of its scenario, else its crank. Their laws do not matter.

    Raises:
        KernelError: an unknown name, no usable pivots, a start at a singular position, or a backend that is not there.
        ValueError: knife edges, or inputs that do not fit the linkage.
    """
    start = time.perf_counter()
    if backend not in (None, *BACKENDS):
        raise KernelError(f"no backend {backend}; there are {', '.join(BACKENDS)}")
    if backend == "llvm" and not native_code.available():
        raise KernelError("the backend llvm needs the package llvmlite: pip install 'gauss-bench[kernel]'")
    chosen = backend or ("llvm" if native_code.available() else "numpy")
    width = (native_code.best_lanes() if chosen == "llvm" else PARTS) if lanes is None else lanes
    if width < 1 or (chosen == "llvm" and width & (width - 1)):
        raise KernelError(f"{width} lanes are no power of 2")
    return Closure(mechanism, _inputs(mechanism, inputs), tuple(open_parameters), tuple(points), chosen, width, cache, start)


def _inputs(mechanism: Mechanism, inputs: Sequence[Input] | None) -> tuple[Input, ...]:
    if inputs is not None:
        return tuple(inputs)
    if mechanism.drivers or mechanism.crank is None:
        return inputs_of(mechanism)
    return (Input(constant(0.0, 1.0), link=mechanism.crank),)


class Closure:
    """Compiled closure of one linkage.

    Attributes:
        mechanism: what was compiled. inputs: names of what drives it, in the order of every `inputs` argument; parameters: of the
        open numbers, likewise, and values: theirs in the file. backend: "llvm" or "numpy". lanes: in one vector. unknowns: loop
        variables that are solved for. build_seconds: to generate the program and to compile or load its code.
    """

    def __init__(
        self,
        mechanism: Mechanism,
        inputs: tuple[Input, ...],
        open_names: tuple[str, ...],
        points: tuple[Point, ...],
        backend: str,
        lanes: int,
        cache: bool,
        start: float,
    ):
        self.mechanism, self.backend, self.lanes = mechanism, backend, lanes
        equations = LoopEquations(mechanism, inputs)
        program = closure_program(equations, open_names, points)
        self.parameters, self.values, self._points = program.open_names, program.values, len(points)
        self._equations, self._program = equations, program
        self.unknowns = tuple(str(x) for x in equations.unknown)
        self._phases = np.array([0.0 if x.link is None else equations.phase[x.link] for x in inputs])
        judge = self._judge = Judge(mechanism, inputs, self._phases, self.parameters, points)
        judge.mechanism_with(self.values)  # refuses a number that is no dimension
        states = Follower(program, "states", Target(backend, lanes, cache))
        path = Follower(program, "path", Target(backend, 1, cache))
        self._tracker = Tracker(program, equations, states, path, judge, lanes)
        try:
            self._start = self._start_at(mechanism.q0, self.values)
        except Lost as error:
            raise KernelError(f"{mechanism.name}: {error}") from error
        self.inputs = tuple(self._tracker.named(self._start.u))
        states.loaded.call(lanes)
        self.build_seconds = time.perf_counter() - start

    def _start_at(self, q: Array, p: Array) -> Start:
        x = loop_values(self._equations, self._judge.mechanism_with(p), q)
        return self._tracker.start(x[: self._program.unknowns], x[self._program.unknowns :], p)

    def turn(
        self, angles: int | Array = 3600, parameters: Array | None = None, threads: int = 1, out: Array | None = None
    ) -> Sweep:
        """One turn of the input from its start, or the values (k,) given; v and a are derivatives by the input.

        Args:
            angles: a number of equal steps, of which the last would be the start again, or values of the input [rad, m].
            parameters, threads, out: as in `sweep`.

        Raises:
            ValueError: several inputs, or numbers that are not finite.
        """
        if len(self.inputs) != 1:
            raise ValueError(f"{self.mechanism.name} has the inputs {', '.join(self.inputs)}; a turn is of one")
        if isinstance(angles, int):
            first = float(self._start.u[0] + self._phases[0])
            angles = first + 2 * np.pi / angles * np.arange(angles)
        return self.sweep(angles, parameters=parameters, threads=threads, out=out)

    def sweep(
        self,
        inputs: Array,
        rates: Array | None = None,
        second_rates: Array | None = None,
        parameters: Array | None = None,
        start: Array | None = None,
        threads: int = 1,
        out: Array | None = None,
    ) -> Sweep:
        """States at samples of the inputs, which go straight from one to the next.

        Args:
            inputs: (k,) of one input, (k, inputs), or (linkages, k, inputs) [rad, m].
            rates: as inputs; where None, 1 for a single input and 0 for several.
            second_rates: as inputs; 0 where None.
            parameters: (n_p,) or (linkages, n_p); those of the file where None.
            start: (n,) or (linkages, n) assembled positions to start from; where None, that of the file, with its dimensions
                changed little by little.
            threads: that share many linkages.
            out: `rows` of an earlier sweep of the same shape, to be overwritten: new memory costs more than what is written to it.
                Not used where samples lie so far apart that there must be steps between them.

        Raises:
            ValueError: shapes that do not fit, or numbers that are not finite.
        """
        levels = self._levels(inputs, rates, second_rates)
        p = self.values if parameters is None else np.asarray(parameters, dtype=float)
        if p.shape[-1:] != (len(self.parameters),) or not np.isfinite(p).all():
            raise ValueError(f"parameters of shape {p.shape}; {len(self.parameters)} are open: {', '.join(self.parameters)}")
        at = () if start is None else np.shape(start)[:-1]
        many = np.broadcast_shapes(levels.shape[:-2], p.shape[:-1], at)
        linkages = many[0] if many else 1
        divided = max(1, ceil(self._tracker.strides(levels[..., : len(self.inputs)])))
        if divided > 1:
            levels = _divide(levels, divided)
        starts = self._starts(p, start, linkages)
        one = [Motion(levels if levels.ndim == 2 else levels[i], p if p.ndim == 1 else p[i], x) for i, x in enumerate(starts)]
        rows = self._memory((linkages, len(one[0].levels), self._program.width), many, out if divided == 1 else None)
        status = np.zeros(rows.shape[:2], dtype=np.int8)
        losses = [replace(x, sample=-(-x.sample // divided)) for x in self._track(one, rows, status, threads)]
        rows, status = rows[:, ::divided], status[:, ::divided]
        return self._sweep(rows, status, losses) if many else self._sweep(rows[0], status[0], losses)

    def c_source(self) -> str:
        """Its routine in plain C, `follow` of `turns/follow.py`, for one lane."""
        return in_plain_c(follow(self._program, "states", plain=True))

    def _memory(self, shape: tuple[int, ...], many: tuple[int, ...], out: Array | None) -> Array:
        if out is None:
            return np.empty(shape)
        if out.shape != (shape if many else shape[1:]) or out.dtype != np.float64 or not out.flags.c_contiguous:
            raise ValueError(f"out of shape {out.shape} is not the memory of {shape if many else shape[1:]} doubles")
        return out.reshape(shape)

    def _levels(self, inputs: Array, rates: Array | None, second_rates: Array | None) -> Array:
        """Inputs, rates and second rates (..., k, 3 K)."""
        K = len(self.inputs)
        u = self._columns(inputs)
        if u.ndim not in (2, 3) or u.shape[-1] != K or not u.size:
            raise ValueError(f"inputs of shape {np.shape(inputs)} are not samples of {', '.join(self.inputs)}")
        levels = np.empty((*u.shape[:-1], 3 * K))
        levels[..., :K] = u - self._phases
        levels[..., K : 2 * K] = (1.0 if K == 1 else 0.0) if rates is None else self._columns(rates)
        levels[..., 2 * K :] = 0.0 if second_rates is None else self._columns(second_rates)
        if not np.isfinite(levels).all():
            raise ValueError("inputs or their rates are not finite")
        return levels

    def _columns(self, x: Array) -> Array:
        """Of one input a column."""
        x = np.asarray(x, dtype=float)
        return x[:, None] if x.ndim == 1 and len(self.inputs) == 1 else x

    def _starts(self, p: Array, start: Array | None, linkages: int) -> list[Start]:
        """The start of each linkage."""
        if start is None:
            nominal = p.ndim == 1 and bool((p == self.values).all())
            if nominal:
                return [self._start] * linkages
            starts = deform_starts(self._tracker, self._start, self.values, np.atleast_2d(p))
            return starts * linkages if len(starts) == 1 else starts
        at = np.broadcast_to(np.asarray(start, dtype=float), (linkages, self.mechanism.n))
        numbers = np.broadcast_to(p, (linkages, len(self.values)))
        return [self._start_or_fault(q, one) for q, one in zip(at, numbers, strict=True)]

    def _start_or_fault(self, q: Array, p: Array) -> Start:
        try:
            return self._start_at(q, p)
        except Lost as error:
            return replace(self._start, x=np.full_like(self._start.x, np.nan), fault=str(error))

    def _track(self, motions: list[Motion], rows: Array, status: Statuses, threads: int) -> list[Loss]:
        """Follow all motions: cut into parts while there are fewer than lanes, else side by side."""
        if len(motions) >= self.lanes:
            return self._tracker.track_many(motions, rows, status, threads)
        lost = [self._tracker.track(motion, rows[i], status[i]) for i, motion in enumerate(motions)]
        return [replace(x, linkage=i) for i, x in enumerate(lost) if x is not None]

    def _sweep(self, rows: Array, status: Statuses, losses: list[Loss]) -> Sweep:
        n = self.mechanism.n
        q, v, a = (rows[..., level * n : (level + 1) * n] for level in range(3))
        places = rows[..., 3 * n :].reshape(*rows.shape[:-1], self._points, 3, 2)
        return Sweep(q, v, a, places[..., 0, :], places[..., 1, :], places[..., 2, :], status, tuple(losses), rows)


def _divide(levels: Array, parts: int) -> Array:
    """(..., k, 3 K) with `parts` steps from each sample to the next; rates hold at the old samples only."""
    ends = levels[..., :-1, None, :], levels[..., 1:, None, :]
    steps = ends[0] + (np.arange(parts) / parts)[:, None] * (ends[1] - ends[0])
    inner = steps.reshape(*levels.shape[:-2], -1, levels.shape[-1])
    return np.concatenate([inner, levels[..., -1:, :]], axis=-2)
