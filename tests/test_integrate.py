"""Integrators show their order, stabilisation cures drift, and energy is kept where nothing dissipates."""

import numpy as np
import pytest

from gauss_bench import metrics
from gauss_bench.integrate import StepFailure
from gauss_bench.integrate.adaptive import dop853
from gauss_bench.integrate.fixed_step import STEPS, step_counts
from gauss_bench.linkage.load import load
from gauss_bench.mechanism.evaluate import Evaluator
from gauss_bench.trajectory import RunFailure, Status
from tests.engine_runs import by_gauss

ORDERS = {"rk4": 4.0, "semi_implicit_euler": 1.0, "dop853_fixed": 8.0, "gauss_legendre": 6.0}
FEW = {"dop853_fixed": (1 / 5, 1 / 8, 1 / 16), "gauss_legendre": (1 / 5, 1 / 10, 1 / 20)}  # [s]: below, only rounding is left
MARGINS = {"dop853_fixed": 0.7}  # those are large: the term of order 9 is as large as that of order 8


def pendulum(t, q, v):
    return -np.sin(q) * 9.81


def end(integrator, h):
    q, v = np.array([1.0]), np.array([0.5])
    for k in range(round(1.0 / h)):
        q, v = STEPS[integrator](pendulum, k * h, q, v, h)
    return float(q[0])


@pytest.mark.parametrize("integrator", STEPS)
def test_each_integrator_converges_at_its_order(integrator):
    (q, v), times = np.array([[[1.0], [np.nan]], [[0.5], [np.nan]]]), np.array([0.0, 1.0])
    dop853(pendulum, times, q, v, 1e-13, 1e-13)
    true = q[-1, 0]
    steps = np.array(FEW.get(integrator, (1 / 40, 1 / 80, 1 / 160)))
    errors = np.array([abs(end(integrator, h) - true) for h in steps])
    order = metrics.observed_order(steps, errors, np.full(3, 1e-14))
    assert np.isnan(order[0])
    # the next term of the error is still felt, at steps of a tenth of the period and more
    assert np.abs(order[1:] - ORDERS[integrator]).max() < MARGINS.get(integrator, 0.15)


def test_projection_keeps_the_loops_closed_to_rounding_and_baumgarte_pulls_them_back():
    mechanism, times, drift = load("six_bar"), 1e-2 * np.arange(101), {}
    for s in ("none", "baumgarte", "projection"):
        drift[s] = metrics.drift(Evaluator(mechanism), by_gauss(mechanism, times, integrator="rk4", stabilization=s, step=1e-2))
    assert drift["projection"].position.max() < 1e-14
    assert drift["projection"].velocity.max() < 1e-13
    assert drift["none"].position.max() > 1e-6  # large first, ...
    assert drift["baumgarte"].position[-1] < 0.2 * drift["none"].position[-1]  # ... small after stabilisation


def test_steps_divide_the_gaps_between_samples_and_are_never_too_long():
    times = np.array([0.0, 0.01, 0.0137, 0.02])
    for gap, (count, h) in zip(np.diff(times), step_counts(times, 1e-3), strict=True):
        assert count * h == pytest.approx(gap, rel=1e-12)
        assert h <= 1e-3 * (1 + 1e-9)
    assert step_counts(np.array([0.0, 1.0]), 1e-3)[0][0] == 1000


@pytest.mark.long
def test_redundant_rows_that_drift_apart_are_named_and_not_followed_into_a_lock():
    mechanism, times = load("parallelogram", "torque"), 1e-3 * np.arange(1001)
    with pytest.raises(RunFailure, match="redundant rows have drifted apart") as caught:
        by_gauss(mechanism, times, integrator="rk4")
    assert caught.value.status == Status.RANK_LOST
    cured = by_gauss(mechanism, times, integrator="rk4", stabilization="projection")
    assert cured.q[-1, 2] > 15.0  # it turns on: three cranks move as one
    assert np.abs(cured.q[:, 2] - cured.q[:, 5]).max() < 1e-12


def test_steps_that_shrink_for_ever_come_to_an_end(monkeypatch):
    """A frequency that grows beyond all bounds towards t = 1 s."""
    monkeypatch.setattr("gauss_bench.integrate.adaptive.MOST", 500)
    q, v = np.ones((2, 1)), np.zeros((2, 1))
    with pytest.raises(StepFailure, match="more than 500 steps before t = 0"):
        dop853(lambda t, q, v: -q / (1 - t) ** 6, np.array([0.0, 1.0]), q, v, 1e-9, 1e-11)
