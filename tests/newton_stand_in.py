"""A stand-in for Newton and Warp: the calls that the adapter makes of them, with Kamino's step in the plane.

The step is M (v1 - v) = h Q + J^T lambda with J v1 = -alpha phi / h, and q1 = q + h v1; redundant rows get the least lambda.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from types import SimpleNamespace
from typing import Any

import numpy as np

from gauss_bench.mechanism.spaces import angles, places
from gauss_bench.terms import Array

Transform = tuple[Array, float]  # origin (2,) and angle
GROUND = -1


class Data:
    """An array of Warp."""

    def __init__(self, shape: tuple[int, ...]):
        self.values = np.zeros(shape)

    def assign(self, values: Array) -> None:
        assert values.dtype == np.float32
        self.values = np.array(values, dtype=float)

    def numpy(self) -> Array:
        return self.values


@dataclass
class Builder:
    up_axis: str
    gravity: tuple[float, float, float]
    masses: list[list[float]] = field(default_factory=list)
    joints: list[tuple[str, int, int, Transform, Transform]] = field(default_factory=list)
    inside: list[int] = field(default_factory=list)

    def add_link(self, xform: Transform, mass: float, inertia: Array, lock_inertia: bool) -> int:
        assert lock_inertia
        self.masses.append([mass, mass, inertia[2, 2]])
        return len(self.masses) - 1

    def _add(self, kind: str, parent: int, child: int, near: Transform, far: Transform) -> int:
        assert child != GROUND
        self.joints.append((kind, parent, child, near, far))
        return len(self.joints) - 1

    def add_joint_revolute(self, parent: int, child: int, parent_xform: Transform, child_xform: Transform, axis: str) -> int:
        assert axis == "Z"
        return self._add("revolute", parent, child, parent_xform, child_xform)

    def add_joint_prismatic(self, parent: int, child: int, parent_xform: Transform, child_xform: Transform, axis: str) -> int:
        assert axis == "X"
        return self._add("prismatic", parent, child, parent_xform, child_xform)

    def add_joint_free(self, child: int) -> int:
        nowhere = np.zeros(2), 0.0
        return self._add("free", GROUND, child, nowhere, nowhere)

    def add_articulation(self, joints: list[int]) -> None:
        self.inside = joints

    def replicate(self, other: "Builder", copies: int) -> None:
        """Take copies of another model, none of which a joint connects with another."""
        assert sorted(other.joints[k][2] for k in other.inside) == list(range(len(other.masses)))  # a tree reaches each link once
        for copy in range(copies):
            self.masses += other.masses
            for kind, parent, child, near, far in other.joints:
                first = copy * len(other.masses)
                self.joints.append((kind, parent if parent == GROUND else parent + first, child + first, near, far))

    rigid_contact_max: int = 1000

    def finalize(self, device: str) -> "Builder":
        assert device == "cpu"
        return self

    def control(self) -> None:
        return None

    def state(self) -> Any:
        n = len(self.masses)
        return SimpleNamespace(body_q=Data((n, 7)), body_qd=Data((n, 6)), body_f=Data((n, 6)))


class Capture:
    """A recording of calls, which are carried out when it is launched."""

    now: "Capture | None" = None

    def __init__(self, device: str):
        assert device == "cpu"
        self.graph: list[Callable[[], None]] = []

    def __enter__(self) -> "Capture":
        Capture.now = self
        return self

    def __exit__(self, *_: object) -> None:
        Capture.now = None


def launch(graph: list[Callable[[], None]]) -> None:
    for call in graph:
        call()


class Kamino:
    """The solver; it says that it converged unless `fails` is set."""

    fails = False

    def __init__(self, model: Builder, config: Any):
        self.model, self.alpha = model, config.constraints.alpha
        self.status = SimpleNamespace(numpy=lambda: {"converged": np.array([not Kamino.fails])})

    def step(self, now: Any, after: Any, control: None, contacts: None, h: float) -> None:
        assert Capture.now is not None  # outside of a recording it would take as long as Newton's own does
        Capture.now.graph.append(lambda: self.take_step(now, after, h))

    def take_step(self, now: Any, after: Any, h: float) -> None:
        model = self.model
        poses, speeds, wrenches = (x.numpy() for x in (now.body_q, now.body_qd, now.body_f))
        q, v, Q = (np.zeros(3 * len(poses)) for _ in range(3))
        places(q)[:], angles(q)[:] = poses[:, :2], 2 * np.arctan2(poses[:, 5], poses[:, 6])
        for x, given in ((v, speeds), (Q, wrenches)):
            places(x)[:], angles(x)[:] = given[:, :2], given[:, 5]
        mass = np.ravel(model.masses)
        places(Q)[:] += places(mass) * model.gravity[:2]
        rows = [row for joint in model.joints for row in constrain(q, *joint)]
        v = v + h * Q / mass
        if rows:
            J, phi = np.array([x for x, _ in rows]), np.array([x for _, x in rows])
            v = v - np.linalg.lstsq(J / np.sqrt(mass), J @ v + self.alpha * phi / h, rcond=1e-10)[0] / np.sqrt(mass)
        q = q + h * v
        after.body_q.values, after.body_qd.values = np.zeros_like(poses), np.zeros_like(speeds)
        after.body_q.values[:, :2], after.body_qd.values[:, :2], after.body_qd.values[:, 5] = places(q), places(v), angles(v)
        after.body_q.values[:, 5], after.body_q.values[:, 6] = np.sin(angles(q) / 2), np.cos(angles(q) / 2)


def constrain(q: Array, kind: str, parent: int, child: int, near: Transform, far: Transform) -> list[tuple[Array, float]]:
    """Return row (n,) and gap of each constraint of a joint at q (n,)."""
    if kind == "free":
        return []
    gap, turn = np.zeros(2), 0.0
    slopes, turns = np.zeros((2, len(q))), np.zeros(len(q))  # of gap and turn
    for sign, body, (origin, angle) in ((-1, parent, near), (1, child, far)):
        x, y, theta = (0.0, 0.0, 0.0) if body == GROUND else q[3 * body : 3 * body + 3]
        arm = rotate(origin, theta)
        gap += sign * (np.array([x, y]) + arm)
        turn += sign * (theta + angle)
        if body != GROUND:
            slopes[0, 3 * body], slopes[1, 3 * body + 1], slopes[:, 3 * body + 2] = sign, sign, [-sign * arm[1], sign * arm[0]]
            turns[3 * body + 2] = sign
    if kind == "revolute":
        return [(slopes[0], gap[0]), (slopes[1], gap[1])]
    theta = near[1] + (0.0 if parent == GROUND else q[3 * parent + 2])
    across, along = rotate(np.array([0.0, 1.0]), theta), rotate(np.array([1.0, 0.0]), theta)
    row = across @ slopes
    if parent != GROUND:
        row[3 * parent + 2] -= along @ gap  # the line turns with the parent
    whole = 2 * np.pi
    return [(row, float(across @ gap)), (turns, turn - whole * np.round(turn / whole))]


def rotate(x: Array, angle: float) -> Array:
    cosine, sine = np.cos(angle), np.sin(angle)
    return np.array([cosine * x[0] - sine * x[1], sine * x[0] + cosine * x[1]])


def to_transform(origin: Array, turn: tuple[float, ...]) -> Transform:
    return origin, 2 * float(np.arctan2(turn[2], turn[3]))


warp = SimpleNamespace(
    mat33=lambda *x: np.reshape(x, (3, 3)),
    vec3=lambda x, y, z: np.array([x, y]),
    quat=lambda *x: x,
    transform=to_transform,
    config=SimpleNamespace(kernel_cache_dir=None, quiet=False),
    set_device=lambda name: None,
    ScopedCapture=Capture,
    capture_launch=launch,
)
newton = SimpleNamespace(
    ModelBuilder=Builder, Axis=SimpleNamespace(X="X", Y="Y", Z="Z"), solvers=SimpleNamespace(SolverKamino=Kamino)
)
Kamino.Config = lambda dynamics_solver: SimpleNamespace(constraints=SimpleNamespace(alpha=0.01))  # type: ignore[attr-defined]
