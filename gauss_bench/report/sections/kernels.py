"""The native kernel: how fast, how exact and how near the machine's limit it is."""

import math
from collections.abc import Sequence

from gauss_bench.report.kernel_figures import equal_accuracy, scaling
from gauss_bench.report.kernel_lines import (
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
from gauss_bench.report.rows import Row, Run, known, number
from gauss_bench.report.tables import Block, Picture, Section, Text, listed

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
    "Long runs with projection where no energy is lost or gained. Order: of the energy's error, from the run at twice the step; it "
    "grows with time, as Runge-Kutta's does."
)
SCALING = (
    "Chains of N windows, (n - m) = 1: one right-hand side of the same state. Exponents p of time ~ N^p are least squares of the "
    "logarithms; own kernels in their own loop, engines as called. Errors against the closed form."
)
CAPTION_SCALING = "The exponent of an engine that is asked in two ways is that of its own loop."
KINEMATICS = "Positions, velocities and accelerations of all links over a turn in 3600 steps; errors against pure geometry."
LIMITS = (
    "A single trajectory cannot be faster than the longest chain of operations through its step, at the measured latency of a "
    "fused multiply-add; a batch not than its operations at the measured peak rate."
)


def section(run: Run) -> Section:
    """Everything else that the kernel suite measured."""
    parts = tuple(part for make in PARTS if (part := make(run)) is not None)
    words = () if parts else (Text("The run measured no kernels."),)
    return Section("The native kernel", "kernel", words, parts)


def steps(run: Run) -> Section | None:
    rows = run.kernels.get("kernel_steps", ())
    head = (
        "linkage",
        "formulation",
        "stabilization",
        "MuJoCo",
        "step",
        "5..95 %",
        "MuJoCo's step",
        "ratio",
        "spread",
        "target",
        "met",
    )
    return _part("A step against MuJoCo", STEPS, rows, head, 4, stepped)


def accuracy(run: Run) -> Section | None:
    rows = run.kernels.get("kernel_accuracy", ())
    if not rows:
        return None
    head = (
        "linkage",
        "within rad",
        "engine",
        "settings",
        "integrator",
        "stabilization",
        "step [s]",
        "error",
        "time",
        "multiple",
        "spread",
    )
    shown = [r for r in rows if r["best"]]
    names = {(r["mechanism"], number(r, "accuracy"), r["engine"]) for r in shown}
    nearest = sorted(rows, key=lambda r: -number(r, "error") if known(r.get("error")) else -math.inf)
    without = {(r["mechanism"], number(r, "accuracy"), r["engine"]): r for r in nearest}
    shown += [r for key, r in without.items() if key not in names]
    ordered = sorted(shown, key=lambda r: (str(r["mechanism"]), -number(r, "accuracy"), str(r["engine"])))
    blocks: list[Block] = [Text(ACCURACY)]
    if svg := equal_accuracy(rows):
        blocks.append(Picture("kernel_accuracy", svg, "Time to solution at equal accuracy", CAPTION))
    blocks.append(table("Equal accuracy, each engine's best", (*head, "remark"), 6, ordered, solved, last_text=1))
    blocks.append(table("Equal accuracy, every way", (*head, "remark"), 6, rows, solved, last_text=1, folded=True))
    return Section("Time to solution at equal accuracy", "kernel-accuracy", tuple(blocks))


def batch(run: Run) -> Section | None:
    rows = run.kernels.get("kernel_batch", ())
    head = (
        "linkage",
        "trajectories",
        "lanes",
        "step",
        "5..95 %",
        "MuJoCo's step",
        "ratio",
        "spread",
        "lanes off by",
        "target",
        "met",
    )
    return _part("Many trajectories", BATCH, rows, head, 1, batched)


def right_hand_sides(run: Run) -> Section | None:
    rows = run.kernels.get("kernel_rhs", ())
    head = ("linkage", "kernel", "constraintDynamics", "settings", "kernel's", "Pinocchio's", "ratio", "spread", "target", "met")
    return _part("One right-hand side against Pinocchio", RHS, rows, head, 4, asked)


def agreement(run: Run) -> Section | None:
    rows = run.kernels.get("kernel_agreement", ())
    head = ("linkage", "formulation", "where", "states", "error", "numpy's own", "target", "met")
    return _part("Agreement with numpy", AGREEMENT, rows, head, 3, agreed, folded=True)


def long_runs(run: Run) -> Section | None:
    rows = run.kernels.get("kernel_long", ())
    drifts = ("position drift", "velocity drift")
    energies = ("kinetic energy [J]", "error, first tenth", "last tenth", "largest", "order")
    head = ("linkage", "formulation", "step [s]", "until s", *drifts, *energies, "target of drift", "met")
    return _part("Long runs", LONG, rows, head, 2, ran)


def sizes(run: Run) -> Section | None:
    rows = run.kernels.get("scaling", ())
    if not rows:
        return None
    growth = run.kernels.get("kernel_growth", ())
    blocks: list[Block] = [Text(SCALING)]
    if svg := scaling(rows, growth):
        blocks.append(Picture("kernel_scaling", svg, "Time of a right-hand side against size", CAPTION_SCALING))
    ordered = sorted(rows, key=lambda r: number(r, "size"))
    head = ("engine", "asked", "windows", "n", "time", "5..95 %", "error", "generate s", "compile s", "remark")
    if growth:
        blocks.append(table("Growth", ("engine", "asked", "sizes", "exponent"), 2, growth, grown))
    blocks.append(table("Every size", head, 2, ordered, sized, last_text=1, folded=True))
    return Section("Size", "kernel-size", tuple(blocks))


def kinematics(run: Run) -> Section | None:
    rows = run.kernels.get("kernel_kinematics", ())
    head = ("linkage", "way", "per second", "5..95 %", "position", "velocity", "acceleration", "target", "met")
    return _part("Kinematics", KINEMATICS, rows, head, 2, turned)


def limits(run: Run) -> Section | None:
    rows = run.kernels.get("kernel_bounds", ())
    if not rows:
        return None
    head = ("linkage", "what", "chain [cycles]", "flops", "least time", "measured", "share")
    machine = [r for r in run.kernels.get("kernel_machine", ()) if known(r.get("value"))]
    facts = [r for r in run.kernels.get("kernel_machine", ()) if r.get("statement")]
    named = listed(f"{r['key']} {r['statement']}" for r in facts)
    said = f"Measured with {named}." if facts else ""
    blocks: list[Block] = [
        Text(f"{LIMITS} {said}".strip()),
        table("Share of the machine's limit", (*head, "remark"), 2, rows, bounded, last_text=1),
    ]
    if machine:
        blocks.append(table("The processor", ("quantity", "value", "5..95 %", "unit"), 1, machine, fact, last_text=1))
    return Section("Distance to the machine's limit", "kernel-limits", tuple(blocks))


PARTS = (steps, accuracy, batch, right_hand_sides, agreement, long_runs, sizes, kinematics, limits)


def _part(
    title: str, words: str, rows: Sequence[Row], head: tuple[str, ...], first: int, line: Line, folded: bool = False
) -> Section | None:
    """A section of one table, with a column for what failed."""
    if not rows:
        return None
    lines = table(title, (*head, "remark"), first, rows, line, last_text=1, folded=folded)
    return Section(title, f"kernel-{title.lower().replace(' ', '-')}", (Text(words), lines))
