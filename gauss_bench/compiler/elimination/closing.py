"""Functions that close a linkage at one sample of its inputs: the rows of joints and inputs, solved for all coordinates.

The inputs u are drivers with rates w and second rates b, so that J is square. The next sample is at u + g:

    correction     J z = -phi(q, u)
    one input      J d = 1,  J e = gamma(q, d),     q' = d w,  q'' = d b + e w^2,     the next guess is q + g (d + g e / 2)
    several        J q' = w,  J q'' = b + gamma(q, q');     the next guess is q + q' + q'' / 2, with g for w and 0 for b

The pivots of J are the guards: their product is its determinant, whose sign distinguishes assemblies. Pivots are chosen at sampled
positions in the assembly in which the linkage starts.
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
        correction: function (q, u) -> z (n).
        motion: function (q, u, w, b, g) -> guards, which must not change their signs; the step (n) to the guess at the next sample;
            q, v, a (3n).
    """

    driven: Mechanism
    correction: Function
    motion: Function

    @property
    def inputs(self) -> int:
        """Number of inputs."""
        return len(self.driven.drivers)

    @property
    def guards(self) -> int:
        """Number of guards."""
        return len(self.motion.outputs[0])

    @cached_property
    def angles(self) -> list[int]:
        """Indices of the coordinates whose sines and cosines are needed."""
        return sorted(self.correction.angles(0) | self.motion.angles(0))

    @property
    def width(self) -> int:
        """Number of values that are stored at each sample, q, v and a."""
        return len(self.motion.outputs[2])


class Driven(Links):
    """The links at a sample, where drivers have given values instead of laws of time.

    Attributes:
        levels: value, rate and second rate of each driver; the name of a driver's law is the driver's index.
        rates: rates of all coordinates if they are known already, else None.
    """

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
        kept: indices of the rows that are eliminated, those of joints and then one for each driver.
        drop: the choice of redundant rows.
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
        """Return the positions of q (k, n) that are not nearly singular and at which det J has the same sign as at the start."""
        J = Constraints(self.driven)(0.0, np.concatenate([self.driven.q0[None], q]), np.zeros((1 + len(q), q.shape[1]))).J
        square = J[:, self.kept]
        for at, row, factor in self.drop.shares:
            square[:, self.kept.index(at)] += factor * J[:, row]
        sizes, signs = np.linalg.svd(square, compute_uv=False), np.linalg.slogdet(square)[0]  # (1 + k, n), (1 + k,)
        regular = sizes[:, -1] / sizes[:, 0]
        if regular[0] < REGULAR:
            raise KernelError(f"{self.driven.name}: the start is at a singular position")
        same: Array = q[(signs[1:] == signs[0]) & (regular[1:] > SINGULAR * np.median(regular))]
        return same

    def _links(self, rates: Sequence[Node], seconds: Sequence[Node], v: Sequence[Node] | None = None) -> Driven:
        """Return the links for rates and second rates of the inputs, and rates v of all coordinates if they are known."""
        links = Driven(self.graph, self.driven, self.parameters, self.state)
        links.levels, links.rates = list(zip(self.levels[0], rates, seconds, strict=True)), v
        return links

    def _rows(self, rates: Sequence[Node], seconds: Sequence[Node], v: Sequence[Node] | None = None) -> list[Row]:
        """Return the rows that are eliminated, for the same arguments as `_links`."""
        return keep_rows(self.graph, rows_of(self._links(rates, seconds, v)), self.kept, self.drop)

    def solve(self) -> tuple[list[list[Node]], list[list[Node]]]:
        """Return the results of `ClosingProgram.correction` and of `ClosingProgram.motion`, each as lists of nodes."""
        graph, n = self.graph, self.driven.n
        jacobian = {(r, c): e for r, row in enumerate(self.rows) for c, e in row.entries.items()}
        factors = lu(graph, jacobian, range(n), range(n), Search(), squares=True)

        def solve(right: Sequence[Node]) -> list[Node]:
            """Return the solution (n) of J x = right."""
            return vector(graph, factors.solve({r: x for r, x in enumerate(right) if not x.zero}), n)

        def follow(rates: Sequence[Node], seconds: Sequence[Node]) -> tuple[list[Node], list[Node]]:
            """Return rates (n) and second rates (n) of all coordinates, for those of the inputs."""
            v = solve([-row.phi_t for row in self._rows(rates, seconds)])
            return v, solve([row.gamma for row in self._rows(rates, seconds, v)])

        _, w, b, g = self.levels
        if len(w) == 1:
            d, e = follow((graph.constant(1.0),), self.zeros)
            advance = [g[0] * (x + g[0] * (y * 0.5)) for x, y in zip(d, e, strict=True)]
            square = w[0] * w[0]
            v, a = [x * w[0] for x in d], [x * b[0] + y * square for x, y in zip(d, e, strict=True)]
        else:
            advance = [x + y * 0.5 for x, y in zip(*follow(g, self.zeros), strict=True)]
            v, a = follow(w, b)
        z = solve([-row.phi for row in self.rows if row.phi is not None])
        links = self._links(self.zeros, self.zeros, v)
        q, guards = [links.coordinate(k) for k in range(n)], [x for x, _ in guarded(factors)]
        return [z], [guards, advance, [*q, *v, *a]]
