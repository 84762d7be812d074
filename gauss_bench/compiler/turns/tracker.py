"""Distribution of the samples of one linkage over lanes, and recovery of stopped lanes.

The samples are cut into as many parts as there are lanes. One lane first finds the positions where parts begin, in strides of at
most STRIDE; then all parts are followed side by side.

Where a lane stops, the step to that sample is subdivided. If that fails too, `kinematics.loop_closure` tries the sample. If it
finds a limit or a singular position there, the motion ends, and no later sample is reported as closed.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from enum import IntEnum
from math import ceil, sqrt

import numpy as np
from numpy.typing import NDArray

from gauss_bench.compiler.elimination.closing import ClosingProgram
from gauss_bench.compiler.equations.sampling import typical_length
from gauss_bench.compiler.errors import KernelError
from gauss_bench.compiler.machine.native_code import Target
from gauss_bench.compiler.turns.follow import TURN, Follower
from gauss_bench.kinematics.errors import MotionError, SingularPosition
from gauss_bench.kinematics.loop_closure import loop_motion
from gauss_bench.mechanism.coordinates import value
from gauss_bench.mechanism.motion_laws import MotionLaw
from gauss_bench.terms import Array

STRIDE = 0.1  # [rad, lengths] step of an input from closure to closure: the error of the second-order prediction is a few 1e-4
MANY = 8  # angles: with more, strides are shorter
SUBDIVISIONS = (8, 64)  # numbers of parts of a step that could not be made at once
FEW = 4  # least number of samples in a part
LEAST = 1e-3  # bound of a guard, relative to its value at the start; below it `loop_closure` decides


class Status(IntEnum):
    """How a sample was closed."""

    CLOSED = 0  # by compiled code
    LIBRARY = 1  # by `kinematics.loop_closure`
    LOST = 2  # not at all: its numbers are NaN


@dataclass(frozen=True)
class Loss:
    """The place and the cause of a motion's end.

    Attributes:
        sample: index of the first sample that could not be closed.
        kind: "limit of motion" or "singular position".
        inputs: name of an input -> its last value that was reached [rad, m].
        text: the reason in one sentence.
    """

    sample: int
    kind: str
    inputs: Mapping[str, float]
    text: str


class Tracker:
    """Follows a linkage from its start. Arrays `levels` (k, 3, K) are values, rates and second rates of K inputs at k samples.

    Attributes:
        q, u: closed position (n,) and inputs (K,) at the start.
        least: (G,) bounds of the guards.
        per_stride: (K,) strides per unit of each input.

    Raises:
        KernelError: the start cannot be closed.
    """

    def __init__(self, program: ClosingProgram, target: Target):
        self.program, self.driven = program, program.driven
        self.follower, self.lanes, self.n = Follower(program, target), target.lanes, program.driven.n
        sizes = [1.0 if d.coordinate.unit == "rad" else typical_length(self.driven) for d in self.driven.drivers]
        many = max(1.0, sqrt(len(program.angles) / MANY))  # the bounds of steps and corrections are for the norm of all angles
        self.per_stride = many / STRIDE / np.array(sizes)
        q0, rows = self.driven.q0, np.empty((1, program.width))
        self.u = np.array([float(value(d.coordinate, q0)) for d in self.driven.drivers])
        closed, guards = self.follower.run(q0[None], np.zeros((1, program.guards)), _at_rest(self.u[None]), rows)
        if not closed[0]:
            raise KernelError(f"{self.driven.name}: the start is not closed, or at a singular position")
        self.q, self.least = rows[0, : self.n], LEAST * guards[0]

    def strides(self, u: Array) -> float:
        """Return the largest step between successive samples of the inputs u (k, K), as a multiple of STRIDE."""
        return float((np.abs(u[1:] - u[:-1]) * self.per_stride).max(initial=0.0))

    def track(self, levels: Array, stride: float, rows: Array, status: NDArray[np.int8]) -> Loss | None:
        """Fill rows (k, R) and status (k,); return the loss if the motion ends before the last sample.

        `stride` is the largest step between successive samples, as a multiple of STRIDE.
        """
        closed = self._follow_parts(levels, stride, rows)
        return self._finish(levels, rows, status, closed) if closed < len(rows) else None

    def _walk(self, u: Array) -> Array:
        """Return positions (m, n) at inputs u (m, K), followed from the start; NaN after the first failure."""
        step = u[0] - self.u
        lead = max(1, ceil(float(np.abs(step * self.per_stride).max())))  # samples from the start to u[0]
        rows = np.empty((lead + len(u), self.program.width))
        levels = _at_rest(np.concatenate([self.u + _fractions(lead) * step, u]))
        closed, _ = self.follower.run(self.q[None], self.least[None], levels, rows)
        rows[closed[0] :] = np.nan
        return rows[lead:, : self.n]

    def _follow_parts(self, levels: Array, stride: float, rows: Array) -> int:
        """Follow the linkage in parallel parts, of which the last may overlap the one before.

        Return the number of samples, from the first on, at which the loops were closed.

        Args:
            levels: (k, 3, K) value, rate and second rate of the inputs at every sample.
            stride: largest step between successive samples, as a multiple of STRIDE.
            rows: (k, R) receives what is stored of every sample.
        """
        k = len(rows)
        parts = self.lanes if k >= FEW * self.lanes else 1
        count = ceil(k / parts)  # samples of each part
        begins = np.minimum(np.arange(parts) * count, k - count)  # (parts,) index of the first sample of each part
        # one lane first walks to the beginning of every part, over some samples of each part that are at most STRIDE apart
        steps = min(count, max(1, ceil(count * stride)))
        stations = (begins[:-1, None] + np.diff(begins)[:, None] * np.arange(steps) // steps).ravel()
        q = self._walk(levels[[*stations, begins[-1]], 0])[::steps]  # (parts, n)
        ahead = levels.take(np.minimum(begins[:, None] + np.arange(count + 1), k - 1), axis=0)
        closed, _ = self.follower.run(q, self.least[None].repeat(parts, axis=0), ahead, rows)
        # a part whose first sample is far from the sample before is in another assembly, or a whole turn off
        gaps = (rows[begins[1:]] - rows[begins[1:] - 1])[:, self.program.angles]
        joined = np.append(True, (gaps * gaps).sum(axis=1) < (2 * TURN) ** 2)
        valid = np.where(joined, closed, 0)  # closed samples of each part
        incomplete = np.flatnonzero(valid < count)
        return int(begins[incomplete[0]] + valid[incomplete[0]]) if len(incomplete) else k

    def _finish(self, levels: Array, rows: Array, status: NDArray[np.int8], at: int) -> Loss | None:
        """Close the samples from `at` on, which the lanes left open; return the loss if the motion ends before the last one."""
        while at < len(rows):
            q, u = (rows[at - 1, : self.n], levels[at - 1, 0]) if at else (self.q, self.u)
            done = self._follow_in_small_steps(q, u, levels[at:], rows[at:])
            if done:
                at += done
                continue
            found = self._close_by_library(q, levels[at])
            if isinstance(found, Loss):
                rows[at:], status[at:] = np.nan, Status.LOST
                return replace(found, sample=at)
            rows[at], status[at], at = found, Status.LIBRARY, at + 1
        return None

    def _follow_in_small_steps(self, q: Array, u: Array, levels: Array, rows: Array) -> int:
        """Follow one lane from q, u, with the step to the first sample subdivided; return the number of closed samples."""
        for parts in SUBDIVISIONS:
            between = u + _fractions(parts) * (levels[0, 0] - u)
            ahead = np.concatenate([_at_rest(between)[:, :-1], levels[None], levels[None, -1:]], axis=1)
            found = np.empty((parts + len(rows), self.program.width))
            closed = int(self.follower.run(q[None], self.least[None], ahead, found)[0][0]) - parts
            if closed > 0:
                rows[:closed] = found[parts : parts + closed]
                return closed
        return 0

    def _close_by_library(self, q: Array, levels: Array) -> Array | Loss:
        """Close a sample with levels (3, K) near the position q by `loop_motion`; return its row of numbers, or the loss."""
        drivers = [replace(d, law=_hold(level)) for d, level in zip(self.driven.drivers, levels.T, strict=True)]
        try:
            motion = loop_motion(replace(self.driven, q0=q.copy(), drivers=tuple(drivers)), np.array([1.0]))
        except MotionError as error:
            kind = "singular position" if isinstance(error, SingularPosition) else "limit of motion"
            return Loss(0, kind, error.inputs, str(error).rpartition(": ")[2])
        return np.concatenate([motion.q[0], motion.v[0], motion.a[0]])


def _fractions(count: int) -> Array:
    """Return the fractions 0, 1 / count, 2 / count ... of a step, smaller than 1, as (count, 1)."""
    return np.arange(count)[:, None] / count


def _at_rest(u: Array) -> Array:
    """Return levels (1, k + 1, 3, K) of inputs u (k, K) with zero rates; the last row is repeated."""
    levels = np.zeros((1, len(u) + 1, 3, u.shape[1]))
    levels[0, :-1, 0], levels[0, -1, 0] = u, u[-1]
    return levels


def _hold(levels: Array) -> MotionLaw:
    """Return the law with a constant value, rate and second rate (3,)."""
    return MotionLaw("held", lambda t: (levels[0], levels[1], levels[2]))
