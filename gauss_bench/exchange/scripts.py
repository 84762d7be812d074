"""Fill the jinja templates of exported programs with the numbers of a linkage."""

from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined

from gauss_bench.engines.base import Choice
from gauss_bench.engines.programs import MAIN, PLAN, SAMPLES, TITLE, coordinates, rates, write_laws
from gauss_bench.engines.transcript import python
from gauss_bench.exchange.text import c_comment, c_string, python_comment
from gauss_bench.mechanism.model import Mechanism

PROGRAMS = Environment(
    loader=PackageLoader("gauss_bench.exchange"),
    undefined=StrictUndefined,
    trim_blocks=True,
    lstrip_blocks=True,
    keep_trailing_newline=True,
)
PROGRAMS.filters |= {"python": python, "comment": python_comment, "c_comment": c_comment, "c_string": c_string}


def write_program(template: str, mechanism: Mechanism, choice: Choice, head: list[str], **variables: Any) -> str:
    """Return the text of a program, from a file in templates/; `variables` are those that the other templates do not share."""
    common = {"mechanism": mechanism, "choice": choice, "head": head, "samples": SAMPLES, "laws": write_laws(mechanism)}
    common |= {"names": coordinates(mechanism), "rates": rates(mechanism), "title": TITLE, "plan": PLAN, "main": MAIN}
    return PROGRAMS.get_template(template).render(**common, **variables)
