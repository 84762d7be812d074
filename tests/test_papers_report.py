"""What the report says of the papers follows from the rows, and turns round with them."""

from dataclasses import dataclass
from typing import Any

import pytest

from gauss_bench.papers.crank_slider import linkage
from gauss_bench.papers.reproduction import paper_motion
from gauss_bench.reference.build import build_reference
from gauss_bench.report.content import Section
from gauss_bench.report.paper_figures import paper_figures
from gauss_bench.report.paper_findings import paper_findings
from gauss_bench.report.sections import papers
from gauss_bench.report.sections import reproduction as again
from tests.papers_tables import Rows, audited, reproduced


@dataclass(frozen=True)
class Told:
    """The tables these sections read."""

    audit: Rows = ()
    reproduction: Rows = ()
    paper_motion: Rows = ()


@pytest.fixture(scope="module")
def told() -> Told:
    motion = paper_motion(linkage(), build_reference(linkage(), 0.1))
    return Told(audited(), reproduced(), tuple(motion["paper_motion"]))


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


def test_every_statement_is_printed_once(told: Told) -> None:
    section = papers.section(told)
    tables = [block for block in section.blocks if block.kind == "table"]
    assert sum(len(table.rows) for table in tables[:-1]) == len(told.audit)
    assert {row["paper"] for row in told.audit} == {table.title.partition(":")[0] for table in tables[:-1]}
    assert "contradict" not in words(section)


def test_a_verdict_that_the_measurement_contradicts_stands_out(told: Told) -> None:
    fallen = Told(changed(told.audit, "name", "velocities", stands=False, faults="what is printed is not right"))
    assert "Verdicts that the measurement contradicts" in words(papers.section(fallen))
    (first, *_) = paper_findings(fallen)
    assert first.tone == "bad"
    assert "velocities" in first.text


def test_the_claim_is_refuted_with_the_numbers_of_the_rows(told: Told) -> None:
    text = words(again.section(told))
    rows = {row["key"]: row for row in told.reproduction}
    assert "refuted" in text
    assert all(f"{rows[key]['value']:.6g}" in text for key in ("mean", "settles_above", "damping", "stable_printed"))
    slower = Told(told.audit, changed(told.reproduction, "key", "mean", value=-12.345678))
    assert "-12.3457" in words(again.section(slower))


def test_a_mechanism_that_stops_is_not_refuted(told: Told) -> None:
    stopping = Told(told.audit, changed(told.reproduction, "key", "stops", verdict="holds"))
    assert "For the printed data this is refuted" not in words(again.section(stopping))
    assert all(finding.title != "The paper's mechanism never stops" for finding in paper_findings(stopping))


def test_figures_2_to_9_are_drawn_and_come_out_the_same_twice(told: Told) -> None:
    svg = paper_figures(told.paper_motion)
    assert svg == paper_figures(told.paper_motion)
    assert all(f">{number}  " in svg or f">{number} " in svg for number in range(2, 10))
    assert paper_figures(()) == ""


def test_findings_name_what_is_wrong(told: Told) -> None:
    titles = {finding.title: finding.text for finding in paper_findings(told)}
    assert len(titles) == 3
    assert "(15) of Yuan & Ge 2016 and (16) of Yuan & Ge 2016" in titles["What the papers print"]


def test_a_run_without_papers_says_so() -> None:
    assert "no paper" in words(papers.section(Told()))
    assert "did not repeat" in words(again.section(Told()))
    assert list(paper_findings(Told())) == []
