"""The verdict on a run of the atlas, the survey of linkages from easy to hard.

The verdicts are:

    pass:      the run reaches its end, the suite's judge has no objection, and the error of every link stays below PASSES times the
               linkage's size [m] and below PASSES [rad] over the whole run
    degraded:  the run reaches its end and the judge has no objection, but an error is larger
    failed:    the judge objects, or the run does not reach its end: its numbers are not finite, its solver refuses the linkage, it
               takes too long, or it crashes
    open:      the verdict is unknown, because the error bar of the reference is above a tenth of PASSES, or because the time budget
               ended before the run
    cannot:    the engine cannot model this linkage

The limits of the judge are in `judge.py`: gaps of 1 % of the size, energy errors of 1 % of the energy scale, accelerations wrong by
1 %, and links off by 5 %.
"""

from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from gauss_bench.judge import examine, judge
from gauss_bench.mechanism.evaluate import Evaluator
from gauss_bench.mechanism.model import Mechanism
from gauss_bench.runs.one_run import Run, acceleration_error
from gauss_bench.trajectory import Reference, Status

PASSES = 1e-3  # relative to the linkage's size, and [rad]: a tenth of a millimetre on ten centimetres
KNOWN = 0.1  # largest error bar of a reference, relative to PASSES
RULE = (
    f"pass: off by at most {PASSES:g} of the size or {PASSES:g} rad over the whole run; "
    "degraded: off by more, but the judge objects to nothing (loops, energy and accelerations within 1 %, no link off by 5 %); "
    "failed: the judge objects, or the run does not end"
)


class Verdict(StrEnum):
    """The outcome of a run; OPEN means that the outcome is unknown, and CANNOT that the engine has no model of the linkage."""

    PASS = "pass"
    DEGRADED = "degraded"
    FAILED = "failed"
    OPEN = "open"
    CANNOT = "cannot"


@dataclass(frozen=True)
class RunVerdict:
    """The verdict on one run.

    Attributes:
        error: largest error of a position, relative to the linkage's size, or of an angle [rad], over the whole run; NaN if no
            error was computed.
        reason: why the verdict is not "pass"; empty if it is.
    """

    verdict: Verdict
    error: float = float("nan")
    reason: str = ""


def decide(mechanism: Mechanism, run: Run, reference: Reference) -> RunVerdict:
    """Return the verdict on a run, from its differences to a reference and from the objections of the judge."""
    if run.status is Status.SKIP:
        return RunVerdict(Verdict.CANNOT, reason=run.message)
    if run.trajectory is None:
        return RunVerdict(Verdict.FAILED, reason=f"{run.status}: {run.message}")
    size = mechanism.size
    error_bar = float(np.max(reference.error_q, initial=0.0))
    # positions have the limit KNOWN PASSES size [m], angles KNOWN PASSES [rad]; the smaller of the two is used for both
    if not error_bar <= KNOWN * PASSES * min(1.0, size):
        return RunVerdict(Verdict.OPEN, reason=f"the error bar of the reference is {error_bar:.1e}")
    with np.errstate(all="ignore"):
        evidence = examine(Evaluator(mechanism), run.trajectory, reference, acceleration_error(mechanism, run.trajectory))
    errors = evidence.errors
    assert errors is not None
    error = max(float(errors.length.max(initial=0.0)) / size, float(errors.angle.max(initial=0.0)))
    verdict = judge(evidence)
    if not verdict.valid:
        return RunVerdict(Verdict.FAILED, error, verdict.sentence)
    if error > PASSES:
        return RunVerdict(Verdict.DEGRADED, error, f"off by {error:.1e} (of the linkage's size, or rad)")
    return RunVerdict(Verdict.PASS, error)
