"""Kinematics compiled: positions, velocities and accelerations of all links per second, over whole turns of the crank.

Each turn is judged by pure geometry, the closure in the crank angle by Newton's method, at every sample; errors are relative to the
largest value of each level. The suite's own link units in numpy
race along, and pylinkage where it is installed.
"""

from collections.abc import Callable, Iterable
from typing import Any

import numpy as np

from gauss_bench.bench.clock import Block, lasting
from gauss_bench.bench.kernel_effort import Effort
from gauss_bench.bench.kernel_timing import Key, Measured, Race, Row, row, spread
from gauss_bench.bench.measurements import pylinkage as kernel_pylinkage
from gauss_bench.bench.targets import CLOSURE, KINEMATICS, at_least
from gauss_bench.compiler.closure import Closure, Sweep, compile_closure
from gauss_bench.kinematics.inputs import inputs_of
from gauss_bench.kinematics.loop_closure import loop_motion
from gauss_bench.mechanism.load import load
from gauss_bench.mechanism.model import Mechanism
from gauss_bench.reference.minimal import MinimalCoordinate
from gauss_bench.terms import Array
from gauss_bench.trajectory import Status

LINKAGES = ("four_bar", "eight_bar")
SCENARIO = "driven"
SAMPLES = 3600
NATIVE, LINK_UNITS, RIVAL = "closure, compiled", "link units, numpy", "pylinkage"
PLAIN_SAMPLES = 36  # of the numpy form: a turn of it would take as long as all the rest
LEVELS = ("position_error", "velocity_error", "acceleration_error")


def kinematics_speed(linkage: str, effort: Effort) -> dict[str, Any]:
    """Rows of a linkage, {"kernel_kinematics": [...]}."""
    mechanism, race, closures = load(linkage, SCENARIO), Race(), list[Closure]()
    turns: list[Callable[[], kernel_pylinkage.Turn]] = []

    def native() -> Block:
        closures.append(compile_closure(mechanism))
        return lasting(None, lambda: closures[0].turn(SAMPLES), SAMPLES)

    def plain() -> Block:
        times, inputs = np.arange(PLAIN_SAMPLES) / SAMPLES, inputs_of(mechanism)
        return lasting(None, lambda: loop_motion(mechanism, inputs, times), PLAIN_SAMPLES)

    race.add(Key("turn", NATIVE), native)

    def rival() -> Block:
        turns.append(kernel_pylinkage.turning(mechanism, SAMPLES))
        return lasting(None, turns[0], SAMPLES)

    race.add(Key("turn", LINK_UNITS), plain)
    race.add(Key("turn", RIVAL), rival)
    measured = race.run(effort.rounds)
    start: Row = {"mechanism": mechanism.name, "scenario": SCENARIO, "samples": SAMPLES}
    own = row(start | {"method": NATIVE}, lambda: rates(measured, NATIVE) | errors(mechanism, closures[0].turn(SAMPLES)))
    own = at_least(own, "rate", KINEMATICS[mechanism.name])
    own["met"] = own.get("met", False) and all(own[level] <= CLOSURE for level in LEVELS)
    rest = row(start | {"method": LINK_UNITS, "samples": PLAIN_SAMPLES}, lambda: rates(measured, LINK_UNITS))
    other = row(start | {"method": RIVAL}, lambda: rates(measured, RIVAL) | named(kernel_pylinkage.errors(mechanism, turns[0]())))
    if other["status"] == Status.OK:
        other["message"] = kernel_pylinkage.version()
    return {"kernel_kinematics": [own, rest, other]}


def rates(measured: Measured, method: str) -> Row:
    """Seconds of one position, and positions per second."""
    found: Row = spread("seconds", measured.of(Key("turn", method)))
    return found | {"rate": 1 / found["seconds"], "rate_low": 1 / found["seconds_high"], "rate_high": 1 / found["seconds_low"]}


def errors(mechanism: Mechanism, turn: Sweep) -> Row:
    """Largest differences from pure geometry, relative to the largest value of each level."""
    crank = 3 * (mechanism.crank or 0) + 2
    theta: Array = turn.q[:, crank]
    motion = MinimalCoordinate(mechanism)
    one = np.ones(1)
    parts = [motion.state(x, one, 0 * one) for x in theta[:, None]]
    exact = [np.concatenate([part[k] for part in parts]) for k in range(3)]
    return named(float(np.abs(x - y).max() / np.abs(y).max()) for x, y in zip((turn.q, turn.v, turn.a), exact, strict=True))


def named(off: Iterable[float]) -> Row:
    """Errors of positions, velocities and accelerations as columns."""
    return dict(zip(LEVELS, off, strict=True))
