"""Sentences computed from the rows of the kernel suite: what was found, and first of all which targets were missed."""

from collections.abc import Iterator, Sequence

from gauss_bench.report.content import Finding, count, error, listed, times
from gauss_bench.report.rows import Row, Run, grouped, known, number

AIMED = ("kernel_steps", "kernel_batch", "kernel_rhs", "kernel_agreement", "kernel_long", "kernel_kinematics")
WORDS = {
    "kernel_steps": "a step",
    "kernel_batch": "a batch",
    "kernel_rhs": "a right-hand side",
    "kernel_agreement": "agreement",
    "kernel_long": "a long run",
    "kernel_kinematics": "kinematics",
}
NAMES = ("mechanism", "formulation", "stabilization", "settings", "place", "method")  # what tells rows of a table apart
VALUES = ("ratio", "error", "rate", "velocity_drift")  # what is held against the target, in order of preference
OWN = "gauss-native"
CANNOT = "cannot reach"


def kernel_findings(run: Run) -> Iterator[Finding]:
    """Everything found, misses first."""
    yield from missed(run)
    yield from claim(run)
    yield from steps(run)
    yield from accuracy(run)
    yield from batch(run)
    yield from right_hand_sides(run)
    yield from agreement(run)
    yield from long_runs(run)
    yield from growth(run)
    yield from kinematics(run)
    yield from limits(run)
    yield from failed(run)


def missed(run: Run) -> Iterator[Finding]:
    """Every target that was not reached, or that all were."""
    aimed = [(name, row) for name in AIMED for row in run.kernels.get(name, ()) if known(row.get("target"))]
    if not aimed:
        return
    off = [(name, row) for name, row in aimed if not row.get("met")]
    if not off:
        text = f"All {count(len(aimed), 'target')} that were set for the compiled kernel are met."
        yield Finding("Targets of the kernel", text, "good")
        return
    said = listed(f"{WORDS[name]} of {_named(row)}" for name, row in off)
    text = f"**{len(off)} of {count(len(aimed), 'target')} of the compiled kernel are missed**: {said}."
    yield Finding("Targets of the kernel", text, "bad")


def _named(row: Row) -> str:
    words = " ".join(str(row[k]) for k in NAMES if row.get(k) not in ("", "none", None))
    column = next((x for x in VALUES if known(row.get(x))), "")
    value = f" ({_short(number(row, column))}, {_short(number(row, 'target'))} wanted)" if column else " (not measured)"
    return words + value


def _short(x: float) -> str:
    return times(x) if 0.01 <= x < 1e6 else error(x)


def claim(run: Run) -> Iterator[Finding]:
    """Whether fewer unknowns are faster, compiled."""
    rows = [row for row in run.kernels.get("kernel_claim", ()) if known(row.get("ratio"))]
    if not rows:
        return
    found = grouped(sorted(rows, key=lambda r: number(r, "unknowns_gauss")), lambda r: str(r["verdict"]))
    said = {"holds": "faster on", "open": "level on", "reversed": "slower on"}
    parts = [f"{words} {listed(map(_ratio, found[key]))}" for key, words in said.items() if key in found]
    text = (
        f"Compiled by the same eliminator, n - m unknowns are {'; '.join(parts)} (times that n + m unknowns take, with its spread)."
    )
    whole = set(found) == {"holds"}
    yield Finding(
        "The paper's claim", f"{'Yes' if whole else 'In part' if 'holds' in found else 'No'}. {text}", "" if whole else "warn"
    )


def _ratio(row: Row) -> str:
    x, low, high = (times(number(row, f"ratio{end}")) for end in ("", "_low", "_high"))
    return f"{row['mechanism']} {x} ({low}..{high})"


def steps(run: Run) -> Iterator[Finding]:
    """How many times faster a step is than MuJoCo's, at its fastest setting."""
    rows = [r for r in run.kernels.get("kernel_steps", ()) if r.get("formulation") == "gauss" and known(r.get("ratio"))]
    for stabilization, group in grouped(rows, lambda r: str(r["stabilization"])).items():
        least = [min(some, key=lambda r: number(r, "ratio")) for some in grouped(group, lambda r: str(r["mechanism"])).values()]
        said = listed(f"{r['mechanism']} {times(number(r, 'ratio'))}" for r in least)
        how = "with projection" if stabilization == "projection" else "without stabilisation"
        text = f"A compiled Runge-Kutta step {how} is this many times faster than MuJoCo's at the faster of its settings: {said}."
        yield Finding("A step in its own loop", f"{text} Steps are equal here, accuracy is not.")


def accuracy(run: Run) -> Iterator[Finding]:
    """What other engines' best ways take to the same accuracy."""
    rows = [r for r in run.kernels.get("kernel_accuracy", ()) if known(r.get("accuracy"))]
    for target, group in sorted(grouped(rows, lambda r: number(r, "accuracy")).items(), reverse=True):
        parts = []
        for engine, some in grouped((r for r in group if r["engine"] != OWN), lambda r: str(r["engine"])).items():
            ratios = [number(r, "ratio") for r in some if r["best"] and known(r.get("ratio"))]
            linkages = {r["mechanism"] for r in some if r["status"] in ("ok", CANNOT)}
            without = len(linkages - {r["mechanism"] for r in some if r["best"]})
            cannot = f" and does not reach it on {count(without, 'linkage')}" if without else ""
            if ratios or without:
                parts.append(f"`{engine}` {_range(ratios)}{cannot}" if ratios else f"`{engine}`{cannot.removeprefix(' and')}")
        if parts:
            text = (
                f"To bring the crank within {target:.0e} rad after one second, the best way of other engines takes this multiple "
            )
            text += (
                f"of the compiled kernel's time: {'; '.join(parts)}. Pinocchio is stepped from Python, the others step themselves."
            )
            yield Finding("Equal accuracy", text)


def _range(values: Sequence[float]) -> str:
    low, high = times(min(values)), times(max(values))
    return low if low == high else f"{low} to {high}"


def batch(run: Run) -> Iterator[Finding]:
    rows = [r for r in run.kernels.get("kernel_batch", ()) if known(r.get("ratio"))]
    if rows:
        said = listed(f"{r['mechanism']} {times(number(r, 'ratio'))}" for r in rows)
        off = max(number(r, "lanes_error") for r in rows)
        states = max(int(number(r, "states")) for r in rows)
        text = (
            f"{states} trajectories from different states, on one core, are this many times faster than MuJoCo's rollout: {said}; "
        )
        apart = "nothing" if off == 0 else f"{error(off)} at most"
        yield Finding("Many trajectories", f"{text}lanes and single runs differ by {apart}.")


def right_hand_sides(run: Run) -> Iterator[Finding]:
    """In its own loop, and where it loses: called from Python."""
    rows = [r for r in run.kernels.get("kernel_rhs", ()) if known(r.get("ratio"))]
    inside = [number(r, "ratio") for r in rows if r["own"] == "in its own loop" and r["rival"] == "less the call"]
    called = [r for r in rows if r["own"] == "called from Python" and r["rival"] == "as called"]
    if inside and called:
        slower = sorted({str(r["mechanism"]) for r in called if number(r, "ratio") < 1})
        text = (
            f"Pinocchio's right-hand side, without its call from Python, takes {_range(inside)} times as long as the kernel's in "
        )
        text += (
            f"its own loop. Called from Python for one state, it takes {_range([number(r, 'ratio') for r in called])} times as long"
        )
        yield Finding("One right-hand side", f"{text}{f': there the kernel is slower on {listed(slower)}' if slower else ''}.")


def agreement(run: Run) -> Iterator[Finding]:
    rows = [r for r in run.kernels.get("kernel_agreement", ()) if known(r.get("error"))]
    if rows:
        worst = max(rows, key=lambda r: number(r, "error"))
        text = (
            f"Accelerations of the compiled formulations differ from those in numpy by {error(number(worst, 'error'))} at most, on "
        )
        tone = "good" if all(r.get("met") for r in rows) else "warn"
        yield Finding("The same accelerations", f"{text}{worst['mechanism']} ({worst['formulation']}, {worst['place']}).", tone)


def long_runs(run: Run) -> Iterator[Finding]:
    rows = [r for r in run.kernels.get("kernel_long", ()) if known(r.get("position_drift"))]
    if rows:
        drifts = [max(number(r, f"{x}_drift") for r in rows) for x in ("position", "velocity")]
        orders = [number(r, "order") for r in rows if known(r.get("order"))]
        text = (
            f"Over {number(rows[0], 't_end'):g} s with projection the compiled kernel leaves the constraints by {error(drifts[0])} "
        )
        text += f"in position and {error(drifts[1])} in velocity at most"
        yield Finding("Long runs", f"{text}; its energy error falls with order {_range(orders)}." if orders else f"{text}.")


def growth(run: Run) -> Iterator[Finding]:
    """Exponents of whatever is asked in the way that costs least."""
    rows = run.kernels.get("kernel_growth", ())
    looped = {r["engine"] for r in rows if r["quantity"] == "in its own loop"}
    shown = [r for r in rows if r["quantity"] == "in its own loop" or r["engine"] not in looped]
    if shown:
        said = listed(f"`{r['engine']}` {number(r, 'exponent'):.2f}" for r in shown)
        text = f"The time of a right-hand side of N windows grows like N^p from {number(shown[0], 'from'):g} on, with p of {said}."
        yield Finding("Growth with size", text)


def kinematics(run: Run) -> Iterator[Finding]:
    rows = [r for r in run.kernels.get("kernel_kinematics", ()) if known(r.get("target")) and known(r.get("rate"))]
    if rows:
        said = listed(f"{number(r, 'rate') / 1e6:.1f} million on {r['mechanism']}" for r in rows)
        off = max(number(r, f"{x}_error") for r in rows for x in ("position", "velocity", "acceleration"))
        yield Finding(
            "Kinematics",
            f"Positions with velocities and accelerations per second on one core: {said}; errors {error(off)} at most.",
        )


def limits(run: Run) -> Iterator[Finding]:
    rows = [r for r in run.kernels.get("kernel_bounds", ()) if known(r.get("share"))]
    if rows:
        groups = grouped(rows, lambda r: str(r["quantity"]))
        said = listed(f"{_percent([number(r, 'share') for r in some])} for {what}" for what, some in groups.items())
        yield Finding(
            "What is left to be gained",
            f"Of the speed that latency and the peak rate of this processor allow, the kernel reaches {said}.",
        )


def _percent(values: Sequence[float]) -> str:
    return f"{100 * min(values):.0f} to {100 * max(values):.0f} %"


def failed(run: Run) -> Iterator[Finding]:
    """What could not be measured, but for what is skipped with a reason or cannot reach an accuracy."""
    lost = [
        (name, r) for name, rows in run.kernels.items() for r in rows if r.get("status") not in ("ok", "skip", CANNOT, "", None)
    ]
    lost = [(name, row) for name, row in lost if name != "kernel_ladder"]  # where a step too long for a method is no failure
    if lost:
        said = "; ".join(
            dict.fromkeys(f"{name.removeprefix('kernel_')} {row.get('mechanism', '')}: {row['message']}" for name, row in lost)
        )
        yield Finding("Not measured", f"{count(len(lost), 'measurement')} of the kernel suite failed: {said}.", "bad")
