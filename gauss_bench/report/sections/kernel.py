"""The native kernel: its speed, its accuracy, and its distance from the limit of the machine.

`layouts.toml` lays out the tables; this file chooses the rows that are shown first, and computes the findings.
"""

from collections.abc import Callable, Iterator, Sequence

from gauss_bench.report.content import (
    Chart,
    Finding,
    Section,
    Text,
    blocks_of,
    count,
    error,
    itemise,
    lay_out,
    layouts,
    list_unmeasured,
    part,
    run_of_numbers,
    times,
)
from gauss_bench.report.rows import Row, Run, group_rows, is_known, number
from gauss_bench.report.site.charts import points

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
TABLES = (*WORDS, "kernel_energy", "scaling", "kernel_growth", "kernel_bounds", "kernel_machine")
NAMES = ("mechanism", "formulation", "stabilization", "settings", "place", "method")  # columns that identify a row
VALUES = ("ratio", "error", "rate", "velocity_drift")  # columns that may have a target, in order of preference
ASKED_ALIKE = (("in its own loop", "less the call"), ("called from Python", "as called"))
FACTS = ("cpu", "cores", "python", "date", "commit")


def section(run: Run) -> Section | None:
    """Return the chapter, with a section for each table that the run filled."""
    agreement = group_rows(run.table("kernel_agreement"), lambda r: (r.get("mechanism"), r.get("formulation")))
    shown = {
        "kernel_steps": [r for r in run.table("kernel_steps") if r.get("settings") != "default"],
        "kernel_rhs": [r for r in run.table("kernel_rhs") if (r.get("own"), r.get("rival")) in ASKED_ALIKE or r["status"] != "ok"],
        "kernel_agreement": [max(some, key=lambda r: number(r, "error")) for some in agreement.values()],
    }
    parts = [part(name, run.table(name), shown.get(name)) for name in WORDS]
    parts[-1:-1] = [size(run)]
    found = tuple(x for x in (*parts, limits(run)) if x is not None)
    return Section("The native kernel", "kernel", (), found) if found else None


def size(run: Run) -> Section | None:
    """Return the section on the time of a right-hand side against the number of loops."""
    rows = [r | {"seconds_low": r.get("low"), "seconds_high": r.get("high")} for r in map(dict, run.table("scaling"))]
    if not rows:
        return None
    words, table = blocks_of("scaling", sorted(rows, key=lambda r: number(r, "size")))
    drawn = [x for x in [figure_of(rows)] if x is not None]
    return Section("Size", "kernel-size", (words, *drawn, *blocks_of("kernel_growth", run.table("kernel_growth")), table))


def figure_of(rows: Sequence[Row]) -> Chart | None:
    """Return the chart of the time of one right-hand side against the number of windows; None without rows."""
    drawn = [r for r in rows if number(r, "seconds") > 0]
    shown = []
    for r in sorted(drawn, key=lambda r: (str(r["engine"]), str(r["quantity"]), number(r, "size"))):
        name = f"{r['engine']}, {r['quantity']}"
        shown.append({"engine": str(r["engine"]), "line": name, "name": name, "x": number(r, "size"), "y": number(r, "seconds")})
    engines = tuple(dict.fromkeys(str(r["engine"]) for r in shown))
    head = {"name": "engine, and how it is asked", "x": "windows", "y": "time [s]"}
    words = "One right-hand side of a chain of windows; lines of one colour are one engine, asked in several ways."
    spec = points(shown, "windows of the chain", "one right-hand side [s]", 380)
    chart = Chart("kernel-size-figure", "Time against size", words, spec, tuple(shown), head, engines, engines)
    return chart if shown else None


def limits(run: Run) -> Section | None:
    """Return the section on the distance of compiled steps from the limits of the processor."""
    machine = run.table("kernel_machine")
    if not run.table("kernel_bounds"):
        return None
    facts = itemise(f"{r['key']} {r['statement']}" for r in machine if r.get("statement") and r["key"] in FACTS)
    said = Text(layouts()["kernel_bounds"]["words"] + (f" Measured on: {facts}." if facts else ""))
    processor = blocks_of("kernel_machine", [r for r in machine if is_known(r.get("value"))])
    blocks = (said, lay_out("kernel_bounds", run.table("kernel_bounds")), *processor)
    return Section("Distance to the machine's limit", "kernel-limits", blocks)


def findings(run: Run) -> Iterator[Finding]:
    """Yield the missed targets, the failed measurements, and a sentence on each table."""
    yield from list_missed(run)
    yield from list_failures(run)
    yield from say_steps(run)
    for table, column, title, say in SAID:
        rows = [r for r in run.table(table) if is_known(r.get(column))]
        text = say(rows) if rows else ""
        if text:
            fine = table == "kernel_agreement" and all(r.get("met") for r in rows)
            tone = "" if table != "kernel_agreement" else "good" if fine else "warn"
            yield Finding(title, f"{text}{list_unmeasured(run.table(table), column)}", tone)


def list_missed(run: Run) -> Iterator[Finding]:
    """Yield the targets that were missed, or that all were met."""
    aimed = [(name, row) for name in WORDS for row in run.table(name) if is_known(row.get("target"))]
    off = [f"{WORDS[name]} of {_name(row)}" for name, row in aimed if not row.get("met")]
    if off:
        text = f"**{len(off)} of {count(len(aimed), 'target')} of the compiled kernel are missed**: {itemise(off)}."
        yield Finding("Targets of the kernel", text, "bad")
    elif aimed:
        text = f"All {count(len(aimed), 'target')} that the authors set for their own compiled kernel are met."
        yield Finding("Targets of the kernel", text, "good")


def _name(row: Row) -> str:
    words = " ".join(str(row[k]) for k in NAMES if row.get(k) not in ("", "none", None))
    column = next((x for x in VALUES if is_known(row.get(x))), "")
    return (
        f"{words} ({_short(number(row, column))}, {_short(number(row, 'target'))} wanted)" if column else f"{words} (not measured)"
    )


def _short(x: float) -> str:
    return times(x) if 0.01 <= x < 1e6 else error(x)


def list_failures(run: Run) -> Iterator[Finding]:
    """Yield the measurements that failed; those skipped with a reason are left out."""
    lost = [(name, r) for name in MEASURED for r in run.table(name) if r.get("status") not in ("ok", "skip", "", None)]
    said = dict.fromkeys(f"{name.removeprefix('kernel_')} {row.get('mechanism', '')}: {row['message']}" for name, row in lost)
    if lost:
        yield Finding("Not measured", f"{count(len(lost), 'measurement')} of the kernel suite failed: {'; '.join(said)}.", "bad")


def say_steps(run: Run) -> Iterator[Finding]:
    """Yield how many times faster a step is than MuJoCo's at its fastest setting."""
    asked = [r for r in run.table("kernel_steps") if r.get("formulation") == "gauss"]
    rows = [r for r in asked if is_known(r.get("ratio"))]
    for stabilization, group in group_rows(rows, lambda r: str(r["stabilization"])).items():
        least = [min(some, key=lambda r: number(r, "ratio")) for some in group_rows(group, lambda r: str(r["mechanism"])).values()]
        said = itemise(f"{r['mechanism']} {times(number(r, 'ratio'))}" for r in least)
        how = "with projection" if stabilization == "projection" else "without stabilisation"
        text = f"A compiled Runge-Kutta step {how} is this many times faster than MuJoCo's at the faster of its settings: {said}."
        rest = list_unmeasured([r for r in asked if r["stabilization"] == stabilization], "ratio")
        yield Finding("A step in its own loop", f"{text} Steps are equal here, accuracy is not.{rest}")


def say_batch(rows: Sequence[Row]) -> str:
    said = itemise(f"{r['mechanism']} {times(number(r, 'ratio'))}" for r in rows)
    off = max(number(r, "lanes_error") for r in rows)
    states = max(int(number(r, "states")) for r in rows)
    text = f"{states} trajectories from different states, on one core, are this many times faster than MuJoCo's rollout: {said}; "
    return f"{text}lanes and single runs differ by {'nothing' if off == 0 else f'{error(off)} at most'}."


def say_right_hand_sides(rows: Sequence[Row]) -> str:
    """Compare right-hand sides with Pinocchio's: in its own loop, and called from Python."""
    inside, called = ([r for r in rows if (r["own"], r["rival"]) == alike] for alike in ASKED_ALIKE)
    if not inside or not called:
        return ""
    slower = sorted({str(r["mechanism"]) for r in called if number(r, "ratio") < 1})
    inner, outer = (run_of_numbers([number(r, "ratio") for r in some]) for some in (inside, called))
    return (
        f"Pinocchio's right-hand side, without its call from Python, takes {inner} times as long as the kernel's in its own loop. "
        f"Called from Python for one state, it takes {outer} times as long"
        f"{f': there the kernel is slower on {itemise(slower)}' if slower else ''}."
    )


def say_agreement(rows: Sequence[Row]) -> str:
    worst = max(rows, key=lambda r: number(r, "error"))
    text = f"Accelerations of the compiled formulations differ from those in numpy by {error(number(worst, 'error'))} at most, on "
    return f"{text}{worst['mechanism']} ({worst['formulation']}, {worst['place']})."


def say_long_runs(rows: Sequence[Row]) -> str:
    place, speed = (error(max(number(r, f"{x}_drift") for r in rows)) for x in ("position", "velocity"))
    orders = [number(r, "order") for r in rows if is_known(r.get("order"))]
    energy = f"; its energy error falls with order {run_of_numbers(orders)}" if orders else ""
    start = f"Over {number(rows[0], 't_end'):g} s with projection the compiled kernel leaves the constraints by"
    return f"{start} {place} in position and {speed} in velocity at most{energy}."


def say_growth(rows: Sequence[Row]) -> str:
    """Return the exponents of growth with size, in the engine's own loop if it has one, with their spread over processes."""
    stepping = {r["engine"] for r in rows if r["quantity"] == "in its own loop"}
    shown = [r for r in rows if r["quantity"] == "in its own loop" or r["engine"] not in stepping]
    said = []
    for r in shown:
        p, low, high = (f"{number(r, f'exponent{end}'):.2f}" for end in ("", "_low", "_high"))
        spread = f"{low}..{high}" if is_known(r.get("exponent_low")) else "of one process"
        said.append(f"`{r['engine']}` {p} ({spread})")
    start = f"The time of a right-hand side of N windows grows like N^p from {number(shown[0], 'from'):g} on, with p of"
    return f"{start} {itemise(said)}."


def say_turns(rows: Sequence[Row]) -> str:
    aimed = [r for r in rows if is_known(r.get("target"))]
    said = itemise(f"{number(r, 'rate') / 1e6:.1f} million on {r['mechanism']}" for r in aimed)
    off = max((number(r, f"{x}_error") for r in aimed for x in ("position", "velocity", "acceleration")), default=0.0)
    text = f"Positions with velocities and accelerations per second on one core: {said}; errors {error(off)} at most."
    return text if aimed else ""


def say_limits(rows: Sequence[Row]) -> str:
    groups = group_rows(rows, lambda r: str(r["quantity"]))
    said = itemise(f"{_percent([number(r, 'share') for r in some])} for {what}" for what, some in groups.items())
    return f"Of the speed that latency and the peak rate of this processor allow, the kernel reaches {said}."


def _percent(values: Sequence[float]) -> str:
    return f"{100 * min(values):.0f} to {100 * max(values):.0f} %"


SAID: tuple[tuple[str, str, str, Callable[[Sequence[Row]], str]], ...] = (
    ("kernel_batch", "ratio", "Many trajectories", say_batch),
    ("kernel_rhs", "ratio", "One right-hand side", say_right_hand_sides),
    ("kernel_agreement", "error", "The same accelerations", say_agreement),
    ("kernel_long", "position_drift", "Long runs", say_long_runs),
    ("kernel_growth", "exponent", "Growth with size", say_growth),
    ("kernel_kinematics", "rate", "Kinematics", say_turns),
    ("kernel_bounds", "share", "What is left to be gained", say_limits),
)
