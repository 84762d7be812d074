"""The searched best of every engine on a linkage, by `../search.py`: ladders of all variants, then one race of what passed.

Every variant is run on its own, in a worker, at sizes from coarse to fine; errors are those of positions, angles and joint forces
at every beat of the whole run, a fiftieth of it (or as near to that as the truth has samples), or where steps are longer at those
beats that they meet: at a fifth of the run or oftener, from 50 steps on at a tenth. Nothing is timed there. Then all that passed
race in one process: first a step of each variant, which with the number of steps tells who is near the cheapest, then whole runs
(or their first part, where steps are equal and a run takes longer than the lead).
"""

import hashlib
import json
import math
from collections.abc import Sequence
from functools import lru_cache
from pathlib import Path
from typing import Any

from gauss_bench.bench.clock import Measured, Missing, Race, Row, at_least, common, ratio, row, spread
from gauss_bench.bench.context import Context
from gauss_bench.bench.offers import Offer, offer
from gauss_bench.bench.search import UNITS, Requirement, Trial, coarsest, equal_steps, explore, finalists, nearest, tolerances, won
from gauss_bench.bench.survived import Watch, patient, survived, watching
from gauss_bench.bench.tasks import Rows, Tables, Task
from gauss_bench.bench.ways import BEATS, Run, Way, evaluated, has_samples, is_adaptive, space, steps_timed, whole_run
from gauss_bench.engines import OWN, all_names, get
from gauss_bench.engines.variants import Variant
from gauss_bench.mechanism.evaluate import Evaluator
from gauss_bench.mechanism.load import load
from gauss_bench.reference.store import stored_reference
from gauss_bench.suites.schema import Search, Suite
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
            tasks.append(patient(task))
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
    """What `race` tells; an engine that crashes or hangs in it is left out, and has that reason in the place of a winner."""
    tables, lost = survived(_race_of, (linkage, scenario, part, rows), [x.name for x in searched(part)])
    mechanism = load(linkage, scenario or None)
    start: Row = {"mechanism": mechanism.name, "scenario": mechanism.scenario}
    for w in requirements(part):
        wanted = start | {"required": w.kind, "accuracy": w.limit, "unit": w.unit}
        tables["search_winners"] += [wanted | {"engine": x} | y.told for x, y in lost.items()]
    return tables


def _race_of(linkage: str, scenario: str, part: Search, rows: Rows, engines: Sequence[str], path: str) -> Tables:
    return race(linkage, scenario, part.model_copy(update={"engines": tuple(engines)}), rows, watching(path))


def race(linkage: str, scenario: str, part: Search, rows: Rows, watch: Watch = id) -> Tables:
    """Winners of every engine for every requirement; `rows` are the ladders of the linkage. Call it in a process of its own."""
    run, found = over(linkage, scenario, part), Ladders(rows)
    wanted, engines = requirements(part), [x.name for x in searched(part)]
    passing = {(w, e): found.passing(e, w) for w in wanted for e in engines}
    costs = steps_timed(run, [way for ways in passing.values() for way in ways], found.steps, watch)
    best = {key: finalists({w: costs[w] for w in ways if w in costs}) for key, ways in passing.items()}
    final = Race(watch)
    raced = dict.fromkeys(way for ways in best.values() for way in ways)
    for way in raced:
        final.add(way, whole_run, run, way, found.steps[way], costs[way], part.lead)
    measured = final.run(part.rounds)
    start: Row = {"mechanism": run.mechanism.name, "scenario": run.mechanism.scenario}
    winners: Rows = []
    for w in wanted:
        lines = [winner_row(start, w, e, best[w, e], passing[w, e], found, measured, part) for e in engines]
        winners += with_ratios(lines, measured, part)
    times = [row(start | place(way), _seconds, measured, way) for way in raced]
    return {"search_winners": winners, "search_times": times}


def _seconds(measured: Measured, way: Way) -> Row:
    return spread("seconds", measured.of(way))


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
    passing: Sequence[Way],
    found: Ladders,
    measured: Measured,
    part: Search,
) -> Row:
    """An engine's winner for a requirement; without one, how near it came and why it went no further."""
    searched_trials = found.of(engine)
    told = start | {"required": wanted.kind, "accuracy": wanted.limit, "unit": wanted.unit, "engine": engine}
    told |= {"variants": len(searched_trials), "evaluations": sum(map(len, searched_trials.values())), "passing": len(passing)}
    told |= {"budget": part.budget, "most_steps": part.most_steps}
    raced = {way: measured.samples[way] for way in best if way in measured.samples}
    told["raced"] = len(raced)
    if not raced:
        return told | beaten(wanted, searched_trials, found, [measured.failed[x] for x in best if x in measured.failed])
    winner, tied = won(raced)
    error = coarsest(searched_trials[winner._replace(size=0.0)], wanted)
    options = next((x.options for x in space(offer(engine)) if x.name == winner.settings), {})
    told |= place(winner) | {"steps": found.steps[winner], "error": error.errors[wanted.kind] if error else None}
    told |= {
        "options": json.dumps(dict(options), sort_keys=True),
        "tied": ", ".join(f"{x.settings} {x.integrator} {x.stabilization}" for x in tied),
    }
    return told | {"status": str(Status.OK), "message": ""} | spread("seconds", raced[winner])


def beaten(wanted: Requirement, trials: dict[Way, list[Trial]], found: Ladders, failed: Sequence[Missing]) -> Row:
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
    text = f"came to {trial.errors[wanted.kind]:.1e} {wanted.unit} in {trial.steps} steps by {way.settings}; {found.ended[way]}"
    return least | {"status": CANNOT, "message": text}


def with_ratios(rows: Rows, measured: Measured, part: Search) -> Rows:
    """The rows of a requirement with their time over that of the cheapest own way."""
    ended = [r for r in rows if r["status"] == Status.OK]
    own = min((r for r in ended if r["engine"] in part.own), key=lambda r: float(r["seconds"]), default=None)
    told = []
    for r in rows:
        ratios: dict[str, Any] = {}
        if own is not None and r["status"] == Status.OK:
            values = ratio(*common(measured.of(way_of(r)), measured.of(way_of(own))))
            ratios = dict(zip(("ratio", "ratio_low", "ratio_high"), values, strict=True))
        aimed = r["status"] == Status.OK and r["required"] == "position" and r["accuracy"] in part.aimed
        told.append(
            at_least(r | ratios, "ratio", part.aims.get(r["engine"]) if aimed else None)
            | {"own": r is own, "ours": r["engine"] in part.own}
        )
    return told


def way_of(r: Row) -> Way:
    return Way(r["engine"], r["settings"], r["integrator"], r["stabilization"], r["step"] or r["tolerance"])
