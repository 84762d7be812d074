"""Test that the report's sentences on the papers follow from the rows, and change with them."""

from pathlib import Path
from typing import Any

import pytest

from gauss_bench.report.content import Finding, Section
from gauss_bench.report.rows import Run
from gauss_bench.report.sections import papers
from gauss_bench.report.sections import reproduction as again
from gauss_bench.tables import read_table

Rows = tuple[dict[str, Any], ...]
REPORTS = Path(__file__).parents[1] / "reports"


def told_of(audit: Rows = (), reproduction: Rows = (), motion: Rows = ()) -> Run:
    """Return a run with the tables that these sections read."""
    return Run({}, {"audit": audit, "reproduction": reproduction, "paper_motion": motion})


def paper_findings(run: Run) -> list[Finding]:
    return [*papers.findings(run), *again.findings(run)]


@pytest.fixture(scope="module")
def told() -> Run:
    return told_of(*(tuple(map(dict, read_table(x, REPORTS))) for x in ("audit", "reproduction", "paper_motion")))


def words(section: Section) -> str:
    found = []
    for block in section.blocks:
        match block.kind:
            case "text":
                found.append(block.text)
            case "bullets":
                found += block.items
            case "table":
                found += [cell.text for row in block.rows for cell in row]
    return "\n".join(found)


def changed(rows: Rows, key: str, name: str, **cells: Any) -> Rows:
    assert any(row[key] == name for row in rows)
    return tuple(row | cells if row[key] == name else row for row in rows)


def test_a_cause_is_listed_and_counted_once_with_the_number_of_its_lines(told: Run) -> None:
    audit = told.table("audit")
    tables = [block for block in papers.section(told).blocks if block.kind == "table" and block.title.endswith("causes")]
    listed = [(table.title.partition(":")[0], row[0].text) for table in tables for row in table.rows]
    assert sorted(listed) == sorted({(row["paper"], row["cause"]) for row in audit if row["cause"]})
    assert sum(int(row[2].text) for table in tables for row in table.rows) == sum(row["verdict"] != "ok" for row in audit)
    wrong = sum(row["verdict"] == "wrong" for row in audit)
    assert f"{wrong} wrong (1 cause)" in paper_findings(told)[0].text
    two = told_of(changed(audit, "name", "inverse of a projector", cause="another"))
    assert f"{wrong} wrong (2 causes)" in paper_findings(two)[0].text


def test_a_verdict_that_the_measurement_contradicts_stands_out(told: Run) -> None:
    fallen = told_of(changed(told.table("audit"), "name", "velocities", stands=False, faults="what is printed is not right"))
    assert "Verdicts that the measurement contradicts" in words(papers.section(fallen))
    first = paper_findings(fallen)[0]
    assert first.tone == "bad"
    assert "velocities" in first.text


def test_the_claim_is_refuted_with_the_numbers_of_the_rows(told: Run) -> None:
    text = words(again.section(told))
    rows = {row["key"]: row for row in told.table("reproduction")}
    assert "refuted" in text
    assert all(f"{rows[key]['value']:.6g}" in text for key in ("mean", "settles_above", "damping", "stable_printed"))
    slower = told_of(told.table("audit"), changed(told.table("reproduction"), "key", "mean", value=-12.345678))
    assert "-12.3457" in words(again.section(slower))
    stopping = told_of(told.table("audit"), changed(told.table("reproduction"), "key", "stops", verdict="holds"))
    assert "For the printed data this is refuted" not in words(again.section(stopping))
    assert all(finding.title != "The paper's mechanism never stops" for finding in paper_findings(stopping))
