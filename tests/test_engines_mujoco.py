"""MuJoCo: the generated model is the mechanism, up to a softness of the closures that the settings name."""

import copy
import sys
import tomllib

import numpy as np
import pytest

from gauss_bench.engines import get
from gauss_bench.engines.base import Choice
from gauss_bench.engines.mujoco import (
    INTEGRATORS,
    SOFTNESS,
    AtSite,
    Coordinate,
    Draft,
    Mujoco,
    comparison,
    native_forces,
    verify,
)
from gauss_bench.engines.native import Native
from gauss_bench.formulations.gauss import gauss
from gauss_bench.mechanism.closure import gauss_newton
from gauss_bench.mechanism.evaluate import Evaluator
from gauss_bench.mechanism.load import built_in, load, load_document
from gauss_bench.mechanism.tree import spanning_tree
from gauss_bench.trajectory import RunFailure, Status

mujoco = pytest.importorskip("mujoco")

ENGINE = Mujoco()

LOADED = """
format = "planar-linkage/1"
name = "loaded"                    # a four-bar with every force, balanced crank, joint D left open
crank = "a"
gravity = [1.0, -9.0]
[ground]
points = { O = [0.0, 0.0], D = [0.4, 0.0], W = [0.1, -0.4] }
[links.a]
points = { O = [0.0, 0.0], B = [0.1, 0.0], X = [0.02, 0.03] }
mass = 1.0
com = [0.0, 0.0]
inertia = 0.02
[links.c]
points = { C = [0.0, 0.0], B = [0.4, 0.0] }
bars = [["B", "C"]]
kg_per_m = 1.0
[links.r]
points = { C = [0.0, 0.0], D = [0.25, 0.0], Y = [0.1, 0.2] }
mass = 0.3
com = [0.2, 0.01]
inertia = 0.01
[joints]
O = { type = "revolute", at = ["ground.O", "a.O"] }
B = { type = "revolute", at = ["a.B", "c.B"] }
C = { type = "revolute", at = ["c.C", "r.C"] }
D = { type = "revolute", at = ["r.D", "ground.D"] }
[forces]
damped_tree_pin = { type = "joint_damping", joint = "B", c = 0.02 }
damped_open_pin = { type = "joint_damping", joint = "D", c = 0.03 }
rest_minus_one = { type = "rotational_spring_damper", links = ["a", "r"], k = 0.3, c = 0.01, rest = -1.0 }
on_one_hinge = { type = "rotational_spring_damper", links = ["ground", "a"], k = 0.3, c = 0.01, rest = 1.0 }
on_the_same_hinge = { type = "rotational_spring_damper", links = ["a", "ground"], k = 0.4, c = 0.02, rest = 2.0 }
between_links = { type = "spring_damper", between = ["a.X", "r.Y"], k = 20.0, c = 0.5, rest = 0.1 }
to_ground = { type = "spring_damper", between = ["ground.W", "r.Y"], k = 20.0, c = 0.5 }
torque = { type = "torque", link = "r", reaction = "c", value = 0.4 }
world_force = { type = "force", point = "r.Y", value = [1.0, -2.0] }
follower = { type = "force", point = "c.C", frame = "body", value = [1.0, -2.0] }
moving_axis = { type = "axis_spring_damper", point = "c.C", origin = "a.X", angle_deg = 33.0, k = 7.0, c = 0.3, rest = 0.1 }
still_axis = { type = "axis_spring_damper", point = "c.C", origin = "ground.W", angle_deg = -33.0, k = 7.0, c = 0.3, rest = 0.1 }
axis_on_a_carried_link = { type = "axis_spring_damper", point = "a.X", origin = "c.C", k = 7.0 }
turned_with_a_third = { type = "force", point = "a.X", frame = "c", value = [1.0, 2.0] }
[assembly]
sketch = { B = [0.1, 0.0], C = [0.3, 0.25] }
[scenarios.all]
start = { crank_deg = 10.0, speed = 3.0 }
duration = 1.0
forces = ["damped_tree_pin", "damped_open_pin", "rest_minus_one", "on_one_hinge", "on_the_same_hinge", "between_links", "to_ground",
  "torque", "world_force", "follower", "moving_axis", "still_axis"]
[scenarios.axis]
start = { crank_deg = 10.0, speed = 3.0 }
duration = 1.0
forces = ["axis_on_a_carried_link"]
[scenarios.frame]
start = { crank_deg = 10.0, speed = 3.0 }
duration = 1.0
forces = ["turned_with_a_third"]
"""

SLIDES = """
format = "planar-linkage/1"
name = "slides"                    # a sledge whose own guide runs over a fixed block, with a slide and a lever on it; a free body
gravity = [0.5, -9.0]
[ground]
points = { P = [0.2, 0.1] }
[links.sledge]
points = { G = [0.0, 0.0], H = [0.1, 0.2] }
mass = 1.0
com = [0.1, 0.05]
inertia = 0.02
[links.block]
points = { K = [0.03, 0.01], L = [0.1, 0.1] }
mass = 0.5
com = [0.0, 0.02]
inertia = 0.01
[links.lever]
points = { L = [0.0, 0.0], E = [0.2, 0.0] }
bars = [["L", "E"]]
mass = 0.4
[links.puck]
points = { C = [0.0, 0.0], F = [0.1, 0.0] }
mass = 2.0
inertia = 0.05
[joints]
fixed_block = { type = "prismatic", guide = "sledge.G", angle_deg = 20.0, block = "ground.P", block_angle_deg = 50, offset = 0.03 }
slot = { type = "prismatic", guide = "sledge.H", angle_deg = 70.0, block = "block.K", block_angle_deg = 15.0, offset = -0.02 }
pin = { type = "revolute", at = ["block.L", "lever.L"] }
[forces]
damped = { type = "joint_damping", joint = "fixed_block", c = 0.4 }
along = { type = "axis_spring_damper", point = "ground.P", origin = "sledge.G", angle_deg = 20.0, k = 50.0, c = 0.2, rest = 0.1 }
across = { type = "axis_spring_damper", point = "ground.P", origin = "sledge.H", angle_deg = 60.0, k = 40.0, c = 0.3, rest = 0.1 }
slot_spring = { type = "axis_spring_damper", point = "block.L", origin = "sledge.G", angle_deg = 70.0, k = 30, c = 0.1, rest = 0.2 }
with_sledge = { type = "force", point = "lever.E", frame = "sledge", value = [0.5, 0.2] }
on_puck = { type = "force", point = "puck.F", value = [0.3, -0.4] }
with_puck = { type = "force", point = "lever.E", frame = "puck", value = [0.4, 0.3] }
to_puck = { type = "axis_spring_damper", point = "puck.F", origin = "sledge.H", angle_deg = 35.0, k = 3.0, c = 0.2, rest = 0.5 }
puck_spring = { type = "rotational_spring_damper", links = ["lever", "puck"], k = 0.2, c = 0.1, rest = 0.5 }
[assembly]
angles = { sledge = -0.5, block = 0.4, lever = 1.0, puck = 0.3 }
sketch = { "sledge.G" = [0.2, 0.1], "block.K" = [0.3, 0.3], "puck.C" = [2.0, 1.0] }
[scenarios.all]
duration = 1.0
forces = ["damped", "along", "across", "slot_spring", "with_sledge", "on_puck", "with_puck", "to_puck", "puck_spring"]
[scenarios.all.start]
slides = { fixed_block = 0.1, slot = 0.2 }
slide_speeds = { fixed_block = 0.3, slot = -0.2 }
angles = { lever = 1.0, puck = 0.3 }
speeds = { lever = 2.0, puck = 1.0 }
points = { "puck.C" = [2.0, 1.0] }
point_velocities = { "puck.C" = [0.5, 0.2] }
"""

LOOP_OF_SLIDES = """
format = "planar-linkage/1"
name = "wedge"
[ground]
points = { P = [0.0, 0.0], Q = [1.0, 0.0] }
[links.x]
points = { A = [0.0, 0.0] }
mass = 1.0
inertia = 0.02
[links.y]
points = { A = [0.0, 0.0] }
mass = 1.0
inertia = 0.02
[joints]
floor = { type = "prismatic", guide = "ground.P", angle_deg = 0.0, block = "x.A" }
between = { type = "prismatic", guide = "x.A", angle_deg = 45.0, block = "y.A", block_angle_deg = 45.0 }
wall = { type = "prismatic", guide = "ground.Q", angle_deg = 90.0, block = "y.A", block_angle_deg = 90.0 }
[assembly]
sketch = { "x.A" = [0.2, 0.0], "y.A" = [1.0, 0.8] }
angles = { x = 0.0, y = 0.0 }
[scenarios.slide]
start = { slides = { floor = 0.2 }, slide_speeds = { floor = 0.0 } }
duration = 1.0
forces = []
"""

PUCK = """
format = "planar-linkage/1"
name = "puck"
gravity = [0.0, -2.0]
[ground]
points = { O = [0.0, 0.0] }
[links.puck]
points = { C = [0.0, 0.0], F = [0.1, 0.0] }
mass = 2.0
inertia = 0.05
[forces]
push = { type = "force", point = "puck.C", value = [3.0, 1.0] }
spin = { type = "torque", link = "puck", value = 0.4 }
[assembly]
angles = { puck = 0.5 }
sketch = { "puck.C" = [2.0, 1.0] }
[scenarios.flight]
duration = 2.0
forces = ["push", "spin"]
[scenarios.flight.start]
angles = { puck = 0.5 }
speeds = { puck = 3.0 }
points = { "puck.C" = [2.0, 1.0] }
point_velocities = { "puck.C" = [1.0, -1.0] }
"""


def document(text, scenario=None):
    return load_document(tomllib.loads(text), scenario)


def closed_linkages():
    """The suite's own linkages and the one with every force, all with one degree of freedom and a crank."""
    found = [load(name) for name in built_in()] + [document(LOADED)]
    return [m for m in found if m.dof == 1 and m.crank is not None and ENGINE.skip(m, Choice()) is None]


LINKAGES = closed_linkages()
linkages = pytest.mark.parametrize("mechanism", LINKAGES, ids=lambda m: m.name)


def states(mechanism, count, fastest=30.0):
    """Random consistent states: the crank is turned in steps of at most 5 degrees, then given a speed [rad/s]."""
    random, joints = np.random.default_rng(5), Evaluator(mechanism).constraints
    column = 3 * mechanism.crank + 2
    row = np.eye(mechanism.n)[column : column + 1]
    q, found = mechanism.q0, []
    while len(found) < count:
        start = q[column]
        target, good = start + random.uniform(-1.5, 1.5), q
        for angle in np.linspace(start, target, 19)[1:]:

            def residual(x, angle=angle):
                rows = joints(0.0, x, np.zeros_like(x))
                return np.append(rows.phi, x[column] - angle), np.vstack([rows.J, row])

            q, error = gauss_newton(q, residual)
            if error > 1e-10:  # a crank that rocks only: turn back at the end of its range
                q = good
                break
            good = q
        J = np.vstack([joints(0.0, q, np.zeros_like(q)).J, row])
        v = np.linalg.lstsq(J, np.append(np.zeros(len(J) - 1), random.uniform(-fastest, fastest)), rcond=1e-9)[0]
        found.append((q, v))
    return found


def acceleration_errors(mechanism, label, chosen):
    """Largest error of the accelerations relative to the largest true one, at every state."""
    model, evaluator = ENGINE.build(mechanism, Choice(label)), Evaluator(mechanism)
    errors = []
    for q, v in chosen:
        exact = gauss(evaluator.terms(0.0, q, v)).a
        errors.append(np.abs(model.acceleration(0.0, q, v) - exact).max() / np.abs(exact).max())
    return np.array(errors)


def trajectory(mechanism, times, label="rigid", integrator="rk4", step=1e-3, native=True):
    model = ENGINE.build(mechanism, Choice(label, integrator, "none", step))
    model.prepare(np.asarray(times, dtype=float), native)
    model.run()
    return model.read()


def exact_trajectory(mechanism, times):
    model = Native("gauss").build(mechanism, Choice(integrator="dop853"))
    model.prepare(np.asarray(times, dtype=float))
    model.run()
    return model.read()


# The generated model ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("mechanism", [*LINKAGES, document(SLIDES), document(PUCK)], ids=lambda m: m.name)
def test_masses_forces_and_gaps_are_those_of_the_mechanism_far_from_the_start(mechanism):
    model, random = ENGINE.build(mechanism, Choice()), np.random.default_rng(7)
    for _ in range(20):
        y, dy = model.y0 + random.normal(0, 2, model.tree.n), random.normal(0, 10, model.tree.n)
        for what, (own, theirs, scale) in comparison(model, Evaluator(mechanism), y, dy).items():
            assert np.abs(own - theirs).max(initial=0.0) <= 1e-13 * scale, what  # rounding: some hundred times 2e-16


def test_every_kind_of_expression_is_in_use():
    kinds = [native_forces(m, spanning_tree(m)) for m in (document(LOADED), document(SLIDES))]
    assert [sum(isinstance(x, AtSite) for x in found) for found in kinds] == [4, 6]
    assert sum(isinstance(x, Coordinate) for x in kinds[1]) == 4  # damping, two springs along slides, one torsion spring
    model = ENGINE.build(document(LOADED), Choice()).model
    assert model.ntendon == 4  # two spatial, damping of the open pin, the torsion spring over two hinges


@pytest.mark.parametrize(
    "spoil",
    [
        lambda m: m.opt.gravity.__setitem__(0, -m.opt.gravity[0]),
        lambda m: m.body_mass.__setitem__(-1, 1.001 * m.body_mass[-1]),
        lambda m: m.tendon_stiffness.__imul__(1.01),
        lambda m: m.tendon_damping.__imul__(-1.0),
        lambda m: m.dof_damping.__imul__(2.0),
        lambda m: m.actuator_gear.__imul__(-1.0),
        lambda m: m.actuator_biasprm.__imul__(0.99),
        lambda m: m.site_pos.__setitem__(0, m.site_pos[0] + [1e-6, 0.0, 0.0]),
        lambda m: m.qpos_spring.__imul__(-1.0),
    ],
)
def test_a_spoiled_model_is_refused(spoil):
    model = ENGINE.build(document(LOADED), Choice())
    verify(model)
    spoil(model.still)
    with pytest.raises(RunFailure, match="differs in"):
        verify(model)


def test_default_is_what_mujoco_ships():
    mechanism = load("six_bar")
    shipped = Draft(mechanism, spanning_tree(mechanism)).spec.compile()
    built = ENGINE.build(mechanism, Choice("default")).model
    for name in ("eq_solref", "eq_solimp", "body_invweight0"):
        assert (getattr(built, name) == getattr(shipped, name)).all()
    assert (built.opt.tolerance, built.opt.iterations) == (shipped.opt.tolerance, shipped.opt.iterations)


def test_a_loop_is_closed_where_mujoco_measures_its_weights():
    for mechanism in LINKAGES:
        model = ENGINE.build(mechanism, Choice())
        assert (model.model.qpos0 == model.y0).all()
        gap = np.abs(np.array(model.forward(model.y0, model.dy0).efc_pos)).max()
        assert gap <= np.abs(Evaluator(mechanism).terms(0.0, mechanism.q0, mechanism.v0).phi).max() + 1e-15  # rounding at 1 m


# Accelerations ----------------------------------------------------------------------------------------------------------


@linkages
def test_accelerations_are_as_exact_as_the_setting_is_rigid(mechanism):
    chosen = states(mechanism, 25)
    default, tuned, rigid = (acceleration_errors(mechanism, label, chosen) for label in ("default", "tuned", "rigid"))
    # the error is proportional to the regulariser (1 - d) / d times the inverse weight: d = 0.9, then 0.9999, then a weight of 1e-6
    assert np.median(tuned) == pytest.approx(1e-4 / (0.1 / 0.9) * np.median(default), rel=0.5)  # default is no longer small
    assert np.median(rigid) == pytest.approx(1e-6 * np.median(tuned), rel=0.1)
    assert np.median(rigid) < 1e-9
    assert rigid.max() < 1e-7  # states of small acceleration inflate a relative error


def test_accelerations_do_not_depend_on_integrator_step_or_history():
    mechanism = document(LOADED)  # with dampers, which MuJoCo's Euler method takes implicitly
    (q, v), other = states(mechanism, 2)
    expected = ENGINE.build(mechanism, Choice("rigid")).acceleration(0.0, q, v)
    for integrator in INTEGRATORS:
        model = ENGINE.build(mechanism, Choice("rigid", integrator, "none", 1e-2))
        model.acceleration(0.0, *other)
        assert (model.acceleration(0.0, q, v) == expected).all()


# Trajectories -----------------------------------------------------------------------------------------------------------


@linkages
def test_rigid_rk4_follows_the_exact_motion(mechanism):
    times = np.linspace(0.0, 0.2, 5)
    exact, found = exact_trajectory(mechanism, times), trajectory(mechanism, times, step=5e-4)
    assert np.abs(found.q - exact.q).max() < 1e-7  # measured 7e-11 to 2e-8, mostly the step
    assert np.abs(found.v - exact.v).max() < 1e-5
    assert np.abs(found.a - exact.a).max() < 1e-4 * np.abs(exact.a).max()
    assert found.steps == 400


def test_default_softness_does_not_converge_with_the_step():
    mechanism, times = load("crank_slider", "paper"), [0.0, 0.5]
    exact = exact_trajectory(mechanism, times).q[-1]
    errors = {
        label: [np.abs(trajectory(mechanism, times, label, step=h).q[-1] - exact).max() for h in (2e-3, 1e-3)] for label in SOFTNESS
    }
    assert errors["default"][1] == pytest.approx(errors["default"][0], rel=0.05)
    assert errors["default"][1] > 1e-3
    assert errors["tuned"][1] < 0.5 * errors["tuned"][0]
    assert errors["rigid"][1] < errors["tuned"][1] < 1e-4 * errors["default"][1]


@pytest.mark.parametrize("integrator", ["euler", "implicitfast", "discrete"])
def test_single_step_integrators_are_of_first_order(integrator):
    mechanism, times = load("four_bar"), [0.0, 0.2]
    exact = exact_trajectory(mechanism, times).q[-1]
    coarse, fine = (np.abs(trajectory(mechanism, times, "rigid", integrator, h).q[-1] - exact).max() for h in (2e-3, 1e-3))
    assert 1.7 < coarse / fine < 2.3


def test_free_flight_is_a_parabola():
    times = np.array([0.0, 0.3, 1.0, 2.0])
    found = trajectory(document(PUCK), times, step=0.1)  # RK4 is exact for constant acceleration
    t = times[:, None]
    a = np.array([3.0 / 2, 1.0 / 2 - 2.0, 0.4 / 0.05])
    expected = [2.0, 1.0, 0.5] + [1.0, -1.0, 3.0] * t + a * t**2 / 2
    np.testing.assert_allclose(found.q, expected, rtol=0, atol=1e-12)  # rounding of 20 steps at 25 rad
    np.testing.assert_allclose(found.a, np.tile(a, (4, 1)), rtol=0, atol=1e-12)


def test_energy_is_kept_without_dampers():
    mechanism = load("crank_slider", "conservative")
    found = trajectory(mechanism, np.linspace(0.0, 1.0, 21))
    energy = Evaluator(mechanism).energy(found.q, found.v)
    assert np.ptp(energy) < 1e-6 * np.ptp(Evaluator(mechanism).applied.potential(found.q))  # measured 3e-9


def test_angles_are_not_wrapped():
    mechanism = load("crank_slider", "paper")
    times = np.linspace(0.0, 1.5, 1501)
    found = trajectory(mechanism, times)
    theta, speed = found.q[:, 2], found.v[:, 2]
    assert theta[-1] < -4 * np.pi
    assert np.abs(np.diff(theta)).max() <= 1.1 * np.abs(speed).max() * 1e-3


@pytest.mark.parametrize("integrator", INTEGRATORS)
def test_both_loops_give_the_same_bits(integrator):
    times = [0.0, 0.05, 0.0777, 0.1]
    a, b = (trajectory(load("four_bar"), times, "tuned", integrator, 1e-3, native) for native in (True, False))
    assert a.steps == b.steps == 50 + 28 + 23
    assert (a.q == b.q).all()
    assert (a.v == b.v).all()


def test_a_run_can_be_repeated_and_a_single_time_is_the_start():
    mechanism = load("four_bar")
    model = ENGINE.build(mechanism, Choice("rigid"))
    runs = []
    for times in ([0.0, 0.1], [0.0], [0.0, 0.1]):
        model.prepare(np.array(times))
        model.run()
        runs.append(model.read())
    assert (runs[0].q == runs[2].q).all()
    assert runs[1].steps == 0
    np.testing.assert_allclose(runs[1].q[0], mechanism.q0, rtol=0, atol=1e-12)  # assembly closes to 1e-10, in fact to rounding
    assert np.abs(runs[1].a[0] - gauss(Evaluator(mechanism).terms(0.0, mechanism.q0, mechanism.v0)).a).max() < 1e-6


# Refusals ---------------------------------------------------------------------------------------------------------------


def test_what_cannot_be_modelled_is_skipped_with_a_reason_and_without_the_library(monkeypatch):
    monkeypatch.setitem(sys.modules, "mujoco", None)
    engine = get("mujoco")
    assert "prescribed" in engine.skip(load("four_bar", "driven"), Choice())
    assert "slide" in engine.skip(document(LOOP_OF_SLIDES), Choice())
    assert "axis_on_a_carried_link" in engine.skip(document(LOADED, "axis"), Choice())
    assert "turned_with_a_third" in engine.skip(document(LOADED, "frame"), Choice())
    assert engine.skip(document(LOADED, "all"), Choice()) is None
    with pytest.raises(ImportError):
        engine.version()


def test_what_is_skipped_is_not_built_either():
    with pytest.raises(RunFailure, match="axis") as failure:
        ENGINE.build(document(LOADED, "axis"), Choice())
    assert failure.value.status is Status.SKIP


def test_a_run_that_leaves_the_numbers_is_refused_without_reset_or_log_file(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    mechanism = copy.copy(load("crank_slider", "paper"))
    object.__setattr__(mechanism, "v0", 1e9 * gauss(Evaluator(mechanism).terms(0.0, mechanism.q0, mechanism.v0)).a)
    model = ENGINE.build(mechanism, Choice("tuned", "rk4", "none", 0.1))
    model.prepare(np.array([0.0, 1.0, 2.0]))
    model.run()
    assert not list(tmp_path.iterdir())
    assert mujoco.get_mju_user_warning() is None
    with pytest.raises(RunFailure, match=r"MuJoCo: .*unstable") as failure:
        model.read()
    assert failure.value.status in (Status.NAN, Status.WARNING)


def test_warnings_and_lost_time_are_refused():
    model = ENGINE.build(load("four_bar"), Choice())
    model.prepare(np.array([0.0, 0.1]))
    model.run()
    model.read()
    model.data.time -= 1e-3
    with pytest.raises(RunFailure, match="clock"):
        model.read()
    model.data.warning[mujoco.mjtWarning.mjWARN_CNSTRFULL].number += 1
    with pytest.raises(RunFailure, match="warned") as failure:
        model.read()
    assert failure.value.status is Status.WARNING


def test_version_names_the_library():
    assert ENGINE.version() == f"mujoco {mujoco.__version__}"
