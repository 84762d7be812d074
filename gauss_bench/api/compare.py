"""Run several engines on one linkage, and return their errors as a table."""

import tempfile
from collections.abc import Sequence
from pathlib import Path

import pandas as pd

from gauss_bench.bench.cases import cross
from gauss_bench.bench.runner import measure_all
from gauss_bench.bench.tasks import CASE_LIMIT
from gauss_bench.engines import names
from gauss_bench.linkage.load import load
from gauss_bench.runs.offers import ChoiceError, check_budget, duration, offers, usable_steps
from gauss_bench.tables import TABLES


def compare(
    linkage: str,
    engines: Sequence[str] | None = None,
    scenario: str | None = None,
    steps: Sequence[float] = (1e-3,),
    t_end: float | None = None,
    jobs: int = 2,
    budget: float | None = None,
    settings: str | None = None,
) -> pd.DataFrame:
    """Return a table of the accuracy and drift of engines on a linkage: one row per engine, setting and step.

    Args:
        linkage: name of a built-in linkage, or a path.
        engines: names of engines; by default all.
        scenario: name of a scenario; by default the first with a start.
        steps: integration steps [s]. If a step does not divide `t_end`, the last step is shorter and the row's note says so. Errors
            are evaluated at those times of the reference that are multiples of the step; the column `compared` counts them.
        t_end: end of the runs [s]; by default the scenario's duration.
        jobs: number of worker processes.
        budget: longest time of one row [s].
        settings: settings of all engines, as a name, as KEY=VALUE,... or as both; by default each engine's standard settings.

    Raises:
        LinkageError: the file has faults.
        ChoiceError: the number of jobs, a step or a time cannot be used, or an engine does not know the settings.
        KeyError: an engine is unknown.
        TypeError: `engines` is a single text.
    """
    if jobs < 1:
        raise ChoiceError(f"jobs must be at least 1, not {jobs}")
    mechanism = load(linkage, scenario)
    end = duration(mechanism.duration, until=t_end)
    chosen = [x.name for x in offers(engines or names())]
    cases = list(cross({linkage: mechanism.scenario}, chosen, usable_steps(steps, end), end, asked=settings))
    with tempfile.TemporaryDirectory() as folder:
        rows, _ = measure_all(cases, Path(folder), jobs, limit=check_budget(budget, CASE_LIMIT))
    return pd.DataFrame(rows, columns=[*TABLES["results"].names])
