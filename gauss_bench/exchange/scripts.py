"""Exported programs: jinja templates of plain programs, filled with the numbers of a linkage."""

import math
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined

from gauss_bench.engines.base import Choice
from gauss_bench.exchange.text import c_comment, c_string, heading, python_comment
from gauss_bench.exchange.transcript import python
from gauss_bench.mechanism.model import Mechanism

SAMPLES = 100  # largest number of rows that a program prints after the first
PROGRAMS = Environment(
    loader=PackageLoader("gauss_bench.exchange"),
    undefined=StrictUndefined,
    trim_blocks=True,
    lstrip_blocks=True,
    keep_trailing_newline=True,
)
PROGRAMS.filters |= {"python": python, "comment": python_comment, "c_comment": c_comment, "c_string": c_string}


def coordinates(mechanism: Mechanism, kinds: tuple[str, str, str] = ("x", "y", "theta")) -> list[str]:
    """Return the names of q in order, LINK.x, LINK.y, LINK.theta, as headings of columns."""
    return [f"{heading(link.name)}.{x}" for link in mechanism.links for x in kinds]


def plan_steps(end: float, step: float) -> tuple[int, int]:
    """Return the numbers of steps that a program takes until `end` and between two rows, as its own `plan` does."""
    count = max(1, math.ceil(end / step - 1e-9))
    every = math.ceil(count / SAMPLES)
    return every * math.ceil(count / every), every


def write_program(template: str, mechanism: Mechanism, choice: Choice, head: list[str], **given: Any) -> str:
    """Fill a template of templates/ with the linkage, the choice, the sentences `head`, and the template's own variables."""
    names, rates = coordinates(mechanism), coordinates(mechanism, ("vx", "vy", "omega"))
    common = {"mechanism": mechanism, "choice": choice, "head": head, "names": names, "rates": rates, "samples": SAMPLES}
    return PROGRAMS.get_template(template).render(**common, **given)
