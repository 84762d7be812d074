"""How exact each method is at each step: errors of the crank angle at one second, against the certified motion, step after step.

A ladder of steps starts at FIRST and is halved until the method has reached the finest target, or cannot: a run would take longer
than the cap, its error has stopped falling, or the run fails. The error is that at one time, so that it may be small by chance on
one rung; the largest step within a target is taken all the same, for all methods alike.
"""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from gauss_bench.bench.clock import timed
from gauss_bench.bench.kernel_timing import Row
from gauss_bench.engines import get
from gauss_bench.engines.base import Choice, Model
from gauss_bench.engines.extras import not_installed
from gauss_bench.mechanism.load import load
from gauss_bench.mechanism.model import Mechanism
from gauss_bench.reference.store import stored_reference
from gauss_bench.trajectory import Reference, RunFailure, Status

TARGETS = (1e-6, 1e-9)  # [rad] what a drawing and what a reference would ask for
AT = 1.0  # [s]
FIRST = 1e-2  # [s]
RUNGS = 20
SHORT = 0.1  # [s] a run that is over sooner is repeated: the first may have waited for its code to be compiled
STALLED = 3  # halvings without ...
FALLS = 0.7  # ... the least error falling below so much of itself: even a method of first order halves it
COARSE = ("nan", "diverged", "not_converged", "warning", "error")  # a failure that a smaller step may mend


@dataclass(frozen=True, order=True)
class Method:
    """Everything that is chosen but the step."""

    engine: str
    settings: str
    integrator: str
    stabilization: str

    def choice(self, step: float) -> Choice:
        return Choice(self.settings, self.integrator, self.stabilization, step)

    def key(self) -> str:
        return "|".join(asdict(self).values())


METHODS = (
    Method("gauss-native", "default", "rk4", "none"),
    Method("gauss-native", "default", "rk4", "projection"),
    Method("mujoco", "tuned", "rk4", "none"),
    Method("mujoco", "rigid", "rk4", "none"),
    *(Method("pinocchio", settings, "rk4", "none") for settings in ("default", "one_iteration")),
    *(Method("exudyn", s, i, "none") for s in ("default", "tuned") for i in ("generalized_alpha", "trapezoidal_index2")),
)


def ladder(linkage: str, scenario: str, method: Method, store: str, cap: float) -> dict[str, Any]:
    """Errors at every step tried, and why no smaller one was: {"kernel_ladder": [...], "ended": text}."""
    mechanism = load(linkage, scenario or None)
    start: Row = {"mechanism": mechanism.name, "scenario": mechanism.scenario, **asdict(method)}
    reason = get(method.engine).skip(mechanism, method.choice(FIRST))
    if reason:
        return {"kernel_ladder": [start | {"status": str(Status.SKIP), "message": reason}], "ended": reason}
    reference = stored_reference(mechanism, AT, Path(store))
    rows: list[Row] = []
    ended = f"{RUNGS} steps were tried"
    for rung in range(RUNGS):
        rows.append(start | measured(mechanism, reference, method, FIRST / 2**rung))
        if reason := why_ended(rows, cap):
            ended = reason
            break
    return {"kernel_ladder": rows, "ended": ended}


def measured(mechanism: Mechanism, reference: Reference, method: Method, step: float) -> Row:
    """One rung: error [rad] and seconds."""
    seconds = np.nan
    try:
        model = get(method.engine).build(mechanism, method.choice(step))
        seconds = timed_run(model, AT)
        if seconds < SHORT:
            seconds = timed_run(model, AT)
        trajectory = model.read()
    except RunFailure as failure:
        return {"step": step, "seconds": seconds, "status": str(failure.status), "message": str(failure)}
    except ImportError as error:
        return {"step": step, "status": str(Status.SKIP), "message": not_installed(error)}
    crank = 3 * (mechanism.crank or 0) + 2
    off = abs(float(trajectory.q[-1, crank] - reference.q[-1, crank]))
    bar = float(np.fmax(reference.error_q, reference.floor_q)[-1])
    return {"step": step, "seconds": seconds, "error": off, "error_bar": bar, "status": str(Status.OK), "message": ""}


def timed_run(model: Model, until: float) -> float:
    model.prepare(np.array([0.0, until]))
    return timed(model.run)


def why_ended(rows: Sequence[Row], cap: float) -> str:
    """Why a ladder ends with its last row, or an empty text."""
    last = rows[-1]
    if last["status"] != Status.OK and last["status"] not in COARSE:
        return str(last["message"])
    errors = [float(row["error"]) if row["status"] == Status.OK else np.inf for row in rows]
    if errors[-1] <= min(TARGETS):
        return "the finest target is reached"
    if last.get("seconds", 0.0) > cap / 2:
        return f"half the step would take longer than {cap:g} s"
    before, after = min(errors[:-STALLED], default=np.inf), min(errors[-STALLED:])
    if np.isfinite(before) and after > FALLS * before:
        return f"the error has not fallen in {STALLED} halvings"
    return ""


def largest_step(rows: Sequence[Row], target: float) -> Row | None:
    """The row with the largest step whose error is within the target; None where there is none."""
    reached = [row for row in rows if row["status"] == Status.OK and row["error"] <= target]
    return max(reached, key=lambda row: float(row["step"]), default=None)


def smallest_error(rows: Sequence[Row]) -> Row | None:
    """The row with the smallest error; None where no run ended."""
    return min((row for row in rows if row["status"] == Status.OK), key=lambda row: float(row["error"]), default=None)
