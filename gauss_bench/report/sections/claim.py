"""The paper's claim that fewer unknowns are faster: n - m and n + m unknowns, timed side by side in otherwise equal code."""

from collections.abc import Iterator, Sequence

from gauss_bench.report.cases import cost_rows, is_unstabilised
from gauss_bench.report.content import Finding, Section, Text, blocks_of, lay_out
from gauss_bench.report.rows import Row, Run, group_by, number, with_number
from gauss_bench.report.words import count, itemise, list_unmeasured, range_text, ratio_text

PLACE = 20
RACES = {"": "a step", "projected_": "a step with projection", "batch_": "a step in a batch"}  # prefix of columns -> what is timed


def section(run: Run) -> Section:
    """Return the section on the claim that fewer unknowns are faster, with the table of timed comparisons."""

    def order(row: Row) -> tuple[float, float, str]:
        """Return the sort key of a row: numbers of unknowns in the Gauss and the Lagrange formulation, then the linkage."""
        return number(row, "unknowns_gauss"), number(row, "unknowns_lagrange"), row["mechanism"]

    answers = [Text(finding.short or finding.text) for finding in findings(run)]
    rows = sorted(run.table("kernel_claim"), key=order)
    return Section("Is the paper right?", "claim", (*answers, *blocks_of("kernel_claim", rows)))


def findings(run: Run) -> Iterator[Finding]:
    """Yield a finding on whether a step with n - m unknowns takes less time than one with n + m."""
    by_formula, ratios = compare_formula(run)
    slower = any(x > 1 for x in ratios.values())
    formula = [{"where": name, "ratio": x} for name, x in ratios.items()]
    behind = [lay_out("behind_formula", formula)] if formula else []
    table = run.table("kernel_claim")
    rows = with_number(table, "ratio")
    if not rows:
        if by_formula:
            yield Finding("The paper's claim", by_formula, "warn" if slower else "", behind=behind)
        return
    verdicts = {r.get(f"{race}verdict", "") for r in rows for race in RACES} - {""}
    answer = answer_in_part("holds" in verdicts, verdicts == {"holds"})
    groups = group_by(rows, lambda r: number(r, "unknowns_gauss") > 1)  # False: linkages with one free coordinate
    parts = [f"with {_count_freedoms(group)} {_compare_races(group)}" for _, group in sorted(groups.items())]
    processes = range_text([number(r, "processes") for r in rows]).replace(".00", "")  # whole numbers without decimals
    text = (
        f"{by_formula}{answer}{', by elimination' if by_formula else ''}. "
        f"Compiled by the same eliminator, n - m unknowns against n + m, as the median of {processes} processes: "
        f"{'; '.join(parts)}.{list_unmeasured(table, 'ratio')}"
    )
    holds = sum(r["verdict"] == "holds" for r in rows)
    short = f"compiled alike, fewer unknowns are faster on {holds} of {count(len(rows), 'linkage')}."
    if ratios:
        multiples = range_text(list(ratios.values()))
        short = f"by the paper's own formula a step takes {multiples} times as long as by Lagrange's multipliers; {short}"
    short = short[0].upper() + short[1:]
    tone = "" if answer == "Yes" and not slower else "warn"
    yield Finding("The paper's claim", text, tone, short, (*behind, lay_out("behind_claim", rows)))


def answer_in_part(holds_once: bool, holds_always: bool) -> str:
    """Return "Yes" for a claim that holds in all cases, "In part" if it holds in some, and else "No"."""
    if holds_always:
        return "Yes"
    return "In part" if holds_once else "No"


def compare_formula(run: Run) -> tuple[str, dict[str, float]]:
    """Return a sentence on the paper's claim that fewer unknowns are faster, and a dictionary: linkage -> ratio of times.

    The ratio is the time of a step of `gauss_pinv`, which is the paper's own formula with its misprints corrected, over that of
    `lagrange`. Both `gauss_pinv` and `lagrange` run in Python in the same loop over the steps. Sentence and dictionary are empty if
    no times are stored.
    """
    rows = [r for r in cost_rows(run.results) if is_unstabilised(r) and r["integrator"] == "rk4"]
    steps = {(r["engine"], r["mechanism"]): r["step_ratio"] for r in with_number(rows, "step_ratio")}
    linkages = [x for engine, x in steps if engine == "gauss_pinv" and ("lagrange", x) in steps]  # with times of both
    ratios = {x: steps["gauss_pinv", x] / steps["lagrange", x] for x in linkages}
    if not ratios:
        return "", {}
    faster = [x <= 1 for x in ratios.values()]
    answer = answer_in_part(any(faster), all(faster))
    listed = itemise(f"{name} {ratio_text(x)}" for name, x in ratios.items())
    return (
        f"{answer}, by the paper's own formula: a step of `gauss_pinv`, with pseudo-inverses, takes this many times as long as one "
        f"of `lagrange`, both in numpy in the same loop: {listed}. ",
        ratios,
    )


def _count_freedoms(rows: Sequence[Row]) -> str:
    """Return the range of n - m, the number of free coordinates, in words such as "2 to 16 free coordinates"."""
    numbers = sorted({int(r["unknowns_gauss"]) for r in rows})
    return count(numbers[0], "free coordinate") if len(numbers) == 1 else f"{numbers[0]} to {numbers[-1]} free coordinates"


def _compare_races(rows: Sequence[Row]) -> str:
    """Return in words, for each kind of step in RACES, how n - m unknowns compare with n + m."""
    parts = []
    for race, words in RACES.items():
        raced = with_number(rows, f"{race}ratio")
        if not raced:
            continue
        by_verdict = group_by(raced, f"{race}verdict")
        details = [f"ratio {range_text([r[f'{race}ratio'] for r in raced])}"]
        for verdict, outcome in (("open", "no difference"), ("reversed", "slower")):
            if verdict in by_verdict:
                details.append(f"{outcome} on {itemise(r['mechanism'] for r in by_verdict[verdict])}")
        faster = len(by_verdict.get("holds", ()))
        parts.append(f"{words} is faster on {faster} of {count(len(raced), 'linkage')} ({'; '.join(details)})")
    return itemise(parts)
