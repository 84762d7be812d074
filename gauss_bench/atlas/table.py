"""Write the results of the survey (the atlas) as rows of a table and as text."""

from collections.abc import Sequence
from typing import Any

from gauss_bench.atlas.chart import group_by_axis
from gauss_bench.atlas.families import FAMILIES
from gauss_bench.atlas.survey import Reach, describe
from gauss_bench.atlas.verdict import RULE, Verdict

HEAD = "axis,engine,"  # first columns of the table's file, which identify it


def row(x: Reach) -> dict[str, Any]:
    """Return the row of one engine and setting on one axis.

    `breaks_at` is the easiest value of the axis at which the engine does not pass. It is None if the engine passes at all values,
    or cannot model the linkage, or if a verdict is unknown.
    """
    axis = FAMILIES[x.axis]
    rest = axis.values[0 if x.passes_to is None else axis.values.index(x.passes_to) + 1 :]
    breaks = rest[0] if rest and x.last not in (Verdict.CANNOT, Verdict.OPEN) else None
    cells = {"axis": x.axis, "unit": axis.unit, **vars(x.setting)}
    cells |= {"easiest": axis.values[0], "hardest": axis.values[-1], "passes_to": x.passes_to, "ends_at": x.ends_at}
    return cells | {"breaks_at": breaks, "last": str(x.last), "error": x.error, "runs": x.runs, "reason": x.reason}


def rows_of(reaches: Sequence[Reach], commit: str) -> list[dict[str, Any]]:
    """Return the rows of the table `atlas`, with errors rounded to three digits."""
    return [row(x) | {"error": float(f"{x.error:.3g}"), "commit": commit} for x in reaches]


def text(reaches: Sequence[Reach]) -> str:
    """Return the results as text: for each axis its title and meaning, then a line for each engine with its setting."""
    lines = [RULE]
    for axis, entries in group_by_axis(reaches):
        lines += ["", f"{axis.title}: {axis.meaning}"]
        lines += [f"  {x.setting.name:28} {describe(x)}" for x in entries]
    return "\n".join(lines)
