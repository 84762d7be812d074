"""The native kernel: how fast, how exact and how near the machine's limit it is."""

from collections.abc import Iterator

from gauss_bench.report.content import Finding, count, error, itemise, times
from gauss_bench.report.rows import Row, Run, is_known, number

PLACE = 30
TITLE, ANCHOR = "The native kernel", "kernel"
NOTHING = "The run measured no kernels."
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
MEASURED = (*WORDS, "kernel_claim", "kernel_bounds", "scaling")


def findings(run: Run) -> Iterator[Finding]:
    """List the targets that were missed, and what could not be measured."""
    yield from list_missed(run)
    yield from list_failures(run)


def list_missed(run: Run) -> Iterator[Finding]:
    """Every target that was not reached, or that all were."""
    aimed = [(name, row) for name in WORDS for row in run.table(name) if is_known(row.get("target"))]
    if not aimed:
        return
    off = [(name, row) for name, row in aimed if not row.get("met")]
    if not off:
        text = f"All {count(len(aimed), 'target')} that the authors set for their own compiled kernel are met."
        yield Finding("Targets of the kernel", text, "good")
        return
    said = itemise(f"{WORDS[name]} of {_name(row)}" for name, row in off)
    text = f"**{len(off)} of {count(len(aimed), 'target')} of the compiled kernel are missed**: {said}."
    yield Finding("Targets of the kernel", text, "bad")


def _name(row: Row) -> str:
    words = " ".join(str(row[k]) for k in NAMES if row.get(k) not in ("", "none", None))
    column = next((x for x in VALUES if is_known(row.get(x))), "")
    value = f" ({_short(number(row, column))}, {_short(number(row, 'target'))} wanted)" if column else " (not measured)"
    return words + value


def _short(x: float) -> str:
    return times(x) if 0.01 <= x < 1e6 else error(x)


def list_failures(run: Run) -> Iterator[Finding]:
    """List what could not be measured, but for what is skipped with a reason."""
    lost = [(name, r) for name in MEASURED for r in run.table(name) if r.get("status") not in ("ok", "skip", "", None)]
    if lost:
        said = "; ".join(
            dict.fromkeys(f"{name.removeprefix('kernel_')} {row.get('mechanism', '')}: {row['message']}" for name, row in lost)
        )
        yield Finding("Not measured", f"{count(len(lost), 'measurement')} of the kernel suite failed: {said}.", "bad")
