"""Accelerations, corrections and multipliers of a linkage under two formulations, by the same elimination.

Gauss: J = [Jd Ju], where u are the n - m independent coordinates and d the others. One factorisation of Jd, which is m x m, gives

    a = a0 + N h,    a0 = (Jd^-1 gamma; 0),    N = (-Jd^-1 Ju; 1),    (N^T M N) h = N^T (Q - M a0)

Lagrange: the n + m equations

    [ M  J^T ] [   a    ]   [   Q   ]
    [ J   0  ] [ lambda ] = [ gamma ]

Newton's correction of a residual r is the shortest in metres and radians, as in the interpreted formulations. Under Gauss, first
the dependent coordinates alone are corrected, Jd x = -r; then the part of x along the free motions is subtracted,

    dx = x - N (N^T N)^-1 N^T x

Under Lagrange x is the solution of the same equations with the right-hand side (0, -r). This x is the shortest in the mass metric,
which moves light links more; without its part along N it is the same dx. The free motions N are the solutions for unit forces
along the independent coordinates, with right-hand sides (e_k, 0). If there are several, the same equations with unit masses cost
less and give dx directly; they also work where an independent coordinate is at rest for a moment.

The nearest velocities v' with J v' + phi_t = 0 follow from N without a residual. With vp any velocities that satisfy the rows, y
the speeds along N that reproduce the independent coordinates of v, and w = v - vp - N y the error of the other coordinates,

    v' = vp + N (y + (N^T N)^-1 N^T w)

Sources: Yuan and Ge (2016), eqs (1)-(9); Haug, Computer-Aided Kinematics and Dynamics of Mechanical Systems (1989), section 6.3.
"""

from collections.abc import Iterable, Sequence
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

Guard = tuple[Node, float]  # a pivot, and the size below which it must not be used

REACH = 12  # number of neighbours in a long sum among which a pair with a known sum is sought


@dataclass(frozen=True, eq=False)
class Terms:
    """The equations of motion as expressions.

    Attributes:
        mass: (n,) diagonal of M.
        rows: the constraint rows that are eliminated.
        Q: generalised force, index of a coordinate -> node.
        mixed: whether some of the rows are combinations of the file's rows, because others are redundant.
    """

    graph: ExpressionGraph
    mass: tuple[Node, ...]
    rows: Sequence[Row]
    Q: Right
    mixed: bool = False

    @property
    def jacobian(self) -> Matrix:
        """Entries of J, (row, coordinate) -> node."""
        return {(r, c): e for r, row in enumerate(self.rows) for c, e in row.entries.items()}

    @property
    def gamma(self) -> Right:
        """Right-hand side of J a = gamma, row -> node."""
        return {r: row.gamma for r, row in enumerate(self.rows) if not row.gamma.zero}

    @property
    def driven(self) -> Right:
        """Right-hand side -phi_t of J v = -phi_t, row -> node."""
        return {r: -row.phi_t for r, row in enumerate(self.rows) if not row.phi_t.zero}


@dataclass(frozen=True, eq=False)
class Motions:
    """A basis of the free motions.

    Attributes:
        N: the motions, each coordinate -> node; each moves exactly one independent coordinate.
        lengths: factors of N^T N.
    """

    graph: ExpressionGraph
    independent: tuple[int, ...]
    N: list[Right]
    lengths: Factors

    @classmethod
    def of(cls, terms: Terms, independent: tuple[int, ...], N: list[Right], search: Search) -> "Motions":
        """Build the basis, with N^T N factorised."""
        return cls(terms.graph, independent, N, _metric(terms.graph, N, [terms.graph.constant(1.0)] * len(terms.mass), search))

    def _shares(self, x: Right) -> Right:
        """Return (N^T N)^-1 N^T x, index of a free motion -> node."""
        products = [self.graph.total([N[j] * y for j, y in x.items() if j in N]) for N in self.N]
        return self.lengths.solve(_without_zeros(enumerate(products)))

    def across(self, change: Right) -> Right:
        """Return a change of coordinates without its part along the free motions."""
        shares = self._shares({j: -x for j, x in change.items()})
        moved = sorted(set().union(change, *self.N))
        parts = {j: [*_at(change, j), *_parts(self.N, shares, j)] for j in moved}
        return _without_zeros((j, self.graph.total(x)) for j, x in parts.items())

    def nearest(self, v: Sequence[Node], driven: Right) -> Right:
        """Return the velocities nearest to v (n,) that satisfy the rows; `driven` are any velocities vp that satisfy them."""
        graph, off = self.graph, {j: x - driven[j] if j in driven else x for j, x in enumerate(v)}  # off = v - vp
        speeds = {k: off[u] / N[u] for k, (u, N) in enumerate(zip(self.independent, self.N, strict=True))}  # y
        others = [j for j in off if j not in self.independent]
        # more = (N^T N)^-1 N^T w, with w = 0 in the independent coordinates
        more = self._shares({j: graph.total([off[j], *(-x for x in _parts(self.N, speeds, j))]) for j in others})
        nearest = {u: graph.total([v[u], *_parts(self.N, more, u)]) for u in self.independent}
        speeds = {k: y + more[k] if k in more else y for k, y in speeds.items()}
        nearest |= {j: graph.total([*_at(driven, j), *_parts(self.N, speeds, j)]) for j in others}
        return _without_zeros(sorted(nearest.items()))


class Gauss:
    """Elimination under Gauss's principle, with n - m unknowns.

    Attributes:
        factors: those of Jd.
        N: the free motions, one for each independent coordinate.
        reduced: factors of N^T M N.
        guards, correcting: guards of the acceleration, and further ones of corrections.
        directions: free motions, and further guards that they need.
    """

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
        """Return a, coordinate -> node, for a right-hand side of J a = gamma."""
        graph = self.terms.graph
        # a = a0 + N h with (N^T M N) h = N^T (Q - M a0), Yuan and Ge (2016), eqs (8)-(9)
        a0 = self.factors.solve(gamma)
        b = [graph.total(_work(self.terms, N, a0), pairs=REACH) for N in self.N]
        h = self.reduced.solve(_without_zeros(enumerate(b)))
        a = [graph.total([*_parts(self.N, h, j), *_at(a0, j)]) for j in range(len(self.terms.mass))]
        return _without_zeros(enumerate(a))

    def correction(self, residual: Right) -> Right:
        """Return the shortest change of the coordinates that cancels a residual, row -> node."""
        return self._motions.across(self.factors.solve({r: -x for r, x in residual.items()}))

    def velocity(self, v: Sequence[Node]) -> Right:
        """Return the nearest velocities to v (n,) that satisfy the rows."""
        return self._motions.nearest(v, self.factors.solve(self.terms.driven))

    def multipliers(self, gamma: Right) -> Right:
        """Return lambda, row -> node, for a right-hand side of J a = gamma."""
        a, terms = self.acceleration(gamma), self.terms
        # the dependent columns determine lambda: Jd^T lambda = (Q - M a)_d
        forces: Right = {}
        for c in range(len(terms.mass)):
            if c not in self.independent:
                inertial = [-(terms.mass[c] * a[c])] if c in a else []
                forces[c] = terms.graph.total([*_at(terms.Q, c), *inertial])
        transposed = {(c, r): e for (r, c), e in terms.jacobian.items() if c in forces}
        return lu(terms.graph, transposed, forces, range(len(terms.rows)), Search(), terms.mixed).solve(forces)


def _without_zeros(entries: Iterable[tuple[int, Node]]) -> Right:
    """Return a sparse vector with the entries (index, node) that are not zero."""
    return {j: x for j, x in entries if not x.zero}


def _at(x: Right, j: int) -> list[Node]:
    """Return entry j of a sparse vector as a list, which is empty if the entry is absent."""
    return [x[j]] if j in x else []


def _parts(motions: Sequence[Right], amounts: Right, j: int) -> list[Node]:
    """Return the summands of coordinate j in the sum of motions times their amounts."""
    return [N[j] * amounts[k] for k, N in enumerate(motions) if j in N and k in amounts]


def _metric(graph: ExpressionGraph, motions: Sequence[Right], weights: Sequence[Node], search: Search) -> Factors:
    """Factorise N^T W N, for motions N and a diagonal W of weights."""
    unknowns = range(len(motions))
    A: Matrix = {}
    for k in unknowns:
        for l in range(k + 1):
            products = {j: x * motions[l][j] for j, x in motions[k].items() if j in motions[l]}
            A[k, l] = A[l, k] = graph.total(_weigh(graph, weights, products), pairs=REACH)
    return lu(graph, A, unknowns, unknowns, Search(search.seed))


def _weigh(graph: ExpressionGraph, weights: Sequence[Node], products: Right) -> list[Node]:
    """Return the summands of sum_j weight_j product_j, after adding products of equal weight.

    So the parts of a sine and a cosine in x and y of a link on a ground pin become constant.
    """
    together: dict[int, list[Node]] = {}
    for j, x in sorted(products.items()):
        together.setdefault(weights[j].index, []).append(x)
    by_index = {w.index: w for w in weights}
    return [by_index[w] * graph.total(x, pairs=REACH) for w, x in together.items()]


def _work(terms: Terms, N: Right, a0: Right) -> list[Node]:
    """Return the summands of N^T (Q - M a0) for one motion N; a constant force such as gravity is combined with a0."""
    inertial, others = {}, []
    for j, x in N.items():
        mass, Q = terms.mass[j], terms.Q.get(j)
        if Q is not None and j in a0 and Q.number is not None and mass.number is not None:
            inertial[j] = x * (Q / mass - a0[j])
            continue
        if j in a0:
            inertial[j] = -(x * a0[j])
        if Q is not None:
            others.append(x * Q)
    return [*_weigh(terms.graph, terms.mass, inertial), *others]


class Lagrange:
    """Elimination of Lagrange's equations, with n + m unknowns; unknown n + r is the multiplier of row r.

    Attributes:
        factors: those of the equations with the mass matrix.
        single: whether corrections use one free motion, because there is only one and its coordinate moves at every sample.
        guards: guards of the acceleration.
    """

    def __init__(self, terms: Terms, independent: Sequence[int], search: Search, moving: bool):
        self.terms, self.n, self.independent, self.search = terms, len(terms.mass), tuple(independent), search
        self.factors = self._factors(terms.mass)
        self.single = moving and len(self.independent) <= 1
        self.guards = guarded(self.factors)

    def _factors(self, mass: Sequence[Node]) -> Factors:
        """Factorise [M J^T; J 0] with masses (n,)."""
        A: Matrix = {(i, i): x for i, x in enumerate(mass)}
        for (r, c), e in self.terms.jacobian.items():
            A[self.n + r, c] = A[c, self.n + r] = e
        size = self.n + len(self.terms.rows)
        return lu(self.terms.graph, A, range(size), range(size), self.search)

    def _solve(self, gamma: Right) -> Right:
        """Return accelerations and multipliers, unknown -> node."""
        return self.factors.solve(self.terms.Q | {self.n + r: x for r, x in gamma.items()})

    def acceleration(self, gamma: Right) -> Right:
        """Return a, coordinate -> node, for a right-hand side of J a = gamma."""
        return self._coordinates(self._solve(gamma))

    @cached_property
    def _units(self) -> Factors:
        """Factors of the equations with unit masses."""
        return self._factors([self.terms.graph.constant(1.0)] * self.n)

    @cached_property
    def _free_motions(self) -> list[Right]:
        """Free motions, each caused by a unit force along one independent coordinate."""
        one = self.terms.graph.constant(1.0)
        return [self._coordinates(self.factors.solve({k: one})) for k in self.independent]

    @cached_property
    def _mobility(self) -> Factors:
        """Factors of the matrix with the movement of each independent coordinate (row) in each free motion (column)."""
        unknowns, motions = range(len(self.independent)), self._free_motions
        A: Matrix = {}
        for k, N in enumerate(motions):
            A |= {(row, k): N[j] for row, j in enumerate(self.independent) if j in N}
        return lu(self.terms.graph, A, unknowns, unknowns, Search(self.search.seed))

    @cached_property
    def _motions(self) -> Motions:
        return Motions.of(self.terms, self.independent, self._free_motions, self.search)

    def _coordinates(self, unknowns: Right) -> Right:
        """Return the unknowns that belong to coordinates."""
        return {k: x for k, x in unknowns.items() if k < self.n}

    def correction(self, residual: Right) -> Right:
        """Return the shortest change of the coordinates that cancels a residual, row -> node."""
        right = {self.n + r: -x for r, x in residual.items()}
        if self.single:
            return self._motions.across(self._coordinates(self.factors.solve(right)))
        return self._coordinates(self._units.solve(right))

    def velocity(self, v: Sequence[Node]) -> Right:
        """Return the nearest velocities to v (n,) that satisfy the rows."""
        if self.single:
            driven = self.factors.solve({self.n + r: x for r, x in self.terms.driven.items()})
            return self._motions.nearest(v, self._coordinates(driven))
        rates = [self.terms.graph.total([*(e * v[c] for c, e in row.entries.items()), row.phi_t]) for row in self.terms.rows]
        change = self.correction(_without_zeros(enumerate(rates)))
        return {j: x + change[j] if j in change else x for j, x in enumerate(v)}

    @property
    def correcting(self) -> list[Guard]:
        """Guards of corrections, besides those of the acceleration."""
        return guarded(self._mobility if self.single else self._units)

    def multipliers(self, gamma: Right) -> Right:
        """Return lambda, row -> node, for a right-hand side of J a = gamma."""
        return {k - self.n: x for k, x in self._solve(gamma).items() if k >= self.n}

    @property
    def directions(self) -> tuple[list[Right], list[Guard]]:
        """Free motions that each move one independent coordinate, and further guards that they need."""
        graph, motions, factors = self.terms.graph, self._free_motions, self._mobility
        if len(motions) == 1:
            return motions, guarded(factors)
        alone = []
        # unit forces along independent coordinates move all of them: combine the motions so that each moves one
        for amounts in [factors.solve({k: graph.constant(1.0)}) for k in range(len(motions))]:
            sums = []
            for j in range(self.n):
                sums.append(graph.total([motions[k][j] * x for k, x in amounts.items() if j in motions[k]]))
            alone.append(_without_zeros(enumerate(sums)))
        return alone, guarded(factors)


def guarded(factors: Factors) -> list[Guard]:
    """Return the pivots that vary with the state, each once and without a constant factor, and their thresholds."""
    guards: dict[int, Guard] = {}
    for p in factors.guarded:
        if p.node.number is None:
            factor, base = factor_out(p.node)
            threshold = max(p.threshold / abs(factor), guards.get(base.index, (base, 0.0))[1])
            guards[base.index] = (base, threshold)
    return list(guards.values())


# Factor on the thresholds of pivots if every choice of rows to drop is singular somewhere: digits are lost long before pivots
# become small, and programs with other choices serve there.
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
        moving: whether the plan's independent coordinates are usable at every sample.
        rows: all constraint rows.
        kept: indices of the rows that are eliminated.
        drop: the choice of the other rows.
        mark: length of the graph's trail before elimination, by which an attempt is undone.
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
        """Return the residuals at the position to be corrected, index of a kept row -> node; a knife edge has none."""
        links = self.links
        there = replace(links.state, t="t_new", q="q_new", v="v_new")
        at_new = Links(links.graph, links.mechanism, links.parameters, there, exact=True)  # slides do not tie angles here
        moved = keep_rows(links.graph, rows_of(at_new), self.kept, self.drop)
        return {k: row.phi for k, row in enumerate(moved) if row.phi is not None and not row.phi.zero}

    def spread_out(self, multipliers: Right) -> Right:
        """Return the multipliers of all rows, given those of the kept rows, index of a kept row -> node.

        A dropped row that was added to kept rows has its factors times their multipliers.
        """
        of_rows = {self.kept[k]: x for k, x in multipliers.items()}
        for dropped in self.drop.rows:
            parts = [of_rows[k] * factor for k, row, factor in self.drop.shares if row == dropped and k in of_rows]
            if parts:
                of_rows[dropped] = self.terms.graph.total(parts)
        return of_rows

    def damped(self, alpha: float, beta: float) -> dict[int, Node]:
        """Return Baumgarte's right-hand side gamma - 2 alpha phi' - beta^2 phi, index of a kept row -> node."""
        sides: dict[int, Node] = {}
        for k, row in enumerate(self.terms.rows):
            side = row.gamma - rate_of(self.links, row) * (2 * alpha)
            sides[k] = side if row.phi is None else side - row.phi * beta**2
        return {k: x for k, x in sides.items() if not x.zero}

    def exact(self) -> tuple[list[Node], list[Node], Node]:
        """Return phi of holonomic rows, phi' of all rows, and the energy, all valid off the constraints too."""
        links = self.links  # but slides tie no angles below
        plain = Links(links.graph, links.mechanism, links.parameters, links.state, exact=True)
        rows = rows_of(plain)
        return [row.phi for row in rows if row.phi is not None], [rate_of(plain, row) for row in rows], energy(plain)


def keep_rows(graph: ExpressionGraph, rows: Sequence[Row], kept: tuple[int, ...], drop: Drop) -> list[Row]:
    """Return the rows to eliminate: the kept ones, with the dropped rows that are added to them."""
    eliminated = []
    for k in kept:
        added = [(rows[r], factor) for at, r, factor in drop.shares if at == k]
        eliminated.append(combine(graph, [(rows[k], 1.0), *added]) if added else rows[k])
    return eliminated


def workspace(study: Study, open_names: tuple[str, ...], plan: Plan) -> Workspace:
    """Build the workspace of a mechanism for a plan.

    Raises:
        KernelError: the plan's independent coordinates are usable at no sample, or the mechanism has no number of a name.
    """
    mechanism, kept = study.mechanism, study.kept(plan.drop)
    asked, lines = open_parameters(mechanism, open_names), line_names(mechanism)
    at_start = dict(zip(lines, line_values(mechanism, 0.0).tolist(), strict=True))
    parameters = Parameters((*asked.names, *lines), asked.all | at_start)
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
    """Return all components (size,) of a sparse vector."""
    zero = graph.constant(0.0)
    return [values.get(k, zero) for k in range(size)]
