"""An engine of others that aborts, lies, prints or lacks something is a result with a reason, in every verb."""

import json
import sys

import pytest

from gauss_bench import cli
from gauss_bench.bench.cases import combinations
from gauss_bench.engines.base import Choice
from gauss_bench.linkage.load import load
from gauss_bench.runs import offers
from gauss_bench.runs.offers import ChoiceError
from gauss_bench.trajectory import Status


def test_an_engine_whose_library_is_missing_cannot_be_used_and_is_described_all_the_same(monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "mujoco", None)
    monkeypatch.setattr(offers, "_known", {})
    told, sound = offers.offers(["mujoco", "gauss"])
    assert (told.status, told.version, sound.usable) == (Status.SKIP, "not installed", True)
    assert told.reason.endswith("; pip install 'gauss-bench[mujoco]'")
    assert {"rk4", "implicitfast"} <= {*told.integrators}
    assert combinations(told) == [("default", "", "none")]  # one row of a suite, which says why
    with pytest.raises(ChoiceError, match="mujoco has no integrator 'rk5'"):
        told.choose(None, "rk5", None, 1e-3)
    assert cli.main(["simulate", "four_bar", "--engine", "mujoco", "--at", "0.01", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert (found["status"], found["message"]) == ("skip", told.reason)
    assert cli.main(["list"]) == 0
    assert f"mujoco         skip: {told.reason}" in capsys.readouterr().out


def test_every_engine_tells_what_of_ours_runs_in_python_inside_its_time():
    """Motion laws are the suite's: no library has one of its own. One that is not of this package is not asked."""
    free, driven = load("four_bar", "torque"), load("four_bar", "driven")
    for name in offers.SAFE:
        assert isinstance(offers.in_python(name, free, Choice()), str)
    for name in ("mujoco", "exudyn", "casadi", "gauss-native"):
        assert offers.in_python(name, free, Choice()) == ""
    for name in ("mujoco", "exudyn"):
        assert "motion laws" in offers.in_python(name, driven, Choice())
    assert "projection" in offers.in_python("casadi", free, Choice(stabilization="projection"))
    assert "steps" in offers.in_python("pinocchio", free, Choice())
    compiled = next(x for x in offers.offer("pinocchio").variants if x.startswith("compiled"))
    assert offers.in_python("pinocchio", free, Choice(compiled)) == ""
    assert offers.in_python("elsewhere:Engine", free, Choice()) == offers.NOT_TOLD


def test_engines_are_a_list_of_names_each_asked_once():
    assert [x.name for x in offers.offers(["lagrange", "gauss", "lagrange"])] == ["lagrange", "gauss"]
    for wrong in ("gauss", ["gauss", 3]):
        with pytest.raises(TypeError, match="engines must be a list of names"):
            offers.offers(wrong)
