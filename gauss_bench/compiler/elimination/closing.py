"""Functions that close a linkage at one sample of its inputs: the rows of joints and inputs, solved for all coordinates.

Inputs u are drivers with rates w and second rates b, so that J is square; the next sample is at u + g:

    correction     J z = -phi(q, u)
    one input      J d = 1,  J e = gamma(q, d),     q' = d w,  q'' = d b + e w^2,     the next guess is q + g (d + g e / 2)
    several        J q' = w,  J q'' = b + gamma(q, q');     the next guess likewise, with g for w and 0 for b

The pivots of J are the guards: their product is its determinant, whose sign distinguishes assemblies. As for the equations of
motion they are chosen at sample positions, here those of the assembly in which the linkage starts.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from gauss_bench.compiler.elimination.formulations import guarded, keep_rows, vector
from gauss_bench.compiler.elimination.function import Function, function
from gauss_bench.compiler.elimination.lu import Search, lu
from gauss_bench.compiler.elimination.partition import SINGULAR, Study, study
from gauss_bench.compiler.equations.constraints import rows_of
from gauss_bench.compiler.equations.links import Links, State, open_parameters
from gauss_bench.compiler.errors import KernelError
from gauss_bench.compiler.expressions.node import ExpressionGraph, Node
from gauss_bench.kinematics.loop_equations import REGULAR
from gauss_bench.mechanism.coordinates import value
from gauss_bench.mechanism.equations import Motion, Row
from gauss_bench.mechanism.evaluate import Constraints
from gauss_bench.mechanism.model import Mechanism
from gauss_bench.mechanism.motion_laws import MotionLaw
from gauss_bench.terms import Array


@dataclass(frozen=True, eq=False)
class ClosingProgram:
    """The functions that close one linkage at given inputs.

    Attributes:
        driven: the linkage, with its inputs as drivers.
        correction: (q, u) -> z (n).
        motion: (q, u, w, b, g) -> guards, which must not change sign; the step (n) to the guess at the next sample; q, v, a.
    """

    driven: Mechanism
    correction: Function
    motion: Function

    @property
    def inputs(self) -> int:
        return len(self.driven.drivers)

    @property
    def guards(self) -> int:
        return len(self.motion.outputs[0])

    @cached_property
    def angles(self) -> list[int]:
        """Coordinates whose sines and cosines are needed."""
        return sorted(self.correction.angles(0) | self.motion.angles(0))

    @property
    def width(self) -> int:
        """Numbers stored at each sample."""
        return len(self.motion.outputs[2])


class Driven(Links):
    """The links at a sample: laws, named by the index of their driver, have its levels; rates are given where they are known."""

    levels: Sequence[Motion]
    rates: Sequence[Node] | None = None

    def law(self, law: MotionLaw) -> Motion:
        return self.levels[int(law.name)]

    def rate(self, k: int) -> Node:
        return super().rate(k) if self.rates is None else self.rates[k]


def closing_program(mechanism: Mechanism) -> ClosingProgram:
    """Generate the program for a linkage with as many drivers, its inputs, as degrees of freedom.

    Raises:
        KernelError: no usable pivots.
    """
    known = study(replace(mechanism, drivers=()) if mechanism.dof == 1 else mechanism)  # positions all over the motion
    correction, motion = _Equations(mechanism, known).solve()
    n, K = mechanism.n, len(mechanism.drivers)
    closing = function((("q", n), ("u", K)), correction, None)
    return ClosingProgram(mechanism, closing, function((("q", n), ("u", K), ("w", K), ("b", K), ("g", K)), motion, None))


class _Equations:
    """The constraint rows of a driven linkage before elimination, at samples of the assembly in which it starts.

    Attributes:
        kept: rows that are eliminated, those of joints and then one for each driver; drop: how the others are shared among them.
        levels: four tuples of one node per input: value u, rate w, second rate b, and the change g from the last position.
    """

    def __init__(self, driven: Mechanism, known: Study):
        numbered = (replace(d, law=MotionLaw(str(k), d.law.motion)) for k, d in enumerate(driven.drivers))
        self.driven, self.drop = replace(driven, drivers=tuple(numbered)), known.drops[0]
        self.parameters = open_parameters(driven, ())
        joints = Constraints(driven).joint_rows
        self.kept = (*(k for k in known.kept(0) if k < joints), *range(joints, joints + len(driven.drivers)))
        q = self._same_assembly(known.states.q)
        u = np.array([value(d.coordinate, q) for d in driven.drivers])
        self.graph = graph = ExpressionGraph(len(q))
        self.state = State("t", "q", "v", np.zeros(len(q)), q, np.random.default_rng(0).normal(size=q.shape))
        self.levels = [
            tuple(graph.input(letter, k, x if letter == "u" else 1.0 + 0.1 * np.sin(x + place), 1.0) for k, x in enumerate(u))
            for place, letter in enumerate("uwbg")
        ]
        zero = graph.constant(0.0)
        self.zeros = (zero,) * len(u)
        self.rows = self._rows(self.zeros, self.zeros)

    def _same_assembly(self, q: Array) -> Array:
        """Select the positions (k, n) at which det J has the same sign as at the start."""
        J = Constraints(self.driven)(0.0, np.concatenate([self.driven.q0[None], q]), np.zeros((1 + len(q), q.shape[1]))).J
        square = J[:, self.kept]
        for at, row, factor in self.drop.shares:
            square[:, self.kept.index(at)] += factor * J[:, row]
        sizes, signs = np.linalg.svd(square, compute_uv=False), np.linalg.slogdet(square)[0]
        regular = sizes[:, -1] / sizes[:, 0]
        if regular[0] < REGULAR:
            raise KernelError(f"{self.driven.name}: the start is at a singular position")
        same: Array = q[(signs[1:] == signs[0]) & (regular[1:] > SINGULAR * np.median(regular))]
        return same

    def _links(self, rates: Sequence[Node], seconds: Sequence[Node], v: Sequence[Node] | None = None) -> Driven:
        links = Driven(self.graph, self.driven, self.parameters, self.state)
        links.levels, links.rates = list(zip(self.levels[0], rates, seconds, strict=True)), v
        return links

    def _rows(self, rates: Sequence[Node], seconds: Sequence[Node], v: Sequence[Node] | None = None) -> list[Row]:
        return keep_rows(self.graph, rows_of(self._links(rates, seconds, v)), self.kept, self.drop)

    def solve(self) -> tuple[list[list[Node]], list[list[Node]]]:
        """Results of `ClosingProgram.correction` and `.motion`."""
        graph, n = self.graph, self.driven.n
        jacobian = {(r, c): e for r, row in enumerate(self.rows) for c, e in row.entries.items()}
        factors = lu(graph, jacobian, range(n), range(n), Search(), squares=True)

        def solved(right: Sequence[Node]) -> list[Node]:
            return vector(graph, factors.solve({r: x for r, x in enumerate(right) if not x.zero}), n)

        def follow(rates: Sequence[Node], seconds: Sequence[Node]) -> tuple[list[Node], list[Node]]:
            """Return rates and second rates of all coordinates for given ones of the inputs."""
            v = solved([-row.phi_t for row in self._rows(rates, seconds)])
            return v, solved([row.gamma for row in self._rows(rates, seconds, v)])

        _, w, b, g = self.levels
        if len(w) == 1:
            d, e = follow((graph.constant(1.0),), self.zeros)
            advance = [g[0] * (x + g[0] * (y * 0.5)) for x, y in zip(d, e, strict=True)]
            square = w[0] * w[0]
            v, a = [x * w[0] for x in d], [x * b[0] + y * square for x, y in zip(d, e, strict=True)]
        else:
            advance = [x + y * 0.5 for x, y in zip(*follow(g, self.zeros), strict=True)]
            v, a = follow(w, b)
        z = solved([-row.phi for row in self.rows if row.phi is not None])
        links = self._links(self.zeros, self.zeros, v)
        return [z], [[x for x, _ in guarded(factors)], advance, [*(links.coordinate(k) for k in range(n)), *v, *a]]
