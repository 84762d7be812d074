"""Findings on searches, from rows with known answers."""

import pytest

from gauss_bench.report.content import Table
from gauss_bench.report.rows import Run
from gauss_bench.report.sections import search


def winner(mechanism, engine, ratio, own=False, accuracy=1e-6):
    row = {"mechanism": mechanism, "scenario": "torque", "engine": engine, "required": "position", "unit": "m"}
    row |= {"accuracy": accuracy, "settings": "lean", "integrator": "rk4", "stabilization": "none", "budget": 24.0, "message": ""}
    row |= {"own": own, "ours": "native" in engine, "step": 1e-3, "error": accuracy / 2, "most_steps": 1e5}
    if ratio is None:
        return row | {"status": "not reached", "steps": 8600.0, "seconds": float("nan")}
    spread = {"ratio": ratio, "ratio_low": 0.98 * ratio, "ratio_high": 1.02 * ratio}
    return row | {"status": "ok", "seconds": ratio * 1e-4} | spread


def run(*rows, **more):
    return Run({}, {"search_winners": rows} | more)


ROWS = (
    winner("four_bar", "gauss-native", 1.0, own=True),
    winner("four_bar", "mujoco", 40.0),
    winner("four_bar", "pinocchio", 20.0),
    winner("four_bar", "lagrange-native", 1.3),
    winner("six_bar", "lagrange-native", 1.0, own=True),
    winner("six_bar", "mujoco", None),
    winner("six_bar", "pinocchio", 7.0),
)


def test_a_sentence_names_each_rival_on_every_linkage_with_the_limits_of_the_search():
    (finding,) = search.findings(run(*ROWS))
    assert finding.title == "Within 1e-06 m of position over the whole run"
    (sentence,) = (x for x in finding.text.split(". ") if "`mujoco`" in x)
    assert "`mujoco` four_bar 40.0 (39.2..40.8) and six_bar not reached in 8,600 steps" in sentence
    assert "`pinocchio` four_bar 20.0 (19.6..20.4) and six_bar 7.00 (6.86..7.14)" in sentence
    assert all(x in sentence for x in ("24 evaluations", "100000 steps", "spread of the race"))
    narrower = [r | {"budget": 14.0, "most_steps": 1e4} if r["mechanism"] == "six_bar" else r for r in ROWS]
    (finding,) = search.findings(run(*narrower))
    assert "14 to 24 evaluations and 10000 to 100000 steps" in finding.text
    assert finding.tone == ""
    assert "`lagrange-native` four_bar" not in finding.text  # what is the suite's own is no rival


OURS = winner("shaper", "gauss-native", 1.0, own=True)
LOST = winner("jansen", "gauss-native", None)
AIMED = [r | ({"target": 20.0, "met": r["ratio"] >= 20} if r["engine"] == "pinocchio" else {}) for r in ROWS]
REACHED = winner("jansen", "pinocchio", 1.0) | {"ratio": float("nan")}


@pytest.mark.parametrize(
    ("rows", "start"),
    [
        ([*ROWS, OURS, winner("shaper", "pinocchio", 0.5)], "**Slower than `pinocchio` on shaper 0.500 (0.490..0.510).**"),
        ([*ROWS, OURS, winner("shaper", "pinocchio", 0.99)], "The cheaper of"),  # its spread goes up to 1.0098: nobody is faster
        ([*ROWS, LOST, winner("jansen", "pinocchio", None)], "**Our own engines do not meet the requirement on jansen**. "),
        ([*ROWS, LOST, REACHED], "**Our own engines do not meet the requirement on jansen**, unlike `pinocchio`. "),
        ([*ROWS, LOST, winner("jansen", "lagrange-native", 1.0, own=True)], "The cheaper of"),
        (AIMED, "**Our lead misses its target** over `pinocchio` on six_bar 7.00 (6.86..7.14) instead of 20.0. "),
    ],
)
def test_a_defeat_stands_first(rows, start):
    (finding,) = search.findings(run(*rows))
    assert finding.text.startswith(start)
    assert finding.tone == ("warn" if start.startswith("**") else "")


def test_a_finding_names_what_it_leaves_out():
    skipped = winner("four_bar", "by_hand", None) | {"status": "skip", "message": "no C compiler"}
    cases = tuple({"mechanism": x, "engine": "gauss", "status": "ok"} for x in ("four_bar", "shaper"))
    (finding,) = search.findings(run(*ROWS, skipped, results=cases))
    assert finding.text.endswith("Left out: `by_hand` on four_bar (not tried: no C compiler). Not searched: shaper.")


def test_a_lost_race_is_a_finding_and_changes_no_other():
    lost = {"mechanism": "shaper", "scenario": "torque", "required": "", "status": "timeout", "message": "no answer within 600 s"}
    crashed = winner("six_bar", "exudyn", None) | {"status": "crashed", "message": "SIGSEGV"}
    crashed |= dict.fromkeys(("steps", "budget"), float("nan"))
    first, second = search.findings(run(*ROWS, lost, crashed))
    assert (first.tone, "shaper: no answer within 600 s" in first.text) == ("bad", True)
    assert "`exudyn` six_bar not reached: SIGSEGV" in second.text
    assert search.section(run(lost)) is None


def test_each_accuracy_is_a_finding_and_every_winner_a_line():
    finer = [r | {"accuracy": 1e-9} for r in ROWS]
    angles = [r | {"required": "angle", "unit": "rad"} for r in ROWS]
    findings = list(search.findings(run(*angles, *finer, *ROWS)))
    assert [f.title[:18] for f in findings] == ["Within 1e-06 m of ", "Within 1e-09 m of ", "Within 1e-06 rad o"]
    section = search.section(run(*ROWS, *finer))
    (table,) = (block for block in section.blocks if isinstance(block, Table))
    assert len(table.rows) == 14
    assert search.section(run()) is None
