"""Measure the time of compiled kinematics: positions, velocities and accelerations of all links over whole turns of the crank.

Errors are differences from the motion that Newton's method finds at every sample. For comparison, a method in numpy that solves one
group of links ("link unit") after the other is timed too.
"""

from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np

from gauss_bench.bench.clock import NO_KEY, Key, Measured, Row, at_least, row
from gauss_bench.bench.measurements.geometry import differences, exact_motion
from gauss_bench.bench.survived import race_processes
from gauss_bench.bench.tasks import Context, Tables, Task, place_of
from gauss_bench.compiler.closure import Sweep, compile_closure
from gauss_bench.kinematics.loop_closure import loop_motion
from gauss_bench.linkage.load import load
from gauss_bench.mechanism.model import Mechanism
from gauss_bench.reference.minimal import MinimalCoordinate
from gauss_bench.runs.blocks import Block, calls_block
from gauss_bench.suites.schema import Suite, Turns

METHODS = NATIVE, LINK_UNITS = "closure, compiled", "link units, numpy"
PLAIN_SAMPLES = 36  # positions that the method in numpy computes: a whole turn would take longer than the rest of the race
LEVELS = ("position_error", "velocity_error", "acceleration_error")


def timing_tasks(suite: Suite, context: Context, tables: Tables) -> list[Task]:
    return context.each(suite.turns, "kernel_kinematics", race_turns)


def race_turns(linkage: str, scenario: str, part: Turns) -> Tables:
    """Return a row for each of METHODS, the compiled one and that in numpy: the time per position in a turn of the crank.

    If a method crashes or hangs in one of the processes, its row has the reason.
    """
    measured = race_processes(entries, (linkage, scenario, part), part.rounds, METHODS, part.processes)
    place = place_of(load(linkage, scenario))
    return {"kernel_kinematics": [turn_row(place, part, method, measured) for method in METHODS]}


def turn_row(place: Row, part: Turns, method: str, measured: Measured) -> Row:
    """Return the table row of a method that computes positions in a turn: time per position, positions per second, and errors.

    The compiled method (NATIVE) has a target for the positions per second, which it meets only if its errors are small too.
    The method in numpy is slow and computes only the first PLAIN_SAMPLES positions of a turn.
    """
    start = place | {"method": method, "samples": PLAIN_SAMPLES if method == LINK_UNITS else part.samples}
    found = row(start, lambda: rate(measured.summary(Key("turn", method))))
    if method != NATIVE or found["mechanism"] not in part.targets:
        return found
    found = at_least(found, "rate", part.targets[found["mechanism"]])
    return found | {"met": found["met"] and all(found[level] <= part.error for level in LEVELS)}


def rate(times: Row) -> Row:
    """Return the columns of the time per position [s] and of its inverse, positions per second, each with its spread."""
    return times | {"rate": 1 / times["seconds"], "rate_low": 1 / times["seconds_high"], "rate_high": 1 / times["seconds_low"]}


def entries(linkage: str, scenario: str, part: Turns) -> Iterator[tuple[Key, Callable[[], Block]]]:
    """Yield the key of each of METHODS, and the function that makes its timing block."""
    mechanism, samples = load(linkage, scenario), part.samples

    def native() -> Block:
        closure = compile_closure(mechanism)
        block = calls_block(NO_KEY, lambda: closure.turn(samples), samples)
        return replace(block, facts=lambda: errors(mechanism, closure.turn(samples)))

    def plain() -> Block:
        times = np.arange(PLAIN_SAMPLES) / samples
        return calls_block(NO_KEY, lambda: loop_motion(mechanism, times), PLAIN_SAMPLES)

    yield Key("turn", NATIVE), native
    yield Key("turn", LINK_UNITS), plain


def errors(mechanism: Mechanism, turn: Sweep) -> Row:
    """Return the columns of the largest errors of positions, velocities and accelerations in one turn of the crank at 1 rad/s."""
    motion = MinimalCoordinate(mechanism)
    off = differences((turn.q, turn.v, turn.a), exact_motion(motion, turn.q[:, motion.crank]))
    return {f"{level}_error": x for level, x in off.items()}
