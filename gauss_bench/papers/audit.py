"""Measure every checked statement of three papers, as printed and as intended, and derive a verdict.

The data file of a paper lists its statements (equations, numbers, claims) in chapters; each statement is called a line. A line has
two forms of the statement: as it is printed, and as the authors intended it. A form is data (a number, a list or a table), or a
string that names a function in the chapter's module in `forms`, which computes what the statement says.

Each line also names its measure: a function that returns the discrepancy of a form from a reference, which is computed without
either form, so that the data file cannot decide the verdict. If the chapter gives cases for a measure under `over`, the worst case
counts. Lines with the same cause of error count as one mistake.
"""

import tomllib
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from enum import StrEnum
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

FOLDER = Path(__file__).parent
PAPERS = ("yuan_ge_2016", "wang_2010", "men_2009")
APART = 1e3  # a printed form counts as wrong only if its discrepancy exceeds this many tolerances, far beyond rounding

Table = dict[str, Any]


class Verdict(StrEnum):
    """The verdict on a printed statement."""

    OK = "ok"
    MISPRINT = "misprint"  # a slip of the pen or of the press, with a clear meaning
    WRONG = "wrong"  # the statement itself is false
    LOOSE = "loose"  # right under a condition that is not stated
    NOT_GIVEN = "not given"  # data that the paper leaves out; the intended form has the data that are assumed here
    UNREADABLE = "unreadable"  # false in the text that was extracted from the paper; the extraction probably lost or added a mark


@dataclass(frozen=True, eq=False)
class Line:
    """One statement of a paper.

    Attributes:
        texts: cells of its row in the table `audit` that are copied from the data file.
        verdict: the verdict that the data file claims: "ok", or the kind of the cause of the error.
        printed, intended: the two forms (functions or data); the same object if the statement is right as printed.
        measure: form -> its discrepancy from the reference, >= 0.
        tolerance: largest discrepancy of a form that counts as right.
        example: form -> a number that a reader can check with pencil and paper; None if there is none.
        truth: function that returns the true value of that number, independently of both forms; None if there is none.
    """

    texts: dict[str, str]
    verdict: Verdict
    printed: Any
    intended: Any
    measure: Callable[[Any], float]
    tolerance: float
    example: Callable[[Any], float] | None
    truth: Callable[[], float] | None


def audit() -> dict[str, Any]:
    """Return {"audit": rows} with a row (`measure_line`) for each statement of the papers."""
    return {"audit": [measure_line(line) for line in lines()]}


def lines() -> tuple[Line, ...]:
    """Return all checked statements, in the order of PAPERS and of each data file."""
    return tuple(line for name in PAPERS for line in read_lines(read_paper(name)))


def read_paper(name: str) -> Table:
    """Read a paper's data file."""
    return tomllib.loads((FOLDER / f"{name}.toml").read_text(encoding="utf-8"))


def read_lines(paper: Table) -> Iterator[Line]:
    """Yield the statements of a paper's data file, with functions in place of their names."""
    cited = f"{paper['authors']}: {paper['title']}. {paper['source']}. {paper['extract']}"
    for chapter in paper["chapter"]:
        module = f"forms.{chapter['forms']}"
        for entry in chapter["line"]:
            cause = paper["cause"][entry["cause"]] if "cause" in entry else {"kind": Verdict.OK}
            tolerance, example = paper["tolerance"][entry["tolerance"]], entry.get("example")
            number = paper["number"][example["number"]] if example else {"text": ""}  # text and true value of the example's number
            texts = {key: entry.get(key, "") for key in ("name", "printed", "intended", "cause")} | {
                "equation": entry.get("place", ""),
                "sentence": entry.get("remark", ""),
                "paper": paper["paper"],
                "measured": chapter["measure"][entry["measure"]],
                "reason": tolerance["reason"],
                "cited": cited,
                "assumed": paper["assumed"],
                "cause_text": cause.get("text", ""),
                "doubt": cause.get("doubt", ""),
                "example": number["text"],
            }
            yield Line(
                texts=texts,
                verdict=Verdict(cause["kind"]),
                printed=resolve_form(module, entry.get("printed_form", entry.get("form"))),
                intended=resolve_form(module, entry.get("intended_form", entry.get("form"))),
                measure=resolve_measure(module, chapter, entry),
                tolerance=tolerance["value"],
                example=resolve_form(module, example["of"]) if example else None,
                truth=resolve_form(module, number["truth"]) if example else None,
            )


def resolve_form(module: str, form: Any) -> Any:
    """Return the function that a string names, in `module` or by its path in `gauss_bench.papers`; data are returned unchanged."""
    if not isinstance(form, str):
        return form
    path, _, name = form.rpartition(".")
    return getattr(import_module(f"gauss_bench.papers.{path or module}"), name)


def resolve_measure(module: str, chapter: Table, entry: Table) -> Callable[[Any], float]:
    """Return the measure of a line: a function form -> discrepancy, the largest over all cases if the measure has several.

    `entry` is the table of the line; the value of its key `on`, if there is one, is the last argument of the measure.
    """
    measure, list_cases = resolve_form(module, entry["measure"]), chapter.get("over", {}).get(entry["measure"])
    on = [entry["on"]] if "on" in entry else []
    if list_cases is None:
        return lambda form: float(measure(form, *on))
    return lambda form: worst([measure(form, case, *on) for case in resolve_form(module, list_cases)()])


def worst(values: Sequence[float]) -> float:
    """Return the largest value, or NaN if any is NaN, which fails every tolerance."""
    return float(np.max(values))


def list_faults(verdict: Verdict, printed: float, intended: float, tolerance: float) -> list[str]:
    """List the contradictions between a claimed verdict and the discrepancies of both forms, `printed` and `intended`.

    A form counts as right within the tolerance, and as wrong beyond APART tolerances.
    """
    # `not x <= tolerance` is also true if x is NaN
    faults = [] if intended <= tolerance else ["the intended form is not right"]
    if verdict == Verdict.OK and not printed <= tolerance:
        faults.append("the printed form is not right")
    if verdict != Verdict.OK and not printed > APART * tolerance:
        faults.append("the printed form is not wrong")
    return faults


def measure_line(line: Line) -> dict[str, Any]:
    """Return the row of a statement in the table `audit`: its texts, discrepancies, verdict, faults and the numbers of its example.

    The verdict is "ok" if the statement is right as printed, else the claimed verdict, or "wrong" if "ok" was claimed.
    """
    printed = line.measure(line.printed)
    intended = printed if line.intended is line.printed else line.measure(line.intended)
    faults = list_faults(line.verdict, printed, intended, line.tolerance)
    verdict_if_wrong = Verdict.WRONG if line.verdict == Verdict.OK else line.verdict
    example = line.example
    return {
        **line.texts,
        "verdict": str(Verdict.OK if printed <= line.tolerance else verdict_if_wrong),
        "printed_off": printed,
        "intended_off": intended,
        "tolerance": line.tolerance,
        "stands": not faults,
        "faults": "; ".join(faults),
        "example_printed": float(example(line.printed)) if example else None,
        "example_intended": float(example(line.intended)) if example else None,
        "example_true": float(line.truth()) if line.truth else None,
    }
