"""Metrics of motions with known drift, forces, energy and errors, and the limits of the judge."""

from dataclasses import replace

import numpy as np
import pytest

from gauss_bench import metrics
from gauss_bench.bench.cases import Case
from gauss_bench.bench.measure import measure
from gauss_bench.formulations import FORMULATIONS
from gauss_bench.linkage.load import load, load_document, merge
from gauss_bench.mechanism.evaluate import Evaluator
from gauss_bench.trajectory import Reference, Trajectory
from tests.engine_runs import document
from tests.synthetic import Clock, Costs, replace_engine

G = 9.81


def still(mechanism, times=None):
    """The start, held."""
    times = np.linspace(0.0, 1.0, 3) if times is None else times
    q = np.tile(mechanism.q0, (len(times), 1))
    return Trajectory(times, q, 0 * q, 0 * q, 1)


def on_a_guide(angle_deg, at=0.3, forces=()):
    """A block of 2 kg on a guide through the ground at an angle; its point on the guide lies at `at` from its centre of mass."""
    changes = {
        "links": {"block": {"points": {"K": [at, 0.0]}}},
        "joints": {"slope": {"angle_deg": angle_deg}},
        "forces": {"brake": {"type": "joint_damping", "joint": "slope", "c": 3.0}},
        "scenarios": {"slide": {"forces": [*forces], "start": {"slide_speeds": {"slope": 4.0}}}},
    }
    return load_document(merge(document("small/block"), changes))


def test_a_guide_carries_the_weight_and_its_moment_about_the_joint():
    """The centre lies 0.3 m to the left of the joint's point: its weight turns the block to the left, the guide to the right."""
    mechanism = on_a_guide(0.0)
    (force,) = metrics.joint_forces(Evaluator(mechanism), still(mechanism)).values()
    assert force["fx"] == pytest.approx(0.0, abs=1e-12)
    assert force["fy"] == pytest.approx(2.0 * G)
    assert force["moment"] == pytest.approx(-2.0 * G * 0.3)
    upright = on_a_guide(90.0)  # falling freely along it, the block needs no force from it and no moment
    falling = still(upright)
    falling.a[:, 1] = -G
    (force,) = metrics.joint_forces(Evaluator(upright), falling).values()
    assert [*force.values()] == pytest.approx([0.0] * len(force), abs=1e-12)


def hanging():
    """A bar of 3 kg and 1 m on a pin, horizontal, at rest."""
    bar, start = {"points": {"E": [1.0, 0.0]}, "mass": 3.0}, {"crank_deg": 0.0}
    changes = {"links": {"bar": bar}, "scenarios": {"swing": {"start": start, "forces": []}}}
    return load_document(merge(document("small/rubbing_bar"), changes))


def test_a_bar_let_go_hangs_on_a_quarter_of_its_weight():
    """A uniform bar turns with 3 g / 2 l, so that its centre falls with three quarters of g."""
    mechanism = hanging()
    a = Evaluator(mechanism).terms(0.0, mechanism.q0, mechanism.v0)
    let_go = replace(still(mechanism), a=np.tile(FORMULATIONS["gauss"](a).a, (3, 1)))
    assert let_go.a[0, 2] == pytest.approx(-1.5 * G)
    (force,) = metrics.joint_forces(Evaluator(mechanism), let_go).values()
    assert force["fy"] == pytest.approx(3.0 * G / 4)
    assert force["fx"] == pytest.approx(0.0, abs=1e-12)


def test_drift_is_the_gap_of_the_worst_joint_at_every_sample_of_a_run_of_any_length():
    """The bar's centre is moved by 3 mm and thrown at 0.2 m/s: its pin opens and parts by as much."""
    mechanism, off = hanging(), still(hanging())
    off.q[1, 0] += 3e-3
    off.v[2, 1] += 0.2
    off.a[0, 0] += 7.0
    found = metrics.drift(Evaluator(mechanism), off)
    assert found.position == pytest.approx([0.0, 3e-3, 0.0], abs=1e-15)
    assert found.velocity == pytest.approx([0.0, 0.0, 0.2], abs=1e-15)
    assert found.acceleration == pytest.approx([7.0, 0.0, 0.0], abs=1e-12)
    growing = np.linspace(0.0, 1e-3, 5001)
    long = still(mechanism, np.arange(5001) * 1e-3)
    long.q[:, 0] += growing
    assert metrics.drift(Evaluator(mechanism), long).position == pytest.approx(growing, abs=1e-15)


def test_energy_gained_from_nowhere_is_told_to_the_joule():
    """The bar is found 2 rad/s faster than it was: I w^2 / 2 about its pin, with I = m l^2 / 3, is 2 J."""
    mechanism, off = hanging(), still(hanging())
    off.v[-1] = [0.0, 1.0, 2.0]  # the centre at half a metre
    gained, bar = metrics.energy_error(Evaluator(mechanism), off)
    assert gained == pytest.approx([0.0, 0.0, 2.0])
    assert bar < 1e-12


def test_work_of_a_damper_is_no_error_of_the_energy():
    """A block that runs against a damper along its guide: v = v0 exp(-c t / m), and what it loses is work."""
    mechanism = on_a_guide(0.0, at=0.0, forces=["brake"])
    t = np.linspace(0.0, 1.0, 201)
    speed = 4.0 * np.exp(-1.5 * t)
    q, v, a = (np.zeros((len(t), 3)) for _ in range(3))
    q[:, 0], v[:, 0], a[:, 0] = (4.0 - speed) / 1.5, speed, -1.5 * speed
    gained, bar = metrics.energy_error(Evaluator(mechanism), Trajectory(t, q, v, a, 200))
    assert np.abs(gained).max() < 1e-9  # of 15 J that are lost
    assert np.abs(gained).max() <= bar < 1e-7
    coarse = slice(None, None, 40)
    gained, bar = metrics.energy_error(Evaluator(mechanism), Trajectory(t[coarse], q[coarse], v[coarse], a[coarse], 5))
    assert 1e-9 < np.abs(gained).max() <= bar  # honest where samples are few


def test_an_acceleration_is_judged_relative_to_the_largest_true_one():
    true = np.array([[10.0, -200.0, 3.0], [0.0, 0.0, 0.0], [1.0, 1.0, 1.0]])
    off = np.array([[0.0, 0.0, 2.0], [0.5, 0.0, 0.0], [0.0, -0.25, 0.1]])
    assert metrics.relative_acceleration_error(true + off, true) == pytest.approx([0.01, 0.5, 0.25])


def test_an_order_is_told_only_above_ten_times_the_floor():
    steps, errors = np.array([4e-3, 2e-3, 1e-3]), np.array([16e-6, 1e-6, 0.5e-6])
    assert metrics.observed_order(steps, errors, np.full(3, 1e-9))[1:] == pytest.approx([4.0, 1.0])
    assert metrics.observed_order(steps, errors, np.full(3, 0.49e-7))[1:] == pytest.approx([4.0, 1.0])
    floors = metrics.observed_order(steps, errors, np.full(3, 0.51e-7))
    assert floors[1] == pytest.approx(4.0)
    assert np.isnan(floors[2])
    assert np.isnan(metrics.observed_order(steps, errors, np.full(3, 2e-7))[1:]).all()
    assert np.isnan(metrics.observed_order(steps, np.array([16e-6, np.nan, 1e-6]), np.zeros(3))).all()


def test_errors_are_the_largest_of_each_link_and_of_the_cranks_angle():
    mechanism = load("four_bar", "torque")
    true = still(mechanism, np.array([0.0, 0.5, 1.0]))
    zeros = np.zeros(3)
    reference = Reference(
        *(true.t, true.q, true.v, true.a),
        *(np.full(3, 1e-12), np.full(3, 2e-12), zeros),
        *(np.full(3, 3e-12), np.full(3, 5e-12), zeros),
        "",
    )
    finer = np.arange(101) * 0.01
    q, v = np.tile(true.q[0], (101, 1)), np.zeros((101, 9))
    q[50, 2] += 1e-3  # the crank's angle at half a second
    q[50, 4] -= 4e-3  # the coupler's centre there, across
    v[50, 6] += 1.5  # the rate of the rocker's centre there, along
    q[51, 2] += 9.0  # between the times of the reference
    v[100, 8] += 2.0  # the rocker's rate at the end
    found = metrics.state_errors(mechanism, Trajectory(finer, q, v, 0 * q, 100), reference)
    assert found.t == pytest.approx([0.0, 0.5, 1.0])
    assert found.measured == pytest.approx([0.0, 1e-3, 0.0])
    assert found.position == pytest.approx(np.array([[0.0] * 3, [1e-3, 4e-3, 0.0], [0.0] * 3]))
    assert found.velocity == pytest.approx(np.array([[0.0] * 3, [0.0, 0.0, 1.5], [0.0, 0.0, 2.0]]))
    assert found.position_bar == pytest.approx([3e-12] * 3)  # the floor is above the reference's own error
    assert found.velocity_bar == pytest.approx([5e-12] * 3)


def of(tmp_path_factory, **errors):
    """Return the row of an engine that moves as `gauss` does, with the given errors added."""
    store = str(tmp_path_factory.getbasetemp() / "references")
    with pytest.MonkeyPatch.context() as patched:
        replace_engine(patched, "mujoco", Clock(), Costs(), truth="gauss", **errors)
        row = measure(Case("four_bar", "torque", "mujoco", "default", "rk4", "none", 1e-3, 1.0), store)["results"][0]
    assert row["status"] == ("ok" if row["valid"] else "invalid")
    return dict(row)


@pytest.mark.long("errors2-acceleration_error_max-0.5-False", "errors3-measured_error_t1-0.03-None")
@pytest.mark.slow("errors0-acceleration_error_median-0.008-True", "errors1-acceleration_error_median-0.012-False")
@pytest.mark.parametrize(
    ("errors", "column", "value", "valid"),
    [
        ({"off_acceleration": 0.008}, "acceleration_error_median", 0.008, True),
        ({"off_acceleration": 0.012}, "acceleration_error_median", 0.012, False),
        ({"off_acceleration": -0.5}, "acceleration_error_max", 0.5, False),
        ({"off_position": 0.03}, "measured_error_t1", 0.03, None),
    ],
)
def test_an_engine_that_is_off_by_a_known_amount_is_told_so(errors, column, value, valid, tmp_path_factory):
    """A per cent at the same state is another model."""
    row = of(tmp_path_factory, **errors)
    assert row[column] == pytest.approx(value, rel=1e-3)
    if valid is not None:
        assert row["valid"] is valid
        assert ("accelerations off" in row["flag"]) is not valid


@pytest.mark.slow
@pytest.mark.parametrize(("gap", "shut"), [(3.7e-3, True), (4.3e-3, False)])
def test_a_loop_that_opens_by_a_hundredth_of_its_size_is_not_this_linkage(gap, shut, tmp_path_factory):
    """The crank is turned about its centre, half its length from the pins, until they open by the gap; the ground is 0.4 m long."""
    a, b = load("four_bar", "torque").links[0].points.values()
    arm = float(np.hypot(*(a - b))) / 2
    row = of(tmp_path_factory, off_position=gap / arm)
    assert row["position_drift"] == pytest.approx(gap, rel=0.05)
    assert ("the loops open" in row["flag"]) is not shut
