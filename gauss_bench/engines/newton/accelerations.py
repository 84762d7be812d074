"""Accelerations at a given state, found from Kamino's steps of six copies of the model of the linkage.

Kamino is a solver of the library Newton. From positions q and velocities v, a step of h [s] computes the new velocities
v1 = P(q) (v + h a_free). Here P(q) projects velocities onto those that the constraints at q allow, so that J(q) v1 = 0, and a_free
are the accelerations that the linkage would have without constraints. In the limit of short steps, velocities change at the rate

    a = P(q) a_free + d/de P(q + e v) v        at e = 0

The first term is found from two copies of the model at q, one with forces and one without: after a step, their velocities v1
differ by h P a_free for every h. The second term is a fourth-order finite difference of the velocities of four copies without
forces, at the positions q + k e v for k = -2, -1, 1, 2. So the accelerations have no error of a time step, and only a small
rounding error, although the library computes in single precision. The four displaced copies have loop gaps of the order e^2, which
Kamino must not close.

Trap: after a step of a crank-slider, J v is about a thousandth of its value before, not zero. In the formula for a, this remainder
would appear as an acceleration, so a second step without forces projects the velocities again. In a run every step leaves nearly
the same remainder, which cancels in the change of velocities from step to step.

Kamino's solver PADMM often stops before it has converged. So this module uses Kamino's solver DVI, which solves for the impulses
directly.
"""

import numpy as np

from gauss_bench.engines.newton.kernels import Libraries
from gauss_bench.engines.newton.world import World
from gauss_bench.mechanism.forces import AppliedForces
from gauss_bench.mechanism.model import Mechanism
from gauss_bench.terms import Array

WEIGHTS = {-2: 1.0, -1: -8.0, 1: 8.0, 2: -1.0}  # k -> weight of the value at k e; the sum / (12 e) is the slope at 0, to order 4
DIFFERENCE = 3e-2  # [rad, m] largest e v; copies move by up to 2 e v. For this e v, truncation is 3e-8, rounding 3e-6
STEP = 0.1  # [s]; the result does not depend on it
CONVERGED = {"dynamics_solver": "dvi", "alpha": 0.0, "contacts": 1}  # options; alpha = 0 leaves gaps open


class Accelerations:
    """A function (q, v, forces) -> accelerations (n,), at a state q, v (n,) that satisfies the constraints.

    The forces (n,) act in addition to gravity.
    """

    def __init__(self, libraries: Libraries, mechanism: Mechanism):
        self.gravity = AppliedForces(mechanism).gravity  # (n,) generalised forces of the links' weights
        self.world = World(libraries, mechanism, CONVERGED, copies=2 + len(WEIGHTS))

    def __call__(self, q: Array, v: Array, forces: Array) -> Array:
        e = DIFFERENCE / max(float(np.abs(v).max()), DIFFERENCE)
        # the first copy starts from q with forces, all others without: from q and from displaced positions
        places = [q, q, *(q + k * e * v for k in WEIGHTS)]
        without_forces = [-self.gravity] * len(places)  # cancels gravity, which Newton adds to all copies
        speeds = np.tile(v, len(places))
        for forces_of_copies in ([forces, *without_forces[1:]], without_forces):  # the second step only projects
            self.world.put(np.concatenate(places), speeds)
            self.world.step(np.concatenate(forces_of_copies), STEP)
            _, speeds = self.world.state()
        # velocities of the copies: pushed by forces, without forces, and without forces at displaced positions
        pushed, free, *moved = speeds.reshape(len(places), -1)
        velocity_term = sum(weight * v1 for weight, v1 in zip(WEIGHTS.values(), moved, strict=True)) / (12 * e)  # d/de P(q + e v) v
        return np.asarray((pushed - free) / STEP + velocity_term)  # P a_free + d/de P(q + e v) v
