"""The native kernel: its speed, its accuracy, and its speed relative to the largest that the processor allows.

This file chooses the rows that a reader sees first and computes the findings; `layouts.toml` has the columns of the tables.
"""

from collections.abc import Callable, Iterator, Sequence

from gauss_bench.report.content import Chart, Finding, Section, Text, blocks_of, lay_out, layouts
from gauss_bench.report.rows import Row, Run, group_by, is_known, number, spread, with_number
from gauss_bench.report.site.charts import specify_points
from gauss_bench.report.words import count, error_text, itemise, list_unmeasured, range_text, ratio_text

PLACE = 30
WORDS = {  # table -> name of the measured quantity
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
IN_LOOP, CALLED = ("in its own loop", "less the call"), ("called from Python", "as called")  # values of the columns own and rival
FACTS = ("cpu", "cores", "python", "date", "commit")  # keys of the rows of `kernel_machine` that are printed as a sentence


def section(run: Run) -> Section | None:
    """Return the chapter with a section for each table that the run filled, or None if it filled none."""
    agreement = group_by(run.table("kernel_agreement"), lambda r: (r.get("mechanism"), r.get("formulation")))
    # the rows that a reader sees first; a folded table has the others
    shown = {
        # without MuJoCo's settings as shipped, because the best settings of each engine are compared
        "kernel_steps": [r for r in run.table("kernel_steps") if r.get("settings") != "default"],
        "kernel_rhs": [r for r in run.table("kernel_rhs") if _calls(r) in (IN_LOOP, CALLED) or r["status"] != "ok"],
        # the largest difference for each linkage and formulation
        "kernel_agreement": [max(rows, key=lambda r: number(r, "error")) for rows in agreement.values()],
    }
    parts = [table_section(name, run.table(name), shown.get(name, run.table(name))) for name in WORDS]
    parts.insert(-1, size_section(run))  # dynamics before kinematics, which is the last table
    filled = [part for part in (*parts, limit_section(run)) if part is not None]
    return Section("The native kernel", "kernel", (), filled) if filled else None


def _calls(row: Row) -> tuple[str, str]:
    """Return how the kernel was called and how Pinocchio was called, in the words of a row of `kernel_rhs`."""
    return row.get("own", ""), row.get("rival", "")


def table_section(name: str, rows: Sequence[Row], shown: Sequence[Row]) -> Section | None:
    """Return the section of the table `name`: a table of `shown` and, if `rows` has more, a folded table of `rows`."""
    if not rows:
        return None
    title = layouts()[name]["title"]
    blocks = blocks_of(name, shown)
    if len(shown) < len(rows):
        blocks.append(lay_out(name, rows, f"{title}: all of it", folded=True))
    return Section(title, f"kernel-{title.lower().replace(' ', '-')}", blocks)


def size_section(run: Run) -> Section | None:
    """Return the section on the time of a right-hand side against the size of the linkage, or None if it was not measured."""
    rows = [{**r, "seconds_low": r.get("low"), "seconds_high": r.get("high")} for r in run.table("scaling")]
    if not rows:
        return None
    words, table = blocks_of("scaling", sorted(rows, key=lambda r: number(r, "size")))
    growth = blocks_of("kernel_growth", run.table("kernel_growth"))
    return Section("Size", "kernel-size", (words, *size_charts(rows), *growth, table))


def size_charts(rows: Sequence[Row]) -> list[Chart]:
    """Return a list with the chart of the time of a right-hand side against the size of a chain of windows; empty without times."""
    drawn = []
    for row in sorted(rows, key=lambda r: (r["engine"], r["quantity"], number(r, "size"))):
        name = f"{row['engine']}, {row['quantity']}"
        if number(row, "seconds") > 0:
            drawn.append({"engine": row["engine"], "line": name, "name": name, "x": number(row, "size"), "y": row["seconds"]})
    if not drawn:
        return []
    engines = list(dict.fromkeys(r["engine"] for r in drawn))
    head = {"name": "engine, and how it is called", "x": "windows", "y": "time [s]"}
    words = "Time of a right-hand side of a chain of windows. Lines of one colour are one engine, called in several ways."
    spec = specify_points(drawn, "windows of the chain", "one right-hand side [s]", 380)
    return [Chart("kernel-size-figure", "Time against size", words, spec, drawn, head, engines)]


def limit_section(run: Run) -> Section | None:
    """Return the section that compares the time of compiled steps with the least time that the processor allows."""
    bounds, machine = run.table("kernel_bounds"), run.table("kernel_machine")
    if not bounds:
        return None
    facts = itemise(f"{r['key']} {r['statement']}" for r in machine if r.get("statement") and r["key"] in FACTS)
    words = Text(layouts()["kernel_bounds"]["words"] + (f" Measured on: {facts}." if facts else ""))
    processor = blocks_of("kernel_machine", with_number(machine, "value"))
    return Section("Distance to the machine's limit", "kernel-limits", (words, lay_out("kernel_bounds", bounds), *processor))


def findings(run: Run) -> Iterator[Finding]:
    """Yield findings on missed targets, failed measurements and times of steps, and one on each table that SENTENCES lists."""
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
            text += list_unmeasured(run.table(table), column)
            yield Finding(title, text, tone, behind=(lay_out(table, rows, folded=False),))


def find_missed_targets(run: Run) -> Iterator[Finding]:
    """Yield a finding on the targets that the kernel missed, or on all targets if it met them."""
    lines, missed = [], []
    for table in WORDS:
        for row in with_number(run.table(table), "target"):
            column = next((x for x in VALUES if is_known(row.get(x))), "")  # empty if the value was not measured
            reached, wanted = (_print(row[column]) if column else ""), _print(row["target"])
            lines.append({**row, "what": WORDS[table], "where": _name_row(row), "reached": reached, "wanted": wanted})
            if not row.get("met"):
                outcome = f"{reached}, target {wanted}" if column else "not measured"
                missed.append(f"{WORDS[table]} of {_name_row(row)} ({outcome})")
    behind = [lay_out("behind_targets", sorted(lines, key=lambda line: bool(line.get("met"))))]  # missed targets first
    targets = count(len(lines), "target")
    if missed:
        short = f"{len(missed)} of {targets} of the compiled kernel are missed"
        yield Finding("Targets of the kernel", f"**{short}**: {itemise(missed)}.", "bad", f"{short}.", behind)
    elif lines:
        text = f"All {targets} that the authors set for their own compiled kernel are met."
        yield Finding("Targets of the kernel", text, "good", behind=behind)


def _name_row(row: Row) -> str:
    """Return in words the linkage, formulation and settings to which a row of a table in MEASURED belongs."""
    return " ".join(row[column] for column in NAMES if row.get(column) not in ("", "none", None))


def _print(x: float) -> str:
    """Format a number as a ratio, or as an error if it is too small or too large for a ratio."""
    return ratio_text(x) if 0.01 <= x < 1e6 else error_text(x)


def find_failures(run: Run) -> Iterator[Finding]:
    """Yield a finding on the measurements that failed; skipped ones are left out."""
    lines, reasons = [], []
    for table in MEASURED:
        what = table.removeprefix("kernel_")
        for row in run.table(table):
            if row.get("status") not in ("ok", "skip", "", None):
                lines.append({**row, "what": what, "where": _name_row(row)})
                reasons.append(f"{what} {row.get('mechanism', '')}: {row['message']}")
    if lines:
        short = f"{count(len(lines), 'measurement')} of the kernel suite failed"
        text = f"{short}: {'; '.join(dict.fromkeys(reasons))}."
        yield Finding("Not measured", text, "bad", f"{short}.", (lay_out("behind_failures", lines),))


def find_steps(run: Run) -> Iterator[Finding]:
    """Yield, for each stabilisation, a finding on the time of a compiled step against that of MuJoCo at its fastest setting."""
    steps = [r for r in run.table("kernel_steps") if r.get("formulation") == "gauss"]
    for stabilization, group in group_by(with_number(steps, "ratio"), "stabilization").items():
        least = [min(rows, key=lambda r: number(r, "ratio")) for rows in group_by(group, "mechanism").values()]
        kind = "with projection" if stabilization == "projection" else "without stabilisation"
        start, rival = f"A compiled Runge-Kutta step {kind} is", "times faster than MuJoCo's at the faster of its settings"
        unmeasured = list_unmeasured([r for r in steps if r["stabilization"] == stabilization], "ratio")
        text = f"{start} this many {rival}: {_list_ratios(least)}. Steps are equal here, accuracy is not.{unmeasured}"
        short = f"{start} {range_text([r['ratio'] for r in least])} {rival}; steps are equal here, accuracy is not."
        behind = lay_out("behind_steps", sorted(group, key=lambda r: (r["mechanism"], r["ratio"])))
        yield Finding("A step in its own loop", text, short=short, behind=(behind,))


def _list_ratios(rows: Sequence[Row]) -> str:
    """Return the linkages of rows, each with its ratio, as a list in words."""
    return itemise(f"{r['mechanism']} {ratio_text(r['ratio'])}" for r in rows)


def describe_batch(rows: Sequence[Row]) -> str:
    """Return a sentence that compares the time of a batch of trajectories with that of MuJoCo."""
    largest_difference = max(number(r, "lanes_error") for r in rows)
    states = max(int(r["states"]) for r in rows)
    text = f"{states} trajectories from different states, on one core, are this many times faster than MuJoCo's rollout"
    difference = "nothing" if largest_difference == 0 else f"at most {error_text(largest_difference)}"
    return f"{text}: {_list_ratios(rows)}; lanes and single runs differ by {difference}."


def describe_right_hand_sides(rows: Sequence[Row]) -> str:
    """Return sentences that compare the times of a right-hand side by Pinocchio and by the kernel; empty without both calls."""
    by_call = group_by(rows, _calls)
    if IN_LOOP not in by_call or CALLED not in by_call:
        return ""
    in_loop, called = (range_text([r["ratio"] for r in by_call[call]]) for call in (IN_LOOP, CALLED))
    slower = itemise(sorted({r["mechanism"] for r in by_call[CALLED] if r["ratio"] < 1}))
    exception = f"; the kernel is slower on {slower}" if slower else ""
    return (
        f"Pinocchio's right-hand side, without its call from Python, takes {in_loop} times as long as the kernel's in its own "
        f"loop. Called from Python for one state, it takes {called} times as long{exception}."
    )


def describe_agreement(rows: Sequence[Row]) -> str:
    """Return a sentence on the largest difference from the formulations in numpy."""
    worst = max(rows, key=lambda r: number(r, "error"))
    text = f"Accelerations of the compiled formulations differ from those in numpy by at most {error_text(worst['error'])}"
    return f"{text}, on {worst['mechanism']} ({worst['formulation']}, {worst['place']})."


def describe_long_runs(rows: Sequence[Row]) -> str:
    """Return a sentence on the largest drift of the long runs, and on the order of their energy error."""
    position, velocity = (error_text(max(number(r, f"{x}_drift") for r in rows)) for x in ("position", "velocity"))
    orders = [r["order"] for r in with_number(rows, "order")]
    energy = f"; its energy error falls with order {range_text(orders)}" if orders else ""
    start = f"Over {number(rows[0], 't_end'):g} s with projection the compiled kernel violates the constraints by at most"
    return f"{start} {position} in position and {velocity} in velocity{energy}."


def describe_growth(rows: Sequence[Row]) -> str:
    """Return a sentence on the exponents p, with ranges, of the growth N^p of each engine's time on chains of N windows."""
    # for an engine that has a loop of its own, only times in this loop
    looped = {r["engine"] for r in rows if r["quantity"] == "in its own loop"}
    chosen = [r for r in rows if r["quantity"] == "in its own loop" or r["engine"] not in looped]
    parts = []
    for r in chosen:
        p = spread(r, "exponent")
        exponent = p.print_with("{:.2f}".format) if is_known(p.low) else f"{p.value:.2f} (of one process)"
        parts.append(f"`{r['engine']}` {exponent}")
    start = f"The time of a right-hand side of N windows grows like N^p from {number(chosen[0], 'from'):g} on, with p of"
    return f"{start} {itemise(parts)}."


def describe_kinematics(rows: Sequence[Row]) -> str:
    """Return a sentence on the rates of the compiled kinematics and their largest error; empty if no rate has a target."""
    with_target = with_number(rows, "target")
    if not with_target:
        return ""
    rates = itemise(f"{r['rate']:.3g} on {r['mechanism']}" for r in with_target)
    largest_error = max(number(r, f"{x}_error") for r in with_target for x in ("position", "velocity", "acceleration"))
    text = "On one core the compiled kinematics compute this many positions a second, with velocities and accelerations"
    return f"{text}: {rates}; errors are at most {error_text(largest_error)}."


def describe_limits(rows: Sequence[Row]) -> str:
    """Return a sentence on the share of the processor's possible speed that the kernel reaches."""
    parts = []
    for quantity, group in group_by(rows, "quantity").items():
        shares = [r["share"] for r in group]
        parts.append(f"{100 * min(shares):.0f} to {100 * max(shares):.0f} % for {quantity}")
    return f"Of the speed that latency and the peak rate of this processor allow, the kernel reaches {itemise(parts)}."


# table, column that a row must have, title of the finding, function that makes its text
SENTENCES: tuple[tuple[str, str, str, Callable[[Sequence[Row]], str]], ...] = (
    ("kernel_batch", "ratio", "Many trajectories", describe_batch),
    ("kernel_rhs", "ratio", "One right-hand side", describe_right_hand_sides),
    ("kernel_agreement", "error", "The same accelerations", describe_agreement),
    ("kernel_long", "position_drift", "Long runs", describe_long_runs),
    ("kernel_growth", "exponent", "Growth with size", describe_growth),
    ("kernel_kinematics", "rate", "Kinematics", describe_kinematics),
    ("kernel_bounds", "share", "What is left to be gained", describe_limits),
)
