"""Properties that every formulation must have, and the one that the negative control lacks."""

from dataclasses import replace

import mpmath
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gauss_bench.formulations import CONTROLS, FORMULATIONS
from gauss_bench.linkage.load import load
from gauss_bench.mechanism.evaluate import Evaluator
from gauss_bench.terms import SingularSystem, Terms, constraint_force, recover_multipliers

SOUND = sorted(FORMULATIONS.keys() - CONTROLS)


def random_terms(seed, n, m):
    """Any symmetric positive definite M, not diagonal, and any independent rows."""
    rng = np.random.default_rng(seed)
    A = rng.normal(size=(n, n))
    J, zero = rng.normal(size=(m, n)), np.zeros(m)
    return Terms(A @ A.T + 0.1 * n * np.eye(n), J, rng.normal(size=n), rng.normal(size=m), zero, zero)


def difference(a, b):
    return float(np.abs(a - b).max() / np.abs(b).max())


@pytest.mark.parametrize("name", SOUND)
@given(seed=st.integers(0, 10_000), n=st.integers(2, 12), rows=st.floats(0.1, 0.99))
@settings(max_examples=40, deadline=None)
def test_the_solution_meets_the_constraints_and_is_stationary(name, seed, n, rows):
    terms = random_terms(seed, n, max(1, int(rows * n)))
    a = FORMULATIONS[name](terms).a
    assert np.abs(terms.J @ a - terms.gamma).max() < 1e-8
    force = constraint_force(terms, a)  # Gauss's principle: no component along any motion the constraints allow
    assert np.abs(force + terms.J.T @ recover_multipliers(terms, a)).max() < 1e-8 * (1 + np.abs(force).max())


def exact(terms):
    """The accelerations in 60 digits."""
    n, m = len(terms.M), len(terms.J)
    with mpmath.workdps(60):
        K = mpmath.zeros(n + m)
        K[:n, :n], K[n:, :n], K[:n, n:] = (mpmath.matrix(x.tolist()) for x in (terms.M, terms.J, terms.J.T))
        solution = mpmath.lu_solve(K, mpmath.matrix([*terms.Q, *terms.gamma]))
        return np.array([float(x) for x in solution[:n]])


@given(seed=st.integers(0, 10_000), decades=st.integers(0, 12))
@settings(max_examples=40, deadline=None)
def test_a_light_link_beside_a_heavy_one_that_stands_still_keeps_its_digits(seed, decades):
    terms = random_terms(seed, 8, 7)
    J = terms.J.copy()
    J[:4, 4:] = 0.0  # four rows hold the four heavy coordinates; three leave one of four light ones free
    heavy = replace(terms, M=np.diag(10.0 ** np.repeat([decades, 0.0], 4)), J=J)
    assert difference(FORMULATIONS["gauss"](heavy).a, exact(heavy)) < 1e-16 * 10.0 ** min(max(decades, 1), 6) * np.linalg.cond(J)


def test_redundant_rows_of_uneven_masses_keep_their_digits():
    terms = random_terms(3, 9, 6)
    uneven = replace(terms, M=np.diag(10.0 ** np.linspace(0, 11, 9)))
    twice = replace(uneven, J=np.vstack([uneven.J, uneven.J[::-1]]), gamma=np.concatenate([uneven.gamma, uneven.gamma[::-1]]))
    assert difference(FORMULATIONS["gauss"](twice).a, exact(uneven)) < 1e-13


@pytest.mark.parametrize("name", SOUND)
@pytest.mark.parametrize("what", ["rows", "masses"])
def test_small_is_not_dependent(name, what):
    """Rows of another unit, 1e-5 of the others, and masses of 1e-10 still count: only rounding makes a row dependent."""
    terms, unit = random_terms(11, 7, 4), np.array([1e-5, 1.0, 1.0, 1.0])
    if what == "rows":
        small = replace(terms, J=unit[:, None] * terms.J, gamma=unit * terms.gamma)
    else:
        small = replace(terms, M=np.diag([1.0, 1.0, 1.0, 1e-10, 1.0, 1e-10, 1.0]))
    found = FORMULATIONS[name](small)
    assert found.rank == 4
    assert difference(found.a, exact(small)) < 1e-5


@pytest.mark.parametrize("decades", [0, 4, 8, 12])
@pytest.mark.parametrize("seed", range(4))
def test_multipliers_take_heavy_links_beside_light_ones(seed, decades):
    """Whether rows are redundant is a matter of geometry: masses of 1 to 1e12 kg in one system neither make nor hide it."""
    terms = random_terms(seed, 8, 5)
    J, gamma = terms.J, terms.gamma
    uneven = replace(terms, M=np.diag(10.0 ** np.linspace(0, decades, 8)))
    assert difference(FORMULATIONS["lagrange"](uneven).a, exact(uneven)) < 1e-13 * 10.0 ** (decades / 2) * np.linalg.cond(J)
    with pytest.raises(SingularSystem, match="redundant"):
        FORMULATIONS["lagrange"](replace(uneven, J=np.vstack([J, J[0] + J[1]]), gamma=np.append(gamma, gamma[0] + gamma[1])))


@pytest.mark.parametrize("name", SOUND)
def test_a_thrown_body_falls_and_a_driven_linkage_has_nothing_left_to_minimise(name):
    body, driven = load("projectile"), load("six_bar", "cycloid")
    free = Evaluator(body).terms(0.0, body.q0, body.v0)
    assert FORMULATIONS[name](free).a == pytest.approx([0.0, -9.81, 0.0])
    full = Evaluator(driven).terms(0.3, driven.q0, driven.v0)
    assert (free.J.shape, full.J.shape) == ((0, 3), (driven.n, driven.n))
    assert difference(FORMULATIONS[name](full).a, np.linalg.solve(full.J, full.gamma)) < 1e-10


def test_equation_16_meets_every_constraint_and_is_wrong_by_the_predicted_amount():
    mechanism = load("crank_slider")
    terms = Evaluator(mechanism).terms(0.0, mechanism.q0, mechanism.v0)
    wrong, true = FORMULATIONS["yuan_ge_eq16"](terms).a, FORMULATIONS["gauss"](terms).a
    assert np.abs(terms.J @ wrong - terms.gamma).max() < 1e-10 * np.abs(wrong).max()
    N = np.eye(mechanism.n) - np.linalg.pinv(terms.J) @ terms.J
    predicted = N @ np.linalg.solve(terms.M, constraint_force(terms, true))
    assert difference(true - wrong, predicted) < 1e-10
    assert difference(wrong, true) > 1.0
    same = replace(terms, M=2.5 * np.eye(mechanism.n))  # it is right only for a multiple of the unit matrix
    assert difference(FORMULATIONS["yuan_ge_eq16"](same).a, FORMULATIONS["gauss"](same).a) < 1e-12


@pytest.mark.parametrize("name", SOUND)
def test_accelerations_do_not_depend_on_the_unit_of_length(name):
    mechanism = load("crank_slider")
    terms = Evaluator(mechanism).terms(0.0, mechanism.q0, mechanism.v0)
    unit = np.tile([1000.0, 1000.0, 1.0], len(mechanism.links))  # millimetres
    scaled = replace(terms, M=terms.M / np.outer(unit, unit), J=terms.J / unit, Q=terms.Q / unit)
    assert difference(FORMULATIONS[name](scaled).a / unit, FORMULATIONS[name](terms).a) < 1e-9
