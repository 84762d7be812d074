"""Several engines on one linkage, as a table."""

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
    """Compare engines on a linkage by accuracy and drift: one row per engine, setting and step.

    Args:
        linkage: name of a built-in linkage, or a path.
        engines: names; all where not given.
        scenario: of the file; the first with a start where not given.
        steps: integration steps [s]. A row's step is the step taken; if it does not divide `t_end`, the last step is shorter and
            the note says so. Errors are evaluated at the reference's times that whole steps reach; `compared` counts them.
        t_end: [s]; the scenario's duration where not given.
        jobs: worker processes.
        budget: seconds that one row may take.
        settings: of the engines, instead of their standard settings: a name, KEY=VALUE,... of their own options, or both.

    Raises:
        LinkageError: the file has faults.
        ChoiceError: a number of jobs, a step or a time that cannot be used, or settings that an engine does not know.
        KeyError: unknown engine.
    """
    if jobs < 1:
        raise ChoiceError(f"jobs must be at least 1, not {jobs}")
    mechanism = load(linkage, scenario)
    end = duration(mechanism.duration, until=t_end)
    wanted = list(engines or names())
    offers(wanted)
    cases = list(cross({linkage: mechanism.scenario}, wanted, usable_steps(steps, end), end, asked=settings))
    with tempfile.TemporaryDirectory() as folder:
        return measure_all(cases, Path(folder), jobs, limit=check_budget(budget, CASE_LIMIT))[0]
