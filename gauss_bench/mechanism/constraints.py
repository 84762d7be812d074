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


def quarter_turn(x: Array) -> Array:
    """S x: (..., 2) vectors turned by +90 degrees."""
    return np.stack((-x[..., 1], x[..., 0]), axis=-1)


class Arms:
    """Vectors fixed in links, gathered so that all of them are rotated at once; the ground is one more, resting, link."""

    def __init__(self, links: list[int], local: list[Array], ground: int):
        self.link = np.array([ground if i == GROUND else i for i in links], dtype=int)
        self.local = np.array(local, dtype=float).reshape(-1, 2)

    def rotate(self, c: Array, s: Array) -> Array:
        """(..., k, 2) vectors in world axes, from cosines and sines (..., links + 1)."""
        c, s = c[..., self.link], s[..., self.link]
        x, y = self.local[:, 0], self.local[:, 1]
        return np.stack((c * x - s * y, s * x + c * y), axis=-1)


def padded(x: Array) -> Array:
    """(..., links + 1, 3): the state per link with a resting ground appended."""
    out = np.zeros((*x.shape[:-1], x.shape[-1] // 3 + 1, 3))
    out[..., :-1, :] = x.reshape(*x.shape[:-1], -1, 3)
    return out


class Constraints:
    """The constraint rows of one mechanism, with every index worked out once."""

    def __init__(self, mechanism: Mechanism):
        self.n = mechanism.n
        self.joint_rows = 2 * len(mechanism.joints)
        self.holonomic = self.joint_rows + (mechanism.driver is not None)
        self.m = self.holonomic + len(mechanism.knife_edges)
        self.driver = mechanism.driver
        pins = [(2 * k, j) for k, j in enumerate(mechanism.joints) if not isinstance(j, Prismatic)]
        slides = [(2 * k, j) for k, j in enumerate(mechanism.joints) if isinstance(j, Prismatic)]
        knives = [(self.holonomic + k, e) for k, e in enumerate(mechanism.knife_edges)]
        ground = len(mechanism.links)

        def points(which: list[Point]) -> Arms:
            return Arms([p.link for p in which], [p.local for p in which], ground)

        def normals(pairs: list[tuple[int, float]]) -> Arms:
            return Arms([i for i, _ in pairs], [np.array([-np.sin(x), np.cos(x)]) for _, x in pairs], ground)

        self.pin_rows = np.array([row for row, _ in pins], dtype=int)
        self.pin_a, self.pin_b = points([j.a for _, j in pins]), points([j.b for _, j in pins])
        self.slide_rows = np.array([row for row, _ in slides], dtype=int)
        self.guide, self.block = points([j.guide for _, j in slides]), points([j.block for _, j in slides])
        self.slide_normal = normals([(j.guide.link, j.angle) for _, j in slides])
        self.offset, self.turn = np.array([j.offset for _, j in slides]), np.array([j.turn for _, j in slides])
        self.knife_rows = np.array([row for row, _ in knives], dtype=int)
        self.knife_point = points([e.point for _, e in knives])
        self.knife_normal = normals([(e.point.link, e.angle) for _, e in knives])
        self.template = self._constant_entries()
        self.rows, self.columns = self._varying_entries()

    def _constant_entries(self) -> Array:
        """(m, n + 3) Jacobian entries that never change; the last three columns belong to the ground and are dropped."""
        J = np.zeros((self.m, self.n + 3))
        for axis in (0, 1):
            J[self.pin_rows + axis, 3 * self.pin_b.link + axis] = 1.0
            J[self.pin_rows + axis, 3 * self.pin_a.link + axis] = -1.0
        J[self.slide_rows + 1, 3 * self.block.link + 2] = 1.0
        J[self.slide_rows + 1, 3 * self.guide.link + 2] = -1.0
        if self.driver is not None:
            J[self.joint_rows, 3 * self.driver.link + 2] = 1.0
        return J

    def _varying_entries(self) -> tuple[Array, Array]:
        """Rows and columns of the entries written at every state, in the order of `_varying_values`."""
        pin, slide, knife = self.pin_rows, self.slide_rows, self.knife_rows
        a, b, g, k = self.pin_a.link, self.pin_b.link, self.guide.link, self.block.link
        e = self.knife_point.link
        rows = [pin, pin + 1, pin, pin + 1, *[slide] * 6, *[knife] * 3]
        columns = [
            *(3 * b + 2, 3 * b + 2, 3 * a + 2, 3 * a + 2),
            *(3 * k, 3 * k + 1, 3 * k + 2, 3 * g, 3 * g + 1, 3 * g + 2),
            *(3 * e, 3 * e + 1, 3 * e + 2),
        ]
        return np.concatenate(rows), np.concatenate(columns)

    def __call__(self, t: float | Array, q: Array, v: Array) -> Rows:
        """Residual, Jacobian, bias and explicit rate of all rows at state(s) q, v (..., n) and time(s) t [s]."""
        x, u = padded(q), padded(v)
        c, s, w = np.cos(x[..., 2]), np.sin(x[..., 2]), u[..., 2]
        phi, gamma, phi_t = (np.zeros((*q.shape[:-1], self.m)) for _ in range(3))
        values: list[Array] = []
        self._pins(x, c, s, w, phi, gamma, values)
        self._slides(x, u, c, s, w, phi, gamma, values)
        if self.driver is not None:
            angle, rate, second = self.driver.law(t)
            phi[..., self.joint_rows] = x[..., self.driver.link, 2] - angle
            phi_t[..., self.joint_rows] = -rate
            gamma[..., self.joint_rows] = second
        self._knives(u, c, s, w, gamma, values)
        J = np.empty((*q.shape[:-1], self.m, self.n + 3))
        J[...] = self.template
        J[..., self.rows, self.columns] = np.concatenate(values, axis=-1)
        return Rows(phi, np.ascontiguousarray(J[..., : self.n]), gamma, phi_t)

    def _pins(self, x: Array, c: Array, s: Array, w: Array, phi: Array, gamma: Array, values: list[Array]) -> None:
        a, b = self.pin_a, self.pin_b
        ra, rb = a.rotate(c, s), b.rotate(c, s)
        gap = x[..., b.link, :2] + rb - x[..., a.link, :2] - ra
        bias = rb * w[..., b.link, None] ** 2 - ra * w[..., a.link, None] ** 2
        for axis in (0, 1):
            phi[..., self.pin_rows + axis] = gap[..., axis]
            gamma[..., self.pin_rows + axis] = bias[..., axis]
        values += [-rb[..., 1], rb[..., 0], ra[..., 1], -ra[..., 0]]

    def _slides(self, x: Array, u: Array, c: Array, s: Array, w: Array, phi: Array, gamma: Array, values: list[Array]) -> None:
        g, b = self.guide, self.block
        rg, rb, normal = g.rotate(c, s), b.rotate(c, s), self.slide_normal.rotate(c, s)
        wg, wb = w[..., g.link, None], w[..., b.link, None]
        gap = x[..., b.link, :2] + rb - x[..., g.link, :2] - rg
        gap_rate = u[..., b.link, :2] + wb * quarter_turn(rb) - u[..., g.link, :2] - wg * quarter_turn(rg)
        turned = quarter_turn(normal)
        phi[..., self.slide_rows] = (normal * gap).sum(-1) - self.offset
        phi[..., self.slide_rows + 1] = x[..., b.link, 2] - x[..., g.link, 2] - self.turn
        centripetal = rg * wg**2 - rb * wb**2 - gap * wg**2
        gamma[..., self.slide_rows] = -((normal * centripetal).sum(-1) + 2 * wg[..., 0] * (turned * gap_rate).sum(-1))
        nx, ny = normal[..., 0], normal[..., 1]
        block_arm = (normal * quarter_turn(rb)).sum(-1)
        guide_arm = (turned * gap).sum(-1) - (normal * quarter_turn(rg)).sum(-1)
        values += [nx, ny, block_arm, -nx, -ny, guide_arm]

    def _knives(self, u: Array, c: Array, s: Array, w: Array, gamma: Array, values: list[Array]) -> None:
        e = self.knife_point
        r, normal = e.rotate(c, s), self.knife_normal.rotate(c, s)
        omega = w[..., e.link, None]
        velocity = u[..., e.link, :2] + omega * quarter_turn(r)
        bias = (normal * r).sum(-1) * omega[..., 0] ** 2 - omega[..., 0] * (quarter_turn(normal) * velocity).sum(-1)
        gamma[..., self.knife_rows] = bias
        values += [normal[..., 0], normal[..., 1], (normal * quarter_turn(r)).sum(-1)]
