"""OpenSim in its environment: its joint forces, and redundant rows; skipped without the environment, in CI too."""

import re
import subprocess
from functools import partial
from pathlib import Path

import numpy as np
import pytest

import gauss_bench
from gauss_bench.engines.base import Choice
from gauss_bench.linkage.load import load
from gauss_bench.mechanism.evaluate import Evaluator
from gauss_bench.mechanism.model import Mechanism
from gauss_bench.metrics import compare_joint_forces, joint_forces
from gauss_bench.runs import questions
from gauss_bench.runs.apart import Request, run_of
from gauss_bench.runs.one_run import sampling_at
from gauss_bench.terms import Array
from gauss_bench.trajectory import Status, Trajectory
from tests.conftest import redundant
from tests.engine_runs import certified

ENGINE = "opensim"
FINDING = Path(__file__).parents[1] / "reports" / "findings" / "opensim_redundant_rows.py"


@pytest.mark.slow
@pytest.mark.usefixtures("elsewhere")
@pytest.mark.parametrize(("settings", "status"), [("default", "invalid"), ("tight", "ok")])
def test_redundant_rows_of_loops_that_open_a_little_take_the_free_motion_away(settings: str, status: str) -> None:
    run = gauss_bench.simulate("parallelogram", "opensim", "torque", settings, step=1e-3, at=[0.0, 1.0, 2.0])
    assert run.status == status, run.message
    before, after = np.abs(run.links["crank"]["omega"][1:])
    assert before > 30.0
    assert (after < 1.0) == (settings == "default")


@pytest.mark.long
def test_the_finding_on_redundant_rows_is_as_told(elsewhere: str) -> None:
    told = subprocess.run([elsewhere, str(FINDING)], capture_output=True, text=True, check=True).stdout
    energies = {x[1]: (float(x[2]), float(x[3])) for x in re.finditer(r"tolerance (.+): energy (\S+) J becomes (\S+) J", told)}
    kept = {name for name, (before, after) in energies.items() if abs(after - before) < 1e-5}
    lost = {name for name, (before, after) in energies.items() if after < before - 1.0}
    assert kept == {"1e-08", "1e-12"}
    assert lost == {"as shipped", "1e+00", "1e-05", "1e-06", "1e-07"}
    assert energies["as shipped"] == energies["1e+00"]  # projections have no part in it
    stopped = [float(x) for x in re.findall(r"tolerance 1e-0[567]: .* becomes (\S+) rad/s", told)]
    assert len(stopped) == 3
    assert max(map(abs, stopped)) < 1e-6
    accelerations = [float(x) for x in re.findall(r"turned by .*: (\S+) rad/s\^2", told)]
    assert len(accelerations) == 8
    assert np.allclose(accelerations[:6], -56.8597, atol=1e-4)
    assert max(map(abs, accelerations[6:])) < 0.01


def certified_states(mechanism: Mechanism) -> Trajectory:
    """Return all states of a mechanism's certified motion, over one second at most."""
    reference = certified(mechanism, min(mechanism.duration, 1.0))
    return Trajectory(reference.t, reference.q, reference.v, reference.a, None)


def told_forces(mechanism: Mechanism, settings: str, states: Trajectory) -> Array:
    """Return the joint forces (k, joints, 3) that OpenSim tells at states; NaN where it tells none."""
    names = tuple(joint.name for joint in mechanism.joints)
    question = partial(questions.joint_forces, names, states.t, states.q, states.v)
    wanted, count = sampling_at(1e-3, [0.0, 1e-3]), 3 * len(names) * len(states.t)
    request = Request(mechanism.sha256, mechanism.scenario, "opensim", Choice(settings), wanted, question, answers=count)
    run = run_of(request, mechanism, limit=60.0)
    assert run.status is Status.OK, run.message
    return np.asarray(run.answer)


# least depth is another tree: other joints close the loops, and some hang the other way round
FORCED = [
    *(("crank_slider", x, "default") for x in ("paper", "driven")),
    *(("shaper", x, y) for x in ("torque", "driven") for y in ("default", "merson/1e-12")),
    *((name, "torque", y) for name in ("four_bar", "six_bar", "eight_bar") for y in ("default", "merson/1e-12")),
    *(("squeezer", "squeeze", y) for y in ("default", "merson/1e-12")),
    ("five_bar", "spring", "merson/1e-12"),
    ("jansen", "driven", "default"),
]
SLOW = ["-".join(x) for x in FORCED if x[0] not in ("crank_slider", "four_bar")]
EXACT = 1e-12  # relative to the largest


@pytest.mark.slow(*SLOW)
@pytest.mark.usefixtures("elsewhere")
@pytest.mark.parametrize(("name", "scenario", "settings"), FORCED)
def test_forces_of_all_joints_are_those_of_the_certified_accelerations(name: str, scenario: str, settings: str) -> None:
    mechanism = load(name, scenario)
    states = certified_states(mechanism)
    told = told_forces(mechanism, settings, states)
    assert np.isfinite(told).all()
    error, largest = compare_joint_forces(Evaluator(mechanism), states, told)
    assert error <= EXACT * largest


@pytest.mark.usefixtures("elsewhere")
def test_forces_that_redundant_rows_leave_undetermined_are_not_told() -> None:
    parallelogram, doubled = load("parallelogram", "torque"), redundant()  # a four-bar whose last pin stands there twice
    assert np.isnan(told_forces(parallelogram, "default", certified_states(parallelogram))).all()
    states = certified_states(load("four_bar", "torque"))
    told, true = told_forces(doubled, "default", states), joint_forces(Evaluator(doubled), states)
    assert np.isnan(told[:, 3:]).all()
    sure = np.array([[x["fx"], x["fy"], x["moment"]] for x in true.values()]).transpose(2, 0, 1)[:, :3]
    assert np.abs(told[:, :3] - sure).max() <= EXACT * np.abs(sure).max()
