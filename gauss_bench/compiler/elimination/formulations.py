"""Accelerations, corrections and multipliers of a linkage by one eliminator under two formulations.

Gauss: J = [Jd Ju] with the independent coordinates u, n - m of them. One factorisation of Jd, which is m x m, gives

    a = a0 + N h,    a0 = (Jd^-1 gamma; 0),    N = (-Jd^-1 Ju; 1),    (N^T M N) h = N^T (Q - M a0)


Lagrange: the n + m equations

    [ M  J^T ] [   a    ]   [   Q   ]
    [ J   0  ] [ lambda ] = [ gamma ]

Newton's correction of a residual r is the shortest in metres and radians, as in the interpreted formulations. Under Gauss, first
the dependent coordinates alone are corrected, Jd x = -r; then the part of x along the free motions is subtracted,

    dx = x - N (N^T N)^-1 N^T x

Under Lagrange x is the solution of the same KKT system for the right-hand side (0, -r). It is the shortest in the mass metric,
which moves light links more; without its part along N it is the same dx. The free motions N are the solutions for unit forces
along the independent coordinates, right-hand sides (e_k, 0). For several of them a KKT system with unit masses costs less; it
also works where an independent coordinate is at rest for a moment.

Given N, the nearest velocities with J v + phi_t = 0 need no residual. With vp any velocities that satisfy the rows, y the speeds
along N that reproduce the independent coordinates of v, and w = v - vp - N y the error of the other coordinates,

    v' = vp + N (y + (N^T N)^-1 N^T w)
Source: Yuan and Ge (2016), eqs (1)-(9); Haug, Computer-Aided Kinematics and Dynamics of Mechanical Systems (1989), section 6.3.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

from gauss_bench.compiler.elimination.lu import Factors, Matrix, Right, Search, lu
from gauss_bench.compiler.elimination.partition import ENOUGH, USABLE, Drop, Study, conditions
from gauss_bench.compiler.equations.constraints import combine, rate_of, rows_of
from gauss_bench.compiler.equations.forces import energy, generalised_force
from gauss_bench.compiler.equations.links import Links, Parameters, State, open_parameters
from gauss_bench.compiler.errors import KernelError
from gauss_bench.compiler.expressions.node import ExpressionGraph, Node, factor_out
from gauss_bench.mechanism.equations import Row
from gauss_bench.mechanism.lines import line_names, line_values
from gauss_bench.mechanism.model import Mechanism

Guard = tuple[Node, float]  # a pivot, and the size below which it is not to be used

REACH = 12  # in a long sum, a pair whose sum is already known is looked for among so many neighbours


@dataclass(frozen=True, eq=False)
class Terms:
    """The equations of motion in expressions: M by coordinate, kept rows of J, Q by coordinate.

    Attributes:
        mixed: whether some rows are combinations of the file's rows, because others are redundant.
    """

    graph: ExpressionGraph
    mass: tuple[Node, ...]
    rows: Sequence[Row]
    Q: Right
    mixed: bool = False

    @property
    def jacobian(self) -> Matrix:
        return {(r, c): e for r, row in enumerate(self.rows) for c, e in row.entries.items()}

    @property
    def gamma(self) -> Right:
        return {r: row.gamma for r, row in enumerate(self.rows) if not row.gamma.zero}

    @property
    def driven(self) -> Right:
        """Return J v of velocities that satisfy the rows, -phi_t."""
        return {r: -row.phi_t for r, row in enumerate(self.rows) if not row.phi_t.zero}


@dataclass(frozen=True, eq=False)
class Motions:
    """A basis N of the free motions; along each of them exactly one independent coordinate moves.

    Attributes:
        lengths: factors of N^T N.
    """

    graph: ExpressionGraph
    independent: tuple[int, ...]
    N: list[Right]
    lengths: Factors

    @classmethod
    def of(cls, terms: Terms, independent: tuple[int, ...], N: list[Right], search: Search) -> "Motions":
        return cls(terms.graph, independent, N, _metric(terms.graph, N, [terms.graph.constant(1.0)] * len(terms.mass), search))

    def _shares(self, x: Right) -> Right:
        """Return (N^T N)^-1 N^T x, free motion -> its share."""
        products = [self.graph.total([N[j] * y for j, y in x.items() if j in N]) for N in self.N]
        return self.lengths.solve({k: y for k, y in enumerate(products) if not y.zero})

    def across(self, change: Right) -> Right:
        """Subtract from a change of coordinates its part along the motions."""
        shares = self._shares({j: -x for j, x in change.items()})
        parts = {j: [*_at(change, j), *_parts(self.N, shares, j)] for j in sorted({j for x in (change, *self.N) for j in x})}
        sums = {j: self.graph.total(x) for j, x in parts.items() if x}
        return {j: x for j, x in sums.items() if not x.zero}

    def nearest(self, v: Sequence[Node], driven: Right) -> Right:
        """Return the velocities nearest to v that satisfy the rows; `driven` are any velocities that do."""
        graph, off = self.graph, {j: x - driven[j] if j in driven else x for j, x in enumerate(v)}
        speeds = {k: off[u] / N[u] for k, (u, N) in enumerate(zip(self.independent, self.N, strict=True))}
        others = [j for j in off if j not in self.independent]
        more = self._shares({j: graph.total([off[j], *(-x for x in _parts(self.N, speeds, j))]) for j in others})
        nearest = {u: graph.total([v[u], *_parts(self.N, more, u)]) for u in self.independent}
        speeds = {k: y + more[k] if k in more else y for k, y in speeds.items()}
        nearest |= {j: graph.total([*_at(driven, j), *_parts(self.N, speeds, j)]) for j in others}
        return {j: x for j, x in sorted(nearest.items()) if not x.zero}


class Gauss:
    """Elimination under Gauss's principle, n - m unknowns."""

    def __init__(self, terms: Terms, independent: Sequence[int], search: Search):
        self.terms, self.independent = terms, tuple(independent)
        J, n = terms.jacobian, len(terms.mass)
        dependent = [c for c in range(n) if c not in self.independent]
        self.factors = lu(terms.graph, J, range(len(terms.rows)), dependent, search, terms.mixed)
        one = terms.graph.constant(1.0)
        self.N = [self.factors.solve({r: -e for (r, c), e in J.items() if c == k}) | {k: one} for k in self.independent]
        self.search = search
        self.reduced = _metric(terms.graph, self.N, terms.mass, search)
        self.guards, self.correcting = guarded(self.factors), list[Guard]()
        self.directions = self.N, list[Guard]()

    @cached_property
    def _motions(self) -> Motions:
        return Motions.of(self.terms, self.independent, self.N, self.search)

    def acceleration(self, gamma: Right) -> Right:
        graph = self.terms.graph
        # a = a0 + N h with (N^T M N) h = N^T (Q - M a0), Yuan and Ge (2016), eqs (8)-(9)
        a0 = self.factors.solve(gamma)
        b = {k: graph.total(_work(self.terms, N, a0), pairs=REACH) for k, N in enumerate(self.N)}
        h = self.reduced.solve({k: x for k, x in b.items() if not x.zero})
        a = {j: graph.total([*_parts(self.N, h, j), *_at(a0, j)]) for j in range(len(self.terms.mass))}
        return {j: x for j, x in a.items() if not x.zero}

    def correction(self, residual: Right) -> Right:
        return self._motions.across(self.factors.solve({r: -x for r, x in residual.items()}))

    def velocity(self, v: Sequence[Node]) -> Right:
        return self._motions.nearest(v, self.factors.solve(self.terms.driven))

    def multipliers(self, gamma: Right) -> Right:
        a, terms = self.acceleration(gamma), self.terms
        # the dependent columns determine lambda: Jd^T lambda = (Q - M a)_d
        forces: Right = {}
        for c in (c for c in range(len(terms.mass)) if c not in self.independent):
            parts = [terms.Q[c]] if c in terms.Q else []
            if c in a:
                parts.append(-(terms.mass[c] * a[c]))
            forces[c] = terms.graph.total(parts)
        transposed = {(c, r): e for (r, c), e in terms.jacobian.items() if c in forces}
        return lu(terms.graph, transposed, forces, range(len(terms.rows)), Search(), terms.mixed).solve(forces)


def _at(x: Right, j: int) -> list[Node]:
    """One entry of a sparse vector, if it is there."""
    return [x[j]] if j in x else []


def _parts(motions: Sequence[Right], amounts: Right, j: int) -> list[Node]:
    """Return the summands of coordinate j in a combination of motions."""
    return [N[j] * amounts[k] for k, N in enumerate(motions) if j in N and k in amounts]


def _metric(graph: ExpressionGraph, motions: Sequence[Right], weights: Sequence[Node], search: Search) -> Factors:
    """Factorise N^T W N with a diagonal W."""
    unknowns = range(len(motions))
    A: Matrix = {}
    for k in unknowns:
        for l in range(k + 1):
            products = {j: x * motions[l][j] for j, x in motions[k].items() if j in motions[l]}
            A[k, l] = A[l, k] = graph.total(_weigh(graph, weights, products), pairs=REACH)
    return lu(graph, A, unknowns, unknowns, Search(search.seed))


def _weigh(graph: ExpressionGraph, weights: Sequence[Node], products: Right) -> list[Node]:
    """Return the summands of a weighted sum, those of equal weight added first: x and y of a link on a ground pin cancel."""
    together: dict[int, list[Node]] = {}
    for j, x in sorted(products.items()):
        together.setdefault(weights[j].index, []).append(x)
    by_index = {w.index: w for w in weights}
    return [by_index[w] * graph.total(x, pairs=REACH) for w, x in together.items()]


def _work(terms: Terms, N: Right, a0: Right) -> list[Node]:
    """Return the summands of N^T (Q - M a0); a constant force such as gravity is combined with a0."""
    inertial, others = {}, []
    for j, x in N.items():
        mass, Q = terms.mass[j], terms.Q.get(j)
        constant = Q is not None and Q.number is not None and mass.number is not None
        if Q is not None and constant and j in a0:
            inertial[j] = x * (Q / mass - a0[j])
        elif j in a0:
            inertial[j] = -(x * a0[j])
        if Q is not None and not (constant and j in a0):
            others.append(x * Q)
    return [*_weigh(terms.graph, terms.mass, inertial), *others]


class Lagrange:
    """n + m unknowns; unknown n + r is the multiplier of row r.

    `moving`: whether the independent coordinates move at every sample in every motion that the rows allow.
    """

    def __init__(self, terms: Terms, independent: Sequence[int], search: Search, moving: bool):
        self.terms, self.n, self.independent, self.search = terms, len(terms.mass), tuple(independent), search
        self.factors = self._factors(terms.mass)
        self.single = moving and len(self.independent) <= 1
        self.guards = guarded(self.factors)

    def _factors(self, mass: Sequence[Node]) -> Factors:
        # KKT matrix [M J^T; J 0], symmetric
        A: Matrix = {(i, i): x for i, x in enumerate(mass)}
        for (r, c), e in self.terms.jacobian.items():
            A[self.n + r, c] = A[c, self.n + r] = e
        size = self.n + len(self.terms.rows)
        return lu(self.terms.graph, A, range(size), range(size), self.search)

    def _solve(self, gamma: Right) -> Right:
        return self.factors.solve(self.terms.Q | {self.n + r: x for r, x in gamma.items()})

    def acceleration(self, gamma: Right) -> Right:
        return self._coordinates(self._solve(gamma))

    @cached_property
    def _units(self) -> Factors:
        """As `factors`, with unit masses."""
        return self._factors([self.terms.graph.constant(1.0)] * self.n)

    @cached_property
    def _free_motions(self) -> list[Right]:
        """Free motions, each caused by a unit force along one independent coordinate."""
        one = self.terms.graph.constant(1.0)
        return [self._coordinates(self.factors.solve({k: one})) for k in self.independent]

    @cached_property
    def _mobility(self) -> Factors:
        """Return how far each of these motions moves the independent coordinates."""
        unknowns, motions = range(len(self.independent)), self._free_motions
        A = {(row, k): N[j] for k, N in enumerate(motions) for row, j in enumerate(self.independent) if j in N}
        return lu(self.terms.graph, A, unknowns, unknowns, Search(self.search.seed))

    @cached_property
    def _motions(self) -> Motions:
        return Motions.of(self.terms, self.independent, self._free_motions, self.search)

    def _coordinates(self, unknowns: Right) -> Right:
        return {k: x for k, x in unknowns.items() if k < self.n}

    def correction(self, residual: Right) -> Right:
        """Return the smallest change of the coordinates that cancels a residual of the constraints (row -> node)."""
        right = {self.n + r: -x for r, x in residual.items()}
        if self.single:
            return self._motions.across(self._coordinates(self.factors.solve(right)))
        return self._coordinates(self._units.solve(right))

    def velocity(self, v: Sequence[Node]) -> Right:
        if self.single:
            driven = self.factors.solve({self.n + r: x for r, x in self.terms.driven.items()})
            return self._motions.nearest(v, self._coordinates(driven))
        graph, rows = self.terms.graph, enumerate(self.terms.rows)
        rates = {r: graph.total([*(e * v[c] for c, e in row.entries.items()), row.phi_t]) for r, row in rows}
        change = self.correction({r: x for r, x in rates.items() if not x.zero})
        return {j: x + change[j] if j in change else x for j, x in enumerate(v)}

    @property
    def correcting(self) -> list[Guard]:
        return guarded(self._mobility if self.single else self._units)

    def multipliers(self, gamma: Right) -> Right:
        return {k - self.n: x for k, x in self._solve(gamma).items() if k >= self.n}

    @property
    def directions(self) -> tuple[list[Right], list[Guard]]:
        graph, unknowns, motions, factors = self.terms.graph, range(len(self.independent)), self._free_motions, self._mobility
        if len(motions) == 1:
            return motions, guarded(factors)
        forces = [factors.solve({k: graph.constant(1.0)}) for k in unknowns]
        sums = [
            [(j, graph.total([motions[k][j] * x for k, x in f.items() if j in motions[k]])) for j in range(self.n)] for f in forces
        ]
        return [{j: x for j, x in motion if not x.zero} for motion in sums], guarded(factors)


def guarded(factors: Factors) -> list[Guard]:
    """Return the pivots that vary with the state, without constant factors and duplicates, and their thresholds."""
    guards: dict[int, Guard] = {}
    for p in factors.guarded:
        if p.node.number is None:
            factor, base = factor_out(p.node)
            threshold = max(p.threshold / abs(factor), guards.get(base.index, (base, 0.0))[1])
            guards[base.index] = (base, threshold)
    return list(guards.values())


# factor on thresholds where any choice of rows to drop is singular somewhere: digits go long before its pivots do; others serve
STEADY = 100.0
FORMULATIONS = ("auto", "gauss", "lagrange")


def refuse(mechanism: Mechanism, formulation: str) -> None:
    """Refuse a linkage for which no program can be generated.

    Raises:
        KernelError: an unknown formulation, or dry friction.
    """
    if formulation not in FORMULATIONS:
        raise KernelError(f"no formulation {formulation}; there are {', '.join(FORMULATIONS)}")
    if mechanism.has_friction:
        raise KernelError(f"{mechanism.name}: no kernel for dry friction, whose force follows from the accelerations it causes")


@dataclass(frozen=True)
class Plan:
    """A formulation, its independent coordinates, and the index of the choice of redundant rows to drop."""

    formulation: str
    independent: tuple[int, ...]
    drop: int = 0


@dataclass(frozen=True, eq=False)
class Workspace:
    """The equations of motion of one mechanism before elimination, at the samples where a plan is usable.

    Attributes:
        caution: factor on the thresholds of pivots.
        moving: whether the plan's independent coordinates serve at every sample.
        rows: all constraint rows; kept: indices of those that are eliminated; drop: the choice of the others.
        mark: length of the graph's trail before elimination, to undo an attempt.
    """

    plan: Plan
    caution: float
    moving: bool
    links: Links
    rows: list[Row]
    terms: Terms
    kept: tuple[int, ...]
    drop: Drop
    mark: int

    def algebra(self, search: Search) -> "Gauss | Lagrange":
        """Start a new elimination; the nodes of an earlier attempt are removed from the graph."""
        self.terms.graph.forget(self.mark)
        if self.plan.formulation == "gauss":
            return Gauss(self.terms, self.plan.independent, search)
        return Lagrange(self.terms, self.plan.independent, search, self.moving)

    def residuals(self) -> dict[int, Node]:
        """Return phi by kept row at the position to be corrected; a knife edge has no residual of position."""
        links = self.links
        there = replace(links.state, t="t_new", q="q_new", v="v_new")
        at_new = Links(links.graph, links.mechanism, links.parameters, there, exact=True)  # slides do not tie angles here
        moved = keep_rows(links.graph, rows_of(at_new), self.kept, self.drop)
        return {k: row.phi for k, row in enumerate(moved) if row.phi is not None and not row.phi.zero}

    def spread_out(self, multipliers: Right) -> Right:
        """Return the multipliers of all rows; a dropped row gets its share of the kept rows that it was combined into."""
        of_rows = {self.kept[k]: x for k, x in multipliers.items()}
        for dropped in self.drop.rows:
            parts = [of_rows[k] * factor for k, row, factor in self.drop.shares if row == dropped and k in of_rows]
            if parts:
                of_rows[dropped] = self.terms.graph.total(parts)
        return of_rows

    def damped(self, alpha: float, beta: float) -> dict[int, Node]:
        """Return Baumgarte's right-hand side by kept row, gamma - 2 alpha phi' - beta^2 phi."""
        sides: dict[int, Node] = {}
        for k, row in enumerate(self.terms.rows):
            side = row.gamma - rate_of(self.links, row) * (2 * alpha)
            sides[k] = side if row.phi is None else side - row.phi * beta**2
        return {k: x for k, x in sides.items() if not x.zero}

    def exact(self) -> tuple[list[Node], list[Node], Node]:
        """Return phi of holonomic rows, phi' of all rows, and energy, valid off the constraints: slides do not tie angles here."""
        links = self.links
        plain = Links(links.graph, links.mechanism, links.parameters, links.state, exact=True)
        rows = rows_of(plain)
        return [row.phi for row in rows if row.phi is not None], [rate_of(plain, row) for row in rows], energy(plain)


def keep_rows(graph: ExpressionGraph, rows: Sequence[Row], kept: tuple[int, ...], drop: Drop) -> list[Row]:
    """Return the rows to eliminate, with the dropped rows that are combined into them."""
    taken = [[(rows[r], factor) for at, r, factor in drop.shares if at == k] for k in kept]
    return [combine(graph, [(rows[k], 1.0), *more]) if more else rows[k] for k, more in zip(kept, taken, strict=True)]


def workspace(study: Study, open_names: tuple[str, ...], plan: Plan) -> Workspace:
    """Build the workspace of a mechanism for a plan.

    Raises:
        KernelError: the plan's partition is singular at every sample, or a name the mechanism does not have.
    """
    mechanism, kept = study.mechanism, study.kept(plan.drop)
    asked, lines = open_parameters(mechanism, open_names), line_names(mechanism)
    parameters = Parameters((*asked.names, *lines), asked.all | dict(zip(lines, line_values(mechanism, 0.0).tolist(), strict=True)))
    usable = study.soundness(plan.drop) > USABLE
    if plan.formulation == "gauss":
        usable &= conditions(study, plan.independent) > USABLE
    states = study.states[usable]
    if not len(states):
        raise KernelError(f"{mechanism.name}: coordinates {plan.independent} do not determine the velocities anywhere")
    graph = ExpressionGraph(len(states))
    here = State("t", "q", "v", states.t, states.q, states.v)
    links = Links(graph, mechanism, parameters, here)
    rows = rows_of(links)
    mass = [links.number(f"links.{link.name}.{key}") for link in mechanism.links for key in ("mass", "mass", "inertia")]
    drop = study.drops[plan.drop]
    terms = Terms(graph, tuple(mass), keep_rows(graph, rows, kept, drop), generalised_force(links), bool(drop.shares))
    steady = bool((study.soundness(plan.drop) >= ENOUGH).all())
    moving = bool((conditions(study, plan.independent) >= ENOUGH).all())
    return Workspace(plan, 1.0 if steady else STEADY, moving, links, rows, terms, kept, drop, len(graph.trail))


def vector(graph: ExpressionGraph, values: dict[int, Node], size: int) -> list[Node]:
    """All components of a sparse vector."""
    zero = graph.constant(0.0)
    return [values.get(k, zero) for k in range(size)]
