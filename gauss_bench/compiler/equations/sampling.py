"""States on the constraints, spread over the motion, at which pivots are chosen and programs are checked.

An undriven linkage is moved along its free motion from its start, in steps of at most STEP, for a full turn or up to the position
beyond which it cannot be closed. A driven linkage is moved by its drivers. Velocities are random, and satisfy the constraints.
"""

from functools import lru_cache, partial
from itertools import pairwise

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import splu

from gauss_bench.mechanism.close import minimum_norm, project
from gauss_bench.mechanism.evaluate import Constraints
from gauss_bench.mechanism.model import Mechanism
from gauss_bench.mechanism.spaces import DIMENSION
from gauss_bench.terms import Array
from gauss_bench.trajectory import States

STEP = 0.1  # [rad, typical lengths] step along the motion: Newton's method stays in one assembly mode in far longer steps too
WALK = 2 * np.pi + STEP  # [rad, typical lengths] length of all steps together: one turn of a crank
FARTHEST = 3.0 * STEP  # largest distance between neighbouring poses: a pose farther away is in another assembly mode
TIMES = 64  # number of time steps in which a driven linkage is moved through its scenario
DENSE = 100  # number of coordinates above which sparse factorisations are used, which are then far cheaper
CLOSED = 1e-12  # [m, rad] largest residual of a closed position
CORRECTIONS = 12  # largest number of Newton corrections of a position
SPEED = 3.0  # [rad/s, typical lengths/s] largest speed of a coordinate
DRIFT = 0.4  # standard deviation of the change of a direction from step to step, relative to its largest component


def typical_length(mechanism: Mechanism) -> float:
    """Return the length [m] that is equivalent to 1 rad where positions and angles are compared.

    It is the mean distance of the links' points from the centres of mass of their links, or 1 if all these distances are zero.
    """
    arms = [float(np.hypot(*(p - link.com))) for link in mechanism.links for p in link.points.values()]
    arms = [x for x in arms if x > 0]
    return sum(arms) / len(arms) if arms else 1.0


def scales(mechanism: Mechanism) -> Array:
    """Return the unit of each coordinate (n,): the typical length [m] for positions, 1 rad for angles."""
    length = typical_length(mechanism)
    return np.tile([*[length] * DIMENSION, 1.0], len(mechanism.links))


# `_walk` takes longer than most searches for pivots, and several stages of the compiler need the same states
@lru_cache(maxsize=64)
def manifold_states(mechanism: Mechanism, count: int, seed: int = 0) -> States:
    """Return at most `count` states that satisfy the constraints and are spread over the motion.

    Args:
        seed: seed of the random velocities and, with several degrees of freedom, of the random directions.
    """
    rng = np.random.default_rng(seed)
    constraints, scale = Constraints(mechanism), scales(mechanism)
    path = _in_time(mechanism, constraints) if mechanism.drivers else _walk(mechanism, constraints, scale, count, rng)
    poses = [path[k] for k in np.unique(np.linspace(0, len(path) - 1, count).round().astype(int))]
    t, q = np.array([time for time, _ in poses]), np.array([position for _, position in poses])
    v = np.array([_velocity(constraints, scale, pose, rng) for pose in poses])
    if mechanism.varying and not mechanism.drivers:  # at random times, because forces that vary may be zero at t = 0
        t = rng.uniform(0.0, mechanism.duration, len(q))
    return States(t, q, v)


Pose = tuple[float, Array]  # time [s], and coordinates q (n,)
Path = list[Pose]  # along a motion, in order


def _walk(mechanism: Mechanism, constraints: Constraints, scale: Array, count: int, rng: np.random.Generator) -> Path:
    """Return poses along the motion that the joints of an undriven linkage allow, in order; their time is 0.

    The linkage is moved forwards from its start and, if that motion ends before all steps are done, also backwards. Directions and
    distances are compared in the units `scale` (n,): q / scale has comparable components, and J scale is the Jacobian for them.
    """
    heading = scale * rng.normal(size=mechanism.n)
    # with several degrees of freedom the heading drifts at random, and both directions are explored
    wanders = mechanism.dof > 1
    # a step of a large linkage takes long: no more steps are made than states are needed
    steps = int(WALK / STEP) if mechanism.n <= DENSE else count
    forwards: Path = [(0.0, mechanism.q0)]
    backwards: Path = []
    for sign, poses in ((1.0, forwards), (-1.0, backwards)):
        q, ahead, before = mechanism.q0, sign * heading, len(poses)
        for _ in range(steps):
            _, J = constraints.residual(q)
            # the last direction, changed a little at random, and projected onto the null space of J
            drift = DRIFT * scale * rng.normal(size=mechanism.n) * wanders  # 0 if the linkage does not wander
            ahead = _normalise(_free_part(J * scale, (ahead + drift) / scale)) * scale
            following = _close(constraints, 0.0, q + STEP * ahead, scale)
            if following is None or np.abs((following - q) / scale).max() > FARTHEST:
                break
            q = following
            poses.append((0.0, q))
        if len(poses) - before == steps and not wanders:
            break
    return [*reversed(backwards), *forwards]


def _normalise(x: Array) -> Array:
    """Return x (n,) divided by its largest absolute component, or x if it is zero."""
    size = float(np.abs(x).max(initial=0.0))
    return x / size if size > 0 else x


def _in_time(mechanism: Mechanism, constraints: Constraints) -> Path:
    """Return poses at equal intervals over the scenario's duration, up to the time at which the linkage cannot be closed."""
    h, scale = constraints.holonomic, scales(mechanism)
    q, path = mechanism.q0, [(0.0, mechanism.q0)]
    times = np.linspace(0.0, mechanism.duration, TIMES + 1)
    for before, t in pairwise(times):
        rows = constraints(before, q, np.zeros_like(q))
        # the guess at t: the drivers move the linkage with the velocity v of least norm that satisfies J v = -phi_t
        ahead = q - (t - before) * scale * shortest_solution(rows.J[:h] * scale, rows.phi_t[:h])
        closed = _close(constraints, float(t), ahead, scale)
        if closed is None:
            break
        q = closed
        path.append((float(t), q))
    return path


def _close(constraints: Constraints, t: float, q: Array, scale: Array) -> Array | None:
    """Return the nearest coordinates (n,) that satisfy the constraints at time t, or None if Newton's method fails."""

    def is_closed(_: Array, phi: Array, __: Array) -> bool:
        """Tell whether the residual phi is at rounding level; the arguments are q, phi and J."""
        return bool(np.abs(phi).max(initial=0.0) < CLOSED)

    residual = partial(constraints.residual, t=t)
    q = project(q, residual, lambda J, phi: scale * shortest_solution(J * scale, phi), CORRECTIONS, is_closed)
    return q if is_closed(q, *residual(q)) else None


def _velocity(constraints: Constraints, scale: Array, pose: Pose, rng: np.random.Generator) -> Array:
    """Return a random velocity (n,) that satisfies all constraint rows; its fastest free coordinate has 0.3 to 1 times SPEED."""
    t, q = pose
    rows = constraints(t, q, np.zeros_like(q))
    J = rows.J * scale
    free = _normalise(_free_part(J, rng.normal(size=len(q)))) if len(J) < len(q) else np.zeros_like(q)
    return scale * (SPEED * free * rng.uniform(0.3, 1.0) - shortest_solution(J, rows.phi_t))


def _free_part(J: Array, x: Array) -> Array:
    """Return the projection of x (n,) onto the null space of J (m, n)."""
    for _ in range(2):  # one pass leaves rounding errors
        x = x - shortest_solution(J, J @ x)
    return x


def shortest_solution(J: Array, r: Array) -> Array:
    """Return the solution x (n,) of J x = r with the least norm; J (m, n) may have redundant rows."""
    if not len(J) or J.shape[1] <= DENSE:
        return minimum_norm(J, r)
    S = sp.csc_matrix(J)
    A = (S @ S.T).tocsc()
    # x = S^T (S S^T)^-1 r; a term of rounding size on the diagonal keeps S S^T regular if rows are redundant
    return np.asarray(S.T @ splu(A + sp.identity(A.shape[0], format="csc") * (1e-14 * A.diagonal().max())).solve(r))
