"""pylinkage beside the compiled closure: a turn of the crank with velocities and accelerations, by its own fastest loop.

It places pins one after the other by intersecting circles (chains of dyads), so of the linkages here the four-bar can be written
for it and the eight-bar, whose last three links close together, cannot. With numba installed its loop is compiled, else it is
Python; the row says which. It is no part of the suite's extras.
"""

from collections.abc import Callable
from importlib import import_module
from importlib.util import find_spec
from typing import Any

import numpy as np

from gauss_bench.bench.measurements import geometry
from gauss_bench.mechanism.coordinates import acceleration, position, velocity
from gauss_bench.mechanism.model import Mechanism
from gauss_bench.reference.minimal import MinimalCoordinate
from gauss_bench.terms import Array
from gauss_bench.trajectory import RunFailure, Status

FOUR_BAR = "four_bar"
PIN = "C"  # of coupler and rocker
Turn = tuple[Array, Array, Array]


def version() -> str:
    """Tell whether its loops are compiled."""
    return "compiled by numba" if find_spec("numba") else "without numba, in Python"


def turning(mechanism: Mechanism, samples: int) -> Callable[[], Turn]:
    """A call that goes on for a turn in equal steps at 1 rad/s: positions, velocities, accelerations (samples, pins, 2).

    The pins are those of the ground, that of the crank, and PIN.

    Raises:
        ImportError: pylinkage is not there.
        RunFailure: the linkage is no chain of dyads that is written for it here.
    """
    parts: Any = import_module("pylinkage")
    if mechanism.name != FOUR_BAR:
        raise RunFailure(Status.SKIP, "its links do not close two by two, as pylinkage's dyads must")
    ground = [parts.Ground(*map(float, mechanism.ground_points[name]), name=name) for name in "AD"]
    lengths = [float(np.hypot(*np.subtract(*link.points.values()))) for link in mechanism.links if len(link.points) == 2]
    coupler = mechanism.links[1].points
    reach = float(np.hypot(*(coupler[PIN] - coupler["B"])))
    crank = parts.Crank(ground[0], lengths[0], angular_velocity=2 * np.pi / samples, initial_angle=float(mechanism.q0[2]))
    start = (float(x) for x in position(mechanism.q0, mechanism.point(1, PIN)))
    linkage = parts.Linkage([*ground, crank, parts.RRRDyad(crank.output, ground[1], reach, lengths[1], *start)])
    linkage.set_input_velocity(crank, omega=1.0)
    return lambda: linkage.step_fast_with_kinematics(iterations=samples)


def differences(mechanism: Mechanism, turn: Turn) -> dict[str, float]:
    """Largest differences of PIN's positions, velocities and accelerations from pure geometry, relative to each's largest value."""
    point = mechanism.point(1, PIN)
    away = turn[0][:, 2] - mechanism.ground_points["A"]
    theta = np.unwrap(np.arctan2(away[:, 1], away[:, 0]))
    q, v, a = geometry.exact_motion(MinimalCoordinate(mechanism), theta)
    x, y, z = (level[:, -1] for level in turn)
    return geometry.differences((x, y, z), (position(q, point), velocity(q, v, point), acceleration(q, v, a, point)))
