"""The searched best of every engine on a linkage, by `../search.py`: ladders of all variants, then one race of what passed.

Every variant is run on its own, in a worker, at sizes from coarse to fine; errors are those of positions, angles and joint forces
at every beat of the whole run, a fiftieth of it (or as near to that as the truth has samples), or where steps are longer at those
beats that they meet: at a fifth of the run or oftener, from 50 steps on at a tenth. Nothing is timed there. Then come races of all
engines: of a step of each variant that passed, which with the number of steps tells who is near the cheapest, then of whole runs
(or of their first part, where steps are equal and a run takes longer than the lead) in several processes. Those of a linkage lie
apart in time, so that what disturbs the machine for a minute is in few of them; winners are worked out from all of them together.

Settings that an engine's authors own are further variants, with the same sizes, requirements and budget. Their cheapest always
races, also where it is far from ours, so that a table shows the one beside the other.
"""

import hashlib
import json
import math
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np

from gauss_bench.bench.clock import Measured, Row, at_least, gather_rounds, quartiles, ratio, row, spread, time_of
from gauss_bench.bench.measure import reference_of
from gauss_bench.bench.search import close, coarsest, equal_steps, explore, finalists, nearest, pick_winner, tolerances
from gauss_bench.bench.survived import Entries, list_survivors, race_here
from gauss_bench.bench.tasks import Context, Rows, Tables, Task, patient, place_of
from gauss_bench.bench.ways import (
    BEATS,
    ROUGH_ROUNDS,
    Run,
    Way,
    choice_of,
    evaluate_run,
    has_samples,
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
from gauss_bench.reach import UNITS, Kind, Requirement, Trial, reach, trial_of
from gauss_bench.runs.blocks import Block, Models
from gauss_bench.runs.offers import Offer, in_python, offer
from gauss_bench.runs.worker import WorkerFailure
from gauss_bench.suites.schema import Search, Suite
from gauss_bench.trajectory import Failure, Status

SKIPPED = (Kind.NO_MODEL, Kind.UNDETERMINED, Kind.NOT_TRIED)  # have this status in tables; other kinds are their own status
BRIEF = 2  # integrators that a brief search tries of an engine that names no variants to try first
Ladders = dict[Way, list[Trial]]  # variant (a way of size 0) -> its trials, in the order of the search
Owners = dict[Way, str]  # variant that the authors of its engine own -> who they are
Asked = list[tuple[Way, int | None, float]]  # ways, each with its number of steps, if it is counted, and its estimated time [s]


def requirements(part: Search) -> list[Requirement]:
    """Return the requirements of a part, in the order of UNITS."""
    return [Requirement(kind, limit) for kind in UNITS for limit in getattr(part, kind)]


def engines_of(part: Search) -> list[Offer]:
    """Return the engines that a part of a suite searches."""
    usual = names() if part.brief else [x for x in all_names() if x not in OWN]
    return [offer(x) for x in part.engines or usual]


def space_of(engine: Offer, part: Search) -> list[Variant]:
    """Return the suite's variants of an engine that a part searches.

    A brief search tries those that the engine names first; of an engine that names none its first integrators alone.
    """
    every = space(engine)
    if not part.brief:
        return every
    if engine.first:
        return [x for x in every if x.name in engine.first]
    return [x for x in every if x.stabilization == "none" and x.integrator in engine.integrators[:BRIEF]] or every


def motion_of(linkage: str, scenario: str, part: Search) -> Run:
    """Return the motion that a part searches: to its end, or to that of the scenario if that is earlier."""
    mechanism = load(linkage, scenario or None)
    return Run(linkage, mechanism, min(part.until, mechanism.duration))


def exact_tasks(suite: Suite, context: Context) -> list[Task]:
    """Return one task, a ladder, for each linkage, engine and variant."""
    tasks = []
    for part, place in _races(suite):
        asked = part.model_copy(update={"linkages": {}, "engines": (), "authors": ()})
        for engine in engines_of(part):
            for variant in [*space_of(engine, part), *owned_by_authors(engine, part)]:
                arguments = (*place, engine.name, variant, asked, context.store)
                names = names_of(engine.name, variant) | ({"owner": variant.owner} if variant.owner else {})
                tasks.append(context.task("search_ladder", ladder, arguments, *place, **names))
    return tasks


def owned_by_authors(engine: Offer, part: Search) -> list[Variant]:
    """Return the variants that the authors of an engine own; none of an engine that cannot be used."""
    return candidates_of(engine.name, part.authors) if engine.usable else []


def timing_tasks(suite: Suite, context: Context, tables: Tables) -> list[Task]:
    """Return a task for the first process of every race; the ladders decide which ways race."""
    return [patient(_task(context, first_race, part, place, tables), 2) for part, place in _races(suite)]


def second_timing_tasks(suite: Suite, context: Context, tables: Tables) -> list[Task]:
    """Return tasks for further processes of every race, with the ways that were near the fastest in the first.

    The processes of one linkage lie apart in time: each number is run on all linkages before the next.
    """
    most = max((part.processes for part in suite.search), default=1)
    return [
        patient(_task(context, further_race, part, place, tables, number))
        for number in range(1, most)
        for part, place in _races(suite)
        if number < part.processes and _has_times(_here(tables, "search_races", place))
    ]


def _races(suite: Suite) -> list[tuple[Search, tuple[str, str]]]:
    """Return each part with each of its linkages and scenarios."""
    return [(part, place) for part in suite.search for place in part.linkages.items()]


def _has_times(races: Rows) -> bool:
    """Tell whether any way was timed."""
    return any(r["status"] == Status.OK for r in races)


def _here(tables: Tables, table: str, place: tuple[str, str]) -> Rows:
    """Return the rows of a table that belong to a linkage and scenario."""
    there = place_of(load(place[0], place[1] or None))
    return [r for r in tables.get(table, []) if {k: r[k] for k in there} == there]


def _task(
    context: Context, function: Callable[..., Tables], part: Search, place: tuple[str, str], tables: Tables, number: int = 0
) -> Task:
    """Return the task of one process of a race; its key includes the rows that it depends on."""
    only = part.model_copy(update={"linkages": dict([place])})
    known = [_here(tables, "search_ladder", place), *([_here(tables, "search_races", place), number] if number else [])]
    seen = hashlib.sha256(json.dumps(known, sort_keys=True).encode()).hexdigest()
    return context.task("search_races", function, (*place, only, *known), *place, seen, process=number)


def complete(suite: Suite, tables: Tables) -> None:
    """Add the winners and times, and the tables of what was searched and of where each option is documented."""
    for part, place in _races(suite):
        ladders, races = (_here(tables, table, place) for table in ("search_ladder", "search_races"))
        for table, rows in winners_and_times(*place, part, ladders, races).items() if races else ():
            tables.setdefault(table, []).extend(rows)
    searched = [(x, part) for part in suite.search for x in engines_of(part) if x.usable]
    engines = {x.name: x for x, _ in searched}
    if engines:
        rows = [space_row(x, variant) for x, part in searched for variant in [*space_of(x, part), *owned_by_authors(x, part)]]
        by_engine = sorted(rows, key=lambda row: [*engines].index(row["engine"]))  # which keeps the order within an engine
        tables["search_space"] = [row for k, row in enumerate(by_engine) if row not in by_engine[:k]]  # parts may share engines
        tables["search_knobs"] = [
            {"engine": x.name, "knob": name, "meaning": meaning, "source": source}
            for x in engines.values()
            for name, (meaning, source) in x.knobs.items()
        ]


def names_of(engine: str, variant: Variant) -> dict[str, str]:
    """Return the columns that name a variant."""
    names = {"engine": engine, "settings": variant.name}
    return names | {"integrator": variant.integrator, "stabilization": variant.stabilization}


def space_row(engine: Offer, variant: Variant) -> Row:
    """Return the row of a variant in the table of what was searched."""
    size = "tolerance" if variant.integrator in engine.adaptive else "step"
    options = json.dumps(dict(variant.options), sort_keys=True)
    return names_of(engine.name, variant) | {"size": size, "options": options, "owner": variant.owner}


# Ladders: the sizes that meet a requirement; no timing affects them


def ladder(linkage: str, scenario: str, engine: str, variant: Variant, part: Search, store: str) -> Tables:
    """Return a row for every evaluation of a variant; the last one has the reason why the search ended."""
    run = motion_of(linkage, scenario, part)
    names = names_of(engine, variant)
    way = Way(**names, size=0.0)
    start: Row = place_of(run.mechanism) | names | {"until": run.until, "owner": variant.owner}
    adaptive = variant.integrator in offer(engine).adaptive
    truth = reference_of(linkage, scenario, run.until, store)
    beats = next((x for x in BEATS if has_samples(truth, run.until, x)), None)
    if beats is None:
        reason = f"the truth has no samples at every tenth of {run.until:g} s"
        return {"search_ladder": [start | {"status": str(Status.SKIP), "message": reason, "ended": reason}]}
    most_steps = part.steps_of.get(engine, part.most_steps)
    scale = tolerances() if adaptive else equal_steps(run.until, beats, most_steps)
    judge, most = Evaluator(run.mechanism), 0 if adaptive else most_steps

    def evaluate(size: float) -> Trial:
        return evaluate_run(run, judge, truth, way._replace(size=size), adaptive, beats)

    trials, ended = explore(evaluate, scale, requirements(part), part.budget, most)
    rows = []
    for trial in trials:
        errors = {f"{kind}_error": x for kind, x in trial.errors.items()}
        outcome = {"steps": trial.steps, "status": str(trial.status), "message": trial.message}
        rows.append(start | place(way._replace(size=trial.size)) | outcome | errors)
    rows[-1]["ended"] = ended
    return {"search_ladder": rows}


def read_ladders(rows: Sequence[Row]) -> Ladders:
    """Return the ladders that the rows of a linkage describe."""
    ladders: Ladders = {}
    for r in rows:
        ladders.setdefault(variant_of(r), []).append(trial_of(r))
    return ladders


def owners_of(rows: Rows) -> Owners:
    """Return the variants (ways of size 0) that belong to the authors of their engine, by the rows of a ladder."""
    return {variant_of(r): r["owner"] for r in rows if r.get("owner")}


def passing_ways(ladders: Ladders, wanted: Requirement, engine: str) -> dict[Way, Trial]:
    """Return way -> trial: each variant of an engine that meets a requirement, at the coarsest size that does."""
    ways: dict[Way, Trial] = {}
    for variant, trials in ladders.items():
        if variant.engine == engine and (trial := coarsest(trials, wanted)):
            ways[variant._replace(size=trial.size)] = trial
    return ways


def rivals(rows: Rows, part: Search) -> list[dict[Way, Trial]]:
    """Return the ways that race for one prize: those of one engine, owner and time loop that meet a requirement.

    `rows` are the ladders of a linkage.
    """
    ladders, owners = read_ladders(rows), owners_of(rows)
    groups: list[dict[Way, Trial]] = []
    for wanted in requirements(part):
        for engine in engines_of(part):
            by_prize: dict[tuple[str, str], dict[Way, Trial]] = {}
            for way, trial in passing_ways(ladders, wanted, engine.name).items():
                by_prize.setdefault((loop_of(way), owner_of(way, owners)), {})[way] = trial
            groups += by_prize.values()
    return groups


# The race: the cheapest of the ways that meet a requirement


def first_race(linkage: str, scenario: str, part: Search, rows: Rows) -> Tables:
    """Estimate the costs of the ways that meet a requirement in one process, and race the cheap ones in another.

    `rows` are the ladders of the linkage.
    """
    run, groups = motion_of(linkage, scenario, part), rivals(rows, part)
    steps = {way: trial.steps for ways in groups for way, trial in ways.items()}
    finest = {way._replace(size=0.0): way for way in sorted(steps, key=lambda x: -x.size)}
    rough, lost = race_apart(rough_entries, run, part, [(x, steps[x], 0.0) for x in finest.values()], ROUGH_ROUNDS)
    seconds = {variant: time_of(x) for variant, x in gather_rounds(rough, entry_of).samples.items()}
    costs = {way: seconds[way._replace(size=0.0)] * (steps[way] or 1) for way in steps if way._replace(size=0.0) in seconds}
    chosen: dict[Way, None] = {}
    for ways in groups:
        chosen |= dict.fromkeys(finalists({way: costs[way] for way in ways if way in costs}))
    asked = [(x, steps[x], costs[x]) for x in chosen]
    rows_of_race, more = race_apart(race_entries, run, part, asked, part.rounds, lost, part.lead)
    return {"search_races": race_rows(run, 0, rows_of_race, lost | more)}


def further_race(linkage: str, scenario: str, part: Search, rows: Rows, first: Rows, number: int) -> Tables:
    """Race the ways that may still win in one more process; `rows` are the ladders, `first` the rows of the first process."""
    run, measured = motion_of(linkage, scenario, part), gather_measured(first)
    near = {way: ways[way].steps for ways in rivals(rows, part) for way in near_ways(ways, measured)}
    asked = [(way, steps, time_of(measured.of(way))) for way, steps in near.items()]
    rows_of_race, lost = race_apart(race_entries, run, part, asked, part.rounds, list_lost(first), part.lead)
    return {"search_races": race_rows(run, number, rows_of_race, lost)}


def race_apart(
    entries: Entries, run: Run, part: Search, asked: Asked, rounds: int, lost: Collection[str] = (), *more: float
) -> tuple[Rows, dict[str, WorkerFailure]]:
    """Race ways in a new process, without the engines in `lost`; return its rows, and the engines that crash or hang in it."""
    names = [x.name for x in engines_of(part) if x.name not in lost]
    left = [x for x in asked if x[0].engine not in lost]
    arguments = (run.linkage, run.mechanism.scenario, run.until, left, *more)
    rows_of_race, gone = list_survivors(race_here, (entries, arguments, rounds), names)
    return rows_of_race, gone


def rough_entries(linkage: str, scenario: str, until: float, asked: Asked) -> Iterator[tuple[Way, Callable[[], Block]]]:
    """Yield each way, without its size, and a function that times one step of it at the size that is asked."""
    run = Run(linkage, load(linkage, scenario or None), until)
    for way, steps, _ in asked:
        yield way._replace(size=0.0), partial(one_step, run, way, steps, {})


def race_entries(linkage: str, scenario: str, until: float, asked: Asked, lead: float) -> Iterator[tuple[Way, Callable[[], Block]]]:
    """Yield whole runs of ways, or first parts of long ones; ways of one variant may share a model."""
    run, models = Run(linkage, load(linkage, scenario or None), until), Models()
    for way, steps, cost in asked:
        yield way, partial(whole_run, run, way, steps, cost, lead, models)


def owner_of(way: Way, owners: Owners) -> str:
    """Return the authors who own the variant of a way, or an empty text if it is the suite's."""
    return owners.get(way._replace(size=0.0), "")


def near_ways(ways: Iterable[Way], measured: Measured) -> list[Way]:
    """Return the ways that may be the fastest, judged by the first process."""
    return close({w: float(quartiles(measured.samples[w])[0]) for w in ways if w in measured.samples})


def race_rows(run: Run, number: int, rows_of_race: Rows, lost: Mapping[str, WorkerFailure]) -> Rows:
    """Return the rows of one process of a race, and one for each engine that crashed or hung in it."""
    start: Row = place_of(run.mechanism) | {"process": number}
    rows = []
    for r in rows_of_race:
        answer = {k: r[k] for k in ("round", "seconds", "status", "message") if k in r}
        rows.append(start | place(entry_of(r)) | {"status": str(Status.OK), "message": ""} | answer)
    return rows + [start | {"engine": e} | failure.columns for e, failure in lost.items()]


def winners_and_times(linkage: str, scenario: str, part: Search, ladder_rows: Rows, races: Rows) -> Tables:
    """Return the winner of every engine for every requirement, and the times of all ways that raced.

    An engine that crashed or hung in one of the processes has a row with the reason instead of a winner.
    """
    if not _has_times(races):
        return {"search_winners": [{k: x for k, x in r.items() if k != "process"} for r in races if not r.get("engine")]}
    run, ladders, owners = motion_of(linkage, scenario, part), read_ladders(ladder_rows), owners_of(ladder_rows)
    measured, lost = gather_measured(races), list_lost(races)
    start: Row = place_of(run.mechanism)
    searched = [x.name for x in engines_of(part)]
    ended = [x for x in searched if x not in lost]
    winners, owned = [], []
    for wanted in requirements(part):
        asked = start | {"required": wanted.kind, "accuracy": wanted.limit, "unit": wanted.unit}
        lines = [winner_row(asked, wanted, engine, ladders, measured, part) for engine in ended]
        for line in (x for x in lines if x["status"] == Status.OK):
            way = way_of(line)
            line["in_python"] = in_python(way.engine, run.mechanism, choice_of(way, is_adaptive(way), run.until))
            line["owner"] = owner_of(way, owners)
        winners += with_ratios(lines, measured, part)
        winners += [asked | {"engine": engine} | lost[engine] for engine in lost if engine in searched]
        by_authors = [x for x in ended if any(way.engine == x for way in owners)]
        owned += [row_of_authors(asked, wanted, engine, ladders, measured, part, owners) for engine in by_authors]
    entered = dict.fromkeys(way for way in (*measured.samples, *measured.failed) if isinstance(way, Way))
    times = [row(start | place(way), _time_over_processes, measured, way) for way in entered if way.engine not in lost]
    return {"search_winners": winners, "search_times": times} | ({"search_owned": owned} if owned else {})


def _time_over_processes(measured: Measured, way: Way) -> Row:
    """Return the columns of a time and its spread; the spread is NaN where only one process ran the way.

    Raises:
        Failure: it was not measured.
    """
    samples = measured.of(way)
    columns: Row = spread("seconds", samples)
    if np.isfinite(samples).any(axis=1).sum() == 1:
        columns |= {"seconds_low": math.nan, "seconds_high": math.nan}
    return columns


def list_lost(races: Rows) -> dict[str, Row]:
    """Return engine -> status and reason, for those that crashed or hung in a race."""
    return {r["engine"]: {k: r[k] for k in ("status", "message")} for r in races if r.get("engine") and r.get("integrator") is None}


def gather_measured(races: Rows) -> Measured:
    """Return the times of the ways over the processes of a race."""
    return gather_rounds((r for r in races if r.get("integrator") is not None), way_of)


def entry_of(r: Mapping[str, Any]) -> Way:
    """Return the way that a row of `race_here` names."""
    return Way(*(r[x] for x in Way._fields))


def way_of(r: Mapping[str, Any]) -> Way:
    """Return the way that a row of a table names."""
    return variant_of(r)._replace(size=r["step"] or r["tolerance"])


def variant_of(r: Mapping[str, Any]) -> Way:
    """Return the variant, a way of size 0, that a row of a table names."""
    return Way(r["engine"], r["settings"], r["integrator"], r["stabilization"], 0.0)


def place(way: Way) -> Row:
    """Return the columns that name a way."""
    columns = way._asdict()
    size = columns.pop("size")
    return columns | ({"step": None, "tolerance": size} if is_adaptive(way) else {"step": size, "tolerance": None})


def winner_row(start: Row, wanted: Requirement, engine: str, ladders: Ladders, measured: Measured, part: Search) -> Row:
    """Return an engine's row for a requirement: its winner among the ways that meet it, or how near it came and why it failed."""
    searched = {way: trials for way, trials in ladders.items() if way.engine == engine}
    passing = passing_ways(searched, wanted, engine)
    columns = start | {"engine": engine, "variants": len(searched), "evaluations": sum(map(len, searched.values()))}
    columns |= {"passing": len(passing), "raced": sum(way in measured.samples for way in passing)}
    columns |= {"budget": part.budget, "most_steps": part.steps_of.get(engine, part.most_steps)}
    near = near_ways(passing, measured)
    if not near:
        return columns | row_without_winner(wanted, searched, [measured.failed[x] for x in passing if x in measured.failed])
    winner, tied = pick_winner({way: measured.samples[way] for way in near})
    columns |= place(winner) | {"steps": passing[winner].steps, "error": passing[winner].errors[wanted.kind], "ties": tied}
    columns["options"] = json.dumps(dict(options_of(winner)), sort_keys=True)
    columns["tied"] = ", ".join(f"{x.settings} {x.integrator} {x.stabilization}" for x in tied)
    return columns | {"status": str(Status.OK), "message": ""} | spread("seconds", measured.of(winner))


def row_of_authors(
    start: Row, wanted: Requirement, engine: str, ladders: Ladders, measured: Measured, part: Search, owners: Owners
) -> Row:
    """Return the cheapest setting that the authors of an engine own, beside the suite's cheapest for the same requirement."""
    theirs = winner_row(start, wanted, engine, {x: y for x, y in ladders.items() if x in owners}, measured, part)
    ours = winner_row(start, wanted, engine, {x: y for x, y in ladders.items() if x not in owners}, measured, part)
    found = {key: x for key, x in theirs.items() if key not in ("passing", "raced", "tied", "ties")}
    found["owner"] = ", ".join(dict.fromkeys(x for way, x in owners.items() if way.engine == engine))
    for key in ("settings", "integrator", "stabilization", "step", "tolerance", "error", "seconds", "variants", "message"):
        found[f"our_{key}"] = ours.get(key)
    if theirs["status"] == Status.OK and ours["status"] == Status.OK:
        times = ratio(measured.of(way_of(theirs)), measured.of(way_of(ours)))
        found |= dict(zip(("ratio", "ratio_low", "ratio_high"), times, strict=True))
    return found


def row_without_winner(wanted: Requirement, trials: Ladders, failed: Sequence[Failure]) -> Row:
    """Return the columns of an engine without a winner: the reason, and the way with the least error."""
    found = reach(trials.values(), [wanted], str(failed[0]) if failed else "no race took it in")
    status = failed[0].status if found.holds and failed else Status.SKIP if found.kind in SKIPPED else found.kind
    columns: Row = {"status": str(status), "message": found.words}
    every = [(way, trial) for way, x in trials.items() if (trial := nearest(x, wanted.kind)) is not None]
    if not every:
        return columns
    way, trial = min(every, key=lambda x: x[1].errors[wanted.kind])
    return columns | place(way._replace(size=trial.size)) | {"steps": trial.steps, "error": trial.errors[wanted.kind]}


def with_ratios(rows: Rows, measured: Measured, part: Search) -> Rows:
    """Add to the rows of a requirement the ratios of their times to that of the cheapest own way.

    The spread of a ratio covers all ways that tie with either, because a second race may name another of them.
    """
    ended = [r for r in rows if r["status"] == Status.OK]
    ours = {way_of(r): r for r in ended if r["engine"] in part.own}
    level = pick_winner({way: measured.of(way) for way in ours})[1] if ours else []
    own = min(ours, key=measured.time, default=None)  # the one with the least time
    fastest = [way for x in level for way in ours[x]["ties"]]
    completed = []
    for r in rows:
        holds = r["status"] == Status.OK
        ratios = ratio_of(r, own, fastest, measured) if own is not None and holds else {}
        aimed = r["status"] == Status.OK and r["required"] == "position" and r["accuracy"] in part.aimed
        plain = {k: x for k, x in r.items() if k != "ties"} | {"own": holds and way_of(r) == own, "ours": r["engine"] in part.own}
        completed.append(at_least(plain | ratios, "ratio", part.aims.get(r["engine"]) if aimed else None))
    return completed


def ratio_of(r: Row, own: Way, fastest: Sequence[Way], measured: Measured) -> Row:
    """Return the ratio of a winner's time to that of the cheapest own way; its spread covers all that tie with either."""
    if way_of(r) == own:
        return {"ratio": 1.0, "ratio_low": 1.0, "ratio_high": 1.0}
    spreads = [ratio(measured.of(x), measured.of(y)) for x in r["ties"] for y in fastest]
    value = ratio(measured.of(way_of(r)), measured.of(own))[0]
    return {"ratio": value, "ratio_low": min(x[1] for x in spreads), "ratio_high": max(x[2] for x in spreads)}
