"""Forces for which a library has no element: the adapter computes them in Python and gives them to the library at every step.

The forces are those of the state at which the step begins. Springs and dampers on tree coordinates y exert forces on these
coordinates,

    constant - stiffness y - damping y'

All other forces act on links at their centres of mass.
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
    """Tell whether a spring or damper acts on one tree coordinate (or on none), not on a sum of several."""
    return int(np.count_nonzero(load.row)) <= 1


class GivenForces:
    """The forces that an adapter gives to its library, and the springs and dampers that are elements of the library.

    Attributes:
        own: springs and dampers that are elements of the library.
        constant: (n,) constant part of the given forces on tree coordinates [N, N m].
        stiffness, damping: (n, n) matrices of the given forces on tree coordinates.
        others: given forces that vary with time or with the direction of motion, or that cannot be written as springs and dampers
            on tree coordinates; None if there are none.
    """

    def __init__(self, mechanism: Mechanism, tree: Tree, is_own: Callable[[OnJoints], bool]):
        """Sort the forces of a mechanism; `is_own` tells whether the library has an element for a spring or damper."""
        loads = sort_loads(mechanism, tree)
        # A force may have several loads. If one of them is an OtherLoad, the whole force is given as a force on links. All other
        # springs and dampers are elements of the library (`own`), or are summed in `stiffness`, `damping` and `constant`.
        on_links = {x.name for x in loads if isinstance(x, OtherLoad)}
        on_joints = [x for x in loads if isinstance(x, OnJoints) and x.name not in on_links]
        springs: list[OnJoints] = []
        for on_joint in on_joints:  # split: the library may have an element for the spring of a load and none for its damper
            springs += [x for x in (replace(on_joint, c=0.0), replace(on_joint, k=0.0)) if x.k or x.c]
        self.tree, self.own = tree, [x for x in springs if is_own(x)]
        self.constant, self.stiffness, self.damping = np.zeros(tree.n), np.zeros((tree.n, tree.n)), np.zeros((tree.n, tree.n))
        for load in loads:
            if isinstance(load, Steady) and not on_links & {*load.names}:
                self.constant += load.value * load.force
        for x in springs:
            if x not in self.own:  # k (rest - L) - c dL/dt along the row, with L = row . y + constant
                self.stiffness += x.k * np.outer(x.row, x.row)
                self.damping += x.c * np.outer(x.row, x.row)
                self.constant += x.k * (x.rest - x.constant) * x.row
        others = tuple(f for f in mechanism.forces if f.name in on_links or f in mechanism.varying)
        self.others = AppliedForces(replace(mechanism, forces=others, gravity=np.zeros(2))) if others else None

    @property
    def joint_damping(self) -> Array:
        """Damping coefficients (n,) [N s/m, N m s/rad] on the tree coordinates, of dampers that are elements of the library."""
        return sum((x.c * np.abs(x.row) for x in self.own), np.zeros(self.tree.n))

    @property
    def are_constant(self) -> bool:
        """Whether the given forces are the same at every state and time."""
        return self.others is None and not self.stiffness.any() and not self.damping.any()

    def on_joints(self, y: Array, dy: Array) -> Array:
        """Return the given forces (n,) that `constant`, `stiffness` and `damping` describe, at a tree state y, dy (n,)."""
        return np.asarray(self.constant - self.stiffness @ y - self.damping @ dy)

    def on_links(self, t: float, y: Array, dy: Array) -> Array | None:
        """Return the forces and torques (3 links,) of `others` at the centres of mass, at t [s], y, dy (n,), or None."""
        if self.others is None:
            return None
        q, v, _ = self.tree.absolute(y, dy, np.zeros_like(y))
        return self.others.generalised(q, v, t)

    def __call__(self, t: float, y: Array, dy: Array) -> Array:
        """Return the generalised forces (n,) on tree coordinates of all given forces together, at time t [s] and y, dy (n,)."""
        if self.others is None:
            return self.on_joints(y, dy)
        q, v, _ = self.tree.absolute(y, dy, np.zeros_like(y))
        return np.asarray(self.on_joints(y, dy) + self.tree.forces(q, self.others.generalised(q, v, t)))
