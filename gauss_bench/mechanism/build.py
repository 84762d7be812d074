"""A checked document becomes frozen data: points resolved, masses worked out, names turned into indices."""

from typing import Any

import numpy as np

from gauss_bench.mechanism import motion_laws
from gauss_bench.mechanism.errors import Fault
from gauss_bench.mechanism.model import (
    GROUND,
    AngleDriver,
    AxisSpringDamper,
    CoulombFriction,
    Driver,
    Force,
    Joint,
    JointDamping,
    KnifeEdge,
    LengthDriver,
    Link,
    Mechanism,
    Point,
    PointForce,
    Prismatic,
    Revolute,
    RotationalSpringDamper,
    SlideDriver,
    SpringDamper,
    Torque,
)
from gauss_bench.mechanism.motion_laws import MotionLaw
from gauss_bench.terms import Array


class BuildError(ValueError):
    """A fault that only shows once points are resolved."""

    def __init__(self, path: str, text: str):
        self.fault = Fault(path, text)
        super().__init__(str(self.fault))


def radians(table: dict[str, Any], key: str) -> float:
    """The angle `key` in radians, written as `key` or as `key_deg`; 0 where neither is given."""
    return float(table[key]) if key in table else float(np.radians(table.get(f"{key}_deg", 0.0)))


def resolve_points(table: dict[str, Any]) -> dict[str, Array]:
    """Name -> (2,) position, with polar and relative forms worked out."""
    done: dict[str, Array] = {}

    def resolve(key: str) -> Array:
        if key not in done:
            value = table[key]
            if isinstance(value, dict):
                base = resolve(value["from"]) if "from" in value else np.zeros(2)
                if "r" in value:
                    theta = np.radians(value.get("deg", 0.0))
                    value = base + value["r"] * np.array([np.cos(theta), np.sin(theta)])
                else:
                    value = base + np.array(value["xy"], dtype=float)
            done[key] = np.array(value, dtype=float)
        return done[key]

    return {key: resolve(key) for key in table}


def build_link(name: str, table: dict[str, Any]) -> Link:
    """Mass, centre of mass and inertia from what is given and, for the rest, from uniform bars."""
    points = resolve_points(table["points"])
    bars = tuple((a, b) for a, b in table.get("bars", []))
    lengths = [float(np.linalg.norm(points[b] - points[a])) for a, b in bars]
    for i, length in enumerate(lengths):
        if length == 0:
            raise BuildError(f"links.{name}.bars[{i}]", "zero length")
    total = sum(lengths)
    mass = float(table["mass"]) if "mass" in table else float(table["kg_per_m"]) * total
    middles = [(points[a] + points[b]) / 2 for a, b in bars]
    if "com" in table:
        com = np.array(table["com"], dtype=float)
    else:
        com = sum((x * m for x, m in zip(lengths, middles, strict=True)), start=np.zeros(2)) / total if bars else np.zeros(2)
    if "inertia" in table:
        inertia = float(table["inertia"])
    else:
        second = (x * (x**2 / 12 + np.sum((m - com) ** 2)) for x, m in zip(lengths, middles, strict=True))
        inertia = mass / total * float(sum(second))
    return Link(name, mass, inertia, com, points, bars)


class Resolver:
    """Looks up the names of one document."""

    def __init__(self, document: dict[str, Any]):
        self.links = tuple(build_link(name, table) for name, table in document["links"].items())
        self.index = {link.name: i for i, link in enumerate(self.links)} | {"ground": GROUND}
        self.ground_points = resolve_points(document.get("ground", {}).get("points", {}))

    def point(self, reference: str) -> Point:
        owner, name = reference.split(".")
        i = self.index[owner]
        local = self.ground_points[name] if i == GROUND else self.links[i].points[name] - self.links[i].com
        return Point(i, local, reference)

    def joint(self, name: str, table: dict[str, Any]) -> list[Joint]:
        """The pairs of one joint; a pin through m links is m - 1 pairs NAME, NAME.001, ... in list order."""
        if table["type"] == "prismatic":
            angle, block_angle = radians(table, "angle"), radians(table, "block_angle")
            guide, block = self.point(table["guide"]), self.point(table["block"])
            return [Prismatic(name, guide, block, angle, angle - block_angle, float(table.get("offset", 0.0)))]
        points = [self.point(x) for x in table["at"]]
        names = [name if k == 0 else f"{name}.{k:03d}" for k in range(len(points) - 1)]
        return [Revolute(n, name, a, b) for n, a, b in zip(names, points, points[1:], strict=False)]

    def force(self, name: str, table: dict[str, Any], joints: tuple[Joint, ...]) -> Force:
        k, c, rest = (float(table.get(key, 0.0)) for key in ("k", "c", "rest"))
        match table["type"]:
            case "torque":
                reaction = self.index[table.get("reaction", "ground")]
                return Torque(name, self.index[table["link"]], reaction, float(table["value"]))
            case "force":
                point, frame = self.point(table["point"]), table.get("frame", "ground")
                owner = point.link if frame == "body" else self.index[frame]
                return PointForce(name, point, np.array(table["value"], dtype=float), owner)
            case "spring_damper":
                a, b = (self.point(x) for x in table["between"])
                return SpringDamper(name, a, b, k, c, rest)
            case "axis_spring_damper":
                origin = self.point(table["origin"]) if "origin" in table else Point(GROUND, np.zeros(2), "ground.")
                return AxisSpringDamper(name, self.point(table["point"]), origin, radians(table, "angle"), k, c, rest)
            case "rotational_spring_damper":
                first, second = (self.index[x] for x in table["links"])
                return RotationalSpringDamper(name, first, second, k, c, radians(table, "rest"))
        return JointDamping(name, tuple(j for j in joints if j.joint == table["joint"]), c)

    def friction(self, name: str, table: dict[str, Any], joints: tuple[Joint, ...]) -> CoulombFriction:
        pairs = tuple(j for j in joints if j.joint == table["joint"])
        return CoulombFriction(name, pairs, float(table["mu"]), float(table.get("radius", 1.0)), float(table["speed"]))

    def driver(self, table: dict[str, Any], joints: tuple[Joint, ...]) -> Driver:
        law = motion_law(table)
        if "joint" in table:
            slide = next(j for j in joints if isinstance(j, Prismatic) and j.name == table["joint"])
            return SlideDriver(slide.name, law, slide)
        if "between" in table:
            a, b = (self.point(x) for x in table["between"])
            return LengthDriver(f"{a.name}-{b.name}", law, a, b)
        return AngleDriver(table["link"], law, self.index[table["link"]])


def motion_law(table: dict[str, Any]) -> MotionLaw:
    """The law of a driver table; values in tables are degrees where a link is driven, metres elsewhere."""
    start = radians(table, "start")
    match table["law"]:
        case "constant":
            return motion_laws.constant(start, float(table["speed"]))
        case "table":
            rows = np.array(table["rows"], dtype=float)
            values = np.radians(rows[:, 1]) if "link" in table else rows[:, 1]
            return motion_laws.table(start, rows[:, 0], values)
        case name:
            return motion_laws.rise(name, start, radians(table, "travel"), float(table["time"]))


def build_mechanism(document: dict[str, Any], scenario: str, source: str, sha256: str) -> Mechanism:
    """The mechanism of one scenario, not yet assembled (q0, v0 empty).

    Raises:
        BuildError: a fault that only shows in resolved points, such as a bar without length.
    """
    names = Resolver(document)
    joints = tuple(pair for name, table in document.get("joints", {}).items() for pair in names.joint(name, table))
    knives = document.get("constraints", {}).items()
    chosen = document["scenarios"][scenario]
    acting = [(f, document["forces"][f]) for f in chosen.get("forces", [])]
    observe = document.get("observe", {})
    crank = document.get("crank")
    driven = [chosen["driver"]] if "driver" in chosen else chosen.get("drivers", [])
    return Mechanism(
        name=document["name"],
        title=document.get("title", ""),
        scenario=scenario,
        scenarios=tuple(document["scenarios"]),
        source=source,
        sha256=sha256,
        duration=float(chosen["duration"]),
        links=names.links,
        ground_points=names.ground_points,
        joints=joints,
        knife_edges=tuple(KnifeEdge(k, names.point(x["point"]), radians(x, "angle")) for k, x in knives),
        forces=tuple(names.force(f, x, joints) for f, x in acting if x["type"] != "coulomb_friction"),
        drivers=tuple(names.driver(x, joints) for x in driven),
        gravity=np.array(document.get("gravity", [0.0, -9.81]), dtype=float),
        crank=None if crank is None else names.index[crank],
        observed_points=tuple(names.point(x) for x in observe.get("points", [])),
        observed_links=tuple(names.index[x] for x in observe.get("links", [])),
        frictions=tuple(names.friction(f, x, joints) for f, x in acting if x["type"] == "coulomb_friction"),
    )
