"""States on the constraints, spread over the motion: where pivots are chosen and programs are checked.

An undriven linkage is moved along its free motion from its start, in steps of at most STEP, for a full turn or up to a position
beyond which it cannot be closed; a driven linkage is moved by its drivers. Velocities are random, and satisfy the constraints.
"""

from functools import lru_cache, partial
from itertools import pairwise

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import splu

from gauss_bench.mechanism.close import project
from gauss_bench.mechanism.evaluate import Constraints
from gauss_bench.mechanism.model import Mechanism
from gauss_bench.mechanism.spaces import DIMENSION
from gauss_bench.terms import Array
from gauss_bench.trajectory import States

STEP = 0.1  # [rad, lengths of the linkage] of a walk: Newton keeps its branch well beyond that
WALK = 2 * np.pi + STEP  # [rad, lengths] one turn of a crank
FARTHEST = 3.0 * STEP  # from pose to pose: a pose farther away is on another branch
TIMES = 64  # at which a driven linkage is closed
DENSE = 100  # coordinates: of larger linkages sparse factorisations are far cheaper
CLOSED = 1e-12  # [m, rad]
CORRECTIONS = 12  # of a position, at most
RANK_TOLERANCE = 1e-9  # of the largest singular value, as where a linkage is assembled
SPEED = 3.0  # [rad/s, lengths/s] of the fastest coordinate


def typical_length(mechanism: Mechanism) -> float:
    """Return the mean distance [m] of points from the centre of mass of their link; a way of it counts as a turn by 1 rad."""
    arms = [float(np.hypot(*(p - link.com))) for link in mechanism.links for p in link.points.values()]
    arms = [x for x in arms if x > 0]
    return sum(arms) / len(arms) if arms else 1.0


def scales(mechanism: Mechanism) -> Array:
    """Return the unit of each coordinate (n,): the typical length [m] for positions, 1 rad for angles."""
    length = typical_length(mechanism)
    return np.tile([*[length] * DIMENSION, 1.0], len(mechanism.links))


@lru_cache(maxsize=64)  # a walk takes longer than most searches for pivots, and several stages need the same states
def manifold_states(mechanism: Mechanism, count: int, seed: int = 0) -> States:
    """Return at most `count` states spread over the motion, the start first."""
    rng = np.random.default_rng(seed)
    constraints, scale = Constraints(mechanism), scales(mechanism)
    path = _in_time(mechanism, constraints) if mechanism.drivers else _walk(mechanism, constraints, scale, count, rng)
    which = np.unique(np.linspace(0, len(path) - 1, count).round().astype(int))
    t, q = np.array([path[k][0] for k in which]), np.array([path[k][1] for k in which])
    v = np.array([_velocity(constraints, scale, path[k], rng) for k in which])
    if mechanism.varying and not mechanism.drivers:  # forces that vary may be zero at t = 0
        t = rng.uniform(0.0, mechanism.duration, len(q))
    return States(t, q, v)


Pose = tuple[float, Array]
Path = list[Pose]


def _walk(mechanism: Mechanism, constraints: Constraints, scale: Array, count: int, rng: np.random.Generator) -> Path:
    """Return poses along the free motion, forwards and, if that ends early, also backwards; ordered along the path."""
    heading = scale * rng.normal(size=mechanism.n)
    # with several degrees of freedom the heading drifts at random, and both directions are explored
    wanders = mechanism.dof > 1
    steps = int(WALK / STEP) if mechanism.n <= DENSE else count
    path: Path = []
    for sign in (1.0, -1.0):
        q, ahead = mechanism.q0, sign * heading
        poses: Path = []
        for _ in range(steps):
            _, J = constraints.residual(q)
            drift = 0.4 * scale * rng.normal(size=mechanism.n) * wanders
            ahead = _unit(_free_part(J * scale, (ahead + drift) / scale)) * scale
            following = _close(constraints, 0.0, q + STEP * ahead, scale)
            if following is None or np.abs((following - q) / scale).max() > FARTHEST:
                break
            q = following
            poses.append((0.0, q))
        path = [*reversed(path), (0.0, mechanism.q0), *poses] if not path else [*reversed(poses), *path]
        if len(poses) == steps and not wanders:
            break
    return path


def _unit(x: Array) -> Array:
    size = float(np.abs(x).max(initial=0.0))
    return x / size if size > 0 else x


def _in_time(mechanism: Mechanism, constraints: Constraints) -> Path:
    """Return poses at equal distances in time over the scenario's duration, up to where the linkage cannot be closed."""
    h, scale = constraints.holonomic, scales(mechanism)
    q, path = mechanism.q0, [(0.0, mechanism.q0)]
    times = np.linspace(0.0, mechanism.duration, TIMES + 1)
    for before, t in pairwise(times):
        rows = constraints(before, q, np.zeros_like(q))
        ahead = q - (t - before) * scale * shortest(rows.J[:h] * scale, rows.phi_t[:h])
        closed = _close(constraints, float(t), ahead, scale)
        if closed is None:
            break
        q = closed
        path.append((float(t), q))
    return path


def _close(constraints: Constraints, t: float, q: Array, scale: Array) -> Array | None:
    """Return the nearest position on the constraints, or None if Newton's method fails."""

    def is_closed(_: Array, phi: Array, __: Array) -> bool:
        return bool(np.abs(phi).max(initial=0.0) < CLOSED)

    residual = partial(constraints.residual, t=t)
    q = project(q, residual, lambda J, phi: scale * shortest(J * scale, phi), CORRECTIONS, is_closed)
    return q if is_closed(q, *residual(q)) else None


def _velocity(constraints: Constraints, scale: Array, pose: Pose, rng: np.random.Generator) -> Array:
    """Return a random velocity that satisfies all rows; its free part is at most SPEED."""
    t, q = pose
    rows = constraints(t, q, np.zeros_like(q))
    J = rows.J * scale
    free = _unit(_free_part(J, rng.normal(size=len(q)))) if len(J) < len(q) else np.zeros_like(q)
    return scale * (SPEED * free * rng.uniform(0.3, 1.0) - shortest(J, rows.phi_t))


def _free_part(J: Array, x: Array) -> Array:
    """Project x onto the free motions; twice, because one pass leaves rounding errors."""
    for _ in range(2):
        x = x - shortest(J, J @ x)
    return x


def shortest(J: Array, r: Array) -> Array:
    """Return the minimum-norm x of J x = r; J (m, n) may have redundant rows."""
    if not len(J):
        return np.zeros(J.shape[1])
    if J.shape[1] <= DENSE:
        return np.asarray(np.linalg.lstsq(J, r, rcond=RANK_TOLERANCE)[0])
    S = sp.csc_matrix(J)
    return np.asarray(S.T @ _normal(S).solve(r))


def _normal(S: sp.csc_matrix) -> "splu":
    """Factorise J J^T with a shift of rounding size, so that redundant rows do not make it singular."""
    A = (S @ S.T).tocsc()
    return splu(A + sp.identity(A.shape[0], format="csc") * (1e-14 * A.diagonal().max()))
