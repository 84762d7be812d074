"""Build a linkage as a MuJoCo specification, which MuJoCo compiles: bodies, joints, closures and forces.

Every link is a body whose frame lies at its centre of mass. Joint coordinates are the tree coordinates y. MuJoCo's reference pose
is the start of the mechanism, so that the loops are closed in the pose in which the compiler computes body_invweight0. Elements
have the names of their counterparts in the linkage file.
"""

from collections import defaultdict
from typing import Any, assert_never

import numpy as np

from gauss_bench.engines.mjcf.across_releases import new_spec, set_spring
from gauss_bench.engines.mjcf.forces import AtSite, Native, Tendon, native_forces
from gauss_bench.engines.shared import closing_pins, spatial
from gauss_bench.engines.tree import Branch, Tree
from gauss_bench.engines.tree_loads import OnJoints, Steady
from gauss_bench.mechanism.coordinates import rotate
from gauss_bench.mechanism.model import GROUND, LengthDriver, Link, Mechanism, Point
from gauss_bench.terms import Array


class Draft:
    """A MuJoCo specification of a mechanism.

    Attributes:
        spec: the MjSpec that MuJoCo compiles.
        bodies: link -> element of its body.
        joints: index of a tree coordinate -> element of its joint.
        torque: (n,) sum of all constant forces on tree coordinates, which MuJoCo takes from its data (qfrc_applied).
        steady: the constant forces on tree coordinates whose sum is `torque`.
        pushes: constant forces at points, each with its actuator.
        controls: name of a motor -> the motor's control (force); `add_motors` fills this table.
        cylinders: for every driven length the driver, its tendon, and the motor whose control is the force.
    """

    def __init__(self, mujoco: Any, mechanism: Mechanism, tree: Tree):
        self.mujoco, self.mechanism, self.tree = mujoco, mechanism, tree
        self.spec: Any = new_spec(mujoco)
        self.spec.option.gravity = spatial(mechanism.gravity)
        self.torque = np.zeros(tree.n)
        self.steady: list[Steady] = []
        self.pushes: list[tuple[AtSite, Any]] = []
        self.controls: dict[str, float] = {}
        self.bodies: dict[int, Any] = {GROUND: self.spec.worldbody}
        self.joints: dict[int, Any] = {}
        self.names: set[tuple[str, str]] = {("body", "world")}  # kinds and names of all elements
        self.sites: dict[tuple[Any, ...], str] = {}  # link, name and place of a point -> name of its site
        y, _ = tree.relative(mechanism.q0, mechanism.v0)
        for b in tree.branches:
            self._add_link(b, mechanism.links[b.link], y)
        connect, site = mujoco.mjtEq.mjEQ_CONNECT, mujoco.mjtObj.mjOBJ_SITE
        for pin in closing_pins(tree):
            self.spec.add_equality(type=connect, objtype=site, name1=self._site(pin[0]), name2=self._site(pin[1]))
        springs = [self._add_force(x) for x in native_forces(mechanism, tree)]
        self._set_joint_springs([x for x in springs if x is not None])
        self.cylinders = [self._add_cylinder(d) for d in mechanism.drivers if isinstance(d, LengthDriver)]

    def _add_link(self, b: Branch, link: Link, y: Array) -> None:
        """Add a link as a body without geometry, in its pose at the tree coordinates y (n,), with its joints."""
        origin, angle = pose_in_parent(b, y)
        quaternion = [np.cos(angle / 2), 0.0, 0.0, np.sin(angle / 2)]
        body = self.bodies[b.parent].add_body(name=self._name("body", link.name), pos=spatial(origin), quat=quaternion)
        body.explicitinertial = True
        body.mass, body.ipos, body.inertia = link.mass, [0.0] * 3, [link.inertia] * 3  # only the last moment of inertia acts
        self.bodies[b.link] = body
        hinge, slide = self.mujoco.mjtJoint.mjJNT_HINGE, self.mujoco.mjtJoint.mjJNT_SLIDE

        def add_joint(at: int, name: str, kind: Any, axis: list[float], anchor: Array) -> None:
            """Add a joint for the tree coordinate with index `at`; axis and anchor are in the link's frame."""
            # `ref`: the coordinate in the pose in which the body is added, so that MuJoCo's qpos are the tree coordinates
            self.joints[at] = body.add_joint(name=self._name("joint", name), type=kind, axis=axis, pos=spatial(anchor), ref=y[at])

        # a free link has slides along x and y and then a hinge; `b.at` is the index of the link's first tree coordinate
        slides = {"revolute": [], "prismatic": [b.axis], "free": [*np.eye(2)]}[b.kind]
        names = [b.joint.name] if b.joint else [f"{link.name} {x}" for x in ("x", "y", "theta")]
        for i, axis in enumerate(slides):  # MuJoCo takes axes in the child's frame
            add_joint(b.at + i, names[i], slide, spatial(rotate(axis, np.array(-angle))), np.zeros(2))
        if b.kind != "prismatic":
            add_joint(b.at + len(slides), names[-1], hinge, [0.0, 0.0, 1.0], b.anchor)

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
            self.bodies[point.link].add_site(name=self.sites[key], pos=spatial(point.local))
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
                tendon = self._add_tendon(f"{a.name} to {b.name}", a, b)
                set_spring(tendon, law.k, law.c)
                tendon.springlength = [law.rest] * 2
                if law.bias:  # the constant part of the force law becomes an actuator without control
                    self._add_actuator((law.bias, 0.0, 0.0), trntype=self.mujoco.mjtTrn.mjTRN_TENDON, target=tendon.name)
            case AtSite():
                self._add_site_force(f)
            case OnJoints() if np.count_nonzero(f.row) == 1:
                return f
            case OnJoints():
                if f.row.any():
                    self._add_fixed_tendon(f)
            case _:
                assert_never(f)
        return None

    def _add_tendon(self, name: str, a: Point, b: Point) -> Any:
        tendon = self.spec.add_tendon(name=self._name("tendon", name))
        tendon.wrap_site(self._site(a))
        tendon.wrap_site(self._site(b))
        return tendon

    def _add_cylinder(self, driver: LengthDriver) -> tuple[LengthDriver, Any, Any]:
        tendon = self._add_tendon(driver.name, driver.a, driver.b)
        motor = self._add_actuator((0.0, 0.0, 0.0), trntype=self.mujoco.mjtTrn.mjTRN_TENDON, target=tendon.name)
        self._make_motor(motor)
        return driver, tendon, motor

    def add_motors(self) -> list[str]:
        """Replace constant forces by motors, whose controls are the forces, for an MJCF document that is used without this suite.

        Return the names of the forces that a control can change.
        """
        changed: list[str] = []
        for f in self.steady:
            if f.force.any():
                changed += f.names
                self.controls[self._add_motor(f)] = f.value
        for push, actuator in self.pushes:
            size = float(np.linalg.norm(push.direction))
            actuator.gear = [*(push.direction / size), 0.0, 0.0, 0.0, 0.0]
            self._make_motor(actuator)
            changed.append(push.name)
            self.controls[actuator.name] = size
        return changed

    def _add_motor(self, f: Steady) -> str:
        """Add a motor for a constant generalised force on one joint or on a weighted sum of joints, and return the motor's name."""
        name = self._name("actuator", f.names[0] if f.names else "torque")
        joints = [(self.joints[int(at)].name, float(f.force[at])) for at in np.flatnonzero(f.force)]
        if len(joints) == 1:
            kind = self.mujoco.mjtTrn.mjTRN_JOINT
            [(target, gear)] = joints
        else:
            kind, gear = self.mujoco.mjtTrn.mjTRN_TENDON, 1.0
            tendon = self.spec.add_tendon(name=self._name("tendon", name))
            target = tendon.name
            for joint, coefficient in joints:
                tendon.wrap_joint(joint, coefficient)
        actuator = self._add_actuator((0.0, 0.0, 0.0), trntype=kind, target=target, name=name)
        actuator.gear = [gear, 0.0, 0.0, 0.0, 0.0, 0.0]
        self._make_motor(actuator)
        return name

    def _make_motor(self, actuator: Any) -> None:
        actuator.gainprm = [1.0, *np.zeros(len(actuator.gainprm) - 1)]
        actuator.biastype, actuator.biasprm = self.mujoco.mjtBias.mjBIAS_NONE, np.zeros_like(actuator.biasprm)

    def _add_actuator(self, bias: tuple[float, float, float], **transmission: Any) -> Any:
        """Add an actuator with the force bias . [1, L, dL/dt], where L is the length of its transmission, and return it."""
        actuator = self.spec.add_actuator(**transmission)
        actuator.gainprm = np.zeros_like(actuator.gainprm)  # the control has no effect
        actuator.biastype = self.mujoco.mjtBias.mjBIAS_AFFINE
        actuator.biasprm = [*bias, *np.zeros(len(actuator.biasprm) - 3)]
        return actuator

    def _add_site_force(self, f: AtSite) -> None:
        name, target = self._name("actuator", f.name), self._site(f.point)
        actuator = self._add_actuator(f.bias, trntype=self.mujoco.mjtTrn.mjTRN_SITE, target=target, name=name)
        if f.frame is not None:
            actuator.refsite = self._site(f.frame)
        actuator.gear = [*f.direction, 0.0, 0.0, 0.0, 0.0]
        if f.constant:
            self.pushes.append((f, actuator))

    def _add_fixed_tendon(self, f: OnJoints) -> None:
        """Add a spring and damper on a sum of joint coordinates.

        Trap: MuJoCo reads a rest length of -1 as "the length at qpos0". So if the rest length is negative, the signs of the rest
        length and of all coefficients of the sum are reversed.
        """
        rest = f.rest - f.constant
        sign = -1.0 if rest < 0 else 1.0
        tendon = self.spec.add_tendon()
        for at in np.flatnonzero(f.row):
            tendon.wrap_joint(self.joints[int(at)].name, sign * f.row[at])
        set_spring(tendon, f.k, f.c)
        tendon.springlength = [sign * rest] * 2

    def _set_joint_springs(self, springs: list[OnJoints]) -> None:
        """Sum the springs and dampers on each joint.

        A spring acts on x = row . y + constant, where the row has a single entry, 1 or -1. The joint's rest position follows from
        the springs' forces at y = 0.
        """
        by_joint: defaultdict[int, list[OnJoints]] = defaultdict(list)
        for f in springs:
            by_joint[int(np.flatnonzero(f.row)[0])].append(f)
        for at, forces in by_joint.items():
            k, joint = sum(f.k for f in forces), self.joints[at]
            force_at_zero = sum(f.k * (f.rest - f.constant) * f.row[at] for f in forces)
            set_spring(joint, k, sum(f.c for f in forces))
            joint.springref = force_at_zero / k if k else 0.0


def pose_in_parent(b: Branch, y: Array) -> tuple[Array, float]:
    """Return the origin (2,) [m] and angle [rad] of a branch's link in its parent's frame, at tree coordinates y (n,)."""
    if b.kind == "free":
        return y[b.at : b.at + 2], float(y[b.at + 2])
    displacement = b.base + y[b.at] * b.axis if b.kind == "prismatic" else np.zeros(2)
    angle = b.turn if b.kind == "prismatic" else float(y[b.at])
    return b.parent_anchor + displacement - rotate(b.anchor, np.array(angle)), angle
