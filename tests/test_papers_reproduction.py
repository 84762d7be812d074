"""Compare the paper's crank-slider with the general library and with the energy, also with data for which it stops."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from gauss_bench.engines import get
from gauss_bench.formulations.yuan_ge_eq16 import yuan_ge_eq16
from gauss_bench.mechanism.model import Torque
from gauss_bench.papers import crank_motion
from gauss_bench.papers.crank_motion import EQ_16, EQS_10_11, find_bound, find_equilibria, settles, torque_range
from gauss_bench.papers.crank_slider import linkage, states
from gauss_bench.papers.forms import least_squares, problems
from gauss_bench.papers.forms.example import SHOWN, reference_motion
from gauss_bench.papers.reproduction import formula_values, judge_claims, paper_motion, reproduction, static_values, steady_values
from tests.conftest import needs
from tests.engine_runs import ran
from tests.published import published

ROUNDING = 1e-12  # relative: accelerations of the general library are closed to 1e-15, times the growth in both
MOTION = crank_motion.motion_of(linkage())


def rows():
    """Return key -> published row."""
    return {row["key"]: row for row in published().table("reproduction")}


@pytest.mark.parametrize("every", [pytest.param(False, marks=pytest.mark.slow), pytest.param(True, marks=pytest.mark.long)])
def test_the_published_rows_are_computed_again(every):
    """All rows at night, else those that take seconds."""
    computed = reproduction()["reproduction"] if every else []
    numbers = {row["key"]: (row["value"], row["bracket"]) for row in computed}
    numbers = numbers or steady_values(MOTION) | static_values(MOTION) | formula_values(MOTION)
    for key, (value, bracket) in numbers.items():
        expected = float("nan") if value is None else value  # an empty cell of a table is read as NaN
        brackets = (bracket or 0.0) + np.nan_to_num(rows()[key]["bracket"])  # both values have one: that of (16) is rounding's
        assert rows()[key]["value"] == pytest.approx(expected, rel=1e-9, abs=3 * brackets + 1e-12, nan_ok=True), key
    verdicts = {row["key"]: row["verdict"] for row in computed} or {"stops": "refuted", "rests": "holds"}
    assert {key: rows()[key]["verdict"] for key in verdicts} == verdicts


def test_the_closed_form_is_the_linkage_file():
    for state in states():
        q, d, e = map(np.array, MOTION.positions(state.q[2]))
        w, found = state.v[2], MOTION.acceleration(state.q[2], state.v[2])
        assert found == pytest.approx(state.a[2], rel=ROUNDING)
        assert np.abs(q - state.q).max() < ROUNDING
        assert np.abs(d * w - state.v).max() < ROUNDING * (1 + np.abs(state.v).max())
        assert np.abs(d * found + e * w * w - state.a).max() < ROUNDING * (1 + np.abs(state.a).max())


def test_wrong_formulas_in_the_crank_angle_are_those_of_the_paper():
    for state, problem in zip(states(), problems.crank_problems(), strict=True):
        right = {EQ_16: yuan_ge_eq16(problem.terms).a, EQS_10_11: least_squares.printed_exponents(problem)}
        for formula, full in right.items():
            found = replace(MOTION, formula=formula).acceleration(state.q[2], state.v[2])
            assert found == pytest.approx(full[problems.CRANK], rel=1e-9)  # two pseudo-inverses of condition 1e3


def test_the_motion_is_that_of_the_reference():
    course = MOTION.run(SHOWN)
    assert course.theta[-1] == pytest.approx(reference_motion().q[-1, 2], abs=1e-9)  # the tolerance, a few steps
    assert course.w[-1] == pytest.approx(reference_motion().v[-1, 2], abs=1e-7)


def test_equilibria_balance_and_stable_ones_hold():
    low, high = torque_range(MOTION)
    assert low.torque == pytest.approx(-(0.37 + 0.77) * 9.81 * 0.15 / 2, rel=1e-12)  # both weights, half the crank's arm
    for torque in (MOTION.torque, 0.0, 0.8, -0.85):
        other = replace(MOTION, torque=torque)
        places = find_equilibria(other)
        assert sorted(place.stable for place in places) == [False, True]
        for place in places:
            nudged = other.run(3.0, (place.theta + 1e-3, 0.0))
            assert (np.abs(nudged.theta - place.theta).max() < 3e-3) == place.stable
    assert not find_equilibria(replace(MOTION, torque=-low.torque + 1e-6))
    assert not find_equilibria(replace(MOTION, torque=-high.torque - 1e-6))


@pytest.mark.parametrize(("torque", "c", "stops"), [(-0.2, 1.0, True), (0.5, 1.0, True), (-0.31, 1.0, False), (-0.5, 5.0, True)])
def test_the_first_turn_decides(torque, c, stops):
    other = replace(MOTION, torque=torque, c=c)
    assert settles(other) == stops
    if stops:
        course = other.run(120.0, rtol=1e-7)
        (place,) = (p.theta for p in find_equilibria(other) if p.stable)
        assert (course.theta[-1], course.w[-1]) == pytest.approx((place, 0.0), abs=1e-3)
    else:
        speeds = [0.0, abs(crank_motion.first_turn(other)[1])]
        while len(speeds) < 8:
            speeds.append(float(crank_motion.integrate_turn(other, -speeds[-1])[0, -1]))
        assert all(later > earlier for earlier, later in pairwise(speeds))


def test_the_regime_is_that_of_a_long_run_and_a_steady_turn_loses_what_it_takes():
    value = {key: row["value"] for key, row in rows().items()}
    course = MOTION.run(16.0, rtol=1e-8)
    round_at = [float(np.interp(-2 * np.pi * k, course.theta[::-1], course.t[::-1])) for k in (90, 100)]
    assert 10 / (round_at[1] - round_at[0]) == pytest.approx(1 / value["period"], rel=2e-3)  # not quite steady yet
    assert value["slowest"] > value["mean"] > value["fastest"]
    assert value["lost"] == pytest.approx(value["taken"], abs=2 * rows()["lost"]["bracket"])


def test_the_table_of_the_figures_is_the_reference():
    reference = reference_motion()
    last = paper_motion(linkage(), reference)["paper_motion"][-1]
    assert last["t"] == reference.t[-1]
    for k, name in ((0, "x1"), (1, "y1"), (2, "theta1"), (6, "x3")):
        assert (last[name], last[f"{name}_rate"]) == pytest.approx((reference.q[-1, k], reference.v[-1, k]), abs=1e-12)


@pytest.mark.parametrize("side", [1e-4, -1e-4])
def test_the_bound_of_the_torque_is_that_of_the_general_library(side):
    """On one side of it the crank completes a turn from rest, on the other it swings back."""
    needs("llvmlite")
    torque = rows()["settles_above"]["value"] + side
    forces = tuple(replace(f, value=torque) if isinstance(f, Torque) else f for f in linkage().forces)
    twisted = replace(linkage(), forces=forces)
    found = ran(get("minimal"), twisted, np.linspace(0.0, 4.0, 41), integrator="dop853", tolerance=1e-10)
    assert (found.q[:, 2].min() < -2 * np.pi) == (side < 0)


@pytest.mark.slow
def test_a_bound_is_found_again_and_refused_between_equal_fates():
    bound = rows()["settles_above"]["value"]
    found, width = find_bound(lambda torque: replace(MOTION, torque=torque), bound + 1e-3, bound - 1e-3, 1e-5)
    assert found == pytest.approx(bound, abs=width)
    with pytest.raises(ValueError, match="different signs"):
        find_bound(lambda torque: replace(MOTION, torque=torque), 0.0, -0.1)


def test_verdicts_follow_from_the_data():
    printed, other = judge_claims(MOTION), judge_claims(replace(MOTION, torque=-MOTION.torque))
    assert not any(printed[claim] for claim in ("stops", "decreases", "formula"))
    assert other["stops"]
    assert other["decreases"]
    assert not other["any_inertia"]
    assert not judge_claims(replace(MOTION, torque=-1.0))["rests"]
