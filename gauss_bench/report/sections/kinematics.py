"""Kinematics three independent ways, and the positions at which a linkage reverses."""

from gauss_bench.report.content import Block, Cell, Section, Table, Text, columns, error_cell, text_cell
from gauss_bench.report.rows import Row, Run, number

PLACE = 40
TABLES = ("agreement", "singular", "basins", "driving")
WORDS = (
    "Over one driven turn the positions, velocities and accelerations of all links are found three ways that share the linkage "
    "file and nothing else: loop equations from link units, point coordinates with link constraints, and the constraints of the "
    "dynamics differentiated. What is printed is their largest difference, relative to the largest value."
)
REVERSALS = (
    "A coordinate that reverses cannot drive the linkage there: for the crank this is a limit of its motion, for another link or a "
    "slide a dead centre. Each is solved as a fold, not searched; a linkage whose positions fork has none listed."
)
BASINS = (
    "Starts drawn within a spread of the assembly (rad in loop variables, m in point coordinates; the two are not the same "
    "distance): the share that each search leads back to it, the share that ends in another assembly, and the mean number of "
    "iterations. No search picks the assembly from far away; the sketch or the last position does."
)
TORQUES = (
    "The torque that drives a turn at constant speed, and the forces in the joints, worked out from each engine's own "
    "accelerations, against virtual work on pure geometry; steps of 0.001 s, errors relative to the largest value. Where nothing "
    "is lost the mean torque over a turn is zero; the crank-slider's is what its damper takes."
)


def section(run: Run) -> Section:
    if not run.table("agreement"):
        return Section("Kinematics", "kinematics", (Text("The run compared no kinematics."),))
    head, numeric = columns(("linkage", "one", "other", "position", "velocity", "acceleration"), 3)
    lines = tuple(_agreement(row) for row in run.table("agreement"))
    blocks: list[Block] = [Text(WORDS), Table("Three ways, one motion", head, lines, numeric)]
    if run.table("singular"):
        head, numeric = columns(("linkage", "coordinate", "kind", "crank angle [deg]"), 3)
        blocks += [
            Text(REVERSALS),
            Table("Limits and dead centres", head, tuple(_singular(row) for row in run.table("singular")), numeric),
        ]
    if run.table("basins"):
        head, numeric = columns(("linkage", "form", "spread", "search", "right", "other root", "iterations"), 2)
        blocks += [Text(BASINS), Table("First guesses", head, tuple(_basin(row) for row in run.table("basins")), numeric - {3})]
    if run.table("driving"):
        names = (
            "linkage",
            "engine",
            "settings",
            "integrator",
            "stabilization",
            "torque error",
            "mean torque",
            "joint forces",
            "status",
        )
        head, numeric = columns(names, 5, last_text=1)
        blocks += [
            Text(TORQUES),
            Table("Driving torque over a turn", head, tuple(_driving(row) for row in run.table("driving")), numeric),
        ]
    return Section("Kinematics", "kinematics", tuple(blocks))


def _basin(row: Row) -> tuple[Cell, ...]:
    spread, steps = number(row, "spread"), number(row, "iterations")
    shares = tuple(Cell(f"{100 * number(row, key):.0f} %", number(row, key)) for key in ("right", "other"))
    search = text_cell(row["method"].replace("_", " "))
    counted = Cell(f"{steps:.1f}", steps) if steps == steps else Cell("-")
    return (text_cell(row["mechanism"]), text_cell(row["form"]), Cell(f"{spread:.2g}", spread), search, *shares, counted)


def _driving(row: Row) -> tuple[Cell, ...]:
    names = tuple(text_cell(row[key]) for key in ("mechanism", "engine", "settings", "integrator", "stabilization"))
    reached = (error_cell(row, "torque_error"), error_cell(row, "mean_torque"), error_cell(row, "force_error"))
    told = text_cell(row["status"]) if row["status"] == "ok" else text_cell(f"{row['status']}: {row['message']}", "bad")
    return (*names, *reached, told)


def _agreement(row: Row) -> tuple[Cell, ...]:
    names = tuple(text_cell(row[key]) for key in ("mechanism", "first", "second"))
    return (*names, *(error_cell(row, key) for key in ("position", "velocity", "acceleration")))


def _singular(row: Row) -> tuple[Cell, ...]:
    angle = number(row, "crank_deg")
    return (*(text_cell(row[key]) for key in ("mechanism", "coordinate", "kind")), Cell(f"{angle:.8f}", angle))
