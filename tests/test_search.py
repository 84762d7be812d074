"""The search finds the winner that is known, says what it spent, and finds it again."""

import json
import math
from operator import itemgetter

import numpy as np
import pytest

from gauss_bench.bench import search
from gauss_bench.bench.clock import Measured, Missing, gather_rounds, prediction_interval, ratio, spread, time_of
from gauss_bench.bench.measurements import search as measured
from gauss_bench.bench.measurements.search import first_race, further_race, ladder, motion_of, winners_and_times
from gauss_bench.bench.search import Scale, close_to_fastest, coarsest, equal_steps, explore, finalists, pick_winner, tolerances
from gauss_bench.bench.tasks import Context
from gauss_bench.bench.ways import BEATS, Way, judge_trial, space, whole_run
from gauss_bench.bench.ways import Run as WayRun
from gauss_bench.engines import get
from gauss_bench.engines.base import Variant
from gauss_bench.linkage.load import load
from gauss_bench.mechanism.evaluate import Evaluator
from gauss_bench.metrics import joint_force_errors
from gauss_bench.reach import Requirement, Trial
from gauss_bench.reference.build import build_reference
from gauss_bench.report.rows import Run
from gauss_bench.report.sections.search import list_owned
from gauss_bench.runs import apart
from gauss_bench.runs.offers import offer
from gauss_bench.runs.one_run import Run as Ended
from gauss_bench.runs.one_run import Sampling
from gauss_bench.suites.schema import Search, Suite
from gauss_bench.tables import TABLES, row_of
from gauss_bench.trajectory import Status, Trajectory
from tests.headlines import compared
from tests.synthetic import Costs, SyntheticModel, clocked

COARSE, FINE = Requirement("position", 1e-3), Requirement("position", 1e-6)


class Method:
    """An error of factor * step^order, and a count of how often it was asked."""

    def __init__(self, factor=1.0, order=4.0, floor=0.0, breaks_above=math.inf):
        self.factor, self.order, self.floor, self.breaks_above = factor, order, floor, breaks_above
        self.asked = []

    def __call__(self, size):
        self.asked.append(size)
        steps = round(1 / size)
        if size > self.breaks_above:
            return Trial(size, {}, 0, Status.DIVERGED, "apart")
        return Trial(size, {"position": max(self.floor, self.factor * size**self.order)}, steps)


@pytest.mark.parametrize("beats", BEATS)
def test_sizes_are_finer_than_a_factor_of_two_from_the_coarsest_on(beats):
    scale = equal_steps(1.0, beats, 100_000)
    counts = np.array([round(1 / x) for x in scale.sizes])
    assert counts[0] == 10
    assert 84_000 < counts[-1] <= 100_000
    assert (counts[1:] / counts[:-1]).max() <= 1.5
    assert (counts[1:] / counts[:-1])[counts[:-1] >= 50].max() <= 1.34
    met = np.gcd(counts, beats)  # samples that errors are taken at
    assert met.min() >= 5
    assert met[counts >= 50].min() >= 10
    assert (met[counts >= 5 * beats] == beats).all()
    walked = counts[list(scale.rungs)]
    assert (walked[0], walked[-1]) == (10, counts[-1])
    assert (walked[1:] / walked[:-1]).max() < 2.5  # octaves, as near as beats allow
    tolerated = np.log10(tolerances().sizes)
    assert tolerated == pytest.approx(np.arange(-2.0, -13.5, -0.5))


def test_a_requirement_is_met_within_a_half_even_by_few_steps():
    """A method of order eight that meets 1e-6 from so many steps a second on, and not with fewer."""
    for exact_from, found in ((11.0, 15), (33.0, 35), (41.0, 50), (52.0, 60), (90.0, 100), (700.0, 750)):
        trials, ended = explore(Method(1e-6 * exact_from**8, 8.0), equal_steps(1.0, 50, 10_000), [COARSE, FINE], 24)
        best = coarsest(trials, FINE)
        assert best.steps == found < 1.5 * exact_from
        assert ended == "every requirement is met"


def test_the_budget_counts_evaluations_and_is_never_exceeded():
    for budget in (1, 3, 7):
        method = Method(3e3)
        trials, ended = explore(method, equal_steps(1.0, 50, 10_000), [COARSE, FINE], budget)
        assert len(method.asked) == len(trials) == budget
        assert ended == ("every requirement is met" if budget == 7 else f"the budget of {budget} evaluations was spent")


def test_what_cannot_get_there_is_given_up_with_its_reason():
    scale = equal_steps(1.0, 50, 100_000)
    soft, slow, broken = Method(floor=1e-2), Method(1.0, order=1.0), Method(breaks_above=1.0)
    trials, ended = explore(soft, scale, [COARSE], 24, most=100_000)
    assert ended == f"no error fell in {search.STALLED} rungs"
    assert coarsest(trials, COARSE) is None
    trials, ended = explore(slow, scale, [FINE], 24, most=100_000)  # it would need a million steps
    assert ended == "errors fall too slowly for 100 000 steps"
    assert trials[-1].steps == 1300  # three rungs from SETTLED steps on tell the order
    trials, ended = explore(lambda size: Trial(size, {}, 0, Status.SKIP, "not for this"), scale, [FINE], 24)
    assert (len(trials), ended) == (1, "not for this")
    trials, ended = explore(broken, Scale((2.0, 0.5, 0.25), (0, 1, 2)), [Requirement("position", 0.1)], 24)
    assert [t.status for t in trials] == [Status.DIVERGED, Status.OK]  # a finer step mends what a coarse one breaks


def test_what_begins_slowly_is_not_given_up():
    """Errors as large as the motion until steps resolve it, at 640 a second, and of order four from there on."""
    late = lambda size: Trial(size, {"position": min(0.3, 0.3 * (640 * size) ** 4)}, round(1 / size))  # noqa: E731
    assert explore(late, equal_steps(1.0, 50, 100_000), [COARSE, FINE], 24, most=100_000)[1] == "every requirement is met"


def test_an_error_that_is_not_determined_asks_for_no_further_rung():
    forces = Requirement("force", 1e-3)
    undetermined = lambda size: Trial(size, {"position": size**4, "force": math.nan}, round(1 / size))  # noqa: E731
    trials, ended = explore(undetermined, equal_steps(1.0, 50, 10_000), [forces, COARSE], 24)
    assert (coarsest(trials, forces), ended) == (None, "every requirement is met")


def test_ties_go_to_the_first_and_the_faster_wins_beyond_the_spread():
    noise = np.array([0.0, 0.02, 0.01, 0.03, 0.05, 0.01, 0.02, 0.04])
    alike = {"first": 1.01 + noise, "second": 1.0 + noise[::-1], "third": 1.5 + noise}
    assert pick_winner(alike) == ("first", ["first", "second"])
    assert pick_winner({name: alike[name] for name in ("third", "second", "first")})[0] == "second"
    assert pick_winner({"slow": 1.5 + noise, "quick": 1.0 + noise}) == ("quick", ["quick"])


def in_processes(**times):
    """Entries that take so long [s] in one process after the other, the same in every round; NaN where one does not run."""
    return {k: np.tile(np.array(x)[:, None], (1, 4)) for k, x in times.items()}


STUDENT = 9.925  # 99.5 % point of Student's t with two degrees of freedom, as printed in tables


def test_a_spread_is_where_a_second_race_of_as_many_processes_falls():
    """Logarithms of -0.1, 0 and 0.1 scatter by 0.1, medians of three of them by (pi / 3)^(1/2) of that."""
    away = STUDENT * 0.1 * math.sqrt(math.pi / 3)
    assert prediction_interval(np.exp([-0.1, 0.0, 0.1])) == pytest.approx((math.exp(-away), math.exp(away)), rel=1e-4)
    assert prediction_interval(np.full(4, 2.5)) == pytest.approx((2.5, 2.5))
    assert prediction_interval(np.array([1.0] * 100 + [9.0]))[1] == 9.0  # a hundred that agree do not leave out one that does not


def test_a_time_is_the_median_of_processes():
    """Lower quartiles of 1, 2, 3, 6 and 9 s, though rounds scatter in each; the spread is of rounds where there is one process."""
    rounds = np.array([0.0, 0.0, 0.5, 2.0, 7.0])
    several = np.array([[2.0], [1.0], [9.0], [3.0], [6.0]]) + rounds
    low, high = prediction_interval(np.array([1.0, 2.0, 3.0, 6.0, 9.0]))
    assert spread("seconds", several) == pytest.approx({"seconds": 3.0, "seconds_low": low, "seconds_high": high})
    assert time_of(several) == 3.0
    alone = spread("seconds", several[0])
    assert alone == pytest.approx({"seconds": 2.0, "seconds_low": 2.0, "seconds_high": 2.0 + 2.0 + 0.8 * 5.0})
    assert spread("seconds", several[:1]) == alone


def test_a_ratio_is_that_of_the_times():
    """The second process is half as fast for both, the third for the rival alone: ratios of 3, 3 and 6, of medians 6 / 2."""
    x = in_processes(own=[1.0, 2.0, 2.0], rival=[3.0, 6.0, 12.0])
    assert ratio(x["rival"], x["own"]) == (3.0, *prediction_interval(np.array([3.0, 3.0, 6.0])))
    assert ratio(x["own"], x["own"]) == (1.0, 1.0, 1.0)
    late = in_processes(own=[1.0, 2.0, 2.0], rival=[np.nan, 6.0, 12.0])  # where both ran
    assert late["rival"].shape == (3, 4)
    assert ratio(late["rival"], late["own"]) == (4.5, *prediction_interval(np.array([3.0, 6.0])))
    never = in_processes(own=[1.0, np.nan], rival=[np.nan, 1.0])
    assert np.isnan(ratio(never["rival"], never["own"])).all()


def test_rounds_stand_by_the_process_that_they_were_in():
    """One entry ran in the first process and the third, the other in the second alone."""
    timed = [("a", 2, 0, 3.0), ("a", 0, 0, 1.0), ("a", 0, 1, 2.0), ("b", 1, 0, 5.0)]
    rows = [dict(zip(("entry", "process", "round", "seconds"), x, strict=True)) for x in timed]
    found = gather_rounds(rows, itemgetter("entry"))
    gap = np.nan
    np.testing.assert_array_equal(found.of("a"), [[1.0, 2.0], [gap, gap], [3.0, gap]])
    np.testing.assert_array_equal(found.of("b"), [[gap], [5.0], [gap]])


def test_what_ran_in_no_process_has_its_reason():
    failed = Measured({}, {"a": Missing(Status.NAN, "not a number")})
    for key, reason in (("a", "not a number"), ("b", "b was not measured")):
        with pytest.raises(Missing, match=reason):
            failed.of(key)


def test_what_is_as_fast_in_a_quarter_of_the_processes_ties():
    """Once in four is a tie, once in five luck."""
    fastest = [1.0] * 5
    races = in_processes(luck=[0.9, 1.2, 1.2, 1.2, 1.2], often=[0.9, 0.9, 1.2, 1.2, 1.2], fastest=fastest)
    assert pick_winner(races) == ("often", ["often", "fastest"])
    scattered = [1.0, 1.3, 0.9, 1.1, 1.2]
    slower = in_processes(second=[1.01 * x for x in scattered], first=scattered, same=scattered[::-1])
    assert pick_winner(slower) == ("first", ["first", "same"])  # a per cent slower in every process is no tie


def test_only_what_is_near_the_cheapest_is_raced():
    costs = {"dear": 5.0, "near": 1.9, "cheapest": 1.0, "far": 2.1}
    assert finalists(costs) == ["near", "cheapest"]
    many = {str(k): 1.0 + 0.01 * k for k in range(20)}
    assert finalists(many) == [*many][: search.FINALISTS]
    assert finalists({}) == close_to_fastest({}) == []
    assert close_to_fastest({"dear": 1.3, "near": 1.2, "fastest": 1.0}) == ["near", "fastest"]  # in further processes


# Whole searches, with engines whose errors and costs are known

WAYS = {  # name -> rad of error at 1 ms, order, seconds of a step
    "rough": (1e-2, 4.0, 1.5e-6),
    "exact": (1e-4, 4.0, 2e-6),
    "same": (1e-4, 4.0, 2e-6),
    "dear": (1e-5, 4.0, 90e-6),
}
SLOWER = 1.5
PART = Search(
    linkages={},
    engines=("mujoco", "gauss-native"),
    own=("gauss-native",),
    until=0.1,
    angle=(1e-4, 1e-7),
    budget=16,
    most_steps=2000,
    processes=3,
    rounds=3,
    lead=0.03,
)


class Exact:
    """The true motion of the four-bar, at the nearest times that it is known."""

    truth = build_reference(load("four_bar", "torque"), PART.until)

    def prepare(self, times, native=True):
        self.times = times

    def run(self):
        """Nothing takes time here."""

    def read(self):
        at = np.abs(self.truth.t[:, None] - self.times).argmin(axis=0)
        return Trajectory(self.times, self.truth.q[at], self.truth.v[at], self.truth.a[at], 0)


@pytest.fixture
def clock(monkeypatch):
    """Engine "mujoco" has the variants of WAYS, compiled formulations are right at once at 0.1 us a step.

    What is asked for in a process of its own is done in this one; in the second such process everything takes SLOWER times as long.
    """
    clock = clocked(monkeypatch)
    asked = []  # of each race, whether whole runs were timed in it

    def here(function, arguments, engines):
        asked.append(arguments[1][-1] is not None)
        clock.slower = SLOWER if sum(asked) == 2 else 1.0
        return json.loads(json.dumps(function(*arguments, tuple(engines)))), {}

    monkeypatch.setattr(measured, "list_survivors", here)

    def build(self, mechanism, choice):
        off, order, seconds = WAYS.get(choice.settings, (0.0, 4.0, 1e-7))
        return SyntheticModel(mechanism, choice, clock, Costs(native_step=seconds), Exact(), 0.0, off, order)

    for kind in (type(get(name)) for name in PART.engines):
        monkeypatch.setattr(kind, "build", build)
        monkeypatch.setattr(kind, "skip", lambda self, mechanism, choice: None)
    variants = {x: Variant(x, "rk4", "none", {"number": k}) for k, x in enumerate(WAYS)}
    monkeypatch.setattr(type(get("mujoco")), "variants", variants)
    monkeypatch.setattr("gauss_bench.runs.offers._known", {})
    monkeypatch.setattr(apart, "_kept", {})
    monkeypatch.setattr(apart, "is_isolated", lambda _: False)  # what stands in for them is known in this process alone
    return clock


def searched(folder, *theirs):
    """The tables of a search with the engines of PART, and further variants of MuJoCo."""
    rows = []
    for engine in PART.engines:
        for variant in (*space(offer(engine)), *(theirs if engine == "mujoco" else ())):
            if (variant.integrator, variant.stabilization) == ("rk4", "none"):
                rows += ladder("four_bar", "torque", engine, variant, PART, str(folder))["search_ladder"]
    told = json.loads(json.dumps(rows))  # as the journal keeps them
    races = first_race("four_bar", "torque", PART, told)["search_races"]
    for number in range(1, PART.processes):
        races = races + further_race("four_bar", "torque", PART, told, races, number)["search_races"]
    return {"search_ladder": rows, "search_races": races} | winners_and_times("four_bar", "torque", PART, told, races)


def test_a_search_names_the_known_winner(clock, tmp_path):
    """At 1e-4 rad `exact` needs steps of 1 ms, 100 of them in 0.2 ms; `rough` 3.2 times as many, each a quarter cheaper, and `dear`
    1.8 times fewer, each 45 times as dear: neither is worth a race. `same` costs what `exact` costs, and comes later."""
    found = searched(tmp_path)
    winners = {(r["engine"], r["accuracy"]): r for r in found["search_winners"]}
    for limit, (fewest, most) in {1e-4: (100, 120), 1e-7: (563, 680)}.items():
        row = winners["mujoco", limit]
        assert row["settings"] == "exact"
        assert fewest <= row["steps"] <= most  # the next size is at most a fifth away
        assert row["error"] <= limit
        assert row["seconds"] == pytest.approx(row["steps"] * 2e-6)
        assert [row[f"seconds_{x}"] for x in ("low", "high")] == pytest.approx(
            prediction_interval(row["seconds"] * np.array([1.0, 1.0, SLOWER]))
        )
        assert row["tied"] == "exact rk4 none, same rk4 none"
        assert json.loads(row["options"]) == {"number": 1}
        own = winners["gauss-native", limit]
        assert own["seconds"] == pytest.approx(own["steps"] * 1e-7)
        assert own["own"] is True
        assert own["ratio"] == 1.0
        assert [row[f"ratio{x}"] for x in ("", "_low", "_high")] == pytest.approx([row["seconds"] / own["seconds"]] * 3)
        assert (row["variants"], row["passing"], row["raced"], row["budget"]) == (4, 4, 2, 16)
        assert row["evaluations"] == sum(r["engine"] == "mujoco" for r in found["search_ladder"])
    rows = {name: tuple(row_of(TABLES[name], r) for r in found[name]) for name in found}
    assert compared(Run({}, rows)) == ["search"]
    for table in ("search_ladder", "search_races", "search_winners", "search_times"):
        assert [row_of(TABLES[table], row) for row in found[table]]


def test_settings_of_an_engines_authors_race_beside_ours_however_far_they_are(clock, tmp_path):
    """`dear` is theirs: ours, `exact`, takes a 22nd of its time, and it would not race if it were ours."""
    kind = type(get("mujoco"))
    kind.variants = {name: x for name, x in kind.variants.items() if name != "dear"}
    found = searched(tmp_path, Variant("dear", "rk4", "none", {"number": 3}, "Those who wrote it"))
    row = next(r for r in found["search_owned"] if r["accuracy"] == 1e-4)
    assert (row["engine"], row["settings"], row["owner"], row["our_settings"]) == ("mujoco", "dear", "Those who wrote it", "exact")
    assert row["seconds"] == pytest.approx(row["steps"] * WAYS["dear"][2])
    assert row["our_seconds"] == pytest.approx(round(0.1 / row["our_step"]) * WAYS["exact"][2])
    assert [row[f"ratio{end}"] for end in ("", "_low", "_high")] == pytest.approx([row["seconds"] / row["our_seconds"]] * 3)
    assert (row["variants"], row["our_variants"], row["budget"]) == (1, 3, PART.budget)
    winner = next(r for r in found["search_winners"] if r["accuracy"] == 1e-4 and r["engine"] == "mujoco")
    assert (winner["settings"], winner["owner"], winner["variants"]) == ("exact", "", 4)
    lines = list_owned([row_of(TABLES["search_owned"], row)])
    assert [x["name"] for x in lines] == ["mujoco, by its authors", "mujoco"]


def test_an_accuracy_out_of_reach_is_told_with_how_near_it_came(clock, tmp_path, monkeypatch):
    for name, error in {"exact": 1e-4, "same": 2e-4, "rough": 1.0, "dear": 1.0}.items():
        monkeypatch.setitem(WAYS, name, (error, 0.0, 2e-6))  # no order: the error does not fall
    (row,) = (r for r in searched(tmp_path)["search_winners"] if r["engine"] == "mujoco" and r["accuracy"] == 1e-7)
    assert (row["status"], row["error"]) == ("not reached", pytest.approx(1e-4, rel=1e-3))
    assert (row["settings"], row["message"]) == ("exact", "not reached in 1,280 steps")
    assert row["raced"] == row["passing"] == 0


def test_a_ladder_goes_as_far_as_a_run_may_and_no_further(clock, tmp_path, monkeypatch):
    """`exact` is of second order here: 1e-4 rad at 1 ms, so that 1e-7 rad would need 3200 steps and all errors fall to the last."""
    monkeypatch.setitem(WAYS, "exact", (1e-4, 2.0, 2e-6))
    variant = offer("mujoco").variants["exact"]
    rows = ladder("four_bar", "torque", "mujoco", variant, PART, str(tmp_path))["search_ladder"]
    assert 0.8 * PART.most_steps < rows[-1]["steps"] <= PART.most_steps
    assert rows[-1]["ended"] == "the finest size was tried"


def raced_rows(times, ties):
    """Winner rows of engines at 1e-6 m by their times in each process, and the race; `ties` are other engines' ways here."""
    place = {"settings": "", "integrator": "rk4", "stabilization": "none", "step": 1e-3, "required": "position", "accuracy": 1e-6}
    ways = {e: measured.way_of(place | {"engine": e}) for e in times}
    rows = [place | {"engine": e, "status": "ok", "ties": [ways[x] for x in (e, *ties.get(e, []))]} for e in times]
    return rows, Measured({ways[e]: np.array(x)[:, None] for e, x in times.items()}, {})


def test_an_aim_is_held_against_rivals_that_get_there():
    """Ours in 1 ms, rivals in 15 and 25 where 20 times as long is aimed at; one that cannot get there has missed no aim."""
    part = PART.model_copy(update={"aims": {"near": 20.0, "far": 20.0, "never": 20.0}, "aimed": (1e-6,)})
    rows, races = raced_rows({"gauss-native": [1e-3] * 3, "near": [15e-3] * 3, "far": [25e-3] * 3}, {})
    rows.append(rows[0] | {"engine": "never", "status": "not reached", "ties": []})
    found = {r["engine"]: r for r in measured.with_ratios(rows, races, part)}
    assert {e: r.get("met") for e, r in found.items()} == {"gauss-native": None, "near": False, "far": True, "never": None}
    assert [found[e]["ours"] for e in found] == [True, False, False, False]
    coarser = [r | {"accuracy": 1e-3} for r in rows]
    assert not any("target" in r for r in measured.with_ratios(coarser, races, part))


def test_a_ratio_is_to_the_cheaper_of_our_own_and_its_spread_covers_all_that_tie():
    """Ours take 10 and 9.8 us, each the faster in two processes of four; the rival 30, and 40 by what ties with it."""
    part = PART.model_copy(update={"own": ("gauss-native", "lagrange-native")})
    times = {
        "gauss-native": [9.0e-6, 11e-6, 9.0e-6, 11e-6],
        "lagrange-native": [9.8e-6] * 4,
        "rival": [30e-6, 30e-6, 30e-6, 30e-6],
        "tied": [40e-6, 40e-6, 40e-6, 20e-6],
    }
    rows, races = raced_rows(times, {"rival": ["tied"]})
    found = {r["engine"]: r for r in measured.with_ratios(rows[:3], races, part)}
    assert [found[e]["own"] for e in found] == [False, True, False]
    pairs = [
        prediction_interval(np.array(times[x]) / np.array(times[y]))
        for x in ("rival", "tied")
        for y in ("gauss-native", "lagrange-native")
    ]
    wanted = [30 / 9.8, min(low for low, _ in pairs), max(high for _, high in pairs)]
    assert found["lagrange-native"]["ratio"] == 1.0
    assert [found["rival"][f"ratio{x}"] for x in ("", "_low", "_high")] == pytest.approx(wanted)
    assert found["gauss-native"]["ratio"] == pytest.approx(10 / 9.8)
    assert not any("ties" in r for r in found.values())


def test_a_run_longer_than_the_lead_is_cut_and_scaled(clock):
    """2000 steps at 90 us are 0.18 s: of them 333 are run in a lead of 30 ms, and the time told is that of all."""
    run, way = WayRun("four_bar", load("four_bar", "torque"), 0.1), Way("mujoco", "dear", "rk4", "none", 5e-5)
    block = whole_run(run, way, 2000, 0.18, 0.03, {})
    assert block.seconds() == pytest.approx(0.18, rel=2e-3)
    assert block.count == pytest.approx(333 / 2000)
    whole = whole_run(run, way, 2000, 0.18, 1.0, {})
    assert (whole.count, whole.seconds()) == pytest.approx((1.0, 0.18))


def test_the_error_is_the_largest_of_the_whole_run_and_at_the_end_that_of_the_last_sample():
    """A link that is 1 mm and 1 mrad off halfway and 1 um at the end holds 1e-5 m there, and does not over the run."""
    mechanism = load("four_bar", "torque")
    truth = Exact.truth
    q = truth.q.copy()
    q[len(q) // 2, [3, 5]] += 1e-3
    q[-1, 4] -= 1e-6
    ran = Ended(Status.OK, "", Trajectory(truth.t, q, truth.v, truth.a, 7), None, Sampling(truth.t, 1e-3, 100, 0))
    way = Way("gauss", "default", "rk4", "none", 1e-3)
    trial = judge_trial(motion_of("four_bar", "torque", PART), Evaluator(mechanism), truth, way, ran)
    assert (trial.errors["position"], trial.errors["angle"], trial.errors["end"]) == pytest.approx((1e-3, 1e-3, 1e-6))
    assert trial.meets(Requirement("end", 1e-5))
    assert not trial.meets(Requirement("position", 1e-5))


def suite_of(part):
    return Suite.model_validate({"format": "gauss-bench-suite/1", "title": "searched", "search": [part.model_dump()]})


def test_a_killed_search_repeats_nothing(tmp_path):
    """Every ladder has a name and a stamp of its own, the same whenever it is asked for; the race depends on what ladders found."""
    suite = suite_of(PART.model_copy(update={"linkages": {"four_bar": "torque"}}))
    one, other = ([(t.key, t.stamp) for t in measured.exact_tasks(suite, Context(str(tmp_path), "stamp"))] for _ in range(2))
    assert one == other
    assert len(set(one)) == len(one) == sum(len(space(offer(x))) for x in PART.engines)
    rows = [{"mechanism": "four_bar", "scenario": "torque", "step": 1e-3}]
    races = [measured.timing_tasks(suite, Context(str(tmp_path), "stamp"), {"search_ladder": x}) for x in (rows, rows, [])]
    (first,), (same,), (changed,) = races
    assert first.key == same.key != changed.key


def test_processes_of_a_linkage_lie_apart_and_depend_on_the_first():
    """The second process goes over all linkages before the third begins; a linkage whose first race was lost is not raced again."""
    linkages = {"four_bar": "torque", "crank_slider": "paper", "six_bar": "torque"}
    part = PART.model_copy(update={"linkages": linkages})
    suite = suite_of(part)
    one, other = ({"mechanism": x, "scenario": linkages[x], "process": 0, "status": "ok"} for x in [*linkages][:2])
    lost = {"mechanism": "six_bar", "scenario": "torque", "process": 0, "status": "crashed", "message": "SIGSEGV"}
    tasks, slower = (
        measured.second_timing_tasks(suite, Context("", "stamp"), {"search_ladder": [], "search_races": [first, other, lost]})
        for first in (one, one | {"seconds": 2e-5})
    )
    names = [(name, number) for number in (1, 2) for name in ("four_bar", "crank_slider")]
    assert [(t.start["mechanism"], t.start["process"]) for t in tasks] == names
    assert [x.key == y.key for x, y in zip(tasks, slower, strict=True)] == [False, True, False, True]
    (told,) = winners_and_times("six_bar", "torque", part, [], [lost])["search_winners"]
    assert told == {"mechanism": "six_bar", "scenario": "torque", "status": "crashed", "message": "SIGSEGV"}


def test_of_an_engine_whose_loop_may_be_anybodys_the_cheapest_of_each_is_raced(clock, tmp_path, monkeypatch):
    """`dear` takes 25 times as long as `exact`, and is the cheapest that is called from Python: its time stands beside."""
    loops = {x: {"loop": "called from Python" if x == "dear" else "compiled"} for x in WAYS}
    monkeypatch.setattr(type(get("mujoco")), "variants", {x: Variant(x, "rk4", "none", loop) for x, loop in loops.items()})
    found = searched(tmp_path)
    assert {r["settings"] for r in found["search_winners"] if r["engine"] == "mujoco"} == {"exact"}
    times = {r["settings"]: r for r in found["search_times"] if r["engine"] == "mujoco"}
    assert math.isfinite(times["dear"]["seconds_low"])  # it was raced in several processes
    assert "rough" not in times


def test_errors_of_joint_forces_are_those_of_newtons_laws():
    """An acceleration that is 1e-3 m/s^2 off on a 0.24 kg rocker's centre shows as that much force at its pins, none at rest."""
    mechanism = load("four_bar", "torque")
    truth = build_reference(mechanism, 0.1)
    evaluator, same = Evaluator(mechanism), Trajectory(truth.t, truth.q, truth.v, truth.a, 0)
    assert joint_force_errors(evaluator, same, truth).max() == 0.0
    off = truth.a.copy()
    off[:, 6] += 1e-3
    errors = joint_force_errors(evaluator, Trajectory(truth.t, truth.q, truth.v, off, 0), truth)
    assert errors.shape == truth.t.shape
    assert 0.5e-3 * mechanism.links[2].mass < errors.max() < 10e-3 * mechanism.links[2].mass
    locked = load("parallelogram", "torque")
    assert np.isnan(joint_force_errors(Evaluator(locked), *(2 * [build_reference(locked, 0.02)]))).all()
