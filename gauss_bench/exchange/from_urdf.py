"""URDF: a tree of links as a mechanism in space, with its loops closed where a user says so; what has no place there is refused.

The file's numbers are taken as they stand. Links without inertia are frames of the link they are fixed to. Closures are given as
LINK.FRAME=LINK.FRAME, where FRAME is a link fixed to LINK, a joint at LINK, or LINK itself.
"""

from collections.abc import Sequence
from pathlib import Path
from xml.etree.ElementTree import Element

import numpy as np

from gauss_bench.exchange.errors import ExchangeError
from gauss_bench.exchange.safe_xml import call_name
from gauss_bench.exchange.spatial import WORLD, Acting, Body, Joint, OnJoint, Spatial, Spot, Straight
from gauss_bench.terms import Array

GRAVITY = (0.0, 0.0, -9.81)  # [m/s^2]: a URDF has none of its own, and z points up
MOVING = {"revolute": "hinge", "continuous": "hinge", "prismatic": "slide", "fixed": ""}
IGNORED = ("visual", "collision", "gazebo", "transmission", "material", "sensor")


def from_urdf(root: Element, path: Path, close: Sequence[str] = ()) -> Spatial:
    """The mechanism of a document that has been inspected; its root link is the world.

    Raises:
        ExchangeError: an element that is faulty, or that a linkage cannot have; or a closure that names nothing.
    """
    return Robot(root, str(path)).spatial(close)


class Robot:
    """Reads a document with the root `robot`."""

    def __init__(self, root: Element, file: str):
        self.file, self.root = file, root
        for node in root.iter():
            if ":" in str(node.tag) or "{" in str(node.tag):
                raise self.refuse(call_name(node), "is no URDF; expand xacro first")
        self.links = self._table("link")
        self.joints = self._table("joint")
        self.parents: dict[str, str] = {}  # link -> the joint by which it hangs
        for name, joint in self.joints.items():
            child = self._end(joint, "child")
            self._end(joint, "parent")
            if child in self.parents:
                raise self.refuse(
                    call_name(joint), f"link {child!r} hangs on two joints; a URDF is a tree, and --close closes its loops"
                )
            self.parents[child] = name
        roots = [name for name in self.links if name not in self.parents]
        if len(roots) != 1:
            raise self.refuse("<robot>", f"has {len(roots)} links without a parent, not one")
        self.order = [roots[0]]
        for name in self.order:
            self.order += [child for child, joint in self.parents.items() if self._end(self.joints[joint], "parent") == name]
        if len(self.order) < len(self.links):
            raise self.refuse("<robot>", f"link {min({*self.links} - {*self.order})!r} hangs on itself")
        self.index = {name: k for k, name in enumerate(self.order)}

    def refuse(self, element: str, reason: str) -> ExchangeError:
        return ExchangeError(f"{self.file}: {element}: {reason}")

    def _table(self, tag: str) -> dict[str, Element]:
        elements: dict[str, Element] = {}
        for node in self.root.findall(tag):
            name = node.get("name")
            if not name or name in elements:
                raise self.refuse(call_name(node), "needs a name of its own")
            elements[name] = node
        return elements

    def _end(self, joint: Element, which: str) -> str:
        node = joint.find(which)
        link = "" if node is None else node.get("link", "")
        if link not in self.links:
            raise self.refuse(call_name(joint), f"its {which} {link!r} is no link")
        return link

    def numbers(self, node: Element | None, key: str, count: int, usual: Sequence[float]) -> Array:
        """The numbers of an attribute.

        Raises:
            ExchangeError: not so many finite numbers.
        """
        text = None if node is None else node.get(key)
        if node is None or text is None:
            return np.array(usual, dtype=float)
        try:
            parsed = np.array([float(x) for x in text.split()])
        except ValueError as error:
            raise self.refuse(call_name(node), f"{key}={text!r}: no numbers") from error
        if len(parsed) != count or not np.isfinite(parsed).all():
            raise self.refuse(call_name(node), f"{key}={text!r}: {count} finite number{'s' * (count > 1)} wanted")
        return parsed

    def origin(self, node: Element | None) -> tuple[Array, Array]:
        """Shift (3,) and turn (3, 3) of an element's <origin>."""
        own = None if node is None else node.find("origin")
        return self.numbers(own, "xyz", 3, (0, 0, 0)), from_angles(self.numbers(own, "rpy", 3, (0, 0, 0)))

    def spatial(self, close: Sequence[str]) -> Spatial:
        """The whole, with the loops that are to be closed."""
        bodies: list[Body] = []
        joints: list[Joint] = []
        acting: list[Acting] = []
        dropped = self._drop()
        self.anchors: dict[str, Array] = {}
        for k, name in enumerate(self.order):
            place, turn, parent = np.zeros(3), np.eye(3), WORLD
            if k:
                node = self.joints[self.parents[name]]
                parent = self.index[self._end(node, "parent")]
                shift, own = self.origin(node)
                place, turn = bodies[parent].origin + bodies[parent].turn @ shift, bodies[parent].turn @ own
                self.anchors[self.parents[name]] = place
                self._joint(node, k, place, turn, joints, acting, dropped)
            bodies.append(self._body(name, parent, place, turn))
        if bodies[WORLD].mass:
            dropped.append(f"the mass of {self.order[0]}, which is the ground")
        closures = tuple(self._closure(text, bodies) for text in close)
        spots = tuple(Spot(name, k, bodies[k].origin) for name, k in self.index.items() if not bodies[k].mass and k)
        return Spatial(
            self.file, tuple(bodies), tuple(joints), np.array(GRAVITY), closures, (), spots, tuple(acting), tuple(dropped)
        )

    def _drop(self) -> list[str]:
        counted = {tag: sum(1 for _ in self.root.iter(tag)) for tag in IGNORED}
        ignored = [f"{n} <{tag}>" for tag, n in counted.items() if n]
        limits = [
            name for name, joint in self.joints.items() if joint.find("limit") is not None and joint.get("type") != "continuous"
        ]
        return [", ".join(ignored)] * bool(ignored) + [f"the limits of joint {name}" for name in limits]

    def _body(self, name: str, parent: int, place: Array, turn: Array) -> Body:
        node = self.links[name].find("inertial")
        shift, own = self.origin(node)
        mass_of, inertia_of = (None if node is None else node.find(tag) for tag in ("mass", "inertia"))
        mass = float(self.numbers(mass_of, "value", 1, (0,))[0])
        xx, xy, xz, yy, yz, zz = (
            float(self.numbers(inertia_of, key, 1, (0,))[0]) for key in ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
        )
        if mass < 0:
            raise self.refuse(call_name(self.links[name]), "a negative mass")
        axes = turn @ own
        inertia = axes @ np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]) @ axes.T
        return Body(name, parent, place, turn, mass, place + turn @ shift, inertia)

    def _joint(
        self, node: Element, k: int, place: Array, turn: Array, joints: list[Joint], acting: list[Acting], dropped: list[str]
    ) -> None:
        name, kind = node.get("name", ""), node.get("type", "")
        if node.find("mimic") is not None:
            raise self.refuse(call_name(node), "<mimic> is a gear, which a linkage does not have")
        if kind not in MOVING:
            raise self.refuse(call_name(node), f"type {kind!r}: only {', '.join(MOVING)} joints move in a plane")
        if not MOVING[kind]:
            return
        axis = turn @ self.numbers(node.find("axis"), "xyz", 3, (1, 0, 0))
        if not np.linalg.norm(axis) > 0:
            raise self.refuse(call_name(node), "an axis without direction")
        dynamics = node.find("dynamics")
        if self.numbers(dynamics, "friction", 1, (0,))[0]:
            raise self.refuse(call_name(node), "friction that does not depend on the joint's load as that of a linkage does")
        joints.append(Joint(name, MOVING[kind], k, place, axis / np.linalg.norm(axis)))
        if damping := float(self.numbers(dynamics, "damping", 1, (0,))[0]):
            acting.append(OnJoint(f"damping_{name}", len(joints) - 1, Straight(c=damping)))

    def _closure(self, text: str, bodies: list[Body]) -> tuple[str, Spot, Spot]:
        ends = text.split("=")
        if len(ends) != 2:
            raise ExchangeError(f"{self.file}: --close {text}: LINK.FRAME=LINK.FRAME is wanted")
        a, b = (self._frame(end.strip(), text, bodies) for end in ends)
        return f"{a.name}_{b.name}", a, b

    def _frame(self, end: str, text: str, bodies: list[Body]) -> Spot:
        """A frame of a link; names may have dots in them, so that every way to part the text is tried."""
        parts = end.split(".")
        for k in range(1, len(parts)):
            link, frame = ".".join(parts[:k]), ".".join(parts[k:])
            if link not in self.index:
                continue
            at = self.index[link]
            if frame == link or self._is_fixed(frame, link):
                return Spot(frame, at, bodies[self.index[frame]].origin)
            joint = self.joints.get(frame)
            if joint is not None and link in (self._end(joint, "parent"), self._end(joint, "child")):
                return Spot(frame, at, self.anchors[frame])
        reason = f"{end!r} is no LINK.FRAME: a link, and a link fixed to it or a joint at it"
        raise ExchangeError(f"{self.file}: --close {text}: {reason}")

    def _is_fixed(self, frame: str, link: str) -> bool:
        """Tell whether one link is fixed to another."""
        while frame in self.parents:
            joint = self.joints[self.parents[frame]]
            if joint.get("type") != "fixed":
                return False
            frame = self._end(joint, "parent")
            if frame == link:
                return True
        return False


def from_angles(rpy: Array) -> Array:
    """(3, 3) of roll, pitch and yaw about fixed axes: Rz(yaw) Ry(pitch) Rx(roll)."""
    (cr, cp, cy), (sr, sp, sy) = np.cos(rpy), np.sin(rpy)
    return np.array(
        [
            [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
            [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
            [-sp, cp * sr, cp * cr],
        ]
    )
