"""The time, the place and the machine of the run."""

from gauss_bench.report.content import Cell, Section, Table, Text, columns, text_cell
from gauss_bench.report.rows import Run

PLACE = 110
TABLES = ()
FACTS = (
    "suite",
    "hours",
    "date",
    "commit",
    "dirty",
    "python",
    "platform",
    "cpu",
    "cores",
    "threads",
    "blas",
    "baseline_engine",
    "wall_time",
)


def section(run: Run) -> Section:
    facts = [(name, run.environment[name]) for name in FACTS if run.environment.get(name) is not None]
    if not facts:
        return Section("Environment", "environment", (Text("The run recorded no environment."),))
    lines = [(text_cell(name.replace("_", " ")), _value(name, value)) for name, value in facts]
    lines += [(text_cell(name), text_cell(version)) for name, version in sorted(run.environment.get("versions", {}).items())]
    head, numeric = columns(("what", "value"), 2)
    return Section("Environment", "environment", (Table("Environment", head, tuple(lines), numeric),))


def _value(name: str, value: object) -> Cell:
    if name == "wall_time" and isinstance(value, (int, float)):
        return Cell(f"{value / 60:.1f} min", float(value))
    return Cell({True: "yes", False: "no"}[value]) if isinstance(value, bool) else text_cell(value)
