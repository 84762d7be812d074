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
from collections.abc import Callable, Hashable, Mapping, Sequence
from functools import lru_cache
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from gauss_bench.bench.clock import (
    Measured,
    Missing,
    Race,
    Row,
    at_least,
    over_processes,
    quartiles,
    ratio,
    row,
    spread,
    time_of,
)
from gauss_bench.bench.context import Context
from gauss_bench.bench.search import close, coarsest, equal_steps, explore, finalists, nearest, tolerances, won
from gauss_bench.bench.survived import list_survivors, patient, watching
from gauss_bench.bench.tasks import Rows, Tables, Task
from gauss_bench.bench.ways import (
    BEATS,
    Models,
    Run,
    Way,
    choice_of,
    evaluate_run,
    has_samples,
    is_adaptive,
    loop_of,
    space,
    steps_timed,
    whole_run,
)
from gauss_bench.engines import OWN, all_names, get
from gauss_bench.engines.variants import Variant
from gauss_bench.linkage.load import load
from gauss_bench.mechanism.evaluate import Evaluator
from gauss_bench.reach import UNITS, Kind, Requirement, Trial, reach, trial_of
from gauss_bench.reference.store import load_stored
from gauss_bench.runs.offers import Offer, in_python, offer
from gauss_bench.runs.worker import WorkerFailure
from gauss_bench.suites.schema import Search, Suite
from gauss_bench.trajectory import Reference, Status

STATUSES = dict.fromkeys((Kind.NO_MODEL, Kind.UNDETERMINED, Kind.NOT_TRIED), Status.SKIP)  # of tables; others by their own names


def requirements(part: Search) -> list[Requirement]:
    return [Requirement(kind, limit) for kind in UNITS for limit in getattr(part, kind)]


def search_linkage(part: Search) -> list[Offer]:
    """The engines of a part that can be asked."""
    return [offer(x) for x in part.engines or (x for x in all_names() if x not in OWN)]


def over(linkage: str, scenario: str, part: Search) -> Run:
    mechanism = load(linkage, scenario or None)
    return Run(linkage, mechanism, min(part.until, mechanism.duration))


def exact(suite: Suite, context: Context) -> list[Task]:
    """One ladder for each linkage, engine and variant."""
    tasks = []
    for part in suite.search:
        asked = part.model_copy(update={"linkages": {}, "engines": ()})
        for linkage, scenario in part.linkages.items():
            for engine in search_linkage(part):
                for variant in space(engine):
                    chosen = {"settings": variant.name, "integrator": variant.integrator, "stabilization": variant.stabilization}
                    arguments = (linkage, scenario, engine.name, variant, asked, context.store)
                    tasks.append(context.task("search_ladder", ladder, arguments, linkage, scenario, engine=engine.name, **chosen))
    return tasks


def timed(suite: Suite, context: Context, tables: Tables) -> list[Task]:
    """The first process of every race: what is worth it, given the ladders, and its times."""
    return [patient(_task(context, first_race, part, place, tables), 2) for part, place in _races(suite)]


def timed_again(suite: Suite, context: Context, tables: Tables) -> list[Task]:
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
    mechanism = load(place[0], place[1] or None)
    return [r for r in tables.get(table, []) if (r["mechanism"], r["scenario"]) == (mechanism.name, mechanism.scenario)]


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
        tables["search_space"] = [r for x in engines.values() for r in space_rows(x)]
        tables["search_knobs"] = [r for x in engines for r in knob_rows(x)]


def space_rows(engine: Offer) -> Rows:
    return [
        {
            "engine": engine.name,
            "settings": x.name,
            "integrator": x.integrator,
            "stabilization": x.stabilization,
            "size": "tolerance" if x.integrator in engine.adaptive else "step",
            "options": json.dumps(dict(x.options), sort_keys=True),
        }
        for x in space(engine)
    ]


def knob_rows(engine: str) -> Rows:
    """The knobs that an engine tells of; one without a file of variants has none but its settings."""
    knobs = getattr(get(engine), "knobs", {})
    return [{"engine": engine, "knob": k.name, "meaning": k.meaning, "source": k.source} for k in knobs.values()]


# Ladders: what passes, without a clock


@lru_cache(maxsize=4)
def reference_of(linkage: str, scenario: str, until: float, store: str) -> Reference:
    return load_stored(load(linkage, scenario or None), until, Path(store))


def ladder(linkage: str, scenario: str, engine: str, variant: Variant, part: Search, store: str) -> Tables:
    """A row for every evaluation of a variant; the last one tells why there are no more."""
    run = over(linkage, scenario, part)
    start: Row = {"mechanism": run.mechanism.name, "scenario": run.mechanism.scenario, "engine": engine, "settings": variant.name}
    start |= {"integrator": variant.integrator, "stabilization": variant.stabilization, "until": run.until}
    adaptive = variant.integrator in offer(engine).adaptive
    way = Way(engine, variant.name, variant.integrator, variant.stabilization, run.until)
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
    rows = [start | trial_row(trial, adaptive) for trial in trials]
    rows[-1]["ended"] = ended
    return {"search_ladder": rows}


def trial_row(trial: Trial, adaptive: bool) -> Row:
    errors = {f"{kind}_error": x for kind, x in trial.errors.items()}
    size = {"step": None, "tolerance": trial.size} if adaptive else {"step": trial.size, "tolerance": None}
    return size | {"steps": trial.steps, "status": str(trial.status), "message": trial.message} | errors


# The race: what is cheapest


def first_race(linkage: str, scenario: str, part: Search, rows: Rows) -> Tables:
    """Times of everything worth a race, after another process has estimated costs; `rows` are the ladders of the linkage."""
    run, ladders = over(linkage, scenario, part), Ladders(rows)
    passing = [some for ways in passing_ways(ladders, part).values() for some in by_loop(ways)]
    ways = list(dict.fromkeys(way for some in passing for way in some))
    estimates, lost = _survivors(estimate, run, ladders, ways, part)
    costs = {Way(*r["way"]): float(r["seconds"]) for r in estimates}
    chosen = dict.fromkeys(way for some in passing for way in finalists({w: costs[w] for w in some if w in costs}))
    told, more = _survivors(race, run, ladders, list(chosen), part, lost, costs, part.lead, part.rounds)
    return {"search_races": race_rows(run, 0, told, lost | more)}


def further_race(linkage: str, scenario: str, part: Search, rows: Rows, first: Rows, number: int) -> Tables:
    """Times in one more process, of what may still win by those of the first."""
    run, ladders = over(linkage, scenario, part), Ladders(rows)
    measured = gather_measured(first)
    near = [way for ways in passing_ways(ladders, part).values() for some in by_loop(ways) for way in near_ways(some, measured)]
    costs = {way: time_of(x) for way, x in measured.samples.items()}
    told, lost = _survivors(race, run, ladders, list(dict.fromkeys(near)), part, list_lost(first), costs, part.lead, part.rounds)
    return {"search_races": race_rows(run, number, told, lost)}


def _survivors(
    function: Callable[..., Tables],
    run: Run,
    ladders: "Ladders",
    ways: Sequence[Way],
    part: Search,
    lost: Mapping[str, Any] = MappingProxyType({}),
    costs: Mapping[Any, float] = MappingProxyType({}),
    *numbers: float,
) -> tuple[Rows, dict[str, WorkerFailure]]:
    """Run a function of several ways in a new process: its results, and the engines that crash or hang in it."""
    asked = [[*way, ladders.steps[way], costs.get(way, 0.0)] for way in ways if way.engine not in lost]
    arguments = (run.linkage, run.mechanism.scenario, run.until, asked, *numbers)
    tables, more = list_survivors(function, arguments, [x.name for x in search_linkage(part) if x.name not in lost])
    return tables["ways"], more


def passing_ways(ladders: "Ladders", part: Search) -> dict[tuple[Requirement, str], list[Way]]:
    """For every requirement and engine what is exact enough."""
    return {(w, e.name): ladders.passing(e.name, w) for w in requirements(part) for e in search_linkage(part)}


def by_loop(ways: Sequence[Way]) -> list[list[Way]]:
    """Return the ways of an engine apart by who runs the loop: the cheapest of each is raced."""
    return [[way for way in ways if loop_of(way) == loop] for loop in dict.fromkeys(map(loop_of, ways))]


def near_ways(ways: Sequence[Way], measured: Measured) -> list[Way]:
    """Those of them that may be the fastest, by the first process."""
    return close({w: float(quartiles(measured.samples[w])[0]) for w in ways if w in measured.samples})


def race_rows(run: Run, number: int, told: Rows, lost: Mapping[str, WorkerFailure]) -> Rows:
    """Rows of one process of a race, and the engines that were lost in it."""
    start: Row = {"mechanism": run.mechanism.name, "scenario": run.mechanism.scenario, "process": number}
    rows = []
    for r in told:
        here = start | place(Way(*r["way"]))
        if "seconds" in r:
            rows += [here | {"status": str(Status.OK), "message": "", "round": k, "seconds": x} for k, x in enumerate(r["seconds"])]
        else:
            rows.append(here | {"status": r["status"], "message": r["message"]})
    return rows + [start | {"engine": e} | failure.told for e, failure in lost.items()]


def race_found(linkage: str, scenario: str, part: Search, ladder_rows: Rows, races: Rows) -> Tables:
    """Winners of every engine for every requirement, and the times of all that was raced.

    An engine that crashed or hung in one of the processes has that reason in the place of a winner.
    """
    if not _has_times(races):
        return {"search_winners": [{k: x for k, x in r.items() if k != "process"} for r in races if not r.get("engine")]}
    run, ladders, measured, lost = over(linkage, scenario, part), Ladders(ladder_rows), gather_measured(races), list_lost(races)
    passing = passing_ways(ladders, part)
    start: Row = {"mechanism": run.mechanism.name, "scenario": run.mechanism.scenario}
    winners: Rows = []
    for w in requirements(part):
        engines = [e for x, e in passing if x == w]
        lines = [winner_row(start, w, e, passing[w, e], ladders, measured, part) for e in engines if e not in lost]
        for line in (x for x in lines if x["status"] == Status.OK):
            way = way_of(line)
            line["in_python"] = in_python(way.engine, run.mechanism, choice_of(way, is_adaptive(way), run.until))
        winners += with_ratios(lines, measured, part)
        place_of = start | {"required": w.kind, "accuracy": w.limit, "unit": w.unit}
        winners += [place_of | {"engine": e} | told for e, told in lost.items() if e in engines]
    entered = dict.fromkeys(way for key in (measured.samples, measured.failed) for way in key if isinstance(way, Way))
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


def estimate(linkage: str, scenario: str, until: float, rows: Sequence[Sequence[Any]], engines: Sequence[str], path: str) -> Tables:
    """Estimated seconds of ways, each with its steps."""
    steps = {Way(*r[:5]): int(r[5]) for r in rows if r[0] in engines}
    costs = steps_timed(Run(linkage, load(linkage, scenario or None), until), list(steps), steps, watching(path))
    return {"ways": [{"way": list(way), "seconds": x} for way, x in costs.items()]}


def race(
    linkage: str,
    scenario: str,
    until: float,
    rows: Sequence[Sequence[Any]],
    lead: float,
    rounds: int,
    engines: Sequence[str],
    path: str,
) -> Tables:
    """Seconds (rounds,) of ways, each with its steps and estimated cost, or why there are none."""
    run, entered = Run(linkage, load(linkage, scenario or None), until), Race(watching(path))
    models: Models = {}
    for r in (r for r in rows if r[0] in engines):
        way = Way(*r[:5])
        entered.add(way, whole_run, run, way, int(r[5]), r[6], lead, models)
    measured = entered.run(rounds)
    told: Rows = [
        {"way": list(way), "seconds": x[0][np.isfinite(x[0])].tolist()}
        for way, x in measured.samples.items()
        if isinstance(way, Way)
    ]
    failed = [(way, x) for way, x in measured.failed.items() if isinstance(way, Way)]
    return {"ways": told + [{"way": list(way), "status": str(x.status), "message": str(x)} for way, x in failed]}


def gather_measured(races: Rows) -> Measured:
    """Gather what the processes of a race measured."""
    samples: dict[Way, dict[int, list[float]]] = {}
    failed: dict[Hashable, Missing] = {}
    for r in sorted((r for r in races if r.get("integrator") is not None), key=lambda r: r.get("round") or 0):
        if r["status"] == Status.OK:
            samples.setdefault(way_of(r), {}).setdefault(r["process"], []).append(r["seconds"])
        else:
            failed.setdefault(way_of(r), Missing(Status(r["status"]), r["message"]))
    return Measured(over_processes(samples), failed)


class Ladders:
    """The ladders of a linkage, by engine and variant in the order in which they were searched.

    Attributes:
        steps: that a way took.
    """

    def __init__(self, rows: Sequence[Row]):
        self.trials: dict[Way, list[Trial]] = {}
        self.ended: dict[Way, str] = {}
        self.steps: dict[Way, int] = {}
        for r in rows:
            variant = Way(r["engine"], r["settings"], r["integrator"], r["stabilization"], 0.0)
            trial = trial_of(r)
            self.trials.setdefault(variant, []).append(trial)
            self.ended[variant] = str(r.get("ended") or r["message"])
            self.steps[variant._replace(size=trial.size)] = trial.steps

    def of(self, engine: str) -> dict[Way, list[Trial]]:
        return {way: trials for way, trials in self.trials.items() if way.engine == engine}

    def passing(self, engine: str, wanted: Requirement) -> list[Way]:
        """The variants of an engine that meet a requirement, each at the largest size that does, in their order."""
        pairs = ((way, coarsest(trials, wanted)) for way, trials in self.of(engine).items())
        return [way._replace(size=trial.size) for way, trial in pairs if trial is not None]


def place(way: Way) -> Row:
    """A way as columns."""
    columns = way._asdict()
    size = columns.pop("size")
    return columns | ({"step": None, "tolerance": size} if is_adaptive(way) else {"step": size, "tolerance": None})


def winner_row(
    start: Row,
    wanted: Requirement,
    engine: str,
    passing: Sequence[Way],
    ladders: Ladders,
    measured: Measured,
    part: Search,
) -> Row:
    """An engine's winner for a requirement, of the ways that are `passing`; without one, how near it came and why no further."""
    searched_trials = ladders.of(engine)
    told = start | {"required": wanted.kind, "accuracy": wanted.limit, "unit": wanted.unit, "engine": engine}
    told |= {"variants": len(searched_trials), "evaluations": sum(map(len, searched_trials.values())), "passing": len(passing)}
    told |= {"budget": part.budget, "most_steps": part.steps_of.get(engine, part.most_steps)}
    told["raced"] = sum(way in measured.samples for way in passing)
    near = near_ways(passing, measured)
    if not near:
        return told | not_won(wanted, searched_trials, [measured.failed[x] for x in passing if x in measured.failed])
    winner, tied = won({way: measured.samples[way] for way in near})
    error = coarsest(searched_trials[winner._replace(size=0.0)], wanted)
    options = next((x.options for x in space(offer(engine)) if x.name == winner.settings), {})
    told |= place(winner) | {"steps": ladders.steps[winner], "error": error.errors[wanted.kind] if error else None}
    told |= {
        "options": json.dumps(dict(options), sort_keys=True),
        "tied": ", ".join(f"{x.settings} {x.integrator} {x.stabilization}" for x in tied),
    }
    return told | {"status": str(Status.OK), "message": "", "ties": tied} | spread("seconds", measured.of(winner))


def not_won(wanted: Requirement, trials: Mapping[Way, list[Trial]], failed: Sequence[Missing]) -> Row:
    """Return the columns of an engine without a winner: the answer, and how near it came."""
    found = reach(trials.values(), [wanted], str(failed[0]) if failed else "no race took it in")
    status = failed[0].status if found.holds and failed else STATUSES.get(found.kind, found.kind)
    told = {"status": str(status), "message": found.words}
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
    level = won({way: measured.of(way) for way in ours})[1] if ours else []
    own = min(ours, key=measured.time, default=None)  # the cheaper, whatever ties with it
    fastest = [way for x in level for way in ours[x]["ties"]]
    told = []
    for r in rows:
        ratios: dict[str, Any] = {}
        if own is not None and r["status"] == Status.OK:
            ratios = ratio_of(r, own, fastest, measured)
        aimed = r["status"] == Status.OK and r["required"] == "position" and r["accuracy"] in part.aimed
        told.append(
            at_least({k: x for k, x in r.items() if k != "ties"} | ratios, "ratio", part.aims.get(r["engine"]) if aimed else None)
            | {"own": r["status"] == Status.OK and way_of(r) == own, "ours": r["engine"] in part.own}
        )
    return told


def ratio_of(r: Row, own: Way, fastest: Sequence[Way], measured: Measured) -> Row:
    """A winner's time over that of our own; the spread is that of whatever ties with either."""
    if way_of(r) == own:
        return {"ratio": 1.0, "ratio_low": 1.0, "ratio_high": 1.0}
    spreads = [ratio(measured.of(x), measured.of(y)) for x in r["ties"] for y in fastest]
    value = ratio(measured.of(way_of(r)), measured.of(own))[0]
    return {"ratio": value, "ratio_low": min(x[1] for x in spreads), "ratio_high": max(x[2] for x in spreads)}


def way_of(r: Row) -> Way:
    return Way(r["engine"], r["settings"], r["integrator"], r["stabilization"], r["step"] or r["tolerance"])
