"""Repeat some samples of a sweep at half the step or a tighter tolerance.

The change of the samples' figures shows the error of the step. Open loops and errors of the energy do not show it: a motion may be
wrong although its loops stay closed and its energy is right.
"""

from dataclasses import replace
from typing import Any

import numpy as np

from gauss_bench.judge import OFF_MOTION
from gauss_bench.runs.offers import offer
from gauss_bench.runs.scrutiny import finer_tolerance
from gauss_bench.sweep.batch import SweepCase, family, rows_of
from gauss_bench.sweep.figures import units
from gauss_bench.sweep.summary import USED, Halved
from gauss_bench.terms import Array
from gauss_bench.trajectory import spread_evenly

MOST, SHARE = 16, 10  # one sample in SHARE of an engine is repeated, and at most MOST
HALF = "half the step"


def halve(case: SweepCase, engine: str, rows: Any, values: Array) -> Halved | None:
    """Repeat some samples of the status ok, and return how much their figures change; None if no sample is ok.

    The limits for a change are those of the judge (`judge.py`) for a run that is repeated with a finer step.

    Args:
        rows: this engine's rows of the sweep's table, as a pandas DataFrame.
        values: (N, d) varied numbers of all N samples.
    """
    choice, mechanism = case.choice(engine), family(case).nominal
    good = rows[rows["status"].isin(USED)].sort_values("sample")
    if not len(good):
        return None
    parts, how = 2, HALF  # parts: number of steps into which each step is divided; it is 1 if the tolerance is tightened instead
    offered = offer(engine)
    if choice.integrator in offered.adaptive:
        tighter = replace(choice, tolerance=finer_tolerance(offered, choice))
        case, parts, how = replace(case, choices=((engine, tighter),)), 1, "a tighter tolerance"
    chosen = spread_evenly(len(good), min(MOST, -(-len(good) // SHARE)))  # -(-a // b) rounds a / b up
    limits = {"m": OFF_MOTION / 2 * mechanism.size, "rad": OFF_MOTION / 2}
    numbers = good["sample"].to_numpy()[chosen]
    finer = rows_of(case, engine, numbers, values[numbers], parts)
    usable = np.isin(finer["status"], USED)
    lost, changes = int((~usable).sum()), {}  # changes: unit -> largest change
    ratios = np.zeros(len(chosen))  # largest ratio of a figure's change to its limit, for each sample
    for unit, limit in limits.items():
        names = [name for name, x in units(mechanism).items() if x == unit]
        # (chosen,) largest change of a figure with this unit
        gaps = np.abs([finer[name] - good[name].to_numpy()[chosen] for name in names] or [np.zeros(len(chosen))]).max(axis=0)
        changes[unit] = float(gaps[usable].max(initial=0.0))
        ratios = np.maximum(ratios, gaps / limit)
    largest = float(ratios[usable].max(initial=0.0))
    return {
        "how": how,
        "samples": len(chosen),
        "m": changes["m"],
        "rad": changes["rad"],
        "worst": int(numbers[usable][ratios[usable].argmax()]) if largest else None,
        "lost": lost,
        "ok": not lost and largest <= 1.0,
    }


def text(check: Halved | None) -> str:
    """Return the result of `halve` in a sentence for the user."""
    if check is None:
        return "no sample was repeated, because none is ok"
    changes = f"{check['samples']} samples with {check['how']} change by at most {check['m']:.2g} m and {check['rad']:.2g} rad"
    if check["ok"]:
        return changes
    lost = f", and {check['lost']} of them fail" if check["lost"] else ""
    where = "" if check["worst"] is None else f" (sample {check['worst']})"
    remedy = "take a smaller --step" if check["how"] == HALF else "take settings of a tighter tolerance"
    return f"NOT TO BE TRUSTED: {changes}{where}{lost}; {remedy}"
