"""What the report says of the papers and of published values, as tasks: each returns tables by name."""

from pathlib import Path
from typing import Any

from gauss_bench.mechanism.load import load
from gauss_bench.papers.audit import audit
from gauss_bench.papers.published import SQUEEZER, published
from gauss_bench.papers.reproduction import SPAN, paper_motion, reproduction
from gauss_bench.reference.store import certified_reference, stored_reference


def example_motion(store: str) -> dict[str, Any]:
    """The motion of the first paper's example: {"paper_motion": rows}."""
    mechanism = load("crank_slider", "paper")
    return paper_motion(mechanism, stored_reference(mechanism, SPAN, Path(store)))


def published_values() -> dict[str, Any]:
    """Published values against certified ones: {"published": rows}; none without the certificate."""
    name, scenario, t = SQUEEZER
    mechanism = load(name, scenario)
    reference = certified_reference(mechanism, t)
    return {"published": published(mechanism, reference) if reference else []}


PAPER_TASKS = {"audit": audit, "reproduction": reproduction, "published": published_values}
