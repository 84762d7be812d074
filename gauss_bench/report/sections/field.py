"""The field: every engine by the same questions, a row for each setting, and a reason in place of each missing answer."""

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from gauss_bench.reach import Requirement
from gauss_bench.report.content import Finding, Section, Text, blocks_of, count, itemise, lay_out
from gauss_bench.report.reaches import answer
from gauss_bench.report.rows import (
    METHOD,
    SAME_ACCELERATION,
    Row,
    Run,
    chose_steps,
    error_bar,
    group_by,
    has_ended,
    is_known,
    number,
)

PLACE = 13
TITLE, ANCHOR = "The field", "field"
ACCURACIES = {"coarse": 1e-4, "fine": 1e-6}  # [m] at which the table has the cost of an engine's searched best
OWN_STEPS, NO_ORDER = "it chooses its own steps", "its errors at three steps have no order"
EARLIER = "in the first row of this engine"


def section(run: Run) -> Section | None:
    """Return the table of all engines, or None for a run that did not ask them."""
    rows = run.table("field")
    if not rows:
        return None
    return Section(TITLE, ANCHOR, [Text(describe_questions(run)), *blocks_of("field", answers(run))])


def describe_questions(run: Run) -> str:
    """Return in words on which linkages and at which step the engines were asked."""
    first = run.table("field")[0]
    return (
        f"All engines were asked the same on {first['mechanism']} at steps of {1e3 * number(first, 'step'):g} ms. Accuracy is that "
        "of a setting; cost, start and size are those of an engine and stand in its first row."
    )


def answers(run: Run, engine: str = "") -> list[Row]:
    """Return the rows of the field, or those of one engine, with what other tables of the run know of each setting."""
    rows = [row for row in run.table("field") if engine in ("", row["engine"])]
    lines: list[Row] = []
    for (_, name), group in group_by(rows, "mechanism", "engine").items():
        shipped = [row for row in group if row["settings"] in ("default", "")]
        ordered = [*shipped, *(row for row in group if row not in shipped)]
        for row in ordered:
            known = accuracy_of(run, row) | engine_facts(run, row, is_first=row is ordered[0])
            lines.append({**row, **known, "name": f"{name} (own)" if name in run.own_engines else name})
    return lines


def accuracy_of(run: Run, row: Row) -> dict[str, Any]:
    """Return what the accuracy cases and the two repeated runs say of a setting."""
    cases = [r for r in run.results if all(r[k] == row[k] for k in METHOD)]
    here = [r for r in cases if (r["mechanism"], r["scenario"]) == (row["mechanism"], row["scenario"])]
    case = next((r for r in here if math.isclose(r["step"], number(row, "step"))), None)
    if case is None:
        return {"missing": row["message"] or "not among the cases of this run"}
    if not has_ended(case):
        return {"missing": case["message"] or case["status"]}
    off = number(case, "acceleration_error_median")
    is_same = off <= SAME_ACCELERATION
    known: dict[str, Any] = {"same_tone": "good" if is_same else "warn", "why_same": "it was not asked at given states"}
    known["same"] = "yes" if is_same else f"off by {off:.0e}" if is_known(off) else ""
    known |= {"order": round(number(case, "observed_order"), 1) + 0.0, "why_order": OWN_STEPS if chose_steps(case) else NO_ORDER}
    known |= {"error": number(case, "length_error"), "bar": error_bar(case, "position_error")}
    known |= redundant_rows(cases, row)
    known["repeats"] = {True: "yes", False: f"no, {number(row, 'difference'):.0e} apart"}.get(row["same_bits"], "")
    known |= {"repeats_tone": "good" if row["same_bits"] else "warn", "why_repeats": row["message"] or "not run twice"}
    known["why_force_error"] = row["message"] or "the forces are not determined"
    known["why_told_force_error"] = row["message"] or "its adapter tells none"
    return known


def redundant_rows(cases: Sequence[Row], row: Row) -> dict[str, Any]:
    """Return the error on the linkage with redundant rows, or why there is none; `cases` are those of the row's setting."""
    others = [r for r in cases if r["mechanism"] == row["redundant"]]
    valid = [r for r in others if has_ended(r) and r["valid"]]
    reason = next((r["flag"] or r["message"] or r["status"] for r in others), "not among the cases of this run")
    return {"redundant": number(valid[0], "length_error") if valid else math.nan, "why_redundant": reason}


def engine_facts(run: Run, row: Row, is_first: bool) -> dict[str, Any]:
    """Return what belongs to an engine and not to a setting: the cost at two accuracies, start and size; in its first row alone."""
    if not is_first:
        return {f"why_{key}": EARLIER for key in (*ACCURACIES, "start", "size")} | {"start": math.nan, "size": math.nan}
    facts: dict[str, Any] = {"why_start": row["message"] or "not timed", "why_size": row["size_of"]}
    for key, limit in ACCURACIES.items():
        winner = winner_of(run, row, limit)
        facts[key] = number(winner, "seconds") if winner else math.nan
        facts[f"why_{key}"] = why_no_winner(run, row, limit, winner)
    return facts


def winner_of(run: Run, row: Row, limit: float) -> Mapping[str, Any] | None:
    """Return the searched best of a row's engine within a limit [m] on the same linkage, or None if it was not searched."""
    for r in run.table("search_winners"):
        same = (r["mechanism"], r["scenario"], r["engine"]) == (row["mechanism"], row["scenario"], row["engine"])
        if same and r["required"] == "position" and math.isclose(number(r, "accuracy"), limit, rel_tol=1e-6):
            return r
    return None


def why_no_winner(run: Run, row: Row, limit: float, winner: Mapping[str, Any] | None) -> str:
    """Return why an engine has no cost within a limit [m]."""
    if winner is None:
        return row["message"] or "not searched in this run"
    return answer(run, row["mechanism"], row["engine"], [Requirement("position", limit)]).words or "not timed"


def findings(run: Run) -> Iterator[Finding]:
    """Yield which engines do not repeat bit by bit, and which were not there to be asked."""
    rows = run.table("field")
    differing = sorted({r["engine"] for r in rows if r["same_bits"] is False})
    asked = sorted({r["engine"] for r in rows if r["same_bits"] is not None})
    if asked:
        missing = sorted({r["engine"] for r in rows} - set(asked))
        text = f"Two runs in two new processes agree bit by bit for {len(asked) - len(differing)} of {count(len(asked), 'engine')}"
        text += f"; not for {itemise(f'`{x}`' for x in differing)}" if differing else ""
        text += f". Not asked: {itemise(f'`{x}`' for x in missing)}." if missing else "."
        yield Finding("Runs that repeat", text, "warn" if differing else "", behind=(lay_out("field", answers(run)),))
