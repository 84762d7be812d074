"""The costs of a step and of an acceleration, as ratios to one engine of the same run."""

import math
from collections.abc import Iterator

from gauss_bench.report.cases import cost_rows, is_unstabilised
from gauss_bench.report.content import Finding, lay_out
from gauss_bench.report.rows import Row, Run, Spread, is_known, spread
from gauss_bench.report.words import itemise, range_text, ratio_text

PLACE = 14
OWN, RIVAL = "gauss", "lagrange"


def findings(run: Run) -> Iterator[Finding]:
    """Yield the cost of a step and of an acceleration by the suite's own formulation, relative to Lagrange multipliers."""
    rows = [row for row in cost_rows(run.results) if is_unstabilised(row)]
    rivals = {_place(row): row for row in reversed(rows) if row["engine"] == RIVAL}
    for quantity, what in (("step", "A step"), ("acceleration", "One acceleration")):
        ratios: dict[str, Spread] = {}
        for row in rows:
            if row["engine"] == OWN and _place(row) in rivals:
                ratio = _ratio(run, spread(row, f"{quantity}_ratio"), spread(rivals[_place(row)], f"{quantity}_ratio"))
                # an acceleration has no integrator: the first row of a linkage counts
                name = f"{row['mechanism']} {row['integrator']}" if quantity == "step" else row["mechanism"]
                if is_known(ratio.value):
                    ratios.setdefault(name, ratio)
        if ratios:
            # without a spread the ends are the ratio itself
            longer = sum(x.value > 1 for x in ratios.values())
            slower = sum((x.low if is_known(x.low) else x.value) > 1 for x in ratios.values())
            level = sum(x.low <= 1 <= x.high for x in ratios.values())
            listed = itemise(f"{name} {_ratio_words(x)}" for name, x in ratios.items())
            lines = [{"where": k, "ratio": x.value, "ratio_low": x.low, "ratio_high": x.high} for k, x in ratios.items()]
            yield Finding(
                f"Cost of {OWN} against {RIVAL}",
                f"{what} of `{OWN}` takes this multiple of the time of `{RIVAL}`: {listed}; slower in {slower} of {len(ratios)}"
                f"{f', not told apart in {level}' if level else ''}.",
                "warn" if longer > len(ratios) / 2 else "good",
                f"{what} of `{OWN}` takes {range_text([x.value for x in ratios.values()])} times as long as one of `{RIVAL}`.",
                (lay_out("behind_cost", lines, own=OWN, rival=RIVAL),),
            )


def _ratio_words(x: Spread) -> str:
    """Return a ratio with its spread, if it has one."""
    return x.print_with(ratio_text) if is_known(x.low) else ratio_text(x.value)


def _place(row: Row) -> tuple[str, ...]:
    """Return the columns that both engines must share."""
    return row["mechanism"], row["settings"], row["integrator"]


def _ratio(run: Run, own: Spread, rival: Spread) -> Spread:
    """Return the quotient of two ratios; it has a spread only if one of both engines is the baseline of all ratios."""
    baseline = run.environment.get("baseline_engine")
    if baseline == RIVAL and rival.value == 1 and is_known(own.low) and is_known(own.high):
        return own
    if baseline == OWN and own.value == 1 and rival.low > 0 and rival.high > 0:
        return Spread(1 / rival.value, 1 / rival.high, 1 / rival.low)
    return Spread(own.value / rival.value if rival.value > 0 else math.nan, math.nan, math.nan)
