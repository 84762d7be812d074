"""A mechanism in space, as it was found in a file: bodies, joints, closures, forces, in world coordinates at one configuration.

That configuration is where every joint has its `ref`: MuJoCo's qpos0, or the zero of a URDF. What is read from a file ends here,
what becomes a planar linkage begins here (`planar.py`).
"""

from dataclasses import dataclass

from gauss_bench.exchange.errors import ExchangeError
from gauss_bench.terms import Array

WORLD = 0  # the first body


@dataclass(frozen=True, eq=False)
class Body:
    """A rigid body.

    Attributes:
        parent: index of the body it hangs on; the world is its own.
        origin, turn: (3,) and (3, 3) of its frame.
        mass: [kg]; com: (3,) [m]; inertia: (3, 3) about it in world axes [kg m^2].
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
    """A coordinate by which a body moves against its parent: a "hinge" [rad] or a "slide" [m].

    Attributes:
        body: that it moves; several joints of one body act in order.
        anchor, axis: (3,) point on it and unit vector.
        ref: its coordinate at the configuration that all is given in; start, speed: at the start.
        armature: inertia of its own.
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
    """A law on a sum of joints' coordinates: joint -> coefficient."""

    name: str
    joints: dict[int, float]
    law: Straight


@dataclass(frozen=True, eq=False)
class Between:
    """A law on the distance of two points."""

    name: str
    a: Spot
    b: Spot
    law: Straight


@dataclass(frozen=True, eq=False)
class Push:
    """A force at a point along `direction` (3,), fixed in the body `frame` as it stands in the given configuration.

    Attributes:
        origin: where the opposite force acts, and from where the law's coordinate is measured along the direction; None where
            nothing takes it, and the force is constant.
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
    """The content of a file.

    Attributes:
        file: that it was read from, for messages.
        gravity: (3,) [m/s^2].
        closures: pairs of points that coincide; welds: pairs of bodies that move as one.
        dropped: what of the file is left out, in sentences.
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

    def refuse(self, element: str, reason: str) -> ExchangeError:
        return ExchangeError(f"{self.file}: {element}: {reason}")
