"""Four-bars of uniform bars of any lengths."""

from typing import Any


def four_bar(crank: Any, coupler: Any, rocker: Any, frame: Any) -> dict[str, Any]:
    """The document of a four-bar A-B-C-D with its crank drawn, and held, at 60 degrees."""
    bars = {"a": ("A", "B", crank), "b": ("B", "C", coupler), "c": ("D", "C", rocker)}
    owners = {"A": ["ground.A", "a.A"], "B": ["a.B", "b.B"], "C": ["b.C", "c.C"], "D": ["ground.D", "c.D"]}
    return {
        "format": "planar-linkage/1",
        "name": "bars",
        "crank": "a",
        "ground": {"points": {"A": [0, 0], "D": [frame, 0]}},
        "links": {k: {"points": {p: [0, 0], r: [x, 0]}, "bars": [[p, r]], "mass": 1} for k, (p, r, x) in bars.items()},
        "joints": {name: {"type": "revolute", "at": at} for name, at in owners.items()},
        "assembly": {"sketch": {"B": [float(crank) / 2, 0.87 * float(crank)], "C": [float(frame) * 0.75, 0.2]}},
        "scenarios": {"rest": {"duration": 1.0, "start": {"crank_deg": 60}}},
    }
