"""The products of vectors in which plane and space differ: nothing above this file asks for a dimension.

A vector has components in world axes. A turning is what angular speeds and moments are: one number in the plane. Numbers may be of
any kind with + - * (floats, arrays, nodes of the compiler, CasADi's symbols), so that each product is written once, by components:

    dot      a . b
    wedge    a x b, a turning
    inner    w . m of two turnings
    twist    w x m of two turnings; None where it vanishes, as it does in the plane
    pull     n . (w x (w x r))
    swing    d x (w x r), a turning
    cross    w x r
"""

from typing import Any

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
    """The plane. `axis` is the direction that every angle turns about, as a turning."""

    dimension, turns = 2, 1
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
        """A vector by the cosine and sine of an angle."""
        (c, i), (x, y) = turn.parts, s.parts
        return Vec(x * c - y * i, x * i + y * c)

    def cross(self, w: Turning, r: Vec) -> Vec:
        x, y = r.parts
        return Vec(-(w * y), w * x)

    def levers(self, m: Turning) -> tuple[Real, ...]:
        """The components of a turning."""
        return (m,)


PLANE = Plane()
