"""Reference accelerations in absolute coordinates, for linkages that one crank angle cannot describe.

In weighted coordinates b = M^(1/2) a, one singular value decomposition, without singular values of rounding size, gives both the
part of b that satisfies the constraints and the free part (index 1: the remaining singular values; index 2: the null space):

    K = J M^(-1/2) = U S V^T,    b = V1 S1^-1 U1^T gamma + V2 V2^T M^(-1/2) Q

Friction in joints adds W N(lambda) to Q. The columns of W are the directions of friction, and N(lambda) are the loads of the
joints. The multipliers lambda follow from K^T lambda = M^(-1/2) Q - b in the same basis:

    lambda = U1 S1^-1 (V1^T M^(-1/2) Q - S1^-1 U1^T gamma)
"""

import numpy as np

from gauss_bench.linkage.closure import null_space
from gauss_bench.mechanism.close import RANK_TOLERANCE
from gauss_bench.mechanism.evaluate import Evaluator
from gauss_bench.mechanism.model import Mechanism
from gauss_bench.terms import Array


class AbsoluteCoordinates:
    """Accelerations of one mechanism for a batch of states (k, n)."""

    def __init__(self, mechanism: Mechanism):
        self.evaluator = Evaluator(mechanism)
        self.root = np.sqrt(mechanism.mass)

    def acceleration(self, t: Array, q: Array, v: Array) -> Array:
        """Return accelerations (k, n) at times (k,) and states q, v (k, n); V2 V2^T is computed as 1 - V1 V1^T."""
        rows = self.evaluator.constraints(t, q, v)
        Q = self.evaluator.applied.generalised(q, v, t)
        U, s, Vt = np.linalg.svd(rows.J / self.root, full_matrices=False)
        keep = s > RANK_TOLERANCE * s.max(axis=-1, keepdims=True, initial=0.0)
        V = np.swapaxes(Vt, -1, -2)  # (k, n, r)
        inverse = np.where(keep, 1.0 / np.where(keep, s, 1.0), 0.0)  # S1^-1
        forced = inverse * (np.swapaxes(U, -1, -2) @ rows.gamma[..., None])[..., 0]  # S1^-1 U1^T gamma
        free = Q / self.root  # M^(-1/2) Q
        friction = self.evaluator.friction
        if friction:
            # `solve_multipliers` solves lambda = base + lift V1^T W N(lambda)
            W = friction.directions(q, v) / self.root[:, None]  # (k, n, joints), in weighted coordinates
            lift = U * inverse[..., None, :]  # U1 S1^-1
            base = lift @ (Vt @ free[..., None] - forced[..., None])
            multipliers = friction.solve_multipliers(base[..., 0], lift @ Vt @ W)
            free = free + (W @ friction.loads(multipliers)[..., None])[..., 0]
        blocked = keep * (Vt @ free[..., None])[..., 0]  # V1^T M^(-1/2) Q
        b = free + (V @ (forced - blocked)[..., None])[..., 0]
        return np.asarray(b / self.root)

    def null_space(self, q: Array) -> Array:
        """Return a basis (n, n - r) of the velocities that the constraints allow at one state."""
        return null_space(self.evaluator.constraints(0.0, q, np.zeros_like(q)).J, len(q))
