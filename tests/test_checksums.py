"""A row that was changed after its run is found; a folder without checksums is read as it is."""

import hashlib
import json
import re
from pathlib import Path

import pytest

from gauss_bench import __version__
from gauss_bench.bench.differences import accuracy_rows
from gauss_bench.checksums import FILE, ChangedRows, checksum_of_run, read_checksums, require_unchanged
from gauss_bench.cli import main
from gauss_bench.report.build import read_run
from gauss_bench.report.citation import describe_rows, renew
from gauss_bench.report.site.tables_page import cite_page
from gauss_bench.tables import KEY, write_schema, write_table

ROOT = Path(__file__).parents[1]
REPORTS = ROOT / "reports"
ROW = dict.fromkeys(KEY[:6], "x") | {"step": 1e-3, "t_end": 1.0, "status": "ok", "message": "", "position_error": 1.5e-5}


@pytest.fixture
def run(tmp_path):
    write_table("results", [ROW | {"step_time": 1e-6}], tmp_path)
    write_table("agreement", [{"mechanism": "four_bar", "first": "a", "second": "b", "position": 1e-9}], tmp_path)
    write_schema(tmp_path)
    return tmp_path


def test_each_file_of_a_table_has_the_sha256_of_its_bytes(run):
    listed = read_checksums(run)
    assert [*listed] == ["agreement.csv", "results.csv", "times/results.csv"]
    for name, checksum in listed.items():
        assert checksum == hashlib.sha256((run / name).read_bytes()).hexdigest()
    write_table("results", [ROW], run)  # nothing is timed now: the file of times is gone, and its checksum with it
    assert [*read_checksums(run)] == ["agreement.csv", "results.csv"]
    lines = b"11  a.csv\n22  b.csv\n"  # which sha256sum prints
    assert checksum_of_run({"b.csv": "22", "a.csv": "11"}) == hashlib.sha256(lines).hexdigest()


@pytest.mark.parametrize("name", ["results.csv", "times/results.csv"])
def test_a_changed_row_is_refused_by_every_reader_that_reports(name, run, capsys):
    require_unchanged(run)
    path = run / name
    text = path.read_text()
    path.write_text(re.sub(r"(?<=e-0)\d", "2", text))
    assert path.read_text() != text
    said = re.escape(f"{path}: a row was changed after the run")
    for read in (read_run, accuracy_rows):
        with pytest.raises(ChangedRows, match=said):
            read(run)
    for call in (["report", "--out", str(run)], ["report", "--out", str(run), "--against", str(run)]):
        assert main(call) == 2
        assert f"{path}: a row was changed after the run" in capsys.readouterr().err
    assert not (run / "site").exists()
    path.write_text(text)
    require_unchanged(run)


def test_a_table_that_is_gone_and_a_damaged_list_are_named(run):
    (run / "agreement.csv").unlink()
    with pytest.raises(ChangedRows, match=r"agreement\.csv: is missing"):
        require_unchanged(run)
    for text, said in (("[1]", "values are texts"), ("{", "no JSON")):
        (run / FILE).write_text(text)
        with pytest.raises(ChangedRows, match=said):
            require_unchanged(run)


def test_a_run_of_an_older_version_has_no_checksums_and_is_read(run):
    (run / FILE).unlink()
    assert len(read_run(run).results) == 1
    assert read_run(run).checksum == ""
    assert "sha256" not in cite_page(read_run(run)).body


def test_the_citation_names_the_version_and_the_rows():
    text = (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    assert f"\nversion: {__version__}\n" in text
    assert renew(text, REPORTS) == text
    known = json.loads((REPORTS / "environment.json").read_text(encoding="utf-8"))
    checksum = checksum_of_run(read_checksums(REPORTS))
    assert f'value: "sha256:{checksum}"' in text
    assert f"measured by commit {known['commit']} (version {known['versions']['gauss-bench']})" in describe_rows(REPORTS)
    assert f"rows sha256:{checksum}" in cite_page(read_run(REPORTS)).body


def test_the_version_stands_in_one_place_and_has_notes():
    assert f'__version__ = "{__version__}"' in (ROOT / "gauss_bench" / "__init__.py").read_text(encoding="utf-8")
    assert __version__ not in (ROOT / "pyproject.toml").read_text(encoding="utf-8").partition("[project.optional")[0]
    assert f"\n## [{__version__}] - " in (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
