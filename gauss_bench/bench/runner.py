"""Run a suite: tasks that measure no times in parallel, then timing tasks one by one, then write the tables.

A measurement is a module in the folder `measurements`. Each module may have these functions:

    exact_tasks(suite, context)                     return tasks that measure no time; they run in parallel
    timing_tasks(suite, context, tables)            return tasks that measure times; they run one after the other, after all exact
                                                    tasks
    second_timing_tasks(suite, context, tables)     return further timing tasks, which depend on the rows of the first ones
    complete(suite, tables)                         fill in columns that depend on the rows of several tasks

`tables` holds table -> rows of all tasks that have ended.
"""

import json
from collections.abc import Sequence
from importlib import import_module
from pathlib import Path
from pkgutil import iter_modules
from types import ModuleType
from typing import Any

from gauss_bench.atomic import write_text
from gauss_bench.bench import measurements
from gauss_bench.bench.cases import Case
from gauss_bench.bench.journal import Journal, fingerprint
from gauss_bench.bench.measurements import accuracy
from gauss_bench.bench.measurements.certificates import certificates_digest
from gauss_bench.bench.measurements.cost import BASELINE
from gauss_bench.bench.provenance import environment
from gauss_bench.bench.tasks import CASE_LIMIT, Context, Rows, Tables, Task, finish, gather
from gauss_bench.engines import AUTHORED
from gauss_bench.judge import LIMITS
from gauss_bench.linkage.load import built_in, load
from gauss_bench.runs.apart import Alteration, leave_unaltered
from gauss_bench.runs.offers import offers
from gauss_bench.suites.read import linkages_of
from gauss_bench.suites.schema import Suite
from gauss_bench.tables import ENVIRONMENT, TABLES, row_of, write_schema, write_table

ORDER = ("accuracy", "cost")  # these measurements come first, because others depend on their rows


def modules() -> list[ModuleType]:
    """Return the modules of all measurements; those in ORDER come first."""
    names = sorted((m.name for m in iter_modules(measurements.__path__)), key=lambda x: (x not in ORDER, x))
    return [import_module(f"{measurements.__name__}.{name}") for name in names]


def list_tasks(function_name: str, *arguments: Any) -> list[Task]:
    """Return the tasks that the functions with this name return, in all measurement modules that have one."""
    functions = [getattr(module, function_name) for module in modules() if hasattr(module, function_name)]
    return [task for function in functions for task in function(*arguments)]


def run(
    suite: Suite,
    folder: Path,
    jobs: int = 2,
    costs: bool = True,
    name: str = "",
    until: float | None = None,
    steps: Sequence[float] | None = None,
    limit: float = CASE_LIMIT,
) -> Tables:
    """Run the tasks of a suite that are not finished yet, write its tables into `folder`, and return table -> rows.

    `jobs` tasks that measure no times run in parallel; timing tasks run only if `costs`, one by one. The report shows the suite's
    `name`. `until` and `steps` [s] replace those of the suite's accuracy cases, each of which may take `limit` [s].

    Raises:
        Busy: another run writes into the same folder.
    """
    stamp, asked = f"{fingerprint()}.{certificates_digest()}", tuple(steps) if steps else None
    context = Context(str(folder / ".run" / "references"), stamp, until=until, steps=asked, limit=limit)
    with Journal(folder / ".run" / "journal.jsonl") as journal:
        tables = finish(list_tasks("exact_tasks", suite, context), jobs, "accuracy", journal)
        timing_stages = {"timing_tasks": "times", "second_timing_tasks": "times again"} if costs else {}
        for stage, label in timing_stages.items():
            tables = gather([tables, finish(list_tasks(stage, suite, context, tables), 1, label, journal)])
    complete_rows(suite, tables)
    for table, rows in tables.items():
        write_table(table, rows, folder)
    write_schema(folder)
    write_text(folder / ENVIRONMENT, json.dumps(describe_run(tables, suite, name), indent=1) + "\n")
    return tables


def complete_rows(suite: Suite, tables: Tables) -> None:
    """Fill in the columns that depend on the rows of several tasks."""
    for module in modules():
        if hasattr(module, "complete"):
            module.complete(suite, tables)


def measure_all(
    cases: Sequence[Case], folder: Path, jobs: int = 2, alter: Alteration = leave_unaltered, limit: float = CASE_LIMIT
) -> tuple[Rows, Rows]:
    """Run accuracy cases, without times and without a journal; return the rows of results and of the references used.

    Only references are written into `folder`. `alter` plants a fault in the mechanism that engines are given. Each case may take
    `limit` [s].
    """
    context = Context(str(folder / ".run" / "references"), "", alter, limit=limit)
    tables = finish(accuracy.tasks(cases, context), jobs, "accuracy")
    tables["results"] = accuracy.with_orders(sorted(tables.get("results", []), key=accuracy.in_order))
    results, references = ([row_of(TABLES[x], row) for row in tables.get(x, [])] for x in ("results", "references"))
    return results, references


def describe_run(tables: Tables, suite: Suite, name: str) -> dict[str, Any]:
    """Describe a run for the report: machine, date, suite, and the versions and settings of its engines."""
    rows = [*tables.get("results", []), *tables.get("search_ladder", [])]
    engines = dict.fromkeys(row["engine"] for row in rows if row.get("engine"))  # each once
    described: dict[str, dict[str, Any]] = {}
    for offer in offers([*engines]):
        about = described[offer.name] = {"version": offer.version, "settings": offer.settings}
        if soft := {label: cause for label, cause in offer.soft.items() if label in offer.settings}:
            about["soft"] = soft
        if offer.environment:
            about["environment"] = offer.environment.partition(" at ")[0]  # without the path, which differs between machines
    return environment() | {
        "suite": name,
        "hours": suite.hours,
        "baseline_engine": BASELINE,
        "own_engines": list(AUTHORED),
        "gates": LIMITS,
        "engines": described,
        "left_out": [rule.model_dump(exclude_defaults=True) for rule in suite.left_out],
        "linkages": own_files(suite),
    }


def own_files(suite: Suite) -> dict[str, str]:
    """Return name of a linkage -> text of its file, for linkages that are not built in: a report can then draw them."""
    paths = [Path(x) for x in linkages_of(suite) if x not in built_in()]
    return {load(x).name: x.read_text(encoding="utf-8") for x in paths if x.is_file()}
