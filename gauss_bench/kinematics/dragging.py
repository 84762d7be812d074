"""Drag a linkage by one of its points: find the smallest change that brings the point to its target, or as near as possible.

Let the columns of N be a basis of the f free motions of the linkage, y (f,) the amplitudes of these motions, p (2,) the dragged
point, P = dp/dy its Jacobian, and r = p - target. A step y follows from the equation of Levenberg-Marquardt,

    (P^T P + sum_k r_k d^2 p_k / dy^2 + mu 1) y = -P^T r,

in which mu makes the matrix positive definite. Gauss-Newton then projects the position after the step back onto the constraints.

A step is halved until the linkage moves continuously: the free motions change little along the step, and the projected position is
near the prediction of second order. The linkage therefore reaches another assembly only by moving there, and keeps its direction at
a fork. With two free motions P is square, and the linkage does not cross a singular position det P = 0: an arm that is pulled
straight folds back to the side from which it came.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from gauss_bench.kinematics.freedom import Freedom, Place, hold
from gauss_bench.mechanism.coordinates import arm, position, velocity
from gauss_bench.mechanism.model import GROUND, Along, Angle, Coordinate, Mechanism, Point
from gauss_bench.mechanism.spaces import angle_slot
from gauss_bench.terms import Array

ORIGIN = Point(GROUND, np.zeros(2), "ground.")  # of the world's axes

# Lengths below are shares of the linkage's size.
LARGEST_STEP = 0.15  # largest displacement in one step, and largest turn of a link [rad]
LARGEST_MISS = 0.25  # largest distance between prediction and projected position, as a share of the step
SMALLEST_COSINE = 0.9  # smallest cosine of the angle between the free motions before and after a step
HALVINGS = 12  # largest number of halvings of a step
MOST_STEPS = 60  # largest number of steps of one call of `Drag.to`: together at most nine sizes of the linkage
NEAR = 1e-13  # distance from the target that is only rounding
RESTING = 1e-8  # a smaller step is the last: the next step, of the order of its square, would be rounding
REACHED = 1e-10  # distance at which the point counts as being at its target
FLAT = 1e-9  # share of the largest curvature below which a curvature counts as zero
MARGIN = 1e-3  # smallest |det P|: it is reached about one degree, or 1e-4 of its length, before an arm is stretched
# smallest displacement of the point in a direction in which it can move, as a share of the linkage's displacement; above MARGIN
STANDING = 5e-3


@dataclass(frozen=True)
class Locks:
    """Names of parts of a linkage that must not move while one of its points is dragged.

    Links keep their angle, points "link.point" their place, slides do not slide, and the links of pin `joints` keep their relative
    angle.
    """

    links: tuple[str, ...] = ()
    points: tuple[str, ...] = ()
    slides: tuple[str, ...] = ()
    joints: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class Dragged:
    """The result of a drag: the position q (n,) that the linkage has reached.

    Attributes:
        reached, apart: whether the point is at its target, and its distance from there [m].
        note: the reason why the point is not at its target; empty if it is.
    """

    q: Array
    reached: bool
    apart: float
    note: str


def lock(mechanism: Mechanism, q: Array, locks: Locks) -> Mechanism:
    """Return the linkage without its drivers, with all locked parts fixed at their positions in q (n,).

    Raises:
        ValueError: the linkage has no part with a name in `locks`.
    """
    held: list[Coordinate] = []
    for reference in locks.points:
        point = find_point(mechanism, reference)
        if point.link != GROUND:  # a point on the ground keeps its place in any case
            held += [Along(ORIGIN, point, 0.0), Along(ORIGIN, point, 0.0, across=True)]
    for name in locks.joints:
        turns = [x.motion for x in mechanism.joints if x.joint == name and x.ends_meet]
        _check_exists(turns, "pin joint", name)
        held += turns
    for name in locks.links:
        # links that are welded together are one body of the mechanism; `whole` has every link of the file
        _check_exists([x for x in mechanism.whole.links if x.name == name], "link", name)
        body, _ = mechanism.find_body(name)
        held.append(Angle(GROUND, body))
    for name in locks.slides:
        motions = [x.motion for x in mechanism.slides if x.name == name]
        _check_exists(motions, "slide", name)
        held += motions
    return hold(mechanism, q, held)


def _check_exists(parts: list[Any], kind: str, name: str) -> None:
    """Raise ValueError if the list of the parts of a kind that have this name is empty."""
    if not parts:
        raise ValueError(f"no {kind} {name!r} that could be locked")


def find_point(mechanism: Mechanism, reference: str) -> Point:
    """Return the point of a linkage that a text "link.point" names.

    Raises:
        ValueError: the linkage has no such link or point.
    """
    try:
        return mechanism.find_point(reference)
    except (KeyError, StopIteration) as error:
        raise ValueError(f"no point {reference!r}") from error


class Drag:
    """A linkage of which one point is dragged; each call of `to` continues from the position that the last call reached.

    In the methods, N (n, f) is the basis of the f free motions in scaled coordinates (`Freedom`), y (f,) a step, the amplitudes of
    these motions, and P (2, f) the Jacobian of the dragged point by y.

    Attributes:
        side: sign of det P, which must not change. It is 0, and forbids no step, until |det P| has exceeded MARGIN, or if P is not
            square.
        directions: number of directions in which the point could move at the beginning, at least 1: a point that could not move
            counts as a point at its limit.
    """

    def __init__(self, mechanism: Mechanism, q: Array, point: str | Point, locks: Locks = Locks(), onto: Point | None = None):
        """Begin to drag the point "link.point" of a linkage that is assembled at the position q (n,).

        If a point `onto` of another link is given, the targets are values of the vector from `onto` to the dragged point (0
        brings both together), else places of the point in the world.

        Raises:
            ValueError: the point is on the ground, a name is unknown, or the joints are open at q.
        """
        self.point = find_point(mechanism, point) if isinstance(point, str) else point
        self.onto = onto
        if self.point.link == GROUND and onto is None:
            raise ValueError(f"{point} is fixed to the ground: moving it would change the linkage instead of dragging it")
        self.freedom = Freedom(lock(mechanism, q, locks))
        place = self.freedom.close(np.array(q, dtype=float))
        if place is None:
            raise ValueError(f"{mechanism.name} cannot be dragged from here: its joints are open")
        self.place = place
        self.side = self._side()
        self.directions = max(self._count_directions(), 1)

    @property
    def q(self) -> Array:
        """(n,) the present position."""
        return self.place.q

    def to(self, target: Array, most: int = MOST_STEPS) -> Dragged:
        """Drag the point towards a target (2,) [m] in at most `most` steps; return the position that is reached."""
        target, size = np.asarray(target, dtype=float), self.freedom.size
        apart = self._apart(self.place, target)
        is_stuck = self.place.free.shape[1] == 0  # without free motions
        for _ in range(most):
            if apart <= NEAR * size or is_stuck:
                break
            is_stuck = not self._step(target, apart)
            apart = self._apart(self.place, target)
        if apart <= REACHED * size:
            return Dragged(self.q, True, apart, "")
        if not is_stuck:
            return Dragged(self.q, False, apart, "the target is too far away for one drag")
        why = f"{self.point.name} cannot come nearer to the target" if self.place.free.shape[1] else "no motion is left free"
        return Dragged(self.q, False, apart, why)

    def is_at_limit(self) -> bool:
        """Tell whether the point can move in fewer directions than at the beginning: it is then at the end of its path or area."""
        return self._count_directions() < self.directions

    def _count_directions(self) -> int:
        """Return the number of independent directions in which the point can move."""
        P = self._point_jacobian(self.place)
        return int(np.sum(np.linalg.svd(P, compute_uv=False) > STANDING)) if P.size else 0

    def _apart(self, place: Place, target: Array) -> float:
        """Return the distance of the point from the target [m]."""
        return float(np.hypot(*(self._position(place) - target)))

    def _step(self, target: Array, apart: float) -> bool:
        """Take the first proposed step that brings the point nearer than `apart` [m]; return whether more may follow."""
        bends = self._bends()
        for y in self._propose_steps(self._position(self.place) - target, bends):
            place = self._try_step(y, bends)
            is_tiny = bool(np.abs(y).max() < RESTING * self.freedom.size)
            if place is not None and self._apart(place, target) < apart:
                self.place = place
                self.side = self.side or self._side()  # fixed as soon as |det P| exceeds MARGIN
                return not is_tiny
            if is_tiny:
                break
        return False

    def _bends(self) -> Array:
        """Return the second derivatives (f, f, n) of the scaled coordinates with respect to a step y."""
        N = self.place.free
        f = N.shape[1]
        i, j = np.triu_indices(f)
        # `bend` is quadratic in a direction; mixed derivatives follow from x_i x_j = ((x_i + x_j)^2 - (x_i - x_j)^2) / 4
        directions = np.concatenate([N[:, i] + N[:, j], N[:, i] - N[:, j]], axis=1).T
        quarters = self.freedom.bend(self.place, directions) / 4
        bends = np.zeros((f, f, len(self.q)))
        bends[i, j] = bends[j, i] = quarters[: len(i)] - quarters[len(i) :]
        return bends

    def _propose_steps(self, r: Array, bends: Array) -> Iterator[Array]:
        """Yield HALVINGS steps y (f,) that may bring the point nearer to its target, each half as long as the one before.

        The first is the step of Levenberg-Marquardt, changed by `_stay_on_side` and shortened to LARGEST_STEP.

        Args:
            r: (2,) vector from the target to the point [m].
            bends: (f, f, n) second derivatives of the scaled coordinates with respect to y.
        """
        P, bent = self._point_jacobian(self.place), self._point_bends(bends)
        gradient, H = P.T @ r, P.T @ P + bent @ r  # first and second derivatives of |r|^2 / 2 by y
        limit = LARGEST_STEP * self.freedom.size
        y = self._descend(gradient, H, limit)
        if self.side:
            y = self._stay_on_side(y, P, bent, gradient, H)
        y = y * min(1.0, limit / max(float(np.abs(self.place.free @ y).max()), np.finfo(float).tiny))
        for _ in range(HALVINGS):
            yield y
            y = y / 2

    def _point_bends(self, bends: Array) -> Array:
        """Return the second derivatives (f, f, 2) of the point by y, from those of the scaled coordinates, `bends` (f, f, n)."""
        N = self.place.free / self.freedom.scale[:, None]  # (n, f) free motions in absolute coordinates
        states, rates = np.broadcast_to(self.q, bends.shape), bends / self.freedom.scale
        # `velocity` multiplies the Jacobian of a point with any derivatives of the coordinates
        bent = velocity(states, rates, self.point) - self._centripetal(N, self.point)
        if self.onto:
            bent = bent - velocity(states, rates, self.onto) + self._centripetal(N, self.onto)
        return bent

    def _descend(self, gradient: Array, H: Array, limit: float) -> Array:
        """Return the solution y (f,) of the equation of Levenberg-Marquardt, (H + mu 1) y = -gradient.

        At a maximum of the distance from the target, y has the length `limit` [m] in the direction of the most negative curvature.
        """
        curvature, V = np.linalg.eigh(H)
        smallest, flat = float(curvature[0]), FLAT * float(np.abs(curvature).max())
        # mu raises a negative smallest curvature to its absolute value plus `flat`, and one near zero to at least flat / 2
        mu = max(0.0, flat - 2.0 * smallest) if smallest < flat else 0.0
        y: Array = -V @ ((V.T @ gradient) / (curvature + mu))
        is_maximum = smallest < -flat and np.abs(y).max() < RESTING * self.freedom.size
        return limit * V[:, 0] if is_maximum else y

    def _stay_on_side(self, y: Array, P: Array, bent: Array, gradient: Array, H: Array) -> Array:
        """Return the step y (2,) if det P keeps its sign s = `side` to first order, else a step that is changed to keep it.

        With the gradient d of s det P by y, the sign is kept, with a margin, if d . y >= MARGIN - s det P. Another y is replaced by
        the minimum of gradient . y + y . H y / 2 on the line d . y = MARGIN - s det P.

        Args:
            P, bent: (2, 2) first and (2, 2, 2) second derivatives of the point with respect to y.
            gradient, H: (2,) and (2, 2) derivatives of half the squared distance from the target with respect to y.
        """
        least = MARGIN - self.side * float(np.linalg.det(P))
        # d det P / dy_k: one column of P at a time is replaced by its derivative
        d = self.side * np.array([np.linalg.det([bent[k, 0], P[:, 1]]) + np.linalg.det([P[:, 0], bent[k, 1]]) for k in (0, 1)])
        if d @ y >= least or not d.any():  # d = 0: to first order no step changes det P
            return y
        base, along = d * least / (d @ d), np.array([-d[1], d[0]])  # a point of the line, and its direction
        # minimum on the line base + t along; FLAT keeps the curvature in the denominator away from zero
        curved = abs(float(along @ H @ along))
        return np.asarray(base - along * float(along @ (gradient + H @ base)) / max(curved, FLAT * float(along @ along)))

    def _try_step(self, y: Array, bends: Array) -> Place | None:
        """Return the position after a step y (f,), or None if the linkage might have jumped to another assembly."""
        N, scale = self.place.free, self.freedom.scale
        move = N @ y  # (n,) in scaled coordinates
        guess = self.q + (move + np.einsum("i,ijk,j->k", y, bends, y) / 2) / scale
        place = self.freedom.close(guess)
        if place is None or place.free.shape[1] > N.shape[1]:
            return None
        if place.free.shape[1] < N.shape[1]:  # the step has left a fork of the motion, where there are more free motions
            return place
        # the singular values of `turned` are the cosines of the angles between the old and the new free motions
        missed, turned = float(np.abs((place.q - guess) * scale).max()), N.T @ place.free
        if missed > LARGEST_MISS * np.abs(move).max() or np.linalg.svd(turned)[1][-1] < SMALLEST_COSINE:
            return None
        # give the new basis the orientation of the old one, so that the signs of det P can be compared
        place = replace(place, free=place.free * np.append(np.ones(N.shape[1] - 1), np.sign(np.linalg.det(turned))))
        # `_stay_on_side` keeps |det P| >= MARGIN to first order; terms of higher order may use up half of MARGIN
        return None if self.side and self.side * self._det(place) < MARGIN / 2 else place

    def _det(self, place: Place) -> float:
        """Return det P at a position; 0 if P is not square, or if the targets are vectors from a point `onto`."""
        return float(np.linalg.det(self._point_jacobian(place))) if place.free.shape[1] == 2 and self.onto is None else 0.0

    def _side(self) -> float:
        """Return the sign of det P; 0 if |det P| is at most MARGIN."""
        det = self._det(self.place)
        return float(np.sign(det)) if abs(det) > MARGIN else 0.0

    def _position(self, place: Place) -> Array:
        """Return the world position (2,) [m] of the dragged point, or the vector to it from the point `onto`."""
        world = position(place.q, self.point)
        return world if self.onto is None else world - position(place.q, self.onto)

    def _point_jacobian(self, place: Place) -> Array:
        """Return P (2, f): the derivatives of `_position(place)` by the amplitudes of the f free motions at `place`."""
        motions = place.free.T / self.freedom.scale  # (f, n); the derivative by an amplitude is the velocity in its motion
        states = np.broadcast_to(place.q, motions.shape)
        rates = velocity(states, motions, self.point)
        return (rates if self.onto is None else rates - velocity(states, motions, self.onto)).T

    def _centripetal(self, N: Array, point: Point) -> Array:
        """Return omega_i omega_j arm (f, f, 2), with the rotations of the point's link in the free motions N (n, f).

        This is minus the centripetal part of the second derivatives of the point.
        """
        turns = N[angle_slot(point.link)]  # for the ground this is a meaningless row, but its arm is zero
        return np.outer(turns, turns)[..., None] * arm(self.q, point)
