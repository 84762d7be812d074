"""Turn a checked document into frozen data: resolve points, work out masses, turn names into indices.

All numbers have one type, double by default; certificates ask for a wider one, so that they start from the decimals of the file.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np

from gauss_bench.linkage.bodies import Mass, bodies, parts, poses, read_welds, together, write_out
from gauss_bench.linkage.errors import BuildError
from gauss_bench.linkage.references import drivers_of
from gauss_bench.linkage.schema import CONSTRAINTS, FORCES, SECOND, physics_digest
from gauss_bench.mechanism import motion_laws
from gauss_bench.mechanism.model import (
    GROUND,
    Along,
    Angle,
    AngleDriver,
    CoulombFriction,
    Driver,
    Force,
    Joint,
    KnifeEdge,
    LengthDriver,
    Link,
    Measured,
    Mechanism,
    Point,
    Prismatic,
    Revolute,
    SlideDriver,
    every_two,
)
from gauss_bench.mechanism.motion_laws import MotionLaw
from gauss_bench.mechanism.numbers import Number, angle_of, direction, exact, length, pair, radians
from gauss_bench.terms import Array


def resolve_points(table: dict[str, Any], number: Number = float) -> dict[str, Array]:
    """Return name -> position (2,) [m] in the link's frame; polar and relative points are resolved."""
    done: dict[str, Array] = {}

    def resolve(key: str) -> Array:
        if key not in done:
            value = table[key]
            if isinstance(value, dict):
                base = resolve(value["from"]) if "from" in value else pair(number, (0, 0))
                if "r" in value:
                    done[key] = base + exact(number, value["r"]) * direction(radians(number, value.get("deg", 0)))
                else:
                    done[key] = base + pair(number, value["xy"])
            else:
                done[key] = pair(number, value)
        return done[key]

    return {key: resolve(key) for key in table}


def build_link(name: str, table: dict[str, Any], number: Number = float) -> Link:
    """Return a link; mass, centre of mass and inertia that the file does not give follow from uniform bars."""
    points = resolve_points(table["points"], number)
    bars = tuple((a, b) for a, b in table.get("bars", []))
    lengths = [length(points[b] - points[a]) for a, b in bars]
    for i, bar in enumerate(lengths):
        if bar == 0:
            raise BuildError(f"links.{name}.bars[{i}]", "zero length")
    none = number("0")
    points_of_mass = [Mass(exact(number, x["mass"]), points[x["point"]], none) for x in table.get("point_masses", [])]
    if "mass" not in table and "kg_per_m" not in table:  # point masses alone
        parts = points_of_mass
        own = [Mass(none, points_of_mass[0].com, exact(number, table["inertia"]))] if "inertia" in table else []
        whole = together([*parts, *own])
        if not whole.inertia > 0:
            raise BuildError(f"links.{name}.inertia", "required: masses at one point have none")
        return Link(name, whole.mass, whole.inertia, whole.com, points, bars)
    total = sum(lengths, start=none)
    mass = exact(number, table["mass"]) if "mass" in table else exact(number, table["kg_per_m"]) * total
    middles = [(points[a] + points[b]) / 2 for a, b in bars]
    if "com" in table:
        com = pair(number, table["com"])
    else:
        weighted = (x * m for x, m in zip(lengths, middles, strict=True))
        com = sum(weighted, start=pair(number, (0, 0))) / (total if bars else number("1"))
    if "inertia" in table:
        inertia = exact(number, table["inertia"])
    else:
        # thin rods: l^2 / 12 about the middle, and the parallel-axis term, weighted by length
        second = (x * (x * x / 12 + length(m - com) ** 2) for x, m in zip(lengths, middles, strict=True))
        inertia = mass / total * sum(second, start=none)
    if points_of_mass:
        mass, com, inertia = together([Mass(mass, com, inertia), *points_of_mass])
    return Link(name, mass, inertia, com, points, bars)


class Resolver:
    """Resolves the names of one document to indices and points; welded links become bodies, or stay `apart`."""

    def __init__(self, document: dict[str, Any], number: Number = float, apart: bool = False):
        self.number_type, self.edition = number, document["format"]
        self.given = {name: build_link(name, table, number) for name, table in document["links"].items()}
        welds = {} if apart else document.get("welds", {})
        self.poses = poses(self.given, welds, _first_named(document), number)
        self.links = bodies(self.given, self.poses)
        self.parts = parts(self.given, self.poses, self.links) if welds else ()
        self.welds = read_welds(self.given, welds)
        own = {link.name: i for i, link in enumerate(self.links)}
        self.index = {name: own[pose.root] for name, pose in self.poses.items()} | {"ground": GROUND}
        self.ground_points = resolve_points(document.get("ground", {}).get("points", {}), number)
        self.joints = tuple(pair for name, table in document.get("joints", {}).items() for pair in self.joint(name, table))

    def link(self, name: str) -> int:
        return self.index[name]

    def pairs(self, joint: str) -> tuple[Joint, ...]:
        return tuple(pair for pair in self.joints if pair.joint == joint)

    def pairs_to_damp(self, joint: str) -> tuple[Joint, ...]:
        return every_two(self.pairs(joint)) if self.edition == SECOND else self.pairs(joint)

    def pair(self, values: Any) -> Array:
        return np.asarray(pair(self.number_type, values))

    def number(self, table: Mapping[str, Any], key: str) -> Any:
        return exact(self.number_type, table.get(key, 0))

    def angle(self, table: Mapping[str, Any], key: str) -> Any:
        return angle_of(table, key, self.number_type)

    @property
    def world(self) -> Point:
        """The origin of the world."""
        return Point(GROUND, pair(self.number_type, (0, 0)), "ground.")

    def point(self, reference: str) -> Point:
        owner, name = reference.split(".")
        i = self.index[owner]
        if i == GROUND:
            return Point(i, self.ground_points[name], reference)
        body = self.links[i]
        own = name if body.name == owner else reference
        return Point(i, body.points[own] - body.com, f"{body.name}.{own}")

    def turn(self, name: str) -> Any:
        owner = name.partition(".")[0]
        return 0 if self.index[owner] == GROUND else self.poses[owner].turn

    def joint(self, name: str, table: dict[str, Any]) -> list[Joint]:
        """Return the pairs of one joint; a pin through m links is m - 1 pairs NAME, NAME.001, ... in list order."""
        if table["type"] == "prismatic":
            angle, block_angle = (
                angle_of(table, key, self.number_type) + self.turn(table[of])
                for key, of in (("angle", "guide"), ("block_angle", "block"))
            )
            guide, block = self.point(table["guide"]), self.point(table["block"])
            return [Prismatic(name, guide, block, angle, angle - block_angle, exact(self.number_type, table.get("offset", 0)))]
        points = [self.point(x) for x in table["at"]]
        names = [name if k == 0 else f"{name}.{k:03d}" for k in range(len(points) - 1)]
        return [Revolute(n, name, a, b) for n, a, b in zip(names, points, points[1:], strict=False)]

    def force(self, name: str, table: dict[str, Any]) -> Force | CoulombFriction:
        found: Force | CoulombFriction = FORCES[table["type"]].read(name, table, self)
        return found

    def driver(self, table: dict[str, Any]) -> Driver:
        law = motion_law(table, self.number_type, self.turn(table["link"]) if "link" in table else 0)
        return self.driven(table, law)

    def driven(self, table: dict[str, Any], law: MotionLaw) -> Driver:
        """Return the driver of the coordinate that a table names by `joint`, `between` or `link`."""
        if "joint" in table:
            slide = next(j for j in self.joints if isinstance(j, Prismatic) and j.name == table["joint"])
            return SlideDriver(slide.name, law, slide)
        if "between" in table:
            a, b = (self.point(x) for x in table["between"])
            return LengthDriver(f"{a.name}-{b.name}", law, a, b)
        return AngleDriver(table["link"], law, self.index[table["link"]])

    def measured(self, table: dict[str, Any]) -> Measured:
        """Return the coordinate that the table `measure` names."""
        if "point" in table:
            angle = angle_of(table, "angle", self.number_type)
            degrees = float(np.degrees(float(angle)))
            axis = {0.0: "x", 90.0: "y"}.get(degrees, f"way at {degrees:g} deg")
            return Measured(f"{axis} of {table['point']}", Along(self.world, self.point(table["point"]), angle))
        return self.usually_measured((self.driven(table, motion_laws.constant(0.0, 0.0)),), None)

    def usually_measured(self, drivers: tuple[Driver, ...], crank: str | None) -> Measured:
        """Return the default measured coordinate: the first driver's, else the crank's angle, else that of the first link.

        In the last case `assemble` replaces it by the first coordinate that can move.
        """
        match drivers:
            case (SlideDriver() as first, *_):
                return measure_slide(first.joint)
            case (LengthDriver() as first, *_):
                return Measured(f"distance {first.name}", first.coordinate)
            case (AngleDriver() as first, *_):
                return measure_angle(self.links, first.link)
        return measure_angle(self.links, 0 if crank is None else self.index[crank])


def measure_angle(links: tuple[Link, ...], index: int) -> Measured:
    return Measured(f"angle of {links[index].name}", Angle(GROUND, index))


def measure_slide(joint: Prismatic) -> Measured:
    return Measured(f"slide {joint.name}", joint.motion)


def motion_law(table: dict[str, Any], number: Number = float, turn: Any = 0) -> MotionLaw:
    """Return the law of a driver table, shifted by the angle -turn [rad] of a welded link in its body.

    Values in tables are degrees if a link is driven, otherwise metres.
    """
    start = angle_of(table, "start", number) - turn
    match table["law"]:
        case "constant":
            return motion_laws.constant(start, exact(number, table["speed"]))
        case "table":
            value = radians if "link" in table else exact
            times, values = ([f(number, row[k]) for row in table["rows"]] for k, f in enumerate((exact, value)))
            return motion_laws.table(start, np.array(times), np.array(values))
        case name:
            travel, time = angle_of(table, "travel", number), exact(number, table["time"])
            return motion_laws.rise(name, start, travel, time, number)


def _first_named(document: dict[str, Any]) -> list[str]:
    """List the links that become roots of their bodies: the crank and the driven links."""
    tables = [y for x in document["scenarios"].values() for y in (x.get("driver"), *x.get("drivers", [])) if y]
    return [name for name in (document.get("crank"), *(x.get("link") for x in tables)) if name]


def build_mechanism(
    document: dict[str, Any], scenario: str, source: str, sha256: str, number: Number = float, apart: bool = False
) -> Mechanism:
    """Return the mechanism of one scenario in numbers of one type, not yet assembled (q0, v0 empty).

    Welded links become one body, and the mechanism of the unwelded links is its `apart`; with apart=True no link is welded.

    Raises:
        BuildError: a fault that only shows in resolved points, such as a bar without length.
    """
    given, document = document, write_out(document)
    names = Resolver(document, number, apart)
    constraints = [CONSTRAINTS[x["type"]].read(name, x, names) for name, x in document.get("constraints", {}).items()]
    chosen = document["scenarios"][scenario]
    acting = [names.force(f, document["forces"][f]) for f in chosen.get("forces", [])]
    observe = document.get("observe", {})
    crank = document.get("crank")
    drivers = tuple(names.driver(x) for x in drivers_of(chosen))
    return Mechanism(
        name=document["name"],
        title=document.get("title", ""),
        scenario=scenario,
        scenarios=tuple(document["scenarios"]),
        source=source,
        sha256=sha256,
        digest=physics_digest(given, scenario),
        duration=float(chosen["duration"]),
        links=names.links,
        ground_points=names.ground_points,
        joints=names.joints,
        knife_edges=tuple(x for x in constraints if isinstance(x, KnifeEdge)),
        couplings=tuple(x for x in constraints if not isinstance(x, KnifeEdge)),
        forces=tuple(f for f in acting if not isinstance(f, CoulombFriction)),
        drivers=drivers,
        gravity=pair(number, document.get("gravity", (0.0, -9.81))),
        crank=None if crank is None else names.index[crank],
        observed_points=tuple(names.point(x) for x in observe.get("points", [])),
        observed_links=tuple(names.index[x] for x in observe.get("links", [])),
        measured=names.measured(document["measure"]) if "measure" in document else names.usually_measured(drivers, crank),
        frictions=tuple(f for f in acting if isinstance(f, CoulombFriction)),
        parts=names.parts,
        welds=names.welds,
        apart=build_mechanism(given, scenario, source, sha256, number, True) if names.parts else None,
    )
