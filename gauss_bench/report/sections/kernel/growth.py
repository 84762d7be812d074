"""The time of a right-hand side against the number of loops."""

from collections.abc import Iterator, Sequence

from gauss_bench.report.content import (
    RANGE,
    Block,
    Cell,
    Chart,
    Finding,
    Section,
    Text,
    counts,
    error_cell,
    itemise,
    remark,
    span,
    table_with_title,
    texts,
    time_of,
)
from gauss_bench.report.rows import (
    Row,
    Run,
    is_known,
    number,
)
from gauss_bench.report.site.charts import points

PLACE = 70
TABLES = ("scaling", "kernel_growth")
SCALING = (
    "Chains of N windows, (n - m) = 1: one right-hand side of the same state. Exponents p of time ~ N^p are least squares of the "
    "logarithms; own kernels in their own loop, engines as called. A time is the median over several processes, a range where a "
    "second race falls in 99 of 100 cases; rounds of one process alone tell nothing of it. Errors against the closed form."
)
BUILDING = ("generate_seconds", "compile_seconds")


def findings(run: Run) -> Iterator[Finding]:
    """Exponents of whatever is asked in the way that costs least."""
    rows = run.table("kernel_growth")
    stepping = {r["engine"] for r in rows if r["quantity"] == "in its own loop"}
    shown = [r for r in rows if r["quantity"] == "in its own loop" or r["engine"] not in stepping]
    if shown:
        said = itemise(f"`{r['engine']}` {_exponent(r)}" for r in shown)
        text = f"The time of a right-hand side of N windows grows like N^p from {number(shown[0], 'from'):g} on, with p of {said}."
        yield Finding("Growth with size", text)


def _exponent(row: Row) -> str:
    """With its spread, where several processes told one."""
    p, low, high = (f"{number(row, f'exponent{end}'):.2f}" for end in ("", "_low", "_high"))
    return f"{p} ({low}..{high})" if is_known(row.get("exponent_low")) else f"{p} (of one process)"


def section(run: Run) -> Section | None:
    rows, growth = run.table("scaling"), run.table("kernel_growth")
    if not rows:
        return None
    blocks: list[Block] = [Text(SCALING)]
    if drawn := figure_of(rows):
        blocks.append(drawn)
    if growth:
        blocks.append(table_with_title("Growth", ("engine", "asked", "sizes", "exponent", RANGE), 2, growth, grown, last_text=0))
    ordered = sorted(rows, key=lambda r: number(r, "size"))
    head = ("engine", "asked", "windows", "n", "time", RANGE, "error", "generate s", "compile s", "remark")
    blocks.append(table_with_title("Every size", head, 2, ordered, size_of, folded=True))
    return Section("Size", "kernel-size", tuple(blocks))


def grown(row: Row) -> tuple[Cell, ...]:
    p, low, high = (number(row, f"exponent{end}") for end in ("", "_low", "_high"))
    spread = Cell(f"{low:.2f}..{high:.2f}", low) if is_known(low) else Cell("-")
    return (*texts(row, "engine", "quantity"), *counts(row, "sizes"), Cell(f"{p:.2f}", p), spread)


def size_of(row: Row) -> tuple[Cell, ...]:
    times_of = (time_of(row), span(row, "low", "high"), error_cell(row, "error"))
    made = tuple(Cell(f"{number(row, x):.2f}", number(row, x)) if is_known(row.get(x)) else Cell("-") for x in BUILDING)
    return (*texts(row, "engine", "quantity"), *counts(row, "size", "n"), *times_of, *made, remark(row))


def figure_of(rows: Sequence[Row]) -> Chart | None:
    """Time of one right-hand side against the number of windows; nothing without rows."""
    drawn = [row for row in rows if is_known(row.get("seconds")) and number(row, "seconds") > 0]
    if not drawn:
        return None
    shown = [
        {
            "engine": str(r["engine"]),
            "line": f"{r['engine']}, {r['quantity']}",
            "name": f"{r['engine']}, {r['quantity']}",
            "x": number(r, "size"),
            "y": number(r, "seconds"),
        }
        for r in sorted(drawn, key=lambda r: (str(r["engine"]), str(r["quantity"]), number(r, "size")))
    ]
    engines = tuple(dict.fromkeys(str(r["engine"]) for r in shown))
    head = {"name": "engine, and how it is asked", "x": "windows", "y": "time [s]"}
    words = "One right-hand side of a chain of windows; lines of one colour are one engine, asked in several ways."
    spec = points(shown, "windows of the chain", "one right-hand side [s]", 380)
    return Chart("kernel-size-figure", "Time against size", words, spec, tuple(shown), head, engines, engines)
