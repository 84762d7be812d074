"""A linkage as frozen data: links, joints, forces, driver and a consistent start.

Coordinates are absolute: q = [x, y, theta] of every link's centre of mass, links in file order, SI units.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from itertools import combinations
from typing import Any, ClassVar, Literal, Protocol

import numpy as np

from gauss_bench.mechanism.motion_laws import Factor, MotionLaw, read_factor
from gauss_bench.mechanism.numbers import turn_vector
from gauss_bench.terms import Array

GROUND = -1


@dataclass(frozen=True, eq=False)
class Point:
    """A point fixed in a link.

    Attributes:
        link: index of the link, or GROUND.
        local: (2,) position relative to the centre of mass, in the link's frame [m]; world position for the ground.
        name: the reference "link.point" of the linkage file.
    """

    link: int
    local: Array
    name: str


@dataclass(frozen=True, eq=False)
class Angle:
    """Scalar coordinate theta_b - theta_a of two links (indices; the ground's angle is 0) [rad]; unwrapped."""

    a: int
    b: int
    unit: ClassVar[Literal["rad"]] = "rad"


@dataclass(frozen=True, eq=False)
class Along:
    """Scalar coordinate [m] of `point` along an axis from `origin`, at `angle` [rad] in the frame of the origin's link.

    With `across` it is the distance to the left of that axis: the same with an axis a quarter turn on, free of rounding.
    """

    origin: Point
    point: Point
    angle: float
    across: bool = False
    body: int | None = None
    unit: ClassVar[Literal["m"]] = "m"

    @property
    def axes(self) -> int:
        """The body in whose frame the axis is fixed: that of the origin, unless another is named."""
        return self.origin.link if self.body is None else self.body


@dataclass(frozen=True, eq=False)
class Distance:
    """Scalar coordinate [m]: the distance of two points."""

    a: Point
    b: Point
    unit: ClassVar[Literal["m"]] = "m"


@dataclass(frozen=True, eq=False)
class Slip:
    """The speed [m/s] of a point across a direction at `angle` [rad] in the frame of its own link; it has no position level."""

    point: Point
    angle: float


@dataclass(frozen=True, eq=False)
class Weighted:
    """Scalar coordinate: the weighted sum of others, such as the angles of two meshing gears; in the unit of the first."""

    terms: tuple[tuple["Angle | Along | Distance", float], ...]

    @property
    def unit(self) -> Literal["rad", "m"]:
        return self.terms[0][0].unit


Coordinate = Angle | Along | Distance | Weighted


@dataclass(frozen=True, eq=False)
class Measured:
    """The coordinate by which motions of a linkage are compared; `name` describes it for the reader of a report."""

    name: str
    coordinate: Coordinate

    @property
    def unit(self) -> Literal["rad", "m"]:
        return self.coordinate.unit


@dataclass(frozen=True, eq=False)
class Link:
    """A rigid link.

    Attributes:
        com: (2,) centre of mass in the link's own frame [m].
        inertia: about the centre of mass [kg m^2].
        points: name -> (2,) position in the link's own frame [m].
        bars: pairs of point names, for drawing.
    """

    name: str
    mass: float
    inertia: float
    com: Array
    points: Mapping[str, Array]
    bars: tuple[tuple[str, str], ...] = ()


@dataclass(frozen=True, eq=False)
class Part:
    """A link of the file and the rigid body that carries it after welding; `body` is an index into `Mechanism.links`.

    Attributes:
        at: (2,) centre of mass of the link relative to that of the body, in the body's frame [m].
        turn: angle of the link minus angle of the body [rad].
    """

    name: str
    body: int
    at: Array
    turn: float


@dataclass(frozen=True, eq=False)
class Weld:
    """A weld: `beyond` are the links that it fixes to the first one (indices among all links of the file), `at` the point there."""

    name: str
    at: Point
    beyond: tuple[int, ...]


@dataclass(frozen=True, eq=False)
class Revolute:
    """A pin: point b of one link coincides with point a of another. `joint` is the name in the file, `name` the pair's own."""

    name: str
    joint: str
    a: Point
    b: Point
    slides: ClassVar[bool] = False

    @property
    def ends(self) -> tuple[Point, Point]:
        """The points that the pin joins, on the first link and on the second."""
        return self.a, self.b

    @property
    def motion(self) -> Angle:
        """The coordinate that the pin leaves free."""
        return Angle(self.a.link, self.b.link)

    @property
    def held(self) -> tuple[tuple[Along, float], tuple[Along, float]]:
        """The coordinates that the pin constrains, with their values: the gap between its points along x and along y, both 0."""
        x, y = (Along(self.a, self.b, 0.0, across, GROUND) for across in (False, True))
        return (x, 0.0), (y, 0.0)


@dataclass(frozen=True, eq=False)
class Prismatic:
    """A slide: the block point stays at the distance `offset` left of a line in the guide's link; the block does not turn in it.

    Attributes:
        angle: direction of the line in the guide link's frame [rad].
        turn: theta of the block minus theta of the guide [rad].
        offset: signed distance of the block point left of the line [m].
    """

    name: str
    guide: Point
    block: Point
    angle: float
    turn: float
    offset: float
    slides: ClassVar[bool] = True

    @property
    def joint(self) -> str:
        return self.name

    @property
    def ends(self) -> tuple[Point, Point]:
        """The points that the slide is measured between, on the guide and on the block."""
        return self.guide, self.block

    @property
    def motion(self) -> Along:
        """The coordinate that the slide leaves free: the position of the block point along the line, from the guide point."""
        return Along(self.guide, self.block, self.angle)

    @property
    def held(self) -> tuple[tuple[Along, float], tuple[Angle, float]]:
        """The coordinates that the slide constrains, with their values: the distance from the line, and the relative angle."""
        beside = Along(self.guide, self.block, self.angle, across=True)
        return (beside, self.offset), (Angle(self.guide.link, self.block.link), self.turn)


Joint = Revolute | Prismatic


def every_two(pairs: tuple[Joint, ...]) -> tuple[Joint, ...]:
    """Return a pin for every two links of a multiple joint; in the file its pins join neighbouring links only."""
    pins = [pair for pair in pairs if isinstance(pair, Revolute)]
    if len(pins) < 2:
        return pairs
    points = [pins[0].a, *(pin.b for pin in pins)]
    return tuple(Revolute(f"{a.name}-{b.name}", pins[0].joint, a, b) for a, b in combinations(points, 2))


@dataclass(frozen=True, eq=False)
class KnifeEdge:
    """Nonholonomic: the point moves only along the direction at `angle` [rad] in the link's frame."""

    name: str
    point: Point
    angle: float

    @classmethod
    def read(cls, name: str, table: Mapping[str, Any], names: "Names") -> "KnifeEdge":
        return cls(name, names.point(table["point"]), names.angle(table, "angle") + names.turn(table["point"]))

    @property
    def coordinate(self) -> Slip:
        return Slip(self.point, self.angle)


class Coupling(Protocol):
    """A constraint that is not a joint: it holds scalar coordinates at given values. Its table in the file names its `type`."""

    @property
    def name(self) -> str: ...
    @property
    def held(self) -> tuple[tuple[Coordinate, float], ...]: ...


@dataclass(frozen=True, eq=False)
class Law:
    """The force F = bias - k (x - rest) - c dx/dt + s / x^2 along a scalar coordinate x; the generalised force is F dx/dq.

    s is `inverse_square`, as of magnets, for coordinates that stay positive. Units follow from the coordinate: k [N/m], c [N s/m],
    rest [m], bias [N], s [N m^2] of a length, k [N m/rad] and so on of an angle. The numbers may be expressions.
    """

    coordinate: Coordinate
    k: float = 0.0
    c: float = 0.0
    rest: float = 0.0
    bias: float = 0.0
    inverse_square: float = 0.0


@dataclass(frozen=True, eq=False)
class PointForce:
    """Force `value` (2,) [N] at a point, times its factor; the vector is fixed in the frame of link `frame` (GROUND: world)."""

    name: str
    point: Point
    value: Array
    frame: int
    factor: Factor | None = None

    @classmethod
    def read(cls, name: str, table: Mapping[str, Any], names: "Names") -> "PointForce":
        point, frame = names.point(table["point"]), table.get("frame", "ground")
        frame = table["point"].partition(".")[0] if frame == "body" else frame
        value, turn = names.pair(table["value"]), names.turn(frame)
        return cls(name, point, turn_vector(value, turn) if turn else value, names.link(frame), read_factor(table))

    def lowered(self) -> tuple["Load", ...]:
        return (self,)


Load = Law | PointForce  # every force is lowered to these two: terms, kernels and adapters need to know no other kind


class Names(Protocol):
    """Reads one table of the linkage file: it resolves names to links and points, and makes numbers of the precision in use."""

    @property
    def world(self) -> Point:
        """The origin of the world."""
        ...

    def link(self, name: str, /) -> int: ...
    def point(self, reference: str, /) -> Point: ...
    def pairs(self, joint: str, /) -> tuple[Joint, ...]: ...
    def damped(self, joint: str, /) -> tuple[Joint, ...]:
        """The pairs in which a joint is damped: every two of its links, or only neighbours in files of the first edition."""
        ...

    def pair(self, values: Any, /) -> Array: ...
    def number(self, table: Mapping[str, Any], key: str, /) -> Any:
        """The number `key`, 0 where it is left out."""
        ...

    def angle(self, table: Mapping[str, Any], key: str, /) -> Any:
        """The angle `key` or `key_deg` [rad], 0 where it is left out."""
        ...

    def turn(self, name: str, /) -> Any:
        """The angle of a link in the frame of the body that carries it [rad]; 0 unless the link is welded."""
        ...


@dataclass(frozen=True, eq=False)
class Torque:
    """Torque `value` times `factor` [N m] on `link`, and the opposite torque on `reaction` (link indices)."""

    name: str
    link: int
    reaction: int
    value: float
    factor: Factor | None = None

    @classmethod
    def read(cls, name: str, table: Mapping[str, Any], names: Names) -> "Torque":
        reaction = names.link(table.get("reaction", "ground"))
        return cls(name, names.link(table["link"]), reaction, names.number(table, "value"), read_factor(table))

    def lowered(self) -> tuple[Load, ...]:
        return (Law(Angle(self.reaction, self.link), bias=self.value),)


@dataclass(frozen=True, eq=False)
class SpringDamper:
    """Tension k (L - rest) + c dL/dt along the line of two points; k [N/m], c [N s/m], rest [m]."""

    name: str
    a: Point
    b: Point
    k: float
    c: float
    rest: float

    @classmethod
    def read(cls, name: str, table: Mapping[str, Any], names: Names) -> "SpringDamper":
        a, b = (names.point(x) for x in table["between"])
        return cls(name, a, b, *(names.number(table, key) for key in ("k", "c", "rest")))

    def lowered(self) -> tuple[Load, ...]:
        return (Law(Distance(self.a, self.b), self.k, self.c, self.rest),)


@dataclass(frozen=True, eq=False)
class AxisSpringDamper:
    """Force k (rest - x) - c dx/dt on x, the coordinate of `point` along an axis fixed in the link of `origin` at `angle` [rad]."""

    name: str
    point: Point
    origin: Point
    angle: float
    k: float
    c: float
    rest: float

    @classmethod
    def read(cls, name: str, table: Mapping[str, Any], names: Names) -> "AxisSpringDamper":
        origin = names.point(table["origin"]) if "origin" in table else names.world
        numbers = (names.number(table, key) for key in ("k", "c", "rest"))
        angle = names.angle(table, "angle") + names.turn(table.get("origin", "ground"))
        return cls(name, names.point(table["point"]), origin, angle, *numbers)

    def lowered(self) -> tuple[Load, ...]:
        return (Law(Along(self.origin, self.point, self.angle), self.k, self.c, self.rest),)


@dataclass(frozen=True, eq=False)
class RotationalSpringDamper:
    """Torque -k (theta_b - theta_a - rest) - c (omega_b - omega_a) on link b, the opposite one on a; angles unwrapped."""

    name: str
    a: int
    b: int
    k: float
    c: float
    rest: float

    @classmethod
    def read(cls, name: str, table: Mapping[str, Any], names: Names) -> "RotationalSpringDamper":
        a, b = (names.link(x) for x in table["links"])
        turn = names.turn(table["links"][1]) - names.turn(table["links"][0])
        return cls(name, a, b, names.number(table, "k"), names.number(table, "c"), names.angle(table, "rest") - turn)

    def lowered(self) -> tuple[Load, ...]:
        return (Law(Angle(self.a, self.b), self.k, self.c, self.rest),)


@dataclass(frozen=True, eq=False)
class JointDamping:
    """Viscous damping in the pairs of a joint: c times the relative angular [N m s/rad] or sliding [N s/m] speed."""

    name: str
    pairs: tuple[Joint, ...]
    c: float

    @classmethod
    def read(cls, name: str, table: Mapping[str, Any], names: Names) -> "JointDamping":
        return cls(name, names.damped(table["joint"]), names.number(table, "c"))

    def lowered(self) -> tuple[Load, ...]:
        return tuple(Law(pair.motion, c=self.c) for pair in self.pairs)


@dataclass(frozen=True, eq=False)
class CoulombFriction:
    """Dry friction in every pair of a joint, proportional to the pair's load; not a Force, which needs q and v alone.

    Attributes:
        mu: coefficient of friction.
        radius: of the pins [m]; a slide has none and this is 1.
        speed: of the regularisation tanh(relative speed / speed) [rad/s or m/s].
    """

    name: str
    pairs: tuple[Joint, ...]
    mu: float
    radius: float
    speed: float

    @classmethod
    def read(cls, name: str, table: Mapping[str, Any], names: Names) -> "CoulombFriction":
        mu, radius, speed = (names.number({"radius": 1, **table}, key) for key in ("mu", "radius", "speed"))
        return cls(name, names.pairs(table["joint"]), mu, radius, speed)


Force = Torque | PointForce | SpringDamper | AxisSpringDamper | RotationalSpringDamper | JointDamping


def factor_of(force: Force) -> Factor | None:
    """The factor of a force, or None where it is steady."""
    return force.factor if isinstance(force, (Torque, PointForce)) else None


def steady_part(force: Force) -> Torque | PointForce:
    """Return a varying force without its time or direction factor.

    Raises:
        TypeError: the force is of a kind that does not vary.
    """
    if not isinstance(force, (Torque, PointForce)):
        raise TypeError(f"force {force.name} is of a kind that does not vary")
    return replace(force, factor=None)


def loads(forces: Iterable[Force]) -> tuple[Load, ...]:
    """Lower steady forces to loads: laws on coordinates and forces at points.

    Raises:
        TypeError: a force has no `lowered` method, or varies; the message names it.
    """
    forces = tuple(forces)
    for force in forces:
        if not hasattr(force, "lowered"):
            raise TypeError(f"force {force.name}: nothing is known of the kind {type(force).__name__}")
        if factor_of(force):
            raise TypeError(f"force {force.name} varies with time or direction, which is not known here")
    return tuple(load for force in forces for load in force.lowered())


@dataclass(frozen=True, eq=False)
class AngleDriver:
    """Prescribed rotation of a link: theta = law(t) [rad]."""

    name: str
    law: MotionLaw
    link: int

    @property
    def coordinate(self) -> Angle:
        return Angle(GROUND, self.link)


@dataclass(frozen=True, eq=False)
class SlideDriver:
    """Prescribed coordinate along a slide, from its guide point: x = law(t) [m]."""

    name: str
    law: MotionLaw
    joint: Prismatic

    @property
    def coordinate(self) -> Along:
        return self.joint.motion


@dataclass(frozen=True, eq=False)
class LengthDriver:
    """An active bar without mass, such as a cylinder: the distance of two points is law(t) [m]."""

    name: str
    law: MotionLaw
    a: Point
    b: Point

    @property
    def coordinate(self) -> Distance:
        return Distance(self.a, self.b)


Driver = AngleDriver | SlideDriver | LengthDriver


def _require(kind: Any, name: str, x: object) -> None:
    if not isinstance(x, kind):
        raise TypeError(f"{name}: nothing is known of the kind {type(x).__name__}")


@dataclass(frozen=True, eq=False)
class Mechanism:
    """One linkage in one scenario, assembled: all engines start from the same q0, v0.

    Attributes:
        source: the file it was read from, as given.
        sha256: digest of the file's bytes.
        digest: hash of everything that determines the motion; comments, titles and other scenarios do not change it.
        gravity: (2,) [m/s^2].
        crank: index of the input link, or None.
        observed_points, observed_links: what the file asks to report: points, and links by their angles (indices).
        measured: the coordinate by which motions are compared: what the file names, else the first driver's, else the crank's
            angle, else the first angle of a link or slide that can move, in the file's order.
        q0, v0: (n,) consistent start, read-only.
        frictions: dry friction in joints, which depends on the accelerations and therefore is not among the forces.
        parts: every link of the file with the body that carries it, if some are welded; else empty. welds: the welds themselves.
        apart: the same linkage with no links merged, if some are welded: results are reported by its links.
        couplings: constraints beside the joints that have a position level.
        warnings: sentences on what the file allows and a motion should stay away from.
        dof: n minus the rank of the joint rows at the start; redundant: joint rows beyond that rank.
    """

    name: str
    title: str
    scenario: str
    scenarios: tuple[str, ...]
    source: str
    sha256: str
    digest: str
    duration: float
    links: tuple[Link, ...]
    ground_points: Mapping[str, Array]
    joints: tuple[Joint, ...]
    knife_edges: tuple[KnifeEdge, ...]
    forces: tuple[Force, ...]
    drivers: tuple[Driver, ...]
    gravity: Array
    crank: int | None
    observed_points: tuple[Point, ...]
    observed_links: tuple[int, ...]
    measured: Measured
    q0: Array = field(default_factory=lambda: np.zeros(0))
    v0: Array = field(default_factory=lambda: np.zeros(0))
    frictions: tuple[CoulombFriction, ...] = ()
    dof: int = -1
    redundant: int = -1
    parts: tuple[Part, ...] = ()
    welds: tuple[Weld, ...] = ()
    apart: "Mechanism | None" = None
    warnings: tuple[str, ...] = ()
    couplings: tuple[Coupling, ...] = ()

    def __post_init__(self) -> None:
        """Check the kinds of all parts and make the arrays read-only.

        Code that selects forces, joints or drivers by kind would silently skip an unknown one. The arrays are frozen because
        everybody who loads the same file gets this same object.

        Raises:
            TypeError: a part is of an unknown kind; the message names it.
        """
        for name in ("gravity", "q0", "v0"):
            if isinstance(given := getattr(self, name), np.ndarray):  # or numbers of another kind, in a list
                object.__setattr__(self, name, fixed := given.view())
                fixed.flags.writeable = False
        loads(f for f in self.forces if not factor_of(f))
        kinds: tuple[Any, ...] = (Joint, Driver, KnifeEdge, CoulombFriction)
        for known, some in zip(kinds, (self.joints, self.drivers, self.knife_edges, self.frictions), strict=True):
            for x in some:
                _require(known, x.name, x)
        _require(Coordinate, self.measured.name, self.measured.coordinate)

    @property
    def pins(self) -> tuple[Revolute, ...]:
        return tuple(joint for joint in self.joints if isinstance(joint, Revolute))

    @property
    def slides(self) -> tuple[Prismatic, ...]:
        return tuple(joint for joint in self.joints if isinstance(joint, Prismatic))

    @property
    def driver(self) -> AngleDriver | None:
        """The prescribed rotation, if it is the only driver of the scenario; else None."""
        only = self.drivers[0] if len(self.drivers) == 1 else None
        return only if isinstance(only, AngleDriver) else None

    @property
    def constraints(self) -> tuple[KnifeEdge | Coupling, ...]:
        """Couplings and knife edges: an engine that does not support them must not run this mechanism."""
        return *self.couplings, *self.knife_edges

    @property
    def has_friction(self) -> bool:
        """True if dry friction acts in a joint; an engine without it must not run this mechanism."""
        return any(f.mu > 0 for f in self.frictions)

    @property
    def varying(self) -> tuple[Force, ...]:
        """The forces that vary with time or direction; an engine that does not support them must not run this mechanism."""
        return tuple(f for f in self.forces if factor_of(f))

    @property
    def kinks(self) -> tuple[float, ...]:
        """Times [s] at which a force jumps or its slope does: an integrator should end a step there and restart."""
        return tuple(sorted({t for f in self.varying if (factor := factor_of(f)) for t in factor.kinks if 0 < t < self.duration}))

    @property
    def forcing_period(self) -> float | None:
        """The shortest period [s] of the sinusoidal forces, or None if there are none."""
        waves = [factor.wave for f in self.varying if (factor := factor_of(f)) and factor.wave]
        return min((2 * np.pi / x.turning for x in waves if x.turning > 0), default=None)

    @property
    def n(self) -> int:
        return 3 * len(self.links)

    @property
    def mass(self) -> Array:
        """(n,) diagonal of the mass matrix."""
        return np.array([x for link in self.links for x in (link.mass, link.mass, link.inertia)])

    def link_name(self, index: int) -> str:
        return "ground" if index == GROUND else self.links[index].name

    @property
    def whole(self) -> "Mechanism":
        """The linkage with every link of its file separate, before welding."""
        return self.apart or self

    def placed(self, name: str) -> tuple[int, Any]:
        """Return the index of the body that carries a link of the file, and the link's angle in that body's frame [rad]."""
        if self.parts:
            part = next(x for x in self.parts if x.name == name)
            return part.body, part.turn
        return next(i for i, link in enumerate(self.links) if link.name == name), 0

    @property
    def size(self) -> float:
        """The largest distance [m] between two points of one link or of the ground; 1 if no link has two points."""
        parts = [[np.asarray(p, dtype=float) for p in link.points.values()] for link in self.links]
        parts.append([np.asarray(p, dtype=float) for p in self.ground_points.values()])
        largest = max((float(np.hypot(*(a - b))) for points in parts for a in points for b in points), default=0.0)
        return largest or 1.0

    def named_point(self, reference: str) -> Point:
        """Return the point "link.point" of the file, as a point of the body that carries the link."""
        owner, _, name = reference.partition(".")
        if owner == "ground":
            return self.point(GROUND, name)
        body, _ = self.placed(owner)
        return self.point(body, name if self.links[body].name == owner else reference)

    def point(self, link: int, name: str) -> Point:
        """Return the point `name` of the link with an index."""
        if link == GROUND:
            return Point(GROUND, self.ground_points[name], f"ground.{name}")
        owner = self.links[link]
        return Point(link, owner.points[name] - owner.com, f"{owner.name}.{name}")
