"""Is the paper right? Few unknowns against many, with nothing else that differs."""

from collections.abc import Iterator, Sequence

from gauss_bench.report.content import (
    RANGE,
    Cell,
    Finding,
    Section,
    Text,
    count,
    counts,
    itemise,
    list_unmeasured,
    ratio_cells,
    remark,
    run_of_numbers,
    table_with_title,
    text_cell,
    texts,
    times,
)
from gauss_bench.report.rows import Row, Run, costs, is_known, number, plain

PLACE = 20
TABLES = ("kernel_claim",)
CLAIM = (
    "The papers solve for n - m accelerations where Lagrange's multipliers solve for n + m unknowns, and say that this is cheaper. "
    "Here nothing else differs: one eliminator, one search for pivots and one code generator serve both formulations, and both "
    "race in one process, which is repeated in several, because where code and data happen to lie moves such a ratio by a few per "
    "cent. A ratio, time with n + m over time with n - m unknowns, is the median of the processes, its range where a second race "
    "falls in 99 of 100 cases; above 1 is the papers' gain, and a verdict is **open** where the range covers 1. Operations, "
    "divisions and the longest chain of dependent operations (in cycles) are those of one acceleration with its guards; projected: "
    "steps that end on the constraints; batch: many trajectories in the lanes of a vector. What a step takes in seconds, and both "
    "formulations in numpy, stand in the linkages' chapters."
)
WAYS = {"": "a step", "projected_": "a step with projection", "batch_": "a step in a batch"}  # how columns begin -> in words
HEAD = (
    *("linkage", "n", "rows", "n - m", "n + m"),
    *("operations, Gauss", "Lagrange", "divisions, Gauss", "Lagrange", "chain, Gauss", "Lagrange"),
    *(x for way in ("step", "projected", "batch") for x in (way, RANGE, "verdict")),
    *("processes", "remark"),
)


def section(run: Run) -> Section:
    """Every linkage, and what follows."""
    rows = run.table("kernel_claim")
    if not rows:
        return Section("Is the paper right?", "claim", (Text("The run raced no compiled formulations."),))
    ordered = sorted(rows, key=lambda r: (number(r, "unknowns_gauss"), number(r, "unknowns_lagrange"), str(r["mechanism"])))
    lines = table_with_title("n - m unknowns against n + m", HEAD, 1, ordered, list_claims)
    return Section("Is the paper right?", "claim", (Text(CLAIM), lines))


VERDICTS = {"holds": "good", "open": "warn", "reversed": "bad"}


def list_claims(row: Row) -> tuple[Cell, ...]:
    """Both formulations of a linkage."""
    kinds = ("operations", "divisions", "critical")
    costs = counts(row, *(f"{kind}_{x}" for kind in kinds for x in ("gauss", "lagrange")))
    raced = (cell for way in WAYS for cell in (*ratio_cells(row, f"{way}ratio"), _verdict(row, way)))
    unknowns = counts(row, "n", "rows", "unknowns_gauss", "unknowns_lagrange")
    return (*texts(row, "mechanism"), *unknowns, *costs, *raced, *counts(row, "processes"), remark(row))


def _verdict(row: Row, way: str) -> Cell:
    verdict = str(row.get(f"{way}verdict", ""))
    return text_cell(verdict, VERDICTS.get(verdict, ""))


def findings(run: Run) -> Iterator[Finding]:
    """State whether fewer unknowns are faster, compiled: a sentence for every linkage, number of free coordinates and way."""
    by_formula, slower = as_printed(run)
    table = run.table("kernel_claim")
    rows = [row for row in table if is_known(row.get("ratio"))]
    if not rows:
        if by_formula:
            yield Finding("The paper's claim", by_formula, "warn" if slower else "")
        return
    verdicts = {str(r.get(f"{way}verdict", "")) for r in rows for way in WAYS} - {""}
    one, more = ([r for r in rows if (number(r, "unknowns_gauss") == 1) is single] for single in (True, False))
    parts = [f"with {_freedoms(some)} {_race(some)}" for some in (one, more) if some]
    processes = run_of_numbers([number(r, "processes") for r in rows]).replace(".00", "")
    answer = "Yes" if verdicts == {"holds"} else "In part" if "holds" in verdicts else "No"
    text = (
        f"{by_formula}{answer}{', by elimination' if by_formula else ''}. "
        f"Compiled by the same eliminator, n - m unknowns against n + m, as the median of {processes} processes: "
        f"{'; '.join(parts)}.{list_unmeasured(table, 'ratio')}"
    )
    yield Finding("The paper's claim", text, "" if answer == "Yes" and not slower else "warn")


def as_printed(run: Run) -> tuple[str, bool]:
    """The claim by the paper's own formula, the repaired one with pseudo-inverses, and whether it is slower anywhere.

    Steps of `gauss_pinv` and of `lagrange`, both interpreted and in the same loop; no words where they were not timed.
    """
    rows = [r for r in costs(run.results) if plain(r) and is_known(r.get("step_ratio"))]
    steps = {(r["mechanism"], r["engine"]): number(r, "step_ratio") for r in rows if r["integrator"] == "rk4"}
    ratios = {x: steps[x, "gauss_pinv"] / steps[x, "lagrange"] for x, e in steps if e == "gauss_pinv" and (x, "lagrange") in steps}
    if not ratios:
        return "", False
    slower = sum(x > 1 for x in ratios.values())
    answer = "Yes" if not slower else "No" if slower == len(ratios) else "In part"
    said = itemise(f"{name} {times(x)}" for name, x in ratios.items())
    return (
        f"{answer}, by the paper's own formula: a step of `gauss_pinv`, with pseudo-inverses, takes this many times as long as one "
        f"of `lagrange`, both in numpy in the same loop: {said}. ",
        slower > 0,
    )


def _freedoms(rows: Sequence[Row]) -> str:
    numbers = sorted({int(number(r, "unknowns_gauss")) for r in rows})
    return count(numbers[0], "free coordinate") if len(numbers) == 1 else f"{numbers[0]} to {numbers[-1]} free coordinates"


def _race(rows: Sequence[Row]) -> str:
    """Every way in which these linkages were raced, with the ends of its ratios and the linkages where few do not win."""
    parts = []
    for way, words in WAYS.items():
        raced = [r for r in rows if is_known(r.get(f"{way}ratio"))]
        if not raced:
            continue
        on = {x: [str(r["mechanism"]) for r in raced if r[f"{way}verdict"] == x] for x in VERDICTS}
        said = f"{words} is faster on {len(on['holds'])} of {count(len(raced), 'linkage')}"
        but = [f"ratio {run_of_numbers([number(r, f'{way}ratio') for r in raced])}"]
        but += [f"{how} on {itemise(on[x])}" for x, how in (("open", "no difference"), ("reversed", "slower")) if on[x]]
        parts.append(f"{said} ({'; '.join(but)})")
    return itemise(parts)
