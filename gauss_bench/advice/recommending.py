"""For each engine, search for the cheapest setting that meets a user's accuracy requirement within a time budget.

The search over steps and tolerances is that of suites (`bench/search.py`). First one variant (a setting without step or tolerance)
of each engine is tried, then the others in turn. Runs take place in worker processes and are not timed. The largest errors of an
accepted setting are at most half of the allowed errors, because the error of the reference, and larger errors between the samples,
may make up the other half. Candidates are chosen without measured times, so that their order and errors are the same in every
recommendation; a budget that ends the search leaves the last of them untested.

Then, for each engine, the accurate settings with the fewest evaluations are timed side by side in one process, as in a suite.
"""

import math
import queue
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import numpy as np

from gauss_bench.advice.answer import BEATS, LOOPS, UNITS, Answer, format_errors, format_setting
from gauss_bench.advice.budget import LANES, Budget
from gauss_bench.advice.racing import race_there
from gauss_bench.advice.truth import MORE, NoTruth, Told, Truth, compute_reference
from gauss_bench.bench.clock import ratio_columns, spread, time_of
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

SHARE = "share of the requirement"  # kind of error: the largest of the errors, each divided by its requirement
HALF = Requirement(SHARE, 0.5)  # requirement on an accepted setting: each error is at most half of the allowed one
KNOWN = 0.1  # largest error bar of the reference, divided by the allowed error
REFERENCE_ENGINE = "gauss-native"  # engine whose compiled model computes the reference; it is also searched like any other engine
DENSE = 400  # largest number of samples of a run with equal steps; every variant may take twice as many steps
EVALUATED = 24  # largest number of runs of one variant
MOST = 200_000  # largest number of steps of a run
TURNED = 0.7  # [rad] largest turn of the fastest link in a step that is tried: larger steps are never accurate
# Order of the reference's integrator. Other engines first try the steps that it would need, and coarser ones if these are accurate.
ORDER = 8.0
SPARE = 8.0  # largest work (evaluations of accelerations) of a variant, in units of the engine's best setting so far
CHOICES = 4  # largest number of settings of one engine that are timed
NEAR = 4.0  # settings with more than NEAR times the least work of their engine are not timed
TRUTH, SEARCHED, RACED = 0.5, 0.65, 0.95  # shares of the budget at which the reference, the search and the timing end
AFTER = 0.05  # share of the budget by which a run may exceed the end of the search
ONE_TRY = 0.1  # share of the budget that the first run of an engine may take in any case
TRIED = 0.85  # share of the budget at which the first runs of all engines must have ended
LAST = 1.25  # time at which the programs, the last part of an answer, must be written, in units of the budget
WRITTEN = 15.0  # [s] that writing the program of the advised setting may take even if the budget is used up
WAITS = 4.0  # limit of the elapsed time of writing a program, relative to its least time: other programs may have the processor
LONGEST = 0.15  # share of the budget that one run may take; the first run of an engine may take twice as long, because it compiles

Better = Callable[[Answer], object]  # a function that is called with each answer that improves on the engine's previous one


class TriedSetting(NamedTuple):
    """A setting that was tried, with its step or tolerance, and its trial run."""

    way: Way
    trial: Trial

    @property
    def work(self) -> float:
        """Number of acceleration evaluations of the trial run.

        If the engine does not count them, the steps times the evaluations in one step; infinity if it counts no steps either.
        """
        if self.trial.evaluations:
            return float(self.trial.evaluations)
        return math.inf if self.trial.steps is None else float(self.trial.steps * EVALUATIONS.get(self.way.integrator, 1))


class _OutOfTime(Exception):
    """Raised if the time allowed for the search of a variant's step or tolerance is over."""


@dataclass
class _Engine:
    """The state of the search for one engine, or for the settings that the engine's authors have contributed.

    Attributes:
        left: variants that were not tried yet; variants: number of all its variants.
        adaptive: names of its integrators that choose their own steps.
        options: name of the settings -> options of the engine.
        trials: variant (a `Way` of size 0) -> its trial runs, one for each step or tolerance that was tried.
        cut: whether the search of a variant ended because its time was over.
        busy: whether a thread runs a variant now.
        longest_limit: the largest time limit of a run so far [s].
        refused: the status and the reason if the engine cannot run the linkage.
        owner: the engine's authors if the variants are theirs; empty if they are the suite's.
    """

    name: str
    left: list[Variant]
    worker: Worker
    adaptive: tuple[str, ...]
    variants: int = 0
    options: dict[str, Mapping[str, Any]] = field(default_factory=dict)
    trials: dict[Way, list[Trial]] = field(default_factory=dict)
    cut: bool = False
    busy: bool = False
    longest_limit: float = 0.0
    refused: tuple[Status, str] | None = None
    owner: str = ""

    @property
    def title(self) -> str:
        """The engine's name, and its authors if they contributed the variants."""
        return f"{self.name} {BY_AUTHORS}, {self.owner}" if self.owner else self.name

    @property
    def is_open(self) -> bool:
        """Whether variants are left to be tried, and the engine does not refuse the linkage."""
        return bool(self.left) and self.refused is None

    @property
    def has_run(self) -> bool:
        """Whether a variant of this engine has begun a run; a variant that refuses the linkage is tried, but begins no run."""
        return any(trial.status is not Status.SKIP for trial in self.all_trials())

    def all_trials(self) -> list[Trial]:
        """Return the trials of all variants, in the order of the search."""
        return [trial for trials in self.trials.values() for trial in trials]

    def accurate_settings(self) -> list[TriedSetting]:
        """Return the accurate settings (HALF), from the least work to the most.

        Each variant gives one setting: the one with its largest step or tolerance that is accurate.
        """
        largest = [(way, coarsest(trials, HALF)) for way, trials in self.trials.items()]
        accurate = [TriedSetting(way._replace(size=trial.size), trial) for way, trial in largest if trial is not None]
        return sorted(accurate, key=lambda x: x.work)

    def best(self) -> TriedSetting | None:
        """Return the accurate setting with the least work so far, or None."""
        return next(iter(self.accurate_settings()), None)

    def nearest(self) -> TriedSetting | None:
        """Return the setting whose errors come nearest to the requirement (the smallest SHARE); None if no run ended."""
        smallest = [(way, nearest(trials, SHARE)) for way, trials in self.trials.items()]
        ended = [TriedSetting(way._replace(size=trial.size), trial) for way, trial in smallest if trial is not None]
        return min(ended, key=lambda x: x.trial.errors[SHARE], default=None)

    def loop_of(self, way: Way) -> str:
        """Return the name of a setting's time loop, or an empty text if its options name none."""
        return str(self.options.get(way.settings, {}).get("loop", ""))

    def size_of(self, way: Way) -> dict[str, float]:
        """Return the size of a setting under its name: {"tolerance": ...} if the integrator is adaptive, else {"step": ...} [s]."""
        return {"tolerance" if way.integrator in self.adaptive else "step": way.size}


class Recommender:
    """One recommendation, as a context manager: call `search`, `race` and `answers` in this order.

    Attributes:
        run: linkage, scenario and duration.
        wanted: kind of error -> largest allowed error [m], [rad], [N].
        engines: title -> state of the search for an engine.
        lost: engine -> why the timing of the settings continued without it.
    """

    def __init__(
        self,
        run: Run,
        wanted: Mapping[str, float],
        spaces: Mapping[str, Sequence[Variant]],
        budget: Budget,
        told: Told,
        better: Better = lambda answer: None,
        owned: Mapping[str, Sequence[Variant]] | None = None,
    ):
        """Prepare the search: start a worker for each engine, and list the variants to try.

        Args:
            spaces: engine -> its variants in the order in which they are tried.
            budget: the time for reference, search, timing and programs together.
            told, better: called with each sentence of progress, and with each answer that improves on the engine's previous one.
            owned: engine -> variants that its authors have contributed; they are searched and timed separately from the suite's.
        """
        self.run, self.wanted, self.budget = run, dict(wanted), budget
        self._told, self._better, self._report_lock = told, better, threading.Lock()
        self._workers, self._changed = ExitStack(), threading.Condition()  # notified when a variant's search ends
        self._failures: queue.Queue[BaseException] = queue.Queue()  # errors in the threads of the search
        self.judge = Evaluator(run.mechanism)
        self.engines: dict[str, _Engine] = {}
        self.lost: dict[str, str] = {}
        self.truth: Truth | None = None
        searches = [(name, "", space) for name, space in spaces.items()]  # engine, authors who contributed the variants, variants
        for name, variants in (owned or {}).items():
            owners = dict.fromkeys(x.owner for x in variants)
            searches += [(name, owner, [x for x in variants if x.owner == owner]) for owner in owners]
        for name, owner, space in searches:
            offered = offer(name)
            engine = _Engine(name, [], self._workers.enter_context(Worker()), offered.adaptive, owner=owner)
            if not offered.usable:
                engine.refused = offered.status, offered.reason
            else:
                engine.left, engine.variants = list(space), len(space)
                engine.options = {x.name: x.options for x in space}
            self.engines[engine.title] = engine

    def __enter__(self) -> "Recommender":
        return self

    def __exit__(self, *_: object) -> None:
        self._workers.close()

    def report(self, sentence: str) -> None:
        """Report a sentence of progress with the elapsed time; several threads may call this at once."""
        with self._report_lock:
            self._told(f"{self.budget.wall_time():5.1f} s  {sentence}")

    # The search for accurate settings

    def search(self) -> Truth:
        """Try variants until all have been tried or the time has ended; return the reference from which all errors are computed.

        Raises:
            NoTruth: no reference is accurate enough.
        """
        truth = self._truth()
        for kind, limit in self.wanted.items():
            if kind in truth.bars and not truth.bars[kind] <= KNOWN * limit:
                known = f"the error bar of the reference is {truth.bars[kind]:.1e} {UNITS[kind]}"
                raise NoTruth(f"{known}, more than a tenth of the required {limit:g} {UNITS[kind]}: {truth.description}")
        self.truth = truth
        # [s] the longest step, in which the fastest link turns by TURNED
        self.longest_step = TURNED / max(float(np.abs(angles(truth.reference.v)).max()), 1e-9)
        # With the first step that is tried, the reference's method would have an error of half the requirement. Its error is about
        # `halving` with `truth.steps` steps, and falls with steps^-ORDER.
        error_share = max(truth.halving[kind] / self.wanted[kind] for kind in self.wanted if kind in truth.halving)
        self.first_step = self.run.until / (truth.steps * (error_share / HALF.limit) ** (1 / ORDER))  # [s]
        threads = [threading.Thread(target=self._search_in_turn, daemon=True) for _ in range(LANES)]
        for thread in threads:
            thread.start()
        for thread in threads:
            while thread.is_alive():  # an interrupt of the user is noticed between two of these waits
                thread.join(0.2)
        if not self._failures.empty():
            raise self._failures.get()
        return truth

    def _truth(self) -> Truth:
        """Return the reference motion, computed in the worker process of the engine REFERENCE_ENGINE.

        If this engine takes part in the search, its model is compiled only once.
        """
        wanted = {k: KNOWN * x for k, x in self.wanted.items()}
        own = self.engines.get(REFERENCE_ENGINE)
        worker = own.worker if own is not None and own.refused is None else self._workers.enter_context(Worker())
        return compute_reference(self.run, wanted, lambda: self.budget.remaining(TRUTH), worker, self.report)

    def _search_in_turn(self) -> None:
        """Search one variant after the other until none is left; LANES threads run this. Errors are kept in `_failures`."""
        try:
            while (engine := self._next_engine()) is not None:
                self._search_variant(engine, engine.left.pop(0))
                with self._changed:
                    engine.busy = False
                    self._changed.notify_all()
        except BaseException as error:
            self._failures.put(error)

    def _next_engine(self) -> _Engine | None:
        """Wait until an engine is idle; return the one with the fewest variants tried, or None at the end of the search.

        After the time for the search, only engines without a run are considered.
        """
        with self._changed:
            while self._failures.empty():
                in_time = self.budget.remaining(SEARCHED) > 0
                waiting = [x for x in self.engines.values() if x.is_open and (in_time or not x.has_run)]
                idle = [x for x in waiting if not x.busy]
                if idle:
                    chosen = min(idle, key=lambda x: len(x.trials))
                    chosen.busy = True
                    return chosen
                if not waiting:
                    return None
                self._changed.wait(0.2)
        return None

    def _search_variant(self, engine: _Engine, variant: Variant) -> None:
        """Search one variant over its steps or tolerances, and store its trial runs in `engine.trials`."""
        way = Way(engine.name, variant.name, variant.integrator, variant.stabilization, 0.0)
        adaptive, before, is_first = variant.integrator in engine.adaptive, engine.best(), not engine.has_run
        trials: list[Trial] = []
        engine.trials[way] = trials
        scale, most = tolerances(smallest=12), 0  # tolerances down to 1e-12; most: largest number of steps, 0 if adaptive
        if not adaptive:
            most = self._step_limit(way, before)
            scale = no_coarser(equal_steps(self.run.until, BEATS, most), self.longest_step)
        by_size: dict[float, Trial] = {}  # the search evaluates some sizes twice
        # [s] of the budget; the first variant of an engine has twice an equal share of the time that is left for the search
        time_left = self.budget.remaining(SEARCHED)
        allowed = min(time_left, 2 * LANES * time_left / (1 + self._untried())) if is_first else time_left
        until = self.budget.seconds_used() + allowed

        def evaluate(size: float) -> Trial:
            """Return the trial at a step [s] or tolerance; if there is none yet, run it.

            Raises:
                _OutOfTime: the time allowed for the variant is used up.
            """
            if size not in by_size:
                # the first run of an engine is made in any case
                if (by_size or not is_first) and self.budget.seconds_used() >= until:
                    raise _OutOfTime
                by_size[size] = self._evaluate(engine, way._replace(size=size), adaptive)
                trials.append(by_size[size])
            return by_size[size]

        try:
            # if the time is over, the engine has a single run; half the usual step makes this run likely to be accurate
            is_late = is_first and self.budget.remaining(SEARCHED) <= 0
            first_step = self.first_step / 2 if is_late else self.first_step
            start = scale if adaptive else no_coarser(scale, first_step)
            # begin with coarser sizes as long as these are accurate enough
            while len(start.sizes) < len(scale.sizes) and evaluate(start.sizes[0]).meets(HALF):
                start = no_coarser(scale, 2 * start.sizes[0])
            explore(evaluate, start, [HALF], EVALUATED, most)
        except _OutOfTime:
            engine.cut = True
        if trials and not engine.has_run:  # the engine refused the linkage in every trial so far
            self._choose_after_refusal(engine, trials[-1])
        self._report_change(engine, before)

    def _untried(self) -> int:
        """Return the number of engines of which no variant was tried yet."""
        return sum(not x.trials and x.refused is None for x in self.engines.values())

    def _choose_after_refusal(self, engine: _Engine, trial: Trial) -> None:
        """After an engine refused the linkage, keep the variants whose time loop has not been tried.

        If there are none and only one variant was tried, a variant with another integrator is kept. Otherwise the refusal is final.
        """
        loops = {engine.loop_of(way) for way in engine.trials}
        others = [x for x in engine.left if str(x.options.get("loop", "")) not in loops]
        if not others and len(engine.trials) == 1:
            others = [x for x in engine.left if x.integrator != next(iter(engine.trials)).integrator][:1]
        engine.left = others
        engine.refused = None if others else (trial.status, trial.message)

    def _step_limit(self, way: Way, before: TriedSetting | None) -> int:
        """Return the largest number of steps of a variant: its work is at most SPARE times that of the engine's best setting.

        At least 2 DENSE and at most MOST steps are allowed. `before` is the best setting so far, or None.
        """
        if before is None:
            return MOST
        steps = SPARE * before.work / EVALUATIONS.get(way.integrator, 1)
        return int(min(MOST, max(steps, 2 * DENSE)))

    def _evaluate(self, engine: _Engine, way: Way, adaptive: bool) -> Trial:
        """Run a setting and return the trial run.

        Its errors include SHARE, the largest ratio of an error to its allowed value, and LOOPS, the largest gap of a joint [m], if
        it is limited.
        """
        assert self.truth is not None
        steps = BEATS if adaptive else round(self.run.until / way.size)
        # the number of samples divides the number of steps, so that no shorter step is needed to meet a sample
        samples = BEATS if adaptive else max(x for x in range(1, DENSE + 1) if steps % x == 0)
        sampling = sample(self.run, steps, samples)
        limit, wall = self._limit(engine), max(self.budget.remaining_wall_time(TRIED), 1.0)
        engine.longest_limit = max(engine.longest_limit, min(limit, wall))
        request = request_of(self.run, way, adaptive, sampling)
        # keep_model: the worker keeps the model, because further runs of this engine follow
        ran = run_apart(request, self.run.mechanism, limit, engine.worker, keep_model=True, longest=wall)
        trial = judge_trial(self.run, self.judge, self.truth.at(self.run, sampling.times), way, ran)
        if trial.status is not Status.OK:
            return trial
        errors = dict(trial.errors)
        if LOOPS in self.wanted and ran.trajectory is not None:
            errors[LOOPS] = float(drift(self.judge, ran.trajectory).position.max())
        # an undetermined error (NaN) makes the share NaN, which meets no requirement
        worst = share(replace(trial, errors=errors), [Requirement(*x) for x in self.wanted.items()])
        return replace(trial, errors=errors | {SHARE: worst})

    def _limit(self, engine: _Engine) -> float:
        """Return the time limit of a run [s]; it is longer for the first run of an engine, which loads or compiles its library.

        The time until the share TRIED of the budget is divided equally among the engines that wait for their first run.
        """
        # the time until the end of the search, which a run may exceed by the share AFTER of the budget
        time_left = self.budget.remaining(SEARCHED + AFTER)
        if engine.has_run:
            return max(min(LONGEST * self.budget.seconds, time_left), 1.0)
        first_share = max(time_left, LANES * self.budget.remaining(TRIED) / (1 + self._untried()))
        return max(min(2 * LONGEST * self.budget.seconds, first_share), ONE_TRY * self.budget.seconds, 1.0)

    def _report_change(self, engine: _Engine, before: TriedSetting | None) -> None:
        """Report how the search of a variant changed the state of an engine whose best setting was `before` (None without one).

        Reported are a cheaper setting, a refusal, and the errors of an engine's first variant if it is not accurate.
        """
        after = engine.best()
        if after is None:
            near = nearest(engine.all_trials(), SHARE)
            if engine.refused:
                status, reason = engine.refused
                self.report(f"{engine.title}: {status}: {reason}")
            elif near is not None and len(engine.trials) == 1:
                self.report(f"{engine.title}: not accurate yet; nearest {self._errors(near)}")
        elif before is None or after.work < before.work:
            how = "holds" if before is None else "better"
            self.report(f"{engine.title}: {how}: {describe_setting(after.way, engine)}: {self._errors(after.trial)}")
            with self._report_lock:  # a preliminary answer: there are no times of this setting or of the fastest engine yet
                self._better(replace(self._accepted_answer(engine, after, None, None), message="not raced yet"))

    def _errors(self, trial: Trial) -> str:
        """Return the errors of a trial run, of the kinds that are required, as text."""
        return format_errors(trial.errors, self.wanted, ", ")

    # The timing of the accurate settings

    def race(self) -> dict[Way, Array]:
        """Time the accurate settings side by side in one process; return setting -> run time in each round (rounds,) [s]."""
        chosen: dict[Way, int | None] = {}  # setting -> number of steps
        by_engine = [list_raced(x) for x in self.engines.values()]
        for rank in range(CHOICES):  # the first settings of all engines before the second of any: time may end before all are timed
            chosen |= {settings[rank].way: settings[rank].trial.steps for settings in by_engine if rank < len(settings)}
        if not chosen or self.budget.remaining(RACED) <= 0:
            return {}
        names = list(dict.fromkeys(x.engine for x in chosen))
        self.report(f"race: {len(chosen)} settings of {len(names)} engines")
        motion = (self.run.linkage, self.run.mechanism.scenario, self.run.until, BEATS)
        deadline = time.monotonic() + self.budget.remaining(RACED)
        arguments = (*motion, [[*way, steps] for way, steps in chosen.items()], deadline)
        limit, longest = max(1.0, self.budget.remaining()), max(1.0, self.budget.remaining_wall_time())  # [s]
        try:
            tables, lost = list_survivors(race_there, arguments, names, limit, longest)
        except WorkerFailure as error:
            self.report(f"race: {error}")
            self.lost = {} if error.status is Status.TIMEOUT else dict.fromkeys(names, str(error))
            return {}
        self.lost = {row["engine"]: row["message"] for row in tables["failed"]} | {name: str(x) for name, x in lost.items()}
        for name, failure in self.lost.items():
            self.report(f"race: {name}: {failure}")
        return {Way(*row["way"]): np.array(row["seconds"]) for row in tables["race"] if row["seconds"]}

    def answers(self, times: Mapping[Way, Array]) -> list[Answer]:
        """Return an answer for every engine: first those that meet the requirement, the fastest first, then the others.

        `times` maps a timed setting to its run time in each round (rounds,) [s].
        """
        chosen: dict[str, TriedSetting] = {}  # title of an engine -> its setting
        for engine in self.engines.values():
            accurate = {x.way: x for x in engine.accurate_settings()}
            if timed := {way: times[way] for way in accurate if way in times}:
                winner, *_ = pick_winner(timed)
                chosen[engine.title] = accurate[winner]
            elif best := engine.best():
                chosen[engine.title] = best
        fastest = min((times[x.way] for x in chosen.values() if x.way in times), key=time_of, default=None)
        accepted = []
        for title, setting in chosen.items():
            engine = self.engines[title]
            # an engine with contributed settings stands twice in `engines`: each time with other settings
            own_times = {way: x for way, x in times.items() if way.settings in engine.options}
            answer = self._accepted_answer(engine, setting, times.get(setting.way), fastest)
            accepted.append(replace(answer, loops=loop_ratios(engine, own_times, fastest)))
        accepted.sort(key=lambda x: math.inf if x.ratio is None else x.ratio)  # settings that were not timed come last
        return accepted + [self._answer_without_setting(x) for x in self.engines.values() if x.title not in chosen]

    def call_worker(self, engine: str, function: Callable[..., Any], arguments: tuple[Any, ...], least: float = 1.0) -> Any:
        """Call function(*arguments) in the worker process of an engine, and return the result.

        The call must end at LAST times the budget, but has at least `least` seconds of processor time, and WAITS times as much wall
        time, because other programs may have the processor.

        Raises:
            WorkerFailure: the call failed or took too long.
        """
        limit = max(least, self.budget.remaining(LAST))
        longest = max(WAITS * least, self.budget.remaining_wall_time(LAST))
        worker = self.engines[engine].worker.under(interpreter_of(engine))
        return worker.call(function, arguments, limit, longest=longest)

    def _counts(self, engine: _Engine) -> dict[str, Any]:
        """Return the fields of an answer that do not depend on the recommended setting."""
        complete = not engine.cut and not engine.is_open
        counts = {"tried": len(engine.trials), "variants": engine.variants, "evaluations": len(engine.all_trials())}
        return counts | {"complete": complete, "owner": engine.owner}

    def _accepted_answer(self, engine: _Engine, setting: TriedSetting, seconds: Array | None, fastest: Array | None) -> Answer:
        """Return the answer for an engine with a setting that meets the requirement.

        `seconds` are the run times of this setting (rounds,), and `fastest` those of the fastest engine; None if not timed.
        """
        way, trial = setting
        fields = self._counts(engine) | engine.size_of(way)
        message = ""
        if seconds is not None and fastest is not None:
            fields |= spread("seconds", seconds) | ratio_columns(seconds, fastest)
        else:
            message = f"holds, not raced: {self.lost.get(engine.name, f'the time ended first; {MORE}')}"
        choice = choice_of(way, way.integrator in engine.adaptive, self.run.until)
        return Answer(
            engine.name,
            str(Status.OK),
            message,
            way.settings,
            way.integrator,
            way.stabilization,
            steps=trial.steps,
            errors=known_errors(trial),
            options=engine.options.get(way.settings, {}),
            in_python=in_python(engine.name, self.run.mechanism, choice),
            **fields,
        )

    def _answer_without_setting(self, engine: _Engine) -> Answer:
        """Return the answer for an engine without a setting that meets the requirement."""
        reason = find_reason(engine)
        # an engine that cannot model the linkage is skipped, which is no failure
        status = str(Status.SKIP if reason.kind in (Kind.NO_MODEL, Kind.UNDETERMINED) else reason.kind)
        near, counts = engine.nearest(), self._counts(engine)
        if reason.kind is not Kind.NOT_REACHED or near is None:
            return Answer(engine.name, status, reason.words, **counts)
        untried = "" if counts["complete"] else "; some variants were not tried"
        message = f"{reason.words}; nearest {self._errors(near.trial)} with {describe_setting(near.way, engine)}{untried}"
        return Answer(engine.name, status, message, steps=near.trial.steps, errors=known_errors(near.trial), **counts)


def known_errors(trial: Trial) -> dict[str, float]:
    """Return kind -> error of a trial run [m], [rad], [N], without SHARE and without undetermined errors (NaN)."""
    return {kind: x for kind, x in trial.errors.items() if kind in UNITS and not math.isnan(x)}


def list_raced(engine: _Engine) -> list[TriedSetting]:
    """Return at most CHOICES settings of an engine to be timed: those whose work is at most NEAR times the least work.

    For each time loop that none of them uses, the setting with the least work in this loop is added, if necessary in place of the
    last of them. Adaptive integrators count as near, because their run time does not follow from the number of evaluations.
    """
    settings = engine.accurate_settings()  # by increasing work
    least = min((x.work for x in settings), default=0.0)
    near = [x for x in settings if x.work <= NEAR * least or x.way.integrator in engine.adaptive][:CHOICES]
    by_loop = {engine.loop_of(x.way): x for x in reversed(settings)}  # the last of a loop, the one with the least work, is kept
    covered = {engine.loop_of(x.way) for x in near}
    others = [x for loop, x in by_loop.items() if loop not in covered]
    return [*near[: CHOICES - len(others)], *others]


def loop_ratios(engine: _Engine, times: Mapping[Way, Array], fastest: Array | None) -> dict[str, float]:
    """Return name of a time loop -> run time of its fastest setting divided by the run time of the fastest engine.

    The result is empty unless settings of several time loops were timed. `times` has the run times of each setting in each round
    (rounds,) [s], and `fastest` those of the fastest engine.
    """
    seconds: dict[str, list[float]] = {}
    for way, x in times.items():
        if way.engine == engine.name:
            seconds.setdefault(engine.loop_of(way), []).append(time_of(x))
    if fastest is None or len(seconds) < 2:
        return {}
    return {loop: min(some) / time_of(fastest) for loop, some in seconds.items()}


def find_reason(engine: _Engine) -> Reach:
    """Return why an engine has no setting that meets the requirement: the kind of reason, and a sentence."""

    def not_tried(reason: str) -> Reach:
        return Reach(Kind.NOT_TRIED, f"{reason}; {MORE}", within="within the budget")

    trials = engine.all_trials()
    if engine.refused is not None:
        status, reason = engine.refused
        if status is not Status.SKIP:
            return Reach(Kind.NOT_TRIED, reason)
        # a refusal is judged like a single trial that was skipped
        return reach([[Trial(math.nan, {}, 0, status, reason)]], [HALF])
    if not trials:
        return not_tried("no variant was tried")
    if engine.left and not engine.has_run:
        return not_tried(f"the tried variants refused ({trials[0].message})")
    # a refusal or crash at one setting says nothing about the errors of runs that did not end in time
    statuses = {trial.status for trial in trials}
    if Status.TIMEOUT in statuses and Status.OK not in statuses:
        return not_tried(f"no run ended within its {engine.longest_limit:.3g} s")
    return reach(engine.trials.values(), [HALF])


def describe_setting(way: Way, engine: _Engine) -> str:
    """Return a setting of an engine as text."""
    return format_setting(way.settings, way.integrator, way.stabilization, **engine.size_of(way))
