"""Pinocchio: on and off the constraints its accelerations are those of Gauss's principle; the suite's integrators step them."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from gauss_bench.engines.base import Choice
from gauss_bench.engines.pinocchio.adapter import VARIANTS, Pinocchio, PinocchioModel
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
from tests.engine_runs import LINKAGES, acceleration_errors, linkage, relative_error
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


def test_only_forces_that_bend_with_the_state_are_evaluated_each_time() -> None:
    """Torques, dampers of joints and springs along slides are linear in tree coordinates; a spring between turning links is not."""
    assert "spring" in ran(made("swinging_block"), np.array([0.0, 0.01])).note
    for name in LINKAGES:
        assert build(load(name)).forces.others == ()


@pytest.mark.parametrize("settings", VARIANTS.settings)
def test_redundant_rows_that_part_end_the_run(settings: str) -> None:
    """The three cranks of a parallelogram drift until they lock each other: no answer is better than that one."""
    with pytest.raises(RunFailure, match="redundant") as failure:
        ran(made("parallelogram"), np.linspace(0.0, 2.0, 5), settings=settings)
    assert failure.value.status is Status.NOT_CONVERGED


@pytest.mark.parametrize("name", exhaustive(LINKAGES, "crank_slider"))
def test_a_model_of_another_mechanism_is_refused(name: str) -> None:
    mechanism = load(name)
    tree, last = spanning_tree(mechanism), mechanism.links[-1]
    up = np.array([0.0, 1e-6])
    moved = [replace(x, b=replace(x.b, local=x.b.local + up)) if isinstance(x, Revolute) else x for x in mechanism.joints]
    for change in (
        {"gravity": mechanism.gravity + up},
        {"links": (*mechanism.links[:-1], replace(last, mass=last.mass * (1 + 1e-6)))},
        {"joints": tuple(moved)},
    ):
        other = replace(mechanism, **change)  # type: ignore[arg-type]
        with pytest.raises(RunFailure, match="differs from the linkage"):
            verify(Multibody(pinocchio, other, spanning_tree(other)), mechanism, tree)


@pytest.mark.parametrize("stabilization", Pinocchio.stabilizations)
@pytest.mark.parametrize("name", ["four_bar", "swinging_block"])
def test_an_exploding_run_ends_in_a_sentence(name: str, stabilization: str) -> None:
    wild = made(name)
    wild = replace(wild, forces=(*wild.forces, *(replace(f, c=1e9) for f in wild.forces if f.name == "brake")))
    with pytest.raises(RunFailure, match="t = ") as failure:
        ran(wild, np.linspace(0.0, 1.0, 3), integrator="rk4", step=0.02, stabilization=stabilization)
    assert failure.value.status in (Status.NAN, Status.NOT_CONVERGED)
