"""Accelerations, corrections and multipliers of a linkage in two formulations, by the same elimination.

J (m, n) is the Jacobian of the constraint rows, gamma the right-hand side of J a = gamma, M the mass matrix, Q the force.

In Gauss's formulation J = [Jd Ju]: Ju are the columns of the n - m independent coordinates, Jd those of the others. One
factorisation of the m x m matrix Jd gives the accelerations

    a = a0 + N h,    a0 = (Jd^-1 gamma; 0),    N = (-Jd^-1 Ju; 1),    (N^T M N) h = N^T (Q - M a0)

In Lagrange's formulation the accelerations and the multipliers lambda are the solution of the n + m equations

    [ M  J^T ] [   a    ]   [   Q   ]
    [ J   0  ] [ lambda ] = [ gamma ]

The columns of N are the free motions: a basis of the velocities v with J v = 0.

Newton's correction dx for a residual r is the solution of J dx = -r with the least norm, in which a metre counts as much as a
radian. In Gauss's formulation, first the dependent coordinates alone are corrected, Jd x = -r. Then the component of x along the
free motions is subtracted:

    dx = x - N (N^T N)^-1 N^T x

In Lagrange's formulation, x is the solution of Lagrange's equations above with the right-hand side (0, -r). This solution has the
least norm in the mass metric, in which light links move more. If the component of x along the free motions is subtracted by the
same formula, the result is the same dx. The free motions are solutions of Lagrange's equations too, each for a unit force along one
independent coordinate, with the right-hand side (e_k, 0). With several free motions it costs less to solve Lagrange's equations
with unit masses instead, which give dx directly. The equations with unit masses can also be solved where the velocity of an
independent coordinate is zero.

The velocities v' that satisfy J v' + phi_t = 0 and are nearest to v are computed from N. Let vp be any velocities that satisfy this
equation, y the speeds along the free motions for which vp + N y equals v in the independent coordinates, and w = v - vp - N y the
error in the other coordinates. Then

    v' = vp + N (y + (N^T N)^-1 N^T w)

Sources: Yuan and Ge (2016), eqs (1)-(9); Haug, Computer-Aided Kinematics and Dynamics of Mechanical Systems (1989), section 6.3.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property

from gauss_bench.compiler.elimination.lu import Factors, Matrix, Search, Sparse, lu
from gauss_bench.compiler.elimination.partition import ENOUGH, USABLE, Drop, Study, conditions
from gauss_bench.compiler.equations.constraints import combine, rate_of, rows_of
from gauss_bench.compiler.equations.forces import energy, generalised_force
from gauss_bench.compiler.equations.links import Links, Parameters
from gauss_bench.compiler.errors import KernelError
from gauss_bench.compiler.expressions.node import ExpressionGraph, Node, factor_out
from gauss_bench.mechanism.equations import Row
from gauss_bench.mechanism.lines import line_names, line_values

Guard = tuple[Node, float]  # a pivot and its threshold: the program must not be used where |pivot| < threshold

REACH = 12  # largest distance between two terms of a long sum whose own sum is tried as one node (`ExpressionGraph.total`)


@dataclass(frozen=True, eq=False)
class Terms:
    """The equations of motion as expressions, the terms M, J, Q and gamma of the module's docstring.

    Attributes:
        mass: (n,) diagonal of M; Q: generalised force, index of a coordinate -> node.
        mixed: whether some of the rows are sums of several constraint rows, because redundant rows were added to them and left out.
    """

    graph: ExpressionGraph
    mass: tuple[Node, ...]
    rows: Sequence[Row]
    Q: Sparse
    mixed: bool = False

    @property
    def jacobian(self) -> Matrix:
        """Entries of J, as a dict from (row, coordinate) to a node."""
        return {(r, c): e for r, row in enumerate(self.rows) for c, e in row.entries.items()}

    @property
    def gamma(self) -> Sparse:
        """Right-hand side of J a = gamma, as a dict from the row to a node; zeros are left out."""
        return {r: row.gamma for r, row in enumerate(self.rows) if not row.gamma.is_zero}

    @property
    def driven(self) -> Sparse:
        """Right-hand side -phi_t of J v = -phi_t, as a dict from the row to a node; zeros are left out."""
        return {r: -row.phi_t for r, row in enumerate(self.rows) if not row.phi_t.is_zero}


class Motions:
    """A basis N of the free motions, which are the velocities v with J v = 0.

    Attributes:
        N: the columns of the basis, each as a dict coordinate -> node; column k moves the independent coordinate independent[k],
            and no other independent coordinate.
        metric: the factorisation of N^T N.
    """

    def __init__(self, terms: Terms, independent: tuple[int, ...], N: list[Sparse], search: Search):
        """Set up the basis with the columns N, and factorise N^T N."""
        self.graph, self.independent, self.N = terms.graph, independent, N
        self.metric = _factorise_metric(terms.graph, N, [terms.graph.constant(1.0)] * len(terms.mass), search)

    def _components(self, x: Sparse) -> Sparse:
        """Return (N^T N)^-1 N^T x, the components of x along the columns of N, as a dict from the index of a column to a node."""
        products = [self.graph.total([N[j] * y for j, y in x.items() if j in N]) for N in self.N]
        return self.metric.solve(_without_zeros(enumerate(products)))

    def remove_free_part(self, x: Sparse) -> Sparse:
        """Return x - N (N^T N)^-1 N^T x: an increment x of the coordinates without its part along the free motions."""
        amounts = self._components({j: -e for j, e in x.items()})  # -(N^T N)^-1 N^T x, so that the result is x + N amounts
        changed = sorted(set().union(x, *self.N))  # coordinates whose entry is not zero in x or in a free motion
        summands = {j: [*_entry(x, j), *_summands(self.N, amounts, j)] for j in changed}
        return _without_zeros((j, self.graph.total(terms)) for j, terms in summands.items())

    def nearest(self, v: Sequence[Node], driven: Sparse) -> Sparse:
        """Return the velocities nearest to v (n,) that satisfy the constraint rows: v' = vp + N (y + (N^T N)^-1 N^T w).

        vp, y and w are defined in the module's docstring; `driven` is vp, which satisfies the rows with the drivers' rates.
        """
        graph, difference = self.graph, {j: x - driven[j] if j in driven else x for j, x in enumerate(v)}  # v - vp
        # y: motion k alone moves independent coordinate u, so that vp + N y equals v in it
        speeds = {k: difference[u] / N[u] for k, (u, N) in enumerate(zip(self.independent, self.N, strict=True))}
        others = [j for j in difference if j not in self.independent]
        # w = v - vp - N y, which vanishes in the independent coordinates
        w = {j: graph.total([difference[j], *(-x for x in _summands(self.N, speeds, j))]) for j in others}
        correction = self._components(w)  # (N^T N)^-1 N^T w
        # in an independent coordinate vp + N y equals v[u], so that only the correction is added to v[u]
        nearest = {u: graph.total([v[u], *_summands(self.N, correction, u)]) for u in self.independent}
        speeds = {k: y + correction[k] if k in correction else y for k, y in speeds.items()}
        nearest |= {j: graph.total([*_entry(driven, j), *_summands(self.N, speeds, j)]) for j in others}
        return _without_zeros(sorted(nearest.items()))


class Gauss:
    """Elimination of the equations of Gauss's principle, with n - m unknowns.

    Attributes:
        factors, reduced_mass: the factorisations of Jd, the columns of J for the dependent coordinates, and of N^T M N.
        N: the free motions (velocities v with J v = 0), one for each independent coordinate, each a dict coordinate -> node.
        guards: pivots that must not be small where the acceleration is evaluated, with their thresholds.
        correcting: further guards of corrections, an empty list.
        directions: the free motions, and their further guards, an empty list.
    """

    def __init__(self, terms: Terms, independent: Sequence[int], search: Search):
        """Factorise Jd (columns of J of the dependent coordinates) and N^T M N; `search` are the settings for choosing pivots."""
        self.terms, self.independent = terms, tuple(independent)
        J, n = terms.jacobian, len(terms.mass)
        dependent = [c for c in range(n) if c not in self.independent]
        # sums of rows may have no pivot of constant sign; normal equations may then be used for the rest (see `lu`)
        self.factors = lu(terms.graph, J, range(len(terms.rows)), dependent, search, normal_equations=terms.mixed)
        one = terms.graph.constant(1.0)
        # column k of N: independent coordinate k moves with speed 1, and the dependent ones as J N = 0 demands
        self.N = [self.factors.solve({r: -e for (r, c), e in J.items() if c == k}) | {k: one} for k in self.independent]
        self.search = search
        self.reduced_mass = _factorise_metric(terms.graph, self.N, terms.mass, search)
        # N^T M N and N^T N are positive definite: only the pivots of Jd need guards
        self.guards, self.correcting = list_guards(self.factors), list[Guard]()
        self.directions = self.N, list[Guard]()

    @cached_property
    def _motions(self) -> Motions:
        """The basis N of the free motions (J N = 0), with N^T N factorised."""
        return Motions(self.terms, self.independent, self.N, self.search)

    def acceleration(self, gamma: Sparse) -> Sparse:
        """Return the accelerations for a given right-hand side gamma of J a = gamma, as a dict coordinate -> node without zeros."""
        graph = self.terms.graph
        # a = a0 + N h with (N^T M N) h = N^T (Q - M a0), Yuan and Ge (2016), eqs (8)-(9); b is the right-hand side
        a0 = self.factors.solve(gamma)
        b = [graph.total(_reduced_force(self.terms, N, a0), distance=REACH) for N in self.N]
        h = self.reduced_mass.solve(_without_zeros(enumerate(b)))
        a = [graph.total([*_summands(self.N, h, j), *_entry(a0, j)]) for j in range(len(self.terms.mass))]
        return _without_zeros(enumerate(a))

    def correction(self, residual: Sparse) -> Sparse:
        """Return the coordinate change with the least norm that cancels a residual (a dict row -> node of the graph)."""
        return self._motions.remove_free_part(self.factors.solve({r: -x for r, x in residual.items()}))

    def velocity(self, v: Sequence[Node]) -> Sparse:
        """Return the velocities nearest to v (n,) that satisfy the constraint rows."""
        return self._motions.nearest(v, self.factors.solve(self.terms.driven))

    def multipliers(self, gamma: Sparse) -> Sparse:
        """Return the multipliers of the constraint rows in `terms`, as a dict row -> node, for a given right-hand side gamma."""
        a, terms = self.acceleration(gamma), self.terms
        # the equations of the dependent coordinates determine lambda, because Jd is regular: Jd^T lambda = (Q - M a)_d
        forces: Sparse = {}
        for c in range(len(terms.mass)):
            if c not in self.independent:
                inertial = [-(terms.mass[c] * a[c])] if c in a else []
                forces[c] = terms.graph.total([*_entry(terms.Q, c), *inertial])
        transposed = {(c, r): e for (r, c), e in terms.jacobian.items() if c in forces}
        return lu(terms.graph, transposed, forces, range(len(terms.rows)), Search(), normal_equations=terms.mixed).solve(forces)


def _without_zeros(entries: Iterable[tuple[int, Node]]) -> Sparse:
    """Return a sparse vector with the entries (index, node) that are not zero."""
    return {j: x for j, x in entries if not x.is_zero}


def _entry(x: Sparse, j: int) -> list[Node]:
    """Return a list with entry j of a sparse vector, or an empty list if the entry is zero."""
    return [x[j]] if j in x else []


def _summands(motions: Sequence[Sparse], amounts: Sparse, j: int) -> list[Node]:
    """Return the summands of entry j of N amounts, where column k of N is motions[k]; summands that are zero are left out."""
    return [N[j] * amounts[k] for k, N in enumerate(motions) if j in N and k in amounts]


def _factorise_metric(graph: ExpressionGraph, motions: Sequence[Sparse], weights: Sequence[Node], search: Search) -> Factors:
    """Factorise N^T W N, where the columns of N are motions (coordinate -> node), and W is a diagonal of weights (n,)."""
    unknowns = range(len(motions))
    A: Matrix = {}
    for k in unknowns:
        for l in range(k + 1):
            products = {j: x * motions[l][j] for j, x in motions[k].items() if j in motions[l]}
            A[k, l] = A[l, k] = graph.total(_weigh(graph, weights, products), distance=REACH)
    return lu(graph, A, unknowns, unknowns, Search(search.seed))  # default settings: the others are chosen for the larger J


def _weigh(graph: ExpressionGraph, weights: Sequence[Node], products: Sparse) -> list[Node]:
    """Return the summands of sum_j weight_j product_j, where products of equal weight are added before they are weighted.

    For a link on a ground pin, for example, whose centre of mass has the distance r from the pin, the products for the coordinates
    x and y are r^2 sin^2 and r^2 cos^2 of the link's angle. The weight of both products is the link's mass, and the sum of the
    products is the constant r^2.
    """
    of_weight: dict[int, list[Node]] = {}  # index of the weight's node -> products with this weight
    for j, x in sorted(products.items()):
        of_weight.setdefault(weights[j].index, []).append(x)
    by_index = {w.index: w for w in weights}
    return [by_index[w] * graph.total(x, distance=REACH) for w, x in of_weight.items()]


def _reduced_force(terms: Terms, N: Sparse, a0: Sparse) -> list[Node]:
    """Return the summands of N^T (Q - M a0) for one motion N.

    For constant Q_j and M_j, as under gravity, M_j (Q_j / M_j - a0_j) is formed, so that `_weigh` can add terms that are multiplied
    by the same mass.
    """
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
    """Elimination of Lagrange's equations, with n + m unknowns: the accelerations, then the multipliers.

    Attributes:
        factors: the factorisation of the matrix [M J^T; J 0].
        single: whether `factors` serve for corrections too: there is at most one free motion, and its independent coordinate moves
            at every sample. Otherwise the equations with unit masses are factorised for corrections.
    """

    def __init__(self, terms: Terms, independent: Sequence[int], search: Search, moving: bool):
        """Factorise the equations; `moving`: whether the independent coordinates determine the velocities at every sample."""
        self.terms, self.n, self.independent, self.search = terms, len(terms.mass), tuple(independent), search
        self.factors = self._factorise(terms.mass)
        self.single = moving and len(self.independent) <= 1
        self.guards = list_guards(self.factors)

    def _factorise(self, mass: Sequence[Node]) -> Factors:
        """Factorise the matrix [M J^T; J 0], where M is the diagonal matrix of `mass` (n,)."""
        A: Matrix = {(i, i): x for i, x in enumerate(mass)}
        for (r, c), e in self.terms.jacobian.items():
            A[self.n + r, c] = A[c, self.n + r] = e
        size = self.n + len(self.terms.rows)
        return lu(self.terms.graph, A, range(size), range(size), self.search)

    def _solve(self, gamma: Sparse) -> Sparse:
        """Return accelerations and multipliers for a right-hand side gamma, as a dict from the index of an unknown to a node."""
        return self.factors.solve(self.terms.Q | {self.n + r: x for r, x in gamma.items()})

    def acceleration(self, gamma: Sparse) -> Sparse:
        """Return the accelerations for a given right-hand side gamma of J a = gamma, as a dict coordinate -> node without zeros."""
        return self._coordinates(self._solve(gamma))

    @cached_property
    def _units(self) -> Factors:
        """The factorisation of [1 J^T; J 0], the matrix of the equations with unit masses."""
        return self._factorise([self.terms.graph.constant(1.0)] * self.n)

    @cached_property
    def _free_motions(self) -> list[Sparse]:
        """For each independent coordinate, the accelerations (coordinate -> node) that a unit force along it causes."""
        one = self.terms.graph.constant(1.0)
        return [self._coordinates(self.factors.solve({k: one})) for k in self.independent]

    @cached_property
    def _mobility(self) -> Factors:
        """Factors of the mobility matrix: how far each free motion (column) moves each independent coordinate (row)."""
        unknowns, motions = range(len(self.independent)), self._free_motions
        A: Matrix = {}
        for k, N in enumerate(motions):
            A |= {(row, k): N[j] for row, j in enumerate(self.independent) if j in N}
        return lu(self.terms.graph, A, unknowns, unknowns, Search(self.search.seed))  # default settings, as for N^T N

    @cached_property
    def _motions(self) -> Motions:
        """The basis N of the free motions (J N = 0), with N^T N factorised."""
        return Motions(self.terms, self.independent, self._free_motions, self.search)

    def _coordinates(self, unknowns: Sparse) -> Sparse:
        """Return the accelerations from the unknowns, which also contain the multipliers."""
        return {k: x for k, x in unknowns.items() if k < self.n}

    def correction(self, residual: Sparse) -> Sparse:
        """Return the coordinate change with the least norm that cancels a residual (a dict row -> node of the graph)."""
        right = {self.n + r: -x for r, x in residual.items()}
        if self.single:  # the solution with masses has the least norm in the mass metric: remove its free motion
            return self._motions.remove_free_part(self._coordinates(self.factors.solve(right)))
        return self._coordinates(self._units.solve(right))  # with unit masses the solution has the least norm

    def velocity(self, v: Sequence[Node]) -> Sparse:
        """Return the velocities nearest to v (n,) that satisfy the constraint rows."""
        if self.single:
            # vp, any velocities that satisfy the rows: the equations J v = -phi_t are the rows n + r
            driven = self.factors.solve({self.n + r: x for r, x in self.terms.driven.items()})
            return self._motions.nearest(v, self._coordinates(driven))
        # otherwise correct v by the residual J v + phi_t
        rates = [self.terms.graph.total([*(e * v[c] for c, e in row.entries.items()), row.phi_t]) for row in self.terms.rows]
        change = self.correction(_without_zeros(enumerate(rates)))
        return {j: x + change[j] if j in change else x for j, x in enumerate(v)}

    @property
    def correcting(self) -> list[Guard]:
        """The pivots, besides those in `guards`, that must exceed their thresholds where corrections are evaluated."""
        return list_guards(self._mobility if self.single else self._units)

    def multipliers(self, gamma: Sparse) -> Sparse:
        """Return the multipliers of the constraint rows in `terms`, as a dict row -> node, for a given right-hand side gamma."""
        return {k - self.n: x for k, x in self._solve(gamma).items() if k >= self.n}

    @property
    def directions(self) -> tuple[list[Sparse], list[Guard]]:
        """Free motions (coordinate -> node), each of which moves a single independent coordinate, and their further guards."""
        graph, motions, factors = self.terms.graph, self._free_motions, self._mobility
        if len(motions) == 1:
            return motions, list_guards(factors)
        separate = []
        # a unit force along one independent coordinate moves the others too: column k of the inverse mobility has the factors of
        # the motions in the combination that moves no independent coordinate but k
        for amounts in [factors.solve({k: graph.constant(1.0)}) for k in range(len(motions))]:
            sums = (graph.total([motions[l][j] * x for l, x in amounts.items() if j in motions[l]]) for j in range(self.n))
            separate.append(_without_zeros(enumerate(sums)))
        return separate, list_guards(factors)


def list_guards(factors: Factors) -> list[Guard]:
    """Return the guards of a factorisation: the pivots that must be tested at run time, with their thresholds.

    Constant pivots are left out. A constant factor of a pivot is divided out, so that multiples of one node are a single guard.
    """
    guards: dict[int, Guard] = {}  # index of a node -> guard; if a node has two thresholds, the larger one is used
    for p in factors.all_pivots:
        if p.node.number is None:
            factor, base = factor_out(p.node)
            threshold = max(p.threshold / abs(factor), guards.get(base.index, (base, 0.0))[1])
            guards[base.index] = (base, threshold)
    return list(guards.values())


# Factor on the thresholds of pivots if the kept rows are nearly dependent at some sample: there digits are lost long before pivots
# become small, and programs that drop other rows are used.
CAUTION = 100.0


@dataclass(frozen=True)
class Plan:
    """How to eliminate: a formulation, its independent coordinates, and the index in `Study.drops` of the rows to leave out."""

    formulation: str
    independent: tuple[int, ...]
    drop: int = 0


class Workspace:
    """The equations of motion of one mechanism as expressions before elimination, for one plan.

    Attributes:
        caution: factor by which the thresholds of pivots are multiplied.
        moving: whether the plan's independent coordinates determine the velocities at every sample.
        drop: the redundant rows that are left out, and the factors by which they are added to kept rows.
        mark: number of entries in the graph's `trail` before elimination; an elimination is undone by removing later entries.
    """

    def __init__(self, study: Study, open_names: tuple[str, ...], plan: Plan):
        """Write the equations; `open_names` are the numbers of the mechanism that are inputs of the program.

        Raises:
            KernelError: the plan's independent coordinates are usable at no sample, or a name in `open_names` is unknown.
        """
        mechanism, self.plan = study.mechanism, plan
        self.kept, self.drop = study.kept_rows(plan.drop), study.drops[plan.drop]
        # level and slope of each force that is piecewise linear in time are inputs too, because they change during a run
        at_start = dict(zip(line_names(mechanism), line_values(mechanism, 0.0).tolist(), strict=True))
        parameters = Parameters(mechanism, open_names, at_start)
        soundness, condition = self.drop.soundness(study.left), conditions(study, plan.independent)
        usable = soundness > USABLE  # (samples,) whether the kept rows are independent there
        if plan.formulation == "gauss":
            usable &= condition > USABLE
        states = study.states[usable]
        if not len(states):
            raise KernelError(f"{mechanism.name}: coordinates {plan.independent} determine the velocities at no sample")
        graph = ExpressionGraph(len(states))
        links = self.links = Links(graph, mechanism, parameters, states)
        self.rows = rows_of(links)
        mass = [links.number(f"links.{link.name}.{key}") for link in mechanism.links for key in ("mass", "mass", "inertia")]
        kept_rows = keep_rows(graph, self.rows, self.kept, self.drop)
        self.terms = Terms(graph, tuple(mass), kept_rows, generalised_force(links), bool(self.drop.shares))
        self.caution = 1.0 if (soundness >= ENOUGH).all() else CAUTION  # 1: kept rows far from dependent at all samples
        self.moving = bool((condition >= ENOUGH).all())
        self.mark = len(graph.trail)

    def eliminate(self, search: Search) -> "Gauss | Lagrange":
        """Begin an elimination with given settings of the pivot search; the graph's nodes of an earlier elimination are removed."""
        self.terms.graph.forget(self.mark)
        if self.plan.formulation == "gauss":
            return Gauss(self.terms, self.plan.independent, search)
        return Lagrange(self.terms, self.plan.independent, search, self.moving)

    def residuals(self) -> dict[int, Node]:
        """Return the residuals phi at a state that is to be corrected: index in `kept` -> node; zeros are left out.

        The state to be corrected is given by the inputs t_new and q_new, because the Jacobian of the correction may be evaluated at
        another state t, q.
        """
        links = self.links
        # exact: two links on a slide keep separate angles, because this state may violate the slide's constraint of equal angles
        at_new = Links(links.graph, links.mechanism, links.parameters, links.states, exact=True)
        at_new.suffix = "_new"
        rows_at_new = keep_rows(links.graph, rows_of(at_new), self.kept, self.drop)
        return {k: row.phi for k, row in enumerate(rows_at_new) if row.phi is not None and not row.phi.is_zero}

    def spread_multipliers(self, multipliers: Sparse) -> Sparse:
        """Return the multipliers of all constraint rows from those of the kept rows: index of a row -> node; zeros are left out.

        A dropped row that was added to kept rows k with factors f_k has the multiplier sum_k f_k lambda_k; other dropped rows have
        0.
        """
        of_rows = {self.kept[k]: x for k, x in multipliers.items()}
        for dropped in self.drop.rows:
            summands = [of_rows[k] * factor for k, row, factor in self.drop.shares if row == dropped and k in of_rows]
            if summands:
                of_rows[dropped] = self.terms.graph.total(summands)
        return of_rows

    def damped_gamma(self, alpha: float, beta: float) -> dict[int, Node]:
        """Return gamma - 2 alpha phi' - beta^2 phi (Baumgarte) of each kept row: index in `kept` -> node; zeros are left out."""
        sides: dict[int, Node] = {}
        for k, row in enumerate(self.terms.rows):
            side = row.gamma - rate_of(self.links, row) * (2 * alpha)
            sides[k] = side if row.phi is None else side - row.phi * beta**2
        return {k: x for k, x in sides.items() if not x.is_zero}

    def checked_outputs(self) -> tuple[list[Node], list[Node], Node]:
        """Return phi of holonomic rows, phi' of all rows, and the energy, also valid for states that violate the constraints.

        `self.links` cannot be used here: it gives both links of a slide the same angle up to a constant, which is true only where
        the constraints are satisfied. The links used here have angles of their own.
        """
        links = self.links
        untied = Links(links.graph, links.mechanism, links.parameters, links.states, exact=True)
        rows = rows_of(untied)
        return [row.phi for row in rows if row.phi is not None], [rate_of(untied, row) for row in rows], energy(untied)


def keep_rows(graph: ExpressionGraph, rows: Sequence[Row], kept: tuple[int, ...], drop: Drop) -> list[Row]:
    """Return the kept constraint rows: each row k in `kept`, plus factor times row r for every (k, r, factor) in `drop.shares`."""
    combined = []
    for k in kept:
        added = [(rows[r], factor) for kept_row, r, factor in drop.shares if kept_row == k]
        combined.append(combine(graph, [(rows[k], 1.0), *added]) if added else rows[k])
    return combined


def vector(graph: ExpressionGraph, values: dict[int, Node], size: int) -> list[Node]:
    """Return a sparse vector, index -> node, as a list of `size` nodes."""
    zero = graph.constant(0.0)
    return [values.get(k, zero) for k in range(size)]
