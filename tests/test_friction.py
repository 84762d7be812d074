"""Dry friction in joints against closed forms, its power, and the fixed point of loads and accelerations."""

import tomllib
from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import brentq

from gauss_bench import metrics
from gauss_bench.engines import get
from gauss_bench.engines.base import Choice
from gauss_bench.formulations import CONTROLS, FORMULATIONS
from gauss_bench.linkage.errors import LinkageError
from gauss_bench.linkage.load import built_in, load, load_document, merge
from gauss_bench.mechanism.coordinates import rate
from gauss_bench.mechanism.evaluate import Evaluator, UndeterminedLoads
from gauss_bench.mechanism.forces import Jammed
from gauss_bench.mechanism.model import Prismatic
from gauss_bench.reference.absolute import AbsoluteCoordinates
from gauss_bench.reference.build import build_reference, random_states
from gauss_bench.reference.minimal import MinimalCoordinate
from gauss_bench.trajectory import RunFailure, Status, Trajectory
from tests.conftest import DATA
from tests.engine_runs import document, ran

SOUND = sorted(FORMULATIONS.keys() - CONTROLS)
FILE = DATA / "friction.toml"
GRAVITY = 9.81


def crank_slider(scenario="torque", **mu):
    """The linkage with friction in all four joints; `mu` replaces coefficients by the forces' names."""
    return load_document(merge(document("friction"), {"forces": {name: {"mu": value} for name, value in mu.items()}}), scenario)


def rubbing(name, scenario, mu=0.1, radius=0.02, speed=0.5):
    """Any linkage of the suite, or of the tests' data, with friction in every joint of one scenario."""
    path = built_in().get(name, DATA / f"{name}.toml")
    document = tomllib.loads(path.read_text(encoding="utf-8"))
    for joint, entry in document["joints"].items():
        force = {"type": "coulomb_friction", "joint": joint, "mu": mu, "speed": speed}
        document["forces"][f"rub_{joint}"] = force | ({"radius": radius} if entry["type"] == "revolute" else {})
        document["scenarios"][scenario].setdefault("forces", []).append(f"rub_{joint}")
    return load_document(document, scenario)


def block(slope, mu, speed):
    """A block of 2 kg on a guide that falls at `slope` degrees, released at 1 m/s downwards; its point is not at its centre."""
    changes = {"joints": {"slope": {"angle_deg": -slope}}, "forces": {"rub": {"mu": mu, "speed": speed}}}
    return load_document(merge(document("small/block"), changes))


MASS, LENGTH = 1.3, 0.6


def pendulum(mu, radius, speed):
    """A uniform bar on a pin with friction, released 30 degrees below the horizontal."""
    return load_document(merge(document("small/rubbing_bar"), {"forces": {"rub": {"mu": mu, "radius": radius, "speed": speed}}}))


def run(mechanism, h=1e-3, t=1.0, name="gauss", times=None):
    every_millisecond = np.arange(round(t / 1e-3) + 1) * 1e-3
    samples = every_millisecond if times is None else times
    return ran(get(name), mechanism, samples, integrator="rk4", stabilization="projection", step=h)


# Closed forms -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", SOUND)
def test_a_block_slides_down_at_the_textbook_acceleration(name):
    slope, mu = np.radians(30.0), 0.3
    mechanism = block(30.0, mu, speed=1e-3)  # tanh(1000) is 1 to the last digit
    expected = GRAVITY * (np.sin(slope) - mu * np.cos(slope))
    found = run(mechanism, t=0.1, name=name)
    down = np.array([np.cos(slope), -np.sin(slope)])
    assert np.abs(found.a[:, :2] @ down - expected).max() < 1e-12  # rounding of accelerations of 10 m/s^2
    way = (found.q[:, :2] - found.q[0, :2]) @ down
    assert np.abs(way - (found.t + expected * found.t**2 / 2)).max() < 1e-12  # RK4 is exact for a parabola


@pytest.mark.parametrize(("theta", "w"), [(-0.4, 3.0), (-1.2, -5.0), (2.0, 0.3), (-np.pi / 2, 8.0)])
def test_a_pin_resists_by_the_force_it_carries_at_that_instant(theta, w):
    mu, radius, speed = 0.4, 0.1, 0.5
    mechanism = pendulum(mu, radius, speed)
    toward, across = np.array([np.cos(theta), np.sin(theta)]), np.array([-np.sin(theta), np.cos(theta)])

    def imbalance(alpha):
        """Moments about the pin, with the pin's force from the acceleration of the centre of mass."""
        pin = MASS * (LENGTH / 2 * (alpha * across - w**2 * toward) + [0.0, GRAVITY])
        torque = -mu * radius * np.linalg.norm(pin) * np.tanh(w / speed)
        return float(MASS * LENGTH**2 / 3 * alpha + MASS * GRAVITY * LENGTH / 2 * np.cos(theta) - torque)

    alpha = brentq(imbalance, -500.0, 500.0, xtol=1e-13)
    q = np.array([*(LENGTH / 2 * toward), theta])
    v = np.array([*(LENGTH / 2 * w * across), w])
    for name in SOUND:
        assert get(name).build(mechanism, Choice()).acceleration(0.0, q, v)[2] == pytest.approx(alpha, rel=1e-11)
    assert MinimalCoordinate(mechanism).acceleration(np.array([theta]), np.array([w]))[0] == pytest.approx(alpha, rel=1e-11)


def test_friction_works_on_the_relative_motion_of_its_pair_alone(rng):
    mechanism = rubbing("everything", "free")  # with a multiple pin, and a guide on a moving link
    friction = Evaluator(mechanism).friction
    q, v, u = rng.normal(size=(3, mechanism.n))
    works = u @ friction.directions(q, v)  # of each pair in the motion u, for a load of 1 N
    assert len(works) == 5
    for (f, pair), work in zip(friction.acting, works, strict=True):
        law = f.mu * (1.0 if isinstance(pair, Prismatic) else f.radius) * np.tanh(rate(pair.motion, q, v) / f.speed)
        assert work == pytest.approx(float(-law * rate(pair.motion, q, u)), abs=1e-14)


# The fixed point --------------------------------------------------------------------------------------------------------


def test_both_references_agree():
    mechanism = crank_slider()
    states = random_states(mechanism, 3)
    absolute = AbsoluteCoordinates(mechanism).acceleration(states.t, states.q, states.v)
    # the fixed point's 1e-13 times what is left of its contraction
    assert (np.abs(absolute - states.a).max(axis=1) < 1e-11 * np.abs(states.a).max(axis=1)).all()


@pytest.mark.parametrize("name", ["gauss", "lagrange"])
def test_a_linkage_that_jams_ends_with_a_sentence(name):
    mechanism = crank_slider(slideway=30.0)
    with pytest.raises(RunFailure, match="mu is too large for these joints, or they jam") as caught:
        run(mechanism, t=0.5, name=name)
    assert caught.value.status == Status.NOT_CONVERGED
    with pytest.raises(Jammed):
        build_reference(mechanism, 0.5)


def test_redundant_rows_leave_the_friction_undetermined_and_are_refused():
    mechanism = rubbing("parallelogram", "torque")
    for name in SOUND:
        with pytest.raises(RunFailure, match="redundant") as caught:
            get(name).build(mechanism, Choice())
        assert caught.value.status == Status.RANK_LOST
    motion = run(load("parallelogram", "torque"), t=0.01)
    for ask in (
        lambda: build_reference(mechanism, 0.1),
        lambda: random_states(mechanism, 3),
        lambda: metrics.reactions(Evaluator(mechanism), motion),
    ):
        with pytest.raises(UndeterminedLoads):
            ask()


# Files ------------------------------------------------------------------------------------------------------------------

FAULTS = tomllib.loads((DATA / "faults" / "linkages.toml").read_text(encoding="utf-8"))["friction"]


@pytest.mark.parametrize("name", FAULTS)
def test_a_fault_is_named_by_table_and_field(name):
    old, new, expected = (FAULTS[name][x] for x in ("text", "becomes", "said"))
    text = FILE.read_text(encoding="utf-8")
    assert old in text
    with pytest.raises(LinkageError) as caught:
        load_document(tomllib.loads(text.replace(old, new, 1)), "torque")
    assert any(expected in str(fault) for fault in caught.value.faults), caught.value.faults


def test_a_driven_crank_supplies_what_friction_dissipates_over_a_turn():
    mechanism = crank_slider("driven")
    evaluator = Evaluator(mechanism)
    true = build_reference(mechanism, 1.0)
    turn = Trajectory(true.t, true.q, true.v, true.a, 0)
    assert turn.t[-1] == 1.0
    torque = metrics.driving_forces(evaluator, turn)[:-1, 0]
    dissipated = -metrics.friction_power(evaluator, turn)[:-1].mean() * 1.0  # W over one turn of 1 s
    # mean values over the equal parts of a period: the change of energy drops out up to rounding
    assert torque.mean() * 2 * np.pi == pytest.approx(dissipated, rel=1e-11)
    assert dissipated > 0.1  # J
    free = replace(mechanism, frictions=())
    without = metrics.driving_forces(Evaluator(free), turn)[:-1, 0]
    assert np.abs(without.mean()) < 1e-12
