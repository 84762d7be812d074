"""No cell of a page or table denies a stored row; this file reads the rows by code of its own, not by that of the report."""

import math
import re
from collections.abc import Mapping
from itertools import product
from pathlib import Path
from typing import NamedTuple

import pytest

from gauss_bench.report.build import all_findings, read_run
from gauss_bench.report.content import Table
from gauss_bench.report.rows import Run
from gauss_bench.report.sections import search
from gauss_bench.report.site.engine import cheapest_table, engine_names
from gauss_bench.report.site.linkage import name_leaders
from gauss_bench.report.site.settings import FORCES, POSITIONS, collect_choices, scenarios
from gauss_bench.report.summary import summary
from tests.published import tables

DENIED = re.compile(r"cannot|not reached|not tried|not determined|do not reach")
ROOT = Path(__file__).parents[1]


class Said(NamedTuple):
    """The text of a cell about an engine on a linkage, for limits of errors that must hold together."""

    place: str
    mechanism: str
    engine: str
    wanted: Mapping[str, float]
    text: str


def false_denials(cells, run):
    """Return those cells that deny a requirement although a stored row shows that it holds."""
    ended = [r for r in run.table("search_ladder") if r["status"] == "ok"]

    def holds(x):
        rows = (r for r in ended if (r["mechanism"], r["engine"]) == (x.mechanism, x.engine))
        return any(all(r[f"{k}_error"] <= limit for k, limit in x.wanted.items()) for r in rows)

    return [x for x in cells if DENIED.search(x.text) and holds(x)]


def cells(run):
    """Yield every cell, line and clause that says whether an engine holds a requirement."""
    names = scenarios(run)
    for name in names:
        shown = collect_choices(run, name)
        for (i, position), (j, force) in product(enumerate(POSITIONS), enumerate(FORCES)):
            wanted = {"position": position} | ({} if math.isinf(force) else {"force": force})
            there = {shown["settings"][k]["engine"]: "holds" for k, _ in shown["picks"][f"{i},{j}"]}
            places = {e: some[i * len(FORCES) + j] for e, some in shown["none"].items()}
            missed = {e: shown["words"][k] for e, k in places.items() if k >= 0}
            assert not there.keys() & missed.keys()
            yield from (Said("chooser", name, e, wanted, x) for e, x in (there | missed).items())
        text = name_leaders(run, name).replace("`", "")
        for engine, words in re.findall(rf"\b({'|'.join(engine_names(run))}): ([^.]*)", text):
            yield Said("linkage page", name, engine, {"position": 1e-4}, words)
    for engine in engine_names(run):
        for row in cheapest_table(run, engine).rows:
            wanted = {"position": 1e-3 * float(row[1].text)}
            yield Said("engine page", row[0].text, engine, wanted, row[2].text)
    section = search.section(run)
    for block in section.blocks if section else ():
        if isinstance(block, Table) and block.title.startswith("Searched best"):
            for row in block.rows:
                wanted = {block.title.split()[-1]: float(row[1].text.split()[0])}
                yield Said("search", row[0].text, row[2].text.removesuffix(" (own)"), wanted, row[-1].text)
    for _, block in tables(summary(run, ())):
        if block.title.startswith("Within"):
            for row in block.rows:
                wanted = {block.title.split()[4]: float(block.title.split()[1])}
                pairs = zip(block.head[1:], row[1:], strict=True)
                yield from (Said("summary", x, row[0].text, wanted, cell.text) for x, cell in pairs)
    for found in all_findings(run):
        if found.title.startswith("Within") and "of " in found.title:
            wanted = {found.title.split()[4]: float(found.title.split()[1])}
            for clause in re.split(r"; (?=`)", found.text.partition("the searched best of ")[2]):
                engine = clause.split("`")[1] if "`" in clause else ""
                for name, words in re.findall(rf"\b({'|'.join(names)}) ((?:not|cannot|holds)[^)]*)", clause):
                    yield Said("finding", name, engine, wanted, words)


@pytest.mark.long
def test_no_cell_of_the_published_rows_denies_what_a_stored_row_shows():
    run = read_run(ROOT / "reports")
    found = list(cells(run))
    assert not false_denials(found, run)
    assert sum(DENIED.search(x.text) is not None for x in found) > 100
    assert {x.place for x in found} == {"chooser", "linkage page", "engine page", "search", "summary", "finding"}
    assert not any("cannot" in x.text.replace("cannot be modelled", "") for x in found)


ROW = {"mechanism": "four_bar", "scenario": "torque", "engine": "exudyn"}
ROW |= {"settings": "x", "integrator": "rk4", "stabilization": "none"}
ROW |= {"tolerance": math.nan, "until": 1.0, "status": "ok", "message": "", "ended": ""}


def planted(*errors, **winner):
    """A run in which one engine was evaluated with errors (steps, position, force), and lost every race."""
    rows = [ROW | {"step": 1 / n, "steps": n, "position_error": p, "angle_error": math.nan, "force_error": f} for n, p, f in errors]
    lost = ROW | {"required": "position", "accuracy": 1e-6, "unit": "m", "step": 1e-4, "steps": 1e4, "error": 1e-5}
    lost |= {"status": "cannot reach", "message": "came to 1.0e-05 m", "budget": 14.0, "most_steps": 1e4, "ours": False} | winner
    return Run({}, {"search_ladder": tuple(rows), "search_winners": (lost,)})


@pytest.mark.parametrize("status", ["cannot reach", "not reached", "crashed", "skip"])
def test_what_holds_and_was_not_timed_is_denied_nowhere(status):
    run = planted((100.0, 1e-2, 10.0), (20_000.0, 2e-7, 1e-4), status=status)
    found = list(cells(run))
    assert false_denials(found, run) == []
    lie = Said("chooser", "four_bar", "exudyn", {"position": 1e-6}, "cannot")
    assert false_denials([lie, lie._replace(wanted={"position": 1e-7})], run) == [lie]
    assert {x.text for x in found if x.place == "chooser" and x.wanted == {"position": 1e-6}} == {"holds"}
    assert [x.text.partition(":")[0] for x in found if x.place in ("search", "finding")] == ["holds, not timed"] * 2
    assert sum(x.place == "engine page" and x.text.startswith("not reached in 20,000 steps") for x in found) == 2  # 1e-7 m, 1e-9 m
