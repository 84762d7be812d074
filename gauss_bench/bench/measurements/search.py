"""The searched best of every engine on a linkage, by `../search.py`: ladders of all variants, then one race of what passed.

Every variant is run on its own, in a worker, at sizes from coarse to fine; errors are those of positions, angles and joint forces
at every beat of the whole run, a fiftieth of it (or as near to that as the truth has samples), or where steps are longer at those
beats that they meet: at a fifth of the run or oftener, from 50 steps on at a tenth. Nothing is timed there. Then come races of all
engines: of a step of each variant that passed, which with the number of steps tells who is near the cheapest, then of whole runs
(or of their first part, where steps are equal and a run takes longer than the lead) in several processes. Those of a linkage lie
apart in time, so that what disturbs the machine for a minute is in few of them; winners are worked out from all of them together.
"""

import hashlib
import json
import math
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from functools import lru_cache, partial
from pathlib import Path
from typing import Any

import numpy as np

from gauss_bench.bench.clock import Block, Measured, Missing, Row, at_least, gather_rounds, quartiles, ratio, row, spread, time_of
from gauss_bench.bench.search import close, coarsest, equal_steps, explore, finalists, nearest, pick_winner, tolerances
from gauss_bench.bench.survived import Entries, list_survivors, race_here
from gauss_bench.bench.tasks import Context, Rows, Tables, Task, patient, place_of
from gauss_bench.bench.ways import (
    BEATS,
    ROUGH_ROUNDS,
    Models,
    Run,
    Way,
    choice_of,
    evaluate_run,
    has_samples,
    is_adaptive,
    loop_of,
    one_step,
    space,
    whole_run,
)
from gauss_bench.engines import OWN, all_names, get
from gauss_bench.engines.base import Variant
from gauss_bench.linkage.load import load
from gauss_bench.mechanism.evaluate import Evaluator
from gauss_bench.reach import UNITS, Kind, Requirement, Trial, reach, trial_of
from gauss_bench.reference.store import load_stored
from gauss_bench.runs.offers import Offer, in_python, offer
from gauss_bench.runs.worker import WorkerFailure
from gauss_bench.suites.schema import Search, Suite
from gauss_bench.trajectory import Reference, Status

STATUSES = dict.fromkeys((Kind.NO_MODEL, Kind.UNDETERMINED, Kind.NOT_TRIED), Status.SKIP)  # of tables; others by their own names
Ladders = dict[Way, list[Trial]]  # trials of every variant, a way of size 0, in the order in which they were searched
Asked = list[tuple[Way, int, float]]  # ways with their steps, and how many seconds they may take


def requirements(part: Search) -> list[Requirement]:
    return [Requirement(kind, limit) for kind in UNITS for limit in getattr(part, kind)]


def search_linkage(part: Search) -> list[Offer]:
    """The engines of a part that can be asked."""
    return [offer(x) for x in part.engines or (x for x in all_names() if x not in OWN)]


def over(linkage: str, scenario: str, part: Search) -> Run:
    mechanism = load(linkage, scenario or None)
    return Run(linkage, mechanism, min(part.until, mechanism.duration))


def exact_tasks(suite: Suite, context: Context) -> list[Task]:
    """One ladder for each linkage, engine and variant."""
    tasks = []
    for part, place in _races(suite):
        asked = part.model_copy(update={"linkages": {}, "engines": ()})
        for engine in search_linkage(part):
            for variant in space(engine):
                arguments = (*place, engine.name, variant, asked, context.store)
                tasks.append(context.task("search_ladder", ladder, arguments, *place, **names_of(engine.name, variant)))
    return tasks


def timing_tasks(suite: Suite, context: Context, tables: Tables) -> list[Task]:
    """The first process of every race: what is worth it, given the ladders, and its times."""
    return [patient(_task(context, first_race, part, place, tables), 2) for part, place in _races(suite)]


def second_timing_tasks(suite: Suite, context: Context, tables: Tables) -> list[Task]:
    """The further processes, of what the first one found to be near the fastest; each goes over all linkages before the next."""
    most = max((part.processes for part in suite.search), default=1)
    return [
        patient(_task(context, further_race, part, place, tables, number))
        for number in range(1, most)
        for part, place in _races(suite)
        if number < part.processes and _has_times(_here(tables, "search_races", place))
    ]


def _races(suite: Suite) -> list[tuple[Search, tuple[str, str]]]:
    return [(part, place) for part in suite.search for place in part.linkages.items()]


def _has_times(races: Rows) -> bool:
    return any(r["status"] == Status.OK for r in races)


def _here(tables: Tables, table: str, place: tuple[str, str]) -> Rows:
    """The rows of a table that are of a linkage."""
    there = place_of(load(place[0], place[1] or None))
    return [r for r in tables.get(table, []) if {k: r[k] for k in there} == there]


def _task(
    context: Context, function: Callable[..., Tables], part: Search, place: tuple[str, str], tables: Tables, number: int = 0
) -> Task:
    """One process of a race, which depends on what was found before."""
    only = part.model_copy(update={"linkages": dict([place])})
    known = [_here(tables, "search_ladder", place), *([_here(tables, "search_races", place), number] if number else [])]
    seen = hashlib.sha256(json.dumps(known, sort_keys=True).encode()).hexdigest()
    return context.task("search_races", function, (*place, only, *known), *place, seen, process=number)


def complete(suite: Suite, tables: Tables) -> None:
    """Fill in winners and times, write down what was searched, and where every knob comes from."""
    for part, place in _races(suite):
        ladders, races = (_here(tables, table, place) for table in ("search_ladder", "search_races"))
        for table, rows in race_found(*place, part, ladders, races).items() if races else ():
            tables.setdefault(table, []).extend(rows)
    engines = {x.name: x for part in suite.search for x in search_linkage(part) if x.usable}
    if engines:
        tables["search_space"] = [space_row(x, variant) for x in engines.values() for variant in space(x)]
        tables["search_knobs"] = [
            {"engine": x, "knob": k.name, "meaning": k.meaning, "source": k.source}
            for x in engines
            for k in getattr(get(x), "knobs", {}).values()  # an engine without a file of variants has none but its settings
        ]


def names_of(engine: str, variant: Variant) -> dict[str, str]:
    """The columns that name a variant."""
    names = {"engine": engine, "settings": variant.name}
    return names | {"integrator": variant.integrator, "stabilization": variant.stabilization}


def space_row(engine: Offer, variant: Variant) -> Row:
    size = "tolerance" if variant.integrator in engine.adaptive else "step"
    return names_of(engine.name, variant) | {"size": size, "options": json.dumps(dict(variant.options), sort_keys=True)}


# Ladders: what passes, without a clock


@lru_cache(maxsize=4)
def reference_of(linkage: str, scenario: str, until: float, store: str) -> Reference:
    return load_stored(load(linkage, scenario or None), until, Path(store))


def ladder(linkage: str, scenario: str, engine: str, variant: Variant, part: Search, store: str) -> Tables:
    """A row for every evaluation of a variant; the last one tells why there are no more."""
    run = over(linkage, scenario, part)
    names = names_of(engine, variant)
    way = Way(**names, size=0.0)
    start: Row = place_of(run.mechanism) | names | {"until": run.until}
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
        told = {"steps": trial.steps, "status": str(trial.status), "message": trial.message}
        rows.append(start | place(way._replace(size=trial.size)) | told | errors)
    rows[-1]["ended"] = ended
    return {"search_ladder": rows}


def read_ladders(rows: Sequence[Row]) -> Ladders:
    """Read the ladders of a linkage."""
    ladders: Ladders = {}
    for r in rows:
        variant = Way(r["engine"], r["settings"], r["integrator"], r["stabilization"], 0.0)
        ladders.setdefault(variant, []).append(trial_of(r))
    return ladders


def passing_ways(ladders: Ladders, part: Search) -> dict[tuple[Requirement, str], dict[Way, Trial]]:
    """For every requirement and engine what is exact enough: each variant at the largest size that is, in their order."""
    found: dict[tuple[Requirement, str], dict[Way, Trial]] = {
        (w, e.name): {} for w in requirements(part) for e in search_linkage(part)
    }
    for (wanted, engine), ways in found.items():
        for variant, trials in ladders.items():
            trial = coarsest(trials, wanted)
            if trial and variant.engine == engine:
                ways[variant._replace(size=trial.size)] = trial
    return found


# The race: what is cheapest


def first_race(linkage: str, scenario: str, part: Search, rows: Rows) -> Tables:
    """Times of everything worth a race, after another process has estimated costs; `rows` are the ladders of the linkage."""
    run, passing = over(linkage, scenario, part), passing_ways(read_ladders(rows), part)
    steps = {way: trial.steps for ways in passing.values() for way, trial in ways.items()}
    finest = {way._replace(size=0.0): way for way in sorted(steps, key=lambda x: -x.size)}
    rough, lost = race_apart(rough_entries, run, part, [(x, steps[x], 0.0) for x in finest.values()], ROUGH_ROUNDS)
    seconds = {variant: time_of(x) for variant, x in gather_rounds(rough, entry_of).samples.items()}
    costs = {way: seconds[way._replace(size=0.0)] * steps[way] for way in steps if way._replace(size=0.0) in seconds}
    chosen: dict[Way, None] = {}
    for ways in passing.values():
        for some in by_loop(ways):
            chosen |= dict.fromkeys(finalists({way: costs[way] for way in some if way in costs}))
    told, more = race_apart(race_entries, run, part, [(x, steps[x], costs[x]) for x in chosen], part.rounds, lost, part.lead)
    return {"search_races": race_rows(run, 0, told, lost | more)}


def further_race(linkage: str, scenario: str, part: Search, rows: Rows, first: Rows, number: int) -> Tables:
    """Times in one more process, of what may still win by those of the first."""
    run, measured = over(linkage, scenario, part), gather_measured(first)
    near: dict[Way, int] = {}
    for ways in passing_ways(read_ladders(rows), part).values():
        near |= {way: ways[way].steps for some in by_loop(ways) for way in near_ways(some, measured)}
    asked = [(way, steps, time_of(measured.of(way))) for way, steps in near.items()]
    told, lost = race_apart(race_entries, run, part, asked, part.rounds, list_lost(first), part.lead)
    return {"search_races": race_rows(run, number, told, lost)}


def race_apart(
    entries: Entries, run: Run, part: Search, asked: Asked, rounds: int, lost: Collection[str] = (), *more: float
) -> tuple[Rows, dict[str, WorkerFailure]]:
    """Race ways in a new process, without engines that were lost before: its rows, and the engines that crash or hang in it."""
    names = [x.name for x in search_linkage(part) if x.name not in lost]
    left = [x for x in asked if x[0].engine not in lost]
    arguments = (run.linkage, run.mechanism.scenario, run.until, left, *more)
    told, gone = list_survivors(race_here, (entries, arguments, rounds), names)
    return told, gone


def rough_entries(linkage: str, scenario: str, until: float, asked: Asked) -> Iterator[tuple[Way, Callable[[], Block]]]:
    """A step of every variant, by the way of it that is asked for."""
    run = Run(linkage, load(linkage, scenario or None), until)
    for way, steps, _ in asked:
        yield way._replace(size=0.0), partial(one_step, run, way, steps, {})


def race_entries(linkage: str, scenario: str, until: float, asked: Asked, lead: float) -> Iterator[tuple[Way, Callable[[], Block]]]:
    """Whole runs of ways, or their first parts; ways of one variant may share a model."""
    run, models = Run(linkage, load(linkage, scenario or None), until), Models()
    for way, steps, cost in asked:
        yield way, partial(whole_run, run, way, steps, cost, lead, models)


def by_loop(ways: Iterable[Way]) -> list[list[Way]]:
    """Return the ways of an engine apart by who runs the loop: the cheapest of each is raced."""
    loops: dict[str, list[Way]] = {}
    for way in ways:
        loops.setdefault(loop_of(way), []).append(way)
    return [*loops.values()]


def near_ways(ways: Iterable[Way], measured: Measured) -> list[Way]:
    """Those of them that may be the fastest, by the first process."""
    return close({w: float(quartiles(measured.samples[w])[0]) for w in ways if w in measured.samples})


def race_rows(run: Run, number: int, told: Rows, lost: Mapping[str, WorkerFailure]) -> Rows:
    """Rows of one process of a race, and the engines that were lost in it."""
    start: Row = place_of(run.mechanism) | {"process": number}
    rows = []
    for r in told:
        answer = {k: r[k] for k in ("round", "seconds", "status", "message") if k in r}
        rows.append(start | place(entry_of(r)) | {"status": str(Status.OK), "message": ""} | answer)
    return rows + [start | {"engine": e} | failure.columns for e, failure in lost.items()]


def race_found(linkage: str, scenario: str, part: Search, ladder_rows: Rows, races: Rows) -> Tables:
    """Winners of every engine for every requirement, and the times of all that was raced.

    An engine that crashed or hung in one of the processes has that reason in the place of a winner.
    """
    if not _has_times(races):
        return {"search_winners": [{k: x for k, x in r.items() if k != "process"} for r in races if not r.get("engine")]}
    run, ladders = over(linkage, scenario, part), read_ladders(ladder_rows)
    measured, lost = gather_measured(races), list_lost(races)
    start: Row = place_of(run.mechanism)
    passing, winners = passing_ways(ladders, part), []
    for wanted in requirements(part):
        engines = {engine: ways for (w, engine), ways in passing.items() if w == wanted}
        asked = start | {"required": wanted.kind, "accuracy": wanted.limit, "unit": wanted.unit}
        lines = [winner_row(asked, wanted, e, ways, ladders, measured, part) for e, ways in engines.items() if e not in lost]
        for line in (x for x in lines if x["status"] == Status.OK):
            way = way_of(line)
            line["in_python"] = in_python(way.engine, run.mechanism, choice_of(way, is_adaptive(way), run.until))
        winners += with_ratios(lines, measured, part) + [asked | {"engine": e} | told for e, told in lost.items() if e in engines]
    entered = dict.fromkeys(way for way in (*measured.samples, *measured.failed) if isinstance(way, Way))
    times = [row(start | place(way), _time_over_processes, measured, way) for way in entered if way.engine not in lost]
    return {"search_winners": winners, "search_times": times}


def _time_over_processes(measured: Measured, way: Way) -> Row:
    """A time and its spread, which one process does not tell.

    Raises:
        Missing: it was not measured.
    """
    samples = measured.of(way)
    told: Row = spread("seconds", samples)
    alone = np.isfinite(samples).any(axis=1).sum() == 1
    return told | {"seconds_low": math.nan, "seconds_high": math.nan} if alone else told


def list_lost(races: Rows) -> dict[str, Row]:
    """Engine -> why it was lost in a race."""
    return {r["engine"]: {k: r[k] for k in ("status", "message")} for r in races if r.get("engine") and r.get("integrator") is None}


def gather_measured(races: Rows) -> Measured:
    """Gather what the processes of a race measured."""
    return gather_rounds((r for r in races if r.get("integrator") is not None), way_of)


def entry_of(r: Mapping[str, Any]) -> Way:
    """The way that a row of `race_here` is about."""
    return Way(*(r[x] for x in Way._fields))


def way_of(r: Mapping[str, Any]) -> Way:
    """The way that a row of a table is about."""
    return Way(r["engine"], r["settings"], r["integrator"], r["stabilization"], r["step"] or r["tolerance"])


def place(way: Way) -> Row:
    """A way as columns of a table."""
    columns = way._asdict()
    size = columns.pop("size")
    return columns | ({"step": None, "tolerance": size} if is_adaptive(way) else {"step": size, "tolerance": None})


def winner_row(
    start: Row,
    wanted: Requirement,
    engine: str,
    passing: Mapping[Way, Trial],
    ladders: Ladders,
    measured: Measured,
    part: Search,
) -> Row:
    """An engine's winner for a requirement, of the ways that are `passing`; without one, how near it came and why no further."""
    searched = {way: trials for way, trials in ladders.items() if way.engine == engine}
    told = start | {"engine": engine, "variants": len(searched), "evaluations": sum(map(len, searched.values()))}
    told |= {"passing": len(passing), "raced": sum(way in measured.samples for way in passing)}
    told |= {"budget": part.budget, "most_steps": part.steps_of.get(engine, part.most_steps)}
    near = near_ways(passing, measured)
    if not near:
        return told | not_won(wanted, searched, [measured.failed[x] for x in passing if x in measured.failed])
    winner, tied = pick_winner({way: measured.samples[way] for way in near})
    options = next((x.options for x in space(offer(engine)) if x.name == winner.settings), {})
    told |= place(winner) | {"steps": passing[winner].steps, "error": passing[winner].errors[wanted.kind], "ties": tied}
    told |= {
        "options": json.dumps(dict(options), sort_keys=True),
        "tied": ", ".join(f"{x.settings} {x.integrator} {x.stabilization}" for x in tied),
    }
    return told | {"status": str(Status.OK), "message": ""} | spread("seconds", measured.of(winner))


def not_won(wanted: Requirement, trials: Ladders, failed: Sequence[Missing]) -> Row:
    """Return the columns of an engine without a winner: the answer, and how near it came."""
    found = reach(trials.values(), [wanted], str(failed[0]) if failed else "no race took it in")
    status = failed[0].status if found.holds and failed else STATUSES.get(found.kind, found.kind)
    told: Row = {"status": str(status), "message": found.words}
    every = [(way, trial) for way, x in trials.items() if (trial := nearest(x, wanted.kind)) is not None]
    if not every:
        return told
    way, trial = min(every, key=lambda x: x[1].errors[wanted.kind])
    return told | place(way._replace(size=trial.size)) | {"steps": trial.steps, "error": trial.errors[wanted.kind]}


def with_ratios(rows: Rows, measured: Measured, part: Search) -> Rows:
    """The rows of a requirement with their time over that of the cheapest own way; of own ways that tie it is the first.

    The spread covers whatever ties with either: a second race may name another of them.
    """
    ended = [r for r in rows if r["status"] == Status.OK]
    ours = {way_of(r): r for r in ended if r["engine"] in part.own}
    level = pick_winner({way: measured.of(way) for way in ours})[1] if ours else []
    own = min(ours, key=measured.time, default=None)  # the cheaper, whatever ties with it
    fastest = [way for x in level for way in ours[x]["ties"]]
    told = []
    for r in rows:
        holds = r["status"] == Status.OK
        ratios = ratio_of(r, own, fastest, measured) if own is not None and holds else {}
        aimed = r["status"] == Status.OK and r["required"] == "position" and r["accuracy"] in part.aimed
        plain = {k: x for k, x in r.items() if k != "ties"} | {"own": holds and way_of(r) == own, "ours": r["engine"] in part.own}
        told.append(at_least(plain | ratios, "ratio", part.aims.get(r["engine"]) if aimed else None))
    return told


def ratio_of(r: Row, own: Way, fastest: Sequence[Way], measured: Measured) -> Row:
    """A winner's time over that of our own; the spread is that of whatever ties with either."""
    if way_of(r) == own:
        return {"ratio": 1.0, "ratio_low": 1.0, "ratio_high": 1.0}
    spreads = [ratio(measured.of(x), measured.of(y)) for x in r["ties"] for y in fastest]
    value = ratio(measured.of(way_of(r)), measured.of(own))[0]
    return {"ratio": value, "ratio_low": min(x[1] for x in spreads), "ratio_high": max(x[2] for x in spreads)}
