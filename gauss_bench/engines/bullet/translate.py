"""What Bullet is given of a linkage: a tree of joints, and the forces and torques that act in these joints.

Bullet has no springs, and forgets every force after the step. So all forces of a linkage are given as forces of the tree's joints,
computed in Python at the beginning of each step, as users of PyBullet do:

    tau = constant - stiffness y - damping y' + V^T Q(q, v, t)

where V maps the rates of the tree coordinates y to absolute speeds, and Q are the forces that are no linear law on y. A damper that
acts on one joint alone is Bullet's own joint damping instead.
"""

from dataclasses import dataclass, replace

import numpy as np

from gauss_bench.engines.shared import beyond_a_tree, driven_coordinates
from gauss_bench.engines.tree import Tree
from gauss_bench.engines.tree_loads import OnJoints, OtherLoad, Steady, sort_loads
from gauss_bench.mechanism.forces import AppliedForces
from gauss_bench.mechanism.model import LengthDriver, Mechanism, factor_of
from gauss_bench.terms import Array


def refusal(mechanism: Mechanism, tree: Tree, coordinates: str) -> str | None:
    """Return the reason why Bullet cannot model a mechanism, or None if it can.

    Args:
        coordinates: "tree" for joints, or "bodies" for free bodies.
    """
    if reason := beyond_a_tree(mechanism, "Bullet"):
        return reason
    if coordinates == "bodies":
        if mechanism.slides:
            return f"Bullet has no slide between free bodies ({mechanism.slides[0].name})"
        return "Bullet has motors in the joints of a tree, and none between free bodies" if mechanism.drivers else None
    for driver in mechanism.drivers:
        if isinstance(driver, LengthDriver):
            return f"Bullet has motors in joints, and none for the length {driver.name}"
    if None in driven_coordinates(mechanism, tree):
        return "Bullet has motors in the joints of its tree, and the driven angle is none"
    return None


@dataclass(frozen=True, eq=False)
class JointForces:
    """The forces of a linkage on the coordinates of its tree.

    Attributes:
        constant: (n,).
        stiffness, damping: (n, n), without the dampers of `joint_damping`.
        joint_damping: (n,) of the dampers that act on one coordinate alone.
        others: the forces that are no linear law on tree coordinates, or that vary; None if there are none.
    """

    tree: Tree
    constant: Array
    stiffness: Array
    damping: Array
    joint_damping: Array
    others: AppliedForces | None

    @property
    def are_constant(self) -> bool:
        """Whether the forces are the same at every state and time, except for the joint damping."""
        return self.others is None and not self.stiffness.any() and not self.damping.any()

    def __call__(self, t: float, y: Array, dy: Array) -> Array:
        """Return the forces (n,) at a time [s] and a tree state y, dy (n,), without the joint damping."""
        tau: Array = self.constant - self.stiffness @ y - self.damping @ dy
        if self.others is not None:
            q, v, _ = self.tree.absolute(y, dy, np.zeros_like(y))
            tau = tau + self.tree.forces(q, self.others.generalised(q, v, t))
        return tau


def joint_forces(mechanism: Mechanism, tree: Tree) -> JointForces:
    """Return all applied forces of a mechanism, except gravity, on the coordinates of its tree."""
    n = tree.n
    constant, joint_damping, stiffness, damping = np.zeros(n), np.zeros(n), np.zeros((n, n)), np.zeros((n, n))
    others = {f.name for f in mechanism.forces if factor_of(f)}
    for load in sort_loads(mechanism, tree):
        match load:
            case Steady(force, value):
                constant += value * force
            case OnJoints(row, offset, k, c, rest):
                # k (rest - L) - c dL/dt acts along L = row . y + offset
                constant += k * (rest - offset) * row
                stiffness += k * np.outer(row, row)
                if np.count_nonzero(row) == 1:
                    joint_damping += c * np.abs(row)
                else:
                    damping += c * np.outer(row, row)
            case OtherLoad(name):
                others.add(name)
    if not others:
        return JointForces(tree, constant, stiffness, damping, joint_damping, None)
    forces = tuple(f for f in mechanism.forces if f.name in others)
    rest_of_them = AppliedForces(replace(mechanism, forces=forces, gravity=np.zeros(2)))
    return JointForces(tree, constant, stiffness, damping, joint_damping, rest_of_them)


class BodyForces:
    """A call (t, q, v) -> the forces (3 links,) at the centres of mass of free links, except gravity, which is Bullet's."""

    are_constant = False  # a run reads every state, because it counts the turns of links

    def __init__(self, mechanism: Mechanism):
        self.applied = AppliedForces(replace(mechanism, gravity=np.zeros(2)))
        self.constant = np.zeros(mechanism.n)

    def __call__(self, t: float, q: Array, v: Array) -> Array:
        return self.applied.generalised(q, v, t)
