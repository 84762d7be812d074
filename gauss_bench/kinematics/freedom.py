"""Free motions at a position: a basis, their second derivatives, and the projection back onto the constraints.

Coordinates are scaled: a turn of one radian counts as a displacement by the size of the linkage. Let J be the constraint Jacobian
and J^+ its pseudo-inverse. The columns of N are an orthonormal basis of the f free motions, and y (f,) their amplitudes. Near q,

    J N = 0,  N^T N = 1,    q(y) = q + N y + J^+ gamma(q, N y) / 2 + ...

Here gamma = -(dJ/dt) v is the quadratic form that `Constraints` evaluates. Drivers keep their values at t = 0. Knife edges are left
out, because they constrain velocities, not positions.
"""

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

from gauss_bench.mechanism.close import project
from gauss_bench.mechanism.coordinates import value
from gauss_bench.mechanism.evaluate import Constraints
from gauss_bench.mechanism.model import Coordinate, Mechanism
from gauss_bench.terms import Array, largest

RANK_TOLERANCE = 1e-7  # share of the largest singular value below which a singular value counts as zero
CLOSED = 1e-13  # [sizes of the linkage] largest residual that rounding explains
ROUNDING = 1e3  # largest residual that is accepted after the last correction, in units of CLOSED: rounding may exceed CLOSED
STILL = 1e-8  # [sizes of the linkage] largest last correction: by quadratic convergence it leaves only rounding
CORRECTIONS = 12  # largest number of corrections: three are usual from a prediction to second order


@dataclass(frozen=True, eq=False)
class Place:
    """A position of a linkage with its free motions.

    Attributes:
        q: (n,) absolute coordinates.
        J, inverse: (m, n) Jacobian of the joints and drivers in scaled coordinates, and its pseudo-inverse (n, m).
        free: (n, f) orthonormal basis N of the free motions in scaled coordinates.
    """

    q: Array
    J: Array
    inverse: Array
    free: Array


class Freedom:
    """The constraints of joints and drivers of one linkage, in scaled coordinates.

    Attributes:
        size: size of the linkage [m].
        scale: (n,) factors that turn absolute coordinates q into scaled coordinates q * scale, which are all in metres.
    """

    def __init__(self, mechanism: Mechanism):
        self.mechanism = mechanism
        self.constraints = Constraints(replace(mechanism, knife_edges=()))
        self.size = mechanism.size
        self.scale = np.tile([1.0, 1.0, self.size], len(mechanism.links))

    def rows(self, q: Array) -> tuple[Array, Array]:
        """Return the constraint residual phi (m,) at q (n,), and its Jacobian J (m, n) in scaled coordinates."""
        phi, J = self.constraints.residual(q)
        return phi, J / self.scale

    def evaluate(self, q: Array) -> tuple[Array, Place]:
        """Return the constraint residual phi (m,) and the `Place` at any q (n,), where the joints may be open."""
        phi, J = self.rows(q)
        return phi, Place(q, J, *split_by_rank(J))

    def close(self, q: Array) -> Place | None:
        """Return a position near q (n,) that satisfies the constraints, found by Gauss-Newton; None if it does not converge."""

        def has_ended(_: Array, phi: Array, __: Array) -> bool:
            """Tell whether the largest residual phi is at most CLOSED, or not finite."""
            return not CLOSED * self.size < largest(phi) < np.inf

        def shortest(J: Array, phi: Array) -> Array:
            """Return the correction of q that is shortest in scaled coordinates."""
            return np.asarray(split_by_rank(J)[0] @ phi / self.scale)

        def is_still(_: Array, size: Array) -> bool:
            """Tell whether the last correction was so small that the next one, by quadratic convergence, would be rounding."""
            return bool(size < STILL * self.size)

        q = project(q, self.rows, shortest, CORRECTIONS, has_ended, is_still)
        if not np.isfinite(q).all():
            return None
        phi, place = self.evaluate(q)
        return place if largest(phi) <= ROUNDING * CLOSED * self.size else None

    def bend(self, place: Place, directions: Array) -> Array:
        """Return the second derivatives J^+ gamma (k, n) of the scaled coordinates along k free motions (k, n), scaled too."""
        positions = np.tile(place.q, (len(directions), 1))
        gamma = self.constraints(0.0, positions, directions / self.scale).gamma
        return np.asarray(gamma @ place.inverse.T)


@dataclass(frozen=True, eq=False)
class Locked:
    """A coupling that holds coordinates at constant values."""

    name: str
    held: tuple[tuple[Coordinate, float], ...]


def hold(mechanism: Mechanism, q: Array, coordinates: Iterable[Coordinate]) -> Mechanism:
    """Return the linkage without its drivers, with coordinates held at their values in q (n,)."""
    locked = Locked("locked", tuple((x, float(value(x, q))) for x in coordinates))
    return replace(mechanism, drivers=(), couplings=(*mechanism.couplings, locked))


def split_by_rank(J: Array) -> tuple[Array, Array]:
    """Return the pseudo-inverse (n, m) of a Jacobian J (m, n), and an orthonormal basis (n, f) of its null space."""
    n = J.shape[1]
    if not len(J):
        return np.zeros((n, 0)), np.eye(n)
    U, s, Vt = np.linalg.svd(J)  # the rows of Vt beyond the rank span the null space
    rank = int((s > RANK_TOLERANCE * s[0]).sum())
    return (Vt[:rank].T / s[:rank]) @ U[:, :rank].T, Vt[rank:].T
