"""The forces that DART is given at every step because it has no element for them, or because a setting wants them explicit.

DART's only springs and dampers are those of one joint coordinate, and it treats them implicitly. All others are computed here, in
Python, at the state with which a step begins: as forces on the tree coordinates, or on links at their centres of mass.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from gauss_bench.engines.tree import Tree
from gauss_bench.engines.tree_loads import OnJoints, OtherLoad, Steady, sort_loads
from gauss_bench.mechanism.forces import AppliedForces
from gauss_bench.mechanism.model import Mechanism
from gauss_bench.terms import Array

IMPLICIT, EXPLICIT = "implicit", "explicit"  # values of the knob `joint_forces`


def on_one_joint(load: OnJoints) -> bool:
    """Tell whether DART has a spring and damper for a load: it acts on at most one tree coordinate."""
    return int(np.count_nonzero(load.row)) <= 1


class GivenForces:
    """The forces of a mechanism that DART is given, and the springs and dampers that it has itself.

    Attributes:
        steady: (n,) constant generalised force.
        own: loads for which DART has springs and dampers of joints.
    """

    def __init__(self, mechanism: Mechanism, tree: Tree, joint_forces: str):
        loads = sort_loads(mechanism, tree)
        beyond = {x.name for x in loads if isinstance(x, OtherLoad)}  # forces that are no laws on tree coordinates
        springs = [x for x in loads if isinstance(x, OnJoints) and x.name not in beyond]
        self.tree = tree
        self.steady = np.zeros(tree.n)
        for load in loads:
            if isinstance(load, Steady) and not beyond & {*load.names}:
                self.steady += load.value * load.force
        self.own = [x for x in springs if joint_forces == IMPLICIT and on_one_joint(x)]
        self.stiffness, self.damping, self.preload = _combine([x for x in springs if x not in self.own], tree.n)
        others = tuple(f for f in mechanism.forces if f.name in beyond or f in mechanism.varying)
        self.others = AppliedForces(replace(mechanism, forces=others, gravity=np.zeros(2))) if others else None

    @property
    def change(self) -> bool:
        """Whether they depend on state or time, so that they are computed at every step."""
        return bool(self.others or self.stiffness.any() or self.damping.any())

    def on_joints(self, y: Array, dy: Array) -> Array:
        """Return the generalised forces (n,) of steady forces and of springs and dampers at a tree state y, dy (n,)."""
        return np.asarray(self.steady + self.preload - self.stiffness @ y - self.damping @ dy)

    def on_links(self, t: float, y: Array, dy: Array) -> Array | None:
        """Return all other forces as forces and torques on the links (3 links,) at time t [s]; None if there are none."""
        if self.others is None:
            return None
        q, v, _ = self.tree.absolute(y, dy, np.zeros_like(y))
        return self.others.generalised(q, v, t)


def _combine(springs: Sequence[OnJoints], n: int) -> tuple[Array, Array, Array]:
    """Return K (n, n), C (n, n) and p (n,) such that the springs and dampers exert p - K y - C dy."""
    stiffness, damping, preload = np.zeros((n, n)), np.zeros((n, n)), np.zeros(n)
    for x in springs:
        stiffness += x.k * np.outer(x.row, x.row)
        damping += x.c * np.outer(x.row, x.row)
        preload += x.k * (x.rest - x.constant) * x.row
    return stiffness, damping, preload
