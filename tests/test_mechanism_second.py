"""The keys of the second edition give the same motion as the links, masses and joints that they abbreviate."""

import copy
import tomllib
from pathlib import Path

import numpy as np
import pytest

import gauss_bench
from gauss_bench.api.kinematics import kinematics
from gauss_bench.api.simulate import simulate
from gauss_bench.cli import main
from gauss_bench.engines import get as engine
from gauss_bench.engines import names
from gauss_bench.engines.base import Choice
from gauss_bench.exchange.errors import ExchangeError
from gauss_bench.exchange.export import KINDS, export_linkage
from gauss_bench.formulations import FORMULATIONS
from gauss_bench.linkage.errors import LinkageError
from gauss_bench.linkage.load import load, load_document, merge
from gauss_bench.mechanism.evaluate import Evaluator
from gauss_bench.reference.build import build_reference
from gauss_bench.reference.certify import Uncertified, certify
from gauss_bench.runs.offers import ChoiceError
from tests.conftest import DATA, needs
from tests.engine_runs import ran
from tests.fuzz.files import toml

VARYING = Path(gauss_bench.__file__).parent / "suites" / "linkages" / "varying.toml"
GIVEN = {*FORMULATIONS, "gauss-native", "lagrange-native", "pinocchio", "mujoco", "exudyn"}  # that have forces which vary
ARM, LEG, GRIPPER = (DATA / f"{name}.toml" for name in ("excavator_arm", "leg", "gripper"))


def document(path):
    return tomllib.loads(path.read_text(encoding="utf-8"))


def changed(path, change):
    return merge(document(path), change)


def said(content, scenario=None):
    with pytest.raises(LinkageError) as caught:
        load_document(content, scenario, "arm.toml")
    return str(caught.value)


def terms(mechanism):
    """Return the start, the masses, and the terms of the equations of motion, each as one array."""
    found = Evaluator(mechanism).terms(0.0, mechanism.q0, mechanism.v0)
    return mechanism.q0, mechanism.mass, np.concatenate([found.Q, found.J.ravel(), found.gamma])


def assert_same(one, other):
    for a, b in zip(terms(one), terms(other), strict=True):
        np.testing.assert_allclose(a, b, rtol=0, atol=1e-11 * (1 + np.abs(b).max()))


@pytest.mark.parametrize("key", ["cylinders", "welds", "links.boom.point_masses", "scenarios.held.hold"])
def test_a_file_of_the_first_edition_has_no_key_of_the_second(key):
    text = said(document(ARM) | {"format": "planar-linkage/1"})
    assert f"arm.toml: {key}: a key of planar-linkage/2, and the file says format = 'planar-linkage/1'" in text
    content = document(GRIPPER)
    content["scenarios"]["grip"]["override"] = {"links": {"left": {"point_masses": [{"point": "tip", "mass": 1.0}]}}}
    assert "scenarios.grip.override.links.left.point_masses: a key of planar-linkage/2" in said(content)


def test_point_masses_move_the_centre_and_add_to_the_inertia():
    """A bar of 3 kg and 1.2 m with 1 kg at either end, by hand: about the same centre, I = m l^2 / 12 + 2 (l / 2)^2."""
    bar = {"points": {"A": [0.0, 0.0], "B": [1.2, 0.0]}, "bars": [["A", "B"]], "mass": 3.0}
    both = bar | {"point_masses": [{"point": "A", "mass": 1.0}, {"point": "B", "mass": 1.0}]}
    alone = {"points": bar["points"], "point_masses": [{"point": "A", "mass": 1.0}, {"point": "B", "mass": 3.0}]}
    links = {"both": both, "alone": alone}
    content = {"format": "planar-linkage/2", "name": "x", "links": links, "scenarios": {"fly": {"duration": 1.0}}}
    content["assembly"] = {"sketch": {"both.A": [0, 0], "both.B": [1, 0], "alone.A": [0, 0], "alone.B": [1, 0]}}
    content["scenarios"]["fly"]["start"] = {"angles": {"both": 0, "alone": 0}, "points": {"both.A": [0, 0], "alone.A": [0, 0]}}
    first, second = load_document(content).links
    assert first.mass == 5.0
    np.testing.assert_allclose([*first.com, first.inertia], [0.6, 0.0, 3.0 * 1.2**2 / 12 + 2 * 0.6**2], rtol=1e-14)
    np.testing.assert_allclose([second.mass, *second.com, second.inertia], [4.0, 0.9, 0.0, 0.3**2 * 3 + 0.9**2], rtol=1e-14)
    links["alone"] = alone | {"point_masses": [{"point": "A", "mass": 1.0}]}
    assert "links.alone.inertia: required: masses at one point have no inertia" in said(content)
    links["alone"] = alone | {"point_masses": [{"point": "C", "mass": 1.0}]}
    assert "links.alone.point_masses[0].point: unknown point 'C' of 'alone'" in said(content)


def test_a_cylinder_is_a_barrel_a_rod_two_pins_and_a_slide():
    content = document(ARM)
    by_hand = copy.deepcopy(content)
    del by_hand["cylinders"]
    barrel, rod = {"pin": [0.0, 0.0], "end": [0.7, 0.0]}, {"pin": [0.0, 0.0], "end": [-0.6, 0.0]}
    by_hand["links"]["lift_barrel"] = {"points": barrel, "bars": [["pin", "end"]], "mass": 8.0}
    by_hand["links"]["lift_rod"] = {"points": rod, "bars": [["pin", "end"]], "mass": 4.0}
    by_hand["joints"]["lift_barrel"] = {"type": "revolute", "at": ["ground.P", "lift_barrel.pin"]}
    by_hand["joints"]["lift_rod"] = {"type": "revolute", "at": ["boom.Q", "lift_rod.pin"]}
    by_hand["joints"]["lift"] = {"type": "prismatic", "guide": "lift_barrel.pin", "block": "lift_rod.pin"}
    by_hand["assembly"]["angles_deg"] |= {"lift_barrel": 45.0}
    for scenario in ("lift", "drop"):
        assert_same(load_document(content, scenario), load_document(by_hand, scenario))


def test_welded_links_are_the_one_link_they_come_to():
    """Bucket and tooth as one link, its numbers by hand from the parallel axes."""
    content = document(ARM)
    c, s = np.cos(np.radians(-40.0)), np.sin(np.radians(-40.0))
    F, tip = np.array([0.3, 0.1]), np.array([0.3 + 0.15 * c, 0.1 + 0.15 * s])
    com = (12.0 * F / 2 + 1.5 * (F + tip) / 2) / 13.5
    parts = [(12.0, F / 2, 12.0 * (F @ F) / 12), (1.5, (F + tip) / 2, 1.5 * 0.15**2 / 12)]
    inertia = sum(i + m * ((x - com) @ (x - com)) for m, x, i in parts)
    one = copy.deepcopy(content)
    del one["welds"], one["links"]["tooth"]
    points = {"E": [0.0, 0.0], "F": F.tolist(), "tip": tip.tolist()}
    one["links"]["bucket"] = {"points": points, "mass": 13.5, "com": com.tolist(), "inertia": float(inertia)}
    push = np.array([[c, -s], [s, c]]) @ [-30.0, 0.0]
    one["forces"]["soil"] |= {"point": "bucket.tip", "value": push.tolist()}
    one["observe"] = {"points": ["bucket.tip"]}
    for name in ("lift", "drop"):
        one["scenarios"][name]["start"]["angles_deg"] = {"stick": -60.0, "bucket": -120.0}
    del one["scenarios"]["held"]
    for scenario in ("lift", "drop"):
        assert_same(load_document(content, scenario), load_document(one, scenario))
    by_points = copy.deepcopy(content)
    by_points["links"]["bucket"]["points"]["tip"] = tip.tolist()
    by_points["welds"]["seam"] = {"link": "tooth", "to": "bucket", "points": [["bucket.F", "tooth.F"], ["bucket.tip", "tooth.tip"]]}
    by_origin = copy.deepcopy(content)
    by_origin["welds"]["seam"] = {"link": "tooth", "to": "bucket", "origin": [0.3, 0.1], "angle_deg": -40.0}
    for other in (by_points, by_origin):
        assert_same(load_document(content, "lift"), load_document(other, "lift"))
    content["welds"]["seam"] = {"link": "tooth", "to": "bucket", "points": [["bucket.F", "tooth.F"], ["bucket.E", "tooth.tip"]]}
    assert "welds.seam.points: the two pairs cannot both coincide: 0.316228 m apart on bucket, 0.15 m on tooth" in said(content)


def test_results_know_welded_links_and_what_the_weld_carries():
    """The tooth by itself: its place on the bucket, and Newton's and Euler's equations with what the weld and the soil do."""
    found = simulate(str(ARM), at=[0.1, 0.2], step=5e-3)
    assert found.status == "ok", found.message
    assert list(found.links) == ["boom", "stick", "bucket", "tooth", "lift_barrel", "lift_rod"]
    tooth, bucket, weld = found.links["tooth"], found.links["bucket"], found.welds["seam"]
    np.testing.assert_allclose(tooth["theta"], bucket["theta"] - np.radians(40.0), rtol=1e-13)
    turn = np.exp(1j * tooth["theta"])
    F = bucket["x"] + 1j * bucket["y"] + np.exp(1j * bucket["theta"]) * (0.15 + 0.05j)
    centre = tooth["x"] + 1j * tooth["y"]
    np.testing.assert_allclose(centre - F, 0.075 * turn, atol=1e-12)
    np.testing.assert_allclose(found.points["tooth.tip"]["x"] + 1j * found.points["tooth.tip"]["y"], F + 0.15 * turn, atol=1e-12)
    soil, lacking = -30.0 * turn, 1.5 * (tooth["ax"] + 1j * (tooth["ay"] + 9.81))
    np.testing.assert_allclose(weld["fx"] + 1j * weld["fy"], lacking - soil, atol=1e-10)
    moment = 1.5 * 0.15**2 / 12 * tooth["alpha"] + (np.conj(0.075 * turn) * lacking - np.conj(0.15 * turn) * soil).imag
    np.testing.assert_allclose(weld["moment"], moment, atol=1e-10)


WRONG = tomllib.loads((DATA / "faults" / "linkages.toml").read_text(encoding="utf-8"))["second_edition"]


@pytest.mark.parametrize("case", WRONG)
def test_faults_of_the_second_edition_name_table_and_field(case):
    assert WRONG[case]["said"] in said(changed(ARM, WRONG[case]["change"]))


def test_damping_of_a_shared_pin_does_not_depend_on_the_order_of_the_list():
    """Three bars on one pin: each is damped by both others, whatever the order of their names."""
    bar = {"points": {"A": [0.0, 0.0], "B": [1.0, 0.0]}, "bars": [["A", "B"]], "mass": 1.0}
    content = {"format": "planar-linkage/2", "name": "x", "gravity": [0.0, 0.0], "links": dict.fromkeys("abc", bar)}
    content["forces"] = {"rub": {"type": "joint_damping", "joint": "P", "c": 0.3}}
    speeds = {"a": 1.0, "b": 2.0, "c": 5.0}
    start = {"angles": {"a": 0.0, "b": 1.0, "c": 2.0}, "speeds": speeds, "points": {"a.A": [0.0, 0.0]}}
    content["scenarios"] = {"spin": {"duration": 1.0, "start": start, "forces": ["rub"]}}
    content["assembly"] = {"sketch": {"P": [0.0, 0.0]}, "angles": {"a": 0.0, "b": 1.0, "c": 2.0}}
    for order in ("abc", "bca", "cab", "acb"):
        content["joints"] = {"P": {"type": "revolute", "at": [f"{x}.A" for x in order]}}
        mechanism = load_document(content)
        Q = Evaluator(mechanism).terms(0.0, mechanism.q0, mechanism.v0).Q
        np.testing.assert_allclose(Q[2::3], [-0.3 * (3 * w - 8.0) for w in speeds.values()], rtol=1e-14)
    content["format"] = "planar-linkage/1"  # the first edition keeps its meaning: neighbours in the list alone
    first = load_document(content)
    Q = Evaluator(first).terms(0.0, first.q0, first.v0).Q
    np.testing.assert_allclose(Q[2::3], [0.3 * 4.0, 0.3 * 3.0, -0.3 * 7.0], rtol=1e-14)  # a-c and c-b
    assert first.digest != mechanism.digest


def test_what_the_drivers_leave_free_is_named_and_can_be_held():
    with pytest.raises(ChoiceError, match=r'1 free \(angle of payload\).*--hold payload`.*`hold = \["payload"\]` in scenario step'):
        kinematics(str(LEG), intervals=4)
    free = kinematics(str(LEG), intervals=4, hold=["payload=-80"])
    np.testing.assert_allclose(free.links["payload"]["theta"], np.radians(-80.0), rtol=1e-12)
    fixed = kinematics(str(LEG), intervals=4, hold=["F"])  # the payload turns with the shank, from where it hangs
    turned = fixed.links["payload"]["theta"] - fixed.links["shank"]["theta"]
    np.testing.assert_allclose(turned, turned[0], rtol=1e-12)
    for hold, text in (("nix", "no such link or joint; there"), ("payload=low", "is not a number of")):
        with pytest.raises(ChoiceError, match=text):
            kinematics(str(LEG), intervals=4, hold=[hold])


def test_a_spring_that_can_pass_zero_length_is_warned_of(capsys, tmp_path):
    """A block on a rail passes the point at which its spring is fixed; it never reaches a point beside the rail."""
    path = tmp_path / "rail.toml"
    for height, rest, warned in ((0.0, 0.1, True), (0.05, 0.1, False), (0.0, 0.0, False)):
        change = {"ground": {"points": {"S": [0.3, height]}}, "forces": {"cord": {"rest": rest}}}
        path.write_bytes(toml(changed(DATA / "small" / "rail.toml", change)))
        assert bool(load(path).warnings) == warned
        assert main(["simulate", str(path)]) == 0
        assert ("warning: forces.cord: the linkage can bring ground.S and block.C together" in capsys.readouterr().err) == warned
        assert main(["show", str(path)]) == 0
        assert ("warning: forces.cord" in capsys.readouterr().out) == warned


def rotor(force, speed=0.0):
    """A link of 0.5 kg m^2 on a pin, without gravity, under one torque."""
    content = changed(DATA / "small" / "rotor.toml", {"forces": {"push": force}})
    content["scenarios"]["run"]["start"]["speeds"]["a"] = speed
    return load_document(content)


# the law, and the integral of its factor from 0 to 1 s
OVER_TIME = {
    "table": ({"law": "table", "rows": [[0.1, 0.0], [0.3, 1.0], [0.5, 0.2]]}, 0.1 + 0.12 + 0.1),
    "ramp": ({"law": "ramp", "start": 0.2, "time": 0.4}, 0.2 + 0.4),
    "step": ({"law": "step", "start": 0.25}, 0.75),
    "sine": ({"law": "sine", "frequency": 1.25, "phase_deg": 90.0}, 1 / (2.5 * np.pi)),
}


@pytest.mark.parametrize("law", OVER_TIME)
def test_a_torque_over_time_gives_the_impulse_of_its_law(law):
    """omega = integral of the torque over the inertia, to rounding: integration starts anew at kinks and jumps."""
    table, integral = OVER_TIME[law]
    mechanism = rotor({"value": 2.0, "over_time": table})
    assert bool(mechanism.kinks) == (law != "sine")
    found = build_reference(mechanism, 1.0)
    assert found.v[-1, 2] == pytest.approx(2.0 * integral / 0.5, abs=1e-11)
    assert found.error_v[-1] < 1e-11


def test_what_varies_is_refused_by_name_where_it_is_not_known():
    mechanism = load(str(VARYING))
    for name in {*names()} - GIVEN:
        text = str(engine(name).skip(mechanism, Choice()))
        assert "force profile, soft_start, shaker, switch, ratchet varies with time or direction" in text, name
    with pytest.raises(Uncertified, match="force profile varies with time or direction"):
        certify(str(VARYING))
    for kind in KINDS:
        with pytest.raises(ExchangeError, match="varies with time"):
            export_linkage(mechanism, kind, 1e-3)


BY_STEPS = [("gauss", "default"), ("gauss-native", "default"), ("lagrange-native", "default"), ("pinocchio", "default")]


@pytest.mark.long("gauss-native-default", "lagrange-native-default", "pinocchio-default", "mujoco-tuned", "exudyn-tuned")
@pytest.mark.parametrize(("name", "settings"), [*BY_STEPS, ("mujoco", "tuned"), ("exudyn", "tuned")])
def test_equal_steps_keep_their_order_through_kinks_and_jumps(name, settings):
    """Forces vary by tables, a ramp, a switch and a ratchet; samples and steps miss all kinks. The order is 4, Exudyn's is 2."""
    if name != "gauss":
        needs("llvmlite" if name.endswith("-native") else name)
    mechanism, times = load(str(VARYING)), np.linspace(0.0, 0.2, 12)
    method, most, order = ("trapezoidal_index2", 5e-6, 3.5) if name == "exudyn" else ("rk4", 1e-8, 12)
    true = ran(engine("gauss"), mechanism, times, integrator="dop853", step=0.01, tolerance=1e-12)
    coarse, fine = (
        ran(engine(name), mechanism, times, settings=settings, integrator=method, step=0.2 / steps) for steps in (88, 176)
    )
    errors = [np.abs(x.q - true.q).max() for x in (coarse, fine)]
    assert errors[1] < most
    assert errors[0] / errors[1] > order, "steps across a jump would leave order one"
    assert fine.steps > 176, "a step more for every kink that they miss"
