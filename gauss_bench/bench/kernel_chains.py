"""Chains of pendulums: as many degrees of freedom as links, so that few unknowns become many.

N bars hang one on the other, so n = 3N coordinates meet m = 2N rows: n - m = N unknowns of Gauss's kind against n + m = 5N of
Lagrange's. Gauss's are coupled, each with each; Lagrange's only with their neighbours.
"""

import re
from typing import Any

from gauss_bench.mechanism.load import load, load_document
from gauss_bench.mechanism.model import Mechanism

MASS, LENGTH = 1.0, 1.0  # [kg], [m] of every bar
FIRST, FAN = -60.0, 7.0  # [deg] of the first bar, and of each against the one before: no two are in line
SCENARIO = "swing"


def name_of(links: int) -> str:
    return f"pendulums_{links}"


def mechanism_named(linkage: str, scenario: str) -> Mechanism:
    """A linkage by name or path, or a chain by the name that `name_of` gives it."""
    match = re.fullmatch(r"pendulums_(\d+)", linkage)
    return load_document(document(int(match[1])), scenario) if match else load(linkage, scenario or None)


def document(links: int) -> dict[str, Any]:
    """The linkage file of a chain, let go at rest."""
    bars = [f"bar{i}" for i in range(links)]
    bar = {"points": {"A": [0.0, 0.0], "B": [LENGTH, 0.0]}, "bars": [["A", "B"]], "mass": MASS}
    above = ["ground.O", *(f"{bar}.B" for bar in bars[:-1])]
    angles = {name: FIRST + FAN * i for i, name in enumerate(bars)}
    return {
        "format": "planar-linkage/1",
        "name": name_of(links),
        "title": f"{links} pendulums, one hanging on the other",
        "gravity": [0.0, -9.81],
        "ground": {"points": {"O": [0.0, 0.0]}},
        "links": dict.fromkeys(bars, bar),
        "joints": {f"P{i}": {"type": "revolute", "at": [point, f"bar{i}.A"]} for i, point in enumerate(above)},
        "assembly": {"angles_deg": angles},
        "observe": {"points": [f"{bars[-1]}.B"]},
        "scenarios": {SCENARIO: {"duration": 1.0, "start": {"angles_deg": angles, "speeds": dict.fromkeys(bars, 0.0)}}},
    }
