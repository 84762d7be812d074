"""One step of an integrator as a graph, with its guards and, if asked for, its projection.

Runge-Kutta of order 4 for q'' = a(t, q, v), with the positions of the stages written out (Nystroem's form: the same numbers but for
rounding, and q_k+1 does not wait for v_k+1):

    q2 = q + h/2 v,         q3 = q2 + h^2/4 a1,   B = q + h v,   q4 = B + h^2/2 a2
    v2 = v + h/2 a1,        v3 = v + h/2 a2,      v4 = v + h a3
    q' = B + h^2/6 (a1 + a2 + a3),                v' = v + h/6 (a1 + 2 a2 + 2 a3 + a4)

Sines. Sine and cosine of the angles are rotated from stage to stage by h/2 v and h v (`Reach.step`), and by the small rest in h^2
(`Reach.bend`). Rotation after rotation would accumulate rounding. Sine and cosine at q are therefore also computed from scratch,
beside the chain of dependent operations, and everything after the second stage starts from those. A step of order 8 goes farther:
its later stages rotate sine and cosine from the position q + h/2 v.

Projection. At the end of a step q gets chord-Newton corrections with the Jacobian of the last stage, whose factors are known
already. At its beginning v is corrected with the Jacobian at q, whose factors the first stage needs anyway. Only the first stage is
evaluated before that correction. The correction is of the size h^5 of the local error, and so does not change the order of the
method. Samples have corrected states, and the other stages start from them.

If rows are redundant and no step projects, the loop around the steps corrects the state in the same way after every
`rollout.SETTLED` steps (`Builder.settle`).

Gauss's collocation (`gauss_legendre`) is implicit: its positions and velocities at the stages follow from the accelerations there,
which a fixed number of passes computes. A guard demands that they have converged.
Sources: Hairer, Norsett and Wanner, Solving Ordinary Differential Equations I (1993), sections II.1 and II.14; Hairer and Wanner,
Solving Ordinary Differential Equations II (1996), section VII.2 (projection).
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, replace
from functools import cache
from math import inf, isfinite

import numpy as np

from gauss_bench.compiler.machine import trigonometry
from gauss_bench.compiler.machine.code import Code
from gauss_bench.compiler.machine.graph import Graph, Pair, inline
from gauss_bench.compiler.machine.rewrite import rewrite
from gauss_bench.integrate.fixed_step import DIFFERENCE, NATIVE_PASSES, dop853_estimates, dop853_tableau, gauss_tableau
from gauss_bench.terms import Array

FINITE = 1e300  # a larger sum has terms that are not finite, or soon will be
TINY = 1e-300  # keeps a divisor from being zero
CONVERGED = 2.0**-28  # largest change of velocities in the last pass of an implicit step: less than a tenth of it is left as error
LAST_CORRECTION = 2.0**-28  # [rad] largest norm of the last correction of positions: less than a thousandth of it is left

Coefficients = Sequence[float]


@dataclass(frozen=True)
class Tableau:
    """An explicit Runge-Kutta method of s stages for q'' = a(t, q, v).

    Attributes:
        c: (s,) nodes.
        A, twice: (s, s) weights of the accelerations in velocities and in positions of the stages, A and A A.
        b, end: (s,) weights in the velocity and the position after the step, b and b A.
        estimates: weights (s,) of the same two kinds, for the difference from a less exact step; each set of weights has the sum 0.
    """

    c: Coefficients
    A: Sequence[Coefficients]
    twice: Sequence[Coefficients]
    b: Coefficients
    end: Coefficients
    estimates: Sequence[tuple[Coefficients, Coefficients]]


@cache
def order_eight() -> Tableau:
    """Return the tableau of DOP853."""
    c, rows, b = dop853_tableau()
    A = np.zeros((len(b), len(b)))
    for k, row in enumerate(rows):
        A[k, :k] = row
    errors = [(e.tolist(), (e @ A).tolist()) for e in dop853_estimates()]
    return Tableau(c, A.tolist(), (A @ A).tolist(), b.tolist(), (b @ A).tolist(), errors)


@dataclass(frozen=True)
class Reach:
    """How far angles may move in a step for its rotated sines to be exact; a step that goes further is not counted.

    Attributes:
        step: largest norm of h v of the angles [rad]; infinite for code that computes every sine from scratch.
        bend: largest norm of h^2/2 a of the angles at three stages [rad].
        correction: largest norm of a correction of the angles [rad].
        corrections: number of Newton corrections of the positions in each step.
    """

    step: float
    bend: float
    correction: float
    corrections: int

    @property
    def rotates(self) -> bool:
        """True if sines are rotated, and not computed from scratch."""
        return isfinite(self.step)


EXACT = Reach(inf, inf, inf, 4)
# Series with an error below an eighth of a rounding reach 0.0065 rad with 2 terms, 0.0625 rad with 4, and 0.25 rad, from the middle
# of a step of order 8 to either side, with 5; for `bend` they have 1 term, and 2. Each integrator takes its shortest reach first.
REACHES = {
    "rk4": (Reach(0.0065, 1.5e-4, 2.0**-28, 1), Reach(0.0625, 6.5e-3, 2.0**-20, 2), EXACT),
    "dop853_fixed": (Reach(0.25, inf, 6.5e-3, 4), EXACT),
    "gauss_legendre": (EXACT,),
    "semi_implicit_euler": (Reach(0.0065, inf, 1.5e-4, 3), Reach(0.0625, inf, 6.5e-3, 5), Reach(inf, inf, inf, 6)),
}


# Steps of a millisecond turn angles farther than the first reach, while their corrections are as small as within it: one is enough.
ONCE = replace(REACHES["rk4"][1], correction=2.0**-28, corrections=1)

# Operations of an acceleration. Code with four longer ones takes long to compile, and does not fit into the processor's caches.
LONG = 3_500


def is_looped(code: Code, integrator: str) -> bool:
    """Tell whether a step loops over its stages, because their code would be too long if each was written out."""
    return integrator == "rk4" and code.acceleration.operations > LONG


def reaches(code: Code, integrator: str) -> tuple[Reach, ...]:
    """Return the reaches of a program's steps, the shortest first."""
    if is_looped(code, integrator):
        return (EXACT,)
    first, *others = REACHES[integrator]
    return (first, ONCE, *others) if code.projected and integrator == "rk4" else (first, *others)


@dataclass(frozen=True, eq=False)
class Step:
    """The values of a step.

    Attributes:
        carried: name of a leaf -> its value at the next step.
        out: q, v (2n) at the beginning of the step, to be stored as a sample.
        regular: mask where no pivot is too small; regular_out: the same for the pivots that `out` needs.
        within: mask where the step stays within its reach and all values are finite.
        error: squared norm of the estimated local error relative to the tolerances, proportional to h^16; None if not estimated.
        settled: name of a leaf -> its value at the next step if the state is projected there; empty if it never is.
        stages: leaf -> its value at the first stage, and at the next one, in a loop over the stages; empty if there is no loop.
    """

    graph: Graph
    carried: dict[str, int]
    out: list[int]
    regular: int
    regular_out: int
    within: int
    error: int | None = None
    settled: dict[str, int] = field(default_factory=dict)
    stages: dict[int, tuple[int, int]] = field(default_factory=dict)

    def roots(self) -> list[int]:
        """Return all values that must be computed in every step."""
        error = [] if self.error is None else [self.error]
        of_stages = [x for pair in self.stages.values() for x in pair]
        return [*self.carried.values(), *self.out, self.regular, self.regular_out, self.within, *error, *of_stages]

    def rewrite_into(self, into: Graph | None = None) -> "Step":
        """Return the step with its arithmetic regrouped, in a graph that may have other steps already."""
        every = [*self.roots(), *self.settled.values()]
        graph, roots = rewrite(self.graph, every, into)
        moved = dict(zip(every, roots, strict=True))
        carried, settled = ({name: moved[x] for name, x in leaves.items()} for leaves in (self.carried, self.settled))
        regular, regular_out, within = (moved[m] for m in (self.regular, self.regular_out, self.within))
        error = None if self.error is None else moved[self.error]
        stages = {
            graph.make(self.graph.operation[leaf], payload=self.graph.payload[leaf]): (moved[first], moved[following])
            for leaf, (first, following) in self.stages.items()
        }
        return Step(graph, carried, [moved[x] for x in self.out], regular, regular_out, within, error, settled, stages)


class Builder:
    """Writes the stages of a step into a graph, and collects their guards. Vectors are lists of n values, one per coordinate.

    Attributes:
        library: whether sines are computed by the functions of the target.
        q, v, p, t, h: leaves of the state, the parameters, the time and the step size.
        known: angle -> its sine and cosine, where a rotation or an earlier stage has computed them.
        pivots: masks where a pivot is not too small.
        score: squares of norms, each divided by its bound: the sum must be at most 1.
    """

    def __init__(self, code: Code, reach: Reach, library: bool = False):
        self.g = g = Graph()
        self.library = library
        self.code, self.reach, self.n = code, reach, code.program.n
        self.q, self.v = self.vector("q"), self.vector("v")
        self.p = [g.leaf(f"%p{i}") for i in range(code.program.n_parameters)]
        self.t, self.h = g.leaf("%t"), g.leaf("%h")
        self.known: dict[int, Pair] = {}
        self.pivots: list[int] = []
        self.score: list[int] = []

    def vector(self, letter: str) -> list[int]:
        """Return a leaf for each coordinate."""
        return [self.g.leaf(f"%{letter}{i}") for i in range(self.n)]

    def carried_sines(self) -> list[Pair]:
        """Return leaves for sine and cosine of each angle."""
        return [(self.g.leaf(f"%s{i}"), self.g.leaf(f"%c{i}")) for i in self.code.angles]

    def times_h(self, factor: float, power: int = 1) -> int:
        """Return factor h^power, which is computed once before the loop."""
        product = self.g.const(factor)
        for _ in range(power):
            product = self.g.mul(product, self.h)
        return product

    def plus(self, x: list[int], y: list[int]) -> list[int]:
        """Return the vector x + y."""
        return [self.g.add(a, b) for a, b in zip(x, y, strict=True)]

    def times(self, factor: int, x: list[int]) -> list[int]:
        """Return the vector factor x."""
        return [self.g.mul(factor, a) for a in x]

    def along(self, x: list[int], factor: int, d: list[int]) -> list[int]:
        """Return the vector x + factor d."""
        return self.plus(x, self.times(factor, d))

    def weighted(self, a: list[list[int]], weights: Coefficients) -> list[int]:
        """Return the weighted sum of the accelerations a at the stages so far."""
        used = [(self.g.const(w), x) for w, x in zip(weights, a, strict=False) if w]
        return [self.g.total([self.g.mul(w, x[i]) for w, x in used]) for i in range(self.n)]

    def sincos(self, x: int) -> Pair:
        """Return sine and cosine of an angle: known ones, else computed by the target's functions or from scratch."""
        if x not in self.known and self.library:
            self.known[x] = self.g.make("sin", x), self.g.make("cos", x)
        elif x not in self.known:
            self.known[x] = trigonometry.sincos(self.g, x)
            self.limit([x], trigonometry.LARGEST)
        return self.known[x]

    def compute_sines(self) -> list[Pair]:
        """Compute sines and cosines of the angles at the beginning of the step from scratch."""
        self.limit([self.q[i] for i in self.code.angles], trigonometry.LARGEST)
        return [trigonometry.sincos(self.g, self.q[i]) for i in self.code.angles]

    def limit(self, values: list[int], bound: float, factor: int | None = None) -> None:
        """Demand that the norm of some values, times a factor, stays below a bound."""
        if isfinite(bound):
            g = self.g
            weight = g.const(bound**-2) if factor is None else g.mul(g.const(bound**-2), g.mul(factor, factor))
            self.score.append(g.mul(weight, g.squares(values)))

    def turn(self, pairs: list[Pair], change: list[int], largest: float, to: list[int]) -> list[Pair]:
        """Return sine and cosine of each angle after a change [rad] of the coordinates, whose norm is at most `largest`.

        They are registered for the angles of the positions `to`. The list is empty if sines are computed from scratch.
        """
        if not self.reach.rotates:
            return []
        turned = [trigonometry.rotate(self.g, pair, change[i], largest) for pair, i in zip(pairs, self.code.angles, strict=True)]
        self.share(to, turned)
        return turned

    def share(self, q: list[int], pairs: list[Pair]) -> None:
        """Register sine and cosine of each angle of the positions q; an empty list of pairs registers nothing."""
        self.known.update(zip(self.of_angles(q), pairs, strict=False))

    def of_angles(self, x: list[int]) -> list[int]:
        """Return the components of a vector that belong to angles whose sines are needed."""
        return [x[i] for i in self.code.angles]

    def acceleration(self, t: int, q: list[int], v: list[int]) -> list[int]:
        """Return the acceleration at a stage, and add its pivots to the guards."""
        a, guard = inline(self.g, self.code.acceleration, ([t], q, v, self.p), self.sincos)
        self._watch(guard, self.code.program.thresholds)
        return a

    def directions(self, t: int, q: list[int], v: list[int]) -> list[list[int]]:
        """Return for each independent coordinate the free motion in which it moves by 1, and add their pivots to the guards."""
        g, free = self.g, self.code.program.independent
        *motions, guard = inline(g, self.code.program.directions, ([t], q, v, self.p), self.sincos)
        self._watch(guard, self.code.program.direction_thresholds)
        return [[g.div(x, motion[k]) for x in motion] for k, motion in zip(free, motions, strict=True)]

    def constrain(self, t: int, q: list[int], v: list[int], a: list[int], z: list[int]) -> list[int]:
        """Return the accelerations that the rows allow and whose independent components are z; a are any that the rows allow."""
        for k, wanted, motion in zip(self.code.program.independent, z, self.directions(t, q, v), strict=True):
            a = self.along(a, self.g.sub(wanted, a[k]), motion)
        return a

    def newton(self, q: list[int], v: list[int], a: list[int], A: Array) -> Callable[[list[list[int]]], list[list[int]]]:
        """Return a function that solves for the changes (s, f) of the f independent accelerations of all s stages.

        Its argument are the errors (s, f) of the accelerations. All stages have the Jacobian of the state q, v, whose acceleration
        is a:  (1 - h^2 A A x K - h A x D) change = error,  as in `gauss_legendre`.
        """
        g, free = self.g, self.code.program.independent
        moved, per = g.const(DIFFERENCE), g.const(1 / DIFFERENCE)
        motions = self.directions(self.t, q, v)

        def derivatives(states: Iterable[tuple[list[int], list[int]]]) -> list[list[int]]:
            """Return the derivatives (f, f) of the independent accelerations by differences, one displaced state per column."""
            columns = [self.acceleration(self.t, *state) for state in states]
            return [[g.mul(per, g.sub(x[k], a[k])) for x in columns] for k in free]

        K = derivatives((self.along(q, moved, N), v) for N in motions)
        D = derivatives((q, self.along(v, moved, N)) for N in motions)
        places = [(i, k) for i in range(len(A)) for k in range(len(free))]  # (stage, free motion) of each unknown

        def entry(i: int, k: int, j: int, l: int) -> int:
            """Return the entry in the row of stage i, motion k and the column of stage j, motion l."""
            stiff = g.add(g.mul(self.times_h(float((A @ A)[i, j]), 2), K[k][l]), g.mul(self.times_h(float(A[i, j])), D[k][l]))
            return g.sub(g.const(float((i, k) == (j, l))), stiff)

        solve = self.factorise([[entry(*row, *column) for column in places] for row in places])

        def solve_stages(errors: list[list[int]]) -> list[list[int]]:
            x = solve([y for row in errors for y in row])
            return [x[i * len(free) : (i + 1) * len(free)] for i in range(len(A))]

        return solve_stages

    def factorise(self, matrix: list[list[int]]) -> Callable[[list[int]], list[int]]:
        """Factorise a matrix (k, k) into L U without exchanging rows; return a function that solves with it."""
        g, size = self.g, len(matrix)
        U, L = [list(row) for row in matrix], [[0] * size for _ in range(size)]
        inverse: list[int] = []
        for k in range(size):
            inverse.append(g.div(g.const(1.0), U[k][k]))
            for i in range(k + 1, size):
                L[i][k] = g.mul(U[i][k], inverse[k])
                for j in range(k + 1, size):
                    U[i][j] = g.sub(U[i][j], g.mul(L[i][k], U[k][j]))

        def solve(right: list[int]) -> list[int]:
            x = list(right)
            for i in range(size):
                for k in range(i):
                    x[i] = g.sub(x[i], g.mul(L[i][k], x[k]))
            for i in reversed(range(size)):
                for j in range(i + 1, size):
                    x[i] = g.sub(x[i], g.mul(U[i][j], x[j]))
                x[i] = g.mul(x[i], inverse[i])
            return x

        return solve

    def _watch(self, guard: list[int], thresholds: Array) -> None:
        """Demand that pivots are not below their thresholds; constant pivots need no guard."""
        g = self.g
        for pivot, threshold in zip(guard, thresholds, strict=True):
            if g.number(pivot) is None:
                self.pivots.append(g.make("le", g.const(threshold), g.abs(pivot)))

    def margin(self, finite: int) -> int:
        """Return the smallest ratio of a pivot to its threshold over all stages; 0 where the mask `finite` does not hold."""
        g, least = self.g, self.g.const(FINITE)
        for mask in self.pivots:
            threshold, size = g.operands[mask]  # `_watch` has made the mask: threshold <= size
            least = g.minimum(g.div(size, threshold), least)
        return g.make("select", finite, least, g.const(0.0))

    def correct_velocity(self, q: list[int] | None = None) -> list[int]:
        """Return the velocity, projected onto the constraints at the positions q, if the code projects.

        By default q is the position at the beginning of the step.
        """
        if not self.code.projected:
            return self.v
        nearest, guard = inline(self.g, self.code.program.nearest_velocity, ([self.t], q or self.q, self.v, self.p), self.sincos)
        self._watch(guard, self.code.program.correcting_thresholds)
        return nearest

    def correct_position(self, t: int, q: list[int], pairs: list[Pair], at: list[int]) -> tuple[list[int], list[Pair]]:
        """Return the positions and their sines, projected onto the constraints if the code projects.

        All corrections have the Jacobian of the positions `at`.
        """
        if not self.code.projected:
            return q, pairs
        if at is q:  # no stage was evaluated at q, so that its pivots have no guard yet
            self.acceleration(t, q, self.v)
        for k in range(self.reach.corrections):
            dq, guard = inline(self.g, self.code.program.position_correction, ([t], at, [t], q, self.p), self.sincos)
            if k == 0:
                self._watch(guard, self.code.program.correcting_thresholds)
            q = self.plus(q, dq)
            last = k == self.reach.corrections - 1
            reach = min(self.reach.correction, LAST_CORRECTION if last else inf)
            self.limit(self.of_angles(dq) or dq, reach)
            pairs = self.turn(pairs, dq, reach, q)
        return q, pairs

    def within(self, v: list[int]) -> int:
        """Return the mask where all limited norms stay in bounds and v is finite."""
        g = self.g
        score = g.make("le", g.total(self.score), g.const(1.0))
        return g.both([score, g.make("le", g.abs(g.total(v)), g.const(FINITE))])

    def step(self, q: list[int], v: list[int], pairs: list[Pair], out_v: list[int], out_pivots: list[int]) -> Step:
        """Return the step that ends at q, v and these sines; its sample has the velocity `out_v`, which `out_pivots` guard."""
        g, regular_out = self.g, self.g.both(out_pivots if self.code.projected else [])
        regular, within = g.both(self.pivots), self.within(v)
        settled = self.carried(*self.settle(q, v, pairs)) if self.code.settles else {}
        return Step(g, self.carried(q, v, pairs), [*self.q, *out_v], regular, regular_out, within, settled=settled)

    def carried(self, q: list[int], v: list[int], pairs: list[Pair]) -> dict[str, int]:
        """Return name of a leaf -> its value at the beginning of the next step."""
        carried = {f"%q{i}": x for i, x in enumerate(q)} | {f"%v{i}": x for i, x in enumerate(v)}
        for i, (s, c) in zip(self.code.angles, pairs, strict=False):
            carried |= {f"%s{i}": s, f"%c{i}": c}
        return carried

    def settle(self, q: list[int], v: list[int], pairs: list[Pair]) -> tuple[list[int], list[int], list[Pair]]:
        """Return positions, velocities and sines at the end of the step, projected onto the constraints by one correction.

        The guards of the next step check them.
        """
        g, end = self.g, self.g.add(self.t, self.h)
        dq, _ = inline(g, self.code.program.position_correction, ([end], q, [end], q, self.p), self.sincos)
        nearest = self.plus(q, dq)
        pairs = self.turn(pairs, dq, self.reach.step, nearest) if pairs else []
        velocities, _ = inline(g, self.code.program.nearest_velocity, ([end], nearest, v, self.p), self.sincos)
        return nearest, velocities, pairs


def rk4(code: Code, reach: Reach, library: bool = False) -> Step:
    """Write one step of the classical Runge-Kutta method, by the formulas at the head of this file."""
    b = Builder(code, reach, library=library)
    g, q, u = b.g, b.q, b.v  # u is the velocity before its correction v
    half, h, sixth = b.times_h(0.5), b.times_h(1.0), b.times_h(1 / 6)
    middle, end = g.add(b.t, half), g.add(b.t, h)
    start = b.carried_sines() if reach.rotates else []
    b.share(q, start)
    v = b.correct_velocity()
    a1 = b.acceleration(b.t, q, u)
    out_pivots = list(b.pivots)  # the sample at q, v needs no other guard
    q2, B = b.along(q, half, u), b.along(q, h, v)
    pairs2 = b.turn(start, b.times(half, u), reach.step / 2, q2)
    a2 = b.acceleration(middle, q2, b.along(v, half, a1))
    q3 = b.along(q2, b.times_h(0.25, 2), a1)
    b.turn(pairs2, b.times(b.times_h(0.25, 2), a1), reach.bend, q3)
    a3 = b.acceleration(middle, q3, b.along(v, half, a2))
    pairs_B = b.turn(b.compute_sines() if reach.rotates else [], b.times(h, v), reach.step, B)
    q4 = b.along(B, b.times_h(0.5, 2), a2)
    b.turn(pairs_B, b.times(b.times_h(0.5, 2), a2), reach.bend, q4)
    a4 = b.acceleration(end, q4, b.along(v, h, a3))
    inner = b.plus(a2, a3)
    bend = b.times(b.times_h(1 / 6, 2), b.plus(a1, inner))
    q_new = b.plus(B, bend)
    v_new = b.along(v, sixth, b.along(b.plus(a1, a4), g.const(2.0), inner))
    b.limit(b.times(h, b.of_angles(v)), reach.step)
    b.limit([x for a in (a1, a2, a3) for x in b.of_angles(a)], reach.bend, b.times_h(0.5, 2))
    pairs = b.turn(pairs_B, bend, reach.bend, q_new)
    q_new, pairs = b.correct_position(end, q_new, pairs, q4 if reach.rotates else q_new)
    return b.step(q_new, v_new, pairs, v, out_pivots)


def rk4_looped(code: Code) -> Step:
    """Write one step of the classical Runge-Kutta method, with one acceleration in a loop over the stages.

    Stage j = 0, 1, 2, 3 is at x, u and the time s. It adds w u and w a to the sums X and U, with w = 1, 2, 2, 1, and the next stage
    is at q + c u and v + c a, with c = h/2, h/2, h. The step ends at q + h/6 X and v + h/6 U.
    """
    b = Builder(code, EXACT)
    g, q, h = b.g, b.q, b.h
    first_v = b.correct_velocity()
    if code.projected:
        b.acceleration(b.t, q, b.v)  # for its guards, which the corrected velocity needs
    out_pivots, b.pivots = list(b.pivots), []
    x, u, X, U = (b.vector(letter) for letter in "xuXU")
    stage, s, steady = g.count("%stage"), g.leaf("%s"), g.make("mask", payload="%steady")  # steady: all guards so far hold
    early = g.make("below", stage, g.whole(2))
    middle = g.make("also", g.make("below", g.whole(0), stage), g.make("below", stage, g.whole(3)))
    c = g.make("select", g.make("everywhere", early), b.times_h(0.5), h)
    weight = g.make("select", g.make("everywhere", middle), g.const(2.0), g.const(1.0))
    a = b.acceleration(s, x, u)
    sum_X, sum_U = b.along(X, weight, u), b.along(U, weight, a)
    regular = g.both([steady, *b.pivots, b.within(a)])
    zero = [g.const(0.0)] * b.n
    leaves = [*x, *u, *X, *U]
    first = [*q, *first_v, *zero, *zero]
    following = [*b.along(q, c, u), *b.along(first_v, c, a), *sum_X, *sum_U]
    stages = dict(zip(leaves, zip(first, following, strict=True), strict=True))
    stages |= {s: (b.t, g.add(b.t, c)), stage: (g.whole(0), g.make("sum", stage, g.whole(1))), steady: (g.all(True), regular)}
    b.pivots, b.score = [regular, *out_pivots], []  # `regular` has the guards of all stages
    sixth = b.times_h(1 / 6)
    q_new, v_new = b.along(q, sixth, sum_X), b.along(first_v, sixth, sum_U)
    q_new, _ = b.correct_position(g.add(b.t, h), q_new, [], q_new)
    return replace(b.step(q_new, v_new, [], first_v, out_pivots), stages=stages)


def semi_implicit_euler(code: Code, reach: Reach, library: bool = False) -> Step:
    """Write one step of v' = v + h a(q, v), q' = q + h v'; v and q' are corrected if the code projects.

    Sines are carried from step to step, rotated by h v', whose norm must stay below `reach.step`.
    """
    b = Builder(code, reach, library=library)
    g, q = b.g, b.q
    b.share(q, b.carried_sines() if reach.rotates else [])
    v = b.correct_velocity()
    a = b.acceleration(b.t, q, v)
    out_pivots = list(b.pivots)
    v_new = b.along(v, b.h, a)
    q_new = b.along(q, b.h, v_new)
    b.limit(b.times(b.h, b.of_angles(v_new)), reach.step)
    pairs = b.turn(b.compute_sines() if reach.rotates else [], b.times(b.h, v_new), reach.step, q_new)
    q_new, pairs = b.correct_position(g.add(b.t, b.h), q_new, pairs, q_new)
    return b.step(q_new, v_new, pairs, v, out_pivots)


def dop853(code: Code, reach: Reach, library: bool = False, estimated: bool = False) -> Step:
    """Write one step of Dormand and Prince of order 8, twelve stages, with the positions of the stages written out as in `rk4`.

    With `estimated`, formulas of order 5 and 3 over the same stages give the error. The tolerances are the leaves "%rtol", "%atol":

        error = h^2 e5^4 / ((e5^2 + e3^2 / 100) 2 n),   e5, e3 norms of the differences relative to atol + rtol max(|y|, |y'|)
    """
    b, method = Builder(code, reach, library=library), order_eight()
    g, q, u, h = b.g, b.q, b.v, b.times_h(1.0)  # u is the velocity before its correction v
    b.share(q, b.compute_sines() if reach.rotates else [])
    # sines at q + h/2 u, from which those of the stages are rotated; `turned` collects the angles of these rotations
    to_middle, turned = b.times(b.times_h(0.5), u), list[int]()
    middle = [b.sincos(x) for x in b.of_angles(b.along(q, b.times_h(0.5), u))] if reach.rotates else []
    v = b.correct_velocity()
    a = [b.acceleration(b.t, q, u)]
    out_pivots = list(b.pivots)

    def rotate_sines(x: list[int], moved: list[int]) -> list[Pair]:
        """Return the sines at positions x = q + moved, rotated from those at the middle of the step."""
        ahead = [g.sub(d, half) for d, half in zip(moved, to_middle, strict=True)]
        turned.extend(b.of_angles(ahead))
        return b.turn(middle, ahead, reach.step, x)

    def at(c: float, weights: Coefficients, twice: Coefficients) -> tuple[list[int], list[int]]:
        """Return displacement and velocity at the fraction c of the step: c h v + h^2 sum twice_k a_k, v + h sum weights_k a_k."""
        moved = b.along(b.times(b.times_h(c), v), b.times_h(1.0, 2), b.weighted(a, twice))
        return moved, b.along(v, h, b.weighted(a, weights))

    for k in range(1, len(method.c)):
        moved, w = at(method.c[k], method.A[k], method.twice[k])
        x = b.plus(q, moved)
        rotate_sines(x, moved)
        a.append(b.acceleration(g.add(b.t, b.times_h(method.c[k])), x, w))
    moved, v_new = at(1.0, method.b, method.end)
    q_new = b.plus(q, moved)
    pairs = rotate_sines(q_new, moved)
    b.limit([g.largest(turned)], reach.step)
    q_new, _ = b.correct_position(g.add(b.t, h), q_new, pairs, x if reach.rotates else q_new)
    step = b.step(q_new, v_new, [], v, out_pivots)
    return replace(step, error=_error(b, a, [*q, *v], [*q_new, *v_new])) if estimated else step


def _error(b: Builder, a: list[list[int]], old: list[int], new: list[int]) -> int:
    """Return the square of a step's estimated error over the allowed one, for `dop853`; `old`, `new` are states (2n)."""
    g, squares = b.g, []
    inverses = []  # 1 / (atol + rtol max(|y|, |y'|)) of each coordinate and rate
    for x, y in zip(old, new, strict=True):
        larger = g.maximum(g.abs(y), g.abs(x))
        inverses.append(g.div(g.const(1.0), g.add(g.leaf("%atol"), g.mul(g.leaf("%rtol"), larger))))
    for weights, twice in order_eight().estimates:
        # errors of q and v divided by h; h^2 comes back in the last line
        errors = [*b.times(b.h, b.weighted(a, twice)), *b.weighted(a, weights)]
        squares.append(g.squares([g.mul(x, inverse) for x, inverse in zip(errors, inverses, strict=True)]))
    fifth, third = squares
    both = g.add(g.add(fifth, g.mul(g.const(0.01), third)), g.const(TINY))
    return g.div(g.mul(g.mul(b.h, b.h), g.mul(fifth, fifth)), g.mul(both, g.const(float(len(new)))))


def gauss_legendre(code: Code, reach: Reach, library: bool = False) -> Step:
    """Write one step of Gauss's collocation with three stages, order 6, implicit, for springs and dampers that are stiff.

    A motion can be stiff only along the free motions N, because rows and not forces hold the others. The unknowns of a stage are
    its independent accelerations z. The other accelerations follow from the rows at the stage, a + N (z - a), and each pass solves

        (1 - h^2 A A x K - h A x D) dz = a - z        K, D = derivatives of a along N by positions and velocities, independent part

    with K and D by differences at the beginning of the step. A step counts only if the change of velocities in its last pass is
    below CONVERGED. A linkage that is driven completely has no free motions: its passes replace the accelerations.
    Source: Hairer and Wanner, Solving Ordinary Differential Equations II (1996), sections IV.5 and IV.8.
    """
    b, (nodes, A, weights) = Builder(code, reach, library=library), gauss_tableau()
    g, q, h, c, free = b.g, b.q, b.times_h(1.0), nodes.tolist(), code.program.independent
    s = len(c)
    v = b.correct_velocity()
    start = b.acceleration(b.t, q, v)
    out_pivots = list(b.pivots)
    newton = b.newton(q, v, start, A) if free else None

    def at(c: float, weights: Coefficients, twice: Coefficients) -> tuple[list[int], list[int]]:
        """Return position and velocity at the fraction c of the step, from the accelerations of the stages."""
        moved = b.along(b.times(b.times_h(c), v), b.times_h(1.0, 2), b.weighted(stages, twice))
        return b.plus(q, moved), b.along(v, h, b.weighted(stages, weights))

    stages, z = [start] * s, [[start[k] for k in free]] * s  # accelerations (s, n), and their independent components (s, f)
    for _ in range(NATIVE_PASSES):
        states = [at(c[i], A[i].tolist(), (A @ A)[i].tolist()) for i in range(s)]
        accelerations = [b.acceleration(g.add(b.t, b.times_h(c[i])), *states[i]) for i in range(s)]
        if newton is None:
            changes = [[g.sub(x, y) for x, y in zip(a, old, strict=True)] for a, old in zip(accelerations, stages, strict=True)]
            stages = accelerations
            continue
        errors = [[g.sub(a[k], x) for k, x in zip(free, row, strict=True)] for a, row in zip(accelerations, z, strict=True)]
        changes = newton(errors)
        z = [b.plus(row, change) for row, change in zip(z, changes, strict=True)]
        stages = [b.constrain(g.add(b.t, b.times_h(c[i])), *states[i], accelerations[i], z[i]) for i in range(s)]
    b.limit(b.times(h, [x for change in changes for x in change]), CONVERGED)
    q_new, v_new = at(1.0, weights.tolist(), (weights @ A).tolist())
    q_new, _ = b.correct_position(g.add(b.t, h), q_new, [], q_new)
    return b.step(q_new, v_new, [], v, out_pivots)


STEPS = {"rk4": rk4, "semi_implicit_euler": semi_implicit_euler, "dop853_fixed": dop853, "gauss_legendre": gauss_legendre}
