"""A cylinder placed by its two pins, written out as the links and joints it stands for.

Between the points P and Q a cylinder C is a link C_barrel pinned at P, a link C_rod pinned at Q, and the slide C between them,
along the line of both pins: its coordinate is the length of the cylinder. The x axes of barrel and rod run from P to Q.
What reads a linkage file from here on meets links and joints alone.
"""

from typing import Any

BARREL, ROD = "barrel", "rod"
PIN, END = "pin", "end"  # points of either link


def write_out(document: dict[str, Any]) -> dict[str, Any]:
    """The document with links and joints instead of cylinders; itself where it has none."""
    cylinders = document.get("cylinders")
    if not cylinders:
        return document
    links, joints = dict(document["links"]), dict(document.get("joints", {}))
    for name, cylinder in cylinders.items():
        ends = dict(zip((BARREL, ROD), cylinder["between"], strict=True))
        for part, at in ends.items():
            links[f"{name}_{part}"] = _link(cylinder[part], 1 if part == BARREL else -1)
            joints[f"{name}_{part}"] = {"type": "revolute", "at": [at, f"{name}_{part}.{PIN}"]}
        joints[name] = {"type": "prismatic", "guide": f"{name}_{BARREL}.{PIN}", "block": f"{name}_{ROD}.{PIN}"}
    return {key: x for key, x in document.items() if key != "cylinders"} | {"links": links, "joints": joints}


def _link(part: dict[str, Any], sense: int) -> dict[str, Any]:
    """A uniform bar from the pin along the cylinder, +1 towards the other pin's side along x, -1 against it."""
    link: dict[str, Any] = {key: part[key] for key in ("mass", "kg_per_m", "inertia") if key in part}
    if "com" in part:
        link["com"] = [sense * part["com"], 0]
    return link | {"points": {PIN: [0, 0], END: [sense * part["length"], 0]}, "bars": [[PIN, END]]}
