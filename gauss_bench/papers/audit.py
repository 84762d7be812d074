"""The audit: every line of the three papers, measured as printed and as it should read, and the verdict that follows.

A data file holds what a paper says, line by line, in its order. A line names the function that measures it and its two forms, each
a function of the chapter's module in `forms` or data that the measure reads: a number, a list, a table. The measure compares any
form with a truth that knows neither, so that a verdict cannot be set by hand. The file says only why a line fails, once for all
lines with that cause: they are one mistake however many they are.
"""

import math
import tomllib
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from enum import StrEnum
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

FOLDER = Path(__file__).parent
PAPERS = ("yuan_ge_2016", "wang_2010", "men_2009")
APART = 1e3  # a printed form is called off only where it is this many tolerances off: no verdict within sight of rounding
WORDS = ("name", "printed", "intended", "cause")  # cells of a row that stand in a line as they are
READ = {**dict(zip(WORDS, WORDS, strict=True)), "equation": "place", "sentence": "remark"}
EXAMPLE = ("example_printed", "example_intended", "example_true")

Table = dict[str, Any]


class Verdict(StrEnum):
    """The verdict on a printed statement."""

    OK = "ok"
    MISPRINT = "misprint"  # a slip of the pen or of the press: what is meant is clear
    WRONG = "wrong"  # the statement itself fails
    LOOSE = "loose"  # right with a condition that is not stated
    NOT_GIVEN = "not given"  # left out; `intended` is what is assumed here, the printed form leaves it out
    UNREADABLE = "unreadable"  # fails as our extract has it, by a mark that the extract is likely to have lost or added


@dataclass(frozen=True, eq=False)
class Line:
    """One statement of a paper.

    Attributes:
        texts: cells of its row that are read, not measured.
        verdict: what the file says of it: ok without a cause, else the kind of the cause.
        printed, intended: both forms, one and the same where the line is right.
        measure: discrepancy of a form from the truth, >= 0.
        tolerance: largest discrepancy of a right form.
        example, truth: how a form gives a number that a reader can check by hand, and how that is known; None without one.
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
    """{"audit": rows}, one a line: its texts, both discrepancies, the verdict and what contradicts it."""
    return {"audit": [measure_line(line) for line in lines()]}


def lines() -> tuple[Line, ...]:
    """All lines in the order of the papers and their equations."""
    return tuple(line for name in PAPERS for line in lines_of(read(name)))


def read(name: str) -> Table:
    """A paper's data file."""
    return tomllib.loads((FOLDER / f"{name}.toml").read_text(encoding="utf-8"))


def lines_of(paper: Table) -> Iterator[Line]:
    cited = f"{paper['authors']}: {paper['title']}. {paper['source']}. {paper['extract']}"
    for chapter in paper["chapter"]:
        room = f"forms.{chapter['forms']}"
        for entry in chapter["line"]:
            cause = paper["cause"][entry["cause"]] if "cause" in entry else {"kind": Verdict.OK}
            tolerance, example = paper["tolerance"][entry["tolerance"]], entry.get("example")
            number = paper["number"][example["number"]] if example else {"text": ""}
            printed, intended = (form_of(room, entry.get(key, entry.get("form"))) for key in ("printed_form", "intended_form"))
            texts = {cell: entry.get(key, "") for cell, key in READ.items()} | {
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
                texts,
                Verdict(cause["kind"]),
                printed,
                intended,
                measure_of(room, entry),
                tolerance["value"],
                form_of(room, example["of"]) if example else None,
                form_of(room, number["truth"]) if example else None,
            )


def form_of(room: str, form: Any) -> Any:
    """A form: data as they are, or the function with a name, of this module or by its path in this room."""
    if not isinstance(form, str):
        return form
    path, _, name = form.rpartition(".")
    return getattr(import_module(f"gauss_bench.papers.{path or room}"), name)


def measure_of(room: str, entry: Table) -> Callable[[Any], float]:
    """The measure of a line; `on` says which part of a form, or which problems, it looks at."""
    measure = form_of(room, entry["measure"])
    return (lambda form: measure(form, entry["on"])) if "on" in entry else measure


def discrepancy(line: Line, form: Any) -> float:
    """The measured discrepancy of a form; infinite where the form cannot even be evaluated, such as by its shape."""
    try:
        return float(line.measure(form))
    except (ValueError, IndexError, ArithmeticError, np.linalg.LinAlgError):
        return math.inf


def list_faults(verdict: Verdict, printed: float, intended: float, tolerance: float) -> list[str]:
    """Say what is wrong with a line itself, from its discrepancies; nothing where the line stands."""
    faults = [] if intended <= tolerance else ["what is called right is not"]
    if verdict == Verdict.OK and not printed <= tolerance:
        faults.append("what is printed is not right")
    if verdict != Verdict.OK and not printed > APART * tolerance:
        faults.append("what is printed is right")
    return faults


def measure_line(line: Line) -> dict[str, Any]:
    """The line measured, as a flat row of texts and numbers.

    `verdict` is what the measurement says: ok where the printed form is right, else what the file says, or wrong where that is ok.
    `stands` tells whether the file says the same.
    """
    printed = discrepancy(line, line.printed)
    intended = printed if line.intended is line.printed else discrepancy(line, line.intended)
    faults = list_faults(line.verdict, printed, intended, line.tolerance)
    off = Verdict.WRONG if line.verdict == Verdict.OK else line.verdict
    numbers: tuple[float | None, ...] = (None, None, None)
    if line.example and line.truth:
        numbers = float(line.example(line.printed)), float(line.example(line.intended)), float(line.truth())
    return {
        **line.texts,
        "verdict": str(Verdict.OK if printed <= line.tolerance else off),
        "printed_off": printed,
        "intended_off": intended,
        "tolerance": line.tolerance,
        "stands": not faults,
        "faults": "; ".join(faults),
        **dict(zip(EXAMPLE, numbers, strict=True)),
    }
