"""The spanning tree of a linkage and the joints it leaves open, for engines in relative coordinates.

Each link hangs on its parent by one branch with one coordinate (a free link by three):

    revolute    theta = theta_parent + y,     the child's anchor stays on the parent's
    prismatic   theta = theta_parent + turn,  child's anchor = parent's anchor + R_parent (base + y axis)
    free        x, y, theta of the centre of mass

Slides are taken into the tree before pins, so that what is left open are pins wherever possible. Branches are listed depth first.
States are mapped for one state (n,) or a batch (..., n).
"""

from dataclasses import dataclass

import numpy as np

from gauss_bench.mechanism.model import GROUND, Joint, Mechanism, Prismatic, Revolute
from gauss_bench.terms import Array


@dataclass(frozen=True, eq=False)
class Branch:
    """How a link hangs on its parent.

    Attributes:
        link, parent: indices; parent may be GROUND.
        kind: "revolute", "prismatic" or "free".
        joint: the joint of the linkage, or None for a free link.
        at: first tree coordinate of the branch.
        parent_anchor, anchor: (2,) in the frames of the centres of mass of parent and link [m].
        base, axis: (2,) in the parent's frame; turn: constant relative angle [rad]. For prismatic branches.
    """

    link: int
    parent: int
    kind: str
    joint: Joint | None
    at: int
    parent_anchor: Array
    anchor: Array
    base: Array
    axis: Array
    turn: float


@dataclass(frozen=True, eq=False)
class Tree:
    """Branches in depth-first order and the joints left open ("closures"); `n` counts tree coordinates."""

    branches: tuple[Branch, ...]
    closures: tuple[Joint, ...]
    n: int
    links: int

    def absolute(self, y: Array, dy: Array, ddy: Array) -> tuple[Array, Array, Array]:
        """q, v, a (..., 3 links) of tree states (..., n)."""
        shape = (*y.shape[:-1], self.links + 1, 3)  # the last, resting, link is the ground
        q, v, a = np.zeros(shape), np.zeros(shape), np.zeros(shape)
        for b in self.branches:
            _place(b, y, dy, ddy, q, v, a)
        flat = (*y.shape[:-1], 3 * self.links)
        return q[..., :-1, :].reshape(flat), v[..., :-1, :].reshape(flat), a[..., :-1, :].reshape(flat)

    def relative(self, q: Array, v: Array) -> tuple[Array, Array]:
        """Tree coordinates and rates (..., n) of absolute states (..., 3 links); what leaves the tree's joints is ignored."""
        y, dy = np.zeros((*q.shape[:-1], self.n)), np.zeros((*q.shape[:-1], self.n))
        for b in self.branches:
            child, rate = q[..., 3 * b.link : 3 * b.link + 3], v[..., 3 * b.link : 3 * b.link + 3]
            if b.kind == "free":
                y[..., b.at : b.at + 3], dy[..., b.at : b.at + 3] = child, rate
                continue
            parent, parent_rate = _parent_state(b, q), _parent_state(b, v)
            if b.kind == "revolute":
                y[..., b.at], dy[..., b.at] = child[..., 2] - parent[..., 2], rate[..., 2] - parent_rate[..., 2]
                continue
            axis, start = _rotate(b.axis, parent[..., 2]), _rotate(b.parent_anchor + b.base, parent[..., 2])
            arm = _rotate(b.anchor, child[..., 2])
            w, w_child = parent_rate[..., 2, None], rate[..., 2, None]
            gap = child[..., :2] + arm - parent[..., :2] - start
            gap_rate = rate[..., :2] + w_child * _quarter(arm) - parent_rate[..., :2] - w * _quarter(start)
            y[..., b.at] = (axis * gap).sum(-1)
            dy[..., b.at] = (axis * gap_rate + w * _quarter(axis) * gap).sum(-1)
        return y, dy

    def forces(self, q: Array, Q: Array) -> Array:
        """Tree generalised forces (..., n) with the same virtual work as absolute forces Q (..., 3 links) at state q."""
        tau = np.zeros((*q.shape[:-1], self.n))
        load = np.zeros((*q.shape[:-1], self.links + 1, 3))
        load[..., :-1, :] = Q.reshape(*q.shape[:-1], self.links, 3)
        for b in reversed(self.branches):
            own = load[..., b.link, :]
            if b.kind == "free":
                tau[..., b.at : b.at + 3] = own
                continue
            child, parent = q[..., 3 * b.link : 3 * b.link + 3], _parent_state(b, q)
            if b.kind == "revolute":
                tau[..., b.at] = own[..., 2] - _cross(_rotate(b.anchor, child[..., 2]), own[..., :2])
            else:
                tau[..., b.at] = (_rotate(b.axis, parent[..., 2]) * own[..., :2]).sum(-1)
            load[..., b.parent, :2] += own[..., :2]
            load[..., b.parent, 2] += own[..., 2] + _cross(child[..., :2] - parent[..., :2], own[..., :2])
        return tau


def _quarter(x: Array) -> Array:
    return np.stack((-x[..., 1], x[..., 0]), axis=-1)


def _rotate(x: Array, theta: Array) -> Array:
    c, s = np.cos(theta), np.sin(theta)
    return np.stack((c * x[0] - s * x[1], s * x[0] + c * x[1]), axis=-1)


def _cross(a: Array, b: Array) -> Array:
    return np.asarray(a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0])


def _parent_state(b: Branch, x: Array) -> Array:
    return np.zeros((*x.shape[:-1], 3)) if b.parent == GROUND else x[..., 3 * b.parent : 3 * b.parent + 3]


def _place(b: Branch, y: Array, dy: Array, ddy: Array, q: Array, v: Array, a: Array) -> None:
    """Fill in the absolute state of one branch's link; arrays are (..., links + 1, 3)."""
    i = b.link
    if b.kind == "free":
        part = slice(b.at, b.at + 3)
        q[..., i, :], v[..., i, :], a[..., i, :] = y[..., part], dy[..., part], ddy[..., part]
        return
    p, w, alpha = q[..., b.parent, :], v[..., b.parent, 2, None], a[..., b.parent, 2, None]
    s, ds, dds = y[..., b.at, None], dy[..., b.at, None], ddy[..., b.at, None]
    arm = _rotate(b.parent_anchor, p[..., 2])
    slide_v, slide_a = np.zeros(2), np.zeros(2)
    if b.kind == "revolute":
        turn, turn_v, turn_a = y[..., b.at], dy[..., b.at], ddy[..., b.at]
    else:
        turn, turn_v, turn_a = np.array(b.turn), np.zeros(()), np.zeros(())
        axis = _rotate(b.axis, p[..., 2])
        arm = arm + _rotate(b.base, p[..., 2]) + s * axis
        slide_v, slide_a = ds * axis, dds * axis + 2 * w * ds * _quarter(axis)
    q[..., i, 2] = p[..., 2] + turn
    v[..., i, 2] = v[..., b.parent, 2] + turn_v
    a[..., i, 2] = a[..., b.parent, 2] + turn_a
    own = -_rotate(b.anchor, q[..., i, 2])
    wi, alpha_i = v[..., i, 2, None], a[..., i, 2, None]
    q[..., i, :2] = p[..., :2] + arm + own
    v[..., i, :2] = v[..., b.parent, :2] + w * _quarter(arm) + slide_v + wi * _quarter(own)
    a[..., i, :2] = a[..., b.parent, :2] + alpha * _quarter(arm) - w**2 * arm + slide_a + alpha_i * _quarter(own) - wi**2 * own


def ends(joint: Joint) -> tuple[int, int]:
    """The two links of a pair: guide and block, or a and b."""
    return (joint.guide.link, joint.block.link) if isinstance(joint, Prismatic) else (joint.a.link, joint.b.link)


def spanning_tree(mechanism: Mechanism) -> Tree:
    """The tree that takes slides first, then pins in file order; links not held by any joint to the ground start free."""
    group = {i: i for i in range(GROUND, len(mechanism.links))}
    chosen: list[Joint] = []
    for joint in sorted(mechanism.joints, key=lambda j: isinstance(j, Revolute)):
        a, b = (group[i] for i in ends(joint))
        if a != b:
            chosen.append(joint)
            group = {i: a if g == b else g for i, g in group.items()}
    branches: list[Branch] = []
    reached = {GROUND}
    count = 0
    order = {id(joint): k for k, joint in enumerate(mechanism.joints)}
    chosen.sort(key=lambda j: order[id(j)])

    def descend(parent: int) -> None:
        nonlocal count
        for joint in chosen:
            if parent in ends(joint):
                child = next(i for i in ends(joint) if i != parent)
                if child not in reached:
                    reached.add(child)
                    branches.append(_branch(joint, parent, child, count))
                    count += 1
                    descend(child)

    descend(GROUND)
    none = np.zeros(2)
    for i in range(len(mechanism.links)):
        if i not in reached:
            reached.add(i)
            branches.append(Branch(i, GROUND, "free", None, count, none, none, none, none, 0.0))
            count += 3
            descend(i)
    closures = tuple(j for j in mechanism.joints if all(j is not b.joint for b in branches))
    return Tree(tuple(branches), closures, count, len(mechanism.links))


def _branch(joint: Joint, parent: int, child: int, at: int) -> Branch:
    none = np.zeros(2)
    if isinstance(joint, Revolute):
        near, far = (joint.a, joint.b) if joint.a.link == parent else (joint.b, joint.a)
        return Branch(child, parent, "revolute", joint, at, near.local, far.local, none, none, 0.0)
    forward = joint.guide.link == parent
    near, far = (joint.guide, joint.block) if forward else (joint.block, joint.guide)
    theta, sign = (joint.angle, 1.0) if forward else (joint.angle - joint.turn, -1.0)
    u = np.array([np.cos(theta), np.sin(theta)])
    base = sign * joint.offset * _quarter(u)
    return Branch(child, parent, "prismatic", joint, at, near.local, far.local, base, sign * u, sign * joint.turn)
