"""Bodies at a state, all in one type of number, and world components of points and vectors fixed in a body.

The ground is a body at rest at the origin.
"""

from collections.abc import Sequence
from functools import cached_property
from typing import Any, NamedTuple, Protocol

import numpy as np

from gauss_bench.mechanism.model import GROUND, Point
from gauss_bench.mechanism.spaces import Real, Vec, rotate_vec
from gauss_bench.terms import Array


class Frame(NamedTuple):
    """A body at a state: index, position z [m] and velocity u [m/s] of its centre of mass, angular speed, unwrapped angle [rad].

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
    """A vector fixed in a body, in world axes: a unit vector, or a force."""

    frame: Frame
    n: Vec


class Arithmetic(Protocol):
    """The functions for one type of number (floats, arrays or symbols), besides + - *; `inverse` is 1 / x, and 0 at x = 0."""

    def sqrt(self, x: Real, /) -> Real: ...
    def sin(self, x: Real, /) -> Real: ...
    def cos(self, x: Real, /) -> Real: ...
    def inverse(self, x: Real, /) -> Real: ...


def unit(angle: float, across: bool = False) -> Array:
    """Return the unit vector (2,) at an angle [rad]; with `across`, the vector a quarter turn further."""
    c, s = np.cos(angle), np.sin(angle)
    return np.array([-s, c] if across else [c, s])


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
