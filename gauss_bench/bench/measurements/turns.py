"""Kinematics compiled: positions, velocities and accelerations of all links per second, over whole turns of the crank.

Each turn is judged by pure geometry, the closure in the crank angle by Newton's method, at every sample; errors are relative to the
largest value of each level. The suite's own link units in numpy race along, and pylinkage where it is installed.
"""

from collections.abc import Callable, Iterable, Sequence

import numpy as np

from gauss_bench.bench.clock import Block, Key, Measured, Race, Row, at_least, lasting, row, spread
from gauss_bench.bench.context import Context
from gauss_bench.bench.measurements import pylinkage
from gauss_bench.bench.survived import Watch, patient, survived, watching
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
    tasks = [
        context.task("kernel_kinematics", raced, (*place, part), *place) for part in suite.turns for place in part.linkages.items()
    ]
    return list(map(patient, tasks))


def raced(linkage: str, scenario: str, part: Turns) -> Tables:
    """What `turn` tells; a way that crashes or hangs in it has that reason in its row."""
    tables, lost = survived(_race_of, (linkage, scenario, part), METHODS)
    for each in tables["kernel_kinematics"]:
        if each["method"] in lost:
            each |= lost[each["method"]].told
    return tables


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
    own = row(start | {"method": NATIVE}, lambda: rates(measured, NATIVE) | errors(mechanism, closures[0].turn(samples)))
    own = at_least(own, "rate", part.targets.get(mechanism.name))
    if "met" in own:
        own["met"] = own["met"] and all(own[level] <= part.error for level in LEVELS)
    rest = row(start | {"method": LINK_UNITS, "samples": PLAIN_SAMPLES}, lambda: rates(measured, LINK_UNITS))
    watch(Key("turn", RIVAL))
    other = row(start | {"method": RIVAL}, lambda: rates(measured, RIVAL) | named(pylinkage.errors(mechanism, turns[0]())))
    if other["status"] == Status.OK:
        other["message"] = pylinkage.version()
    return {"kernel_kinematics": [own, rest, other]}


def rates(measured: Measured, method: str) -> Row:
    """Seconds of one position, and positions per second."""
    times: Row = spread("seconds", measured.of(Key("turn", method)))
    return times | {"rate": 1 / times["seconds"], "rate_low": 1 / times["seconds_high"], "rate_high": 1 / times["seconds_low"]}


def errors(mechanism: Mechanism, turn: Sweep) -> Row:
    """Largest differences from pure geometry, relative to the largest value of each level."""
    motion = MinimalCoordinate(mechanism)
    theta: Array = turn.q[:, motion.crank]
    one = np.ones(1)
    parts = [motion.state(x, one, 0 * one) for x in theta[:, None]]
    exact = [np.concatenate([part[k] for part in parts]) for k in range(3)]
    return named(float(np.abs(x - y).max() / np.abs(y).max()) for x, y in zip((turn.q, turn.v, turn.a), exact, strict=True))


def named(off: Iterable[float]) -> Row:
    """Errors of positions, velocities and accelerations as columns."""
    return dict(zip(LEVELS, off, strict=True))
