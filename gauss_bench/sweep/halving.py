"""Repeats some samples of a sweep at half the step or a tighter tolerance; loops and energy do not show the step's error."""

from dataclasses import replace
from typing import Any

import numpy as np

from gauss_bench.judge import OFF_MOTION
from gauss_bench.runs.offers import offer
from gauss_bench.runs.scrutiny import finer_tolerance
from gauss_bench.sweep.batch import Asked, columns_of, family, rows_of
from gauss_bench.sweep.summary import USED
from gauss_bench.terms import Array

MOST, SHARE = 16, 10  # samples of an engine that are checked: one in ten, and never more than so many
UNITS = ("m", "rad")
HALF = "half the step"


def halve(asked: Asked, engine: str, rows: Any, values: Array) -> dict[str, Any] | None:
    """Repeat some samples that are ok and return the changes of their places and extremes, or None where none is ok.

    Args:
        rows: of the engine, as pandas has them. values: (N, d) of all samples.

    Returns:
        how: "half the step", or "a tighter tolerance" where the integrator chooses its steps. samples: that were checked, evenly
        over the table. m, rad: the largest change of a figure of that unit. worst: the sample
        that has it. lost: how many are not ok when repeated. ok: whether the judge's limits of a repetition hold.
    """
    choice, mechanism = asked.choice(engine), family(asked).nominal
    good = rows[rows["status"].isin(USED)].sort_values("sample")
    if not len(good):
        return None
    parts, how = 2, HALF
    if choice.integrator in (offered := offer(engine)).adaptive:
        tighter = replace(choice, tolerance=finer_tolerance(offered, choice))
        asked, parts, how = replace(asked, choices=((engine, tighter),)), 1, "a tighter tolerance"
    chosen = np.unique(np.linspace(0, len(good) - 1, min(MOST, -(-len(good) // SHARE))).round().astype(int))
    units = columns_of(mechanism, [])
    of = {unit: [name for name, x in units.items() if x == unit] for unit in UNITS}
    limits = {"m": OFF_MOTION / 2 * mechanism.size, "rad": OFF_MOTION / 2}
    check: dict[str, Any] = {"how": how, "samples": len(chosen), "m": 0.0, "rad": 0.0, "worst": None, "lost": 0}
    numbers = good["sample"].to_numpy()[chosen]
    finer = rows_of(asked, engine, numbers, values[numbers], parts)
    usable = np.isin(finer["status"], USED)
    check["lost"] = int((~usable).sum())
    off = np.zeros(len(chosen))
    for unit, names in of.items():
        gaps = np.abs([finer[name] - good[name].to_numpy()[chosen] for name in names] or [off]).max(axis=0)
        check[unit] = float(gaps[usable].max(initial=0.0))
        off = np.maximum(off, gaps / limits[unit])
    largest = float(off[usable].max(initial=0.0))
    if largest:
        check["worst"] = int(numbers[usable][off[usable].argmax()])
    return check | {"ok": not check["lost"] and largest <= 1.0}


def text(check: dict[str, Any] | None) -> str:
    """Return the result as text for users."""
    if check is None:
        return "nothing was repeated: no sample is ok"
    told = f"{check['how']} of {check['samples']} samples changes {check['m']:.2g} m and {check['rad']:.2g} rad at most"
    if check["ok"]:
        return told
    lost = f", and {check['lost']} of them are lost" if check["lost"] else ""
    where = "" if check["worst"] is None else f" (sample {check['worst']})"
    mend = "take a smaller --step" if check["how"] == HALF else "take settings of a tighter tolerance"
    return f"NOT TO BE TRUSTED: {told}{where}{lost}: {mend}"
