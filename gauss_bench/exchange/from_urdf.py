"""Import of URDF: from a tree of links to a mechanism in space. Elements that a linkage cannot have are refused.

Numbers are taken from the file unchanged. Links without inertia are frames of the link that they are fixed to. URDF cannot close
loops, so a user gives the closures as LINK.FRAME=LINK.FRAME, where FRAME is a link fixed to LINK, a joint at LINK, or LINK itself.
"""

from collections.abc import Sequence
from pathlib import Path
from xml.etree.ElementTree import Element

import numpy as np

from gauss_bench.exchange.errors import ExchangeError
from gauss_bench.exchange.safe_xml import call_name
from gauss_bench.exchange.spatial import WORLD, Acting, Body, Joint, OnJoints, Spatial, Spot, Straight
from gauss_bench.terms import Array

GRAVITY = (0.0, 0.0, -9.81)  # [m/s^2]: a URDF has none of its own, and z points up
MOVING = {"revolute": "hinge", "continuous": "hinge", "prismatic": "slide", "fixed": ""}
IGNORED = ("visual", "collision", "gazebo", "transmission", "material", "sensor")


def from_urdf(root: Element, path: Path, close: Sequence[str] = ()) -> Spatial:
    """Return the mechanism of a document that `read_xml` has accepted; its root link is the world.

    Raises:
        ExchangeError: an element is faulty, a linkage cannot have it, or a closure names a frame that does not exist.
    """
    return Robot(root, str(path)).spatial(close)


class Robot:
    """A reader of a document with the root `robot`.

    Attributes:
        ends: joint -> names of its parent and child links.
        hangs: link -> the joint by which it hangs on its parent; the root has none.
        index: link -> index of its body, parents first.
    """

    def __init__(self, root: Element, file: str):
        self.file, self.root = file, root
        for node in root.iter():
            if ":" in str(node.tag) or "{" in str(node.tag):
                raise self.refuse(call_name(node), "is no URDF; expand xacro first")
        self.links, self.joints = self._table("link"), self._table("joint")
        self.ends = {name: (self._end(joint, "parent"), self._end(joint, "child")) for name, joint in self.joints.items()}
        self.hangs: dict[str, str] = {}
        for name, (_, child) in self.ends.items():
            if child in self.hangs:
                reason = f"link {child!r} hangs on two joints; a URDF is a tree, and --close closes its loops"
                raise self.refuse(call_name(self.joints[name]), reason)
            self.hangs[child] = name
        order = [name for name in self.links if name not in self.hangs]
        if len(order) != 1:
            raise self.refuse("<robot>", f"has {len(order)} links without a parent, not one")
        for name in order:
            order += [child for parent, child in self.ends.values() if parent == name]
        if len(order) < len(self.links):
            raise self.refuse("<robot>", f"link {min({*self.links} - {*order})!r} hangs on itself")
        self.index = {name: k for k, name in enumerate(order)}

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

    def numbers(self, node: Element | None, key: str, usual: Sequence[float]) -> Array:
        """Return the numbers of an attribute, or the usual ones if it is missing; there must be as many as usual.

        Raises:
            ExchangeError: the attribute holds another number of values, or values that are not finite.
        """
        text = None if node is None else node.get(key)
        if node is None or text is None:
            return np.array(usual, dtype=float)
        try:
            parsed = np.array([float(x) for x in text.split()])
        except ValueError as error:
            raise self.refuse(call_name(node), f"{key}={text!r}: no numbers") from error
        if len(parsed) != len(usual) or not np.isfinite(parsed).all():
            raise self.refuse(call_name(node), f"{key}={text!r}: {len(usual)} finite number{'s' * (len(usual) > 1)} wanted")
        return parsed

    def number(self, node: Element | None, key: str) -> float:
        return float(self.numbers(node, key, (0,))[0])

    def origin(self, node: Element | None) -> tuple[Array, Array]:
        """Return the shift (3,) and rotation (3, 3) of an element's <origin>: Rz(yaw) Ry(pitch) Rx(roll)."""
        own, turn = None if node is None else node.find("origin"), np.eye(3)
        for angle, (i, j) in zip(self.numbers(own, "rpy", (0, 0, 0)), ((1, 2), (2, 0), (0, 1)), strict=True):
            about = np.eye(3)
            about[i, i] = about[j, j] = np.cos(angle)
            about[i, j], about[j, i] = -np.sin(angle), np.sin(angle)
            turn = about @ turn
        return self.numbers(own, "xyz", (0, 0, 0)), turn

    def spatial(self, close: Sequence[str]) -> Spatial:
        """Read the whole document, with its loops closed as `close` says."""
        bodies, joints, acting, dropped = list[Body](), list[Joint](), list[Acting](), self._drop()
        for name, k in self.index.items():
            place, turn, parent = np.zeros(3), np.eye(3), WORLD
            if k:
                node, parent = self.joints[self.hangs[name]], self.index[self.ends[self.hangs[name]][0]]
                shift, own = self.origin(node)
                place, turn = bodies[parent].origin + bodies[parent].turn @ shift, bodies[parent].turn @ own
                if joint := self._joint(node, k, place, turn):
                    joints.append(joint)
                    if damping := self.number(node.find("dynamics"), "damping"):
                        acting.append(OnJoints(f"damping_{joint.name}", {len(joints) - 1: 1.0}, Straight(c=damping)))
            bodies.append(self._body(name, parent, place, turn))
        if bodies[WORLD].mass:
            dropped.append(f"the mass of {bodies[WORLD].name}, which is the ground")
        closures = tuple(self._closure(text, bodies) for text in close)
        spots = tuple(Spot(name, k, bodies[k].origin) for name, k in self.index.items() if not bodies[k].mass and k)
        parts = tuple(bodies), tuple(joints), np.array(GRAVITY), closures, (), spots, tuple(acting), tuple(dropped)
        return Spatial(self.file, *parts)

    def _drop(self) -> list[str]:
        """List the elements that are left out: visuals and the like, and limits of joints."""
        counted = {tag: sum(1 for _ in self.root.iter(tag)) for tag in IGNORED}
        ignored = ", ".join(f"{n} <{tag}>" for tag, n in counted.items() if n)
        bounded = [name for name, x in self.joints.items() if x.find("limit") is not None and x.get("type") != "continuous"]
        return [ignored] * bool(ignored) + [f"the limits of joint {name}" for name in bounded]

    def _body(self, name: str, parent: int, place: Array, turn: Array) -> Body:
        node = self.links[name].find("inertial")
        shift, own = self.origin(node)
        mass_of, inertia_of = (None if node is None else node.find(tag) for tag in ("mass", "inertia"))
        if (mass := self.number(mass_of, "value")) < 0:
            raise self.refuse(call_name(self.links[name]), "a negative mass")
        inertia, axes = [[self.number(inertia_of, f"i{min(a, b)}{max(a, b)}") for b in "xyz"] for a in "xyz"], turn @ own
        return Body(name, parent, place, turn, mass, place + turn @ shift, axes @ np.array(inertia) @ axes.T)

    def _joint(self, node: Element, k: int, place: Array, turn: Array) -> Joint | None:
        name, kind = node.get("name", ""), node.get("type", "")
        if node.find("mimic") is not None:
            raise self.refuse(call_name(node), "<mimic> is a gear, which a linkage does not have")
        if kind not in MOVING:
            raise self.refuse(call_name(node), f"type {kind!r}: only {', '.join(MOVING)} joints move in a plane")
        if not MOVING[kind]:
            return None
        axis = turn @ self.numbers(node.find("axis"), "xyz", (1, 0, 0))
        if not np.linalg.norm(axis) > 0:
            raise self.refuse(call_name(node), "an axis without direction")
        if self.number(node.find("dynamics"), "friction"):
            raise self.refuse(call_name(node), "friction that does not depend on the joint's load as that of a linkage does")
        return Joint(name, MOVING[kind], k, place, axis / np.linalg.norm(axis))

    def _closure(self, text: str, bodies: list[Body]) -> tuple[str, Spot, Spot]:
        ends = text.split("=")
        if len(ends) != 2:
            raise self.refuse(f"--close {text}", "LINK.FRAME=LINK.FRAME is wanted")
        a, b = (self._find_frame(end.strip(), text, bodies) for end in ends)
        return f"{a.name}_{b.name}", a, b

    def _find_frame(self, end: str, text: str, bodies: list[Body]) -> Spot:
        """Return the point that LINK.FRAME names; names may contain dots, so the text is split at every dot in turn."""
        parts = end.split(".")
        for k in range(1, len(parts)):
            link, frame = ".".join(parts[:k]), ".".join(parts[k:])
            if link in self.index and (frame == link or self._is_fixed(frame, link)):
                return Spot(frame, self.index[link], bodies[self.index[frame]].origin)
            if link in self.ends.get(frame, ()):  # a joint lies where its child has its origin
                return Spot(frame, self.index[link], bodies[self.index[self.ends[frame][1]]].origin)
        raise self.refuse(f"--close {text}", f"{end!r} is no LINK.FRAME: a link, and a link fixed to it or a joint at it")

    def _is_fixed(self, frame: str, link: str) -> bool:
        """Tell whether one link is fixed to another."""
        while frame != link and frame in self.hangs and self.joints[self.hangs[frame]].get("type") == "fixed":
            frame = self.ends[self.hangs[frame]][0]
        return frame == link
