"""The searched best of every engine on a linkage, by `../search.py`: ladders of all variants, then one race of what passed.

Every variant is run on its own, in a worker, at sizes from coarse to fine; errors are those of positions, angles and joint forces
at every beat of the whole run, a fiftieth of it (or as near to that as the truth has samples), or where steps are longer at those
beats that they meet: at a fifth of the run or oftener, from 50 steps on at a tenth. Nothing is timed there. Then come races of all
engines: of a step of each variant that passed, which with the number of steps tells who is near the cheapest, then of whole runs
(or of their first part, where steps are equal and a run takes longer than the lead) in several processes, one after the other.
"""

import hashlib
import json
import math
from collections.abc import Callable, Hashable, Iterable, Mapping, Sequence
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from gauss_bench.bench.clock import Measured, Missing, Race, Races, Row, at_least, row
from gauss_bench.bench.context import Context
from gauss_bench.bench.search import (
    UNITS,
    Requirement,
    Trial,
    close,
    coarsest,
    equal_steps,
    explore,
    finalists,
    nearest,
    tolerances,
    won_over,
)
from gauss_bench.bench.survived import patient, survived, watching
from gauss_bench.bench.tasks import Rows, Tables, Task
from gauss_bench.bench.ways import BEATS, Run, Way, evaluated, has_samples, is_adaptive, space, steps_timed, whole_run
from gauss_bench.engines import OWN, all_names, get
from gauss_bench.engines.variants import Variant
from gauss_bench.linkage.load import load
from gauss_bench.mechanism.evaluate import Evaluator
from gauss_bench.reference.store import stored_reference
from gauss_bench.runs.offers import Offer, offer
from gauss_bench.runs.worker import WorkerFailure
from gauss_bench.suites.schema import Search, Suite
from gauss_bench.terms import Array
from gauss_bench.trajectory import Reference, Status

CANNOT = "cannot reach"


def requirements(part: Search) -> list[Requirement]:
    return [Requirement(kind, limit) for kind in UNITS for limit in getattr(part, kind)]


def searched(part: Search) -> list[Offer]:
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
            for engine in searched(part):
                for variant in space(engine):
                    chosen = {"settings": variant.name, "integrator": variant.integrator, "stabilization": variant.stabilization}
                    arguments = (linkage, scenario, engine.name, variant, asked, context.store)
                    tasks.append(context.task("search_ladder", ladder, arguments, linkage, scenario, engine=engine.name, **chosen))
    return tasks


def timed(suite: Suite, context: Context, tables: Tables) -> list[Task]:
    """One race for each linkage, given its ladders."""
    tasks = []
    for part in suite.search:
        for linkage, scenario in part.linkages.items():
            mechanism = load(linkage, scenario or None)
            place = (mechanism.name, mechanism.scenario)
            rows = [r for r in tables.get("search_ladder", []) if (r["mechanism"], r["scenario"]) == place]
            seen = hashlib.sha256(json.dumps(rows, sort_keys=True).encode()).hexdigest()
            only = part.model_copy(update={"linkages": {linkage: scenario}})
            task = context.task("search_winners", raced, (linkage, scenario, only, rows), linkage, scenario, seen)
            tasks.append(patient(task, 1 + part.processes))
    return tasks


def complete(suite: Suite, tables: Tables) -> None:
    """Write down what was searched, and where every knob comes from."""
    engines = {x.name: x for part in suite.search for x in searched(part) if x.usable}
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
    return stored_reference(load(linkage, scenario or None), until, Path(store))


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
    scale = tolerances() if adaptive else equal_steps(run.until, beats, part.most_steps)
    judge, most = Evaluator(run.mechanism), 0 if adaptive else part.most_steps

    def evaluate(size: float) -> Trial:
        return evaluated(run, judge, truth, way._replace(size=size), adaptive, beats)

    trials, ended = explore(evaluate, scale, requirements(part), part.budget, most)
    rows = [start | trial_row(trial, adaptive) for trial in trials]
    rows[-1]["ended"] = ended
    return {"search_ladder": rows}


def trial_row(trial: Trial, adaptive: bool) -> Row:
    errors = {f"{kind}_error": x for kind, x in trial.errors.items()}
    size = {"step": None, "tolerance": trial.size} if adaptive else {"step": trial.size, "tolerance": None}
    return size | {"steps": trial.steps, "status": str(trial.status), "message": trial.message} | errors


def trial_of(r: Row) -> Trial:
    """A trial as its row tells it."""
    errors = {kind: float(r[f"{kind}_error"]) for kind in UNITS if r.get(f"{kind}_error") is not None}
    size = r.get("step") or r.get("tolerance") or math.nan
    return Trial(float(size), errors, int(r.get("steps") or 0), Status(r["status"]), str(r["message"]))


# The race: what is cheapest


def raced(linkage: str, scenario: str, part: Search, rows: Rows) -> Tables:
    """Winners of every engine for every requirement; `rows` are the ladders of the linkage.

    One process estimates costs, then each of `part.processes` races what is worth it. An engine that crashes or hangs in one of
    them is left out from then on, and has that reason in the place of a winner.
    """
    run, ladders, wanted = over(linkage, scenario, part), Ladders(rows), requirements(part)
    engines = [x.name for x in searched(part)]
    lost: dict[str, WorkerFailure] = {}

    def there(function: Callable[..., Tables], ways: Iterable[Way], *numbers: float) -> Rows:
        """What a function tells of ways, in a new process."""
        asked = [[*way, ladders.steps[way], costs.get(way, 0.0)] for way in dict.fromkeys(ways) if way.engine not in lost]
        arguments = (linkage, scenario, run.until, asked, *numbers)
        tables, more = survived(function, arguments, [x for x in engines if x not in lost])
        lost.update(more)
        return tables["ways"]

    costs: dict[Way, float] = {}
    passing = {(w, e): ladders.passing(e, w) for w in wanted for e in engines}
    costs = {Way(*r["way"]): r["seconds"] for r in there(estimated, every(passing))}
    best = {key: finalists({w: costs[w] for w in ways if w in costs}) for key, ways in passing.items()}
    races = [measured_of(there(race, every(best), part.lead, part.rounds))]
    near = {key: close({w: races[0].quartile(w) for w in ways if w in races[0].samples}) for key, ways in best.items()}
    races += [measured_of(there(race, every(near), part.lead, part.rounds)) for _ in range(1, part.processes)]
    measured = Races(races)
    start: Row = {"mechanism": run.mechanism.name, "scenario": run.mechanism.scenario}
    winners: Rows = []
    for w in wanted:
        left = [e for e in engines if e not in lost]
        lines = [winner_row(start, w, e, best[w, e], near[w, e], len(passing[w, e]), ladders, measured, part) for e in left]
        winners += with_ratios(lines, measured, part)
        place_of = start | {"required": w.kind, "accuracy": w.limit, "unit": w.unit}
        winners += [place_of | {"engine": e} | failure.told for e, failure in lost.items()]
    times = [row(start | place(way), measured.spread, "seconds", way) for way in every(best) if way.engine not in lost]
    return {"search_winners": winners, "search_times": times}


def every(ways: Mapping[Any, Sequence[Way]]) -> list[Way]:
    """All of them, each once."""
    return list(dict.fromkeys(way for some in ways.values() for way in some))


def estimated(
    linkage: str, scenario: str, until: float, rows: Sequence[Sequence[Any]], engines: Sequence[str], path: str
) -> Tables:
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
    for r in (r for r in rows if r[0] in engines):
        way = Way(*r[:5])
        entered.add(way, whole_run, run, way, int(r[5]), r[6], lead)
    measured = entered.run(rounds)
    told: Rows = [{"way": list(way), "seconds": x.tolist()} for way, x in measured.samples.items() if isinstance(way, Way)]
    failed = [(way, x) for way, x in measured.failed.items() if isinstance(way, Way)]
    return {"ways": told + [{"way": list(way), "status": str(x.status), "message": str(x)} for way, x in failed]}


def measured_of(rows: Rows) -> Measured:
    """What `race` told."""
    ran: dict[Hashable, Array] = {Way(*r["way"]): np.array(r["seconds"]) for r in rows if "seconds" in r}
    return Measured(ran, {Way(*r["way"]): Missing(Status(r["status"]), r["message"]) for r in rows if "seconds" not in r})


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
    best: Sequence[Way],
    near: Sequence[Way],
    passing: int,
    ladders: Ladders,
    measured: Races,
    part: Search,
) -> Row:
    """An engine's winner for a requirement; without one, how near it came and why it went no further.

    `passing` ways are exact enough, `best` were raced, and `near` in every process.
    """
    searched_trials = ladders.of(engine)
    told = start | {"required": wanted.kind, "accuracy": wanted.limit, "unit": wanted.unit, "engine": engine}
    told |= {"variants": len(searched_trials), "evaluations": sum(map(len, searched_trials.values())), "passing": passing}
    told |= {"budget": part.budget, "most_steps": part.most_steps}
    told["raced"] = sum(way in measured for way in best)
    if not near:
        return told | beaten(wanted, searched_trials, ladders, [measured.failed[x] for x in best if x in measured.failed])
    winner, tied = won_over(measured, near)
    error = coarsest(searched_trials[winner._replace(size=0.0)], wanted)
    options = next((x.options for x in space(offer(engine)) if x.name == winner.settings), {})
    told |= place(winner) | {"steps": ladders.steps[winner], "error": error.errors[wanted.kind] if error else None}
    told |= {
        "options": json.dumps(dict(options), sort_keys=True),
        "tied": ", ".join(f"{x.settings} {x.integrator} {x.stabilization}" for x in tied),
    }
    return told | {"status": str(Status.OK), "message": ""} | measured.spread("seconds", winner)


def beaten(wanted: Requirement, trials: dict[Way, list[Trial]], ladders: Ladders, failed: Sequence[Missing]) -> Row:
    """Why an engine has no winner."""
    if failed:
        return {"status": str(failed[0].status), "message": str(failed[0])}
    every = [(way, trial) for way, x in trials.items() if (trial := nearest(x, wanted.kind)) is not None]
    if not every:
        last = [x[-1] for x in trials.values()]
        status, message = (last[0].status, last[0].message) if last else (Status.SKIP, "it was not searched")
        if status is Status.OK:
            status, message = Status.SKIP, f"errors of {wanted.kind} are not determined: redundant rows leave joint forces open"
        return {"status": str(status), "message": message}
    way, trial = min(every, key=lambda x: x[1].errors[wanted.kind])
    least = place(way._replace(size=trial.size)) | {"steps": trial.steps, "error": trial.errors[wanted.kind]}
    text = f"came to {trial.errors[wanted.kind]:.1e} {wanted.unit} in {trial.steps} steps by {way.settings}; {ladders.ended[way]}"
    return least | {"status": CANNOT, "message": text}


def with_ratios(rows: Rows, measured: Races, part: Search) -> Rows:
    """The rows of a requirement with their time over that of the cheapest own way."""
    ended = [r for r in rows if r["status"] == Status.OK]
    own = min((r for r in ended if r["engine"] in part.own), key=lambda r: float(r["seconds"]), default=None)
    told = []
    for r in rows:
        ratios: dict[str, Any] = {}
        if own is not None and r["status"] == Status.OK:
            ratios = dict(zip(("ratio", "ratio_low", "ratio_high"), measured.ratio(way_of(r), way_of(own)), strict=True))
        aimed = r["status"] == Status.OK and r["required"] == "position" and r["accuracy"] in part.aimed
        told.append(
            at_least(r | ratios, "ratio", part.aims.get(r["engine"]) if aimed else None)
            | {"own": r is own, "ours": r["engine"] in part.own}
        )
    return told


def way_of(r: Row) -> Way:
    return Way(r["engine"], r["settings"], r["integrator"], r["stabilization"], r["step"] or r["tolerance"])
