"""A linkage file is read completely, or refused with all its faults, each named by file, table and field."""

import tomllib

import numpy as np
import pytest

from gauss_bench.cli import main
from gauss_bench.linkage.errors import LinkageError
from gauss_bench.linkage.load import MAX_BYTES, built_in, load, load_document
from tests.conftest import DATA

FOUR_BAR = built_in()["four_bar"].read_text(encoding="utf-8")


def write(folder, text, name="four_bar"):
    path = folder / f"{name}.toml"
    path.write_text(text, encoding="utf-8")
    return path


def faults(path, scenario=None):
    with pytest.raises(LinkageError) as caught:
        load(path, scenario)
    assert str(path) in str(caught.value)
    return [str(f) for f in caught.value.faults]


SINGLE = tomllib.loads((DATA / "faults" / "four_bar.toml").read_text(encoding="utf-8"))


@pytest.mark.parametrize("name", SINGLE)
def test_a_fault_is_named_by_file_table_and_field_and_ends_with_2(name, tmp_path, capsys):
    old, new, expected = SINGLE[name].values()
    assert old in FOUR_BAR
    path = write(tmp_path, FOUR_BAR.replace(old, new, 1))
    assert main(["simulate", str(path), "--scenario", "torque", "--at", "0", "--json"]) == 2
    said = capsys.readouterr()
    assert said.out == ""
    assert f"{path}: " in said.err
    assert expected in said.err


def test_independent_faults_are_reported_together(tmp_path):
    names = ("unknown key", "unknown link", "unknown force", "mass negative", "not a number", "wrong joint type", "crank unknown")
    text = FOUR_BAR
    for name in names:
        text = text.replace(SINGLE[name]["old"], SINGLE[name]["new"], 1)
    found = faults(write(tmp_path, text))
    for name in names:
        assert any(SINGLE[name]["said"] in fault for fault in found), (name, found)


@pytest.mark.parametrize(
    ("content", "expected"),
    [
        (b"", "the file is empty"),
        (b"# only a comment\n", "the file is empty"),
        (b"\xff\xfe\x00", "not UTF-8"),
        (b"#" * (MAX_BYTES + 1), "larger than"),
        (b"a = " + b"[" * 100_000, "TOML"),
        (b"x = 1" + b"0" * 5000, "a number cannot be read"),
    ],
)
def test_what_is_no_linkage_file_is_refused(content, expected, tmp_path):
    path = tmp_path / "four_bar.toml"
    path.write_bytes(content)
    assert any(expected in fault for fault in faults(path))


def test_a_path_that_cannot_be_read_and_an_unknown_scenario_are_refused(tmp_path):
    assert faults(tmp_path / "missing.toml")
    assert faults(tmp_path / ".")
    with pytest.raises(LinkageError, match=r"scenarios\.rest: unknown scenario; the file has driven, cycloid, torque"):
        load("four_bar", "rest")


@pytest.mark.parametrize("name", built_in())
def test_every_scenario_of_a_built_in_linkage_starts_on_its_constraints(name):
    from gauss_bench.mechanism.evaluate import Evaluator

    for scenario in load(name).scenarios:
        mechanism = load(name, scenario)
        terms = Evaluator(mechanism).terms(0.0, mechanism.q0, mechanism.v0)
        assert np.abs(terms.phi).max() < 1e-14  # Gauss-Newton ends at rounding of coordinates below 1 m
        assert np.abs(terms.phi_dot).max() < 1e-13  # one linear solve at speeds below 10 rad/s


@pytest.mark.parametrize("turns", [-2, 1])
def test_a_link_that_cannot_turn_over_may_start_whole_turns_from_the_sketch(turns):
    document = tomllib.loads(FOUR_BAR)
    here = load_document(document, "torque")
    rocker = [link.name for link in here.links].index("rocker")
    document["scenarios"]["torque"]["start"] = {"angles": {"rocker": float(here.q0[3 * rocker + 2]) + 2 * np.pi * turns}}
    there = load_document(document, "torque")
    moved = np.zeros(here.n)
    moved[3 * rocker + 2] = 2 * np.pi * turns
    assert there.q0 == pytest.approx(here.q0 + moved, abs=1e-12)


def test_a_multiple_joint_is_pairs_in_list_order():
    document = tomllib.loads(FOUR_BAR)
    document["links"]["flag"] = {"points": {"B": [0.0, 0.0], "E": [0.1, 0.0]}, "bars": [["B", "E"]], "mass": 0.1}
    document["joints"]["B"]["at"].append("flag.B")
    document["assembly"]["angles"] = {"flag": 0.3}
    document["expect"] = {"dof": 2}
    document["scenarios"]["torque"]["start"] = {"crank": 1.0, "speed": 2.0, "angles": {"flag": 0.3}}  # in radians
    mechanism = load_document(document, "torque")
    assert (mechanism.q0[2], mechanism.v0[2]) == pytest.approx((1.0, 2.0), abs=1e-14)
    assert [j.name for j in mechanism.joints] == ["A", "B", "B.001", "C", "D"]
    assert mechanism.dof == 2


def test_a_mechanism_that_others_are_given_too_cannot_be_written_into():
    mechanism = load("four_bar")
    assert load("four_bar") is mechanism
    for array in (mechanism.q0, mechanism.v0, mechanism.gravity):
        with pytest.raises(ValueError, match="read-only"):
            array[0] += 1.0
