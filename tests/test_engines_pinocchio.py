"""Pinocchio: on and off the constraints its accelerations are those of Gauss's principle; the suite's integrators step them."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from gauss_bench.engines.base import Choice
from gauss_bench.engines.pinocchio.adapter import VARIANTS, Pinocchio, PinocchioModel
from gauss_bench.engines.pinocchio.dynamics import DrivingTorques, TreeForces
from gauss_bench.engines.pinocchio.tree import Multibody, verify
from gauss_bench.engines.tree import spanning_tree
from gauss_bench.formulations.gauss import gauss
from gauss_bench.linkage.load import load
from gauss_bench.mechanism.evaluate import Evaluator
from gauss_bench.mechanism.model import Mechanism, Revolute
from gauss_bench.reference.build import random_states
from gauss_bench.terms import Array, baumgarte
from gauss_bench.trajectory import RunFailure, Status, Trajectory
from tests.conftest import everything, exhaustive, needs, redundant
from tests.engine_runs import LINKAGES, acceleration_errors, by_gauss, linkage, open_by, relative_error
from tests.engine_runs import ran as ran_in

pinocchio = needs("pinocchio")

ENGINE = Pinocchio()
MORE = ("swinging_block", "parallelogram")
LAWS = [("shaper", "driven"), ("five_bar", "driven")]


def made(name: str) -> Mechanism:
    others = {"redundant": redundant, "everything": lambda: replace(everything(), knife_edges=())}
    return others[name]() if name in others else linkage(name, "torque" if name == "parallelogram" else None)


def build(mechanism: Mechanism, **choice: Any) -> PinocchioModel:
    return ENGINE.build(mechanism, Choice(**{"integrator": "rk4", **choice}))


def ran(mechanism: Mechanism, times: Array, **choice: Any) -> Trajectory:
    return ran_in(ENGINE, mechanism, times, **choice)


@pytest.mark.parametrize("settings", VARIANTS.settings)
@pytest.mark.parametrize("name", exhaustive(["everything", "redundant", *MORE], "everything", "redundant"))
def test_accelerations_of_closed_states_are_those_of_gauss(name: str, settings: str) -> None:
    mechanism = made(name)
    errors = acceleration_errors(ENGINE, mechanism, settings, random_states(mechanism, 25))
    assert errors.max() < 1e-10  # rounding, amplified by transmission angles, is 3e-13


@pytest.mark.parametrize("stabilization", ["none", "baumgarte"])
@pytest.mark.parametrize(
    ("name", "scenario"),
    exhaustive(
        [*((x, None) for x in (*LINKAGES, "swinging_block")), *LAWS], ("eight_bar", None), ("swinging_block", None), LAWS[0]
    ),
)
def test_open_loops_and_links_off_their_laws_are_drawn_back_as_the_suite_does_it(
    name: str, scenario: str | None, stabilization: str, rng: np.random.Generator
) -> None:
    mechanism = linkage(name, scenario)
    tree, evaluator, model = spanning_tree(mechanism), Evaluator(mechanism), build(mechanism, stabilization=stabilization)
    y0, dy0 = tree.relative(mechanism.q0, mechanism.v0)
    for t in (0.0, 0.2, 0.3):
        y, dy = y0 + 1e-2 * rng.standard_normal(tree.n), dy0 + rng.standard_normal(tree.n)
        q, v, a = tree.absolute(y, dy, model.stabilized(t, y, dy))
        terms = evaluator.terms(t, q, v)
        assert np.abs(terms.phi).max() > 1e-4  # off the constraints, or nothing is shown
        expected = gauss(baumgarte(terms, 20.0, 20.0) if stabilization == "baumgarte" else terms).a
        assert relative_error(a, expected) < 1e-10  # rounding, amplified by transmission angles


def test_torques_that_move_nothing_are_a_failure_with_a_sentence() -> None:
    mechanism = load("four_bar", "driven")
    tree = spanning_tree(mechanism)
    drive = DrivingTorques(TreeForces(mechanism, tree, Multibody(pinocchio, mechanism, tree)), (0.0, 0.0))
    with pytest.raises(RunFailure, match="no driving torque") as failure:
        drive(lambda t, y, dy, tau: np.ones(tree.n), 0.0, np.zeros(tree.n), np.zeros(tree.n), np.zeros(tree.n))
    assert failure.value.status is Status.RANK_LOST


def test_only_forces_that_bend_with_the_state_are_evaluated_each_time() -> None:
    """Torques, dampers of joints and springs along slides are linear in tree coordinates; a spring between turning links is not."""
    block = made("swinging_block")
    assert [f.name for f in build(block).forces.others] == ["spring"]
    for name in LINKAGES:
        assert build(load(name)).forces.others == ()
    assert "spring" in ran(block, np.array([0.0, 0.01])).note
    assert ran(load("four_bar"), np.array([0.0, 0.01])).note == ""


@pytest.mark.slow
@pytest.mark.parametrize("name", ["redundant", "parallelogram"])
@pytest.mark.parametrize("settings", VARIANTS.settings)
def test_redundant_rows_run_when_projection_keeps_them_together(name: str, settings: str) -> None:
    mechanism, times = made(name), np.linspace(0.0, 0.4, 5)
    found = ran(mechanism, times, settings=settings, stabilization="projection")
    expected = by_gauss(mechanism, times, integrator="rk4", stabilization="projection")
    assert np.abs(found.q - expected.q).max() < 1e-6  # RK4 at 1 ms and 15 rad/s, stepping tree and absolute coordinates


@pytest.mark.parametrize("settings", VARIANTS.settings)
def test_redundant_rows_that_part_end_the_run(settings: str) -> None:
    """The three cranks of a parallelogram drift until they lock each other: no answer is better than that one."""
    with pytest.raises(RunFailure, match="redundant") as failure:
        ran(made("parallelogram"), np.linspace(0.0, 2.0, 5), settings=settings)
    assert failure.value.status is Status.NOT_CONVERGED


def test_independent_rows_far_off_are_not_mistaken_for_it() -> None:
    mechanism = load("crank_slider", "paper")
    found = ran(mechanism, np.linspace(0.0, 1.0, 3), integrator="semi_implicit_euler", step=2e-3)
    assert open_by(mechanism, found) > 1e-2  # a coarse method has opened the loop by centimetres, and the engine says so honestly


def test_projection_needs_fixed_steps() -> None:
    assert "fixed-step" in (ENGINE.skip(load("four_bar"), Choice(integrator="dop853", stabilization="projection")) or "")


@pytest.mark.parametrize(
    "change",
    [
        lambda m: replace(m, gravity=m.gravity + np.array([0.0, 1e-6])),
        lambda m: replace(m, links=(*m.links[:-1], replace(m.links[-1], mass=m.links[-1].mass * (1 + 1e-6)))),
        lambda m: replace(m, joints=tuple(moved(j) for j in m.joints)),
    ],
    ids=["gravity", "mass", "pin"],
)
@pytest.mark.parametrize("name", exhaustive(LINKAGES, "crank_slider"))
def test_a_model_of_another_mechanism_is_refused(name: str, change: object) -> None:
    mechanism = load(name)
    tree = spanning_tree(mechanism)
    verify(Multibody(pinocchio, mechanism, tree), mechanism, tree)
    other = change(mechanism)  # type: ignore[operator]
    with pytest.raises(RunFailure, match="differs from the linkage") as failure:
        verify(Multibody(pinocchio, other, spanning_tree(other)), mechanism, tree)
    assert failure.value.status is Status.ERROR


def moved(joint: object) -> object:
    """A pin whose point b lies a micrometre off."""
    return replace(joint, b=replace(joint.b, local=joint.b.local + np.array([0.0, 1e-6]))) if isinstance(joint, Revolute) else joint


@pytest.mark.parametrize("stabilization", Pinocchio.stabilizations)
@pytest.mark.parametrize("name", ["four_bar", "swinging_block"])
def test_an_exploding_run_ends_in_a_sentence(name: str, stabilization: str) -> None:
    wild = made(name)
    wild = replace(wild, forces=(*wild.forces, *(replace(f, c=1e9) for f in wild.forces if f.name == "brake")))
    with pytest.raises(RunFailure, match="t = ") as failure:
        ran(wild, np.linspace(0.0, 1.0, 3), integrator="rk4", step=0.02, stabilization=stabilization)
    assert failure.value.status in (Status.NAN, Status.NOT_CONVERGED)


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_a_state_that_is_not_finite_has_no_acceleration(bad: float) -> None:
    mechanism = load("crank_slider")
    with pytest.raises(RunFailure) as failure:
        build(mechanism).acceleration(0.0, mechanism.q0, np.full(mechanism.n, bad))
    assert failure.value.status is Status.NAN
