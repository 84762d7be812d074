"""Forces by time and direction in native code: each law over its kinks, in every form of the code, alone and in batches."""

from functools import cache

import numpy as np
import pytest

from gauss_bench.compiler.equations.forces import FLAT, tanh
from gauss_bench.compiler.expressions.node import ExpressionGraph
from gauss_bench.compiler.kernel import compile_kernel
from gauss_bench.engines import get
from gauss_bench.engines.base import Choice
from gauss_bench.formulations.gauss import gauss
from gauss_bench.integrate.legs import legs
from gauss_bench.linkage.load import load
from gauss_bench.mechanism.evaluate import Evaluator
from tests.conftest import needs
from tests.engine_runs import ran
from tests.test_mechanism_second import OVER_TIME, VARYING, rotor

OPEN = ("forces.switch.value", "forces.ratchet.value", "links.bar.mass")


needs("llvmlite")


@pytest.fixture(scope="module")
def mechanism():
    return load(VARYING)


@cache
def kernel(**form):
    return compile_kernel(load(VARYING), **({"formulation": "gauss", "stabilization": "projection"} | form))


@pytest.mark.parametrize("name", ["gauss-native", "lagrange-native"])
@pytest.mark.parametrize("law", OVER_TIME)
def test_the_impulse_of_each_law_is_exact_where_it_is_made_of_lines(law, name):
    """Before the first and after the last row of a table too; neither steps nor samples meet a kink."""
    table, integral = OVER_TIME[law]
    mechanism = rotor({"value": 2.0, "over_time": table})
    for integrator, close in (("rk4", 1e-12 if law != "sine" else 2e-5), ("dop853", 1e-11)):
        assert get(name).skip(mechanism, Choice(integrator=integrator)) is None
        found = ran(get(name), mechanism, np.linspace(0.0, 1.0, 4), integrator=integrator, step=0.07, tolerance=1e-12)
        assert found.v[-1, 2] == pytest.approx(2.0 * integral / 0.5, abs=close)


def test_a_torque_against_its_direction_has_a_share_of_its_value():
    mechanism = rotor({"value": -1.0, "against": {"share": 3.0, "speed": 1e-3}}, speed=1.0)
    found = ran(get("gauss-native"), mechanism, [0.0, 0.1, 1.0], integrator="dop853", tolerance=1e-12)
    np.testing.assert_allclose(found.v[:, 2], [1.0, 0.4, -2.0 * (1.0 - 1 / 6)], atol=1e-2)
    np.testing.assert_allclose(found.v[1, 2], 0.4, atol=1e-12)


FORMS = [{}, {"backend": "numpy"}, {"formulation": "lagrange"}]


@pytest.mark.parametrize("form", FORMS, ids=str)
def test_all_forms_of_the_code_have_the_accelerations_of_the_linkage(form, mechanism):
    found = kernel(**form)
    evaluator, times = Evaluator(mechanism), np.array([0.0, 0.03, 0.0999, 0.1, 0.13, 0.19, 5.0])
    states = mechanism.q0 + 0.0 * times[:, None], mechanism.v0 * np.linspace(-2.0, 2.0, len(times))[:, None]
    true = np.array([gauss(evaluator.terms(t, q, v)).a for t, q, v in zip(times, *states, strict=True)])
    np.testing.assert_allclose(found.acceleration(*states, times), true, rtol=0, atol=1e-12 * np.abs(true).max())
    alone = [found.acceleration(q, v, float(t)) for t, q, v in zip(times, *states, strict=True)]
    np.testing.assert_allclose(alone, true, rtol=0, atol=1e-12 * np.abs(true).max())


@pytest.mark.parametrize("form", FORMS, ids=str)
def test_where_a_rollout_is_cut_makes_no_difference(form, mechanism):
    found, h = kernel(**form), 2.3e-3
    whole, _ = found.rollout(mechanism.q0, mechanism.v0, h, 80)
    samples = found.rollout(mechanism.q0, mechanism.v0, h, 80, every=9)
    np.testing.assert_allclose(samples[0][-1], whole, rtol=0, atol=1e-13)
    rest, _ = found.rollout(samples[0][2], samples[1][2], h, 53, t0=27 * h)
    np.testing.assert_allclose(rest, whole, rtol=0, atol=1e-13)
    usual = kernel(formulation=form.get("formulation", "gauss"))  # either corrects in a metric of its own
    np.testing.assert_allclose(whole, usual.rollout(mechanism.q0, mechanism.v0, h, 80)[0], rtol=0, atol=1e-11)


def test_batches_with_open_numbers_go_over_kinks_as_each_does_alone(mechanism):
    found = kernel(open_parameters=OPEN)
    assert found.parameters == OPEN
    numbers = np.array([[0.4 + 0.1 * k, -0.3, 0.6 + 0.05 * k] for k in range(5)])
    starts = np.tile(mechanism.q0, (5, 1)), np.tile(mechanism.v0, (5, 1))
    q, _ = found.rollout(*starts, 1e-3, 200, parameters=numbers, every=60)
    assert q.shape == (5, 4, mechanism.n)
    for k in range(5):
        alone, _ = found.rollout(mechanism.q0, mechanism.v0, 1e-3, 200, parameters=numbers[k])
        np.testing.assert_array_equal(q[k, -1], alone)
    np.testing.assert_allclose(q[0, -1], kernel().rollout(mechanism.q0, mechanism.v0, 1e-3, 200)[0], rtol=0, atol=1e-13)
    assert np.abs(q[3, -1] - q[0, -1]).max() > 1e-3
    with pytest.raises(ValueError, match="1 parameters given, 3 are open"):
        found.rollout(mechanism.q0, mechanism.v0, 1e-3, 200, parameters=np.ones(1))


def test_legs_end_at_kinks_and_at_samples():
    found = [(round(x.t, 12), round(x.h, 12), x.n, x.slots) for x in legs(0.0, 0.1, 10, 4, (-1.0, 0.25, 0.27, 0.6, 0.95, 1.0, 2.0))]
    assert found == [
        (0.0, 0.1, 2, (0, 0)),
        (0.2, 0.05, 1, (0, 0)),
        (0.25, 0.02, 1, (0, 0)),
        (0.27, 0.03, 1, (0, 0)),
        (0.3, 0.1, 1, (0, 1)),
        (0.4, 0.1, 2, (1, 1)),
        (0.6, 0.1, 2, (1, 2)),
        (0.8, 0.1, 1, (2, 2)),
        (0.9, 0.05, 1, (2, 2)),
        (0.95, 0.05, 1, (2, 3)),
    ]
    assert [(x.n, x.slots) for x in legs(0.0, 0.1, 10, 4, ())] == [(8, (0, 2)), (2, (2, 3))]
    assert [(x.n, x.slots) for x in legs(5.0, 0.1, 10, 10, (5.0, 5.5, 6.0))] == [(5, (0, 0)), (5, (0, 1))]


def test_the_tangent_of_a_direction_is_exact_to_rounding():
    x = np.concatenate([np.linspace(-3.0, 3.0, 301), [1e-12, -1e-5, 0.0, FLAT, -30.0, 1e3, -1e9]])
    graph = ExpressionGraph(len(x))
    found = tanh(graph, graph.input("x", 0, x, 1.0)).values[: len(x)]
    np.testing.assert_allclose(found, np.tanh(x), rtol=0, atol=6e-16)  # twice that of 1
