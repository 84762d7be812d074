"""Vectors of the plane, and the parts of a state that belong to one body.

The components of a vector are numbers of any kind with + - * (floats, arrays, nodes of the compiler, CasADi's symbols), so that
every formula of mechanics is written once. An angular speed or a moment is one number, about the normal of the plane.
"""

from typing import Any

import numpy as np

from gauss_bench.terms import Array

Real = Any  # a number of any kind
DIMENSION = 2
SIZE = 3  # coordinates of a body: x and y of its centre of mass, and its angle


class Vec:
    """A vector in the plane, given by its components x and y."""

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


def dot(a: Vec, b: Vec) -> Real:
    """Return the scalar product of two vectors."""
    return a.parts[0] * b.parts[0] + a.parts[1] * b.parts[1]


def wedge(a: Vec, b: Vec) -> Real:
    """Return the number a x b; for an arm a and a force b it is the moment of the force."""
    return a.parts[0] * b.parts[1] - a.parts[1] * b.parts[0]


def cross(omega: Real, r: Vec) -> Vec:
    """Return omega x r: the velocity of a point at the arm r, relative to the centre, if the body turns at omega."""
    x, y = r.parts
    return Vec(-(omega * y), omega * x)


def rotate_vec(turn: Vec, vector: Vec) -> Vec:
    """Return a vector rotated by the angle whose cosine and sine are `turn`."""
    (cosine, sine), (x, y) = turn.parts, vector.parts
    return Vec(x * cosine - y * sine, x * sine + y * cosine)


# Parts of a state (..., n): positions, velocities or accelerations of all bodies. The ground has index -1 and rests at the origin.


def slots(body: int) -> slice:
    """Return the slice of a state that holds x, y and the angle of a body."""
    return slice(SIZE * body, SIZE * (body + 1))


def angle_slot(body: int) -> int:
    """Return the index of a body's angle in a state."""
    return SIZE * body + DIMENSION


def bodies(x: Array) -> Array:
    """Return a state (..., n) as an array (..., bodies, 3); it is a view if x is contiguous."""
    return x.reshape(*x.shape[:-1], x.shape[-1] // SIZE, SIZE)


def places(x: Array) -> Array:
    """Return x and y of all centres of mass, or their rates, as an array (..., bodies, 2)."""
    return bodies(x)[..., :DIMENSION]


def angles(x: Array) -> Array:
    """Return the angles of all bodies, or their rates, as a view (..., bodies)."""
    return x[..., DIMENSION::SIZE]


def place_at(x: Array, body: int) -> Array:
    """Return x and y of a body's centre of mass, or their rates, as an array (..., 2); zeros for the ground."""
    return places(x)[..., body, :] if body >= 0 else np.zeros((*x.shape[:-1], DIMENSION), dtype=x.dtype)


def angle_at(x: Array, body: int) -> Array:
    """Return the angle of a body, or its rate, as an array (...); zeros for the ground."""
    return np.asarray(angles(x)[..., body] if body >= 0 else np.zeros(x.shape[:-1], dtype=x.dtype))
