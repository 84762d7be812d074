"""An engine of others that aborts, lies, prints or lacks something is a result with a reason, in every verb."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

PLUGIN = """
import os
from gauss_bench.engines.interpreted import Interpreted

class Engine(Interpreted):
    def __init__(self):
        super().__init__("gauss")
        self.name = type(self).__name__.lower()
        self.integrators, self.stabilizations = ("rk4",), ("none",)
    def build(self, mechanism, choice):
        model = Interpreted("gauss").build(mechanism, choice)
        run, read = model.run, model.read
        model.run = lambda: (self.hook(), run())
        model.read = lambda: self.told(read())
        return model
    def hook(self):
        pass
    def told(self, trajectory):
        return trajectory

class Aborts(Engine):
    def hook(self):
        os.abort()

class Spoils(Engine):
    def hook(self):
        print("noise" * 1000)
        for k in range(3, 12):
            try:
                os.write(k, b"X" * 64)
            except OSError:
                pass

class Short(Engine):
    def told(self, x):
        return type(x)(x.t[:5], x.q[:5], x.v[:5], x.a[:5], 5)

class Rests(Engine):
    def told(self, x):
        return type(x)(x.t, 0 * x.q + x.q[0], 0 * x.v, 0 * x.a, x.steps)

class Wordy(Engine):
    def hook(self):
        raise ValueError("a first line\\n" + "and more \\x00" * 1000)

class Letters(Engine):
    def __init__(self):
        super().__init__()
        self.integrators = "rk4"

class Bare:
    name = "bare"
"""
NAMES = ("aborts", "spoils", "short", "rests", "wordy", "letters", "bare", "absent")


@pytest.fixture(scope="module")
def environment(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    folder = tmp_path_factory.mktemp("plugin")
    (folder / "others.py").write_text(PLUGIN, encoding="utf-8")
    made = folder / "others-1.0.dist-info"
    made.mkdir()
    (made / "METADATA").write_text("Metadata-Version: 2.1\nName: others\nVersion: 1.0\n", encoding="utf-8")
    points = "".join(f"{x} = {'nowhere' if x == 'absent' else 'others'}:{x.capitalize()}\n" for x in NAMES)
    (made / "entry_points.txt").write_text(f"[gauss_bench.engines]\n{points}", encoding="utf-8")
    root = str(Path(__file__).parents[1])
    return os.environ | {"PYTHONPATH": os.pathsep.join([root, str(folder)])}


CODE = """
import json
import gauss_bench
from gauss_bench.bench.offers import offers
told = {x.name: [str(x.status), x.reason] for x in offers()}
runs = {x: gauss_bench.simulate("four_bar", x, at=[0.05], step=5e-3, limit=60.0) for x in NAMES}
rows = gauss_bench.compare("four_bar", ["gauss", *NAMES], steps=(1e-2,), t_end=0.1, jobs=1)
best = rows.groupby("engine")["status"].agg(lambda x: sorted(set(x)))
why = rows.groupby("engine")["message"].first()
print(json.dumps([told, {k: [str(x.status), x.message] for k, x in runs.items()}, best.to_dict(), why.to_dict()]))
"""


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
