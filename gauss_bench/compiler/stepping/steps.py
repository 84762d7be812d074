"""One step of an integrator as a graph of arithmetic, with its guards and, under the stabilisation "projection", its projection.

A guard is a condition that a valid step must satisfy: no pivot of the elimination is too small, and no link turns too far.

Runge-Kutta. The method of order 4 for q'' = a(t, q, v) has the positions of the stages written out in accelerations (Nystroem's
form). The results are those of the usual form except for rounding, and the position of a stage does not wait for its velocity. From
q, v, the step computes q', v' by

    q2 = q + h/2 v,         q3 = q2 + h^2/4 a1,   B = q + h v,   q4 = B + h^2/2 a2
    v2 = v + h/2 a1,        v3 = v + h/2 a2,      v4 = v + h a3
    q' = B + h^2/6 (a1 + a2 + a3),                v' = v + h/6 (a1 + 2 a2 + 2 a3 + a4)

Sines. Sine and cosine of an angle x + d follow from those of x by a rotation by d, which is cheap for small d. From stage to stage,
sines and cosines are updated by a rotation by h/2 v or h v (at most `Reach.step`), and by a further small rotation of the order h^2
(at most `Reach.bend`). One rotation after the other would accumulate rounding errors. Sine and cosine at q are therefore also
computed from the angle itself; the rotations for the fourth stage and the end of the step start from these values. In a step of
order 8, sines and cosines of all later stages are rotated from those at the position q + h/2 v.

Projection. At the end of a step, q gets Newton corrections, all with the Jacobian of the last stage, which is already factorised.
At the beginning of a step, v is corrected with the Jacobian at q, whose factors the first stage needs anyway. Only the first stage
is evaluated before the correction of v. The correction of v is of the order h^5, like the local error, and so does not change the
order of the method. Samples have corrected states, and the velocities of all stages but the first start from the corrected
velocity.

If constraint rows are redundant and the steps do not project the state, the loop over the steps projects it after every
`rollout.SETTLED` steps (`Builder.settle`).

Gauss's collocation (`gauss_legendre`) is implicit: positions and velocities at the stages follow from the accelerations at all
stages, which a fixed number of iterations computes. A guard checks that the accelerations of the stages have converged.
Sources: Hairer, Norsett and Wanner, Solving Ordinary Differential Equations I (1993), sections II.1 and II.14; Hairer and Wanner,
Solving Ordinary Differential Equations II (1996), section VII.2 (projection).
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field, replace
from math import inf, isfinite

import numpy as np

from gauss_bench.compiler.machine import trigonometry
from gauss_bench.compiler.machine.code import Code
from gauss_bench.compiler.machine.graph import Graph, Pair, inline
from gauss_bench.compiler.machine.rewrite import rewrite
from gauss_bench.integrate.fixed_step import DIFFERENCE, NATIVE_PASSES, dop853_estimates, dop853_tableau, gauss_tableau
from gauss_bench.terms import Array

FINITE = 1e300  # a larger sum has terms that are not finite or that overflow in the next operations
TINY = 1e-300  # keeps a divisor from being zero
# largest change of velocities in the last iteration of an implicit step; less than a tenth of it is left as error
CONVERGED = 2.0**-28
# [rad] largest norm of the last correction of positions; less than a thousandth of it is left as error
LAST_CORRECTION = 2.0**-28


@dataclass(frozen=True)
class Reach:
    """The largest changes of the links' angles in a step for which the code of the step is valid.

    A step in which the angles change by more is not accepted, and is repeated by code with a larger reach.

    Attributes:
        step: largest norm of h v over all angles [rad]; infinite for code that computes every sine and cosine from its angle.
        bend: largest norm of h^2/2 a over all angles and three stages [rad].
        correction: largest norm of one Newton correction of the positions over all angles [rad].
        corrections: number of Newton corrections of the positions in each step.
    """

    step: float
    bend: float
    correction: float
    corrections: int

    @property
    def rotates(self) -> bool:
        """True if sines and cosines are updated by a rotation of their previous values, instead of being computed from scratch."""
        return isfinite(self.step)


EXACT = Reach(inf, inf, inf, 4)  # for code that computes every sine and cosine from its angle, with four Newton corrections
# The series of a rotation (`trigonometry.rotate`) have an error below an eighth of a rounding up to 0.0065 rad with 2 terms, 0.0625
# rad with up to 4, and 0.25 rad with 5; a step of order 8 rotates up to 0.25 rad from its middle to either side. The series for
# `bend` have 1 or 2 terms. Each integrator begins with its smallest reach.
REACHES = {
    "rk4": (Reach(0.0065, 1.5e-4, 2.0**-28, 1), Reach(0.0625, 6.5e-3, 2.0**-20, 2), EXACT),
    "dop853_fixed": (Reach(0.25, inf, 6.5e-3, 4), EXACT),
    "gauss_legendre": (EXACT,),
    "semi_implicit_euler": (Reach(0.0065, inf, 1.5e-4, 3), Reach(0.0625, inf, 6.5e-3, 5), Reach(inf, inf, inf, 6)),
}


# The second reach with a single Newton correction, for projected steps of about a millisecond: their angles change by more than the
# first reach, but their corrections are as small as within the first reach, so that one correction is enough.
ONCE = replace(REACHES["rk4"][1], correction=2.0**-28, corrections=1)

# Largest number of operations of an acceleration that is written out for each of four stages. Longer code would take long to
# compile, and would not fit into the processor's caches.
LONG = 3_500


def is_looped(code: Code, integrator: str) -> bool:
    """Tell whether a step loops over its stages, because their code would be too long if each was written out."""
    return integrator == "rk4" and code.acceleration.operations > LONG


def reaches(code: Code, integrator: str) -> tuple[Reach, ...]:
    """Return the reaches (largest changes of angles per step) for which code of a step is generated, the smallest first."""
    if is_looped(code, integrator):  # this code computes every sine and cosine from its angle, and is valid for any change
        return (EXACT,)
    first, *others = REACHES[integrator]
    # projected steps of rk4 also have ONCE: code with a single Newton correction for the second reach
    return (first, ONCE, *others) if code.projected and integrator == "rk4" else (first, *others)


@dataclass(frozen=True, eq=False)
class Step:
    """The values that one integration step computes, as values (node indices) of a graph of arithmetic.

    Attributes:
        carried: name of a leaf that changes from step to step, such as a coordinate -> its value at the next step.
        out: q, v (2n) at the beginning of the step, to be stored as a sample.
        regular: mask that is true where no pivot of the step is too small.
        regular_out: mask that is true where no pivot on which `out` depends is too small.
        within: mask that is true where the angles change by no more than the reach of the code, and all values are finite.
        error: squared norm of the estimated local error relative to the tolerances, proportional to h^16; None if it is not
            estimated.
        settled: name of a leaf -> its value at the next step if the state is projected there after many steps (`rollout.SETTLED`);
            empty if the state is never projected in this way.
        stages: variable of a loop over the stages (a leaf) -> its value at the first stage, and its value at the next stage; empty
            if there is no such loop.
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
        """Return all values that must be computed in every step; the values in `settled` are not among them."""
        error = [] if self.error is None else [self.error]
        of_stages = [x for pair in self.stages.values() for x in pair]
        return [*self.carried.values(), *self.out, self.regular, self.regular_out, self.within, *error, *of_stages]

    def rewrite_into(self, into: Graph | None = None) -> "Step":
        """Return this step with sums and products regrouped, in the graph `into` (which may contain other steps) or a new one."""
        every = [*self.roots(), *self.settled.values()]
        graph, moved = rewrite(self.graph, every, into)
        carried, settled = ({name: moved[x] for name, x in values.items()} for values in (self.carried, self.settled))
        regular, regular_out, within = (moved[m] for m in (self.regular, self.regular_out, self.within))
        error = None if self.error is None else moved[self.error]
        # The keys of `stages` are leaves, which are not among the roots: find or make them in the new graph by operation and name.
        stages = {
            graph.make(self.graph.operation[leaf], payload=self.graph.payload[leaf]): (moved[first], moved[following])
            for leaf, (first, following) in self.stages.items()
        }
        return Step(graph, carried, [moved[x] for x in self.out], regular, regular_out, within, error, settled, stages)


class Builder:
    """Writes the arithmetic of one integration step into a graph, and collects its guards: conditions for a valid step.

    All int values, in all methods, are nodes of the graph and stand for a number or a mask. Vectors are lists of n nodes; `pairs`
    are sine and cosine of each angle in `code.angles`, empty if the step computes every sine from its angle.

    Attributes:
        library: whether sines are computed by functions of the target language, such as those of C.
        n: number of coordinates.
        q, v, p, t, h: leaves (inputs of the step) of the state, the number arguments, the time and the step size.
        sines: node of an angle -> its sine and cosine.
        pivots: guards: masks that are true where a pivot of an elimination is at least its threshold.
        score: terms (norm / bound)^2, one for each norm that is limited (`limit`); the step is valid only if their sum is at most
            1 (`within`).
    """

    def __init__(self, code: Code, reach: Reach, library: bool = False):
        """Make a graph whose leaves are the inputs of one integration step; arguments are explained in the class."""
        self.g = g = Graph()
        self.library = library
        self.code, self.reach, self.n = code, reach, code.program.n
        self.q, self.v = self.vector("q"), self.vector("v")
        self.p = [g.leaf(f"%p{i}") for i in range(len(code.program.parameters))]
        self.t, self.h = g.leaf("%t"), g.leaf("%h")
        self.sines: dict[int, Pair] = {}
        self.pivots: list[int] = []
        self.score: list[int] = []

    def vector(self, letter: str) -> list[int]:
        """Return the leaves of a vector, one for each coordinate, such as %q0, %q1 ... for the letter q."""
        return [self.g.leaf(f"%{letter}{i}") for i in range(self.n)]

    def carried_sines(self) -> list[Pair]:
        """Return the graph's inputs for sine and cosine of each angle at the beginning of the step, computed in the step before.

        The result is an empty list if the step computes every sine from its angle.
        """
        angles = self.code.angles if self.reach.rotates else ()
        return [(self.g.leaf(f"%s{i}"), self.g.leaf(f"%c{i}")) for i in angles]

    def times_h(self, factor: float, power: int = 1) -> int:
        """Return factor * h^power, which is computed once before the loop over the steps."""
        product = self.g.const(factor)
        for _ in range(power):
            product = self.g.mul(product, self.h)
        return product

    def plus(self, x: list[int], y: list[int]) -> list[int]:
        """Return the vector x + y."""
        return [self.g.add(a, b) for a, b in zip(x, y, strict=True)]

    def minus(self, x: list[int], y: list[int]) -> list[int]:
        """Return the vector x - y."""
        return [self.g.sub(a, b) for a, b in zip(x, y, strict=True)]

    def times(self, factor: int, x: list[int]) -> list[int]:
        """Return the vector factor * x."""
        return [self.g.mul(factor, a) for a in x]

    def along(self, x: list[int], factor: int, d: list[int]) -> list[int]:
        """Return the vector x + factor * d."""
        return self.plus(x, self.times(factor, d))

    def weighted(self, a: list[list[int]], weights: Array) -> list[int]:
        """Return the weighted sum of the accelerations a (stages, n) at the stages so far; further weights are not used."""
        terms = [(self.g.const(w), x) for w, x in zip(weights, a, strict=False) if w]
        return [self.g.total([self.g.mul(w, x[i]) for w, x in terms]) for i in range(self.n)]

    def sincos(self, x: int) -> Pair:
        """Return sine and cosine of an angle x, from `sines` or written now; without a library, |x| is limited to LARGEST."""
        if x not in self.sines and self.library:
            self.sines[x] = self.g.make("sin", x), self.g.make("cos", x)
        elif x not in self.sines:
            self.sines[x] = trigonometry.sincos(self.g, x)
            self.limit([x], trigonometry.LARGEST)
        return self.sines[x]

    def compute_sines(self) -> list[Pair]:
        """Compute the sines and cosines at the beginning of the step from the angles, not by rotating earlier sines and cosines.

        The result is an empty list if no sines are rotated from them.
        """
        if not self.reach.rotates:
            return []
        self.limit([self.q[i] for i in self.code.angles], trigonometry.LARGEST)
        return [trigonometry.sincos(self.g, self.q[i]) for i in self.code.angles]

    def limit(self, values: list[int], bound: float, factor: int | None = None) -> None:
        """Require that the norm of the nodes `values`, times the node `factor`, is at most `bound`, unless `bound` is infinite.

        The step is valid only if the sum of `score` is at most 1 (`within`), so that no single norm exceeds its bound.
        """
        if isfinite(bound):
            g = self.g
            weight = g.const(bound**-2) if factor is None else g.mul(g.const(bound**-2), g.mul(factor, factor))
            self.score.append(g.mul(weight, g.sum_of_squares(values)))

    def turn(self, pairs: list[Pair], change: list[int], bound: float, to: list[int]) -> list[Pair]:
        """Return sine and cosine of each angle after a change of the positions, by rotating sine and cosine before the change.

        If the step computes every sine from its angle, the result is an empty list.

        Args:
            bound: largest change of an angle [rad] for which the result is valid; the caller ensures it by `limit`.
            to: the new positions (n,). The new sines and cosines are stored in `sines` under their angles, so that functions that
                are written later for the positions `to` use them.
        """
        if not self.reach.rotates:
            return []
        turned = [trigonometry.rotate(self.g, pair, change[i], bound) for pair, i in zip(pairs, self.code.angles, strict=True)]
        self.store_sines(to, turned)
        return turned

    def store_sines(self, q: list[int], pairs: list[Pair]) -> None:
        """Store `pairs`, sine and cosine of each angle of the positions q, in `sines`; an empty list stores nothing."""
        self.sines.update(zip(self.of_angles(q), pairs, strict=False))

    def of_angles(self, x: list[int]) -> list[int]:
        """Return the components of a vector (n,) for the angles whose sines are needed (`code.angles`)."""
        return [x[i] for i in self.code.angles]

    def acceleration(self, t: int, q: list[int], v: list[int]) -> list[int]:
        """Return the acceleration (n,) at time t, positions q and velocities v, and add the guards of its elimination."""
        a, pivots = inline(self.g, self.code.acceleration, ([t], q, v, self.p), self.sincos)
        self._add_guards(pivots, self.code.program.thresholds)
        return a

    def directions(self, t: int, q: list[int], v: list[int]) -> list[list[int]]:
        """Return, for each independent coordinate, the free motion (n,) in which its rate is 1 and the others' rates are 0."""
        g, free = self.g, self.code.program.independent
        *motions, pivots = inline(g, self.code.program.directions, ([t], q, v, self.p), self.sincos)
        self._add_guards(pivots, self.code.program.direction_thresholds)
        return [[g.div(x, motion[k]) for x in motion] for k, motion in zip(free, motions, strict=True)]

    def constrain(self, t: int, q: list[int], v: list[int], a: list[int], z: list[int]) -> list[int]:
        """Return the accelerations (n,) that satisfy the constraint rows, as `a` does, and whose independent components are z."""
        for k, target, motion in zip(self.code.program.independent, z, self.directions(t, q, v), strict=True):
            a = self.along(a, self.g.sub(target, a[k]), motion)
        return a

    def newton(self, q: list[int], v: list[int], a: list[int], A: Array) -> Callable[[list[list[int]]], list[list[int]]]:
        """Return a function that computes Newton's corrections (s, f) of the f independent accelerations at all s stages.

        The function takes the errors (s, f) of these accelerations, and solves

            (1 - h^2 kron(A A, K) - h kron(A, D)) correction = error

        A (s, s) has the weights of the Runge-Kutta method. K and D (f, f) are the derivatives of the independent accelerations with
        respect to displacements and to velocities along the free motions. These derivatives are computed by finite differences at
        the state q, v, whose acceleration is a, and are used for all stages.
        """
        g, free = self.g, self.code.program.independent
        displacement, inverse = g.const(DIFFERENCE), g.const(1 / DIFFERENCE)
        motions = self.directions(self.t, q, v)

        def derivatives(states: Iterable[tuple[list[int], list[int]]]) -> list[list[int]]:
            """Return the derivatives (f, f) of the independent accelerations by differences, a column for each displaced state."""
            columns = [self.acceleration(self.t, *state) for state in states]
            return [[g.mul(inverse, g.sub(x[k], a[k])) for x in columns] for k in free]

        K = derivatives((self.along(q, displacement, N), v) for N in motions)
        D = derivatives((q, self.along(v, displacement, N)) for N in motions)
        places = [(i, k) for i in range(len(A)) for k in range(len(free))]  # (stage, free motion) of each unknown

        def entry(i: int, k: int, j: int, l: int) -> int:
            """Return the entry of Newton's matrix in the row of stage i, free motion k and the column of stage j, free motion l."""
            stiff = g.add(g.mul(self.times_h(float((A @ A)[i, j]), 2), K[k][l]), g.mul(self.times_h(float(A[i, j])), D[k][l]))
            return g.sub(g.const(float((i, k) == (j, l))), stiff)

        solve = self.factorise([[entry(*row, *column) for column in places] for row in places])

        def solve_stages(errors: list[list[int]]) -> list[list[int]]:
            """Return the corrections (s, f) of the independent accelerations at the stages for their errors (s, f)."""
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
            """Return the solution (k,) for a right side (k,), by substitution forwards with L and backwards with U."""
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

    def _add_guards(self, pivots: list[int], thresholds: Array) -> None:
        """Add the guards |pivot| >= threshold to `self.pivots`; a pivot that is a constant needs no guard."""
        g = self.g
        for pivot, threshold in zip(pivots, thresholds, strict=True):
            if g.number(pivot) is None:
                self.pivots.append(g.make("le", g.const(threshold), g.abs(pivot)))

    def margin(self, finite: int) -> int:
        """Return the node of the smallest ratio of a pivot to its threshold over all stages; 0 where the mask `finite` is false."""
        g, least = self.g, self.g.const(FINITE)  # the result without pivots
        for mask in self.pivots:
            threshold, size = g.operands[mask]  # `_add_guards` has made the mask: threshold <= size
            least = g.minimum(g.div(size, threshold), least)
        return g.make("select", finite, least, g.const(0.0))

    def correct_velocity(self) -> list[int]:
        """Return the velocity at the beginning of the step, which is projected under the stabilisation "projection".

        Guards for the pivots of this correction are added.
        """
        if not self.code.projected:
            return self.v
        nearest, pivots = inline(self.g, self.code.program.nearest_velocity, ([self.t], self.q, self.v, self.p), self.sincos)
        self._add_guards(pivots, self.code.program.correcting_thresholds)
        return nearest

    def correct_position(self, t: int, q: list[int], pairs: list[Pair], at: list[int]) -> tuple[list[int], list[Pair]]:
        """Return positions q with sines and cosines of their angles; under the stabilisation "projection", q is corrected first.

        Args:
            at: positions at which the Jacobian of all corrections is evaluated, usually those of the last stage. If no stage was
                evaluated at q or near q, pass the list `q` itself.
        """
        if not self.code.projected:
            return q, pairs
        if at is q:  # no stage was evaluated at q, so that its pivots have no guard yet
            self.acceleration(t, q, self.v)
        for k in range(self.reach.corrections):
            dq, pivots = inline(self.g, self.code.program.position_correction, ([t], at, [t], q, self.p), self.sincos)
            if k == 0:  # all corrections have the same pivots
                self._add_guards(pivots, self.code.program.correcting_thresholds)
            q = self.plus(q, dq)
            is_last = k == self.reach.corrections - 1
            bound = min(self.reach.correction, LAST_CORRECTION if is_last else inf)
            self.limit(self.of_angles(dq) or dq, bound)  # all coordinates are limited if no sines are needed
            pairs = self.turn(pairs, dq, bound, q)
        return q, pairs

    def within(self, v: list[int]) -> int:
        """Return the mask that is true where v is finite and no limited norm exceeds its bound (see `limit`)."""
        g = self.g
        # each term of `score` is (norm / bound)^2, so that no norm exceeds its bound where the sum of the terms is at most 1;
        # the sum of v tests all components: if one is infinite or NaN, so is the sum, and the comparison fails
        score = g.make("le", g.total(self.score), g.const(1.0))
        return g.both([score, g.make("le", g.abs(g.total(v)), g.const(FINITE))])

    def step(self, q: list[int], v: list[int], pairs: list[Pair], out_v: list[int], out_pivots: list[int]) -> Step:
        """Return the step that ends at positions q and velocities v; `pairs` has sine and cosine of each angle of q.

        The sample at the beginning has the velocity `out_v`, valid where the masks `out_pivots` are true.
        """
        g, regular_out = self.g, self.g.both(out_pivots if self.code.projected else [])
        regular, within = g.both(self.pivots), self.within(v)  # no pivot is too small; no angle has changed too much
        # variables of the next step if the state is projected before it
        settled = self.carry(*self.settle(q, v, pairs)) if self.code.settles else {}
        return Step(g, self.carry(q, v, pairs), [*self.q, *out_v], regular, regular_out, within, settled=settled)

    def carry(self, q: list[int], v: list[int], pairs: list[Pair]) -> dict[str, int]:
        """Return the variables that a step hands to the next one: name of a leaf ("%q0" ...) -> node of its next value."""
        carried = {f"%q{i}": x for i, x in enumerate(q)} | {f"%v{i}": x for i, x in enumerate(v)}
        for i, (s, c) in zip(self.code.angles, pairs, strict=False):
            carried |= {f"%s{i}": s, f"%c{i}": c}
        return carried

    def settle(self, q: list[int], v: list[int], pairs: list[Pair]) -> tuple[list[int], list[int], list[Pair]]:
        """Return positions, velocities, and sines and cosines at the end of the step, projected by one correction.

        The next step checks the pivots at the projected state, so that no guards are added here.
        """
        g, end = self.g, self.g.add(self.t, self.h)
        # arguments: time and positions of the Jacobian, time and positions that are corrected (here the same), parameters
        dq, _ = inline(g, self.code.program.position_correction, ([end], q, [end], q, self.p), self.sincos)
        nearest = self.plus(q, dq)
        pairs = self.turn(pairs, dq, self.reach.step, nearest) if pairs else []
        velocities, _ = inline(g, self.code.program.nearest_velocity, ([end], nearest, v, self.p), self.sincos)
        return nearest, velocities, pairs


def rk4(code: Code, reach: Reach, library: bool = False) -> Step:
    """Write one step of the classical Runge-Kutta method, by the formulas at the head of this file.

    `pairs2` and `pairs_B` are the sines and cosines at the positions q2 and B of these formulas; `pairs` are the sines and cosines
    at the end of the step.
    """
    b = Builder(code, reach, library=library)
    g, q, u = b.g, b.q, b.v  # u is the velocity before its correction v: a1 and q2 use u, in order not to wait for v
    half, h, sixth = b.times_h(0.5), b.times_h(1.0), b.times_h(1 / 6)
    middle, end = g.add(b.t, half), g.add(b.t, h)
    start = b.carried_sines()
    b.store_sines(q, start)
    v = b.correct_velocity()
    a1 = b.acceleration(b.t, q, u)
    out_pivots = list(b.pivots)  # the sample at q, v needs the guards so far and no others
    q2, B = b.along(q, half, u), b.along(q, h, v)
    pairs2 = b.turn(start, b.times(half, u), reach.step / 2, q2)
    a2 = b.acceleration(middle, q2, b.along(v, half, a1))
    q3 = b.along(q2, b.times_h(0.25, 2), a1)
    b.turn(pairs2, b.times(b.times_h(0.25, 2), a1), reach.bend, q3)
    a3 = b.acceleration(middle, q3, b.along(v, half, a2))
    # from here on, sines and cosines are rotated from those at q that are computed from the angles themselves
    pairs_B = b.turn(b.compute_sines(), b.times(h, v), reach.step, B)
    q4 = b.along(B, b.times_h(0.5, 2), a2)
    b.turn(pairs_B, b.times(b.times_h(0.5, 2), a2), reach.bend, q4)
    a4 = b.acceleration(end, q4, b.along(v, h, a3))
    inner = b.plus(a2, a3)
    bend = b.times(b.times_h(1 / 6, 2), b.plus(a1, inner))
    q_new = b.plus(B, bend)
    v_new = b.along(v, sixth, b.along(b.plus(a1, a4), g.const(2.0), inner))
    # guards of the rotations above: h v, and h^2/2 a at three stages
    b.limit(b.times(h, b.of_angles(v)), reach.step)
    b.limit([x for a in (a1, a2, a3) for x in b.of_angles(a)], reach.bend, b.times_h(0.5, 2))
    pairs = b.turn(pairs_B, bend, reach.bend, q_new)
    q_new, pairs = b.correct_position(end, q_new, pairs, q4 if reach.rotates else q_new)
    return b.step(q_new, v_new, pairs, v, out_pivots)


def rk4_looped(code: Code) -> Step:
    """Write one step of the classical Runge-Kutta method; the code of the acceleration occurs once, in a loop over the stages.

    Stage j = 0, 1, 2, 3 is at the position x, the velocity u and the time s, and has the acceleration a. X is the sum of w u, and U
    is the sum of w a, over all stages, with the weights w = 1, 2, 2, 1. The next stage is at q + c u, v + c a and the time t + c,
    with c = h/2, h/2, h. The step ends at q + h/6 X and v + h/6 U.
    """
    b = Builder(code, EXACT)
    g, q, h = b.g, b.q, b.h
    first_v = b.correct_velocity()
    if code.projected:
        # the result is not used; the call adds to b.pivots the guards of the elimination, on which the corrected velocity relies
        b.acceleration(b.t, q, b.v)
    # guards of the sample at the beginning of the step; the body of the loop collects its own in b.pivots
    out_pivots, b.pivots = list(b.pivots), []
    # variables of the loop: vectors, number and time of the stage, and a mask: all guards of the stages so far are satisfied
    x, u, X, U = (b.vector(letter) for letter in "xuXU")
    stage, s, steady = g.count("%stage"), g.leaf("%s"), g.make("mask", payload="%steady")
    # body of the loop, with c = h/2 in the stages 0 and 1, and w = 2 in the stages 1 and 2
    early = g.make("below", stage, g.whole(2))
    middle = g.make("also", g.make("below", g.whole(0), stage), g.make("below", stage, g.whole(3)))
    c = g.make("select", g.make("everywhere", early), b.times_h(0.5), h)
    weight = g.make("select", g.make("everywhere", middle), g.const(2.0), g.const(1.0))
    a = b.acceleration(s, x, u)
    sum_X, sum_U = b.along(X, weight, u), b.along(U, weight, a)
    regular = g.both([steady, *b.pivots, b.within(a)])
    # each variable with its value at stage 0 and at the next stage
    zero = [g.const(0.0)] * b.n
    leaves = [*x, *u, *X, *U]
    first = [*q, *first_v, *zero, *zero]
    following = [*b.along(q, c, u), *b.along(first_v, c, a), *sum_X, *sum_U]
    stages = dict(zip(leaves, zip(first, following, strict=True), strict=True))
    stages |= {s: (b.t, g.add(b.t, c)), stage: (g.whole(0), g.make("sum", stage, g.whole(1))), steady: (g.all(True), regular)}
    # after the loop: `regular` has the guards of all stages
    b.pivots, b.score = [regular, *out_pivots], []
    sixth = b.times_h(1 / 6)
    q_new, v_new = b.along(q, sixth, sum_X), b.along(first_v, sixth, sum_U)
    q_new, _ = b.correct_position(g.add(b.t, h), q_new, [], q_new)
    return replace(b.step(q_new, v_new, [], first_v, out_pivots), stages=stages)


def semi_implicit_euler(code: Code, reach: Reach, library: bool = False) -> Step:
    """Write one step of v' = v + h a(q, v), q' = q + h v'."""
    b = Builder(code, reach, library=library)
    g, q = b.g, b.q
    b.store_sines(q, b.carried_sines())
    v = b.correct_velocity()
    a = b.acceleration(b.t, q, v)
    out_pivots = list(b.pivots)  # guards of the sample at q, v; the correction of q' adds others
    v_new = b.along(v, b.h, a)
    q_new = b.along(q, b.h, v_new)
    b.limit(b.times(b.h, b.of_angles(v_new)), reach.step)
    pairs = b.turn(b.compute_sines(), b.times(b.h, v_new), reach.step, q_new)
    q_new, pairs = b.correct_position(g.add(b.t, b.h), q_new, pairs, at=q_new)
    return b.step(q_new, v_new, pairs, v, out_pivots)


def dop853(code: Code, reach: Reach, library: bool = False, estimated: bool = False) -> Step:
    """Write one step of Dormand and Prince of order 8, twelve stages, with the positions of the stages written out as in `rk4`.

    If `estimated`, formulas of order 5 and 3 over the same stages give the squared relative error of the step. The tolerances atol
    and rtol are the leaves "%atol" and "%rtol" of the graph. With the states y and y' (2n,) before and after the step:

        error = h^2 e5^4 / ((e5^2 + e3^2 / 100) 2 n)

    e5 and e3 are the norms of the differences of y' from the results of order 5 and 3, each component divided by h (atol + rtol
    max(|y|, |y'|)).
    """
    b, (c, rows, weights) = Builder(code, reach, library=library), dop853_tableau()  # nodes, weights of stages, and of the end
    # accelerations have the weights A in the velocities of the stages; velocities have the weights A in positions, so that
    # accelerations have the weights A A in positions
    A = np.array([np.pad(row, (0, len(weights) - len(row))) for row in rows])
    twice = A @ A
    g, q, u, h = b.g, b.q, b.v, b.times_h(1.0)  # u is the velocity before its correction v
    b.store_sines(q, b.compute_sines())
    # `middle`: sines and cosines at q + h/2 u, from which those of the stages are rotated; `rotations` collects the angles of these
    # rotations, which are limited below
    to_middle, rotations = b.times(b.times_h(0.5), u), list[int]()
    middle = [b.sincos(x) for x in b.of_angles(b.along(q, b.times_h(0.5), u))] if reach.rotates else []
    v = b.correct_velocity()
    a = [b.acceleration(b.t, q, u)]  # of the stages so far; at u, in order not to wait for v
    out_pivots = list(b.pivots)  # guards of the sample at q, v

    def rotate_sines(x: list[int], moved: list[int]) -> list[Pair]:
        """Return sines and cosines at x = q + moved, by a rotation of those at q + h/2 u, which is noted in `rotations`."""
        from_middle = b.minus(moved, to_middle)
        rotations.extend(b.of_angles(from_middle))
        return b.turn(middle, from_middle, reach.step, x)

    def motion_at(fraction: float, of_velocity: Array, of_position: Array) -> tuple[list[int], list[int]]:
        """Return displacement and velocity at a fraction c of the step, from the accelerations a_k of the stages so far.

        The displacement is c h v + h^2 sum_k of_position_k a_k, and the velocity is v + h sum_k of_velocity_k a_k.
        """
        moved = b.along(b.times(b.times_h(fraction), v), b.times_h(1.0, 2), b.weighted(a, of_position))
        return moved, b.along(v, h, b.weighted(a, of_velocity))

    for k in range(1, len(c)):
        moved, stage_v = motion_at(c[k], A[k], twice[k])
        stage_q = b.plus(q, moved)
        rotate_sines(stage_q, moved)
        a.append(b.acceleration(g.add(b.t, b.times_h(c[k])), stage_q, stage_v))
    moved, v_new = motion_at(1.0, weights, weights @ A)
    q_new = b.plus(q, moved)
    pairs = rotate_sines(q_new, moved)
    b.limit([g.largest(rotations)], reach.step)
    # the corrections use the Jacobian of the last stage, which is at the end of the step and, with a limit of the step, near q_new
    q_new, _ = b.correct_position(g.add(b.t, h), q_new, pairs, at=stage_q if reach.rotates else q_new)
    step = b.step(q_new, v_new, [], v, out_pivots)
    return replace(step, error=_error(b, a, A, [*q, *v], [*q_new, *v_new])) if estimated else step


def _error(b: Builder, a: list[list[int]], A: Array, old: list[int], new: list[int]) -> int:
    """Return the square of a step's estimated error divided by the allowed error, by the formula of `dop853`.

    Args:
        a: (s, n) nodes of the accelerations at the stages.
        A: (s, s) weights of the accelerations in the velocities of the stages.
        old, new: nodes of the states (2n,) before and after the step, y and y' in the formula of `dop853`.
    """
    g, squares = b.g, []  # squares: e5^2 and e3^2
    inverses = []  # 1 / (atol + rtol max(|y|, |y'|)) of each coordinate and velocity
    for x, y in zip(old, new, strict=True):
        larger = g.maximum(g.abs(y), g.abs(x))
        inverses.append(g.div(g.const(1.0), g.add(g.leaf("%atol"), g.mul(g.leaf("%rtol"), larger))))
    for e in dop853_estimates():
        # errors of q and v divided by h; the factor h^2 of the formula is in the last line
        errors = [*b.times(b.h, b.weighted(a, e @ A)), *b.weighted(a, e)]
        squares.append(g.sum_of_squares([g.mul(x, inverse) for x, inverse in zip(errors, inverses, strict=True)]))
    fifth, third = squares
    both = g.add(g.add(fifth, g.mul(g.const(0.01), third)), g.const(TINY))
    return g.div(g.mul(g.mul(b.h, b.h), g.mul(fifth, fifth)), g.mul(both, g.const(float(len(new)))))


def gauss_legendre(code: Code, reach: Reach, library: bool = False) -> Step:
    """Write one step of Gauss's collocation with three stages, order 6, implicit, for springs and dampers that are stiff.

    A motion can be stiff only along the free motions N (n, f), because constraints and not forces determine all other directions.
    The unknowns of a stage are its independent accelerations z (f,): the accelerations of the independent coordinates. Let a (n,)
    be the acceleration that is evaluated at the stage, and a_f (f,) its independent components. Then a + N (z - a_f) satisfies the
    constraint rows and has the independent components z. Each iteration of Newton's method solves

        (1 - h^2 kron(A A, K) - h kron(A, D)) dz = a_f - z

    for the corrections dz of z at all stages. A (3, 3) has the method's coefficients; K and D (f, f) are derivatives of the
    independent accelerations with respect to displacements and velocities along the free motions. A linkage whose inputs are all
    driven has no free motions: each iteration then replaces the accelerations of the stages by those evaluated at their states.
    Source: Hairer and Wanner, Solving Ordinary Differential Equations II (1996), sections IV.5 and IV.8.
    """
    b, (nodes, A, weights) = Builder(code, reach, library=library), gauss_tableau()
    g, q, h, c, free = b.g, b.q, b.times_h(1.0), nodes.tolist(), code.program.independent
    s = len(c)  # number of stages
    v = b.correct_velocity()
    start = b.acceleration(b.t, q, v)
    out_pivots = list(b.pivots)  # guards of the sample at q, v
    newton = b.newton(q, v, start, A) if free else None

    def state_at(fraction: float, of_velocity: Array, of_position: Array) -> tuple[list[int], list[int]]:
        """Return position and velocity at a fraction of the step, from weighted sums of the accelerations `stages`."""
        moved = b.along(b.times(b.times_h(fraction), v), b.times_h(1.0, 2), b.weighted(stages, of_position))
        return b.plus(q, moved), b.along(v, h, b.weighted(stages, of_velocity))

    stages, z = [start] * s, [[start[k] for k in free]] * s  # accelerations (s, n), and their independent components (s, f)
    for _ in range(NATIVE_PASSES):
        states = [state_at(c[i], A[i], (A @ A)[i]) for i in range(s)]
        accelerations = [b.acceleration(g.add(b.t, b.times_h(c[i])), *states[i]) for i in range(s)]
        if newton is None:
            changes = [b.minus(a, old) for a, old in zip(accelerations, stages, strict=True)]
            stages = accelerations
            continue
        errors = [b.minus([a[k] for k in free], row) for a, row in zip(accelerations, z, strict=True)]
        changes = newton(errors)
        z = [b.plus(row, change) for row, change in zip(z, changes, strict=True)]
        stages = [b.constrain(g.add(b.t, b.times_h(c[i])), *states[i], accelerations[i], z[i]) for i in range(s)]
    b.limit(b.times(h, [x for change in changes for x in change]), CONVERGED)
    q_new, v_new = state_at(1.0, weights, weights @ A)
    q_new, _ = b.correct_position(g.add(b.t, h), q_new, [], q_new)
    return b.step(q_new, v_new, [], v, out_pivots)


STEPS = {"rk4": rk4, "semi_implicit_euler": semi_implicit_euler, "dop853_fixed": dop853, "gauss_legendre": gauss_legendre}
