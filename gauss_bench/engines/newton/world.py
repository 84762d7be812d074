"""A linkage in the library Newton: rigid bodies in absolute coordinates, and joints that its solver Kamino takes as constraints.

An articulation, an object of Newton, lists the joints of the spanning tree, and not those that close loops. Frames of links lie at
the links' centres of mass, and the linkage lies in the plane z = 0.

A step of h [s] from q, v uses the forces Q and the constraint Jacobian J at q, and the semi-implicit Euler method:

    M (v1 - v) = h Q + J^T lambda
    J v1 = -alpha phi / h
    q1 = q + h v1

One step launches hundreds of kernels (compiled functions). This takes 0.1 s if Python launches them, so Warp records the launches
once for each h, and replays them in C++.

Traps: Newton computes in single precision. For models without shapes, Kamino reserves memory for 1000 contacts; the option
`contacts` sets a smaller number.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np

from gauss_bench.engines.following import wind
from gauss_bench.engines.newton.kernels import Libraries
from gauss_bench.engines.shared import spatial
from gauss_bench.engines.tree import spanning_tree
from gauss_bench.mechanism.frames import unit
from gauss_bench.mechanism.model import GROUND, Joint, Mechanism, Prismatic
from gauss_bench.mechanism.spaces import angles, places
from gauss_bench.terms import Array

PLANE = slice(0, 2)  # x and y of a position, velocity or force
TURN = 5  # index of the rotation about z in a velocity or force (6,); a pose (7,) has sin and cos of half the angle at 5 and 6


def joint_frames(joint: Joint) -> tuple[tuple[Array, float], tuple[Array, float]]:
    """Return origin (2,) [m] and angle [rad] of a joint's frame in the first link, and of its frame in the second link.

    A pin lets the second frame turn about the first, and a slide lets it move along the first frame's x axis.
    """
    first, second = joint.ends
    if not isinstance(joint, Prismatic):
        return (first.local, 0.0), (second.local, 0.0)
    on_the_line = first.local + joint.offset * unit(joint.angle, across=True)
    return (on_the_line, joint.angle), (second.local, joint.angle - joint.turn)


class World:
    """A linkage, or several equal copies of it that do not touch each other, in the library Newton.

    States q, v and forces (3 * links * copies,) hold the entries of the first copy, then those of the second copy, and so on.
    `current` is Newton's object for the present state.
    """

    def __init__(self, libraries: Libraries, mechanism: Mechanism, options: Mapping[str, Any], copies: int = 1):
        """Build the copies at the start of the linkage.

        Option "alpha" is the share of a gap that a step closes, and "contacts" the largest number of contacts in each copy.
        """
        self.warp, self.newton = libraries.warp, libraries.newton
        common = {"up_axis": self.newton.Axis.Y, "gravity": tuple(spatial(mechanism.gravity))}
        self.builder, all_copies = self.newton.ModelBuilder(**common), self.newton.ModelBuilder(**common)
        self.bodies = {GROUND: -1}  # link -> the library's index of its body
        for k, link in enumerate(mechanism.links):
            inertia = self.warp.mat33(*(link.inertia * np.eye(3)).ravel().tolist())
            pose = self._frame(places(mechanism.q0)[k], angles(mechanism.q0)[k])
            self.bodies[k] = self.builder.add_link(xform=pose, mass=link.mass, inertia=inertia, lock_inertia=True)
        tree = spanning_tree(mechanism)
        tree_joints = []  # the library's indices of the articulation's joints, each from parent to child
        for branch in tree.branches:
            if branch.joint is None:
                tree_joints.append(self.builder.add_joint_free(child=self.bodies[branch.link]))
            else:
                tree_joints.append(self._add_joint(branch.joint, backwards=branch.joint.ends[0].link == branch.link))
        self.builder.add_articulation(tree_joints)
        for joint in tree.closures:
            # Newton refuses joints whose child is the ground
            self._add_joint(joint, backwards=joint.ends[1].link == GROUND)
        all_copies.replicate(self.builder, copies)
        model = all_copies.finalize(device="cpu")
        model.rigid_contact_max = options["contacts"] * copies
        settings = self.newton.solvers.SolverKamino.Config(dynamics_solver=options["dynamics_solver"])
        settings.constraints.alpha = options["alpha"]
        self.solver = self.newton.solvers.SolverKamino(model, config=settings)
        self.control, self.current = model.control(), model.state()
        self.graphs: dict[float, Any] = {}  # step size, in single precision [s] -> recorded step
        self.put(np.tile(mechanism.q0, copies), np.tile(mechanism.v0, copies))

    def _add_joint(self, joint: Joint, backwards: bool) -> int:
        """Add a joint and return the library's index of it; if `backwards`, the joint's second link is the parent."""
        ends = [(self.bodies[end.link], self._frame(*frame)) for end, frame in zip(joint.ends, joint_frames(joint), strict=True)]
        (parent, near), (child, far) = reversed(ends) if backwards else ends
        if isinstance(joint, Prismatic):
            add, axis = self.builder.add_joint_prismatic, self.newton.Axis.X
        else:
            add, axis = self.builder.add_joint_revolute, self.newton.Axis.Z
        return int(add(parent, child, parent_xform=near, child_xform=far, axis=axis))

    def _frame(self, origin: Array, angle: float) -> Any:
        """Return a frame in the plane, given by its origin (2,) [m] and angle [rad], as a transform of the library Warp."""
        turn = self.warp.quat(0.0, 0.0, float(np.sin(angle / 2)), float(np.cos(angle / 2)))
        return self.warp.transform(self.warp.vec3(*spatial(origin)), turn)

    def put(self, q: Array, v: Array) -> None:
        """Set the absolute state q, v (3 * links * copies,)."""
        self.angles = angles(q).copy()  # angles when they were last set or read: `state` counts turns from them
        # a pose is the position x, y, z and the quaternion x, y, z, w of a body
        poses, speeds = np.zeros((len(self.angles), 7)), np.zeros((len(self.angles), 6))
        poses[:, PLANE], speeds[:, PLANE], speeds[:, TURN] = places(q), places(v), angles(v)
        poses[:, 5], poses[:, 6] = np.sin(self.angles / 2), np.cos(self.angles / 2)
        self.current.body_q.assign(poses.astype(np.float32))
        self.current.body_qd.assign(speeds.astype(np.float32))

    def state(self) -> tuple[Array, Array]:
        """Return the absolute state q, v (3 * links * copies,); between two calls, no link may turn by half a turn or more."""
        poses, speeds = (np.asarray(x.numpy(), dtype=float) for x in (self.current.body_q, self.current.body_qd))
        q, v = np.empty(3 * len(poses)), np.empty(3 * len(poses))
        places(q)[:], places(v)[:] = poses[:, PLANE], speeds[:, PLANE]
        angles(q)[:], angles(v)[:] = wind(2 * np.arctan2(poses[:, 5], poses[:, 6]), self.angles), speeds[:, TURN]
        self.angles = angles(q).copy()
        return q, v

    def record(self, h: float) -> Any:
        """Return the recording of a step of h [s]; recording does not advance the state."""
        size = float(np.float32(h))  # sizes that differ only by double-precision rounding share a recording
        if size not in self.graphs:
            with self.warp.ScopedCapture(device="cpu") as capture:
                self.solver.step(self.current, self.current, self.control, None, size)
            self.graphs[size] = capture.graph
        return self.graphs[size]

    def step(self, forces: Array, h: float) -> bool:
        """Take a step of h [s] under forces (3 * links * copies,) besides gravity, and tell whether the solver converged."""
        wrenches = np.zeros((len(self.angles), 6), dtype=np.float32)
        wrenches[:, PLANE], wrenches[:, TURN] = places(forces), angles(forces)
        self.current.body_f.assign(wrenches)
        self.warp.capture_launch(self.record(h))
        return bool(self.solver.status.numpy()["converged"].all())
