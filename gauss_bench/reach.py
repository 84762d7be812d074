"""The answer for a linkage, an engine and a requirement: the engine holds it, or how far the search came and why it ended.

The search, the recommendation and the report print this answer and no other. It follows from the evaluations of the engine's
variants alone, so that it can be computed from stored rows of `search_ladder` as well as from a search that has just ended.
"""

import math
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import Any

import numpy as np

from gauss_bench.trajectory import Status

UNITS = {"position": "m", "angle": "rad", "force": "N", "end": "m"}  # of errors, by what they are errors of; `end`: of position
ERRORS = {"end": "position at the end"}  # kinds of errors in words, where the kind is none
BY_AUTHORS = "by its authors"  # of settings that the authors of an engine own
RUNGS = 3  # of a ladder tell the order of convergence ...
APART = 1.4  # ... if each has so many times the steps of the one before: nearer ones tell rounding
STEADY = 0.2  # two orders of convergence that differ by less are one
ABSENT = re.compile(
    r"not installed|no C compiler|not in this build|the truth has no samples"
)  # reasons of a machine, not an engine


@dataclass(frozen=True)
class Requirement:
    """The largest error over the whole run: of positions [m], angles [rad] or joint forces [N]; or of positions at its end [m]."""

    kind: str
    limit: float

    @property
    def unit(self) -> str:
        return UNITS[self.kind]


@dataclass(frozen=True)
class Trial:
    """One evaluation of a variant.

    Attributes:
        size: step [s] or tolerance.
        errors: kind -> largest of the run, NaN where it is not determined; empty for a failed run.
        steps: taken, or asked for; None where an integrator chooses them and the engine does not count them.
        status, message: OK, or why it failed.
        evaluations: of accelerations, or None where the engine does not count them.
    """

    size: float
    errors: Mapping[str, float]
    steps: int | None = 0
    status: Status = Status.OK
    message: str = ""
    evaluations: int | None = None

    def meets(self, wanted: Requirement) -> bool:
        return self.status is Status.OK and self.errors.get(wanted.kind, math.nan) <= wanted.limit


def trial_of(row: Mapping[str, Any]) -> Trial:
    """Return the trial that a row of `search_ladder` describes."""
    values = {x: row.get(x) for x in ("step", "tolerance", "steps", *(f"{kind}_error" for kind in UNITS))}
    known = {x: float(y) for x, y in values.items() if y is not None and math.isfinite(y)}
    status = Status(row["status"])
    errors = {kind: known.get(f"{kind}_error", math.nan) for kind in UNITS} if status is Status.OK else {}
    size = known.get("step") or known.get("tolerance") or math.nan
    return Trial(size, errors, int(known["steps"]) if "steps" in known else None, status, str(row.get("message") or ""))


class Kind(StrEnum):
    """The answers there are."""

    TIMED = "holds"
    UNTIMED = "holds, not timed"
    NOT_REACHED = "not reached"
    NO_MODEL = "cannot be modelled"
    UNDETERMINED = "not determined"  # joint forces of redundant rows: no engine has them
    NOT_TRIED = "not tried"


@dataclass(frozen=True)
class Reach:
    """The answer for one engine and requirement.

    Attributes:
        reason: why the engine is not timed, not tried or has no model; for NOT_REACHED, how its runs failed.
        steps: the most steps of a run that was tried.
        seconds: the time of the search [s], where time ended it.
        within: the same in words, where it is no number of seconds.
        order: of convergence, of the variant that would hold with the fewest steps; NaN where none is steady.
        needed: number of steps at which that variant would hold the requirement, if its error keeps falling at that order.
    """

    kind: Kind
    reason: str = ""
    steps: int = 0
    seconds: float = math.nan
    order: float = math.nan
    needed: float = math.nan
    within: str = ""

    @property
    def holds(self) -> bool:
        return self.kind in (Kind.TIMED, Kind.UNTIMED)

    @property
    def words(self) -> str:
        """Return the answer as it is printed everywhere."""
        within = [f"in {self.steps:,} steps"] if self.steps and self.kind is Kind.NOT_REACHED else []
        within += [f"within {self.seconds:.3g} s"] if math.isfinite(self.seconds) else []
        within += [self.within] if self.within else []
        said = " ".join([str(self.kind), *within[-1:]])
        if math.isfinite(self.needed):
            needed = f"{float(f'{self.needed:.2g}'):,.0f}" if self.needed < 1e9 else f"{self.needed:.0e}"
            said += f"; order {self.order:.1f} extrapolates to {needed}{' steps' if math.isfinite(self.seconds) else ''}"
        return f"{said}: {self.reason}" if self.reason else said


def reach(ladders: Iterable[Sequence[Trial]], wanted: Sequence[Requirement], untimed: str | None = None) -> Reach:
    """Return the answer of an engine, given the trials of each of its variants, for requirements that have to hold together.

    `untimed` is why no race timed what holds; None where one did.
    """
    ladders = [some for some in ladders if some]
    trials = [trial for some in ladders for trial in some]
    ended = [trial for trial in trials if trial.status is Status.OK]
    shares = [share(trial, wanted) for trial in ended]
    if any(x <= 1 for x in shares):
        return Reach(Kind.TIMED) if untimed is None else Reach(Kind.UNTIMED, untimed)
    failed = [trial for trial in trials if trial.status is not Status.SKIP]
    if not failed:
        reason = trials[0].message if trials else "it was not searched"
        return Reach(Kind.NOT_TRIED if not trials or ABSENT.search(reason) else Kind.NO_MODEL, reason)
    if ended and all(map(math.isnan, shares)):
        return Reach(Kind.UNDETERMINED, "redundant rows leave joint forces open")
    steps = max(trial.steps or 0 for trial in failed)
    if not ended:
        return Reach(Kind.NOT_REACHED, f"no run ended: {failed[-1].message}", steps)
    tried = [x for some in ladders if math.isfinite((x := convergence(some, wanted))[1])]
    order, needed = min(tried, key=lambda x: x[1], default=(math.nan, math.nan))
    return Reach(Kind.NOT_REACHED, steps=steps, order=order, needed=needed)


def share(trial: Trial, wanted: Sequence[Requirement]) -> float:
    """Return the largest error of a run over what is required of it; NaN where an error is not determined."""
    shares = [trial.errors.get(w.kind, math.nan) / w.limit for w in wanted]
    return math.nan if any(map(math.isnan, shares)) else max(shares)


def convergence(trials: Sequence[Trial], wanted: Sequence[Requirement]) -> tuple[float, float]:
    """Return the order at which errors fell in the last rungs, and the steps at which they would hold; NaN without a steady one."""
    rungs: list[tuple[int, Trial]] = []
    counted = [(t.steps, t) for t in trials if t.steps]
    for steps, trial in sorted(counted, key=lambda x: -x[0]):
        if not rungs or steps * APART <= rungs[-1][0]:
            rungs.append((steps, trial))
    last = [(steps, t) for steps, t in rungs[:RUNGS] if t.status is Status.OK]
    with np.errstate(all="ignore"):
        errors = np.log([share(t, wanted) for _, t in last])
        orders = np.diff(errors) / -np.diff(np.log([steps for steps, _ in last]))
    if len(last) < RUNGS or not (np.isfinite(orders).all() and orders.min() > 0 and np.ptp(orders) < STEADY):
        return math.nan, math.nan
    order = float(orders[0])  # between the two finest
    return order, last[0][0] * math.exp(min(errors[0] / order, 100.0))
