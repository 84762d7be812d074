"""The answer to the question whether an engine meets a requirement on a linkage; if not, how far the search came and why it ended.

The search, the recommendation and the report print this answer, a `Reach`, in the same words. It is computed from the trials of the
engine's variants, which may be stored rows of the table `search_ladder`.
"""

import math
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import Any

import numpy as np

from gauss_bench.trajectory import Status

UNITS = {"position": "m", "angle": "rad", "force": "N", "end": "m"}  # kind of an error -> its unit; `end`: position at the end
ERRORS = {"end": "position at the end"}  # kind -> its name, if that differs
BY_AUTHORS = "by its authors"  # mark of settings that the authors of an engine sent in
RUNGS = 3  # number of trials that show the order of convergence
APART = 1.4  # smallest ratio of the numbers of steps of two of these trials: with less, rounding hides the order
STEADY = 0.2  # largest difference of two orders of convergence that count as equal
# reasons of failures that are due to the machine, not to the engine
ABSENT = re.compile(r"not installed|no C compiler|not in this build|the truth has no samples")


@dataclass(frozen=True)
class Requirement:
    """The largest allowed error, of a kind in UNITS, over the whole run; for the kind `end`, at the end of the run."""

    kind: str
    limit: float

    @property
    def unit(self) -> str:
        """The unit of the limit, such as "m"."""
        return UNITS[self.kind]


@dataclass(frozen=True)
class Trial:
    """One run of a variant, with one step or one tolerance.

    Attributes:
        size: step [s] or tolerance.
        errors: kind of error -> largest error of the run, NaN if it is not determined; empty for a failed run.
        steps: number of steps; None if the integrator chooses its steps and the engine does not count them.
        evaluations: number of evaluations of the accelerations; None if the engine does not count its evaluations.
    """

    size: float
    errors: Mapping[str, float]
    steps: int | None = 0
    status: Status = Status.OK
    message: str = ""
    evaluations: int | None = None

    def meets(self, wanted: Requirement) -> bool:
        """Tell whether the run ended with an error within the requirement."""
        return self.status is Status.OK and self.errors.get(wanted.kind, math.nan) <= wanted.limit


def trial_of(row: Mapping[str, Any]) -> Trial:
    """Return the trial that a row of the table `search_ladder` describes."""

    def read(column: str) -> float:
        """Return the number in a column; NaN if it is missing or not finite."""
        x = row.get(column)
        return float(x) if x is not None and math.isfinite(x) else math.nan

    status = Status(row["status"])
    errors = {kind: read(f"{kind}_error") for kind in UNITS} if status is Status.OK else {}
    size = read("tolerance") if math.isnan(read("step")) else read("step")
    steps = read("steps")
    return Trial(size, errors, int(steps) if math.isfinite(steps) else None, status, str(row.get("message") or ""))


class Kind(StrEnum):
    """The kinds of answer."""

    TIMED = "holds"
    UNTIMED = "holds, not timed"
    NOT_REACHED = "not reached"
    NO_MODEL = "cannot be modelled"
    UNDETERMINED = "not determined"  # redundant rows leave joint forces undetermined, whatever the engine
    NOT_TRIED = "not tried"


@dataclass(frozen=True)
class Reach:
    """The answer for one engine and requirement.

    Attributes:
        reason: why the engine is not timed, not tried or has no model; for NOT_REACHED, how its runs failed.
        steps: largest number of steps of a trial.
        seconds: time of the search [s] if a time limit ended it, else NaN.
        order: order of convergence of the variant that would meet the requirement with the fewest steps; NaN if there is none.
        needed: number of steps with which this variant would meet the requirement if its error kept falling at this order.
        within: words such as "within the budget" that are printed in place of `seconds`.
    """

    kind: Kind
    reason: str = ""
    steps: int = 0
    seconds: float = math.nan
    order: float = math.nan
    needed: float = math.nan
    within: str = ""

    @property
    def words(self) -> str:
        """The answer in words, such as "not reached within 60 s; order 4.0 extrapolates to 21,000 steps"."""
        answer, is_timed = str(self.kind), math.isfinite(self.seconds)
        if self.within:
            answer += f" {self.within}"
        elif is_timed:
            answer += f" within {self.seconds:.3g} s"
        elif self.steps and self.kind is Kind.NOT_REACHED:
            answer += f" in {self.steps:,} steps"
        if math.isfinite(self.needed):
            # two significant digits, without an exponent below 1e9
            needed = f"{float(f'{self.needed:.2g}'):,.0f}" if self.needed < 1e9 else f"{self.needed:.0e}"
            answer += f"; order {self.order:.1f} extrapolates to {needed}{' steps' if is_timed else ''}"
        return f"{answer}: {self.reason}" if self.reason else answer


def reach(ladders: Iterable[Sequence[Trial]], wanted: Sequence[Requirement], untimed: str | None = None) -> Reach:
    """Return the answer whether an engine meets all requirements in one run; if not, why not, and how many steps would meet them.

    Args:
        ladders: for each variant of the engine its trials, in any order.
        untimed: the reason why no timed comparison has a variant that meets the requirements; None if one has.
    """
    ladders = [ladder for ladder in ladders if ladder]
    trials = [trial for ladder in ladders for trial in ladder]
    ended = [trial for trial in trials if trial.status is Status.OK]
    # largest ratio of error to limit, at most 1 if all requirements are met; NaN if redundant rows leave joint forces undetermined
    shares = [share(trial, wanted) for trial in ended]
    if any(x <= 1 for x in shares):
        return Reach(Kind.TIMED) if untimed is None else Reach(Kind.UNTIMED, untimed)
    not_skipped = [trial for trial in trials if trial.status is not Status.SKIP]
    if not not_skipped:  # the engine skipped all trials
        reason = trials[0].message if trials else "it was not searched"
        return Reach(Kind.NOT_TRIED if not trials or ABSENT.search(reason) else Kind.NO_MODEL, reason)
    if ended and all(map(math.isnan, shares)):
        return Reach(Kind.UNDETERMINED, "redundant rows leave joint forces open")
    steps = max(trial.steps or 0 for trial in not_skipped)
    if not ended:
        return Reach(Kind.NOT_REACHED, f"no run ended: {not_skipped[-1].message}", steps)
    extrapolated = [convergence(ladder, wanted) for ladder in ladders]  # (order, needed) of each variant
    order, needed = min(extrapolated, key=lambda pair: math.inf if math.isnan(pair[1]) else pair[1])
    return Reach(Kind.NOT_REACHED, steps=steps, order=order, needed=needed)


def share(trial: Trial, wanted: Sequence[Requirement]) -> float:
    """Return the largest ratio of an error of a run to its limit; NaN if an error is not known."""
    return float(np.max([trial.errors.get(x.kind, math.nan) / x.limit for x in wanted]))  # the maximum with a NaN is NaN


def convergence(trials: Sequence[Trial], wanted: Sequence[Requirement]) -> tuple[float, float]:
    """Return the order of convergence in the finest trials, and the number of steps that would meet the requirements at this order.

    The order is that of the RUNGS trials with the most steps, whose numbers of steps differ by a factor of at least APART. Both
    are NaN if there are fewer, if one failed, or if the orders between neighbours are not positive or differ by STEADY or more.
    """
    rungs: list[tuple[int, Trial]] = []  # number of steps and trial, finest first, far enough apart
    counted = [(x.steps, x) for x in trials if x.steps]
    for steps, trial in sorted(counted, key=lambda rung: -rung[0]):
        if not rungs or steps * APART <= rungs[-1][0]:
            rungs.append((steps, trial))
    finest = [(steps, x) for steps, x in rungs[:RUNGS] if x.status is Status.OK]
    with np.errstate(all="ignore"):
        errors = np.log([share(x, wanted) for _, x in finest])  # of error / limit: 0 if the requirement is just met
        # finest first: errors rise and numbers of steps fall along the list, so that a positive order needs the minus sign
        orders = np.diff(errors) / -np.diff(np.log([steps for steps, _ in finest]))
    if len(finest) < RUNGS or not (np.isfinite(orders).all() and orders.min() > 0 and np.ptp(orders) < STEADY):
        return math.nan, math.nan
    order = float(orders[0])  # between the two finest
    return order, finest[0][0] * math.exp(min(errors[0] / order, 100.0))  # the limit on the exponent prevents an overflow
