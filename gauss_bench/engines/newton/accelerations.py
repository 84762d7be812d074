"""Accelerations at a given state, found from Kamino's steps of six copies of the linkage.

A step of h [s] from q, v solves for the velocities v1 = P(q) (v + h a_free). P projects velocities onto those that the constraints
at q allow, J(q) v1 = 0, and a_free are the accelerations without constraints. In the limit of short steps, velocities change at the
rate

    a = P(q) a_free + d/de P(q + e v) v        at e = 0

The first term is found from two copies at q, one with forces and one without: their velocities v1 differ by h P a_free for every h.
The second term is the fourth-order difference of four copies at q + k e v without forces. So the result has no error of a time
step, and little of rounding, although Newton computes in single precision. Kamino must not close the gaps of the four copies, which
have the size e^2.

Trap: after a step, a small part of J v remains, on a crank-slider a thousandth. In a run every step leaves nearly the same part,
which cancels in the change of velocities from step to step. Here the part would appear as an acceleration, so a second step without
forces projects the velocities again. Kamino's solver PADMM often stops before it has converged. Runs with PADMM have this error,
and accelerations must not have it. So Kamino's solver DVI, which solves for the impulses directly, takes the steps here, whatever
solver the settings name.
"""

import numpy as np

from gauss_bench.engines.newton.kernels import Libraries
from gauss_bench.engines.newton.world import World
from gauss_bench.mechanism.forces import AppliedForces
from gauss_bench.mechanism.model import Mechanism
from gauss_bench.terms import Array

WEIGHTS = {-2: 1.0, -1: -8.0, 1: 8.0, 2: -1.0}  # k -> weight of the value at k e; the sum over 12 e is the slope at 0, to order 4
DIFFERENCE = 3e-2  # [rad, m] a copy moves by 2 e v at most; at e v of this size truncation is 3e-8, rounding 3e-6
STEP = 0.1  # [s]; the result does not depend on it
CONVERGED = {"dynamics_solver": "dvi", "alpha": 0.0, "contacts": 1}  # options; alpha = 0 leaves gaps open


class Accelerations:
    """A function (q, v, forces) -> accelerations (n,), for a state q, v (n,) on the constraints and forces (n,) besides gravity."""

    def __init__(self, libraries: Libraries, mechanism: Mechanism):
        """Build a world of six copies of the linkage, with the options CONVERGED."""
        self.weight = AppliedForces(mechanism).gravity  # (n,)
        self.world = World(libraries, mechanism, CONVERGED, copies=2 + len(WEIGHTS))

    def __call__(self, q: Array, v: Array, forces: Array) -> Array:
        """Return the accelerations (n,) at q, v (n,) under `forces` (n,) besides gravity.

        The copies start from q with forces, from q without, and from q + k e v without forces for every k of WEIGHTS.
        """
        e = DIFFERENCE / max(float(np.abs(v).max()), DIFFERENCE)
        places = [q, q, *(q + k * e * v for k in WEIGHTS)]
        weightless = -self.weight  # cancels gravity, which Newton adds to all copies
        without_forces = [weightless] * len(places)
        speeds = np.tile(v, len(places))
        for given in ([forces, *without_forces[1:]], without_forces):  # the second step only projects
            self.world.put(np.concatenate(places), speeds)
            self.world.step(np.concatenate(given), STEP)
            speeds = self.world.state()[1]
        # velocities of the copies: pushed by forces, without forces, and without forces at displaced positions
        pushed, free, *moved = speeds.reshape(len(places), -1)
        velocity_term = sum(weight * x for weight, x in zip(WEIGHTS.values(), moved, strict=True)) / (12 * e)  # d/de P(q + e v) v
        return np.asarray((pushed - free) / STEP + velocity_term)  # P a_free + d/de P(q + e v) v
