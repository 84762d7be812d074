"""Summarise a sweep: counts by status, quantiles of every figure (number in a row, see `figures.py`), and sensitivities.

The sensitivities of a Sobol plan are Sobol's indices: the share of a figure's variance that a varied number explains alone (first),
or alone and by interactions with others (total). If the plan has grids or random values, the sensitivities are Spearman's rank
correlations between the varied numbers and the figures.
"""

from collections.abc import Sequence
from typing import Any, NotRequired, TypedDict

import numpy as np

from gauss_bench.sweep.plan import Plan
from gauss_bench.terms import Array

QUANTILES = (0.0, 0.05, 0.25, 0.5, 0.75, 0.95, 1.0)
FEWEST = 8  # smallest number of samples from which a correlation is computed
USED = ("ok",)  # statuses of the samples whose figures are used


class SobolIndices(TypedDict):
    """Sobol's indices of a varied number: its share of the variance of a figure, a number computed from each motion.

    Attributes:
        first: share of the variance that the number explains alone.
        total: share of the variance that the number explains alone and by interactions with other varied numbers.
    """

    first: float
    total: float


class FigureSummary(TypedDict):
    """A figure (a number that is computed from each motion) over the samples that are ok, in its own unit.

    Attributes:
        count: number of samples that have this figure.
        mean, deviation: mean and standard deviation of the figure.
        quantiles: share of the samples, such as "0.05" -> value that the figure does not exceed in this share of the samples.
        sobol: path of a varied number -> Sobol's indices, in a Sobol plan.
        rank_correlation: path of a varied number -> Spearman's rank correlation, in a plan of grids and random values with enough
            samples.
    """

    count: int
    mean: float
    deviation: float
    quantiles: dict[str, float]
    sobol: NotRequired[dict[str, SobolIndices]]
    rank_correlation: NotRequired[dict[str, float]]


class Halved(TypedDict):
    """The repetition of some samples at half the step or a tighter tolerance.

    Attributes:
        how: "half the step", or "a tighter tolerance" if the integrator chooses its steps.
        samples: number of repeated samples.
        m, rad: largest change of a figure that is measured in metres or in radians.
        worst: index of the sample whose change is largest in proportion to its limit; null if nothing changes.
        lost: number of samples that are not ok when they are repeated.
        ok: whether all changes are within the judge's limits for a repetition, and no sample is lost.
    """

    how: str
    samples: int
    m: float
    rad: float
    worst: int | None
    lost: int
    ok: bool


class EngineSummary(TypedDict):
    """The samples of one engine.

    Attributes:
        samples: number of samples.
        status: status of a sample -> number of samples.
        reasons: message of samples that are not ok -> number of samples, for the five most frequent messages.
        figures: name of a figure -> summary of the figure.
        half_the_step: change of the figures at half the step; null if no sample is ok.
    """

    samples: int
    status: dict[str, int]
    reasons: dict[str, int]
    figures: dict[str, FigureSummary]
    half_the_step: Halved | None


def summary(rows: Any, plan: Plan, figures: Sequence[str]) -> dict[str, Any]:
    """Return name of an engine -> `EngineSummary` of its rows, without the key `half_the_step`."""
    return {engine: _summarise(part.sort_values("sample"), plan, figures) for engine, part in rows.groupby("engine", sort=False)}


def _summarise(rows: Any, plan: Plan, figures: Sequence[str]) -> dict[str, Any]:
    """Return counts of statuses, reasons of failures, and statistics and sensitivities of each figure, for one engine's rows."""
    counts = {str(k): int(x) for k, x in rows["status"].value_counts().sort_index().items()}
    good = rows["status"].isin(USED).to_numpy()
    summaries = {}
    for name in figures:
        y = np.where(good, rows[name].to_numpy(dtype=float), np.nan)
        known = y[np.isfinite(y)]
        if len(known):
            quantiles = np.quantile(known, QUANTILES).tolist()
            summaries[name] = {
                "count": len(known),
                "mean": float(known.mean()),
                "deviation": float(known.std(ddof=1)) if len(known) > 1 else 0.0,
                "quantiles": {f"{share:g}": x for share, x in zip(QUANTILES, quantiles, strict=True)},
            } | sensitivities(plan, y)
    reasons = {str(k): int(x) for k, x in rows.loc[~good, "message"].value_counts().head(5).items()}
    return {"samples": len(rows), "status": counts, "reasons": reasons, "figures": summaries}


def sensitivities(plan: Plan, y: Array) -> dict[str, Any]:
    """Return {"sobol": ...} or {"rank_correlation": ...} of a figure y (N,), or {} if it has too few values or does not vary.

    y is NaN for a sample without the figure. If there is such a sample, rank correlations are computed instead of Sobol's indices.
    """
    known = np.isfinite(y)
    if plan.base and known.all():
        return {"sobol": _sobol(plan, y)}
    x = plan.values[: len(y)][known]
    if len(x) < FEWEST or np.ptp(y[known]) == 0:
        return {}
    import pandas

    varied = np.ptp(x, axis=0) > 0
    ranks = pandas.DataFrame(np.column_stack([y[known], x[:, varied]])).rank()
    correlations = np.atleast_2d(np.corrcoef(ranks, rowvar=False))[0, 1:].tolist()
    return {"rank_correlation": dict(zip(np.array(plan.paths)[varied].tolist(), correlations, strict=True))}


def _sobol(plan: Plan, y: Array) -> dict[str, dict[str, float]]:
    """Return Sobol's first-order and total index of every number, by its path."""
    from scipy.stats import sobol_indices

    n, d = plan.base, len(plan.paths)
    parts = y.reshape(d + 2, 1, n)  # y at the points A, B, and A with each column of B; scipy has an axis for several outputs
    indices = sobol_indices(func={"f_A": parts[0], "f_B": parts[1], "f_AB": parts[2:]}, n=n)
    first, total = (np.atleast_1d(np.squeeze(x)) for x in (indices.first_order, indices.total_order))
    return {path: {"first": float(first[k]), "total": float(total[k])} for k, path in enumerate(plan.paths)}


def text(summary: dict[str, Any]) -> str:
    """Return the summaries of all engines (name -> `EngineSummary`) as text with a line for each figure."""
    lines = []
    for engine, of_engine in summary.items():
        counts = ", ".join(f"{count} {status}" for status, count in of_engine["status"].items())
        lines += [f"{engine}: {of_engine['samples']} samples: {counts}"]
        lines += [f"  {count} x {reason}" for reason, count in of_engine["reasons"].items() if reason]
        lines += [f"  {'figure':<28}{'5 %':>12}{'median':>12}{'95 %':>12}  depends on"]
        for name, x in of_engine["figures"].items():
            low, middle, high = (x["quantiles"][key] for key in ("0.05", "0.5", "0.95"))
            lines += [f"  {name:<28}{low:>12.5g}{middle:>12.5g}{high:>12.5g}  {_dependence(x)}"]
    return "\n".join(lines)


def _dependence(x: dict[str, Any]) -> str:
    """Return the sensitivities in a figure's summary as text, the largest first; Sobol's indices as first/total."""
    if "sobol" in x:
        ordered = sorted(x["sobol"].items(), key=lambda item: -item[1]["total"])
        return ", ".join(f"{path} {value['first']:.2f}/{value['total']:.2f}" for path, value in ordered)
    ordered = sorted(x.get("rank_correlation", {}).items(), key=lambda item: -abs(item[1]))
    return ", ".join(f"{path} {value:+.2f}" for path, value in ordered)
