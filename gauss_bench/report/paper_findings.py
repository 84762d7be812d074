"""Sentences computed from the rows about the papers: each function looks for one thing and returns what it found, or nothing."""

from collections.abc import Iterable, Iterator, Mapping

from gauss_bench.report.content import Finding, count, error, listed
from gauss_bench.report.rows import Row, Run, grouped, number

SAID = {"ok": "right as printed", "misprint": "misprinted", "not given": "left out", "unreadable": "unreadable in our text"}


def paper_findings(run: Run) -> Iterator[Finding]:
    """Everything found about the papers, most general first."""
    yield from statements(run)
    yield from unseen(run)
    yield from never_stops(run)


def causes(rows: Iterable[Row]) -> dict[tuple[str, str], list[Row]]:
    """(paper, cause) -> its lines; lines without a cause are left out."""
    return grouped((row for row in rows if row.get("cause")), lambda row: (str(row["paper"]), str(row["cause"])))


def verdicts(rows: Iterable[Row]) -> str:
    """How many lines came out how, and for how many causes: "3 right as printed, 4 misprinted (2 causes)"."""
    parts = []
    for verdict, group in grouped(rows, lambda row: str(row["verdict"])).items():
        reasons = len(causes(group))
        parts.append(f"{len(group)} {SAID.get(verdict, verdict)}" + (f" ({count(reasons, 'cause')})" if reasons else ""))
    return listed(parts)


def statements(run: Run) -> Iterator[Finding]:
    """How many printed lines hold, for how many causes the others do not, and which are wrong."""
    if not run.audit:
        return
    papers = {row["paper"] for row in run.audit}
    off = [row for row in run.audit if row["verdict"] != "ok"]
    wrong = grouped((row for row in off if row["verdict"] == "wrong"), lambda row: f"{row['equation']} of {row['paper']}")
    fallen = [str(row["name"]) for row in run.audit if not row["stands"]]
    text = f"Of {count(len(run.audit), 'line')} of {count(len(papers), 'paper')} that were computed: {verdicts(run.audit)}."
    text += f" Wrong as statements: {listed(wrong)}." if wrong else ""
    text += f" **The measurement contradicts the verdict on {listed(fallen)}.**" if fallen else ""
    yield Finding("What the papers print", text, "bad" if fallen else "warn" if off else "good")


def unseen(run: Run) -> Iterator[Finding]:
    """The printed formula that meets the constraints and is wrong."""
    rows = {str(row["name"]): row for row in run.audit}
    meets, off = rows.get("meets the constraints"), rows.get("with Moore-Penrose inverses")
    if meets is None or off is None or not (meets["stands"] and off["stands"]):
        return
    printed, true = (number(off, f"example_{key}") for key in ("printed", "true"))
    yield Finding(
        "A printed formula that no residual gives away",
        f"Eq. {off['equation']} of {off['paper']}, read with Moore-Penrose inverses, meets every constraint to "
        f"{error(number(meets, 'printed_off'))} and gives {printed:.4g} for the {off['example']}, where the truth is {true:.4g}.",
        "warn",
    )


def never_stops(run: Run) -> Iterator[Finding]:
    """What becomes of the mechanism that is said to stop."""
    rows = {str(row["key"]): row for row in run.reproduction}
    if "stops" not in rows or rows["stops"]["verdict"] != "refuted":
        return
    low, high = (number(rows[key], "value") for key in ("settles_above", "settles_below"))
    torque, mean = number(rows["torque"], "value"), number(rows["mean"], "value")
    yield Finding(
        "The paper's mechanism never stops",
        f'"{str(rows["stops"]["quantity"]).capitalize()}", says the first paper of its example. With the printed data it settles '
        f"into turning at {mean:.4g} rad/s on average; from the printed start it comes to rest only for torques between "
        f"{low:.4f} and {high:.4f} N m, and {torque:g} N m is printed. {assumed(rows)}",
        "warn",
    )


def assumed(rows: Mapping[str, Row]) -> str:
    """What the example's numbers need that the paper does not give, from the reproduction's rows by key."""
    left_out = (rows[key] for key in ("inertias", "gravity") if key in rows)
    taken = (f"the {row['quantity']} ({str(row['statement']).partition(';')[0]})" for row in left_out)
    return f"The paper does not give {listed(taken)}."
