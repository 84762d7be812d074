"""Compare the accelerations of compiled formulations with those of the same formulations in numpy.

The states are random, or close to positions at which a choice of independent coordinates fails: dead centres, where a link or slide
reverses, and the change points of a parallelogram, where all bars lie in one line and the constraint rows lose rank. Near a change
point every formulation loses digits, because the condition number grows like the inverse of the distance; the difference between
two formulations in numpy shows how many digits remain.
"""

from collections.abc import Iterator

import numpy as np

from gauss_bench import metrics
from gauss_bench.bench.clock import Missing, Row, at_most, row
from gauss_bench.bench.measurements.claim import FORMULATIONS
from gauss_bench.bench.measurements.geometry import exact_motion
from gauss_bench.bench.tasks import Context, Tables, Task, place_of
from gauss_bench.compiler.errors import KernelError
from gauss_bench.compiler.kernel import compile_kernel
from gauss_bench.engines import get
from gauss_bench.engines.base import Choice
from gauss_bench.kinematics.singular import ChangePoint, singular_positions
from gauss_bench.linkage.load import load
from gauss_bench.mechanism.model import Mechanism
from gauss_bench.reference.build import random_states
from gauss_bench.reference.minimal import MinimalCoordinate
from gauss_bench.runs.questions import accelerations
from gauss_bench.suites.schema import Agreement, Suite
from gauss_bench.terms import Array
from gauss_bench.trajectory import Status

CENTRES = "dead centres"
FOLDED = {"parallelogram": (0.0, np.pi)}  # [rad] crank angles at which all its bars lie in one line
OFFSETS = {CENTRES: (0.0, 1e-9, 1e-6, 1e-3), "change points": (1e-6, 1e-4, 1e-2)}  # [rad] of the crank from these positions
SPEED = 10.0  # [rad/s] of the crank at these positions


def exact_tasks(suite: Suite, context: Context) -> list[Task]:
    return context.each(suite.agreement, "kernel_agreement", agreement)


def agreement(linkage: str, scenario: str, part: Agreement) -> Tables:
    """Return one row for each kind of states and formulation: the largest relative difference of a kernel from numpy."""
    mechanism = load(linkage, scenario or None)
    rows = []
    for kind, q, v in list_states(mechanism, part.states):
        for formulation in FORMULATIONS:
            start: Row = place_of(mechanism) | {"formulation": formulation, "place": kind, "states": len(q)}
            rows.append(at_most(row(start, differences, mechanism, formulation, q, v), "error", part.target))
    return {"kernel_agreement": rows}


def list_states(mechanism: Mechanism, count: int) -> Iterator[tuple[str, Array, Array]]:
    """Yield the name of each kind of states, and states q, v (k, n) of that kind, which obey the constraints.

    The kinds are `count` random states and, for each distance of the crank from singular positions in OFFSETS, the states on both
    sides of every such position, at the crank speed SPEED.
    """
    states = random_states(mechanism, count)
    yield "random states", states.q, states.v
    motion = MinimalCoordinate(mechanism)
    name, cranks = _singular(mechanism)
    for offset in OFFSETS[name] if cranks else ():
        angles = np.unique([crank + side * offset for crank in cranks for side in (-1, 1)])
        q, v, _ = exact_motion(motion, angles, SPEED)
        yield f"{name}, {offset:g} rad off" if offset else name, q, v


def _singular(mechanism: Mechanism) -> tuple[str, list[float]]:
    """Return the linkage's kind of singular positions, a key of OFFSETS, and the crank angles [rad] there, possibly none."""
    if mechanism.name in FOLDED:
        return "change points", list(FOLDED[mechanism.name])
    try:
        positions = singular_positions(mechanism)
    except ChangePoint:  # it ends the search, so that no dead centre is known; only change points of FOLDED are compared
        return CENTRES, []
    # angles that differ only by rounding count once
    return CENTRES, sorted({round(s.crank, 12): s.crank for s in positions if s.kind == "dead centre"}.values())


def differences(mechanism: Mechanism, formulation: str, q: Array, v: Array) -> Row:
    """Return the columns `error`, `numpy_error` and `against`, which compare a kernel with formulations in numpy at states (k, n).

    `against` is the formulation in numpy whose accelerations are taken as true. `error` is the largest relative error of the kernel
    in calls for single states and in one call for all states. `numpy_error` is the largest relative error of a second formulation
    in numpy.

    Raises:
        Missing, RunFailure: the kernel or a formulation has no accelerations.
    """
    # of the formulations in numpy, only udwadia_kalaba and gauss accept redundant rows
    second = "udwadia_kalaba" if mechanism.redundant else "lagrange" if formulation == "gauss" else "gauss"
    against = "gauss" if mechanism.redundant else formulation
    try:
        kernel = compile_kernel(mechanism, formulation)
    except KernelError as error:
        raise Missing(Status.ERROR, str(error)) from error
    true = _accelerations(mechanism, against, q, v)

    def worst(a: Array) -> float:
        return float(metrics.relative_acceleration_error(a, true).max())

    single = np.array([kernel.acceleration(*x) for x in zip(q, v, strict=True)])
    errors = {"error": max(worst(single), worst(kernel.acceleration(q, v)))}
    return errors | {"numpy_error": worst(_accelerations(mechanism, second, q, v)), "against": against}


def _accelerations(mechanism: Mechanism, name: str, q: Array, v: Array) -> Array:
    """Return the accelerations (k, n) of a formulation in numpy at states q, v (k, n)."""
    return accelerations(np.zeros(len(q)), q, v, get(name).build(mechanism, Choice()))
