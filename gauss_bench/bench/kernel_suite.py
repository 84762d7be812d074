"""The kernel suite: how fast and how exact the compiled formulations are, against what, and what is left to be gained.

First what no clock decides, in parallel workers: ladders of steps, agreement, long runs. Then everything that is timed, one linkage
after the other in one worker process and nothing beside it. Finished tasks are not repeated; what fails is a row with its reason.
"""

import hashlib
import json
from collections import Counter
from pathlib import Path
from typing import Any

import pandas as pd

from gauss_bench.bench.journal import Journal, fingerprint
from gauss_bench.bench.kernel_chains import SCENARIO as SWING
from gauss_bench.bench.kernel_chains import name_of
from gauss_bench.bench.kernel_effort import FULL, Effort
from gauss_bench.bench.measurements import batch as kernel_batch
from gauss_bench.bench.measurements import turns as kernel_kinematics
from gauss_bench.bench.measurements.agreement import FOLDED, agreement
from gauss_bench.bench.measurements.certificates import certificates_digest
from gauss_bench.bench.measurements.equal_accuracy import Ladders, equal_accuracy
from gauss_bench.bench.measurements.growth import growth, scaling
from gauss_bench.bench.measurements.kernel_costs import chain_costs, kernel_costs, processor
from gauss_bench.bench.measurements.ladder import METHODS, ladder
from gauss_bench.bench.measurements.long_runs import SCENARIO as LONG
from gauss_bench.bench.measurements.long_runs import long_run
from gauss_bench.bench.tasks import Task, finish
from gauss_bench.mechanism.load import load
from gauss_bench.tables import KERNEL_TABLES, environment, write_table

LINKAGES = {"crank_slider": "paper", "four_bar": "torque", "six_bar": "torque", "shaper": "torque", "eight_bar": "torque"}
LIMIT = 300.0  # [s] the slowest task generates the longest chain of pendulums, in half a minute
LARGE = 16  # windows: below, what calling and filling of vectors cost hides how time grows
FACTS = ("date", "commit", "dirty", "cpu", "cores", "python", "platform")
NAMES = ("mechanism", "scenario", "formulation", "stabilization", "settings", "place", "own", "method")  # that tell rows apart
Found = dict[str, dict[str, Any]]


def run_kernels(linkages: dict[str, str] | None, folder: Path, jobs: int = 2, effort: Effort = FULL) -> dict[str, pd.DataFrame]:
    """Run what is not finished yet, write the kernel tables into `folder`, and return them by name.

    `linkages` (name or path -> scenario) leave out what is not about them; None for all of it.

    Raises:
        Busy: another kernel run writes into the same folder.
    """
    chosen, whole = linkages or LINKAGES, linkages is None
    files = "".join(load(linkage).sha256 for linkage in (*chosen, *FOLDED))
    stamp = f"{fingerprint()}.{certificates_digest()}.{hashlib.sha256(files.encode()).hexdigest()[:16]}"
    with Journal(folder / ".run" / "kernel.jsonl") as journal:
        store = str(folder / ".run" / "references")
        found = finish(exact_tasks(chosen, whole, effort, store, stamp), jobs, LIMIT, "accuracy", journal)
        found |= finish(timed_tasks(chosen, whole, effort, stamp, found), 1, LIMIT, "times", journal)
    return _write(found, folder)


def summary(tables: dict[str, pd.DataFrame]) -> str:
    """How many rows have a target, and which of them miss it."""
    aimed = [row for table in tables.values() for row in table.to_dict("records") if isinstance(row.get("met"), bool)]
    missed = [" ".join(str(row[k]) for k in NAMES if isinstance(row.get(k), str) and row[k]) for row in aimed if not row["met"]]
    said = f": {'; '.join(dict.fromkeys(missed))}" if missed else ""
    return f"{len(aimed) - len(missed)} of {len(aimed)} targets met{', missed' if missed else ''}{said}"


def exact_tasks(chosen: dict[str, str], whole: bool, effort: Effort, store: str, stamp: str) -> list[Task]:
    """What may run side by side: no time in it counts."""
    tasks = []
    for linkage, scenario in chosen.items():
        for method in METHODS:
            key, arguments = _ladder_key(linkage, scenario, method.key()), (linkage, scenario, method, store, effort.cap)
            tasks.append(_task(key, ladder, arguments, stamp, effort))
    for linkage, scenario in {**chosen, **(dict.fromkeys(FOLDED, "torque") if whole else {})}.items():
        tasks.append(_task(f"kernel_agreement|{linkage}|{scenario}", agreement, (linkage, scenario, effort.states), stamp, effort))
    for linkage in chosen:
        if LONG in load(linkage).scenarios:
            tasks.append(_task(f"kernel_long|{linkage}|{LONG}", long_run, (linkage, effort.long), stamp, effort))
    return tasks


def timed_tasks(chosen: dict[str, str], whole: bool, effort: Effort, stamp: str, found: Found) -> list[Task]:
    """What is timed, one after the other; `found` has the ladders."""
    tasks = [_task("kernel_machine||", processor, (effort,), stamp, effort)]
    for linkage, scenario in chosen.items():
        tasks.append(_task(f"kernel_steps|{linkage}|{scenario}", kernel_costs, (linkage, scenario, effort), stamp, effort))
        ladders = _ladders(linkage, scenario, found)
        seen = hashlib.sha256(json.dumps([x[1:] for x in ladders]).encode()).hexdigest()[:16]
        compared = (linkage, scenario, ladders, effort.rounds, effort.lead)
        tasks.append(_task(f"kernel_accuracy|{linkage}|{scenario}", equal_accuracy, compared, f"{stamp}.{seen}", effort))
    for linkage in kernel_batch.LINKAGES:
        if linkage in chosen:
            arguments = (linkage, chosen[linkage], effort)
            tasks.append(_task(f"kernel_batch|{linkage}|{chosen[linkage]}", kernel_batch.batch, arguments, stamp, effort))
    for linkage in kernel_kinematics.LINKAGES:
        if linkage in chosen:
            key = f"kernel_kinematics|{linkage}|{kernel_kinematics.SCENARIO}"
            tasks.append(_task(key, kernel_kinematics.kinematics_speed, (linkage, effort), stamp, effort))
    for size in effort.sizes if whole else ():
        tasks.append(_task(f"scaling|{size}|", scaling, ((size,),), stamp, effort))
    for links in effort.chains if whole else ():
        tasks.append(_task(f"kernel_claim|{name_of(links)}|{SWING}", chain_costs, (name_of(links), SWING, effort), stamp, effort))
    return tasks


def _task(key: str, function: Any, arguments: tuple[Any, ...], stamp: str, effort: Effort) -> Task:
    """A task that begins with the table a failure is told in; another effort is another task."""
    return Task(key, function, arguments, f"{stamp}.{hashlib.sha256(repr(effort).encode()).hexdigest()[:8]}")


def _ladder_key(linkage: str, scenario: str, method: str) -> str:
    return f"kernel_ladder|{linkage}|{scenario}|{method}"


def _ladders(linkage: str, scenario: str, found: Found) -> Ladders:
    """Method, rungs and why they ended, for every method of a linkage."""
    ladders = []
    for method in METHODS:
        entry = found[_ladder_key(linkage, scenario, method.key())]
        rows = entry.get("kernel_ladder", [entry.get("row")])
        ladders.append((method, rows, str(entry.get("ended", rows[-1]["message"]))))
    return ladders


def _write(found: Found, folder: Path) -> dict[str, pd.DataFrame]:
    """Every table, in the order of the tasks."""
    rows: dict[str, list[dict[str, Any]]] = {name: [] for name in KERNEL_TABLES}
    for key, entry in found.items():
        for name in KERNEL_TABLES:
            rows[name] += entry.get(name, [])
        if "row" in entry:
            table, mechanism, scenario = key.split("|")[:3]
            rows[table].append({"mechanism": mechanism, "scenario": scenario, **entry["row"]})
    rows["kernel_growth"] = exponents(rows["scaling"])
    where = environment()
    rows["kernel_machine"] += [{"key": x, "status": "ok", "statement": str(where[x])} for x in FACTS]
    rows["kernel_machine"] += [{"key": name, "status": "ok", "statement": x} for name, x in sorted(where["versions"].items())]
    tables = {name: pd.DataFrame(x) for name, x in rows.items()}
    for name, frame in tables.items():
        write_table(frame, folder / f"{name}.csv")
    return tables


def exponents(rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """How time grows with size from LARGE on, of everything that was timed at two such sizes or more."""
    timed = [row for row in rows if row["status"] == "ok" and row["size"] >= LARGE]
    pairs = Counter((row["engine"], row["quantity"]) for row in timed)
    return [
        {"engine": engine, "quantity": quantity, "sizes": sizes, "from": LARGE, "exponent": growth(timed, engine, quantity, LARGE)}
        for (engine, quantity), sizes in pairs.items()
        if sizes > 1
    ]
