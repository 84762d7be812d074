"""Is the paper right? Few unknowns against many, with nothing else that differs."""

from collections.abc import Iterator, Sequence

from gauss_bench.report.content import (
    Cell,
    Finding,
    Section,
    Text,
    counts,
    listed,
    ratio_cells,
    remark,
    text_cell,
    texts,
    time_of,
    times,
    titled_table,
)
from gauss_bench.report.rows import Row, Run, grouped, known, number

PLACE = 20
TABLES = ("kernel_claim",)
CLAIM = (
    "The papers solve for n - m accelerations where Lagrange's multipliers solve for n + m unknowns, and say that this is cheaper. "
    "Here nothing else differs: one eliminator, one search for pivots and one code generator serve both formulations, and both "
    "race in one run. A ratio above 1 is the papers' gain. Operations, divisions and the longest chain of dependent operations (in "
    "cycles) are those of one acceleration with its guards; projected: steps that end on the constraints; batch: many trajectories "
    "in the lanes of a vector; numpy: one acceleration of the textbook's form of both, dense and interpreted. A verdict is "
    "**open** where the ratio's spread covers 1."
)
HEAD = (
    *("linkage", "n", "rows", "n - m", "n + m"),
    *("operations, Gauss", "Lagrange", "divisions, Gauss", "Lagrange", "chain, Gauss", "Lagrange"),
    *("step, Gauss", "Lagrange", "ratio", "spread", "projected", "spread", "batch", "spread", "numpy", "spread", "verdict"),
)


def section(run: Run) -> Section:
    """Whether the papers' claim holds."""
    rows = run.table("kernel_claim")
    if not rows:
        return Section("Is the paper right?", "claim", (Text("The run raced no compiled formulations."),))
    ordered = sorted(rows, key=lambda r: (number(r, "unknowns_gauss"), number(r, "unknowns_lagrange"), str(r["mechanism"])))
    lines = titled_table("n - m unknowns against n + m", HEAD, 1, ordered, claimed)
    return Section("Is the paper right?", "claim", (Text(CLAIM), Text(verdict(ordered)), lines))


def verdict(rows: Sequence[Row]) -> str:
    """In a sentence, from the rows' verdicts."""
    groups = grouped((r for r in rows if r.get("verdict")), lambda r: str(r["verdict"]))
    said = {
        "holds": "**Fewer unknowns are faster** on {}.",
        "open": "On {} there is no difference that the measurement could tell.",
        "reversed": "**The claim is reversed** on {}: the unknowns n - m are coupled, each with each, and n + m are not.",
    }
    parts = [text.format(listed(map(_named, groups[key]))) for key, text in said.items() if key in groups]
    gains = [number(r, "ratio") for r in rows if number(r, "unknowns_gauss") == 1 and known(r.get("ratio"))]
    if gains:
        parts.append(f"With one degree of freedom the formulation alone is worth {times(min(gains))} to {times(max(gains))} times.")
    held = [number(r, "projected_ratio") for r in rows if known(r.get("projected_ratio"))]
    if held:
        parts.append(f"With projection, which both do alike, {times(min(held))} to {times(max(held))} times are left.")
    many = [number(r, "batch_ratio") for r in rows if number(r, "unknowns_gauss") == 1 and known(r.get("batch_ratio"))]
    if many:
        parts.append(f"In a batch, where no chain is waited for, it is worth {times(min(many))} to {times(max(many))} times.")
    plain = [number(r, "numpy_ratio") for r in rows if known(r.get("numpy_ratio"))]
    if plain:
        how = "always slower" if max(plain) < 1 else "never slower" if min(plain) >= 1 else "slower on some"
        span = f"{times(min(plain))} to {times(max(plain))}"
        parts.append(f"In numpy, where calls cost more than arithmetic, n - m unknowns are {how}: the ratio is {span}.")
    return " ".join(parts)


def _named(row: Row) -> str:
    return f"{row['mechanism']} ({times(number(row, 'ratio'))})"


VERDICTS = {"holds": "good", "open": "warn", "reversed": "bad"}


def claimed(row: Row) -> tuple[Cell, ...]:
    """Both formulations of a linkage."""
    kinds = ("operations", "divisions", "critical")
    costs = counts(row, *(f"{kind}_{x}" for kind in kinds for x in ("gauss", "lagrange")))
    ratios = (cell for name in ("ratio", "projected_ratio", "batch_ratio", "numpy_ratio") for cell in ratio_cells(row, name))
    outcome = str(row.get("verdict", "")) or remark(row).text
    return (
        *texts(row, "mechanism"),
        *counts(row, "n", "rows", "unknowns_gauss", "unknowns_lagrange"),
        *costs,
        time_of(row),
        time_of(row, "rival_seconds"),
        *ratios,
        text_cell(outcome, VERDICTS.get(outcome, "bad")),
    )


def findings(run: Run) -> Iterator[Finding]:
    """Whether fewer unknowns are faster, compiled."""
    rows = [row for row in run.table("kernel_claim") if known(row.get("ratio"))]
    if not rows:
        return
    verdicts = grouped(sorted(rows, key=lambda r: number(r, "unknowns_gauss")), lambda r: str(r["verdict"]))
    said = {"holds": "faster on", "open": "level on", "reversed": "slower on"}
    parts = [f"{words} {listed(map(_ratio, verdicts[key]))}" for key, words in said.items() if key in verdicts]
    text = (
        f"Compiled by the same eliminator, n - m unknowns are {'; '.join(parts)} (times that n + m unknowns take, with its spread)."
    )
    whole = set(verdicts) == {"holds"}
    yield Finding(
        "The paper's claim", f"{'Yes' if whole else 'In part' if 'holds' in verdicts else 'No'}. {text}", "" if whole else "warn"
    )


def _ratio(row: Row) -> str:
    x, low, high = (times(number(row, f"ratio{end}")) for end in ("", "_low", "_high"))
    return f"{row['mechanism']} {x} ({low}..{high})"
