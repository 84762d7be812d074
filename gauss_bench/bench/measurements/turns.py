"""Kinematics compiled: positions, velocities and accelerations of all links per second, over whole turns of the crank.

Each turn is judged by pure geometry, the closure in the crank angle by Newton's method, at every sample; errors are relative to the
largest value of each level. The suite's own link units in numpy race along, and pylinkage where it is installed.
"""

from collections.abc import Callable, Iterable, Sequence

import numpy as np

from gauss_bench.bench.clock import Block, Key, Race, Row, at_least, lasting, row, spread
from gauss_bench.bench.context import Context
from gauss_bench.bench.measurements import pylinkage
from gauss_bench.bench.survived import Watch, list_survivors, patient, watching
from gauss_bench.bench.tasks import Tables, Task
from gauss_bench.compiler.closure import Closure, Sweep, compile_closure
from gauss_bench.kinematics.inputs import inputs_of
from gauss_bench.kinematics.loop_closure import loop_motion
from gauss_bench.linkage.load import load
from gauss_bench.mechanism.model import Mechanism
from gauss_bench.reference.minimal import MinimalCoordinate
from gauss_bench.suites.schema import Suite, Turns
from gauss_bench.terms import Array
from gauss_bench.trajectory import Status

METHODS = NATIVE, LINK_UNITS, RIVAL = "closure, compiled", "link units, numpy", "pylinkage"
PLAIN_SAMPLES = 36  # of the numpy form: a turn of it would take as long as all the rest
LEVELS = ("position_error", "velocity_error", "acceleration_error")


def timed(suite: Suite, context: Context, tables: Tables) -> list[Task]:
    """One task for each linkage."""
    return [
        patient(context.task("kernel_kinematics", race_turns, (*place, part), *place), part.processes)
        for part in suite.turns
        for place in part.linkages.items()
    ]


def race_turns(linkage: str, scenario: str, part: Turns) -> Tables:
    """A row for each way, over the processes; one that crashes or hangs in a process has that reason in its row."""
    answers = []
    for _ in range(part.processes):
        tables, lost = list_survivors(_race_of, (linkage, scenario, part), METHODS)
        rows = tables["kernel_kinematics"]
        answers.append([r | lost[r["method"]].told if r["method"] in lost else r for r in rows])
    return {"kernel_kinematics": [over_processes(rows, part) for rows in zip(*answers, strict=True)]}


def over_processes(rows: Sequence[Row], part: Turns) -> Row:
    """One way's row with the median of the times that processes found, or the first that failed; `rows` are its own."""
    if failed := next((r for r in rows if r["status"] != Status.OK), None):
        return failed
    return aim(rows[0] | (rates(np.array([[r["seconds"]] for r in rows])) if len(rows) > 1 else {}), part)


def aim(row: Row, part: Turns) -> Row:
    """With the target of its linkage for the compiled way, which wrong kinematics do not meet."""
    if row["method"] != NATIVE:
        return row
    row = at_least(row, "rate", part.targets.get(row["mechanism"]))
    return row | ({"met": row["met"] and all(row[level] <= part.error for level in LEVELS)} if "met" in row else {})


def _race_of(linkage: str, scenario: str, part: Turns, methods: Sequence[str], path: str) -> Tables:
    return turn(linkage, scenario, part, methods, watching(path))


def turn(linkage: str, scenario: str, part: Turns, methods: Sequence[str] = METHODS, watch: Watch = id) -> Tables:
    """Rows of a linkage, one for each way; `methods` are those that are gone."""
    mechanism, race, closures, samples = load(linkage, scenario), Race(watch), list[Closure](), part.samples
    turns: list[Callable[[], pylinkage.Turn]] = []

    def native() -> Block:
        closures.append(compile_closure(mechanism))
        return lasting(None, lambda: closures[0].turn(samples), samples)

    def plain() -> Block:
        times, inputs = np.arange(PLAIN_SAMPLES) / samples, inputs_of(mechanism)
        return lasting(None, lambda: loop_motion(mechanism, inputs, times), PLAIN_SAMPLES)

    def rival() -> Block:
        turns.append(pylinkage.turning(mechanism, samples))
        return lasting(None, turns[0], samples)

    for name, make in ((NATIVE, native), (LINK_UNITS, plain), (RIVAL, rival)):
        if name in methods:
            race.add(Key("turn", name), make)
    measured = race.run(part.rounds)
    start: Row = {"mechanism": mechanism.name, "scenario": scenario, "samples": samples}
    watch(Key("turn", NATIVE))

    def rate_steps(method: str) -> Row:
        return rates(measured.of(Key("turn", method)))

    own = row(start | {"method": NATIVE}, lambda: rate_steps(NATIVE) | errors(mechanism, closures[0].turn(samples)))
    own = aim(own, part)
    rest = row(start | {"method": LINK_UNITS, "samples": PLAIN_SAMPLES}, lambda: rate_steps(LINK_UNITS))
    watch(Key("turn", RIVAL))
    other = row(start | {"method": RIVAL}, lambda: rate_steps(RIVAL) | name_row(pylinkage.errors(mechanism, turns[0]())))
    if other["status"] == Status.OK:
        other["message"] = pylinkage.version()
    return {"kernel_kinematics": [own, rest, other]}


def rates(samples: Array) -> Row:
    """Seconds of one position, and positions per second; `samples` (processes, rounds)."""
    times: Row = spread("seconds", samples)
    return times | {"rate": 1 / times["seconds"], "rate_low": 1 / times["seconds_high"], "rate_high": 1 / times["seconds_low"]}


def errors(mechanism: Mechanism, turn: Sweep) -> Row:
    """Largest differences from pure geometry, relative to the largest value of each level."""
    motion = MinimalCoordinate(mechanism)
    theta: Array = turn.q[:, motion.crank]
    one = np.ones(1)
    parts = [motion.state(x, one, 0 * one) for x in theta[:, None]]
    exact = [np.concatenate([part[k] for part in parts]) for k in range(3)]
    return name_row(float(np.abs(x - y).max() / np.abs(y).max()) for x, y in zip((turn.q, turn.v, turn.a), exact, strict=True))


def name_row(off: Iterable[float]) -> Row:
    """Errors of positions, velocities and accelerations as columns."""
    return dict(zip(LEVELS, off, strict=True))
