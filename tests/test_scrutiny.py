"""The judge calls no wrong run ok: each of its checks has a case with a known answer."""

import re
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from gauss_bench import judge, metrics
from gauss_bench.api.simulate import simulate
from gauss_bench.engines.base import Choice
from gauss_bench.engines.interpreted import InterpretedModel
from gauss_bench.linkage.load import load, load_document, merge
from gauss_bench.mechanism.evaluate import Evaluator
from gauss_bench.runs import scrutiny
from gauss_bench.runs.apart import Request
from gauss_bench.runs.offers import Offer
from gauss_bench.runs.one_run import JUDGED, Run, draw_samples, sampling
from gauss_bench.trajectory import Status, Trajectory, spread_evenly
from tests.engine_runs import by_gauss, document
from tests.fuzz.files import toml
from tests.fuzz.motions import over_motions

MECHANISMS = Path(__file__).parents[1] / "mechanisms"
MASS, K = 2.0, 8e4


def oscillator(k=K, c=0.0):
    """A block of 2 kg on a horizontal slide, held by a spring: x = 0.1 cos(w t), w^2 = k / m."""
    return merge(document("small/oscillator"), {"forces": {"f": {"k": k, "c": c}}})


def at_rest(document):
    mechanism = load_document(document)
    still = np.zeros((1, mechanism.n))
    return mechanism, Trajectory(np.zeros(1), mechanism.q0[None], mechanism.v0[None], still, 0)


def test_the_fastest_rate_is_that_of_the_oscillator():
    assert scrutiny.fastest_rate(*at_rest(oscillator())) == pytest.approx(np.sqrt(K / MASS), rel=1e-6)
    damped = scrutiny.fastest_rate(*at_rest(oscillator(c=100.0)))
    assert damped == pytest.approx(np.sqrt(K / MASS - (100.0 / (2 * MASS)) ** 2), rel=1e-6)


def test_damping_that_no_sample_sees_is_not_held_against_the_energy(tmp_path, monkeypatch):
    """Samples lie a millisecond apart, however fast the linkage is."""
    monkeypatch.setattr("gauss_bench.api.simulate.sample_spacing", lambda mechanism, t_end: 1e-3)
    path = tmp_path / "oscillator.toml"
    path.write_bytes(toml(oscillator(k=8e8, c=4e4)))
    found = simulate(str(path), step=2e-5, at=[0.0, 0.005])
    assert {x.subject for x in found.objections} == {"rates"}  # no sample sees a velocity
    assert "energy is not decidable" in found.message
    assert found.metrics["energy_error"] == pytest.approx(0.5 * 8e8 * 0.1**2, rel=1e-6)


def test_energy_that_is_gained_or_lost_where_samples_see_it_is_told():
    t = np.array([0.0, 1e-3, 2e-3, 2.1e-3])
    assert metrics.without_loss(t, np.array([0.0, -5.0, -4.0, -7.0]), 5e-4) == pytest.approx([0.0, 0.0, 1.0, -2.0])


def test_energy_that_nothing_else_decides_is_objected_to():
    lost = replace(SOUND, energy=FIVE - 1.0)
    assert not judge.judge(lost).valid
    hidden = replace(lost, seen=FIVE)
    assert judge.judge(hidden).valid
    assert "1 J are lost" in judge.remark(hidden)
    assert not judge.remark(replace(lost, seen=lost.energy))


@pytest.mark.long
def test_no_wrong_motion_of_a_random_linkage_is_called_ok():
    endings = list(over_motions(1, 6))
    assert [sentence for _, _, sentence in endings if sentence] == []
    assert sum(word == "ok, and right" for _, word, _ in endings) >= 2


def test_a_motion_that_runs_away_makes_no_noise(tmp_path, capfd):
    path = tmp_path / "oscillator.toml"
    path.write_bytes(toml(oscillator(k=1e13)))
    found = simulate(str(path), stabilization="projection", step=1e-2, at=[0.0, 0.9])
    assert found.status == "nan"
    assert capfd.readouterr() == ("", "")


FORCED = """
[forces.hum]
type = "torque"
link = "crank"
value = 1.0
over_time = { law = "sine", frequency = 4000.0, phase_deg = 90.0 }
[scenarios.hum]
start = { crank_deg = 0.0, speed = 0.0 }
duration = 0.02
forces = ["hum"]
"""


def with_force(folder, force):
    """Write a file of the four-bar with one more force and a scenario, and return its path."""
    path, four_bar = folder / "four_bar.toml", (MECHANISMS / "four_bar.toml").read_text(encoding="utf-8")
    path.write_text(four_bar.replace("planar-linkage/1", "planar-linkage/2") + force, encoding="utf-8")
    return str(path)


@pytest.fixture
def humming(tmp_path):
    """Return a file of the four-bar under a torque that swings 4000 times a second, for which there is no certificate."""
    return with_force(tmp_path, FORCED)


@pytest.mark.parametrize(("step", "status"), [(1e-3, "invalid"), (1e-4, "ok")])
def test_a_step_that_meets_a_swinging_force_in_one_phase_is_not_ok(step, status, humming, capfd):
    found = simulate(humming, scenario="hum", step=step)
    assert found.status == status, found.message
    warned = "does not resolve a force that oscillates with a period of 0.00025 s" in capfd.readouterr().err
    assert warned == (status == "invalid")
    if status == "ok":
        assert found.metrics["energy_error"] <= found.metrics["energy_error_bar"] + 1e-2 * found.metrics["energy_scale"]
    else:
        assert "0.25 steps in a period of the fastest force" in found.message


def test_a_table_turns_where_its_slope_changes_sign(tmp_path):
    """A ramp, a plateau, a fall, and a rise after it."""
    rows = [[0.0, 0.0], [0.1, 1.0], [0.2, 1.0], [0.3, 0.5], [0.4, 0.0], [0.5, 2.0], [0.6, 3.0]]
    path = with_force(tmp_path, re.sub(r"\{ law = .* \}", f'{{ law = "table", rows = {rows} }}', FORCED))
    assert [x.tolist() for x in scrutiny.reversal_times(load(path, "hum"))] == [[0.2, 0.4]]
    assert scrutiny.reversal_times(load("four_bar", "torque")) == []


def ran(mechanism, count, step=1e-3):
    """Return the motion of a linkage in so many samples, a millisecond apart."""
    return by_gauss(mechanism, 1e-3 * np.arange(count), integrator="rk4", step=step)


@cache
def sound_run(step):
    """The four-bar for 0.2 s."""
    return ran(load("four_bar", "conservative"), 201, step)


def played(change):
    """Return the judge's verdict on a sound run by 1 ms, if it and its repetition at half the step are changed alike."""
    finer = Run(Status.OK, "", change(sound_run(5e-4)), None, sampling(5e-4, 0.2))
    choice = Choice("default", "rk4")
    evidence, _ = scrutiny.evidence_of(load("four_bar", "conservative"), choice, change(sound_run(1e-3)), None, finer)
    return judge.judge(evidence)


CHANGED = {
    "frozen at its start": lambda x: replace(x, q=x.q * 0 + x.q[0], v=x.v * 0 + x.v[0], a=x.a * 0 + x.a[0]),
    "velocities scaled": lambda x: replace(x, v=0.9 * x.v),
    "velocities reversed": lambda x: replace(x, v=-x.v),
    "half the speed": lambda x: replace(x, q=np.repeat(x.q, 2, axis=0)[: len(x.t)], v=np.repeat(x.v, 2, axis=0)[: len(x.t)]),
    "accelerations of another time": lambda x: replace(x, a=np.roll(x.a, 40, axis=0)),
    "a jump half way": lambda x: replace(x, q=x.q + 0.06 * (x.t > 0.1)[:, None]),
}


def test_a_motion_whose_rates_are_of_another_motion_is_refused():
    assert played(lambda x: x).valid
    for how, change in CHANGED.items():
        assert judge.Subject.RATES in {x.subject for x in played(change).objections}, how


@pytest.mark.parametrize("faster", [1.0, 1.01])
def test_a_sound_motion_of_another_start_is_refused(faster):
    """The run is a motion of this linkage from another start: only the first sample shows the error."""
    mechanism = load("four_bar", "conservative")
    first, finer = (ran(replace(mechanism, v0=faster * mechanism.v0), 101, step) for step in (1e-3, 5e-4))
    again = Run(Status.OK, "", finer, None, sampling(5e-4, 0.1))
    evidence, _ = scrutiny.evidence_of(mechanism, Choice("default", "rk4", step=1e-3), first, None, again)
    assert {x.subject for x in judge.judge(evidence).objections} == (set() if faster == 1.0 else {judge.Subject.START})


FIVE = np.zeros(5)
STILL = metrics.RateGaps(FIVE, FIVE, FIVE, FIVE, bars=metrics.MotionGap(0.0, 0.0, 0.0, 0.0), fastest=(3.0, 40.0))
SOUND = judge.Evidence(0.2, metrics.Drift(FIVE, FIVE, FIVE), FIVE, 0.0, 7.0, rates=STILL, duration=1.0)


def off_by(length, angle):
    each = FIVE[:, None]
    return metrics.Errors(FIVE, FIVE, each + length, each + angle, each, FIVE, FIVE)


SLOW = replace(STILL, fastest=(0.0, 0.0))  # no link leaves its place within the second of the run
IN_NUMBERS = {  # limit, and the evidence of a value
    "start, place": (2e-6, lambda x: {"start": metrics.MotionGap(x, 0, 0, 0)}),
    "start, angle": (1e-5, lambda x: {"start": metrics.MotionGap(0, x, 0, 0)}),
    "start, velocity": (3e-5, lambda x: {"start": metrics.MotionGap(0, 0, x, 0)}),
    "start, angular velocity": (4e-4, lambda x: {"start": metrics.MotionGap(0, 0, 0, x)}),
    "start, velocity of a slow linkage": (2e-6, lambda x: {"start": metrics.MotionGap(0, 0, x, 0), "rates": SLOW}),
    "start, angular velocity of a slow linkage": (1e-5, lambda x: {"start": metrics.MotionGap(0, 0, 0, x), "rates": SLOW}),
    # at rest for 4 s: a fortieth of 0.2 m, and of a radian, in that time
    "accelerations at rest": (1.25e-3, lambda x: {"duration": 4.0, "rates": replace(SLOW, speed=FIVE + x)}),
    "angular accelerations at rest": (6.25e-3, lambda x: {"duration": 4.0, "rates": replace(SLOW, spin=FIVE + x)}),
    "loops": (0.002, lambda x: {"drift": metrics.Drift(FIVE + x, FIVE, FIVE)}),
    "loops of a large linkage": (0.01, lambda x: {"drift": metrics.Drift(FIVE + x, FIVE, FIVE), "size": 20.0}),
    "energy": (0.07, lambda x: {"energy": FIVE + x}),
    "energy with an error bar": (0.09, lambda x: {"energy": FIVE - x, "energy_bar": 0.02}),
    "accelerations": (0.01, lambda x: {"acceleration_error": x}),
    "formulations": (0.01, lambda x: {"disagreement": x}),
    "a link's place": (0.01, lambda x: {"errors": off_by(x, 0.0)}),
    "a link's angle": (0.05, lambda x: {"errors": off_by(0.0, x)}),
    "half the step, place": (0.005, lambda x: {"halving": off_by(x, 0.0)}),
    "half the step, angle": (0.025, lambda x: {"halving": off_by(0.0, x)}),
    "steps a period": (1 / 2.0, lambda x: {"steps_a_period": 1 / x}),
    "steps a forcing": (1 / 2.0, lambda x: {"steps_a_forcing": 1 / x}),
}


@pytest.mark.parametrize(("share", "valid"), [(0.99, True), (1.01, False), (np.nan, False)])
@pytest.mark.parametrize("what", IN_NUMBERS)
def test_every_limit_of_the_judge_in_numbers(what, share, valid):
    """Size 0.2 m, 7 J that move, speeds 3 m/s and 40 rad/s."""
    assert judge.judge(SOUND).valid
    limit, found = IN_NUMBERS[what]
    assert judge.judge(replace(SOUND, **found(share * limit))).valid is valid


@pytest.mark.parametrize(("lost", "told"), [(0.9e-9, False), (1.1e-9, True), (0.99e-2, True), (1.01e-2, False)])
def test_digits_are_told_that_lie_between_a_billionth_and_what_is_refused(lost, told):
    assert bool(judge.remark(replace(SOUND, disagreement=lost))) is told
    assert "keep about 6 digits" in judge.remark(replace(SOUND, disagreement=2.6e-7))


@pytest.mark.parametrize("broken", [1, 24])
def test_a_run_is_trusted_up_to_the_sample_before_the_first_that_is_objected_to(broken):
    mechanism = load("four_bar", "conservative")
    x = ran(mechanism, 25)
    q = x.q.copy()
    q[broken:, 0] += 0.5
    evaluator = Evaluator(mechanism)
    assert judge.trusted_until(evaluator, x) == x.t[-1]
    assert judge.trusted_until(evaluator, replace(x, q=q)) == x.t[broken - 1]
    moved = scrutiny.as_truth(replace(x, q=q))
    assert judge.trusted_until(evaluator, x, finer=moved) == x.t[broken - 1]
    assert judge.trusted_until(evaluator, x, moved) == x.t[broken - 1]


@pytest.mark.parametrize(("share", "valid"), [(0.9, True), (1.1, False)])
@pytest.mark.parametrize("name", ["place", "turn", "speed", "spin"])
def test_the_limits_of_rates_are_shares_of_size_and_speed(name, share, valid):
    """A gap alone; size 0.2 m, speeds 3 m/s and 40 rad/s."""
    limit = {"place": 0.005, "turn": 0.025, "speed": 0.075, "spin": 1.0}[name]

    def off(shares):
        return replace(STILL, **{name: FIVE + shares * limit})

    evidence = replace(SOUND, rates=off(share))
    assert judge.judge(evidence).valid == valid
    # half the step halves a gap of a first-order method, but excuses at most MOST_SHARED limits
    assert judge.judge(replace(evidence, rates_again=off(0.45 * share))).valid
    assert not judge.judge(replace(SOUND, rates=off(4.0), rates_again=STILL)).valid


@pytest.mark.parametrize(("share", "valid"), [(2.9, True), (3.1, False)])
@pytest.mark.parametrize("name", ["place", "turn", "speed", "spin"])
def test_what_samples_allow_of_rates_is_at_most_two_limits(name, share, valid):
    """Size, duration and largest speeds are 1, and all error bars are 9."""
    bars = metrics.MotionGap(9.0, 9.0, 9.0, 9.0)
    rates = replace(STILL, **{name: FIVE + share * judge.OFF_RATES}, bars=bars, fastest=(1.0, 1.0))
    assert judge.judge(replace(SOUND, size=1.0, rates=rates)).valid == valid


@pytest.mark.parametrize(
    ("gained", "bar", "floor", "valid"),
    [(0.29, 9.0, 0.0, True), (0.31, 9.0, 0.0, False), (0.31, 9.0, 0.02, True), (0.11, 0.02, 9.0, True), (0.13, 0.02, 9.0, False)],
)
def test_what_samples_allow_of_work_is_at_most_two_limits(gained, bar, floor, valid):
    """10 J move; rounding is allowed beside the two limits."""
    found = {"energy": FIVE + gained, "energy_bar": bar, "energy_scale": 10.0, "energy_floor": floor}
    assert judge.judge(replace(SOUND, **found)).valid == valid


def test_accelerations_are_judged_where_the_samples_themselves_say():
    t = np.arange(500.0)
    x = Trajectory(t, *np.random.default_rng(1).normal(size=(3, 500, 3)), 499)
    drawn = draw_samples(x)
    assert len(drawn) == JUDGED
    assert (np.diff(drawn) > 0).all()
    for name in "qva":
        other = getattr(x, name).copy()
        other[7, 1] += 1e-9
        assert not np.array_equal(drawn, draw_samples(replace(x, **{name: other})))
    assert draw_samples(x[:5]).tolist() == [0, 1, 2, 3, 4]


def test_rates_of_a_polynomial_leave_no_gap_and_a_scaled_one_leaves_its_share():
    t = np.linspace(0.0, 1.0, 101)
    p = np.polynomial.Polynomial([0.1, -2.0, 3.0])
    columns = np.array([1.0, 2.0, -1.0])
    q, v, a = (x(t)[:, None] * columns for x in (p, p.deriv(), p.deriv(2)))
    gaps = metrics.rate_gaps(Trajectory(t, q, v, a, 100))
    assert max(float(x.max()) for x in (gaps.place, gaps.turn, gaps.speed, gaps.spin)) < 1e-12
    # of t^3 the end correction leaves h^3 / 2 = 5e-7, trapezia alone h^2 / 2 = 5e-5
    assert abs(metrics.integral(t, 3 * t[:, None] ** 2)[-1, 0] - 1.0) < 1e-6
    off = metrics.rate_gaps(Trajectory(t, q, 1.1 * v, a, 100))
    assert off.turn[-1] == pytest.approx(0.1 * abs(p(1.0) - p(0.0)), rel=1e-9)
    assert off.place[-1] == pytest.approx(0.2 * abs(p(1.0) - p(0.0)), rel=1e-9)
    assert off.fastest == pytest.approx((2.2 * np.abs(p.deriv()(t)).max(), 1.1 * np.abs(p.deriv()(t)).max()))


def test_an_integrator_that_chooses_its_steps_is_run_again_at_a_tighter_tolerance(tmp_path):
    path = tmp_path / "oscillator.toml"
    path.write_bytes(toml(oscillator(k=800.0)))
    loose = simulate(str(path), integrator="dop853", settings="dop853_rtol=0.02,dop853_atol=0.02", at=[0.0, 1.0])
    assert loose.status == "invalid"
    assert "a tighter tolerance moves a link" in loose.message
    assert "ask for a tighter tolerance" in loose.advice
    sound = simulate(str(path), integrator="dop853", at=[0.0, 1.0])
    assert sound.status == "ok"
    assert 0 < sound.metrics["halving_length"] < 1e-6


def test_a_repetition_is_compared_at_the_samples_of_the_run():
    asked = Request("x", "s", "gauss", Choice("default", "x"), sampling(1e-3, 4e-3))
    engine = Offer("x", settings={"default": {}}, integrators=("x",), adaptive=("x",))
    times = scrutiny.repeat_finer(asked, engine, 0.0, asked.wanted.times).wanted.times
    assert times == pytest.approx(5e-4 * np.arange(9))
    column = np.arange(9.0)[:, None]
    again = Run(Status.OK, "", Trajectory(times, column, column, column, 8), None, sampling(1e-3, 4e-3))
    kept = scrutiny.at_samples(again, asked.wanted.times[:4]).trajectory
    assert [x.ravel().tolist() for x in (kept.q, kept.v, kept.a)] == [[0.0, 2.0, 4.0, 6.0]] * 3
    lost = replace(again, trajectory=None)
    assert scrutiny.at_samples(lost, times) is lost


@pytest.mark.parametrize(
    ("settings", "asked", "finer"),
    [
        ({"dop853_rtol": 1e-6, "dop853_atol": 1e-9}, None, 1e-8),
        ({"reltol": 1e-4}, None, 1e-6),
        ({"other": 3.0}, None, 1e-8),
        ({"reltol": 1e-4}, 1e-5, 1e-7),
        ({"reltol": 1e-13}, None, 1e-11),
    ],
)
def test_a_tighter_tolerance_is_a_hundredth(settings, asked, finer):
    engine = Offer("x", settings={"default": settings}, integrators=("x",), adaptive=("x",))
    assert scrutiny.finer_tolerance(engine, Choice("default", "x", tolerance=asked)) == pytest.approx(finer)


def test_the_same_bits_at_another_tolerance_are_no_repetition():
    mechanism = load("four_bar", "conservative")
    x = ran(mechanism, 11)
    again = Run(Status.OK, "", x, None, sampling(1e-3, 0.01))
    evidence, _ = scrutiny.evidence_of(mechanism, Choice("default", "own"), x, None, again, adaptive=True)
    assert judge.Subject.REPETITION in {y.subject for y in judge.judge(evidence).objections}
    kept = replace(x, a=x.a * 0 + x.a[0])
    for motion, refused in ((x, True), (kept, False)):  # of a parabola half the step may leave every bit
        again = replace(again, trajectory=motion)
        evidence, _ = scrutiny.evidence_of(mechanism, Choice("default", "rk4"), motion, None, again)
        assert (judge.Subject.REPETITION in {y.subject for y in judge.judge(evidence).objections}) is refused
    lost = replace(again, status=Status.TIMEOUT, message="too late", trajectory=None)
    evidence, _ = scrutiny.evidence_of(mechanism, Choice("default", "rk4"), x, None, lost)
    assert "half the step gave no motion to compare with: timeout, too late" in judge.judge(evidence).sentence


def test_a_driven_linkage_may_be_the_same_at_half_the_step():
    mechanism = load("four_bar", "driven")
    x = ran(mechanism, 11)
    assert not scrutiny.depends_on_steps(mechanism, x)
    assert scrutiny.depends_on_steps(load("four_bar", "conservative"), x)


def test_samples_are_copies_of_real_numbers_without_a_mask():
    t, states = np.arange(3.0), np.zeros((3, 3))
    good = Trajectory(t, states, states, states, 2)
    masked = np.ma.masked_array(states, mask=np.arange(9).reshape(3, 3) == 7)
    for q, valid in ((states, True), (states.view(np.ma.MaskedArray), True), (masked, False)):
        assert judge.completeness(replace(good, q=q), t, 3).valid is valid
    for kind in (complex, object, bool, str):
        bad = replace(good, v=states.astype(kind))
        assert "not real numbers" in judge.completeness(bad, t, 3).sentence
        assert judge.cut_at_fault(bad, t, 3) is None
    taken = judge.cut_at_fault(good, t, 3)
    states += 1.0  # the engine keeps a hold of its array
    assert not taken.q.any()


def test_a_certified_motion_is_held_against_its_rates_too(monkeypatch):
    """The places of the engine are right and its velocities a tenth too small; the reference is known."""
    read = InterpretedModel.read
    monkeypatch.setattr(InterpretedModel, "read", lambda model: replace(x := read(model), v=0.9 * x.v))
    found = simulate("four_bar", scenario="torque", at=[0.0, 0.2])
    assert "rates" in {x.subject for x in found.objections}


@pytest.mark.parametrize(("share", "enough"), [(0.9, True), (1.1, False)])
def test_a_reference_decides_whose_bar_is_a_tenth_of_what_is_allowed(share, enough):
    mechanism = load("four_bar", "torque")  # of less than a metre
    known = scrutiny.as_truth(at_rest(oscillator())[1])
    allowed = 0.1 * judge.OFF_MOTION * mechanism.size
    assert scrutiny.decides(replace(known, error_q=np.array([share * allowed])), mechanism) == enough


def test_samples_lie_an_eighth_of_the_quickest_period_apart_where_that_is_short(humming):
    assert scrutiny.sample_spacing(load("four_bar", "torque"), 2.0) == 1e-3
    assert scrutiny.sample_spacing(load(humming, "hum"), 2.0) == pytest.approx(0.25e-3 / 8)
    quick = load_document(oscillator(k=8e8))  # w = 2e4 rad/s
    assert scrutiny.sample_spacing(quick, 1.0) == pytest.approx(2 * np.pi / 2e4 / 8, rel=1e-3)
    assert scrutiny.sample_spacing(quick, 40.0) == pytest.approx(40.0 / 200_000)  # no more samples than memory has room for
    assert scrutiny.sample_spacing(quick, 4000.0) == 1e-3
    assert scrutiny.sample_spacing(load("squeezer"), 0.03) == pytest.approx(0.3e-3)  # a hundred samples of a short run


def test_of_a_long_run_the_first_part_is_repeated():
    times = np.arange(101.0)
    assert len(scrutiny.first_part(times, 29.0, 60.0)) == 101
    assert len(scrutiny.first_part(times, float("nan"), 60.0)) == 101
    assert len(scrutiny.first_part(times, 300.0, 60.0)) == 10
    assert len(scrutiny.first_part(times, 1e6, 60.0)) == 2


@pytest.mark.parametrize(
    ("subjects", "stabilized", "adaptive", "said"),
    [
        (["loops"], False, False, "do not trust it; take a step smaller than 0.001 s, or stabilization projection"),
        (["loops"], True, False, "do not trust it; take a step smaller than 0.001 s"),
        (["step"], False, True, "do not trust it; ask for a tighter tolerance"),
        (["rates"], False, False, "do not trust it"),
        (["motion"], False, False, ""),
    ],
)
def test_what_mends_a_run_follows_from_what_is_wrong(subjects, stabilized, adaptive, said):
    objections = tuple(judge.Objection(judge.Subject(x), 1.0, 0.0, x) for x in subjects)
    assert judge.advice(objections, 1e-3, stabilized, adaptive) == said


def test_samples_are_spread_evenly_from_the_first_to_the_last():
    assert spread_evenly(5, 3).tolist() == [0, 2, 4]
    assert spread_evenly(3, 20).tolist() == [0, 1, 2]
    assert spread_evenly(0, 20).tolist() == []
