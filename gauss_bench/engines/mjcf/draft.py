"""Write a linkage as an MJCF document, which MuJoCo compiles: bodies, joints, closures and forces.

Every link is a body whose frame lies at its centre of mass. Joint coordinates are the tree coordinates y. MuJoCo's reference pose
is the start of the mechanism, so that the loops are closed in the pose in which the compiler computes body_invweight0. Elements
have the names of their counterparts in the linkage file. Numbers have all digits: the six digits of MuJoCo's own writer are too few
for closed loops.
"""

from collections import defaultdict
from typing import Any, assert_never
from xml.etree.ElementTree import Element, SubElement

import numpy as np

from gauss_bench.engines.mjcf.forces import AtSite, Native, Tendon, native_forces
from gauss_bench.engines.shared import closing_pins, spatial
from gauss_bench.engines.tree import Branch, Tree
from gauss_bench.engines.tree_loads import OnJoints, Steady
from gauss_bench.mechanism.coordinates import rotate
from gauss_bench.mechanism.model import GROUND, LengthDriver, Link, Mechanism, Point
from gauss_bench.terms import Array


def write_numbers(x: Any) -> str:
    """Return numbers in full precision, separated by spaces."""
    return " ".join(repr(float(value)) for value in np.atleast_1d(x))


class Draft:
    """A mechanism as an MJCF document, with MuJoCo's default options.

    Attributes:
        root: the document, with the elements `option`, `closures`, `tendons` and `actuators`.
        bodies: link -> element of its body.
        joints: index of a tree coordinate -> element of its joint.
        torque: (n,) sum of all constant forces on tree coordinates, for the field qfrc_applied of MuJoCo's data.
        steady: the constant forces on tree coordinates whose sum is `torque`.
        pushes: constant forces at points, each with its actuator.
        controls: name of a motor -> the motor's control (force); empty until `add_motors` is called.
        cylinders: for every driven length the driver, its tendon, and the motor whose control is the force.
    """

    def __init__(self, mechanism: Mechanism, tree: Tree):
        """Write the links of the tree with their joints, then the closures, the forces and the driven lengths."""
        self.mechanism, self.tree = mechanism, tree
        self.root = Element("mujoco", model=mechanism.name)
        SubElement(self.root, "compiler", angle="radian", autolimits="true")
        self.option = SubElement(self.root, "option", gravity=write_numbers(spatial(mechanism.gravity)))
        world = SubElement(self.root, "worldbody")
        self.closures, self.tendons, self.actuators = (SubElement(self.root, x) for x in ("equality", "tendon", "actuator"))
        self.torque = np.zeros(tree.n)
        self.steady: list[Steady] = []
        self.pushes: list[tuple[AtSite, Element]] = []
        self.controls: dict[str, float] = {}
        self.bodies: dict[int, Element] = {GROUND: world}
        self.joints: dict[int, Element] = {}
        self.names: set[tuple[str, str]] = {("body", "world")}  # kinds and names of all elements
        self.sites: dict[tuple[Any, ...], str] = {}  # link, name and place of a point -> name of its site
        y, _ = tree.relative(mechanism.q0, mechanism.v0)
        for b in tree.branches:
            self._add_link(b, mechanism.links[b.link], y)
        for first, second in closing_pins(tree):
            SubElement(self.closures, "connect", site1=self._site(first), site2=self._site(second))
        springs = [self._add_force(x) for x in native_forces(mechanism, tree)]
        self._set_joint_springs([x for x in springs if x is not None])
        self.cylinders = [self._add_cylinder(d) for d in mechanism.drivers if isinstance(d, LengthDriver)]

    def _add_link(self, b: Branch, link: Link, y: Array) -> None:
        """Add a link as a body without geometry, in its pose at the tree coordinates y (n,), with its joints."""
        origin, angle = pose_in_parent(b, y)
        pos, quat = write_numbers(spatial(origin)), write_numbers([np.cos(angle / 2), 0.0, 0.0, np.sin(angle / 2)])  # quaternion
        body = SubElement(self.bodies[b.parent], "body", name=self._name("body", link.name), pos=pos, quat=quat)
        moments = write_numbers([link.inertia] * 3)  # only the moment about z acts
        SubElement(body, "inertial", pos="0 0 0", mass=write_numbers(link.mass), diaginertia=moments)
        self.bodies[b.link] = body

        def add_joint(index: int, name: str, kind: str, axis: list[float], anchor: Array) -> None:
            """Add a joint for the tree coordinate with this index; axis and anchor are in the link's frame."""
            # `ref`: the coordinate in the pose in which the body is added, so that MuJoCo's qpos are the tree coordinates
            geometry = {"axis": write_numbers(axis), "pos": write_numbers(spatial(anchor)), "ref": write_numbers(y[index])}
            self.joints[index] = SubElement(body, "joint", geometry, name=self._name("joint", name), type=kind)

        # a free link has slides along x and y and then a hinge; `b.at` is the index of the link's first tree coordinate
        slide_axes = {"revolute": [], "prismatic": [b.axis], "free": [*np.eye(2)]}[b.kind]  # in the parent's frame
        names = [b.joint.name] if b.joint else [f"{link.name} {x}" for x in ("x", "y", "theta")]
        for i, axis in enumerate(slide_axes):  # MuJoCo takes axes in the child's frame
            add_joint(b.at + i, names[i], "slide", spatial(rotate(axis, np.array(-angle))), np.zeros(2))
        if b.kind != "prismatic":
            add_joint(b.at + len(slide_axes), names[-1], "hinge", [0.0, 0.0, 1.0], b.anchor)

    def find_bodies(self, model: Any) -> list[int]:
        """Return MuJoCo's index of each link's body in the compiled model, in the order of the links."""
        return [model.body(self.bodies[i].attrib["name"]).id for i in range(len(self.mechanism.links))]

    def _name(self, kind: str, wanted: str) -> str:
        """Return a name for a new element of a kind: the wanted one, with a number if another element of the kind has it."""
        name, k = wanted, 1
        while (kind, name) in self.names:
            k += 1
            name = f"{wanted} {k}"
        self.names.add((kind, name))
        return name

    def _site(self, point: Point) -> str:
        """Return the name of the site at a point; the first call for a point adds the site."""
        key = point.link, point.name, tuple(point.local)
        if key not in self.sites:
            self.sites[key] = self._name("site", point.name)
            SubElement(self.bodies[point.link], "site", name=self.sites[key], pos=write_numbers(spatial(point.local)))
        return self.sites[key]

    def _add_force(self, f: Native) -> OnJoints | None:
        """Add the element of a force, or return the force if it is a spring or damper on a single joint.

        A joint has one spring in MuJoCo, so all springs on it must be summed first.
        """
        match f:
            case Steady():
                self.torque += f.value * f.force
                self.steady.append(f)
            case Tendon(a, b, law):
                tendon = self._add_tendon(f"{a.name} to {b.name}", a, b, write_spring(law.k, law.c, law.rest))
                if law.bias:  # the constant part of the force becomes an actuator whose control has no effect
                    self._add_actuator((law.bias, 0.0, 0.0), tendon=tendon.attrib["name"])
            case AtSite():
                self._add_site_force(f)
            case OnJoints() if np.count_nonzero(f.row) == 1:
                return f
            case OnJoints():
                if f.row.any():
                    self._add_spring_on_sum(f)
            case _:
                assert_never(f)
        return None

    def _add_tendon(self, name: str, a: Point, b: Point, spring: dict[str, str]) -> Element:
        """Add a tendon between two points, with the attributes `spring`, and return its element."""
        tendon = SubElement(self.tendons, "spatial", spring, name=self._name("tendon", name))
        for point in (a, b):
            SubElement(tendon, "site", site=self._site(point))
        return tendon

    def _add_cylinder(self, driver: LengthDriver) -> tuple[LengthDriver, Element, Element]:
        """Add a driven length, and return the driver and the elements of its tendon and motor."""
        tendon = self._add_tendon(driver.name, driver.a, driver.b, {})
        return driver, tendon, SubElement(self.actuators, "motor", tendon=tendon.attrib["name"])

    def add_motors(self) -> list[str]:
        """Replace constant forces by motors, whose controls are the forces, for an MJCF document that is used without this suite.

        Return the names of the forces that a control can change.
        """
        controlled: list[str] = []
        for f in self.steady:
            if f.force.any():
                controlled += f.names
                self.controls[self._add_motor(f)] = f.value
        for push, actuator in self.pushes:
            size = float(np.linalg.norm(push.direction))
            actuator.tag = "motor"
            for key in ("gainprm", "biastype", "biasprm"):  # attributes of the element <general>, not of <motor>
                del actuator.attrib[key]
            # a unit vector, so that the control is the force
            actuator.set("gear", write_numbers([*(push.direction / size), 0.0, 0.0, 0.0, 0.0]))
            controlled.append(push.name)
            self.controls[actuator.attrib["name"]] = size
        return controlled

    def _add_motor(self, f: Steady) -> str:
        """Add a motor for a constant generalised force on one joint or on a weighted sum of joints, and return the motor's name."""
        name = self._name("actuator", f.names[0] if f.names else "torque")
        [index, *others] = np.flatnonzero(f.force)  # of the tree coordinates on which the force acts
        if others:
            tendon = self._name("tendon", name)
            self._add_fixed_tendon(f.force, name=tendon)
            SubElement(self.actuators, "motor", name=name, tendon=tendon)
        else:
            joint = self.joints[int(index)].attrib["name"]
            SubElement(self.actuators, "motor", name=name, joint=joint, gear=write_numbers(f.force[index]))
        return name

    def _add_fixed_tendon(self, row: Array, **attributes: str) -> None:
        """Add a fixed tendon: MuJoCo's element for a length row . y that is a weighted sum of joint coordinates."""
        tendon = SubElement(self.tendons, "fixed", attributes)
        for index in np.flatnonzero(row):
            SubElement(tendon, "joint", joint=self.joints[int(index)].attrib["name"], coef=write_numbers(row[index]))

    def _add_actuator(self, bias: tuple[float, float, float], **attributes: str) -> Element:
        """Add an actuator with the force bias . [1, L, dL/dt], where L is the length of its transmission, and return it."""
        force = {"gainprm": "0", "biastype": "affine", "biasprm": write_numbers(bias)}  # gain 0: the control has no effect
        return SubElement(self.actuators, "general", attributes | force)

    def _add_site_force(self, f: AtSite) -> None:
        """Add the actuator of a force at a point."""
        attributes = {"name": self._name("actuator", f.name), "site": self._site(f.point)}
        if f.frame is not None:
            attributes["refsite"] = self._site(f.frame)
        actuator = self._add_actuator(f.bias, **attributes, gear=write_numbers([*f.direction, 0.0, 0.0, 0.0, 0.0]))
        if f.constant:
            self.pushes.append((f, actuator))

    def _add_spring_on_sum(self, f: OnJoints) -> None:
        """Add a spring and damper on a sum of joint coordinates.

        Trap: MuJoCo reads a rest length of -1 as "the length at qpos0". So if the rest length is negative, the signs of the rest
        length and of all coefficients of the sum are reversed.
        """
        rest = f.rest - f.constant
        sign = -1.0 if rest < 0 else 1.0
        self._add_fixed_tendon(sign * f.row, **write_spring(f.k, f.c, sign * rest))

    def _set_joint_springs(self, springs: list[OnJoints]) -> None:
        """Give each joint the sum of the springs and dampers that act on it.

        A spring acts on x = row . y + constant, where the row has a single entry, 1 or -1. The joint's rest position follows from
        the springs' forces at y = 0.
        """
        by_joint: defaultdict[int, list[OnJoints]] = defaultdict(list)
        for f in springs:
            by_joint[int(np.flatnonzero(f.row)[0])].append(f)
        for at, forces in by_joint.items():
            k, c, joint = sum(f.k for f in forces), sum(f.c for f in forces), self.joints[at]
            force_at_zero = sum(f.k * (f.rest - f.constant) * f.row[at] for f in forces)
            if k:
                joint.attrib |= {"stiffness": write_numbers(k), "springref": write_numbers(force_at_zero / k)}
            if c:
                joint.set("damping", write_numbers(c))


def write_spring(k: float, c: float, rest: float) -> dict[str, str]:
    """Return the attributes of a tendon with stiffness k, damping c and the rest length `rest`."""
    return {"stiffness": write_numbers(k), "damping": write_numbers(c), "springlength": write_numbers([rest] * 2)}


def pose_in_parent(b: Branch, y: Array) -> tuple[Array, float]:
    """Return the origin (2,) [m] and angle [rad] of a branch's link in its parent's frame, at tree coordinates y (n,)."""
    if b.kind == "free":
        return y[b.at : b.at + 2], float(y[b.at + 2])
    displacement = b.base + y[b.at] * b.axis if b.kind == "prismatic" else np.zeros(2)
    angle = b.turn if b.kind == "prismatic" else float(y[b.at])
    return b.parent_anchor + displacement - rotate(b.anchor, np.array(angle)), angle
