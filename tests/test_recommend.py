"""Recommendations hold what they promise, in the time that they are given, and are the same again."""

import json
import subprocess
import sys
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

import gauss_bench
from gauss_bench.advice import budget
from gauss_bench.advice import truth as truths
from gauss_bench.advice.answer import Answer, format_setting
from gauss_bench.advice.budget import Budget
from gauss_bench.advice.recommending import SHARE, WRITTEN, Recommender, TriedSetting, _Engine, find_reason, list_raced, loop_ratios
from gauss_bench.advice.truth import NoTruth, Truth, compute_reference, interpolate
from gauss_bench.api.recommend import Recommendation, list_remarks, list_variants, recommended_answer, with_snippet, write_advice
from gauss_bench.bench.ways import Run, Way, loop_of, request_of, sample
from gauss_bench.cli import main
from gauss_bench.engines import get
from gauss_bench.engines.base import Choice, Variant
from gauss_bench.exchange.export import write_snippet
from gauss_bench.linkage.load import built_in, load
from gauss_bench.mechanism.evaluate import Evaluator
from gauss_bench.reach import Trial
from gauss_bench.runs.apart import run_apart
from gauss_bench.runs.offers import offer
from gauss_bench.runs.one_run import Run as Ended
from gauss_bench.runs.worker import Worker, WorkerFailure
from gauss_bench.trajectory import Reference, Status, Trajectory
from tests.alone import python_alone, rows_of
from tests.conftest import DATA, needs
from tests.engine_runs import by_gauss
from tests.plugin import installed

SHORT = Run("crank_slider", load("crank_slider"), 0.2)


def recommending(spaces=None, budget=None, **wanted):
    """A recommendation for SHORT, of which nobody hears."""
    return Recommender(SHORT, wanted or {"position": 1e-6}, spaces or {}, budget or Budget(60.0), len)


@pytest.fixture
def recommender():
    with recommending() as made:
        yield made


@pytest.fixture(scope="module")
def workers():
    with Worker() as one, Worker() as other:
        yield one, other


def test_between_samples_a_motion_of_degree_five_is_exact():
    t, at = np.linspace(0.0, 1.0, 5), np.linspace(0.0, 1.0, 41)
    p = np.polynomial.Polynomial([0.1, -2.0, 3.0, 0.5, -4.0, 7.0])
    none = np.zeros(5)
    q, v, a = (x(t)[:, None] for x in (p, p.deriv(), p.deriv(2)))
    x, u = interpolate(Reference(t, q, v, a, none, none, none, none, none, none, ""), at)
    np.testing.assert_allclose(x[:, 0], p(at), rtol=0, atol=1e-14)
    np.testing.assert_allclose(u[:, 0], p.deriv()(at), rtol=0, atol=1e-13)


@cache
def moving(steps, opened=0.0):
    """The crank-slider over SHORT by so many steps of order eight; its rod is moved along x by `opened` [m]."""
    h = SHORT.until / steps
    x = by_gauss(SHORT.mechanism, h * np.arange(steps + 1), integrator="dop853_fixed", step=h)
    q = x.q.copy()
    q[:, 3] += opened
    return replace(x, q=q)


def test_the_bar_of_a_truth_holds_what_halving_changes_what_joints_open_by_and_what_lies_between_samples():
    judge = Evaluator(SHORT.mechanism)
    exact, coarse, fine = moving(320), moving(20), moving(40)
    plain = truths._compare(SHORT, judge, coarse, fine, 20, "gauss")
    changed = np.abs(coarse.q - fine.q[::2]).reshape(-1, 3, 3)
    assert plain.halving["angle"] == pytest.approx(changed[..., 2].max(), rel=1e-6)
    off = np.abs(interpolate(plain.reference, exact.t)[0] - exact.q).reshape(-1, 3, 3)
    assert off[..., 2].max() > 2 * plain.halving["angle"]  # here the bar is that of what lies between samples
    assert plain.bars["angle"] >= off[..., 2].max()
    assert plain.bars["position"] >= np.hypot(off[..., 0], off[..., 1]).max()
    opened = truths._compare(SHORT, judge, moving(20, opened=1e-3), moving(40, opened=1e-3), 20, "gauss")
    for kind in ("position", "angle"):
        assert opened.bars[kind] >= plain.bars[kind] + 0.999e-3


def known(coarse=40, **changes):
    """The truth of runs of so many steps and twice as many, with other bars if they are given."""
    judge = Evaluator(SHORT.mechanism)
    return replace(truths._compare(SHORT, judge, moving(coarse), moving(2 * coarse), coarse, "gauss"), **changes)


def test_a_truth_serves_that_is_known_to_a_tenth_of_what_is_required(monkeypatch):
    for share, serves in ((0.09, True), (0.11, False)):
        bars = {"position": share * 1e-6}
        monkeypatch.setattr(Recommender, "_truth", lambda recommender, bars=bars: known(bars=bars))
        with recommending() as recommender:
            if serves:
                assert recommender.search().bars == bars
            else:
                with pytest.raises(NoTruth, match="more than a tenth of the required 1e-06 m"):
                    recommender.search()


def test_a_truth_has_the_linkages_own_accelerations_to_a_millionth():
    judge, coarse, fine = Evaluator(SHORT.mechanism), moving(20), moving(40)
    near, off = (replace(fine, a=fine.a * (1 + x)) for x in (0.9e-6, 1.1e-6))
    assert truths._compare(SHORT, judge, coarse, near, 20, "gauss").steps == 20
    with pytest.raises(NoTruth, match="accelerations of gauss differ from those of the linkage by 1"):
        truths._compare(SHORT, judge, coarse, off, 20, "gauss")


def test_a_certificate_vouches_for_what_lies_within_a_thousand_bars_of_it():
    """A motion that is found 1e-3 m or so beside the certified one, with a bar of a micrometre."""

    def moved(off):
        found = known()
        q = found.reference.q.copy()
        q[:, 3] += off
        return replace(found, reference=replace(found.reference, q=q), bars=found.bars | {"position": 1e-6, "angle": 1e-7})

    certified = truths._certify(SHORT, moved(0.9e-3))
    assert certified.certified
    assert certified.bars["position"] == pytest.approx(0.9e-3, rel=1e-3)
    with pytest.raises(NoTruth, match="the motion found and the certified one differ by 1"):
        truths._certify(SHORT, moved(1.1e-3))


@pytest.mark.parametrize(
    ("bars", "wanted", "seconds", "taken", "best"),
    [
        ((1e-3, 1e-5, 1e-7), 1e-5, 60.0, [100, 200, 200, 400], 1e-5),
        ((1e-6,), 1e-5, 60.0, [100, 200], 1e-6),
        ((1e-3, 1e-4, 2e-4, 1e-9), 1e-9, 60.0, [100, 200, 200, 400, 800], 1e-4),  # rounding: the third is no better
        ((1e-3, 1e-4, 1e-4, 1e-9), 1e-9, 60.0, [100, 200, 200, 400, 800], 1e-4),
        ((1e-9,), 1e-5, 0.0, [], None),
        (tuple(0.5**k for k in range(12)), 1e-9, 60.0, [100, 200, *(100 << k for k in range(1, 13))], 0.5**11),
    ],
)
def test_a_motion_is_followed_in_ever_smaller_steps_until_that_serves(bars, wanted, seconds, taken, best, monkeypatch):
    """Two runs are looked at first; where they do not serve, numpy begins with the second of them, as there is no compiler."""

    def known_to(run, judge, coarse, fine, steps, engine):
        bar = next(found)
        return Truth(None, {"position": bar, "angle": bar}, {}, steps, False, "")

    seen, found, x = list[int](), iter(bars), Trajectory(*(np.zeros(1),) * 4, 0)
    monkeypatch.setattr(truths, "find_spec", lambda name: None)  # no compiler
    monkeypatch.setattr(truths, "_run", lambda run, engine, steps, left, worker: seen.append(steps) or x)
    monkeypatch.setattr(truths, "_compare", known_to)
    monkeypatch.setattr(truths, "_certify", lambda run, truth: truth)
    if best is None:
        with pytest.raises(NoTruth, match="no reference within 0 s, its share of the budget; a larger --budget helps"):
            compute_reference(SHORT, {"position": wanted}, lambda: seconds, Worker(), len)
    else:
        assert compute_reference(SHORT, {"position": wanted}, lambda: seconds, Worker(), len).bars["position"] == best
    assert seen == taken


def test_a_motion_that_cannot_be_followed_says_why(monkeypatch):
    monkeypatch.setattr(truths, "find_spec", lambda name: None)  # no compiler
    monkeypatch.setattr(truths, "_run", lambda *_: "the matrix is singular")
    told = []
    with pytest.raises(NoTruth, match="cannot be followed: the matrix is singular"):
        compute_reference(SHORT, {}, lambda: 60.0, Worker(), told.append)
    assert told == ["reference: gauss: the matrix is singular"] * 2


def test_loops_are_required_of_the_whole_run(monkeypatch):
    """A run whose loops open on its way and are closed at its end."""
    open_once = moving(40)
    open_once = replace(open_once, q=open_once.q + 1e-3 * (np.arange(41) == 20)[:, None] * (np.arange(9) == 3))
    monkeypatch.setattr(
        "gauss_bench.advice.recommending.run_apart", lambda request, *_, **__: Ended(Status.OK, "", open_once, None, request.wanted)
    )
    with recommending({"gauss": list_variants(offer("gauss"))}, loops=1e-6) as recommender:
        recommender.truth = known()
        engine = recommender.engines["gauss"]
        trial = recommender._evaluate(engine, Way("gauss", "default", "rk4", "none", SHORT.until / 40), adaptive=False)
    assert trial.errors["loops"] >= 0.999e-3
    assert trial.errors[SHARE] == pytest.approx(trial.errors["loops"] / 1e-6)


@pytest.mark.slow
def test_what_is_recommended_holds_half_of_all_that_is_required():
    needs("llvmlite")
    needs("cc", "gcc", "clang")
    found = gauss_bench.recommend("crank_slider", 1e-6, angle=1e-5, until=0.2, engines=("minimal", "by_hand"), budget=900.0)
    for answer in found.answers:
        assert answer.status == "ok", answer
        assert answer.errors["position"] <= 0.5e-6
        assert answer.errors["angle"] <= 0.5e-5
        assert (answer.step is None) != (answer.tolerance is None)
    assert found.certified
    assert all(found.known[kind] <= 0.1 * x for kind, x in found.required.items())
    ratios = [x.ratio for x in found.answers]
    assert ratios[0] == 1.0
    assert ratios[1] is None or ratios[1] >= 1.0
    assert found.advice.startswith(f"Take {found.answers[0].engine} with ")


ARM = str(DATA / "excavator_arm.toml")
PASTED = [  # linkage, scenario, engine, settings, integrator, stabilisation, step or tolerance
    ("crank_slider", "paper", "mujoco", "tuned_chain/1", "rk4", "none", 2e-3),
    ("crank_slider", "paper", "pinocchio", "one/dop853_fixed/least depth", "dop853_fixed", "none", 2e-3),
    ("crank_slider", "paper", "casadi", "sundials/cvodes_adams", "cvodes_adams", "none", 1e-8),
    ("excavator", "dig", "mujoco", None, "rk4", "none", 2e-3),  # a driven link, on a driven length
    ("four_bar", "cycloid", "exudyn", None, "generalized_alpha", "none", 2e-3),
]
PASTED_TOO = [
    ("crank_slider", "paper", "mujoco", "rigid_lean/2", "rk4", "none", 2e-3),
    ("crank_slider", "paper", "pinocchio", "one_drawn_shut", "dop853", "baumgarte", 1e-8),
    ("crank_slider", "paper", "casadi", "interpreted/dop853_fixed", "dop853_fixed", "none", 2e-3),
    (ARM, "lift", "pinocchio", None, "rk4", "none", 2e-3),
    (ARM, "lift", "exudyn", None, "generalized_alpha", "none", 2e-3),
]


@pytest.mark.parametrize("case", [*PASTED, *(pytest.param(x, marks=pytest.mark.long) for x in PASTED_TOO)], ids=str)
@pytest.mark.slow
def test_a_pasted_program_moves_as_the_engine_was_judged(case, tmp_path):
    """In a process that cannot import this package, by every kind of step that a program may take."""
    linkage, scenario, engine, settings, integrator, stabilization, size = case
    needs(engine)
    settings = settings or next(x.name for x in list_variants(offer(engine)) if x.integrator == integrator)
    mechanism, end, adaptive = load(linkage, scenario), 0.1, integrator in offer(engine).adaptive
    choice = Choice(settings, integrator, stabilization, 0.01 if adaptive else size, size if adaptive else None)
    file = tmp_path / "pasted.py"
    file.write_text(write_snippet(mechanism, mechanism.name, engine, choice, end, ()))
    _, rows = rows_of(python_alone(file, end, choice.step))
    model = get(engine).build(mechanism, choice)
    model.prepare(rows[:, 0])
    model.run()
    run = model.read()
    assert len(rows) > 10
    np.testing.assert_allclose(rows[:, 1:], np.hstack([run.q, run.v]), rtol=0, atol=1e-10 * (1 + np.abs(run.v).max()))


ADAPTIVE = """
from dataclasses import replace
from gauss_bench.engines.interpreted import Interpreted

class Ode(Interpreted):
    adaptive = ("ode",)
    def __init__(self):
        super().__init__("gauss")
        self.name, self.integrators, self.stabilizations, self.settings = "ode", ("ode",), ("none",), {"default": {}}
        self.options = ()
    def build(self, mechanism, choice):
        assert choice.tolerance <= 1e-7  # the program's, or the tighter one of the repetition that judges it
        return Interpreted("gauss").build(mechanism, replace(choice, integrator="dop853"))
"""


@pytest.mark.parametrize("name", ["crank_slider", *(pytest.param(x, marks=pytest.mark.long) for x in ("four_bar", "shaper"))])
def test_the_program_of_an_engine_with_a_tolerance_starts(name, tmp_path):
    """An engine of others too, which has no option for it: the tolerance is a part of the choice."""
    environment = installed(tmp_path, ADAPTIVE, ("ode",))
    for engine, integrator in (("gauss", "dop853"), ("ode", "ode")):
        program = tmp_path / f"run-{engine}.py"
        program.write_text(write_snippet(load(name), name, engine, Choice("default", integrator, "none", 0.01, 1e-7), 0.05, ()))
        command = [sys.executable, str(program)]
        ended = subprocess.run(command, cwd="/", env=environment, capture_output=True, text=True, timeout=300, check=False)
        assert ended.returncode == 0, ended.stderr
        run = json.loads(ended.stdout)
        assert (run["status"], run["engine"], run["t"]) == ("ok", engine, [0.0, 0.05]), run["message"]


@pytest.mark.long
def test_recommended_programs_start_from_any_folder(tmp_path, monkeypatch):
    """One finds the user's file by its whole path; none has the name of a library that it imports."""
    needs("mujoco")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("PYTHONPATH", str(Path(gauss_bench.__file__).parents[1]))
    Path("crank_slider.toml").write_bytes(built_in()["crank_slider"].read_bytes())
    asked = ["--position", "1e-2", "--until", "0.02", "--engine", "gauss", "--engine", "mujoco", "--out", "made"]
    assert main(["recommend", "crank_slider.toml", *asked]) == 0
    for name in ("gauss", "mujoco"):
        command = [sys.executable, str(tmp_path / "made" / f"run-{name}.py")]
        assert subprocess.run(command, cwd="/", capture_output=True, timeout=300, check=True).stdout


@pytest.mark.slow
@pytest.mark.long("gauss-native-default-dop853_fixed", "minimal-fixed/rk4-rk4", "pinocchio-one/rk4/least depth-rk4")
@pytest.mark.parametrize(
    ("engine", "settings", "integrator"),
    [
        ("gauss", "default", "rk4"),
        ("exudyn", "every_step/generalized_alpha/EXUdense", "generalized_alpha"),
        ("casadi", "sundials/cvodes_adams", "cvodes_adams"),
        ("gauss-native", "default", "dop853_fixed"),
        ("minimal", "fixed/rk4", "rk4"),
        ("pinocchio", "one/rk4/least depth", "rk4"),
    ],
)
def test_a_model_that_is_given_another_step_moves_as_one_that_is_built_for_it(engine, settings, integrator, workers):
    """Bit for bit: a search builds each model once."""
    needs("llvmlite" if engine in ("gauss", "gauss-native", "minimal") else engine)
    adaptive, (one, other) = integrator in offer(engine).adaptive, workers
    for size in (1e-4, 1e-8) if adaptive else (0.02, 0.005):
        count = 40 if adaptive else round(SHORT.until / size)
        wanted = request_of(SHORT, Way(engine, settings, integrator, "none", size), adaptive, sample(SHORT, count, 10))
        kept = run_apart(wanted, SHORT.mechanism, 100.0, one, keep_model=True)
    anew = run_apart(wanted, SHORT.mechanism, 100.0, other)
    assert kept.trajectory is not None, kept.message
    assert anew.trajectory is not None, anew.message
    assert np.array_equal(kept.trajectory.q, anew.trajectory.q)
    assert np.array_equal(kept.trajectory.a, anew.trajectory.a)


@pytest.fixture
def slow(monkeypatch):
    """A clock on the wall and the seconds that others had the processor: [wall, waited], to be set."""
    clock = [0.0, 0.0]
    monkeypatch.setattr(budget.time, "monotonic", lambda: clock[0])
    monkeypatch.setattr(budget, "waiting_times", lambda: {"worker": clock[1] / 2, "other worker": clock[1] / 2})
    return clock


def test_what_a_busy_machine_takes_does_not_count_up_to_the_wall(slow):
    """Two workers at a time, each of which waits half of the time: half of the seconds count."""
    own = Budget(60.0)
    slow[:] = 40.0, 40.0
    assert own.seconds_used() == pytest.approx(20.0)
    assert own.remaining() == pytest.approx(40.0)
    slow[0] = 60.0
    assert own.seconds_used() == pytest.approx(40.0), "nobody waited meanwhile"
    assert own.remaining(0.5) == pytest.approx(-18.0), "half of the budget ends at 42 s by the clock on the wall at the latest"
    slow[:] = 86.0, 1000.0
    assert own.seconds_used() == 0.0
    assert own.remaining() == pytest.approx(-2.0)
    assert own.remaining(1.25) == pytest.approx(1.0), "everything has ended within one and a half times the budget"


@pytest.mark.skipif(not budget.waiting_times(), reason="this system does not tell of waiting")
def test_processes_that_it_has_started_are_asked():
    with Worker() as worker:
        process = worker.start()
        assert process.pid in budget.waiting_times()


def test_of_an_engine_with_two_loops_both_are_raced_and_told():
    """Compiled, the least work of six settings; called from Python the last of them: 3 and 60 times the fastest of all."""
    ways = {name: Way("pinocchio", name, "dop853_fixed", "none", 0.0) for name in offer("pinocchio").variants}
    compiled = [way for way in ways.values() if loop_of(way) == "compiled"][:5]
    called = next(way for way in ways.values() if loop_of(way) == "called from Python")
    trials = {way: [Trial(0.01, {SHARE: 0.4}, 100 + k, evaluations=100 + k)] for k, way in enumerate([*compiled, called])}
    options = {name: x.options for name, x in offer("pinocchio").variants.items()}
    engine = _Engine("pinocchio", [], Worker(), (), trials=trials, options=options)
    chosen = [way._replace(size=0.0) for way, _ in list_raced(engine)]
    assert chosen == [*compiled[:3], called]
    seconds = (3e-3, 4e-3, 5e-3, 6e-3, 7e-3, 6e-2)
    times = {way._replace(size=0.01): np.full(3, x) for way, x in zip((*compiled, called), seconds, strict=True)}
    told = loop_ratios(engine, times, np.full(3, 1e-3))
    assert told == pytest.approx({"compiled": 3.0, "called from Python": 60.0})
    assert loop_ratios(replace(engine, name="mujoco"), times, np.full(3, 1e-3)) == {}
    answer = Answer("pinocchio", "ok", loops=told)
    assert list_remarks(SHORT, [answer])[0].endswith(": compiled 3, called from Python 60")


def engine_with(*trials, refused=None):
    way = Way("exudyn", "default", "rk4", "none", 0.0)
    return _Engine("exudyn", [], Worker(), (), trials={way: list(trials)} if trials else {}, longest_limit=6.0, refused=refused)


def test_what_was_not_tried_or_took_too_long_is_not_said_to_be_impossible():
    """Each answer that recommendations give where nothing holds; the words are those of every page."""
    late, crashed = Trial(0.1, {}, 0, Status.TIMEOUT, "no answer within 6 s"), Trial(0.05, {}, 20, Status.CRASHED, "SIGSEGV")
    refused = Trial(0.1, {}, 0, Status.SKIP, "no drivers")
    no_turn = "not tried within the budget: no variant was tried; a larger --budget helps"
    no_end = "not tried within the budget: no run ended within its 6 s; a larger --budget helps"
    refusal = "not tried within the budget: the tried variants refused (no drivers); a larger --budget helps"
    answers = [
        (no_turn, engine_with()),
        *((no_end, engine_with(late, *others)) for others in ((), (crashed,), (refused,))),
        ("not reached in 10 steps", engine_with(Trial(0.1, {SHARE: 2.0}, 10), late)),
        (refusal, replace(engine_with(refused), left=list_variants(offer("gauss"))[:1])),
        ("cannot be modelled: no knife edge", engine_with(refused=(Status.SKIP, "no knife edge"))),
        ("not tried: ImportError: broken", engine_with(refused=(Status.ERROR, "ImportError: broken"))),
    ]
    for words, engine in answers:
        assert find_reason(engine).words == words
    assert "raise --budget" in write_advice([Answer("exudyn", "not tried", no_end)], {"position": 1e-6})


def test_the_program_that_is_shown_is_that_of_the_advice():
    """Of two engines that hold, one was raced, and the program of the other could be written."""
    timed = dict.fromkeys(("seconds", "seconds_low", "seconds_high"), 5e-3) | dict.fromkeys(
        ("ratio", "ratio_low", "ratio_high"), 1.0
    )
    held = Answer("", "ok", "", "default", "rk4", "none", 0.01, errors={"position": 1e-7})
    raced = replace(held, engine="mujoco", snippet="run_mujoco()", **timed)
    unraced = replace(held, engine="gauss-native", message="holds, not raced: the time ended first", snippet="run_native()")

    def told_as(answers):
        sentence = write_advice(answers, {"position": 1e-6})
        made = ("step-halved", False, {"position": 1e-9}, (*answers,), sentence, (), False)
        return Recommendation("rig", "free", 0.2, {"position": 1e-6}, *made).text

    text = told_as([raced, unraced])
    assert "Take mujoco with " in text
    assert "run_mujoco()" in text
    assert "run_native()" not in text
    text = told_as([replace(raced, snippet="", message="no answer within 1 s"), unraced])
    assert "run_native()" not in text
    assert "Its program: no answer within 1 s." in text
    assert "Take mujoco with rk4, step 0.01 s: it holds 1e-06 m with 1.0e-07 m in 5 ms a run. Accurate, not raced: gauss-" in text
    text = told_as([unraced])
    assert "Take gauss-native with rk4, step 0.01 s: it holds 1e-06 m with 1.0e-07 m (no setting was raced)." in text
    assert "run_native()" in text
    assert recommended_answer([unraced, raced]) is raced


def test_the_program_of_the_advice_is_written_after_the_time_has_ended(monkeypatch):
    """Where all time is used, it has 15 s of work and a minute of elapsed time; any other program has 1 s and 4 s."""
    limits = []

    def call(worker, function, arguments, limit, longest):
        limits.append((limit, longest))
        return {"answer": "run()"}

    monkeypatch.setattr(Worker, "call", call)
    with recommending(budget=Budget(1e-9)) as recommender:
        recommender.engines = {"exudyn": engine_with()}
        answer = Answer("exudyn", "ok", "", "default", "rk4", "none", 0.01, errors={"position": 1e-7, "angle": 1e-7})
        for least in (WRITTEN, 1.0):
            assert with_snippet(recommender, answer, least).snippet == "run()"
    assert limits == [(15.0, 60.0), (1.0, 4.0)]


def test_what_a_busy_machine_answers_differs_in_what_was_not_tried(slow, monkeypatch):
    """Runs of 6 s of work, which a busy machine lets wait for 3 s; and so long that the limit of elapsed time ends the search."""
    spaces = {name: list_variants(offer(name))[:2] for name in ("gauss", "schur", "lagrange")}
    monkeypatch.setattr(Recommender, "_truth", lambda recommender: known())
    monkeypatch.setattr("gauss_bench.advice.recommending.LANES", 1)

    def search(seconds, wall, waited):
        slow[:] = 0.0, 0.0

        def evaluate(recommender, engine, way, adaptive):
            slow[:] = slow[0] + wall, slow[1] + waited
            return Trial(way.size, {SHARE: 0.1, "position": 1e-7}, round(SHORT.until / way.size))

        monkeypatch.setattr(Recommender, "_evaluate", evaluate)
        with recommending(spaces, Budget(seconds, lanes=1)) as recommender:
            recommender.search()
            return {x.engine: x for x in recommender.answers({})}

    idle, busy = search(600.0, 6.0, 0.0), search(600.0, 9.0, 3.0)
    assert busy == idle, "waiting does not count"
    crowded = search(600.0, 300.0, 290.0)
    assert sum(x.tried for x in crowded.values()) < sum(x.tried for x in idle.values()), "elapsed time has its limit"
    for name, answer in crowded.items():
        assert answer.status == idle[name].status == "ok"
        assert answer.complete == (answer.tried == answer.variants), "what was not tried is told"


def way(settings, integrator="rk4"):
    return Way("gauss", settings, integrator, "none", 0.0)


def engine_of(works, adaptive=()):
    """An engine with one trial a way: its steps, and its share of the requirement."""
    trials = {x: [Trial(1.0 / steps, {SHARE: share}, steps)] for x, (steps, share) in works.items()}
    return _Engine("gauss", [], None, adaptive, trials=trials)


def test_half_of_the_requirement_holds_and_of_an_engine_four_race_whose_work_is_at_most_four_times_the_least():
    held = engine_of({way("a"): (300, 0.1), way("b"): (100, 0.5), way("c"): (50, 0.5001), way("d"): (100, 0.4)})
    assert [(x.way.settings, x.way.size) for x in held.accurate_settings()] == [("b", 0.01), ("d", 0.01), ("a", 1 / 300)]
    near = engine_of({way("a"): (100, 0.1), way("b"): (400, 0.1), way("c"): (401, 0.1), way("d", "own"): (5000, 0.1)}, ("own",))
    many = engine_of({way(str(k)): (100 + k, 0.1) for k in range(6)})
    assert [x.settings for x, _ in list_raced(near)] == ["a", "b", "d"]
    assert [x.settings for x, _ in list_raced(many)] == ["0", "1", "2", "3"]


def test_a_variant_may_take_eight_times_the_work_of_the_best(recommender):
    for steps, most in ((50, 800), (100, 800), (101, 808), (25_000, 200_000), (26_000, 200_000)):
        assert recommender._step_limit(way("b"), TriedSetting(way("a"), Trial(1e-3, {}, steps))) == most
    assert recommender._step_limit(way("b"), None) == 200_000


def test_the_engine_with_the_fewest_tries_has_its_turn_and_after_the_end_only_who_had_none(recommender):
    left = list_variants(offer("gauss"))[:1]
    once = replace(engine_of({way("a"): (100, 0.1)}), left=[*left])
    twice = replace(engine_of({way("a"): (100, 0.1), way("b"): (100, 0.1)}), left=[*left])
    never, busy = replace(engine_of({}), left=[*left]), replace(engine_of({}), left=[*left], busy=True)
    done, refused = engine_of({}), replace(engine_of({}), left=[*left], refused=(Status.SKIP, "no such joint"))
    recommender.engines = {"busy": busy, "done": done, "refused": refused, "twice": twice, "once": once, "never": never}
    assert [recommender._next_engine() for _ in range(3)] == [never, once, twice]
    for engine in (once, twice, never):
        engine.busy = False
    recommender.budget.remaining = lambda share=1.0: 0.0
    assert recommender._next_engine() is never
    recommender.engines = {"once": once, "twice": twice}
    assert recommender._next_engine() is None
    refuses = replace(engine_with(Trial(1e-3, {}, 0, Status.SKIP, "the compiled loop has no drivers")), left=[*left])
    recommender.engines = {"once": once, "refuses": refuses}
    assert recommender._next_engine() is refuses, "it was asked and not run"


def test_an_engine_that_refuses_is_asked_by_its_other_loop_or_once_more_by_another_integrator(recommender):
    trial, first = Trial(1e-3, {}, 100, Status.SKIP, "no such joint"), {way("a"): (100, 1.0)}
    same, other, third = (Variant(x, y, "none", {}) for x, y in (("b", "rk4"), ("c", "euler"), ("d", "rkf45")))
    compiled, *called = (Variant(x, "rk4", "none", {"loop": loop}) for x, loop in (("b", "own"), ("c", "called"), ("d", "called")))
    loops = {x.name: x.options for x in (compiled, *called)} | {"a": compiled.options}
    for left, options, kept in (([same, other, third], {}, [other]), ([same], {}, []), ([compiled, *called], loops, called)):
        engine = replace(engine_of(first), left=left, options=options)
        recommender._choose_after_refusal(engine, trial)
        assert (engine.left, engine.refused) == (kept, None if kept else (Status.SKIP, "no such joint"))


def test_answers_are_ordered_by_the_race_and_those_that_hold_without_one_say_why():
    """Seven engines: two were raced, one crashed in the race, one was refused, for one there was no time, two do not hold."""
    slow, quick = (way("slow"), 100, 0.1), (way("quick"), 120, 0.2)

    def engine(name, *tried):
        trials = {w._replace(engine=name): [Trial(SHORT.until / n, {SHARE: x, "position": x * 1e-6}, n)] for w, n, x in tried}
        return _Engine(name, [], None, (), variants=2, trials=trials)

    names = ("crashed", "refused", "late")
    engines = [
        engine("far", (way("a"), 50, 2.0)),
        *(engine(x, slow) for x in names),
        engine("second", slow, quick),
        engine("first", quick),
    ]
    timed = {("second", slow): 0.05, ("second", quick): 0.02, ("first", quick): 0.01}
    raced = [{"way": [*w._replace(engine=x, size=SHORT.until / n)], "seconds": [y] * 5} for (x, (w, n, _)), y in timed.items()]
    tables = {"race": raced, "failed": [{"engine": "refused", "message": "no such joint"}]}
    lost = {"crashed": WorkerFailure(Status.CRASHED, "SIGSEGV")}
    with pytest.MonkeyPatch.context() as patch, recommending() as recommender:
        patch.setattr("gauss_bench.advice.recommending.list_survivors", lambda *_: (tables, lost))
        recommender.engines = {x.name: x for x in engines}
        answers = recommender.answers(recommender.race())
    said = [f"holds, not raced: {x}" for x in ("SIGSEGV", "no such joint", "the time ended first; a larger --budget helps")]
    assert [(x.engine, x.settings, x.ratio, x.message) for x in answers[:5]] == [
        ("first", "quick", pytest.approx(1.0), ""),
        ("second", "quick", pytest.approx(2.0), ""),
        *((name, "slow", None, words) for name, words in zip(names, said, strict=True)),
    ]
    assert (answers[0].step, answers[0].tolerance, answers[0].steps) == (SHORT.until / 120, None, 120)
    assert (answers[5].engine, answers[5].status) == ("far", "not reached")
    assert "nearest 2.0e-06 m with a, rk4, step 0.004 s" in answers[5].message


def test_a_setting_is_said_with_each_word_once():
    assert format_setting("default", "rk4", "none") == "rk4"
    assert format_setting("tuned", "rk4", "projection") == "tuned, rk4, projection"
    assert format_setting("Newton/rk4", "rk4", "none") == "Newton/rk4"


def test_a_time_without_a_reference_is_shortened_twice_to_a_quarter():
    assert [*truths.shorten(8.0)] == [8.0, 2.0, 0.5]
