"""Several engines on one linkage, as a table."""

import tempfile
from collections.abc import Sequence
from pathlib import Path

import pandas as pd

from gauss_bench.bench.cases import crossed
from gauss_bench.bench.runner import measure_all
from gauss_bench.engines import names
from gauss_bench.mechanism.load import load


def compare(
    linkage: str,
    engines: Sequence[str] | None = None,
    scenario: str | None = None,
    steps: Sequence[float] = (1e-3,),
    t_end: float | None = None,
    jobs: int = 2,
) -> pd.DataFrame:
    """Accuracy and drift of engines on a linkage (a built-in name or a file), one row per engine, setting and step.

    Args:
        linkage: name of a built-in linkage, or a path.
        engines: names; all where not given.
        scenario: of the file; the first with a start where not given.
        steps: integration steps [s], each a divisor of 0.01 s.
        t_end: [s]; the scenario's duration, at most 2 s, where not given.
        jobs: worker processes.

    Raises:
        LinkageError: the file has faults.
    """
    mechanism = load(linkage, scenario)
    t_end = min(mechanism.duration, 2.0) if t_end is None else t_end
    cases = list(crossed({linkage: mechanism.scenario}, list(engines or names()), tuple(steps), t_end))
    with tempfile.TemporaryDirectory() as folder:
        return measure_all(cases, Path(folder), jobs)[0]
