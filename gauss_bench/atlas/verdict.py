"""The meanings of pass, degraded and failed, in one place.

    pass       the run ends, the suite's judge has no objection, and no link is ever off by more than PASSES of the linkage's size
               [m] or PASSES [rad], over the whole run
    degraded   the run ends and the judge has no objection, but a link is off by more; the judge's own limits are in `judge.py`:
               loops open by 1 % of the size, energy off by 1 % of what moves, accelerations off by 1 %, a link off by 5 %
    failed     the judge objects, or the run does not end: not finite, refused by its solver, out of time, crashed

A reference counts where its bar is a tenth of PASSES or less; else the place is open, and so is what the budget does not reach.
"""

from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from gauss_bench.judge import examine, judge
from gauss_bench.mechanism.evaluate import Evaluator
from gauss_bench.mechanism.model import Mechanism
from gauss_bench.runs.one_run import Run, acceleration_error
from gauss_bench.trajectory import Reference, Status

PASSES = 1e-3  # of the linkage's size, and [rad]: a tenth of a millimetre on ten centimetres
KNOWN = 0.1  # of PASSES: bar of a reference that can tell
RULE = (
    f"pass: off by at most {PASSES:g} of the size or {PASSES:g} rad over the whole run; "
    "degraded: off by more, but the judge objects to nothing (loops, energy and accelerations within 1 %, no link off by 5 %); "
    "failed: the judge objects, or the run does not end"
)


class Verdict(StrEnum):
    """The outcome of a run, from good to bad; OPEN where it is not known, CANNOT where the engine has no such model."""

    PASS = "pass"
    DEGRADED = "degraded"
    FAILED = "failed"
    OPEN = "open"
    CANNOT = "cannot"


@dataclass(frozen=True)
class RunVerdict:
    """The verdict on one run.

    Attributes:
        error: largest error over the run, of the size or [rad]; NaN where there is none.
        reason: why it is no pass, or an empty text.
    """

    verdict: Verdict
    error: float = float("nan")
    reason: str = ""


def decide(mechanism: Mechanism, run: Run, reference: Reference) -> RunVerdict:
    """The verdict on a run against a reference."""
    if run.status is Status.SKIP:
        return RunVerdict(Verdict.CANNOT, reason=run.message)
    if run.trajectory is None:
        return RunVerdict(Verdict.FAILED, reason=f"{run.status}: {run.message}")
    size = mechanism.size
    bar = float(np.max(reference.error_q, initial=0.0))
    if not bar <= KNOWN * PASSES * min(1.0, size):
        return RunVerdict(Verdict.OPEN, reason=f"the reference is known to {bar:.1e} alone")
    with np.errstate(all="ignore"):
        evidence = examine(Evaluator(mechanism), run.trajectory, reference, acceleration_error(mechanism, run.trajectory))
    errors = evidence.errors
    assert errors is not None
    error = max(float(errors.length.max(initial=0.0)) / size, float(errors.angle.max(initial=0.0)))
    verdict = judge(evidence)
    if not verdict.valid:
        return RunVerdict(Verdict.FAILED, error, verdict.sentence)
    if error > PASSES:
        return RunVerdict(Verdict.DEGRADED, error, f"off by {error:.1e} of the size or rad")
    return RunVerdict(Verdict.PASS, error)
