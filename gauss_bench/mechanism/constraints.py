"""Constraint residual, Jacobian and acceleration bias of a linkage in absolute coordinates.

A vector of the plane is a complex number, so that i turns it by a quarter and n . g + i n x g = conj(n) g. With z the centre of
mass of a link and r = exp(i theta) s the arm of a link-fixed point s:

    p = z + r,    dp/dtheta = i r,    p'' = z'' + i r alpha - r omega^2

    revolute    p_b - p_a = 0
    prismatic   n . (p_b - p_g) - offset = 0,   theta_b - theta_g - turn = 0,   n the normal of the guide, turning with it
    driver      theta - law(t) = 0,   u . (p_b - p_g) - law(t) = 0,   or   |p_b - p_a| - law(t) = 0
    knife edge  n . p' = 0   (no position level)

gamma collects what is left of the second derivative when J a is taken away, with the opposite sign: J a = gamma.
Source: Haug, Computer-Aided Kinematics and Dynamics of Mechanical Systems (1989), sections 3.3 and 3.6.

All functions take one state, q (n,), or a batch, q (..., n), in double or in the longer type the linkage was built in.
"""

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from gauss_bench.mechanism.model import GROUND, AngleDriver, LengthDriver, Mechanism, Point, Prismatic, SlideDriver
from gauss_bench.mechanism.numbers import direction
from gauss_bench.terms import Array


@dataclass(frozen=True)
class Rows:
    """All constraint rows at a state (or batch): joints two each, then driver, then knife edges."""

    phi: Array
    J: Array
    gamma: Array
    phi_t: Array


Vectors = NDArray[np.complexfloating[Any, Any]]


def unpacked(x: Array) -> tuple[Vectors, Array]:
    """Vector and angle (..., links + 1) of a state (..., n), with a resting ground appended."""
    links = x.shape[-1] // 3
    out = np.zeros((*x.shape[:-1], links + 1, 3), dtype=x.dtype)
    out[..., :-1, :] = x.reshape(*x.shape[:-1], links, 3)
    return out[..., 0] + 1j * out[..., 1], out[..., 2]


class Constraints:
    """The constraint rows of one mechanism, with every index worked out once.

    All link-fixed vectors (ends of pins, ends of slides, their normals) stand in one list, so that one rotation serves them all;
    the ground is one more link that rests, and its columns of J are dropped at the end.
    """

    def __init__(self, mechanism: Mechanism):
        self.n = mechanism.n
        self.joint_rows = 2 * len(mechanism.joints)
        self.holonomic = self.joint_rows + len(mechanism.drivers)
        self.m = self.holonomic + len(mechanism.knife_edges)
        self.laws = [driver.law for driver in mechanism.drivers]
        self.ground = len(mechanism.links)
        self.link: list[int] = []
        self.local: list[Array] = []
        pins = [(2 * k, j) for k, j in enumerate(mechanism.joints) if not isinstance(j, Prismatic)]
        slides = [(2 * k, j) for k, j in enumerate(mechanism.joints) if isinstance(j, Prismatic)]
        driven = list(enumerate(mechanism.drivers, self.joint_rows))
        pushed = [(row, d.joint) for row, d in driven if isinstance(d, SlideDriver)]
        bars = [(row, d) for row, d in driven if isinstance(d, LengthDriver)]
        turned = [(row, d.link) for row, d in driven if isinstance(d, AngleDriver)]
        knives = [(self.holonomic + k, e) for k, e in enumerate(mechanism.knife_edges)]
        self.pin_a, self.pin_b = self._points([j.a for _, j in pins]), self._points([j.b for _, j in pins])
        self.guide, self.block = self._points([j.guide for _, j in slides]), self._points([j.block for _, j in slides])
        self.slide_normal = self._normals([(j.guide.link, j.angle) for _, j in slides])
        self.driven_guide = self._points([j.guide for _, j in pushed])
        self.driven_block = self._points([j.block for _, j in pushed])
        self.driven_axis = self._add([j.guide.link for _, j in pushed], [direction(j.angle) for _, j in pushed])
        self.bar_a, self.bar_b = self._points([d.a for _, d in bars]), self._points([d.b for _, d in bars])
        self.edge = self._points([e.point for _, e in knives])
        self.edge_normal = self._normals([(e.point.link, e.angle) for _, e in knives])
        self.links = np.array(self.link, dtype=int)
        self.arms = np.array(self.local).reshape(-1, 2) @ [1.0, 1.0j]
        self.offset, self.turn = np.array([j.offset for _, j in slides]), np.array([j.turn for _, j in slides])
        self.pin_x = np.array([row for row, _ in pins], dtype=int)
        self.slide_gap = np.array([row for row, _ in slides], dtype=int)
        self.driven_slides = np.array([row for row, _ in pushed], dtype=int)
        self.driven_bars = np.array([row for row, _ in bars], dtype=int)
        self.driven_angles = np.array([row for row, _ in turned], dtype=int)
        self.driven_links = np.array([link for _, link in turned], dtype=int)
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
        J[self.driven_angles, 3 * self.driven_links + 2] = 1.0
        return J

    def _varying_entries(self) -> tuple[Array, Array]:
        """Rows and columns of the entries written at every state, in the order in which `__call__` lists their values."""
        a, b, e = (3 * self.links[x] for x in (self.pin_a, self.pin_b, self.edge))
        rows, columns = [self.pin_x, self.pin_y] * 2, [b + 2, b + 2, a + 2, a + 2]
        pairs = (
            (self.slide_gap, self.block, self.guide),
            (self.driven_slides, self.driven_block, self.driven_guide),
            (self.driven_bars, self.bar_b, self.bar_a),
        )
        for row, far, near in pairs:
            rows += [row] * 6
            columns += [3 * self.links[x] + axis for x in (far, near) for axis in (0, 1, 2)]
        rows += [self.edge_rows] * 3
        return np.concatenate(rows), np.concatenate([*columns, e, e + 1, e + 2])

    def __call__(self, t: float | Array, q: Array, v: Array) -> Rows:
        """Residual, Jacobian, bias and explicit rate of all rows at state(s) q, v (..., n) and time(s) t [s]."""
        z, theta = unpacked(q)
        u, omega = unpacked(v)
        r = np.exp(1j * theta)[..., self.links] * self.arms
        arms = _Arms(z[..., self.links], u[..., self.links], omega[..., self.links], r)
        shape = (*q.shape[:-1], self.m)
        phi, gamma, phi_t = (np.zeros(shape, dtype=r.real.dtype) for _ in range(3))
        values: list[Array] = []
        if len(self.pin_x):
            self._pins(arms, phi, gamma, values)
        if len(self.slide_gap):
            self._slides(arms, theta, phi, gamma, values)
        if self.laws:
            phi[..., self.driven_angles] = theta[..., self.driven_links]
            self._driven_slides(arms, phi, gamma, values)
            self._bars(arms, phi, gamma, values)
            for row, law in enumerate(self.laws, self.joint_rows):
                value, rate, second = law(t)
                phi[..., row] -= value
                phi_t[..., row] = -np.asarray(rate)
                gamma[..., row] += second
        if len(self.edge_rows):
            self._edges(arms, gamma, values)
        J = np.empty((*shape, self.n + 3), dtype=r.real.dtype)
        J[...] = self.template
        if values:
            J[..., self.rows, self.columns] = np.concatenate(values, axis=-1)
        return Rows(phi, np.ascontiguousarray(J[..., : self.n]), gamma, phi_t)

    def _pins(self, arms: "_Arms", phi: Array, gamma: Array, values: list[Array]) -> None:
        a, b = arms.part(self.pin_a), arms.part(self.pin_b)
        gap = b.z + b.r - a.z - a.r
        bias = b.r * b.omega**2 - a.r * a.omega**2
        phi[..., self.pin_x], phi[..., self.pin_y] = gap.real, gap.imag
        gamma[..., self.pin_x], gamma[..., self.pin_y] = bias.real, bias.imag
        values += [-b.r.imag, b.r.real, a.r.imag, -a.r.real]

    def _slides(self, arms: "_Arms", theta: Array, phi: Array, gamma: Array, values: list[Array]) -> None:
        normal = arms.part(self.slide_normal).r
        distance, gamma[..., self.slide_gap], entries = _along(normal, arms.part(self.guide), arms.part(self.block))
        phi[..., self.slide_gap] = distance - self.offset
        phi[..., self.slide_turn] = theta[..., self.links[self.block]] - theta[..., self.links[self.guide]] - self.turn
        values += entries

    def _driven_slides(self, arms: "_Arms", phi: Array, gamma: Array, values: list[Array]) -> None:
        axis = arms.part(self.driven_axis).r
        found = _along(axis, arms.part(self.driven_guide), arms.part(self.driven_block))
        phi[..., self.driven_slides], gamma[..., self.driven_slides], entries = found
        values += entries

    def _bars(self, arms: "_Arms", phi: Array, gamma: Array, values: list[Array]) -> None:
        a, b = arms.part(self.bar_a), arms.part(self.bar_b)
        gap = b.z + b.r - a.z - a.r
        length = np.abs(gap)
        towards = (gap / length).conj()
        rate = towards * (b.u - a.u + 1j * (b.omega * b.r - a.omega * a.r))
        turning = (towards * (a.r * a.omega**2 - b.r * b.omega**2)).real + rate.imag**2 / length
        phi[..., self.driven_bars], gamma[..., self.driven_bars] = length, -turning
        x, y = towards.real, -towards.imag
        values += [x, y, -(towards * b.r).imag, -x, -y, (towards * a.r).imag]

    def _edges(self, arms: "_Arms", gamma: Array, values: list[Array]) -> None:
        e, n = arms.part(self.edge), arms.part(self.edge_normal).r
        towards = n.conj()
        arm, velocity = towards * e.r, towards * (e.u + 1j * e.omega * e.r)
        gamma[..., self.edge_rows] = arm.real * e.omega**2 - e.omega * velocity.imag
        values += [n.real, n.imag, -arm.imag]


def _along(n: Vectors, g: "_Arms", b: "_Arms") -> tuple[Array, Array, list[Array]]:
    """Coordinate n . (p_b - p_g) for a direction n that turns with g: its value, its bias and its Jacobian entries."""
    towards = n.conj()
    gap = towards * (b.z + b.r - g.z - g.r)
    rate = towards * (b.u - g.u + 1j * (b.omega * b.r - g.omega * g.r))
    turning = (towards * (g.r * g.omega**2 - b.r * b.omega**2)).real - gap.real * g.omega**2
    block_arm = -(towards * b.r).imag
    guide_arm = gap.imag + (towards * g.r).imag
    return gap.real, -turning - 2 * g.omega * rate.imag, [n.real, n.imag, block_arm, -n.real, -n.imag, guide_arm]


class _Arms(NamedTuple):
    """Per link-fixed vector: position z, velocity u and angular speed of its link, and the vector r in world axes."""

    z: Vectors
    u: Vectors
    omega: Array
    r: Vectors

    def part(self, which: slice) -> "_Arms":
        return _Arms(self.z[..., which], self.u[..., which], self.omega[..., which], self.r[..., which])
