"""The costs of a step and of an acceleration, as ratios to one engine of the same run."""

from collections.abc import Iterator

from gauss_bench.report.content import Finding, itemise, times
from gauss_bench.report.rows import Row, Run, costs, is_known, number, plain

PLACE = 14
TABLES = ("results",)
OWN, RIVAL = "gauss", "lagrange"


def findings(run: Run) -> Iterator[Finding]:
    """Yield the cost of a step and of an acceleration by the suite's own formulation, relative to Lagrange multipliers."""
    rows = [row for row in costs(run.results) if plain(row)]
    for quantity, what in (("step", "A step"), ("acceleration", "One acceleration")):
        spreads: dict[str, list[float]] = {}
        for row in (r for r in rows if r["engine"] == OWN):
            rival = next((r for r in rows if r["engine"] == RIVAL and _alike(r, row)), None)
            ratio = _ratio(run, row, rival, quantity) if rival is not None else []
            if ratio:  # an acceleration has no integrator: one per linkage
                spreads.setdefault(f"{row['mechanism']}{' ' + row['integrator'] if quantity == 'step' else ''}", ratio)
        if spreads:
            longer, slower = (sum(x[:2][end] > 1 for x in spreads.values()) for end in (0, -1))
            level = sum(x[1] <= 1 <= x[2] for x in spreads.values() if len(x) > 1)
            told = itemise(f"{name} {_with_spread(x)}" for name, x in spreads.items())
            yield Finding(
                f"Cost of {OWN} against {RIVAL}",
                f"{what} of `{OWN}` takes this multiple of the time of `{RIVAL}`: {told}; slower in {slower} of {len(spreads)}"
                f"{f', not told apart in {level}' if level else ''}.",
                "warn" if longer > len(spreads) / 2 else "good",
            )


def _with_spread(x: list[float]) -> str:
    return f"{times(x[0])} ({times(x[1])}..{times(x[2])})" if len(x) > 1 else times(x[0])


def _alike(a: Row, b: Row) -> bool:
    return all(a[key] == b[key] for key in ("mechanism", "settings", "integrator"))


def _ratio(run: Run, own: Row, rival: Row, quantity: str) -> list[float]:
    """Return the ratio, with low and high if one of both engines is the baseline of all ratios; else the quotient of two ratios."""
    x, low, high = (number(own, f"{quantity}_ratio{end}") for end in ("", "_low", "_high"))
    y, below, above = (number(rival, f"{quantity}_ratio{end}") for end in ("", "_low", "_high"))
    baseline = run.environment.get("baseline_engine")
    if baseline == RIVAL and y == 1 and is_known(low) and is_known(high):
        return [x, low, high]
    if baseline == OWN and x == 1 and below > 0 and above > 0:
        return [1 / y, 1 / above, 1 / below]
    return [x / y] if is_known(x) and y > 0 else []
