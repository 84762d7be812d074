"""The summary beside the rows is short, begins with defeats, and follows from the rows."""

import pytest

from gauss_bench.report.content import Finding
from gauss_bench.report.pages import markdown_page
from gauss_bench.report.rows import Run
from gauss_bench.report.summary import summary
from tests.headlines import compared, with_raw_rows
from tests.published import REPORTS, published, published_findings, tables

LIMIT = 30_000  # bytes that a reviewer reads


def test_the_published_summary_follows_from_the_published_rows():
    page = markdown_page(published(), summary(published(), published_findings()))
    assert (REPORTS / "README.md").read_text(encoding="utf-8") == page, "write it again: gauss-bench report --out reports"
    assert len(page.encode()) <= LIMIT


@pytest.mark.long
def test_every_published_headline_is_that_of_the_raw_rows():
    assert set(compared(with_raw_rows(REPORTS))) == {"steps", "one_value", "costs", "claim", "search"}


def test_defeats_come_first_in_the_summary():
    found = [
        Finding("Fine", "All is well.", "good"),
        Finding("Odd", "Something is odd.", "warn"),
        Finding("Race", "It is fast. **Slower than `x` on y 0.5.** **Our lead misses its target** over y. More of it.", "warn"),
    ]
    _, lost, won = summary(Run(), found)
    (bullets,), (others,) = lost.blocks, won.blocks
    assert bullets.items == ["**Race.** Slower than `x` on y 0.5. Our lead misses its target over y.", "**Odd.** Something is odd."]
    assert others.items == ["**Fine.** All is well."]


def test_every_engine_has_its_least_error_and_every_winner_its_ratio():
    """Both are computed a second time: the least error of usable cases, and times divided by the smallest time."""
    run = published()
    for name, table in tables(summary(run, ())):
        for row in table.rows if table.head[1:2] != ("four_bar: error [m]",) else ():  # tests/test_readme.py holds that one
            if name in run.linkages:
                cases = [r for r in run.cases_of(name) if (r["engine"], r["settings"]) == (row[0].text, row[1].text)]
                usable = [
                    r["measured_error_t2"] for r in cases if r["status"] in ("ok", "invalid") and r["valid"] and not r["control"]
                ]
                assert row[3].text == f"{len(usable)} of {len(cases)}"
                assert row[6].text == (f"{min(usable):.1e}" if usable else "-")
            else:
                required, accuracy = table.title.split()[4], float(table.title.split()[1])
                for linkage, cell in zip(table.head[1:], row[1:], strict=True):
                    of = [x for x in run.table("search_winners") if x["mechanism"] == linkage]
                    found = {x["engine"]: x for x in of if (x["required"], x["accuracy"]) == (required, accuracy)}
                    told = found.get(row[0].text.removesuffix(" (own)"), {"status": "skip"})
                    if told["status"] == "ok":
                        expected = told["seconds"] / min(x["seconds"] for x in found.values() if x["status"] == "ok")
                        assert float(cell.text) == pytest.approx(expected, rel=6e-3)
                    else:
                        kinds = ("-", "cannot be modelled", "not determined", "not tried")
                        assert cell.text in kinds or (told["status"] != "skip" and cell.text.startswith("not reached in "))
