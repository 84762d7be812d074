"""A mechanism in space, as a file describes it: bodies, joints, closures and forces, in world coordinates at one configuration.

At that configuration every joint's coordinate is its `ref`: MuJoCo's qpos0, or zero in a URDF. `from_mjcf.py` and `from_urdf.py`
produce this data; `planar.py` makes a planar linkage of it.
"""

from dataclasses import dataclass

from gauss_bench.exchange.errors import ExchangeError
from gauss_bench.terms import Array

WORLD = 0  # the first body


@dataclass(frozen=True, eq=False)
class Body:
    """A rigid body.

    Attributes:
        parent: index of the body to which its joints connect it; the world is its own parent.
        origin, turn: (3,) place [m] and (3, 3) rotation of its frame.
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
        body: index of the body that it moves; several joints of one body act one after the other.
        anchor, axis: (3,) a point on the axis, and its unit vector.
        ref: coordinate at the configuration in which all data are given.
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
    """A point (3,) of a body."""

    name: str
    body: int
    place: Array


@dataclass(frozen=True, eq=False)
class Straight:
    """The force F = bias - k (x - rest) - c dx/dt along a coordinate x."""

    k: float = 0.0
    c: float = 0.0
    rest: float = 0.0
    bias: float = 0.0


@dataclass(frozen=True, eq=False)
class OnJoints:
    """A force law on a sum of joint coordinates; `joints` maps a joint to its coefficient."""

    name: str
    joints: dict[int, float]
    law: Straight


@dataclass(frozen=True, eq=False)
class Between:
    """A force law on the distance between two points."""

    name: str
    a: Spot
    b: Spot
    law: Straight


@dataclass(frozen=True, eq=False)
class Push:
    """A force at a point along `direction` (3,), which is fixed in the body `frame` and given at the file's configuration.

    Attributes:
        origin: point at which the opposite force acts, and from which the law's coordinate is measured along the direction; None
            for a constant force without a reaction.
    """

    name: str
    point: Spot
    frame: int
    direction: Array
    law: Straight
    origin: Spot | None


Acting = OnJoints | Between | Push


@dataclass(frozen=True, eq=False)
class Spatial:
    """The mechanism of a file.

    Attributes:
        file: path of the file, for messages.
        gravity: (3,) [m/s^2].
        closures: name and pair of points that coincide.
        welds: pairs of bodies that are rigidly connected.
        spots: named points of bodies.
        dropped: sentences on parts of the file that are left out.
        closable: how a user closes a loop of a tree without closures, as a part of a sentence; empty if the file does that itself.
    """

    file: str
    bodies: tuple[Body, ...]
    joints: tuple[Joint, ...]
    gravity: Array
    closures: tuple[tuple[str, Spot, Spot], ...] = ()
    welds: tuple[tuple[int, int], ...] = ()
    spots: tuple[Spot, ...] = ()
    acting: tuple[Acting, ...] = ()
    dropped: tuple[str, ...] = ()
    closable: str = ""

    def refuse(self, element: str, reason: str) -> ExchangeError:
        return ExchangeError(f"{self.file}: {element}: {reason}")
