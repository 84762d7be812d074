"""Find the assemblies of a linkage with its inputs fixed, from random starts.

From randomly placed links Levenberg-Marquardt approaches the constraints, and Gauss-Newton converges onto them. The search ends
after PATIENCE starts without a new assembly, and may therefore miss assemblies.
"""

import numpy as np

from gauss_bench.kinematics.freedom import Freedom, hold
from gauss_bench.kinematics.root_finding import ExitFlag, levenberg_marquardt
from gauss_bench.kinematics.topology import shared_angles
from gauss_bench.mechanism.model import GROUND, Angle, Mechanism
from gauss_bench.mechanism.spaces import angles
from gauss_bench.terms import Array

MOST = 300  # largest number of starts
PATIENCE = 40  # number of starts without a new assembly after which the search ends
NEAR = 1e-6  # [sizes of the linkage] residual at which Gauss-Newton takes over
SAME = 1e-5  # [sizes of the linkage, rad] distance below which two assemblies are the same: far above the error of a search


def branches(mechanism: Mechanism, q: Array) -> tuple[Array, ...]:
    """Return the positions (n,) of all assemblies that the search finds: q itself first, then from the nearest to the farthest.

    The inputs (the coordinates of the drivers, or the crank's angle) are the same in all. Angles are within half a turn of those in
    q.

    Raises:
        ValueError: the linkage has no inputs, the fixed inputs leave a motion free, or the joints are open at q.
    """
    freedom = Freedom(hold_inputs(mechanism, q))
    closed = freedom.close(q)
    if closed is None:
        raise ValueError(f"{mechanism.name}: other assemblies cannot be found, because its joints are open")
    if closed.free.shape[1]:
        raise ValueError(f"{mechanism.name}: {closed.free.shape[1]} of its motions stay free if its inputs are fixed")

    positions, rng, idle = [closed.q], np.random.default_rng(0), 0
    for _ in range(MOST):
        if idle == PATIENCE:
            break
        idle += 1
        start = closed.q * freedom.scale + rng.uniform(-np.pi, np.pi, size=len(q)) * freedom.size
        root = levenberg_marquardt(lambda x: freedom.rows(x / freedom.scale), start, tolerance=NEAR * freedom.size)
        place = freedom.close(root.x / freedom.scale) if root.flag == ExitFlag.CONVERGED else None
        if place is None:
            continue
        assembly = _turn_back(mechanism, place.q, closed.q)
        if all(_apart(freedom, assembly, x) > SAME * freedom.size for x in positions):
            positions.append(assembly)
            idle = 0
    return (positions[0], *sorted(positions[1:], key=lambda x: _apart(freedom, x, closed.q)))


def hold_inputs(mechanism: Mechanism, q: Array) -> Mechanism:
    """Return the linkage with its drivers, or else its crank, fixed at their values in q (n,).

    Raises:
        ValueError: the linkage has neither drivers nor a crank.
    """
    if mechanism.drivers:
        return hold(mechanism, q, [x.coordinate for x in mechanism.drivers])
    if mechanism.crank is None:
        raise ValueError(f"{mechanism.name} has neither a driver nor a crank that could be fixed")
    return hold(mechanism, q, [Angle(GROUND, mechanism.crank)])


def _apart(freedom: Freedom, a: Array, b: Array) -> float:
    """Return the largest difference of any scaled coordinate [m] between two positions."""
    return float(np.abs((a - b) * freedom.scale).max())


def _turn_back(mechanism: Mechanism, q: Array, near: Array) -> Array:
    """Return q with angles within half a turn of `near`; links joined by a slide turn together."""
    q = q.copy()
    turns = 2 * np.pi * np.round(angles(q - near) / (2 * np.pi))
    for link, (root, _) in shared_angles(mechanism).items():
        if root != GROUND:  # a link that slides on the ground cannot turn
            angles(q)[link] -= turns[root]
    return q
