"""The second pipeline of a certificate, held against closed forms, the double-precision reference and itself.

Long double carries 64 bits: EPS is 1.1e-19. Where nothing else is said, tolerances are some roundings of the values compared.
"""

from copy import deepcopy
from decimal import Decimal

import numpy as np
import pytest

from gauss_bench.linkage.closure import list_held
from gauss_bench.linkage.load import decimal_document, load, merge
from gauss_bench.mechanism.numbers import PI
from gauss_bench.reference import extended
from gauss_bench.reference.build import build_reference
from gauss_bench.reference.collocation import gauss_legendre
from gauss_bench.reference.exact import closed_form
from gauss_bench.reference.extended import Linkage, extend_motion
from tests.conftest import DATA, exhaustive

LONG = np.longdouble
EPS = float(np.finfo(LONG).eps)
STEP = 1e-2  # [s] steps are halved wherever the motion needs it

pytestmark = pytest.mark.skipif(np.finfo(LONG).nmant <= 60, reason="long double is no longer than double on this platform")


def decimals(linkage, scenario):
    """The document with decimals as written and the scenario's override merged."""
    document = decimal_document(linkage)
    return merge(document, document["scenarios"][scenario].get("override", {}))


def samples(until, spacing="0.01"):
    return [str(k * Decimal(spacing)) for k in range(int(Decimal(until) / Decimal(spacing)) + 1)]


def run(linkage, scenario, until, step=STEP, spacing="0.01"):
    return extend_motion(decimals(linkage, scenario), scenario, samples(until, spacing), step)


def distance(one, other):
    """Largest difference relative to the largest value, or to 1."""
    return float(np.abs(one - other).max() / max(1.0, np.abs(other).max()))


@pytest.mark.parametrize(("stages", "dtype", "steps"), [(2, np.float64, (0.1, 0.05)), (8, LONG, (3, 2)), (10, LONG, (4, 3))])
def test_the_error_falls_with_twice_the_stages(stages, dtype, steps):
    """An oscillator at steps long enough, up to two thirds of a period, for the error to stand far above rounding."""
    times = np.array([0.0, 24.0], dtype=dtype)
    one, none = np.ones(1, dtype=dtype), np.zeros(1, dtype=dtype)
    errors = []
    for h in steps:
        q, v = gauss_legendre(lambda t, q, v: -q, times, one, none, h, stages)
        errors.append(float(np.hypot(q[-1, 0] - np.cos(times[-1]), v[-1, 0] + np.sin(times[-1]))))
    order = np.log(errors[0] / errors[1]) / np.log(steps[0] / steps[1])
    assert order == pytest.approx(2 * stages, abs=0.5)


STARTS = [("parallelogram", "torque"), ("five_bar", "spring"), ("sleigh", "glide")]
STARTS += [
    (DATA / f"{name}.toml", scenario) for name, scenario in (("pushed", "push"), ("everything", "free"), ("all_kinds", "all"))
]


@pytest.mark.parametrize(("linkage", "scenario"), STARTS, ids=str)
def test_the_start_is_closed_and_held_to_the_last_digit(linkage, scenario):
    document = decimals(linkage, scenario)
    found = Linkage(document, scenario)
    q, v = found.q0, found.v0
    rows = found.rows(LONG(0), q, v)
    size = 1 + float(np.abs(q).max())
    assert np.abs(rows.phi).max(initial=0.0) < 4 * EPS * size
    assert np.abs(rows.J @ v + rows.phi_t).max(initial=0.0) < 8 * EPS * (1 + float(np.abs(v).max()))
    held = list_held(found.mechanism, document["scenarios"][scenario], LONG)
    value, J = held.evaluate(q)
    assert held.target.dtype == LONG
    assert np.abs(value - held.target).max(initial=0.0) < 4 * EPS * size
    assert np.abs(J @ v - held.rate).max(initial=0.0) < 8 * EPS * (1 + float(np.abs(v).max()))
    double = load(linkage, scenario)
    assert np.abs(q - double.q0).max() < 1e-13


QUICK = [("parallelogram", "torque", "0.02"), ("excavator", "dig", "0.1"), (DATA / "everything.toml", "free", "0.03")]
MOTIONS = [
    *QUICK,
    ("eight_bar", "torque", "0.1"),
    ("jansen", "walk", "0.1"),
    ("five_bar", "spring", "0.2"),
    ("six_bar", "cycloid", "0.3"),
]


@pytest.mark.parametrize(("linkage", "scenario", "until"), exhaustive(MOTIONS, *QUICK))
def test_the_motion_agrees_with_the_double_reference_and_does_not_drift(linkage, scenario, until):
    motion, halved = run(linkage, scenario, until), run(linkage, scenario, until, STEP / 2)
    assert motion.stopped == ""
    assert motion.times == tuple(samples(until))
    assert motion.drift[0] < 8 * EPS * (1 + np.abs(motion.q).max())
    assert motion.drift[1] < 8 * EPS * (1 + np.abs(motion.v).max())
    mechanism = load(linkage, scenario)
    reference = build_reference(mechanism, float(until))
    for level in ("q", "v", "a"):
        value, bar = getattr(reference, level), getattr(reference, f"error_{level}")
        # the bars leave out that decimals become doubles, and of driven motions the condition of the closure: some 100 a derivative
        floor = {"q": 1e-14, "v": 1e-13, "a": 1e-12}[level] * (1 + np.abs(value).max())
        assert (np.abs(getattr(motion, level) - value).max(axis=-1) <= bar + floor).all(), level
        # half the step changes roundings only, which the motion multiplies by 10 to 100
        assert distance(getattr(motion, level), getattr(halved, level)) < {"q": 1e-17, "v": 1e-16, "a": 1e-15}[level], level


@pytest.mark.parametrize(
    ("name", "scenario", "until"), [("sleigh", "glide", "2"), ("n_four_bar_2", "fall", "0.5"), ("pendulum", "swing", "1")]
)
def test_the_motion_follows_closed_forms_in_forty_digits(name, scenario, until):
    motion = run(name, scenario, until, spacing="0.1")
    exact = closed_form(load(name, scenario), motion.times)
    for level, bound in (("q", 1e-17), ("v", 1e-16), ("a", 1e-15)):
        error = [
            abs(x - type(x)(float(y)) - float(y - LONG(float(y))))
            for x, y in zip(getattr(exact, level).ravel(), getattr(motion, level).ravel(), strict=True)
        ]
        assert max(error) < bound * max(1.0, float(np.abs(getattr(motion, level)).max())), level


def test_a_singular_position_ends_the_motion_with_its_time():
    motion = run("n_four_bar_2", "fall", "0.8")
    assert "singular position" in motion.stopped
    assert motion.stopped.startswith("t = 0.714")  # the bars lie down 0.7143 s after the start, by the closed form
    assert motion.times[-1] == "0.71"
    assert len(motion.q) == len(motion.a) == len(motion.times)


def test_a_law_that_ends_between_samples_costs_no_digits():
    """The jerk of a cycloid jumps at its end: a step across it would be good to a few digits only."""
    document = decimals("five_bar", "spring")
    chosen = deepcopy(document["scenarios"]["spring"])
    law = {"link": "left", "law": "sine", "start_deg": 100, "travel_deg": 20, "time": Decimal("0.037")}
    chosen |= {"driver": law, "start": {"angles_deg": {"right": 80}, "speeds": {"right": -1}}}
    document["scenarios"] = {"half": chosen}
    one, other = (extend_motion(document, "half", samples("0.1"), h) for h in (STEP, STEP / 2))
    assert one.stopped == ""
    left = 2 + 3 * list(document["links"]).index("left")
    assert np.abs(one.q[4:, left] - LONG(PI) * 120 / 180).max() < 8 * EPS
    assert distance(one.q, other.q) < 1e-17
    assert distance(one.a, other.a) < 1e-15


def test_friction_and_short_long_doubles_are_refused(monkeypatch):
    friction = load(DATA / "friction.toml").scenario
    with pytest.raises(ArithmeticError, match="friction"):
        run(DATA / "friction.toml", friction, "0.02")
    monkeypatch.setattr(extended, "MANTISSA", 1000)
    with pytest.raises(ArithmeticError, match="mantissa"):
        run("four_bar", "torque", "0.02")
