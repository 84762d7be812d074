"""The routine that computes the positions of a linkage for one sample of its inputs after the other.

Several sequences of samples are computed side by side, each in its own lane (an element of a vector register, or of an array in
numpy). Guards are pivots of the constraint Jacobian, which must not become small.

    follow(q, least, inputs, out, report; samples, shift, block, last)

With n coordinates, K inputs, G guards and R numbers that are stored at each sample, the arrays have these rows, each with one
number for each lane:

    q:        n                      guess at the first sample
    least:    G                      smallest admissible magnitude of each guard, with the guard's sign
    inputs:   (samples + 1) x 3 K    values and first and second time derivatives; the next group of lanes begins `shift` rows later
    out:      R for each sample      the samples of lane k one after the other; they begin at number min(k block, last)
    report:   1 + G                  number of samples closed before the first failure, and the guards at the last sample

A sample is closed if the last correction was shorter than SETTLED, no correction was longer than REACH, the guess was near the
previous sample, and no guard is below its bound in `least`. The numbers that a lane stores at and after the first sample that it
cannot close are invalid. `tracker.py` decides how the motion is computed from this sample on.

Newton's method starts at a guess whose sines are computed from scratch, so that no rounding is carried from sample to sample. A
correction adds z to q, and sines and cosines of q + z follow from those of q by a rotation through z. Sine and cosine of z are
computed by series of two terms, which are exact up to rounding errors if |z| is at most REACH.
"""

from collections.abc import Sequence

from gauss_bench.compiler.elimination.closing import ClosingProgram
from gauss_bench.compiler.machine import trigonometry
from gauss_bench.compiler.machine.graph import Graph, Pair, count_operations, inline, live
from gauss_bench.compiler.machine.rewrite import rewrite
from gauss_bench.compiler.machine.routine import Array, Compute, Load, Loop, Routine, Scatter, Statement, Store
from gauss_bench.compiler.machine.schedule import order

# Norms are taken over all angles of which sines are needed.
REACH = 0.0065  # [rad] largest norm of one correction: two terms of the series are then exact, and no other assembly is near
SETTLED = 1e-8  # [rad] norm up to which a correction is the last one: the remaining error is about its square
TURN = 0.3  # [rad] largest norm of the step to the next guess: far less than the distance between two assembly modes
LEVELS = 3  # numbers of an input at a sample: value u, time derivatives w and b; the value n at the next sample follows them
LIMIT = 8  # largest number of corrections; from the farthest accepted guess, quadratic convergence needs four

Sample = dict[str, list[int]]  # name of a result at one sample (`_write_sample`) -> its values, by their indices in a graph


def _write_sample(program: ClosingProgram, plain: bool) -> tuple[Graph, Sample]:
    """Write one Newton correction, and the values that are computed at one sample, into a new graph.

    The correction begins at q; `guess` is the q of the first correction. Leaves %s and %c are sine and cosine of an angle of q.

    Args:
        plain: whether the code is written for numpy: with its sine and cosine, and without regrouped arithmetic.

    Returns:
        The graph, and the values in it:

            start: sine, cosine, sine, ... of the angles of the guess.
            end: sine, cosine, sine, ... of the angles of the corrected position q + z.
            closed: (n,) the corrected position q + z.
            guards: (G,) the pivots of the constraint Jacobian at the corrected position.
            following: (n,) the guess at the next sample.
            stored: (R,) the numbers to be stored: positions, velocities and accelerations.
            norms: two squared norms over the angles: of the correction z, and of the step from q + z to the guess at the next
                sample.
    """
    g, n, K, angles = Graph(), program.driven.n, program.inputs, program.angles

    def sincos(x: int) -> Pair:
        """Return sine and cosine of a value, computed from scratch."""
        return (g.make("sin", x), g.make("cos", x)) if plain else trigonometry.sincos(g, x)

    q, guess = _leaves(g, "q", n), _leaves(g, "guess", n)
    u, w, b, next_u = (_leaves(g, letter, K) for letter in "uwbn")  # values, both time derivatives, values at the next sample
    at_q = {q[k]: (g.leaf(f"%s{k}"), g.leaf(f"%c{k}")) for k in angles}  # angle -> its sine and cosine, which are leaves too
    ((*correction,),) = inline(g, program.correction, (q, u), at_q.__getitem__)  # Newton's z, the only result of the function
    closed = [g.add(x, change) for x, change in zip(q, correction, strict=True)]
    start = [sincos(guess[k]) for k in angles]
    end = [sincos(closed[k]) if plain else trigonometry.rotate(g, at_q[q[k]], correction[k], REACH) for k in angles]
    at_closed = {closed[k]: pair for k, pair in zip(angles, end, strict=True)}
    # at the corrected position: the guards, the step to the guess at the next sample, and the numbers to be stored
    step = [g.sub(after, before) for before, after in zip(u, next_u, strict=True)]
    guards, advance, stored = inline(g, program.motion, (closed, u, w, b, step), at_closed.__getitem__)
    following = [g.add(x, change) for x, change in zip(closed, advance, strict=True)]
    norms = [g.sum_of_squares([x[k] for k in angles]) for x in (correction, advance)]
    flat_start, flat_end = ([x for pair in pairs for x in pair] for pairs in (start, end))
    sample = {"start": flat_start, "end": flat_end, "closed": closed, "guards": guards}
    sample |= {"following": following, "stored": stored, "norms": norms}
    if not plain:  # regroup the arithmetic, in a new graph, in which values have other indices
        g, moved = rewrite(g, [x for values in sample.values() for x in values])
        sample = {name: [moved[x] for x in values] for name, values in sample.items()}
    return g, sample


def _leaves(g: Graph, name: str, count: int) -> list[int]:
    """Return the leaves %NAME0, %NAME1 ... of the graph for the `count` components of a vector."""
    return [g.leaf(f"%{name}{k}") for k in range(count)]


def _settle(g: Graph, program: ClosingProgram, sample: Sample, values: Sequence[int], alive: int) -> tuple[Loop, int]:
    """Build the loop of Newton's corrections at one sample, which begins with the guess as q.

    The loop continues, for at most LIMIT iterations, as long as some lane is unsettled: all its samples so far were closed
    (`alive`), the last |z| is larger than SETTLED, and no |z| of this sample was larger than REACH.

    Return the loop, and a mask that is true for the lanes in which no correction was longer than REACH.
    """
    always, one = g.all(True), g.whole(1)
    near, j = g.make("mask", payload="%near"), g.count("%j")
    # near: no earlier correction of the sample was longer than REACH; j: number of corrections, counted from 1
    correction_square, _ = sample["norms"]
    still_near = g.both([near, g.make("le", correction_square, g.const(REACH**2))])
    unsettled = g.both([still_near, alive, g.make("lt", g.const(SETTLED**2), correction_square)])
    again = g.make("also", g.make("any", unsettled), g.make("below", j, g.whole(LIMIT)))
    leaves = [*_leaves(g, "q", program.driven.n), *(g.leaf(f"%{letter}{k}") for k in program.angles for letter in "sc")]
    first = [*_leaves(g, "guess", program.driven.n), *sample["start"]]
    # leaf -> its value in the first iteration of the loop, and in every further one
    carried = dict(zip(leaves, zip(first, [*sample["closed"], *sample["end"]], strict=True), strict=True))
    carried |= {near: (always, still_near), j: (one, g.make("sum", j, one))}
    return Loop(carried, [Compute(values)], again), still_near


def follow(program: ClosingProgram, plain: bool = False) -> Routine:
    """Build the routine `follow`, in which each lane of a group computes one sample after the other.

    The routine ends after the last sample, or when no lane of the group has a closed sample and a near guess at the next one.
    """
    g, sample = _write_sample(program, plain)
    n, K = program.driven.n, program.inputs
    first, guess, least = _leaves(g, "first", n), _leaves(g, "guess", n), _leaves(g, "least", program.guards)

    # all values of one sample, in the order in which they are computed; below they are divided into those that follow from the
    # guess, those of a correction, and all others
    results = [x for values in sample.values() for x in values]
    values = order(g, results, {f"%guess{k}": x for k, x in enumerate(sample["following"])}, plain)
    before = set(live(g, sample["start"]))  # computed once, from the guess
    repeated = set(live(g, [*sample["closed"], *sample["end"], sample["norms"][0]])) - before  # computed by every correction

    # alive: all samples of the lane so far were closed, and the guess for this one is near the sample before
    # i: number of samples before this one; done: number of closed ones among them
    alive, i, done = g.make("mask", payload="%alive"), g.count("%i"), g.leaf("%done")
    corrections, still_near = _settle(g, program, sample, [x for x in values if x in repeated], alive)
    correction_square, advance_square = sample["norms"]
    # a guard x must have the sign of its bound a, and |x| >= |a|: that is x a >= a a
    guards_hold = [g.make("le", g.mul(a, a), g.mul(x, a)) for x, a in zip(sample["guards"], least, strict=True)]
    is_settled = g.make("le", correction_square, g.const(SETTLED**2))
    is_closed = g.both([alive, still_near, is_settled, *guards_hold])
    # the lane continues with the next sample if the guess there is not far away
    goes_on = g.both([is_closed, g.make("le", advance_square, g.const(TURN**2))])

    # variables of the loop over samples: leaf -> first value, next value
    done_later, i_later = g.add(done, g.flag(is_closed)), g.make("sum", i, g.whole(1))
    carried = dict(zip(guess, zip(first, sample["following"], strict=True), strict=True))
    carried |= {alive: (g.all(True), goes_on), done: (g.const(0.0), done_later), i: (g.whole(0), i_later)}

    # the loop over samples; the values n of the next sample follow in `inputs` after the levels u, w, b of this one
    rows = {g.leaf(f"%{letter}{k}"): level * K + k for level, letter in enumerate("uwbn") for k in range(K)}
    body: list[Statement] = [
        Load("inputs", rows, g.make("times", i, payload=LEVELS * K)),
        Compute([x for x in values if x in before]),
        corrections,
        Compute([x for x in values if x not in repeated]),
        Scatter("out", sample["stored"], g.make("times", i, payload=program.width), g.count("%block"), g.count("%last")),
    ]
    loop = Loop(carried, body, g.make("also", g.make("any", goes_on), g.make("below", i_later, g.count("%samples"))))
    loads = [Load(name, {x: k for k, x in enumerate(leaves)}) for name, leaves in (("q", first), ("least", least))]

    statements: list[Statement] = [*loads, loop, Store("report", [done_later, *sample["guards"]])]
    arrays = {"q": Array(n), "least": Array(program.guards), "inputs": Array(1, "shift"), "out": Array(0)}
    arrays["report"] = Array(1 + program.guards)
    counts = ("samples", "shift", "block", "last")
    return Routine("follow", g, arrays, (), counts, statements, is_closed, count_operations(g, values))
