"""The report of an invented run: its sentences follow from the rows, it has every row, and a second build gives the same files."""

import json
import math
import re
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from gauss_bench.linkage import schema
from gauss_bench.linkage.load import built_in, load, load_document
from gauss_bench.report.build import all_findings, build_report, read_run
from gauss_bench.report.drawings.drawing import draw, write_drawings
from gauss_bench.report.rows import KEYS

ROOT = Path(__file__).parents[1]
BAR = 3e-13
STEPS = (0.008, 0.004, 0.002, 0.001)
NATIVE = {"gauss": 60e-6, "lagrange": 40e-6, "yuan_ge_eq16": 70e-6}
ENVIRONMENT = {"suite": "gauss_bench 0.1.0", "date": "2026-11-20", "commit": "0123456789abcdef", "dirty": False, "wall_time": 321.5}
ENVIRONMENT |= {"engines": {"mujoco": {"version": "mujoco 4.0.0", "settings": {"stiff": {"solref": [0.002, 1.0]}}}}}
Row = dict[str, Any]


def case(mechanism: str, engine: str, settings: str, integrator: str, stabilization: str, step: float) -> Row:
    key = (mechanism, "torque", engine, settings, integrator, stabilization, step, 2.0)
    return dict(zip(KEYS, key, strict=True)) | {"status": "ok", "message": "", "note": "", "valid": True, "control": False}


def ran(row: Row, error: float, acceleration: float, cost: float, /, **ratios: float) -> Row:
    """Return a case that ended, with its errors and drift, the cost of a step, and ratios of costs with their ranges."""
    drift = 1e-16 if row["stabilization"] == "projection" else error / 5
    row |= {"measured_error_t05": error / 50, "measured_error_t1": error / 8, "measured_error_t2": error}
    row |= {"position_drift": drift, "velocity_drift": 20 * drift, "acceleration_residual": 1e-13, "energy_error": error / 3}
    row |= {"position_error_bar": BAR, "velocity_error_bar": 10 * BAR, "energy_error_bar": BAR, "position_error": 1.5 * error}
    row |= {"acceleration_error_median": acceleration, "acceleration_error_max": 8 * acceleration, "steps": int(2.0 / row["step"])}
    for name, x in ratios.items():
        row |= {f"{name}_ratio": x, f"{name}_ratio_low": 0.96 * x, f"{name}_ratio_high": 1.05 * x}
    return row | {"step_time": cost, "build_time": 2e-3}


def invented(mechanisms: tuple[str, ...] = ("four_bar", "six_bar")) -> list[Row]:
    rows = []
    for mechanism, step in ((m, h) for m in mechanisms for h in STEPS):
        for engine, cost in NATIVE.items():
            control = engine == "yuan_ge_eq16"
            for integrator, order in (("rk4", 4), ("semi_implicit_euler", 1)):
                for stabilization in ("none", "projection"):
                    error = 8.0 if control else {4: 2e4, 1: 3.0}[order] * step**order + 4e-15
                    row = case(mechanism, engine, "default", integrator, stabilization, step)
                    row |= {"valid": not control, "control": control}
                    ratio = cost / NATIVE["lagrange"]
                    row = ran(row, error, 0.7 if control else 3e-14, order * cost, step=ratio, acceleration=1.02 * ratio)
                    rows.append(row | {"observed_order": order, "acceleration_time": cost})
        for settings, softness in (("default", 3e-2), ("stiff", 3e-5)):
            row = case(mechanism, "mujoco", settings, "implicit", "none", step) | {"valid": False, "native_step_time": 3e-6}
            rows.append(ran(row, softness, 10 * softness, 9e-6, step=0.06, native_step=0.02))
        exact = case(mechanism, "pinocchio", "default", "rk4", "none", step)
        rows.append(ran(exact, 2e4 * step**4 + 4e-15, 2e-14, 12e-6, step=0.08))
        failed = case(mechanism, "exudyn", "default", "generalized_alpha", "none", step) | {"valid": False}
        message = "Newton did not converge at t = 0.31 s | step <size>\nsee *log*"
        status, message = ("nan", message) if step > 0.004 else ("skip", "no such pair")
        rows.append(failed | {"status": status, "message": message})
    adaptive = (ran(case(m, "gauss", "default", "dop853", "none", 0.001), 1e-13, 3e-14, 1e-4) for m in mechanisms)
    return rows + [row | {"step": math.nan} for row in adaptive]


def write_run(folder: Path, rows: list[Row]) -> Path:
    """Write the tables of a run into a folder as the runner does, and return the folder."""
    folder.mkdir(parents=True, exist_ok=True)
    pd.DataFrame(rows).to_csv(folder / "results.csv", index=False)
    kept = ("position_drift", "velocity_drift", "energy_error")
    ends = [row for row in rows if row["status"] == "ok"]
    series = [{k: row[k] for k in KEYS} | {"t": t} | {k: row[k] * t**2 for k in kept} for row in ends for t in (0.0, 0.5, 1.0)]
    pd.DataFrame(series, columns=None if series else [*KEYS, "t"]).to_csv(folder / "series.csv", index=False)
    reference = {"scenario": "torque", "t_end": 2.0, "method": "two integrations", "error_bar_q": BAR, "measured_t05": 1.0}
    references = [{"mechanism": name} | reference for name in sorted({str(r["mechanism"]) for r in rows})]
    pd.DataFrame(references).to_csv(folder / "references.csv", index=False)
    (folder / "environment.json").write_text(json.dumps(ENVIRONMENT))
    return folder


@pytest.fixture(scope="module")
def report(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = write_run(tmp_path_factory.mktemp("run"), invented())
    build_report(folder)
    return folder


def lines_of(folder: Path) -> list[str]:
    """Return the rows of all cases in the tables of the site, with | between their cells."""
    pages = "".join(path.read_text() for path in (folder / "site").glob("linkage-*-rows.html"))
    rows = re.findall(r"<tr(?: hidden)?>(<td.*)", pages)
    return ["|".join(re.sub(r"<[^>]*>", "", f"<{cell}") for cell in row.split("<td")[1:]) for row in rows]


def text_of(rows: list[Row], folder: Path) -> str:
    """Return the tones, titles and texts of all findings of a run with these rows."""
    return "\n".join(f"{x.tone}: {x.title}: {x.text}" for x in all_findings(read_run(write_run(folder, rows))))


def test_the_control_is_named_and_what_is_not_valid_ranks_nowhere(tmp_path: Path) -> None:
    """The soft engine with stiff settings is the cheapest within 1e-3, but it is not valid."""
    text = text_of(invented(), tmp_path)
    assert "`yuan_ge_eq16` satisfies the constraints of acceleration to 1.0e-13 and is still wrong" in text
    assert "No row of it passes the gate" in text
    assert "bad: The negative control" in text_of([row | {"valid": True} for row in invented()], tmp_path)
    assert re.search(r"four_bar, torque: .*Cheapest within 1e-03 rad: `pinocchio` rk4 at step 0.008 s, 3 ms", text)
    assert not re.search(r"Cheapest within \S+ rad: `(mujoco|yuan)", text)


@pytest.mark.slow
def test_every_case_is_in_the_tables_and_failures_keep_their_sentence(report: Path) -> None:
    lines = lines_of(report)
    assert len(lines) == len(read_run(report).results) == len(invented())
    page = (report / "site" / "method.html").read_text()
    assert "Newton did not converge at t = 0.31 s | step &lt;size&gt;" in page
    assert '<span class="t-bad">nan</span>' in page, "the status nan was read as a missing number"
    exact = [x for x in lines if x.startswith("gauss|default|dop853")]
    assert len(exact) == 2
    assert all("|own|" in x and "|&lt; 3e-13|" in x and "1.0e-13|1.0e-13" not in x for x in exact), "below the reference's bar"


@pytest.mark.long
def test_built_twice_is_the_same_byte_for_byte(report: Path, tmp_path: Path) -> None:
    other = write_run(tmp_path, invented()[::-1])
    files = build_report(other)
    assert len(files) > 20
    for path in files:
        assert path.read_bytes() == (report / path.relative_to(other)).read_bytes(), path.name
    assert not list(other.rglob("*.part"))


def test_a_run_of_an_unknown_linkage_without_an_environment_is_reported(tmp_path: Path) -> None:
    rows = [case("unheard_of", "new_engine", "", "", "", math.nan) | {"status": "crashed", "valid": False}]
    (write_run(tmp_path, rows) / "environment.json").unlink()
    build_report(tmp_path)
    page = (tmp_path / "site" / "method.html").read_text()
    assert "crashed" in page
    assert not re.search(r"\bnan\b", page, re.IGNORECASE)


@pytest.mark.slow
def test_drawings_show_every_link_and_are_up_to_date(tmp_path: Path) -> None:
    for path in write_drawings(tmp_path):
        svg = path.read_text()
        assert all(f">{link.name}</text>" in svg for link in load(path.stem).links)
        kept = (ROOT / "mechanisms" / path.name).read_text()
        split = re.compile(r"-?\d+\.?\d*")
        assert split.sub("#", kept) == split.sub("#", svg), f"{path.name}: run write_drawings"
        # half a pixel: another machine's rounding, far below what is seen
        np.testing.assert_allclose([float(x) for x in split.findall(kept)], [float(x) for x in split.findall(svg)], atol=0.5)


GUIDE = (ROOT / "mechanisms" / "README.md").read_text()


def test_the_guides_complete_file_loads_and_is_drawn_in_any_state_and_without_bars(tmp_path: Path) -> None:
    (example,) = (x for x in re.findall(r"```toml\n(.*?)```", GUIDE, re.DOTALL) if x.startswith("format"))
    document = tomllib.loads(example)
    path = tmp_path / f"{document['name']}.toml"
    path.write_text(example)
    assert {load(path, scenario).dof for scenario in document["scenarios"]} == {1}
    document["links"]["crank"] |= {"mass": 1.0, "inertia": 1.0}
    for key in ("bars", "kg_per_m"):
        document["links"]["crank"].pop(key, None)
    mechanism = load_document(document)
    assert draw(mechanism) != draw(mechanism, np.zeros(mechanism.n))
    assert draw(mechanism) == draw(mechanism, mechanism.q0)


def test_the_guide_names_every_key_of_the_grammar() -> None:
    tables = [x for x in vars(schema).values() if isinstance(x, type) and issubclass(x, schema.Table)]
    keys = {field.alias or name for table in tables for name, field in table.model_fields.items()}
    words = set(re.findall(r"\w+", GUIDE))
    assert keys - words == set()
    assert set(built_in()) <= words
