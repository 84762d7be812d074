"""DART, in an environment of its own: the forces that it is given, what it refuses, and its errors against certificates.

What needs DART is skipped without its environment, in CI too.
"""

import os
from dataclasses import replace
from importlib.metadata import EntryPoint
from pathlib import Path

import numpy as np
import pytest

import gauss_bench
from gauss_bench.engines import FILE, environment_of, get, names
from gauss_bench.engines.base import Choice
from gauss_bench.engines.dart.adapter import Dart
from gauss_bench.engines.dart.messages import Messages
from gauss_bench.engines.dart.translate import EXPLICIT, IMPLICIT, forces_of
from gauss_bench.engines.given_forces import on_one_joint
from gauss_bench.engines.tree import spanning_tree
from gauss_bench.engines.tree_loads import OnJoints
from gauss_bench.linkage.load import load
from gauss_bench.mechanism.forces import AppliedForces
from gauss_bench.mechanism.model import AngleDriver
from gauss_bench.reference.certificate import certificate_path, read_certificate
from gauss_bench.runs.worker import keep
from gauss_bench.terms import Array
from gauss_bench.trajectory import RunFailure, Status
from tests.conftest import everything

ENVIRONMENT = environment_of("dart")


@pytest.fixture
def dart(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The adapter of this package, in the environment of DART that the user's file of engines names."""
    if ENVIRONMENT is None:
        pytest.skip("there is no environment of DART here")
    path = tmp_path / "engines.toml"
    path.write_text(f'[dart]\npython = "{ENVIRONMENT.python}"\n', encoding="utf-8")
    monkeypatch.setenv(FILE, str(path))
    monkeypatch.setattr("gauss_bench.runs.offers._known", {})
    keep("dart").stop()  # its process may have another file of engines


def crank_error(name: str, scenario: str, settings: str, step: float) -> float:
    """Error of the crank's angle after 1 s [rad]."""
    mechanism = load(name, scenario)
    path = certificate_path(mechanism)
    assert path is not None
    certificate = read_certificate(path)
    (at,) = np.flatnonzero(certificate.t == 1.0)
    run = gauss_bench.simulate(name, "dart", scenario, settings, step=step, at=[0.0, 1.0])
    assert run.links, run.message
    crank = mechanism.crank
    assert crank is not None
    return float(abs(run.links[mechanism.link_name(crank)]["theta"][-1] - certificate.q[at, 3 * crank + 2]))


# crank error after 1 s in steps of 1 ms [rad]
MEASURED = [
    ("crank_slider", "paper", "explicit", 0.0904),
    ("eight_bar", "torque", "explicit", 0.0537),
    ("parallelogram", "torque", "explicit", 0.0326),
    ("crank_slider", "paper", "shut", 0.0553),
    ("crank_slider", "paper", "default", 0.0614),
]


@pytest.mark.slow
@pytest.mark.usefixtures("dart")
@pytest.mark.parametrize(("name", "scenario", "settings", "most"), MEASURED)
def test_the_crank_is_off_the_certificate_by_no_more_than_was_measured(
    name: str, scenario: str, settings: str, most: float
) -> None:
    assert 0.8 * most < crank_error(name, scenario, settings, 1e-3) < 1.2 * most


@pytest.mark.slow
@pytest.mark.usefixtures("dart")
def test_a_tenth_of_the_step_leaves_a_tenth_of_the_error() -> None:
    coarse, fine = (crank_error("parallelogram", "torque", "explicit", step) for step in (1e-3, 1e-4))
    assert coarse / fine == pytest.approx(10.0, rel=0.05)


@pytest.mark.usefixtures("dart")
@pytest.mark.parametrize("name", ["crank_slider", "four_bar"])
def test_a_crank_at_constant_speed_is_prescribed(name: str) -> None:
    run = gauss_bench.simulate(name, "dart", "driven", at=[0.0, 0.1])
    assert run.status == "ok", run.message
    assert run.links["crank"]["theta"][-1] == pytest.approx(0.2 * np.pi, abs=1e-12)
    assert run.links["crank"]["omega"][-1] == pytest.approx(2 * np.pi, abs=1e-12)


@pytest.mark.usefixtures("dart")
def test_a_crank_with_a_motion_law_has_its_speed_at_every_sample_and_its_place_to_first_order() -> None:
    (driver,) = load("four_bar", "cycloid").drivers
    assert isinstance(driver, AngleDriver)
    run = gauss_bench.simulate("four_bar", "dart", "cycloid", at=[0.0, 0.1, 0.2], step=1e-3)
    for t, theta, omega in zip(run.t, run.links["crank"]["theta"], run.links["crank"]["omega"], strict=True):
        value, rate, _ = driver.law(t)
        assert omega == pytest.approx(rate, abs=1e-9)
        assert theta == pytest.approx(value, abs=1e-3 * np.abs(rate) + 1e-12)


@pytest.mark.usefixtures("dart")
def test_a_run_that_blows_up_is_a_warning_of_one_sentence() -> None:
    run = gauss_bench.simulate("eight_bar", "dart", "torque", "shut,lcp=PGS", at=[0.0, 1.0], step=1e-2)
    assert run.status == "warning"
    assert run.message.startswith("DART: Warning")
    assert "\x1b" not in run.message


@pytest.mark.parametrize("joint_forces", [IMPLICIT, EXPLICIT])
def test_forces_that_dart_has_and_is_given_are_all_forces(joint_forces: str, rng: np.random.Generator) -> None:
    """As generalised forces on the tree, at random states."""
    mechanism = everything()
    tree = spanning_tree(mechanism)
    given = forces_of(mechanism, tree, joint_forces)
    assert bool(given.own) == (joint_forces == IMPLICIT)
    whole = AppliedForces(replace(mechanism, gravity=np.zeros(2)))
    for _ in range(3):
        y, dy = rng.standard_normal((2, tree.n))
        q, v, _ = tree.absolute(y, dy, np.zeros(tree.n))
        own = sum((spring(x, y, dy) for x in given.own), np.zeros(tree.n))
        on_links = given.on_links(0.3, y, dy)
        assert on_links is not None
        found = own + given.on_joints(y, dy) + tree.forces(q, on_links)
        np.testing.assert_allclose(found, tree.forces(q, whole.generalised(q, v, 0.3)), atol=1e-11 * np.abs(found).max())


def spring(x: OnJoints, y: Array, dy: Array) -> Array:
    """Force (n,) of a spring and damper of a joint."""
    return np.asarray((x.k * (x.rest - x.row @ y - x.constant) - x.c * x.row @ dy) * x.row)


def test_dart_has_springs_on_one_coordinate_of_its_tree_alone() -> None:
    alone, both = np.array([0.0, -1.0, 0.0]), np.array([1.0, -1.0, 0.0])
    assert on_one_joint(OnJoints(alone, 0.0, 1.0, 0.0, 0.0))
    assert not on_one_joint(OnJoints(both, 0.0, 1.0, 0.0, 0.0))


def test_what_runs_in_python_is_told() -> None:
    dart = Dart()
    assert dart.in_python(load("parallelogram", "torque"), Choice("default")) == ""
    assert "forces" in dart.in_python(load("crank_slider", "paper"), Choice("explicit"))
    assert dart.in_python(load("four_bar", "cycloid"), Choice("default")).startswith("motion laws")


def test_a_plug_in_of_that_name_is_used_where_there_is_no_environment(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(FILE, str(tmp_path / "engines.toml"))
    point = EntryPoint("dart", "tests.faulty_engines:Sound", "gauss_bench.engines")
    monkeypatch.setattr("gauss_bench.engines._plug_ins", lambda: [point])
    assert names().count("dart") == 1
    assert type(get("dart")).__name__ == "Sound"


@pytest.mark.parametrize(
    ("name", "scenario", "words"),
    [("excavator", None, "not the length"), ("sleigh", None, "knife edge")],
)
def test_what_dart_cannot_have_is_refused(name: str, scenario: str | None, words: str) -> None:
    assert words in str(Dart().skip(load(name, scenario), Choice()))


def test_a_driven_link_without_a_hinge_on_the_ground_is_refused() -> None:
    mechanism = load("four_bar", "driven")
    (driver,) = mechanism.drivers
    assert isinstance(driver, AngleDriver)
    assert Dart().skip(mechanism, Choice()) is None
    coupler = replace(mechanism, drivers=(replace(driver, link=1),))
    assert Dart().skip(coupler, Choice()) == "DART prescribes coordinates of the tree of joints, and the driven angle is none"


def test_what_a_library_prints_is_a_failure_with_its_first_line_and_does_not_reach_the_streams(
    capfd: pytest.CaptureFixture[str],
) -> None:
    with Messages() as messages:
        messages.check()
        os.write(2, b"\x1b[1;33mWarning [X.cpp:1]\x1b[0m Non-finite\n" * 3)
        os.write(1, b"and more\n")
        with pytest.raises(RunFailure, match=r"^DART: Warning \[X.cpp:1\] Non-finite$") as caught:
            messages.check()
    assert caught.value.status is Status.WARNING
    print("after")
    assert capfd.readouterr() == ("after\n", "")
