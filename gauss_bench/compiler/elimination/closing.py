"""Generated functions that close the loops of a linkage for one sample of its inputs.

The functions also return the first and second time derivatives of all coordinates, and a first guess of the position at the next
sample. The symbols are:

    u, w, b:     values of the inputs (the coordinates that drivers prescribe), and their first and second time derivatives
    g:           change of u from one sample to the next
    phi = 0:     constraint equations of joints and drivers: as many as there are coordinates q, so that their Jacobian J is square
    gamma:       right-hand side of J q'' = gamma
    z:           Newton's correction of q
    d, e:        first and second derivatives of q with respect to the input, if there is only one input

The equations are:

    correction:         J z = -phi(q, u)
    one input:          J d = 1,  J e = gamma(q, d),     q' = d w,  q'' = d b + e w^2,     the next guess is q + g (d + g e / 2)
    several inputs:     J q' = w,  J q'' = b + gamma(q, q');     the next guess is q + q' + q'' / 2, with g for w and 0 for b

The pivots of J are guards, whose signs are tested at every sample: the product of the pivots is the determinant of J, whose sign
distinguishes the assembly modes. Pivots are chosen at sampled positions of the assembly mode in which the linkage starts.
"""

from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property

import numpy as np

from gauss_bench.compiler.elimination.formulations import keep_rows, list_guards, vector
from gauss_bench.compiler.elimination.function import Function, function
from gauss_bench.compiler.elimination.lu import Search, lu
from gauss_bench.compiler.elimination.partition import SINGULAR, Study, study
from gauss_bench.compiler.equations.constraints import rows_of
from gauss_bench.compiler.equations.links import Links, Parameters
from gauss_bench.compiler.errors import KernelError
from gauss_bench.compiler.expressions.node import ExpressionGraph, Node
from gauss_bench.kinematics.loop_equations import REGULAR
from gauss_bench.mechanism.coordinates import value
from gauss_bench.mechanism.equations import Row
from gauss_bench.mechanism.evaluate import Constraints
from gauss_bench.mechanism.model import Mechanism
from gauss_bench.mechanism.motion_laws import Motion, MotionLaw
from gauss_bench.terms import Array
from gauss_bench.trajectory import States


class ClosingProgram:
    """The functions that close one linkage at given inputs; the symbols are those of the module's docstring.

    Attributes:
        correction: function (q, u) -> Newton's correction z (n) of positions q.
        motion: function (q, u, w, b, g) of a closed position -> the guards, which must not change their signs; the step (n) from q
            to the guess at the next sample; and q, v, a (3n). g is the change of the inputs to the next sample.
    """

    def __init__(self, driven: Mechanism):
        """Generate the program of a linkage that has as many drivers (inputs) as degrees of freedom.

        Raises:
            KernelError: no usable pivots, or a start at a singular position.
        """
        # `study` samples positions. Without its driver a linkage of one degree of freedom is sampled over its whole motion, and not
        # only where the driver moves it in this scenario.
        analysis = study(replace(driven, drivers=()) if driven.dof == 1 else driven)
        correction, motion = _Equations(driven, analysis).solve()
        n, K = driven.n, len(driven.drivers)
        # None: every node has an instruction of its own
        self.correction: Function = function((("q", n), ("u", K)), correction, None)
        self.motion: Function = function((("q", n), ("u", K), ("w", K), ("b", K), ("g", K)), motion, None)
        self.driven = driven

    @property
    def inputs(self) -> int:
        """Number of inputs, the coordinates that drivers prescribe."""
        return len(self.driven.drivers)

    @property
    def guards(self) -> int:
        """Number of guards, the pivots of J that must keep their signs."""
        return len(self.motion.outputs[0])

    @cached_property
    def angles(self) -> list[int]:
        """Indices of the coordinates whose sines and cosines are needed."""
        return sorted(self.correction.angles(0) | self.motion.angles(0))

    @property
    def width(self) -> int:
        """Number of values that are stored at each sample: 3n, for q, v and a."""
        return len(self.motion.outputs[2])


class Driven(Links):
    """Positions and velocities of the links as expressions, with the values of drivers as inputs instead of functions of time.

    Attributes:
        levels: value, first and second time derivative of each driver; the name of a driver's law is its index here.
        rates: rates (n,) of all coordinates; with None they are inputs of the graph.
    """

    levels: Sequence[Motion]
    rates: Sequence[Node] | None = None

    def law(self, law: MotionLaw) -> Motion:
        """Return the given value, first and second time derivative of the driver with this law."""
        return self.levels[int(law.name)]

    def rate(self, k: int) -> Node:
        """Return the rate of coordinate k: rates[k] if `rates` is given, else an input of the graph."""
        return super().rate(k) if self.rates is None else self.rates[k]


class _Equations:
    """The constraint rows of a driven linkage as expressions, before elimination, with values at sampled positions.

    Attributes:
        kept, drop: indices of the rows that are eliminated (of joints, then of drivers), and the redundant rows left out.
        u, w, b, g: one node per input, for its value, first and second time derivative, and change to the next sample.
        rows: the kept rows for inputs with the values u and zero time derivatives.
    """

    def __init__(self, driven: Mechanism, analysis: Study):
        """Write the constraint rows of a driven linkage as expressions; `analysis` has the sampled positions and redundant rows."""
        # a law is named by the index of its driver, so that `Driven.law` finds the given values of the driver
        numbered = (replace(d, law=MotionLaw(str(k), d.law.motion)) for k, d in enumerate(driven.drivers))
        # index 0 in `drops` and `kept`: the best choice of redundant rows to leave out
        self.driven, self.drop = replace(driven, drivers=tuple(numbered)), analysis.drops[0]
        self.parameters = Parameters(driven, ())
        joints = Constraints(driven).joint_rows
        self.kept = (*(k for k in analysis.kept_rows(0) if k < joints), *range(joints, joints + len(driven.drivers)))
        q = self._in_same_assembly(analysis.states.q)
        u = np.array([value(d.coordinate, q) for d in driven.drivers])  # (inputs, samples)
        self.graph = graph = ExpressionGraph(len(q))
        self.states = States(np.zeros(len(q)), q, np.random.default_rng(0).normal(size=q.shape))
        self.u = tuple(graph.input("u", k, x, 1.0) for k, x in enumerate(u))
        # w, b and g (first and second time derivatives, and changes, of the inputs) get different arbitrary values near 1 at the
        # samples, so that no terms cancel by accident
        self.w, self.b, self.g = (
            tuple(graph.input(letter, k, 1.0 + 0.1 * np.sin(x + place), 1.0) for k, x in enumerate(u))
            for place, letter in enumerate("wbg", start=1)
        )
        self.zeros = (graph.constant(0.0),) * len(u)
        self.rows = self._rows(self.zeros, self.zeros)

    def _in_same_assembly(self, q: Array) -> Array:
        """Return the positions among q (k, n) that are not nearly singular and at which det J has the same sign as at the start.

        J is made square: each redundant row is left out, after it is added to kept rows with the factors in `drop.shares`. A
        position is nearly singular if its smallest singular value, relative to the largest, is far below the median over positions.

        Raises:
            KernelError: the start is at a singular position.
        """
        J = Constraints(self.driven)(0.0, np.concatenate([self.driven.q0[None], q]), np.zeros((1 + len(q), q.shape[1]))).J
        square = J[:, self.kept]
        for kept_row, dropped_row, factor in self.drop.shares:
            square[:, self.kept.index(kept_row)] += factor * J[:, dropped_row]
        # singular values (1 + k, n) and signs of det J (1 + k,); the first position is the start
        sizes, signs = np.linalg.svd(square, compute_uv=False), np.linalg.slogdet(square)[0]
        regular = sizes[:, -1] / sizes[:, 0]  # 0 at a singular position
        if regular[0] < REGULAR:
            raise KernelError(f"{self.driven.name}: the start is at a singular position")
        return np.asarray(q[(signs[1:] == signs[0]) & (regular[1:] > SINGULAR * np.median(regular))])

    def _rows(self, rates: Sequence[Node], seconds: Sequence[Node], v: Sequence[Node] | None = None) -> list[Row]:
        """Return the rows that are eliminated, for inputs with the values u and given first and second time derivatives.

        `v` are the rates (n,) of all coordinates; with None they are inputs of the graph.
        """
        links = Driven(self.graph, self.driven, self.parameters, self.states)
        links.levels, links.rates = list(zip(self.u, rates, seconds, strict=True)), v
        return keep_rows(self.graph, rows_of(links), self.kept, self.drop)

    def solve(self) -> tuple[list[list[Node]], list[list[Node]]]:
        """Return the results of `ClosingProgram.correction` and `ClosingProgram.motion`: [z], and [guards, step, (q, v, a)]."""
        graph, n = self.graph, self.driven.n
        jacobian = {(r, c): e for r, row in enumerate(self.rows) for c, e in row.entries.items()}
        factors = lu(graph, jacobian, range(n), range(n), Search(), normal_equations=True)

        def solve_rows(right: Sequence[Node]) -> list[Node]:
            """Return the solution (n) of J x = right."""
            return vector(graph, factors.solve({r: x for r, x in enumerate(right) if not x.is_zero}), n)

        def follow(rates: Sequence[Node], seconds: Sequence[Node]) -> tuple[list[Node], list[Node]]:
            """Return the first and second derivatives (n) of all coordinates; `rates`, `seconds` are those of the inputs."""
            v = solve_rows([-row.phi_t for row in self._rows(rates, seconds)])
            return v, solve_rows([row.gamma for row in self._rows(rates, seconds, v)])

        w, b, g = self.w, self.b, self.g  # of the inputs: first and second time derivatives, and changes to the next sample
        if len(w) == 1:  # d and e, from one pair of solutions, give the motion and the step to the next guess
            d, e = follow((graph.constant(1.0),), self.zeros)  # first and second derivatives of q (n,) with respect to the input
            advance = [g[0] * (x + g[0] * (y * 0.5)) for x, y in zip(d, e, strict=True)]
            square = w[0] * w[0]
            v, a = [x * w[0] for x in d], [x * b[0] + y * square for x, y in zip(d, e, strict=True)]
        else:
            # the step by Taylor's series, as if the inputs moved at the constant rates g for one unit of time
            advance = [x + y * 0.5 for x, y in zip(*follow(g, self.zeros), strict=True)]
            v, a = follow(w, b)
        z = solve_rows([-row.phi for row in self.rows if row.phi is not None])
        links = Links(graph, self.driven, self.parameters, self.states)
        q, guards = [links.coordinate(k) for k in range(n)], [x for x, _ in list_guards(factors)]
        return [z], [guards, advance, [*q, *v, *a]]
