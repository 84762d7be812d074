"""Exudyn's nearest to one right-hand side: one step of generalized-alpha with its sparse solver.

A step takes at least one solution of its equations. The accelerations are its own initial ones, which are differences.
"""

import numpy as np

from gauss_bench.engines.base import Choice
from gauss_bench.engines.exudyn.adapter import ExudynModel
from gauss_bench.engines.shared import LibraryCall
from gauss_bench.mechanism.model import Mechanism
from gauss_bench.terms import Array

STEP = 1e-3  # [s]
STEPS = 20  # in one call


def sparse(mechanism: Mechanism, q: Array, v: Array) -> LibraryCall:
    model = ExudynModel(mechanism, Choice("tuned", "generalized_alpha", "none", STEP))
    model.simulation.linearSolver.solverType = model.exu.LinearSolverType.EigenSparse
    times = np.array([0.0, STEPS * STEP])
    return LibraryCall(model.run, model.built_in(q, v), lambda: model.prepare(times), STEPS)


CALLS = {"sparse": sparse}
