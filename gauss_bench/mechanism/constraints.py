"""Constraint residual, Jacobian and acceleration bias of a linkage in absolute coordinates.

With R(theta) the rotation of a link, S the quarter turn and r = R s the arm of a link-fixed point s:

    p = [x, y] + r,    dp/dtheta = S r,    p'' = [x'', y''] + S r alpha - r omega^2

    revolute    p_b - p_a = 0
    prismatic   n . (p_b - p_g) - offset = 0,   theta_b - theta_g - turn = 0,   n = R_g S u the normal of the guide
    driver      theta - law(t) = 0
    knife edge  n . p' = 0   (no position level)

gamma collects what is left of the second derivative when J a is taken away, with the opposite sign: J a = gamma.
Source: Haug, Computer-Aided Kinematics and Dynamics of Mechanical Systems (1989), sections 3.3 and 3.6.

All functions take one state, q (n,), or a batch, q (..., n).
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from gauss_bench.mechanism.model import GROUND, Mechanism, Point, Prismatic
from gauss_bench.terms import Array


@dataclass(frozen=True)
class Rows:
    """All constraint rows at a state (or batch): joints two each, then driver, then knife edges."""

    phi: Array
    J: Array
    gamma: Array
    phi_t: Array


def unpacked(x: Array) -> tuple[Array, Array, Array]:
    """x, y and angle (..., links + 1) of a state (..., n), with a resting ground appended."""
    links = x.shape[-1] // 3
    out = np.zeros((*x.shape[:-1], links + 1, 3))
    out[..., :-1, :] = x.reshape(*x.shape[:-1], links, 3)
    return out[..., 0], out[..., 1], out[..., 2]


class Constraints:
    """The constraint rows of one mechanism, with every index worked out once.

    All link-fixed vectors (ends of pins, ends of slides, their normals) stand in one list, so that one rotation serves them all;
    the ground is one more link that rests, and its columns of J are dropped at the end.
    """

    def __init__(self, mechanism: Mechanism):
        self.n = mechanism.n
        self.joint_rows = 2 * len(mechanism.joints)
        self.holonomic = self.joint_rows + (mechanism.driver is not None)
        self.m = self.holonomic + len(mechanism.knife_edges)
        self.driver = mechanism.driver
        self.ground = len(mechanism.links)
        self.link: list[int] = []
        self.local: list[Array] = []
        pins = [(2 * k, j) for k, j in enumerate(mechanism.joints) if not isinstance(j, Prismatic)]
        slides = [(2 * k, j) for k, j in enumerate(mechanism.joints) if isinstance(j, Prismatic)]
        knives = [(self.holonomic + k, e) for k, e in enumerate(mechanism.knife_edges)]
        self.pin_a, self.pin_b = self._points([j.a for _, j in pins]), self._points([j.b for _, j in pins])
        self.guide, self.block = self._points([j.guide for _, j in slides]), self._points([j.block for _, j in slides])
        self.slide_normal = self._normals([(j.guide.link, j.angle) for _, j in slides])
        self.edge = self._points([e.point for _, e in knives])
        self.edge_normal = self._normals([(e.point.link, e.angle) for _, e in knives])
        self.links = np.array(self.link, dtype=int)
        self.X, self.Y = np.array(self.local, dtype=float).reshape(-1, 2).T
        self.offset, self.turn = np.array([j.offset for _, j in slides]), np.array([j.turn for _, j in slides])
        self.pin_x = np.array([row for row, _ in pins], dtype=int)
        self.slide_gap = np.array([row for row, _ in slides], dtype=int)
        self.edge_rows = np.array([row for row, _ in knives], dtype=int)
        self.pin_y, self.slide_turn = self.pin_x + 1, self.slide_gap + 1
        self.template = self._constant_entries()
        self.rows, self.columns = self._varying_entries()

    def _points(self, points: list[Point]) -> slice:
        return self._add([p.link for p in points], [p.local for p in points])

    def _normals(self, lines: list[tuple[int, float]]) -> slice:
        return self._add([i for i, _ in lines], [np.array([-np.sin(x), np.cos(x)]) for _, x in lines])

    def _add(self, links: list[int], local: list[Array]) -> slice:
        first = len(self.link)
        self.link += [self.ground if i == GROUND else i for i in links]
        self.local += local
        return slice(first, len(self.link))

    def _constant_entries(self) -> Array:
        """(m, n + 3) Jacobian entries that never change; the last three columns belong to the ground."""
        J = np.zeros((self.m, self.n + 3))
        for axis, rows in enumerate((self.pin_x, self.pin_y)):
            J[rows, 3 * self.links[self.pin_b] + axis] = 1.0
            J[rows, 3 * self.links[self.pin_a] + axis] = -1.0
        J[self.slide_turn, 3 * self.links[self.block] + 2] = 1.0
        J[self.slide_turn, 3 * self.links[self.guide] + 2] = -1.0
        if self.driver is not None:
            J[self.joint_rows, 3 * self.driver.link + 2] = 1.0
        return J

    def _varying_entries(self) -> tuple[Array, Array]:
        """Rows and columns of the entries written at every state, in the order in which `__call__` lists their values."""
        a, b, g, k, e = (3 * self.links[x] for x in (self.pin_a, self.pin_b, self.guide, self.block, self.edge))
        rows = [self.pin_x, self.pin_y] * 2 + [self.slide_gap] * 6 + [self.edge_rows] * 3
        columns = [b + 2, b + 2, a + 2, a + 2, k, k + 1, k + 2, g, g + 1, g + 2, e, e + 1, e + 2]
        return np.concatenate(rows), np.concatenate(columns)

    def __call__(self, t: float | Array, q: Array, v: Array) -> Rows:
        """Residual, Jacobian, bias and explicit rate of all rows at state(s) q, v (..., n) and time(s) t [s]."""
        x, y, theta = unpacked(q)
        u, w, omega = unpacked(v)
        c, s = np.cos(theta)[..., self.links], np.sin(theta)[..., self.links]
        rx, ry = c * self.X - s * self.Y, s * self.X + c * self.Y
        arms = _Arms(x[..., self.links], y[..., self.links], u[..., self.links], w[..., self.links], rx, ry, omega[..., self.links])
        shape = (*q.shape[:-1], self.m)
        phi, gamma, phi_t = np.zeros(shape), np.zeros(shape), np.zeros(shape)
        values: list[Array] = []
        if len(self.pin_x):
            self._pins(arms, phi, gamma, values)
        if len(self.slide_gap):
            self._slides(arms, theta, phi, gamma, values)
        if self.driver is not None:
            angle, phi_t[..., self.joint_rows], gamma[..., self.joint_rows] = self.driver.law(t)
            phi[..., self.joint_rows] = theta[..., self.driver.link] - angle
            phi_t[..., self.joint_rows] *= -1.0
        if len(self.edge_rows):
            self._edges(arms, gamma, values)
        J = np.empty((*shape, self.n + 3))
        J[...] = self.template
        if values:
            J[..., self.rows, self.columns] = np.concatenate(values, axis=-1)
        return Rows(phi, np.ascontiguousarray(J[..., : self.n]), gamma, phi_t)

    def _pins(self, arms: "_Arms", phi: Array, gamma: Array, values: list[Array]) -> None:
        a, b = arms.part(self.pin_a), arms.part(self.pin_b)
        phi[..., self.pin_x] = b.x + b.rx - a.x - a.rx
        phi[..., self.pin_y] = b.y + b.ry - a.y - a.ry
        wa, wb = a.omega**2, b.omega**2
        gamma[..., self.pin_x] = b.rx * wb - a.rx * wa
        gamma[..., self.pin_y] = b.ry * wb - a.ry * wa
        values += [-b.ry, b.rx, a.ry, -a.rx]

    def _slides(self, arms: "_Arms", theta: Array, phi: Array, gamma: Array, values: list[Array]) -> None:
        g, b, normal = arms.part(self.guide), arms.part(self.block), arms.part(self.slide_normal)
        nx, ny = normal.rx, normal.ry
        gap_x, gap_y = b.x + b.rx - g.x - g.rx, b.y + b.ry - g.y - g.ry
        rate_x = b.u - b.omega * b.ry - g.u + g.omega * g.ry
        rate_y = b.w + b.omega * b.rx - g.w - g.omega * g.rx
        wg, wb = g.omega**2, b.omega**2
        phi[..., self.slide_gap] = nx * gap_x + ny * gap_y - self.offset
        phi[..., self.slide_turn] = theta[..., self.links[self.block]] - theta[..., self.links[self.guide]] - self.turn
        centripetal = nx * (g.rx * wg - b.rx * wb - gap_x * wg) + ny * (g.ry * wg - b.ry * wb - gap_y * wg)
        gamma[..., self.slide_gap] = -centripetal - 2 * g.omega * (nx * rate_y - ny * rate_x)
        block_arm = ny * b.rx - nx * b.ry
        guide_arm = nx * gap_y - ny * gap_x + nx * g.ry - ny * g.rx
        values += [nx, ny, block_arm, -nx, -ny, guide_arm]

    def _edges(self, arms: "_Arms", gamma: Array, values: list[Array]) -> None:
        e, normal = arms.part(self.edge), arms.part(self.edge_normal)
        nx, ny = normal.rx, normal.ry
        along = nx * (e.w + e.omega * e.rx) - ny * (e.u - e.omega * e.ry)
        gamma[..., self.edge_rows] = (nx * e.rx + ny * e.ry) * e.omega**2 - e.omega * along
        values += [nx, ny, ny * e.rx - nx * e.ry]


class _Arms(NamedTuple):
    """Per link-fixed vector: position x, y, velocity u, w and angular speed of its link, and the vector rx, ry in world axes."""

    x: Array
    y: Array
    u: Array
    w: Array
    rx: Array
    ry: Array
    omega: Array

    def part(self, which: slice) -> "_Arms":
        return _Arms(*(values[..., which] for values in self))
