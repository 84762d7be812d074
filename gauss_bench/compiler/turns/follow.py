"""The routine that follows a linkage from sample to sample: each lane follows a part of the samples.

    follow(q, least, inputs, out, report; samples, shift, block, last)

With n coordinates, K inputs, G guards and R numbers that are stored at each sample, the arrays have these rows, each with one
number for each lane:

    q        n                     guess at the first sample
    least    G                     bound of each guard, with the guard's sign
    inputs   (samples + 1) x 3 K   values, rates, second rates; those of the next group begin `shift` rows further on
    out      R for each sample     lane k's samples, side by side; they begin at min(k block, last)
    report   1 + G                 number of samples closed before the first that could not be, and the guards at the last sample

A sample is closed if the last correction was shorter than SETTLED, no correction was longer than the reach of the rotation, the
guess was near the previous sample, and no guard is below its bound. What is stored after the first sample that is not closed is
invalid. `tracker.py` decides how such a lane continues.

Newton's method starts at a guess whose sines are computed from scratch, so that no rounding is carried from sample to sample. A
correction moves q by z and rotates its sines, which is exact because z is short.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gauss_bench.compiler.elimination.closing import ClosingProgram
from gauss_bench.compiler.machine import trigonometry
from gauss_bench.compiler.machine.graph import Graph, Pair, count_operations, inline, live
from gauss_bench.compiler.machine.native_code import Loaded, Target, in_lanes
from gauss_bench.compiler.machine.rewrite import rewrite
from gauss_bench.compiler.machine.routine import Array, Compute, Load, Loop, Routine, Scatter, Statement, Store
from gauss_bench.compiler.machine.schedule import order
from gauss_bench.terms import Array as Floats

REACH = 0.0065  # [rad] norm of one correction: two terms of the rotation are exact so far, and no other assembly is near
SETTLED = 1e-8  # [rad] norm of the last correction: its square is left as error
TURN = 0.3  # [rad] norm of the distance to the guess: far less than lies between two assemblies
LEVELS = 3  # rows of inputs of a sample: values u, rates w and second rates b; the values n of the next sample stand behind them
LIMIT = 8  # corrections; from the farthest guess that is accepted quadratic convergence needs four


@dataclass(frozen=True, eq=False)
class _Sample:
    """The values that one sample computes, in the graph of the routine.

    The position is q, the corrected one q + z; the angles are the coordinates whose sines are needed.

    Attributes:
        start: sine and cosine of each angle of the guess, one after the other.
        end: sine and cosine of each angle of the corrected position.
        closed: (n,) the corrected position.
        guards: (G,) the guards there.
        following: (n,) the guess at the next sample.
        stored: (R,) the numbers to be stored.
        norms: squared norms of the angles of the correction, and of the way to the next guess.
    """

    start: list[int]
    end: list[int]
    closed: list[int]
    guards: list[int]
    following: list[int]
    stored: list[int]
    norms: list[int]


def _leaves(g: Graph, letter: str, count: int) -> list[int]:
    """Return the leaves of a vector with `count` components."""
    return [g.leaf(f"%{letter}{k}") for k in range(count)]


def _write_sample(program: ClosingProgram, plain: bool) -> tuple[Graph, _Sample]:
    """Write one correction of a sample, and what follows from the corrected position, into a graph.

    `plain` leaves sines to the target and the arithmetic as it is.
    """
    g, n, K, angles = Graph(), program.driven.n, program.inputs, program.angles

    def sincos(x: int) -> Pair:
        return (g.make("sin", x), g.make("cos", x)) if plain else trigonometry.sincos(g, x)

    q, guess = _leaves(g, "q", n), _leaves(g, "guess", n)
    u, w, b, next_u = (_leaves(g, letter, K) for letter in "uwbn")  # values, rates, second rates, values at the next sample
    at_q = {q[k]: (g.leaf(f"%s{k}"), g.leaf(f"%c{k}")) for k in angles}
    ((*z,),) = inline(g, program.correction, (q, u), at_q.__getitem__)
    closed = [g.add(x, change) for x, change in zip(q, z, strict=True)]
    start = [sincos(guess[k]) for k in angles]
    end = [sincos(closed[k]) if plain else trigonometry.rotate(g, at_q[q[k]], z[k], REACH) for k in angles]
    at_closed = {closed[k]: pair for k, pair in zip(angles, end, strict=True)}
    step = [g.sub(after, before) for before, after in zip(u, next_u, strict=True)]
    guards, advance, stored = inline(g, program.motion, (closed, u, w, b, step), at_closed.__getitem__)
    following = [g.add(x, way) for x, way in zip(closed, advance, strict=True)]
    norms = [g.squares([x[k] for k in angles]) for x in (z, advance)]
    flat_start, flat_end = ([x for pair in pairs for x in pair] for pairs in (start, end))
    parts = [flat_start, flat_end, closed, guards, following, stored, norms]  # in the order of the fields of `_Sample`
    if not plain:
        g, moved = rewrite(g, [x for part in parts for x in part])
        values = iter(moved)
        parts = [[next(values) for _ in part] for part in parts]
    return g, _Sample(*parts)


def _settle(g: Graph, program: ClosingProgram, sample: _Sample, values: Sequence[int], alive: int) -> tuple[Loop, int]:
    """Build the loop of corrections, which ends when all lanes have settled; `values` are those that a correction computes.

    Return it, and the mask where no correction was longer than the reach of the rotation.
    """
    always, one = g.all(True), g.whole(1)
    near, j = g.make("mask", payload="%near"), g.count("%j")
    size, _ = sample.norms
    still_near = g.both([near, g.make("le", size, g.const(REACH**2))])
    unsettled = g.both([still_near, alive, g.make("lt", g.const(SETTLED**2), size)])
    again = g.make("also", g.make("any", unsettled), g.make("below", j, g.whole(LIMIT)))
    leaves = [*_leaves(g, "q", program.driven.n), *(g.leaf(f"%{letter}{k}") for k in program.angles for letter in "sc")]
    first = [*_leaves(g, "guess", program.driven.n), *sample.start]
    carried = dict(zip(leaves, zip(first, [*sample.closed, *sample.end], strict=True), strict=True))
    carried |= {near: (always, still_near), j: (one, g.make("sum", j, one))}
    return Loop(carried, [Compute(values)], again), still_near


def follow(program: ClosingProgram, plain: bool = False) -> Routine:
    """Build the routine that follows a group of lanes; `plain` leaves sines and the order of operations to the target."""
    g, sample = _write_sample(program, plain)
    n, K = program.driven.n, program.inputs
    first, guess, least = _leaves(g, "first", n), _leaves(g, "guess", n), _leaves(g, "least", program.guards)
    every = [*sample.start, *sample.end, *sample.closed, *sample.guards, *sample.following, *sample.stored, *sample.norms]
    values = order(g, every, {f"%guess{k}": x for k, x in enumerate(sample.following)}, plain)
    before = set(live(g, sample.start))
    repeated = set(live(g, [*sample.closed, *sample.end, sample.norms[0]])) - before  # the values that a correction computes
    alive, i, done = g.make("mask", payload="%alive"), g.count("%i"), g.leaf("%done")  # i, done: numbers of samples, of closed ones
    corrections, still_near = _settle(g, program, sample, [x for x in values if x in repeated], alive)
    size, turn = sample.norms
    sides = [g.make("le", g.mul(a, a), g.mul(x, a)) for x, a in zip(sample.guards, least, strict=True)]  # x / a >= 1
    good = g.both([alive, still_near, g.make("le", size, g.const(SETTLED**2)), *sides])
    goes_on = g.both([good, g.make("le", turn, g.const(TURN**2))])
    counted, later = g.add(done, g.flag(good)), g.make("sum", i, g.whole(1))
    carried = dict(zip(guess, zip(first, sample.following, strict=True), strict=True))
    carried |= {alive: (g.all(True), goes_on), done: (g.const(0.0), counted), i: (g.whole(0), later)}
    rows = {g.leaf(f"%{letter}{k}"): level * K + k for level, letter in enumerate("uwbn") for k in range(K)}
    body: list[Statement] = [
        Load("inputs", rows, g.make("times", i, payload=LEVELS * K)),
        Compute([x for x in values if x in before]),
        corrections,
        Compute([x for x in values if x not in repeated]),
        Scatter("out", sample.stored, g.make("times", i, payload=program.width), g.count("%block"), g.count("%last")),
    ]
    loop = Loop(carried, body, g.make("also", g.make("any", goes_on), g.make("below", later, g.count("%samples"))))
    loads = [Load(name, {x: k for k, x in enumerate(leaves)}) for name, leaves in (("q", first), ("least", least))]
    statements: list[Statement] = [*loads, loop, Store("report", [counted, *sample.guards])]
    arrays = {"q": Array(n), "least": Array(program.guards), "inputs": Array(1, "shift"), "out": Array(0)}
    arrays["report"] = Array(1 + program.guards)
    counts = ("samples", "shift", "block", "last")
    return Routine("follow", g, arrays, (), counts, statements, good, count_operations(g, values))


class Follower:
    """Follows lanes on a target, in groups of vector width by native code, or all at once by numpy."""

    def __init__(self, program: ClosingProgram, target: Target):
        self.program, self.loaded = program, Loaded(lambda many: follow(program, target.backend == "numpy"), target)

    def run(self, q: Floats, least: Floats, inputs: Floats, rows: Floats) -> tuple[NDArray[np.integer[Any]], Floats]:
        """Follow lanes from their guesses; return the number of closed samples (lanes,) and the guards at the last ones (lanes, G).

        Args:
            q: (lanes, n) guesses at the first samples.
            least: (lanes, G) bounds of the guards.
            inputs: (lanes, samples + 1, 3, K) values, rates, second rates; only the values in the last row matter.
            rows: (any, R) array for the stored numbers. The parts of the lanes follow each other in it; the last part ends with the
                array, and may overlap the part before.
        """
        lanes, samples = self.loaded.lanes(len(q)), inputs.shape[1] - 1
        guesses, bounds, levels = (in_lanes(a, lanes) for a in (q, least, inputs.reshape(len(inputs), -1)))
        report, out = np.empty((len(guesses), 1 + self.program.guards, lanes)), rows.reshape(-1)
        block = samples * self.program.width
        given = self.loaded.given([guesses, bounds, levels, out, report])
        self.loaded.call(lanes)(*given, samples, inputs[0].size, block, out.size - block, len(guesses))
        found = report.transpose(0, 2, 1).reshape(-1, report.shape[1])[: len(q)]
        return found[:, 0].astype(int), found[:, 1:]
