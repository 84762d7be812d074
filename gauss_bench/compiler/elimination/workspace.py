"""The equations of motion of one mechanism in expressions, ready to be eliminated again and again."""

from dataclasses import dataclass, replace

from gauss_bench.compiler.elimination.formulations import Algebra, Gauss, Lagrange, Terms
from gauss_bench.compiler.elimination.lu import Search
from gauss_bench.compiler.elimination.partition import USABLE, Study, conditions
from gauss_bench.compiler.equations.constraints import Row, rows_of
from gauss_bench.compiler.equations.forces import generalised_force
from gauss_bench.compiler.equations.links import Links, State
from gauss_bench.compiler.equations.parameters import Parameters
from gauss_bench.compiler.errors import KernelError
from gauss_bench.compiler.expressions.node import Graph, Node


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
