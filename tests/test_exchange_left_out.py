"""An import names every element that it leaves out, and keeps dampers and springs apart."""

import json
import tomllib
from dataclasses import asdict
from xml.etree.ElementTree import fromstring, tostring

import numpy as np
import pytest

import gauss_bench
from gauss_bench.cli import main
from gauss_bench.exchange.imports import import_file
from gauss_bench.exchange.own_model import read_own_linkage
from gauss_bench.exchange.unused import list_names
from tests.conftest import DATA, needs

mujoco = needs("mujoco")
URDF, UPRIGHT, LEG = ((DATA / x).read_text(encoding="utf-8") for x in ("four_bar.urdf", "four_bar_xz.xml", "imports/leg.xml"))
NAMED = [
    "<geom> floor, bar",
    "the range of joint crank_j",
    "the control range of actuator m",
    "the force range of actuator m",
    "2 sensors: <jointpos> angle and <jointvel>",
    "<key> other",
    "<option> timestep 0.002, integrator implicitfast, iterations 50: ",
    "<flag> multiccd enable: ",
    "<visual>",
    "<numeric> gait",
    "<material> steel",
    "<light> sun",
    "<camera> side",
    "<exclude> 1 without a name",
    "<connect> C: soft closures",
    "contacts of 4 geoms and pairs (<geom> floor, bar",
]


def edited(text, changes, tmp_path):
    """Import a model after replacing parts of its text, each of which must occur."""
    for old, new in changes.items():
        assert old in text, old
        text = text.replace(old, new)
    file = tmp_path / "model.xml"
    file.write_text(text, encoding="utf-8")
    return import_file(file, "model")


@pytest.mark.slow
@pytest.mark.long("urdf", "upright")
@pytest.mark.parametrize(
    ("text", "kind", "dof", "said"),
    [(LEG, "MJCF", 1, NAMED), (URDF, "URDF", 3, ["No loop is closed: "]), (UPRIGHT, "MJCF", 1, ["C was opening"])],
    ids=["mjcf", "urdf", "upright"],
)
def test_what_an_import_says_stands_on_stderr_in_json_and_in_the_file(text, kind, dof, said, tmp_path, capsys):
    file, out = tmp_path / "leg.xml", tmp_path / "leg.toml"
    file.write_text(text, encoding="utf-8")
    assert main(["import", str(file), "--out", str(out), "--json"]) == 0
    printed = capsys.readouterr()
    answer, head = json.loads(printed.out), [x for x in out.read_text(encoding="utf-8").splitlines() if x.startswith("#")]
    for words in said:
        assert any(words in x for x in [*answer["left_out"], answer["note"]]), words
        assert any(words in x for x in head), words
        assert any(words in x for x in printed.err.splitlines()), words
    assert all(f"not imported: {x}" in printed.err for x in answer["left_out"])
    assert "This file is yours" in head[0]
    assert [answer[x] for x in ("kind", "name", "links", "dof")] == [kind, "leg", 3, dof]
    assert main(["simulate", str(out), "--at", "0.01"]) == 0
    assert main(["import", str(file), "--out", str(out)]) == 2
    assert asdict(gauss_bench.import_model(file, out, replace=True)) == answer | {"left_out": tuple(answer["left_out"])}


def test_an_open_urdf_says_so_and_its_example_closes_the_loop(tmp_path):
    note = edited(URDF, {}, tmp_path).note
    tree = "No loop is closed: the linkage is an open tree with 3 degrees of freedom. --close LINK.FRAME=LINK.FRAME"
    assert note.startswith(tree)
    closed = import_file(tmp_path / "model.xml", "model", [note.removesuffix(".").rpartition("--close ")[2]])
    assert (closed.dof, closed.note) == (1, "")


def test_a_tree_with_one_end_gives_the_form_of_a_closure_without_an_example(tmp_path):
    root = fromstring(URDF)
    for node in [*root]:
        ends = {node.get("name"), *(x.get("link") for x in node if x.tag in ("parent", "child"))}
        if ends & {"rocker", "rocker_end"}:
            root.remove(node)
    note = edited(tostring(root, encoding="unicode"), {}, tmp_path).note
    assert "2 degrees of freedom" in note
    assert "where FRAME is a link fixed to LINK" in note


def test_mjcf_without_a_closure_says_so(tmp_path):
    closure = LEG[LEG.index("<equality>") : LEG.index("</equality>")]
    note = edited(LEG, {closure: "<equality>"}, tmp_path).note
    tree = "No loop is closed: the linkage is an open tree with 3 degrees of freedom."
    assert note == f"{tree} <connect> in <equality> closes a loop."


def test_unread_elements_of_a_urdf_are_named(tmp_path):
    more = '<ros2_control name="hardware" type="system"/><gazebo reference="crank"/></robot>'
    left_out = edited(URDF, {"</robot>": more, '<link name="crank">': '<link name="crank"><collision/>'}, tmp_path).left_out
    for sentence in ("<ros2_control> hardware", "<gazebo> crank", "<collision> of crank"):
        assert sentence in left_out


def test_many_long_names_make_no_long_sentence():
    said = list_names([f"{k}" + "x" * 1000 for k in range(500)] + ["", ""])
    assert said.endswith("480 more and 2 without a name")
    assert len(said) < 2000


def test_a_file_that_is_stepped_as_it_stands_keeps_its_settings(tmp_path):
    """A diagnosis or tuning of a user's file steps it with the file's own solver, so it lists no settings as left out."""
    edited(LEG, {}, tmp_path)
    remarks = read_own_linkage(tmp_path / "model.xml", "leg").flattened.remarks
    assert any("contacts of 4" in x for x in remarks)
    assert not any("<option>" in x or "soft closures" in x for x in remarks)


def test_names_of_any_kind_stay_in_their_sentence(tmp_path):
    found = edited(LEG, {'"bar"': '"&#10;format = 1"'}, tmp_path)
    assert tomllib.loads(found.text)["format"] == "planar-linkage/1"


def forces_of(text, changes, tmp_path):
    return dict(tomllib.loads(edited(text, changes, tmp_path).text)["forces"])


def test_damping_of_a_default_class_is_a_pure_damping_and_stiffness_with_springref_a_spring(tmp_path):
    """springref is an angle of the joint, here in degrees; the hinge turns against the plane's normal."""
    forces = forces_of(LEG, {}, tmp_path)
    assert forces["damping_crank_j"] == {"type": "joint_damping", "joint": "crank_j", "c": 0.002}
    assert set(forces) == {"damping_crank_j", "spring_rocker_j", "m"}
    spring = {"type": "rotational_spring_damper", "links": ["ground", "rocker"], "k": 0.5, "c": 0.1}
    assert forces["spring_rocker_j"] == spring | {"rest": pytest.approx(-np.radians(20.0))}
    undamped = forces_of(LEG, {'springref="20" damping="0.1"': 'springref="20" damping="0"'}, tmp_path)
    assert undamped["spring_rocker_j"] == forces["spring_rocker_j"] | {"c": 0.0}


def test_damping_of_slides_and_of_a_urdf_is_a_pure_damping(tmp_path):
    hinge = '<joint name="crank_j" range="-90 90"/>'
    slide = '<joint name="crank_j" type="slide" axis="1 0 0" damping="0.7"/>'
    joint = '<joint name="D" type="revolute">'
    assert forces_of(LEG, {hinge: slide}, tmp_path)["damping_crank_j"] == {"type": "joint_damping", "joint": "crank_j", "c": 0.7}
    forces = forces_of(URDF, {joint: f'{joint}<dynamics damping="0.25" friction="0"/>'}, tmp_path)
    assert forces["damping_D"] == {"type": "joint_damping", "joint": "D", "c": 0.25}


RANGE = {'forcerange="-0.2 0.2"': "", 'ctrlrange="-5 5"': 'ctrlrange="-0.1 0.1"'}
LIMITS = {  # changes of the leg, and the force of its motor in MuJoCo
    "as it is": ({}, 0.2),
    "a control beyond its range": (RANGE, 0.1),
    "the same with clamping off": (RANGE | {"<flag ": '<flag clampctrl="disable" '}, 0.3),
    "a group that is switched off": (
        {'<motor name="m"': '<motor name="m" group="2"', "<option ": '<option actuatorgroupdisable="2" '},
        0.0,
    ),
}


@pytest.mark.parametrize("case", LIMITS)
def test_a_limited_or_disabled_motor_pushes_as_mujoco_lets_it(case, tmp_path):
    changes, wanted = LIMITS[case]
    found = forces_of(LEG, changes, tmp_path).get("m", {"value": 0.0})["value"]
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "model.xml"))
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    mujoco.mj_forward(model, data)
    assert data.qfrc_actuator[0] == pytest.approx(wanted)
    assert found == pytest.approx(-wanted)  # the axis y of the world points away from the reader of the plane x-z
