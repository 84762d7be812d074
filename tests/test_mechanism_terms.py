"""Own terms against automatic differentiation: a linkage is written a second time, as positions and energies in symbols alone.

Rows, Jacobian, bias, generalised forces, potential and power all follow from those by differentiation, and so do the rates of
motion laws: `tests/second_derivation.py`.
"""

from pathlib import Path

import casadi as ca
import numpy as np
import pytest

from gauss_bench.linkage.load import built_in, document_of, load, load_document
from gauss_bench.mechanism.equations import Symbols, rows
from gauss_bench.mechanism.evaluate import Evaluator
from gauss_bench.mechanism.generated import FEW
from gauss_bench.mechanism.motion_laws import rise
from tests.conftest import DATA, redundant
from tests.second_derivation import equations

FILES = [*built_in().values(), *sorted(DATA.glob("*.toml"))]
CASES = [(path, scenario) for path in FILES for scenario in document_of(path)[0]["scenarios"]]
STATES = 20
ROUNDING = 1e-12  # of the largest number in a sum: positions and angles of size 1, speeds of size 5, through a dozen operations


def check(mechanism, random):
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
def test_all_terms_follow_from_positions_and_energies(path, scenario, rng):
    check(load(path, scenario), rng)


def test_redundant_rows_too(rng):
    check(redundant(), rng)


@pytest.mark.parametrize("law", ["constant", "sine", "cosine", "poly345", "table"])
def test_every_motion_law_too_within_its_time_and_outside(law, rng):
    rows = [[0.0, 0.0], [0.2, 30.0], [0.5, 20.0], [0.7, 90.0]]
    numbers = {"constant": {"speed": 2.0}, "table": {"rows": rows}}.get(law, {"travel_deg": 90.0, "time": 0.7})
    document = document_of("four_bar")[0]
    document["scenarios"]["driven"]["driver"] = {"link": "crank", "law": law, "start_deg": 10.0, **numbers}
    check(load_document(document, "driven"), rng)


@pytest.mark.parametrize(
    ("law", "speed", "acceleration"),
    [("sine", 2, 2 * np.pi), ("cosine", np.pi / 2, np.pi**2 / 2), ("poly345", 15 / 8, 10 / np.sqrt(3))],
)
def test_a_rise_has_the_peaks_of_the_textbook(law, speed, acceleration):
    """The factors are for a travel of 1 in a time of 1."""
    value, rate, second = rise(law, 0.3, 1.7, 0.8)(np.linspace(0.0, 0.8, 20001))
    assert value[[0, -1]] == pytest.approx([0.3, 0.3 + 1.7])
    assert np.abs(rate).max() == pytest.approx(speed * 1.7 / 0.8)
    assert np.abs(second).max() == pytest.approx(acceleration * 1.7 / 0.8**2)


def test_every_row_has_the_name_of_its_constraint(any_mechanism):
    written = [row.name for row in rows(any_mechanism, Symbols(any_mechanism.n))]
    assert [x.owner for x in any_mechanism.row_names] == written


def test_few_states_as_floats_are_many_as_arrays(any_mechanism, rng):
    """Below FEW states the equations run on floats, from there on arrays; sines of both round differently in the last bit."""
    evaluator = Evaluator(any_mechanism)
    q, v = rng.normal(size=(2, FEW, any_mechanism.n))
    many, few = evaluator.constraints(0.0, q, v), evaluator.constraints(0.0, q[1:], v[1:])
    for name in ("phi", "J", "gamma", "phi_t"):
        np.testing.assert_allclose(getattr(many, name)[1:], getattr(few, name), rtol=1e-12, atol=1e-12)
