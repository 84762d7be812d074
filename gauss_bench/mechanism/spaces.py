"""The plane: vectors, the parts of a state that belong to one body, and the frames of bodies at a state.

The components of a vector are numbers of any kind with + - * (floats, arrays, nodes of the compiler, CasADi's symbols), so that
every formula of mechanics is written once. An angular speed or a moment is one number, about the normal of the plane. The ground
is a body at rest at the origin, with the index -1.
"""

from collections.abc import Sequence
from functools import cached_property
from typing import Any, NamedTuple, Protocol

import numpy as np

from gauss_bench.mechanism.model import GROUND, Point
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


def unit(angle: float, across: bool = False) -> Array:
    """Return the unit vector (2,) at an angle [rad]; with `across`, the vector a quarter turn further."""
    c, s = np.cos(angle), np.sin(angle)
    return np.array([-s, c] if across else [c, s])


# Parts of a state (..., n): positions, velocities or accelerations of all bodies.


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


# Frames of bodies, and world components of points and vectors fixed in a body.


class Frame(NamedTuple):
    """A body at a state: its index, z and u of its centre of mass [m, m/s], its angular speed and unwrapped angle [rad].

    `rests` tells whether the body is at rest, as the ground is: formulas leave out its terms.
    """

    body: int
    z: Vec
    u: Vec
    omega: Real
    angle: Real
    rests: bool = False


REST = Frame(GROUND, Vec(0.0, 0.0), Vec(0.0, 0.0), 0.0, 0.0, rests=True)


class End(NamedTuple):
    """A point fixed in a body: the frame of the body, and the arm from its centre of mass to the point, in world axes."""

    frame: Frame
    arm: Vec

    @property
    def place(self) -> Vec:
        """The position of the point in the world [m]."""
        return self.arm if self.frame.rests else self.frame.z + self.arm


class Direction(NamedTuple):
    """A unit vector fixed in a body, in world axes."""

    frame: Frame
    n: Vec


class Arithmetic(Protocol):
    """The functions for one type of number (floats, arrays or symbols), besides + - *; `inverse` is 1 / x, and 0 at x = 0."""

    def sqrt(self, x: Real, /) -> Real: ...
    def sin(self, x: Real, /) -> Real: ...
    def cos(self, x: Real, /) -> Real: ...
    def inverse(self, x: Real, /) -> Real: ...


class Placement:
    """The bodies of a linkage at a state; a subclass provides `body` and `arithmetic` for a type of number."""

    arithmetic: Arithmetic

    def body(self, body: int) -> tuple[Sequence[Real], Sequence[Real]]:
        """Return x, y and angle of a body, and their rates."""
        raise NotImplementedError

    @cached_property
    def frames(self) -> dict[int, Frame]:
        """The frames computed so far, by body; `frame` adds to them."""
        return {GROUND: REST}

    def frame(self, body: int) -> Frame:
        """Return the frame of a body: its position, angle and velocities; it is computed once and stored."""
        if body not in self.frames:
            (x, y, angle), (u, w, omega) = self.body(body)
            self.frames[body] = Frame(body, Vec(x, y), Vec(u, w), omega, angle)
        return self.frames[body]

    def numbers(self, value: Any) -> Vec:
        """Return a vector (2,) of the file, converted to the type of number of this placement."""
        return Vec(*value)

    def vector(self, body: int, value: Any) -> Direction:
        """Return the vector `value` (2,), which is fixed in a body's frame, in world axes."""
        frame, local = self.frame(body), self.numbers(value)
        if frame.rests:
            return Direction(frame, local)
        if body not in self.turns:
            self.turns[body] = Vec(self.arithmetic.cos(frame.angle), self.arithmetic.sin(frame.angle))
        return Direction(frame, rotate_vec(self.turns[body], local))

    @cached_property
    def turns(self) -> dict[int, Vec]:
        """Body -> cosine and sine of its angle, computed once for each body."""
        return {}

    def direction(self, body: int, angle: float, across: bool = False) -> Direction:
        """Return the direction at an angle [rad] in a body's frame; with `across`, the direction a quarter turn further."""
        return self.vector(body, unit(angle, across))

    def end(self, point: Point) -> End:
        """Return a point of the mechanism as the end of an arm from the centre of mass of its body."""
        return End(*self.vector(point.link, point.local))
