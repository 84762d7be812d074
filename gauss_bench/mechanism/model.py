"""A linkage as frozen data: links, joints, forces, drivers and a consistent start.

States are absolute: q (n,) has x, y of the centre of mass and the angle theta of every link, links in file order, in SI units.
"""

import warnings
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from itertools import combinations
from typing import Any, ClassVar, Literal, NamedTuple, Protocol

import numpy as np

from gauss_bench.mechanism.motion_laws import Factor, MotionLaw, read_factor
from gauss_bench.mechanism.numbers import turn_vector
from gauss_bench.mechanism.spaces import SIZE
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
    """Scalar coordinate theta_b - theta_a [rad], unwrapped, of the links with the indices a and b; the ground has angle 0."""

    a: int
    b: int
    unit: ClassVar[Literal["rad"]] = "rad"


@dataclass(frozen=True, eq=False)
class Along:
    """Scalar coordinate [m]: the place of `point` along an axis through `origin`.

    Attributes:
        angle: angle of the axis in the frame of the body in which the axis is fixed [rad].
        across: whether the axis is turned by a further 90 degrees (without rounding): the coordinate is then the distance of
            `point` to the left of the axis at `angle`.
        body: index of the body in which the axis is fixed; None for the body of the origin.
    """

    origin: Point
    point: Point
    angle: float
    across: bool = False
    body: int | None = None
    unit: ClassVar[Literal["m"]] = "m"

    @property
    def axes(self) -> int:
        """The index of the body in whose frame the axis is fixed."""
        return self.origin.link if self.body is None else self.body


@dataclass(frozen=True, eq=False)
class Distance:
    """Scalar coordinate [m]: the distance of two points."""

    a: Point
    b: Point
    unit: ClassVar[Literal["m"]] = "m"


@dataclass(frozen=True, eq=False)
class Slip:
    """The speed [m/s] of a point across a direction at `angle` [rad] in the frame of its link; no coordinate has this rate."""

    point: Point
    angle: float


@dataclass(frozen=True, eq=False)
class Weighted:
    """Scalar coordinate: a weighted sum of coordinates, for example of the angles of two meshing gears."""

    terms: tuple[tuple["Angle | Along | Distance", float], ...]

    @property
    def unit(self) -> Literal["rad", "m"]:
        """The unit of its first coordinate."""
        return self.terms[0][0].unit


Coordinate = Angle | Along | Distance | Weighted


@dataclass(frozen=True, eq=False)
class Measured:
    """A coordinate with the name under which reports print it."""

    name: str
    coordinate: Coordinate

    @property
    def unit(self) -> Literal["rad", "m"]:
        """The unit of the coordinate."""
        return self.coordinate.unit


@dataclass(frozen=True, eq=False)
class Link:
    """A rigid link, with its mass [kg] and moment of inertia about the centre of mass [kg m^2].

    Attributes:
        com: (2,) centre of mass in the link's own frame [m].
        points: name of each point -> its position (2,) in the link's own frame [m].
        bars: pairs of names of points, between which drawings have a bar.
    """

    name: str
    mass: float
    inertia: float
    com: Array
    points: Mapping[str, Array]
    bars: tuple[tuple[str, str], ...] = ()


@dataclass(frozen=True, eq=False)
class Part:
    """A link of the file as a part of the rigid body with the index `body` that carries it after welding.

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
    """A weld of one link to another.

    Attributes:
        at: point of the welded link about which the moment of the weld is reported.
        beyond: indices of the links that the weld carries, among all links of the file.
    """

    name: str
    at: Point
    beyond: tuple[int, ...]


@dataclass(frozen=True, eq=False)
class Revolute:
    """A pin: point a of one link coincides with point b of another.

    A joint of m links, whose name in the file is `joint`, has m - 1 pins with names of their own. `Prismatic` has the same
    attributes.

    Attributes:
        ends_meet: whether the joint keeps its two ends at one place; the held coordinates are then the gap between them.
        parts: names of the held coordinates.
        numbers: names of the fields with the values of the first held coordinates; these values can be parameters of programs.
    """

    name: str
    joint: str
    a: Point
    b: Point
    ends_meet: ClassVar[bool] = True
    parts: ClassVar[tuple[str, ...]] = ("x", "y")
    numbers: ClassVar[tuple[str, ...]] = ()

    @property
    def ends(self) -> tuple[Point, Point]:
        """The points that the pin joins, on the first link and on the second."""
        return self.a, self.b

    @property
    def motion(self) -> Angle:
        """The coordinate that the pin leaves free: the angle of the second link relative to the first."""
        return Angle(self.a.link, self.b.link)

    @property
    def held(self) -> tuple[tuple[Along, float], tuple[Along, float]]:
        """The coordinates that the pin holds, with their values: the gap between its points along x and along y, both 0."""
        x = Along(self.a, self.b, 0.0, body=GROUND)
        y = Along(self.a, self.b, 0.0, across=True, body=GROUND)
        return (x, 0.0), (y, 0.0)


@dataclass(frozen=True, eq=False)
class Prismatic:
    """A slide: the block point moves parallel to a line of the guide's link, and both links turn by the same angle.

    Attributes:
        guide: point on the line.
        block: point of the other link.
        angle: direction of the line in the frame of the guide's link [rad].
        turn: theta of the block's link minus theta of the guide's link [rad].
        offset: distance of the block point to the left of the line [m].
    """

    name: str
    guide: Point
    block: Point
    angle: float
    turn: float
    offset: float
    ends_meet: ClassVar[bool] = False
    parts: ClassVar[tuple[str, ...]] = ("normal", "turn")
    numbers: ClassVar[tuple[str, ...]] = ("offset",)

    @property
    def joint(self) -> str:
        """The name of the joint in the file: a slide is one whole joint."""
        return self.name

    @property
    def ends(self) -> tuple[Point, Point]:
        """The points between which the coordinate of the slide is measured."""
        return self.guide, self.block

    @property
    def motion(self) -> Along:
        """The coordinate that the slide leaves free: the position of the block point along the line, from the guide point."""
        return Along(self.guide, self.block, self.angle)

    @property
    def held(self) -> tuple[tuple[Along, float], tuple[Angle, float]]:
        """The coordinates that the slide keeps constant, with their values: distance from the line, and relative angle."""
        beside = Along(self.guide, self.block, self.angle, across=True)
        return (beside, self.offset), (Angle(self.guide.link, self.block.link), self.turn)


Joint = Revolute | Prismatic


def pins_of_all_pairs(pairs: tuple[Joint, ...]) -> tuple[Joint, ...]:
    """Return the k (k - 1) / 2 pins between every two of the k links that a joint connects, from its k - 1 consecutive pins.

    A slide, or a pin through two links, is returned unchanged.
    """
    pins = [pair for pair in pairs if isinstance(pair, Revolute)]
    if len(pins) < 2:
        return pairs
    points = [pins[0].a, *(pin.b for pin in pins)]
    return tuple(Revolute(f"{a.name}-{b.name}", pins[0].joint, a, b) for a, b in combinations(points, 2))


@dataclass(frozen=True, eq=False)
class KnifeEdge:
    """A nonholonomic constraint: the point moves only along the direction at `angle` [rad] in its link's frame."""

    name: str
    point: Point
    angle: float

    @classmethod
    def read(cls, name: str, table: Mapping[str, Any], names: "Names") -> "KnifeEdge":
        """Return the knife edge of a table."""
        return cls(name, names.point(table["point"]), names.angle(table, "angle") + names.turn(table["point"]))

    @property
    def coordinate(self) -> Slip:
        """The component of the point's velocity across the knife edge, which stays zero."""
        return Slip(self.point, self.angle)


class Coupling(Protocol):
    """A constraint that is not a joint: it holds scalar coordinates at constant values, as a pair of gears does."""

    @property
    def name(self) -> str:
        """The name of the constraint in the file."""

    @property
    def held(self) -> tuple[tuple[Coordinate, float], ...]:
        """The coordinates that the constraint keeps constant, with their values."""


@dataclass(frozen=True, eq=False)
class Law:
    """The force F = bias - k (x - rest) - c dx/dt + s / x^2 along a scalar coordinate x; the generalised force is F dx/dq.

    s is the attribute `inverse_square`, for forces as between magnets, on coordinates that stay positive. For a length x the units
    are k [N/m], c [N s/m], rest [m], bias [N] and s [N m^2]; for an angle k [N m/rad], c [N m s/rad], rest [rad] and bias [N m].
    The attributes may be symbolic expressions of the compiler instead of numbers.
    """

    coordinate: Coordinate
    k: float = 0.0
    c: float = 0.0
    rest: float = 0.0
    bias: float = 0.0
    inverse_square: float = 0.0


@dataclass(frozen=True, eq=False)
class PointForce:
    """Force `value` (2,) [N] at a point, times `factor`; the vector is fixed in the frame of the link with the index `frame`."""

    name: str
    point: Point
    value: Array
    frame: int
    factor: Factor | None = None

    @classmethod
    def read(cls, name: str, table: Mapping[str, Any], names: "Names") -> "PointForce":
        """Return the force of a table, whose `frame` is "ground", "body" for the link of the point, or a link."""
        frame = table.get("frame", "ground")
        if frame == "body":
            frame = table["point"].partition(".")[0]
        value, turn = names.pair(table["value"]), names.turn(frame)
        if turn:  # from the frame of a welded link into that of its body
            value = turn_vector(value, turn)
        return cls(name, names.point(table["point"]), value, names.link(frame), read_factor(table))

    def to_loads(self) -> tuple["Load", ...]:
        """Return the force itself, which is one of the two kinds of load."""
        return (self,)


Load = Law | PointForce  # every force is a sum of such loads: terms, kernels and adapters support no other kind


class Names(Protocol):
    """The parts of a linkage by name, and the numbers of its file, from which forces and constraints are built by `read`."""

    @property
    def world(self) -> Point:
        """The origin of the world."""

    def link(self, name: str, /) -> int:
        """Return the index of the body that carries a link."""

    def point(self, reference: str, /) -> Point:
        """Return the point "link.point" as a point of the body that carries the link."""

    def pairs(self, joint: str, /) -> tuple[Joint, ...]:
        """Return the kinematic pairs of a joint: the slide, or a pin between every two consecutive links in the joint's list."""

    def pairs_to_damp(self, joint: str, /) -> tuple[Joint, ...]:
        """Return the pairs in which a joint is damped: every two of its links or, in the first edition, consecutive links."""

    def pair(self, values: Any, /) -> Array:
        """Return two numbers of a table of the file as an array (2,)."""

    def number(self, table: Mapping[str, Any], key: str, /) -> Any:
        """Return the number at `key` of a table of the file; 0 if it is missing."""

    def angle(self, table: Mapping[str, Any], key: str, /) -> Any:
        """Return the angle [rad] at `key` or, in degrees, at `key_deg` of a table; 0 if both are missing."""

    def turn(self, name: str, /) -> Any:
        """Return the angle of a link in the frame of the body that carries it [rad]; 0 unless the link is welded."""


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
        """Return the torque of a table."""
        reaction = names.link(table.get("reaction", "ground"))
        return cls(name, names.link(table["link"]), reaction, names.number(table, "value"), read_factor(table))

    def to_loads(self) -> tuple[Load, ...]:
        """Return a law with a constant force (bias) on the relative angle."""
        return (Law(Angle(self.reaction, self.link), bias=self.value),)


def _linear_numbers(table: Mapping[str, Any], names: Names) -> tuple[Any, Any, Any]:
    """Return k, c and rest from the table of a spring and damper; 0 for a missing number."""
    return names.number(table, "k"), names.number(table, "c"), names.number(table, "rest")


@dataclass(frozen=True, eq=False)
class SpringDamper:
    """Tension k (L - rest) + c dL/dt between the points a and b, at the distance L; k [N/m], c [N s/m], rest [m]."""

    name: str
    a: Point
    b: Point
    k: float
    c: float
    rest: float

    @classmethod
    def read(cls, name: str, table: Mapping[str, Any], names: Names) -> "SpringDamper":
        """Return the spring and damper of a table."""
        a, b = (names.point(x) for x in table["between"])
        return cls(name, a, b, *_linear_numbers(table, names))

    def to_loads(self) -> tuple[Load, ...]:
        """Return a law on the distance of both points."""
        return (Law(Distance(self.a, self.b), self.k, self.c, self.rest),)


@dataclass(frozen=True, eq=False)
class AxisSpringDamper:
    """Force k (rest - x) - c dx/dt along x, the place of `point` on an axis through `origin`, at `angle` [rad] in its link."""

    name: str
    point: Point
    origin: Point
    angle: float
    k: float
    c: float
    rest: float

    @classmethod
    def read(cls, name: str, table: Mapping[str, Any], names: Names) -> "AxisSpringDamper":
        """Return the spring and damper of a table; without `origin`, the world's origin is used."""
        origin = names.point(table["origin"]) if "origin" in table else names.world
        # the file gives the angle in the frame of the origin's link, which may be turned in a body of welded links
        angle = names.angle(table, "angle") + names.turn(table.get("origin", "ground"))
        return cls(name, names.point(table["point"]), origin, angle, *_linear_numbers(table, names))

    def to_loads(self) -> tuple[Load, ...]:
        """Return a law on the point's position along the axis."""
        return (Law(Along(self.origin, self.point, self.angle), self.k, self.c, self.rest),)


@dataclass(frozen=True, eq=False)
class RotationalSpringDamper:
    """Torque -k (theta_b - theta_a - rest) - c (omega_b - omega_a) on link b, and its opposite on a; angles unwrapped."""

    name: str
    a: int
    b: int
    k: float
    c: float
    rest: float

    @classmethod
    def read(cls, name: str, table: Mapping[str, Any], names: Names) -> "RotationalSpringDamper":
        """Return the spring and damper of a table, with the rest angle between the bodies that carry the links.

        The file gives the rest angle between the links; the difference of their constant angles in the bodies is subtracted.
        """
        a, b = (names.link(x) for x in table["links"])
        turn = names.turn(table["links"][1]) - names.turn(table["links"][0])
        return cls(name, a, b, names.number(table, "k"), names.number(table, "c"), names.angle(table, "rest") - turn)

    def to_loads(self) -> tuple[Load, ...]:
        """Return a law on the relative angle."""
        return (Law(Angle(self.a, self.b), self.k, self.c, self.rest),)


@dataclass(frozen=True, eq=False)
class JointDamping:
    """Viscous damping in the pairs of a joint: c [N m s/rad or N s/m] times the relative angular or sliding speed."""

    name: str
    pairs: tuple[Joint, ...]
    c: float

    @classmethod
    def read(cls, name: str, table: Mapping[str, Any], names: Names) -> "JointDamping":
        """Return the damping of a table."""
        return cls(name, names.pairs_to_damp(table["joint"]), names.number(table, "c"))

    def to_loads(self) -> tuple[Load, ...]:
        """Return a damping law for each pair of the joint."""
        return tuple(Law(pair.motion, c=self.c) for pair in self.pairs)


@dataclass(frozen=True, eq=False)
class CoulombFriction:
    """Dry friction in every pair of a joint, proportional to the load of the pair; not a `Force`, which depends on q, v, t alone.

    Attributes:
        mu: coefficient of friction.
        radius: radius of the pins [m]; 1 for a slide.
        speed: speed of the regularisation tanh(relative speed / speed) [rad/s or m/s].
    """

    name: str
    pairs: tuple[Joint, ...]
    mu: float
    radius: float
    speed: float

    @classmethod
    def read(cls, name: str, table: Mapping[str, Any], names: Names) -> "CoulombFriction":
        """Return the friction of a table; a slide has no `radius`, and gets 1."""
        numbers = (names.number({"radius": 1, **table}, key) for key in ("mu", "radius", "speed"))
        return cls(name, names.pairs(table["joint"]), *numbers)


Force = Torque | PointForce | SpringDamper | AxisSpringDamper | RotationalSpringDamper | JointDamping


def turns_only(force: Force) -> bool:
    """Tell whether all loads of a force are laws on angles, so that it exerts only torques."""
    return all(isinstance(x, Law) and x.coordinate.unit == "rad" for x in force.to_loads())


def factor_of(force: Force) -> Factor | None:
    """Return the factor of a force that varies, or None for a steady force."""
    return force.factor if isinstance(force, (Torque, PointForce)) else None


class UnsupportedForce(TypeError):
    """A force of a kind that has no loads, or a force that varies where only steady forces are supported."""


def loads(forces: Iterable[Force]) -> tuple[Load, ...]:
    """Return the loads of steady forces.

    Raises:
        UnsupportedForce: a force varies, or has no method `to_loads`; the message names it.
    """
    result: list[Load] = []
    for force in forces:
        if not hasattr(force, "to_loads"):
            raise UnsupportedForce(f"force {force.name}: unknown kind {type(force).__name__}")
        if factor_of(force):
            raise UnsupportedForce(f"force {force.name} varies with time or direction, which is not supported here")
        own_loads = tuple(force.to_loads())
        # nothing would apply the factor of another kind of force, or that of a load
        if any(getattr(x, "factor", None) for x in (force, *own_loads)):
            raise UnsupportedForce(f"force {force.name}: only a Torque or a PointForce may vary, not a {type(force).__name__}")
        result += own_loads
    return tuple(result)


@dataclass(frozen=True, eq=False)
class AngleDriver:
    """Prescribed rotation of a link: theta = law(t) [rad]. The other kinds of driver have the same attributes.

    Attributes:
        by: key of a linkage file that names the driven link, joint or points in the driver's table.
        key: name of the prescribed coordinate in results.
    """

    name: str
    law: MotionLaw
    link: int
    by: ClassVar[str] = "link"
    key: ClassVar[str] = "angle"

    @property
    def coordinate(self) -> Angle:
        """The angle of the link."""
        return Angle(GROUND, self.link)


@dataclass(frozen=True, eq=False)
class SlideDriver:
    """Prescribed coordinate along a slide, from its guide point: x = law(t) [m]."""

    name: str
    law: MotionLaw
    joint: Prismatic
    by: ClassVar[str] = "joint"

    @property
    def key(self) -> str:
        """The name of the prescribed coordinate in results: "position", or "length" if the slide is that of a cylinder."""
        return "length" if self.joint.guide.name == f"{self.name}_barrel.pin" else "position"

    @property
    def coordinate(self) -> Along:
        """The position of the block point along the line of the guide."""
        return self.joint.motion


@dataclass(frozen=True, eq=False)
class LengthDriver:
    """Prescribed distance of two points: |p_b - p_a| = law(t) [m], as of an active cylinder without mass."""

    name: str
    law: MotionLaw
    a: Point
    b: Point
    by: ClassVar[str] = "between"
    key: ClassVar[str] = "length"

    @property
    def coordinate(self) -> Distance:
        """The distance between the points a and b."""
        return Distance(self.a, self.b)


Driver = AngleDriver | SlideDriver | LengthDriver


class RowName(NamedTuple):
    """The name of a constraint row.

    Attributes:
        owner: name of its joint, coupling, driver or knife edge.
        part: name of the coordinate that this row of a joint holds; empty if the owner is no joint.
        place: index of the row among those of its owner.
    """

    owner: str
    part: str
    place: int


@dataclass(frozen=True, eq=False)
class Mechanism:
    """One linkage in one scenario; all engines start from the same q0, v0.

    Attributes:
        source, sha256: path of the file, as the caller gave it, and digest of its bytes.
        digest: digest of everything that determines the motion; comments, titles and other scenarios do not change it.
        links: bodies; welded links are one body.
        gravity: (2,) [m/s^2].
        crank: index of the input link, or None.
        observed_points, observed_links: points whose places, and indices of links whose angles results report.
        measured: coordinate by which motions are compared: that which the file names, else that of the first driver, else the
            crank's angle, else the first angle of a link or coordinate of a slide that can move.
        q0, v0: (n,) consistent start, read-only; empty before assembly.
        frictions: dry friction in joints; it depends on accelerations and is therefore not among the forces.
        dof, redundant: n minus the rank of the joint rows at the start, and number of joint rows minus rank; -1 before assembly.
        parts: every link of the file with the body that carries it; empty if no links are welded.
        apart: the same linkage with its links unwelded, in which results are reported; None if no links are welded.
        warnings: sentences on positions that the linkage can reach and a motion should avoid.
        couplings: constraints on positions other than joints and drivers.
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
        """Make the arrays read-only, and check the types of all parts: code that selects parts by type would skip unknown ones.

        Raises:
            TypeError: a force, joint or other part is of an unknown type; the message names it.
        """
        # `load` returns the same object for the same file, so a caller that changed its arrays would change them for all others
        for name in ("gravity", "q0", "v0"):
            array = getattr(self, name)
            if isinstance(array, np.ndarray):  # a sweep gives lists of expressions instead
                view = array.view()
                view.flags.writeable = False
                object.__setattr__(self, name, view)
        # the result is not needed: `loads` raises if a force is of an unknown type
        loads(f for f in self.forces if not factor_of(f))
        parts: list[tuple[Any, str, object]] = [(Coordinate, self.measured.name, self.measured.coordinate)]
        parts += [(Joint, x.name, x) for x in self.joints] + [(Driver, x.name, x) for x in self.drivers]
        parts += [(KnifeEdge, x.name, x) for x in self.knife_edges] + [(CoulombFriction, x.name, x) for x in self.frictions]
        for kind, name, part in parts:
            if not isinstance(part, kind):
                raise TypeError(f"{name}: unknown kind {type(part).__name__}")

    @property
    def pins(self) -> tuple[Revolute, ...]:
        """The joints that are pins."""
        return tuple(joint for joint in self.joints if isinstance(joint, Revolute))

    @property
    def slides(self) -> tuple[Prismatic, ...]:
        """The joints that are slides."""
        return tuple(joint for joint in self.joints if isinstance(joint, Prismatic))

    @property
    def drivable(self) -> dict[str, Prismatic]:
        """Name -> joint for the slides, whose coordinates a driver or the start of a scenario can prescribe."""
        return {joint.name: joint for joint in self.slides}

    @property
    def held_angles(self) -> tuple[tuple[Angle, float], ...]:
        """The relative angles that joints and couplings keep constant, with their values."""
        held = [x for part in (*self.joints, *self.couplings) for x in part.held]
        return tuple((x, value) for x, value in held if isinstance(x, Angle))

    @property
    def turned_links(self) -> set[int]:
        """The indices of the links whose angles drivers prescribe."""
        return {driver.link for driver in self.drivers if isinstance(driver, AngleDriver)}

    @property
    def torques(self) -> tuple[Torque, ...]:
        """The forces that are torques on single links."""
        return tuple(force for force in self.forces if isinstance(force, Torque))

    @property
    def driver(self) -> AngleDriver | None:
        """The driver of the scenario if it is the only one and turns a link; else None."""
        only = self.drivers[0] if len(self.drivers) == 1 else None
        return only if isinstance(only, AngleDriver) else None

    @property
    def constraints(self) -> tuple[KnifeEdge | Coupling, ...]:
        """Couplings and knife edges: an engine that does not support them must not run this mechanism."""
        return *self.couplings, *self.knife_edges

    @property
    def has_friction(self) -> bool:
        """Whether dry friction acts in a joint: an engine that does not support it must not run this mechanism."""
        return any(f.mu > 0 for f in self.frictions)

    @property
    def varying(self) -> tuple[Torque | PointForce, ...]:
        """The forces that vary with time or direction: an engine that does not support them must not run this mechanism."""
        return tuple(force for force, _ in self.factors)

    @property
    def kinks(self) -> tuple[float, ...]:
        """The times [s] at which a force or its slope jumps: an integrator should end a step there and restart."""
        return tuple(sorted({t for _, factor in self.factors for t in factor.kinks if 0 < t < self.duration}))

    @property
    def forcing_period(self) -> float | None:
        """The shortest period [s] of the sinusoidal forces, or None if there are none."""
        waves = [factor.wave for _, factor in self.factors if factor.wave]
        return min((2 * np.pi / x.turning for x in waves if x.turning > 0), default=None)

    @property
    def factors(self) -> list[tuple[Torque | PointForce, Factor]]:
        """The forces that vary with time or direction, each with the function of time and speed that multiplies it."""
        return [(f, f.factor) for f in self.forces if isinstance(f, (Torque, PointForce)) and f.factor]

    @property
    def n(self) -> int:
        """Number of coordinates: x, y and angle of each body."""
        return SIZE * len(self.links)

    @property
    def loops(self) -> int:
        """Number of independent loops: joints - links, by Euler, if all links are connected with the ground."""
        return max(0, len(self.joints) - len(self.links))

    @property
    def m(self) -> int:
        """Number of constraint rows: held coordinates, drivers and knife edges."""
        return len(self.held_names) + len(self.drivers) + len(self.knife_edges)

    @property
    def held_names(self) -> tuple[str, ...]:
        """The name of the joint or coupling of each row that holds a coordinate; rows of drivers and knife edges follow."""
        return tuple(part.name for part in (*self.joints, *self.couplings) for _ in part.held)

    @property
    def row_names(self) -> tuple[RowName, ...]:
        """The names of all constraint rows, in their order: joints, couplings, drivers, knife edges."""
        joints = [RowName(x.name, part, k) for x in self.joints for k, part in enumerate(x.parts)]
        couplings = [RowName(x.name, "", k) for x in self.couplings for k in range(len(x.held))]
        return *joints, *couplings, *(RowName(x.name, "", 0) for x in (*self.drivers, *self.knife_edges))

    @property
    def mass(self) -> Array:
        """The diagonal (n,) of the mass matrix: mass, mass, moment of inertia of each body."""
        return np.array([x for link in self.links for x in (link.mass, link.mass, link.inertia)])

    def link_name(self, index: int) -> str:
        """Return the name of a body, or "ground"."""
        return "ground" if index == GROUND else self.links[index].name

    @property
    def whole(self) -> "Mechanism":
        """The linkage with every link of the file as a body of its own, even if links are welded together."""
        return self.apart or self

    def find_body(self, name: str) -> tuple[int, Any]:
        """Return the index of the body that carries a link of the file, and the link's angle in that body's frame [rad]."""
        if self.parts:
            part = next(x for x in self.parts if x.name == name)
            return part.body, part.turn
        return next(i for i, link in enumerate(self.links) if link.name == name), 0

    @property
    def size(self) -> float:
        """The largest distance [m] between two points of one link or of the ground; 1 if no link has two points."""
        distances = [0.0]
        for points in (*(link.points for link in self.links), self.ground_points):
            places = [np.asarray(p, dtype=float) for p in points.values()]
            distances += [float(np.hypot(*(a - b))) for a, b in combinations(places, 2)]
        return max(distances) or 1.0

    def find_point(self, reference: str) -> Point:
        """Return the point "link.point" of the file as a point of the body that carries the link.

        A welded body has the name of one of its links; points of its other links are named "link.point" in the body.
        """
        owner, _, name = reference.partition(".")
        if owner == "ground":
            return self.point(GROUND, name)
        body, _ = self.find_body(owner)
        return self.point(body, name if self.links[body].name == owner else reference)

    def placed(self, name: str) -> tuple[int, Any]:
        """Deprecated name of `find_body`."""
        warnings.warn("Mechanism.placed is now Mechanism.find_body", DeprecationWarning, stacklevel=2)
        return self.find_body(name)

    def named_point(self, reference: str) -> Point:
        """Deprecated name of `find_point`."""
        warnings.warn("Mechanism.named_point is now Mechanism.find_point", DeprecationWarning, stacklevel=2)
        return self.find_point(reference)

    def point(self, link: int, name: str) -> Point:
        """Return the point `name` of the body with the index `link`, or of the ground."""
        if link == GROUND:
            return Point(GROUND, self.ground_points[name], f"ground.{name}")
        owner = self.links[link]
        return Point(link, owner.points[name] - owner.com, f"{owner.name}.{name}")
