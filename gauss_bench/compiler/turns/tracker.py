"""Distribution of the samples of one linkage over the lanes of a vector, and recovery where the loops cannot be closed at once.

A sample is closed if positions are found at which the constraints hold for the inputs of the sample. The samples are cut into as
many parts as there are lanes (elements of a vector register). A single lane first finds the positions at which the parts of the
motion begin, in steps of at most STRIDE; then all parts are computed side by side, each in its lane.

If a lane cannot close a sample, the step to that sample is divided into smaller steps. If these fail too, `kinematics.loop_closure`
tries to close the sample; if it finds a limit of motion or a singular position, the motion ends.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from math import ceil, sqrt
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gauss_bench.compiler.elimination.closing import ClosingProgram
from gauss_bench.compiler.equations.sampling import typical_length
from gauss_bench.compiler.errors import KernelError
from gauss_bench.compiler.machine.native_code import Loaded, Target, in_lanes
from gauss_bench.compiler.turns.follow import TURN, follow
from gauss_bench.kinematics.loop_closure import loop_motion
from gauss_bench.kinematics.motion import MotionError, SingularPosition
from gauss_bench.mechanism.coordinates import value
from gauss_bench.mechanism.motion_laws import MotionLaw
from gauss_bench.terms import Array

STRIDE = 0.1  # [rad, typical lengths] longest step of an input: the error of the second-order prediction is a few 1e-4
MANY = 8  # number of angles above which steps are shorter than STRIDE
SUBDIVISIONS = (8, 64)  # numbers of parts of a step that could not be made at once
FEW = 4  # smallest number of samples in a part of a motion that is divided among lanes
LEAST = 1e-3  # smallest ratio of a guard (a pivot) to its value at the start; below this ratio, `loop_closure` decides


@dataclass(frozen=True)
class Loss:
    """The place and the cause of a motion's end.

    Attributes:
        sample: index of the first sample that is not closed.
        kind: "limit of motion" or "singular position".
        inputs: name of an input -> its last value that was reached [rad, m].
        text: the reason in words.
    """

    sample: int
    kind: str
    inputs: Mapping[str, float]
    text: str


class Tracker:
    """Computes the motion of a linkage for samples of its inputs, beginning at its start.

    Arrays `levels` (k, 3, K) are values, first and second time derivatives of K inputs at k samples. Arrays `rows` (k, R) receive
    q, v and a of each sample, R = 3n.

    Attributes:
        q, u: position (n,) with closed loops, and inputs (K,), at the start.
        least: (G,) lower bounds of the guards, with the signs that the guards have at the start.
        per_stride: (K,) number of steps of the size STRIDE per unit change [rad, m] of each input.
    """

    def __init__(self, program: ClosingProgram, target: Target):
        """Close the linkage at its start.

        Raises:
            KernelError: the loops cannot be closed at the start, or the start is at a singular position.
        """
        self.program, self.driven = program, program.driven
        self.loaded = Loaded(lambda many: follow(program, target.backend == "numpy"), target)
        self.lanes, self.n = target.lanes, program.driven.n
        sizes = [1.0 if d.coordinate.unit == "rad" else typical_length(self.driven) for d in self.driven.drivers]
        # `follow` limits the norm over all angles of steps and corrections, which grows with the root of the number of angles:
        # linkages with more than MANY angles get shorter steps
        shorter = max(1.0, sqrt(len(program.angles) / MANY))
        self.per_stride = shorter / STRIDE / np.array(sizes)
        q0, rows = self.driven.q0, np.empty((1, program.width))
        self.u = np.array([float(value(d.coordinate, q0)) for d in self.driven.drivers])
        closed, guards = self.follow(q0[None], np.zeros((1, program.guards)), _at_rest(self.u[None]), rows)
        if not closed[0]:
            raise KernelError(f"{self.driven.name}: the start is not closed, or at a singular position")
        self.q, self.least = rows[0, : self.n], LEAST * guards[0]

    def follow(self, q: Array, least: Array, inputs: Array, rows: Array) -> tuple[NDArray[np.integer[Any]], Array]:
        """Compute the samples of each lane one after the other, starting with a guess for the position at the first sample.

        Return for each lane the number of samples before the first one that could not be closed (lanes,), and the guards at the
        last sample that was computed (lanes, G).

        Args:
            q: (lanes, n) guesses at the first samples.
            least: (lanes, G) smallest admissible magnitudes of the guards, with the guards' signs.
            inputs: (lanes, samples + 1, 3, K) values, first and second time derivatives. The last row is needed for a guess beyond
                the last sample; only its values matter.
            rows: (any, R) array for the stored numbers. The array begins with the samples of the first lane, then come the samples
                of the second lane, and so on; it ends with the samples of the last lane. If the array is too short for the samples
                of all lanes, the last lanes share some rows, and must have the same inputs at the samples in shared rows. For
                example, with 5 rows and two lanes of 3 samples each, the first lane has rows 0 to 2, the second rows 2 to 4.
        """
        lanes, samples = self.loaded.lanes(len(q)), inputs.shape[1] - 1
        guesses, bounds, levels = (in_lanes(a, lanes) for a in (q, least, inputs.reshape(len(inputs), -1)))
        report, out = np.empty((len(guesses), 1 + self.program.guards, lanes)), rows.reshape(-1)
        block = samples * self.program.width  # numbers of one lane
        last = out.size - block  # where the numbers of the last lane begin
        arguments = self.loaded.as_arguments([guesses, bounds, levels, out, report])
        self.loaded.call(lanes)(*arguments, samples, inputs[0].size, block, last, len(guesses))
        # from (groups, 1 + G, lanes of a group) to (lanes, 1 + G), without the copies that fill the last group
        of_lanes = report.transpose(0, 2, 1).reshape(-1, report.shape[1])[: len(q)]
        return of_lanes[:, 0].astype(int), of_lanes[:, 1:]

    def longest_stride(self, u: Array) -> float:
        """Return the largest change of an input between successive samples of the inputs u (k, K), as a multiple of STRIDE."""
        return float((np.abs(u[1:] - u[:-1]) * self.per_stride).max(initial=0.0))

    def track(self, levels: Array, stride: float, rows: Array) -> Loss | None:
        """Compute the motion at all samples; return where and why it ends before the last sample, or None if it does not.

        Args:
            levels: (k, 3, K) values, first and second time derivatives of the inputs at the samples.
            stride: largest change of an input between successive samples, as a multiple of STRIDE.
            rows: (k, R) array that receives q, v and a of every sample, NaN where the linkage is not closed.
        """
        return self._finish(levels, rows, self._follow_parts(levels, stride, rows))

    def _walk(self, u: Array) -> Array:
        """Return positions (m, n) at inputs u (m, K), computed in a single lane; NaN from the first input on that it cannot close.

        The lane moves from the start to u[0] in steps of at most STRIDE, and then through u, one step from each input to the next.
        """
        step = u[0] - self.u
        lead = max(1, ceil(float(np.abs(step * self.per_stride).max())))  # samples from the start to u[0]
        rows = np.empty((lead + len(u), self.program.width))
        levels = _at_rest(np.concatenate([self.u + _fractions(lead) * step, u]))
        closed, _ = self.follow(self.q[None], self.least[None], levels, rows)
        rows[closed[0] :] = np.nan  # closed[0] is the number of samples that the lane closed
        return rows[lead:, : self.n]

    def _follow_parts(self, levels: Array, stride: float, rows: Array) -> int:
        """Compute the motion in parts, one in each lane; return the number of samples before the first that cannot be closed.

        All parts have the same number of samples, and the last one ends with the last sample, so that parts may overlap.
        """
        k = len(rows)
        parts = self.lanes if k >= FEW * self.lanes else 1
        count = ceil(k / parts)  # samples of each part
        begins = np.minimum(np.arange(parts) * count, k - count)  # (parts,) index of the first sample of each part
        # a single lane first moves to the beginning of every part. From one beginning to the next it closes the linkage at `steps`
        # of the samples, the stations, which are about STRIDE apart
        steps = min(count, max(1, ceil(count * stride)))
        stations = (begins[:-1, None] + np.diff(begins)[:, None] * np.arange(steps) // steps).ravel()
        q = self._walk(levels[[*stations, begins[-1]], 0])[::steps]  # (parts, n) positions at the beginnings
        # then all lanes together compute their parts; each reads the inputs of one sample more, for which it makes its last guess
        ahead = levels.take(np.minimum(begins[:, None] + np.arange(count + 1), k - 1), axis=0)  # (parts, count + 1, 3, K)
        closed, _ = self.follow(q, self.least[None].repeat(parts, axis=0), ahead, rows)
        # a part whose first sample is far from the sample before is in another assembly mode, or a whole turn off, and is not used
        gaps = (rows[begins[1:]] - rows[begins[1:] - 1])[:, self.program.angles]
        joined = np.append(True, (gaps * gaps).sum(axis=1) < (2 * TURN) ** 2)
        valid = np.where(joined, closed, 0)  # closed samples of each part
        incomplete = np.flatnonzero(valid < count)
        return int(begins[incomplete[0]] + valid[incomplete[0]]) if len(incomplete) else k

    def _finish(self, levels: Array, rows: Array, sample: int) -> Loss | None:
        """Compute the samples from index `sample` on, the first at which a lane could not close the linkage in one step.

        Return where and why the motion ends before the last sample, or None if it does not.
        """
        while sample < len(rows):
            q, u = (rows[sample - 1, : self.n], levels[sample - 1, 0]) if sample else (self.q, self.u)
            closed = self._follow_in_small_steps(q, u, levels[sample:], rows[sample:])
            if closed:
                sample += closed
                continue
            row = self._close_by_library(q, levels[sample])
            if isinstance(row, Loss):
                rows[sample:] = np.nan
                return replace(row, sample=sample)
            rows[sample], sample = row, sample + 1
        return None

    def _follow_in_small_steps(self, q: Array, u: Array, levels: Array, rows: Array) -> int:
        """Compute samples in one lane, with the step to the first sample divided into 8 or 64 smaller steps (SUBDIVISIONS).

        Return the number of samples that were closed before the first failure.

        Args:
            q, u: position (n,) with closed loops and inputs (K,) from which the step begins.
            levels: (k, 3, K) values, first and second time derivatives of the inputs at the samples.
            rows: (k, R) array whose first rows receive q, v and a of the samples that are closed.
        """
        for parts in SUBDIVISIONS:
            between = u + _fractions(parts) * (levels[0, 0] - u)
            # `parts` samples from u on, with zero derivatives, without the repeated last one of `_at_rest`; then the samples to be
            # computed, with the last one repeated, because the routine reads the inputs of one sample more than it closes
            ahead = np.concatenate([_at_rest(between)[:, :-1], levels[None], levels[None, -1:]], axis=1)
            all_rows = np.empty((parts + len(rows), self.program.width))
            (closed,), _ = self.follow(q[None], self.least[None], ahead, all_rows)
            if closed > parts:
                rows[: closed - parts] = all_rows[parts:closed]
                return int(closed) - parts
        return 0

    def _close_by_library(self, q: Array, levels: Array) -> Array | Loss:
        """Close one sample near the position q (n,) by `loop_motion`; return its row (R,), or a `Loss` with the reason."""
        # every driver gets a law with the same value and derivatives at all times, so that the time 1.0 below is arbitrary
        drivers = [replace(d, law=_hold(level)) for d, level in zip(self.driven.drivers, levels.T, strict=True)]
        try:
            motion = loop_motion(replace(self.driven, q0=q.copy(), drivers=tuple(drivers)), np.array([1.0]))
        except MotionError as error:
            kind = "singular position" if isinstance(error, SingularPosition) else "limit of motion"
            reason = str(error).rpartition(": ")[2]  # the message gives the place, then ": " and the reason
            return Loss(sample=0, kind=kind, inputs=error.inputs, text=reason)  # the caller enters the sample
        return np.concatenate([motion.q[0], motion.v[0], motion.a[0]])


def _fractions(count: int) -> Array:
    """Return the fractions 0, 1 / count, 2 / count ... of a step, smaller than 1, as (count, 1)."""
    return np.arange(count)[:, None] / count


def _at_rest(u: Array) -> Array:
    """Return inputs u (k, K) with zero time derivatives, in the layout (1, k + 1, 3, K) that the routine `follow` reads.

    The last sample is repeated, because the routine reads the inputs of one sample beyond the last one that it closes.
    """
    levels = np.zeros((1, len(u) + 1, 3, u.shape[1]))
    levels[0, :-1, 0], levels[0, -1, 0] = u, u[-1]
    return levels


def _hold(levels: Array) -> MotionLaw:
    """Return the law that has the given value, first and second time derivative (3,) at every time."""
    return MotionLaw("held", lambda t: (levels[0], levels[1], levels[2]))
