"""The summary of a sweep: counts by status, quantiles of every figure, and sensitivities.

The sensitivities of a Sobol plan are Sobol's indices by scipy: the share of a figure's variance that a number explains alone
(first), and together with all others (total). Those of other plans are Spearman's rank correlations of numbers and figures.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np

from gauss_bench.sweep.plan import Plan
from gauss_bench.terms import Array

QUANTILES = (0.0, 0.05, 0.25, 0.5, 0.75, 0.95, 1.0)
FEWEST = 8  # smallest number of samples of a correlation
USED = ("ok",)


def summary(rows: Any, plan: Plan, figures: Sequence[str]) -> dict[str, Any]:
    """Return for each engine the counts by status, and quantiles and sensitivities of every figure of samples that are ok.

    Args:
        rows: all rows, as a pandas table.
        figures: names of the columns of figures.
    """
    return {engine: _summarise(part.sort_values("sample"), plan, figures) for engine, part in rows.groupby("engine", sort=False)}


def _summarise(rows: Any, plan: Plan, figures: Sequence[str]) -> dict[str, Any]:
    """Summarise the rows of one engine."""
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
    """Return the sensitivities of a figure y (N,), under the name of their measure; y is NaN for a sample without the figure."""
    there = np.isfinite(y)
    if plan.base and there.all():
        return {"sobol": _sobol(plan, y)}
    x = plan.values[: len(y)][there]
    if len(x) < FEWEST or np.ptp(y[there]) == 0:
        return {}
    import pandas

    varied = np.ptp(x, axis=0) > 0
    ranks = pandas.DataFrame(np.column_stack([y[there], x[:, varied]])).rank()
    correlations = np.atleast_2d(np.corrcoef(ranks, rowvar=False))[0, 1:].tolist()
    return {"rank_correlation": dict(zip(np.array(plan.paths)[varied].tolist(), correlations, strict=True))}


def _sobol(plan: Plan, y: Array) -> dict[str, dict[str, float]]:
    """Return Sobol's first-order and total index of every number, by its path."""
    from scipy.stats import sobol_indices

    n, d = plan.base, len(plan.paths)
    parts = y.reshape(d + 2, 1, n)
    indices = sobol_indices(func={"f_A": parts[0], "f_B": parts[1], "f_AB": parts[2:]}, n=n)
    first, total = (np.atleast_1d(np.squeeze(x)) for x in (indices.first_order, indices.total_order))
    return {path: {"first": float(first[k]), "total": float(total[k])} for k, path in enumerate(plan.paths)}


def text(summary: dict[str, Any]) -> str:
    """Return the summary as text for users."""
    lines = []
    for engine, found in summary.items():
        counts = ", ".join(f"{count} {status}" for status, count in found["status"].items())
        lines += [f"{engine}: {found['samples']} samples: {counts}"]
        lines += [f"  {count} x {reason}" for reason, count in found["reasons"].items() if reason]
        lines += [f"  {'figure':<28}{'5 %':>12}{'median':>12}{'95 %':>12}  depends on"]
        for name, x in found["figures"].items():
            low, middle, high = (x["quantiles"][key] for key in ("0.05", "0.5", "0.95"))
            lines += [f"  {name:<28}{low:>12.5g}{middle:>12.5g}{high:>12.5g}  {_dependence(x)}"]
    return "\n".join(lines)


def _dependence(x: dict[str, Any]) -> str:
    """Return the sensitivities of a figure as text, the largest first; Sobol's indices are first/total."""
    if "sobol" in x:
        ordered = sorted(x["sobol"].items(), key=lambda item: -item[1]["total"])
        return ", ".join(f"{path} {value['first']:.2f}/{value['total']:.2f}" for path, value in ordered)
    ordered = sorted(x.get("rank_correlation", {}).items(), key=lambda item: -abs(item[1]))
    return ", ".join(f"{path} {value:+.2f}" for path, value in ordered)
