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

from gauss_bench.kernels.elimination import Search
from gauss_bench.kernels.errors import KernelError
from gauss_bench.kernels.export import Costs, costs_of
from gauss_bench.kernels.parameters import Parameters
from gauss_bench.kernels.partition import Study, candidates, covering
from gauss_bench.kernels.workspace import Plan, Workspace, workspace

EFFORT = 2400  # attempts times unknowns, at most: about a second
ATTEMPTS = 144
REPEATED = 4  # ways that are repeated
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

    Raises:
        KernelError: no partition and no pivots are usable.
    """
    wanted = Wanted(aim, max(1, min(ATTEMPTS, EFFORT // (found.mechanism.n + len(found.kept)))))
    results = []
    if formulation in ("gauss", "auto"):
        results.append(_best_partition(found, parameters, independent, wanted))
    if formulation in ("lagrange", "auto"):
        results.append(best_of(workspace(found, parameters, Plan("lagrange", ())), wanted))
    return min(results, key=lambda x: wanted.price(x.costs))


def _best_partition(found: Study, parameters: Parameters, independent: tuple[int, ...] | None, wanted: Wanted) -> Best:
    """The best of the two partitions that a plain attempt finds cheapest."""
    choices = (candidates(found) or covering(found)[:1]) if independent is None else [independent]
    plain = [attempted(workspace(found, parameters, Plan("gauss", x)), [PLAIN])[0] for x in choices]
    plain = sorted(plain, key=lambda x: wanted.price(x.costs))
    if wanted.attempts == 1:
        return plain[0]
    return min((best_of(x.work, wanted) for x in plain[:2]), key=lambda x: wanted.price(x.costs))
