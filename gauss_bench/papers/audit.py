"""Measure every checked statement of three papers, as printed and as intended, and derive a verdict.

The data file of a paper lists the paper's statements (equations, numbers, claims) in their order, in chapters; each statement is
called a line. A line has two versions of the statement, called forms: as it is printed, and as the authors intended it, which is
the corrected statement. In the data file, each form is either a string or data (a number, a list or a table). Such a string is the
name of a function, in the chapter's module in `forms`, which computes what the paper's statement says. A form that consists of text
is given as a list with this text.

Each line also names its measure: a function that returns the discrepancy of a form of the statement from a reference. The reference
is computed without either of the two forms, so that the data file cannot decide the verdict. A chapter of the data file may give
cases for a measure, under the key `over`. With cases, the measure is evaluated for each case, and the worst value is used. The data
file also gives the cause of each error; lines with the same cause count as one mistake.
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

    A form of the statement is a function that computes what it says, or data such as a number or a list.

    Attributes:
        texts: cells of the statement's row in the table `audit` that are copied from the data file.
        verdict: the verdict that the data file claims: "ok" if the file names no cause of an error, else the kind of this cause.
        printed, intended: form of the statement as printed, and form as intended by the authors; the same object if the statement
            is right as printed.
        measure: function that maps a form to its discrepancy from the reference, >= 0.
        tolerance: largest discrepancy of a form that counts as right.
        example: function that maps a form to a number that a reader can check with pencil and paper; None if there is no example.
        truth: function that computes the true value of the example's number independently of both forms; None if there is no
            example.
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
    """Return {"audit": rows} with a row for each statement of the papers: its texts, both discrepancies, and the verdict."""
    return {"audit": [measure_line(line) for line in lines()]}


def lines() -> tuple[Line, ...]:
    """Return all checked statements of all papers, in the order of PAPERS and of each paper's data file."""
    return tuple(line for name in PAPERS for line in lines_of(read(name)))


def read(name: str) -> Table:
    """Read a paper's data file."""
    return tomllib.loads((FOLDER / f"{name}.toml").read_text(encoding="utf-8"))


def lines_of(paper: Table) -> Iterator[Line]:
    """Yield the statements of a paper's data file, with the functions themselves in place of their names in the file.

    The data file has chapters with lines, one for each statement. `printed` is the function or data of the statement as printed,
    `intended` as the authors meant it. A line refers to its measure, its cause of error, its tolerance and its number (what its
    example computes) by keys of tables in the file or the chapter.
    """
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
    """Return the function that a string in a data file names; return any other value (a number, list or table) unchanged.

    The string `form` is the name of a function in `module`, the chapter's module, or the path of a function in
    `gauss_bench.papers`.
    """
    if not isinstance(form, str):
        return form
    path, _, name = form.rpartition(".")
    return getattr(import_module(f"gauss_bench.papers.{path or module}"), name)


def measure_of(module: str, chapter: Table, entry: Table) -> Callable[[Any], float]:
    """Return a function of one form of a statement: its largest discrepancy over all cases for which the statement is tested.

    Args:
        module: module of the chapter in `papers`.
        chapter: table of the data file; its table `over` names, for a measure, the function that lists the cases of this measure.
        entry: table of the statement; the value of its key `on`, if there is one, is passed to the measure as the last argument.
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
    """Return the measured discrepancy of a form of a statement from the reference.

    The discrepancy is infinite if the form cannot be evaluated, for example because shapes of arrays do not fit.
    """
    try:
        return float(line.measure(form))
    except (ValueError, IndexError, ArithmeticError, np.linalg.LinAlgError):
        return math.inf


def list_faults(verdict: Verdict, printed: float, intended: float, tolerance: float) -> list[str]:
    """List the contradictions between the verdict that the data file claims for a statement and the measured discrepancies.

    The list is empty if they agree.

    Args:
        verdict: the verdict that the data file claims.
        printed, intended: differences of the statement as printed and as intended from the reference.
        tolerance: largest difference of a correct statement. A statement as printed counts as wrong only if its difference exceeds
            APART times the tolerance.
    """
    # `not x <= tolerance` also is true if x is NaN
    faults = [] if intended <= tolerance else ["what is called right is not"]
    if verdict == Verdict.OK and not printed <= tolerance:
        faults.append("what is printed is not right")
    if verdict != Verdict.OK and not printed > APART * tolerance:
        faults.append("what is printed is right")
    return faults


def measure_line(line: Line) -> dict[str, Any]:
    """Measure a statement of a paper, and return its row of texts and numbers in the table `audit`.

    Besides the texts that quote and explain the statement, the row has these columns:
        verdict: "ok" if the statement is right as printed; otherwise the verdict that the data file claims, or "wrong" if the file
            claims "ok".
        printed_off, intended_off: differences of the statement as printed and as intended from the reference.
        tolerance: largest difference of a correct statement.
        stands: whether the measured discrepancies agree with the verdict of the data file.
        faults: the contradictions between the measured discrepancies and the verdict of the data file.
        example_printed, example_intended, example_true: the number of the statement's example as computed by the printed form and
            by the intended form, and its true value; None if the paper's statement has no numerical example.
    """
    printed = discrepancy(line, line.printed)
    intended = printed if line.intended is line.printed else discrepancy(line, line.intended)
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
