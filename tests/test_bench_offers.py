"""An engine of others that aborts, lies, prints or lacks something is a result with a reason, in every verb."""

import json
import subprocess
import sys

import pytest

from gauss_bench import cli
from gauss_bench.bench.cases import variants
from gauss_bench.engines.base import Choice
from gauss_bench.linkage.load import load
from gauss_bench.runs import offers
from gauss_bench.runs.offers import ChoiceError
from gauss_bench.trajectory import Status
from tests.plugin import NAMES, installed


def test_an_engine_whose_library_is_missing_cannot_be_used_and_is_described_all_the_same(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(sys.modules, "mujoco", None)
    monkeypatch.setattr(offers, "_known", {})
    told, sound = offers.offers(["mujoco", "gauss"])
    assert (told.status, told.version, sound.usable) == (Status.SKIP, "not installed", True)
    assert told.reason.endswith("; pip install 'gauss-bench[mujoco]'")
    assert {"rk4", "implicitfast"} <= {*told.integrators}
    assert variants(told) == [("default", "", "none")]  # one row of a suite, which says why
    with pytest.raises(ChoiceError, match="mujoco has no integrator 'rk5'"):
        told.choose(None, "rk5", None, 1e-3)
    assert cli.main(["simulate", "four_bar", "--engine", "mujoco", "--at", "0.01", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert (found["status"], found["message"]) == ("skip", told.reason)
    assert cli.main(["list"]) == 0
    assert f"mujoco         skip: {told.reason}" in capsys.readouterr().out


def test_every_engine_tells_what_of_ours_runs_in_python_inside_its_time() -> None:
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


@pytest.fixture(scope="module")
def environment(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    return installed(tmp_path_factory.mktemp("plugin"))


CODE = """
import json
import gauss_bench
from gauss_bench.runs.offers import offers
told = {x.name: [str(x.status), x.reason] for x in offers()}
runs = {x: gauss_bench.simulate("four_bar", x, at=[0.05], step=5e-3, limit=60.0) for x in NAMES}
rows = gauss_bench.compare("four_bar", ["gauss", *NAMES], steps=(1e-2,), t_end=0.1, jobs=1)
best = rows.groupby("engine")["status"].agg(lambda x: sorted(set(x)))
why = rows.groupby("engine")["message"].first()
print(json.dumps([told, {k: [str(x.status), x.message] for k, x in runs.items()}, best.to_dict(), why.to_dict()]))
"""


@pytest.mark.long
@pytest.mark.slow
def test_engines_of_others_are_results_with_a_reason(environment: dict[str, str]) -> None:
    code = f"NAMES = {NAMES!r}\n{CODE}"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, env=environment, timeout=400, check=False)
    assert done.returncode == 0, done.stderr
    offered, runs, rows, why = json.loads(done.stdout)
    assert offered["gauss"] == ["ok", ""]
    assert offered["bare"][0] == "error"
    assert "no method version, skip, build" in offered["bare"][1]
    assert offered["absent"][0] == "skip"
    expected = {"aborts": "crashed", "spoils": "ok", "short": "incomplete", "rests": "invalid", "wordy": "error"}
    expected |= {"letters": "error", "bare": "error", "absent": "skip"}
    assert {k: status for k, (status, _) in runs.items()} == expected
    assert "SIGABRT" in runs["aborts"][1]
    assert "5 of" in runs["short"][1]
    assert "ok" in rows["gauss"]
    assert rows["aborts"] == ["crashed"]
    assert rows["short"] == ["incomplete"]
    assert rows["bare"] == rows["letters"] == ["error"]
    assert why["bare"] == runs["bare"][1] == offered["bare"][1]
    assert why["letters"] == "TypeError: integrators is a text, not names"
    assert why["wordy"].startswith("ValueError: a first line and more")
    assert why["wordy"].isprintable()
    assert len(why["wordy"]) < 600
    assert rows["absent"] == ["skip"]
