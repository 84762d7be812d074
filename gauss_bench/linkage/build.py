"""Build the frozen `Mechanism` of a checked document: resolve points, compute masses, turn names into indices.

All numbers have one type, double by default. Certificates use a type with more digits, which keeps all decimals of the file.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np

from gauss_bench.linkage.bodies import Mass, combine_masses, expand_cylinders, find_poses, list_parts, merge_welded, read_welds
from gauss_bench.linkage.errors import BuildError
from gauss_bench.linkage.references import drivers_of
from gauss_bench.linkage.schema import CONSTRAINTS, FORCES, SECOND, physics_digest
from gauss_bench.mechanism import model, motion_laws
from gauss_bench.mechanism.frames import unit
from gauss_bench.mechanism.motion_laws import MotionLaw
from gauss_bench.mechanism.numbers import Number, angle_of, exact, length, pair, radians
from gauss_bench.terms import Array


def resolve_points(table: dict[str, Any], number: Number = float) -> dict[str, Array]:
    """Return name -> position (2,) [m] of every point in the link's frame; polar and relative points are resolved.

    `number` converts decimal text to the type of the numbers; `exact` and `radians` apply it to a value.
    """
    positions: dict[str, Array] = {}

    def resolve(name: str) -> Array:
        """Return the position of a point; if it is relative to another point, resolve that point first."""
        if name not in positions:
            value = table[name]
            if not isinstance(value, dict):
                positions[name] = pair(number, value)
            else:
                base = resolve(value["from"]) if "from" in value else pair(number, (0, 0))
                if "r" in value:
                    shift = exact(number, value["r"]) * unit(radians(number, value.get("deg", 0)))
                else:
                    shift = pair(number, value["xy"])
                positions[name] = base + shift
        return positions[name]

    return {name: resolve(name) for name in table}


def build_link(name: str, table: dict[str, Any], number: Number = float) -> model.Link:
    """Return the link of a table; a mass, centre or inertia that the table lacks follows from uniform bars and point masses.

    Raises:
        BuildError: a bar has zero length, or the link has zero inertia.
    """
    points = resolve_points(table["points"], number)
    bars = tuple((a, b) for a, b in table.get("bars", []))
    for i, (a, b) in enumerate(bars):
        if length(points[b] - points[a]) == 0:
            raise BuildError(f"links.{name}.bars[{i}]", "zero length")
    zero = number("0")
    point_masses = [Mass(exact(number, x["mass"]), points[x["point"]], zero) for x in table.get("point_masses", [])]
    if "mass" in table or "kg_per_m" in table:
        bare = _mass_of_bars(table, [(points[a], points[b]) for a, b in bars], number)  # without point masses
        total = combine_masses([bare, *point_masses]) if point_masses else bare
    else:
        # there are only point masses; an inertia in the file counts as that of a part without mass
        own_inertia = [Mass(zero, point_masses[0].com, exact(number, table["inertia"]))] if "inertia" in table else []
        total = combine_masses([*point_masses, *own_inertia])
        if not total.inertia > 0:
            raise BuildError(f"links.{name}.inertia", "required: masses at one point have no inertia")
    return model.Link(name, total.mass, total.inertia, total.com, points, bars)


def _mass_of_bars(table: dict[str, Any], bars: list[tuple[Array, Array]], number: Number) -> Mass:
    """Return mass, centre and inertia of a link without its point masses: those of its table, else of uniform bars (ends [m])."""
    zero = number("0")
    lengths = [length(b - a) for a, b in bars]
    middles = [(a + b) / 2 for a, b in bars]
    total_length = sum(lengths, start=zero)
    mass = exact(number, table["mass"]) if "mass" in table else exact(number, table["kg_per_m"]) * total_length
    if "com" in table:
        com = pair(number, table["com"])
    else:
        weighted = (size * middle for size, middle in zip(lengths, middles, strict=True))
        com = sum(weighted, start=pair(number, (0, 0))) / (total_length if bars else number("1"))  # the origin without bars
    if "inertia" in table:
        return Mass(mass, com, exact(number, table["inertia"]))
    # thin rods: l^2 / 12 about the middle, and the parallel-axis term, weighted by length
    moments = (size * (size * size / 12 + length(middle - com) ** 2) for size, middle in zip(lengths, middles, strict=True))
    return Mass(mass, com, mass / total_length * sum(moments, start=zero))


class UnknownLink(KeyError):
    """A table names a link that the file does not have."""


class Resolver:
    """The links, points and joints of one document by name: the `Names` from which forces and constraints are read.

    Attributes:
        links: the rigid bodies; links that are welded to each other are one body.
        parts: for each link of the file, its body and its pose in this body; empty if nothing is welded.
        index: link of the file, or "ground" -> index of its body.
        poses: link of the file -> its frame in the frame of its body.
    """

    def __init__(self, document: dict[str, Any], number: Number = float, unwelded: bool = False):
        """Resolve all links, points and joints of a document; with `unwelded`, each link of the file is a body of its own.

        Raises:
            BuildError: a fault that shows only when positions are computed from the file's numbers, such as a bar without length.
        """
        self.number_type, self.format = number, document["format"]  # format: edition of the grammar, such as "planar-linkage/1"
        links = {name: build_link(name, table, number) for name, table in document["links"].items()}
        welds = {} if unwelded else document.get("welds", {})
        # the crank and the driven links give their bodies (groups of welded links) their frames
        drivers = [driver for scenario in document["scenarios"].values() for driver in drivers_of(scenario)]
        preferred = [document.get("crank"), *(driver.get("link") for driver in drivers)]
        self.poses = find_poses(links, welds, preferred, number)
        self.links = merge_welded(links, self.poses)
        self.parts = list_parts(links, self.poses, self.links) if welds else ()
        self.welds = read_welds(links, welds)
        body_index = {body.name: i for i, body in enumerate(self.links)}
        self.index = {name: body_index[pose.root] for name, pose in self.poses.items()} | {"ground": model.GROUND}
        self.ground_points = resolve_points(document.get("ground", {}).get("points", {}), number)
        self.joints = tuple(joint for name, table in document.get("joints", {}).items() for joint in self.build_joint(name, table))

    def link(self, name: str) -> int:
        """Return the index of the body that carries a link.

        Raises:
            UnknownLink: there is no such link.
        """
        if name not in self.index:
            raise UnknownLink(name)
        return self.index[name]

    def pairs(self, joint: str) -> tuple[model.Joint, ...]:
        """Return the pairs of a joint: the slide, or a pin between every two consecutive links of the joint's list."""
        return tuple(pair for pair in self.joints if pair.joint == joint)

    def pairs_to_damp(self, joint: str) -> tuple[model.Joint, ...]:
        """Return the pairs in which a joint is damped: every two of its links or, in the first edition, consecutive links."""
        return model.pins_of_all_pairs(self.pairs(joint)) if self.format == SECOND else self.pairs(joint)

    def pair(self, values: Any) -> Array:
        """Return a pair of numbers of the file as an array (2,)."""
        return np.asarray(pair(self.number_type, values))

    def number(self, table: Mapping[str, Any], key: str) -> Any:
        """Return the number at `key` of a table; 0 if it is missing."""
        return exact(self.number_type, table.get(key, 0))

    def angle(self, table: Mapping[str, Any], key: str) -> Any:
        """Return the angle [rad] at `key` or, in degrees, at `key_deg` of a table; 0 if both are missing."""
        return angle_of(table, key, self.number_type)

    @property
    def world(self) -> model.Point:
        """The origin of the world."""
        return model.Point(model.GROUND, pair(self.number_type, (0, 0)), "ground.")

    def point(self, reference: str) -> model.Point:
        """Return the point "link.point" as a point of the body that carries the link."""
        owner, name = reference.split(".")
        i = self.link(owner)
        if i == model.GROUND:
            return model.Point(i, self.ground_points[name], reference)
        body = self.links[i]
        key = name if body.name == owner else reference  # a body has the points of the other links under their full names
        return model.Point(i, body.points[key] - body.com, f"{body.name}.{key}")

    def turn(self, name: str) -> Any:
        """Return the angle [rad] of a link in the frame of its body, 0 for the ground; `name` is LINK or LINK.POINT."""
        owner = name.partition(".")[0]
        return 0 if self.index[owner] == model.GROUND else self.poses[owner].turn

    def build_joint(self, name: str, table: dict[str, Any]) -> list[model.Joint]:
        """Return the kinematic pairs of one joint; a pin through m links has m - 1 pairs NAME, NAME.001, ..."""
        if table["type"] == "prismatic":
            # the file gives the angles of the axis in the frames of links; here they are in those of the bodies
            angle = self.angle(table, "angle") + self.turn(table["guide"])
            block_angle = self.angle(table, "block_angle") + self.turn(table["block"])
            guide, block = self.point(table["guide"]), self.point(table["block"])
            # the axis has one direction: theta_guide + angle = theta_block + block_angle, which gives theta_block - theta_guide
            return [model.Prismatic(name, guide, block, angle, angle - block_angle, self.number(table, "offset"))]
        points = [self.point(x) for x in table["at"]]
        names = [name if k == 0 else f"{name}.{k:03d}" for k in range(len(points) - 1)]
        return [model.Revolute(pair_name, name, a, b) for pair_name, a, b in zip(names, points, points[1:], strict=False)]

    def build_force(self, name: str, table: dict[str, Any]) -> model.Force | model.CoulombFriction:
        """Return the force or dry friction that a table of the file describes.

        Raises:
            BuildError: a force has no loads, or it varies and is neither a torque nor a force at a point.
        """
        force: model.Force | model.CoulombFriction = self.read(FORCES, f"forces.{name}", table)
        if isinstance(force, model.CoulombFriction) or model.factor_of(force):
            return force
        try:
            model.loads([force])
        except model.UnsupportedForce as error:
            key = next((x for x in ("over_time", "against") if x in table), "type")
            raise BuildError(f"forces.{name}.{key}", str(error)) from error
        return force

    def read(self, kinds: Mapping[str, Any], path: str, table: dict[str, Any]) -> Any:
        """Return the force or constraint of the table at `path`.

        Raises:
            BuildError: the table names a link that does not exist, in a key that `grammar.toml` does not list in `named`.
        """
        name = path.partition(".")[2]
        try:
            return kinds[table["type"]].read(name, table, self)
        except UnknownLink as error:
            raise BuildError(path, f"there is no link {error}") from error

    def build_driver(self, table: dict[str, Any], law: MotionLaw) -> model.Driver:
        """Return the driver with a given law; the table names the driven coordinate by `joint`, `between` or `link`."""
        if "joint" in table:
            slide = next(j for j in self.joints if isinstance(j, model.Prismatic) and j.name == table["joint"])
            return model.SlideDriver(slide.name, law, slide)
        if "between" in table:
            a, b = (self.point(x) for x in table["between"])
            return model.LengthDriver(f"{a.name}-{b.name}", law, a, b)
        return model.AngleDriver(table["link"], law, self.index[table["link"]])

    def find_measured(self, table: dict[str, Any]) -> model.Measured:
        """Return the coordinate that the table `measure` of the file names."""
        if "point" in table:
            angle = self.angle(table, "angle")
            degrees = float(np.degrees(float(angle)))
            axis = {0.0: "x", 90.0: "y"}.get(degrees, f"axis at {degrees:g} deg")
            return model.Measured(f"{axis} of {table['point']}", model.Along(self.world, self.point(table["point"]), angle))
        # the table names its coordinate by the keys of a driver's table: build a driver, whose law is not used
        driver = self.build_driver(table, motion_laws.constant(0.0, 0.0))
        return self.choose_measured((driver,), None)

    def choose_measured(self, drivers: tuple[model.Driver, ...], crank: str | None) -> model.Measured:
        """Return the coordinate that reports show by default: that of the first driver, else the angle of the crank or first link.

        Without drivers, crank or `measure`, `assemble` replaces the angle of the first link by the first coordinate that can move.
        """
        match drivers:
            case (model.SlideDriver() as first, *_):
                return measure_slide(first.joint)
            case (model.LengthDriver() as first, *_):
                return model.Measured(f"distance {first.name}", first.coordinate)
            case (model.AngleDriver() as first, *_):
                return measure_angle(self.links, first.link)
        return measure_angle(self.links, 0 if crank is None else self.index[crank])


def measure_angle(links: tuple[model.Link, ...], index: int) -> model.Measured:
    """Return the angle of a link, with the name under which reports print it."""
    return model.Measured(f"angle of {links[index].name}", model.Angle(model.GROUND, index))


def measure_slide(joint: model.Prismatic) -> model.Measured:
    """Return the coordinate along a slide, with the name under which reports print it."""
    return model.Measured(f"slide {joint.name}", joint.motion)


def build_law(table: dict[str, Any], number: Number = float, turn: Any = 0) -> MotionLaw:
    """Return the motion law of a driver's table; `turn` [rad] is the angle of the driven link in its body."""
    start = angle_of(table, "start", number) - turn
    match table["law"]:
        case "constant":
            return motion_laws.constant(start, exact(number, table["speed"]))
        case "table":
            convert = radians if "link" in table else exact  # rows have degrees if a link is driven, otherwise metres
            times = [exact(number, time) for time, _ in table["rows"]]
            values = [convert(number, value) for _, value in table["rows"]]
            return motion_laws.table(start, np.array(times), np.array(values))
        case name:
            travel, time = angle_of(table, "travel", number), exact(number, table["time"])
            return motion_laws.rise(name, start, travel, time, number)


def build_mechanism(
    document: dict[str, Any], scenario: str, source: str, sha256: str, number: Number = float, unwelded: bool = False
) -> model.Mechanism:
    """Return the mechanism of one scenario, with all numbers in one type; it is not assembled yet: q0 and v0 are empty.

    Links that are welded to each other become one body, and `Mechanism.apart` has every link as a body of its own (None without
    welds). With `unwelded`, every link is a body of its own in the returned mechanism itself.

    Raises:
        BuildError: a fault that shows only when positions are computed from the file's numbers, such as a bar without length.
    """
    expanded = expand_cylinders(document)
    names = Resolver(expanded, number, unwelded)
    constraints = [names.read(CONSTRAINTS, f"constraints.{name}", x) for name, x in expanded.get("constraints", {}).items()]
    chosen = expanded["scenarios"][scenario]
    forces = [names.build_force(name, expanded["forces"][name]) for name in chosen.get("forces", [])]
    observe = expanded.get("observe", {})
    crank = expanded.get("crank")
    turns = [names.turn(x["link"]) if "link" in x else 0 for x in drivers_of(chosen)]  # angles of the driven links in their bodies
    drivers = tuple(names.build_driver(x, build_law(x, number, turn)) for x, turn in zip(drivers_of(chosen), turns, strict=True))
    return model.Mechanism(
        name=document["name"],
        title=document.get("title", ""),
        scenario=scenario,
        scenarios=tuple(document["scenarios"]),
        source=source,
        sha256=sha256,
        digest=physics_digest(document, scenario),
        duration=float(chosen["duration"]),
        links=names.links,
        ground_points=names.ground_points,
        joints=names.joints,
        knife_edges=tuple(x for x in constraints if isinstance(x, model.KnifeEdge)),
        couplings=tuple(x for x in constraints if not isinstance(x, model.KnifeEdge)),
        forces=tuple(f for f in forces if not isinstance(f, model.CoulombFriction)),
        drivers=drivers,
        gravity=pair(number, document.get("gravity", (0.0, -9.81))),
        crank=None if crank is None else names.index[crank],
        observed_points=tuple(names.point(x) for x in observe.get("points", [])),
        observed_links=tuple(names.index[x] for x in observe.get("links", [])),
        measured=names.find_measured(document["measure"]) if "measure" in document else names.choose_measured(drivers, crank),
        frictions=tuple(f for f in forces if isinstance(f, model.CoulombFriction)),
        parts=names.parts,
        welds=names.welds,
        apart=build_mechanism(document, scenario, source, sha256, number, True) if names.parts else None,
    )
