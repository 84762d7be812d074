"""Joint forces of samples in extended precision: multipliers of the constraint rows in absolute coordinates.

A row of J^T is what its joint does to the links with a multiplier of one: a force at the points that it holds, or a torque.
Rows stand in the mechanism's order, two per joint, then drivers, then knife edges, each written here anew from what it means:

    pin           along x, then along y, on b, with the reaction on a
    slide         across the guide on the block, with the reaction in the same line on the guide; then a torque
    driver        what holds the driven coordinate: a torque, a force along the guide, a force along the line of two points
    knife edge    across the edge at its point

J^T lambda = Q - M a has more rows than unknowns; that all of them are met is the check of the whole motion.
"""

from typing import Any

import numpy as np

from gauss_bench.mechanism.model import GROUND, AngleDriver, Prismatic, SlideDriver
from gauss_bench.mechanism.numbers import direction
from gauss_bench.reference.refinement import chord, pseudo_inverse
from gauss_bench.reference.taylor.arithmetic import Value, dot, vanishes
from gauss_bench.reference.taylor.forces import Wrench
from gauss_bench.reference.taylor.moving_vectors import Instant
from gauss_bench.reference.taylor.solve import Long, dense
from gauss_bench.reference.taylor.vector_sums import LoopCoordinates
from gauss_bench.terms import Array


def reactions(coordinates: LoopCoordinates, at: Instant) -> list[dict[int, Value]]:
    """Rows of J, column -> value, at an instant."""
    mechanism, rows = coordinates.mechanism, 2 * len(coordinates.mechanism.joints)
    wrenches = [Wrench(coordinates, at) for _ in range(rows + len(mechanism.drivers) + len(mechanism.knife_edges))]
    for joint, first, second in zip(mechanism.joints, wrenches[:rows:2], wrenches[1:rows:2], strict=True):
        if isinstance(joint, Prismatic):
            first.slide(joint.block, joint.guide, first.turned(across(joint.angle), joint.guide.link))
            second.twist(joint.block.link, joint.guide.link, 1)
        else:
            first.pull(joint.b, joint.a, (1, 0))
            second.pull(joint.b, joint.a, (0, 1))
    for driver, wrench in zip(mechanism.drivers, wrenches[rows:], strict=False):
        if isinstance(driver, AngleDriver):
            wrench.twist(driver.link, GROUND, 1)
        elif isinstance(driver, SlideDriver):
            slide = driver.joint
            wrench.slide(slide.block, slide.guide, wrench.turned(direction(slide.angle), slide.guide.link))
        else:
            d = wrench.value(wrench.gap(driver.a, driver.b))
            length = at.arithmetic.sqrt(dot(d, d))
            wrench.pull(driver.b, driver.a, (d[0] / length, d[1] / length))
    for edge, wrench in zip(mechanism.knife_edges, wrenches[rows + len(mechanism.drivers) :], strict=True):
        wrench.push(edge.point, wrench.turned(across(edge.angle), edge.point.link))
    return [{j: x for j, x in enumerate(wrench.flat()) if not vanishes(x)} for wrench in wrenches]


def across(angle: Any) -> Array:
    u = direction(angle)
    return np.array([-u[1], u[0]])


def joint_forces(rows: list[dict[int, Value]], force: Long, redundant: int, eps: float) -> tuple[Long, float]:
    """Multipliers (k, m) of J^T lambda = force (k, n), and the largest residual relative to the forces.

    Where rows are redundant some multipliers stay zero, and none of them mean anything; the residual does.

    Raises:
        Unsolved: a sample is singular in double precision.
    """
    k, n = force.shape
    multipliers = np.zeros((k, len(rows)), dtype=force.dtype)
    J = dense(rows, k, n)
    kept = independent(J[0], len(rows) - redundant)

    def left(x: Long) -> Long:
        parts = -force
        for i, r in enumerate(kept):
            for j, value in rows[r].items():
                parts[:, j] = parts[:, j] + value * x[:, i]
        return parts

    multipliers[:, kept] = chord(left, pseudo_inverse(np.swapaxes(J[:, kept], 1, 2)), multipliers[:, kept], eps)
    off, scale = (float(np.abs(x).astype(float).max(initial=0.0)) for x in (left(multipliers[:, kept]), force))
    return multipliers, off / max(scale, 1e-300)


def independent(J: Array, count: int) -> list[int]:
    """As many independent rows of J (m, n), in their order."""
    from scipy.linalg import qr

    return sorted(qr(J.T, mode="r", pivoting=True)[1][:count].tolist()) if count else []
