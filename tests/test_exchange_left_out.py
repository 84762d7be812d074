"""What an import leaves out is named, element by element; damping and springs come in as what they are."""

import json
import subprocess
import sys
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gauss_bench.exchange.imports import import_file
from gauss_bench.exchange.own_model import own_linkage
from gauss_bench.exchange.unused import list_names
from tests.conftest import DATA, needs

mujoco = needs("mujoco")
URDF = DATA / "four_bar.urdf"
LEG = """<mujoco model="leg">
  <compiler angle="degree" autolimits="true"/>
  <option timestep="0.002" integrator="implicitfast" iterations="50"><flag multiccd="enable"/></option>
  <visual><global fovy="60"/></visual>
  <custom><numeric name="gait" data="1"/></custom>
  <default>
    <geom type="capsule" size="0.006" density="1200"/>
    <joint type="hinge" axis="0 1 0" damping="0.002"/>
    <default class="sprung"><joint stiffness="0.5" springref="20" damping="0"/></default>
    <default class="free"><joint damping="0"/></default>
  </default>
  <asset><material name="steel"/></asset>
  <worldbody>
    <light name="sun" pos="0 -1 2"/><camera name="side" pos="0 -1 0"/>
    <geom name="floor" type="plane" size="2 2 .1" pos="0 0 -0.5"/>
    <body name="crank" pos="0 0 0.3"><joint name="crank_j" range="-90 90"/><geom name="bar" fromto="0 0 0  0.05 0 0"/>
      <body name="coupler" pos="0.05 0 0"><joint name="b_j" class="free"/><geom fromto="0 0 0  0.18 0 0.06"/></body></body>
    <body name="rocker" pos="0.2 0 0.25"><joint name="rocker_j" class="sprung"/><geom fromto="0 0 0  0.03 0 0.11"/></body>
  </worldbody>
  <contact><exclude body1="crank" body2="rocker"/></contact>
  <equality><connect name="C" body1="coupler" body2="rocker" anchor="0.18 0 0.06"/></equality>
  <actuator><motor name="m" joint="crank_j" ctrlrange="-5 5" forcerange="-0.2 0.2"/></actuator>
  <sensor><jointpos name="angle" joint="crank_j"/><jointvel joint="crank_j"/></sensor>
  <keyframe><key name="home" ctrl="0.3"/><key name="other"/></keyframe>
</mujoco>"""
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


def run(*arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run([sys.executable, "-m", "gauss_bench", *arguments], capture_output=True, text=True, check=False)


@pytest.mark.slow
def test_every_element_that_is_left_out_stands_on_stderr_in_json_and_in_the_file(tmp_path: Path) -> None:
    file, out = tmp_path / "leg.xml", tmp_path / "leg.toml"
    file.write_text(LEG, encoding="utf-8")
    done = run("import", str(file), "--out", str(out), "--json")
    assert done.returncode == 0, done.stderr
    answer, head = json.loads(done.stdout), [x for x in out.read_text(encoding="utf-8").splitlines() if x.startswith("#")]
    for what in NAMED:
        assert any(what in x for x in answer["left_out"]), what
        assert any(what in x for x in head), what
        assert any(x.startswith("not imported: ") and what in x for x in done.stderr.splitlines()), what
    assert answer["note"] == ""


@pytest.mark.slow
def test_an_open_urdf_says_so_and_its_example_closes_the_loop(tmp_path: Path) -> None:
    out = tmp_path / "leg.toml"
    done = run("import", str(URDF), "--out", str(out), "--json")
    assert done.returncode == 0, done.stderr
    note = json.loads(done.stdout)["note"]
    assert note.startswith(
        "Nothing is closed: the linkage is an open tree with 3 degrees of freedom. --close LINK.FRAME=LINK.FRAME"
    )
    assert note in done.stderr
    assert f"# {note}\n" in out.read_text(encoding="utf-8")
    example = note.removesuffix(".").rpartition("--close ")[2]
    closed = run("import", str(URDF), "--out", str(out), "--replace", "--json", "--close", example)
    assert closed.returncode == 0, closed.stderr
    assert (json.loads(closed.stdout)["dof"], json.loads(closed.stdout)["note"]) == (1, "")


def test_a_tree_with_one_end_gives_the_form_of_a_closure_without_an_example(tmp_path: Path) -> None:
    text = URDF.read_text(encoding="utf-8")
    begin, end = text.index('<joint name="D"'), text.index("</joint>", text.index('<joint name="D"')) + len("</joint>")
    file = tmp_path / "arm.urdf"
    file.write_text(remove_links(text[:begin] + text[end:], ("rocker", "rocker_end")), encoding="utf-8")
    note = import_file(file, "arm").note
    assert "2 degrees of freedom" in note
    assert "where FRAME is a link fixed to LINK" in note


def remove_links(text: str, names: tuple[str, ...]) -> str:
    """The text of a URDF without these links, and without the joints at them."""
    from xml.etree.ElementTree import fromstring, tostring

    root = fromstring(text)
    for node in [*root]:
        ends = [x.get("link") for x in node if x.tag in ("parent", "child")]
        if node.get("name") in names or {*ends} & {*names}:
            root.remove(node)
    return tostring(root, encoding="unicode")


def test_mjcf_without_a_closure_says_so(tmp_path: Path) -> None:
    file = tmp_path / "leg.xml"
    begin, end = LEG.index("<equality>"), LEG.index("</equality>") + len("</equality>")
    file.write_text(LEG[:begin] + LEG[end:], encoding="utf-8")
    note = import_file(file, "leg").note
    assert (
        note == "Nothing is closed: the linkage is an open tree with 3 degrees of freedom. <connect> in <equality> closes a loop."
    )


def test_unread_elements_of_a_urdf_are_named(tmp_path: Path) -> None:
    file = tmp_path / "model.urdf"
    more = '<ros2_control name="hardware" type="system"/><gazebo reference="crank"/>'
    text = URDF.read_text(encoding="utf-8").replace("</robot>", f"{more}</robot>")
    file.write_text(text.replace('<link name="crank">', '<link name="crank"><collision/>'), encoding="utf-8")
    left_out = import_file(file, "model").left_out
    for what in ("<ros2_control> hardware", "<gazebo> crank", "<collision> of crank"):
        assert what in left_out


def test_many_long_names_make_no_long_sentence() -> None:
    said = list_names([f"{k}" + "x" * 1000 for k in range(500)] + ["", ""])
    assert said.endswith("480 more and 2 without a name")
    assert len(said) < 2000


def test_a_file_that_is_stepped_as_it_stands_keeps_its_settings(tmp_path: Path) -> None:
    """What a diagnosis or tuning of a user's own file leaves out is what its linkage lacks, not the solver that steps it."""
    path = tmp_path / "leg.xml"
    path.write_text(LEG, encoding="utf-8")
    remarks = own_linkage(path, "leg").flattened.remarks
    assert any("contacts of 4" in x for x in remarks)
    assert not any("<option>" in x or "soft closures" in x for x in remarks)


def test_names_of_any_kind_stay_in_their_sentence(tmp_path: Path) -> None:
    path = tmp_path / "leg.xml"
    path.write_text(LEG.replace('"bar"', '"&#10;format = 1"'), encoding="utf-8")
    found = import_file(path, "leg")
    assert tomllib.loads(found.text)["format"] == "planar-linkage/1"


def forces_of(text: str, tmp_path: Path) -> dict[str, Any]:
    file = tmp_path / "model.xml"
    file.write_text(text, encoding="utf-8")
    return dict(tomllib.loads(import_file(file, "model").text)["forces"])


def test_damping_of_a_default_class_is_a_pure_damping_and_stiffness_with_springref_a_spring(tmp_path: Path) -> None:
    """springref is an angle of the joint, here in degrees; the hinge turns against the plane's normal."""
    forces = forces_of(LEG, tmp_path)
    assert forces["damping_crank_j"] == {"type": "joint_damping", "joint": "crank_j", "c": 0.002}
    assert set(forces) == {"damping_crank_j", "spring_rocker_j", "m"}
    spring = forces["spring_rocker_j"]
    assert (spring["type"], spring["links"], spring["k"], spring["c"]) == (
        "rotational_spring_damper",
        ["ground", "rocker"],
        0.5,
        0.0,
    )
    assert spring["rest"] == pytest.approx(-np.radians(20.0))


def test_damping_of_slides_and_of_a_urdf_is_a_pure_damping(tmp_path: Path) -> None:
    slide = LEG.replace('<joint name="crank_j" range="-90 90"/>', '<joint name="crank_j" type="slide" axis="1 0 0" damping="0.7"/>')
    assert forces_of(slide, tmp_path)["damping_crank_j"] == {"type": "joint_damping", "joint": "crank_j", "c": 0.7}
    file = tmp_path / "model.urdf"
    text = URDF.read_text(encoding="utf-8")
    name = "D"
    joint = text[text.index(f'<joint name="{name}"') :].partition("</joint>")[0]
    file.write_text(text.replace(joint, f'{joint}<dynamics damping="0.25" friction="0"/>'), encoding="utf-8")
    forces = tomllib.loads(import_file(file, "model").text)["forces"]
    assert forces[f"damping_{name}"] == {"type": "joint_damping", "joint": name, "c": 0.25}


LIMITS = {  # what is changed in the leg, and the force of its motor in MuJoCo
    "as it is": ({}, 0.2),
    "a control beyond its range": ({'forcerange="-0.2 0.2"': "", 'ctrlrange="-5 5"': 'ctrlrange="-0.1 0.1"'}, 0.1),
    "the same with clamping off": (
        {'forcerange="-0.2 0.2"': "", 'ctrlrange="-5 5"': 'ctrlrange="-0.1 0.1"', "<flag ": '<flag clampctrl="disable" '},
        0.3,
    ),
    "a group that is switched off": (
        {'<motor name="m"': '<motor name="m" group="2"', "<option ": '<option actuatorgroupdisable="2" '},
        0.0,
    ),
}


@pytest.mark.parametrize("what", LIMITS)
def test_a_limited_or_disabled_motor_pushes_as_mujoco_lets_it(what: str, tmp_path: Path) -> None:
    text, (changes, wanted) = LEG, LIMITS[what]
    for old, new in changes.items():
        assert old in text
        text = text.replace(old, new)
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    mujoco.mj_forward(model, data)
    assert data.qfrc_actuator[0] == pytest.approx(wanted)
    found = forces_of(text, tmp_path).get("m", {"value": 0.0})["value"]
    assert found == pytest.approx(-wanted)  # the axis y of the world points away from the reader of the plane x-z


def test_a_motor_with_delay_is_refused(tmp_path: Path) -> None:
    file = tmp_path / "model.xml"
    file.write_text(LEG.replace('forcerange="-0.2 0.2"', 'delay="0.01" nsample="8"'), encoding="utf-8")
    with pytest.raises(ValueError, match="without delay"):
        import_file(file, "model")
