"""The forces that a library is given at every step because it has no element for them.

They are computed in Python at the state with which a step begins: as forces on the tree coordinates,

    constant - stiffness y - damping y'

and, where they are no laws on those, as forces on links at their centres of mass.
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from gauss_bench.engines.tree import Tree
from gauss_bench.engines.tree_loads import OnJoints, OtherLoad, Steady, sort_loads
from gauss_bench.mechanism.forces import AppliedForces
from gauss_bench.mechanism.model import Mechanism
from gauss_bench.terms import Array


def on_one_joint(load: OnJoints) -> bool:
    """Tell whether a spring or damper acts on at most one tree coordinate."""
    return int(np.count_nonzero(load.row)) <= 1


def split_load(load: OnJoints) -> list[OnJoints]:
    """Return the spring and the damper of a load, as far as it has them."""
    return [x for x in (replace(load, c=0.0), replace(load, k=0.0)) if x.k or x.c]


class GivenForces:
    """The forces of a mechanism that a library is given, and the springs and dampers that it has itself.

    Attributes:
        own: springs and dampers that the library has.
        constant: (n,); stiffness, damping: (n, n).
        others: the forces that are no laws on tree coordinates, or that vary; None if there are none.
    """

    def __init__(self, mechanism: Mechanism, tree: Tree, is_own: Callable[[OnJoints], bool]):
        loads = sort_loads(mechanism, tree)
        beyond = {x.name for x in loads if isinstance(x, OtherLoad)}  # forces that are no laws on tree coordinates
        within = [x for x in loads if isinstance(x, OnJoints) and x.name not in beyond]
        springs = [part for load in within for part in split_load(load)]
        self.tree, self.own = tree, [x for x in springs if is_own(x)]
        self.constant, self.stiffness, self.damping = np.zeros(tree.n), np.zeros((tree.n, tree.n)), np.zeros((tree.n, tree.n))
        for load in loads:
            if isinstance(load, Steady) and not beyond & {*load.names}:
                self.constant += load.value * load.force
        for x in springs:
            if x not in self.own:
                self.stiffness += x.k * np.outer(x.row, x.row)
                self.damping += x.c * np.outer(x.row, x.row)
                self.constant += x.k * (x.rest - x.constant) * x.row
        others = tuple(f for f in mechanism.forces if f.name in beyond or f in mechanism.varying)
        self.others = AppliedForces(replace(mechanism, forces=others, gravity=np.zeros(2))) if others else None

    @property
    def joint_damping(self) -> Array:
        """The library's own damping (n,) of the joints."""
        return sum((x.c * np.abs(x.row) for x in self.own), np.zeros(self.tree.n))

    @property
    def are_constant(self) -> bool:
        """Whether they are the same at every state and time."""
        return self.others is None and not self.stiffness.any() and not self.damping.any()

    def on_joints(self, y: Array, dy: Array) -> Array:
        """Return the forces (n,) of laws on tree coordinates, at a tree state y, dy (n,)."""
        return np.asarray(self.constant - self.stiffness @ y - self.damping @ dy)

    def on_links(self, t: float, y: Array, dy: Array) -> Array | None:
        """Return all other forces as forces and torques on the links (3 links,) at time t [s]; None if there are none."""
        if self.others is None:
            return None
        q, v, _ = self.tree.absolute(y, dy, np.zeros_like(y))
        return self.others.generalised(q, v, t)

    def __call__(self, t: float, y: Array, dy: Array) -> Array:
        """Return all of them as forces (n,) on the tree coordinates."""
        on_links = self.on_links(t, y, dy)
        if on_links is None:
            return self.on_joints(y, dy)
        q, _, _ = self.tree.absolute(y, dy, np.zeros_like(y))
        return np.asarray(self.on_joints(y, dy) + self.tree.forces(q, on_links))
