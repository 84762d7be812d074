"""Pinocchio: on and off the constraints its accelerations are those of Gauss's principle, and the suite's integrators step them."""

import sys
import tomllib
from dataclasses import replace

import numpy as np
import pytest

from gauss_bench.engines import get
from gauss_bench.engines.base import Choice
from gauss_bench.engines.native import Native
from gauss_bench.engines.pinocchio import SETTINGS, Multibody, Pinocchio, PinocchioModel, TreeForces, verify
from gauss_bench.formulations.gauss import gauss
from gauss_bench.integrate.stabilization import baumgarte
from gauss_bench.mechanism.closure import gauss_newton
from gauss_bench.mechanism.evaluate import Evaluator
from gauss_bench.mechanism.load import load, load_document
from gauss_bench.mechanism.model import Mechanism, Revolute
from gauss_bench.mechanism.tree import spanning_tree
from gauss_bench.terms import Array
from gauss_bench.trajectory import RunFailure, Status, Trajectory
from tests.conftest import everything, redundant

pytest.importorskip("pinocchio")

ENGINE = Pinocchio()
LINKAGES = ("crank_slider", "four_bar", "six_bar", "eight_bar")

SWINGING_BLOCK = """
format = "planar-linkage/1"
name = "swinging_block"            # an inverted crank-slider: the guide turns, stands off, and the block has a line of its own
crank = "crank"
gravity = [0.7, -9.0]
expect = { dof = 1, redundant = 0 }
[ground]
points = { O = [0.0, 0.0], D = [0.5, -0.1] }
[links.crank]
points = { O = [0.0, 0.0], B = [0.2, 0.0] }
mass = 1.0
com = [0.07, 0.02]
inertia = 0.02
[links.block]
points = { B = [0.0, 0.0], K = [0.05, 0.02] }
mass = 0.4
com = [0.01, -0.02]
inertia = 0.003
[links.lever]
points = { D = [0.0, 0.0], G = [0.1, 0.05], E = [0.6, 0.0] }
mass = 1.5
com = [0.3, 0.01]
inertia = 0.05
[joints]
O = { type = "revolute", at = ["ground.O", "crank.O"] }
B = { type = "revolute", at = ["block.B", "crank.B"] }
slot = { type = "prismatic", guide = "lever.G", angle_deg = 25.0, block = "block.K", block_angle_deg = 40.0, offset = 0.03 }
D = { type = "revolute", at = ["lever.D", "ground.D"] }
[forces]
motor = { type = "torque", link = "crank", value = 1.0 }
brake = { type = "joint_damping", joint = "D", c = 0.1 }
rub = { type = "joint_damping", joint = "slot", c = 0.5 }
along = { type = "axis_spring_damper", point = "block.B", origin = "lever.D", angle_deg = 25.0, k = 5.0, c = 0.2, rest = 0.3 }
spring = { type = "spring_damper", between = ["crank.B", "lever.E"], k = 20.0, c = 0.3, rest = 0.2 }
[assembly]
sketch = { B = [0.2, 0.0] }
angles_deg = { lever = 150.0, block = 135.0 }
[scenarios.run]
start = { crank_deg = 0.0, speed = 2.0 }
duration = 1.0
forces = ["motor", "brake", "rub", "along", "spring"]
"""

PARALLELOGRAM = """
format = "planar-linkage/1"
name = "parallelogram"             # three equal cranks: one row is redundant only while the linkage is closed
crank = "first"
expect = { dof = 1, redundant = 1 }
[ground]
points = { A = [0.0, 0.0], D = [0.4, 0.0], G = [0.2, 0.15] }
[links]
first = { points = { A = [0.0, 0.0], B = [0.16, 0.0] }, bars = [["A", "B"]], kg_per_m = 0.8 }
second = { points = { D = [0.0, 0.0], C = [0.16, 0.0] }, bars = [["D", "C"]], kg_per_m = 0.8 }
third = { points = { G = [0.0, 0.0], H = [0.16, 0.0] }, bars = [["G", "H"]], kg_per_m = 0.8 }
coupler = { points = { B = [0.0, 0.0], C = [0.4, 0.0], H = [0.2, 0.15] }, bars = [["B", "C"], ["C", "H"]], kg_per_m = 0.8 }
[joints]
A = { type = "revolute", at = ["ground.A", "first.A"] }
B = { type = "revolute", at = ["first.B", "coupler.B"] }
C = { type = "revolute", at = ["coupler.C", "second.C"] }
D = { type = "revolute", at = ["ground.D", "second.D"] }
G = { type = "revolute", at = ["ground.G", "third.G"] }
H = { type = "revolute", at = ["coupler.H", "third.H"] }
[assembly]
sketch = { B = [0.14, 0.08], C = [0.54, 0.08], H = [0.34, 0.23] }
[forces]
motor = { type = "torque", link = "first", value = 2.0 }
[scenarios.torque]
start = { crank_deg = 30.0, speed = 0.0 }
duration = 2.0
forces = ["motor"]
"""

WEDGE = """
format = "planar-linkage/1"
name = "wedge"                     # a loop of slides alone
expect = { dof = 1 }
[ground]
points = { O = [0.0, 0.0] }
[links]
low = { points = { P = [0.0, 0.0] }, mass = 1.0, inertia = 0.01 }
high = { points = { P = [0.0, 0.0] }, mass = 1.0, inertia = 0.01 }
[joints]
floor = { type = "prismatic", guide = "ground.O", block = "low.P" }
wall = { type = "prismatic", guide = "ground.O", angle_deg = 90.0, block = "high.P", block_angle_deg = 90.0 }
slope = { type = "prismatic", guide = "low.P", angle_deg = 45.0, block = "high.P", block_angle_deg = 45.0 }
[assembly]
sketch = { "low.P" = [0.1, 0.0], "high.P" = [0.0, -0.1] }
angles = { low = 0.0, high = 0.0 }
[scenarios.run]
start = { slides = { floor = 0.1 } }
duration = 1.0
"""


def from_text(text: str) -> Mechanism:
    return load_document(tomllib.loads(text))


def linkage(name: str) -> Mechanism:
    texts = {"swinging_block": SWINGING_BLOCK, "parallelogram": PARALLELOGRAM}
    made = {"everything": without_knife_edges, "redundant": redundant}
    return from_text(texts[name]) if name in texts else made[name]() if name in made else load(name)


def without_knife_edges() -> Mechanism:
    return replace(everything(), knife_edges=())


def closed_states(mechanism: Mechanism, rng: np.random.Generator, count: int = 12) -> list[tuple[Array, Array]]:
    """Random crank angles, reached in small steps so that the assembly stays, and crank speeds up to 30 rad/s."""
    evaluator, c = Evaluator(mechanism), 3 * mechanism.crank + 2
    q, unit, found = mechanism.q0, np.eye(mechanism.n)[c], []
    for target in rng.uniform(-0.5, 0.5, count).cumsum() + q[c]:
        for angle in np.linspace(q[c], target, 1 + int(np.ceil(abs(target - q[c]) / np.radians(5))))[1:]:

            def residual(x: Array, angle: float = angle) -> tuple[Array, Array]:
                terms = evaluator.terms(0.0, x, np.zeros_like(x))
                return np.append(terms.phi, x[c] - angle), np.vstack([terms.J, unit])

            q, error = gauss_newton(q, residual)
            assert error < 1e-12  # the state is on the constraints, up to rounding
        J = evaluator.terms(0.0, q, np.zeros_like(q)).J
        speed = rng.uniform(-30.0, 30.0)
        found.append((q, np.linalg.lstsq(np.vstack([J, unit]), np.append(np.zeros(len(J)), speed), rcond=None)[0]))
    return found


def relative_error(a: Array, expected: Array) -> float:
    return float(np.abs(a - expected).max() / np.abs(expected).max())


def build(mechanism: Mechanism, **choice: object) -> PinocchioModel:
    return ENGINE.build(mechanism, Choice(**{"integrator": "rk4", **choice}))


def ran(mechanism: Mechanism, times: Array, **choice: object) -> Trajectory:
    model = build(mechanism, **choice)
    model.prepare(times)
    model.run()
    return model.read()


def by_gauss(mechanism: Mechanism, times: Array, **choice: object) -> Trajectory:
    model = Native("gauss").build(mechanism, Choice(**{"integrator": "dop853", **choice}))
    model.prepare(times)
    model.run()
    return model.read()


def open_by(mechanism: Mechanism, trajectory: Trajectory) -> float:
    return float(np.abs(Evaluator(mechanism).constraints(trajectory.t, trajectory.q, trajectory.v).phi).max())


@pytest.mark.parametrize("settings", SETTINGS)
@pytest.mark.parametrize("name", [*LINKAGES, "swinging_block", "redundant", "parallelogram"])
def test_accelerations_of_closed_states_are_those_of_gauss(name: str, settings: str, rng: np.random.Generator) -> None:
    mechanism = linkage(name)
    evaluator, model = Evaluator(mechanism), build(mechanism, settings=settings)
    for q, v in closed_states(mechanism, rng):
        expected = gauss(evaluator.terms(0.0, q, v)).a
        assert (
            relative_error(model.acceleration(0.0, q, v), expected) < 1e-10
        )  # rounding, amplified by transmission angles, is 3e-13


@pytest.mark.parametrize("settings", SETTINGS)
def test_several_degrees_of_freedom_free_bodies_and_every_force(settings: str, rng: np.random.Generator) -> None:
    mechanism = without_knife_edges()
    tree, evaluator, model = spanning_tree(mechanism), Evaluator(mechanism), build(mechanism, settings=settings)
    for _ in range(10):
        q, v, _ = tree.absolute(rng.standard_normal(tree.n), rng.standard_normal(tree.n), np.zeros(tree.n))
        assert relative_error(model.acceleration(0.0, q, v), gauss(evaluator.terms(0.0, q, v)).a) < 1e-12  # no loops: rounding only


@pytest.mark.parametrize("stabilization", ["none", "baumgarte"])
@pytest.mark.parametrize("name", [*LINKAGES, "swinging_block"])
def test_open_loops_are_drawn_shut_as_the_suite_does_it(name: str, stabilization: str, rng: np.random.Generator) -> None:
    mechanism = linkage(name)
    tree, evaluator, model = spanning_tree(mechanism), Evaluator(mechanism), build(mechanism, stabilization=stabilization)
    for q, v in closed_states(mechanism, rng, 5):
        y, dy = tree.relative(q, v)
        y, dy = y + 1e-2 * rng.standard_normal(tree.n), dy + 0.1 * rng.standard_normal(tree.n)
        q, v, a = tree.absolute(y, dy, model.stabilized(0.0, y, dy))
        terms = evaluator.terms(0.0, q, v)
        assert np.abs(terms.phi).max() > 1e-4  # off the constraints, or nothing is shown
        expected = gauss(baumgarte(terms) if stabilization == "baumgarte" else terms).a
        assert relative_error(a, expected) < 1e-10  # as for closed states: both are exact


def test_which_end_of_a_pin_is_named_first_does_not_matter(rng: np.random.Generator) -> None:
    """The constraint force changes its sign and its frame; the accelerations must not notice."""
    mechanism = load("eight_bar")
    swapped = replace(mechanism, joints=tuple(replace(j, a=j.b, b=j.a) if isinstance(j, Revolute) else j for j in mechanism.joints))
    one, other = build(mechanism), build(swapped)
    for q, v in closed_states(mechanism, rng, 5):
        assert relative_error(one.acceleration(0.0, q, v), other.acceleration(0.0, q, v)) < 1e-10  # as for closed states


def test_an_acceleration_depends_on_its_state_alone(rng: np.random.Generator) -> None:
    mechanism = load("six_bar")
    model, states = build(mechanism), closed_states(mechanism, rng, 4)
    first = [model.plain(0.0, *model.tree.relative(q, v)) for q, v in states]
    again = [model.plain(0.0, *model.tree.relative(q, v)) for q, v in reversed(states)][::-1]
    np.testing.assert_array_equal(first, again)  # no warm start, and no result that lives in memory of the next call


# Forces -----------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "mechanism", [without_knife_edges(), from_text(SWINGING_BLOCK), *map(load, LINKAGES)], ids=lambda m: m.name
)
def test_forces_do_the_same_work_in_the_tree(mechanism: Mechanism, rng: np.random.Generator) -> None:
    tree, weightless = spanning_tree(mechanism), Evaluator(replace(mechanism, gravity=np.zeros(2)))
    forces = TreeForces(mechanism, tree, Multibody(mechanism, tree))
    for _ in range(5):
        y, dy, shift = rng.standard_normal((3, tree.n))
        q, v, _ = tree.absolute(y, dy, dy)
        along = tree.absolute(y, shift, dy)[1]
        work, expected = forces(y, dy) @ shift, weightless.applied.generalised(q, v) @ along
        assert work == pytest.approx(expected, rel=1e-12, abs=1e-12 * np.abs(forces(y, dy)).max())  # rounding of a few sums


def test_only_forces_that_bend_with_the_state_are_evaluated_each_time() -> None:
    """Torques, dampers of joints and springs along slides are linear in tree coordinates; a spring between turning links is not."""
    block = from_text(SWINGING_BLOCK)
    assert [f.name for f in build(block).forces.others] == ["spring"]
    for name in LINKAGES:
        assert build(load(name)).forces.others == ()
    assert "spring" in ran(block, np.array([0.0, 0.01])).note
    assert ran(load("four_bar"), np.array([0.0, 0.01])).note == ""


# Runs -------------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("settings", SETTINGS)
@pytest.mark.parametrize("name", [*LINKAGES, "swinging_block", "everything"])
def test_dop853_follows_gauss(name: str, settings: str) -> None:
    mechanism, times = linkage(name), np.linspace(0.0, 0.5, 6)
    found, expected = ran(mechanism, times, integrator="dop853", settings=settings), by_gauss(mechanism, times)
    assert np.abs(found.q - expected.q).max() < 1e-8  # two runs at rtol 1e-10, whose errors grow along half a second
    assert relative_error(found.a, expected.a) < 1e-7  # the same error in q and v, times the stiffness of the speeds squared


@pytest.mark.parametrize(("integrator", "order"), [("rk4", 4), ("semi_implicit_euler", 1)])
def test_the_error_falls_with_the_order_of_the_method(integrator: str, order: int) -> None:
    mechanism, times = load("crank_slider", "paper"), np.array([0.0, 0.25])
    exact = by_gauss(mechanism, times)
    errors = [np.abs(ran(mechanism, times, integrator=integrator, step=h).q - exact.q).max() for h in (2e-3, 1e-3)]
    assert np.log2(errors[0] / errors[1]) == pytest.approx(order, abs=0.3)  # higher orders of h are still felt


def test_stabilizations_hold_the_loops_shut() -> None:
    mechanism, times = load("crank_slider", "paper"), np.linspace(0.0, 1.0, 11)
    drift = {x: open_by(mechanism, ran(mechanism, times, stabilization=x, step=2e-3)) for x in Pinocchio.stabilizations}
    assert drift["projection"] < 1e-12  # two Gauss-Newton corrections, then rounding
    assert drift["projection"] < drift["baumgarte"] < drift["none"]


def test_samples_begin_at_the_start_and_angles_are_not_wrapped() -> None:
    mechanism, times = load("eight_bar"), np.linspace(0.0, 1.5, 151)
    found = ran(mechanism, times)
    np.testing.assert_allclose(found.q[0], mechanism.q0, rtol=0, atol=1e-14)  # there and back through the tree
    np.testing.assert_allclose(found.v[0], mechanism.v0, rtol=0, atol=1e-14)
    crank = found.q[:, 3 * mechanism.crank + 2]
    assert np.ptp(crank) > 2 * np.pi
    assert np.abs(np.diff(crank)).max() < 1.0
    assert (found.steps, found.evaluations) == (1500, 6000)


def test_a_single_time_is_the_start() -> None:
    mechanism = load("four_bar")
    for integrator in Pinocchio.integrators:
        found = ran(mechanism, np.zeros(1), integrator=integrator)
        assert (found.steps, found.evaluations, found.q.shape) == (0, 0, (1, mechanism.n))


def test_times_between_steps_are_met_by_shorter_steps() -> None:
    mechanism, times = load("four_bar"), np.array([0.0, 0.0105, 0.02])
    found, exact = ran(mechanism, times), by_gauss(mechanism, times)
    assert found.steps == 21
    assert np.abs(found.q - exact.q).max() < 1e-10  # RK4 at 1 ms, for 20 ms


def test_a_second_run_repeats_the_first() -> None:
    model, times = build(load("six_bar")), np.linspace(0.0, 0.1, 3)
    runs = []
    for _ in range(2):
        model.prepare(times, native=False)
        model.run()
        runs.append(model.read())
    np.testing.assert_array_equal(runs[0].q, runs[1].q)
    assert runs[0].evaluations == runs[1].evaluations == 400


# Redundant rows ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["redundant", "parallelogram"])
@pytest.mark.parametrize("settings", SETTINGS)
def test_redundant_rows_run_when_projection_keeps_them_together(name: str, settings: str) -> None:
    mechanism, times = linkage(name), np.linspace(0.0, 1.0, 5)
    found = ran(mechanism, times, settings=settings, stabilization="projection")
    expected = by_gauss(mechanism, times, integrator="rk4", stabilization="projection")
    assert np.abs(found.q - expected.q).max() < 1e-6  # RK4 at 1 ms and 15 rad/s, stepping tree and absolute coordinates


@pytest.mark.parametrize("settings", SETTINGS)
def test_redundant_rows_that_part_end_the_run(settings: str) -> None:
    """The three cranks of a parallelogram drift until they lock each other: no answer is better than that one."""
    with pytest.raises(RunFailure, match="redundant") as failure:
        ran(from_text(PARALLELOGRAM), np.linspace(0.0, 2.0, 5), settings=settings)
    assert failure.value.status is Status.NOT_CONVERGED


def test_independent_rows_far_off_are_not_mistaken_for_it() -> None:
    mechanism = load("crank_slider", "paper")
    found = ran(mechanism, np.linspace(0.0, 1.0, 3), integrator="semi_implicit_euler", step=2e-3)
    assert open_by(mechanism, found) > 1e-2  # a coarse method has opened the loop by centimetres, and the engine says so honestly


# Refusals ---------------------------------------------------------------------------------------------------------------


def test_what_is_skipped_and_why() -> None:
    choice = Choice(integrator="rk4")
    assert "prescribed" in (ENGINE.skip(load("four_bar", "driven"), choice) or "")
    assert "knife edge" in (ENGINE.skip(everything(), choice) or "")
    assert "slide slope" in (ENGINE.skip(from_text(WEDGE), choice) or "")
    assert "fixed-step" in (ENGINE.skip(load("four_bar"), Choice(integrator="dop853", stabilization="projection")) or "")
    for name in (*LINKAGES, "swinging_block", "redundant", "parallelogram"):
        assert ENGINE.skip(linkage(name), choice) is None


def test_skipping_needs_no_pinocchio(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pinocchio", None)
    engine = get("pinocchio")
    assert engine.skip(load("crank_slider"), Choice(integrator=engine.integrators[0])) is None
    with pytest.raises(ImportError):
        engine.build(load("crank_slider"), Choice(integrator=engine.integrators[0]))


def test_the_version_names_the_library() -> None:
    import pinocchio

    assert ENGINE.version() == f"Pinocchio {pinocchio.__version__}"


@pytest.mark.parametrize(
    "change",
    [
        lambda m: replace(m, gravity=m.gravity + np.array([0.0, 1e-6])),
        lambda m: replace(m, links=(*m.links[:-1], replace(m.links[-1], mass=m.links[-1].mass * (1 + 1e-6)))),
        lambda m: replace(m, joints=tuple(moved(j) for j in m.joints)),
    ],
    ids=["gravity", "mass", "pin"],
)
@pytest.mark.parametrize("name", LINKAGES)
def test_a_model_of_another_mechanism_is_refused(name: str, change: object) -> None:
    mechanism = load(name)
    tree = spanning_tree(mechanism)
    verify(Multibody(mechanism, tree), mechanism, tree)
    other = change(mechanism)  # type: ignore[operator]
    with pytest.raises(RunFailure, match="differs from the linkage") as failure:
        verify(Multibody(other, spanning_tree(other)), mechanism, tree)
    assert failure.value.status is Status.ERROR


def moved(joint: object) -> object:
    """A pin whose point b lies a micrometre off."""
    return replace(joint, b=replace(joint.b, local=joint.b.local + np.array([0.0, 1e-6]))) if isinstance(joint, Revolute) else joint


@pytest.mark.parametrize("stabilization", Pinocchio.stabilizations)
@pytest.mark.parametrize("name", ["four_bar", "swinging_block"])
def test_an_exploding_run_ends_in_a_sentence(name: str, stabilization: str) -> None:
    wild = linkage(name)
    wild = replace(wild, forces=(*wild.forces, *(replace(f, c=1e9) for f in wild.forces if f.name == "brake")))
    with pytest.raises(RunFailure, match="t = ") as failure:
        ran(wild, np.linspace(0.0, 1.0, 3), integrator="rk4", step=0.02, stabilization=stabilization)
    assert failure.value.status in (Status.NAN, Status.NOT_CONVERGED)


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_a_state_that_is_not_finite_has_no_acceleration(bad: float) -> None:
    mechanism = load("crank_slider")
    with pytest.raises(RunFailure) as failure:
        build(mechanism).acceleration(0.0, mechanism.q0, np.full(mechanism.n, bad))
    assert failure.value.status is Status.NAN
