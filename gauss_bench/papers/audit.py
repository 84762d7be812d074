"""The whole audit: every line of the three papers, measured."""

from typing import Any

from gauss_bench.papers import (
    example_lines,
    link_unit_lines,
    loop_lines,
    method_lines,
    omission_lines,
    point_lines,
    projector_lines,
)
from gauss_bench.papers.line import Line, row

CHAPTERS = (method_lines, projector_lines, example_lines, omission_lines, link_unit_lines, loop_lines, point_lines)


def lines() -> tuple[Line, ...]:
    """In the order of the papers and their equations."""
    return tuple(line for chapter in CHAPTERS for line in chapter.lines())


def audit() -> dict[str, Any]:
    """{"audit": rows}: see `line.row` for their columns."""
    return {"audit": [row(line) for line in lines()]}
