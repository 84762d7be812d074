"""Test that the report's sentences on the papers follow from the rows, and change with them."""

from dataclasses import replace

from gauss_bench.report.sections import papers
from gauss_bench.report.sections import reproduction as again
from tests.published import published


def paper_findings(run):
    return [*papers.findings(run), *again.findings(run)]


def words(section):
    """Return the paragraphs and lists of a section, and the cells of its tables."""
    found = []
    for block in section.blocks:
        rows = block.rows if block.kind == "table" else ()
        found += [getattr(block, "text", ""), *getattr(block, "items", ()), *(cell.text for row in rows for cell in row)]
    return "\n".join(found)


def changed(table, key, name, **cells):
    """Return the published run with other cells in the row of a table whose column `key` has a name."""
    rows = published().table(table)
    assert any(row[key] == name for row in rows)
    return replace(published(), tables={**published().tables, table: tuple({**r, **cells} if r[key] == name else r for r in rows)})


def test_a_cause_is_listed_and_counted_once_with_the_number_of_its_lines():
    audit = published().table("audit")
    tables = [block for block in papers.section(published()).blocks if block.kind == "table" and block.title.endswith("causes")]
    listed = [(table.title.partition(":")[0], row[0].text) for table in tables for row in table.rows]
    assert sorted(listed) == sorted({(row["paper"], row["cause"]) for row in audit if row["cause"]})
    assert sum(int(row[2].text) for table in tables for row in table.rows) == sum(row["verdict"] != "ok" for row in audit)
    wrong = sum(row["verdict"] == "wrong" for row in audit)
    assert f"{wrong} wrong (1 cause)" in paper_findings(published())[0].text
    two = changed("audit", "name", "inverse of a projector", cause="another")
    assert f"{wrong} wrong (2 causes)" in paper_findings(two)[0].text


def test_a_verdict_that_the_measurement_contradicts_stands_out():
    fallen = changed("audit", "name", "velocities", stands=False, faults="the printed form is not right")
    assert "Verdicts that the measurement contradicts" in words(papers.section(fallen))
    first = paper_findings(fallen)[0]
    assert first.tone == "bad"
    assert "velocities" in first.text


def test_the_claim_is_refuted_with_the_numbers_of_the_rows():
    text = words(again.section(published()))
    rows = {row["key"]: row for row in published().table("reproduction")}
    assert "refuted" in text
    assert all(f"{rows[key]['value']:.6g}" in text for key in ("mean", "settles_above", "damping", "stable_printed"))
    assert "-12.3457" in words(again.section(changed("reproduction", "key", "mean", value=-12.345678)))
    stopping = changed("reproduction", "key", "stops", verdict="holds")
    assert "For the printed data this is refuted" not in words(again.section(stopping))
    assert all(finding.title != "The paper's mechanism never stops" for finding in paper_findings(stopping))
