"""No wrong answer is called ok: the certificate, half the step, the fastest mode and the lost digits, each with a known answer."""

from typing import Any

import numpy as np
import pytest

import gauss_bench
from gauss_bench import judge, metrics
from gauss_bench.api.simulate import simulate
from gauss_bench.engines import get
from gauss_bench.engines.base import Choice
from gauss_bench.linkage.load import load, load_document
from gauss_bench.runs.scrutiny import as_truth, disagreement, fastest_rate
from gauss_bench.trajectory import Trajectory
from tests.fuzz.files import toml
from tests.fuzz.mechanics import Mechanics, true_end
from tests.fuzz.motions import over_motions
from tests.random_linkages import random_linkage

MASS, K = 2.0, 8e4


def oscillator(k: float = K, c: float = 0.0) -> dict[str, Any]:
    """A block of 2 kg on a horizontal slide, held by a spring: x = 0.1 cos(w t), w^2 = k / m."""
    return {
        "format": "planar-linkage/1",
        "name": "oscillator",
        "gravity": [0.0, 0.0],
        "ground": {"points": {"O": [0.0, 0.0]}},
        "links": {"block": {"points": {"A": [0.0, 0.0], "B": [0.2, 0.0]}, "mass": MASS, "com": [0.0, 0.0], "inertia": 0.1}},
        "joints": {"slide": {"type": "prismatic", "guide": "ground.O", "block": "block.A"}},
        "forces": {"f": {"type": "axis_spring_damper", "point": "block.A", "k": k, "c": c}},
        "assembly": {"sketch": {"block.A": [0.1, 0.0]}, "angles": {"block": 0.0}},
        "scenarios": {"s": {"duration": 1.0, "forces": ["f"], "start": {"slides": {"slide": 0.1}}}},
    }


def at_rest(document: dict[str, Any]) -> tuple[Any, Trajectory]:
    mechanism = load_document(document)
    still = np.zeros((1, mechanism.n))
    return mechanism, Trajectory(np.zeros(1), mechanism.q0[None], mechanism.v0[None], still, 0)


def test_the_fastest_rate_is_that_of_the_oscillator() -> None:
    assert fastest_rate(*at_rest(oscillator())) == pytest.approx(np.sqrt(K / MASS), rel=1e-6)
    damped = fastest_rate(*at_rest(oscillator(c=100.0)))
    assert damped == pytest.approx(np.sqrt(K / MASS - (100.0 / (2 * MASS)) ** 2), rel=1e-6)


def test_the_fastest_rate_of_a_pendulum_is_its_own() -> None:
    mechanism = load("pendulum")
    hanging = mechanism.q0 * 0
    hanging[2] = -np.pi / 2
    hanging[1] = -0.5
    still = np.zeros((1, 3))
    found = fastest_rate(mechanism, Trajectory(np.zeros(1), hanging[None], still, still, 0))
    assert found == pytest.approx(np.sqrt(1.5 * 9.81), rel=1e-6)


def test_a_step_that_resolves_no_period_is_not_ok(tmp_path: Any) -> None:
    path = tmp_path / "oscillator.toml"
    path.write_bytes(toml(oscillator(k=8e8)))  # a period of 0.3 ms
    found = simulate(str(path), at=[0.0, 0.004])
    assert found.status == "invalid", found.message
    assert "stiffness" in {x.subject for x in found.objections}
    assert "steps in a period of the fastest oscillation" in found.message
    assert "take a step smaller" in found.advice
    assert simulate(str(path), step=1e-5, at=[0.0, 0.01]).status == "ok"


def test_damping_that_no_sample_sees_is_not_held_against_the_energy(tmp_path: Any) -> None:
    """A block let go by a stiff spring is at rest after 0.2 ms; samples lie a millisecond apart."""
    path = tmp_path / "oscillator.toml"
    path.write_bytes(toml(oscillator(k=8e8, c=4e4)))
    found = simulate(str(path), step=2e-5, at=[0.0, 0.005])
    assert found.status == "ok", found.message
    assert "energy is not decidable" in found.message
    assert found.metrics["energy_error"] == pytest.approx(0.5 * 8e8 * 0.1**2, rel=1e-6)


def test_energy_that_is_gained_or_lost_where_samples_see_it_is_told() -> None:
    t = np.array([0.0, 1e-3, 2e-3, 2.1e-3])
    assert metrics.without_loss(t, np.array([0.0, -5.0, -4.0, -7.0]), 5e-4) == pytest.approx([0.0, 0.0, 1.0, -2.0])


def test_energy_that_nothing_else_decides_is_objected_to() -> None:
    drift = metrics.Drift(np.zeros(1), np.zeros(1), np.zeros(1))
    evidence = judge.Evidence(1.0, drift, np.array([0.0, -1.0]), 0.0, 1.0)
    assert not judge.judge(evidence).valid
    decided = judge.Evidence(1.0, drift, evidence.energy, 0.0, 1.0, seen=np.zeros(2))
    assert judge.judge(decided).valid
    assert "1 J are lost" in judge.remark(decided)
    assert not judge.remark(judge.Evidence(1.0, drift, evidence.energy, 0.0, 1.0, seen=evidence.energy))


def test_half_the_step_decides_where_no_truth_is_known(tmp_path: Any) -> None:
    path = tmp_path / "oscillator.toml"
    path.write_bytes(toml(oscillator(k=800.0)))  # a period of 0.3 s
    coarse = simulate(str(path), step=2e-2, integrator="semi_implicit_euler", at=[0.0, 1.0])
    assert "step" in {x.subject for x in coarse.objections}
    fine = simulate(str(path), step=1e-3, at=[0.0, 1.0])
    assert fine.status == "ok"
    assert fine.metrics["halving_length"] < 1e-8
    assert fine.links["block"]["x"][-1] == pytest.approx(0.1 * np.cos(20.0), abs=1e-8)


def test_a_certificate_takes_the_place_of_half_the_step() -> None:
    found = gauss_bench.simulate("four_bar", scenario="torque", at=[0.0, 0.1])
    assert found.status == "ok"
    assert found.metrics["halving_angle"] is None


def test_the_limits_of_half_the_step_are_half_of_those_of_the_truth() -> None:
    mechanism, start = at_rest(oscillator())
    for moved, valid in ((0.4 * judge.OFF_MOTION * 0.2, True), (0.6 * judge.OFF_MOTION * 0.2, False)):
        other = as_truth(Trajectory(start.t, np.add(start.q, [moved, 0.0, 0.0]), start.v, start.a, 0))
        errors = metrics.state_errors(mechanism, start, other)
        drift = metrics.Drift(np.zeros(1), np.zeros(1), np.zeros(1))
        evidence = judge.Evidence(mechanism.size, drift, np.zeros(1), 0.0, 1.0, halving=errors)
        assert judge.judge(evidence).valid is valid


@pytest.mark.parametrize(("lost", "said"), [(1e-12, ""), (2.6e-7, "keep about 6 digits"), (0.5, "")])
def test_lost_digits_are_told_and_lost_accelerations_are_objected_to(lost: float, said: str) -> None:
    drift = metrics.Drift(np.zeros(1), np.zeros(1), np.zeros(1))
    evidence = judge.Evidence(1.0, drift, np.zeros(1), 0.0, 1.0, disagreement=lost)
    assert said in judge.remark(evidence)
    assert bool(judge.remark(evidence)) is bool(said)
    assert judge.judge(evidence).valid is (lost < judge.OFF_ACCELERATION)


def test_formulations_of_a_sound_linkage_agree() -> None:
    mechanism = load("four_bar", "torque")
    still = np.zeros((1, mechanism.n))
    found = disagreement(mechanism, Trajectory(np.zeros(1), mechanism.q0[None], mechanism.v0[None], still, 0))
    assert found is not None
    assert found < 1e-12


def test_the_mechanics_of_the_tests_are_those_of_a_pendulum() -> None:
    """Small swings of a uniform bar: the angle from hanging is a cos(w t), w^2 = 3 g / 2 l."""
    bar = {"points": {"A": [0.0, 0.0], "B": [1.0, 0.0]}, "mass": 2.0, "com": [0.5, 0.0], "inertia": 2.0 / 12}
    document = {
        "ground": {"points": {"O": [0.0, 0.0]}},
        "links": {"bar": bar},
        "joints": {"O": {"type": "revolute", "at": ["ground.O", "bar.A"]}},
        "scenarios": {"s": {}},
    }
    angle, w = 1e-4, np.sqrt(1.5 * 9.81)
    turn = angle - np.pi / 2
    start = np.array([0.5 * np.cos(turn), 0.5 * np.sin(turn), turn])
    found, bar_of_error = true_end(document, "s", start, np.zeros(3), 0.3)
    assert found[2] + np.pi / 2 == pytest.approx(angle * np.cos(w * 0.3), abs=1e-11)
    assert bar_of_error < 1e-8


def test_the_mechanics_of_the_tests_and_of_the_suite_agree_on_every_joint_and_force(tmp_path: Any) -> None:
    """Accelerations at the start, of linkages with slides and springs, derived twice."""
    kinds = set()
    for seed in range(12):
        document = random_linkage(seed)
        mechanism = load_document(document)
        kinds |= {x["type"] for part in ("joints", "forces") for x in document[part].values()}
        own = get("gauss").build(mechanism, Choice("default", "rk4")).acceleration(0.0, mechanism.q0, mechanism.v0)
        other = Mechanics(document, "run").acceleration(mechanism.q0, mechanism.v0)
        assert np.abs(own - other).max() <= 1e-9 * np.abs(own).max(), seed
    assert kinds == {"revolute", "prismatic", "spring_damper", "torque"}


@pytest.mark.slow
def test_no_wrong_motion_of_a_random_linkage_is_called_ok() -> None:
    endings = list(over_motions(1, 6))
    assert [sentence for _, _, sentence in endings if sentence] == []
    assert sum(word == "ok, and right" for _, word, _ in endings) >= 2


def test_a_motion_that_runs_away_makes_no_noise(tmp_path: Any, capfd: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "oscillator.toml"
    path.write_bytes(toml(oscillator(k=1e13)))
    found = simulate(str(path), stabilization="projection", step=1e-2, at=[0.0, 0.9])
    assert found.status == "nan"
    assert capfd.readouterr() == ("", "")


def test_rows_are_judged_like_single_runs_where_no_truth_is_known(tmp_path: Any) -> None:
    path = tmp_path / "oscillator.toml"
    path.write_bytes(toml(oscillator(k=8e8)))  # no reference passes it
    (row,) = rows_of(str(path), "rk4", "none", 0.004)
    assert "no truth to compare with" in row["note"]
    assert "half the step moves a link" in row["message"]
    assert row["status"] == "invalid"


def rows_of(path: str, integrator: str, stabilization: str, until: float) -> list[dict[str, Any]]:
    """Rows of `compare` by gauss at this integrator and stabilisation."""
    found = gauss_bench.compare(path, engines=["gauss"], t_end=until, jobs=1).to_dict("records")
    return [x for x in found if (x["integrator"], x["stabilization"]) == (integrator, stabilization)]
