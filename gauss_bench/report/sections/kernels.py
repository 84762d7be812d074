"""The native kernel: how fast, how exact and how near the machine's limit it is."""

import math
from collections.abc import Sequence

from gauss_bench.report.content import Block, Picture, Section, Text, listed
from gauss_bench.report.kernel_figures import equal_accuracy, scaling
from gauss_bench.report.kernel_lines import (
    RANGE,
    Line,
    agreed,
    asked,
    batched,
    bounded,
    fact,
    grown,
    ran,
    sized,
    solved,
    stepped,
    table,
    turned,
)
from gauss_bench.report.rows import Row, Run, grouped, known, number

STEPS = (
    "A Runge-Kutta step of 1e-4 s in the engine's own loop, forces, springs and guards included, from the scenario's start. "
    "Targets were set before the kernel was built."
)
ACCURACY = (
    "Equal steps are not equal accuracy. Each method takes the largest of the halved steps with which the crank is as near the "
    "certified angle after one second; then all race over that second. Long runs are cut to their first part and scaled. The "
    "multiple is of the kernel's fastest way. Pinocchio has no integrator for closed loops: its steps are the suite's, in Python, "
    "which is most of their time."
)
CAPTION = (
    "Each engine's fastest way of those tried, with its multiple of the kernel's; cannot: none reached it within the time allowed."
)
BATCH = "Per step of one trajectory, on one core; all states differ. Lanes are checked against runs of single trajectories."
RHS = (
    "A state in, its accelerations out. In its own loop: a quarter of the kernel's step. Less the call: without what calling a "
    "function of Pinocchio from Python costs. Called from Python, both mostly wait for Python."
)
AGREEMENT = (
    "Worst relative difference from the same formulation in numpy, at random states and close to where partitions fail; beside it "
    "the difference of two formulations in numpy from each other, which is what rounding leaves."
)
LONG = (
    "Long runs with projection where no energy is lost or gained: largest drift, kinetic energy, and largest error of the energy "
    "in tenths of the run, which grows with time, as Runge-Kutta's does. Order: of that error, from the run at twice the step. The "
    "target is of both drifts, and of an order of 4."
)
SCALING = (
    "Chains of N windows, (n - m) = 1: one right-hand side of the same state. Exponents p of time ~ N^p are least squares of the "
    "logarithms; own kernels in their own loop, engines as called. Errors against the closed form."
)
CAPTION_SCALING = "Exponents p of time ~ windows^p stand at the ends of the lines."
KINEMATICS = "Positions, velocities and accelerations of all links over a turn in 3600 steps; errors against pure geometry."
LIMITS = (
    "A single trajectory cannot be faster than the longest chain of operations through its step, at the measured latency of a "
    "fused multiply-add; a batch not than its operations at the measured peak rate."
)
RATIO, GOAL = ("ratio", "spread"), ("target", "met", "remark")
FACTS = ("cpu", "cores", "python", "date", "commit")


def section(run: Run) -> Section:
    """Everything else that the kernel suite measured."""
    parts = tuple(part for make in PARTS if (part := make(run)) is not None)
    words = () if parts else (Text("The run measured no kernels."),)
    return Section("The native kernel", "kernel", words, parts)


def steps(run: Run) -> Section | None:
    rows = run.kernels.get("kernel_steps", ())
    names, times = ("linkage", "formulation", "stabilization", "MuJoCo"), ("step", RANGE, "MuJoCo's step")
    best = [row for row in rows if row.get("settings") != "default"]
    return _part("A step against MuJoCo", STEPS, rows, (*names, *times, *RATIO, *GOAL), 4, stepped, best)


def accuracy(run: Run) -> Section | None:
    rows = run.kernels.get("kernel_accuracy", ())
    names = ("linkage", "within rad", "engine", "settings", "integrator", "stabilization")
    head = (*names, *("step [s]", "error", "time", "multiple", "spread", "remark"))
    if not rows:
        return None
    blocks: list[Block] = [Text(ACCURACY)]
    if svg := equal_accuracy(rows):
        blocks.append(Picture("kernel_accuracy", svg, "Time to solution at equal accuracy", CAPTION))
    blocks.append(table("Equal accuracy, each engine's best", head, 6, best_of_engines(rows), solved))
    blocks.append(table("Equal accuracy, every way", head, 6, rows, solved, folded=True))
    return Section("Time to solution at equal accuracy", "kernel-accuracy", tuple(blocks))


def best_of_engines(rows: Sequence[Row]) -> list[Row]:
    """Each engine's fastest way to an accuracy; where it has none, the one that came nearest."""

    def key(row: Row) -> tuple[str, float, str]:
        return str(row.get("mechanism", "")), -number(row, "accuracy"), str(row.get("engine", ""))

    def rank(row: Row) -> tuple[bool, float]:
        return not row.get("best"), number(row, "error") if known(row.get("error")) else math.inf

    return [min(group, key=rank) for _, group in sorted(grouped(rows, key).items())]


def batch(run: Run) -> Section | None:
    head = ("linkage", "trajectories", "lanes", "step", RANGE, "MuJoCo's step", *RATIO, "lanes off by", *GOAL)
    return _part("Many trajectories", BATCH, run.kernels.get("kernel_batch", ()), head, 1, batched)


def right_hand_sides(run: Run) -> Section | None:
    rows = run.kernels.get("kernel_rhs", ())
    head = ("linkage", "kernel", "constraintDynamics", "settings", "kernel's", "Pinocchio's", *RATIO, *GOAL)
    alike = (("in its own loop", "less the call"), ("called from Python", "as called"))
    fair = [row for row in rows if (row.get("own"), row.get("rival")) in alike or row.get("status") != "ok"]
    return _part("One right-hand side against Pinocchio", RHS, rows, head, 4, asked, fair)


def agreement(run: Run) -> Section | None:
    rows = run.kernels.get("kernel_agreement", ())
    head = ("linkage", "formulation", "where", "states", "error", "numpy's own", *GOAL)
    worst = [max(group, key=lambda r: number(r, "error")) for group in grouped(rows, _formulated).values()]
    return _part("Agreement with numpy", AGREEMENT, rows, head, 3, agreed, worst)


def _formulated(row: Row) -> tuple[str, str]:
    return str(row.get("mechanism", "")), str(row.get("formulation", ""))


def long_runs(run: Run) -> Section | None:
    drifts, energies = ("position drift", "velocity drift"), ("energy [J]", "error, first tenth", "last tenth", "largest", "order")
    head = ("linkage", "formulation", "step [s]", "until s", *drifts, *energies, *GOAL)
    return _part("Long runs", LONG, run.kernels.get("kernel_long", ()), head, 2, ran)


def sizes(run: Run) -> Section | None:
    rows, growth = run.kernels.get("scaling", ()), run.kernels.get("kernel_growth", ())
    if not rows:
        return None
    blocks: list[Block] = [Text(SCALING)]
    if svg := scaling(rows, growth):
        blocks.append(Picture("kernel_scaling", svg, "Time of a right-hand side against size", CAPTION_SCALING))
    if growth:
        blocks.append(table("Growth", ("engine", "asked", "sizes", "exponent"), 2, growth, grown, last_text=0))
    ordered = sorted(rows, key=lambda r: number(r, "size"))
    head = ("engine", "asked", "windows", "n", "time", RANGE, "error", "generate s", "compile s", "remark")
    blocks.append(table("Every size", head, 2, ordered, sized, folded=True))
    return Section("Size", "kernel-size", tuple(blocks))


def kinematics(run: Run) -> Section | None:
    head = ("linkage", "way", "per second", RANGE, "position", "velocity", "acceleration", *GOAL)
    return _part("Compiled kinematics", KINEMATICS, run.kernels.get("kernel_kinematics", ()), head, 2, turned)


def limits(run: Run) -> Section | None:
    rows, machine = run.kernels.get("kernel_bounds", ()), run.kernels.get("kernel_machine", ())
    if not rows:
        return None
    facts = listed(f"{r['key']} {r['statement']}" for r in machine if r.get("statement") and r["key"] in FACTS)
    said = f"{LIMITS} Measured on: {facts}." if facts else LIMITS
    head = ("linkage", "what", "chain [cycles]", "flops", "least time", "measured", "share", "remark")
    blocks: list[Block] = [Text(said), table("Share of the machine's limit", head, 2, rows, bounded)]
    if quantities := [r for r in machine if known(r.get("value"))]:
        blocks.append(table("The processor", ("quantity", "value", RANGE, "unit"), 1, quantities, fact))
    return Section("Distance to the machine's limit", "kernel-limits", tuple(blocks))


PARTS = (steps, accuracy, batch, right_hand_sides, agreement, long_runs, sizes, kinematics, limits)


def _part(
    title: str, words: str, rows: Sequence[Row], head: tuple[str, ...], first: int, line: Line, shown: Sequence[Row] | None = None
) -> Section | None:
    """A section of a table; where only some rows are `shown`, another one, folded, has all of them."""
    if not rows:
        return None
    blocks: list[Block] = [Text(words), table(title, head, first, rows if shown is None else shown, line)]
    if shown is not None and len(shown) < len(rows):
        blocks.append(table(f"{title}: all of it", head, first, rows, line, folded=True))
    return Section(title, f"kernel-{title.lower().replace(' ', '-')}", tuple(blocks))
