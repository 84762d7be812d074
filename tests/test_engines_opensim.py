"""OpenSim, in an environment of its own: what it is given and refuses, and its errors against certificates.

What needs OpenSim is skipped without its environment, in CI too.
"""

import re
import subprocess
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest

import gauss_bench
from gauss_bench.engines import ELSEWHERE, FILE, UnknownEngine, all_names, environment_of, get, names
from gauss_bench.engines.base import Choice
from gauss_bench.engines.opensim.adapter import OpenSim
from gauss_bench.engines.opensim.translate import refusal
from gauss_bench.engines.tree import spanning_tree
from gauss_bench.linkage.load import load
from gauss_bench.mechanism.evaluate import Evaluator
from gauss_bench.mechanism.model import Mechanism
from gauss_bench.metrics import compare_joint_forces, joint_forces, relative_acceleration_error
from gauss_bench.reference.build import random_states
from gauss_bench.reference.certificate import certificate_path, find_certified, read_certificate
from gauss_bench.runs import questions
from gauss_bench.runs.apart import Request, run_of
from gauss_bench.runs.offers import NOT_TOLD, in_python, offers
from gauss_bench.runs.one_run import Asked, sampling_at
from gauss_bench.runs.worker import keep
from gauss_bench.terms import Array
from gauss_bench.trajectory import Status, Trajectory
from tests.conftest import everything, redundant

ENVIRONMENT = environment_of("opensim")
FINDING = Path(__file__).parents[1] / "reports" / "findings" / "opensim_redundant_rows.py"


@pytest.fixture
def opensim(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The adapter of this package, in the environment of OpenSim that the user's file of engines names."""
    if ENVIRONMENT is None:
        pytest.skip("there is no environment of OpenSim here")
    path = tmp_path / "engines.toml"
    path.write_text(f'[opensim]\npython = "{ENVIRONMENT.python}"\n', encoding="utf-8")
    monkeypatch.setenv(FILE, str(path))
    monkeypatch.setattr("gauss_bench.runs.offers._known", {})
    keep("opensim").stop()  # its process may have another file of engines


# crank error after 1 s in steps of 1 ms [rad]; on redundant rows (the parallelogram) that of the default is noise, 4e-8 to 2e-6
MEASURED = [
    ("crank_slider", "paper", "default", 1.5e-8),
    ("eight_bar", "torque", "default", 9.0e-8),
    ("crank_slider", "paper", "tight", 8.1e-9),
    ("eight_bar", "torque", "tight", 8.1e-8),
    ("parallelogram", "torque", "tight", 9.8e-11),
]


@pytest.mark.slow
@pytest.mark.usefixtures("opensim")
@pytest.mark.parametrize(("name", "scenario", "settings", "most"), MEASURED)
def test_the_crank_is_off_the_certificate_by_no_more_than_was_measured(
    name: str, scenario: str, settings: str, most: float
) -> None:
    mechanism = load(name, scenario)
    path = certificate_path(mechanism)
    assert path is not None
    certificate = read_certificate(path)
    (at,) = np.flatnonzero(certificate.t == 1.0)
    run = gauss_bench.simulate(name, "opensim", scenario, settings, step=1e-3, at=[0.0, 1.0])
    assert run.status == "ok", run.message
    crank = mechanism.crank
    assert crank is not None
    error = abs(run.links[mechanism.link_name(crank)]["theta"][-1] - certificate.q[at, 3 * crank + 2])
    assert 0.5 * most < error < 1.2 * most


@pytest.mark.slow
@pytest.mark.usefixtures("opensim")
@pytest.mark.parametrize(("settings", "status"), [("default", "invalid"), ("tight", "ok")])
def test_redundant_rows_of_loops_that_open_a_little_take_the_free_motion_away(settings: str, status: str) -> None:
    run = gauss_bench.simulate("parallelogram", "opensim", "torque", settings, step=1e-3, at=[0.0, 1.0, 2.0])
    assert run.status == status, run.message
    before, after = np.abs(run.links["crank"]["omega"][1:])
    assert before > 30.0
    assert (after < 1.0) == (settings == "default")


@pytest.mark.long
@pytest.mark.skipif(ENVIRONMENT is None, reason="there is no environment of OpenSim here")
def test_the_finding_on_redundant_rows_is_as_told() -> None:
    assert ENVIRONMENT is not None
    told = subprocess.run([ENVIRONMENT.python, str(FINDING)], capture_output=True, text=True, check=True).stdout
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


def answer(mechanism: Mechanism, settings: str, question: Asked, count: int) -> Array:
    """Return OpenSim's answer, of so many numbers, to a question about a mechanism under some settings."""
    choice, wanted = Choice(settings), sampling_at(1e-3, [0.0, 1e-3])
    request = Request(mechanism.sha256, mechanism.scenario, "opensim", choice, wanted, question, answers=count)
    run = run_of(request, mechanism, limit=60.0)
    assert run.status is Status.OK, run.message
    return np.asarray(run.answer)


def certified(mechanism: Mechanism) -> Trajectory:
    """Return all states of a mechanism's certified motion, over one second at most."""
    reference = find_certified(mechanism, min(mechanism.duration, 1.0))
    assert reference is not None
    return Trajectory(reference.t, reference.q, reference.v, reference.a, None)


def told_forces(mechanism: Mechanism, settings: str, states: Trajectory) -> Array:
    """Return the joint forces (k, joints, 3) that OpenSim tells at states; NaN where it tells none."""
    names = tuple(joint.name for joint in mechanism.joints)
    question = partial(questions.joint_forces, names, states.t, states.q, states.v)
    return answer(mechanism, settings, question, 3 * len(names) * len(states.t))


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
@pytest.mark.usefixtures("opensim")
@pytest.mark.parametrize(("name", "scenario", "settings"), FORCED)
def test_forces_of_all_joints_are_those_of_the_certified_accelerations(name: str, scenario: str, settings: str) -> None:
    mechanism = load(name, scenario)
    states = certified(mechanism)
    told = told_forces(mechanism, settings, states)
    assert np.isfinite(told).all()
    error, largest = compare_joint_forces(Evaluator(mechanism), states, told)
    assert error <= EXACT * largest


@pytest.mark.usefixtures("opensim")
def test_forces_that_redundant_rows_leave_undetermined_are_not_told() -> None:
    parallelogram, doubled = load("parallelogram", "torque"), redundant()  # a four-bar whose last pin stands there twice
    assert np.isnan(told_forces(parallelogram, "default", certified(parallelogram))).all()
    states = certified(load("four_bar", "torque"))
    told, true = told_forces(doubled, "default", states), joint_forces(Evaluator(doubled), states)
    assert np.isnan(told[:, 3:]).all()
    sure = np.array([[x["fx"], x["fy"], x["moment"]] for x in true.values()]).transpose(2, 0, 1)[:, :3]
    assert np.abs(told[:, :3] - sure).max() <= EXACT * np.abs(sure).max()


@pytest.mark.slow(*SLOW)
@pytest.mark.usefixtures("opensim")
@pytest.mark.parametrize(("name", "scenario", "settings"), [*FORCED, ("parallelogram", "torque", "default")])
def test_accelerations_at_certified_and_at_200_random_states_are_exact(name: str, scenario: str, settings: str) -> None:
    mechanism = load(name, scenario)
    for states in (certified(mechanism), random_states(mechanism)):
        question = partial(questions.accelerations, states.t, states.q, states.v)
        told = answer(mechanism, settings, question, states.a.size)
        assert relative_acceleration_error(told, states.a).max() <= EXACT


@pytest.mark.usefixtures("opensim")
@pytest.mark.parametrize("name", ["crank_slider", "four_bar"])
def test_a_crank_at_constant_speed_is_prescribed(name: str) -> None:
    run = gauss_bench.simulate(name, "opensim", "driven", at=[0.0, 0.1])
    assert run.status == "ok", run.message
    assert run.links["crank"]["theta"][-1] == pytest.approx(0.2 * np.pi, abs=1e-12)
    assert run.links["crank"]["omega"][-1] == pytest.approx(2 * np.pi, abs=1e-12)


@pytest.mark.usefixtures("opensim")
def test_steps_that_opensim_chooses_are_counted_and_follow_the_tolerance() -> None:
    few, many = (
        gauss_bench.simulate("four_bar", "opensim", integrator="rk_merson_adaptive", tolerance=x, at=[0.0, 0.2])
        for x in (1e-5, 1e-9)
    )
    assert few.status == many.status == "ok"
    assert few.metrics["steps"] < many.metrics["steps"]


@pytest.mark.parametrize(
    ("force", "reason"),
    [
        ("guy", "OpenSim cannot turn the force guy with a third link"),
        ("world", "OpenSim has no spring or damper along an axis that is not a slide's (world)"),
        ("stretch", None),
        ("push", None),
        ("coil", None),
        ("motor", None),
        ("wind", None),
        ("jet", None),
        ("grease", None),
    ],
)
def test_a_force_without_an_exact_element_is_refused_by_name(force: str, reason: str | None) -> None:
    whole = everything()
    alone = replace(whole, forces=tuple(f for f in whole.forces if f.name == force))
    assert refusal(alone, spanning_tree(alone)) == reason


def test_a_damper_on_a_sum_of_coordinates_is_refused_by_name() -> None:
    pin, chain = load("crank_slider", "paper"), everything()
    assert refusal(pin, spanning_tree(pin)) is None
    (coil,) = (f for f in chain.forces if f.name == "coil")
    far = replace(chain, forces=(replace(coil, a=-1),))  # between the ground and the beam lie two hinges
    assert refusal(far, spanning_tree(far)) == "OpenSim has no spring or damper on a sum of coordinates (coil)"


@pytest.mark.parametrize(
    ("name", "scenario", "words"),
    [
        ("four_bar", "cycloid", "no motion law sine"),
        ("excavator", None, "not the length"),
        ("sleigh", None, "knife edge"),
    ],
)
def test_a_driver_or_joint_that_opensim_cannot_have_is_refused(name: str, scenario: str | None, words: str) -> None:
    mechanism = load(name, scenario)
    assert words in str(OpenSim().skip(mechanism, Choice()))


def test_without_its_environment_the_engine_is_not_listed_and_told_how_to_install(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(FILE, str(tmp_path / "engines.toml"))
    monkeypatch.setattr("gauss_bench.runs.offers._known", {})
    assert not {*ELSEWHERE} & {*all_names()}
    for ask in (get, lambda name: offers([name])):
        with pytest.raises(UnknownEngine, match="engines install opensim"):
            ask("opensim")
    (tmp_path / "engines.toml").write_text('[opensim]\npython = "/nowhere/python"\n')  # which needs no class
    assert "opensim" in names()
    assert isinstance(get("opensim"), OpenSim)
    mechanism = load("four_bar")
    assert in_python("opensim", mechanism, Choice()) == ""
    (tmp_path / "engines.toml").write_text('[opensim]\nclass = "my_engine:Other"\npython = "/nowhere/python"\n')
    assert in_python("opensim", mechanism, Choice()) == NOT_TOLD  # and that class is not imported here


WORDS = {"newton": r"\bkamino\b|engines.newton"}  # where an engine has the name of laws and of methods


def test_outside_its_room_one_line_of_python_names_the_engine() -> None:
    package = Path(gauss_bench.__file__).parent
    for name in ELSEWHERE:
        files = [p for p in package.rglob("*.py") if package / "engines" / name not in p.parents]
        lines = [
            line
            for p in files
            for line in p.read_text(encoding="utf-8").splitlines()
            if re.search(WORDS.get(name, rf"\b{name}\b"), line, re.IGNORECASE)
        ]
        assert len(lines) == 1
        assert (package / "engines" / name / "requirements.txt").exists()
        assert "://" not in (package / "engines" / name / "requirements.txt").read_text(encoding="utf-8")
