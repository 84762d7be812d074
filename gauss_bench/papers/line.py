"""One line of the audit: what a paper prints, what is right, and a measurement that tells one from the other.

A line holds both forms as functions of the same signature and one `measure`, which compares any such function with a truth that
knows neither. So a verdict cannot be set by hand: `judge` finds fault with a line whose printed form is right though it is called
a misprint, whose printed form is wrong though it is called ok, or whose correction is itself wrong.

Lines that fail for one and the same reason share a `Cause`, and are one mistake however many they are.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from enum import StrEnum
from functools import cache
from typing import Any

import numpy as np

APART = 1e3  # a printed form is called off only where it is this many tolerances off: no verdict within sight of rounding
SAME_TEXT = ""

Form = Callable[..., Any]


class Verdict(StrEnum):
    """The verdict on a printed statement."""

    OK = "ok"
    MISPRINT = "misprint"  # a slip of the pen or of the press: what is meant is clear
    WRONG = "wrong"  # the statement itself fails
    LOOSE = "loose"  # right with a condition that is not stated
    NOT_GIVEN = "not given"  # left out; `intended` is what is assumed here, the printed form leaves it out
    UNREADABLE = "unreadable"  # fails as our extract has it, by a mark that the extract is likely to have lost or added


@dataclass(frozen=True)
class Cause:
    """Causes for which lines fail.

    Attributes:
        name: unique within its paper.
        kind: the verdict on every line that fails for it.
        text: the mistake, the condition or the omission in a sentence.
        doubt: why it may be the text extract's and not the paper's; empty where nothing suggests that.
    """

    name: str
    kind: Verdict
    text: str
    doubt: str = ""


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
        cited, assumed: where the paper is to be found and how it was read; what its numbers need that it does not give.
        printed, intended: what stands there and what is right, in words or letters; `intended` is empty where that is the same.
        verdict: what is to be said of it, which `judge` holds against the measurement: ok without a cause, else the cause's kind.
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
    cause: Cause | None = None
    example: Example | None = None
    cited: str = ""
    assumed: str = ""


@dataclass(frozen=True)
class Judgement:
    """Both discrepancies, and what is wrong with the line itself; no faults where the line stands."""

    printed: float
    intended: float
    faults: tuple[str, ...]


def discrepancy(line: Line, form: Form) -> float:
    """The measured discrepancy of a form; infinite where the form cannot even be evaluated, such as by its shape."""
    return measure_line(line.measure, form)


@cache
def measure_line(measure: Callable[[Form], float], form: Form) -> float:
    try:
        return float(measure(form))
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
    """The line measured, as a flat row of texts and numbers.

    `verdict` is what the measurement says: ok where the printed form is right, else the kind of the cause, or wrong where no cause
    is known. `stands` tells whether the line itself says the same.
    """
    judged = judge(line)
    words = ("paper", "equation", "name", "printed", "intended", "measured", "reason", "sentence", "cited", "assumed")
    off = Verdict.WRONG if line.cause is None else line.cause.kind
    example: dict[str, Any] = {"example": "", "example_printed": None, "example_intended": None, "example_true": None}
    if line.example is not None:
        values = (line.example.of(line.printed_form), line.example.of(line.intended_form), line.example.true())
        example = dict(zip(example, (line.example.name, *map(float, values)), strict=True))
    return {
        **{key: getattr(line, key) for key in words},
        "verdict": str(Verdict.OK if judged.printed <= line.tolerance else off),
        "cause": line.cause.name if line.cause else "",
        "cause_text": line.cause.text if line.cause else "",
        "doubt": line.cause.doubt if line.cause else "",
        "printed_off": judged.printed,
        "intended_off": judged.intended,
        "tolerance": line.tolerance,
        "stands": not judged.faults,
        "faults": "; ".join(judged.faults),
        **example,
    }
