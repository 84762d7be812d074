"""Decide on a run of the atlas.

pass       the run ends, the suite's judge has no objection, and the error of every link stays below PASSES times the linkage's
           size [m] and PASSES [rad] over the whole run
degraded   the run ends and the judge has no objection, but an error is larger. The limits of the judge are in `judge.py`: gaps of
           1 % of the size, energy errors of 1 % of the energy scale, accelerations wrong by 1 %, links off by 5 %
failed     the judge objects, or the run does not end: it is not finite, its solver refuses it, it takes too long, or it crashes
open       the error bar of the reference is above a tenth of PASSES, or the budget ended before the run
cannot     the engine has no model of this linkage
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
    """The outcome of a run, from good to bad; OPEN if it is unknown, CANNOT if the engine has no model of the linkage."""

    PASS = "pass"
    DEGRADED = "degraded"
    FAILED = "failed"
    OPEN = "open"
    CANNOT = "cannot"


@dataclass(frozen=True)
class RunVerdict:
    """The verdict on one run.

    Attributes:
        verdict: the verdict.
        error: largest error over the run, relative to the linkage's size, or [rad]; NaN without a run.
        reason: why the run does not pass, or an empty text.
    """

    verdict: Verdict
    error: float = float("nan")
    reason: str = ""


def decide(mechanism: Mechanism, run: Run, reference: Reference) -> RunVerdict:
    """Return the verdict on a run, from its comparison with a reference."""
    if run.status is Status.SKIP:
        return RunVerdict(Verdict.CANNOT, reason=run.message)
    if run.trajectory is None:
        return RunVerdict(Verdict.FAILED, reason=f"{run.status}: {run.message}")
    size = mechanism.size
    bar = float(np.max(reference.error_q, initial=0.0))
    if not bar <= KNOWN * PASSES * min(1.0, size):
        return RunVerdict(Verdict.OPEN, reason=f"the error bar of the reference is {bar:.1e}")
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
