"""Findings of rows with known answers: the named case, its number, and where a threshold lies."""

from typing import Any

import numpy as np
import pytest

from gauss_bench.report.build import all_findings
from gauss_bench.report.cases import chose_steps, run_time
from gauss_bench.report.rows import KEYS, Run

KEY = ("four_bar", "torque", "gauss", "default", "rk4", "none", 1e-3, 2.0)
Row = dict[str, Any]


def row(engine="gauss", **columns):
    """A valid row of 2 s at 1 ms, with an error of 2e-4 rad, at 50 us a step, but for the columns given."""
    found = dict(zip(KEYS, KEY, strict=True)) | {"status": "ok", "message": "", "note": "", "valid": True, "control": False}
    found |= {"measured": "angle of crank", "measured_unit": "rad", "measured_error_t2": 2e-4, "measured_error_bar_t2": 1e-12}
    found |= {"position_drift": 1e-6, "velocity_drift": 1e-5, "acceleration_error_median": 1e-14, "step_time": 50e-6}
    found |= {"engine": engine} | columns
    return {"steps": round(found["t_end"] / found["step"])} | found


def texts(title, *rows, environment=None, **tables):
    """The text of the findings of that title, of a run with these rows and tables."""
    run = Run(environment or {}, {"results": rows, **tables})
    return "\n".join(f.text for f in all_findings(run) if f.title == title)


def kernel_texts(title, **tables):
    return texts(title, **{f"kernel_{name}": tuple(rows) for name, rows in tables.items()})


LOOPS = [row(), row("lagrange", step_time=25e-6), row("gauss-native", native_step_time=1e-7)]  # one of them compiled
AT_TARGET = [row("schur", measured_error_t2=0.9e-6), row("lagrange", measured_error_t2=1.1e-6, step_time=1e-6)]
NEAR = [row(x, measured_error_t2=e) for x, e in (("gauss", 1.0e-4), ("lagrange", 1.04e-4), ("schur", 1.06e-4))]
BELOW = [row(measured_error_t2=0.9e-12), row("lagrange", measured_error_t2=1.1e-12)]


@pytest.mark.parametrize(
    ("rows", "text"),
    [
        (
            [row(), row("lagrange", step_time=5e-6)],
            "`lagrange` rk4 at step 0.001 s, 10 ms stepped from Python; `gauss` needs 100 ms",
        ),
        (LOOPS, "Cheapest within 1e-03 rad: `gauss-native` rk4 at step 0.001 s, 0.2 ms in its own loop. "),
        (LOOPS, "`lagrange` rk4 at step 0.001 s, 50 ms stepped from Python; `gauss` needs 100 ms (2.00 times as long)"),
        (AT_TARGET, "Cheapest within 1e-06 rad: `schur`"),
        (NEAR, "Most accurate: `gauss` and `lagrange` rk4"),
        (BELOW, "Error of angle of crank below the reference's bar (1e-12 rad): `gauss`."),
    ],
)
def test_the_best_of_a_linkage(rows, text):
    assert text in texts("four_bar, torque", *rows)


def test_a_run_costs_its_steps_in_the_engines_own_loop_if_it_has_one():
    costs = [run_time(row(**x)) for x in ({}, {"native_step_time": 2e-6}, {"step_time": np.nan})]
    assert costs == pytest.approx([0.1, 4e-3, np.nan], nan_ok=True)


@pytest.mark.parametrize(("steps", "own"), [(2000, False), (2030, False), (2050, True), (400, True)])
def test_an_integrator_that_took_other_steps_than_asked_chose_them(steps, own):
    assert chose_steps(row(steps=steps)) is own


@pytest.mark.parametrize(("error", "same"), [(0.9e-6, True), (1.1e-6, False)])
def test_a_millionth_is_the_same_acceleration(error, same):
    engine = row("exudyn", acceleration_error_median=error)
    assert ("`exudyn` (" in texts("Same state, same acceleration", engine)) is same
    assert ("`exudyn`" in texts("Soft, or another model", engine)) is not same


@pytest.mark.parametrize(("coarse", "finer", "flat"), [(4e-3, 1.1e-2, True), (4e-3, 0.9e-2, False), (2e-3, 2e-2, False)])
def test_an_error_is_flat_if_a_quarter_of_the_step_does_not_halve_it(coarse, finer, flat):
    soft = {"engine": "mujoco", "acceleration_error_median": 1e-2}
    rows = [row(step=coarse, measured_error_t2=2e-2, **soft), row(step=1e-3, measured_error_t2=finer, **soft)]
    assert ("and does not: on four_bar" in texts("Soft, or another model", *rows)) is flat


OFF = {"measured_error_t2": 1.1, "position_drift": 0.9e-4}


IN_BOUNDS = [{"measured_error_t2": 0.9}, {"position_drift": 1.1e-4}, {"acceleration_error_median": 1.1e-2}, {"control": True}]


@pytest.mark.parametrize("changed", [{}, *IN_BOUNDS])
def test_a_crank_a_radian_off_behind_closed_loops_is_found(changed):
    assert bool(texts("Closed loops, wrong motion", row(), row("mujoco", **OFF | changed))) is not bool(changed)
    gates = {"gates": {"acceleration": 1e-3}}  # the gate that a run recorded decides whose model is right
    assert not texts("Closed loops, wrong motion", row("mujoco", **OFF, acceleration_error_median=5e-3), environment=gates)


def published(difference, **columns):
    digits = {"printed_digits": 16, "true_digits": 9}
    return {"quantity": "beta", "difference": difference, "floor": 1e-13, "error_bar": 2e-13} | digits | columns


@pytest.mark.parametrize(("difference", "off"), [(1.9e-12, False), (2.1e-12, True), (0.0, False)])
def test_a_published_value_is_off_beyond_ten_times_the_certificates_bar(difference, off):
    text = texts("Published values", published=(published(difference), published(0.0)))
    assert ("1 are off" in text) is off
    worse = published(1e-6, quantity="gamma", true_digits=4)
    assert "gamma, is printed with 16 digits, of which 4 are true" in texts("Published values", published=(published(1e-9), worse))


def ratio(value, low=np.nan, high=np.nan):
    return {"step_ratio": value, "step_ratio_low": low, "step_ratio_high": high}


@pytest.mark.parametrize(
    ("baseline", "own", "rival", "text"),
    [
        ("lagrange", ratio(1.5, 1.4, 1.6), ratio(1.0, 1.0, 1.0), "four_bar rk4 1.50 (1.40..1.60); slower in 1 of 1."),
        ("lagrange", ratio(1.5, 0.9, 1.6), ratio(1.0, 1.0, 1.0), "slower in 0 of 1, undecided in 1."),
        ("gauss", ratio(1.0, 1.0, 1.0), ratio(0.5, 0.4, 0.8), "four_bar rk4 2.00 (1.25..2.50)"),
    ],
)
def test_costs_against_lagrange_have_the_spread_of_the_rows(baseline, own, rival, text):
    stabilised = row(stabilization="baumgarte", step_ratio=1.3)  # costs more; Lagrange was timed without
    rows = (stabilised, row(**own), row("lagrange", **rival))
    assert text in texts("Cost of gauss against lagrange", *rows, environment={"baseline_engine": baseline})


def test_the_judges_reasons_are_listed_without_their_numbers():
    flags = ("a link ends up 0.037 m from where it should be", "a link ends up turned by 3.1 rad from where it should be")
    flags += ("energy off by 1.2e+03 J where 24 J move", "the loops open by 0.031 (m or rad)")
    text = texts("Ran, but not valid", *(row("exudyn", valid=False, status="invalid", flag=x) for x in flags))
    words = ("a link ends up away from where it should be", "a link ends up turned from where it should be", "energy off")
    assert all(x in text for x in (*words, "the loops open)"))
    assert not any(x in text for x in ("0.037", "3.1", " J", "0.031"))


def kernel_step(settings, over):
    step = {"mechanism": "six_bar", "formulation": "gauss", "stabilization": "none", "status": "ok"}
    return step | {"settings": settings, "ratio": over}


def claimed(mechanism, unknowns, verdicts, *ratios):
    found = {"mechanism": mechanism, "unknowns_gauss": unknowns, "processes": 5.0, "status": "ok", "message": ""}
    for way, verdict, x in zip(("", "projected_", "batch_"), verdicts, ratios, strict=True):
        found |= {f"{way}ratio": x, f"{way}ratio_low": 0.98 * x, f"{way}ratio_high": 1.02 * x, f"{way}verdict": verdict}
    return found


HOLDS, REVERSED = ("holds",) * 3, ("reversed",) * 3


def test_the_papers_claim_is_one_sentence_on_every_linkage_and_kind_of_step():
    rows = [
        claimed("four_bar", 1, HOLDS, 1.5, 1.2, 2.0),
        claimed("eight_bar", 1, ("holds", "open", "reversed"), 1.3, 1.01, 0.9),
        claimed("pendulums_2", 2, REVERSED, 0.9, 0.8, 0.7),
        claimed("pendulums_16", 16, REVERSED, 0.4, 0.5, 0.3),
        {"mechanism": "sleigh", "unknowns_gauss": 3, "status": "skip", "message": "no kernel"},
    ]
    text = kernel_texts("The paper's claim", claim=rows)
    assert text.startswith("In part. Compiled by the same eliminator, n - m unknowns against n + m, as the median of 5 processes: ")
    first, second = text.split(": ", 1)[1].split("; with 2 to 16")
    assert first.startswith("with 1 free coordinate a step is faster on 2 of 2 linkages (ratio 1.30 to 1.50)")
    assert "a step with projection is faster on 1 of 2 linkages (ratio 1.01 to 1.20; no difference on eight_bar)" in first
    assert "a step in a batch is faster on 1 of 2 linkages (ratio 0.900 to 2.00; slower on eight_bar)" in first
    assert "a step is faster on 0 of 2 linkages (ratio 0.400 to 0.900; slower on pendulums_2 and pendulums_16)" in second
    assert text.endswith("Left out: sleigh (no kernel).")


@pytest.mark.parametrize(
    ("title", "table", "columns"),
    [
        ("A step in its own loop", "steps", kernel_step("tuned", 5.0)),
        ("Many trajectories", "batch", {"ratio": 5.0, "lanes_error": 0.0, "states": 9.0}),
        ("What is left to be gained", "bounds", {"quantity": "a batch", "share": 0.5}),
        ("The same accelerations", "agreement", {"error": 1e-15, "formulation": "gauss", "place": "random", "met": True}),
        ("Long runs", "long", {"position_drift": 1e-16, "velocity_drift": 1e-16, "t_end": 100.0}),
        ("The paper's claim", "claim", claimed("four_bar", 1, HOLDS, 1.5, 1.2, 2.0)),
    ],
)
def test_a_headline_names_the_linkages_that_it_leaves_out(title, table, columns):
    whole = columns | {"mechanism": "four_bar", "status": "ok", "message": ""}
    lost = {k: x for k, x in whole.items() if isinstance(x, str)}
    lost |= {"mechanism": "shaper", "status": "skip", "message": "no compiler"}
    assert kernel_texts(title, **{table: [whole, lost]}).endswith("Left out: shaper (no compiler).")
    assert "Left out" not in kernel_texts(title, **{table: [whole]})


def asked(own, rival, over):
    return {"mechanism": "four_bar", "own": own, "rival": rival, "ratio": over, "status": "ok"}


FORMS = {"position_error": 1e-16, "velocity_error": 2e-15, "acceleration_error": 3e-14}
TURN = {"mechanism": "four_bar", "rate": 7.9e6, "target": 7.4e6, "met": True, "status": "ok"} | FORMS
SHARES = [{"mechanism": x, "quantity": "a batch", "share": y, "status": "ok"} for x, y in (("a", 0.42), ("b", 0.5))]
CALLS = [asked("in its own loop", "less the call", 25.0), asked("in its own loop", "as called", 30.0)]
STEPS = [kernel_step("default", 100.0), kernel_step("tuned", 60.0)]  # of which the faster setting counts
CALLS += [asked("called from Python", "as called", 0.8), asked("called from Python", "less the call", 0.7)]


@pytest.mark.parametrize(
    ("title", "tables", "parts"),
    [
        ("A step in its own loop", {"steps": STEPS}, ["six_bar 60.0."]),
        ("A step in its own loop", {"steps": STEPS[::-1]}, ["six_bar 60.0."]),
        ("What is left to be gained", {"bounds": SHARES}, ["42 to 50 % for a batch"]),
        ("Kinematics", {"kinematics": [TURN]}, ["7.9e+06 on four_bar", "at most 3.0e-14"]),
        (
            "One right-hand side",
            {"rhs": CALLS},
            ["takes 25.0 times", "0.800 times as long; the kernel is slower on four_bar"],
        ),
    ],
)
def test_numbers_of_the_kernel_are_printed_in_their_units(title, tables, parts):
    text = kernel_texts(title, **tables)
    assert all(x in text for x in parts)
