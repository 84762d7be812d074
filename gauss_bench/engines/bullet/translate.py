"""What Bullet is given of a linkage: a tree of joints, and the forces and torques that act in these joints.

Bullet has no springs, and forgets every force after the step. So all forces of a linkage are given as forces of the tree's joints,
computed in Python at the beginning of each step, as users of PyBullet do:

    tau = constant - stiffness y - damping y' + V^T Q(q, v, t)

where V maps the rates of the tree coordinates y to absolute speeds, and Q are the forces that are no linear law on y. A damper that
acts on one joint alone is Bullet's own joint damping instead.
"""

from dataclasses import replace

import numpy as np

from gauss_bench.engines.given_forces import GivenForces, on_one_joint
from gauss_bench.engines.shared import beyond_a_tree, undriven
from gauss_bench.engines.tree import Tree
from gauss_bench.mechanism.forces import AppliedForces
from gauss_bench.mechanism.model import Mechanism
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
    return undriven(mechanism, tree, "Bullet")


def joint_forces(mechanism: Mechanism, tree: Tree) -> GivenForces:
    """Return all applied forces of a mechanism, except gravity, on the coordinates of its tree."""
    return GivenForces(mechanism, tree, lambda load: not load.k and on_one_joint(load))


class BodyForces:
    """A call (t, q, v) -> the forces (3 links,) at the centres of mass of free links, except gravity, which is Bullet's."""

    are_constant = False  # a run reads every state, because it counts the turns of links

    def __init__(self, mechanism: Mechanism):
        self.applied = AppliedForces(replace(mechanism, gravity=np.zeros(2)))
        self.constant = np.zeros(mechanism.n)

    def __call__(self, t: float, q: Array, v: Array) -> Array:
        return self.applied.generalised(q, v, t)
