"""Compute the forces that the adapter gives to Bullet.

Bullet has no springs, and forgets every force after a step. Therefore the adapter computes all forces in Python at the beginning of
each step, as users of PyBullet do. Free bodies get forces on the links, and a tree gets forces and torques tau in its joints:

    tau = constant - stiffness y - damping y' + V^T Q(q, v, t)

V maps the rates y' of the tree coordinates y to absolute speeds, and Q are the forces on links that the other terms do not contain.
A damper on a single joint is Bullet's own joint damping.
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from gauss_bench.engines.given_forces import GivenForces, on_one_joint
from gauss_bench.engines.tree import Tree
from gauss_bench.mechanism.forces import AppliedForces
from gauss_bench.mechanism.model import Mechanism
from gauss_bench.terms import Array

Forces = Callable[[float, Array, Array], Array]  # function (t, y, dy) -> given forces (n,) on the coordinates y of a world


def joint_forces(mechanism: Mechanism, tree: Tree) -> GivenForces:
    """Return all applied forces of a mechanism except gravity; those of dampers on a single joint are left to Bullet."""
    return GivenForces(mechanism, tree, lambda load: not load.k and on_one_joint(load))


def body_forces(mechanism: Mechanism) -> Forces:
    """Return a function (t, q, v) -> forces and torques (3 links,) on links as free bodies, without gravity, which Bullet adds."""
    applied = AppliedForces(replace(mechanism, gravity=np.zeros(2)))
    return lambda t, q, v: applied.generalised(q, v, t)
