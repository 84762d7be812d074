"""Formulations against motions in closed form: a singular chain of any size, a nonholonomic body, a pendulum, a thrown bar."""

import numpy as np
import pytest

from gauss_bench.api.simulate import simulate
from gauss_bench.linkage.load import load
from gauss_bench.mechanism.evaluate import Evaluator
from gauss_bench.reference.exact import closed_form
from gauss_bench.reference.motion import Motion
from gauss_bench.terms import Array

FORMS = ("pendulum", "projectile", "sleigh", "n_four_bar_1", "n_four_bar_3")


def exact(name: str, times: list[float]) -> Motion:
    found = closed_form(load(name), [repr(t) for t in times])
    assert found is not None
    return found


def doubles(values: Array) -> Array:
    return values.astype(float)


@pytest.mark.parametrize("name", FORMS)
def test_a_closed_form_obeys_the_equations_of_motion(name: str) -> None:
    mechanism = load(name)
    motion = exact(name, [0.0, 0.31, 1.7, 6.4])
    evaluator = Evaluator(mechanism)
    for q, v, a in zip(*(doubles(x) for x in (motion.q, motion.v, motion.a)), strict=True):
        terms = evaluator.terms(0.0, q, v)
        assert np.abs(terms.phi).max(initial=0.0) < 1e-14
        assert np.abs(terms.phi_dot).max(initial=0.0) < 1e-13
        assert np.abs(terms.J @ a - terms.gamma).max(initial=0.0) < 1e-12
        force = terms.Q - terms.M @ a  # what is left over must be a force of the constraints: no work on what they allow
        _, s, Vt = np.linalg.svd(terms.J) if len(terms.J) else (None, np.zeros(0), np.eye(mechanism.n))
        free = Vt[int((s > 1e-9).sum()) :]
        assert np.abs(free @ force).max() < 1e-12 * (1.0 + np.abs(terms.Q).max())


@pytest.mark.parametrize("name", FORMS)
def test_a_closed_form_starts_where_the_linkage_does(name: str) -> None:
    mechanism, motion = load(name), exact(name, [0.0])
    assert np.abs(doubles(motion.q[0]) - mechanism.q0).max() < 1e-14
    assert np.abs(doubles(motion.v[0]) - mechanism.v0).max() < 1e-14


def test_a_linkage_that_only_bears_the_name_has_no_closed_form() -> None:
    from dataclasses import replace

    assert closed_form(replace(load("pendulum"), digest="another"), ["0"]) is None
    assert closed_form(load("four_bar"), ["0"]) is None


def n_four_bar(count: int, t: list[float]) -> tuple[Array, Array]:
    """Angle of the verticals from upright, clockwise, and its rate."""
    motion = exact(f"n_four_bar_{count}", t)
    return np.pi / 2 - doubles(motion.q[:, 2]), -doubles(motion.v[:, 2])


@pytest.mark.long("7-gauss")
@pytest.mark.slow("1-gauss")
@pytest.mark.parametrize(("count", "engine"), [(1, "gauss"), (2, "lagrange"), (7, "gauss")])
def test_the_chain_follows_its_closed_form_up_to_the_first_singular_position(count: int, engine: str) -> None:
    at = [0.2, 0.4, 0.6]  # the bars lie on the ground line after 0.7 s
    found = simulate(f"n_four_bar_{count}", engine, step=1e-3, at=at)
    phi, w = n_four_bar(count, at)
    assert np.abs(np.pi / 2 - np.array(found["links"]["v0"]["theta"]) - phi).max() < 1e-9
    assert np.abs(-np.array(found["links"][f"v{count}"]["omega"]) - w).max() < 1e-8


@pytest.mark.long
@pytest.mark.slow
def test_the_chain_passes_singular_positions_under_projection() -> None:
    at = [2.0, 3.0]
    found = simulate("n_four_bar_2", "gauss", stabilization="projection", step=1e-3, at=at)
    phi, _ = n_four_bar(2, at)
    assert np.abs(np.pi / 2 - np.array(found["links"]["v0"]["theta"]) - phi).max() < 1e-5  # the crossings cost the digits


@pytest.mark.long("udwadia_kalaba")
@pytest.mark.slow("gauss", "lagrange")
@pytest.mark.parametrize("engine", ["gauss", "lagrange", "udwadia_kalaba"])
def test_the_sleigh_follows_its_closed_form(engine: str) -> None:
    at = [0.5, 1.0, 2.0]
    found = simulate("sleigh", engine, step=1e-3, at=at)
    motion = exact("sleigh", at)
    body = found["links"]["body"]
    q, v = (np.column_stack([body[k] for k in keys]) for keys in (("x", "y", "theta"), ("vx", "vy", "omega")))
    assert np.abs(q - doubles(motion.q)).max() < 1e-9
    assert np.abs(v - doubles(motion.v)).max() < 1e-9
    assert found["metrics"]["velocity_drift"] < 1e-10
