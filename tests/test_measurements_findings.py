"""What the report says of rows written down by hand: which one it names, its number, and where a threshold lies."""

from typing import Any

import numpy as np
import pytest

from gauss_bench.report.build import all_findings
from gauss_bench.report.rows import KEYS, Run, chose_steps, run_time

KEY = ("four_bar", "torque", "gauss", "default", "rk4", "none", 1e-3, 2.0)


def row(**columns: Any) -> dict[str, Any]:
    """A valid row of 2 s at 1 ms, with an error of 2e-4 rad, at 50 us a step, but for the columns given."""
    found = dict(zip(KEYS, KEY, strict=True)) | {"status": "ok", "message": "", "note": "", "valid": True, "control": False}
    found |= {"measured": "angle of crank", "measured_unit": "rad", "measured_error_t2": 2e-4, "measured_error_bar_t2": 1e-12}
    found |= {"position_drift": 1e-6, "velocity_drift": 1e-5}
    found |= {"acceleration_error_median": 1e-14, "step_time": 50e-6}
    found |= columns
    return {"steps": round(found["t_end"] / found["step"])} | found


def said(title: str, *rows: dict[str, Any], environment: dict[str, Any] | None = None, **tables: Any) -> str:
    """The text of the findings of that title, of a run with these rows and tables."""
    run = Run(environment or {}, {"results": rows, **tables})
    return "\n".join(f.text for f in all_findings(run) if f.title == title)


def test_gauss_is_told_how_many_times_as_long_as_the_cheapest_it_takes() -> None:
    """2000 steps of 50 us against 2000 of 5 us: 100 ms against 10 ms."""
    text = said("four_bar, torque", row(), row(engine="lagrange", step_time=5e-6))
    assert "Cheapest within 1e-03 rad: `lagrange` rk4 at step 0.001 s, 10 ms stepped from Python" in text
    assert "`gauss` needs 100 ms (10.0 times as long)" in text


def test_compiled_and_interpreted_are_not_held_against_each_other() -> None:
    """The compiled engine needs 0.2 ms; `gauss` is told against the cheapest that is stepped from Python as it is."""
    compiled = row(engine="gauss-native", native_step_time=1e-7)
    text = said("four_bar, torque", row(), row(engine="lagrange", step_time=25e-6), compiled)
    assert "Cheapest within 1e-03 rad: `gauss-native` rk4 at step 0.001 s, 0.2 ms in its own loop. " in text
    assert "`lagrange` rk4 at step 0.001 s, 50 ms stepped from Python; `gauss` needs 100 ms (2.00 times as long)" in text


def test_a_target_is_reached_by_what_errs_less() -> None:
    near, far = row(engine="schur", measured_error_t2=0.9e-6), row(engine="lagrange", measured_error_t2=1.1e-6, step_time=1e-6)
    text = said("four_bar, torque", near, far)
    assert "Cheapest within 1e-06 rad: `schur`" in text
    assert "Cheapest within 1e-03 rad: `lagrange`" in text
    assert "Most accurate: `schur`" in text


def test_a_run_costs_its_steps_in_the_engines_own_loop_where_it_has_one() -> None:
    assert run_time(row()) == pytest.approx(0.1)
    assert run_time(row(native_step_time=2e-6)) == pytest.approx(4e-3)
    assert np.isnan(run_time(row(step_time=np.nan)))


def test_engines_within_a_twentieth_tie() -> None:
    rows = [row(engine=name, measured_error_t2=x) for name, x in (("gauss", 1.0e-4), ("lagrange", 1.04e-4), ("schur", 1.06e-4))]
    assert "Most accurate: `gauss` and `lagrange` rk4" in said("four_bar, torque", *rows)


def test_an_error_below_the_references_bar_is_no_number() -> None:
    text = said("four_bar, torque", row(measured_error_t2=0.9e-12), row(engine="lagrange", measured_error_t2=1.1e-12))
    assert "Error of angle of crank below the reference's bar (1e-12 rad): `gauss`." in text


@pytest.mark.parametrize(("error", "same"), [(0.9e-6, True), (1.1e-6, False)])
def test_a_millionth_is_the_same_acceleration(error: float, same: bool) -> None:
    engine = row(engine="exudyn", acceleration_error_median=error)
    assert ("`exudyn` (" in said("Same state, same acceleration", engine)) is same
    assert ("`exudyn`" in said("Soft, or another model", engine)) is not same


@pytest.mark.parametrize(("finer", "flat"), [(1.1e-2, True), (0.9e-2, False)])
def test_an_error_that_halves_over_four_times_the_step_comes_from_the_step(finer: float, flat: bool) -> None:
    soft = {"engine": "mujoco", "acceleration_error_median": 1e-2}
    rows = [row(step=4e-3, measured_error_t2=2e-2, **soft), row(step=1e-3, measured_error_t2=finer, **soft)]
    assert ("and does not: on four_bar" in said("Soft, or another model", *rows)) is flat


def test_twice_the_step_is_no_evidence() -> None:
    soft = {"engine": "mujoco", "acceleration_error_median": 1e-2, "measured_error_t2": 2e-2}
    assert "and does not" not in said("Soft, or another model", row(step=2e-3, **soft), row(step=1e-3, **soft))


@pytest.mark.parametrize(
    ("changed", "told"),
    [
        ({}, True),
        ({"measured_error_t2": 0.9}, False),
        ({"position_drift": 1.1e-4}, False),
        ({"acceleration_error_median": 1.1e-2}, False),
        ({"control": True}, False),
    ],
)
def test_a_crank_a_radian_off_behind_closed_loops_is_told(changed: dict[str, Any], told: bool) -> None:
    off = row(engine="mujoco", **({"measured_error_t2": 1.1, "position_drift": 0.9e-4} | changed))
    assert bool(said("Closed loops, wrong motion", row(), off)) is told


def test_the_gate_that_a_run_recorded_decides_whose_model_is_right() -> None:
    off = row(engine="mujoco", measured_error_t2=1.1, position_drift=1e-5, acceleration_error_median=5e-3)
    assert said("Closed loops, wrong motion", off)
    assert not said("Closed loops, wrong motion", off, environment={"gates": {"acceleration": 1e-3}})


@pytest.mark.parametrize(("steps", "own"), [(2000, False), (2030, False), (2050, True), (400, True)])
def test_an_integrator_that_took_other_steps_than_asked_chose_them(steps: int, own: bool) -> None:
    assert chose_steps(row(steps=steps)) is own


def published(difference: float) -> dict[str, Any]:
    digits = {"printed_digits": 16, "true_digits": 9}
    return {"quantity": "beta", "difference": difference, "floor": 1e-13, "error_bar": 2e-13} | digits


@pytest.mark.parametrize(("difference", "off"), [(1.9e-12, False), (2.1e-12, True), (0.0, False)])
def test_a_published_value_is_off_beyond_ten_times_what_the_certificate_leaves_open(difference: float, off: bool) -> None:
    assert ("1 are off" in said("Published values", published=(published(difference), published(0.0)))) is off


def test_the_worst_published_value_is_named_with_its_true_digits() -> None:
    worse = published(1e-6) | {"quantity": "gamma", "true_digits": 4}
    text = said("Published values", published=(published(1e-9), worse))
    assert "2 are off" in text
    assert "gamma is printed with 16 digits, of which 4 are true" in text


def test_costs_against_lagrange_are_the_rows_own_ratio_with_its_spread() -> None:
    own = row(step_ratio=1.5, step_ratio_low=1.4, step_ratio_high=1.6)
    rival = row(engine="lagrange", step_ratio=1.0, step_ratio_low=1.0, step_ratio_high=1.0)
    text = said("Cost of gauss against lagrange", own, rival, environment={"baseline_engine": "lagrange"})
    assert "four_bar rk4 1.50 (1.40..1.60); slower in 1 of 1." in text
    wide = row(step_ratio=1.5, step_ratio_low=0.9, step_ratio_high=1.6)
    text = said("Cost of gauss against lagrange", wide, rival, environment={"baseline_engine": "lagrange"})
    assert "slower in 0 of 1, not told apart in 1." in text
    base, other = row(step_ratio=1.0), row(engine="lagrange", step_ratio=0.5, step_ratio_low=0.4, step_ratio_high=0.8)
    text = said("Cost of gauss against lagrange", base, other, environment={"baseline_engine": "gauss"})
    assert "four_bar rk4 2.00 (1.25..2.50)" in text


def test_costs_are_compared_at_the_same_stabilisation() -> None:
    """With Baumgarte's terms `gauss` costs more than without; `lagrange` was timed without."""
    plain = {"step_ratio": 1.0, "step_ratio_low": 1.0, "step_ratio_high": 1.0}
    rows = [row(stabilization="baumgarte", step_ratio=1.3), row(**plain)]
    rival = row(engine="lagrange", step_ratio=0.5, step_ratio_low=0.4, step_ratio_high=0.8)
    text = said("Cost of gauss against lagrange", *rows, rival, environment={"baseline_engine": "gauss"})
    assert "four_bar rk4 2.00 (1.25..2.50)" in text


def test_the_judges_words_are_told_without_their_numbers() -> None:
    flags = ("a link ends up 0.037 m from where it should be", "a link ends up turned by 3.1 rad from where it should be")
    flags += ("energy off by 1.2e+03 J where 24 J move", "the loops open by 0.031 (m or rad)")
    text = said("Ran, but not valid", *(row(engine="exudyn", valid=False, status="invalid", flag=x) for x in flags))
    words = ("a link ends up away from where it should be", "a link ends up turned from where it should be", "energy off")
    assert all(x in text for x in (*words, "the loops open)"))
    assert not any(x in text for x in ("0.037", "3.1", " J", "0.031"))


def kernel_step(settings: str, ratio: float, **columns: Any) -> dict[str, Any]:
    found = {"mechanism": "six_bar", "formulation": "gauss", "stabilization": "none", "settings": settings, "status": "ok"}
    return found | {"ratio": ratio} | columns


def kernels(title: str, **tables: Any) -> str:
    return said(title, **{f"kernel_{name}": tuple(rows) for name, rows in tables.items()})


def test_a_compiled_step_is_held_against_the_faster_of_mujocos_settings() -> None:
    """100 times faster than the slower setting, 60 times than the faster: 60 is what counts."""
    for order in (1, -1):
        rows = [kernel_step("default", 100.0), kernel_step("tuned", 60.0)][::order]
        text = kernels("A step in its own loop", steps=rows)
        assert "six_bar 60.0" in text
        assert "100" not in text


def claimed(mechanism: str, unknowns: int, verdicts: tuple[str, str, str], *ratios: float) -> dict[str, Any]:
    found: dict[str, Any] = {"mechanism": mechanism, "unknowns_gauss": unknowns, "processes": 5.0, "status": "ok", "message": ""}
    for way, verdict, x in zip(("", "projected_", "batch_"), verdicts, ratios, strict=True):
        found |= {f"{way}ratio": x, f"{way}ratio_low": 0.98 * x, f"{way}ratio_high": 1.02 * x, f"{way}verdict": verdict}
    return found


def test_one_sentence_tells_the_papers_claim_for_every_linkage_and_way() -> None:
    rows = [
        claimed("four_bar", 1, ("holds", "holds", "holds"), 1.5, 1.2, 2.0),
        claimed("eight_bar", 1, ("holds", "open", "reversed"), 1.3, 1.01, 0.9),
        claimed("pendulums_2", 2, ("reversed", "reversed", "reversed"), 0.9, 0.8, 0.7),
        claimed("pendulums_16", 16, ("reversed", "reversed", "reversed"), 0.4, 0.5, 0.3),
        {"mechanism": "sleigh", "unknowns_gauss": 3, "status": "skip", "message": "no kernel"},
    ]
    text = said("The paper's claim", kernel_claim=tuple(rows))
    assert text.startswith("In part. Compiled by the same eliminator, n - m unknowns against n + m, as the median of 5 processes: ")
    first, second = text.split(": ", 1)[1].split("; with 2 to 16")
    assert first.startswith("with 1 free coordinate a step is faster on 2 of 2 linkages (ratio 1.30 to 1.50)")
    assert "a step with projection is faster on 1 of 2 linkages (ratio 1.01 to 1.20; no difference on eight_bar)" in first
    assert "a step in a batch is faster on 1 of 2 linkages (ratio 0.900 to 2.00; slower on eight_bar)" in first
    assert "a step is faster on 0 of 2 linkages (ratio 0.400 to 0.900; slower on pendulums_2 and pendulums_16)" in second
    assert text.endswith("Left out: sleigh (no kernel).")


@pytest.mark.parametrize(
    ("title", "table", "told"),
    [
        ("A step in its own loop", "steps", {"formulation": "gauss", "stabilization": "none", "settings": "tuned", "ratio": 5.0}),
        ("Many trajectories", "batch", {"ratio": 5.0, "lanes_error": 0.0, "states": 9.0}),
        ("What is left to be gained", "bounds", {"quantity": "a batch", "share": 0.5}),
        ("The same accelerations", "agreement", {"error": 1e-15, "formulation": "gauss", "place": "random", "met": True}),
        ("Long runs", "long", {"position_drift": 1e-16, "velocity_drift": 1e-16, "t_end": 100.0}),
        ("The paper's claim", "claim", claimed("four_bar", 1, ("holds", "holds", "holds"), 1.5, 1.2, 2.0)),
    ],
)
def test_what_a_headline_leaves_out_stands_beside_it(title: str, table: str, told: dict[str, Any]) -> None:
    whole = told | {"mechanism": "four_bar", "status": "ok", "message": ""}
    lost = {k: x for k, x in whole.items() if isinstance(x, str)}
    lost |= {"mechanism": "shaper", "status": "skip", "message": "no compiler"}
    text = kernels(title, **{table: [whole, lost]})
    assert text.endswith("Left out: shaper (no compiler).")
    assert "Left out" not in kernels(title, **{table: [whole]})


def test_a_share_of_the_machines_limit_is_in_per_cent() -> None:
    rows = [{"mechanism": x, "quantity": "a batch", "share": y, "status": "ok"} for x, y in (("four_bar", 0.42), ("six_bar", 0.5))]
    assert "42 to 50 % for a batch" in kernels("What is left to be gained", bounds=rows)


def test_kinematics_are_told_in_millions_a_second() -> None:
    errors = {f"{x}_error": y for x, y in (("position", 1e-16), ("velocity", 2e-15), ("acceleration", 3e-14))}
    found = [{"mechanism": "four_bar", "rate": 7.9e6, "target": 7.4e6, "met": True, "status": "ok"} | errors]
    text = kernels("Kinematics", kinematics=found)
    assert "7.9 million on four_bar" in text
    assert "3.0e-14 at most" in text


def test_one_right_hand_side_is_told_where_it_loses() -> None:
    def asked(own: str, rival: str, ratio: float) -> dict[str, Any]:
        return {"mechanism": "four_bar", "own": own, "rival": rival, "ratio": ratio, "status": "ok"}

    rows = [asked("in its own loop", "less the call", 25.0), asked("in its own loop", "as called", 30.0)]
    rows += [asked("called from Python", "as called", 0.8), asked("called from Python", "less the call", 0.7)]
    text = kernels("One right-hand side", rhs=rows)
    assert "takes 25.0 times as long" in text
    assert "it takes 0.800 times as long: there the kernel is slower on four_bar" in text
