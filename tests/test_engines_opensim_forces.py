"""Joint forces read from OpenSim's reactions and records, shown on a stand-in that follows OpenSim's conventions.

OpenSim's reaction on a child moves all links beyond the joint, together with the forces that OpenSim has on these bodies:

    force = sum of (m a - F),    moment = sum of (I alpha - T + arm x (m a - F)) about the origin of the child's frame
"""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from gauss_bench.bench.probes import moving_states
from gauss_bench.engines.opensim.forces import JointForces
from gauss_bench.engines.tree import Branch, Tree, spanning_tree
from gauss_bench.linkage.load import document_of, load, load_document
from gauss_bench.mechanism.coordinates import position, rotate
from gauss_bench.mechanism.evaluate import Evaluator, list_determined
from gauss_bench.mechanism.model import GROUND, Mechanism, Point
from gauss_bench.mechanism.spaces import angle_at, place_at
from gauss_bench.metrics import joint_forces
from gauss_bench.reference.absolute import AbsoluteCoordinates
from gauss_bench.suites.read import FOLDER
from gauss_bench.terms import Array
from gauss_bench.trajectory import Trajectory
from tests.conftest import DATA, redundant

ROUNDING = 1e-12  # of the largest force
# trees of pins and slides without loops: file, scenario, loads that OpenSim has on bodies, loads that it has on coordinates
KINDS = (FOLDER / "linkages" / "kinds.toml", "loaded", ("wind", "jet", "cord"), ("motor", "twist", "spring", "coil", "bearing"))
SLIDES = (DATA / "slides.toml", "all", ("on_puck",), ("damped", "along", "slot_spring"))


class Listed:
    """Numbers, or lists of them, as OpenSim's types hold them."""

    def __init__(self, *entries: Any):
        self.entries = entries

    def get(self, k: int) -> Any:
        return self.entries[k]


def hangs_on(tree: Tree, link: int, b: Branch) -> bool:
    """Tell whether a link lies beyond a joint of the tree."""
    above = {x.link: x.parent for x in tree.branches}
    while link not in (b.link, GROUND):
        link = above[link]
    return link == b.link


def react(tree: Tree, b: Branch, q: Array, lacking: Array) -> Listed:
    """Return OpenSim's reaction on the child of a joint, from M a - Q (n,) of the forces on bodies."""
    about, force, moment = position(q, Point(b.link, b.anchor, "")), np.zeros(2), 0.0
    for i in (i for i in range(tree.links) if hangs_on(tree, i, b)):
        push, (x, y) = place_at(lacking, i), place_at(q, i) - about
        force, moment = force + push, moment + angle_at(lacking, i) + x * push[1] - y * push[0]
    return Listed(Listed(0.0, 0.0, moment), Listed(*force, 0.0))


def stand_in(joints: dict[str, Listed], records: dict[int, Listed]) -> Any:
    """Return a model that tells these reactions, by OpenSim's name of the joint, and records, by number of the closing pin."""
    told = {name: SimpleNamespace(calcReactionOnChildExpressedInGround=lambda _, x=x: x) for name, x in joints.items()}
    kept = {k: SimpleNamespace(getRecordValues=lambda _, x=x: x) for k, x in records.items()}
    return SimpleNamespace(model=SimpleNamespace(getJointSet=lambda: told, getConstraintSet=lambda: kept))


def true_forces(mechanism: Mechanism, t: float, q: Array, v: Array, a: Array) -> dict[str, Array]:
    """Return name of a joint -> (3,) fx, fy and moment, by Newton's laws."""
    found = joint_forces(Evaluator(mechanism), Trajectory(np.array([t]), q[None], v[None], a[None], None))
    return {name: np.array([x["fx"][0], x["fy"][0], x["moment"][0]]) for name, x in found.items()}


def compare(mechanism: Mechanism, on_bodies: tuple[str, ...]) -> None:
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
def test_loads_on_coordinates_pass_through_the_joints_of_the_linkage(
    path: Any, scenario: str, on_bodies: tuple[str, ...], on_coordinates: tuple[str, ...]
) -> None:
    document, _, _ = document_of(path)
    document["scenarios"][scenario]["forces"] = [*on_bodies, *on_coordinates]
    compare(load_document(document, scenario), on_bodies)


def test_a_driven_slide_that_hangs_on_its_block_exerts_nothing_along_its_line() -> None:
    document, _, _ = document_of(DATA / "slides.toml")
    scenario = document["scenarios"]["all"]
    scenario["drivers"] = [{"joint": "fixed_block", "law": "constant", "start": 0.1, "speed": 0.3}]
    scenario["start"]["slides"].pop("fixed_block")
    scenario["start"]["slide_speeds"].pop("fixed_block")
    scenario["forces"] = ["on_puck", "damped", "slot_spring"]
    compare(load_document(document, "all"), ("on_puck",))


def test_a_driven_crank_has_no_moment() -> None:
    document, _, _ = document_of(KINDS[0])
    scenario = document["scenarios"]["driven"]
    scenario["drivers"] = [{"link": "arm", "law": "constant", "start_deg": 20.0, "speed": 2.0}]
    scenario["forces"] = ["wind"]
    scenario["start"] = {"slides": {"slot": 0.2, "rail": 0.1}}
    compare(load_document(document, "driven"), ("wind",))


def test_the_force_of_a_closing_pin_is_turned_from_the_frame_of_the_link_that_carries_its_loop() -> None:
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


def test_forces_are_determined_where_no_redundant_row_takes_part() -> None:
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
