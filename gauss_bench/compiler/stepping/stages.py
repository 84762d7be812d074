"""One stage of Runge-Kutta for a loop over the stages, and what follows the last.

With the stage at x, u and the step begun at q, v; the sums X, U; the way c to the next stage and the weight w of this one:

    a = a(t, x, u),   X += w u,   U += w a,   x = q + c u,   u = v + c a          (all with the old u)
    q' = q + h/6 X,   v' = v + h/6 U                                             after the fourth

Sines are rotated from q to x; those at q come from nothing. The projection follows the last stage: q by Newton's chord at the
uncorrected q', then v with the Jacobian at the corrected one.
"""

from dataclasses import dataclass

from gauss_bench.compiler.machine import trigonometry
from gauss_bench.compiler.machine.graph import Graph, inline
from gauss_bench.compiler.stepping.steps import Builder, Code, Reach


@dataclass(frozen=True, eq=False)
class Stage:
    """The values of a part of a step: leaf -> its next value, and the masks of Step."""

    graph: Graph
    carried: dict[str, int]
    regular: int | None
    within: int

    def roots(self) -> list[int]:
        """Everything that must be computed."""
        return [*self.carried.values(), *(m for m in (self.regular, self.within) if m is not None)]


def rk4_stage(code: Code, reach: Reach) -> Stage:
    """One stage."""
    b = Builder(code, reach, "x", "u")
    g, x, u = b.g, b.q, b.v
    q, v, way, weight = b.vector("q"), b.vector("v"), g.leaf("%way"), g.leaf("%weight")
    if reach.rotates:
        moved = [g.sub(a, c) for a, c in zip(x, q, strict=True)]
        b.turn(b.given(), moved, reach.step, x)
        b.limit(b.of_angles(moved), reach.step)
        b.limit(b.of_angles(q), trigonometry.LARGEST)
    a = b.acceleration(b.t, x, u)
    following = {"x": b.along(q, way, u), "u": b.along(v, way, a)}
    following |= {"X": b.along(b.vector("X"), weight, u), "U": b.along(b.vector("U"), weight, a)}
    carried = {f"%{letter}{i}": k for letter, values in following.items() for i, k in enumerate(values)}
    return Stage(g, carried, g.both(b.pivots), b.within(a))


def rk4_end(code: Code, reach: Reach) -> Stage:
    """The step's results from the sums."""
    b = Builder(code, reach)
    g, sixth, end = b.g, b.times_h(1 / 6), b.g.add(b.t, b.h)
    q, v = b.along(b.q, sixth, b.vector("X")), b.along(b.v, sixth, b.vector("U"))
    if code.projected:
        pairs = [b.sincos(x) for x in b.of_angles(q)]
        q, _ = b.corrected_position(end, q, pairs, q)
        (dv,) = inline(g, code.velocity, ([end], q, v, b.p), b.sincos)
        v = [g.add(x, d) for x, d in zip(v, dv, strict=True)]
    carried = {f"%q{i}": x for i, x in enumerate(q)} | {f"%v{i}": x for i, x in enumerate(v)}
    return Stage(g, carried, g.both(b.pivots), b.within(v))
