"""The program of a linkage, as straight-line functions, and the search for the cheapest one.

    linkage -> rows and forces (equations) -> factors (lu) -> accelerations (formulations) -> functions (function)

The functions share their expressions: if several are evaluated at the same state, sines, Jacobian and factors are the same.

The search tries independent coordinates and orders of pivots, and keeps those that give the cheapest acceleration. By Markowitz's
rule for pivots many candidates are equally good. The choice among these pivots decides how many terms cancel later, and how long
the longest chain of dependent operations is. Half of the attempts choose among equally good pivots by different rules, and the
other half repeat the best of these rules with other seeds. The search is seeded, and its length depends on the linkage alone, so
that a linkage always gives the same program. Its result is stored on disk, so that a later process needs only one elimination. A
small number in the environment variable GAUSS_BENCH_ATTEMPTS shortens the search, but the generated code may then need more time
per step.
"""

import json
import math
import os
from collections.abc import Iterable, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, field, replace
from functools import cache, lru_cache
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gauss_bench.compiler import user_cache
from gauss_bench.compiler.elimination.formulations import Guard, Plan, Workspace, vector
from gauss_bench.compiler.elimination.function import Costs, Function, Inputs, costs_of, function, uses
from gauss_bench.compiler.elimination.lu import Search
from gauss_bench.compiler.elimination.partition import Study, candidates, covering, study
from gauss_bench.compiler.elimination.rank import CHECKED, error_off_constraints, error_on_constraints
from gauss_bench.compiler.errors import KernelError
from gauss_bench.linkage.digest import content_digest, source_digest
from gauss_bench.mechanism.lines import with_lines
from gauss_bench.mechanism.model import Mechanism
from gauss_bench.terms import Array

EFFORT = 2400  # largest product of the numbers of attempts and of unknowns, which bounds the time of a search to about a second
LENGTH = 60_000  # largest product of the numbers of attempts and of operations of one attempt, a bound for large linkages
SHORTER = "GAUSS_BENCH_ATTEMPTS"  # environment variable with the number of attempts, for this process and all that it starts
THOROUGH = 144  # number of attempts if the environment does not give it


_shorter = os.environ.get(SHORTER, "")
ATTEMPTS = int(_shorter) if _shorter.isdecimal() and int(_shorter) > 0 else THOROUGH  # largest number of attempts of a search
# error of a program above which a plain attempt is tried too: usual programs have 1e-12 or less, so that few are eliminated twice
PRECISE = 1e-11
# The price of an attempt is the estimate `Costs.single` of its acceleration.
CLOSE = 1.03  # ratio of two prices that timing cannot distinguish
REPEATED = 4  # number of rules that are repeated with other seeds
SEARCHED = 3  # number of plans that are searched: those with the cheapest plain attempts
HOPELESS = 1.5  # price of a plan relative to the best one above which it is not searched
NOISES, PATIENCES, CROSSINGS = (0.0, 0.6, 1.5, 3.0), (0.0, 0.5, 2.0), (0.0, 1.0, 0.5)  # values of the search's settings
SEEDS = 2  # number of seeds for each combination of these values
FORMULATIONS = ("auto", "gauss", "lagrange")
PLAIN = Search()  # Markowitz's count alone, without random numbers; an attempt with it is a plain attempt
SOURCES = ("mechanism", "compiler/expressions", "compiler/equations", "compiler/elimination")  # code on which a search depends


@dataclass(frozen=True, eq=False)
class Attempt:
    """An elimination of the equations of motion with usable pivots, with the search settings that found it and its costs."""

    work: Workspace
    search: Search
    costs: Costs


def try_settings(work: Workspace, searches: Iterable[Search]) -> list[Attempt]:
    """Eliminate the equations once with each of several settings of the search; return the attempts that found usable pivots.

    Raises:
        KernelError: no attempt finds usable pivots.
    """
    attempts: list[Attempt] = []
    failure = KernelError("no attempt was made")
    for search in searches:
        try:
            elimination = work.eliminate(search)
        except KernelError as error:
            failure = error
            continue
        costs = costs_of([*elimination.acceleration(work.terms.gamma).values(), *(x for x, _ in elimination.guards)])
        attempts.append(Attempt(work, search, costs))
    if not attempts:
        raise failure
    return attempts


def pick_cheapest(attempts: Sequence[Attempt]) -> Attempt:
    """Return the attempt with the fewest operations among those whose price (estimated cycles) is at most CLOSE times the least.

    Timing of single steps cannot distinguish such prices, but every operation costs time when many trajectories are computed
    together.
    """
    least = min(x.costs.single for x in attempts)
    return min((x for x in attempts if x.costs.single <= CLOSE * least), key=lambda x: x.costs.operations)


def search_plan(work: Workspace, count: int) -> Attempt:
    """Make `count` attempts to eliminate the equations of one plan, and return the cheapest one.

    Half of the attempts have different search settings, the first of them PLAIN (Markowitz's count alone). The others repeat the
    best of these settings with other seeds.
    """
    combinations = product(NOISES, PATIENCES, CROSSINGS, range(SEEDS))
    settings = [Search(seed, noise, patience, crossing) for seed, (noise, patience, crossing, _) in enumerate(combinations)]
    order = np.random.default_rng(0).permutation(len(settings))
    # without random numbers the seed makes no difference: such settings are tried once
    shuffled = [settings[k] if settings[k].is_random else replace(settings[k], seed=0) for k in order]
    various = list(dict.fromkeys([PLAIN, *shuffled]))[: (count + 1) // 2]
    attempts = sorted(try_settings(work, various), key=lambda x: x.costs.single)
    leaders = attempts[:REPEATED]
    retries = [(k, leaders[k % len(leaders)].search) for k in range(count - len(various))]
    # settings without random numbers would give the same program again; seeds from 100 on are not used in `various`
    repeated = [replace(search, seed=100 + k) for k, search in retries if search.is_random]
    return pick_cheapest([*attempts, *(try_settings(work, repeated) if repeated else [])])


def cheapest(
    analysis: Study, open_parameters: tuple[str, ...], formulation: str, independent: tuple[int, ...] | None, drop: int = 0
) -> Attempt:
    """Return the cheapest elimination over the formulations and independent coordinates that the caller does not prescribe.

    One plain attempt for each combination of formulation and coordinates decides which combinations are searched longer.

    Args:
        drop: index in `Study.drops` of the redundant rows to leave out.
        formulation: "gauss", "lagrange", or "auto" for both.
        independent: the independent coordinates in Gauss's formulation; if None, all candidates are tried.

    Raises:
        KernelError: no independent coordinates or no pivots are usable.
    """
    # in Lagrange's formulation the independent coordinates only select the free motions
    plans = [Plan("lagrange", covering(analysis)[0], drop)] if formulation != "gauss" else []
    if formulation != "lagrange":
        choices = (candidates(analysis) or covering(analysis)[:1]) if independent is None else [independent]
        plans += [Plan("gauss", x, drop) for x in choices]
    plain, failure = [], KernelError(f"{analysis.mechanism.name}: no choice of independent coordinates is usable")
    for plan in plans:
        try:
            plain += try_settings(Workspace(analysis, open_parameters, plan), [PLAIN])
        except KernelError as error:
            failure = error
    if not plain:
        raise failure
    plain = sorted(plain, key=lambda x: x.costs.single)
    unknowns = analysis.mechanism.n + len(analysis.kept_rows(drop))
    # for a linkage with many unknowns or a long program fewer attempts are made, so that the search ends soon
    count = min(ATTEMPTS, EFFORT // unknowns, LENGTH // max(1, plain[0].costs.operations))
    if count <= 1:
        return plain[0]
    tried = [x for x in plain[:SEARCHED] if x.costs.single <= HOPELESS * plain[0].costs.single]
    return pick_cheapest([search_plan(x.work, count) for x in tried])


def _cache_name(mechanism: Mechanism, *arguments: Any) -> str | None:
    """Return the file name of a search's result in the user's cache; None if a number of the mechanism cannot be hashed."""
    try:
        return f"{content_digest(_sources(), mechanism, arguments)}.json"
    except TypeError:
        return None


@cache
def _sources() -> str:
    """Return a hash of the source code on which the result of a search depends."""
    return source_digest(*SOURCES)


def _recall(analysis: Study, open_parameters: tuple[str, ...], name: str | None) -> Attempt | None:
    """Repeat the elimination whose settings an earlier search has stored as `name`.

    Return None if none are stored, or if they find no usable pivots.
    """
    stored = user_cache.load(name) if name else None
    if stored is None:
        return None
    plan, search = json.loads(stored)
    try:
        work = Workspace(analysis, open_parameters, Plan(plan["formulation"], tuple(plan["independent"]), plan["drop"]))
        return try_settings(work, [Search(**search)])[0]
    except KernelError:
        return None


__all__ = ["Costs", "Function", "KernelError", "Program", "generate", "known_program", "partitions"]


NOTHING = Function((), (), ())  # placeholder for a function that a program does not have


@dataclass(frozen=True, eq=False)
class Program:
    """Straight-line functions of one mechanism under one formulation, for one choice of independent coordinates.

    Their arguments are the time t, positions q and velocities v (n,), and parameters p (n_p,): numbers of the linkage that are set
    at run time. Guards (k,) are pivots: a function may be used at a state if abs(guard) >= threshold for all its guards. A program
    that computes accelerations alone does not have the functions that are listed after `acceleration`.

    Attributes:
        n, m: numbers of coordinates, and of constraint rows without the redundant rows that are left out.
        independent: the independent coordinates; in Lagrange's formulation they only parametrise the free motions.
        parameters: names of the parameters p: first those that the caller has named, such as "links.crank.mass" or
            "points.rod.A.x", then those of `mechanism/lines.py`, the level and slope of forces that are piecewise linear in time.
        values: (n_p,) values of the parameters: in the linkage file or, for those of `mechanism/lines.py`, at t = 0.
        dropped: names of the redundant rows that were dropped.
        acceleration: function (t, q, v, p) -> a (n,), guards.
        position_correction: function (t_at, q_at, t, q, p) -> dq (n,), the shortest Newton correction with the Jacobian at q_at and
            the residual at q, and its guards besides those of the acceleration.
        nearest_velocity: function (t, q, v, p) -> the velocities (n,) nearest to v that the constraints allow, and the same
            additional guards.
        directions: function (t, q, v, p) -> for each independent coordinate a motion (n,) that the constraints allow and that moves
            no other independent coordinate; last, its guards besides those of the acceleration.
        multipliers: function (t, q, v, p) -> lambda of M a + J^T lambda = Q, for all constraint rows in the file's order. If a
            redundant row was added to kept rows k with factors f_k before it was left out, its multiplier is sum_k f_k lambda_k,
            otherwise 0.
        energy: function (q, v, p) -> kinetic plus potential energy (1,) [J].
        residual: function (t, q, v, p) -> phi of all holonomic rows, phi_dot of all rows.
        stabilized: function as `acceleration`, with gamma - 2 alpha phi_dot - beta^2 phi in place of gamma; None if the program was
            generated without Baumgarte's terms.
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


def generate(
    mechanism: Mechanism,
    formulation: str = "auto",
    open_parameters: tuple[str, ...] = (),
    independent: tuple[int, ...] | None = None,
    baumgarte: tuple[float, float] | None = None,
    drop: int = 0,
    remembered: bool = False,
) -> Program:
    """Generate and check the program of a mechanism: straight-line functions for its accelerations, corrections and energy.

    Args:
        formulation: "gauss", "lagrange", or "auto" for the one that costs less.
        open_parameters: names of the mechanism's numbers that are inputs of the program.
        independent: the independent coordinates in Gauss's formulation; with None the search chooses them.
        baumgarte: alpha, beta [1/s] of the function `stabilized`; with None the program has no such function.
        drop: index in `Study.drops` of the choice of redundant rows to leave out.
        remembered: whether the result of the search is read from and written to the user's cache.

    Raises:
        KernelError: dry friction, an unknown parameter, no usable independent coordinates, or a program that fails its own check.
    """
    if formulation not in FORMULATIONS:
        raise KernelError(f"no formulation {formulation}; there are {', '.join(FORMULATIONS)}")
    if mechanism.has_friction:
        raise KernelError(f"{mechanism.name}: kernels do not support dry friction, whose force depends on the accelerations")
    analysis = study(mechanism)
    if independent is not None and (len(set(independent)) != analysis.free or not set(independent) <= set(range(mechanism.n))):
        raise KernelError(f"{mechanism.name} has {analysis.free} independent coordinates among {mechanism.n}, not {independent}")
    arguments = (open_parameters, formulation, independent, drop)
    name = _cache_name(mechanism, *arguments, ATTEMPTS) if remembered else None
    recalled = _recall(analysis, open_parameters, name)
    best = recalled or cheapest(analysis, *arguments)
    program = _write(analysis, best, baumgarte)
    error = error_of(program, mechanism)
    if recalled is None:
        if error > PRECISE and best.search != PLAIN:
            # pivots of a random search may lose digits in a large linkage; a plain attempt prefers large pivots to small ones
            with suppress(KernelError):  # the plain attempt may find no usable pivots
                plain = try_settings(best.work, [PLAIN])[0]
                other = _write(analysis, plain, baumgarte)
                other_error = error_of(other, mechanism)
                if other_error < error:
                    best, program, error = plain, other, other_error
        if name:
            user_cache.store(name, json.dumps([asdict(best.work.plan), asdict(best.search)]).encode())
    if error == math.inf:
        raise KernelError(f"{program.name}: the {program.formulation} kernel has no finite results at any checked state")
    if error > CHECKED:
        raise KernelError(f"{program.name}: the {program.formulation} kernel has a relative error of {error:.1e}")
    return program


known_program = lru_cache(maxsize=32)(generate)  # the same mechanism is often compiled under several stabilisations


def partitions(mechanism: Mechanism) -> list[tuple[int, ...]]:
    """Return choices of independent coordinates, of which at least one is usable at every sampled position."""
    return covering(study(mechanism))


def _write(analysis: Study, best: Attempt, baumgarte: tuple[float, float] | None) -> Program:
    """Repeat the elimination of the attempt `best`, and return the program that it gives."""
    work, elimination = best.work, best.work.eliminate(best.search)
    mechanism, links, graph = analysis.mechanism, work.links, work.terms.graph
    n = mechanism.n
    # residuals and energy come first: later the graph may replace a product by an expression that equals it on the constraints only
    phi, phi_dot, energy = work.checked_outputs()
    guards = elimination.guards
    a = vector(graph, elimination.acceleration(work.terms.gamma), n)
    dq = vector(graph, elimination.correction(work.residuals()), n)
    correcting = elimination.correcting  # guards that corrections need in addition to `guards`
    nearest = vector(graph, elimination.velocity([links.rate(k) for k in range(n)]), n)
    stabilized = vector(graph, elimination.acceleration(work.damped_gamma(*baumgarte)), n) if baumgarte else []
    multipliers = work.spread_multipliers(elimination.multipliers(work.terms.gamma))
    directions, direction_guards = elimination.directions  # free motions, and guards that they need in addition to `guards`
    pivots, correcting_pivots, direction_pivots = ([x for x, _ in group] for group in (guards, correcting, direction_guards))
    # the code of a step merges the functions of these outputs, which must compute a common node by the same instruction: its uses
    # in all of them are counted
    shared = uses([*a, *pivots, *dq, *nearest, *stabilized])
    size = len(links.parameters.names)
    at: Inputs = (("t", 1), ("q", n), ("v", n), ("p", size))
    moved: Inputs = (("t", 1), ("q", n), ("t_new", 1), ("q_new", n), ("p", size))

    def thresholds(group: Sequence[Guard]) -> Array:
        """Return the thresholds (guards,) times `caution`, which is above 1 if the kept rows are nearly dependent somewhere."""
        return work.caution * np.array([x for _, x in group])

    return Program(
        name=mechanism.name,
        formulation=work.plan.formulation,
        n=n,
        m=len(work.kept),
        independent=work.plan.independent,
        parameters=links.parameters.names,
        values=links.parameters.values,
        dropped=analysis.dropped_names(work.plan.drop),
        thresholds=thresholds(guards),
        acceleration=function(at, [a, pivots], shared),
        position_correction=function(moved, [dq, correcting_pivots], shared),
        nearest_velocity=function(at, [nearest, correcting_pivots], shared),
        correcting_thresholds=thresholds(correcting),
        directions=function(at, [*(vector(graph, N, n) for N in directions), direction_pivots], shared),
        direction_thresholds=thresholds(direction_guards),
        multipliers=function(at, [vector(graph, multipliers, len(work.rows))], shared),
        energy=function(at[1:], [[energy]], shared),
        residual=function(at, [phi, phi_dot], shared),
        stabilized=function(at, [stabilized, pivots], shared) if baumgarte else None,
    )


def error_of(program: Program, mechanism: Mechanism) -> float:
    """Return the largest relative error of a program at states other than the samples, on the constraints and off them.

    The program is compared with the evaluation in numpy. The error is infinite if a result is not finite, or if the program is not
    usable at any of the states on the constraints.
    """

    def accelerate(t: Array, q: Array, v: Array) -> tuple[Array, NDArray[np.bool_]]:
        """Return accelerations (k, n), and whether the program is valid at each of the k states, for t (k, 1) and q, v (k, n)."""
        # `with_lines` gives the parameters at each time: level and slope of the forces that are piecewise linear in time vary
        a, guard = program.acceleration(t, q, v, with_lines(mechanism, program.values, t[:, 0]))
        return a, np.asarray((np.abs(guard) >= program.thresholds).all(axis=1))

    def evaluate(t: float, q: Array, v: Array) -> Array:
        """Return, for one state, one vector: the residuals phi of the holonomic rows, the rates phi_dot of all rows, the energy."""
        return np.concatenate([*program.residual([t], q, v, program.values), program.energy(q, v, program.values)[0]])

    error, count = error_on_constraints(mechanism, accelerate)
    worst = float(np.max([error, error_off_constraints(mechanism, evaluate)]))  # NaN if one is NaN
    return worst if count and math.isfinite(worst) else math.inf
