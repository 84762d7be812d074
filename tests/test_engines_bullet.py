"""Bullet's adapter, with stand-ins that take the steps of PyBullet; see also `test_engines_elsewhere.py`.

Tests that need PyBullet are skipped without its environment, in CI too.
"""

import numpy as np
import pytest

import gauss_bench
from gauss_bench.engines.bullet.accelerations import Accelerations
from gauss_bench.engines.bullet.adapter import Bullet, step_through
from gauss_bench.engines.bullet.translate import body_forces, joint_forces
from gauss_bench.engines.bullet.world import STRONGEST, BodyWorld, TreeWorld, list_joints
from gauss_bench.engines.shared import drivers_by_coordinate, open_tree
from gauss_bench.engines.tree import spanning_tree, turning
from gauss_bench.integrate.fixed_step import Stretch
from gauss_bench.linkage.load import load
from gauss_bench.mechanism.coordinates import rotate
from gauss_bench.mechanism.evaluate import Evaluator
from gauss_bench.mechanism.motion_laws import MotionLaw
from gauss_bench.mechanism.spaces import angles, places
from gauss_bench.reference.build import random_states
from tests.conftest import everything
from tests.engine_runs import linkage, relative_error

ENGINE = "bullet"


@pytest.mark.usefixtures("elsewhere")
def test_the_damping_that_bullet_ships_is_found_as_a_force_that_the_linkage_has_not():
    run = gauss_bench.simulate("crank_slider", "bullet", "paper", "damping=0.04", at=[0.0, 0.5])
    assert run.status == "invalid"
    assert "accelerations off by" in run.message


@pytest.mark.parametrize("name", ["crank_slider", "shaper", "swinging_block", "loaded", "puck", "everything"])
def test_the_joints_of_the_tree_put_every_link_where_the_linkage_has_it(name, rng):
    mechanism = everything() if name == "everything" else linkage(name)
    tree = spanning_tree(mechanism)
    y = rng.uniform(-2.0, 2.0, tree.n)
    q, _, _ = tree.absolute(y, y, y)
    frames = [(np.zeros(2), np.zeros(()))]  # place and angle of the base, then of every joint
    centres = []
    for joint, value in zip(list_joints(mechanism, tree), y, strict=True):
        place, angle = frames[joint.parent]
        along = np.array(joint.origin[:2]) + (0.0 if joint.turns else value * np.array(joint.axis[:2]))
        frames.append((place + rotate(along, angle), angle + (value if joint.turns else 0.0)))
        centres.append(frames[-1][0] + rotate(np.array(joint.centre[:2]), frames[-1][1]))
    at = [b.at + (2 if b.kind == "free" else 0) for b in tree.branches]
    links = [b.link for b in tree.branches]
    np.testing.assert_allclose([centres[k] for k in at], places(q)[links], atol=1e-14)
    turned = np.array([frames[k + 1][1] for k in at]) + turning(tree).constants[links]
    np.testing.assert_allclose(turned, angles(q)[links], atol=1e-14)


class StandIn:
    """Steps on velocities as Bullet takes them, computed in numpy from the suite's own terms."""

    def __init__(self, mechanism, tree):
        self.tree, self.evaluator = tree, Evaluator(mechanism)
        self.joint_rows = self.evaluator.constraints.joint_rows

    def set_step(self, step):
        self.h = step

    def set_residual(self, residual):
        pass

    def put(self, y, dy):
        self.y, self.dy = y, dy
        self.rates = {}

    def drive(self, joint, rate):
        self.rates[joint] = rate

    def state(self):
        return self.y, self.dy

    def step(self, tau):
        """Let velocities follow from the forces, and project them onto those that closures and motors allow: J v = b."""
        tree, own = self.tree, open_tree(self.evaluator, self.tree, self.y, self.dy)
        v = self.dy + self.h * np.linalg.solve(own.mass, own.forces)
        speeds = tree.unit_speeds(self.y)  # (n, 3 links)
        rows = [self.evaluator.constraints(0.0, own.q, 0 * own.q).J[: self.joint_rows] @ speeds.T]
        rows += [np.eye(tree.n)[[joint]] for joint in self.rates]
        J, b = np.vstack(rows), np.concatenate([np.zeros(self.joint_rows), [*self.rates.values()]])
        response = np.linalg.solve(own.mass, J.T)
        self.dy = v - response @ np.linalg.lstsq(J @ response, J @ v - b, rcond=1e-11)[0]
        self.y = self.y + self.h * self.dy


@pytest.mark.parametrize(
    ("name", "scenario"), [("four_bar", "torque"), ("crank_slider", "driven"), ("four_bar", "cycloid"), ("parallelogram", "torque")]
)
def test_steps_on_velocities_alone_show_the_accelerations_of_closed_loops(name, scenario):
    mechanism = load(name, scenario)
    tree = spanning_tree(mechanism)
    laws = {at: driver.law for at, driver in drivers_by_coordinate(mechanism, tree).items()}
    world = StandIn(mechanism, tree)
    found = Accelerations(world, joint_forces(mechanism, tree), laws)
    states = random_states(mechanism, 3)
    for t, q, v, a in zip(states.t, states.q, states.v, states.a, strict=True):
        y, dy = tree.relative(q, v)
        assert relative_error(tree.absolute(y, dy, found(t, y, dy))[2], a) < 1e-9


class Clock(StandIn):
    """A world of one joint, which moves at the rate of its motor; `seen` lists the forces that it is given."""

    def __init__(self):
        self.rates, self.seen = {0: 0.0}, list[float]()
        self.y = self.dy = np.zeros(1)

    def step(self, tau):
        self.y = self.y + self.h * self.rates[0]
        self.seen += tau


def test_a_driven_joint_is_where_its_law_has_it_after_every_step():
    law = MotionLaw("square", lambda t: (t * t, 2 * t, 2 + 0 * t))
    world = Clock()
    y, dy = np.full((3, 1), np.nan), np.full((3, 1), np.nan)
    plan = [Stretch(0.0, 2, 0.1, np.inf, 1), Stretch(0.2, 1, 0.4, np.inf, None), Stretch(0.6, 2, 0.2, np.inf, 2)]
    step_through(world, lambda t, y, dy: np.array([t]), {0: law}, plan, (y, dy))
    np.testing.assert_allclose(y[1:, 0], [0.2**2, 1.0**2], atol=1e-15)
    np.testing.assert_allclose(world.seen, [0.0, 0.1, 0.2, 0.6, 0.8], atol=1e-15)  # forces at the beginning of each step


class Recorder:
    """A stand-in for PyBullet, which records every call and its keywords."""

    def __init__(self):
        self.calls = []

    def __getattr__(self, name):
        if name.isupper():
            return name

        def record(*arguments, **keywords):
            self.calls.append((name, keywords))
            return len(self.calls)

        return record

    def of(self, name):
        return [keywords for called, keywords in self.calls if called == name]


def tree_world(recorder):
    mechanism = load("four_bar", "torque")
    return TreeWorld(recorder, mechanism, spanning_tree(mechanism), Bullet.settings["default"])


def test_masses_are_set_in_calls_that_set_nothing_which_would_send_them_to_the_base():
    for build in (tree_world, lambda x: BodyWorld(x, load("four_bar", "torque"), Bullet.settings["default"])):
        recorder = Recorder()
        build(recorder)
        changes = recorder.of("changeDynamics")
        for keyword in ("linearDamping", "angularDamping", "maxJointVelocity"):
            assert any(keyword in x for x in changes)
            assert not any(keyword in x and "mass" in x for x in changes)
        assert sum("mass" in x for x in changes) == 3  # one call for each link


def test_closures_may_exert_the_same_impulse_in_a_step_of_any_length():
    recorder = Recorder()
    world = tree_world(recorder)
    for step in (1e-3, 1e-15):
        world.set_step(step)
        assert recorder.of("changeConstraint")[-1]["maxForce"] * step == pytest.approx(STRONGEST)


def test_free_bodies_are_given_the_linkages_forces_without_gravity():
    mechanism = load("four_bar", "torque")
    q, v = mechanism.q0, mechanism.v0 + 1.0
    own = Evaluator(mechanism).applied
    np.testing.assert_allclose(body_forces(mechanism)(0.0, q, v), own.generalised(q, v, 0.0) - own.gravity, atol=1e-15)
