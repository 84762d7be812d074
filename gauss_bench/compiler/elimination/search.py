"""The search for a cheap elimination: partitions and pivot orders are tried, and the cheapest acceleration is kept.

Markowitz's rule leaves many ties, and which way they fall decides how much cancels later and how long the longest chain of
operations is. Half of the attempts break them in many ways, the other half repeat the best of these ways with other seeds. A single
trajectory waits for the longest chain, a batch for the number of operations: `aim` says what is wanted. The search is seeded and
its length depends on the linkage alone, so that a linkage always gives the same program.
"""

from collections.abc import Iterable
from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from gauss_bench.compiler.elimination.formulations import Plan, Workspace, workspace
from gauss_bench.compiler.elimination.function import Costs, costs_of
from gauss_bench.compiler.elimination.lu import Search
from gauss_bench.compiler.elimination.partition import Study, candidates, covering
from gauss_bench.compiler.equations.links import Parameters
from gauss_bench.compiler.errors import KernelError

EFFORT = 2400  # attempts times unknowns, at most: about a second
ATTEMPTS = 144
REPEATED = 4  # ways that are repeated
SEARCHED, HOPELESS = 3, 1.5  # plans that are searched: the best by a plain attempt, none that costs so much more than the first
NOISES, PATIENCES, CROSSINGS, UNDIVIDED = (0.0, 0.6, 1.5, 3.0), (0.0, 0.5, 2.0), (0.0, 1.0, 0.5), (False, True)
PLAIN = Search()


@dataclass(frozen=True, eq=False)
class Best:
    """A workspace, the search that served it best, and what it came to."""

    work: Workspace
    search: Search
    costs: Costs


@dataclass(frozen=True)
class Wanted:
    """What is searched for: least `Costs.single` or `Costs.batch`, in so many attempts."""

    aim: str
    attempts: int

    def price(self, costs: Costs) -> float:
        return costs.single if self.aim == "single" else costs.batch


def attempted(work: Workspace, searches: Iterable[Search]) -> list[Best]:
    """Costs of the acceleration and its guards under several searches; those that find no usable pivots are left out.

    Raises:
        KernelError: none of them does.
    """
    found: list[Best] = []
    failure = KernelError("no attempt was made")
    for search in searches:
        try:
            algebra = work.algebra(search)
        except KernelError as error:
            failure = error
            continue
        costs = costs_of([*algebra.acceleration(work.terms.gamma).values(), *(x for x, _ in algebra.guards)])
        found.append(Best(work, search, costs))
    if not found:
        raise failure
    return found


def best_of(work: Workspace, wanted: Wanted) -> Best:
    """The cheapest of several attempts."""
    ways = [Search(0, *way) for way in product(NOISES, PATIENCES, CROSSINGS, UNDIVIDED)]
    order = np.random.default_rng(0).permutation(len(ways))
    various = [PLAIN, *(replace(ways[k], seed=int(k)) for k in order)][: (wanted.attempts + 1) // 2]
    found = sorted(attempted(work, various), key=lambda x: wanted.price(x.costs))
    leaders, spare = found[:REPEATED], wanted.attempts - len(various)
    again = [replace(leaders[k % len(leaders)].search, seed=100 + k) for k in range(spare)]
    return min([found[0], *(attempted(work, again) if again else [])], key=lambda x: wanted.price(x.costs))


def cheapest(found: Study, parameters: Parameters, formulation: str, independent: tuple[int, ...] | None, aim: str) -> Best:
    """The cheapest program of a mechanism among the formulations and partitions that are open.

    A plain attempt at each tells which are worth a search.

    Raises:
        KernelError: no partition and no pivots are usable.
    """
    wanted = Wanted(aim, max(1, min(ATTEMPTS, EFFORT // (found.mechanism.n + len(found.kept)))))
    plain, failure = [], KernelError(f"{found.mechanism.name}: no partition is usable")
    for plan in _plans(found, formulation, independent):
        try:
            plain += attempted(workspace(found, parameters, plan), [PLAIN])
        except KernelError as error:
            failure = error
    if not plain:
        raise failure
    plain = sorted(plain, key=lambda x: wanted.price(x.costs))
    if wanted.attempts == 1:
        return plain[0]
    tried = [x for x in plain[:SEARCHED] if wanted.price(x.costs) <= HOPELESS * wanted.price(plain[0].costs)]
    return min((best_of(x.work, wanted) for x in tried), key=lambda x: wanted.price(x.costs))


def _plans(found: Study, formulation: str, independent: tuple[int, ...] | None) -> list[Plan]:
    """Partitions under gauss, and lagrange, as far as the formulation is open."""
    plans = [Plan("lagrange", ())] if formulation != "gauss" else []
    if formulation != "lagrange":
        choices = (candidates(found) or covering(found)[:1]) if independent is None else [independent]
        plans += [Plan("gauss", x) for x in choices]
    return plans
