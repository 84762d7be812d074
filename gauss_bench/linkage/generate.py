"""Generate linkages of any size: the N-four-bar, and chains of N pendulums.

n_four_bar_N, from the IFToMM benchmark library (A02), has N + 1 vertical bars of length l on ground pivots (i l, 0), and N equal
horizontal bars between their tops. It moves like a pendulum, and is singular if all bars lie on the ground line.

pendulums_N is a chain of N bars with n = 3N coordinates and m = 2N constraint rows: Gauss's principle gives N unknowns with a full
matrix, Lagrange's equations 5N unknowns, each coupled only with those of neighbouring bars.
"""

from typing import Any

MASS, LENGTH = 1.0, 1.0  # [kg], [m] of every bar
SPEED = 1.0  # [m/s] of the top of the first vertical bar at the start, to the right
FIRST, FAN = -60.0, 7.0  # [deg] angle of the first pendulum, and increase from each to the next: no two neighbours are in line


def n_four_bar(count: int) -> dict[str, Any]:
    """Return the document of an N-four-bar with `count` windows, upright at the start."""
    verticals = {f"v{i}": _bar("A", "B") for i in range(count + 1)}
    horizontals = {f"h{i}": _bar("B", "C") for i in range(count)}
    joints: dict[str, Any] = {f"A{i}": {"type": "revolute", "at": [f"ground.A{i}", f"v{i}.A"]} for i in range(count + 1)}
    joints |= {f"B{i}": {"type": "revolute", "at": [f"v{i}.B"]} for i in range(count + 1)}
    for i in range(count):  # each horizontal joins the tops of two neighbouring verticals
        joints[f"B{i}"]["at"].append(f"h{i}.B")
        joints[f"B{i + 1}"]["at"].append(f"h{i}.C")
    upright = {f"v{i}": 90.0 for i in range(count + 1)} | {f"h{i}": 0.0 for i in range(count)}
    return {
        "format": "planar-linkage/1",
        "name": f"n_four_bar_{count}",
        "title": f"N-four-bar of {count} windows (IFToMM benchmark A02)",
        "crank": "v0",
        "gravity": [0.0, -9.81],
        "expect": {"dof": 1, "redundant": 0, "loops": count},
        "ground": {"points": {f"A{i}": [i * LENGTH, 0.0] for i in range(count + 1)}},
        "links": verticals | horizontals,
        "joints": joints,
        "assembly": {"angles_deg": upright},
        "observe": {"points": ["v0.B"]},
        "scenarios": {
            "fall": {"duration": 10.0, "start": {"crank_deg": 90.0, "speed": -SPEED / LENGTH}},
            "driven": {"duration": 1.0, "driver": {"link": "v0", "law": "constant", "start_deg": 90.0, "speed": -1.0}},
        },
    }


def pendulums(count: int) -> dict[str, Any]:
    """Return the document of a chain of `count` pendulums, each a bar pinned to the end of the one before, released at rest."""
    bars = [f"bar{i}" for i in range(count)]
    above = ["ground.O", *(f"{bar}.B" for bar in bars[:-1])]
    angles = {name: FIRST + FAN * i for i, name in enumerate(bars)}
    return {
        "format": "planar-linkage/1",
        "name": f"pendulums_{count}",
        "title": f"a chain of {count} pendulums",
        "gravity": [0.0, -9.81],
        "ground": {"points": {"O": [0.0, 0.0]}},
        "links": {name: _bar("A", "B") for name in bars},
        "joints": {f"P{i}": {"type": "revolute", "at": [point, f"bar{i}.A"]} for i, point in enumerate(above)},
        "assembly": {"angles_deg": angles},
        "observe": {"points": [f"{bars[-1]}.B"]},
        "scenarios": {"swing": {"duration": 1.0, "start": {"angles_deg": angles, "speeds": dict.fromkeys(bars, 0.0)}}},
    }


def _bar(a: str, b: str) -> dict[str, Any]:
    """Return the table of a link that is a uniform bar with end points called a and b."""
    return {"points": {a: [0.0, 0.0], b: [LENGTH, 0.0]}, "bars": [[a, b]], "mass": MASS}
