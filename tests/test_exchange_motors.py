"""Constant forces are exported as MJCF motors with their values as ctrl, drive the exported model, and are imported unchanged."""

import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from gauss_bench.engines import get
from gauss_bench.engines.base import Choice
from gauss_bench.engines.mujoco.adapter import MujocoModel
from gauss_bench.engines.tree import spanning_tree
from gauss_bench.exchange.errors import ExchangeError
from gauss_bench.exchange.export import export_linkage
from gauss_bench.exchange.imports import import_file
from gauss_bench.exchange.own_model import ENGINE, read_own_linkage, setting_text
from gauss_bench.linkage.load import built_in, load, load_document
from gauss_bench.mechanism.forces import AppliedForces
from gauss_bench.mechanism.model import PointForce, Torque
from tests.conftest import DATA, needs

mujoco = needs("mujoco")

FILES = [str(file) for file in built_in().values()] + [str(file) for file in sorted(DATA.glob("*.toml"))]
MOTORS = [x for x in FILES if any(word in Path(x).read_text(encoding="utf-8") for word in ('"torque"', '"force"'))]
NOT_MJCF = ("everything", "friction", "all_kinds", "dyads", "excavator_arm")  # their scenarios with motors, for other parts of them
CARTS = DATA / "motors" / "carts.toml"


def exported(mechanism, folder):
    """Return plain MuJoCo's model of the exported document, with rigid closures, and its data at the keyframe."""
    text = export_linkage(mechanism, "mujoco", 1e-3).text
    (folder / "model.xml").write_text(text, encoding="utf-8")
    model = mujoco.MjModel.from_xml_string(text)
    model.body_invweight0[:] *= 1e-7
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, model.key("start").id)
    return model, data


def same_work(back, mechanism, names):
    """Return for both linkages the sum of some forces at the start, as generalised forces on one tree of joints."""
    order = [[x.name for x in back.links].index(link.name) for link in mechanism.links]
    found = []
    for x, links in ((back, order), (mechanism, [*range(len(order))])):
        only = replace(x, forces=tuple(f for f in x.forces if f.name in names), gravity=np.zeros(2))
        Q = AppliedForces(only).generalised(x.q0, x.v0).reshape(-1, 3)[links]
        found.append(spanning_tree(mechanism).forces(mechanism.q0, Q.ravel()))
    return found[0], found[1]


@pytest.mark.parametrize("file", MOTORS, ids=lambda x: Path(x).stem)
def test_a_motor_that_goes_out_comes_back_as_the_same_motor(file, tmp_path):
    document = tomllib.loads(Path(file).read_text(encoding="utf-8"))
    compared = 0
    for scenario, given in document.get("scenarios", {}).items():
        if not given.get("forces") or "driver" in given or "drivers" in given:
            continue
        mechanism = load(file, scenario)
        try:
            text = export_linkage(mechanism, "mujoco", 1e-3).text
        except ExchangeError:
            continue
        (tmp_path / "model.xml").write_text(text, encoding="utf-8")
        back = load_document(tomllib.loads(import_file(tmp_path / "model.xml", "back").text))
        compared += check_motors(back, mechanism)
    assert compared or Path(file).stem in NOT_MJCF


def check_motors(back, mechanism):
    """Compare torques by their links and values, and forces at points by their generalised forces; return the number of motors."""
    motors = [f for f in mechanism.forces if isinstance(f, (Torque, PointForce))]
    by_name = {f.name: f for f in back.forces}
    for f in motors:
        own = by_name[f.name]
        if isinstance(f, Torque):
            assert isinstance(own, Torque)
            ends = [[m.link_name(x.link), m.link_name(x.reaction)] for m, x in ((back, own), (mechanism, f))]
            assert ends[0] == ends[1]
            assert own.value == pytest.approx(f.value, rel=1e-12)
    found, wanted = same_work(back, mechanism, [f.name for f in motors if isinstance(f, PointForce)])
    assert np.abs(found - wanted).max() < 1e-12 * max(1.0, np.abs(wanted).max())
    return len(motors)


def test_motors_on_slides_and_between_moving_links_come_back(tmp_path):
    mechanism = load(str(CARTS))
    model, data = exported(mechanism, tmp_path)
    controls = {model.actuator(k).name: (float(data.ctrl[k]), float(model.actuator_gear[k, 0])) for k in range(model.nu)}
    assert controls == {"turn": (0.7, -1.0), "haul": (pytest.approx(-4.0), 1.0), "lift": (pytest.approx(5.0), 1.0)}
    assert {int(x) for x in model.actuator_trntype} == {int(mujoco.mjtTrn.mjTRN_JOINT)}
    back = load_document(tomllib.loads(import_file(tmp_path / "model.xml", "back").text))
    assert {f.name for f in back.forces} == {"haul", "lift", "lift_2", "turn", "damping_slot"}
    assert tomllib.loads(import_file(tmp_path / "model.xml", "back").text)["forces"]["damping_slot"]["type"] == "joint_damping"
    for names in (["haul"], ["lift", "lift_2"], ["turn"]):
        found, wanted = same_work(back, mechanism, names)
        assert found == pytest.approx(wanted, abs=1e-12), names
        assert np.count_nonzero(np.abs(wanted) > 1e-12) == 1, names  # one joint alone


CASES = [
    ("four_bar", "torque"),
    ("jansen", "walk"),
    (str(CARTS), "all"),
    (str(DATA / "loaded.toml"), "all"),
    (str(DATA / "slides.toml"), "all"),
]


@pytest.mark.parametrize(("name", "scenario"), CASES, ids=lambda x: Path(x).stem)
def test_ctrl_changes_qacc_as_the_motor_of_the_linkage_does(name, scenario, tmp_path):
    """Plain MuJoCo with another ctrl accelerates as the suite's own equations with another value of the force."""
    mechanism = load(name, scenario)
    model, data = exported(mechanism, tmp_path)
    tree, factor = MujocoModel(mechanism, Choice("tuned", "rk4")).tree, -3.0
    assert model.nu
    for k in range(model.nu):
        motor = model.actuator(k).name
        if not model.actuator_gainprm[k, 0]:
            continue
        names = {motor, "lift_2"} if motor == "lift" else {motor}
        forces = tuple(replace(f, value=factor * np.asarray(f.value)) if f.name in names else f for f in mechanism.forces)
        changed = replace(mechanism, forces=forces)
        mujoco.mj_resetDataKeyframe(model, data, 0)
        mujoco.mj_forward(model, data)
        before = np.array(data.qacc)
        data.ctrl[k] *= factor
        mujoco.mj_forward(model, data)
        own = get("gauss").build(changed, Choice("default", "rk4")).acceleration(0.0, mechanism.q0, mechanism.v0)
        found = tree.absolute(np.array(data.qpos), np.array(data.qvel), np.array(data.qacc))[2]
        assert np.abs(found - own).max() < 1e-5 * np.abs(own).max(), motor  # closures are nearly rigid
        assert np.abs(data.qacc - before).max() > 1e-3 * np.abs(own).max(), motor


def test_an_exported_file_as_it_stands_accelerates_as_the_linkage_with_its_motor(tmp_path):
    mechanism, file = load("four_bar", "torque"), tmp_path / "model.xml"
    file.write_text(export_linkage(mechanism, "mujoco", 1e-3).text, encoding="utf-8")
    own = load_document(read_own_linkage(file, "own").document)
    found = get(ENGINE).build(own, Choice(setting_text(file, {}), "", "none", 1e-3)).acceleration(0.0, own.q0, own.v0)
    wanted = get("gauss").build(mechanism, Choice()).acceleration(0.0, mechanism.q0, mechanism.v0)
    assert np.abs(found - wanted).max() < 1e-3 * np.abs(wanted).max()  # closures are soft


def test_a_motor_at_rest_goes_out_so_that_it_can_be_driven(tmp_path):
    four_bar = load("four_bar", "torque")
    forces = tuple(replace(f, value=0.0) if isinstance(f, Torque) else f for f in four_bar.forces)
    model, data = exported(replace(four_bar, forces=forces), tmp_path)
    assert data.ctrl.tolist() == [0.0]
    mujoco.mj_forward(model, data)
    before = np.array(data.qacc)
    data.ctrl[0] = 0.6
    mujoco.mj_forward(model, data)
    assert np.abs(data.qacc - before).max() > 1.0


def test_forces_that_no_ctrl_changes_are_named_at_the_head(tmp_path):
    text = export_linkage(load(str(DATA / "slides.toml")), "mujoco", 1e-3).text
    assert "Motors: with_sledge = 0.538516 N, on_puck = 0.5 N." in text
    assert "No ctrl changes with_puck: " in text
    assert "No ctrl changes across, to_puck: springs along an axis" in text
    document = tomllib.loads(CARTS.read_text(encoding="utf-8"))
    document["forces"]["turn"]["reaction"] = "cart"  # which never turns against the block
    text = export_linkage(load_document(document), "mujoco", 1e-3).text
    assert "No ctrl changes turn: it has no effect" in text
    assert "Motors: haul = -4 N, lift = 5 N." in text
