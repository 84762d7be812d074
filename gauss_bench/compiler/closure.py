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

from gauss_bench.compiler.elimination.closing import closing_program
from gauss_bench.compiler.errors import KernelError
from gauss_bench.compiler.machine.native_code import Target, choose_target
from gauss_bench.compiler.turns.tracker import Linkages, Loss, Status, Tracker
from gauss_bench.kinematics.inputs import Input, inputs_of
from gauss_bench.kinematics.loop_equations import LoopEquations
from gauss_bench.mechanism.model import Mechanism, Point
from gauss_bench.mechanism.motion_laws import constant
from gauss_bench.terms import Array

__all__ = ["Closure", "Loss", "Status", "Sweep", "compile_closure"]

Statuses = NDArray[np.int8]

PARTS = 32  # lanes of the numpy backend: they share the overhead of a call


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
    """Compile the closure of a mechanism.

    Args:
        lanes: samples or linkages in one vector, a power of 2; chosen for the host where None.
        open_parameters: names of dimensions to be given with each sweep, such as "points.rod.B.x", "links.rod.com.x" or
            "joints.guide.offset".
        backend: "llvm", or "numpy" without a compiler; None for the first that is installed.
        cache: whether object code is kept in the user's cache folder.
        points: points whose positions, velocities and accelerations are returned too.
        inputs: the driven coordinates; if None, the drivers of the scenario, else the crank. Their laws are not used.

    Raises:
        KernelError: an unknown name, no usable pivots, a start at a singular position, or a backend that is not there.
        ValueError: knife edges, or inputs that do not fit the linkage.
    """
    target = choose_target(backend, lanes, cache)
    if target.backend == "numpy" and lanes is None:
        target = replace(target, lanes=PARTS)
    if inputs is None:
        free = not mechanism.drivers and mechanism.crank is not None
        inputs = (Input(constant(0.0, 1.0), link=mechanism.crank),) if free else inputs_of(mechanism)
    return Closure(mechanism, tuple(inputs), tuple(open_parameters), tuple(points), target)


class Closure:
    """Compiled closure of one linkage.

    Attributes:
        mechanism: the compiled mechanism. backend: "llvm" or "numpy". lanes: samples in one vector.
        inputs: names of the driven coordinates, in the order of every `inputs` argument.
        parameters: names of the open parameters, in the order of every `parameters` argument. values: those of the file.
        build_seconds: time to generate the program and to compile or load its code.
    """

    def __init__(
        self,
        mechanism: Mechanism,
        inputs: tuple[Input, ...],
        open_names: tuple[str, ...],
        points: tuple[Point, ...],
        target: Target,
    ):
        start = time.perf_counter()
        self.mechanism, self.backend, self.lanes = mechanism, target.backend, target.lanes
        LoopEquations(mechanism, inputs)  # only for its check of the inputs
        for name in open_names:
            if name.startswith(("forces.", "gravity.")) or name.endswith((".mass", ".inertia")):
                raise KernelError(f"{name} is no dimension of {mechanism.name}: kinematics does not depend on it")
        program = closing_program(replace(mechanism, observed_points=points), inputs, open_names)
        self.parameters, self.values, self._points = program.open_names, program.values, len(points)
        self._tracker = Tracker(program, target, inputs)
        self._start = self._tracker.starts(mechanism.q0[None], self.values[None])
        if self._start.faults[0]:
            raise KernelError(f"{mechanism.name}: {self._start.faults[0]}")
        self.inputs = tuple(self._tracker.name(self._start.u[0]))
        self._tracker.follower.loaded.call(self.lanes)
        self.build_seconds = time.perf_counter() - start

    def turn(
        self, angles: int | Array = 3600, parameters: Array | None = None, threads: int = 1, out: Array | None = None
    ) -> Sweep:
        """Sweep one turn of the input from its start, or given values (k,); v and a are derivatives by the input.

        Args:
            angles: number of equal steps in the turn (the end point is left out), or values of the input [rad, m].
            parameters, threads, out: as in `sweep`.

        Raises:
            ValueError: several inputs, or numbers that are not finite.
        """
        if len(self.inputs) != 1:
            raise ValueError(f"{self.mechanism.name} has the inputs {', '.join(self.inputs)}; a turn is of one")
        if isinstance(angles, int):
            angles = float(self._start.u[0, 0]) + 2 * np.pi / angles * np.arange(angles)
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
        """Compute the states at samples of the inputs, followed along straight lines from one sample to the next.

        Args:
            inputs: (k,) of one input, (k, inputs), or (linkages, k, inputs) [rad, m].
            rates: as inputs; where None, 1 for a single input and 0 for several.
            second_rates: as inputs; 0 where None.
            parameters: (n_p,) or (linkages, n_p); those of the file where None.
            start: (n,) or (linkages, n) assembled positions to start from; if None, that of the file, continued to the given
                dimensions in small steps.
            threads: number of threads that share many linkages.
            out: `rows` of an earlier sweep of the same shape, to be overwritten: allocating memory takes longer than filling it.
                Not used if samples are so far apart that intermediate steps are needed.

        Raises:
            ValueError: shapes that do not fit, or numbers that are not finite.
        """
        levels = self._levels(inputs, rates, second_rates)
        p = self.values if parameters is None else np.asarray(parameters, dtype=float)
        if p.shape[-1:] != (len(self.parameters),) or not np.isfinite(p).all():
            raise ValueError(f"parameters of shape {p.shape}; {len(self.parameters)} are open: {', '.join(self.parameters)}")
        many = np.broadcast_shapes(levels.shape[:-3], p.shape[:-1], () if start is None else np.shape(start)[:-1])
        # samples that are too far apart for one step get intermediate ones, which are removed from the result below
        stride = self._tracker.strides(levels[..., 0, :])
        divided = max(1, ceil(stride))
        if divided > 1:
            levels = _divide(levels, divided)
        some = self._linkages(np.broadcast_to(p, (many[0] if many else 1, len(self.parameters))), start)
        rows = self._memory((*many, levels.shape[-3], self._tracker.program.width), out if divided == 1 else None)
        status = np.zeros((len(some.p), levels.shape[-3]), dtype=np.int8)
        each = rows if many else rows[None]
        found = self._tracker.track(some, levels if levels.ndim > 3 else levels[None], stride / divided, each, status, threads)
        losses = tuple(replace(x, sample=-(-x.sample // divided)) for x in found)  # the next sample that was asked for
        rows, status = rows[..., ::divided, :], (status if many else status[0])[..., ::divided]
        n, shape = self.mechanism.n, (*status.shape, self._points, 3, 2)
        q, v, a = (rows[..., level * n : (level + 1) * n] for level in range(3))
        places = rows[..., self._tracker.program.width - 6 * self._points :].reshape(shape)
        return Sweep(q, v, a, places[..., 0, :], places[..., 1, :], places[..., 2, :], status, losses, rows)

    def _linkages(self, p: Array, start: Array | None) -> Linkages:
        """Return the linkages with parameters p (linkages, n_p) at their start positions."""
        if start is not None:
            return self._tracker.starts(np.broadcast_to(np.asarray(start, dtype=float), (len(p), self.mechanism.n)), p)
        if not (p == self.values).all():
            return self._tracker.deform(self._start, p)
        return self._start if len(p) == 1 else self._start.take(np.zeros(len(p), dtype=int))

    def _memory(self, shape: tuple[int, ...], out: Array | None) -> Array:
        if out is not None and (out.shape != shape or out.dtype != np.float64 or not out.flags.c_contiguous):
            raise ValueError(f"out of shape {out.shape} is not the memory of {shape} doubles")
        return np.empty(shape) if out is None else out

    def _levels(self, inputs: Array, rates: Array | None, second_rates: Array | None) -> Array:
        """Stack inputs, rates and second rates as (..., k, 3, K), K inputs, and check them."""
        K, u = len(self.inputs), self._columns(inputs)
        if u.ndim not in (2, 3) or u.shape[-1] != K or not u.size:
            raise ValueError(f"inputs of shape {np.shape(inputs)} are not samples of {', '.join(self.inputs)}")
        levels = np.empty((*u.shape[:-1], 3, K))
        levels[..., 0, :], levels[..., 1, :] = u, (1.0 if K == 1 else 0.0) if rates is None else self._columns(rates)
        levels[..., 2, :] = 0.0 if second_rates is None else self._columns(second_rates)
        if not np.isfinite(levels).all():
            raise ValueError("inputs or their rates are not finite")
        return levels

    def _columns(self, x: Array) -> Array:
        """Return samples (k,) of a single input as a column (k, 1), other arrays as they are."""
        x = np.asarray(x, dtype=float)
        return x[:, None] if x.ndim == 1 and len(self.inputs) == 1 else x


def _divide(levels: Array, parts: int) -> Array:
    """Interpolate levels (..., k, 3, K) with `parts` steps between samples; rates are meaningful at the original samples only."""
    before, after = levels[..., :-1, None, :, :], levels[..., 1:, None, :, :]
    steps = before + (np.arange(parts) / parts)[:, None, None] * (after - before)
    inner = steps.reshape(*levels.shape[:-3], -1, *levels.shape[-2:])
    return np.concatenate([inner, levels[..., -1:, :, :]], axis=-3)
