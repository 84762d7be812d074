"""From a mechanism in space to the document of a planar linkage: the plane, the links, their joints and forces, and a start.

The plane is the one that all hinges are normal to, with the world's axes as near to its own as may be: x and z of the world are x
and y of a linkage in that plane, so that upright stays upright. Bodies that are welded are one link; what is welded to the world is
ground. A link's frame is that of its first body.
"""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from gauss_bench.exchange.errors import ExchangeError
from gauss_bench.exchange.spatial import (
    WORLD,
    Acting,
    Between,
    Joint,
    OnJoint,
    OnSum,
    Push,
    Spatial,
    Spot,
    Straight,
)
from gauss_bench.linkage.build import build_mechanism
from gauss_bench.linkage.closure import close_joints
from gauss_bench.linkage.schema import FORMAT
from gauss_bench.linkage.sketch import sketch
from gauss_bench.linkage.surest import HELD, candidates, null_space, surest
from gauss_bench.mechanism.constraints import Constraints
from gauss_bench.mechanism.coordinates import gradient, value
from gauss_bench.mechanism.model import GROUND, Mechanism, Prismatic
from gauss_bench.terms import Array

FLAT = 1e-9  # sine of an angle out of the plane, and offset across it in lengths of the mechanism: what rounding explains
SAME = 1e-12  # [m] two points of a link that are one
OPEN = 1e-6  # in lengths of the mechanism: from where it is said that a loop was open
DURATION = 5.0  # [s] of the scenario: files say nothing of it
SCENARIO = "as_imported"


@dataclass(frozen=True, eq=False)
class Plane:
    """Axes (3,) in the plane, and its normal."""

    x: Array
    y: Array
    normal: Array

    def flat(self, place: Array) -> Array:
        """(2,) of a vector (3,)."""
        return np.array([place @ self.x, place @ self.y])


@dataclass(frozen=True, eq=False)
class Move:
    """A displacement of the plane, turning by `angle` [rad] about the origin and then shifting, with its rates."""

    angle: float
    shift: Array
    omega: float
    speed: Array

    def place(self, x: Array) -> Array:
        return rotate(x, self.angle) + self.shift

    def velocity(self, x: Array) -> Array:
        """Of the point that was at x (2,), where it is now."""
        at = self.place(x)
        return self.speed + self.omega * np.array([-at[1], at[0]])


def rotate(x: Array, angle: float) -> Array:
    c, s = np.cos(angle), np.sin(angle)
    return np.array([c * x[0] - s * x[1], s * x[0] + c * x[1]])


def planar_document(spatial: Spatial, name: str, title: str) -> tuple[dict[str, Any], tuple[str, ...]]:
    """The document of a planar linkage, and what was left out or changed, in sentences.

    Raises:
        ExchangeError: an element that is not planar, or not expressible; with the reason.
    """
    return Flattened(spatial).document(name, title)


class Flattened:
    """A mechanism on its way into the plane."""

    def __init__(self, spatial: Spatial):
        self.spatial, self.told = spatial, list(spatial.dropped)
        self.plane = plane_of(spatial)
        self.extent = max(float(np.linalg.norm(j.anchor - spatial.bodies[j.body].com)) for j in spatial.joints) or 1.0
        self.joints_of: dict[int, list[int]] = {}
        for k, joint in enumerate(spatial.joints):
            self.joints_of.setdefault(joint.body, []).append(k)
        self.group = self._groups()
        self.moves = self._moves()
        self._check_welds()
        self.members: dict[int, list[int]] = {}
        for k, g in enumerate(self.group):
            self.members.setdefault(g, []).append(k)
        self.index = [g for g in self.members if g != WORLD]  # groups that are links, in order of their first bodies
        taken = name_parts([spatial.bodies[g].name for g in self.index], ["ground"])
        self.names = dict(zip(self.index, taken, strict=True)) | {WORLD: "ground"}
        self.points: dict[int, dict[str, Array]] = {g: {} for g in self.members}

    def refuse(self, element: str, reason: str) -> ExchangeError:
        return ExchangeError(f"{self.spatial.file}: {element}: {reason}")

    def _groups(self) -> list[int]:
        """Of every body the first of those that move as one with it."""
        group = list(range(len(self.spatial.bodies)))
        fixed = [(b.parent, k) for k, b in enumerate(self.spatial.bodies) if k != WORLD and k not in self.joints_of]
        for a, b in (*fixed, *self.spatial.welds):
            old, new = sorted((group[a], group[b]), reverse=True)
            group = [new if g == old else g for g in group]
        return group

    def _moves(self) -> list[Move]:
        """Of every body, from the configuration of the file to the start, along the tree of joints."""
        moves = [Move(0.0, np.zeros(2), 0.0, np.zeros(2))]
        for k, body in enumerate(self.spatial.bodies[1:], 1):
            move = moves[body.parent]
            for at in self.joints_of.get(k, []):
                joint = self.spatial.joints[at]
                by, anchor = joint.start - joint.ref, self.plane.flat(joint.anchor)
                if joint.kind == "slide":
                    along = rotate(self.plane.flat(joint.axis), move.angle)
                    move = Move(move.angle, move.shift + by * along, move.omega, move.speed + joint.speed * along)
                else:
                    turn, rate, there = self.sign(joint) * by, self.sign(joint) * joint.speed, move.place(anchor)
                    angle, speed = move.angle + turn, move.speed - rate * np.array([-there[1], there[0]])
                    move = Move(angle, there - rotate(anchor, angle), move.omega + rate, speed)
            moves.append(move)
        return moves

    def sign(self, joint: Joint) -> float:
        """The sign of a hinge: 1 where it turns about the plane's normal, -1 the other way."""
        return float(np.sign(joint.axis @ self.plane.normal))

    def _check_welds(self) -> None:
        for a, b in self.spatial.welds:
            shift = np.abs(self.moves[a].shift - self.moves[b].shift).max()
            if shift > OPEN * self.extent or abs(self.moves[a].angle - self.moves[b].angle) > OPEN:
                names = self.spatial.bodies[a].name, self.spatial.bodies[b].name
                raise self.refuse(f"weld of {names[0]} and {names[1]}", "does not hold at the start")

    # the link of a group

    def frame(self, g: int) -> tuple[Array, float]:
        """Origin (2,) and angle of a group's frame, where the file has it."""
        if g == WORLD:
            return np.zeros(2), 0.0
        body = self.spatial.bodies[g]
        flat = [axis for axis in body.turn.T if abs(axis @ self.plane.normal) < FLAT]
        if not flat:
            return self.plane.flat(body.origin), 0.0
        along = self.plane.flat(flat[0])
        return self.plane.flat(body.origin), float(np.arctan2(along[1], along[0]))

    def local(self, g: int, place: Array) -> Array:
        """(2,) of a place (3,) in a group's frame."""
        origin, angle = self.frame(g)
        return rotate(self.plane.flat(place) - origin, -angle)

    def angle(self, g: int) -> float:
        """Of a group's link at the start [rad], unwrapped along the tree."""
        return self.frame(g)[1] + self.moves[g].angle

    def point(self, spot: Spot, name: str | None = None, anew: bool = False) -> str:
        """The reference LINK.POINT of a point, which is made where there is none in that place, or anew with a name of its own."""
        g = self.group[spot.body]
        at, there, owner = self.local(g, spot.place), self.points[g], self.names[g]
        for key, x in there.items():
            if not anew and np.abs(x - at).max() <= SAME * max(1.0, self.extent):
                return f"{owner}.{key}"
        own = spot.name if name is None else name
        for prefix in {f"{self.spatial.bodies[spot.body].name}.", f"{owner}."}:
            own = own.removeprefix(prefix)
        (key,) = name_parts([own], list(there))
        there[key] = at
        return f"{owner}.{key}"

    def mass(self, g: int) -> tuple[float, Array, float]:
        """Mass, centre of mass (2,) in the group's frame, and inertia about it, of all its bodies together."""
        bodies = [self.spatial.bodies[k] for k in self.members[g]]
        n = self.plane.normal
        total = sum(b.mass for b in bodies)
        if not total > 0:
            raise self.refuse(f"body {bodies[0].name}", "has no mass; every link of a linkage has one")
        places = [self.local(g, b.com) for b in bodies]
        if len(bodies) == 1:
            com, inertia = places[0], float(n @ bodies[0].inertia @ n)
        else:
            com = sum((b.mass * x for b, x in zip(bodies, places, strict=True)), np.zeros(2)) / total
            own = ((float(n @ b.inertia @ n), b.mass * float((x - com) @ (x - com))) for b, x in zip(bodies, places, strict=True))
            inertia = sum(i + j for i, j in own)
        for k in self.members[g]:
            inertia += sum(self._armature(self.spatial.joints[j]) for j in self.joints_of.get(k, []))
        if not inertia > 0:
            raise self.refuse(f"body {bodies[0].name}", "has no moment of inertia about the plane's normal")
        return float(total), com, inertia

    def _armature(self, joint: Joint) -> float:
        """The inertia of a joint itself, which adds to that of its link.

        Raises:
            ExchangeError: it is not the link's alone.
        """
        grounded = self.group[self.spatial.bodies[joint.body].parent] == WORLD
        if joint.armature and not (joint.kind == "hinge" and grounded and len(self.joints_of[joint.body]) == 1):
            raise self.refuse(f"joint {joint.name}", "an armature other than that of a hinge on the ground is no part of a link")
        return joint.armature

    # joints

    def _joints(self) -> dict[str, dict[str, Any]]:
        """The tables of joints and closures; the name of each joint of the file goes to `self.joint_names`."""
        tables: dict[str, dict[str, Any]] = {}
        self.joint_names: dict[int, str] = {}
        self.held: set[int] = set()
        for k, body in enumerate(self.spatial.bodies):
            own = [self.spatial.joints[j] for j in self.joints_of.get(k, [])]
            parent = self.group[body.parent]
            if parent == self.group[k] and own:
                self.told += [f"joint {j.name}, which a weld holds" for j in own]
                self.held |= {*self.joints_of[k]}
                continue
            if len(own) > 1 and [j.kind for j in own] == ["slide", "slide", "hinge"] and self._cross(own[0], own[1]):
                continue  # free in the plane
            if len(own) > 1:
                kinds = " and ".join(j.kind for j in own)
                raise self.refuse(
                    f"body {body.name}", f"has the joints {kinds}, which a linkage has with a link between them alone"
                )
            for joint in own:
                (name,) = name_parts([joint.name], list(tables))
                self.joint_names[self.joints_of[k][0]] = name
                near, far = Spot(name, body.parent, joint.anchor), Spot(name, k, joint.anchor)
                ends = [self.point(near, name), self.point(far, name)]
                tables[name] = {"type": "revolute", "at": ends} if joint.kind == "hinge" else self._slide(joint, ends)
        for name, a, b in self.spatial.closures:
            if self.group[a.body] == self.group[b.body]:
                self.told.append(f"closure {name}, whose bodies are one link")
                continue
            self._check_closure(name, a, b)
            (key,) = name_parts([name], list(tables))
            tables[key] = {"type": "revolute", "at": [self.point(a), self.point(b)]}
        return tables

    def _cross(self, a: Joint, b: Joint) -> bool:
        return bool(np.linalg.norm(np.cross(a.axis, b.axis)) > FLAT)

    def _slide(self, joint: Joint, ends: list[str]) -> dict[str, Any]:
        along = self.plane.flat(joint.axis)
        theta = float(np.arctan2(along[1], along[0]))
        angles = (theta - self.frame(g)[1] for g in (self.group[self.spatial.bodies[joint.body].parent], self.group[joint.body]))
        return {"type": "prismatic", "guide": ends[0], "block": ends[1], "angle": next(angles), "block_angle": next(angles)}

    def _check_closure(self, name: str, a: Spot, b: Spot) -> None:
        if abs((a.place - b.place) @ self.plane.normal) > FLAT * self.extent:
            raise self.refuse(f"closure {name}", "its points lie in different planes and can never meet")
        gap = float(np.linalg.norm(self.at_start(a) - self.at_start(b)))
        if gap > OPEN * self.extent:
            self.told.append(f"closure {name} was open by {gap:.3g} m at the start; the linkage is assembled with it closed")
        ends = (self.moves[x.body].velocity(self.plane.flat(x.place)) for x in (a, b))
        parting = float(np.linalg.norm(next(ends) - next(ends)))
        if parting > OPEN * self.extent:
            self.told.append(f"closure {name} was parting by {parting:.3g} m/s at the start; speeds are those that keep it closed")

    def at_start(self, spot: Spot) -> Array:
        return self.moves[spot.body].place(self.plane.flat(spot.place))

    # forces

    def _forces(self) -> dict[str, dict[str, Any]]:
        tables: dict[str, dict[str, Any]] = {}
        for acting in self.spatial.acting:
            for table in self._force(acting):
                (name,) = name_parts([acting.name], list(tables))
                tables[name] = table
        return tables

    def _force(self, acting: Acting) -> list[dict[str, Any]]:
        match acting:
            case OnJoint(joint=k):
                if k in self.held:
                    return []
                joint = self.spatial.joints[k]
                if joint.kind == "hinge":
                    return self._on_angle(acting.name, {k: 1.0}, acting.law)
                return self._on_slide(joint, k, acting.law)
            case OnSum():
                return self._on_angle(acting.name, acting.joints, acting.law)
            case Between():
                return [self._between(acting)]
            case Push():
                return self._push(acting)

    def _on_angle(self, name: str, joints: dict[int, float], law: Straight) -> list[dict[str, Any]]:
        """A law on a sum of hinges that is the angle of one link against another, or its negative."""
        wanted = {k: c for k, c in joints.items() if c and k not in self.held}
        if any(self.spatial.joints[k].kind != "hinge" for k in wanted):
            raise self.refuse(name, "a sum with a slide in it")
        groups = [WORLD, *self.index]
        pairs = ((a, b, sign) for a in groups for b in groups for sign in (1.0, -1.0) if a != b)
        angle = next((x for x in pairs if self._turn(x[0], x[1]) == {k: x[2] * c for k, c in wanted.items()}), None)
        if angle is None:
            raise self.refuse(name, "a sum of joints that is no angle between two links")
        a, b, sign = angle
        refs = sum(c * self.spatial.joints[k].ref for k, c in joints.items())
        here = self.frame(b)[1] - self.frame(a)[1]
        rest, links = here + sign * (law.rest - refs), [self.names[a], self.names[b]]
        tables: list[dict[str, Any]] = []
        if law.k or law.c:
            single = next(iter(joints)) if len(joints) == 1 else None
            if not law.k and law.c > 0 and single in self.joint_names:
                tables.append({"type": "joint_damping", "joint": self.joint_names[single], "c": law.c})
            else:
                tables.append({"type": "rotational_spring_damper", "links": links, "k": law.k, "c": law.c, "rest": rest})
        if law.bias or not tables:
            link, reaction = (b, a) if b != WORLD else (a, b)
            turned = sign if b != WORLD else -sign
            tables.append(
                {"type": "torque", "link": self.names[link], "reaction": self.names[reaction], "value": turned * law.bias}
            )
        return tables

    def _turn(self, a: int, b: int) -> dict[int, float]:
        """The angle of group b against that of a as a sum of hinges: joint -> +-1."""
        total: dict[int, float] = {}
        for g, sign in ((b, 1.0), (a, -1.0)):
            body = g
            while body != WORLD:
                for k in self.joints_of.get(body, []):
                    joint = self.spatial.joints[k]
                    if joint.kind == "hinge" and k not in self.held:
                        total[k] = total.get(k, 0.0) + sign * self.sign(joint)
                body = self.spatial.bodies[body].parent
        return {k: x for k, x in total.items() if x}

    def _turns_with(self, a: int, b: int) -> bool:
        """Tell whether every hinge that turns group a turns b as well."""
        return self._turn(WORLD, a).items() <= self._turn(WORLD, b).items()

    def _on_slide(self, joint: Joint, k: int, law: Straight) -> list[dict[str, Any]]:
        """A law along a slide; of a body that is free in the plane, on the way of its hinge along that axis."""
        parent = self.spatial.bodies[joint.body].parent
        own = [self.spatial.joints[j] for j in self.joints_of[joint.body]]
        anchor = own[-1].anchor if len(own) > 1 else joint.anchor
        near, far = (self.point(Spot(joint.name, b, anchor)) for b in (parent, joint.body))
        along = self.plane.flat(joint.axis)
        if len(own) > 1 and abs(along @ self.plane.flat(own[1 - self.joints_of[joint.body].index(k)].axis)) > FLAT:
            raise self.refuse(f"joint {joint.name}", "a force along one of two slides that are not at right angles")
        angle = float(np.arctan2(along[1], along[0])) - self.frame(self.group[parent])[1]
        tables: list[dict[str, Any]] = []
        if law.k or law.c:
            spring = {"type": "axis_spring_damper", "point": far, "origin": near, "angle": angle}
            tables.append(spring | {"k": law.k, "c": law.c, "rest": law.rest - joint.ref})
        if law.bias or not tables:
            push = law.bias * np.array([np.cos(angle), np.sin(angle)])
            tables += self._pair(far, near, self.group[parent], push)
        return tables

    def _pair(self, point: str, origin: str | None, frame: int, value: Array) -> list[dict[str, Any]]:
        """A constant force (2,) in a group's frame at a point, and the opposite at the origin unless that is ground."""
        of = self.names[frame]
        tables = [{"type": "force", "point": point, "value": value.tolist(), "frame": of}]
        if origin is not None and not origin.startswith("ground."):
            tables.append({"type": "force", "point": origin, "value": (-value).tolist(), "frame": of})
        return tables

    def _between(self, acting: Between) -> dict[str, Any]:
        law = acting.law
        if law.bias and not law.k:
            raise self.refuse(acting.name, "a constant tension, which a linkage has no force for")
        if abs((acting.a.place - acting.b.place) @ self.plane.normal) > FLAT * self.extent:
            raise self.refuse(acting.name, "its ends lie in different planes")
        rest = law.rest + (law.bias / law.k if law.k else 0.0)
        return {
            "type": "spring_damper",
            "between": [self.point(acting.a), self.point(acting.b)],
            "k": law.k,
            "c": law.c,
            "rest": rest,
        }

    def _push(self, acting: Push) -> list[dict[str, Any]]:
        if abs(acting.direction @ self.plane.normal) > FLAT:
            raise self.refuse(acting.name, "a force out of the plane")
        g, law = self.group[acting.frame], acting.law
        along = self.plane.flat(acting.direction)
        angle = float(np.arctan2(along[1], along[0])) - self.frame(g)[1]
        point, origin = self.point(acting.point), None if acting.origin is None else self.point(acting.origin)
        tables: list[dict[str, Any]] = []
        if law.k or law.c:
            if origin is None or not self._turns_with(g, self.group[acting.point.body]):
                raise self.refuse(acting.name, "a servo along an axis of a moving body, whose torque on that body is left out")
            spring = {"type": "axis_spring_damper", "point": point, "origin": origin, "angle": angle}
            tables.append(spring | {"k": law.k, "c": law.c, "rest": law.rest})
        if law.bias or not tables:
            push = law.bias * np.array([np.cos(angle), np.sin(angle)])
            tables += self._pair(point, origin, g, push)
        return tables

    # the whole

    def document(self, name: str, title: str) -> tuple[dict[str, Any], tuple[str, ...]]:
        for spot in self.spatial.spots:
            self.point(spot, anew=True)
        joints, forces = self._joints(), self._forces()
        for g in self.index:
            if not self.points[g]:
                self.points[g]["O"] = np.zeros(2)
        links = {self.names[g]: self._link(g) for g in self.index}
        if not links:
            raise self.refuse("the model", "has no body that moves")
        gravity = self.spatial.gravity
        if abs(across := float(gravity @ self.plane.normal)) > FLAT * max(1.0, float(np.linalg.norm(gravity))):
            self.told.append(f"gravity across the plane ({across:.4g} m/s^2), which moves nothing in it")
        placed = {f"{self.names[g]}.{key}": x for g in self.index for key, x in list(self.points[g].items())[:1]}
        drawn = {reference: self._drawn(reference, x) for reference, x in placed.items()}
        document: dict[str, Any] = {
            "format": FORMAT,
            "name": name,
            "title": title,
            "gravity": self.plane.flat(gravity).tolist(),
            "ground": {"points": {key: x.tolist() for key, x in self.points[WORLD].items()}},
            "links": links,
            "joints": joints,
            "forces": forces,
            "assembly": {"angles": {self.names[g]: self.angle(g) for g in self.index}, "sketch": drawn},
            "scenarios": {SCENARIO: {"duration": DURATION, "forces": list(forces)}},
        }
        start, crank, dof = self._start(document)
        document["scenarios"][SCENARIO]["start"] = start
        if crank:
            document["crank"] = crank
        document["expect"] = {"dof": dof}
        return {key: x for key, x in document.items() if x != {} and x != {"points": {}}}, tuple(self.told)

    def _link(self, g: int) -> dict[str, Any]:
        mass, com, inertia = self.mass(g)
        points = self.points[g]
        ends = [key for k, key in enumerate(points) if k == 0 or np.abs(points[key] - points[list(points)[k - 1]]).max() > SAME]
        bars = {"bars": [[a, b] for a, b in pairwise(ends)]} if len(ends) > 1 else {}
        places = {key: x.tolist() for key, x in points.items()}
        return {"points": places, **bars, "mass": mass, "com": com.tolist(), "inertia": inertia}

    def _drawn(self, reference: str, local: Array) -> list[float]:
        """The place of a link's point at the start."""
        g = next(g for g in self.index if reference.startswith(f"{self.names[g]}."))
        origin, angle = self.frame(g)
        place: list[float] = self.moves[g].place(origin + rotate(local, angle)).tolist()
        return place

    def _start(self, document: dict[str, Any]) -> tuple[dict[str, Any], str | None, int]:
        """The table of the start, the crank, and the degrees of freedom: so many coordinates are held, the surest ones."""
        mechanism = build_mechanism(document, SCENARIO, self.spatial.file, "")
        rows = Constraints(mechanism)
        q = close_joints(mechanism, rows, sketch(mechanism, document))
        J = rows(0.0, q, np.zeros_like(q)).J
        free = null_space(J, mechanism.n)
        chosen = surest(candidates(mechanism, q), q, free)
        start: dict[str, Any] = {}
        velocity = self._velocities(mechanism)
        crank = None
        for kind, key, coordinates in chosen:
            values = [float(value(x, q)) for x in coordinates]
            speeds = [float(gradient(x, q) @ velocity) for x in coordinates]
            table, rates = HELD[kind]
            start.setdefault(table, {})[key] = values if kind == "point" else values[0]
            if any(speeds):
                start.setdefault(rates, {})[key] = speeds if kind == "point" else speeds[0]
            if crank is None and kind == "angle" and turns_on_ground(mechanism, key):
                crank = key
        return start, crank, free.shape[1]

    def _velocities(self, mechanism: Mechanism) -> Array:
        """v (n,) of the links at the start, as the joints of the file have it."""
        v = []
        for g, link in zip(self.index, mechanism.links, strict=True):
            origin, angle = self.frame(g)
            v += [*self.moves[g].velocity(origin + rotate(link.com, angle)), self.moves[g].omega]
        return np.array(v)


def plane_of(spatial: Spatial) -> Plane:
    """The plane that every hinge is normal to and every slide lies in.

    Raises:
        ExchangeError: there is none.
    """
    hinges = [j for j in spatial.joints if j.kind == "hinge"]
    slides = [j for j in spatial.joints if j.kind == "slide"]
    if not spatial.joints:
        raise ExchangeError(f"{spatial.file}: the model: has no joints")
    if hinges:
        normal, first = hinges[0].axis, hinges[0]
    else:
        others = [*(j.axis for j in slides[1:]), spatial.gravity, *np.eye(3)]
        crosses = (np.cross(slides[0].axis, x) for x in others)
        normal, first = next(x for x in crosses if np.linalg.norm(x) > FLAT), slides[0]
    normal = normal / np.linalg.norm(normal)
    for joint in hinges:
        if np.linalg.norm(np.cross(joint.axis, normal)) > FLAT:
            raise ExchangeError(f"{spatial.file}: joint {joint.name}: turns about another axis than {first.name}: not planar")
    for joint in slides:
        if abs(joint.axis @ normal) > FLAT:
            raise ExchangeError(
                f"{spatial.file}: joint {joint.name}: slides out of the plane that {first.name} moves in: not planar"
            )
    axes = np.eye(3)
    across = int(np.argmax(np.abs(normal)))
    first_axis, second_axis = (axes[k] for k in range(3) if k != across)
    exact = np.where(np.abs(normal) < SAME, 0.0, normal)
    normal = exact / np.linalg.norm(exact)
    x = first_axis - (first_axis @ normal) * normal
    x /= np.linalg.norm(x)
    y = np.cross(normal, x)
    y = y if y @ second_axis > 0 else -y
    return Plane(x, y, np.cross(x, y))


def name_parts(wanted: Sequence[str], taken: Sequence[str]) -> list[str]:
    """Names of letters, digits and underscores, each new."""
    names: list[str] = []
    for name in wanted:
        base = re.sub(r"[^A-Za-z0-9_]+", "_", name).strip("_") or "x"
        k, chosen = 1, base
        while chosen in taken or chosen in names:
            k += 1
            chosen = f"{base}_{k}"
        names.append(chosen)
    return names


def turns_on_ground(mechanism: Mechanism, link: str) -> bool:
    """Tell whether a pin joins a link to the ground."""
    index = [x.name for x in mechanism.links].index(link)
    pins = (j for j in mechanism.joints if not isinstance(j, Prismatic))
    return any({j.a.link, j.b.link} == {GROUND, index} for j in pins)
