"""The truth is checked against closed forms, and its bar against itself."""

from dataclasses import replace

import numpy as np
import pytest

from gauss_bench.linkage.load import built_in, load, load_document
from gauss_bench.mechanism.evaluate import Evaluator
from gauss_bench.reference.build import integrate_twice, random_states, sample_times
from gauss_bench.reference.collocation import NoConvergence, gauss_legendre
from gauss_bench.reference.exact import closed_form
from gauss_bench.reference.minimal import LostClosure, MinimalCoordinate
from gauss_bench.reference.store import load_stored
from tests.conftest import everything, redundant
from tests.four_bars import four_bar


@pytest.mark.slow
def test_the_crank_angle_and_absolute_coordinates_give_the_same_motion():
    """Their error bars are far below the errors they judge, and never shrink."""
    mechanism, times = load("four_bar"), sample_times(0.2)
    one, other = (integrate_twice(mechanism, times, minimal) for minimal in (True, False))
    assert np.abs(one.q - other.q).max() < 1e-11
    assert np.abs(one.a - other.a).max() < 1e-8
    for x in (one, other):
        assert x.error_q.max() < 1e-12
        assert x.error_v.max() < 1e-11
        assert (np.diff(x.error_q) >= 0).all()


@pytest.mark.parametrize(
    "mechanism",
    [load("six_bar"), everything(), redundant(), load("excavator", "dig")],
    ids=["six_bar", "everything", "redundant", "excavator"],
)
def test_random_states_are_consistent_and_repeatable(mechanism):
    """A linkage that is wholly driven is taken at many times: at the start it rests."""
    states, again = random_states(mechanism, 30), random_states(mechanism, 30)
    rows = Evaluator(mechanism).constraints(states.t, states.q, states.v)
    assert np.abs(rows.phi).max() < 1e-12
    assert np.abs((rows.J @ states.v[..., None])[..., 0] + rows.phi_t).max() < 1e-11
    assert np.median(np.abs(states.a).max(axis=1)) > 1e-2
    assert np.abs((rows.J @ states.a[..., None])[..., 0] - rows.gamma).max() < 1e-8
    for one, other in zip(vars(states).values(), vars(again).values(), strict=True):
        np.testing.assert_array_equal(one, other)


def test_a_linkage_that_cannot_turn_says_where_it_stops():
    motion = MinimalCoordinate(load_document(four_bar(0.3, 0.2, 0.25, 0.4)))
    low, high = motion.angles_reached()
    limit = np.arccos((0.3**2 + 0.4**2 - (0.2 + 0.25) ** 2) / (2 * 0.3 * 0.4))  # coupler and rocker in line
    assert high <= limit < high + np.radians(1.01)
    assert low > -np.pi
    with pytest.raises(LostClosure, match=f"near crank angle {limit + 0.05:.6f} rad"):
        motion.geometry(np.array([limit - 0.05, limit + 0.05]))


def test_collocation_refuses_a_step_that_is_too_long():
    with pytest.raises(NoConvergence):
        gauss_legendre(lambda t, q, v: -1e6 * q, np.array([0.0, 1.0]), np.array([1.0]), np.array([0.0]), 1.0)


def test_a_stored_reference_is_the_same_and_is_not_shared_by_other_linkages(tmp_path):
    file = tmp_path / "four_bar.toml"  # without a certificate beside it
    file.write_bytes(built_in()["four_bar"].read_bytes())
    first, second = (load_stored(load(file), 0.05, tmp_path) for _ in range(2))
    np.testing.assert_array_equal(first.q, second.q)
    certified = load_stored(load("four_bar"), 0.05, tmp_path)
    assert np.abs(first.q - certified.q[: len(first.q)]).max() < first.error_q.max() + 1e-13
    file.write_bytes(built_in()["four_bar"].read_bytes() + b"# another file\n")
    load_stored(load(file), 0.05, tmp_path)
    assert len(list(tmp_path.glob("*.npz"))) == 2


@pytest.mark.parametrize("name", ["pendulum", "projectile", "sleigh", "n_four_bar_1", "n_four_bar_3"])
def test_a_closed_form_starts_with_the_linkage_and_obeys_its_equations_of_motion(name):
    mechanism = load(name)
    found = closed_form(mechanism, ["0.0", "0.31", "1.7", "6.4"])
    assert found is not None
    for other in (replace(mechanism, digest="another"), load("four_bar")):  # the first only bears the name
        assert closed_form(other, ["0"]) is None
    levels = [x.astype(float) for x in (found.q, found.v, found.a)]
    for x, start in zip(levels, (mechanism.q0, mechanism.v0), strict=False):
        assert np.abs(x[0] - start).max() < 1e-14
    evaluator = Evaluator(mechanism)
    for q, v, a in zip(*levels, strict=True):
        terms = evaluator.terms(0.0, q, v)
        assert np.abs(terms.phi).max(initial=0.0) < 1e-14
        assert np.abs(terms.phi_dot).max(initial=0.0) < 1e-13
        assert np.abs(terms.J @ a - terms.gamma).max(initial=0.0) < 1e-12
        force = terms.Q - terms.M @ a  # must be a force of the constraints, which does no work on the motions that they allow
        _, s, Vt = np.linalg.svd(terms.J) if len(terms.J) else (None, np.zeros(0), np.eye(mechanism.n))
        free = Vt[int((s > 1e-9).sum()) :]
        assert np.abs(free @ force).max() < 1e-12 * (1.0 + np.abs(terms.Q).max())
