"""A step in each engine's own loop, taken from the races: the compiled formulations against a rival at the same step.

Forces, springs and the guards of the pivots are in what is timed, and so is the call from Python, a few parts in a hundred of the
kernel's time.
"""

from gauss_bench.bench.clock import Key, Measured, Row, at_least, row
from gauss_bench.bench.measurements.cost import NATIVE, gather_by_linkage
from gauss_bench.bench.tasks import Rows, Tables
from gauss_bench.suites.schema import Steps, Suite


def complete(suite: Suite, tables: Tables) -> None:
    """Add the rows of every linkage on which the own engines raced with the rival."""
    steps = {(r["mechanism"], r["scenario"]): r["step"] for r in tables.get("samples", [])}
    for part in suite.steps:
        for place, measured in gather_by_linkage(tables).items():
            if any(isinstance(k, Key) and k.engine == part.rival for k in (*measured.samples, *measured.failed)):
                tables.setdefault("kernel_steps", []).extend(step_rows(place, part, steps.get(place), measured))


def step_rows(place: tuple[str, str], part: Steps, step: float | None, measured: Measured) -> Rows:
    """One row for each formulation, stabilisation and setting of the rival; the first formulation has targets."""
    rows = []
    for number, (formulation, engine) in enumerate(part.own.items()):
        for stabilization in part.stabilizations:
            for settings in part.settings:
                start: Row = {"mechanism": place[0], "scenario": place[1], "formulation": formulation}
                start |= {"stabilization": stabilization, "rival": part.rival, "settings": settings, "step": step}
                own, rival = Key(NATIVE, engine, stabilization=stabilization), Key(NATIVE, part.rival, settings)
                comparison = row(start, measured.compared, own, rival)
                target = part.targets.get(stabilization, {}).get(place[0]) if number == 0 else None
                rows.append(at_least(comparison, "ratio", target))
    return rows
