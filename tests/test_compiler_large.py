"""Kernels of large linkages: the same physics as everywhere, in code that does not grow with the linkage."""

from collections.abc import Iterator
from dataclasses import replace
from itertools import chain
from typing import Any

import numpy as np
import pytest

from gauss_bench.bench.measurements.growth import exponent, scaling
from gauss_bench.compiler.chains.looped import LoopedPrograms
from gauss_bench.compiler.elimination.formulations import Plan
from gauss_bench.compiler.elimination.partition import study
from gauss_bench.compiler.elimination.rank import acceleration_error
from gauss_bench.compiler.elimination.rounds import PLAIN, generate_in_rounds, programs_in_rounds
from gauss_bench.compiler.equations.sampling import manifold_states
from gauss_bench.compiler.errors import KernelError
from gauss_bench.compiler.kernel import Kernel, compile_kernel, form_for
from gauss_bench.compiler.machine.loops import loop_program
from gauss_bench.compiler.machine.native_code import Target
from gauss_bench.engines import get
from gauss_bench.engines.base import Choice
from gauss_bench.linkage.load import built_in, load, load_document
from gauss_bench.mechanism.evaluate import Evaluator
from gauss_bench.mechanism.model import CoulombFriction, Mechanism
from gauss_bench.reference.exact import closed_form
from tests.conftest import DATA, needs

needs("llvmlite")

FORMULATIONS = ("gauss", "lagrange")
EXACT = 1e-10  # relative: 1e-13 is usual; pivots as small as the guard's thousandth of their row may cost three digits more
ROUNDING = 1e-13  # relative: the same operations, long sums in another order


def large_kernel(mechanism: Mechanism, formulation: str = "gauss", **more: Any) -> Kernel:
    return compile_kernel(mechanism, formulation, form="looped", **more)


LIKE_OTHERS = {"cycloid", "conservative", "settles"}  # of the same linkage, with another law or fewer forces
QUICK = {"crank_slider", "sleigh", "n_four_bar_12", "pendulums_9", "ladder_11"}


def every_linkage() -> Iterator[Mechanism]:
    """Scenarios without dry friction of the linkages that come with the suite; chains; and a ladder of unequal loops."""
    for name in [*sorted(built_in()), "n_four_bar_1", "n_four_bar_12"]:
        for scenario in load(name).scenarios:
            mechanism = load(name, scenario)
            if not mechanism.has_friction and scenario not in LIKE_OTHERS:
                yield mechanism
    yield load("pendulums_9", "swing")
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


@pytest.fixture(scope="module")
def four_bars() -> dict[int, Kernel]:
    """Kernels of N-four-bars by N."""
    return {count: large_kernel(load(f"n_four_bar_{count}")) for count in (1, 16, 64)}


@pytest.mark.long("ladder_11-fall-gauss", "n_four_bar_12-fall-gauss")
@pytest.mark.slow(
    "ladder_11-fall-lagrange",
    "n_four_bar_12-driven-gauss",
    "n_four_bar_12-fall-lagrange",
    "pendulums_9-swing-gauss",
    "pendulums_9-swing-lagrange",
)
@pytest.mark.parametrize("formulation", FORMULATIONS)
@pytest.mark.parametrize(
    "mechanism",
    [m if m.name in QUICK else pytest.param(m, marks=pytest.mark.long) for m in every_linkage()],
    ids=lambda m: f"{m.name}-{m.scenario}",
)
def test_accelerations_are_those_of_the_linkage(mechanism: Mechanism, formulation: str) -> None:
    kernel, evaluator = large_kernel(mechanism, formulation), Evaluator(mechanism)
    states = manifold_states(mechanism, 7, seed=5)
    found = kernel.acceleration(states.q, states.v, states.t)
    for t, q, v, a in zip(states.t, states.q, states.v, found, strict=True):
        assert acceleration_error(evaluator, float(t), q, v, a) <= EXACT
        np.testing.assert_array_equal(kernel.acceleration(q, v, float(t)), a)


@pytest.mark.slow("n_four_bar_12-fall-gauss")
@pytest.mark.parametrize("formulation", FORMULATIONS)
@pytest.mark.parametrize(
    "name", ["four_bar-cycloid", "n_four_bar_12-fall", pytest.param("squeezer-squeeze", marks=pytest.mark.long)]
)
def test_a_step_is_that_of_runge_and_kutta(name: str, formulation: str) -> None:
    mechanism = load(*name.split("-"))
    kernel, h, n = large_kernel(mechanism, formulation), 1e-5, 4
    q, v = mechanism.q0, mechanism.v0
    for t in np.arange(n) * h:
        a1 = kernel.acceleration(q, v, t)
        a2 = kernel.acceleration(q + h / 2 * v, v + h / 2 * a1, t + h / 2)
        a3 = kernel.acceleration(q + h / 2 * v + h**2 / 4 * a1, v + h / 2 * a2, t + h / 2)
        a4 = kernel.acceleration(q + h * v + h**2 / 2 * a2, v + h * a3, t + h)
        q, v = q + h * v + h**2 / 6 * (a1 + a2 + a3), v + h / 6 * (a1 + 2 * a2 + 2 * a3 + a4)
    found = kernel.rollout(mechanism.q0, mechanism.v0, h, n)
    for own, wanted in zip(found, (q, v), strict=True):
        assert np.abs(own - wanted).max() <= ROUNDING * np.abs(wanted).max()


@pytest.mark.long("1")
@pytest.mark.slow("16")
@pytest.mark.parametrize("count", [1, 16, 64])
def test_n_four_bars_fall_as_their_closed_form_says(four_bars: dict[int, Kernel], count: int) -> None:
    kernel = four_bars[count]
    motion = closed_form(kernel.mechanism, ["0.5"])
    assert motion is not None
    q, v = kernel.rollout(kernel.mechanism.q0, kernel.mechanism.v0, 1e-3, 500)
    assert np.abs(q - motion.q[0].astype(float)).max() < 1e-11  # the method's own error is h^4 = 1e-12 in the units of the linkage
    assert np.abs(v - motion.v[0].astype(float)).max() < 1e-11
    assert kernel.lost == kernel.fallbacks == 0


@pytest.mark.slow("16")
@pytest.mark.parametrize("count", [1, 16])
def test_a_singular_position_is_passed(four_bars: dict[int, Kernel], count: int) -> None:
    """All bars lie on the ground line at about 0.73 s; the branch that is left there is the parallelogram's."""
    kernel = four_bars[count]
    motion = closed_form(kernel.mechanism, ["1.5"])
    assert motion is not None
    q, _ = kernel.rollout(kernel.mechanism.q0, kernel.mechanism.v0, 1e-3, 1500)
    assert kernel.fallbacks > 0
    # a step away, 1e-3 rad, rounding of 1e-14 grows a million times at most
    assert np.abs(q - motion.q[0].astype(float)).max() < 1e-7


def test_a_partition_fails_where_its_coordinate_stands_still() -> None:
    """The slider of a slider-crank has no speed at the dead centre, whatever the crank does."""
    mechanism = load("crank_slider", "conservative")
    slider = next(i for i, link in enumerate(mechanism.links) if link.name == "slider")
    generated = generate_in_rounds(study(mechanism), Plan("gauss", (3 * slider,)))
    programs = LoopedPrograms(iter([loop_program(generated)]), Target("llvm", 1, cache=True))
    states = manifold_states(mechanism, 400)
    sound = np.array([programs.acceleration(0.0, q, v, np.zeros(0)) is not None for q, v in zip(states.q, states.v, strict=True)])
    share = np.abs(states.v[:, 3 * slider]) / np.abs(states.v).max(axis=1)
    assert sound[share > 0.05].all()
    assert not sound[share < 1e-4].any()


def test_where_one_partition_fails_another_serves() -> None:
    mechanism = load("crank_slider", "conservative")
    kernel, evaluator = large_kernel(mechanism), Evaluator(mechanism)
    slider = next(i for i, link in enumerate(mechanism.links) if link.name == "slider")
    slow = generate_in_rounds(study(mechanism), Plan("gauss", (3 * slider,)))
    programs = map(loop_program, chain([slow], programs_in_rounds(mechanism, PLAIN)))
    kernel._programs = kernel._driver.programs = LoopedPrograms(programs, kernel.options.target)
    states = manifold_states(mechanism, 60)
    for q, v in zip(states.q, states.v, strict=True):
        assert acceleration_error(evaluator, 0.0, q, v, kernel.acceleration(q, v)) <= EXACT
    q, v = kernel.rollout(mechanism.q0, mechanism.v0, 1e-4, 20_000)
    assert kernel.switches > 0
    wanted, _ = large_kernel(mechanism, "lagrange").rollout(mechanism.q0, mechanism.v0, 1e-4, 20_000)
    assert np.abs(q - wanted).max() < 1e-7  # two seconds of falling multiply rounding, and what is lost near the guard


@pytest.mark.parametrize("lanes", [1, 2, 8])
def test_many_trajectories_are_many_single_ones(lanes: int) -> None:
    mechanism = load("jansen", "walk")
    kernel = large_kernel(mechanism, lanes=lanes)
    states = manifold_states(mechanism, 11, seed=2)
    q, v = kernel.rollout(states.q, states.v, 1e-5, 50, every=20)
    assert q.shape == v.shape == (len(states.q), 3, mechanism.n)
    for k, (q0, v0) in enumerate(zip(states.q, states.v, strict=True)):
        alone = kernel.rollout(q0, v0, 1e-5, 50)
        for own, wanted in zip((q[k, -1], v[k, -1]), alone, strict=True):
            assert np.abs(own - wanted).max() <= ROUNDING * np.abs(wanted).max()


@pytest.mark.slow
def test_what_cannot_go_on_is_not_a_number() -> None:
    mechanism = load("n_four_bar_12")
    kernel = large_kernel(mechanism)
    q0, v0 = np.tile(mechanism.q0, (2, 1)), np.tile(mechanism.v0, (2, 1))
    v0[1] = np.nan
    q, v = kernel.rollout(q0, v0, 1e-3, 10)
    assert np.isfinite(q[0]).all()
    assert np.isnan(q[1]).all()
    assert np.isnan(v[1]).all()
    assert kernel.lost == 1


@pytest.mark.long
def test_code_does_not_grow_with_the_linkage_and_operations_do_in_proportion() -> None:
    made = [loop_program(generate_in_rounds(study(load(f"n_four_bar_{n}")), Plan("gauss", (2,)))) for n in (32, 128)]
    programs = [p.plain for p in made]
    operations, groups, loops = zip(*((p.operations, len(p.groups.groups), len(p.loops)) for p in programs), strict=True)
    assert operations[1] < 4.1 * operations[0]
    assert groups[1] < 1.4 * groups[0]  # one round more
    assert loops[1] < 1.4 * loops[0]


@pytest.mark.slow("n_four_bar_40", "n_four_bar_4")
@pytest.mark.parametrize("name", ["n_four_bar_4", "n_four_bar_6", "n_four_bar_40"])
def test_the_engine_and_the_library_choose_the_same_form(name: str) -> None:
    mechanism = load(name)
    taken = compile_kernel(mechanism, "gauss").form
    assert get("gauss-native").build(mechanism, Choice(step=1e-3)).kernel.form == taken
    assert taken == form_for(len(mechanism.links)) == ("straight line" if name == "n_four_bar_4" else "looped")


def test_the_form_depends_on_the_number_of_links_once() -> None:
    """Straight-line code up to one number of links, loops beyond it, and loops never where they cannot do what is asked for."""
    forms = [form_for(links) for links in range(1, 200)]
    assert forms == sorted(forms, reverse=True)
    assert set(forms) == {"straight line", "looped"}
    for more in ({"chosen": True}, {"backend": "numpy"}):
        assert {form_for(links, **more) for links in range(1, 200)} == {"straight line"}
    with pytest.raises(KernelError, match="looped"):
        compile_kernel(load("four_bar"), independent=(2,), form="looped")


@pytest.mark.slow("lagrange-projection")
@pytest.mark.parametrize("stabilization", ["none", "baumgarte", "projection"])
@pytest.mark.parametrize("formulation", FORMULATIONS)
def test_loops_take_the_steps_of_straight_line_code(stabilization: str, formulation: str) -> None:
    """From a state off the constraints, so that what brings it back is seen; with a mass left open."""
    m, heavy = load("four_bar"), np.array([1.7])
    found = []
    for form in ("looped", "straight line"):
        kernel = compile_kernel(m, formulation, stabilization, ("links.rocker.mass",), form=form)
        q = m.q0 + 1e-5 * np.sin(np.arange(m.n))
        found.append(np.concatenate(kernel.rollout(q, m.v0, 1e-3, 60, parameters=heavy, every=20), axis=-1))
        if stabilization == "projection":
            bodies = Evaluator(m).constraints(0.0, *np.split(found[-1][-1], 2))
            assert np.abs(bodies.phi).max() < 1e-14
    # projections that start at other points of the same chord differ by what the first correction leaves
    np.testing.assert_allclose(found[0], found[1], rtol=0, atol=1e-9 if stabilization == "projection" else 1e-12)


@pytest.mark.long
@pytest.mark.slow
def test_loops_take_steps_of_semi_implicit_euler_and_know_forces_and_energy() -> None:
    mechanism = load("n_four_bar_5")
    loops, straight = (compile_kernel(mechanism, "gauss", form=form) for form in ("looped", "straight line"))
    one, other = (k.rollout(mechanism.q0, mechanism.v0, 1e-3, 300, integrator="semi_implicit_euler") for k in (loops, straight))
    np.testing.assert_allclose(one, other, rtol=0, atol=1e-12)
    np.testing.assert_allclose(loops.energy(*one), straight.energy(*other), rtol=1e-12)
    terms, a = Evaluator(mechanism).terms(0.0, *one), loops.acceleration(*one)
    for kernel in (loops, straight):
        assert np.abs(terms.M @ a + terms.J.T @ kernel.forces(*one) - terms.Q).max() < 1e-9 * np.abs(terms.Q).max()


def test_what_there_is_no_kernel_for_is_refused() -> None:
    with pytest.raises(KernelError, match="no formulation"):
        large_kernel(load("four_bar"), "newton")
    plain = load("four_bar")
    rubbing = replace(plain, frictions=(CoulombFriction("rubs", plain.joints[:1], 0.1, 0.01, 0.1),))
    with pytest.raises(KernelError, match="dry friction"):
        large_kernel(rubbing)


def test_the_comparison_has_a_row_for_every_engine() -> None:
    rows = scaling(1, 3)["scaling_races"]
    own = [x for x in rows if x["engine"].startswith("loops")]
    assert {x["engine"] for x in own} == {"loops, gauss", "loops, lagrange"}
    assert all(0 < x["seconds_low"] <= x["seconds"] <= x["seconds_high"] and x["error"] < ROUNDING for x in own)
    assert all(x["message"] for x in rows if x["status"] != "ok")


def test_growth_is_the_slope_of_logarithms() -> None:
    sizes = (1, 16, 64, 256)
    assert exponent(sizes, [3e-7 * n**1.25 for n in sizes]) == pytest.approx(1.25)


@pytest.mark.parametrize("name", ["pendulum", "sleigh"])
def test_answers_are_not_changed_by_later_questions(name: str) -> None:
    mechanism = load(name)
    kernel = large_kernel(mechanism)
    first = kernel.acceleration(mechanism.q0, mechanism.v0)
    kept, (q, v) = first.copy(), kernel.rollout(mechanism.q0, mechanism.v0, 1e-3, 10)
    q_kept, v_kept = q.copy(), v.copy()
    kernel.acceleration(q, v)
    kernel.rollout(q, v, 1e-3, 10)
    np.testing.assert_array_equal(first, kept)
    np.testing.assert_array_equal(np.stack([q, v]), np.stack([q_kept, v_kept]))


@pytest.mark.slow
@pytest.mark.parametrize("formulation", FORMULATIONS)
def test_where_no_pivot_serves_everywhere_another_program_goes_on(formulation: str) -> None:
    m = load(str(DATA / "uneven_pivots_07.toml"))
    kernel = large_kernel(m, formulation, stabilization="projection")
    found = np.concatenate(kernel.rollout(m.q0, m.v0, 1e-3, 200))
    model = get("gauss").build(m, Choice(integrator="rk4", stabilization="projection", step=1e-3))
    model.prepare(np.array([0.0, 0.2]))
    model.run()
    expected = model.read()
    np.testing.assert_allclose(found, np.concatenate([expected.q[-1], expected.v[-1]]), rtol=0, atol=1e-6)  # lagrange's metric
    assert kernel.lost == 0


def test_forces_and_energy_of_other_numbers_than_the_files_are_refused() -> None:
    m = load("crank_slider")
    kernel = large_kernel(m, open_parameters=("links.crank.mass",))
    mass = np.array([m.links[0].mass])
    for ask in (kernel.forces, kernel.energy):
        np.testing.assert_array_equal(ask(m.q0, m.v0, parameters=mass), ask(m.q0, m.v0))
        with pytest.raises(KernelError, match="numbers"):
            ask(m.q0, m.v0, parameters=2 * mass)
