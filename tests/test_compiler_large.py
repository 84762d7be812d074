"""Kernels of large linkages: the same physics as everywhere, in code that grows in proportion to the linkage."""

from functools import cache

import numpy as np
import pytest

from gauss_bench.compiler.elimination.rank import acceleration_error
from gauss_bench.compiler.equations.sampling import manifold_states
from gauss_bench.compiler.kernel import Kernel, compile_kernel
from gauss_bench.compiler.stepping import steps
from gauss_bench.compiler.stepping.rollout import bodies
from gauss_bench.linkage.load import load
from gauss_bench.mechanism.evaluate import Evaluator
from gauss_bench.reference.exact import closed_form
from tests.conftest import exhaustive, needs

needs("llvmlite")

FORMULATIONS = ("gauss", "lagrange")
EXACT = 1e-10  # relative: 1e-13 is usual; pivots as small as the guard's thousandth of their row may cost three digits more


@cache
def four_bars(count: int) -> Kernel:
    """The kernel of four-bars in a row."""
    return compile_kernel(load(f"n_four_bar_{count}"), "gauss")


LARGE = [("n_four_bar_12", "driven"), ("n_four_bar_12", "fall"), ("pendulums_9", "swing")]
LARGE += [("pendulums_32", "swing")]  # whose cheapest pivots lose digits


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "scenario", "formulation"),
    exhaustive([(*x, f) for x in LARGE for f in FORMULATIONS], ("pendulums_9", "swing", "lagrange")),
)
def test_accelerations_are_those_of_the_linkage(name: str, scenario: str, formulation: str) -> None:
    mechanism = load(name, scenario)
    kernel, evaluator = compile_kernel(mechanism, formulation), Evaluator(mechanism)
    states = manifold_states(mechanism, 7, seed=5)
    found = kernel.acceleration(states.q, states.v, states.t)
    for t, q, v, a in zip(states.t, states.q, states.v, found, strict=True):
        assert acceleration_error(evaluator, float(t), q, v, a) <= EXACT
        np.testing.assert_array_equal(kernel.acceleration(q, v, float(t)), a)


@pytest.mark.long("1", "64")
@pytest.mark.slow("4")
@pytest.mark.parametrize("count", [1, 4, 64])
def test_n_four_bars_fall_as_their_closed_form_says(count: int) -> None:
    kernel = four_bars(count)
    motion = closed_form(kernel.mechanism, ["0.5"])
    assert motion is not None
    q, v = kernel.rollout(kernel.mechanism.q0, kernel.mechanism.v0, 1e-3, 500)
    assert np.abs(q - motion.q[0].astype(float)).max() < 1e-11  # the method's own error is h^4 = 1e-12 in the units of the linkage
    assert np.abs(v - motion.v[0].astype(float)).max() < 1e-11
    assert kernel.lost == kernel.fallbacks == 0


@pytest.mark.long("16")
@pytest.mark.parametrize("count", [1, 16])
def test_a_singular_position_is_passed(count: int) -> None:
    """All bars lie on the ground line at about 0.73 s; the branch that is left there is the parallelogram's."""
    kernel = four_bars(count)
    motion = closed_form(kernel.mechanism, ["1.5"])
    assert motion is not None
    q, _ = kernel.rollout(kernel.mechanism.q0, kernel.mechanism.v0, 1e-3, 1500)
    assert kernel.fallbacks > 0
    # a step away, 1e-3 rad, rounding of 1e-14 grows a million times at most
    assert np.abs(q - motion.q[0].astype(float)).max() < 1e-7


@pytest.mark.parametrize("stabilization", ["none", "projection"])
def test_a_loop_over_stages_takes_the_steps_that_are_written_out(stabilization: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """The loop is chosen where an acceleration has more operations than the threshold, and its code is less than half as long."""
    m = load("n_four_bar_2")
    ends, lengths = [], []
    operations = compile_kernel(m, "gauss", stabilization).operations
    for threshold in (operations, operations - 1):
        monkeypatch.setattr(steps, "LONG", threshold)
        kernel = compile_kernel(m, "gauss", stabilization)
        ends.append(kernel.rollout(np.tile(m.q0, (3, 1)), np.tile(m.v0, (3, 1)), 1e-3, 300))
        np.testing.assert_allclose(kernel.rollout(m.q0, m.v0, 1e-3, 300), [x[0] for x in ends[-1]], rtol=0, atol=1e-12)
        code = kernel._programs.codes[0]
        lengths.append(sum(body.operations for body in bodies(code, "rk4", steps.reaches(code, "rk4")[-1:])))
    np.testing.assert_allclose(*ends, rtol=0, atol=1e-12)
    assert lengths[1] < (0.5 if stabilization == "none" else 1.0) * lengths[0]


def test_a_form_of_code_that_is_named_warns_and_has_no_effect() -> None:
    mechanism = load("pendulum")
    with pytest.warns(DeprecationWarning, match="straight-line"):
        old = compile_kernel(mechanism, form="looped")
    np.testing.assert_array_equal(
        old.acceleration(mechanism.q0, mechanism.v0), compile_kernel(mechanism).acceleration(mechanism.q0, mechanism.v0)
    )
