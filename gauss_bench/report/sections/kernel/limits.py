"""The distance of the compiled steps from what the processor allows."""

from collections.abc import Iterator, Sequence

from gauss_bench.report.content import (
    RANGE,
    Block,
    Cell,
    Finding,
    Section,
    Text,
    counts,
    itemise,
    list_unmeasured,
    remark,
    table_with_title,
    texts,
    time_of,
)
from gauss_bench.report.rows import Row, Run, group_rows, is_known, number

PLACE = 90
TABLES = ("kernel_bounds", "kernel_machine")
LIMITS = (
    "A single trajectory cannot be faster than the longest chain of operations through its step, at the measured latency of a "
    "fused multiply-add; a batch not than its operations at the measured peak rate."
)
FACTS = ("cpu", "cores", "python", "date", "commit")


def findings(run: Run) -> Iterator[Finding]:
    rows = [r for r in run.table("kernel_bounds") if is_known(r.get("share"))]
    if rows:
        groups = group_rows(rows, lambda r: str(r["quantity"]))
        said = itemise(f"{_percent([number(r, 'share') for r in some])} for {what}" for what, some in groups.items())
        yield Finding(
            "What is left to be gained",
            f"Of the speed that latency and the peak rate of this processor allow, the kernel reaches {said}."
            f"{list_unmeasured(run.table('kernel_bounds'), 'share')}",
        )


def _percent(values: Sequence[float]) -> str:
    return f"{100 * min(values):.0f} to {100 * max(values):.0f} %"


def section(run: Run) -> Section | None:
    rows, machine = run.table("kernel_bounds"), run.table("kernel_machine")
    if not rows:
        return None
    facts = itemise(f"{r['key']} {r['statement']}" for r in machine if r.get("statement") and r["key"] in FACTS)
    said = f"{LIMITS} Measured on: {facts}." if facts else LIMITS
    head = ("linkage", "what", "chain [cycles]", "flops", "least time", "measured", "share", "remark")
    blocks: list[Block] = [Text(said), table_with_title("Share of the machine's limit", head, 2, rows, limit)]
    if quantities := [r for r in machine if is_known(r.get("value"))]:
        blocks.append(table_with_title("The processor", ("quantity", "value", RANGE, "unit"), 1, quantities, fact))
    return Section("Distance to the machine's limit", "kernel-limits", tuple(blocks))


def limit(row: Row) -> tuple[Cell, ...]:
    share = number(row, "share")
    reached = Cell(f"{100 * share:.0f} %", share) if is_known(share) else Cell("-")
    return (
        *texts(row, "mechanism", "quantity"),
        *counts(row, "cycles", "flops"),
        time_of(row, "bound"),
        time_of(row),
        reached,
        remark(row),
    )


def fact(row: Row) -> tuple[Cell, ...]:
    value, low, high = (number(row, f"value{end}") for end in ("", "_low", "_high"))
    return (*texts(row, "quantity"), Cell(f"{value:.3g}", value), Cell(f"{low:.3g}..{high:.3g}", low), *texts(row, "unit"))
