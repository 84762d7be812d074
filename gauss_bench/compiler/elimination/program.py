"""The program of a linkage: straight-line functions, ready for any machine.

    linkage -> rows and forces (equations) -> factors (lu) -> accelerations (formulations) -> functions (function)

The functions share their expressions: where several are evaluated at the same state, sines, Jacobian and factors are the same.

The search for a cheap elimination: partitions and pivot orders are tried, and the cheapest acceleration is kept.

Markowitz's rule leaves many ties, and which way they fall decides how much cancels later and how long the longest chain of
operations is. Half of the attempts break them in many ways, the other half repeat the best of these ways with other seeds. The
search is seeded and its length depends on the linkage alone, so that a linkage always gives the same program. Its outcome is
stored on disk, and a later process eliminates only once. A small GAUSS_BENCH_ATTEMPTS shortens the search at the price of slower
steps.
"""

import json
import os
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass, field, replace
from functools import cache, lru_cache
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gauss_bench.compiler import user_cache
from gauss_bench.compiler.elimination.formulations import Plan, Workspace, refuse, vector, workspace
from gauss_bench.compiler.elimination.function import Costs, Function, Inputs, costs_of, function, uses
from gauss_bench.compiler.elimination.lu import Search
from gauss_bench.compiler.elimination.partition import Study, candidates, covering, study
from gauss_bench.compiler.elimination.rank import CHECKED, error_off_constraints, error_on_constraints
from gauss_bench.compiler.errors import KernelError
from gauss_bench.linkage.digest import content_digest, source_digest
from gauss_bench.mechanism.lines import with_lines
from gauss_bench.mechanism.model import Mechanism
from gauss_bench.terms import Array

EFFORT = 2400  # attempts times unknowns, at most: about a second
LENGTH = 60_000  # attempts times operations of a plain one, at most: of large linkages few are tried
SHORTER = "GAUSS_BENCH_ATTEMPTS"  # in the environment: as many attempts, in this process and in all that it starts
THOROUGH = 144
ATTEMPTS = int(said) if (said := os.environ.get(SHORTER, "")).isdecimal() and int(said) else THOROUGH
CLOSE = 1.01  # prices of a single step that races do not tell apart
REPEATED = 4  # ways that are repeated
SEARCHED, HOPELESS = 3, 1.5  # plans that are searched: the best by a plain attempt, none that costs so much more than the first
NOISES, PATIENCES, CROSSINGS = (0.0, 0.6, 1.5, 3.0), (0.0, 0.5, 2.0), (0.0, 1.0, 0.5)
PLAIN = Search()
SOURCES = ("mechanism", "compiler/expressions", "compiler/equations", "compiler/elimination")  # that a search follows from


@dataclass(frozen=True, eq=False)
class Best:
    """The best attempt on a workspace: its search settings and its costs."""

    work: Workspace
    search: Search
    costs: Costs


def attempt(work: Workspace, searches: Iterable[Search]) -> list[Best]:
    """Eliminate under each of several search settings and return the costs; attempts without usable pivots are left out.

    Raises:
        KernelError: no attempt finds usable pivots.
    """
    attempts: list[Best] = []
    failure = KernelError("no attempt was made")
    for search in searches:
        try:
            algebra = work.algebra(search)
        except KernelError as error:
            failure = error
            continue
        costs = costs_of([*algebra.acceleration(work.terms.gamma).values(), *(x for x, _ in algebra.guards)])
        attempts.append(Best(work, search, costs))
    if not attempts:
        raise failure
    return attempts


def pick(attempts: Sequence[Best]) -> Best:
    """Return the attempt with the fewest operations among those whose price is within CLOSE of the least.

    The price of a single step cannot tell such attempts apart, while a batch pays for every operation.
    """
    least = min(x.costs.single for x in attempts)
    return min((x for x in attempts if x.costs.single <= CLOSE * least), key=lambda x: x.costs.operations)


def best_of(work: Workspace, count: int) -> Best:
    """Return the cheapest of `count` attempts: half with different search settings, half with other seeds of the best of these."""
    settings = [Search(0, *choice) for choice in product(NOISES, PATIENCES, CROSSINGS)]
    order = np.random.default_rng(0).permutation(len(settings))
    various = [PLAIN, *(replace(settings[k], seed=int(k)) for k in order)][: (count + 1) // 2]
    attempts = sorted(attempt(work, various), key=lambda x: x.costs.single)
    leaders = attempts[:REPEATED]
    repeated = [(k, leaders[k % len(leaders)].search) for k in range(count - len(various))]
    # without chance a repetition gives the same program
    again = [replace(search, seed=100 + k) for k, search in repeated if search.by_chance]
    return pick([*attempts, *(attempt(work, again) if again else [])])


def cheapest(
    known: Study, open_parameters: tuple[str, ...], formulation: str, independent: tuple[int, ...] | None, drop: int = 0
) -> Best:
    """Return the cheapest elimination of a mechanism over the formulations and partitions that the caller left open.

    One plain attempt at each of them decides which are worth a longer search.

    Raises:
        KernelError: no partition and no pivots are usable.
    """
    plain, failure = [], KernelError(f"{known.mechanism.name}: no partition is usable")
    for plan in _plans(known, formulation, independent, drop):
        try:
            plain += attempt(workspace(known, open_parameters, plan), [PLAIN])
        except KernelError as error:
            failure = error
    if not plain:
        raise failure
    plain = sorted(plain, key=lambda x: x.costs.single)
    unknowns = known.mechanism.n + len(known.kept(drop))
    count = min(ATTEMPTS, EFFORT // unknowns, LENGTH // max(1, plain[0].costs.operations))
    if count <= 1:
        return plain[0]
    tried = [x for x in plain[:SEARCHED] if x.costs.single <= HOPELESS * plain[0].costs.single]
    return pick([best_of(x.work, count) for x in tried])


def _name(mechanism: Mechanism, *asked: Any) -> str | None:
    """Return the file name of a search's outcome in the cache; None if the mechanism cannot be hashed (numbers of other types)."""
    try:
        return f"{content_digest(_sources(), mechanism, asked)}.json"
    except TypeError:
        return None


@cache
def _sources() -> str:
    return source_digest(*SOURCES)


def _recall(known: Study, open_parameters: tuple[str, ...], name: str | None) -> Best | None:
    """Repeat the elimination that an earlier search has stored; None if there is none or it no longer works."""
    kept = user_cache.load(name) if name else None
    if kept is None:
        return None
    plan, search = json.loads(kept)
    try:
        work = workspace(known, open_parameters, Plan(plan["formulation"], tuple(plan["independent"]), plan["drop"]))
        return attempt(work, [Search(**search)])[0]
    except KernelError:
        return None


def _plans(known: Study, formulation: str, independent: tuple[int, ...] | None, drop: int) -> list[Plan]:
    """List the plans to try: lagrange, and gauss with each candidate partition, unless the caller fixed the formulation."""
    plans = [Plan("lagrange", covering(known)[0], drop)] if formulation != "gauss" else []
    if formulation != "lagrange":
        choices = (candidates(known) or covering(known)[:1]) if independent is None else [independent]
        plans += [Plan("gauss", x, drop) for x in choices]
    return plans


__all__ = ["Costs", "Function", "KernelError", "Program", "generate", "known_program", "partitions"]


NOTHING = Function((), (), ())


@dataclass(frozen=True, eq=False)
class Program:
    """Straight-line functions of one mechanism under one formulation and one partition.

    Attributes:
        name: of the mechanism.
        formulation: "gauss" or "lagrange".
        n, m: numbers of coordinates and of constraint rows kept.
        independent: coordinates of the partition; under lagrange they only parametrise the free motions.
        parameters: names of the numbers left open, such as "links.crank.mass" or "points.rod.A.x", in the order of p; then those
            of `mechanism/lines.py`, which change with time.
        values: (n_p,) their values in the linkage file.
        dropped: names of the redundant rows that were dropped.
        acceleration: (t, q, v, p) -> a (n,), guard (k,).
        thresholds: (k,) the state is usable where abs(guard) >= thresholds.
        position_correction: (t_at, q_at, t, q, p) -> dq (n,), the shortest Newton correction with the Jacobian at q_at and the
            residual at q; then its own guard, which holds in addition to that of the acceleration.
        nearest_velocity: (t, q, v, p) -> v (n,), the nearest one that the constraints allow; then its guard.
        correcting_thresholds: thresholds of these two guards.
        directions: (t, q, v, p) -> one free motion (n,) for each independent coordinate; then their guard.
        direction_thresholds: thresholds of that guard.
        multipliers: (t, q, v, p) -> lambda of M a + J^T lambda = Q, for all rows in the file's order. A dropped row has 0, or its
            share where kept rows are combinations with it.
        energy: (q, v, p) -> (1,) kinetic plus potential energy [J].
        residual: (t, q, v, p) -> phi (all holonomic rows), phi_dot (all rows).
        stabilized: as acceleration, with gamma - 2 alpha phi_dot - beta^2 phi in place of gamma; None unless asked for.

    A program of accelerations alone leaves out what follows `acceleration`.
    """

    name: str
    formulation: str
    n: int
    m: int
    independent: tuple[int, ...]
    parameters: tuple[str, ...]
    values: Array
    dropped: tuple[str, ...]
    thresholds: Array
    acceleration: Function
    position_correction: Function = NOTHING
    nearest_velocity: Function = NOTHING
    correcting_thresholds: Array = field(default_factory=lambda: np.zeros(0))
    directions: Function = NOTHING
    direction_thresholds: Array = field(default_factory=lambda: np.zeros(0))
    multipliers: Function = NOTHING
    energy: Function = NOTHING
    residual: Function = NOTHING
    stabilized: Function | None = None

    @property
    def n_parameters(self) -> int:
        """Length of the input p."""
        return len(self.parameters)


def generate(
    mechanism: Mechanism,
    formulation: str = "auto",
    open_parameters: tuple[str, ...] = (),
    independent: tuple[int, ...] | None = None,
    baumgarte: tuple[float, float] | None = None,
    drop: int = 0,
    remembered: bool = False,
) -> Program:
    """Generate and check the program of a mechanism.

    Args:
        formulation: "gauss", "lagrange", or "auto" for the one that costs less.
        open_parameters: names of numbers of the file that stay inputs.
        independent: coordinates of the partition (gauss); chosen where None.
        baumgarte: alpha, beta [1/s] of the stabilised variant.
        drop: which choice of redundant rows is dropped, of `drops`.
        remembered: whether the outcome of the search is read from and written to the user's cache.

    Raises:
        KernelError: dry friction, an unknown parameter, no usable partition, or a program that fails its own check.
    """
    refuse(mechanism, formulation)
    known = study(mechanism)
    if independent is not None and (len(set(independent)) != known.free or not set(independent) <= set(range(mechanism.n))):
        raise KernelError(f"{mechanism.name} has {known.free} independent coordinates among {mechanism.n}, not {independent}")
    asked = (open_parameters, formulation, independent, drop)
    name = _name(mechanism, *asked, ATTEMPTS) if remembered else None
    best = _recall(known, open_parameters, name)
    if best is None:
        best = cheapest(known, *asked)
        if name:
            user_cache.store(name, json.dumps([asdict(best.work.plan), asdict(best.search)]).encode())
    program = _write(known, best, baumgarte)
    try:
        check(program, mechanism)
    except KernelError:
        if best.search == PLAIN:
            raise
        # in a large linkage pivots from a random search may lose digits: a plain attempt takes the largest ones
        program = _write(known, attempt(best.work, [PLAIN])[0], baumgarte)
        check(program, mechanism)
    return program


known_program = lru_cache(maxsize=32)(generate)  # the same mechanism is often compiled under several stabilisations


def partitions(mechanism: Mechanism) -> list[tuple[int, ...]]:
    """Return choices of independent coordinates: at every sampled position at least one is usable, the first at most of them."""
    return covering(study(mechanism))


def _write(known: Study, best: Best, baumgarte: tuple[float, float] | None) -> Program:
    """Write all functions of the best plan."""
    work, algebra = best.work, best.work.algebra(best.search)
    mechanism, links, graph = known.mechanism, work.links, work.terms.graph
    n = mechanism.n
    phi, phi_dot, energy = work.exact()  # first: elimination may rewrite products in a form valid on the constraints only
    guards = algebra.guards
    a = vector(graph, algebra.acceleration(work.terms.gamma), n)
    dq = vector(graph, algebra.correction(work.residuals()), n)
    correcting = algebra.correcting
    nearest = vector(graph, algebra.velocity([links.rate(k) for k in range(n)]), n)
    stabilized = vector(graph, algebra.acceleration(work.damped(*baumgarte)), n) if baumgarte else []
    multipliers = work.spread_out(algebra.multipliers(work.terms.gamma))
    directions, apart = algebra.directions
    shared = uses([*a, *(x for x, _ in guards), *dq, *nearest, *stabilized])
    size = len(links.parameters.names)
    at: Inputs = (("t", 1), ("q", n), ("v", n), ("p", size))
    moved: Inputs = (("t", 1), ("q", n), ("t_new", 1), ("q_new", n), ("p", size))
    pivots = [x for x, _ in guards]
    return Program(
        name=mechanism.name,
        formulation=work.plan.formulation,
        n=n,
        m=len(work.kept),
        independent=work.plan.independent,
        parameters=links.parameters.names,
        values=links.parameters.values,
        dropped=known.dropped(work.plan.drop),
        thresholds=work.caution * np.array([x for _, x in guards]),
        acceleration=function(at, [a, pivots], shared),
        position_correction=function(moved, [dq, [x for x, _ in correcting]], shared),
        nearest_velocity=function(at, [nearest, [x for x, _ in correcting]], shared),
        correcting_thresholds=work.caution * np.array([x for _, x in correcting]),
        directions=function(at, [*(vector(graph, N, n) for N in directions), [x for x, _ in apart]], shared),
        direction_thresholds=work.caution * np.array([x for _, x in apart]),
        multipliers=function(at, [vector(graph, multipliers, len(work.rows))], shared),
        energy=function(at[1:], [[energy]], shared),
        residual=function(at, [phi, phi_dot], shared),
        stabilized=function(at, [stabilized, pivots], shared) if baumgarte else None,
    )


def check(program: Program, mechanism: Mechanism) -> None:
    """Compare a program with the interpreted evaluation at new states, on the constraints and off them.

    Raises:
        KernelError: the program is off by more than CHECKED, or usable at none of these states.
    """

    def accelerate(t: Array, q: Array, v: Array) -> tuple[Array, NDArray[np.bool_]]:
        a, guard = program.acceleration(t, q, v, with_lines(mechanism, program.values, t[:, 0]))
        return a, np.asarray((np.abs(guard) >= program.thresholds).all(axis=1))

    def evaluate(t: float, q: Array, v: Array) -> Array:
        return np.concatenate([*program.residual([t], q, v, program.values), program.energy(q, v, program.values)[0]])

    error, count = error_on_constraints(mechanism, accelerate)
    if not count:
        raise KernelError(f"{program.name}: the {program.formulation} kernel is usable at no position that was tried")
    error = max(error, error_off_constraints(mechanism, evaluate))
    if not error <= CHECKED:
        raise KernelError(f"{program.name}: the {program.formulation} kernel is off by {error:.1e}, which its condition explains")
