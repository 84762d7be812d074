"""The paper's claim that fewer unknowns are faster: n - m against n + m unknowns with equal code otherwise."""

from collections.abc import Iterator, Sequence

from gauss_bench.report.content import Finding, Section, Text, blocks_of, count, itemise, list_unmeasured, run_of_numbers, times
from gauss_bench.report.rows import Row, Run, costs, is_known, number, plain

PLACE = 20
TABLES = ("kernel_claim",)
WAYS = {"": "a step", "projected_": "a step with projection", "batch_": "a step in a batch"}  # how columns begin -> in words
VERDICTS = ("holds", "open", "reversed")


def section(run: Run) -> Section:
    rows = sorted(run.table("kernel_claim"), key=lambda r: (*(number(r, f"unknowns_{x}") for x in UNKNOWNS), str(r["mechanism"])))
    blocks = blocks_of("kernel_claim", rows) or [Text("The run raced no compiled formulations.")]
    return Section("Is the paper right?", "claim", tuple(blocks))


UNKNOWNS = ("gauss", "lagrange")


def findings(run: Run) -> Iterator[Finding]:
    """Yield whether fewer unknowns are faster, for linkages with one and with more free coordinates."""
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
    """Return a sentence on the claim by the paper's own formula, repaired, and whether that is slower on any linkage.

    It compares steps of `gauss_pinv` and `lagrange`, both interpreted in the same loop; without times the sentence is empty.
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
    """Return for each kind of step the range of ratios, and the linkages on which fewer unknowns are not faster."""
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
