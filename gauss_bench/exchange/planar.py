"""Convert a spatial mechanism to the document of a planar linkage: plane, links, joints, forces and a start.

The axes of all hinges are normal to the plane. The plane's own axes are as near as possible to axes of the world: a mechanism in
the x-z plane of the world gets x and z as axes, so that it stays upright. Bodies that are welded to each other are one link, and
bodies that are welded to the world are ground. The frame of a link is the frame of the first of its bodies. Points and vectors in
the plane are complex numbers x + i y.
"""

import re
from cmath import phase, rect
from collections.abc import Collection, Iterator
from dataclasses import dataclass
from itertools import pairwise, permutations
from typing import Any

import numpy as np

from gauss_bench.exchange.spatial import WORLD, Between, Body, Force, Joint, LinearLaw, OnJoints, Push, Spatial, Spot
from gauss_bench.exchange.text import make_unique
from gauss_bench.linkage.build import build_mechanism
from gauss_bench.linkage.closure import close_joints, null_space
from gauss_bench.linkage.schema import FORMAT
from gauss_bench.linkage.sketch import sketch
from gauss_bench.linkage.start_coordinates import choose_held
from gauss_bench.mechanism.coordinates import gradient, value
from gauss_bench.mechanism.evaluate import Constraints
from gauss_bench.mechanism.model import GROUND, Mechanism
from gauss_bench.terms import Array

FLAT = 1e-9  # largest sine of an angle out of the plane, or offset relative to the mechanism's size, that is taken as rounding
SAME = 1e-12  # [m] distance up to which two points of a link are the same
OPEN = 1e-6  # gap relative to the mechanism's size above which a loop is reported as open
DURATION = 5.0  # [s] duration of the scenario, because model files have none
SCENARIO = "as_imported"
Table = dict[str, Any]


@dataclass(frozen=True, eq=False)
class Plane:
    """A plane in space, given by three orthogonal unit vectors (3,): its axes x and y, and its normal."""

    x: Array
    y: Array
    normal: Array

    def project(self, place: Array) -> complex:
        """Return the projection of a vector (3,) onto the plane, as x + i y."""
        return complex(place @ self.x, place @ self.y)


@dataclass(frozen=True)
class Move:
    """A rigid displacement of a body in the plane: a rotation by `angle` [rad] about the origin, then a shift [m].

    Attributes:
        omega: angular velocity of the body [rad/s].
        speed: velocity of the point of the body that is at the origin of the plane after the displacement [m/s].
    """

    angle: float = 0.0
    shift: complex = 0j
    omega: float = 0.0
    speed: complex = 0j

    def place(self, x: complex) -> complex:
        """Return the point to which the displacement moves the body's point at x."""
        return rect(1.0, self.angle) * x + self.shift

    def velocity(self, x: complex) -> complex:
        """Return the velocity [m/s] of the body's point that was at x before the body was displaced."""
        return self.speed + 1j * self.omega * self.place(x)

    def follow(self, joint: Joint, axis: complex, anchor: complex, sign: float) -> "Move":
        """Return the displacement of the child body of a joint; `self` is the displacement of the parent body.

        Args:
            axis, anchor: direction of a slide and pivot of a hinge in the plane, before both bodies are displaced.
            sign: 1 if a hinge's axis has the direction of the plane's normal, else -1.
        """
        change = joint.start - joint.ref
        if joint.kind == "slide":
            along = rect(1.0, self.angle) * axis
            return Move(self.angle, self.shift + change * along, self.omega, self.speed + joint.speed * along)
        angle, rate = self.angle + sign * change, sign * joint.speed
        pivot = self.place(anchor)
        # the child's displacement also brings `anchor` to `pivot`, and speed + i omega pivot is the same for both bodies
        return Move(angle, pivot - rect(1.0, angle) * anchor, self.omega + rate, self.speed - 1j * rate * pivot)


def pair(x: complex) -> list[float]:
    """Return a point or vector x + i y as [x, y]."""
    return [float(x.real), float(x.imag)]


class Flattened:
    """A mechanism in space, projected into its plane; its methods raise ExchangeError for a part that a linkage cannot have.

    Bodies and joints are given by their indices in the mechanism, and a link by the index of its first body.

    Attributes:
        extent: size of the mechanism: the largest distance of a joint from the centre of mass of its body [m], or 1 if that is 0.
        joints_of: body -> joints that move it relative to its parent, in order.
        link_of: body -> its link; bodies that are fixed or welded to each other are one link.
        moves: body -> its displacement from the file's configuration (every joint coordinate at its `ref`) to the start.
        members: link -> its bodies.
        links: the links except the ground, in the order of their first bodies.
        names: link -> its name in the linkage file.
        frames: link -> origin and angle [rad] of its frame in the configuration of the file.
        points: link -> name of a point -> place in the link's frame [m].
        joint_names: joint -> its name in the linkage file.
        locked: joints that a weld keeps from moving, because it makes their two bodies one link.
        remarks: phrases on parts of the file that the linkage leaves out or changes.
    """

    def __init__(self, spatial: Spatial):
        """Find the plane and the links, and move the bodies to the start; `write_document` adds points, joints and forces."""
        self.spatial, self.remarks, self.refuse = spatial, list(spatial.dropped), spatial.refuse
        self.plane = find_plane(spatial)
        self.extent = max(float(np.linalg.norm(j.anchor - spatial.bodies[j.body].com)) for j in spatial.joints) or 1.0
        self.joints_of: dict[int, list[int]] = {}
        for k, joint in enumerate(spatial.joints):
            self.joints_of.setdefault(joint.body, []).append(k)
        self.link_of = self._group_bodies()
        self.moves = self._move_bodies()
        self.members: dict[int, list[Body]] = {}
        for body, link in zip(spatial.bodies, self.link_of, strict=True):
            self.members.setdefault(link, []).append(body)
        self.links = [link for link in self.members if link != WORLD]
        self.names = {WORLD: "ground"}
        for link in self.links:
            self.names[link] = make_name(spatial.bodies[link].name, self.names.values())
        self.frames = {link: self._find_frame(link) for link in self.members}
        self.points: dict[int, dict[str, complex]] = {link: {} for link in self.members}
        self.joint_names: dict[int, str] = {}
        self.locked: set[int] = set()

    def _group_bodies(self) -> list[int]:
        """Return the link of every body: bodies that are fixed or welded to each other are one link."""
        link_of = list(range(len(self.spatial.bodies)))
        fixed = [(body.parent, k) for k, body in enumerate(self.spatial.bodies) if k != WORLD and k not in self.joints_of]
        for a, b in (*fixed, *self.spatial.welds):  # merge the two links into the one with the smaller index
            new, old = sorted((link_of[a], link_of[b]))
            link_of = [new if link == old else link for link in link_of]
        return link_of

    def _move_bodies(self) -> list[Move]:
        """Return the planar displacement of every body from the file's configuration to the start, at which welds must hold."""
        moves, bodies = [Move()], self.spatial.bodies
        for k, body in enumerate(bodies[1:], 1):
            move = moves[body.parent]
            for joint in self._list_joints(k):
                move = move.follow(joint, self.plane.project(joint.axis), self.plane.project(joint.anchor), self.sign(joint))
            moves.append(move)
        for a, b in self.spatial.welds:
            shift = abs(moves[a].shift - moves[b].shift)
            if shift > OPEN * self.extent or abs(moves[a].angle - moves[b].angle) > OPEN:
                raise self.refuse(f"weld of {bodies[a].name} and {bodies[b].name}", "does not hold at the start")
        return moves

    def _list_joints(self, body: int) -> list[Joint]:
        """Return the joints that move a body relative to its parent, in order."""
        return [self.spatial.joints[k] for k in self.joints_of.get(body, [])]

    def sign(self, joint: Joint) -> float:
        """Return 1 if a hinge's axis has the direction of the plane's normal, -1 if it has the opposite direction."""
        return float(np.sign(joint.axis @ self.plane.normal))

    # links

    def _find_frame(self, link: int) -> tuple[complex, float]:
        """Return origin and angle [rad] of a link's frame: the angle of the first axis of its body that lies in the plane, or 0."""
        if link == WORLD:
            return 0j, 0.0
        body = self.spatial.bodies[link]
        in_plane = [self.plane.project(axis) for axis in body.turn.T if abs(axis @ self.plane.normal) < FLAT]
        return self.plane.project(body.origin), phase(in_plane[0]) if in_plane else 0.0

    def to_link(self, link: int, place: Array) -> complex:
        """Return the point `place` (3,) of the world, in the file's configuration, as x + i y in the frame of a link."""
        origin, angle = self.frames[link]
        return (self.plane.project(place) - origin) * rect(1.0, -angle)

    def to_plane(self, link: int, local: complex) -> complex:
        """Return the position in the plane, at the file's configuration, of a point given in the frame of a link."""
        origin, angle = self.frames[link]
        return origin + rect(1.0, angle) * local

    def add_point(self, spot: Spot, is_new: bool = False) -> str:
        """Add a point to a link and return its name LINK.POINT.

        If the link has a point at the same place, that point's name is returned, unless `is_new` asks for a further point.
        """
        link = self.link_of[spot.body]
        place, points, owner = self.to_link(link, spot.place), self.points[link], self.names[link]
        for key, existing in points.items():
            if not is_new and abs(existing - place) <= SAME * max(1.0, self.extent):
                return f"{owner}.{key}"
        wanted = spot.name
        # the link's name is written before the point's name anyway; `fromkeys` leaves out a repetition
        for prefix in dict.fromkeys([self.spatial.bodies[spot.body].name, owner]):
            wanted = wanted.removeprefix(f"{prefix}.")
        key = make_name(wanted, points)
        points[key] = place
        return f"{owner}.{key}"

    def _write_link(self, link: int) -> Table:
        """Return the table of a link in the linkage file: points, bars, and mass, centre of mass and inertia of all its bodies.

        The inertia includes the armatures (rotor inertias of motors) of the hinges that move the link.
        """
        bodies, normal, points = self.members[link], self.plane.normal, self.points[link]
        mass = float(sum(b.mass for b in bodies))
        if not mass > 0:
            raise self.refuse(f"body {bodies[0].name}", "has no mass, which every link of a linkage needs")
        centres = [self.to_link(link, b.com) for b in bodies]
        com = centres[0]  # exactly, without the rounding of a mean, if there is one body
        if len(bodies) > 1:
            com = sum(b.mass * centre for b, centre in zip(bodies, centres, strict=True)) / mass
        inertia = 0.0
        for body, centre in zip(bodies, centres, strict=True):  # parallel axis theorem
            inertia += float(normal @ body.inertia @ normal) + body.mass * abs(centre - com) ** 2
        inertia += sum(self._check_armature(j) for j in self.spatial.joints if self.link_of[j.body] == link)
        if not inertia > 0:
            raise self.refuse(f"body {bodies[0].name}", "has no moment of inertia about the plane's normal")
        table: Table = {"points": {key: pair(x) for key, x in points.items()}}
        # bars join the points in order; a point at the same place as the one before gets none
        names = list(points)
        ends = names[:1] + [b for a, b in pairwise(names) if abs(points[b] - points[a]) > SAME]
        if len(ends) > 1:
            table["bars"] = [[a, b] for a, b in pairwise(ends)]
        return table | {"mass": mass, "com": pair(com), "inertia": inertia}

    def _check_armature(self, joint: Joint) -> float:
        """Return a joint's armature [kg m^2], which is added to the moment of inertia of the link that the joint moves.

        An armature between two moving links resists their relative motion, so it cannot be added to the inertia of one link.
        """
        parent, joints = self.spatial.bodies[joint.body].parent, self.joints_of[joint.body]
        is_hinge_on_ground = joint.kind == "hinge" and self.link_of[parent] == WORLD and len(joints) == 1
        if joint.armature and not is_hinge_on_ground:
            raise self.refuse(f"joint {joint.name}", "only the armature of a hinge on the ground can be added to a link")
        return joint.armature

    # joints

    def _write_joints(self) -> dict[str, Table]:
        """Return the linkage file's tables of joints and closures, by name; also fill `joint_names` and `locked`."""
        tables: dict[str, Table] = {}
        for k in range(len(self.spatial.bodies)):
            self._add_joint(k, tables)
        for name, a, b in self.spatial.closures:
            if self.link_of[a.body] == self.link_of[b.body]:
                self.remarks.append(f"closure {name}, whose bodies are one link")
                continue
            self._check_closure(name, a, b)
            tables[make_name(name, tables)] = {"type": "revolute", "at": [self.add_point(a), self.add_point(b)]}
        return tables

    def _add_joint(self, k: int, tables: dict[str, Table]) -> None:
        """Add to `tables` the table of the joint between body k and its parent.

        No joint is needed if a weld makes both bodies one link (the joints are then `locked`), or if body k is free in the plane.
        """
        body, joints = self.spatial.bodies[k], self._list_joints(k)
        if joints and self.link_of[body.parent] == self.link_of[k]:
            self.remarks += [f"joint {joint.name}, which a weld holds" for joint in joints]
            self.locked |= {*self.joints_of[k]}
            return
        kinds = [joint.kind for joint in joints]
        if kinds == ["slide", "slide", "hinge"] and np.linalg.norm(np.cross(joints[0].axis, joints[1].axis)) > FLAT:
            return  # two crossed slides and a hinge: the body is free in the plane and needs no joint
        if len(joints) > 1:
            reason = f"has the joints {' and '.join(kinds)}, which a linkage can have only with a link between them"
            raise self.refuse(f"body {body.name}", reason)
        for joint in joints:  # one, or none if the body is fixed to its parent
            name = make_name(joint.name, tables)
            self.joint_names[self.joints_of[k][0]] = name
            ends = [self.add_point(Spot(name, end, joint.anchor)) for end in (body.parent, k)]  # the joint's point on both
            if joint.kind == "hinge":
                tables[name] = {"type": "revolute", "at": ends}
            else:  # the parent is the guide, body k the block: the angle of the slide's axis in the frame of each of their links
                theta = phase(self.plane.project(joint.axis))
                guide, block = (theta - self.frames[self.link_of[end]][1] for end in (body.parent, k))
                tables[name] = {"type": "prismatic", "guide": ends[0], "block": ends[1], "angle": guide, "block_angle": block}

    def _check_closure(self, name: str, a: Spot, b: Spot) -> None:
        """Add remarks if a closure is open, or is opening, at the start; refuse a closure that can never close."""
        if abs((a.place - b.place) @ self.plane.normal) > FLAT * self.extent:
            raise self.refuse(f"closure {name}", "its points lie in different planes and can never meet")
        move_a, move_b = self.moves[a.body], self.moves[b.body]
        at_a, at_b = self.plane.project(a.place), self.plane.project(b.place)
        gap = abs(move_a.place(at_a) - move_b.place(at_b))
        if gap > OPEN * self.extent:
            self.remarks.append(f"closure {name} was open by {gap:.3g} m at the start; the linkage is assembled with it closed")
        speed = abs(move_a.velocity(at_a) - move_b.velocity(at_b))
        if speed > OPEN * self.extent:
            remark = f"closure {name} was opening at {speed:.3g} m/s at the start; the linkage has speeds that keep it closed"
            self.remarks.append(remark)

    # forces

    def _write_forces(self) -> dict[str, Table]:
        """Return the linkage file's tables of all forces, by name; one force of the model file may become several tables."""
        tables: dict[str, Table] = {}
        for force in self.spatial.forces:
            for table in self._write_force(force):
                tables[make_name(force.name, tables)] = table
        return tables

    def _write_force(self, force: Force) -> list[Table]:
        """Return the tables of the linkage file that describe one force of the model file."""
        match force:
            case OnJoints(name, joints, law):
                slides = [k for k in joints if self.spatial.joints[k].kind == "slide" and k not in self.locked]
                if not slides:
                    return self._write_on_angle(name, joints, law)
                if [*joints.values()] != [1.0]:  # anything but one slide alone, with the weight 1
                    raise self.refuse(name, "a sum of joints that contains a slide")
                joint = self.joint_names.get(slides[0])  # None for a slide of a body that is free in the plane
                if law.c > 0 and not (law.k or law.bias) and joint is not None:
                    return [{"type": "joint_damping", "joint": joint, "c": law.c}]
                # a spring, a constant force, or a damper on a body free in the plane
                return self._write_on_slide(slides[0], law)
            case Between(name, a, b, law):
                if law.bias and not law.k:
                    raise self.refuse(name, "a constant tension; a linkage has no such force")
                if abs((a.place - b.place) @ self.plane.normal) > FLAT * self.extent:
                    raise self.refuse(name, "its ends lie in different planes")
                rest = law.rest + (law.bias / law.k if law.k else 0.0)  # bias - k (x - rest) = -k (x - rest - bias / k)
                ends = {"type": "spring_damper", "between": [self.add_point(a), self.add_point(b)]}
                return [ends | {"k": law.k, "c": law.c, "rest": rest}]
            case Push():
                return self._write_push(force)

    def _write_on_angle(self, name: str, joints: dict[int, float], law: LinearLaw) -> list[Table]:
        """Return tables of the linkage file for a force law on a weighted sum of hinge angles; none if welds lock all hinges."""
        if self.locked.issuperset(joints):
            return []
        a, b, sign = self._find_angle(name, {k: weight for k, weight in joints.items() if weight and k not in self.locked})
        tables: list[Table] = []
        joint = self.joint_names.get(next(iter(joints))) if len(joints) == 1 else None  # name of the only hinge; None for a sum
        if law.c > 0 and not law.k and joint is not None:
            tables.append({"type": "joint_damping", "joint": joint, "c": law.c})
        elif law.k or law.c:
            at_refs = sum(weight * self.spatial.joints[k].ref for k, weight in joints.items())  # sum in the file's configuration
            links = [self.names[a], self.names[b]]
            # the angle of frame b relative to frame a, when the sum of hinges has the value law.rest
            (_, angle_a), (_, angle_b) = self.frames[a], self.frames[b]
            rest = angle_b - angle_a + sign * (law.rest - at_refs)
            tables.append({"type": "rotational_spring_damper", "links": links, "k": law.k, "c": law.c, "rest": rest})
        if law.bias or not tables:  # a motor without torque becomes a torque 0, so that the linkage file has a force of this name
            # the torque acts on b if the sum grows with theta_b, so that the torque's value has the sign of the motor's control
            link, reaction = (b, a) if sign > 0 else (a, b)
            value = law.bias
            if link == WORLD:
                link, reaction, value = reaction, link, -value
            tables.append({"type": "torque", "link": self.names[link], "reaction": self.names[reaction], "value": value})
        return tables

    def _find_angle(self, name: str, wanted: dict[int, float]) -> tuple[int, int, float]:
        """Return links a, b and a sign: sign * (theta_b - theta_a) is, up to a constant, the weighted sum of hinge angles.

        `wanted` maps a hinge to the weight of its angle in the sum on which the force `name` acts.
        """
        opposite = {k: -weight for k, weight in wanted.items()}
        pairs = [*permutations(self.names, 2)]
        if len(wanted) == 1:  # prefer the two links of the hinge to links that slide on them
            body = self.spatial.joints[next(iter(wanted))].body
            pairs.insert(0, (self.link_of[self.spatial.bodies[body].parent], self.link_of[body]))
        for a, b in pairs:
            turn = self._relative_angle(a, b)
            if turn in (wanted, opposite):
                return a, b, 1.0 if turn == wanted else -1.0
        raise self.refuse(name, "a sum of joints that is not the angle between two links")

    def _relative_angle(self, a: int, b: int) -> dict[int, float]:
        """Return the angle of link b relative to link a as a weighted sum of hinge angles: hinge -> +1 or -1.

        A hinge on both paths, from the world to a and to b, turns both links, so its angle cancels in the relative angle.
        """
        weights: dict[int, float] = {}
        for body, sign in ((b, 1.0), (a, -1.0)):
            for k, turn in self.list_hinges(body):
                if k not in self.locked:
                    weights[k] = weights.get(k, 0.0) + sign * turn
        return {k: weight for k, weight in weights.items() if weight}

    def list_hinges(self, body: int) -> Iterator[tuple[int, float]]:
        """Yield the hinges between a body and the world, each with its sign.

        The sign is 1 if a growing joint coordinate turns the body from the x axis of the plane towards the y axis, else -1.
        """
        while body != WORLD:
            for k in self.joints_of.get(body, []):
                if self.spatial.joints[k].kind == "hinge":
                    yield k, self.sign(self.spatial.joints[k])
            body = self.spatial.bodies[body].parent

    def _write_on_slide(self, k: int, law: LinearLaw) -> list[Table]:
        """Return the tables of the linkage file for a force law along slide k, between the slide's body and its parent body.

        The force acts at the anchor of the body's last joint, which is the hinge of a body that is free in the plane.
        """
        joint = self.spatial.joints[k]
        parent, joints = self.spatial.bodies[joint.body].parent, self._list_joints(joint.body)
        along = self.plane.project(joint.axis)
        for other in joints[:-1]:  # the last joint of a free body is its hinge
            cosine = (along.conjugate() * self.plane.project(other.axis)).real  # dot product of the two directions
            if other is not joint and abs(cosine) > FLAT:
                raise self.refuse(f"joint {joint.name}", "a force along one of two slides that are not at right angles")
        origin, point = (self.add_point(Spot(joint.name, body, joints[-1].anchor)) for body in (parent, joint.body))
        # in the file's configuration both points coincide, while the joint coordinate is `ref`
        return self._write_along(point, origin, self.link_of[parent], along, law, law.rest - joint.ref)

    def _write_push(self, force: Push) -> list[Table]:
        """Return the tables of the linkage file for a force at a point, along a direction that is fixed in a body."""
        if abs(force.direction @ self.plane.normal) > FLAT:
            raise self.refuse(force.name, "a force out of the plane")
        link, law = self.link_of[force.frame], force.law
        point, origin = self.add_point(force.point), None if force.origin is None else self.add_point(force.origin)
        # hinge -> sign, for the body of the axis and the body of the point. If a hinge turns the first body, but not the second,
        # the first needs a torque against the moment of a force that depends on the motion.
        axis_hinges, point_hinges = self._relative_angle(WORLD, link), self._relative_angle(WORLD, self.link_of[force.point.body])
        turns_with = axis_hinges.items() <= point_hinges.items()
        if (law.k or law.c) and (origin is None or not turns_with):
            reason = "a servo along an axis of a moving body: a linkage has no force with its torque on that body"
            raise self.refuse(force.name, reason)
        return self._write_along(point, origin, link, self.plane.project(force.direction), law, law.rest)

    def _write_along(self, point: str, origin: str | None, link: int, along: complex, law: LinearLaw, rest: float) -> list[Table]:
        """Return the tables of the linkage file for a force law along an axis.

        A reaction on the ground is left out, because it moves nothing. A law whose numbers are all 0 becomes a constant force 0, so
        that the linkage file still has a force of this name.

        Args:
            point: LINK.POINT at which the force acts.
            origin: LINK.POINT at which the opposite force acts; None for a constant force without reaction.
            link: link in which the axis is fixed.
            along: direction of the axis in the plane, in the file's configuration.
            rest: rest length of the spring, measured from `origin` [m].
        """
        angle, tables = phase(along) - self.frames[link][1], list[Table]()  # angle of the axis in the frame of `link`
        if law.k or law.c:
            spring = {"type": "axis_spring_damper", "point": point, "origin": origin, "angle": angle}
            tables.append(spring | {"k": law.k, "c": law.c, "rest": rest})
        if law.bias or not tables:
            force, frame = rect(law.bias, angle), self.names[link]
            tables.append({"type": "force", "point": point, "value": pair(force), "frame": frame})
            if origin is not None and not origin.startswith("ground."):
                tables.append({"type": "force", "point": origin, "value": pair(-force), "frame": frame})
        return tables

    # the document

    def write_document(self, name: str, title: str) -> tuple[Table, tuple[str, ...]]:
        """Return the document of a planar linkage (the tables of its file), and phrases on parts that it leaves out or changes."""
        if not self.links:
            raise self.refuse("the model", "has no body that moves")
        for spot in self.spatial.spots:
            self.add_point(spot, is_new=True)
        joints, forces = self._write_joints(), self._write_forces()  # both add points to the links
        for link in self.links:
            self.points[link] = self.points[link] or {"O": 0j}  # every link needs a point
        links = {self.names[link]: self._write_link(link) for link in self.links}
        gravity = self.spatial.gravity
        across = float(gravity @ self.plane.normal)
        if abs(across) > FLAT * max(1.0, float(np.linalg.norm(gravity))):
            self.remarks.append(f"gravity normal to the plane ({across:.4g} m/s^2), which has no effect")
        places, angles = Table(), Table()  # position of a point and angle of every link before the joints are closed
        for link in self.links:
            point, local = next(iter(self.points[link].items()))
            places[f"{self.names[link]}.{point}"] = pair(self.moves[link].place(self.to_plane(link, local)))
            angles[self.names[link]] = self.frames[link][1] + self.moves[link].angle
        document: Table = {
            "format": FORMAT,
            "name": name,
            "title": title,
            "gravity": pair(self.plane.project(gravity)),
            "ground": {"points": {key: pair(x) for key, x in self.points[WORLD].items()}},
            "links": links,
            "joints": joints,
            "forces": forces,
            "assembly": {"angles": angles, "sketch": places},
            "scenarios": {SCENARIO: {"duration": DURATION, "forces": list(forces)}},
        }
        document["scenarios"][SCENARIO]["start"], crank, dof = self._find_start(document)
        if crank:
            document["crank"] = crank
        document["expect"] = {"dof": dof}
        document = {key: table for key, table in document.items() if table not in ({}, {"points": {}})}  # without empty tables
        return document, tuple(self.remarks)

    def _find_start(self, document: Table) -> tuple[Table, str | None, int]:
        """Return the table of the start, the name of the crank or None, and the number of degrees of freedom.

        The start prescribes as many coordinates as there are degrees of freedom: those that best determine all others. The crank
        is the first link with a pin on the ground whose angle the start prescribes.
        """
        mechanism = build_mechanism(document, SCENARIO, self.spatial.file, "")
        rows = Constraints(mechanism)  # rows(t, q, v).J is the constraint Jacobian
        q = close_joints(mechanism, rows, sketch(mechanism, document))
        free = null_space(rows(0.0, q, np.zeros_like(q)).J, mechanism.n)  # (n, dof): directions in which the joints stay closed
        v: list[float] = []  # velocities (n,) of the links, which follow from the speeds of the file's joints
        for link, built in zip(self.links, mechanism.links, strict=True):
            move = self.moves[link]
            v += [*pair(move.velocity(self.to_plane(link, complex(*built.com)))), move.omega]
        velocity, start, crank = np.array(v), Table(), None
        for chosen in choose_held(mechanism, q, free):
            values = [float(value(x, q)) for x in chosen.coordinates]  # a point has x and y, an angle or slide one coordinate
            speeds = [float(gradient(x, q) @ velocity) for x in chosen.coordinates]
            values_table, rates_table = chosen.tables
            start.setdefault(values_table, {})[chosen.name] = values if chosen.kind == "point" else values[0]
            if any(speeds):
                start.setdefault(rates_table, {})[chosen.name] = speeds if chosen.kind == "point" else speeds[0]
            if crank is None and chosen.kind == "angle" and turns_on_ground(mechanism, chosen.name):
                crank = chosen.name
        return start, crank, free.shape[1]


def find_plane(spatial: Spatial) -> Plane:
    """Return a plane that is normal to the axis of every hinge and parallel to every slide.

    Raises:
        ExchangeError: there is no plane in which all joints move.
    """
    hinges = [j for j in spatial.joints if j.kind == "hinge"]
    slides = [j for j in spatial.joints if j.kind == "slide"]
    if not spatial.joints:
        raise spatial.refuse("the model", "has no joints")
    first = (hinges or slides)[0]
    if hinges:
        normals = [first.axis]
    else:  # the plane is spanned by the first slide and another slide, gravity or an axis of the world
        normals = [np.cross(first.axis, x) for x in (*(j.axis for j in slides[1:]), spatial.gravity, *np.eye(3))]
    normal = next(x / np.linalg.norm(x) for x in normals if np.linalg.norm(x) > FLAT)
    for joint in hinges:
        if np.linalg.norm(np.cross(joint.axis, normal)) > FLAT:
            raise spatial.refuse(f"joint {joint.name}", f"turns about another axis than {first.name}: not planar")
    for joint in slides:
        if abs(joint.axis @ normal) > FLAT:
            raise spatial.refuse(f"joint {joint.name}", f"slides out of the plane that {first.name} moves in: not planar")
    # x and y are near the two axes of the world that are farthest from the normal; x is the projection of the first of these
    first_axis, second_axis = np.delete(np.eye(3), np.argmax(np.abs(normal)), axis=0)
    exact = np.where(np.abs(normal) < SAME, 0.0, normal)  # so that no rounding tilts x and y against axes of the world
    normal = exact / np.linalg.norm(exact)
    x = first_axis - (first_axis @ normal) * normal
    x /= np.linalg.norm(x)
    y = np.cross(normal, x)
    if not y @ second_axis > 0:
        y = -y
    return Plane(x, y, np.cross(x, y))


def make_name(wanted: str, taken: Collection[str]) -> str:
    """Return `wanted` as a name of letters, digits and underscores, with a number at its end if `taken` contains the name."""
    return make_unique(re.sub(r"[^A-Za-z0-9_]+", "_", wanted).strip("_") or "x", taken)


def turns_on_ground(mechanism: Mechanism, link: str) -> bool:
    """Tell whether a pin joins a link to the ground."""
    index = [x.name for x in mechanism.links].index(link)
    return any({pin.a.link, pin.b.link} == {GROUND, index} for pin in mechanism.pins)
