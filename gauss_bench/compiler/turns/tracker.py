"""Distribution of samples over lanes (one linkage cut into parts, or one linkage per lane), and recovery of stopped lanes.

The samples of one linkage are cut into as many parts as there are lanes. One lane first finds the positions where parts begin, in
strides of at most STRIDE; then all parts are followed side by side. With many linkages each lane follows one. Its start is reached
from the start of the file by changing the open parameters in small steps, with every guard keeping its sign.

Where a lane stops, the step to that sample is subdivided; if that fails too, `kinematics.loop_closure` tries it. A sample that it
closes is accepted; where it finds a limit or a singular position the motion ends, and no later sample is reported as closed.

Linkages with other dimensions than the file's need their own start, found by continuation: the parameters change in small, growing
steps, each with a guess extrapolated from the last two. Every guard keeps its sign on the way, so that the assembly is the same.
Source: Allgower and Georg, Introduction to Numerical Continuation Methods (2003), chapter 2.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from enum import IntEnum
from itertools import pairwise
from math import ceil, sqrt
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gauss_bench.compiler.elimination.closing import ClosingProgram
from gauss_bench.compiler.equations.links import with_parameters
from gauss_bench.compiler.equations.sampling import typical_length
from gauss_bench.compiler.machine.native_code import Target
from gauss_bench.compiler.turns.follow import TURN, Follower
from gauss_bench.kinematics.errors import MotionError, SingularPosition
from gauss_bench.kinematics.inputs import Input
from gauss_bench.kinematics.loop_closure import loop_motion
from gauss_bench.mechanism.coordinates import acceleration, position, value, velocity
from gauss_bench.mechanism.model import Mechanism
from gauss_bench.mechanism.motion_laws import MotionLaw
from gauss_bench.terms import Array

STRIDE = 0.1  # [rad, lengths] of an input between two closures: the second-order prediction then misses by a few 1e-4
MANY = 8  # angles; beyond, strides are shorter
SUBDIVISIONS = (8, 64)  # of a way that could not be gone at once
FEW = 4  # samples of a part, at least
LEAST = 1e-3  # of a guard at the start: below, the library decides, which refuses rates nearer to a singular position still
SIGN = 1e-300  # of a guard, whose sign alone is to be kept
STEPS = (32, 256)  # to other numbers; the last is the longest, a sixteenth or a 128th of the way
APART = "with these numbers the linkage cannot be assembled where the file has it, coming from there"


class Status(IntEnum):
    """How a sample was closed: natively, by the library's loop closure, or not at all."""

    CLOSED = 0
    LIBRARY = 1  # by the library's closure
    LOST = 2  # not: the numbers are NaN


@dataclass(frozen=True)
class Loss:
    """The place and the cause of a motion's end.

    Attributes:
        linkage: row of the parameters; 0 for one linkage.
        sample: the first that could not be closed.
        kind: "limit of motion", "singular position" or "not assembled".
        inputs: name -> last value reached [rad, m].
        text: one sentence.
    """

    linkage: int
    sample: int
    kind: str
    inputs: Mapping[str, float]
    text: str


@dataclass(frozen=True, eq=False)
class Linkages:
    """Start positions of some linkages of one structure.

    Attributes:
        p: (linkages, n_p) open numbers.
        q: (linkages, n) closed positions, NaN where there is none. u: (linkages, K) inputs there.
        least: (linkages, G) lower bounds of the guards.
        faults: (linkages,) why there is no start; "" where there is one.
    """

    p: Array
    q: Array
    u: Array
    least: Array
    faults: NDArray[np.str_]

    def take(self, index: slice | NDArray[np.integer[Any]]) -> "Linkages":
        """Select linkages by index, also repeatedly."""
        return Linkages(self.p[index], self.q[index], self.u[index], self.least[index], self.faults[index])


class Tracker:
    """Follows linkages of a program; levels (linkages or 1, k, 3, K) are values, rates and second rates of the inputs."""

    def __init__(self, program: ClosingProgram, target: Target, inputs: Sequence[Input]):
        self.program, self.inputs = program, inputs
        self.follower, self.lanes, self.n = Follower(program, target), target.lanes, program.driven.n
        sizes = [1.0 if d.coordinate.unit == "rad" else typical_length(program.driven) for d in program.driven.drivers]
        many = max(1.0, sqrt(len(program.angles) / MANY))  # what bounds a way and a correction is the norm of all angles
        self.per_stride = many / STRIDE / np.array(sizes)

    def linkage(self, p: Array) -> Mechanism:
        """Return the mechanism with open parameters p (n_p,), or with arrays of them (n_p, k)."""
        return with_parameters(self.program.driven, dict(zip(self.program.open_names, p, strict=True)))

    def name(self, u: Array) -> dict[str, float]:
        """Return the inputs by name."""
        return {d.name: float(x) for d, x in zip(self.program.driven.drivers, u, strict=True)}

    def starts(self, q: Array, p: Array) -> Linkages:
        """Build `Linkages` from assembled positions (linkages, n) and parameters p (linkages, n_p)."""
        u = np.stack([np.broadcast_to(value(d.coordinate, q), len(q)) for d in self.linkage(p.T).drivers], axis=-1)
        rows = np.empty((len(q), self.program.width))
        closed, guards = self.follower.run(q, np.zeros((len(q), self.program.guards)), _at_rest(u[:, None], len(u)), p, rows)
        faults = np.where(closed, "", "the start is not closed, or at a singular position")
        return Linkages(p, np.where(closed[:, None], rows[:, : self.n], np.nan), u, LEAST * guards, faults)

    def deform(self, start: Linkages, p: Array) -> Linkages:
        """Find the starts of linkages with parameters p (linkages, n_p) by continuation from a known start."""
        first = start.take(np.zeros(len(p), dtype=int))
        q, least = np.full_like(first.q, np.nan), first.least.copy()
        for steps in STEPS:
            left = np.flatnonzero(~np.isfinite(q).all(axis=1))
            if len(left):
                q[left], least[left] = self._deform(first.take(left), p[left], steps)
        return Linkages(p, q, first.u, least, np.where(np.isfinite(q).all(axis=1), "", APART))

    def _deform(self, first: Linkages, p: Array, steps: int) -> tuple[Array, Array]:
        """Return positions (linkages, n), NaN where lost, and the lower bounds of the guards there."""
        signs, levels = SIGN * np.sign(first.least), _at_rest(first.u[:1, None], 1)
        before = q = first.q
        last, rows = 1.0, np.empty((len(p), self.program.width))
        for a, b in pairwise(np.linspace(0.0, 1.0, steps + 1) ** 2):
            guess = q + (q - before) * ((b - a) / last)
            closed, guards = self.follower.run(guess, signs, levels, first.p + b * (p - first.p), rows)
            q, before, last = np.where(closed[:, None], rows[:, : self.n], np.nan), q, b - a
        return q, LEAST * guards

    def strides(self, u: Array) -> float:
        """Return the largest distance of neighbouring samples (..., k, K), in strides."""
        return float((np.abs(u[..., 1:, :] - u[..., :-1, :]) * self.per_stride).max(initial=0.0))

    def track(
        self, some: Linkages, levels: Array, stride: float, rows: Array, status: NDArray[np.int8], threads: int = 1
    ) -> list[Loss]:
        """Fill rows (linkages, k, R) and status (linkages, k): many linkages side by side, a few one by one in parts.

        `stride` is the largest distance of neighbouring samples, in strides.
        """
        count, k = status.shape
        every = np.broadcast_to(levels, (count, *levels.shape[1:]))
        if count < self.lanes:
            closed = [self._follow_parts(some.take(slice(i, i + 1)), every[i], stride, rows[i]) for i in range(count)]
        else:
            q = self._walk(some, levels[:, :1, 0])[:, -1]
            flat, ahead = rows.reshape(-1, self.program.width), np.concatenate([levels, levels[:, -1:]], axis=1)
            closed = self.follower.run(q, some.least, ahead, some.p, flat, threads)[0].tolist()
        losses = [
            (i, self._finish(some.take(slice(i, i + 1)), every[i], rows[i], status[i], done))
            for i, done in enumerate(closed)
            if done < k
        ]
        return [replace(loss, linkage=i) for i, loss in losses if loss is not None]

    def _walk(self, some: Linkages, u: Array) -> Array:
        """Return positions (linkages, m, n) at inputs u (linkages or 1, m, K) from each start; NaN after the first failure."""
        way = u[:, 0] - some.u
        lead = max(1, ceil(float(np.abs(way * self.per_stride).max())))
        levels = _at_rest(u, len(way), lead)
        levels[:, :lead, 0] = some.u[:, None] + _parts(lead) * way[:, None]
        rows = np.empty((len(way), lead + u.shape[1], self.program.width))
        closed, _ = self.follower.run(some.q, some.least, levels, some.p, rows.reshape(-1, self.program.width))
        q = rows[:, lead:, : self.n]
        q[np.arange(lead, rows.shape[1]) >= closed[:, None]] = np.nan
        return q

    def _follow_parts(self, one: Linkages, levels: Array, stride: float, rows: Array) -> int:
        """Follow one linkage in parallel parts, the last of which may overlap; return the number of closed samples."""
        k = len(rows)
        parts = self.lanes if k >= FEW * self.lanes else 1
        count = -(-k // parts)
        begins = np.minimum(np.arange(parts) * count, k - count)
        each = min(count, max(1, ceil(count * stride)))
        # one lane first walks to the beginning of every part, in `each` substeps per part
        nodes = (begins[:-1, None] + np.diff(begins)[:, None] * np.arange(each) // each).ravel()
        q = self._walk(one, levels[None, [*nodes, begins[-1]], 0])[0, ::each]
        ahead = levels.take(np.minimum(begins[:, None] + np.arange(count + 1), k - 1), axis=0)
        closed, _ = self.follower.run(q, one.least.repeat(parts, axis=0), ahead, one.p.repeat(parts, axis=0), rows)
        gaps = (rows[begins[1:]] - rows[begins[1:] - 1])[:, self.program.angles]
        joined = np.append(True, (gaps * gaps).sum(axis=1) < (2 * TURN) ** 2)  # else a part is in another assembly or a turn off
        first = int(np.argmin(joined & (closed == count)))
        return k if joined[first] and closed[first] == count else int(begins[first] + (closed[first] if joined[first] else 0))

    def _finish(self, one: Linkages, levels: Array, rows: Array, status: NDArray[np.int8], at: int) -> Loss | None:
        """Close the samples from `at` on that a lane left open; return the loss if the motion ends before the last."""
        loss = Loss(0, 0, "not assembled", self.name(one.u[0]), str(one.faults[0])) if one.faults[0] else None
        while loss is None and at < len(rows):
            q, u = (rows[at - 1, : self.n], levels[at - 1, 0]) if at else (one.q[0], one.u[0])
            done = self._onward(one, q, u, levels[at:], rows[at:])
            if done:
                at += done
                continue
            found = self._ask(one.p[0], q, levels[at])
            if isinstance(found, Loss):
                loss = replace(found, sample=at)
            else:
                rows[at], status[at], at = found, Status.LIBRARY, at + 1
        if loss is not None:
            rows[loss.sample :], status[loss.sample :] = np.nan, Status.LOST
        return loss

    def _onward(self, one: Linkages, q: Array, u: Array, levels: Array, rows: Array) -> int:
        """Follow one lane from q, u with the step to the first sample subdivided; return the number of closed samples."""
        for parts in SUBDIVISIONS:
            way = u + _parts(parts) * (levels[0, 0] - u)
            ahead = np.concatenate([_at_rest(way[None], 1)[:, :-1], levels[None], levels[None, -1:]], axis=1)
            found = np.empty((parts + len(rows), self.program.width))
            closed = int(self.follower.run(q[None], one.least, ahead, one.p, found)[0][0]) - parts
            if closed > 0:
                rows[:closed] = found[parts : parts + closed]
                return closed
        return 0

    def _ask(self, p: Array, q: Array, levels: Array) -> Array | Loss:
        """Close the sample after q by `loop_motion`; return its row of numbers, or the reason why it cannot be reached."""
        mechanism = replace(self.linkage(p), q0=q.copy())
        given = [replace(x, law=_hold(level)) for x, level in zip(self.inputs, levels.T, strict=True)]
        try:
            motion = loop_motion(mechanism, given, np.array([1.0]))
        except MotionError as error:
            kind = "singular position" if isinstance(error, SingularPosition) else "limit of motion"
            return Loss(0, 0, kind, error.inputs, str(error).rpartition(": ")[2])
        (q,), (v,), (a,) = motion.q, motion.v, motion.a
        points = [x for p in mechanism.observed_points for x in (position(q, p), velocity(q, v, p), acceleration(q, v, a, p))]
        return np.concatenate([q, v, a, *points])


def _parts(count: int) -> Array:
    """Return the fractions 0, 1 / count, ... (count, 1) of a step."""
    return np.arange(count)[:, None] / count


def _at_rest(u: Array, linkages: int, lead: int = 0) -> Array:
    """Return levels (linkages, lead + k + 1, 3, K) of inputs (linkages or 1, k, K) with zero rates; the last row is repeated."""
    levels = np.zeros((linkages, lead + u.shape[1] + 1, 3, u.shape[2]))
    levels[:, lead:-1, 0], levels[:, -1, 0] = u, u[:, -1]
    return levels


def _hold(levels: Array) -> MotionLaw:
    """Return the law with a constant value, rate and second rate (3,)."""
    return MotionLaw("held", lambda t: (levels[0], levels[1], levels[2]))
