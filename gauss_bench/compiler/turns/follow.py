"""The samples of whole turns as a routine: each lane follows a part of a turn.

    follow(q, least, inputs, out, report; samples, shift, block, last)

n coordinates, K inputs, G guards, R numbers stored at each sample; rows of the arrays, each with one number for each lane:

    q        n                     guess at the first sample
    least    G                     what each guard must not fall below, on its side of zero
    inputs   (samples + 1) x 3 K   values, rates, second rates; the next group's begin `shift` rows further on
    out      a lane's samples, R numbers each; lane k's begin at k `block`, at most at `last`
    report   1 + G                 samples closed before the first that could not be, guards at the last of all samples

A sample is closed if the last correction was shorter than SETTLED, no correction exceeded the reach of the rotation, the guess was
near the previous sample, and every guard is large enough. After the first sample that is not closed, the stored values are invalid.

Newton starts at the guess, whose sines come from nothing, so that no rounding is carried from sample to sample. A correction
moves q by z and rotates its sines, which is exact while z is short.

What happens after a lane has stopped is decided in tracker.py.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gauss_bench.compiler.elimination.closing import ClosingProgram
from gauss_bench.compiler.machine import trigonometry
from gauss_bench.compiler.machine.graph import (
    Array,
    Compute,
    Graph,
    Load,
    Loop,
    Pair,
    Routine,
    Scatter,
    Statement,
    Store,
    count_operations,
    inline,
    live,
    order,
    rewrite,
)
from gauss_bench.compiler.machine.native_code import Loaded, Target, in_lanes
from gauss_bench.terms import Array as Floats

REACH = 0.0065  # [rad] norm of one correction: two terms of the rotation are exact so far, and no other assembly is near
SETTLED = 1e-8  # [rad] norm of the last one: its square is left
TURN = 0.3  # [rad] norm of the way to the guess: far less than lies between two assemblies
LIMIT = 8  # corrections; quadratic convergence needs four from the farthest guess that is taken


def follow(program: ClosingProgram, plain: bool = False) -> Routine:
    """Build the routine that follows a group of lanes; `plain` leaves sines and the order of operations to the target."""
    g, n, K, angles = Graph(), program.driven.n, program.inputs, program.angles

    def sincos(x: int) -> Pair:
        return (g.make("sin", x), g.make("cos", x)) if plain else trigonometry.sincos(g, x)

    def norm(values: Sequence[int]) -> int:
        return g.squares([values[k] for k in angles])

    def leaves(letter: str, count: int) -> list[int]:
        return [g.leaf(f"%{letter}{k}") for k in range(count)]

    q, guess, first = leaves("q", n), leaves("guess", n), leaves("first", n)
    u, w, b, following = (leaves(letter, K) for letter in "uwbn")
    pairs = {q[k]: (g.leaf(f"%s{k}"), g.leaf(f"%c{k}")) for k in angles}
    ((*z,),) = inline(g, program.correction, (q, u), pairs.__getitem__)
    closed = [g.add(a, c) for a, c in zip(q, z, strict=True)]
    start = {k: sincos(guess[k]) for k in angles}
    end = {k: sincos(closed[k]) if plain else trigonometry.rotate(g, pairs[q[k]], z[k], REACH) for k in angles}
    ends = {closed[k]: pair for k, pair in end.items()}
    way = [g.sub(c, a) for a, c in zip(u, following, strict=True)]
    guards, advance, stored = inline(g, program.motion, (closed, u, w, b, way), ends.__getitem__)
    roots = {
        "start": [x for pair in start.values() for x in pair],
        "end": [x for pair in end.values() for x in pair],
        "closed": closed,
        "guards": guards,
        "next": [g.add(a, c) for a, c in zip(closed, advance, strict=True)],
        "stored": stored,
        "norms": [norm(z), norm(advance)],
    }
    every = [x for part in roots.values() for x in part]
    if not plain:
        g, moved = rewrite(g, every)
        new = iter(moved)
        roots = {name: [next(new) for _ in part] for name, part in roots.items()}
        every = moved

    q, guess, first = leaves("q", n), leaves("guess", n), leaves("first", n)
    sines = [g.leaf(f"%{letter}{k}") for k in angles for letter in "sc"]
    carried = dict(zip([*q, *sines], zip([*guess, *roots["start"]], [*roots["closed"], *roots["end"]], strict=True), strict=True))
    newton = set(live(g, [*roots["closed"], *roots["end"], roots["norms"][0]])) - set(live(g, roots["start"]))
    values = live(g, every)
    values = values if plain else order(g, values, {f"%guess{k}": x for k, x in enumerate(roots["next"])})
    always, one = g.all(True), g.whole(1)
    alive, near = (g.make("mask", payload=f"%{x}") for x in ("alive", "near"))
    i, j, done = g.count("%i"), g.count("%j"), g.leaf("%done")

    size, turn = roots["norms"]
    still_near = g.both([near, g.make("le", size, g.const(REACH**2))])
    open_ = g.both([still_near, alive, g.make("lt", g.const(SETTLED**2), size)])
    again = g.make("also", g.make("any", open_), g.make("below", j, g.whole(LIMIT)))
    corrections = Loop(
        carried | {near: (always, still_near), j: (one, g.make("sum", j, one))},
        [Compute([x for x in values if x in newton])],
        again,
    )
    least = [g.leaf(f"%least{k}") for k in range(program.guards)]
    sides = [g.make("le", g.mul(a, a), g.mul(x, a)) for x, a in zip(roots["guards"], least, strict=True)]
    good = g.both([alive, still_near, g.make("le", size, g.const(SETTLED**2)), *sides])
    on = g.both([good, g.make("le", turn, g.const(TURN**2))])
    counted, later = g.add(done, g.flag(good)), g.make("sum", i, one)
    outer = dict(zip(guess, zip(first, roots["next"], strict=True), strict=True))
    outer |= {alive: (always, on), done: (g.const(0.0), counted), i: (g.whole(0), later)}
    levels = {g.leaf(f"%{x}{k}"): r * K + k for r, x in enumerate("uwb") for k in range(K)}
    body: list[Statement] = [
        Load(
            "inputs",
            {g.leaf(f"%{x}{k}"): r * K + k for r, x in enumerate("uwbn") for k in range(K)},
            g.make("times", i, payload=len(levels)),
        ),
        Compute([x for x in values if x in set(live(g, roots["start"]))]),
        corrections,
        Compute([x for x in values if x not in newton]),
        Scatter("out", roots["stored"], g.make("times", i, payload=program.width), g.count("%block"), g.count("%last")),
    ]
    turns = Loop(outer, body, g.make("also", g.make("any", on), g.make("below", later, g.count("%samples"))))
    given = {"q": first, "least": least}
    loads = [Load(name, {x: k for k, x in enumerate(rows)}) for name, rows in given.items()]
    arrays = {name: Array(len(rows)) for name, rows in given.items()}
    arrays |= {"inputs": Array(1, "shift"), "out": Array(0), "report": Array(1 + program.guards)}
    statements: list[Statement] = [*loads, turns, Store("report", [counted, *roots["guards"]])]
    counts = ("samples", "shift", "block", "last")
    return Routine("follow", g, arrays, (), counts, statements, good, count_operations(g, values))


class Follower:
    """Follows lanes on a target: groups of vector width in native code, all at once in numpy."""

    def __init__(self, program: ClosingProgram, target: Target):
        self.program, self.loaded = program, Loaded(lambda many: follow(program, target.backend == "numpy"), target)

    def run(self, q: Floats, least: Floats, inputs: Floats, rows: Floats) -> tuple[NDArray[np.integer[Any]], Floats]:
        """Follow lanes from their guesses; return the number of closed samples (lanes,) and the final guards (lanes, G).

        Args:
            q: (lanes, n) guesses at the first samples.
            least: (lanes, G) bounds of the guards.
            inputs: (lanes, samples + 1, 3, K) values, rates, second rates; of the row after the last only the values count.
            rows: (any, R), filled by one lane after the other; the last lane is aligned with the end and may overlap.
        """
        lanes, samples = self.loaded.lanes(len(q)), inputs.shape[1] - 1
        guesses, bounds, levels = (in_lanes(a, lanes) for a in (q, least, inputs.reshape(len(inputs), -1)))
        report, out = np.empty((len(guesses), 1 + self.program.guards, lanes)), rows.reshape(-1)
        block = samples * self.program.width
        given = self.loaded.given([guesses, bounds, levels, out, report])
        self.loaded.call(lanes)(*given, samples, inputs[0].size, block, out.size - block, len(guesses))
        found = report.transpose(0, 2, 1).reshape(-1, report.shape[1])[: len(q)]
        return found[:, 0].astype(int), found[:, 1:]
