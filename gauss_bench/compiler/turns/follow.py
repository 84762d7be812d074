"""The samples of whole turns as a routine: each lane follows a part of a turn, or a linkage of its own.

    follow(x, signs, inputs, p, out, where, report; tolerance; samples, shift)

U unknowns, K inputs, G guards, R numbers stored at each sample; rows of the arrays, each with one number for each lane:

    x        U                     guess at the first sample; afterwards the last closed sample
    signs    G                     that the guards must keep; 0 for any
    inputs   (samples + 1) x 3 K   values, rates, second rates; the next group's begin `shift` rows further on, 0 if shared
    p        n_p                   open parameters
    where    1                     whole numbers: where in `out` a lane's samples begin
    out      a lane's samples, one after the other: R numbers each
    report   1 + G                 samples closed before the first that could not be, guards at the last of them

A sample is closed where |A|^2 <= tolerance sum |R|^2 after at most LIMIT corrections, none of which left the reach of the rotation;
the guess was not far from the sample before; and every guard keeps its sign and is not too small. A lane that fails keeps its last
closed state; what it goes on to store is void.

Newton starts at the guess, whose sines come from nothing, so that no rounding is carried from sample to sample. A correction
moves x by z and rotates its sines, which is exact while z is short.

Leaves: %x0, %s0, %c0 ... iterate and sines of its angles, %X0 ... guess, %l0 ... the sample before, %u0, %w0, %b0 ... inputs with
their rates and second rates, %n0 ... the inputs at the next sample, %p0 ... open parameters.

Nobody here decides what follows where a lane stops: tracker.py does.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from gauss_bench.compiler.elimination.loop_program import ClosureProgram
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
    depending,
    inline,
    live,
    order,
    rewrite,
)
from gauss_bench.compiler.machine.native_code import Loaded, Target, in_lanes, out_of_lanes, share
from gauss_bench.terms import Array as Floats

REACH = 0.0065  # [rad, lengths] norm of one correction: two terms of the rotation are exact so far, and no other assembly is near
LARGEST = trigonometry.LARGEST  # [rad]
TURN = 0.3  # [rad, lengths] norm of the way to the guess: far less than lies between two assemblies

Outputs = Literal["states", "path"]
Carried = dict[int, tuple[int, int]]


@dataclass(frozen=True, eq=False)
class ClosingCode:
    """A program in machine arithmetic.

    Attributes:
        start: sines and cosines of the guess's angles, by unknown.
        score: sum of squares of A; square: of the lengths of the vectors in it.
        moved: by leaf of the iterate ("%x0", "%s0", "%c0" ...), its value after a correction.
        near: mask, the correction is short enough for that.
        turn: mask, the guess is not far from the sample before; regular: mask, no guard is too small.
        guards: by guard, its value.
        guess: by unknown, at the next sample.
        outputs: the row to be stored.
    """

    graph: Graph
    start: dict[int, Pair]
    score: int
    square: int
    moved: dict[str, int]
    near: int
    turn: int
    regular: int
    guards: list[int]
    guess: list[int]
    outputs: list[int]

    def roots(self) -> list[int]:
        """Everything that must be computed."""
        pairs = [x for pair in self.start.values() for x in pair]
        masks = [self.near, self.turn, self.regular]
        return [*pairs, self.score, self.square, *self.moved.values(), *masks, *self.guards, *self.guess, *self.outputs]

    def replaced(self, graph: Graph, roots: list[int]) -> "ClosingCode":
        """The same code in another graph, for its roots there."""
        new = iter(roots)
        start = {k: (next(new), next(new)) for k in self.start}
        score, square, moved = next(new), next(new), {name: next(new) for name in self.moved}
        near, turn, regular = next(new), next(new), next(new)
        guards, guess = [next(new) for _ in self.guards], [next(new) for _ in self.guess]
        return ClosingCode(graph, start, score, square, moved, near, turn, regular, guards, guess, list(new))


def write_function(program: ClosureProgram, outputs: Outputs, library: bool = False) -> ClosingCode:
    """A program as code that stores states, or the unknowns x alone ("path"); with `library`, sines are left to the target."""
    g = Graph()

    def sincos(x: int) -> Pair:
        return (g.make("sin", x), g.make("cos", x)) if library else trigonometry.sincos(g, x)

    turning = [k for k, angle in enumerate(program.angles) if angle]
    x, guess, last = ([g.leaf(f"%{letter}{k}") for k in range(program.unknowns)] for letter in "xXl")
    u, w, second, following = ([g.leaf(f"%{letter}{j}") for j in range(program.inputs)] for letter in "uwbn")
    p = [g.leaf(f"%p{i}") for i in range(program.parameters)]
    pairs = {x[k]: (g.leaf(f"%s{k}"), g.leaf(f"%c{k}")) for k in turning}
    pairs |= {u[j]: sincos(u[j]) for j, angle in enumerate(program.known_angles) if angle}
    way = [g.sub(b, a) for a, b in zip(u, following, strict=True)]
    function = program.states if outputs == "states" else program.path
    results = inline(g, function, (x, u, w, second, way, p), pairs.__getitem__)
    residual, (square,), z, guards, limits, advance, stored = results
    moved = {f"%x{k}": g.add(x[k], z[k]) for k in range(program.unknowns)}
    for k in turning:
        pair = sincos(moved[f"%x{k}"]) if library else trigonometry.rotate(g, pairs[x[k]], z[k], REACH)
        moved |= {f"%s{k}": pair[0], f"%c{k}": pair[1]}
    scale = [g.const(1.0 / length) for length in program.lengths]
    jump = [g.mul(c, g.sub(a, b)) for c, a, b in zip(scale, guess, last, strict=True)]
    return ClosingCode(
        g,
        {k: sincos(guess[k]) for k in turning},
        g.squares(residual),
        square,
        moved,
        _within(g, [g.mul(c, a) for c, a in zip(scale, z, strict=True)], REACH),
        _within(g, jump, TURN),
        g.both([g.make("le", least, g.mul(x, x)) for x, least in zip(guards, limits, strict=True)]),
        guards,
        [g.add(a, b) for a, b in zip(x, advance, strict=True)],
        stored or list(x),
    )


def _within(g: Graph, values: list[int], bound: float) -> int:
    """Mask where the norm of some values is at most a bound."""
    return g.make("le", g.squares(values), g.const(bound * bound))


LIMIT = 8  # corrections; quadratic convergence needs four from the farthest guess that is taken


def follow(program: ClosureProgram, outputs: Outputs, plain: bool = False) -> Routine:
    """The routine that follows a group of lanes; `plain` where sines and the order of operations are left to the target."""
    code = write_function(program, outputs, plain)
    code = code if plain else code.replaced(*rewrite(code.graph, code.roots()))
    g, K = code.graph, program.inputs
    values, always = live(g, code.roots()), g.all(True)
    x, X, last = ([g.leaf(f"%{letter}{k}") for k in range(program.unknowns)] for letter in "xXl")
    first = [g.leaf(f"%first{k}") for k in range(program.unknowns)]
    signs, guards = ([g.leaf(f"%{name}{k}") for k in range(len(code.guards))] for name in ("sign", "guard"))
    alive, near, i, j = (*(g.make("mask", payload=f"%{x}") for x in ("alive", "near")), *(g.count(f"%{x}") for x in "ij"))
    done, one, following = g.leaf("%done"), g.whole(1), g.make("sum", i, g.whole(1))

    iterate = {g.leaf(f"%{letter}{k}") for k, pair in code.start.items() for letter in "sc"} | set(x)
    score, corrected = set(live(g, [code.score, code.square])), set(live(g, [*code.moved.values(), code.near]))
    closing = set(live(g, [code.turn, code.regular, *code.guards, *code.guess, *code.outputs]))
    starts = set(live(g, [x for pair in code.start.values() for x in pair]))
    varying = depending(g, iterate)
    in_order = values if plain else order(g, values, {name: b for name, b in code.moved.items() if g.leaf(name) in iterate})

    def chosen(which: set[int]) -> Compute:
        return Compute([x for x in in_order if x in which])

    enough = g.make("mul", code.square, g.leaf("%tolerance"))
    closed, going = g.make("le", code.score, enough), g.both([alive, near])
    again = g.make("also", g.make("any", g.both([going, g.make("not", closed)])), g.make("below", j, g.whole(LIMIT)))
    iterated: Carried = {a: (b, code.moved[f"%x{k}"]) for k, (a, b) in enumerate(zip(x, X, strict=True))}
    for k, pair in code.start.items():
        iterated |= {g.leaf(f"%{letter}{k}"): (b, code.moved[f"%{letter}{k}"]) for letter, b in zip("sc", pair, strict=True)}
    iterated |= {near: (always, g.both([near, code.near])), j: (g.whole(0), g.make("sum", j, one))}
    shared = score | (corrected & closing)
    newton = Loop(iterated, [chosen(shared)], again, [chosen(corrected - shared)])
    kept = [g.make("le", g.const(0.0), g.make("mul", a, sign)) for a, sign in zip(code.guards, signs, strict=True)]
    good = g.both([going, closed, code.turn, code.regular, *kept])

    def stay(new: Sequence[int], old: Sequence[int]) -> list[int]:
        return [g.make("select", good, a, b) for a, b in zip(new, old, strict=True)]

    ended, passed = stay(x, last), stay(code.guards, guards)
    counted = g.add(done, g.flag(good))
    carried: Carried = {a: (b, c) for a, b, c in zip(X, first, code.guess, strict=True)}
    carried |= {a: (b, c) for a, b, c in zip(last, first, ended, strict=True)}
    carried |= {a: (g.const(0.0), c) for a, c in zip(guards, passed, strict=True)}
    carried |= {alive: (always, good), done: (g.const(0.0), counted), i: (g.whole(0), following)}
    inputs = {g.leaf(f"%{letter}{j}"): k * K + j for k, letter in enumerate("uwbn") for j in range(K)}
    body: list[Statement] = [
        Load("inputs", inputs, g.make("times", i, payload=3 * K)),
        chosen((score | corrected | starts) - varying),
        newton,
        chosen(closing),
        Scatter("out", "where", code.outputs, g.make("times", i, payload=len(code.outputs))),
    ]
    turn = Loop(carried, body, g.make("also", g.make("any", good), g.make("below", following, g.count("%samples"))))
    parameters = {g.leaf(f"%p{k}"): k for k in range(program.parameters)}
    entry = [
        Load(name, {a: k for k, a in enumerate(rows)}) for name, rows in (("x", first), ("signs", signs), ("p", list(parameters)))
    ]
    arrays = {
        "x": Array(program.unknowns), "signs": Array(program.guards), "inputs": Array(1, "shift"), "p": Array(program.parameters),
        "out": Array(0), "where": Array(1, whole=True), "report": Array(1 + program.guards),
    }  # fmt: skip
    statements: list[Statement] = [*entry, turn, Store("x", ended), Store("report", [counted, *passed])]
    return Routine(
        "follow", g, arrays, ("tolerance",), ("samples", "shift"), statements, good, count_operations(g, live(g, code.roots()))
    )


Counts = NDArray[np.integer[Any]]


@dataclass(frozen=True, eq=False)
class Course:
    """The motions that lanes are to follow.

    Attributes:
        x: (lanes, U) guess at each lane's first sample.
        signs: (lanes, G) that the guards must keep; 0 for any.
        inputs: (lanes or 1, samples + 1, 3 K) values, rates, second rates; of the row after the last only the values count.
        parameters: (lanes, n_p).
        where: (lanes,) row of each lane's first sample in `rows`.
        rows: (any, R) where samples are stored.
        tolerance: |A|^2 of a closed sample, of the squared lengths of the vectors in it.
    """

    x: Floats
    signs: Floats
    inputs: Floats
    parameters: Floats
    where: Counts
    rows: Floats
    tolerance: float

    @property
    def samples(self) -> int:
        return int(self.inputs.shape[1]) - 1


@dataclass(frozen=True, eq=False)
class Followed:
    """The outcome of the lanes: samples closed before the first that was not, x (lanes, U) and guards (lanes, G) at the last."""

    closed: Counts
    x: Floats
    guards: Floats


class Follower:
    """Follows lanes on a target, `lanes` of them at a time; all at once on arrays."""

    def __init__(self, program: ClosureProgram, outputs: Outputs, target: Target):
        self.program, self.lanes, plain = program, target.lanes, target.backend == "numpy"
        self.loaded = Loaded(lambda many: follow(program, outputs, plain), target)

    def run(self, course: Course, threads: int = 1) -> Followed:
        count, numpy = len(course.x), self.loaded.target.backend == "numpy"
        lanes = count if numpy else self.lanes
        x = in_lanes(course.x.copy(), lanes)  # is written to; one lane would be a view
        signs, p = (in_lanes(a, lanes) for a in (course.signs, course.parameters))
        where = in_lanes(np.asarray(course.where, dtype=np.int64)[:, None] * course.rows.shape[1], lanes)
        inputs, shift = _input_lanes(course.inputs, lanes)
        report = np.empty((len(x), 1 + self.program.guards, lanes))
        call, samples = self.loaded.call(lanes), course.samples

        def part(low: int, high: int) -> None:
            arrays = [x[low:high], signs[low:high], inputs[low:] if shift else inputs, p[low:high]]
            arrays += [course.rows.reshape(-1), where[low:high], report[low:high]]
            call(*self.loaded.given(arrays), course.tolerance, samples, shift, high - low)

        share(part, len(x), threads)
        reports = out_of_lanes(report, count)
        last = out_of_lanes(x, count) if x.size else course.x  # an open chain has no unknowns
        return Followed(reports[:, 0].astype(int), last, reports[:, 1:])


def _input_lanes(inputs: Floats, lanes: int) -> tuple[Floats, int]:
    """(lanes or 1, samples, columns) as (groups, samples x columns, lanes), and rows between groups: 0 where one serves all."""
    count, samples, columns = inputs.shape
    if count == 1:
        return np.repeat(inputs.reshape(1, -1, 1), lanes, axis=2), 0
    return in_lanes(inputs.reshape(count, -1), lanes), samples * columns
