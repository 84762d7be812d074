"""Exudyn as an engine: exact models, honest accelerations, second-order motion, and failures that are told."""

import sys
import tomllib
from dataclasses import replace

import numpy as np
import pytest

from gauss_bench.engines.base import Choice
from gauss_bench.engines.exudyn import SETTINGS, Exudyn, ExudynModel, Readout, System, simulation_settings, verify
from gauss_bench.engines.native import Native
from gauss_bench.formulations.gauss import gauss
from gauss_bench.mechanism.closure import gauss_newton
from gauss_bench.mechanism.evaluate import Evaluator
from gauss_bench.mechanism.load import load, load_document
from gauss_bench.mechanism.model import Mechanism
from gauss_bench.trajectory import RunFailure, Status, Trajectory

exu = pytest.importorskip("exudyn")

LINKAGES = {"crank_slider": "paper", "four_bar": "torque", "six_bar": "torque", "eight_bar": "torque"}
INTEGRATORS = ("generalized_alpha", "trapezoidal_index2")

# Three equal cranks carry a coupler: the third takes nothing away from the motion, one joint row too many.
PARALLELOGRAM = """
format = "planar-linkage/1"
name = "three_cranks"
crank = "one"
[ground]
points = { A = [0.0, 0.0], B = [0.5, 0.0], C = [0.2, 0.2] }
[links.one]
points = { G = [0.0, 0.0], P = [0.2, 0.0] }
bars = [["G", "P"]]
mass = 0.3
[links.two]
points = { G = [0.0, 0.0], P = [0.2, 0.0] }
bars = [["G", "P"]]
mass = 0.4
[links.three]
points = { G = [0.0, 0.0], P = [0.2, 0.0] }
bars = [["G", "P"]]
mass = 0.5
[links.coupler]
points = { A = [0.0, 0.0], B = [0.5, 0.0], C = [0.2, 0.2] }
bars = [["A", "B"]]
mass = 1.0
[joints]
A = { type = "revolute", at = ["ground.A", "one.G"] }
B = { type = "revolute", at = ["ground.B", "two.G"] }
C = { type = "revolute", at = ["ground.C", "three.G"] }
a = { type = "revolute", at = ["one.P", "coupler.A"] }
b = { type = "revolute", at = ["two.P", "coupler.B"] }
c = { type = "revolute", at = ["three.P", "coupler.C"] }
[assembly]
sketch = { a = [0.1, 0.17], b = [0.6, 0.17], c = [0.3, 0.37] }
[scenarios.swing]
start = { crank_deg = 60.0, speed = 2.0 }
duration = 1.0
"""

# Every kind of force and joint: a pendulum of two links with a slide on the second, a third link at their pin, and a free plate.
ALL_KINDS = """
format = "planar-linkage/1"
name = "all_kinds"
gravity = [1.0, -9.0]
[ground]
points = { O = [0.1, 0.2], W = [1.0, -0.3] }
[links.arm]
points = { O = [0.0, 0.0], T = [0.5, 0.1] }
com = [0.2, 0.05]
mass = 1.2
inertia = 0.03
[links.rail]
points = { T = [0.0, 0.0], L = [0.2, 0.1], E = [0.6, 0.0] }
com = [0.3, 0.02]
mass = 0.8
inertia = 0.02
[links.block]
points = { K = [0.02, -0.03], H = [0.1, 0.2] }
mass = 0.6
inertia = 0.01
[links.side]
points = { T = [0.0, 0.0], S = [0.3, 0.0] }
bars = [["T", "S"]]
mass = 0.4
[links.plate]
points = { M = [0.0, 0.0], N = [0.2, 0.1] }
com = [0.1, 0.0]
mass = 0.9
inertia = 0.02
[joints]
O = { type = "revolute", at = ["ground.O", "arm.O"] }
T = { type = "revolute", at = ["arm.T", "rail.T", "side.T"] }
slide = { type = "prismatic", guide = "rail.L", block = "block.K", angle_deg = 25.0, block_angle_deg = -40.0, offset = 0.03 }
[forces]
motor = { type = "torque", link = "side", reaction = "arm", value = 0.7 }
world = { type = "force", point = "plate.N", value = [0.4, -0.6] }
body = { type = "force", point = "plate.N", frame = "body", value = [0.3, 0.5] }
other = { type = "force", point = "block.H", frame = "arm", value = [-0.8, 0.2] }
spring = { type = "spring_damper", between = ["side.S", "block.H"], k = 20.0, c = 0.6, rest = 0.15 }
anchor = { type = "spring_damper", between = ["ground.W", "plate.M"], k = 6.0, rest = 0.0 }
level = { type = "axis_spring_damper", point = "plate.M", origin = "ground.W", angle_deg = 180.0, k = 5.0, c = 0.2, rest = 0.1 }
slope = { type = "axis_spring_damper", point = "plate.N", origin = "ground.W", angle_deg = 35.0, k = 5.0, c = 0.2, rest = 0.1 }
along = { type = "axis_spring_damper", point = "block.H", origin = "rail.E", angle_deg = 205.0, k = 9.0, c = 0.3, rest = 0.2 }
back = { type = "axis_spring_damper", point = "rail.E", origin = "block.H", angle_deg = -40.0, k = 9.0, c = 0.3, rest = 0.2 }
torsion = { type = "rotational_spring_damper", links = ["arm", "rail"], k = 1.5, c = 0.05, rest_deg = 20.0 }
hinge = { type = "rotational_spring_damper", links = ["plate", "ground"], k = 0.5, c = 0.02, rest_deg = -30.0 }
pins = { type = "joint_damping", joint = "T", c = 0.04 }
rub = { type = "joint_damping", joint = "slide", c = 0.7 }
across = { type = "axis_spring_damper", point = "block.H", origin = "rail.E", angle_deg = 90.0, k = 9.0 }
[assembly]
angles = { arm = 0.2, rail = -0.5, side = 1.1, plate = 0.4 }
sketch = { "plate.M" = [0.8, -0.5], "block.K" = [0.9, 0.2] }
[scenarios.all]
duration = 0.3
forces = [
  "motor", "world", "body", "other", "spring", "anchor", "level", "slope", "along", "back", "torsion", "hinge", "pins", "rub",
]
[scenarios.all.start]
angles = { arm = 0.2, rail = -0.5, side = 1.1, plate = 0.4 }
speeds = { arm = 1.5, rail = -2.0, side = 3.0, plate = 2.0 }
slides = { slide = 0.25 }
slide_speeds = { slide = -0.4 }
points = { "plate.M" = [0.8, -0.5] }
point_velocities = { "plate.M" = [0.3, 0.9] }
"""


def document(text: str) -> dict:
    return tomllib.loads(text)


def random_states(mechanism: Mechanism, count: int = 200, fastest: float = 30.0) -> list:
    """Closed states at random crank angles with crank speeds up to `fastest` [rad/s]."""
    evaluator, crank = Evaluator(mechanism), 3 * mechanism.crank + 2
    rest, unit = np.zeros(mechanism.n), np.eye(mechanism.n)[crank]

    def close(q, target):
        def residual(x):
            rows = evaluator.terms(0.0, x, rest)
            return np.append(rows.phi, x[crank] - target), np.vstack([rows.J, unit])

        return gauss_newton(q, residual)[0]

    ring = [mechanism.q0]
    for _ in range(71):
        ring.append(close(ring[-1], ring[-1][crank] + np.radians(5.0)))
    rng, states = np.random.default_rng(1), []
    for _ in range(count):
        near = ring[rng.integers(len(ring))]
        q = close(near, near[crank] + np.radians(rng.uniform(0.0, 5.0)))
        J = evaluator.terms(0.0, q, rest).J
        rates = np.append(np.zeros(len(J)), rng.uniform(-fastest, fastest))
        states.append((q, np.linalg.lstsq(np.vstack([J, unit]), rates, rcond=None)[0]))
    return states


def acceleration_errors(mechanism: Mechanism, settings: str, states: list) -> np.ndarray:
    model, evaluator = Exudyn().build(mechanism, Choice(settings, INTEGRATORS[0])), Evaluator(mechanism)
    errors = []
    for q, v in states:
        true = gauss(evaluator.terms(0.0, q, v)).a
        errors.append(np.abs(model.acceleration(0.0, q, v) - true).max() / np.abs(true).max())
    return np.array(errors)


def run(mechanism: Mechanism, times, integrator: str = INTEGRATORS[0], step: float = 1e-3, settings: str = "tuned") -> Trajectory:
    model = Exudyn().build(mechanism, Choice(settings, integrator, step=step))
    model.prepare(np.asarray(times, dtype=float))
    model.run()
    return model.read()


def truth(mechanism: Mechanism, times) -> Trajectory:
    model = Native("gauss").build(mechanism, Choice("default", "dop853"))
    model.prepare(np.asarray(times, dtype=float))
    model.run()
    return model.read()


@pytest.fixture(scope="module")
def linkages() -> dict[str, Mechanism]:
    return {name: load(name, scenario) for name, scenario in LINKAGES.items()}


def test_default_settings_are_the_shipped_ones(linkages):
    shipped = exu.SimulationSettings()
    own = simulation_settings(linkages["four_bar"], Choice("default", "generalized_alpha"))
    assert shipped.timeIntegration.adaptiveStep, "the one deviation that the settings admit"
    own.timeIntegration.adaptiveStep = True
    own.solution.file.write = True  # nothing but speed
    assert str(own) == str(shipped)


@pytest.mark.parametrize("name", LINKAGES)
def test_tuned_acceleration_is_exact_but_for_fourth_order_differences(name, linkages):
    errors = acceleration_errors(linkages[name], "tuned", random_states(linkages[name]))
    assert np.median(errors) < 1e-11, "rounding 1e-16 over a relative step of 1e-3, times the conditioning of a linkage"
    assert errors.max() < 1e-9, "the worst transmission angle costs two or three digits more"


@pytest.mark.parametrize("name", LINKAGES)
def test_default_acceleration_has_the_error_of_its_own_differencing(name, linkages):
    states = random_states(linkages[name], 50)
    moving = acceleration_errors(linkages[name], "default", states)
    assert moving.max() < 1e-4, "one-sided differences with relative epsilon 1e-7 leave about 1e-6 at the worst"
    resting = acceleration_errors(linkages[name], "default", [(q, 0 * v) for q, v in states])
    assert resting.max() < 1e-10, "at rest there is nothing to differentiate"
    assert np.median(moving) > 100 * np.median(resting)


@pytest.mark.parametrize("integrator", INTEGRATORS)
@pytest.mark.parametrize("name", LINKAGES)
def test_halving_the_step_quarters_the_error(name, integrator, linkages):
    times = [0.0, 0.2]
    end = truth(linkages[name], times).q[-1]
    coarse, fine = (np.abs(run(linkages[name], times, integrator, h).q[-1] - end).max() for h in (1e-3, 5e-4))
    assert 3.5 < coarse / fine < 4.5, "both integrators are of order two; the next order is far smaller at these steps"


@pytest.mark.parametrize("settings", SETTINGS)
@pytest.mark.parametrize("integrator", INTEGRATORS)
def test_crank_slider_of_the_paper_at_one_second(integrator, settings, linkages):
    times = np.linspace(0.0, 1.0, 5)
    found, true = run(linkages["crank_slider"], times, integrator, 1e-4, settings), truth(linkages["crank_slider"], times)
    assert true.q[-1, 2] < -4 * np.pi, "two turns: wrapped angles would be far off"
    assert np.abs(found.q - true.q).max() < 1e-4, "2.7e-5 and 1.0e-5 measured; a hundredth of what 1e-3 leaves"
    assert np.abs(found.v - true.v).max() < 1e-3
    assert np.abs(found.a - true.a).max() < 0.1, "1e-3 of 100 m/s^2: the accelerations are those of the end of a step"
    assert found.steps == 10_000


def test_index_three_keeps_positions_and_index_two_keeps_velocities(linkages):
    mechanism = linkages["four_bar"]
    rows = {}
    for integrator in INTEGRATORS:
        end = run(mechanism, [0.0, 0.5], integrator)
        terms = Evaluator(mechanism).terms(0.0, end.q[-1], end.v[-1])
        rows[integrator] = np.abs(terms.phi).max(), np.abs(terms.phi_dot).max()
    assert rows["generalized_alpha"][0] < 1e-10, "to the tolerance of the Newton iteration"
    assert rows["trapezoidal_index2"][1] < 1e-8, "the same, divided by the step"
    assert rows["generalized_alpha"][1] > 100 * rows["trapezoidal_index2"][1], "what is not enforced drifts"
    assert rows["trapezoidal_index2"][0] > 100 * rows["generalized_alpha"][0]


@pytest.mark.parametrize("integrator", INTEGRATORS)
def test_recording_does_not_change_the_motion(integrator, linkages):
    mechanism = linkages["six_bar"]
    few, many = run(mechanism, [0.0, 0.2], integrator), run(mechanism, np.linspace(0.0, 0.2, 41), integrator)
    for name in "qva":
        assert np.array_equal(getattr(few, name)[[0, -1]], getattr(many, name)[[0, -1]])
    middle = run(mechanism, [0.0, 0.1], integrator)
    assert np.abs(many.q[20] - middle.q[-1]).max() < 1e-12, "a sample stands for the end of its step"


@pytest.mark.parametrize("integrator", INTEGRATORS)
def test_samples_off_the_grid_of_steps_are_met(integrator, linkages):
    times = [0.0, 0.0707, 0.1, 0.10012, 0.2]
    found, true = run(linkages["crank_slider"], times, integrator), truth(linkages["crank_slider"], times)
    assert found.steps == 71 + 30 + 1 + 100
    single = np.abs(run(linkages["crank_slider"], [0.0, 0.2], integrator).q[-1] - true.q[-1]).max()
    assert np.abs(found.q - true.q).max() < 2 * single, "restarts cost no more than the truncation error itself"


def test_a_single_time_is_the_start(linkages):
    mechanism = linkages["eight_bar"]
    start = run(mechanism, [0.0])
    assert np.array_equal(start.q[0], mechanism.q0)
    assert np.array_equal(start.v[0], mechanism.v0)
    true = gauss(Evaluator(mechanism).terms(0.0, mechanism.q0, mechanism.v0)).a
    assert np.abs(start.a[0] - true).max() < 1e-9 * np.abs(true).max(), "at rest Exudyn's own accelerations are exact"
    assert start.steps == 0


def test_a_model_can_be_run_again(linkages):
    model = Exudyn().build(linkages["four_bar"], Choice("default", "generalized_alpha", step=1e-3))
    ends = []
    for times in ([0.0, 0.1], [0.0, 0.033, 0.1], [0.0, 0.1]):
        model.prepare(np.array(times))
        model.acceleration(0.0, model.mechanism.q0, np.zeros(model.mechanism.n))  # a look elsewhere, between the two
        model.prepare(np.array(times))
        model.run()
        ends.append(model.read().q[-1])
    assert np.array_equal(ends[0], ends[2])


@pytest.mark.parametrize("settings", SETTINGS)
def test_redundant_rows_leave_the_motion_right(settings):
    mechanism = load_document(document(PARALLELOGRAM))
    assert (mechanism.dof, mechanism.redundant) == (1, 1)
    limit = {"default": 1e-4, "tuned": 1e-9}[settings]  # as for the linkages without redundant rows
    assert acceleration_errors(mechanism, settings, random_states(mechanism, 50)).max() < limit
    reference = Native("gauss").build(mechanism, Choice("default", "rk4", "projection", 1e-3))
    reference.prepare(np.array([0.0, 0.5]))
    reference.run()
    for integrator in INTEGRATORS:
        error = np.abs(run(mechanism, [0.0, 0.5], integrator, 1e-3, settings).q[-1] - reference.read().q[-1]).max()
        assert error < 5e-4, "1.2e-4 measured: h^2 = 1e-6 at ten radians per second; a lost row changes the motion by 0.1"


def test_every_kind_of_force_and_joint_is_exact():
    mechanism = load_document(document(ALL_KINDS))
    assert Exudyn().skip(mechanism, Choice()) is None
    assert acceleration_errors(mechanism, "tuned", [(mechanism.q0, mechanism.v0)])[0] < 1e-11
    times = [0.0, 0.1, 0.3]
    true = truth(mechanism, times)
    for integrator in INTEGRATORS:
        found = run(mechanism, times, integrator)
        assert np.abs(found.q - true.q).max() < 1e-4, "h^2 at speeds of a few radians per second; forces matter from 1e-2 on"
    without = truth(replace(mechanism, forces=()), times)
    assert np.abs(without.q - true.q).max() > 0.01


@pytest.mark.parametrize("force", document(ALL_KINDS)["scenarios"]["all"]["forces"])
def test_each_force_alone_passes_and_its_absence_is_noticed(force):
    content = document(ALL_KINDS)
    content["scenarios"]["all"]["forces"] = [force]
    mechanism = load_document(content)
    Exudyn().build(mechanism, Choice("tuned", "generalized_alpha"))  # compares all terms with the linkage's
    bare = System(replace(mechanism, forces=()))
    with pytest.raises(RunFailure, match="applied forces") as caught:
        verify(bare, Readout(bare), Evaluator(mechanism), 0.5)
    assert caught.value.status is Status.ERROR


def test_a_missing_joint_or_a_wrong_mass_is_noticed(linkages):
    mechanism = linkages["four_bar"]
    heavy = replace(mechanism.links[0], mass=2 * mechanism.links[0].mass)
    for wrong, words in (
        (replace(mechanism, joints=mechanism.joints[1:]), "degrees of freedom"),
        (replace(mechanism, links=(heavy, *mechanism.links[1:]), gravity=np.zeros(2)), "mass matrix"),
    ):
        system = System(replace(wrong, dof=mechanism.dof))
        system.mechanism = mechanism
        with pytest.raises(RunFailure, match=words):
            verify(system, Readout(system), Evaluator(replace(mechanism, gravity=wrong.gravity)), 0.3)


def test_what_cannot_be_modelled_is_skipped_without_the_library(monkeypatch):
    monkeypatch.setitem(sys.modules, "exudyn", None)  # importing it now fails
    engine, choice = Exudyn(), Choice("default", "generalized_alpha")
    assert "motion law" in engine.skip(load("four_bar", "driven"), choice)
    content = document(ALL_KINDS)
    content["scenarios"]["all"]["forces"] = ["across"]
    assert "across" in engine.skip(load_document(content), choice)
    content["forces"]["anchor"] |= {"c": 0.5, "between": ["ground.O", "arm.O"]}
    content["scenarios"]["all"]["forces"] = ["anchor"]
    assert "coincide" in engine.skip(load_document(content), choice)
    heading = np.degrees(np.arctan2(0.9, 0.3) - 0.4)  # of the start's velocity, in the plate's frame
    content["constraints"] = {"skate": {"type": "knife_edge", "point": "plate.M", "angle_deg": heading}}
    content["scenarios"]["all"]["forces"] = []
    assert "knife" in engine.skip(load_document(content), choice)
    assert engine.skip(load("crank_slider", "paper"), choice) is None


def test_the_skipped_axis_spring_would_indeed_be_wrong():
    content = document(ALL_KINDS)
    content["scenarios"]["all"]["forces"] = ["across"]
    with pytest.raises(RunFailure, match="applied forces"):
        Exudyn().build(load_document(content), Choice("tuned", "generalized_alpha"))


def test_a_step_too_large_for_the_newton_iteration_is_told(linkages):
    with pytest.raises(RunFailure, match=r"t = 0\.\d+ s: Exudyn gave up .*smaller step") as caught:
        run(linkages["six_bar"], [0.0, 1.0], step=1e-2)
    assert caught.value.status is Status.NOT_CONVERGED
    assert "python" not in str(caught.value).lower(), "no place in a file"


def prepared(mechanism: Mechanism) -> ExudynModel:
    model = Exudyn().build(mechanism, Choice("tuned", "generalized_alpha", step=1e-3))
    model.prepare(np.array([0.0, 0.05]))
    model.run()
    return model


def test_states_are_judged_whatever_the_return_value_was(linkages):
    model = prepared(linkages["four_bar"])
    model.q[-1, 0] += 0.2  # a crank torn off its pin
    with pytest.raises(RunFailure, match="open") as caught:
        model.read()
    assert caught.value.status is Status.DIVERGED
    model = prepared(linkages["four_bar"])
    model.v[-1, 0] = np.nan
    with pytest.raises(RunFailure, match="not finite") as caught:
        model.read()
    assert caught.value.status is Status.NAN


def test_warnings_that_exudyn_prints_are_heard(linkages):
    model = prepared(linkages["four_bar"])
    exu.Print("WARNING: something is odd")
    with pytest.raises(RunFailure, match="something is odd") as caught:
        model.read()
    assert caught.value.status is Status.WARNING


def test_nothing_is_printed_and_no_file_is_left(capfd, tmp_path, monkeypatch, linkages):
    monkeypatch.chdir(tmp_path)
    run(linkages["four_bar"], [0.0, 0.05])
    assert capfd.readouterr().out == ""
    assert list(tmp_path.iterdir()) == []
