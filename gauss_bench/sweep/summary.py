"""The summary of a sweep: counts by status, quantiles of every figure, and sensitivities.

Of Sobol's plan the sensitivities are Sobol's indices by scipy: the share of a figure's variance that a number explains alone
(first), and with all others (total). Elsewhere they are Spearman's rank correlations of numbers and figures.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np

from gauss_bench.sweep.plan import Plan
from gauss_bench.terms import Array

QUANTILES = (0.0, 0.05, 0.25, 0.5, 0.75, 0.95, 1.0)
FEWEST = 8  # samples of a correlation
USED = ("ok",)


def summary(rows: Any, plan: Plan, figures: Sequence[str]) -> dict[str, Any]:
    """By engine: counts by status, and of samples that are ok quantiles and sensitivities of every figure.

    Args:
        rows: of the table, as pandas has them. figures: names of their columns.
    """
    return {engine: _of_engine(part.sort_values("sample"), plan, figures) for engine, part in rows.groupby("engine", sort=False)}


def _of_engine(rows: Any, plan: Plan, figures: Sequence[str]) -> dict[str, Any]:
    counts = {str(k): int(x) for k, x in rows["status"].value_counts().sort_index().items()}
    good = rows["status"].isin(USED).to_numpy()
    told = {}
    for name in figures:
        y = np.where(good, rows[name].to_numpy(dtype=float), np.nan)
        there = np.isfinite(y)
        if there.any():
            told[name] = {
                "count": int(there.sum()),
                "mean": float(y[there].mean()),
                "deviation": float(y[there].std(ddof=1)) if there.sum() > 1 else 0.0,
                "quantiles": {f"{x:g}": float(value) for x, value in zip(QUANTILES, np.quantile(y[there], QUANTILES), strict=True)},
            } | sensitivities(plan, y)
    reasons = {str(k): int(x) for k, x in rows.loc[~good, "message"].value_counts().head(5).items()}
    return {"samples": len(rows), "status": counts, "reasons": reasons, "figures": told}


def sensitivities(plan: Plan, y: Array) -> dict[str, Any]:
    """Sensitivities of a figure y (N,), not a number where a sample has none; the key says by which measure."""
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
    from scipy.stats import sobol_indices

    n, d = plan.base, len(plan.paths)
    parts = y.reshape(d + 2, 1, n)
    indices = sobol_indices(func={"f_A": parts[0], "f_B": parts[1], "f_AB": parts[2:]}, n=n)
    first, total = (np.atleast_1d(np.squeeze(x)) for x in (indices.first_order, indices.total_order))
    return {path: {"first": float(first[k]), "total": float(total[k])} for k, path in enumerate(plan.paths)}


def text(summary: dict[str, Any]) -> str:
    """The summary for people."""
    lines = []
    for engine, told in summary.items():
        ended = ", ".join(f"{count} {status}" for status, count in told["status"].items())
        lines += [f"{engine}: {told['samples']} samples: {ended}"]
        lines += [f"  {count} x {reason}" for reason, count in told["reasons"].items() if reason]
        lines += [f"  {'figure':<28}{'5 %':>12}{'median':>12}{'95 %':>12}  depends on"]
        for name, x in told["figures"].items():
            low, middle, high = (x["quantiles"][key] for key in ("0.05", "0.5", "0.95"))
            lines += [f"  {name:<28}{low:>12.5g}{middle:>12.5g}{high:>12.5g}  {_dependence(x)}"]
    return "\n".join(lines)


def _dependence(x: dict[str, Any]) -> str:
    if "sobol" in x:
        ordered = sorted(x["sobol"].items(), key=lambda item: -item[1]["total"])
        return ", ".join(f"{path} {value['first']:.2f}/{value['total']:.2f}" for path, value in ordered)
    ordered = sorted(x.get("rank_correlation", {}).items(), key=lambda item: -abs(item[1]))
    return ", ".join(f"{path} {value:+.2f}" for path, value in ordered)
