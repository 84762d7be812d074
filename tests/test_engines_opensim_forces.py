"""OpenSim's joint forces: read from a stand-in that follows OpenSim's conventions, and in OpenSim's environment; redundant rows.

OpenSim's reaction on a child moves all links beyond the joint, together with the forces that OpenSim has on these bodies:

    force = sum of (m a - F),    moment = sum of (I alpha - T + arm x (m a - F)) about the origin of the child's frame

Tests that need OpenSim are skipped without its environment, in CI too.
"""

import re
import subprocess
from dataclasses import replace
from functools import partial
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import gauss_bench
from gauss_bench.bench.probes import moving_states
from gauss_bench.engines.base import Choice
from gauss_bench.engines.opensim.forces import JointForces
from gauss_bench.engines.tree import spanning_tree
from gauss_bench.linkage.load import document_of, load, load_document
from gauss_bench.mechanism.coordinates import position, rotate
from gauss_bench.mechanism.evaluate import Evaluator, list_determined
from gauss_bench.mechanism.model import GROUND, Point
from gauss_bench.mechanism.spaces import angle_at, place_at
from gauss_bench.metrics import compare_joint_forces, joint_forces
from gauss_bench.reference.absolute import AbsoluteCoordinates
from gauss_bench.runs import questions
from gauss_bench.runs.apart import Request, run_of
from gauss_bench.runs.one_run import sampling_at
from gauss_bench.suites.read import FOLDER
from gauss_bench.trajectory import Status, Trajectory
from tests.conftest import DATA, redundant
from tests.engine_runs import certified

ROUNDING = 1e-12  # of the largest force
# trees of pins and slides without loops: file, scenario, loads that OpenSim has on bodies, loads that it has on coordinates
KINDS = (FOLDER / "linkages" / "kinds.toml", "loaded", ("wind", "jet", "cord"), ("motor", "twist", "spring", "coil", "bearing"))
SLIDES = (DATA / "slides.toml", "all", ("on_puck",), ("damped", "along", "slot_spring"))


class Listed:
    """Numbers, or lists of them, as OpenSim's types hold them."""

    def __init__(self, *entries):
        self.entries = entries

    def get(self, k):
        return self.entries[k]


def hangs_on(tree, link, b):
    """Tell whether a link lies beyond a joint of the tree."""
    above = {x.link: x.parent for x in tree.branches}
    while link not in (b.link, GROUND):
        link = above[link]
    return link == b.link


def react(tree, b, q, lacking):
    """Return OpenSim's reaction on the child of a joint, from M a - Q (n,) of the forces on bodies."""
    about, force, moment = position(q, Point(b.link, b.anchor, "")), np.zeros(2), 0.0
    for i in (i for i in range(tree.links) if hangs_on(tree, i, b)):
        push, (x, y) = place_at(lacking, i), place_at(q, i) - about
        force, moment = force + push, moment + angle_at(lacking, i) + x * push[1] - y * push[0]
    return Listed(Listed(0.0, 0.0, moment), Listed(*force, 0.0))


def stand_in(joints, records):
    """Return a model that tells these reactions, by OpenSim's name of the joint, and records, by number of the closing pin."""
    told = {name: SimpleNamespace(calcReactionOnChildExpressedInGround=lambda _, x=x: x) for name, x in joints.items()}
    kept = {k: SimpleNamespace(getRecordValues=lambda _, x=x: x) for k, x in records.items()}
    return SimpleNamespace(model=SimpleNamespace(getJointSet=lambda: told, getConstraintSet=lambda: kept))


def true_forces(mechanism, t, q, v, a):
    """Return name of a joint -> (3,) fx, fy and moment, by Newton's laws."""
    found = joint_forces(Evaluator(mechanism), Trajectory(np.array([t]), q[None], v[None], a[None], None))
    return {name: np.array([x["fx"][0], x["fy"][0], x["moment"][0]]) for name, x in found.items()}


def compare(mechanism, on_bodies):
    """Compare the joint forces that are read from the stand-in with those by Newton's laws, at random states."""
    tree, motion = spanning_tree(mechanism), AbsoluteCoordinates(mechanism)
    bodily = Evaluator(replace(mechanism, forces=tuple(f for f in mechanism.forces if f.name in on_bodies)))
    for t, q, v in zip(*moving_states(mechanism, motion), strict=True):
        (a,) = motion.acceleration(np.array([t]), q[None], v[None])
        lacking = a * mechanism.mass - bodily.applied.generalised(q, v, t)
        built = stand_in({f"joint{b.at}": react(tree, b, q, lacking) for b in tree.branches}, {})
        told, true = JointForces(mechanism, tree, built).read(None, q, v), true_forces(mechanism, t, q, v, a)
        assert told.keys() == true.keys()
        largest = max(np.abs(x).max() for x in true.values())
        for name, expected in true.items():
            np.testing.assert_allclose(told[name], expected, rtol=0, atol=ROUNDING * largest, err_msg=name)


@pytest.mark.parametrize(("path", "scenario", "on_bodies", "on_coordinates"), [KINDS, SLIDES], ids=["kinds", "slides"])
def test_loads_on_coordinates_pass_through_the_joints_of_the_linkage(path, scenario, on_bodies, on_coordinates):
    document, _, _ = document_of(path)
    document["scenarios"][scenario]["forces"] = [*on_bodies, *on_coordinates]
    compare(load_document(document, scenario), on_bodies)


def test_a_driven_slide_that_hangs_on_its_block_exerts_nothing_along_its_line():
    document, _, _ = document_of(DATA / "slides.toml")
    scenario = document["scenarios"]["all"]
    scenario["drivers"] = [{"joint": "fixed_block", "law": "constant", "start": 0.1, "speed": 0.3}]
    scenario["start"]["slides"].pop("fixed_block")
    scenario["start"]["slide_speeds"].pop("fixed_block")
    scenario["forces"] = ["on_puck", "damped", "slot_spring"]
    compare(load_document(document, "all"), ("on_puck",))


def test_a_driven_crank_has_no_moment():
    document, _, _ = document_of(KINDS[0])
    scenario = document["scenarios"]["driven"]
    scenario["drivers"] = [{"link": "arm", "law": "constant", "start_deg": 20.0, "speed": 2.0}]
    scenario["forces"] = ["wind"]
    scenario["start"] = {"slides": {"slot": 0.2, "rail": 0.1}}
    compare(load_document(document, "driven"), ("wind",))


def test_the_force_of_a_closing_pin_is_turned_from_the_frame_of_the_link_that_carries_its_loop():
    mechanism = load("squeezer")
    tree, q, v = spanning_tree(mechanism), mechanism.q0, mechanism.v0
    pins = {pin.name: k for k, pin in enumerate(tree.closures)}
    force = np.array([3.0, 4.0])
    # both sides of the last loop hang on one link; the other loops are closed over the ground
    carrier = next(i for i, link in enumerate(mechanism.links) if link.name == "K5")
    records = {k: Listed(*force) for k in pins.values()}
    records[pins["E.002"]] = Listed(*rotate(force, -angle_at(q, carrier)))
    nothing = Listed(Listed(0.0, 0.0, 0.0), Listed(0.0, 0.0, 0.0))
    built = stand_in({f"joint{b.at}": nothing for b in tree.branches}, records)
    told = JointForces(mechanism, tree, built).read(None, q, v)
    for name in pins:
        np.testing.assert_allclose(told[name], [3.0, 4.0, 0.0], atol=1e-15, err_msg=name)


def test_forces_are_determined_where_no_redundant_row_takes_part():
    assert list_determined(load("four_bar")) == ["A", "B", "C", "D"]
    assert list_determined(redundant()) == ["A", "B", "C"]  # its last pin stands there twice
    document, _, _ = document_of("parallelogram")
    assert list_determined(load_document(document, "torque")) == []
    document["links"]["lamp"] = {"points": {"T": [0.0, 0.0]}, "mass": 0.2, "com": [0.0, -0.1], "inertia": 0.001}
    document["joints"]["T"] = {"type": "revolute", "at": ["coupler.C", "lamp.T"]}
    document["assembly"]["angles_deg"] = {"lamp": 20.0}
    document["expect"] = {"dof": 2, "redundant": 1}
    document["scenarios"]["torque"]["start"] = {"angles_deg": {"crank": 30.0, "lamp": 20.0}}
    assert list_determined(load_document(document, "torque")) == ["T"]


# In the environment of OpenSim

ENGINE = "opensim"
FINDING = Path(__file__).parents[1] / "reports" / "findings" / "opensim_redundant_rows.py"


@pytest.mark.slow
@pytest.mark.usefixtures("elsewhere")
@pytest.mark.parametrize(("settings", "status"), [("default", "invalid"), ("tight", "ok")])
def test_redundant_rows_of_loops_that_open_a_little_take_the_free_motion_away(settings, status):
    run = gauss_bench.simulate("parallelogram", "opensim", "torque", settings, step=1e-3, at=[0.0, 1.0, 2.0])
    assert run.status == status, run.message
    before, after = np.abs(run.links["crank"]["omega"][1:])
    assert before > 30.0
    assert (after < 1.0) == (settings == "default")


@pytest.mark.long
def test_the_finding_on_redundant_rows_is_as_told(elsewhere):
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


def certified_states(mechanism):
    """Return all states of a mechanism's certified motion, over one second at most."""
    reference = certified(mechanism, min(mechanism.duration, 1.0))
    return Trajectory(reference.t, reference.q, reference.v, reference.a, None)


def told_forces(mechanism, settings, states):
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
def test_forces_of_all_joints_are_those_of_the_certified_accelerations(name, scenario, settings):
    mechanism = load(name, scenario)
    states = certified_states(mechanism)
    told = told_forces(mechanism, settings, states)
    assert np.isfinite(told).all()
    error, largest = compare_joint_forces(Evaluator(mechanism), states, told)
    assert error <= EXACT * largest


@pytest.mark.usefixtures("elsewhere")
def test_forces_that_redundant_rows_leave_undetermined_are_not_told():
    parallelogram, doubled = load("parallelogram", "torque"), redundant()  # a four-bar whose last pin stands there twice
    assert np.isnan(told_forces(parallelogram, "default", certified_states(parallelogram))).all()
    states = certified_states(load("four_bar", "torque"))
    told, true = told_forces(doubled, "default", states), joint_forces(Evaluator(doubled), states)
    assert np.isnan(told[:, 3:]).all()
    sure = np.array([[x["fx"], x["fy"], x["moment"]] for x in true.values()]).transpose(2, 0, 1)[:, :3]
    assert np.abs(told[:, :3] - sure).max() <= EXACT * np.abs(sure).max()
