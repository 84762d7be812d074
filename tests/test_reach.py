"""The one answer for a linkage, an engine and a requirement: each of its kinds from trials whose answer is known."""

import math

import pytest

from gauss_bench.engines import not_installed
from gauss_bench.engines.base import Choice
from gauss_bench.engines.c_code import NO_COMPILER
from gauss_bench.engines.pinocchio.symbolic import PinocchioCasadi
from gauss_bench.linkage.load import load
from gauss_bench.reach import Kind, Reach, Requirement, Trial, convergence, reach, trial_of
from gauss_bench.trajectory import Status

MICRON, NEWTON = Requirement("position", 1e-6), Requirement("force", 1e-3)


def ladder(factor, order, *steps, force=0.0):
    """Trials of a method whose error is factor / steps^order [m]."""
    return [Trial(1 / n, {"position": factor / n**order, "force": force}, n) for n in steps]


SECOND = ladder(100.0, 2.0, 1250, 2500, 5000, 10_000)  # 1e-6 m, exactly, at 10,000 steps


def test_what_holds_was_timed_or_was_not():
    assert reach([SECOND], [MICRON]) == Reach(Kind.TIMED)
    untimed = reach([SECOND], [MICRON], "crashed: SIGSEGV")
    assert (untimed.kind, untimed.words) == (Kind.UNTIMED, "holds, not timed: crashed: SIGSEGV")


def test_what_was_not_reached_tells_its_steps_its_order_and_where_it_would_hold():
    found = reach([SECOND[:-1]], [MICRON])
    assert (found.kind, found.steps) == (Kind.NOT_REACHED, 5000)
    assert (found.order, found.needed) == pytest.approx((2.0, 10_000.0))
    assert found.words == "not reached in 5,000 steps; order 2.0 extrapolates to 10,000"


def test_of_several_variants_the_one_that_needs_the_fewest_steps_tells_the_order():
    first, fourth = ladder(0.5, 1.0, 1000, 2000, 4000), ladder(1e6, 4.0, 250, 500, 750)  # 500,000 and 1,000 steps
    assert reach([first, fourth], [MICRON]).words == "not reached in 4,000 steps; order 4.0 extrapolates to 1,000"
    assert reach([first], [MICRON]).needed == pytest.approx(5e5)


def test_an_order_that_is_not_steady_extrapolates_to_nothing():
    floor = [Trial(1 / n, {"position": 1e-3}, n) for n in (1000, 2000, 4000)]
    bent = [Trial(1 / n, {"position": x}, n) for n, x in ((1000, 1e-2), (2000, 5e-3), (4000, 1e-3))]
    for some in (floor, bent, SECOND[:2]):
        assert math.isnan(convergence(some, [MICRON])[1])
        assert reach([some], [MICRON]).words == f"not reached in {some[-1].steps:,} steps"


def test_sizes_between_rungs_do_not_tell_the_order():
    noisy = [Trial(1 / 4900, {"position": 5e-6}, 4900)]  # beside 5000 steps: of rounding, not of the method
    assert convergence([*SECOND[:-1], *noisy], [MICRON])[0] == pytest.approx(2.0)


def test_a_failed_run_is_not_reached_with_its_reason():
    crashed = [Trial(0.1, {}, 10, Status.CRASHED, "SIGSEGV"), Trial(0.05, {}, 20, Status.CRASHED, "SIGSEGV")]
    assert reach([crashed], [MICRON]).words == "not reached in 20 steps: no run ended: SIGSEGV"
    timed_out = [Trial(math.nan, {}, 0, Status.TIMEOUT, "no answer within 600 s")]
    assert reach([timed_out], [MICRON]).words == "not reached: no run ended: no answer within 600 s"
    assert Reach(Kind.NOT_REACHED, "stopped", 10, 12.0).words == "not reached within 12 s: stopped"


def test_requirements_that_have_to_hold_together_do():
    exact, soft = ladder(100.0, 2.0, 20_000, force=1.0), ladder(1e6, 2.0, 20_000, force=1e-6)
    assert reach([exact], [MICRON]).kind is Kind.TIMED
    assert reach([soft], [NEWTON]).kind is Kind.TIMED
    assert reach([exact, soft], [MICRON, NEWTON]).kind is Kind.NOT_REACHED


def test_what_has_no_model_is_told_from_what_the_machine_has_not():
    def skipped(reason):
        return reach([[Trial(math.nan, {}, 0, Status.SKIP, reason)]], [MICRON])

    assert skipped("Exudyn has no planar knife edge").words == "cannot be modelled: Exudyn has no planar knife edge"
    symbolic = PinocchioCasadi().skip(load("four_bar"), Choice("default", "rk4", "none", 1e-3))
    for reason in (NO_COMPILER, not_installed(ImportError("no module", name="exudyn")), str(symbolic)):
        assert skipped(reason) == Reach(Kind.NOT_TRIED, reason)
    assert reach([], [MICRON]).words == "not tried: it was not searched"


def test_joint_forces_of_redundant_rows_are_nobodys_though_one_run_failed():
    gave_up = [Trial(1e-2, {}, 100, Status.NOT_CONVERGED, "gave up")]
    moves = [Trial(1e-3, {"position": 1e-9, "force": math.nan}, 1000)]
    assert reach([gave_up, moves], [NEWTON]).words == "not determined: redundant rows leave joint forces open"
    assert reach([gave_up], [NEWTON]).kind is Kind.NOT_REACHED


def test_a_stored_row_is_the_trial_that_it_was():
    row = {"step": 1e-3, "tolerance": math.nan, "steps": 1000.0, "position_error": 1e-7, "force_error": math.nan, "status": "ok"}
    trial = trial_of(row)
    assert (trial.size, trial.steps, trial.meets(MICRON), trial.message) == (1e-3, 1000, True, "")
    assert math.isnan(trial.errors["force"])
    assert trial_of({"status": "timeout", "message": "x"}).errors == {}
