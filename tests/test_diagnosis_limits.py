"""Test the limits of a diagnosis with artificial samples on both sides of each."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from gauss_bench.diagnosis.causes import Cause
from gauss_bench.diagnosis.diagnosis import Case
from gauss_bench.diagnosis.explanations import Explanation, candidates, explain, tell
from gauss_bench.diagnosis.observations import Burst
from gauss_bench.diagnosis.split import Closure, by_steps, closure_of, horizon_of, size, usable
from gauss_bench.terms import Array
from gauss_bench.trajectory import States

K, N = 9, 3  # samples and coordinates
NONE = np.zeros((K, N))


def burst(q: Array, step: float = 1e-3) -> Burst:
    x = States(np.arange(float(K)), q, NONE)
    return Burst(step, None, x[:1], x[1:2], x, x, x, NONE)


def test_errors_are_looked_at_until_one_leaves_a_tenth_but_for_five_samples_at_least() -> None:
    one = NONE.copy()
    one[6, 1] = -0.1
    assert horizon_of([NONE, one]) == 9
    one[6, 1] = -0.1001
    assert horizon_of([NONE, one]) == 6
    one[2, 0] = np.nan
    assert horizon_of([NONE, one]) == 5
    assert horizon_of([one[:3]]) == 3


@pytest.mark.parametrize(("order", "converges"), [(0.39, False), (0.41, True), (4.0, True), (-1.0, False)])
def test_runs_converge_whose_order_is_beyond_two_fifths(order: float, converges: bool) -> None:
    """Errors are x = 1e-3 + c h^p: without an order the last run is the limit, and with an order the limit is 1e-3."""
    runs = tuple(burst(NONE + 1e-3 + 1e-4 * h**order, h) for h in (1.0, 0.5, 0.25))
    found = by_steps(runs, States(runs[0].at.t, NONE, NONE), adaptive=False)
    assert found.order == pytest.approx(order)
    assert found.converges is converges
    assert found.limit.max() == pytest.approx(1e-3 if converges else 1e-3 + 1e-4 * 0.25**order, rel=1e-9)
    assert not by_steps(runs[:2], States(runs[0].at.t, NONE, NONE), adaptive=False).converges
    assert not by_steps(runs, States(runs[0].at.t, NONE, NONE), adaptive=True).converges


def test_runs_that_no_step_changes_have_no_order_and_those_that_one_step_mends_any() -> None:
    true = States(np.arange(float(K)), NONE, NONE)
    assert np.isnan(by_steps((burst(NONE),) * 3, true, adaptive=False).order)
    assert by_steps((burst(NONE + 1e-3), burst(NONE), burst(NONE)), true, adaptive=False).order == np.inf
    assert size(np.array([[3.0, -4.0], [0.0, 0.0]])) == pytest.approx(4 / np.sqrt(2))  # mean square of the largest entries
    assert size(np.zeros((0, 3))) == 0.0


class Open:
    """A linkage whose gaps are equal to the positions of a run."""

    mechanism = SimpleNamespace(
        joints=[SimpleNamespace(name="A", held=(0, 0))], couplings=[], drivers=[SimpleNamespace(name="crank")]
    )

    def gaps(self, x: States) -> Array:
        return x.q

    def project(self, x: States) -> States:
        return States(x.t, 0 * x.q, x.v)

    def parts(self, x: States) -> Any:
        return SimpleNamespace(multipliers=lambda a: 100.0 * x.q)


def test_a_gap_stays_if_half_the_step_leaves_three_quarters_of_it() -> None:
    gap = np.zeros((K, N))
    gap[:, 1] = 1e-3
    for left, stays in ((0.74, False), (0.76, True)):
        found = closure_of(Open(), (burst(gap), burst(gap), burst(left * gap)), gap)  # type: ignore[arg-type]
        assert found.closure_stays is stays
        assert found.closure == pytest.approx((1e-3, 1e-3, left * 1e-3))
        assert (found.closure_joint, found.closure_share) == ("A", pytest.approx(1.0))
        assert (found.held, found.compliance) == (pytest.approx(1.0), pytest.approx(0.01))
    assert not closure_of(Open(), (burst(gap),), gap).closure_stays  # type: ignore[arg-type]
    driven = np.roll(gap, 1, axis=1)
    assert closure_of(Open(), (burst(driven),), driven).closure_joint == "crank"  # type: ignore[arg-type]
    closed = Closure((1.0,), 1.0, 3.0, False, "", 0.0, 0.0, 0.0)
    assert not closed.grows
    assert replace(closed, closure_late=3.01).grows  # three times as wide at the end


@pytest.mark.parametrize(("order", "cause"), [(1.0, Cause.INTEGRATOR), (1.4, Cause.INTEGRATOR), (1.6, Cause.SOFTNESS)])
def test_gaps_that_follow_forces_cause_no_error_that_falls_more_slowly_with_the_step(order: float, cause: Cause) -> None:
    """A solver on velocities leaves gaps of second order in the step and errors of first order."""
    gaps = Closure((1.6e-4, 4e-5, 1e-5), 1.6e-4, 1.6e-4, False, "D", 0.1, 0.95, 1e-6)
    case = SimpleNamespace(closure=gaps, steps=SimpleNamespace(order=order), adaptive=False, by_step=1e-2, whole=1e-2)
    case._find_stale_data, case._constraints_are_compliant, case._name_hidden_fault = (lambda: None), (lambda: False), (lambda: "")
    assert Case._explain_step_error(case).cause is cause  # type: ignore[arg-type]
    assert not replace(gaps, closure=(1e-4,)).falls_faster(0.0)
    assert not replace(gaps, closure=(0.0, 0.0)).falls_faster(0.0)


def test_samples_are_usable_that_are_finite_and_not_opened_by_more_than_asked() -> None:
    q = NONE.copy()
    q[3, 0], q[4, 0] = -1e-3, 1.001e-3
    a = NONE.copy()
    a[5, 2] = np.inf
    assert np.flatnonzero(~usable(Open(), replace(burst(q), a=a), 1e-3)).tolist() == [4, 5]  # type: ignore[arg-type]


X = np.linspace(1.0, 2.0, K * N).reshape(K, N)
MASS = np.ones(N)


def one_of(effect: Array, once: bool = False, exact: bool = False, linear: bool = True) -> Explanation:
    return Explanation(Cause.FORCE, "f", effect if linear else lambda c: c * effect, "f {is}", once, exact)


def test_what_is_left_out_once_has_an_amount_near_one() -> None:
    for amount, found in ((0.84, 0), (0.86, 1), (1.14, 1), (1.16, 0)):
        assert len(explain(amount * X, MASS, iter([one_of(X, once=True)]))) == found
        assert len(explain(amount * X, MASS, iter([one_of(X)]))) == 1


@pytest.mark.parametrize("linear", [True, False])
def test_an_amount_is_that_of_least_squares_in_the_metric_of_the_masses(linear: bool) -> None:
    mass = np.array([1.0, 4.0, 0.0])
    y = 0.3 * X + np.array([0.0, 0.0, 1.0])  # the last coordinate weighs nothing
    (found,) = explain(y, mass, iter([one_of(X, linear=linear)]))
    assert found.amount == pytest.approx(0.3)
    assert found.share == pytest.approx(1.0)
    assert found.residual == pytest.approx(0.0, abs=1e-12)


def test_an_explanation_reproduces_what_it_leaves_no_more_of_than_noise() -> None:
    """The residual is orthogonal to the effect, and a hundredth of the accelerations."""
    effect, left = np.zeros((K, N)), np.zeros((K, N))
    effect[0, 0], left[1, 0] = 1.0, 0.01
    a = np.zeros((K, N))
    a[2, 0] = 1.0
    for noise, known in ((0.0099, 0), (0.0101, 1)):
        found = explain(effect + left, MASS, iter([one_of(effect)]), a, noise)
        assert found[0].residual == pytest.approx(0.01)
        assert len(candidates(found, noise)) == known
        assert len(explain(effect + left, MASS, iter([one_of(effect, exact=True)]), a, noise)) == known


def test_the_best_explanation_stands_first_and_what_changes_nothing_nowhere() -> None:
    half = X.copy()
    half[:, 0] = 0.0
    worse = Explanation(Cause.MASS, "half", half, "half {is}")
    found = explain(2 * X, MASS, iter([one_of(0 * X), worse, one_of(X)]))
    assert [x.what for x in found] == ["f", "half"]
    assert explain(0 * X, MASS, iter([one_of(X)])) == []


def test_amounts_in_words() -> None:
    for amount, one, many in (
        (-1.0, "f is left out", "f are left out"),
        (-1.014, "f is left out", "f are left out"),
        (-1.016, "f is 102 % too small", "f are 102 % too small"),
        (-2.014, "f has the wrong sign", "f have the wrong sign"),
        (-1.984, "f is 198 % too small", "f are 198 % too small"),
        (0.01, "f is 1 % too large", "f are 1 % too large"),
    ):
        assert (tell("f {is}", amount), tell("f {are}", amount)) == (one, many)
