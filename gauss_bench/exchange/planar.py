"""From a mechanism in space to the document of a planar linkage: the plane, the links, their joints and forces, and a start.

All hinges are normal to the plane. Its axes follow the world's as nearly as possible: for a mechanism in the world's x-z plane they
are x and z, so that upright stays upright. Bodies that are welded to each other are one link; bodies that are welded to the world
are ground. A link's frame is that of its first body. Places and vectors of the plane are complex numbers x + i y.
"""

import re
from cmath import phase, rect
from collections.abc import Collection
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from gauss_bench.exchange.spatial import WORLD, Acting, Between, Joint, OnJoints, Push, Spatial, Spot, Straight
from gauss_bench.exchange.text import unique
from gauss_bench.linkage.build import build_mechanism
from gauss_bench.linkage.closure import close_joints, null_space
from gauss_bench.linkage.schema import FORMAT
from gauss_bench.linkage.sketch import sketch
from gauss_bench.linkage.start_coordinates import choose_held
from gauss_bench.mechanism.coordinates import gradient, value
from gauss_bench.mechanism.evaluate import Constraints
from gauss_bench.mechanism.model import GROUND, Mechanism, Revolute
from gauss_bench.terms import Array

FLAT = 1e-9  # largest sine of an angle out of the plane, or offset relative to the mechanism's size, that rounding explains
SAME = 1e-12  # [m] distance below which two points of a link are the same
OPEN = 1e-6  # gap relative to the mechanism's size from which a loop is reported as open
DURATION = 5.0  # [s] of the scenario: the files have no duration
SCENARIO = "as_imported"
Table = dict[str, Any]


@dataclass(frozen=True, eq=False)
class Plane:
    """A plane in space: two orthogonal axes (3,) and the normal (3,), all of length 1."""

    x: Array
    y: Array
    normal: Array

    def flat(self, place: Array) -> complex:
        """Project a vector (3,) into the plane, as x + i y."""
        return complex(place @ self.x, place @ self.y)


@dataclass(frozen=True)
class Move:
    """A rigid displacement of the plane with its rates: a rotation by `angle` [rad] about the origin, then a shift [m]."""

    angle: float = 0.0
    shift: complex = 0j
    omega: float = 0.0
    speed: complex = 0j

    def place(self, x: complex) -> complex:
        return rect(1.0, self.angle) * x + self.shift

    def velocity(self, x: complex) -> complex:
        """Return the velocity of the point that was at x before the displacement."""
        return self.speed + 1j * self.omega * self.place(x)

    def after(self, joint: Joint, axis: complex, anchor: complex, sign: float) -> "Move":
        """Return the move of a body that hangs by a joint on a body with this move.

        A hinge turns about the plane's normal, or against it if `sign` is -1.
        """
        by = joint.start - joint.ref
        if joint.kind == "slide":
            along = rect(1.0, self.angle) * axis
            return Move(self.angle, self.shift + by * along, self.omega, self.speed + joint.speed * along)
        angle, rate, there = self.angle + sign * by, sign * joint.speed, self.place(anchor)
        return Move(angle, there - rect(1.0, angle) * anchor, self.omega + rate, self.speed - 1j * rate * there)


def pair(x: complex) -> list[float]:
    return [float(x.real), float(x.imag)]


class Flattened:
    """A mechanism in space, projected into its plane.

    Attributes:
        group: body -> the first of the bodies that are rigidly connected with it; that index stands for their link.
        moves: body -> its displacement from the configuration of the file to the start.
        frames: link -> origin and angle [rad] of its frame in the configuration of the file.
        points: link -> name -> place in its frame [m].
        held: joints that a weld keeps from moving.
        told: sentences on parts that are left out or changed.
    """

    def __init__(self, spatial: Spatial):
        self.spatial, self.told, self.refuse = spatial, list(spatial.dropped), spatial.refuse
        self.plane = plane_of(spatial)
        self.extent = max(float(np.linalg.norm(j.anchor - spatial.bodies[j.body].com)) for j in spatial.joints) or 1.0
        self.joints_of: dict[int, list[int]] = {}
        for k, joint in enumerate(spatial.joints):
            self.joints_of.setdefault(joint.body, []).append(k)
        self.group = self._group_bodies()
        self.moves = self._move_bodies()
        members = {g: [k for k, x in enumerate(self.group) if x == g] for g in dict.fromkeys(self.group)}
        self.members = {g: [spatial.bodies[k] for k in x] for g, x in members.items()}
        self.index = [g for g in members if g != WORLD]  # the links, in the order of their first bodies
        self.names = {WORLD: "ground"}
        for g in self.index:
            self.names[g] = name_part(spatial.bodies[g].name, self.names.values())
        self.frames = {g: self._frame(g) for g in members}
        self.points: dict[int, dict[str, complex]] = {g: {} for g in members}
        self.held: set[int] = set()

    def _group_bodies(self) -> list[int]:
        """Merge bodies that are fixed or welded to each other; a group is named by its first body."""
        group = list(range(len(self.spatial.bodies)))
        fixed = [(b.parent, k) for k, b in enumerate(self.spatial.bodies) if k != WORLD and k not in self.joints_of]
        for a, b in (*fixed, *self.spatial.welds):
            old, new = sorted((group[a], group[b]), reverse=True)
            group = [new if g == old else g for g in group]
        return group

    def _move_bodies(self) -> list[Move]:
        """Compute the moves along the tree of joints.

        Raises:
            ExchangeError: a weld does not hold at the start.
        """
        moves, bodies = [Move()], self.spatial.bodies
        for k, body in enumerate(bodies[1:], 1):
            move = moves[body.parent]
            for joint in self._own(k):
                move = move.after(joint, self.plane.flat(joint.axis), self.plane.flat(joint.anchor), self.sign(joint))
            moves.append(move)
        for a, b in self.spatial.welds:
            shift = abs(moves[a].shift - moves[b].shift)
            if shift > OPEN * self.extent or abs(moves[a].angle - moves[b].angle) > OPEN:
                raise self.refuse(f"weld of {bodies[a].name} and {bodies[b].name}", "does not hold at the start")
        return moves

    def _own(self, body: int) -> list[Joint]:
        return [self.spatial.joints[k] for k in self.joints_of.get(body, [])]

    def sign(self, joint: Joint) -> float:
        """Return 1 if a hinge's axis points along the plane's normal, -1 if it points the other way."""
        return float(np.sign(joint.axis @ self.plane.normal))

    # the link of a group

    def _frame(self, g: int) -> tuple[complex, float]:
        """Return origin and angle of a link's frame; the first axis of its body that lies in the plane gives the angle."""
        body = self.spatial.bodies[g]
        flat = [self.plane.flat(axis) for axis in body.turn.T if abs(axis @ self.plane.normal) < FLAT]
        return (0j, 0.0) if g == WORLD else (self.plane.flat(body.origin), phase(flat[0]) if flat else 0.0)

    def local(self, g: int, place: Array) -> complex:
        """Return a place (3,) of the file's configuration in the frame of a link."""
        origin, angle = self.frames[g]
        return (self.plane.flat(place) - origin) * rect(1.0, -angle)

    def unfolded(self, g: int, local: complex) -> complex:
        """Return a place of a link's frame in the plane, at the file's configuration."""
        origin, angle = self.frames[g]
        return origin + rect(1.0, angle) * local

    def point(self, spot: Spot, name: str | None = None, anew: bool = False) -> str:
        """Return the name LINK.POINT of a point of a link.

        A point that is there already is used again, unless `anew` asks for a point with a name of its own.
        """
        g = self.group[spot.body]
        at, there, owner = self.local(g, spot.place), self.points[g], self.names[g]
        for key, x in there.items():
            if not anew and abs(x - at) <= SAME * max(1.0, self.extent):
                return f"{owner}.{key}"
        own = spot.name if name is None else name
        for prefix in {f"{self.spatial.bodies[spot.body].name}.", f"{owner}."}:
            own = own.removeprefix(prefix)
        key = name_part(own, there)
        there[key] = at
        return f"{owner}.{key}"

    def _link(self, g: int) -> Table:
        """Return the table of a link: its points, and mass, centre and inertia of all its bodies together.

        Raises:
            ExchangeError: the link has no mass or no moment of inertia.
        """
        bodies, n, points = self.members[g], self.plane.normal, self.points[g]
        mass = float(sum(b.mass for b in bodies))
        if not mass > 0:
            raise self.refuse(f"body {bodies[0].name}", "has no mass; every link of a linkage has one")
        places = [self.local(g, b.com) for b in bodies]
        com = places[0] if len(places) == 1 else sum(b.mass * x for b, x in zip(bodies, places, strict=True)) / mass
        # parallel axis theorem: each body's inertia about the normal, moved to the common centre of mass
        inertia = sum(float(n @ b.inertia @ n) + b.mass * abs(x - com) ** 2 for b, x in zip(bodies, places, strict=True))
        inertia += sum(self._armature(j) for j in self.spatial.joints if self.group[j.body] == g)
        if not inertia > 0:
            raise self.refuse(f"body {bodies[0].name}", "has no moment of inertia about the plane's normal")
        # bars join the points in order; a point in the same place as the one before adds none
        ends = [key for k, key in enumerate(points) if k == 0 or abs(points[key] - points[list(points)[k - 1]]) > SAME]
        bars = {"bars": [[a, b] for a, b in pairwise(ends)]} if len(ends) > 1 else {}
        return {"points": {key: pair(x) for key, x in points.items()}, **bars, "mass": mass, "com": pair(com), "inertia": inertia}

    def _armature(self, joint: Joint) -> float:
        """Return a joint's armature, which adds to the inertia of its link.

        Raises:
            ExchangeError: the joint is no hinge on the ground, so that the armature is not the inertia of one link.
        """
        grounded = self.group[self.spatial.bodies[joint.body].parent] == WORLD
        if joint.armature and not (joint.kind == "hinge" and grounded and len(self.joints_of[joint.body]) == 1):
            raise self.refuse(f"joint {joint.name}", "an armature other than that of a hinge on the ground is no part of a link")
        return joint.armature

    # joints

    def _joints(self) -> dict[str, Table]:
        """Return the tables of joints and closures; `self.joint_names` maps a joint of the file to its name there."""
        tables: dict[str, Table] = {}
        self.joint_names: dict[int, str] = {}
        for k, body in enumerate(self.spatial.bodies):
            own = self._own(k)
            if own and self.group[body.parent] == self.group[k]:
                self.told += [f"joint {j.name}, which a weld holds" for j in own]
                self.held |= {*self.joints_of[k]}
                continue
            kinds = [j.kind for j in own]
            if kinds == ["slide", "slide", "hinge"] and np.linalg.norm(np.cross(own[0].axis, own[1].axis)) > FLAT:
                continue  # two crossed slides and a hinge: the body is free in the plane and needs no joint
            if len(own) > 1:
                reason = f"has the joints {' and '.join(kinds)}, which a linkage has with a link between them alone"
                raise self.refuse(f"body {body.name}", reason)
            for joint in own:
                name = name_part(joint.name, tables)
                self.joint_names[self.joints_of[k][0]] = name
                at = [self.point(Spot(name, b, joint.anchor), name) for b in (body.parent, k)]
                tables[name] = {"type": "revolute", "at": at} if joint.kind == "hinge" else self._slide(joint, at)
        for name, a, b in self.spatial.closures:
            if self.group[a.body] == self.group[b.body]:
                self.told.append(f"closure {name}, whose bodies are one link")
                continue
            self._check_closure(name, a, b)
            tables[name_part(name, tables)] = {"type": "revolute", "at": [self.point(a), self.point(b)]}
        return tables

    def _slide(self, joint: Joint, ends: list[str]) -> Table:
        theta, parent = phase(self.plane.flat(joint.axis)), self.spatial.bodies[joint.body].parent
        guide, block = (theta - self.frames[self.group[k]][1] for k in (parent, joint.body))
        return {"type": "prismatic", "guide": ends[0], "block": ends[1], "angle": guide, "block_angle": block}

    def _check_closure(self, name: str, a: Spot, b: Spot) -> None:
        """Refuse a closure that can never close; report one that is open, or opening, at the start."""
        if abs((a.place - b.place) @ self.plane.normal) > FLAT * self.extent:
            raise self.refuse(f"closure {name}", "its points lie in different planes and can never meet")
        ends = [(self.moves[x.body], self.plane.flat(x.place)) for x in (a, b)]
        (place_a, speed_a), (place_b, speed_b) = [(move.place(x), move.velocity(x)) for move, x in ends]
        if (gap := abs(place_a - place_b)) > OPEN * self.extent:
            self.told.append(f"closure {name} was open by {gap:.3g} m at the start; the linkage is assembled with it closed")
        if (parting := abs(speed_a - speed_b)) > OPEN * self.extent:
            self.told.append(f"closure {name} was parting by {parting:.3g} m/s at the start; speeds are those that keep it closed")

    # forces

    def _forces(self) -> dict[str, Table]:
        tables: dict[str, Table] = {}
        for acting in self.spatial.acting:
            for table in self._force(acting):
                tables[name_part(acting.name, tables)] = table
        return tables

    def _force(self, acting: Acting) -> list[Table]:
        match acting:
            case OnJoints(name, joints, law):
                slides = [k for k in joints if self.spatial.joints[k].kind == "slide" and k not in self.held]
                if slides and [*joints.values()] == [1.0]:
                    return self._on_slide(slides[0], law)
                if slides:
                    raise self.refuse(name, "a sum with a slide in it")
                return self._on_angle(name, joints, law)
            case Between(name, a, b, law):
                if law.bias and not law.k:
                    raise self.refuse(name, "a constant tension, which a linkage has no force for")
                if abs((a.place - b.place) @ self.plane.normal) > FLAT * self.extent:
                    raise self.refuse(name, "its ends lie in different planes")
                rest = law.rest + (law.bias / law.k if law.k else 0.0)
                ends = {"type": "spring_damper", "between": [self.point(a), self.point(b)]}
                return [ends | {"k": law.k, "c": law.c, "rest": rest}]
            case Push():
                return self._push(acting)

    def _on_angle(self, name: str, joints: dict[int, float], law: Straight) -> list[Table]:
        """Return the tables of a law on a sum of hinges, which must be plus or minus the angle between two links.

        There are none if welds hold all of these hinges.
        """
        if self.held.issuperset(joints):
            return []
        wanted = {k: c for k, c in joints.items() if c and k not in self.held}
        signed = {sign: {k: sign * c for k, c in wanted.items()} for sign in (1.0, -1.0)}
        pairs = ((a, b, sign) for a in self.names for b in self.names for sign in signed if a != b)
        angle = next(((a, b, sign) for a, b, sign in pairs if self._turn(a, b) == signed[sign]), None)
        if angle is None:
            raise self.refuse(name, "a sum of joints that is no angle between two links")
        a, b, sign = angle
        tables: list[Table] = []
        single = self.joint_names.get(next(iter(joints))) if len(joints) == 1 else None
        if law.c > 0 and not law.k and single is not None:
            tables.append({"type": "joint_damping", "joint": single, "c": law.c})
        elif law.k or law.c:
            refs = sum(c * self.spatial.joints[k].ref for k, c in joints.items())
            rest = self.frames[b][1] - self.frames[a][1] + sign * (law.rest - refs)
            links = [self.names[a], self.names[b]]
            tables.append({"type": "rotational_spring_damper", "links": links, "k": law.k, "c": law.c, "rest": rest})
        if law.bias or not tables:
            link, reaction, turned = (b, a, sign) if b != WORLD else (a, b, -sign)
            ends = {"link": self.names[link], "reaction": self.names[reaction]}
            tables.append({"type": "torque", **ends, "value": turned * law.bias})
        return tables

    def _turn(self, a: int, b: int) -> dict[int, float]:
        """Return the angle of link b against link a as a sum of hinges: joint -> +-1.

        Both are followed to the world; hinges that both share cancel.
        """
        total: dict[int, float] = {}
        for body, sign in ((b, 1.0), (a, -1.0)):
            while body != WORLD:
                for k in self.joints_of.get(body, []):
                    joint = self.spatial.joints[k]
                    if joint.kind == "hinge" and k not in self.held:
                        total[k] = total.get(k, 0.0) + sign * self.sign(joint)
                body = self.spatial.bodies[body].parent
        return {k: x for k, x in total.items() if x}

    def _on_slide(self, k: int, law: Straight) -> list[Table]:
        """Return the tables of a law along a slide; for a body that is free in the plane, it acts at the point of its hinge."""
        joint = self.spatial.joints[k]
        parent, own, along = self.spatial.bodies[joint.body].parent, self._own(joint.body), self.plane.flat(joint.axis)
        for other in own[:-1]:
            if other is not joint and abs((along.conjugate() * self.plane.flat(other.axis)).real) > FLAT:
                raise self.refuse(f"joint {joint.name}", "a force along one of two slides that are not at right angles")
        near, far = (self.point(Spot(joint.name, b, own[-1].anchor)) for b in (parent, joint.body))
        return self._along(far, near, self.group[parent], along, law, law.rest - joint.ref)

    def _push(self, acting: Push) -> list[Table]:
        if abs(acting.direction @ self.plane.normal) > FLAT:
            raise self.refuse(acting.name, "a force out of the plane")
        g, law = self.group[acting.frame], acting.law
        point, origin = self.point(acting.point), None if acting.origin is None else self.point(acting.origin)
        turns_with = self._turn(WORLD, g).items() <= self._turn(WORLD, self.group[acting.point.body]).items()
        if (law.k or law.c) and (origin is None or not turns_with):
            raise self.refuse(acting.name, "a servo along an axis of a moving body, whose torque on that body is left out")
        return self._along(point, origin, g, self.plane.flat(acting.direction), law, law.rest)

    def _along(self, point: str, origin: str | None, g: int, along: complex, law: Straight, rest: float) -> list[Table]:
        """Return the tables of a law along an axis that is fixed in link g: a spring and damper, and a constant force.

        The opposite of the constant force acts at the origin; on the ground it moves nothing and is left out.
        """
        angle, tables = phase(along) - self.frames[g][1], list[Table]()
        if law.k or law.c:
            spring = {"type": "axis_spring_damper", "point": point, "origin": origin, "angle": angle}
            tables.append(spring | {"k": law.k, "c": law.c, "rest": rest})
        if law.bias or not tables:
            push, of = rect(law.bias, angle), self.names[g]
            tables.append({"type": "force", "point": point, "value": pair(push), "frame": of})
            if origin is not None and not origin.startswith("ground."):
                tables.append({"type": "force", "point": origin, "value": pair(-push), "frame": of})
        return tables

    # the document

    def document(self, name: str, title: str) -> tuple[Table, tuple[str, ...]]:
        """Return the document of a planar linkage, and sentences on the parts that are left out or changed.

        Raises:
            ExchangeError: an element is not planar, or a linkage cannot have it; the message gives the reason.
        """
        for spot in self.spatial.spots:
            self.point(spot, anew=True)
        joints, forces = self._joints(), self._forces()
        for g in self.index:
            self.points[g] = self.points[g] or {"O": 0j}
        links = {self.names[g]: self._link(g) for g in self.index}
        if not links:
            raise self.refuse("the model", "has no body that moves")
        gravity = self.spatial.gravity
        if abs(across := float(gravity @ self.plane.normal)) > FLAT * max(1.0, float(np.linalg.norm(gravity))):
            self.told.append(f"gravity across the plane ({across:.4g} m/s^2), which moves nothing in it")
        first = {g: next(iter(self.points[g].items())) for g in self.index}
        drawn = {f"{self.names[g]}.{key}": pair(self.moves[g].place(self.unfolded(g, x))) for g, (key, x) in first.items()}
        angles = {self.names[g]: self.frames[g][1] + self.moves[g].angle for g in self.index}
        document: Table = {
            "format": FORMAT,
            "name": name,
            "title": title,
            "gravity": pair(self.plane.flat(gravity)),
            "ground": {"points": {key: pair(x) for key, x in self.points[WORLD].items()}},
            "links": links,
            "joints": joints,
            "forces": forces,
            "assembly": {"angles": angles, "sketch": drawn},
            "scenarios": {SCENARIO: {"duration": DURATION, "forces": list(forces)}},
        }
        start, crank, dof = self._start(document)
        document["scenarios"][SCENARIO]["start"] = start
        if crank:
            document["crank"] = crank
        document["expect"] = {"dof": dof}
        return {key: x for key, x in document.items() if x not in ({}, {"points": {}})}, tuple(self.told)

    def _start(self, document: Table) -> tuple[Table, str | None, int]:
        """Return the table of the start, the crank and the number of degrees of freedom.

        The start prescribes as many coordinates as there are degrees of freedom: those that determine the rest most surely.
        """
        mechanism = build_mechanism(document, SCENARIO, self.spatial.file, "")
        rows = Constraints(mechanism)
        q = close_joints(mechanism, rows, sketch(mechanism, document))
        free = null_space(rows(0.0, q, np.zeros_like(q)).J, mechanism.n)
        velocity, start, crank = self._velocities(mechanism), Table(), None
        for held in choose_held(mechanism, q, free):
            values = [float(value(x, q)) for x in held.coordinates]
            speeds = [float(gradient(x, q) @ velocity) for x in held.coordinates]
            of_values, of_rates = held.tables
            start.setdefault(of_values, {})[held.name] = values if held.kind == "point" else values[0]
            if any(speeds):
                start.setdefault(of_rates, {})[held.name] = speeds if held.kind == "point" else speeds[0]
            if crank is None and held.kind == "angle" and turns_on_ground(mechanism, held.name):
                crank = held.name
        return start, crank, free.shape[1]

    def _velocities(self, mechanism: Mechanism) -> Array:
        """Return v (n,) of the links at the start, from the speeds of the file's joints."""
        v = []
        for g, link in zip(self.index, mechanism.links, strict=True):
            v += [*pair(self.moves[g].velocity(self.unfolded(g, complex(*link.com)))), self.moves[g].omega]
        return np.array(v)


def plane_of(spatial: Spatial) -> Plane:
    """Return the plane to which every hinge is normal and in which every slide lies.

    Raises:
        ExchangeError: the joints have no such plane.
    """
    hinges = [j for j in spatial.joints if j.kind == "hinge"]
    slides = [j for j in spatial.joints if j.kind == "slide"]
    if not spatial.joints:
        raise spatial.refuse("the model", "has no joints")
    first = (hinges or slides)[0]
    # Without hinges, the first slide and another slide, gravity or an axis of the world span the plane.
    others = [*(j.axis for j in slides[1:]), spatial.gravity, *np.eye(3)]
    normals = [first.axis] if hinges else [np.cross(first.axis, x) for x in others]
    normal = next(x / np.linalg.norm(x) for x in normals if np.linalg.norm(x) > FLAT)
    for joint in hinges:
        if np.linalg.norm(np.cross(joint.axis, normal)) > FLAT:
            raise spatial.refuse(f"joint {joint.name}", f"turns about another axis than {first.name}: not planar")
    for joint in slides:
        if abs(joint.axis @ normal) > FLAT:
            raise spatial.refuse(f"joint {joint.name}", f"slides out of the plane that {first.name} moves in: not planar")
    first_axis, second_axis = np.delete(np.eye(3), np.argmax(np.abs(normal)), axis=0)
    exact = np.where(np.abs(normal) < SAME, 0.0, normal)  # without rounding, axes of the world stay exact
    normal = exact / np.linalg.norm(exact)
    x = first_axis - (first_axis @ normal) * normal
    x /= np.linalg.norm(x)
    y = np.cross(normal, x)
    y = y if y @ second_axis > 0 else -y
    return Plane(x, y, np.cross(x, y))


def name_part(wanted: str, taken: Collection[str]) -> str:
    """Return a name that is not taken, of letters, digits and underscores."""
    return unique(re.sub(r"[^A-Za-z0-9_]+", "_", wanted).strip("_") or "x", taken)


def turns_on_ground(mechanism: Mechanism, link: str) -> bool:
    """Tell whether a pin joins a link to the ground."""
    index = [x.name for x in mechanism.links].index(link)
    return any({j.a.link, j.b.link} == {GROUND, index} for j in mechanism.joints if isinstance(j, Revolute))
