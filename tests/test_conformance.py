"""What an adapter must keep to: sound ones do, and whoever breaks one rule is told which."""

import json

import numpy as np
import pytest

import gauss_bench.bench.conformance as rules
from gauss_bench.bench.conformance import Check, conformance, effect, lateness
from gauss_bench.cli import main
from gauss_bench.engines import all_names

WRONG = "yuan_ge_eq16"  # as published
ALIKE = ("gauss_pinv", "schur", "udwadia_kalaba", "lagrange-native")  # by the adapter of another


def broken(name: str) -> dict[str, str]:
    return {x.name: x.message for x in conformance(name) if x.passed is False}


def test_a_sound_adapter_keeps_every_rule() -> None:
    checks = conformance("tests.faulty_engines:Sound")
    assert all(x.passed for x in checks), checks
    assert len(checks) > 20


@pytest.mark.slow
@pytest.mark.parametrize("name", [x for x in all_names() if x not in (WRONG, *ALIKE)])
def test_built_in_engines_keep_every_rule(name: str) -> None:
    assert not broken(name)


@pytest.mark.slow
def test_a_formula_that_is_wrong_as_published_is_told() -> None:
    assert broken(WRONG)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("fault", "check", "rule"),
    [
        ("Remembers", "_same_again", "a model can run again"),
        ("Degrees", "_start", "the first sample is the start"),
        ("Late", "_derivatives", "velocities and accelerations are derivatives"),
        ("Short", "_times", "samples are at the times asked for"),
        ("Weightless", "_forces", "a torque acts as defined"),
        ("Unsure", "_undisturbed", "an acceleration is a finite number"),
    ],
)
def test_a_broken_rule_is_named(fault: str, check: str, rule: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """By the check of that rule; that a sound engine passes all of them is told above."""
    monkeypatch.setattr(rules, "CHECKS", [x for x in rules.CHECKS if x.__name__ == check])
    assert any(name.startswith(rule) for name in broken(f"tests.faulty_engines:{fault}"))


def test_effects_are_told_apart() -> None:
    true = np.array([1.0, -2.0, 0.5])
    assert effect(true, true) == ""
    assert effect(0 * true, true) == "it has no effect"
    assert effect(-true, true) == "it acts in the opposite direction"
    assert effect(9.81 * true, true).startswith("its effect is 9.81 times")


def test_lateness_is_counted_in_samples() -> None:
    t = 0.01 * np.arange(100)[:, None]
    for shift in (0.0, 0.5, 1.0, -1.0):
        assert lateness(np.sin(t), np.sin(t - 0.01 * shift)) == pytest.approx(shift, abs=1e-2)


def test_a_class_that_is_not_there_is_a_check_that_failed(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["conformance", "tests.faulty_engines:Absent", "--json"]) == 1
    found = json.loads(capsys.readouterr().out)
    assert not found["passed"]
    assert Check(**found["checks"][0]).passed is False
    assert "Absent" in found["checks"][0]["message"]


def test_an_unknown_name_is_bad_usage() -> None:
    assert main(["conformance", "no_such_engine"]) == 2
