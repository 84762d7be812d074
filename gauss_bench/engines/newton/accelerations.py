"""Accelerations that Kamino's steps imply at a given state, by steps of six copies of the linkage.

A step of h [s] from q, v solves for the velocities v1 = P(q) (v + h a_free), where P projects velocities onto those that the
constraints at q allow, J(q) v1 = 0, and a_free are the accelerations without constraints. In a run q moves on, and so does P. In
the limit of short steps, velocities change at the rate

    a = P(q) a_free + d/de P(q + e v) v        at e = 0

Two copies of the linkage stand at q, with and without forces; their velocities then differ by h P a_free, whatever h. Four stand at
q + k e v without forces, and their fourth-order difference is the second term. So the error of the time step is not in it, and
little of rounding, which is that of single precision. Gaps, which are of the size e^2 in the four copies, must not be drawn shut.

Trap: the solvers leave a share of J v1, on a crank-slider a thousandth. In a run that is left of every step alike, so that no
acceleration comes of it. Here a second step without forces projects again. PADMM often ends before it has converged, which is an
error of runs; DVI solves for the impulses directly and is asked here under every setting.
"""

import numpy as np

from gauss_bench.engines.newton.kernels import Libraries
from gauss_bench.engines.newton.world import World
from gauss_bench.mechanism.forces import AppliedForces
from gauss_bench.mechanism.model import Mechanism
from gauss_bench.terms import Array

WEIGHTS = {-2: 1.0, -1: -8.0, 1: 8.0, 2: -1.0}  # of the values at k e, over 12 e: the slope at 0, but for terms of the size e^4
DIFFERENCE = 3e-2  # [rad, m] by which a copy is moved at most twice: truncation e^4/30 is 3e-8, rounding 1e-7/e is 3e-6
STEP = 0.1  # [s]
CONVERGED = {"dynamics_solver": "dvi", "alpha": 0.0, "contacts": 1}


class Accelerations:
    """A call (q, v, forces) -> accelerations (n,), at a state q, v (n,) on the constraints, under forces (n,) besides gravity."""

    def __init__(self, libraries: Libraries, mechanism: Mechanism):
        self.weight = AppliedForces(mechanism).gravity  # what is no force takes it away
        self.world = World(libraries, mechanism, CONVERGED, copies=2 + len(WEIGHTS))

    def __call__(self, q: Array, v: Array, forces: Array) -> Array:
        e = DIFFERENCE / max(float(np.abs(v).max()), DIFFERENCE)
        places = [q, q, *(q + k * e * v for k in WEIGHTS)]
        given = [forces, *([-self.weight] * (1 + len(WEIGHTS)))]
        speeds = np.tile(v, len(places))
        for now in (given, [-self.weight] * len(places)):
            self.world.put(np.concatenate(places), speeds)
            self.world.step(np.concatenate(now), STEP)
            speeds = self.world.state()[1]
        pushed, free, *moved = speeds.reshape(len(places), -1)
        turning = sum(weight * x for weight, x in zip(WEIGHTS.values(), moved, strict=True)) / (12 * e)
        return np.asarray((pushed - free) / STEP + turning)
