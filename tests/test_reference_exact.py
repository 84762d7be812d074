"""Formulations against motions in closed form: a singular chain of any size, a nonholonomic body, a pendulum, a thrown bar."""

from dataclasses import replace

import numpy as np
import pytest

from gauss_bench.linkage.load import load
from gauss_bench.mechanism.evaluate import Evaluator
from gauss_bench.reference.exact import closed_form


def exact(name: str, times: list[float]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """q, v, a (k, n) in doubles."""
    found = closed_form(load(name), [repr(t) for t in times])
    assert found is not None
    return found.q.astype(float), found.v.astype(float), found.a.astype(float)


@pytest.mark.parametrize("name", ["pendulum", "projectile", "sleigh", "n_four_bar_1", "n_four_bar_3"])
def test_a_closed_form_starts_with_the_linkage_and_obeys_its_equations_of_motion(name: str) -> None:
    mechanism = load(name)
    levels = exact(name, [0.0, 0.31, 1.7, 6.4])
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


def test_a_linkage_that_only_bears_the_name_has_no_closed_form() -> None:
    assert closed_form(replace(load("pendulum"), digest="another"), ["0"]) is None
    assert closed_form(load("four_bar"), ["0"]) is None
