"""Find the cheapest setting of every engine on a linkage, by the rules of `../search.py`: errors first, then a race.

First, every variant runs alone in a worker process, at finer and finer sizes; the list of its trials is a "ladder". Errors are the
largest errors of positions, of angles and of joint forces during the run, at 50 equidistant sample times (or fewer, if the
reference lacks samples there, or some are not ends of steps).

Then settings race. The estimated cost of a setting is the time of one step of its variant, times the number of steps; the cheap
settings are timed over whole runs, in several processes. Of a run with equal steps that would take longer than `lead`, only the
first part is timed. The processes of one linkage are not consecutive, so that a disturbance of a minute affects few of them.

Settings that the authors (owners) of an engine sent in are further variants. Their cheapest setting is always timed, because a
table compares it with the suite's.
"""

import hashlib
import json
import math
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from functools import partial
from itertools import product
from typing import Any, NamedTuple

import numpy as np

from gauss_bench.bench.clock import Measured, Row, at_least, gather_rounds, quartiles, ratio, ratio_columns, row, spread, time_of
from gauss_bench.bench.measure import reference_of
from gauss_bench.bench.search import close_to_fastest, coarsest, equal_steps, explore, finalists, nearest, pick_winner, tolerances
from gauss_bench.bench.survived import list_survivors, race_here
from gauss_bench.bench.tasks import Context, Rows, Tables, Task, gather, group_by, place_of, with_race_limit
from gauss_bench.bench.ways import (
    BEATS,
    ROUGH_ROUNDS,
    Run,
    Way,
    choice_of,
    evaluate_run,
    is_adaptive,
    loop_of,
    one_step,
    options_of,
    space,
    whole_run,
)
from gauss_bench.engines import OWN, all_names, names
from gauss_bench.engines.authors import candidates_of
from gauss_bench.engines.base import Variant
from gauss_bench.linkage.load import load
from gauss_bench.mechanism.evaluate import Evaluator
from gauss_bench.metrics import common_times
from gauss_bench.reach import UNITS, Kind, Requirement, Trial, reach, trial_of
from gauss_bench.runs.blocks import Block, Models
from gauss_bench.runs.offers import Offer, in_python, offer
from gauss_bench.runs.worker import WorkerFailure
from gauss_bench.suites.schema import Search, Suite
from gauss_bench.trajectory import Failure, Status

SKIPPED = (Kind.NO_MODEL, Kind.UNDETERMINED, Kind.NOT_TRIED)  # answers with the status "skip" in tables; others are statuses
BRIEF = 2  # number of integrators in a brief search, for engines that list no variants under `first`
Ladders = dict[Way, list[Trial]]  # variant (a `Way` whose size is 0) -> its trials, from coarse to fine
Owners = dict[Way, str]  # variant (a `Way` whose size is 0) that the authors of its engine sent in -> these authors
Place = tuple[str, str]  # linkage and scenario, as a suite names them


class Racer(NamedTuple):
    """A setting that takes part in a race.

    Attributes:
        steps: number of steps of a run with this setting; None if the engine does not count its steps.
        seconds: estimated time of the run [s]; 0 before any estimate.
    """

    way: Way
    steps: int | None
    seconds: float


def requirements(part: Search) -> list[Requirement]:
    """Return the accuracy requirements of a section of the suite, in the order of UNITS."""
    return [Requirement(kind, limit) for kind in UNITS for limit in getattr(part, kind)]


def engines_of(part: Search) -> list[Offer]:
    """Return the descriptions of the engines whose settings a section of the suite searches.

    If the section names none, these are all except RIVALS for a brief search, and all except OWN for other searches.
    """
    by_default = names() if part.brief else [x for x in all_names() if x not in OWN]
    return [offer(x) for x in part.engines or by_default]


def space_of(engine: Offer, part: Search) -> list[Variant]:
    """Return the variants of an engine that a section of the suite searches, without those that the engine's authors sent in.

    A brief search tries the variants that the engine lists under `first`. If the engine lists none, the search tries those with one
    of the first BRIEF integrators and no stabilisation, or all variants if there is none of these.
    """
    every = space(engine)
    if not part.brief:
        return every
    if engine.first:
        return [x for x in every if x.name in engine.first]
    return [x for x in every if x.stabilization == "none" and x.integrator in engine.integrators[:BRIEF]] or every


def candidates(engine: Offer, part: Search) -> list[Variant]:
    """Return all variants of an engine to be searched: those of the suite, then those that the engine's authors sent in."""
    return space_of(engine, part) + (candidates_of(engine.name, part.authors) if engine.usable else [])


def motion_of(linkage: str, scenario: str, part: Search) -> Run:
    """Return the motion of a search, which ends when the section of the suite says or, if earlier, when the scenario ends."""
    mechanism = load(linkage, scenario or None)
    return Run(linkage, mechanism, min(part.until, mechanism.duration))


def exact_tasks(suite: Suite, context: Context) -> list[Task]:
    """Return one task for each linkage, engine and variant; the task runs the variant at finer and finer sizes."""
    tasks = []
    for part, place in _races(suite):
        # these fields do not affect the trials of a variant, and are emptied so that the task's key does not depend on them
        stripped = part.model_copy(update={"linkages": {}, "engines": (), "authors": ()})
        for engine in engines_of(part):
            for variant in candidates(engine, part):
                arguments = (*place, engine.name, variant, stripped, context.store)
                owner = {"owner": variant.owner} if variant.owner else {}
                columns = name_variant(engine.name, variant) | owner
                tasks.append(context.task("search_ladder", ladder, arguments, *place, **columns))
    return tasks


def timing_tasks(suite: Suite, context: Context, tables: Tables) -> list[Task]:
    """Return a task for the first process of every race, in which all settings that met a requirement may take part."""
    # with the limit of two races: `first_race` times steps in one process, and runs in another
    return [with_race_limit(_task(context, first_race, part, place, tables), 2) for part, place in _races(suite)]


def second_timing_tasks(suite: Suite, context: Context, tables: Tables) -> list[Task]:
    """Return tasks that repeat every race in further processes, with the settings close to the fastest in the first process.

    Process k runs on all linkages before process k + 1.
    """
    tasks = []
    for number in range(1, max((part.processes for part in suite.search), default=1)):
        for part, place in _races(suite):
            if number < part.processes and _has_times(_rows_at(tables, "search_races", place)):
                tasks.append(with_race_limit(_task(context, further_race, part, place, tables, number)))
    return tasks


def _races(suite: Suite) -> list[tuple[Search, Place]]:
    """Return (section, (linkage, scenario)) for each section of the suite that searches settings, and each of its linkages."""
    return [(part, place) for part in suite.search for place in part.linkages.items()]


def _has_times(races: Rows) -> bool:
    """Tell whether any row of a race has a time."""
    return any(r["status"] == Status.OK for r in races)


def _rows_at(tables: Tables, table: str, place: Place) -> Rows:
    """Return the rows of a table that belong to a linkage and scenario."""
    wanted = place_of(load(place[0], place[1] or None))
    return [r for r in tables.get(table, []) if {k: r[k] for k in wanted} == wanted]


def _task(context: Context, function: Callable[..., Tables], part: Search, place: Place, tables: Tables, number: int = 0) -> Task:
    """Return the task of process `number` of a race; its key includes the rows on which the race depends.

    These are the linkage's rows of `search_ladder` and, for a further process (`further_race`), those of process 0 (`first_race`).
    """
    this_section = part.model_copy(update={"linkages": dict([place])})
    key_rows: list[Any] = [_rows_at(tables, "search_ladder", place)]
    if number:
        key_rows += [_rows_at(tables, "search_races", place), number]
    digest = hashlib.sha256(json.dumps(key_rows, sort_keys=True).encode()).hexdigest()
    return context.task("search_races", function, (*place, this_section, *key_rows), *place, digest, process=number)


def complete(suite: Suite, tables: Tables) -> None:
    """Add the tables of the search: cheapest settings, their times, variants that were searched, and meanings of options."""
    results = []
    for part, place in _races(suite):
        if races := _rows_at(tables, "search_races", place):
            results.append(winners_and_times(*place, part, _rows_at(tables, "search_ladder", place), races))
    tables |= gather(results)
    variants: dict[str, Rows] = {}  # engine -> rows of its variants, without duplicates if parts share engines
    knobs: Rows = []
    for part in suite.search:
        for engine in (x for x in engines_of(part) if x.usable):
            if engine.name not in variants:
                for knob, (meaning, source) in engine.knobs.items():
                    knobs.append({"engine": engine.name, "knob": knob, "meaning": meaning, "source": source})
            listed = variants.setdefault(engine.name, [])
            found = [space_row(engine, x) for x in candidates(engine, part)]
            listed += [r for r in found if r not in listed]
    if variants:
        tables |= {"search_space": [r for rows in variants.values() for r in rows], "search_knobs": knobs}


def name_variant(engine: str, variant: Variant) -> dict[str, str]:
    """Return the columns that name a variant of an engine."""
    return {"engine": engine, "settings": variant.name, "integrator": variant.integrator, "stabilization": variant.stabilization}


def space_row(engine: Offer, variant: Variant) -> Row:
    """Return the row of a variant in the table `search_space`, which lists the variants that were searched."""
    size = "tolerance" if variant.integrator in engine.adaptive else "step"
    options = json.dumps(dict(variant.options), sort_keys=True)
    return name_variant(engine.name, variant) | {"size": size, "options": options, "owner": variant.owner}


def ladder(linkage: str, scenario: str, engine: str, variant: Variant, part: Search, store: str) -> Tables:
    """Run a variant at finer and finer sizes; return a row for each run, the last with the reason why no finer size was tried.

    `store` is the folder where references are stored.
    """
    run, names = motion_of(linkage, scenario, part), name_variant(engine, variant)
    way = Way(**names, size=0.0)
    start: Row = place_of(run.mechanism) | names | {"until": run.until, "owner": variant.owner}
    adaptive = variant.integrator in offer(engine).adaptive
    reference = reference_of(linkage, scenario, run.until, store)
    # number of equidistant sample times at which errors are taken: the first for which the reference has all samples
    counts = [x for x in BEATS if common_times(reference.t, run.until / x * np.arange(x + 1))[1].all()]
    if not counts:
        reason = f"the truth has no samples at every tenth of {run.until:g} s"
        return {"search_ladder": [start | {"status": str(Status.SKIP), "message": reason, "ended": reason}]}
    sample_count, most_steps = counts[0], part.steps_of.get(engine, part.most_steps)
    sizes = tolerances() if adaptive else equal_steps(run.until, sample_count, most_steps)
    evaluator = Evaluator(run.mechanism)

    def evaluate(size: float) -> Trial:
        return evaluate_run(run, evaluator, reference, way._replace(size=size), adaptive, sample_count)

    trials, ended = explore(evaluate, sizes, requirements(part), part.budget, 0 if adaptive else most_steps)
    rows = []
    for trial in trials:
        errors = {f"{kind}_error": x for kind, x in trial.errors.items()}
        outcome = {"steps": trial.steps, "status": str(trial.status), "message": trial.message}
        rows.append(start | name_way(way._replace(size=trial.size)) | outcome | errors)
    rows[-1]["ended"] = ended
    return {"search_ladder": rows}


def read_ladders(rows: Rows) -> Ladders:
    """Return the trials of each variant, given the rows of the table `search_ladder` of one linkage."""
    groups = group_by(rows, *Way._fields[:-1])  # all but the size
    return {Way._make((*names, 0.0)): [trial_of(r) for r in same] for names, same in groups.items()}


def owners_of(rows: Rows) -> Owners:
    """Return variant -> the authors who sent it in, given rows of `search_ladder`; the suite's variants are left out."""
    return {variant_of(r): r["owner"] for r in rows if r.get("owner")}


def passing_ways(ladders: Ladders, wanted: Requirement, engine: str) -> dict[Way, Trial]:
    """Return setting -> trial: the coarsest setting that meets a requirement, of each variant of an engine that has one."""
    coarsest_trials = {way: coarsest(trials, wanted) for way, trials in ladders.items() if way.engine == engine}
    return {way._replace(size=trial.size): trial for way, trial in coarsest_trials.items() if trial}


def rivals(rows: Rows, part: Search) -> list[dict[Way, Trial]]:
    """Return groups of settings, each as a dict setting -> trial; the cheapest setting of each group is to be found.

    All settings of a group meet the same requirement, and have the same engine, the same owner and the same time loop (option
    `loop`). `rows` are the linkage's rows of the table `search_ladder`.
    """
    ladders, owners = read_ladders(rows), owners_of(rows)
    groups: list[dict[Way, Trial]] = []
    for wanted, engine in product(requirements(part), engines_of(part)):
        by_loop_and_owner: dict[tuple[str, str | None], dict[Way, Trial]] = {}
        for way, trial in passing_ways(ladders, wanted, engine.name).items():
            by_loop_and_owner.setdefault((loop_of(way), owners.get(without_size(way))), {})[way] = trial
        groups += by_loop_and_owner.values()
    return groups


def first_race(linkage: str, scenario: str, part: Search, rows: Rows) -> Tables:
    """Estimate, in one process, the cost of each setting that meets a requirement, and time the cheap settings in another.

    The estimated cost is the time of one step of the variant times the number of steps. The cheap settings are chosen separately in
    each group of `rivals`, from the rows of `search_ladder` that belong to the linkage.
    """
    run, groups = motion_of(linkage, scenario, part), rivals(rows, part)
    steps = {way: trial.steps for ways in groups for way, trial in ways.items()}
    # one step of each variant is timed, at its finest size, which is the last one in the dict and replaces the others
    finest = {without_size(way): way for way in sorted(steps, key=lambda x: -x.size)}
    step_times, lost = race_apart(run, part, [Racer(x, steps[x], 0.0) for x in finest.values()], ROUGH_ROUNDS)
    measured = gather_rounds(step_times, entry_of)
    seconds = {variant: measured.time(way) for variant, way in finest.items() if way in measured.samples}  # of one step
    costs = {way: seconds[without_size(way)] * (steps[way] or 1) for way in steps if without_size(way) in seconds}
    chosen: dict[Way, None] = {}  # each setting once, even if several groups have it
    for ways in groups:
        chosen |= dict.fromkeys(finalists({way: costs[way] for way in ways if way in costs}))
    timed, more_lost = race_apart(run, part, [Racer(x, steps[x], costs[x]) for x in chosen], part.rounds, lost, part.lead)
    return {"search_races": race_rows(run, 0, timed, lost | more_lost)}


def further_race(linkage: str, scenario: str, part: Search, rows: Rows, first: Rows, number: int) -> Tables:
    """Repeat the race in a further process, with only those settings that were close to the fastest in the first process.

    Args:
        rows: the rows of the table `search_ladder` that belong to the linkage.
        first: the rows of the race in the first process.
        number: index of this process.
    """
    run, measured = motion_of(linkage, scenario, part), gather_measured(first)
    steps: dict[Way, int | None] = {}  # number of steps of each setting that takes part again
    for trials in rivals(rows, part):
        steps |= {way: trials[way].steps for way in near_ways(trials, measured)}
    racers = [Racer(way, count, time_of(measured.of(way))) for way, count in steps.items()]
    timed, lost = race_apart(run, part, racers, part.rounds, list_lost(first), part.lead)
    return {"search_races": race_rows(run, number, timed, lost)}


def race_apart(
    run: Run, part: Search, racers: Sequence[Racer], rounds: int, lost: Collection[str] = (), lead: float | None = None
) -> tuple[Rows, dict[str, WorkerFailure]]:
    """Race settings in a new process: time runs, each for at most its first `lead` [s], or single steps if `lead` is None.

    Engines in `lost`, which crashed or hung in an earlier race, are left out. Return the rows of `race_here`, and engine ->
    failure for each engine that crashed or hung in this race.
    """
    engines = [x.name for x in engines_of(part) if x.name not in lost]
    arguments = (run.linkage, run.mechanism.scenario, run.until, [x for x in racers if x.way.engine not in lost], lead)
    timed, more_lost = list_survivors(race_here, (race_entries, arguments, rounds), engines)
    return timed, more_lost


def race_entries(
    linkage: str, scenario: str, until: float, racers: Sequence[Racer], lead: float | None
) -> Iterator[tuple[Way, Callable[[], Block]]]:
    """Yield each setting to be timed, and the function that makes its timing block: a run, or a step if `lead` is None.

    Of a run that takes longer than `lead` [s], only the first part is timed. Settings that differ only in size may share a model.
    """
    run, models = Run(linkage, load(linkage, scenario or None), until), Models()
    for x in racers:
        if lead is None:
            yield x.way, partial(one_step, run, x.way, x.steps, models)
        else:
            yield x.way, partial(whole_run, run, x.way, x.steps, x.seconds, lead, models)


def without_size(way: Way) -> Way:
    """Return the variant of a setting, as a `Way` of size 0."""
    return way._replace(size=0.0)


def near_ways(ways: Iterable[Way], measured: Measured) -> list[Way]:
    """Return the settings that may still be the fastest, given their times in the first process of a race."""
    return close_to_fastest({way: float(quartiles(measured.samples[way])[0]) for way in ways if way in measured.samples})


def race_rows(run: Run, number: int, timed: Rows, lost: Mapping[str, WorkerFailure]) -> Rows:
    """Return the rows of process `number` of a race: one for each row of `race_here`, and one for each engine that was lost."""
    start: Row = place_of(run.mechanism) | {"process": number}
    rows = []
    for r in timed:
        outcome = {k: r[k] for k in ("round", "seconds", "status", "message") if k in r}
        rows.append(start | name_way(entry_of(r)) | {"status": str(Status.OK), "message": ""} | outcome)
    return rows + [start | {"engine": engine} | failure.columns for engine, failure in lost.items()]


def winners_and_times(linkage: str, scenario: str, part: Search, ladder_rows: Rows, races: Rows) -> Tables:
    """Return up to three tables of results for a linkage, table -> rows.

    `search_winners` has the cheapest setting of each engine for each requirement, or the reason why it has none. `search_times` has
    the time of each setting that was timed. `search_owned` compares the settings of an engine's authors with those of the suite, if
    authors sent in settings. If nothing was timed, there is only `search_winners`, with the reasons.

    Args:
        ladder_rows: the rows of the table `search_ladder` that belong to the linkage.
        races: the rows of all processes of the race.
    """
    if not _has_times(races):  # only the rows of races that failed as a whole, which name no engine, are returned
        return {"search_winners": [{k: x for k, x in r.items() if k != "process"} for r in races if not r.get("engine")]}
    run, ladders, owners = motion_of(linkage, scenario, part), read_ladders(ladder_rows), owners_of(ladder_rows)
    measured, lost = gather_measured(races), list_lost(races)  # lost: engine that crashed or hung -> reason
    start: Row = place_of(run.mechanism)
    searched = [x.name for x in engines_of(part)]
    ended = [x for x in searched if x not in lost]
    winners, owned = [], []
    for wanted in requirements(part):
        requirement = start | {"required": wanted.kind, "accuracy": wanted.limit, "unit": wanted.unit}
        rows = [winner_row(requirement, wanted, engine, ladders, measured, part) for engine in ended]
        for r in rows:
            if r["status"] == Status.OK:
                way = way_of(r)
                r["in_python"] = in_python(way.engine, run.mechanism, choice_of(way, is_adaptive(way), run.until))
                r["owner"] = owners.get(without_size(way), "")
        winners += with_ratios(rows, measured, part)
        winners += [requirement | {"engine": engine} | lost[engine] for engine in lost if engine in searched]
        by_authors = [x for x in ended if any(way.engine == x for way in owners)]
        owned += [row_of_authors(requirement, wanted, engine, ladders, measured, part, owners) for engine in by_authors]
    entered = dict.fromkeys(way for way in (*measured.samples, *measured.failed) if isinstance(way, Way))
    times = [row(start | name_way(way), _time_over_processes, measured, way) for way in entered if way.engine not in lost]
    return {"search_winners": winners, "search_times": times} | ({"search_owned": owned} if owned else {})


def _time_over_processes(measured: Measured, way: Way) -> Row:
    """Return the columns of the time of a setting and of its spread, which is NaN if only one process timed it.

    Raises:
        Failure: the setting was not timed.
    """
    samples = measured.of(way)
    columns: Row = spread("seconds", samples)
    if np.isfinite(samples).any(axis=1).sum() == 1:
        columns |= {"seconds_low": math.nan, "seconds_high": math.nan}
    return columns


def list_lost(races: Rows) -> dict[str, Row]:
    """Return engine -> status and reason, for each engine that crashed or hung in a race, given the rows of the race."""
    lost = [r for r in races if r.get("engine") and r.get("integrator") is None]  # rows of whole engines name no setting
    return {r["engine"]: {"status": r["status"], "message": r["message"]} for r in lost}


def gather_measured(races: Rows) -> Measured:
    """Return the measured times of each setting in all processes of a race, given the rows of the race."""
    return gather_rounds((r for r in races if r.get("integrator") is not None), way_of)


def entry_of(r: Mapping[str, Any]) -> Way:
    """Return the setting that a row of `race_here` names in its columns."""
    return Way(*(r[x] for x in Way._fields))


def way_of(r: Mapping[str, Any]) -> Way:
    """Return the setting that a table row names; either its column `step` or its column `tolerance` is empty."""
    return variant_of(r)._replace(size=r["step"] or r["tolerance"])


def variant_of(r: Mapping[str, Any]) -> Way:
    """Return the variant that a row of a table names, as a `Way` of size 0."""
    return Way(r["engine"], r["settings"], r["integrator"], r["stabilization"], 0.0)


def name_way(way: Way) -> Row:
    """Return the columns that identify a setting: engine, settings, integrator, stabilisation, and step or tolerance."""
    columns = way._asdict()
    size = columns.pop("size")
    return columns | ({"step": None, "tolerance": size} if is_adaptive(way) else {"step": size, "tolerance": None})


def winner_row(start: Row, wanted: Requirement, engine: str, ladders: Ladders, measured: Measured, part: Search) -> Row:
    """Return an engine's row for a requirement: its winner, the cheapest setting that meets the requirement.

    If no timed setting meets the requirement, the row has the reason, and the error of the engine's most accurate setting. `start`
    has the first columns of the row, which name linkage and requirement.
    """
    searched = {way: trials for way, trials in ladders.items() if way.engine == engine}
    passing = passing_ways(searched, wanted, engine)
    columns = start | {"engine": engine, "variants": len(searched), "evaluations": sum(map(len, searched.values()))}
    columns |= {"passing": len(passing), "raced": sum(way in measured.samples for way in passing)}
    columns |= {"budget": part.budget, "most_steps": part.steps_of.get(engine, part.most_steps)}
    near = near_ways(passing, measured)
    if not near:
        return columns | row_without_winner(wanted, searched, [measured.failed[x] for x in passing if x in measured.failed])
    winner, tied = pick_winner({way: measured.samples[way] for way in near})
    columns |= name_way(winner) | {"steps": passing[winner].steps, "error": passing[winner].errors[wanted.kind], "ties": tied}
    columns["options"] = json.dumps(dict(options_of(winner)), sort_keys=True)
    columns["tied"] = ", ".join(f"{x.settings} {x.integrator} {x.stabilization}" for x in tied)
    return columns | {"status": str(Status.OK), "message": ""} | spread("seconds", measured.of(winner))


def row_of_authors(
    start: Row, wanted: Requirement, engine: str, ladders: Ladders, measured: Measured, part: Search, owners: Owners
) -> Row:
    """Return the row that compares the cheapest setting of an engine's authors with the cheapest setting of the suite.

    Both meet the same requirement. Names of columns of the suite's setting begin with `our_`. If both were timed, the row has the
    ratio of the authors' time to the suite's. `start` has the first columns, which name linkage and requirement.
    """
    theirs = winner_row(start, wanted, engine, {way: x for way, x in ladders.items() if way in owners}, measured, part)
    ours = winner_row(start, wanted, engine, {way: x for way, x in ladders.items() if way not in owners}, measured, part)
    columns = {key: x for key, x in theirs.items() if key not in ("passing", "raced", "tied", "ties")}
    columns["owner"] = ", ".join(dict.fromkeys(owner for way, owner in owners.items() if way.engine == engine))
    for key in ("settings", "integrator", "stabilization", "step", "tolerance", "error", "seconds", "variants", "message"):
        columns[f"our_{key}"] = ours.get(key)
    if theirs["status"] == Status.OK and ours["status"] == Status.OK:
        columns |= ratio_columns(measured.of(way_of(theirs)), measured.of(way_of(ours)))
    return columns


def row_without_winner(wanted: Requirement, trials: Ladders, failed: Sequence[Failure]) -> Row:
    """Return the columns of an engine without a timed setting for a requirement: the reason, and its most accurate setting.

    `failed` are the failures of the engine's settings in the race.
    """
    answer = reach(trials.values(), [wanted], str(failed[0]) if failed else "it took part in no race")
    status: Status | Kind = Status.SKIP if answer.kind in SKIPPED else answer.kind
    if answer.kind in (Kind.TIMED, Kind.UNTIMED) and failed:  # a setting is accurate enough, but failed when it was timed
        status = failed[0].status
    columns: Row = {"status": str(status), "message": answer.words}
    nearest_trials = {way: trial for way, x in trials.items() if (trial := nearest(x, wanted.kind)) is not None}
    if not nearest_trials:
        return columns
    way = min(nearest_trials, key=lambda x: nearest_trials[x].errors[wanted.kind])
    trial = nearest_trials[way]
    return columns | name_way(way._replace(size=trial.size)) | {"steps": trial.steps, "error": trial.errors[wanted.kind]}


def with_ratios(rows: Rows, measured: Measured, part: Search) -> Rows:
    """Return the rows of all engines for a requirement, with the ratio of each winner's time to that of our own fastest winner.

    Our own engines are those in `part.own`: the column "ours" marks all their rows, "own" their fastest winner. If the suite has an
    aim for the ratio (`part.aims`) at this requirement, two more columns have the aim and whether it is met.
    """
    ours = {way_of(r): r for r in rows if r["status"] == Status.OK and r["engine"] in part.own}  # winners of our own engines
    own = min(ours, key=measured.time, default=None)  # the fastest of them
    _, tied_winners = pick_winner({way: measured.of(way) for way in ours}) if ours else (None, [])  # those that tie with it
    tied_with_own = [way for winner in tied_winners for way in ours[winner]["ties"]]
    completed = []
    for r in rows:
        holds = r["status"] == Status.OK
        ratios = ratio_of(r, own, tied_with_own, measured) if own is not None and holds else {}
        aimed = holds and r["required"] == "position" and r["accuracy"] in part.aimed
        columns = {k: x for k, x in r.items() if k != "ties"} | {"own": holds and way_of(r) == own, "ours": r["engine"] in part.own}
        completed.append(at_least(columns | ratios, "ratio", part.aims.get(r["engine"]) if aimed else None))
    return completed


def ratio_of(r: Row, own: Way, fastest: Sequence[Way], measured: Measured) -> Row:
    """Return the columns of the ratio of the time of a row's winner to that of our own fastest winner `own`.

    The spread covers the spreads of all ratios of a setting that ties with the winner (the row's `ties`) to one that ties with
    `own` (`fastest`), because a repeated race may name any of these settings.
    """
    if way_of(r) == own:
        return {"ratio": 1.0, "ratio_low": 1.0, "ratio_high": 1.0}
    spreads = [ratio(measured.of(x), measured.of(y)) for x in r["ties"] for y in fastest]
    value, _, _ = ratio(measured.of(way_of(r)), measured.of(own))
    return {"ratio": value, "ratio_low": min(low for _, low, _ in spreads), "ratio_high": max(high for *_, high in spreads)}
