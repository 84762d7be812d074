"""Test that a diagnosis names planted faults and no fault of a sound engine."""

from dataclasses import replace
from functools import partial
from types import SimpleNamespace

import numpy as np
import pytest

import gauss_bench
from gauss_bench.diagnosis import faults, samples
from gauss_bench.diagnosis.causes import Cause, Part
from gauss_bench.diagnosis.checks import CRANK_SLIDER, DRIVEN, FOUR_BAR, alter, truth
from gauss_bench.diagnosis.diagnosis import SMALL, Case, diagnose_runs
from gauss_bench.diagnosis.explanations import Explanation, candidates, explain, tell
from gauss_bench.diagnosis.faults import CLEAN, ENGINES, Fault, Faulty
from gauss_bench.diagnosis.motion import OwnMotion, TrueMotion
from gauss_bench.diagnosis.observations import Burst, checkpoints, ladder
from gauss_bench.diagnosis.selftest import diagnose_fault
from gauss_bench.diagnosis.split import Closure, by_steps, closure_of, horizon_of, size, usable
from gauss_bench.engines.base import Choice
from gauss_bench.linkage.load import load
from gauss_bench.mechanism.model import JointDamping, RotationalSpringDamper, Torque
from gauss_bench.runs.one_run import Run, one_run, sampling
from gauss_bench.trajectory import States, Status
from tests.conftest import exhaustive, needs

QUICK = ("inertia", "soft_loop", "stale", "late", "wrapped", "backwards")  # the test of the whole self-test plants all faults
SIX_BAR = ("six_bar", "torque")


def verdict(fault, where, step=2e-3, until=0.4, **choice):
    mechanism = load(*where)
    chosen = ladder(Choice(step=step, **{"integrator": "rk4", **choice}), adaptive=False)
    return diagnose_runs(partial(one_run, Faulty(fault), mechanism), mechanism, truth(where, until), chosen, until)


@pytest.mark.slow("soft_loop")
@pytest.mark.parametrize("name", QUICK)
def test_a_planted_fault_is_named(name):
    (fault,) = (x for x in ENGINES if x.name == name)
    found = diagnose_fault(fault)
    assert found.cause is fault.cause, found.verdict
    assert max(found.parts, key=lambda part: found.parts[part]) is fault.cause.part, found.parts
    if name == "inertia":
        best = found.explanations[0]
        assert (best.what, best.amount) == ("inertia of crank", pytest.approx(0.01, rel=1e-3))
        assert "inertia of crank is 1 % too large" in found.verdict


@pytest.mark.slow
def test_a_sound_engine_has_no_dominant_cause_and_the_little_error_it_has_falls_as_its_integrator_says():
    found = verdict(CLEAN, FOUR_BAR)
    assert found.cause is Cause.NONE
    assert found.numbers.error < SMALL
    assert found.numbers.order == pytest.approx(4.0, abs=0.1)
    assert found.numbers.step_exponent == pytest.approx(5.0, abs=0.3)
    assert found.parts[Part.MODEL] == found.parts[Part.SOFTNESS] == found.parts[Part.SAMPLING] == 0.0


def jacobian_of_the_step_before(terms, model, t, q, v):
    return replace(terms, J=model.recent[0][0]) if model.running else terms


def shifted(by, times, step):
    return np.where(times > 0, times + by, times)


def of(name, cause, **what):
    return Fault(name, name, cause, **what)


VARIATIONS = [  # none of them is one of the catalogue's
    (of("inertia of rocker", Cause.INERTIA, linkage=partial(alter, of="rocker", inertia=1.01)), FOUR_BAR, {}),
    (of("mass of slider", Cause.MASS, linkage=partial(alter, of="slider", mass=0.99)), CRANK_SLIDER, {}),
    (of("Jacobian alone", Cause.STALE, terms=jacobian_of_the_step_before), CRANK_SLIDER, {}),
    (of("stale under Euler", Cause.STALE, terms=faults.stale), FOUR_BAR, {"integrator": "semi_implicit_euler"}),
    (of("half a millisecond", Cause.SHIFT, times=partial(shifted, 5e-4)), FOUR_BAR, {}),
    (of("second rate, projected", Cause.SECOND_RATE, terms=faults.without_second_rate), DRIVEN, {"stabilization": "projection"}),
    (of("inertia in a larger linkage", Cause.INERTIA, linkage=partial(alter, of="coupler", inertia=1.01)), SIX_BAR, {}),
    (of("gravity in a larger linkage", Cause.GRAVITY, linkage=partial(alter, gravity=-1.0)), SIX_BAR, {}),
]


@pytest.mark.long("projection")
@pytest.mark.slow("none")
@pytest.mark.parametrize("stabilization", ["none", "projection"])
def test_a_wrong_length_is_told_from_soft_constraints(stabilization):
    """The coupler is a millimetre too long, so that the loop is open by the file's dimensions, whatever the step and the force."""
    longer_one = of("length of coupler", Cause.LENGTH, linkage=partial(alter, joint="B", by=1e-3))
    found = verdict(longer_one, FOUR_BAR, stabilization=stabilization)
    assert found.cause is Cause.LENGTH, found.verdict
    assert found.cause.part is Part.MODEL
    assert max(found.parts, key=lambda part: found.parts[part]) is Part.MODEL
    assert "of coupler is elsewhere than the file says, by [1.00e-03" in found.verdict


@pytest.mark.slow
def test_a_fault_smaller_than_the_integrators_error_is_told_beside_it():
    """The error of Euler's method at 2 ms is far larger than that of 1 % of the crank's inertia."""
    heavy = of("inertia", Cause.INERTIA, linkage=partial(alter, of="crank", inertia=1.01))
    found = verdict(heavy, FOUR_BAR, integrator="semi_implicit_euler")
    assert found.cause is Cause.INTEGRATOR, found.verdict
    assert "besides, the inertia of crank is 1 % too large" in found.verdict
    assert [x.what for x in found.candidates] == ["inertia of crank"]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("fault", "where", "choice"), exhaustive(VARIATIONS, VARIATIONS[1], VARIATIONS[5]), ids=lambda x: getattr(x, "name", None)
)
def test_a_variation_of_a_fault_is_named_too(fault, where, choice):
    found = verdict(fault, where, **{"step": 4e-3, **choice})
    assert found.cause is fault.cause, found.verdict


def of_all_links(key, factor, mechanism):
    return replace(mechanism, links=tuple(replace(x, **{key: factor * getattr(x, key)}) for x in mechanism.links))


def with_angular_forces_reversed(mechanism):
    angular = (Torque, RotationalSpringDamper, JointDamping)
    keys = ("value", "k", "c")
    forces = [
        replace(x, **{key: -getattr(x, key) for key in keys if hasattr(x, key)}) if isinstance(x, angular) else x
        for x in mechanism.forces
    ]
    return replace(mechanism, forces=tuple(forces))


def with_bias(factor, terms, *_):
    return replace(terms, gamma=factor * terms.gamma)


def with_entry(row, column, factor, terms, *_):
    J = terms.J.copy()
    J[row, column] *= factor
    return replace(terms, J=J)


NAMED = [
    (of("all inertias", Cause.INERTIA, linkage=partial(of_all_links, "inertia", 1.01)), "all inertias are 1 % too large"),
    (of("all masses", Cause.MASS, linkage=partial(of_all_links, "mass", 1.01)), "all masses are 1 % too large"),
    (of("gravity", Cause.GRAVITY, linkage=partial(alter, gravity=9.80665 / 9.81)), "gravity is 0.0341 % too small"),
    (
        of("bias", Cause.VELOCITY_TERMS, terms=partial(with_bias, 1.01)),
        "the velocity terms of the constraints (J' v) are 1 % too large",
    ),
    (
        of("entry", Cause.JACOBIAN, terms=partial(with_entry, 7, 8, 1.001)),
        "entry (D, second row; theta of rocker) is 0.1 % too large",
    ),
    (of("reversed", Cause.FORCE, linkage=with_angular_forces_reversed), "all angular forces have the wrong sign"),
]


@pytest.mark.parametrize(("fault", "said"), NAMED, ids=lambda x: getattr(x, "name", ""))
def test_every_cause_that_reproduces_the_accelerations_is_named_and_no_other(fault, said):
    """The last fault makes the motion diverge, and is found in a shorter run."""
    found = verdict(fault, FOUR_BAR, step=4e-3)
    assert found.cause is fault.cause, found.verdict
    assert any(said in x.sentence for x in found.candidates), found.verdict
    assert all(x.residual <= 1e-8 for x in found.candidates)
    assert len(found.candidates) == (3 if fault.name == "reversed" else 1)


# known answers


def test_the_linkages_own_flow_is_that_of_the_certificate_forwards_and_backwards():
    own, true, k = OwnMotion(load(*FOUR_BAR)), truth(FOUR_BAR, 0.3), np.array([3, 10, 20])
    for by in (1, -1):
        found = own.flow(States(true.t[k], true.q[k], true.v[k]), by * np.full(3, 0.01))
        np.testing.assert_allclose(found.q, true.q[k + by], atol=1e-11)
        np.testing.assert_allclose(found.v, true.v[k + by], atol=1e-10)
    between = TrueMotion(own, true).at(np.array([0.1234]))
    again = own.flow(between, np.array([0.13 - 0.1234]))
    np.testing.assert_allclose(again.q[0], true.q[13], atol=1e-11)


def test_a_map_of_time_is_found_and_an_engine_in_time_has_none():
    true, t = TrueMotion(OwnMotion(load(*FOUR_BAR)), truth(FOUR_BAR, 0.5)), np.arange(1, 20) * 0.02
    for shift, rate in ((3e-3, 1.0), (0.0, 1.02)):
        x = true.at(shift + rate * t)
        found = samples.fit_time_map(true, States(t, x.q, x.v), stretch=rate != 1.0)
        assert (found.shift, found.rate) == pytest.approx((shift, rate), rel=1e-6, abs=1e-8)
    x = true.at(t)
    assert samples.fit_time_map(true, States(t, x.q + 1e-3 * t[:, None], x.v), stretch=False) is None


def test_checkpoints_are_reached_by_whole_steps_with_one_more_after_them():
    for step, until in ((1e-3, 1.0), (3e-3, 0.5), (1e-2, 0.1), (0.02, 0.1)):
        t = checkpoints(step, until)
        assert len(t) >= 1
        np.testing.assert_allclose(np.round(t / step), t / step, rtol=1e-9)
        assert step * (1 - 1e-9) <= t[0] <= t[-1] <= until * (1 + 1e-9) - step


def test_an_engine_that_does_not_run_has_its_reason():
    crashed, chosen = Run(Status.CRASHED, "it died", None, None, sampling(1e-3, 0.3)), ladder(Choice(step=1e-3), adaptive=False)
    found = diagnose_runs(lambda c, wanted: crashed, load(*FOUR_BAR), truth(FOUR_BAR, 0.3), chosen, 0.3)
    assert (found.cause, len(found.runs)) == (Cause.UNKNOWN, 1)
    assert "crashed: it died" in found.verdict


@pytest.mark.long("mujoco-rigid-causes1", "pinocchio-default-causes2")
@pytest.mark.slow
@pytest.mark.parametrize(
    ("engine", "settings", "causes"),
    [
        ("mujoco", "default", {Cause.SOFTNESS}),
        ("mujoco", "rigid", {Cause.NONE}),
        ("pinocchio", "default", {Cause.NONE}),
        ("exudyn", "default", {Cause.INTEGRATOR}),
    ],
)
def test_engines_as_they_are(engine, settings, causes):
    """MuJoCo as shipped is soft, Exudyn has steps of order two, and the others have no dominant cause at a millisecond."""
    needs(engine)
    found = gauss_bench.diagnose("crank_slider", engine, settings=settings, until=0.5)
    assert found.cause in causes, found.verdict
    assert set(found.parts) == set(Part)


# limits, with artificial samples on both sides of each

K, N = 9, 3  # samples and coordinates
NONE = np.zeros((K, N))


def burst(q, step=1e-3):
    x = States(np.arange(float(K)), q, NONE)
    return Burst(step, None, x[:1], x[1:2], x, x, x, NONE)


def test_errors_are_looked_at_until_one_leaves_a_tenth_but_for_five_samples_at_least():
    one = NONE.copy()
    one[6, 1] = -0.1
    assert horizon_of([NONE, one]) == 9
    one[6, 1] = -0.1001
    assert horizon_of([NONE, one]) == 6
    one[2, 0] = np.nan
    assert horizon_of([NONE, one]) == 5
    assert horizon_of([one[:3]]) == 3


@pytest.mark.parametrize(("order", "converges"), [(0.39, False), (0.41, True), (4.0, True), (-1.0, False)])
def test_runs_converge_whose_order_is_beyond_two_fifths(order, converges):
    """Errors are x = 1e-3 + c h^p: without an order the last run is the limit, and with an order the limit is 1e-3."""
    runs = tuple(burst(NONE + 1e-3 + 1e-4 * h**order, h) for h in (1.0, 0.5, 0.25))
    found = by_steps(runs, States(runs[0].at.t, NONE, NONE), adaptive=False)
    assert found.order == pytest.approx(order)
    assert found.converges is converges
    assert found.limit.max() == pytest.approx(1e-3 if converges else 1e-3 + 1e-4 * 0.25**order, rel=1e-9)
    assert not by_steps(runs[:2], States(runs[0].at.t, NONE, NONE), adaptive=False).converges
    assert not by_steps(runs, States(runs[0].at.t, NONE, NONE), adaptive=True).converges


def test_runs_that_no_step_changes_have_no_order_and_those_that_one_step_mends_any():
    true = States(np.arange(float(K)), NONE, NONE)
    assert np.isnan(by_steps((burst(NONE),) * 3, true, adaptive=False).order)
    assert by_steps((burst(NONE + 1e-3), burst(NONE), burst(NONE)), true, adaptive=False).order == np.inf
    assert size(np.array([[3.0, -4.0], [0.0, 0.0]])) == pytest.approx(4 / np.sqrt(2))  # mean square of the largest entries
    assert size(np.zeros((0, 3))) == 0.0


class Open:
    """A linkage whose gaps are equal to the positions of a run."""

    mechanism = SimpleNamespace(held_names=("A", "A"), drivers=[SimpleNamespace(name="crank")])

    def gaps(self, x):
        return x.q

    def project(self, x):
        return States(x.t, 0 * x.q, x.v)

    def parts(self, x):
        return SimpleNamespace(multipliers=lambda a: 100.0 * x.q)


def test_a_gap_stays_if_half_the_step_leaves_three_quarters_of_it():
    gap = np.zeros((K, N))
    gap[:, 1] = 1e-3
    for left, stays in ((0.74, False), (0.76, True)):
        found = closure_of(Open(), (burst(gap), burst(gap), burst(left * gap)), gap)
        assert found.closure_stays is stays
        assert found.closure == pytest.approx((1e-3, 1e-3, left * 1e-3))
        assert (found.closure_joint, found.closure_share) == ("A", pytest.approx(1.0))
        assert (found.held, found.compliance) == (pytest.approx(1.0), pytest.approx(0.01))
    assert not closure_of(Open(), (burst(gap),), gap).closure_stays
    driven = np.roll(gap, 1, axis=1)
    assert closure_of(Open(), (burst(driven),), driven).closure_joint == "crank"
    closed = Closure((1.0,), 1.0, 3.0, False, "", 0.0, 0.0, 0.0)
    assert not closed.grows
    assert replace(closed, closure_late=3.01).grows  # three times as wide at the end


@pytest.mark.parametrize(("order", "cause"), [(1.0, Cause.INTEGRATOR), (1.4, Cause.INTEGRATOR), (1.6, Cause.SOFTNESS)])
def test_gaps_that_follow_forces_cause_no_error_that_falls_more_slowly_with_the_step(order, cause):
    """A solver on velocities leaves gaps of second order in the step and errors of first order."""
    gaps = Closure((1.6e-4, 4e-5, 1e-5), 1.6e-4, 1.6e-4, False, "D", 0.1, 0.95, 1e-6)
    case = SimpleNamespace(closure=gaps, steps=SimpleNamespace(order=order), adaptive=False, by_step=1e-2, whole=1e-2)
    case._find_stale_data, case._constraints_are_compliant, case._name_hidden_fault = (lambda: None), (lambda: False), (lambda: "")
    assert Case._explain_step_error(case).cause is cause
    assert not replace(gaps, closure=(1e-4,)).falls_faster(0.0)
    assert not replace(gaps, closure=(0.0, 0.0)).falls_faster(0.0)


def test_samples_are_usable_that_are_finite_and_not_opened_by_more_than_asked():
    q = NONE.copy()
    q[3, 0], q[4, 0] = -1e-3, 1.001e-3
    a = NONE.copy()
    a[5, 2] = np.inf
    assert np.flatnonzero(~usable(Open(), replace(burst(q), a=a), 1e-3)).tolist() == [4, 5]


X = np.linspace(1.0, 2.0, K * N).reshape(K, N)
MASS = np.ones(N)


def one_of(effect, once=False, exact=False, linear=True):
    return Explanation(Cause.FORCE, "f", effect if linear else lambda c: c * effect, "f {is}", once, exact)


def test_what_is_left_out_once_has_an_amount_near_one():
    for amount, found in ((0.84, 0), (0.86, 1), (1.14, 1), (1.16, 0)):
        assert len(explain(amount * X, MASS, iter([one_of(X, once=True)]))) == found
        assert len(explain(amount * X, MASS, iter([one_of(X)]))) == 1


@pytest.mark.parametrize("linear", [True, False])
def test_an_amount_is_that_of_least_squares_in_the_metric_of_the_masses(linear):
    y = 0.3 * X + np.array([0.0, 0.0, 1.0])  # the last coordinate weighs nothing
    (found,) = explain(y, np.array([1.0, 4.0, 0.0]), iter([one_of(X, linear=linear)]))
    assert (found.amount, found.share, found.residual) == pytest.approx((0.3, 1.0, 0.0), abs=1e-12)


def test_an_explanation_reproduces_what_it_leaves_no_more_of_than_noise():
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


def test_the_best_explanation_stands_first_and_what_changes_nothing_nowhere():
    half = X.copy()
    half[:, 0] = 0.0
    worse = Explanation(Cause.MASS, "half", half, "half {is}")
    found = explain(2 * X, MASS, iter([one_of(0 * X), worse, one_of(X)]))
    assert [x.what for x in found] == ["f", "half"]
    assert explain(0 * X, MASS, iter([one_of(X)])) == []


def test_amounts_in_words():
    for amount, one, many in (
        (-1.0, "f is left out", "f are left out"),
        (-1.014, "f is left out", "f are left out"),
        (-1.016, "f is 102 % too small", "f are 102 % too small"),
        (-2.014, "f has the wrong sign", "f have the wrong sign"),
        (-1.984, "f is 198 % too small", "f are 198 % too small"),
        (0.01, "f is 1 % too large", "f are 1 % too large"),
    ):
        assert (tell("f {is}", amount), tell("f {are}", amount)) == (one, many)
