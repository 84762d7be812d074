"""Bodies at a state: where a body is, how it moves, and how what is fixed in it lies in world axes.

A `Placement` says where all bodies of a linkage are; the ground is one that rests at the origin. Everything above asks it for
frames, ends and directions, whatever its numbers are.
"""

from typing import Any, NamedTuple, Protocol

from gauss_bench.mechanism.model import Point
from gauss_bench.mechanism.spaces import Plane, Real, Turning, Vec


class Frame(NamedTuple):
    """A body at a state.

    Attributes:
        body: its index; GROUND for the ground.
        z, u: place [m] and velocity [m/s] of its centre of mass.
        omega: its angular speed [rad/s].
        angle: about the plane's normal, unwrapped [rad].
        rests: whether it is the ground, on which what rests costs nothing.
    """

    body: int
    z: Vec
    u: Vec
    omega: Turning
    angle: Real
    rests: bool = False


class End(NamedTuple):
    """A point fixed in a body, by the body's frame and the point's arm from the centre of mass in world axes."""

    frame: Frame
    arm: Vec

    @property
    def place(self) -> Vec:
        return self.arm if self.frame.rests else self.frame.z + self.arm


class Direction(NamedTuple):
    """A unit vector fixed in a body, in world axes."""

    frame: Frame
    n: Vec


class Arithmetic(Protocol):
    """The operations that numbers have no operators for."""

    def sqrt(self, x: Real, /) -> Real: ...
    def inverse(self, x: Real, /) -> Real: ...


class Placement(Protocol):
    """The bodies of a linkage at a state."""

    @property
    def space(self) -> Plane: ...
    @property
    def arithmetic(self) -> Arithmetic: ...
    def frame(self, body: int, /) -> Frame: ...
    def end(self, point: Point, /) -> End: ...
    def direction(self, body: int, angle: float, across: bool, /) -> Direction:
        """The direction at an angle [rad] of a body's frame, or where `across` the one a quarter turn on."""
        ...

    def vector(self, body: int, value: Any, /) -> Direction:
        """A vector that is fixed in a body's frame, in world axes."""
        ...
