"""In how many ways a linkage can be put together with its inputs where they are: found from starts by lot, each told once.

From links turned and moved by lot Levenberg-Marquardt finds the way to the constraints, and Gauss-Newton ends on them. Nothing
promises that all are found: a search ends when it has met nothing new for a while.
Source: as in `root_finding`.
"""

from dataclasses import replace

import numpy as np

from gauss_bench.kinematics.freedom import Freedom
from gauss_bench.kinematics.root_finding import ExitFlag, levenberg_marquardt
from gauss_bench.kinematics.topology import shared_angles
from gauss_bench.mechanism.coordinates import value
from gauss_bench.mechanism.model import GROUND, AngleDriver, Mechanism
from gauss_bench.mechanism.motion_laws import constant
from gauss_bench.mechanism.spaces import angle_at, angles
from gauss_bench.terms import Array

MOST = 300  # starts
PATIENCE = 40  # starts without anything new
NEAR = 1e-6  # of the linkage's size, before Gauss-Newton
SAME = 1e-5  # of the linkage's size, and [rad]: far above where searches end


def branches(mechanism: Mechanism, q: Array, seed: int = 0) -> tuple[Array, ...]:
    """Positions (n,) of every assembly that was found: q itself first, then from the nearest to the farthest.

    Held are the coordinates of the scenario's drivers where q has them, or the crank's angle. Angles are within half a turn of q's.

    Raises:
        ValueError: what is held leaves something free, or the joints are open at q.
    """
    held = hold_at(mechanism, q)
    freedom = Freedom(held)
    here = freedom.close(q)
    if here is None:
        raise ValueError(f"{mechanism.name} has no other assembly from here: its joints are open")
    if here.free.shape[1]:
        raise ValueError(f"{mechanism.name} is not held: {here.free.shape[1]} of its motions stay free beside its inputs")

    positions, rng, idle = [here.q], np.random.default_rng(seed), 0
    for _ in range(MOST):
        idle += 1
        if idle > PATIENCE:
            break
        start = here.q * freedom.scale + rng.uniform(-np.pi, np.pi, size=len(q)) * freedom.size
        root = levenberg_marquardt(lambda x: freedom.rows(x / freedom.scale), start, tolerance=NEAR * freedom.size)
        place = freedom.close(root.x / freedom.scale) if root.flag == ExitFlag.CONVERGED else None
        if place is None:
            continue
        other = _turn_back(mechanism, place.q, here.q)
        if all(_apart(freedom, other, x) > SAME * freedom.size for x in positions):
            positions.append(other)
            idle = 0
    return (positions[0], *sorted(positions[1:], key=lambda x: _apart(freedom, x, here.q)))


def hold_at(mechanism: Mechanism, q: Array) -> Mechanism:
    """The linkage with its inputs held where they are at q (n,)."""
    if mechanism.drivers:
        still = tuple(replace(x, law=constant(float(value(x.coordinate, q)), 0.0)) for x in mechanism.drivers)
        return replace(mechanism, drivers=still)
    if mechanism.crank is None:
        raise ValueError(f"{mechanism.name} has neither a driver nor a crank whose position could be held")
    crank = constant(float(angle_at(q, mechanism.crank)), 0.0)
    return replace(mechanism, drivers=(AngleDriver("crank", crank, mechanism.crank),))


def _apart(freedom: Freedom, a: Array, b: Array) -> float:
    return float(np.abs((a - b) * freedom.scale).max())


def _turn_back(mechanism: Mechanism, q: Array, near: Array) -> Array:
    """The same position with the angles within half a turn of others; links that a slide ties together turn as one."""
    q = q.copy()
    turns = 2 * np.pi * np.round(angles(q - near) / (2 * np.pi))
    for link, (root, _) in shared_angles(mechanism).items():
        if root != GROUND:  # what slides on the ground has no whole turns
            angles(q)[link] -= turns[root]
    return q
