"""The report of an invented run: what it says follows from the rows, nothing is lost, and it comes out the same twice."""

import json
import math
import re
import tomllib
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from gauss_bench.linkage import schema
from gauss_bench.linkage.load import built_in, load, load_document
from gauss_bench.report.build import all_findings, build_report, read_run
from gauss_bench.report.drawings.drawing import draw, write_drawings
from gauss_bench.report.drawings.pose import pose_links
from gauss_bench.report.palette import ENGINES, inline
from gauss_bench.report.rows import KEYS

ROOT = Path(__file__).parents[1]
LINKAGES = {"four_bar": 1.0, "six_bar": 4.0}
BAR = 3e-13
STEPS = (0.008, 0.004, 0.002, 0.001)
NATIVE = {"gauss": 60e-6, "lagrange": 40e-6, "schur": 55e-6, "yuan_ge_eq16": 70e-6}
STIFFNESS = {"default": 3e-2, "stiff": 3e-5}


def case(mechanism: str, engine: str, settings: str, integrator: str, stabilization: str, step: float) -> dict[str, object]:
    key = (mechanism, "torque", engine, settings, integrator, stabilization, step, 2.0)
    return dict(zip(KEYS, key, strict=True)) | {"status": "ok", "message": "", "note": "", "valid": True, "control": False}


def ran(row: dict[str, object], error: float, acceleration: float, cost: float) -> dict[str, object]:
    """A case that ended, with an error at the end and at the same state, and the cost of a step."""
    drift = 1e-16 if row["stabilization"] == "projection" else error / 5
    crank = {"measured_error_t05": error / 50, "measured_error_t1": error / 8, "measured_error_t2": error}
    drifts = {"position_drift": drift, "velocity_drift": 20 * drift, "acceleration_residual": 1e-13}
    bars = {"position_error_bar": BAR, "velocity_error_bar": 10 * BAR, "energy_error": error / 3, "energy_error_bar": BAR}
    worst = {"position_error": 1.5 * error, "velocity_error": 12 * error, "link_errors": "{}"}
    same = {"acceleration_error_median": acceleration, "acceleration_error_max": 8 * acceleration}
    return (
        row
        | crank
        | drifts
        | bars
        | worst
        | same
        | {"steps": int(2.0 / float(str(row["step"]))), "step_time": cost, "build_time": 2e-3}
    )


def ratios(row: dict[str, object], name: str, ratio: float) -> dict[str, object]:
    return row | {f"{name}_ratio": ratio, f"{name}_ratio_low": 0.96 * ratio, f"{name}_ratio_high": 1.05 * ratio}


def native_rows(mechanism: str, hardness: float) -> list[dict[str, object]]:
    rows = []
    for engine, cost in NATIVE.items():
        control = engine == "yuan_ge_eq16"
        for integrator, order, stages in (("rk4", 4, 4), ("semi_implicit_euler", 1, 1)):
            for stabilization in ("none", "baumgarte", "projection"):
                for step in STEPS:
                    error = 8.0 if control else hardness * {4: 2e4, 1: 3.0}[order] * step**order + 4e-15
                    row = case(mechanism, engine, "default", integrator, stabilization, step)
                    row = ran(row, error, 0.7 if control else 3e-14, stages * cost)
                    row = ratios(ratios(row, "step", cost / NATIVE["lagrange"]), "acceleration", cost / NATIVE["lagrange"] * 1.02)
                    rows.append(
                        row | {"valid": not control, "control": control, "observed_order": order, "acceleration_time": cost}
                    )
    return rows


def foreign_rows(mechanism: str, hardness: float) -> list[dict[str, object]]:
    rows = []
    for step in STEPS:
        for settings, softness in STIFFNESS.items():
            row = ran(case(mechanism, "mujoco", settings, "implicit", "none", step), hardness * softness, 10 * softness, 9e-6)
            row = ratios(ratios(row, "step", 0.06), "native_step", 0.02)
            rows.append(row | {"valid": False, "native_step_time": 3e-6, "observed_order": 0.0})
        row = ran(case(mechanism, "pinocchio", "default", "rk4", "none", step), 2e4 * step**4 + 4e-15, 2e-14, 12e-6)
        rows.append(ratios(row, "step", 0.08))
        failed = case(mechanism, "exudyn", "default", "generalized_alpha", "none", step) | {"valid": False}
        message = "Newton did not converge at t = 0.31 s | step <size>\nsee *log*"
        rows.append(
            failed | ({"status": "nan", "message": message} if step > 0.004 else {"status": "skip", "message": "no such pair"})
        )
    adaptive = case(mechanism, "gauss", "default", "dop853", "none", math.nan)
    rows.append(ran(adaptive | {"step": 0.001}, 1e-13, 3e-14, 1e-4) | {"step": math.nan})
    return rows


def histories(rows: list[dict[str, object]]) -> list[dict[str, object]]:
    times = np.linspace(0.0, 2.0, 21)
    found = []
    for row in rows:
        if row["status"] == "ok":
            worst = {k: float(str(row[k])) for k in ("position_drift", "velocity_drift", "energy_error")}
            for t in times:
                found.append({k: row[k] for k in KEYS} | {"t": t, **{k: x * (t / 2) ** 2 for k, x in worst.items()}})
    return found


ENVIRONMENT = {
    "suite": "gauss_bench 0.1.0",
    "date": "2026-11-20",
    "commit": "0123456789abcdef",
    "dirty": False,
    "python": "3.11.2",
    "cpu": "an invented processor",
    "cores": 2,
    "versions": {"numpy": "2.3.0", "mujoco": "4.0.0"},
    "baseline_engine": "lagrange",
    "engines": {"mujoco": {"version": "mujoco 4.0.0", "settings": {"default": {}, "stiff": {"solref": [0.002, 1.0]}}}},
    "wall_time": 321.5,
}


def write_run(folder: Path, rows: list[dict[str, object]]) -> Path:
    """A folder as the runner leaves it."""
    folder.mkdir(parents=True, exist_ok=True)
    pd.DataFrame(rows, columns=None if rows else [*KEYS, "status"]).to_csv(folder / "results.csv", index=False)
    told = histories(rows)
    pd.DataFrame(told, columns=None if told else [*KEYS, "t"]).to_csv(folder / "series.csv", index=False)
    reference = {"scenario": "torque", "t_end": 2.0, "method": "two integrations", "error_bar_q": BAR, "error_bar_v": 10 * BAR}
    angles = {"measured_t05": 1.0, "measured_t1": 4.0, "measured_t2": 26.9}
    references = [{"mechanism": name} | reference | angles for name in sorted({str(r["mechanism"]) for r in rows})]
    pd.DataFrame(references, columns=None if rows else ["mechanism"]).to_csv(folder / "references.csv", index=False)
    pd.DataFrame(columns=["mechanism", "engine", "quantity", "round", "seconds"]).to_csv(folder / "samples.csv", index=False)
    (folder / "environment.json").write_text(json.dumps(ENVIRONMENT))
    return folder


def invented() -> list[dict[str, object]]:
    return [row for name, hardness in LINKAGES.items() for row in native_rows(name, hardness) + foreign_rows(name, hardness)]


@pytest.fixture(scope="module")
def report(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = write_run(tmp_path_factory.mktemp("run"), invented())
    build_report(folder)
    return folder


def lines_of(folder: Path) -> list[str]:
    """The rows of every case in the tables of the site, cell by cell."""
    pages = "".join(path.read_text() for path in (folder / "site").glob("linkage-*-rows.html"))
    rows = re.findall(r"<tr(?: hidden)?>(<td.*?)</tr>", pages)
    return ["|".join(re.sub(r"<[^>]+>", "", cell) for cell in row.split("</td>")) for row in rows]


def text_of(rows: list[dict[str, object]], folder: Path) -> str:
    """All findings of a run with these rows, as one text."""
    return "\n".join(f"{x.tone}: {x.title}: {x.text}" for x in all_findings(read_run(write_run(folder, rows))))


def test_soft_engine_is_flagged_and_its_step_does_not_help(tmp_path: Path) -> None:
    said = text_of(invented(), tmp_path)
    soft = re.search(r"warn: Soft, or another model: `mujoco` \(settings default\).*", said)
    assert soft is not None
    assert "3.0e-01" in soft[0]
    assert "at step 0.008 s and" in soft[0]
    exact = [row | {"acceleration_error_median": 1e-12} if row["engine"] == "mujoco" else row for row in invented()]
    assert "Soft" not in text_of(exact, tmp_path)


def test_control_is_flagged_and_a_gate_that_passes_it_is_called_too_wide(tmp_path: Path) -> None:
    said = text_of(invented(), tmp_path)
    assert "`yuan_ge_eq16` satisfies the constraints of acceleration to 1.0e-13 and is still wrong" in said
    assert "No row of it passes the gate" in said
    passing = [row | {"valid": True} for row in invented()]
    assert "bad: The negative control" in text_of(passing, tmp_path)


def test_own_cost_is_told_whichever_way_it_falls(tmp_path: Path) -> None:
    said = text_of(invented(), tmp_path)
    assert "four_bar rk4 1.50 (1.44..1.58)" in said
    assert "slower in 4 of 4" in said
    less = {"step_ratio": 0.8, "step_ratio_low": 0.78, "step_ratio_high": 0.82}
    cheap = [row | less if row["engine"] == "gauss" else row for row in invented()]
    assert "four_bar rk4 0.80" in text_of(cheap, tmp_path)
    assert "slower in 0 of 4" in text_of(cheap, tmp_path)


def test_cheapest_at_equal_accuracy_takes_no_invalid_row(tmp_path: Path) -> None:
    """The stiff soft engine is cheaper than all and within 1e-3, but not valid."""
    said = text_of(invented(), tmp_path)
    assert re.search(r"four_bar, torque: .*Cheapest within 1e-03 rad: `pinocchio` rk4 at step 0.008 s, 3 ms", said)
    assert not re.search(r"Cheapest within \S+ rad: `(mujoco|yuan)", said)


@pytest.mark.long
def test_failures_keep_their_sentence(report: Path) -> None:
    page = (report / "site" / "method.html").read_text()
    assert "Newton did not converge at t = 0.31 s | step &lt;size&gt;" in page
    assert '<span class="t-bad">nan</span>' in page, "the status nan was read as a missing number"


@pytest.mark.slow
def test_every_case_is_in_the_tables(report: Path) -> None:
    assert len(lines_of(report)) == len(read_run(report).results) == len(invented())


def test_nothing_below_the_reference_is_printed_as_a_number(report: Path) -> None:
    lines = [x for x in lines_of(report) if x.startswith("gauss|default|dop853")]
    assert lines
    assert all("|&lt; 3e-13|" in x and "1.0e-13|1.0e-13" not in x for x in lines if "|own|" in x)


@pytest.mark.slow
def test_built_twice_is_the_same_byte_for_byte(report: Path, tmp_path: Path) -> None:
    rows = invented()
    other = write_run(tmp_path, rows[::-1])
    files = build_report(other)
    assert len(files) > 20
    for path in files:
        assert path.read_bytes() == (report / path.relative_to(other)).read_bytes(), path.name
    assert not list(other.rglob("*.part"))


@pytest.mark.parametrize(
    "rows", [[], [case("unheard_of", "new_engine", "", "", "", math.nan) | {"status": "crashed", "valid": False}]]
)
def test_runs_with_next_to_nothing(rows: list[dict[str, object]], tmp_path: Path) -> None:
    folder = write_run(tmp_path, rows)
    (folder / "environment.json").unlink()
    build_report(folder)
    page = (folder / "site" / "method.html").read_text()
    assert ("crashed" in page) == bool(rows)
    assert not re.search(r"\bnan\b", page, re.IGNORECASE)


def test_inline_pictures_follow_the_page_colours() -> None:
    svg = inline(draw(*pose_links("four_bar")), "x")
    assert svg.startswith("<svg")
    assert not re.search(r"#[0-9a-f]{6}", svg), "a colour has no variable and would not turn dark"
    assert len(set(ENGINES.values())) == len(ENGINES)


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


def test_drawing_of_any_state_and_of_links_without_bars() -> None:
    document = tomllib.loads(example())
    document["links"]["crank"] |= {"mass": 1.0, "inertia": 1.0}
    for key in ("bars", "kg_per_m"):
        document["links"]["crank"].pop(key, None)
    mechanism = load_document(document)
    assert draw(mechanism) != draw(mechanism, np.zeros(mechanism.n))
    assert draw(mechanism) == draw(mechanism, mechanism.q0)


def guide() -> str:
    return (ROOT / "mechanisms" / "README.md").read_text()


def example() -> str:
    """The complete file in the guide: its one TOML block that names a format."""
    (found,) = (x for x in re.findall(r"```toml\n(.*?)```", guide(), re.DOTALL) if x.startswith("format"))
    return found


def test_the_guide_has_a_complete_file_that_loads(tmp_path: Path) -> None:
    document = tomllib.loads(example())
    path = tmp_path / f"{document['name']}.toml"
    path.write_text(example())
    for scenario in document["scenarios"]:
        assert load(path, scenario).dof == 1


def test_the_guide_names_every_key_of_the_grammar() -> None:
    tables = [x for x in vars(schema).values() if isinstance(x, type) and issubclass(x, schema.Table)]
    keys = {field.alias or name for table in tables for name, field in table.model_fields.items()}
    words = set(re.findall(r"\w+", guide()))
    assert keys - words == set()
    assert set(built_in()) <= words
