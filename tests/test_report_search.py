"""What the report says of searches, from rows whose answers are known."""

from typing import Any

from gauss_bench.report.content import Table
from gauss_bench.report.rows import Run
from gauss_bench.report.sections import search


def winner(mechanism: str, engine: str, ratio: float | None, own: bool = False, accuracy: float = 1e-6) -> dict[str, Any]:
    row = {
        "mechanism": mechanism,
        "scenario": "torque",
        "required": "position",
        "accuracy": accuracy,
        "unit": "m",
        "engine": engine,
    }
    row |= {"settings": "lean", "integrator": "rk4", "stabilization": "none", "budget": 24.0, "most_steps": 1e5, "own": own}
    row |= {"step": 1e-3, "error": accuracy / 2, "evaluations": 30.0, "passing": 2.0, "message": ""}
    if ratio is None:
        return row | {"status": "cannot reach", "message": "came to 1e-3 m", "seconds": float("nan")}
    spread = {"ratio": ratio, "ratio_low": 0.98 * ratio, "ratio_high": 1.02 * ratio}
    return row | {"status": "ok", "seconds": ratio * 1e-4} | spread


def run(*rows: dict[str, Any]) -> Run:
    return Run({}, {"search_winners": rows})


ROWS = (
    winner("four_bar", "gauss-native", 1.0, own=True),
    winner("four_bar", "mujoco", 40.0),
    winner("four_bar", "pinocchio", 20.0),
    winner("six_bar", "lagrange-native", 1.0, own=True),
    winner("six_bar", "mujoco", None),
    winner("six_bar", "pinocchio", 7.0),
)


def test_each_engine_is_told_by_its_least_and_largest_ratio() -> None:
    (finding,) = search.findings(run(*ROWS))
    assert finding.title == "Within 1e-06 m over the whole run"
    assert "`mujoco` takes 40.0 (four_bar) times as long on 1 linkage, cannot reach it on six_bar" in finding.text
    assert "`pinocchio` takes 7.00 (six_bar) to 20.0 (four_bar) times as long on 2 linkages" in finding.text
    assert "24 evaluations" in finding.text
    assert finding.tone == ""
    assert "gauss-native` takes" not in finding.text  # what is own is no rival


def test_where_an_engine_wins_stands_first() -> None:
    (finding,) = search.findings(run(*ROWS, winner("shaper", "gauss-native", 1.0, own=True), winner("shaper", "pinocchio", 0.5)))
    assert finding.text.startswith("Faster than our own best: pinocchio on shaper.")
    assert finding.tone == "warn"


def test_where_we_cannot_stands_in_the_same_sentence() -> None:
    (finding,) = search.findings(run(*ROWS, winner("jansen", "gauss-native", None), winner("jansen", "pinocchio", None)))
    assert "Our own ways cannot reach it on jansen" in finding.text
    assert finding.tone == "warn"


def test_accuracies_are_told_apart_and_every_winner_is_a_line() -> None:
    finer = [r | {"accuracy": 1e-9} for r in ROWS]
    findings = list(search.findings(run(*ROWS, *finer)))
    assert [f.title[:12] for f in findings] == ["Within 1e-06", "Within 1e-09"]
    section = search.section(run(*ROWS, *finer))
    assert section is not None
    (table,) = (block for block in section.blocks if isinstance(block, Table))
    assert len(table.rows) == 12
    assert search.section(run()) is None
