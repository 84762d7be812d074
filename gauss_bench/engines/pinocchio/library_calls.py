"""One evaluation of the right-hand side by Pinocchio alone: its two algorithms for constrained trees, on the tree of least depth.

lcaba is the algorithm of Sathya and Carpentier, Constrained articulated body dynamics algorithms (2024). The penalty and accuracy
in use are the best compromise found: smaller values take longer and give no better accelerations.
"""

from functools import partial

import numpy as np

from gauss_bench.engines.base import Choice
from gauss_bench.engines.pinocchio.adapter import PinocchioModel
from gauss_bench.engines.shared import LibraryCall
from gauss_bench.mechanism.model import Mechanism
from gauss_bench.terms import Array


def prepare_solver(variant: str, mechanism: Mechanism, q: Array, v: Array) -> LibraryCall:
    """Return a call of Pinocchio's solver alone, by a variant's algorithm, at an absolute state q, v (n,)."""
    model = PinocchioModel(mechanism, Choice(variant, "rk4"))
    y, dy = model.tree.relative(q, v)
    call = model.plain.bare(y, dy)
    return LibraryCall(call, model.tree.absolute(y, dy, np.array(call())).a)


CALLS = {
    "constraintDynamics": partial(prepare_solver, "one/rk4/least depth"),
    "lcaba": partial(prepare_solver, "articulated/rk4/least depth"),
}
