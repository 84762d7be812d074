"""Joint forces of samples in extended precision: multipliers of the constraint rows in absolute coordinates.

Rows stand in the mechanism's order: two per joint, then drivers, then knife edges, each written here anew from what it means. With
p = z + r a link-fixed point, n a direction that turns with link g and i the quarter turn,

    pin           p_b - p_a:        1 and i r_b for b, less 1 and i r_a for a
    along n       n . (p_b - p_g):  n and n . i r_b for b, less n and n . i r_g for g, and (i n) . (p_b - p_g) for its angle

J^T lambda = Q - M a has more rows than unknowns; that all of them are met is the check of the whole motion. As the least-squares
problem [1 J^T; J 0][r; lambda] = [Q - M a; 0] it is solved in double, sparse, and refined with extended residuals r.
Source: Higham, Accuracy and Stability of Numerical Algorithms (2nd ed. 2002), sections 20.5 and 20.6.
"""

from collections import defaultdict
from collections.abc import Callable, Iterator
from typing import Any, assert_never

import numpy as np

from gauss_bench.mechanism.model import GROUND, AngleDriver, Driver, LengthDriver, Mechanism, Point, Prismatic, SlideDriver
from gauss_bench.mechanism.numbers import direction, length
from gauss_bench.reference.taylor.solve import SWEEPS, Long, Unsolved
from gauss_bench.terms import Array

Entry = tuple[int, Any]  # column of J, and its value (k,) or a constant


class AbsoluteRows:
    """The Jacobian of one mechanism's constraint rows at samples q (k, n), row by row."""

    def __init__(self, mechanism: Mechanism, q: Long):
        self.q = q
        self.none = q[:, 0] - q[:, 0]
        self.rows: list[list[Entry]] = []
        for joint in mechanism.joints:
            if isinstance(joint, Prismatic):
                u = direction(joint.angle)
                self.rows.append(self._along(np.array([-u[1], u[0]]), joint.guide, joint.block))
                self.rows.append(self._angles(joint.guide.link, joint.block.link))
            else:
                self.rows += [self._pin(joint.a, joint.b, axis) for axis in (0, 1)]
        self.rows += [self._driven(driver) for driver in mechanism.drivers]
        for edge in mechanism.knife_edges:
            u = direction(edge.angle)
            n = self._turn(np.array([-u[1], u[0]]), edge.point.link)
            self.rows.append(list(self._velocity(edge.point, n, 1)))

    def _turn(self, vector: Any, link: int) -> tuple[Any, Any]:
        if link == GROUND:
            return self.none + vector[0], self.none + vector[1]
        c, s = np.cos(self.q[:, 3 * link + 2]), np.sin(self.q[:, 3 * link + 2])
        return c * vector[0] - s * vector[1], s * vector[0] + c * vector[1]

    def _place(self, p: Point) -> tuple[Any, Any]:
        x, y = self._turn(p.local, p.link)
        return (x, y) if p.link == GROUND else (self.q[:, 3 * p.link] + x, self.q[:, 3 * p.link + 1] + y)

    def _velocity(self, p: Point, n: tuple[Any, Any], sign: int) -> Iterator[Entry]:
        """Entries of sign n . p'."""
        if p.link != GROUND:
            r = self._turn(p.local, p.link)
            entries = (n[0], n[1], n[1] * r[0] - n[0] * r[1])
            yield from ((3 * p.link + k, sign * x) for k, x in enumerate(entries))

    def _pin(self, a: Point, b: Point, axis: int) -> list[Entry]:
        n = (self.none + (1 - axis), self.none + axis)
        return [*self._velocity(b, n, 1), *self._velocity(a, n, -1)]

    def _angles(self, first: int, second: int) -> list[Entry]:
        return [(3 * i + 2, self.none + sign) for i, sign in ((second, 1), (first, -1)) if i != GROUND]

    def _along(self, vector: Any, guide: Point, block: Point) -> list[Entry]:
        n = self._turn(vector, guide.link)
        entries = [*self._velocity(block, n, 1), *self._velocity(guide, n, -1)]
        if guide.link != GROUND:
            far, near = self._place(block), self._place(guide)
            entries.append((3 * guide.link + 2, n[0] * (far[1] - near[1]) - n[1] * (far[0] - near[0])))
        return entries

    def _driven(self, driver: Driver) -> list[Entry]:
        match driver:
            case AngleDriver():
                return self._angles(GROUND, driver.link)
            case SlideDriver():
                return self._along(direction(driver.joint.angle), driver.joint.guide, driver.joint.block)
            case LengthDriver():
                far, near = self._place(driver.b), self._place(driver.a)
                gap = (far[0] - near[0], far[1] - near[1])
                u = (gap[0] / length(gap), gap[1] / length(gap))
                return [*self._velocity(driver.b, u, 1), *self._velocity(driver.a, u, -1)]
        assert_never(driver)

    def dense(self) -> Array:
        """(k, m, n) in double precision."""
        k, n = self.q.shape
        J = np.zeros((k, len(self.rows), n))
        for r, row in enumerate(self.rows):
            for j, value in row:
                J[:, r, j] += value.astype(float)
        return J

    def transposed(self, multipliers: Long) -> Long:
        """J^T lambda (k, n) in extended precision."""
        parts: dict[int, Any] = defaultdict(lambda: self.none)
        for r, row in enumerate(self.rows):
            for j, value in row:
                parts[j] = parts[j] + value * multipliers[:, r]
        return np.stack([parts[j] for j in range(self.q.shape[1])], axis=-1)


def joint_forces(mechanism: Mechanism, q: Long, force: Long, redundant: int, eps: float) -> tuple[Long, float]:
    """Multipliers (k, m) of J^T lambda = force (k, n), and the largest residual relative to the forces.

    Where rows are redundant some multipliers stay zero, and none of them mean anything; the residual does.

    Raises:
        Unsolved: a sample is singular in double precision.
    """
    rows = AbsoluteRows(mechanism, q)
    m = len(rows.rows)
    multipliers = np.zeros((len(q), m), dtype=q.dtype)
    scale = max(float(np.abs(force).astype(float).max(initial=0.0)), 1e-300)
    if m == 0:
        return multipliers, float(np.abs(force).astype(float).max(initial=0.0)) / scale
    J = rows.dense()
    kept = _independent(J[0], m - redundant)
    solve = [_least_squares(sample[kept]) for sample in J]
    before = np.inf
    for _ in range(SWEEPS):
        left = force - rows.transposed(multipliers)
        off = float(np.abs(left).astype(float).max(initial=0.0)) / scale
        if off <= eps or off >= before / 2:
            return multipliers, min(off, before)
        step = np.array([one(x) for one, x in zip(solve, left.astype(float), strict=True)])
        multipliers[:, kept] = multipliers[:, kept] + step
        before = off
    return multipliers, before


def _least_squares(J: Array) -> Callable[[Array], Array]:
    """The map that gives the least-squares solution (m,) of J^T y = b (n,)."""
    from scipy.sparse import csc_array
    from scipy.sparse.linalg import splu

    m, n = J.shape
    matrix = np.zeros((n + m, n + m))
    matrix[:n, :n], matrix[:n, n:], matrix[n:, :n] = np.eye(n), J.T, J
    try:
        factors = splu(csc_array(matrix))
    except RuntimeError as error:
        raise Unsolved("the joints carry no unique forces at a sample: the position is singular") from error
    return lambda b: np.asarray(factors.solve(np.concatenate([b, np.zeros(m)]))[n:])


def _independent(J: Array, count: int) -> list[int]:
    """As many independent rows of J (m, n), in their order."""
    from scipy.linalg import qr

    return sorted(qr(J.T, mode="r", pivoting=True)[1][:count].tolist())
