"""The cost of a step and of an acceleration by Gauss's principle, as a multiple of the cost with Lagrange's multipliers."""

import math
from collections.abc import Iterator

from gauss_bench.report.cases import cost_rows, is_unstabilised
from gauss_bench.report.content import Finding, lay_out
from gauss_bench.report.rows import Row, Run, Spread, first_number, is_known, of_engine, spread
from gauss_bench.report.words import itemise, range_text, ratio_text

PLACE = 14
OWN, RIVAL = "gauss", "lagrange"


def findings(run: Run) -> Iterator[Finding]:
    """Yield a finding on the cost of a step, and one on the cost of an acceleration."""
    for quantity, subject in (("step", "A step"), ("acceleration", "One acceleration")):
        ratios = divide_costs(run, quantity)
        if not ratios:
            continue
        above = sum(x.value > 1 for x in ratios.values())
        slower = sum(first_number(x.low, x.value) > 1 for x in ratios.values())  # by the whole range, if the range is known
        level = sum(x.low <= 1 <= x.high for x in ratios.values())
        undecided = f", undecided in {level}" if level else ""
        listed = itemise(f"{name} {x.print_with(ratio_text)}" for name, x in ratios.items())
        lines = [{"where": k, "ratio": x.value, "ratio_low": x.low, "ratio_high": x.high} for k, x in ratios.items()]
        yield Finding(
            f"Cost of {OWN} against {RIVAL}",
            f"{subject} of `{OWN}` takes this multiple of the time of `{RIVAL}`: {listed}; slower in {slower} of {len(ratios)}"
            f"{undecided}.",
            "warn" if above > len(ratios) / 2 else "good",
            f"{subject} of `{OWN}` takes {range_text([x.value for x in ratios.values()])} times as long as one of `{RIVAL}`.",
            (lay_out("behind_cost", lines, own=OWN, rival=RIVAL),),
        )


def divide_costs(run: Run, quantity: str) -> dict[str, Spread]:
    """Return linkage -> time of the engine OWN divided by that of RIVAL; for a step, linkage and integrator -> this ratio.

    Args:
        quantity: "step" or "acceleration".
    """
    rows = [row for row in cost_rows(run.results) if is_unstabilised(row)]
    # reversed: of several rows the first is kept
    rivals = {_place(row): row for row in reversed(rows) if row["engine"] == RIVAL}
    ratios: dict[str, Spread] = {}
    for row in of_engine(rows, OWN):
        rival = rivals.get(_place(row), {})
        ratio = _divide(run, spread(row, f"{quantity}_ratio"), spread(rival, f"{quantity}_ratio"))
        # an acceleration has no integrator: the first row of a linkage counts
        name = f"{row['mechanism']} {row['integrator']}" if quantity == "step" else row["mechanism"]
        if is_known(ratio.value):
            ratios.setdefault(name, ratio)
    return ratios


def _place(row: Row) -> tuple[str, ...]:
    """Return linkage, settings and integrator of a row; rows of two engines are compared only if these three are equal."""
    return row["mechanism"], row["settings"], row["integrator"]


def _divide(run: Run, own: Spread, rival: Spread) -> Spread:
    """Return the time of OWN divided by that of RIVAL; NaN if it is unknown.

    Both times are multiples of the time of the run's baseline engine. The range of the quotient is known only if one of the two
    engines is the baseline: the quotient is then `own`, or 1 / `rival`.
    """
    baseline = run.environment.get("baseline_engine")
    if baseline == RIVAL and rival.value == 1 and is_known(own.low) and is_known(own.high):
        return own
    if baseline == OWN and own.value == 1 and rival.low > 0 and rival.high > 0:
        return Spread(1 / rival.value, 1 / rival.high, 1 / rival.low)
    quotient = own.value / rival.value if rival.value > 0 else math.nan
    return Spread(quotient, math.nan, math.nan)
