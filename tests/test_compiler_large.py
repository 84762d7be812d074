"""Kernels of large linkages: the same physics as everywhere, in code that grows in proportion to the linkage."""

from collections.abc import Iterator
from functools import cache
from typing import Any

import numpy as np
import pytest

from gauss_bench.bench.measurements.growth import exponent, race_growth
from gauss_bench.bench.survived import race_here
from gauss_bench.compiler.elimination.rank import acceleration_error
from gauss_bench.compiler.equations.sampling import manifold_states
from gauss_bench.compiler.kernel import Kernel, compile_kernel
from gauss_bench.compiler.stepping import steps
from gauss_bench.compiler.stepping.rollout import bodies
from gauss_bench.engines import get
from gauss_bench.engines.base import Choice
from gauss_bench.linkage.load import load, load_document
from gauss_bench.mechanism.evaluate import Evaluator
from gauss_bench.mechanism.model import Mechanism
from gauss_bench.reference.exact import closed_form
from tests.conftest import DATA, needs

needs("llvmlite")

FORMULATIONS = ("gauss", "lagrange")
EXACT = 1e-10  # relative: 1e-13 is usual; pivots as small as the guard's thousandth of their row may cost three digits more
ROUNDING = 1e-13  # relative: the same operations, long sums in another order


def large_linkages() -> Iterator[Mechanism]:
    """Windows of four-bars, hanging pendulums, and a ladder of unequal loops."""
    yield from (load("n_four_bar_12", scenario) for scenario in load("n_four_bar_12").scenarios)
    yield load("pendulums_9", "swing")
    yield load("pendulums_32", "swing")  # a search finds cheaper pivots that lose digits
    yield ladder(11)


def ladder(count: int) -> Mechanism:
    """Four-bars side by side of which no two are alike, with springs, dampers and braked joints."""
    rng = np.random.default_rng(count)
    feet, heights = np.cumsum(rng.uniform(0.8, 1.4, count + 1)), rng.uniform(0.7, 1.3, count + 1)
    tops = np.stack([feet, heights], axis=1)
    lengths, angles = np.hypot(*np.diff(tops, axis=0).T), np.degrees(np.arctan2(*np.diff(tops, axis=0).T[::-1]))
    turns = {f"v{i}": 90.0 for i in range(count + 1)} | {f"h{i}": float(x) for i, x in enumerate(angles)}
    links = {f"v{i}": bar(x, rng.uniform(0.5, 2.0)) for i, x in enumerate(heights)}
    links |= {f"h{i}": bar(x, rng.uniform(0.5, 2.0)) for i, x in enumerate(lengths)}
    joints: dict[str, Any] = {f"A{i}": {"type": "revolute", "at": [f"ground.A{i}", f"v{i}.A"]} for i in range(count + 1)}
    for i in range(count + 1):
        ends = [f"v{i}.B", *([f"h{i - 1}.B"] if i else []), *([f"h{i}.A"] if i < count else [])]
        joints[f"B{i}"] = {"type": "revolute", "at": ends}
    forces: dict[str, Any] = {
        f"spring{i}": {"type": "spring_damper", "between": [f"ground.A{i}", f"v{i + 1}.B"], "k": 20.0 + i, "c": 0.5, "rest": 1.0}
        for i in range(0, count, 3)
    }
    forces |= {f"brake{i}": {"type": "joint_damping", "joint": f"B{i}", "c": 0.02 * i} for i in range(1, count, 4)}
    return load_document(
        {
            "format": "planar-linkage/1",
            "name": f"ladder_{count}",
            "crank": "v0",
            "ground": {"points": {f"A{i}": [float(x), 0.0] for i, x in enumerate(feet)}},
            "links": links,
            "joints": joints,
            "forces": forces,
            "assembly": {"angles_deg": turns},
            "observe": {"points": ["v0.B"]},
            "scenarios": {"fall": {"duration": 1.0, "start": {"crank_deg": 90.0, "speed": -1.0}, "forces": list(forces)}},
        }
    )


def bar(length: float, mass: float) -> dict[str, Any]:
    return {"points": {"A": [0.0, 0.0], "B": [float(length), 0.0]}, "bars": [["A", "B"]], "mass": float(mass)}


@cache
def four_bars(count: int) -> Kernel:
    """The kernel of so many windows."""
    return compile_kernel(load(f"n_four_bar_{count}"), "gauss")


@pytest.mark.long("ladder_11-fall-gauss", "n_four_bar_12-driven-gauss", "n_four_bar_12-driven-lagrange", "n_four_bar_12-fall-gauss")
@pytest.mark.long(
    "n_four_bar_12-fall-lagrange", "pendulums_9-swing-gauss", "pendulums_32-swing-gauss", "pendulums_32-swing-lagrange"
)
@pytest.mark.slow("ladder_11-fall-lagrange", "pendulums_9-swing-lagrange")
@pytest.mark.parametrize("formulation", FORMULATIONS)
@pytest.mark.parametrize("mechanism", list(large_linkages()), ids=lambda m: f"{m.name}-{m.scenario}")
def test_accelerations_are_those_of_the_linkage(mechanism: Mechanism, formulation: str) -> None:
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


@pytest.mark.parametrize("lanes", [1, 2, 8])
def test_many_trajectories_are_many_single_ones(lanes: int) -> None:
    mechanism = load("jansen", "walk")
    kernel = compile_kernel(mechanism, lanes=lanes)
    states = manifold_states(mechanism, 11, seed=2)
    q, v = kernel.rollout(states.q, states.v, 1e-5, 50, every=20)
    assert q.shape == v.shape == (len(states.q), 3, mechanism.n)
    for k, (q0, v0) in enumerate(zip(states.q, states.v, strict=True)):
        alone = kernel.rollout(q0, v0, 1e-5, 50)
        for own, wanted in zip((q[k, -1], v[k, -1]), alone, strict=True):
            assert np.abs(own - wanted).max() <= ROUNDING * np.abs(wanted).max()


@pytest.mark.slow
def test_what_cannot_go_on_is_not_a_number() -> None:
    mechanism = load("n_four_bar_4")
    kernel = compile_kernel(mechanism)
    q0, v0 = np.tile(mechanism.q0, (2, 1)), np.tile(mechanism.v0, (2, 1))
    v0[1] = np.nan
    q, v = kernel.rollout(q0, v0, 1e-3, 10)
    assert np.isfinite(q[0]).all()
    assert np.isnan(q[1]).all()
    assert np.isnan(v[1]).all()
    assert kernel.lost == 1


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


def test_growth_is_the_slope_of_logarithms() -> None:
    sizes = (1, 16, 64, 256)
    assert exponent(sizes, [3e-7 * n**1.25 for n in sizes]) == pytest.approx(1.25)


@pytest.mark.long("lagrange")
@pytest.mark.slow
@pytest.mark.parametrize("formulation", FORMULATIONS)
def test_where_no_pivot_serves_everywhere_another_program_goes_on(formulation: str) -> None:
    m = load(str(DATA / "uneven_pivots_07.toml"))
    kernel = compile_kernel(m, formulation, "projection")
    found = np.concatenate(kernel.rollout(m.q0, m.v0, 1e-3, 200))
    model = get("gauss").build(m, Choice(integrator="rk4", stabilization="projection", step=1e-3))
    model.prepare(np.array([0.0, 0.2]))
    model.run()
    expected = model.read()
    np.testing.assert_allclose(found, np.concatenate([expected.q[-1], expected.v[-1]]), rtol=0, atol=1e-6)  # lagrange's metric
    assert kernel.lost == 0


def test_the_comparison_has_a_row_for_every_engine() -> None:
    rows = race_growth(1, 3, race=race_here)["scaling_races"]
    own = [x for x in rows if x["engine"].endswith("-native")]
    assert {x["engine"] for x in own} == {"gauss-native", "lagrange-native"}
    assert all(0 < x["seconds_low"] <= x["seconds"] <= x["seconds_high"] and x["error"] < ROUNDING for x in own)
    assert all(x["message"] for x in rows if x["status"] != "ok")


def test_a_form_of_code_that_is_named_warns_and_has_no_effect() -> None:
    mechanism = load("pendulum")
    with pytest.warns(DeprecationWarning, match="straight-line"):
        old = compile_kernel(mechanism, form="looped")
    np.testing.assert_array_equal(
        old.acceleration(mechanism.q0, mechanism.v0), compile_kernel(mechanism).acceleration(mechanism.q0, mechanism.v0)
    )
