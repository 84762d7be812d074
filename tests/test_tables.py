"""Tables are read as they were written, undeclared columns are refused or ignored, and older formats are read."""

import csv
import json
import math
from pathlib import Path

import pyarrow.parquet as pq
import pytest

from gauss_bench import checksums, tables
from gauss_bench.bench.gate import read_baseline
from gauss_bench.bench.provenance import check_publishable
from gauss_bench.cli import main
from gauss_bench.report.field_run import folders_of
from gauss_bench.tables import FORMAT, KEY, TABLES, TableError

CASE = dict(zip(KEY, ("four_bar", "torque", "gauss", "default", "rk4", "none", 1e-3, 2.0), strict=True))
REPORTS = Path(__file__).parents[1] / "reports"
VALUES = {
    "text": ("", 'a, "b"\nc', "nan", "True", "1"),
    "number": (math.nan, 0.0, -1.25, 1e-300, math.inf),
    "flag": (None, True, False),
}


def row(table, turn):
    """A row whose values are those of each kind in turn."""
    return {c.name: VALUES[c.kind][(turn + k) % len(VALUES[c.kind])] for k, c in enumerate(table.columns)}


def same(one, other):
    return one == other or (isinstance(one, float) and isinstance(other, float) and math.isnan(one) and math.isnan(other))


@pytest.mark.parametrize("name", TABLES)
def test_what_is_written_is_read(name, tmp_path):
    rows = [row(TABLES[name], turn) | ({"format": FORMAT} if name == "baseline" else {}) for turn in range(5)]
    paths = tables.write_table(name, rows, tmp_path)
    tables.write_schema(tmp_path)
    found = tables.read_table(name, tmp_path)
    assert TABLES[name].meaning
    assert all(column.meaning for column in TABLES[name].columns)
    assert {path.suffix for path in paths} == {f".{TABLES[name].suffix}"}
    assert set(paths) == set(tables.files_of(name, tmp_path))
    assert len(found) == len(rows)
    for one, other in zip(rows, found, strict=True):
        for column in TABLES[name].columns:
            if TABLES[name].curves and column.kind == "number" and column.name not in ("step", "t_end"):
                continue  # curves are kept in single precision
            if column.timed and column.name.endswith(("_low", "_high")):
                continue  # rounded as the value between them
            assert same(one[column.name], other[column.name]), column.name
    tables.write_table(name, found, tmp_path)
    assert all(map(same, found[0].values(), tables.read_table(name, tmp_path)[0].values()))


HEAD = "mechanism,first,second,position,velocity"
DAMAGED = [  # file, content, and what is said of it
    ("agreement.csv", "", "is empty, without the names of its columns"),
    ("agreement.csv", f"{HEAD}\nfour_bar,a,b,1,2\n", "column 'acceleration' is missing"),
    ("agreement.csv", f"{HEAD},acceleration\nfour_bar,a,b,1,2,three\n", "row 1, column 'acceleration'"),
    (tables.SCHEMA_FILE, json.dumps({"format": FORMAT + 1}), "is later than"),
    (tables.SCHEMA_FILE, json.dumps({"format": "two"}), "'two' is not a format"),
    (tables.SCHEMA_FILE, json.dumps({"format": 0}), "0 is not a format"),
]


@pytest.mark.parametrize(("file", "content", "said"), DAMAGED)
def test_a_damaged_table_is_refused_with_a_sentence(file, content, said, tmp_path, capsys):
    tables.write_table("agreement", [], tmp_path)
    tables.write_schema(tmp_path)
    (tmp_path / tables.checksums.FILE).unlink()  # which would tell it first
    (tmp_path / file).write_text(content)
    before = sorted(tmp_path.rglob("*"))
    assert main(["report", "--out", str(tmp_path)]) == 2
    told = capsys.readouterr().err
    assert file in told
    assert said in told
    assert sorted(tmp_path.rglob("*")) == before


def test_a_column_that_is_not_in_the_schema_and_times_that_could_not_be_told_apart_are_not_written(tmp_path):
    with pytest.raises(KeyError, match="invented"):
        tables.write_table("agreement", [{"mechanism": "four_bar", "invented": 1}], tmp_path)
    with pytest.raises(ValueError, match="same key"):
        tables.write_table("results", [CASE | {"step_time": 5e-5}] * 2, tmp_path)
    assert not list(tmp_path.iterdir())


def test_a_baseline_of_a_later_format_is_refused_and_an_older_one_is_read(tmp_path):
    head = [*KEY, "metric", "value", "accepted"]
    line = ["four_bar", "torque", "gauss", "default", "rk4", "none", "0.001", "1", "position_error", "1e-9", "2026-01-01 first"]
    path = tmp_path / "baseline.csv"
    for more, read in (([], True), ([str(FORMAT)], True), ([str(FORMAT + 1)], False)):
        with path.open("w", newline="") as file:
            csv.writer(file).writerows([[*head, *(["format"] if more else [])], [*line, *more]])
        if read:
            assert [row["value"] for row in read_baseline(path)] == ["1e-9"]
        else:
            with pytest.raises(TableError, match=f"format {FORMAT + 1} is later"):
                read_baseline(path)


LIMIT = 3_000_000  # bytes of what is published beside the code


def test_published_files_are_small_unchanged_and_read_completely():
    """Every published file is a table of the schema or one of a few others, and every column of a table is read."""
    others = {"README.md", "what_changed.md", "environment.json", checksums.FILE, tables.SCHEMA_FILE}
    ignored = ("site", "local", ".run", "pictures", "findings")
    files = [path for path in REPORTS.rglob("*") if path.is_file() and path.relative_to(REPORTS).parts[0] not in ignored]
    assert sum(path.stat().st_size for path in files) < LIMIT
    listed = {x for name in TABLES for folder in folders_of(REPORTS) for x in tables.files_of(name, folder)}
    for folder in folders_of(REPORTS):
        in_folder = {str(x.relative_to(folder)) for name in TABLES if name != "baseline" for x in tables.files_of(name, folder)}
        assert checksums.read_checksums(folder).keys() == in_folder
        checksums.require_unchanged(folder)
        check_publishable(folder)
    assert {path for path in files if path.name not in others} == listed
    assert {x.parent.name for x in listed} == {"reports", "field", "times"}
    for name in TABLES:
        path = next(iter(tables.files_of(name, REPORTS)), REPORTS)
        if path.suffix == ".csv":
            with path.open(newline="", encoding="utf-8") as file:
                lines = list(csv.DictReader(file))
            keys = [c.name for c in TABLES[name].key if c.kind == "text"]
            assert [[r[k] for k in keys] for r in tables.read_table(name, REPORTS)] == [[r[k] for k in keys] for r in lines]


@pytest.mark.parametrize(("form", "stabilised"), [(1, math.nan), (2, 5e-5)])
def test_times_with_another_meaning_in_earlier_formats_are_missing(form, stabilised, tmp_path):
    """Format 1 gave stabilised runs those of plain steps; builds left out the first step until format 3."""
    if form > 1:
        (tmp_path / "tables.json").write_text(json.dumps({"format": form}), encoding="utf-8")
    lines = [f"{','.join(KEY)},status,step_time,build_time"]
    lines += [f"four_bar,torque,gauss,default,rk4,{s},0.001,2,ok,5e-5,0.1" for s in ("none", "projection")]
    (tmp_path / "results.csv").write_text("\n".join(lines) + "\n")
    rows = tables.read_table("results", tmp_path)
    assert [row["step_time"] for row in rows] == pytest.approx([5e-5, stabilised], nan_ok=True)
    assert all(math.isnan(row[x]) for row in rows for x in ("build_time", "cold_build_time"))


HEAD_OF_CASE, CASE_OF_1 = ",".join(KEY), "four_bar,torque,gauss,default,rk4,none,0.001,2"
FORMAT_1 = {  # tables with errors of the crank, and a baseline with dates and reasons
    "results": f"{HEAD_OF_CASE},status,steps,crank_error_t1,crank_error_bar_t1\n{CASE_OF_1},ok,2000,1e-07,1e-12\n",
    "references": "mechanism,scenario,t_end,method,crank_t05,crank_t1\nfour_bar,torque,2,two ways,0.123456789012345,2\n",
    "certificates": "status,message,mechanism,scenario,crank_end\nok,,four_bar,torque,0.5\n",
    "kernel_batch": "mechanism,scenario,states,steps,rival,settings,rival_steps\nfour_bar,torque,4096,1000,mujoco,tuned,10\n",
    "baseline": f"{HEAD_OF_CASE},metric,value,accepted\n{CASE_OF_1},crank_error_t1,1.5e-07,2026-11-21 first baseline\n"
    "four_bar,torque,reference,,,,0,2,crank_t05,0.123456789012345,2026-11-22 a better reference\n",
}


@pytest.mark.parametrize("rewritten", [False, True])
def test_errors_of_the_crank_are_read_as_those_of_the_measured_coordinate(rewritten, tmp_path):
    for name, text in FORMAT_1.items():
        (tmp_path / f"{name}.csv").write_text(text)
    if rewritten:
        assert len(tables.migrate(tmp_path)) == 5
        assert tables.format_of(tmp_path) == FORMAT
        assert not any("crank_error" in path.read_text() for path in tmp_path.glob("*.csv") if path.stem in ("results", "baseline"))
    (result,), (truth,), (certificate,), (batch,) = (
        tables.read_table(name, tmp_path) for name in ("results", "references", "certificates", "kernel_batch")
    )
    assert (result["measured_error_t1"], result["measured_error_bar_t1"], result["steps"]) == (1e-7, 1e-12, 2000)
    assert result["measured_unit"] == truth["measured_unit"] == certificate["measured_unit"] == "rad"
    assert truth["measured_t05"] == 0.123456789012345
    assert certificate["measured_end"] == 0.5
    assert (batch["steps"], batch["rival_steps"]) == (1000, 10)
    baseline = read_baseline(tmp_path / "baseline.csv")
    assert [row["metric"] for row in baseline] == ["measured_error_t1", "measured_t05"]
    assert [row["value"] for row in baseline] == ["1.5e-07", "0.123456789012345"]
    assert [row["accepted"] for row in baseline] == ["2026-11-21 first baseline", "2026-11-22 a better reference"]


def test_times_are_stored_apart_and_joined_when_read(tmp_path):
    """Other times change no byte of the rows of accuracy; a case that was not timed has no row of times."""
    rows = [CASE | {"position_error": 1e-6, "step_time": 5e-5}, CASE | {"step": 1e-2, "position_error": 1e-2}]
    accuracy, times = tables.write_table("results", rows, tmp_path)
    tables.write_schema(tmp_path)
    assert len(times.read_text().splitlines()) == 2
    timed, untimed = tables.read_table("results", tmp_path)
    assert (timed["position_error"], timed["step_time"]) == (1e-6, 5e-5)
    assert math.isnan(untimed["step_time"])
    before = accuracy.read_bytes(), times.read_bytes()
    tables.write_table("results", [rows[0] | {"step_time": 6e-5}, rows[1]], tmp_path)
    assert accuracy.read_bytes() == before[0]
    assert times.read_bytes() != before[1]


def test_times_of_a_missing_row_are_refused(tmp_path):
    accuracy, _ = tables.write_table("results", [CASE | {"step_time": 5e-5}], tmp_path)
    tables.write_schema(tmp_path)
    accuracy.write_text(accuracy.read_text().replace("four_bar", "six_bar"))
    with pytest.raises(TableError, match=r"times/results.csv: a row of times has no matching row .* four_bar torque"):
        tables.read_table("results", tmp_path)


@pytest.mark.parametrize(
    ("ratio", "low", "high", "stored"),
    [
        (135.5154239, 129.0173248, 144.3879532, (135.5, 129.0, 144.4)),  # a hundredth of the spread is 0.15
        (1.03715630, 1.03711, 1.03731, (1.037156, 1.03711, 1.03731)),  # 2e-6
        (2.71828, 1.0, 9.87654, (2.718, 1.0, 9.877)),  # 0.09, but four digits
        (2.71828, math.nan, math.nan, (2.718, math.nan, math.nan)),
    ],
)
def test_a_ratio_keeps_the_digits_that_its_spread_supports(ratio, low, high, stored, tmp_path):
    tables.write_table("results", [CASE | {"step_ratio": ratio, "step_ratio_low": low, "step_ratio_high": high}], tmp_path)
    tables.write_schema(tmp_path)
    (found,) = tables.read_table("results", tmp_path)
    assert all(same(found[f"step_ratio{end}"], x) for end, x in zip(("", "_low", "_high"), stored, strict=True))


def test_samples_of_format_4_are_of_one_process(tmp_path):
    row = {"mechanism": "four_bar", "engine": "gauss", "quantity": "step", "step": 1e-4, "process": 3, "round": 1, "seconds": 2e-5}
    tables.write_table("samples", [row], tmp_path)
    path = tmp_path / "times" / "samples.parquet"
    pq.write_table(pq.read_table(path).drop_columns(["process"]), path)
    (tmp_path / "tables.json").write_text('{"format": 4}', encoding="utf-8")
    (read,) = tables.read_table("samples", tmp_path)
    assert (read["process"], read["round"]) == (0.0, 1.0)


def test_format_3_is_read_and_migrated_to_separate_files(tmp_path):
    """Format 3 had all columns in one file, twice. Figures, times and builds stay the same."""
    (tmp_path / "tables.json").write_text('{"format": 3}', encoding="utf-8")
    head = "mechanism,scenario,engine,settings,integrator,stabilization,step,t_end,status,position_error,step_time,build_time"
    (tmp_path / "results.csv").write_text(f"{head}\nfour_bar,torque,gauss,default,rk4,none,0.001,2,ok,1e-6,5.1234567e-5,0.1\n")
    (tmp_path / "results.parquet").write_bytes(b"the same again")
    (old,) = tables.read_table("results", tmp_path)
    written = tables.migrate(tmp_path)
    assert {str(path.relative_to(tmp_path)) for path in written} == {"results.csv", "times/results.csv"}
    assert not (tmp_path / "results.parquet").exists()
    (new,) = tables.read_table("results", tmp_path)
    assert (old["step_time"], new["step_time"]) == (5.1234567e-5, 5.123e-5)
    assert old["build_time"] == new["build_time"] == 0.1
    assert all(same(old[c.name], new[c.name]) for c in TABLES["results"].columns if not c.timed)


def test_curves_are_the_same_bytes_and_within_a_pens_width(tmp_path):
    rows = [CASE | {"t": t / 7, "measured_error": 1.2345678e-7 * t} for t in range(100)]
    (path,) = tables.write_table("series", rows, tmp_path)
    before = path.read_bytes()
    tables.write_table("series", rows, tmp_path)
    assert path.read_bytes() == before
    tables.write_schema(tmp_path)
    for row, found in zip(rows, tables.read_table("series", tmp_path), strict=True):
        assert found["measured_error"] == pytest.approx(row["measured_error"], rel=1.3e-4)
        assert found["t"] == pytest.approx(row["t"], rel=1e-7)
        assert found["step"] == row["step"]


def test_a_file_may_lack_a_column_that_was_added_later_and_no_other(tmp_path):
    path = tmp_path / "times" / "kernel_growth.csv"
    path.parent.mkdir()
    tables.write_schema(tmp_path)
    path.write_text("engine,quantity,sizes,from,exponent,unknown\na,q,3,16,1.5,words\n", encoding="utf-8")
    (row,) = tables.read_table("kernel_growth", tmp_path)
    assert "unknown" not in row
    assert row["exponent"] == 1.5
    assert math.isnan(row["exponent_low"])
    path.write_text("engine,quantity,sizes,from\na,q,3,16\n", encoding="utf-8")
    with pytest.raises(TableError, match="'exponent' is missing"):
        tables.read_table("kernel_growth", tmp_path)
