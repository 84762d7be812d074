"""The field: every engine by the same questions, a row for each setting, and a reason in place of each missing answer."""

import math
from collections.abc import Iterator, Mapping, Sequence
from itertools import product
from typing import Any

from gauss_bench.reach import Requirement
from gauss_bench.report.cases import SAME_ACCELERATION, chose_steps, error_bar, has_ended
from gauss_bench.report.content import Finding, Section, Text, blocks_of, lay_out
from gauss_bench.report.first_table import mark_own
from gauss_bench.report.pages import facts
from gauss_bench.report.reaches import answer
from gauss_bench.report.rows import METHOD, Row, Run, Spread, group_by, is_known, number, spread, with_number
from gauss_bench.report.words import count, itemise, ratio_text
from gauss_bench.trajectory import Status

PLACE = 13
TITLE, ANCHOR = "The field", "field"
ACCURACIES = {"coarse": 1e-4, "fine": 1e-6}  # [m] at which the table has the cost of an engine's searched best
WORDS = {"coarse": "a tenth of a millimetre", "fine": "a micrometre"}
OWN_STEPS, NO_ORDER, UNTOLD, UNTIMED = "own steps", "no order", "none told", "no time"


def section(run: Run) -> Section | None:
    """Return the tables of all engines, or None for a run that did not ask them."""
    if not run.field_run.table("field"):
        return None
    return Section(
        TITLE, ANCHOR, [Text(describe_questions(run)), *blocks_of("field", answers(run)), *blocks_of("field_costs", costs(run))]
    )


def describe_questions(run: Run) -> str:
    """Return in words on which linkage and at which step the engines were asked, and in which run if that is another one."""
    first = run.field_run.table("field")[0]
    words = (
        f"All engines were asked the same on {first['mechanism']} at steps of {1e3 * number(first, 'step'):g} ms. Accuracy is that "
        "of a setting; cost, start and size are those of an engine."
    )
    return f"{words} {describe_run(run)}" if run.beside else words


def describe_run(run: Run) -> str:
    """Return in words which run asked the engines, and why its times differ from those of the run beside which it is published."""
    return (
        f"The rows are of a run of their own ({', '.join(facts(run.field_run))}). Its times are those of a brief search; the suite "
        f"`{run.environment.get('suite', '')}`, whose times stand on the other pages, searched longer and found other settings."
    )


def answers(run: Run, engine: str = "") -> list[Row]:
    """Return the rows of the field, or those of one engine, with what other tables of the run know of each setting."""
    run = run.field_run
    lines: list[Row] = []
    for group in rows_of_engines(run, engine):
        shipped = [row for row in group if row["settings"] in ("default", "")]
        for row in (*shipped, *(row for row in group if row not in shipped)):
            lines.append({**row, **accuracy_of(run, row), "name": mark_own(run, row["engine"])})
    return lines


def rows_of_engines(run: Run, engine: str) -> list[list[Row]]:
    """Return the rows of the field of each engine, or of one engine."""
    rows = [row for row in run.table("field") if engine in ("", row["engine"])]
    return list(group_by(rows, "mechanism", "engine").values())


def accuracy_of(run: Run, row: Row) -> dict[str, Any]:
    """Return what the accuracy cases and the two repeated runs say of a setting."""
    cases = [r for r in run.results if all(r[k] == row[k] for k in METHOD)]
    here = [r for r in cases if (r["mechanism"], r["scenario"]) == (row["mechanism"], row["scenario"])]
    case = next((r for r in here if math.isclose(r["step"], number(row, "step"))), None)
    if case is None:
        return {"missing": row["message"] or "not among the cases of this run"}
    if not has_ended(case):
        return {"missing": describe_end(case)}
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
    known["why_told_force_error"] = row["message"] or UNTOLD
    return known


def redundant_rows(cases: Sequence[Row], row: Row) -> dict[str, Any]:
    """Return the error on the linkage with redundant rows, or why there is none; `cases` are those of the row's setting."""
    others = [r for r in cases if r["mechanism"] == row["redundant"]]
    valid = [r for r in others if has_ended(r) and r["valid"]]
    reason = next((describe_end(r) for r in others), "not among the cases of this run")
    return {"redundant": number(valid[0], "length_error") if valid else math.nan, "why_redundant": reason}


def describe_end(row: Row) -> str:
    """Return why a case gives no error, in a few words; the page of its engine has the whole reason."""
    if has_ended(row):
        return "not valid"
    return "cannot be modelled" if row["status"] == Status.SKIP else str(row["status"]).replace("_", " ")


def costs(run: Run, engine: str = "") -> list[Row]:
    """Return a row for each engine of the field, or for one: the cost of its searched best at two accuracies, start and size."""
    run = run.field_run
    lines: list[dict[str, Any]] = []
    for row, *_ in rows_of_engines(run, ""):
        line = {**row, "name": mark_own(run, row["engine"]), "why_start": row["message"] or "not timed", "why_size": row["size_of"]}
        for key, limit in ACCURACIES.items():
            winner = winner_of(run, row, limit)
            time = spread(winner, "seconds") if winner else Spread(math.nan, math.nan, math.nan)
            line |= {key: time.value, f"{key}_range_low": time.low, f"{key}_range_high": time.high}
            line |= {f"why_{key}": why_no_winner(run, row, limit, winner), f"why_{key}_range": UNTIMED, f"why_{key}_over": UNTIMED}
        lines.append(line)
    for line, key in product(lines, ACCURACIES):
        same = [x[key] for x in lines if x["mechanism"] == line["mechanism"] and is_known(x[key])]
        line[f"{key}_over"] = line[key] / min(same, default=math.nan)
    return [line for line in lines if engine in ("", line["engine"])]


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
    return answer(run, row["mechanism"], row["engine"], [Requirement("position", limit)]).words.partition(";")[0] or "not timed"


def findings(run: Run) -> Iterator[Finding]:
    """Yield which engines do not repeat bit by bit and which were not there, and the cost of those of environments."""
    run = run.field_run
    rows, lines = run.table("field"), costs(run)
    differing = sorted({r["engine"] for r in rows if r["same_bits"] is False})
    asked = sorted({r["engine"] for r in rows if r["same_bits"] is not None})
    if asked:
        missing = sorted({r["engine"] for r in rows} - set(asked))
        text = f"Two runs in two new processes agree bit by bit for {len(asked) - len(differing)} of {count(len(asked), 'engine')}"
        text += f"; not for {itemise(f'`{x}`' for x in differing)}" if differing else ""
        text += f". Not asked: {itemise(f'`{x}`' for x in missing)}." if missing else "."
        yield Finding("Runs that repeat", text, "warn" if differing else "", behind=(lay_out("field", answers(run)),))
    apart = sorted(x for x, known in run.environment.get("engines", {}).items() if known.get("environment"))
    sentences = [compare_costs(lines, apart, key) for key in ACCURACIES]
    if any(sentences):
        text = " ".join(filter(None, sentences))
        yield Finding("Engines in environments of their own", text, short=sentences[0], behind=(lay_out("field_costs", lines),))


def compare_costs(lines: Sequence[Row], engines: Sequence[str], key: str) -> str:
    """Return a sentence on the costs of some engines as multiples of the least of all; empty if none of them has a cost."""
    over = {row["engine"]: row[f"{key}_over"] for row in with_number(lines, f"{key}_over")}
    timed = sorted((x for x in engines if x in over), key=lambda x: over[x])
    if not timed:
        return ""
    fastest = min(over, key=lambda x: over[x])
    multiples = itemise(f"`{x}` {ratio_text(over[x])}" for x in timed)
    none = itemise(f"`{x}`" for x in engines if x not in over)
    place = f"To hold {WORDS[key]} on {lines[0]['mechanism']}"
    words = f"{place}, in multiples of the time of `{fastest}`, the fastest engine asked, it takes {multiples}"
    return f"{words}; no setting of {none} was found." if none else f"{words}."
