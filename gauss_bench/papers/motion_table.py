"""The paper's figures 2 to 9 as a table: positions and speeds of crank and slider against time, from a reference."""

from typing import Any

import numpy as np
from scipy.interpolate import BPoly

from gauss_bench.mechanism.model import Mechanism
from gauss_bench.papers.crank_slider import KEPT
from gauss_bench.terms import Array
from gauss_bench.trajectory import Reference

ROWS = 601
SPAN = 4.0  # [s] drawn at most: on a longer axis the turns would run together
COLUMNS = {"x1": 0, "y1": 1, "theta1": 2, "x3": 6}  # of the paper's seven coordinates


def paper_motion(mechanism: Mechanism, reference: Reference) -> dict[str, Any]:
    """{"paper_motion": rows} with t, x1, x1_rate, y1, y1_rate, theta1, theta1_rate, x3, x3_rate [s, m, rad].

    Between samples the motion is the polynomial that has their positions, velocities and accelerations at both ends.

    Raises:
        ValueError: the mechanism is not the crank-slider, or the reference not of this mechanism.
    """
    if mechanism.name != "crank_slider" or reference.q.shape[1] != mechanism.n:
        raise ValueError(f"{mechanism.name}: not the crank-slider with its reference")
    t = np.linspace(0.0, min(SPAN, float(reference.t[-1])), ROWS)
    kept = np.array(KEPT)[list(COLUMNS.values())]
    levels = np.stack([reference.q[:, kept], reference.v[:, kept], reference.a[:, kept]], axis=1)
    curve = BPoly.from_derivatives(reference.t, levels)
    return {"paper_motion": [drawn(*x) for x in zip(t, curve(t), curve.derivative()(t), strict=True)]}


def drawn(t: float, place: Array, rate: Array) -> dict[str, float]:
    """One row."""
    row = {"t": float(t)}
    for name, x, x_rate in zip(COLUMNS, place, rate, strict=True):
        row |= {name: float(x), f"{name}_rate": float(x_rate)}
    return row
