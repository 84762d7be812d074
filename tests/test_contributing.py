"""Rows of the table in CONTRIBUTING.md as worked examples: each is carried out, and its promised effect is checked."""

import csv
import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]


@pytest.mark.long
def test_a_new_engine_is_a_room_and_a_line(tmp_path):
    """The tests of all engines, run in a copy of the project with the engine of the documentation, include it and pass."""
    copied(tmp_path)
    shutil.copytree(ROOT / "tests", tmp_path / "tests")
    shutil.copy(ROOT / "pyproject.toml", tmp_path)
    library = tmp_path / "library"  # apart from the project: one of the tests takes the library away
    library.mkdir()
    (library / "heuns.py").touch()  # which the engine imports and does not need
    engines = tmp_path / "gauss_bench" / "engines"
    (engines / "heuns").mkdir()
    (engines / "heuns" / "__init__.py").write_text('"""Heun\'s method."""\n', encoding="utf-8")
    template = (ROOT / "gauss_bench/docs/pages/template/my_engine/__init__.py").read_text(encoding="utf-8")
    adapter = template.replace('name = "heun"', 'name = "heuns"').replace("return Model", "import heuns\n\n        return Model")
    (engines / "heuns" / "adapter.py").write_text(adapter, encoding="utf-8")
    register = engines / "__init__.py"
    line = '    "heuns": "gauss_bench.engines.heuns.adapter:Heun",\n'
    register.write_text(register.read_text(encoding="utf-8").replace("FOREIGN = {\n", "FOREIGN = {\n" + line, 1), encoding="utf-8")
    chosen = ("tests/test_engines.py", "tests/test_conformance.py", "-k", "heuns", "-m", "not long")
    # a copy of pytest that inherited the outer one's options would run in its processes
    environment = {k: v for k, v in os.environ.items() if not k.startswith("PYTEST")}
    environment |= {"PYTHONPATH": f"{tmp_path}{os.pathsep}{library}", "PYTEST_DISABLE_PLUGIN_AUTOLOAD": "1"}
    command = [sys.executable, "-m", "pytest", "-q", "-x", "-p", "no:cacheprovider", *chosen]
    done = subprocess.run(command, capture_output=True, text=True, cwd=tmp_path, env=environment, check=False)
    assert done.returncode == 0, done.stdout[-3000:]
    marks = done.stdout.split()[0]
    assert "s" not in marks, "none is skipped"
    assert marks.count(".") == 2  # a missing library, and every rule for adapters


def insert(path, before, text):
    source = path.read_text(encoding="utf-8")
    assert source.count(before) == 1, f"{path.name} has changed: {before!r}"
    path.write_text(source.replace(before, text + before), encoding="utf-8")


SECTION = '''"""What the weather was."""

from collections.abc import Iterator

from gauss_bench.report.content import Finding, Section, Table, Text, text_cell
from gauss_bench.report.rows import Run

PLACE = 95


def findings(run: Run) -> Iterator[Finding]:
    if rows := run.table("weather"):
        yield Finding("Weather", f"It was {rows[0]['sky']} in {rows[0]['place']}.")


def section(run: Run) -> Section:
    head = ("place", "sky", "temperature")
    rows = tuple(tuple(text_cell(row[x]) for x in head) for row in run.table("weather"))
    return Section("Weather", "weather", (Text("Looked up by hand."), Table("Weather", head, rows, frozenset({2}))))
'''
TABLE = """
[tables.weather]
meaning = "a place"
keys = 1
columns = [
  { text = "place", meaning = "name" },
  { text = "sky", meaning = "seen" },
  { number = "temperature", unit = "K", meaning = "there" },
]
"""


def copied(folder):
    """Copy the package with its compiled files to a folder, and return the folder."""
    for name in ("gauss_bench", "mechanisms"):
        shutil.copytree(ROOT / name, folder / name)
    return folder


def said_by(folder, *command):
    """Return the output of a command that uses the copied package."""
    environment = os.environ | {"PYTHONPATH": str(folder)}
    done = subprocess.run([sys.executable, *command], capture_output=True, text=True, cwd=folder, env=environment, check=False)
    assert done.returncode == 0, done.stderr[-3000:]
    return done.stdout


@pytest.mark.long
def test_a_new_report_section_with_a_table_of_its_own_is_a_file_and_an_entry_of_the_schema(tmp_path):
    folder = copied(tmp_path)
    (folder / "gauss_bench" / "report" / "sections" / "weather.py").write_text(SECTION, encoding="utf-8")
    with (folder / "gauss_bench" / "tables.toml").open("a", encoding="utf-8") as schema:
        schema.write(TABLE)
    run = folder / "run"
    row = "{'place': 'Bonn', 'sky': 'dry', 'temperature': 281.5}"
    write = f"from pathlib import Path; from gauss_bench.tables import *; d = Path({str(run)!r}); write_schema(d); "
    said_by(folder, "-c", write + f"write_table('weather', [{row}], d)")
    said_by(folder, "-m", "gauss_bench", "report", "--out", str(run))
    assert "**Weather.** It was dry in Bonn." in (run / "README.md").read_text(encoding="utf-8")
    page = (run / "site" / "method.html").read_text(encoding="utf-8")
    assert all(word in page for word in ("Bonn", "dry", "281.5"))


LISTED_SHOWN_DRAWN = """
from gauss_bench.cli import main
assert main(["list"]) == 0
print("SHOWN")
assert main(["show", "my_four_bar", "--svg", "my_four_bar.svg"]) == 0
"""


@pytest.mark.slow
def test_a_new_linkage_is_one_file(tmp_path):
    folder = copied(tmp_path)
    document = (ROOT / "mechanisms" / "four_bar.toml").read_text(encoding="utf-8")
    new, count = re.subn(r'^name( *)= "four_bar"', r'name\1= "my_four_bar"', document, count=1, flags=re.MULTILINE)
    assert count == 1
    (folder / "mechanisms" / "my_four_bar.toml").write_text(new, encoding="utf-8")
    for other in {*(folder / "mechanisms").glob("*.toml")} - {folder / "mechanisms" / f"{x}four_bar.toml" for x in ("", "my_")}:
        other.unlink()  # what there is to say of them takes its time
    listed, shown = said_by(folder, "-c", LISTED_SHOWN_DRAWN).split("SHOWN")
    assert "my_four_bar" in listed
    assert "my_four_bar" in shown
    assert (folder / "my_four_bar.svg").exists()
    command = ("run", "my_four_bar", "--suite", "gate", "--engine", "gauss", "--steps", "0.01", "--until", "0.1", "--no-costs")
    said_by(folder, "-m", "gauss_bench", *command, "--out", "run")
    assert "my_four_bar" in (folder / "run" / "results.csv").read_text(encoding="utf-8")


METRIC = '''def largest_acceleration(mechanism: Mechanism, trajectory: Trajectory) -> float:
    """Of any link's centre of mass [m/s^2]."""
    links = trajectory.a.reshape(len(trajectory.t), len(mechanism.links), 3)
    return float(np.linalg.norm(links[..., :2], axis=-1).max())


'''


ONE_CASE = """
from pathlib import Path
from gauss_bench.bench.cases import Case
from gauss_bench.bench.measure import measure
from gauss_bench.tables import write_schema, write_table
found = measure(Case("four_bar", "torque", "gauss", "default", "rk4", "none", 1e-2, 0.1), "store")
write_table("results", found["results"], Path("run"))
write_schema(Path("run"))
"""


@pytest.mark.slow
def test_a_metric_is_a_function_its_call_and_its_column(tmp_path):
    folder = copied(tmp_path)
    package = folder / "gauss_bench"
    insert(package / "metrics.py", "def energy_scale(", METRIC)
    called = '        "largest_acceleration": metrics.largest_acceleration(mechanism, trajectory),\n'
    insert(package / "bench" / "measure.py", '        "position_drift": float(drift.position.max()),\n', called)
    column = '  { number = "largest_acceleration", unit = "m/s^2", added = true, meaning = "of any centre of mass" },\n'
    insert(
        package / "tables.toml", '  { number = "compared", meaning = "number of times at which the reference is known" },\n', column
    )
    said_by(
        folder,
        "-c",
        f"{ONE_CASE}\nfrom gauss_bench.tables import read_table\nassert read_table('results', Path({str(ROOT / 'reports')!r}))",
    )
    with (folder / "run" / "results.csv").open(newline="", encoding="utf-8") as file:
        rows = [row for row in csv.DictReader(file) if row["status"] == "ok"]
    assert rows
    assert all(0 < float(row["largest_acceleration"]) < 1e5 for row in rows)
    told = json.loads((folder / "run" / "tables.json").read_text(encoding="utf-8"))["tables"]["results"]["columns"]
    assert next(x["unit"] for x in told if x["name"] == "largest_acceleration") == "m/s^2"
