"""Compare statements of the papers, and published values, with computed values."""

from collections.abc import Callable
from pathlib import Path

from gauss_bench.bench.tasks import Context, Tables, Task
from gauss_bench.linkage.load import load
from gauss_bench.papers.audit import audit
from gauss_bench.papers.published import SQUEEZER, list_published_values
from gauss_bench.papers.reproduction import SPAN, paper_motion, reproduction
from gauss_bench.reference.certificate import find_certified
from gauss_bench.reference.store import load_stored
from gauss_bench.suites.schema import Suite


def exact_tasks(suite: Suite, context: Context) -> list[Task]:
    """Return one task for each table that the suite's section `papers` lists."""
    makers: dict[str, Callable[..., Tables]] = {"audit": audit, "reproduction": reproduction, "published": list_published}
    tasks = {name: context.task(name, make, ()) for name, make in makers.items()}
    tasks["paper_motion"] = context.task("paper_motion", example_motion, (context.store,))
    return [tasks[name] for part in suite.papers for name in part.tables]


def example_motion(store: str) -> Tables:
    """Return the table rows of the example motion of Yuan and Ge (2016), whose reference is stored in the folder `store`."""
    mechanism = load("crank_slider", "paper")
    return paper_motion(mechanism, load_stored(mechanism, SPAN, Path(store)))


def list_published() -> Tables:
    """Return one row for each published value, compared with that of the certified motion; none if the certificate is missing."""
    name, scenario, t = SQUEEZER
    mechanism = load(name, scenario)
    reference = find_certified(mechanism, t)
    return {"published": list_published_values(mechanism, reference) if reference else []}
