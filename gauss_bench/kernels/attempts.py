"""The search for a cheap elimination: partitions and pivot orders are tried, and the cheapest acceleration is kept.

Markowitz's rule leaves many ties, and which way they fall decides how much cancels later and how long the longest chain of
operations is. A single trajectory waits for that chain, a batch for the number of operations; `Costs.estimate` weighs both. The
search is seeded and its length depends on the linkage alone, so that a linkage always gives the same program.
"""

from dataclasses import dataclass, replace
from itertools import product

from gauss_bench.kernels.algebra import Algebra, Gauss, Lagrange, Terms
from gauss_bench.kernels.elimination import Search
from gauss_bench.kernels.errors import KernelError
from gauss_bench.kernels.export import Costs, costs_of
from gauss_bench.kernels.links import Links, State
from gauss_bench.kernels.node import Graph, Node
from gauss_bench.kernels.parameters import Parameters
from gauss_bench.kernels.partition import USABLE, Study, candidates, conditions, covering
from gauss_bench.kernels.symbol_forces import generalised_force
from gauss_bench.kernels.symbols import Row, rows_of

EFFORT = 2400  # attempts times unknowns, at most: about a second
ATTEMPTS = 72
NOISES, PATIENCES, CROSSINGS, UNDIVIDED = (0.0, 0.6, 1.5, 3.0), (0.0, 0.5, 2.0), (0.0, 1.0, 0.5), (False, True)


@dataclass(frozen=True)
class Plan:
    """A formulation and, for gauss, its independent coordinates."""

    formulation: str
    independent: tuple[int, ...]


@dataclass(frozen=True, eq=False)
class Workspace:
    """The equations of motion of one mechanism, before elimination, at the samples one plan can use.

    Attributes:
        rows: all rows at the state; kept: indices of those that are eliminated.
        mark: how much the graph knew before elimination.
    """

    plan: Plan
    links: Links
    rows: list[Row]
    terms: Terms
    kept: tuple[int, ...]
    mark: int

    def algebra(self, search: Search) -> Algebra:
        """An elimination from a clean slate; what an earlier one made is forgotten."""
        self.terms.graph.forget(self.mark)
        if self.plan.formulation == "gauss":
            return Gauss(self.terms, self.plan.independent, search)
        return Lagrange(self.terms, search)


def workspace(found: Study, parameters: Parameters, plan: Plan) -> Workspace:
    """Terms of a mechanism for a plan.

    Raises:
        KernelError: the plan's partition is singular at every sample.
    """
    states, mechanism = found.states, found.mechanism
    if plan.formulation == "gauss":
        states = states.part(conditions(found, plan.independent) > USABLE)
        if not len(states):
            raise KernelError(f"{mechanism.name}: coordinates {plan.independent} do not determine the velocities anywhere")
    graph = Graph(len(states))
    here = State("t", "q", "v", states.t, states.q, states.v)
    links = Links(graph, mechanism, parameters, here)
    rows = rows_of(links)
    mass = [links.number(f"links.{link.name}.{key}") for link in mechanism.links for key in ("mass", "mass", "inertia")]
    terms = Terms(graph, tuple(mass), [rows[k] for k in found.kept], generalised_force(links))
    return Workspace(plan, links, rows, terms, found.kept, len(graph.trail))


def plain_links(work: Workspace) -> Links:
    """The links at the same state, every angle for itself: for energy and residuals, which must be right off the constraints."""
    links = work.links
    return Links(links.graph, links.mechanism, links.parameters, links.state, exact=True)


def moved_links(work: Workspace) -> Links:
    """The links at the state that a position correction starts from, inputs t_new and q_new: every angle for itself."""
    links = work.links
    there = replace(links.state, t="t_new", q="q_new", v="v_new")
    return Links(links.graph, links.mechanism, links.parameters, there, exact=True)


def vector(graph: Graph, values: dict[int, Node], size: int) -> list[Node]:
    """All components of a sparse vector."""
    zero = graph.constant(0.0)
    return [values.get(k, zero) for k in range(size)]


def searches(count: int) -> list[Search]:
    """The ways in which ties are broken, the plain one first."""
    ways = list(product(NOISES, PATIENCES, CROSSINGS, UNDIVIDED))
    return [Search(seed, *ways[seed % len(ways)]) for seed in range(count)]


def attempt(work: Workspace, search: Search) -> Costs:
    """Costs of the acceleration and its guards under one way of breaking ties."""
    algebra = work.algebra(search)
    return costs_of([*algebra.acceleration(work.terms.gamma).values(), *(x for x, _ in algebra.guards)])


@dataclass(frozen=True, eq=False)
class Best:
    """A workspace, the search that served it best, and what it came to."""

    work: Workspace
    search: Search
    costs: Costs


def best_of(work: Workspace, tries: list[Search]) -> Best:
    """The cheapest of several attempts.

    Raises:
        KernelError: none of them finds usable pivots.
    """
    found: Best | None = None
    failure: KernelError | None = None
    for search in tries:
        try:
            costs = attempt(work, search)
        except KernelError as error:
            failure = error
            continue
        if found is None or costs.estimate < found.costs.estimate:
            found = Best(work, search, costs)
    if found is None:
        raise failure or KernelError("no attempt was made")
    return found


def cheapest(found: Study, parameters: Parameters, formulation: str, independent: tuple[int, ...] | None) -> Best:
    """The cheapest program of a mechanism among the formulations and partitions that are open.

    Raises:
        KernelError: no partition and no pivots are usable.
    """
    unknowns = found.mechanism.n + len(found.kept)
    tries = searches(max(1, min(ATTEMPTS, EFFORT // unknowns)))
    results = []
    if formulation in ("gauss", "auto"):
        results.append(_best_partition(found, parameters, independent, tries))
    if formulation in ("lagrange", "auto"):
        results.append(best_of(workspace(found, parameters, Plan("lagrange", ())), tries))
    return min(results, key=lambda x: x.costs.estimate)


def _best_partition(found: Study, parameters: Parameters, independent: tuple[int, ...] | None, tries: list[Search]) -> Best:
    choices = (candidates(found) or covering(found)[:1]) if independent is None else [independent]
    plain = [best_of(workspace(found, parameters, Plan("gauss", x)), tries[:1]) for x in choices]
    plain = sorted(plain, key=lambda x: x.costs.estimate)
    return min([plain[0], *(best_of(x.work, tries) for x in plain[:2] if len(tries) > 1)], key=lambda x: x.costs.estimate)
