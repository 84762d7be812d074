"""The native kernel: its speed, its accuracy, and its distance from the limit of the machine.

`layouts.toml` lays out the tables; this file chooses the rows that are shown first, and computes the findings.
"""

from collections.abc import Callable, Iterator, Sequence

from gauss_bench.report.content import Chart, Finding, Section, Table, Text, blocks_of, lay_out, layouts
from gauss_bench.report.rows import Row, Run, group_by, is_known, number, spread, with_number
from gauss_bench.report.site.charts import points
from gauss_bench.report.words import count, error_text, itemise, list_unmeasured, range_text, ratio_text

PLACE = 30
WORDS = {
    "kernel_steps": "a step",
    "kernel_batch": "a batch",
    "kernel_rhs": "a right-hand side",
    "kernel_agreement": "agreement",
    "kernel_long": "a long run",
    "kernel_kinematics": "kinematics",
}
MEASURED = (*WORDS, "kernel_claim", "kernel_bounds", "scaling")
NAMES = ("mechanism", "formulation", "stabilization", "settings", "place", "method")  # columns that identify a row
VALUES = ("ratio", "error", "rate", "velocity_drift")  # columns that may have a target, in order of preference
IN_LOOP, CALLED = ("in its own loop", "less the call"), ("called from Python", "as called")  # how kernel and Pinocchio are called
FACTS = ("cpu", "cores", "python", "date", "commit")


def section(run: Run) -> Section | None:
    """Return the chapter, with a section for each table that the run filled."""
    agreement = group_by(run.table("kernel_agreement"), lambda r: (r.get("mechanism"), r.get("formulation")))
    shown = {
        # rivals as they are shipped stand in the tables of costs; here each is at its best
        "kernel_steps": [r for r in run.table("kernel_steps") if r.get("settings") != "default"],
        "kernel_rhs": [r for r in run.table("kernel_rhs") if _asked(r) in (IN_LOOP, CALLED) or r["status"] != "ok"],
        "kernel_agreement": [max(some, key=lambda r: number(r, "error")) for some in agreement.values()],
    }
    parts = [table_section(name, run.table(name), shown.get(name)) for name in WORDS]
    parts.insert(-1, size_section(run))  # the last table is what else was measured, and stays last
    filled = [x for x in (*parts, limit_section(run)) if x is not None]
    return Section("The native kernel", "kernel", (), filled) if filled else None


def _asked(row: Row) -> tuple[str, str]:
    """Return how the kernel and its rival were asked for a right-hand side."""
    return row.get("own", ""), row.get("rival", "")


def table_section(name: str, rows: Sequence[Row], shown: Sequence[Row] | None = None) -> Section | None:
    """Return a section with one table; if only some rows are `shown`, a folded second table has all of them."""
    if not rows:
        return None
    title = layouts()[name]["title"]
    blocks = blocks_of(name, rows if shown is None else shown)
    if shown is not None and len(shown) < len(rows):
        blocks.append(lay_out(name, rows, f"{title}: all of it", folded=True))
    return Section(title, f"kernel-{title.lower().replace(' ', '-')}", blocks)


def size_section(run: Run) -> Section | None:
    """Return the section on the time of a right-hand side against the number of loops."""
    rows = [{**r, "seconds_low": r.get("low"), "seconds_high": r.get("high")} for r in run.table("scaling")]
    if not rows:
        return None
    words, table = blocks_of("scaling", sorted(rows, key=lambda r: number(r, "size")))
    growth = blocks_of("kernel_growth", run.table("kernel_growth"))
    return Section("Size", "kernel-size", (words, *size_charts(rows), *growth, table))


def size_charts(rows: Sequence[Row]) -> list[Chart]:
    """Return the chart of the time of one right-hand side against the number of windows; none without times."""
    shown = []
    for r in sorted(rows, key=lambda r: (r["engine"], r["quantity"], number(r, "size"))):
        name = f"{r['engine']}, {r['quantity']}"
        if number(r, "seconds") > 0:
            shown.append({"engine": r["engine"], "line": name, "name": name, "x": number(r, "size"), "y": r["seconds"]})
    if not shown:
        return []
    engines = list(dict.fromkeys(r["engine"] for r in shown))
    head = {"name": "engine, and how it is asked", "x": "windows", "y": "time [s]"}
    words = "One right-hand side of a chain of windows; lines of one colour are one engine, asked in several ways."
    spec = points(shown, "windows of the chain", "one right-hand side [s]", 380)
    return [Chart("kernel-size-figure", "Time against size", words, spec, shown, head, engines, engines)]


def limit_section(run: Run) -> Section | None:
    """Return the section on the distance of compiled steps from the limits of the processor."""
    bounds, machine = run.table("kernel_bounds"), run.table("kernel_machine")
    if not bounds:
        return None
    facts = itemise(f"{r['key']} {r['statement']}" for r in machine if r.get("statement") and r["key"] in FACTS)
    words = Text(layouts()["kernel_bounds"]["words"] + (f" Measured on: {facts}." if facts else ""))
    processor = blocks_of("kernel_machine", with_number(machine, "value"))
    return Section("Distance to the machine's limit", "kernel-limits", (words, lay_out("kernel_bounds", bounds), *processor))


def findings(run: Run) -> Iterator[Finding]:
    """Yield the missed targets, the failed measurements, and a sentence on each table."""
    yield from find_missed_targets(run)
    yield from find_failures(run)
    yield from find_steps(run)
    for table, column, title, describe in SENTENCES:
        rows = with_number(run.table(table), column)
        text = describe(rows) if rows else ""
        if text:
            tone = ""
            if table == "kernel_agreement":
                tone = "good" if all(r.get("met") for r in rows) else "warn"
            short = IN_SHORT[table](rows) if table in IN_SHORT else ""
            whole = f"{text}{list_unmeasured(run.table(table), column)}"
            yield Finding(title, whole, tone, short, (lay_out(table, rows, folded=False),))


def find_missed_targets(run: Run) -> Iterator[Finding]:
    """Yield the targets that were missed, or that all were met."""
    aimed = [(name, row) for name in WORDS for row in with_number(run.table(name), "target")]
    off = [f"{WORDS[name]} of {_name_miss(row)}" for name, row in aimed if not row.get("met")]
    targets = count(len(aimed), "target")
    behind = [list_targets(aimed)]
    if off:
        text = f"**{len(off)} of {targets} of the compiled kernel are missed**: {itemise(off)}."
        short = f"{len(off)} of {targets} of the compiled kernel are missed."
        yield Finding("Targets of the kernel", text, "bad", short, behind)
    elif aimed:
        text = f"All {targets} that the authors set for their own compiled kernel are met."
        yield Finding("Targets of the kernel", text, "good", behind=behind)


def list_targets(aimed: Sequence[tuple[str, Row]]) -> Table:
    """Return the table of (name of a table, row with a target), missed targets first."""
    lines = []
    for name, row in sorted(aimed, key=lambda x: bool(x[1].get("met"))):
        column = _valued_column(row)
        reached = _print(row[column]) if column else ""
        lines.append({**row, "what": WORDS[name], "where": _name_row(row), "reached": reached, "wanted": _print(row["target"])})
    return lay_out("behind_targets", lines)


def _name_row(row: Row) -> str:
    """Return linkage, formulation and settings of a row."""
    return " ".join(row[k] for k in NAMES if row.get(k) not in ("", "none", None))


def _valued_column(row: Row) -> str:
    """Return the column of a row's value that may have a target; empty if it was not measured."""
    return next((x for x in VALUES if is_known(row.get(x))), "")


def _name_miss(row: Row) -> str:
    """Return a row in words, with the value that it has and the one that it should have."""
    words, column = _name_row(row), _valued_column(row)
    return f"{words} ({_print(row[column])}, {_print(row['target'])} wanted)" if column else f"{words} (not measured)"


def _print(x: float) -> str:
    """Format a ratio, or a number that is too small or large for one as an error."""
    return ratio_text(x) if 0.01 <= x < 1e6 else error_text(x)


def find_failures(run: Run) -> Iterator[Finding]:
    """Yield the measurements that failed; those skipped with a reason are left out."""
    failed = [(name, r) for name in MEASURED for r in run.table(name) if r.get("status") not in ("ok", "skip", "", None)]
    listed = dict.fromkeys(f"{name.removeprefix('kernel_')} {row.get('mechanism', '')}: {row['message']}" for name, row in failed)
    if failed:
        text = f"{count(len(failed), 'measurement')} of the kernel suite failed: {'; '.join(listed)}."
        lines = [{**row, "what": name.removeprefix("kernel_"), "where": _name_row(row)} for name, row in failed]
        short = f"{count(len(failed), 'measurement')} of the kernel suite failed."
        yield Finding("Not measured", text, "bad", short, (lay_out("behind_failures", lines),))


def find_steps(run: Run) -> Iterator[Finding]:
    """Yield how many times faster a step is than MuJoCo's at its fastest setting."""
    asked = [r for r in run.table("kernel_steps") if r.get("formulation") == "gauss"]
    for stabilization, group in group_by(with_number(asked, "ratio"), "stabilization").items():
        least = [min(some, key=lambda r: number(r, "ratio")) for some in group_by(group, "mechanism").values()]
        how = "with projection" if stabilization == "projection" else "without stabilisation"
        text = f"A compiled Runge-Kutta step {how} is this many times faster than MuJoCo's at the faster of its settings"
        rest = list_unmeasured([r for r in asked if r["stabilization"] == stabilization], "ratio")
        short = (
            f"A compiled Runge-Kutta step {how} is {range_text([r['ratio'] for r in least])} times faster than MuJoCo's at the "
            "faster of its settings; steps are equal here, accuracy is not."
        )
        yield Finding(
            "A step in its own loop",
            f"{text}: {_list_ratios(least)}. Steps are equal here, accuracy is not.{rest}",
            short=short,
            behind=(lay_out("behind_steps", sorted(group, key=lambda r: (r["mechanism"], r["ratio"]))),),
        )


def _list_ratios(rows: Sequence[Row]) -> str:
    """Return each linkage with its ratio."""
    return itemise(f"{r['mechanism']} {ratio_text(r['ratio'])}" for r in rows)


def describe_batch(rows: Sequence[Row]) -> str:
    """Return how many times faster a batch is than MuJoCo's, and by how much its lanes differ from single runs."""
    off = max(number(r, "lanes_error") for r in rows)
    states = max(int(r["states"]) for r in rows)
    text = f"{states} trajectories from different states, on one core, are this many times faster than MuJoCo's rollout"
    difference = "nothing" if off == 0 else f"{error_text(off)} at most"
    return f"{text}: {_list_ratios(rows)}; lanes and single runs differ by {difference}."


def describe_right_hand_sides(rows: Sequence[Row]) -> str:
    """Compare right-hand sides with Pinocchio's: in its own loop, and called from Python."""
    ways = group_by(rows, _asked)
    if IN_LOOP not in ways or CALLED not in ways:
        return ""
    inner, outer = (range_text([r["ratio"] for r in ways[x]]) for x in (IN_LOOP, CALLED))
    slower = itemise(sorted({r["mechanism"] for r in ways[CALLED] if r["ratio"] < 1}))
    return (
        f"Pinocchio's right-hand side, without its call from Python, takes {inner} times as long as the kernel's in its own loop. "
        f"Called from Python for one state, it takes {outer} times as long"
        f"{f': there the kernel is slower on {slower}' if slower else ''}."
    )


def describe_agreement(rows: Sequence[Row]) -> str:
    """Return the largest difference from the formulations in numpy, and where it occurs."""
    worst = max(rows, key=lambda r: number(r, "error"))
    text = f"Accelerations of the compiled formulations differ from those in numpy by {error_text(worst['error'])} at most, on "
    return f"{text}{worst['mechanism']} ({worst['formulation']}, {worst['place']})."


def describe_long_runs(rows: Sequence[Row]) -> str:
    """Return the largest drift of the long runs, and the order of their energy error."""
    position, velocity = (error_text(max(number(r, f"{x}_drift") for r in rows)) for x in ("position", "velocity"))
    orders = [r["order"] for r in with_number(rows, "order")]
    energy = f"; its energy error falls with order {range_text(orders)}" if orders else ""
    start = f"Over {number(rows[0], 't_end'):g} s with projection the compiled kernel leaves the constraints by"
    return f"{start} {position} in position and {velocity} in velocity at most{energy}."


def describe_growth(rows: Sequence[Row]) -> str:
    """Return the exponents of growth with size, in the engine's own loop if it has one, with their spread over processes."""
    looped = {r["engine"] for r in rows if r["quantity"] == "in its own loop"}
    shown = [r for r in rows if r["quantity"] == "in its own loop" or r["engine"] not in looped]
    parts = []
    for r in shown:
        p = spread(r, "exponent")
        exponent = p.print_with("{:.2f}".format) if is_known(p.low) else f"{p.value:.2f} (of one process)"
        parts.append(f"`{r['engine']}` {exponent}")
    start = f"The time of a right-hand side of N windows grows like N^p from {number(shown[0], 'from'):g} on, with p of"
    return f"{start} {itemise(parts)}."


def describe_exponents(rows: Sequence[Row]) -> str:
    """Return the range of the exponents of growth in one sentence."""
    exponents = [r["exponent"] for r in rows]
    return f"The time of a right-hand side of N windows grows like N^p, with p of {range_text(exponents, '{:.2f}'.format)}."


def describe_kinematics(rows: Sequence[Row]) -> str:
    """Return how many positions a second the compiled kinematics compute, and their largest error."""
    aimed = with_number(rows, "target")
    rates = itemise(f"{r['rate'] / 1e6:.1f} million on {r['mechanism']}" for r in aimed)
    off = max((number(r, f"{x}_error") for r in aimed for x in ("position", "velocity", "acceleration")), default=0.0)
    text = f"Positions with velocities and accelerations per second on one core: {rates}; errors {error_text(off)} at most."
    return text if aimed else ""


def describe_rates(rows: Sequence[Row]) -> str:
    """Return the rates of the compiled kinematics in one sentence, with the digits of their table."""
    rates = itemise(f"{r['rate']:.3g} on {r['mechanism']}" for r in with_number(rows, "target"))
    return f"On one core the compiled kinematics compute this many positions a second, with velocities and accelerations: {rates}."


def describe_limits(rows: Sequence[Row]) -> str:
    """Return which share of the processor's possible speed the kernel reaches."""
    groups = group_by(rows, "quantity")
    shares = itemise(f"{_percent([r['share'] for r in some])} for {what}" for what, some in groups.items())
    return f"Of the speed that latency and the peak rate of this processor allow, the kernel reaches {shares}."


def _percent(values: Sequence[float]) -> str:
    """Format the range of some shares in per cent."""
    return f"{100 * min(values):.0f} to {100 * max(values):.0f} %"


SENTENCES: tuple[tuple[str, str, str, Callable[[Sequence[Row]], str]], ...] = (  # table, column, title, sentence
    ("kernel_batch", "ratio", "Many trajectories", describe_batch),
    ("kernel_rhs", "ratio", "One right-hand side", describe_right_hand_sides),
    ("kernel_agreement", "error", "The same accelerations", describe_agreement),
    ("kernel_long", "position_drift", "Long runs", describe_long_runs),
    ("kernel_growth", "exponent", "Growth with size", describe_growth),
    ("kernel_kinematics", "rate", "Kinematics", describe_kinematics),
    ("kernel_bounds", "share", "What is left to be gained", describe_limits),
)
IN_SHORT: dict[str, Callable[[Sequence[Row]], str]] = {"kernel_growth": describe_exponents, "kernel_kinematics": describe_rates}
