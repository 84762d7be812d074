"""Measure every checked statement of the three papers, as printed and as intended, and derive a verdict.

The data file of a paper lists the paper's statements (equations, numbers, claims) in their order; each is called a line. A line has
two forms: the statement as printed, and as intended, that is corrected. In the data file, a form is a text, which names a function
of the chapter's module in `forms`, or data: a number, a list or a table. (A form that is one text is given as a list of this text.)

A line also names its measure: a function that returns the discrepancy of a form from a reference. The reference is computed from
neither of the two forms, so that the data file cannot decide the verdict. If the chapter lists cases for a measure under `over`,
the measure is evaluated for each case, and its worst value is used. The file gives the cause of an error; lines with the same
cause count as one mistake.
"""

import math
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
APART = 1e3  # a printed form counts as wrong only if it differs by this many tolerances, far beyond rounding
CELLS = {  # cell of a row -> key of the line from which it is copied
    "name": "name",
    "printed": "printed",
    "intended": "intended",
    "cause": "cause",
    "equation": "place",
    "sentence": "remark",
}

Table = dict[str, Any]


class Verdict(StrEnum):
    """The verdict on a printed statement."""

    OK = "ok"
    MISPRINT = "misprint"  # a slip of the pen or of the press, with a clear meaning
    WRONG = "wrong"  # the statement itself is false
    LOOSE = "loose"  # right under a condition that is not stated
    NOT_GIVEN = "not given"  # data that the paper leaves out; the intended form has the data that are assumed here
    UNREADABLE = "unreadable"  # false in our extract, which probably lost or added a mark


@dataclass(frozen=True, eq=False)
class Line:
    """One statement of a paper.

    Attributes:
        texts: cells of the line's row that are copied from the file.
        verdict: the verdict that the file claims: "ok" if it names no cause, else the kind of that cause.
        printed, intended: the statement as printed and as intended; the same object if the line is right as printed.
        measure: function that maps a form to its discrepancy from the reference, >= 0.
        tolerance: largest discrepancy of a right form.
        example: function that maps a form to a number that a reader can check by hand; None if the line has no example.
        truth: function that computes the true value of this number from neither form; None if the line has no example.
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
    """Return {"audit": rows} with a row for each line: its texts, both discrepancies, and the verdict."""
    return {"audit": [measure_line(line) for line in lines()]}


def lines() -> tuple[Line, ...]:
    """Return all lines in the order of the papers and their equations."""
    return tuple(line for name in PAPERS for line in lines_of(read(name)))


def read(name: str) -> Table:
    """Read a paper's data file."""
    return tomllib.loads((FOLDER / f"{name}.toml").read_text(encoding="utf-8"))


def lines_of(paper: Table) -> Iterator[Line]:
    """Yield the lines of a paper's data file, with functions in place of the names of forms and measures."""
    cited = f"{paper['authors']}: {paper['title']}. {paper['source']}. {paper['extract']}"
    for chapter in paper["chapter"]:
        module = f"forms.{chapter['forms']}"
        for entry in chapter["line"]:
            cause = paper["cause"][entry["cause"]] if "cause" in entry else {"kind": Verdict.OK}
            tolerance, example = paper["tolerance"][entry["tolerance"]], entry.get("example")
            number = paper["number"][example["number"]] if example else {"text": ""}  # what the example computes
            texts = {cell: entry.get(key, "") for cell, key in CELLS.items()} | {
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
                printed=form_of(module, entry.get("printed_form", entry.get("form"))),
                intended=form_of(module, entry.get("intended_form", entry.get("form"))),
                measure=measure_of(module, chapter, entry),
                tolerance=tolerance["value"],
                example=form_of(module, example["of"]) if example else None,
                truth=form_of(module, number["truth"]) if example else None,
            )


def form_of(module: str, form: Any) -> Any:
    """Return the form that an entry of a data file stands for.

    A text is the name of a function in the chapter's module `module`, or its path in `papers`; the form is this function. Any other
    entry is data, and is the form itself.
    """
    if not isinstance(form, str):
        return form
    path, _, name = form.rpartition(".")
    return getattr(import_module(f"gauss_bench.papers.{path or module}"), name)


def measure_of(module: str, chapter: Table, entry: Table) -> Callable[[Any], float]:
    """Return the function that maps a form of a line to its largest discrepancy over the cases of the line's measure.

    Args:
        module: module of the chapter in `papers`.
        chapter: table of the data file; its `over` names the function that lists the cases of a measure.
        entry: table of the line; its `on`, if there is one, is passed to the measure as the last argument.
    """
    measure, cases = form_of(module, entry["measure"]), chapter.get("over", {}).get(entry["measure"])
    on = [entry["on"]] if "on" in entry else []
    if cases is None:
        return lambda form: float(measure(form, *on))
    return lambda form: worst([measure(form, case, *on) for case in form_of(module, cases)()])


def worst(values: Sequence[float]) -> float:
    """Return the largest value, or NaN if any is NaN, which fails every tolerance."""
    return float(np.max(values))


def discrepancy(line: Line, form: Any) -> float:
    """Return the measured discrepancy of a form; infinite if the form cannot be evaluated, as when shapes do not fit."""
    try:
        return float(line.measure(form))
    except (ValueError, IndexError, ArithmeticError, np.linalg.LinAlgError):
        return math.inf


def list_faults(verdict: Verdict, printed: float, intended: float, tolerance: float) -> list[str]:
    """List the contradictions between the verdict that the data file claims for a line, and measurement; empty if there is none.

    Args:
        printed, intended: discrepancy of the line as printed, and as intended.
    """
    # `not x <= tolerance` also is true if x is NaN
    faults = [] if intended <= tolerance else ["what is called right is not"]
    if verdict == Verdict.OK and not printed <= tolerance:
        faults.append("what is printed is not right")
    if verdict != Verdict.OK and not printed > APART * tolerance:
        faults.append("what is printed is right")
    return faults


def measure_line(line: Line) -> dict[str, Any]:
    """Measure a line and return its row of texts and numbers.

    The row's `verdict` is "ok" if the line is right as printed. Otherwise it is the file's verdict, or "wrong" if the file claims
    "ok". `printed_off` and `intended_off` are the discrepancies of the line as printed and as intended. `stands` tells whether
    measurement and file agree, and `faults` gives the contradictions. `example_printed`, `example_intended` and `example_true` are
    the values of the line's example by both forms and its true value, None if the line has no example.
    """
    printed = discrepancy(line, line.printed)
    intended = printed if line.intended is line.printed else discrepancy(line, line.intended)
    faults = list_faults(line.verdict, printed, intended, line.tolerance)
    fault = Verdict.WRONG if line.verdict == Verdict.OK else line.verdict
    example = line.example
    return {
        **line.texts,
        "verdict": str(Verdict.OK if printed <= line.tolerance else fault),
        "printed_off": printed,
        "intended_off": intended,
        "tolerance": line.tolerance,
        "stands": not faults,
        "faults": "; ".join(faults),
        "example_printed": float(example(line.printed)) if example else None,
        "example_intended": float(example(line.intended)) if example else None,
        "example_true": float(line.truth()) if line.truth else None,
    }
