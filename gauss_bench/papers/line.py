"""One line of the audit: what a paper prints, what is right, and a measurement that tells one from the other.

A line holds both forms as functions of the same signature and one `measure`, which compares any such function with a truth that
knows neither. So a verdict cannot be set by hand: `judge` finds fault with a line whose printed form is right though it is called
a misprint, whose printed form is wrong though it is called ok, or whose correction is itself wrong.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from enum import StrEnum
from typing import Any

import numpy as np

YUAN_GE = "Yuan & Ge 2016"
WANG = "Wang et al. 2010"
MEN = "Men et al. 2009"

APART = 1e3  # a printed form is called off only where it is this many tolerances off: no verdict within sight of rounding
ROUNDING = 1e-13  # relative: sums of some ten products of numbers of order one leave 1e-15; two decades of room
SOLVED = 1e-10  # relative: rounding times the condition of the systems solved, up to 1e4, leaves 1e-12; two decades of room
SAME_TEXT = ""

Form = Callable[..., Any]


class Verdict(StrEnum):
    """What is to be said of a printed statement."""

    OK = "ok"
    MISPRINT = "misprint"  # a slip of the pen or of the press: what is meant is clear
    WRONG = "wrong"  # the statement itself fails
    LOOSE = "loose"  # right with a condition that is not stated
    NOT_GIVEN = "not given"  # left out; `intended` is what is assumed here, the printed form leaves it out


@dataclass(frozen=True)
class Example:
    """A number that a reader can check by hand: what it is, with its unit; how a form gives it; what it truly is."""

    name: str
    of: Form
    true: Callable[[], float]


@dataclass(frozen=True)
class Line:
    """One statement of a paper.

    Attributes:
        paper, equation, name: what is audited; `name` is unique in the audit.
        printed, intended: what stands there and what is right, in words or letters; `intended` is empty where that is the same.
        printed_form, intended_form: both as functions that `measure` takes.
        measure: discrepancy of a form from the truth, >= 0, in the unit that `measured` says.
        tolerance: largest discrepancy of a right form, with its reason.
        sentence: what follows for a reader.
    """

    paper: str
    equation: str
    name: str
    printed: str
    intended: str
    verdict: Verdict
    printed_form: Form
    intended_form: Form
    measure: Callable[[Form], float]
    measured: str
    tolerance: float
    reason: str
    sentence: str
    example: Example | None = None


@dataclass(frozen=True)
class Judgement:
    """Both discrepancies, and what is wrong with the line itself; no faults where the line stands."""

    printed: float
    intended: float
    faults: tuple[str, ...]


def right(
    paper: str,
    equation: str,
    name: str,
    printed: str,
    form: Form,
    measure: Callable[[Form], float],
    measured: str,
    tolerance: float,
    reason: str,
    sentence: str,
) -> Line:
    """A line of something that is right as printed."""
    return Line(paper, equation, name, printed, SAME_TEXT, Verdict.OK, form, form, measure, measured, tolerance, reason, sentence)


def discrepancy(line: Line, form: Form) -> float:
    """The measured discrepancy of a form; infinite where the form cannot even be evaluated, such as by its shape."""
    try:
        return float(line.measure(form))
    except (ValueError, IndexError, ArithmeticError, np.linalg.LinAlgError):
        return math.inf


def judge(line: Line) -> Judgement:
    """Measure both forms and hold the verdict against them."""
    printed, intended = discrepancy(line, line.printed_form), discrepancy(line, line.intended_form)
    faults = []
    if not intended <= line.tolerance:
        faults.append("what is called right is not")
    if line.verdict == Verdict.OK:
        if not printed <= line.tolerance:
            faults.append("what is printed is not right")
        if line.intended != SAME_TEXT or line.intended_form is not line.printed_form:
            faults.append("what is right needs no other form")
    elif not printed > APART * line.tolerance:
        faults.append("what is printed is right")
    return Judgement(printed, intended, tuple(faults))


def row(line: Line) -> dict[str, Any]:
    """The line measured, as a flat row of texts and numbers; `stands` tells whether the verdict agrees with the measurement."""
    judged = judge(line)
    words = ("paper", "equation", "name", "printed", "intended", "measured", "reason", "sentence")
    example: dict[str, Any] = {"example": "", "example_printed": None, "example_intended": None, "example_true": None}
    if line.example is not None:
        values = (line.example.of(line.printed_form), line.example.of(line.intended_form), line.example.true())
        example = dict(zip(example, (line.example.name, *map(float, values)), strict=True))
    return {
        **{key: getattr(line, key) for key in words},
        "verdict": str(line.verdict),
        "printed_off": judged.printed,
        "intended_off": judged.intended,
        "tolerance": line.tolerance,
        "stands": not judged.faults,
        "faults": "; ".join(judged.faults),
        **example,
    }
