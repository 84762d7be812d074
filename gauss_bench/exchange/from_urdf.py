"""Import of URDF: convert a tree of links to a spatial mechanism. Elements that a linkage cannot have are refused.

A link without mass is a frame of the link to which it is fixed. URDF cannot close loops, so a user gives the closures as
LINK.FRAME=LINK.FRAME, where FRAME is a link fixed to LINK, a joint at LINK, or LINK itself.
"""

from collections.abc import Sequence
from itertools import combinations
from xml.etree.ElementTree import Element

import numpy as np

from gauss_bench.exchange.errors import FileReader
from gauss_bench.exchange.safe_xml import describe
from gauss_bench.exchange.spatial import WORLD, Body, Force, Joint, LinearLaw, OnJoints, Spatial, Spot
from gauss_bench.exchange.unused import list_ignored, list_names
from gauss_bench.terms import Array

GRAVITY = (0.0, 0.0, -9.81)  # [m/s^2] a URDF gives no gravity; by convention z points up
KINDS = {"revolute": "hinge", "continuous": "hinge", "prismatic": "slide", "fixed": ""}  # type in a URDF -> kind of joint
READ = {  # tag -> tags in it that are read
    "robot": ("link", "joint"),
    "link": ("inertial",),
    "inertial": ("origin", "mass", "inertia"),
    "joint": ("parent", "child", "origin", "axis", "dynamics", "mimic", "limit"),  # limits are listed by joint
}


class Robot(FileReader):
    """A reader of a URDF that `read_xml` has accepted; its methods raise ExchangeError for elements that a linkage cannot have.

    Attributes:
        links, joints: name -> element.
        ends: joint -> names of its parent link and its child link.
        joint_to: link -> joint whose child it is; the root link has no entry.
        index: link -> index of its body; parents precede their children.
    """

    def __init__(self, root: Element, file: str):
        """Read the links and joints of a document, and find the order of its tree."""
        self.file, self.root = file, root
        for node in root.iter():
            if ":" in str(node.tag) or "{" in str(node.tag):
                raise self.refuse(describe(node), "is no URDF; expand xacro first")
        self.links, self.joints = self._read_table("link"), self._read_table("joint")
        self.ends = {name: (self._read_end(joint, "parent"), self._read_end(joint, "child")) for name, joint in self.joints.items()}
        self.joint_to: dict[str, str] = {}
        for name, (_, child) in self.ends.items():
            if child in self.joint_to:
                reason = f"link {child!r} is the child of two joints; a URDF is a tree, and --close closes its loops"
                raise self.refuse(describe(self.joints[name]), reason)
            self.joint_to[child] = name
        order = [name for name in self.links if name not in self.joint_to]
        if len(order) != 1:
            raise self.refuse("<robot>", f"has {len(order)} links without a parent, not one")
        for name in order:  # the loop visits the children that it appends, so that all descendants of the root follow
            order += [child for parent, child in self.ends.values() if parent == name]
        if len(order) < len(self.links):
            raise self.refuse("<robot>", f"link {min({*self.links} - {*order})!r} is a descendant of itself")
        self.index = {name: k for k, name in enumerate(order)}

    def _read_table(self, tag: str) -> dict[str, Element]:
        """Return name -> element of all elements with a tag."""
        elements: dict[str, Element] = {}
        for node in self.root.findall(tag):
            name = node.get("name")
            if not name or name in elements:
                raise self.refuse(describe(node), "needs a name of its own")
            elements[name] = node
        return elements

    def _read_end(self, joint: Element, which: str) -> str:
        """Return the name of a joint's link; `which` is "parent" or "child"."""
        node = joint.find(which)
        link = "" if node is None else node.get("link", "")
        if link not in self.links:
            raise self.refuse(describe(joint), f"its {which} {link!r} is no link")
        return link

    def read_numbers(self, node: Element | None, key: str, default: Sequence[float]) -> Array:
        """Return the numbers of an attribute, as many as `default` has, or `default` if the element or the attribute is missing."""
        text = None if node is None else node.get(key)
        if node is None or text is None:
            return np.array(default, dtype=float)
        try:
            parsed = np.array([float(x) for x in text.split()])
        except ValueError as error:
            raise self.refuse(describe(node), f"{key}={text!r}: not numbers") from error
        if len(parsed) != len(default) or not np.isfinite(parsed).all():
            wanted = "a finite number is" if len(default) == 1 else f"{len(default)} finite numbers are"
            raise self.refuse(describe(node), f"{key}={text!r}: {wanted} required")
        return parsed

    def read_number(self, node: Element | None, key: str) -> float:
        """Return the value of an attribute with one number, or 0 if the element or the attribute is missing."""
        return float(self.read_numbers(node, key, (0,))[0])

    def read_origin(self, node: Element | None) -> tuple[Array, Array]:
        """Return the shift (3,) [m] and rotation (3, 3) of the <origin> in an element; zero and no rotation if it is missing."""
        origin, turn = None if node is None else node.find("origin"), np.eye(3)
        # roll about x, pitch about y and yaw about z, in this order; each turns the other two axes i and j. The rotation matrices
        # are written out because rounding in quaternions would tilt the axis of a rotation about x, y or z.
        for angle, (i, j) in zip(self.read_numbers(origin, "rpy", (0, 0, 0)), ((1, 2), (2, 0), (0, 1)), strict=True):
            rotation = np.eye(3)
            rotation[i, i] = rotation[j, j] = np.cos(angle)
            rotation[i, j], rotation[j, i] = -np.sin(angle), np.sin(angle)
            turn = rotation @ turn
        return self.read_numbers(origin, "xyz", (0, 0, 0)), turn

    def read(self, close: Sequence[str]) -> Spatial:
        """Return the mechanism in space, whose world is the root link; `close` has closures LINK.FRAME=LINK.FRAME of its loops."""
        bodies, joints, forces, dropped = list[Body](), list[Joint](), list[Force](), self._list_ignored()
        for name, k in self.index.items():  # parents precede their children
            if name not in self.joint_to:
                bodies.append(self._read_body(name, WORLD, np.zeros(3), np.eye(3)))
                continue
            joint_name = self.joint_to[name]
            parent_name, _ = self.ends[joint_name]
            node, parent = self.joints[joint_name], self.index[parent_name]
            shift, rotation = self.read_origin(node)
            place, turn = bodies[parent].origin + bodies[parent].turn @ shift, bodies[parent].turn @ rotation
            joint = self._read_joint(node, k, place, turn)
            if joint is not None:  # None for a fixed joint
                joints.append(joint)
                if damping := self.read_number(node.find("dynamics"), "damping"):
                    forces.append(OnJoints(f"damping_{joint.name}", {len(joints) - 1: 1.0}, LinearLaw(c=damping)))
            bodies.append(self._read_body(name, parent, place, turn))
        if bodies[WORLD].mass:
            dropped.append(f"the mass of {bodies[WORLD].name}, which is the ground")
        return Spatial(
            self.file,
            tuple(bodies),
            tuple(joints),
            np.array(GRAVITY),
            closures=tuple(self._read_closure(text, bodies) for text in close),
            spots=tuple(Spot(name, k, bodies[k].origin) for name, k in self.index.items() if not bodies[k].mass and k != WORLD),
            forces=tuple(forces),
            dropped=tuple(dropped),
            how_to_close="" if close else self._describe_closing(bodies),
        )

    def _list_ignored(self) -> list[str]:
        """Return a sentence for each kind of element that is not read, and for each joint with limits."""
        limits: list[str] = []
        for name, joint in self.joints.items():
            limit = joint.find("limit")
            if limit is not None and joint.get("type") != "fixed":
                numbers = ", ".join(f"{key} {list_names([x])}" for key, x in limit.items())
                limits.append(f"the limits of joint {name}" + (f": {numbers}" if numbers else ""))
        return [*list_ignored(self.root, READ), *limits]

    def _describe_closing(self, bodies: Sequence[Body]) -> str:
        """Return how --close closes a loop, with an example if the tree has ends on two different links."""
        parents = {parent for parent, _ in self.ends.values()}
        # the ends of the tree, each as (moving link, frame): the frame is fixed to the link, or is the link itself
        tips = [(self._list_chain(name)[-1], name) for name in self.index if name not in parents and name in self.joint_to]
        pairs = [(a, b) for a, b in combinations(tips, 2) if a[0] != b[0]]  # ends on two different links
        if not pairs:
            return "--close LINK.FRAME=LINK.FRAME closes a loop, where FRAME is a link fixed to LINK, a joint at it, or LINK itself"

        # authors add frames where links are joined: prefer pairs of frames, and the nearest of these pairs
        def rank(pair: tuple[tuple[str, str], tuple[str, str]]) -> tuple[int, float]:
            """Return the number of ends that are moving links, not frames fixed to a link, and the distance [m] of the two ends."""
            a, b = (bodies[self.index[frame]].origin for _, frame in pair)
            return sum(link == frame for link, frame in pair), float(np.linalg.norm(a - b))

        a, b = (f"{link}.{frame}" for link, frame in min(pairs, key=rank))
        return f"--close LINK.FRAME=LINK.FRAME closes a loop, for example --close {a}={b}"

    def _list_chain(self, frame: str) -> list[str]:
        """Return the link `frame`, the link to which it is fixed, and so on up to a link that moves or is the root."""
        chain, joint = [frame], self.joint_to.get(frame)
        while joint is not None and self.joints[joint].get("type") == "fixed":
            chain.append(self.ends[joint][0])
            joint = self.joint_to.get(chain[-1])
        return chain

    def _read_body(self, name: str, parent: int, place: Array, turn: Array) -> Body:
        """Return the body of a link; `place` (3,) [m] and `turn` (3, 3) are position and rotation of the link's frame."""
        node = self.links[name].find("inertial")
        shift, rotation = self.read_origin(node)
        mass = self.read_number(None if node is None else node.find("mass"), "value")
        if mass < 0:
            raise self.refuse(describe(self.links[name]), "a negative mass")
        inertia_node = None if node is None else node.find("inertia")
        xx, xy, xz, yy, yz, zz = (self.read_number(inertia_node, key) for key in ("ixx", "ixy", "ixz", "iyy", "iyz", "izz"))
        inertia = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])  # in the axes of <inertial>
        axes = turn @ rotation
        return Body(name, parent, place, turn, mass, place + turn @ shift, axes @ inertia @ axes.T)

    def _read_joint(self, node: Element, k: int, place: Array, turn: Array) -> Joint | None:
        """Return the joint that a <joint> element describes, or None if it is a fixed joint.

        It moves body k, whose frame has the position `place` (3,) [m] and the rotation `turn` (3, 3).
        """
        name, kind = node.get("name", ""), node.get("type", "")
        if node.find("mimic") is not None:
            raise self.refuse(describe(node), "<mimic> is a gear; a linkage has no gears")
        if kind not in KINDS:
            raise self.refuse(describe(node), f"type {kind!r}: only {', '.join(KINDS)} joints move in a plane")
        if not KINDS[kind]:
            return None
        axis = turn @ self.read_numbers(node.find("axis"), "xyz", (1, 0, 0))
        if not np.linalg.norm(axis) > 0:
            raise self.refuse(describe(node), "an axis without direction")
        if self.read_number(node.find("dynamics"), "friction"):
            reason = "joint friction that does not depend on the load; in a linkage it is proportional to the joint's load"
            raise self.refuse(describe(node), reason)
        return Joint(name, KINDS[kind], k, place, axis / np.linalg.norm(axis))

    def _read_closure(self, text: str, bodies: list[Body]) -> tuple[str, Spot, Spot]:
        """Return the name and the two points of a closure that a user gives as LINK.FRAME=LINK.FRAME."""
        ends = text.split("=")
        if len(ends) != 2:
            raise self.refuse(f"--close {text}", "LINK.FRAME=LINK.FRAME is required")
        a, b = (self._find_frame(end.strip(), text, bodies) for end in ends)
        return f"{a.name}_{b.name}", a, b

    def _find_frame(self, end: str, text: str, bodies: list[Body]) -> Spot:
        """Return the point for one end LINK.FRAME of a closure; `text` is the whole closure, for messages."""
        parts = end.split(".")
        for k in range(1, len(parts)):  # names may contain dots, so try every dot as the one between link and frame
            link, frame = ".".join(parts[:k]), ".".join(parts[k:])
            if link in self.index and link in self._list_chain(frame):
                return Spot(frame, self.index[link], bodies[self.index[frame]].origin)
            if link in self.ends.get(frame, ()):  # a joint is at the origin of its child
                return Spot(frame, self.index[link], bodies[self.index[self.ends[frame][1]]].origin)
        raise self.refuse(f"--close {text}", f"{end!r} is no LINK.FRAME: a link, and a link fixed to it or a joint at it")
