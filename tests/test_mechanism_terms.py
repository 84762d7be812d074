"""Own terms against automatic differentiation: a linkage is written a second time, as positions and energies in symbols alone.

Rows, Jacobian, bias, generalised forces, potential and power all follow from those by differentiation, and so do the rates of
motion laws: `tests/second_derivation.py`.
"""

from pathlib import Path

import casadi as ca
import numpy as np
import pytest

from gauss_bench.engines.casadi import functions
from gauss_bench.linkage.load import built_in, document_of, load
from gauss_bench.mechanism.evaluate import Evaluator
from gauss_bench.mechanism.generated import FEW
from gauss_bench.mechanism.model import Mechanism
from tests.conftest import DATA, everything, redundant
from tests.second_derivation import equations

FILES = [*built_in().values(), *sorted(DATA.glob("*.toml"))]
CASES = [(path, scenario) for path in FILES for scenario in document_of(path)[0]["scenarios"]]
STATES = 20
ROUNDING = 1e-12  # of the largest number in a sum: positions and angles of size 1, speeds of size 5, through a dozen operations


def check(mechanism: Mechanism, random: np.random.Generator) -> None:
    """Compare all terms and powers with the second derivation, at random states and times."""
    e, own = equations(mechanism), Evaluator(mechanism)
    derived = ca.Function("derived", [e.t, e.q, e.v], [e.phi, e.c, e.J, e.gamma, e.Q, e.potential, e.power])
    h = own.constraints.holonomic
    for _ in range(STATES):
        t = random.uniform(-0.2, 1.2) * max(mechanism.duration, 1.0)
        q, v = random.normal(size=mechanism.n), random.normal(0.0, 5.0, mechanism.n)
        phi, c, J, gamma, Q, potential, power = (np.array(x) for x in derived(t, q, v))
        terms, applied = own.terms(t, q, v), own.applied
        stiffest = float(np.abs(terms.Q).max(initial=1.0))  # one stiff spring rounds in all that it touches
        pairs = {
            "phi": (terms.phi[:h], phi[:, 0], 1.0),
            "phi_dot": (terms.phi_dot, c[:, 0], 10.0),
            "J": (terms.J, J, 1.0),
            "gamma": (terms.gamma, gamma[:, 0], 25.0),
            "Q": (terms.Q, Q[:, 0], stiffest),
            "potential": (applied.potential(q), potential, stiffest),
            "power": (applied.power(q, v), power, 25.0 * stiffest),
        }
        for what, (found, expected, size) in pairs.items():
            scale = max(size, float(np.abs(expected).max(initial=0.0)))
            assert np.abs(found - expected).max(initial=0.0) < 10 * ROUNDING * scale, what


@pytest.mark.parametrize(("path", "scenario"), CASES, ids=lambda x: x.stem if isinstance(x, Path) else x)
def test_all_terms_follow_from_positions_and_energies(path: Path, scenario: str, rng: np.random.Generator) -> None:
    check(load(path, scenario), rng)


def test_redundant_rows_too(rng: np.random.Generator) -> None:
    check(redundant(), rng)


def test_a_fault_in_any_number_of_a_force_shows(rng: np.random.Generator) -> None:
    """The comparison fails if one number of one force is off by a thousandth."""
    mechanism = everything()
    numbers = ("c", "k", "rest", "value", "value.x", "value.y")
    names = [f"forces.{f.name}.{x}" for f in mechanism.forces for x in numbers if np.size(getattr(f, x[:5], ())) == 1 + ("." in x)]
    opened = functions(mechanism, names)
    q, v = rng.normal(size=mechanism.n), rng.normal(0.0, 5.0, mechanism.n)
    own = Evaluator(mechanism).terms(0.0, q, v).Q
    assert np.abs(np.array(opened.forces(q, v, opened.values))[:, 0] - own).max() < 1e-9
    assert len(names) > 10
    for k, name in enumerate(names):
        faulty = [x * 1.001 if i == k else x for i, x in enumerate(opened.values)]
        if opened.values[k]:
            assert np.abs(np.array(opened.forces(q, v, faulty))[:, 0] - own).max() > 1e-5, name


def test_a_batch_of_states_is_the_states_one_by_one(any_mechanism: Mechanism, rng: np.random.Generator) -> None:
    evaluator = Evaluator(any_mechanism)
    q, v = rng.normal(size=(2, 3, any_mechanism.n)), rng.normal(size=(2, 3, any_mechanism.n))
    rows = evaluator.constraints(0.0, q, v)
    for k in np.ndindex(2, 3):
        one = evaluator.constraints(0.0, q[k], v[k])
        for batch, single in ((rows.phi, one.phi), (rows.J, one.J), (rows.gamma, one.gamma)):
            np.testing.assert_array_equal(batch[k], single)


def test_few_states_as_floats_are_many_as_arrays(any_mechanism: Mechanism, rng: np.random.Generator) -> None:
    """Below FEW states the equations run on floats, from there on arrays; sines of both round differently in the last bit."""
    evaluator = Evaluator(any_mechanism)
    q, v = rng.normal(size=(2, FEW, any_mechanism.n))
    many, few = evaluator.constraints(0.0, q, v), evaluator.constraints(0.0, q[1:], v[1:])
    for name in ("phi", "J", "gamma", "phi_t"):
        np.testing.assert_allclose(getattr(many, name)[1:], getattr(few, name), rtol=1e-12, atol=1e-12)


def test_active_bars_keep_their_lengths_and_do_the_work() -> None:
    from gauss_bench.api.simulate import simulate

    found = simulate("excavator", "gauss", stabilization="projection", at=[0.0, 0.5])
    assert found["status"] == "ok"
    assert found["metrics"]["position_drift"] < 1e-14
    # RK4 at a millisecond leaves some 1e-9 J; where a law ends, its jerk jumps and the quadrature's bar is as large
    assert found["metrics"]["energy_error"] < 1e-9 + 2 * found["metrics"]["energy_error_bar"]
    assert found["metrics"]["energy_error_bar"] < 1e-7
    assert set(found["drivers"]) == {"ground.P-boom.A", "boom.Q-bucket.R"}
