"""CasADi: motions by its integrators, linkages that it refuses, and its functions for users."""

from dataclasses import replace

import numpy as np
import pytest

from gauss_bench.engines import get
from gauss_bench.engines.base import Choice
from gauss_bench.engines.casadi import functions
from gauss_bench.linkage.load import load
from gauss_bench.mechanism.evaluate import Evaluator
from gauss_bench.metrics import drift, state_errors
from gauss_bench.trajectory import RunFailure, Status
from tests.conftest import DATA, everything, exhaustive, redundant
from tests.engine_runs import certified, ran

ENGINE = get("casadi")
TIMES = np.arange(201) * 1e-3
TRIED = ("sleigh", "six_bar.cycloid")


def run(mechanism, integrator="idas", stabilization="none", settings="tight", times=TIMES):
    return ran(ENGINE, mechanism, times, settings=settings, integrator=integrator, stabilization=stabilization)


def position_error(mechanism, trajectory):
    return float(state_errors(mechanism, trajectory, certified(mechanism, float(trajectory.t[-1]))).position.max())


def position_drift(mechanism, trajectory):
    return float(drift(Evaluator(mechanism), trajectory).position.max())


# a knife edge, active bars, a driven crank, a law that ends, a stiff seven-body linkage, a body without any constraint
@pytest.mark.parametrize(
    "linkage",
    exhaustive(
        ["sleigh", "excavator", "crank_slider.driven", "six_bar.cycloid", "squeezer", "projectile"], "sleigh", "six_bar.cycloid"
    ),
)
@pytest.mark.parametrize("integrator", ENGINE.adaptive)
def test_every_form_follows_the_certified_motion(linkage, integrator):
    mechanism = load(*linkage.split("."))
    times = TIMES[: int(mechanism.duration / 1e-3 + 1.5)]
    coarse, fine = (position_error(mechanism, run(mechanism, integrator, "none", s, times)) for s in ("default", "tight"))
    assert fine < 1e-6  # up to some thousand steps, each within 1e-10
    assert fine < 1e-2 * coarse or fine < 1e-12


def test_index_1_drifts_the_stabilised_forms_less_and_projection_not_at_all():
    mechanism = load("four_bar", "torque")
    times = np.arange(501) * 2e-3
    found = {
        (i, s): position_drift(mechanism, run(mechanism, i, s, "default", times))
        for i, s in (("idas", "none"), ("idas_ggl", "none"), ("idas", "baumgarte"), ("idas", "projection"), ("cvodes_bdf", "none"))
    }
    assert found["idas", "none"] > 1e-6
    assert found["cvodes_bdf", "none"] > 1e-6
    assert found["idas_ggl", "none"] < 1e-6
    assert found["idas", "baumgarte"] < found["idas", "none"] / 10
    assert found["idas", "projection"] < 1e-13


@pytest.mark.parametrize("integrator", ["idas", "cvodes_bdf", "cvodes_adams"])
def test_projection_starts_the_method_again_and_its_steps_are_counted(integrator):
    mechanism = load("eight_bar", "torque")
    plain, projected = run(mechanism, integrator), run(mechanism, integrator, "projection")
    intervals = len(TIMES) - 1
    assert projected.steps > plain.steps + 5 * intervals  # a multistep method takes several small steps to begin
    assert projected.evaluations > projected.steps
    assert position_error(mechanism, projected) < 1e-6


def test_samples_are_where_they_were_asked_for_and_cost_no_steps():
    mechanism = load("four_bar", "torque")
    coarse, fine = run(mechanism, times=TIMES[::50]), run(mechanism, times=TIMES)
    assert coarse.steps == fine.steps
    np.testing.assert_allclose(fine.q[::50], coarse.q, rtol=0, atol=1e-12)
    uneven = np.array([0.0, 0.05, 0.051, 0.2])
    projected = run(mechanism, "cvodes_bdf", "projection", times=uneven)
    assert position_drift(mechanism, projected) < 1e-13
    assert position_error(mechanism, projected) < 1e-7
    still = run(mechanism, times=TIMES[:1])
    assert still.steps == 0
    np.testing.assert_array_equal(still.q[0], mechanism.q0)


def test_what_it_cannot_model_it_refuses_with_a_reason():
    for mechanism, word in ((load(DATA / "friction.toml"), "friction"), (redundant(), "redundant")):
        assert word in (ENGINE.skip(mechanism, Choice(integrator="idas")) or "")
        with pytest.raises(ValueError, match=word):
            functions(mechanism)
    assert "stabilised" in (ENGINE.skip(load("four_bar"), Choice(integrator="idas_ggl", stabilization="projection")) or "")


@pytest.mark.parametrize("integrator", ENGINE.adaptive)
def test_a_solver_that_gives_up_is_a_failure_with_a_sentence(integrator):
    sound = load("four_bar", "torque")
    falling = replace(sound, v0=1e9 * np.ones(sound.n))  # not a motion of this linkage: accelerations of 1e18
    with pytest.raises(RunFailure, match=r"gave up: .*|not finite") as caught:
        run(falling, integrator)
    assert caught.value.status in (Status.NOT_CONVERGED, Status.NAN)
    assert "Consult" not in str(caught.value)


@pytest.mark.parametrize("mechanism", [everything(), load("six_bar", "cycloid"), load("sleigh")], ids=lambda m: m.name)
def test_the_functions_are_the_equations_of_motion(mechanism, rng):
    own, given = Evaluator(mechanism), functions(mechanism)
    q, v = mechanism.q0, mechanism.v0 + rng.normal(size=mechanism.n)
    a, multipliers = (np.array(x)[:, 0] for x in given.acceleration(0.1, q, v))
    terms = own.terms(0.1, q, v)
    assert np.abs(terms.M @ a + terms.J.T @ multipliers - terms.Q).max() < 1e-9
    assert np.abs(terms.J @ a - terms.gamma).max() < 1e-9
    np.testing.assert_allclose(np.array(given.mass_matrix(q)), terms.M)
    np.testing.assert_allclose(np.array(given.forces(q, v))[:, 0], terms.Q, atol=1e-11)
    np.testing.assert_allclose(float(given.energy(q, v)), own.energy(q, v))
    phi, phi_dot = given.residual(0.1, q, v)
    np.testing.assert_allclose(np.array(phi)[:, 0], terms.phi[: own.constraints.holonomic], atol=1e-14)
    np.testing.assert_allclose(np.array(phi_dot)[:, 0], terms.phi_dot, atol=1e-12)


def test_open_parameters_take_the_place_of_numbers_and_can_be_differentiated():
    mechanism = everything()
    names = ("links.arm.mass", "gravity.y", "gravity.x", "forces.stretch.k", "joints.slot.offset")
    opened, plain = functions(mechanism, names), functions(mechanism)
    state = (0.0, mechanism.q0, mechanism.v0)
    np.testing.assert_allclose(np.array(opened.acceleration(*state, opened.values)[0]), np.array(plain.acceleration(*state)[0]))
    heavier = list(opened.values)
    heavier[0] *= 1.5
    links = tuple(replace(x, mass=1.5 * x.mass) if x.name == "arm" else x for x in mechanism.links)
    same = functions(replace(mechanism, links=links))
    np.testing.assert_allclose(np.array(opened.acceleration(*state, heavier)[0]), np.array(same.acceleration(*state)[0]))
    slope = np.array(opened.acceleration.jacobian()(*state, opened.values, 0, 0)[3])[:, 0]
    h = 1e-6
    moved = [np.array(opened.acceleration(*state, [opened.values[0] + s * h, *opened.values[1:]])[0]) for s in (1, -1)]
    np.testing.assert_allclose(slope, (moved[0] - moved[1])[:, 0] / (2 * h), rtol=1e-5, atol=1e-5)


@pytest.mark.parametrize("name", ["links.arm.colour", "links.nobody.mass", "forces.push.value", "speed", "joints.O.offset"])
def test_a_parameter_that_is_not_there_is_refused_by_name(name):
    with pytest.raises(ValueError, match=name):
        functions(everything(), (name,))
    with pytest.raises(ValueError, match="twice"):
        functions(everything(), ("gravity.y", "gravity.y"))
