"""Steps of generalized-alpha with Exudyn's sparse solver, which are timed in place of evaluations of the right-hand side.

Exudyn offers no call that only evaluates the right-hand side; a step solves the equations of motion at least once. The call is
checked by the initial accelerations of a run, which Exudyn computes by finite differences.
"""

import numpy as np

from gauss_bench.engines.base import Choice
from gauss_bench.engines.exudyn.adapter import ExudynModel
from gauss_bench.engines.shared import LibraryCall
from gauss_bench.mechanism.model import Mechanism
from gauss_bench.terms import Array

STEP = 1e-3  # [s]
STEPS = 20  # steps in one call


def step_sparse(mechanism: Mechanism, q: Array, v: Array) -> LibraryCall:
    """Return a call that takes STEPS steps from the mechanism's start, and Exudyn's accelerations at the state q, v (n,)."""
    model = ExudynModel(mechanism, Choice("tuned", "generalized_alpha", "none", STEP))
    model.simulation.linearSolver.solverType = model.exu.LinearSolverType.EigenSparse
    times = np.array([0.0, STEPS * STEP])
    return LibraryCall(model.run, model.built_in(q, v), lambda: model.prepare(times), STEPS)


CALLS = {"sparse": step_sparse}
