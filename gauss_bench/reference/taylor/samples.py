"""States in loop coordinates as samples of a motion in absolute coordinates, with joint forces and residuals.

The joint forces are the multipliers of the constraint rows in absolute coordinates. A column of J^T has the forces of a constraint
on the links for a multiplier of one. The constraints are in the mechanism's order: two for each joint, then one for each driver,
then one for each knife edge. Each is derived here a second time, independently of `mechanism/coordinates.py`:

    pin:          a force along x, then a force along y, on the point b, each with its reaction on the point a
    slide:        a force across the guide on the block, with its reaction in the same line on the guide; then a torque on the
                  block, with its reaction on the guide
    driver:       on an angle a torque; on a slide a force along the guide; on a length a force along the line of its two points
    knife edge:   a force across the edge at its point

The system J^T lambda = Q - M a has more rows than unknowns, so that its residual checks the whole motion.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from gauss_bench.mechanism.frames import unit
from gauss_bench.mechanism.model import GROUND, AngleDriver, Prismatic, SlideDriver
from gauss_bench.mechanism.numbers import Number
from gauss_bench.reference.motion import Motion
from gauss_bench.reference.refinement import pseudo_inverse, solve_by_chord
from gauss_bench.reference.taylor.arithmetic import Long, Value, dot, epsilon, multiply, stack_arrays, to_dense, vanishes
from gauss_bench.reference.taylor.forces import Loads, Wrench
from gauss_bench.reference.taylor.rows import LoopRows
from gauss_bench.reference.taylor.vector_sums import NONE, Instant, LoopCoordinates, Vectors, at_states

BALANCE = 1e-25  # largest relative residual of the equations of motion in 128 bit; for other numbers it is scaled to their rounding
ROUNDING = 2.0**-112  # relative rounding of numbers with 128 bit


class Inconsistent(ArithmeticError):
    """Loops have opened or forces do not balance: the motion cannot be used."""


@dataclass(frozen=True, eq=False)
class LoopStates:
    """Loop coordinates x and their rates v, a (k, n) at times t (k,), all in one type of number."""

    t: Long
    x: Long
    v: Long
    a: Long


def sample(
    rows: LoopRows, states: LoopStates, times: Sequence[str], redundant: int, stopped: str, method: str, number: Number
) -> Motion:
    """Return a motion in absolute coordinates with joint forces, given states in loop coordinates; check its residuals.

    Args:
        times: the times of the states as decimal texts [s].
        redundant: number of redundant constraint rows.
        stopped: the reason why the motion ends early, or empty; method: the method in words.
        number: type of number of the states.

    Raises:
        Inconsistent: residuals of the loops or of the equations of motion are larger than rounding errors.
    """
    coordinates, eps = rows.coordinates, epsilon(number)
    mechanism = coordinates.mechanism
    at = at_states(states.x)
    v, a = (dict(enumerate(x.T)) for x in (states.v, states.a))
    zero = states.t - states.t  # (k,) in the type of number of the states

    def absolute(vectors: Vectors, angles: Mapping[int, Value]) -> Long:
        """Return coordinates (k, n) of all links or their derivatives, given those of the vectors l e and of the angles."""
        values: list[Value] = []
        for centre, index in zip(coordinates.centres, coordinates.angle, strict=True):
            values += [*at.combine(centre, vectors), 0 if index == NONE else angles.get(index, 0)]
        return stack_arrays(values, zero)

    q = absolute(at, dict(enumerate(at.x)))
    for i, turn in enumerate(coordinates.turn):  # constant angles between links that share an angle coordinate
        q[:, 3 * i + 2] = q[:, 3 * i + 2] + turn
    velocity = absolute(at.variation(v), v)
    acceleration = absolute(at.variation(a), a) + absolute(at.bias(v), {})
    # residuals of the loops: usually about a thousand roundings, but 1e-12 if decimals of the file contradict each other
    laws = rows.laws(states.t)
    gaps = stack_arrays([*rows.residuals(at, laws), *coordinates.turn_gaps], zero)
    rate_gaps = multiply(rows.entries(at), states.v) - stack_arrays(rows.rates(laws), zero)
    gap, rate_gap, fastest = (float(np.abs(x).astype(float).max(initial=0.0)) for x in (gaps, rate_gaps, states.v))
    if not max(gap, rate_gap / (1.0 + fastest)) < eps**0.5:
        raise Inconsistent(f"the loops are open by {gap:.1e} m or rad, and their rates differ by {rate_gap:.1e} per second")
    Q = stack_arrays(Loads(coordinates, at, v).flat(), zero)
    multipliers, imbalance = joint_forces(reactions(coordinates, at), Q - mechanism.mass * acceleration, redundant, eps)
    if not imbalance < BALANCE / ROUNDING * eps:
        raise Inconsistent(f"the equations of motion are satisfied only to {imbalance:.1e} of the joint forces")
    return Motion(tuple(times), q, velocity, acceleration, None if redundant else multipliers, (gap, rate_gap), stopped, method)


def reactions(coordinates: LoopCoordinates, at: Instant) -> list[dict[int, Value]]:
    """Return the rows of the constraint Jacobian J in absolute coordinates, each as column -> value.

    Each row is the generalised force of a unit reaction in a joint, a driver or a knife edge, and is built as a `Wrench`.
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
            d = at.combine(row.gap(driver.a, driver.b))
            length = at.arithmetic.sqrt(dot(d, d))
            row.pull(driver.b, driver.a, (d[0] / length, d[1] / length))
    for edge in mechanism.knife_edges:
        row = add_row()
        row.push(edge.point, row.turn(unit(edge.angle, across=True), edge.point.link))
    return [{j: x for j, x in enumerate(wrench.flat()) if not vanishes(x)} for wrench in wrenches]


def joint_forces(rows: list[dict[int, Value]], force: Long, redundant: int, eps: float) -> tuple[Long, float]:
    """Return the multipliers (k, m) of J^T lambda = force (k, n), and the largest residual relative to the forces.

    If rows are redundant, the multipliers of dependent rows are set to zero, and the others depend on the choice of these rows.

    Raises:
        Unsolved: the rows of J at a sample are linearly dependent in double precision.
    """
    from scipy.linalg import qr

    k, n = force.shape
    multipliers = np.zeros((k, len(rows)), dtype=force.dtype)
    J, count = to_dense(rows, k, n), len(rows) - redundant
    independent = sorted(qr(J[0].T, mode="r", pivoting=True)[1][:count].tolist()) if count else []  # indices of rows

    def residual(x: Long) -> Long:
        """Return J^T x - force (k, n) for multipliers x (k, count) of the independent rows."""
        remaining = -force
        for i, r in enumerate(independent):
            for j, value in rows[r].items():
                remaining[:, j] = remaining[:, j] + value * x[:, i]
        return remaining

    inverse = pseudo_inverse(np.swapaxes(J[:, independent], 1, 2))
    multipliers[:, independent] = solve_by_chord(residual, inverse, multipliers[:, independent], eps)
    off, scale = (float(np.abs(x).astype(float).max(initial=0.0)) for x in (residual(multipliers[:, independent]), force))
    return multipliers, off / max(scale, 1e-300)
