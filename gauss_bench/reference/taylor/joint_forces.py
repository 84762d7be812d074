"""Compute the joint forces at samples in extended precision: the multipliers of the constraint rows in absolute coordinates.

A column of J^T has the forces of a constraint on the links for a multiplier of one: forces at points, or a torque. The constraints
are in the mechanism's order: two for each joint, then one for each driver, then one for each knife edge. The force of each kind of
constraint is derived here a second time, independently of `mechanism/coordinates.py`:

    pin:          a force along x, then a force along y, on the point b, each with its reaction on the point a
    slide:        a force across the guide on the block, with its reaction in the same line on the guide; then a torque on the
                  block, with its reaction on the guide
    driver:       on an angle a torque; on a slide a force along the guide; on a length a force along the line of its two points
    knife edge:   a force across the edge at its point

The system J^T lambda = Q - M a has more rows than unknowns, so that its residual checks the whole motion.
"""

import numpy as np

from gauss_bench.mechanism.frames import unit
from gauss_bench.mechanism.model import GROUND, AngleDriver, Prismatic, SlideDriver
from gauss_bench.reference.refinement import pseudo_inverse, solve_by_chord
from gauss_bench.reference.taylor.arithmetic import Value, dot, vanishes
from gauss_bench.reference.taylor.forces import Wrench
from gauss_bench.reference.taylor.moving_vectors import Instant
from gauss_bench.reference.taylor.solve import Long, to_dense
from gauss_bench.reference.taylor.vector_sums import LoopCoordinates
from gauss_bench.terms import Array


def reactions(coordinates: LoopCoordinates, at: Instant) -> list[dict[int, Value]]:
    """Return the rows of the constraint Jacobian J in absolute coordinates at an instant, each as column -> value.

    A row of J equals the generalised force of a unit reaction in a joint, a driver or a knife edge. Each row is therefore built
    from the forces and moments that this unit reaction exerts on the links (`Wrench`): `pull` adds a pair of opposite forces at two
    points, `slide` such a pair in one line on two links, `twist` a pair of torques, and `push` a single force.
    """
    mechanism, wrenches = coordinates.mechanism, list[Wrench]()

    def add_row() -> Wrench:
        """Add a constraint row, whose forces are still zero, and return it."""
        wrenches.append(Wrench(coordinates, at))
        return wrenches[-1]

    for joint in mechanism.joints:
        first, second = add_row(), add_row()
        if isinstance(joint, Prismatic):
            first.slide(joint.block, joint.guide, first.turn(unit(joint.angle, across=True), joint.guide.link))
            second.twist(joint.block.link, joint.guide.link, 1)
        else:
            first.pull(joint.b, joint.a, (1, 0))
            second.pull(joint.b, joint.a, (0, 1))
    for driver in mechanism.drivers:
        row = add_row()
        if isinstance(driver, AngleDriver):
            row.twist(driver.link, GROUND, 1)
        elif isinstance(driver, SlideDriver):
            slide = driver.joint
            row.slide(slide.block, slide.guide, row.turn(unit(slide.angle), slide.guide.link))
        else:
            d = row.value(row.gap(driver.a, driver.b))
            length = at.arithmetic.sqrt(dot(d, d))
            row.pull(driver.b, driver.a, (d[0] / length, d[1] / length))
    for edge in mechanism.knife_edges:
        row = add_row()
        row.push(edge.point, row.turn(unit(edge.angle, across=True), edge.point.link))
    return [{j: x for j, x in enumerate(wrench.flat()) if not vanishes(x)} for wrench in wrenches]


def joint_forces(rows: list[dict[int, Value]], force: Long, redundant: int, eps: float) -> tuple[Long, float]:
    """Return the multipliers (k, m) of J^T lambda = force (k, n), and the largest residual relative to the forces.

    If rows are redundant, some multipliers are set to zero and the others are not unique; the residual is meaningful all the same.

    Raises:
        Unsolved: the rows of J at a sample are linearly dependent in double precision.
    """
    k, n = force.shape
    multipliers = np.zeros((k, len(rows)), dtype=force.dtype)
    J = to_dense(rows, k, n)
    kept = choose_independent(J[0], len(rows) - redundant)

    def residual(x: Long) -> Long:
        """Return J^T x - force (k, n) for multipliers x (k, kept) of the kept rows."""
        remaining = -force
        for i, r in enumerate(kept):
            for j, value in rows[r].items():
                remaining[:, j] = remaining[:, j] + value * x[:, i]
        return remaining

    inverse = pseudo_inverse(np.swapaxes(J[:, kept], 1, 2))
    multipliers[:, kept] = solve_by_chord(residual, inverse, multipliers[:, kept], eps)
    off, scale = (float(np.abs(x).astype(float).max(initial=0.0)) for x in (residual(multipliers[:, kept]), force))
    return multipliers, off / max(scale, 1e-300)


def choose_independent(J: Array, count: int) -> list[int]:
    """Return the indices of `count` independent rows of J (m, n), in order."""
    from scipy.linalg import qr

    return sorted(qr(J.T, mode="r", pivoting=True)[1][:count].tolist()) if count else []
