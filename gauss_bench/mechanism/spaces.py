"""The vector products that differ between plane and space: no other file depends on the dimension.

A vector has components in world axes. A turning is an angular speed or a moment: one number in the plane. Numbers may be of any
kind with + - * (floats, arrays, nodes of the compiler, CasADi's symbols), so that each product is written once, by components:

    dot      a . b
    wedge    a x b, a turning
    inner    w . m of two turnings
    twist    w x m of two turnings; None where it vanishes, as it does in the plane
    pull     n . (w x (w x r))
    swing    d x (w x r), a turning
    cross    w x r
"""

from typing import Any

import numpy as np

from gauss_bench.terms import Array

Real = Any  # a number of any kind
Turning = Any  # a number in the plane


class Vec:
    """A vector, by its components."""

    __slots__ = ("parts",)

    def __init__(self, *parts: Real):
        self.parts = parts

    def __add__(self, other: "Vec") -> "Vec":
        return Vec(*(a + b for a, b in zip(self.parts, other.parts, strict=True)))

    def __sub__(self, other: "Vec") -> "Vec":
        return Vec(*(a - b for a, b in zip(self.parts, other.parts, strict=True)))

    def __mul__(self, factor: Real) -> "Vec":
        return Vec(*(a * factor for a in self.parts))

    def __neg__(self) -> "Vec":
        return Vec(*(-a for a in self.parts))


class Plane:
    """Vector products in the plane. `axis` is the unit turning: the plane's normal."""

    dimension, turns = 2, 1
    size = dimension + turns  # coordinates of a body: its place, then its angle
    axis = 1.0

    def dot(self, a: Vec, b: Vec) -> Real:
        return a.parts[0] * b.parts[0] + a.parts[1] * b.parts[1]

    def wedge(self, a: Vec, b: Vec) -> Turning:
        return a.parts[0] * b.parts[1] - a.parts[1] * b.parts[0]

    def inner(self, w: Turning, m: Turning) -> Real:
        return w * m

    def twist(self, w: Turning, m: Turning) -> Turning | None:
        return None

    def pull(self, w: Turning, n: Vec, r: Vec) -> Real:
        return -((w * w) * self.dot(n, r))

    def swing(self, w: Turning, d: Vec, r: Vec) -> Turning:
        return w * self.dot(d, r)

    def turned(self, turn: Vec, s: Vec) -> Vec:
        """Return the vector s rotated by an angle; `turn` is its (cosine, sine)."""
        (c, i), (x, y) = turn.parts, s.parts
        return Vec(x * c - y * i, x * i + y * c)

    def cross(self, w: Turning, r: Vec) -> Vec:
        x, y = r.parts
        return Vec(-(w * y), w * x)

    def levers(self, m: Turning) -> tuple[Real, ...]:
        """The components of a turning."""
        return (m,)


PLANE = Plane()


# Slices of a state (..., n) of all bodies by body. The ground has index -1 and rests at the origin.


def slots(body: int) -> slice:
    """The coordinates of a body in a state."""
    return slice(PLANE.size * body, PLANE.size * (body + 1))


def angle_slot(body: int) -> int:
    """The coordinate that is the angle of a body."""
    return PLANE.size * body + PLANE.dimension


def bodies(x: Array) -> Array:
    """A state (..., n) by body, (..., bodies, 3); a view where x is contiguous."""
    return x.reshape(*x.shape[:-1], x.shape[-1] // PLANE.size, PLANE.size)


def places(x: Array) -> Array:
    """The places of all centres of mass, or their rates, (..., bodies, 2)."""
    return bodies(x)[..., : PLANE.dimension]


def angles(x: Array) -> Array:
    """The angles of all bodies, or their rates, (..., bodies), as a view."""
    return x[..., PLANE.dimension :: PLANE.size]


def place_at(x: Array, body: int) -> Array:
    """The place of a body's centre of mass, or its rate, (..., 2)."""
    return places(x)[..., body, :] if body >= 0 else np.zeros((*x.shape[:-1], PLANE.dimension), dtype=x.dtype)


def angle_at(x: Array, body: int) -> Array:
    """The angle of a body, or its rate, (...)."""
    return np.asarray(angles(x)[..., body] if body >= 0 else np.zeros(x.shape[:-1], dtype=x.dtype))
