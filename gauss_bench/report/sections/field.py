"""The section "The field": the results of the same tests of all engines and settings, with a reason for each missing result."""

import math
from collections.abc import Iterator, Sequence
from itertools import product
from typing import Any

from gauss_bench.reach import Requirement
from gauss_bench.report.cases import SAME_ACCELERATION, chose_steps, error_bar, has_ended
from gauss_bench.report.content import Finding, Section, Text, blocks_of, lay_out
from gauss_bench.report.first_table import mark_own
from gauss_bench.report.pages import list_facts
from gauss_bench.report.rows import METHOD, Row, Run, group_by, is_known, number, spread, with_number
from gauss_bench.report.site.settings import find_race, reach_of_search
from gauss_bench.report.words import count, itemise, itemise_code, ratio_text
from gauss_bench.trajectory import Status

PLACE = 13
TITLE, ANCHOR = "The field", "field"
ACCURACIES = {"coarse": 1e-4, "fine": 1e-6}  # [m] largest position errors of the settings whose cost the table gives
WORDS = {"coarse": "a tenth of a millimetre", "fine": "a micrometre"}
NOT_HERE = "not among the cases of this run"


def section(run: Run) -> Section | None:
    """Return the section with the tables of test results and of costs, or None if the run has no rows of the table `field`."""
    if not run.field_run.table("field"):
        return None
    tables = (*blocks_of("field", list_results(run)), *blocks_of("field_costs", list_costs(run)))
    return Section(TITLE, ANCHOR, (Text(describe_questions(run)), *tables))


def describe_questions(run: Run) -> str:
    """Return sentences on the linkage and step of the tests, and on the run `run.beside` if the rows come from it."""
    first = run.field_run.table("field")[0]
    words = (
        f"All engines ran the same tests on {first['mechanism']} at steps of {1e3 * number(first, 'step'):g} ms. Accuracy is that "
        "of a setting; cost, start and size are those of an engine."
    )
    return f"{words} {describe_run(run)}" if run.beside else words


def describe_run(run: Run) -> str:
    """Return sentences on the separate run that gave the rows, and on why its times differ from those on other pages."""
    return (
        f"The rows come from a separate run ({', '.join(list_facts(run.field_run))}). Its times are those of a brief search; "
        f"the suite `{run.environment.get('suite', '')}`, whose times are on other pages, searched longer and found other settings."
    )


def list_results(run: Run, engine: str = "") -> list[Row]:
    """Return a row of test results for each setting of each engine, or only of `engine`, if it is named.

    Among the rows of an engine, its settings as shipped come first.
    """
    run = run.field_run
    lines: list[Row] = []
    for group in group_by(run.table("field"), "mechanism", "engine").values():
        if engine in ("", group[0]["engine"]):
            ordered = sorted(group, key=lambda row: row["settings"] not in ("default", ""))
            lines += [{**row, **accuracy_of(run, row), "name": mark_own(run, row["engine"])} for row in ordered]
    return lines


def accuracy_of(run: Run, row: Row) -> dict[str, Any]:
    """Return the test results of a setting: errors and orders of its accuracy cases, and whether two runs are equal bit by bit.

    Returns:
        Columns of the layout `field`. `same` says whether the accelerations at given states agree with the reference; `repeats`,
        whether two runs are equal. Columns that begin with `why_`, and `missing`, are reasons for missing values (see
        `content.missing_reason`).
    """
    cases = [r for r in run.results if all(r[k] == row[k] for k in METHOD)]
    here = [r for r in cases if (r["mechanism"], r["scenario"]) == (row["mechanism"], row["scenario"])]
    case = next((r for r in here if math.isclose(r["step"], number(row, "step"))), None)
    if case is None:
        return {"missing": row["message"] or NOT_HERE}
    if not has_ended(case):
        return {"missing": describe_end(case)}
    linkage = row["redundant"]  # name of the tested linkage with redundant rows
    others = [r for r in cases if r["mechanism"] == linkage]
    errors = [number(r, "length_error") for r in others if has_ended(r) and r["valid"]]
    off = number(case, "acceleration_error_median")
    is_same = off <= SAME_ACCELERATION
    difference = f"off by {off:.0e}" if is_known(off) else ""
    repeats = {True: "yes", False: f"no, {number(row, 'difference'):.0e} apart"}
    return {
        "same": "yes" if is_same else difference,
        "same_tone": "good" if is_same else "warn",
        "why_same": "not compared at given states",
        "order": round(number(case, "observed_order"), 1) + 0.0,  # without a minus sign before zero
        "why_order": "own steps" if chose_steps(case) else "no order",
        "error": number(case, "length_error"),
        "bar": error_bar(case, "position_error"),
        "repeats": repeats.get(row["same_bits"], ""),
        "repeats_tone": "good" if row["same_bits"] else "warn",
        "why_repeats": row["message"] or "not run twice",
        "why_force_error": row["message"] or "the forces are not determined",
        "why_told_force_error": row["message"] or "none returned",  # joint forces that the engine itself returns
        "redundant": errors[0] if errors else math.nan,
        "why_redundant": describe_end(others[0]) if others else NOT_HERE,
    }


def describe_end(row: Row) -> str:
    """Return in a few words why the error of a case is not shown; the page of the engine has the whole reason."""
    if has_ended(row):
        return "not valid"
    return "cannot be modelled" if row["status"] == Status.SKIP else str(row["status"]).replace("_", " ")


def list_costs(run: Run, engine: str = "") -> list[Row]:
    """Return a row for each engine, or only for `engine`: its cost at both ACCURACIES, its time to start, and its installed size.

    Columns "coarse" and "fine" have the time of the engine's cheapest setting [s]. With the endings `_range_low` and `_range_high`
    they have its range, with `_over` its ratio to the time of the fastest engine. Columns `why_*` have reasons for missing values.
    """
    run = run.field_run
    lines: list[dict[str, Any]] = []
    for row, *_ in group_by(run.table("field"), "mechanism", "engine").values():
        line = {**row, "name": mark_own(run, row["engine"]), "why_start": row["message"] or "not timed", "why_size": row["size_of"]}
        for key, limit in ACCURACIES.items():
            wanted = Requirement("position", limit)
            race = find_race(run, row["mechanism"], row["engine"], wanted, row["scenario"])
            time = spread(race or {}, "seconds")
            line |= {key: time.value, f"{key}_range_low": time.low, f"{key}_range_high": time.high}
            reason = row["message"] or "not searched in this run"
            if race is not None:
                # the result of the search without its details, which follow a semicolon
                reason = reach_of_search(run, row["mechanism"], row["engine"], [wanted]).words.partition(";")[0] or "not timed"
            line |= {f"why_{key}": reason, f"why_{key}_range": "no time", f"why_{key}_over": "no time"}
        lines.append(line)
    for line, key in product(lines, ACCURACIES):
        same = [x[key] for x in lines if x["mechanism"] == line["mechanism"] and is_known(x[key])]
        line[f"{key}_over"] = line[key] / min(same, default=math.nan)  # multiple of the fastest engine
    # other engines are left out only now, because the multiples need the fastest of all
    return [line for line in lines if engine in ("", line["engine"])]


def findings(run: Run) -> Iterator[Finding]:
    """Yield a finding on the engines whose runs repeat bit by bit, and one on the costs of engines in environments of their own."""
    run = run.field_run
    rows, lines = run.table("field"), list_costs(run)
    # `same_bits` is None if the engine was not run twice
    differing = sorted({r["engine"] for r in rows if r["same_bits"] is False})
    twice = sorted({r["engine"] for r in rows if r["same_bits"] is not None})
    if twice:
        others = sorted({r["engine"] for r in rows} - set(twice))
        text = f"Two runs in two new processes agree bit by bit for {len(twice) - len(differing)} of {count(len(twice), 'engine')}"
        text += f"; not for {itemise_code(differing)}" if differing else ""
        text += f". Not run twice: {itemise_code(others)}." if others else "."
        yield Finding("Runs that repeat", text, "warn" if differing else "", behind=(lay_out("field", list_results(run)),))
    installed = run.environment.get("engines", {})
    apart = sorted(name for name, engine in installed.items() if engine.get("environment"))
    sentences = [compare_costs(lines, apart, key) for key in ACCURACIES]
    if any(sentences):
        text = " ".join(filter(None, sentences))
        yield Finding("Engines in environments of their own", text, short=sentences[0], behind=(lay_out("field_costs", lines),))


def compare_costs(lines: Sequence[Row], engines: Sequence[str], key: str) -> str:
    """Return a sentence on the costs of `engines` as multiples of the least cost of all; empty if none of `engines` has a cost."""
    multiples = {row["engine"]: row[f"{key}_over"] for row in with_number(lines, f"{key}_over")}
    timed = sorted((x for x in engines if x in multiples), key=lambda x: multiples[x])
    if not timed:
        return ""
    fastest = min(multiples, key=lambda x: multiples[x])
    listed = itemise(f"`{x}` {ratio_text(multiples[x])}" for x in timed)
    without = itemise_code(x for x in engines if x not in multiples)
    place = f"To hold {WORDS[key]} on {lines[0]['mechanism']}"
    text = f"{place} takes these multiples of the time of `{fastest}`, the fastest engine: {listed}"
    return f"{text}; no setting of {without} was found." if without else f"{text}."
