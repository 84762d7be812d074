"""Search, for each engine, the cheapest setting that meets a user's accuracy requirement within a time budget.

The search over steps and tolerances is that of suites (`bench/search.py`). The variants are tried in an order that gives every
engine an early answer: first one variant of each engine, then the others in turn. Runs take place in worker processes, two at a
time, and are not timed. A variant is not tried with more than SPARE times the evaluations of the engine's best setting so far.
Errors are the largest of the whole run against the reference of `truth.py`. A setting must stay within half of the requirement,
because the error of the reference and the time between samples may account for the other half. Candidates, their order and their
errors are therefore the same in every recommendation. If the budget ends the search, only the last candidates are missing, and the
answer says so.

Then the accurate settings with the least work of each engine are timed side by side in one process, as in suites.
"""

import math
import queue
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from gauss_bench.advice.answer import BEATS, LOOPS, UNITS, Answer, format_errors, format_setting
from gauss_bench.advice.budget import LANES, Budget
from gauss_bench.advice.racing import race_there
from gauss_bench.advice.truth import MORE, NoTruth, Truth, truth
from gauss_bench.bench.clock import ratio, spread, time_of
from gauss_bench.bench.search import coarsest, equal_steps, explore, nearest, no_coarser, pick_winner, tolerances
from gauss_bench.bench.survived import list_survivors
from gauss_bench.bench.ways import Run, Way, choice_of, judge_trial, request_of, sample
from gauss_bench.engines.base import Variant
from gauss_bench.integrate.fixed_step import EVALUATIONS
from gauss_bench.mechanism.evaluate import Evaluator
from gauss_bench.mechanism.spaces import angles
from gauss_bench.metrics import drift
from gauss_bench.reach import BY_AUTHORS, Kind, Reach, Requirement, Trial, reach, share
from gauss_bench.runs.apart import run_apart
from gauss_bench.runs.offers import in_python, interpreter_of, offer
from gauss_bench.runs.worker import Worker, WorkerFailure
from gauss_bench.terms import Array
from gauss_bench.trajectory import Status

SHARE = "share of the requirement"  # largest of the errors, each divided by its requirement
HALF = Requirement(SHARE, 0.5)
KNOWN = 0.1  # largest error bar of the reference, as a share of the requirement
TRUE = "gauss-native"  # engine whose compiled model computes the reference; it is also searched like any other engine
DENSE = 400  # most samples of a run with equal steps
EVALUATED = 24  # most runs of one variant
MOST = 200_000  # most steps of a run
TURNED = 0.7  # [rad] largest turn of the fastest link in a step that is tried: larger steps are never accurate
# order of the reference's integrator: others first try the steps that it would need, and coarser ones only if these are accurate
ORDER = 8.0
SPARE = 8.0  # most evaluations of a variant, in units of those of the engine's best setting so far
CHOICES = 4  # most settings of one engine that are timed
NEAR = 4.0  # settings with more than NEAR times the least work of their engine are not timed
TRUTH, SEARCHED, RACED = 0.5, 0.65, 0.95  # shares of the budget at which these phases end
AFTER = 0.05  # share of the budget by which a run may exceed the end of the search
ONE_TRY = 0.1  # share of the budget that the first run of an engine may take in any case
TRIED = 0.85  # share of the budget until which an engine without a run gets one
LAST = 1.25  # end of writing the programs, which follows the race, in units of the budget
WRITTEN = 15.0  # [s] that writing the program of the advised setting may take in any case
WAITS = 4.0  # most elapsed time of it, in units of WRITTEN: other programs may have the processor
LONGEST = 0.15  # share of the budget that one run may take; the first run of an engine, which loads or compiles, twice that

Told = Callable[[str], object]
Better = Callable[[Answer], object]


class _Over(Exception):
    """The time for the search of a variant has ended."""


@dataclass
class _Engine:
    """The state of the search for one engine.

    Attributes:
        owner: the engine's authors if the variants are theirs, which are searched apart; empty if they are the suite's.
        left: variants that were not tried yet; options: settings -> options of the engine.
        trials: variant -> its trials; ended: variant -> why its search ended.
        cut: whether time ended the search of a variant; busy: whether a lane runs it now.
        longest: the largest time limit of its runs [s].
        refused: the status and the reason where the engine cannot run the linkage.
    """

    name: str
    left: list[Variant]
    worker: Worker
    adaptive: tuple[str, ...]
    variants: int = 0
    options: dict[str, Mapping[str, Any]] = field(default_factory=dict)
    trials: dict[Way, list[Trial]] = field(default_factory=dict)
    ended: dict[Way, str] = field(default_factory=dict)
    cut: bool = False
    busy: bool = False
    longest: float = 0.0
    refused: tuple[Status, str] | None = None
    owner: str = ""

    @property
    def title(self) -> str:
        """The name of the engine, and the owner if the variants are its authors': the key of this search among all."""
        return f"{self.name} {BY_AUTHORS}, {self.owner}" if self.owner else self.name

    def passing(self) -> dict[Way, Trial]:
        """Return the settings that meet the requirement, from the least work to the most; equal ones in the order of trying."""
        holding = {way: trial for way, x in self.trials.items() if (trial := coarsest(x, HALF)) is not None}
        return {
            way._replace(size=trial.size): trial
            for way, trial in sorted(holding.items(), key=lambda pair: work(pair[0].integrator, pair[1]))
        }

    def loop_of(self, way: Way) -> str:
        """Return the name of the time loop that a setting uses, or an empty text where its options name none."""
        return str(self.options.get(way.settings, {}).get("loop", ""))

    @property
    def has_run(self) -> bool:
        """Whether a variant has been run: one that refuses the linkage is tried and not run."""
        return any(trial.status is not Status.SKIP for some in self.trials.values() for trial in some)

    def best(self) -> tuple[Way, Trial] | None:
        """Return the setting with the least work that meets the requirement so far, or None."""
        return next(iter(self.passing().items()), None)


def work(integrator: str, trial: Trial) -> float:
    """Return the number of acceleration evaluations of a run; else steps times evaluations per step; infinity if unknown."""
    if trial.evaluations:
        return float(trial.evaluations)
    return math.inf if trial.steps is None else float(trial.steps * EVALUATIONS.get(integrator, 1))


@dataclass(frozen=True, eq=False)
class Searched:
    """The result of the search, before the race. The time budget only decides which candidates are missing.

    Attributes:
        truth: the reference of all errors.
        engines: name -> trials of every variant of the suite (sizes 0) in the order of trying.
    """

    truth: Truth
    engines: Mapping[str, Mapping[Way, Sequence[Trial]]]


class Recommender:
    """One recommendation, as a context manager: call `search`, `race` and `answers` in this order.

    Attributes:
        run: linkage, scenario and duration; wanted: kind of error -> largest allowed error [m], [rad], [N].
        spaces: engine -> its variants in the order in which they are tried, or a sentence why it has none.
        owned: variants of these engines that their authors own; they are searched and raced apart from the suite's.
    """

    def __init__(
        self,
        run: Run,
        wanted: Mapping[str, float],
        spaces: Mapping[str, Sequence[Variant] | str],
        budget: Budget,
        told: Told,
        better: Better = lambda answer: None,
        owned: Mapping[str, Sequence[Variant]] | None = None,
    ):
        self.run, self.wanted, self.budget = run, dict(wanted), budget
        self._better = better
        self._told, self._say, self._stack, self._state = told, threading.Lock(), ExitStack(), threading.Condition()
        self.judge = Evaluator(run.mechanism)
        self.engines: dict[str, _Engine] = {}  # by title
        self.lost: dict[str, str] = {}  # engine -> why the race went on without it
        theirs = {(name, x.owner): [y for y in some if y.owner == x.owner] for name, some in (owned or {}).items() for x in some}
        for (name, owner), space in [*(((name, ""), space) for name, space in spaces.items()), *theirs.items()]:
            offered = offer(name)
            engine = _Engine(name, [], self._stack.enter_context(Worker()), offered.adaptive, owner=owner)
            if not offered.usable:
                engine.refused = offered.status, offered.reason
            elif isinstance(space, str):
                engine.refused = Status.SKIP, space
            else:
                engine.left, engine.variants = list(space), len(space)
                engine.options = {x.name: x.options for x in space}
            self.engines[engine.title] = engine
        self.truth: Truth | None = None

    def __enter__(self) -> "Recommender":
        return self

    def __exit__(self, *_: object) -> None:
        self._stack.close()

    def report(self, sentence: str) -> None:
        with self._say:
            self._told(f"{self.budget.wall_time():5.1f} s  {sentence}")

    # The search for accurate settings

    def search(self) -> Searched:
        """Try variants until all have been tried or the time has ended.

        Raises:
            NoTruth: no reference is accurate enough to judge by.
        """
        truth = self._truth()
        for kind, limit in self.wanted.items():
            if kind in truth.bars and not truth.bars[kind] <= KNOWN * limit:
                known = f"the error bar of the reference is {truth.bars[kind]:.1e} {UNITS[kind]}"
                raise NoTruth(f"{known}, more than a tenth of the required {limit:g} {UNITS[kind]}: {truth.told}")
        self.truth = truth
        # Steps in which the fastest link would turn by more than TURNED are not tried.
        self.longest = TURNED / max(float(np.abs(angles(truth.reference.v)).max()), 1e-9)
        halved = max(truth.halving[kind] / self.wanted[kind] for kind in self.wanted if kind in truth.halving)
        # The error of the reference's method falls with steps^-ORDER: these steps should give half of the requirement.
        self.first = self.run.until / (truth.steps * (halved / HALF.limit) ** (1 / ORDER))
        lanes = [threading.Thread(target=self._lane, daemon=True) for _ in range(LANES)]
        failures: queue.Queue[BaseException] = queue.Queue()
        self._failures = failures
        for lane in lanes:
            lane.start()
        for lane in lanes:
            while lane.is_alive():  # an interrupt of the user is noticed between two of these waits
                lane.join(0.2)
        if not failures.empty():
            raise failures.get()
        return Searched(truth, {x.name: x.trials for x in self.engines.values() if not x.owner})

    def _truth(self) -> Truth:
        """Compute the reference, in the worker of the compiled engine, so that its model is compiled once for both uses."""
        wanted = {k: KNOWN * x for k, x in self.wanted.items()}
        own = self.engines.get(TRUE)
        worker = own.worker if own is not None and own.refused is None else self._stack.enter_context(Worker())
        return truth(self.run, wanted, lambda: self.budget.remaining(TRUTH), worker, self.report)

    def _lane(self) -> None:
        try:
            while (engine := self._next()) is not None:
                self._variant(engine, engine.left.pop(0))
                with self._state:
                    engine.busy = False
                    self._state.notify_all()
        except BaseException as error:
            self._failures.put(error)

    def _next(self) -> _Engine | None:
        """Return the idle engine with the fewest variants tried, or None at the end of the search.

        When the time for the search has ended, each engine without a run still gets one, with steps that should be accurate enough.
        Variants that refuse the linkage take no time, so an engine that has only refused so far has had no run.
        """
        with self._state:
            while self._failures.empty():
                due = self.budget.remaining(SEARCHED) > 0
                open_ones = [x for x in self.engines.values() if x.left and x.refused is None and (due or not x.has_run)]
                if not open_ones:
                    return None
                free = [x for x in open_ones if not x.busy]
                if free:
                    chosen = min(free, key=lambda x: len(x.trials))
                    chosen.busy = True
                    return chosen
                self._state.wait(0.2)
        return None

    def _variant(self, engine: _Engine, variant: Variant) -> None:
        """Search one variant over step sizes or tolerances, and keep its trials."""
        way = Way(engine.name, variant.name, variant.integrator, variant.stabilization, 0.0)
        adaptive, before, first = variant.integrator in engine.adaptive, engine.best(), not engine.has_run
        trials: list[Trial] = []
        engine.trials[way] = trials
        scale, most = tolerances(smallest=12), 0
        if not adaptive:
            most = self._most(way, before)
            scale = no_coarser(equal_steps(self.run.until, BEATS, most), self.longest)
        # The search asks for some sizes twice; each is run once.
        seen: dict[float, Trial] = {}
        until = self.budget.seconds_used() + self._slice(first)

        def evaluate(size: float) -> Trial:
            if size not in seen:
                if (seen or not first) and self.budget.seconds_used() >= until:
                    raise _Over
                seen[size] = self._evaluate(engine, way._replace(size=size), adaptive)
                trials.append(seen[size])
            return seen[size]

        try:
            late = first and self.budget.remaining(SEARCHED) <= 0  # the engine gets a single run: its step is rather too fine
            start = scale if adaptive else no_coarser(scale, self.first / 2 if late else self.first)
            # Begin at coarser sizes as long as they hold: the cheapest setting may need fewer steps than the reference.
            while len(start.sizes) < len(scale.sizes) and evaluate(start.sizes[0]).meets(HALF):
                start = no_coarser(scale, 2 * start.sizes[0])
            _, engine.ended[way] = explore(evaluate, start, [HALF], EVALUATED, most)
        except _Over:
            engine.cut, engine.ended[way] = True, "its time for searching ended"
        if trials and not engine.has_run:
            self._refuse(engine, trials[-1])
        self._tell(engine, before)

    def _slice(self, first: bool) -> float:
        """Return the seconds that a variant may take. The first that an engine runs gets twice an equal share of the time."""
        left = self.budget.remaining(SEARCHED)
        waiting = sum(not x.trials and x.refused is None for x in self.engines.values())
        return left if not first else min(left, 2 * LANES * left / (1 + waiting))

    def _refuse(self, engine: _Engine, trial: Trial) -> None:
        """Keep the variants with other time loops of an engine that refused the linkage, else one with another integrator.

        Without any, record the reason.
        """
        loops = {engine.loop_of(way) for way in engine.trials}
        others = [x for x in engine.left if str(x.options.get("loop", "")) not in loops]
        if not others and len(engine.trials) == 1:
            others = [x for x in engine.left if x.integrator != next(iter(engine.trials)).integrator][:1]
        engine.left = others
        engine.refused = None if others else (trial.status, trial.message)

    def _most(self, way: Way, before: tuple[Way, Trial] | None) -> int:
        """Return the most steps that a variant may take: MOST, or as many as are at most SPARE times the engine's best."""
        if before is None:
            return MOST
        spared = SPARE * work(before[0].integrator, before[1]) / EVALUATIONS.get(way.integrator, 1)
        return int(min(MOST, max(spared, 2 * DENSE)))

    def _evaluate(self, engine: _Engine, way: Way, adaptive: bool) -> Trial:
        assert self.truth is not None
        steps = BEATS if adaptive else round(self.run.until / way.size)
        # Samples must divide the steps evenly, so that no shorter step is needed to meet a sample time.
        samples = BEATS if adaptive else max(x for x in range(1, DENSE + 1) if steps % x == 0)
        wanted = sample(self.run, steps, samples)
        limit, wall = self._limit(engine), max(self.budget.remaining_wall_time(TRIED), 1.0)
        engine.longest = max(engine.longest, min(limit, wall))
        request = request_of(self.run, way, adaptive, wanted)
        ran = run_apart(request, self.run.mechanism, limit, engine.worker, again=True, longest=wall)
        trial = judge_trial(self.run, self.judge, self.truth.at(self.run, wanted.times), way, ran)
        if trial.status is not Status.OK:
            return trial
        errors = dict(trial.errors)
        if LOOPS in self.wanted and ran.trajectory is not None:
            errors[LOOPS] = float(drift(self.judge, ran.trajectory).position.max())
        # The requirement that is met worst counts; an undetermined error (NaN) does not pass as small.
        worst = share(replace(trial, errors=errors), [Requirement(*x) for x in self.wanted.items()])
        return replace(trial, errors=errors | {SHARE: worst})

    def _limit(self, engine: _Engine) -> float:
        """Return the time limit of a run [s]. The first run of an engine, which loads or compiles its library, has a minimum."""
        if engine.has_run:
            return max(min(LONGEST * self.budget.seconds, self.budget.remaining(SEARCHED + AFTER)), 1.0)
        waiting = 1 + sum(not x.trials and x.refused is None for x in self.engines.values())
        own = max(self.budget.remaining(SEARCHED + AFTER), LANES * self.budget.remaining(TRIED) / waiting)
        return max(min(2 * LONGEST * self.budget.seconds, own), ONE_TRY * self.budget.seconds, 1.0)

    def _tell(self, engine: _Engine, before: tuple[Way, Trial] | None) -> None:
        after, trials = engine.best(), [x for many in engine.trials.values() for x in many]
        if after is None:
            best = nearest(trials, SHARE)
            if engine.refused:
                self.report(f"{engine.title}: {engine.refused[0]}: {engine.refused[1]}")
            elif best is not None and len(engine.trials) == 1:
                self.report(f"{engine.title}: not yet; nearest {self._errors(best)}")
        elif before is None or work(after[0].integrator, after[1]) < work(before[0].integrator, before[1]):
            how = "holds" if before is None else "better"
            self.report(f"{engine.title}: {how}: {describe_setting(after[0], engine)}: {self._errors(after[1])}")
            with self._say:
                self._better(replace(self._hold(engine, *after, None, None), message="not raced yet"))

    def _errors(self, trial: Trial) -> str:
        return format_errors(trial.errors, self.wanted, ", ")

    # The race for the cheapest setting

    def race(self) -> dict[Way, Array]:
        """Time the accurate settings side by side in one process; return setting -> seconds of a run (rounds,)."""
        chosen: dict[Way, int | None] = {}
        lists = [choices(x) for x in self.engines.values()]
        for place in range(CHOICES):  # first choices of all engines before second ones of any
            chosen |= {way: trial.steps for ways in lists for way, trial in ways[place : place + 1]}
        if not chosen or self.budget.remaining(RACED) <= 0:
            return {}
        self.report(f"race: {len(chosen)} settings of {len({x.engine for x in chosen})} engines")
        rows = [[*way, steps] for way, steps in chosen.items()]
        place_of = (self.run.linkage, self.run.mechanism.scenario, self.run.until, BEATS)
        deadline = time.monotonic() + self.budget.remaining(RACED)
        names = list(dict.fromkeys(x.engine for x in chosen))
        limits = (max(1.0, x()) for x in (self.budget.remaining, self.budget.remaining_wall_time))
        try:
            tables, lost = list_survivors(race_there, (*place_of, rows, deadline), names, *limits)
        except WorkerFailure as error:
            self.report(f"race: {error}")
            self.lost = {} if error.status is Status.TIMEOUT else dict.fromkeys(names, str(error))
            return {}
        self.lost = {row["engine"]: row["message"] for row in tables["failed"]} | {name: str(x) for name, x in lost.items()}
        for name, failure in self.lost.items():
            self.report(f"race: {name}: {failure}")
        return {Way(*r["way"]): np.array(r["seconds"]) for r in tables["race"] if r["seconds"]}

    def answers(self, times: Mapping[Way, Array]) -> list[Answer]:
        """Return an answer for every engine: first those that meet the requirement, the fastest first, then the others."""
        chosen: dict[str, tuple[Way, Trial]] = {}
        for engine in self.engines.values():
            ways = engine.passing()
            if raced := {way: times[way] for way in ways if way in times}:
                winner = pick_winner(raced)[0]
                chosen[engine.title] = winner, ways[winner]
            elif best := engine.best():
                chosen[engine.title] = best
        fastest = min((times[w] for w, _ in chosen.values() if w in times), key=time_of, default=None)
        held: list[Answer] = []
        for title, (way, trial) in chosen.items():
            engine = self.engines[title]
            answer = self._hold(engine, way, trial, times.get(way), fastest)
            own_times = {w: x for w, x in times.items() if w.settings in engine.options}
            held.append(replace(answer, loops=by_loop(engine, own_times, fastest)))
        # Settings without a race have no ratio and come last.
        held.sort(key=lambda x: math.inf if x.ratio is None else x.ratio)
        return held + [self._not_held(x) for x in self.engines.values() if x.title not in chosen]

    def call_worker(self, engine: str, function: Callable[..., Any], arguments: tuple[Any, ...], least: float = 1.0) -> Any:
        """Call a function in the engine's worker, until LAST times the budget at the latest, or for `least` seconds [s].

        Raises:
            WorkerFailure: the call failed or took too long.
        """
        limit = max(least, self.budget.remaining(LAST))
        longest = max(WAITS * least, self.budget.remaining_wall_time(LAST))
        worker = self.engines[engine].worker.under(interpreter_of(engine))
        return worker.call(function, arguments, limit, longest=longest)

    def _counts(self, engine: _Engine) -> dict[str, Any]:
        evaluations = sum(map(len, engine.trials.values()))
        complete = not engine.cut and not (engine.left and engine.refused is None)
        return {"tried": len(engine.trials), "variants": engine.variants, "evaluations": evaluations, "complete": complete}

    def _hold(self, engine: _Engine, way: Way, trial: Trial, seconds: Array | None, fastest: Array | None) -> Answer:
        timed: dict[str, float] = {}
        if seconds is not None and fastest is not None:
            timed = spread("seconds", seconds)
            timed |= dict(zip(("ratio", "ratio_low", "ratio_high"), ratio(seconds, fastest), strict=True))
        adaptive = way.integrator in engine.adaptive
        size = {"tolerance": way.size} if adaptive else {"step": way.size}
        errors = {k: x for k, x in trial.errors.items() if k in UNITS and not math.isnan(x)}
        columns: dict[str, Any] = way._asdict() | size | timed | self._counts(engine)
        columns.pop("size")
        columns["owner"] = engine.owner
        message = "" if timed else f"holds, not raced: {self.lost.get(engine.name, f'the time ended first; {MORE}')}"
        columns["options"] = engine.options.get(way.settings, {})
        columns["in_python"] = in_python(way.engine, self.run.mechanism, choice_of(way, adaptive, self.run.until))
        return Answer(status=str(Status.OK), message=message, steps=trial.steps, errors=errors, **columns)

    def _not_held(self, engine: _Engine) -> Answer:
        counts: dict[str, Any] = self._counts(engine) | {"owner": engine.owner}
        found = answer_of(engine)
        status = str(Status.SKIP if found.kind in (Kind.NO_MODEL, Kind.UNDETERMINED) else found.kind)
        best = [(way, trial) for way, x in engine.trials.items() if (trial := nearest(x, SHARE)) is not None]
        if found.kind is not Kind.NOT_REACHED or not best:
            return Answer(engine.name, status, found.words, **counts)
        way, trial = min(best, key=lambda x: x[1].errors[SHARE])
        errors = {k: x for k, x in trial.errors.items() if k in UNITS and not math.isnan(x)}
        placed = describe_setting(way._replace(size=trial.size), engine)
        untried = "" if counts["complete"] else "; some variants were not tried"
        message = f"{found.words}; came to {self._errors(trial)} with {placed}{untried}"
        return Answer(engine.name, status, message, steps=trial.steps, errors=errors, **counts)


def choices(engine: _Engine) -> list[tuple[Way, Trial]]:
    """Return the settings of an engine to time: those with the least work, and the one with the least work of each time loop."""
    ways = list(engine.passing().items())
    least = min((work(w.integrator, t) for w, t in ways), default=0.0)
    near = [(w, t) for w, t in ways if work(w.integrator, t) <= NEAR * least or w.integrator in engine.adaptive][:CHOICES]
    shown = {engine.loop_of(w) for w, _ in near}
    others = {engine.loop_of(w): (w, t) for w, t in reversed(ways) if engine.loop_of(w) not in shown}  # the least of each loop
    return [*near[: CHOICES - len(others)], *others.values()]


def by_loop(engine: _Engine, times: Mapping[Way, Array], fastest: Array | None) -> dict[str, float]:
    """Return time loop -> time of its fastest setting over that of the fastest engine; empty if the engine has a single loop."""
    ways = [way for way in times if way.engine == engine.name]
    loops = {loop: [w for w in ways if engine.loop_of(w) == loop] for loop in dict.fromkeys(map(engine.loop_of, ways))}
    if fastest is None or len(loops) < 2:
        return {}
    return {loop: min(time_of(times[w]) for w in some) / time_of(fastest) for loop, some in loops.items()}


def answer_of(engine: _Engine) -> Reach:
    """Return the answer for an engine without a setting that meets the requirement."""
    if engine.refused is not None and engine.refused[0] is not Status.SKIP:
        return Reach(Kind.NOT_TRIED, engine.refused[1])
    if engine.refused is not None:
        return reach([[Trial(math.nan, {}, 0, *engine.refused)]], [HALF])
    if engine.trials and engine.left and not engine.has_run:
        refused = next(trial.message for some in engine.trials.values() for trial in some)
        return Reach(Kind.NOT_TRIED, f"the variants that had a turn refused ({refused}); {MORE}", within="within the budget")
    trials = [trial for some in engine.trials.values() for trial in some]
    if not trials:
        return Reach(Kind.NOT_TRIED, f"it had no turn; {MORE}", within="within the budget")
    # a refusal or a crash at one setting does not say what the runs without an end would have come to
    statuses = {trial.status for trial in trials}
    if Status.TIMEOUT in statuses and Status.OK not in statuses:
        return Reach(Kind.NOT_TRIED, f"no run ended in the {engine.longest:.3g} s that it had; {MORE}", within="within the budget")
    return reach(engine.trials.values(), [HALF])


def describe_setting(way: Way, engine: _Engine) -> str:
    """Return a setting in words."""
    adaptive = way.integrator in engine.adaptive
    size = {"tolerance": way.size} if adaptive else {"step": way.size}
    return format_setting(way.settings, way.integrator, way.stabilization, **size)
