"""Constraint residual, Jacobian and acceleration bias of a linkage in absolute coordinates.

Apart from pins, which hold two points together, every row holds one scalar coordinate (`coordinates.py`):

    revolute    p_b - p_a = 0
    prismatic   x - offset = 0,  x across the line of the guide;    theta_b - theta_g - turn = 0
    driver      x - law(t) = 0,  x an angle, a way along a guide or a distance
    knife edge  x' = 0   (no position level)

gamma collects what is left of the second derivative when J a is taken away, with the opposite sign: J a = gamma.
Source: Haug, Computer-Aided Kinematics and Dynamics of Mechanical Systems (1989), sections 3.3 and 3.6.

All functions take one state, q (n,), or a batch, q (..., n), in double or in the longer type the linkage was built in.
"""

from dataclasses import dataclass
from typing import assert_never

import numpy as np

from gauss_bench.mechanism.coordinates import AngleState, SlipState, Stack, Stacked, groups
from gauss_bench.mechanism.model import Coordinate, Mechanism, Prismatic, Revolute
from gauss_bench.terms import Array


@dataclass(frozen=True)
class Rows:
    """All constraint rows at a state (or batch): joints two each, then driver, then knife edges."""

    phi: Array
    J: Array
    gamma: Array
    phi_t: Array


class Constraints:
    """The constraint rows of one mechanism, with every index worked out once; the ground's columns of J are dropped at the end."""

    def __init__(self, mechanism: Mechanism):
        self.n = mechanism.n
        self.joint_rows = 2 * len(mechanism.joints)
        self.holonomic = self.joint_rows + len(mechanism.drivers)
        self.m = self.holonomic + len(mechanism.knife_edges)
        self.laws = [driver.law for driver in mechanism.drivers]
        self.stack = Stack(len(mechanism.links))
        pins: list[tuple[int, Revolute]] = []
        held: list[tuple[int, Coordinate, float]] = []
        for row, joint in zip(range(0, self.joint_rows, 2), mechanism.joints, strict=True):
            match joint:
                case Revolute():
                    pins.append((row, joint))
                case Prismatic():
                    (beside, offset), (turning, turn) = joint.held
                    held += [(row, beside, offset), (row + 1, turning, turn)]
                case _:
                    assert_never(joint)
        held += [(row, driver.coordinate, 0.0) for row, driver in enumerate(mechanism.drivers, self.joint_rows)]
        self.pin_a, self.pin_b = self.stack.points([j.a for _, j in pins]), self.stack.points([j.b for _, j in pins])
        kinds = groups(self.stack, [coordinate for _, coordinate, _ in held])
        self.edge = self.stack.points([e.point for e in mechanism.knife_edges])
        self.edge_normal = self.stack.directions([(e.point.link, e.angle, True) for e in mechanism.knife_edges])
        self.stack.close()
        self.pin_x = np.array([row for row, _ in pins], dtype=int)
        self.pin_y, self.edge_rows = self.pin_x + 1, np.arange(self.holonomic, self.m)
        self.held = []  # rows, values and coordinates by kinds
        for group in kinds:
            rows, _, values = zip(*(held[i] for i in group.which), strict=True)
            self.held.append((np.array(rows), np.array(values), group))
        self.template = self._constant_entries()
        self.rows, self.columns = self._varying_entries()

    def _constant_entries(self) -> Array:
        """(m, n + 3) Jacobian entries that never change; the last three columns belong to the ground."""
        J = np.zeros((self.m, self.n + 3))
        for axis, rows in enumerate((self.pin_x, self.pin_y)):
            J[rows, 3 * self.stack.links[self.pin_b] + axis] = 1.0
            J[rows, 3 * self.stack.links[self.pin_a] + axis] = -1.0
        for rows, _, group in self.held:
            if group.constant:
                for column, entry in zip(group.columns, AngleState.entries, strict=True):
                    J[rows, column] += entry
        return J

    def _varying_entries(self) -> tuple[Array, Array]:
        """Rows and columns of the entries written at every state, in the order in which `__call__` lists their values."""
        a, b, e = (3 * self.stack.links[x] for x in (self.pin_a, self.pin_b, self.edge))
        rows, columns = [self.pin_x, self.pin_y] * 2, [b + 2, b + 2, a + 2, a + 2]
        for row, _, group in self.held:
            if not group.constant:
                rows += [row] * len(group.columns)
                columns += group.columns
        rows += [self.edge_rows] * 3
        return np.concatenate(rows), np.concatenate([*columns, e, e + 1, e + 2])

    def __call__(self, t: float | Array, q: Array, v: Array) -> Rows:
        """Residual, Jacobian, bias and explicit rate of all rows at state(s) q, v (..., n) and time(s) t [s]."""
        x = self.stack.at(q, v)
        dtype, shape = x.dtype, (*q.shape[:-1], self.m)
        phi, gamma, phi_t = (np.zeros(shape, dtype=dtype) for _ in range(3))
        values: list[Array] = []
        if len(self.pin_x):
            self._pins(x, phi, gamma, values)
        for rows, held, group in self.held:
            state = group.at(x)
            phi[..., rows] = state.value - held
            if not group.constant:
                gamma[..., rows] = -state.bias
                values += state.entries
        for row, law in enumerate(self.laws, self.joint_rows):
            value, rate, second = law(t)
            phi[..., row] -= value
            phi_t[..., row] = -np.asarray(rate)
            gamma[..., row] += second
        if len(self.edge_rows):
            slip = SlipState(x.directions(self.edge_normal), x.ends(self.edge))
            gamma[..., self.edge_rows] = -slip.bias
            values += slip.entries
        J = np.empty((*shape, self.n + 3), dtype=dtype)
        J[...] = self.template
        if values:
            J[..., self.rows, self.columns] = np.concatenate(values, axis=-1)
        return Rows(phi, np.ascontiguousarray(J[..., : self.n]), gamma, phi_t)

    def _pins(self, x: Stacked, phi: Array, gamma: Array, values: list[Array]) -> None:
        a, b = x.ends(self.pin_a), x.ends(self.pin_b)
        gap = b.z + b.r - a.z - a.r
        centripetal = b.r * b.omega**2 - a.r * a.omega**2
        phi[..., self.pin_x], phi[..., self.pin_y] = gap.real, gap.imag
        gamma[..., self.pin_x], gamma[..., self.pin_y] = centripetal.real, centripetal.imag
        values += [-b.r.imag, b.r.real, a.r.imag, -a.r.real]
