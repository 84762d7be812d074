"""A mechanism in space, as a model file describes it: bodies, joints, closures and forces.

All numbers are given in world coordinates, in the configuration in which every joint coordinate equals its `ref`: MuJoCo's qpos0 in
MJCF, and zero in URDF.
"""

from dataclasses import dataclass

from gauss_bench.exchange.errors import FileReader
from gauss_bench.terms import Array

WORLD = 0  # the first body


@dataclass(frozen=True, eq=False)
class Body:
    """A rigid body.

    Attributes:
        parent: index of the body to which the joints of this body connect it; the world is its own parent.
        origin, turn: (3,) place [m] and (3, 3) rotation of the body's frame.
        mass: [kg].
        com: (3,) centre of mass [m].
        inertia: (3, 3) about the centre of mass in world axes [kg m^2].
    """

    name: str
    parent: int
    origin: Array
    turn: Array
    mass: float
    com: Array
    inertia: Array


@dataclass(frozen=True, eq=False)
class Joint:
    """A coordinate of a body relative to its parent: a "hinge" [rad] or a "slide" [m].

    Attributes:
        body: index of the body that the joint moves; several joints of one body act one after the other.
        anchor, axis: (3,) a point on the joint's axis [m], and the axis as a unit vector.
        ref: joint coordinate in the configuration in which all numbers of the mechanism are given.
        start, speed: coordinate and rate at the start.
        armature: inertia that the joint adds [kg m^2, or kg for a slide].
    """

    name: str
    kind: str
    body: int
    anchor: Array
    axis: Array
    ref: float = 0.0
    start: float = 0.0
    speed: float = 0.0
    armature: float = 0.0


@dataclass(frozen=True, eq=False)
class Spot:
    """A point of a body; `place` is (3,) [m]."""

    name: str
    body: int
    place: Array


@dataclass(frozen=True, eq=False)
class LinearLaw:
    """The linear force law F = bias - k (x - rest) - c dx/dt along a coordinate x."""

    k: float = 0.0
    c: float = 0.0
    rest: float = 0.0
    bias: float = 0.0


@dataclass(frozen=True, eq=False)
class OnJoints:
    """A force on a weighted sum of joint coordinates, by a law of this sum; `joints` maps the index of a joint to its weight."""

    name: str
    joints: dict[int, float]
    law: LinearLaw


@dataclass(frozen=True, eq=False)
class Between:
    """A force between two points, by a law of their distance."""

    name: str
    a: Spot
    b: Spot
    law: LinearLaw


@dataclass(frozen=True, eq=False)
class Push:
    """A force at a point, along a direction that is fixed in a body.

    Attributes:
        frame: index of the body in which the direction is fixed.
        direction: (3,) unit vector, at the configuration of the file.
        origin: point at which the opposite force acts, and from which the law's coordinate is measured along the direction; None
            for a constant force without a reaction.
    """

    name: str
    point: Spot
    frame: int
    direction: Array
    law: LinearLaw
    origin: Spot | None


Force = OnJoints | Between | Push


@dataclass(frozen=True, eq=False)
class Spatial(FileReader):
    """The mechanism that a model file describes.

    Attributes:
        file: path of the file, for messages.
        gravity: (3,) [m/s^2].
        closures: for each closure its name and the two points that it keeps together.
        welds: pairs of indices of bodies that are rigidly connected.
        spots: named points of bodies.
        forces: springs, dampers, motors and other forces.
        dropped: phrases that name the parts of the file that an import leaves out.
        how_to_close: part of a message that says how a user can close a loop by --close; empty if loops are closed in another way.
    """

    file: str
    bodies: tuple[Body, ...]
    joints: tuple[Joint, ...]
    gravity: Array
    closures: tuple[tuple[str, Spot, Spot], ...] = ()
    welds: tuple[tuple[int, int], ...] = ()
    spots: tuple[Spot, ...] = ()
    forces: tuple[Force, ...] = ()
    dropped: tuple[str, ...] = ()
    how_to_close: str = ""
