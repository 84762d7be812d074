"""Drag a linkage by one of its points: find the smallest change that brings the point to its target, or as near as possible.

With N a basis of the free motions, y (f,) their amounts, P = dp/dy the Jacobian of the point p, and r = p - target, each step
solves

    (P^T P + sum_k r_k d^2 p_k / dy^2 + mu 1) y = -P^T r        (Levenberg-Marquardt; mu makes the matrix positive definite)

and Gauss-Newton projects the result back onto the constraints. A step is halved until the linkage certainly moves continuously: the
free motions turn little, and the projected position is near the prediction to second order. The linkage therefore reaches another
assembly only by moving there. At a fork, a position from which it can move in several ways, it keeps its direction. If the point
determines two degrees of freedom, the linkage stays on its side of the singular positions det P = 0: an arm that is pulled straight
folds back to the side from which it came.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from gauss_bench.kinematics.freedom import Freedom, Place
from gauss_bench.mechanism.coordinates import arm, position, rotate, value, velocity
from gauss_bench.mechanism.model import GROUND, AngleDriver, Mechanism, Point, Revolute, SlideDriver
from gauss_bench.mechanism.motion_laws import constant
from gauss_bench.mechanism.spaces import angle_at, angle_slot, place_at
from gauss_bench.terms import Array

# Lengths below are shares of the linkage's size.
LARGEST_STEP = 0.15  # largest displacement in one step, and largest turn of a link [rad]
LARGEST_MISS = 0.25  # largest distance between prediction and projected position, as a share of the step
SMALLEST_COSINE = 0.9  # smallest cosine of the angle between the free motions before and after a step
HALVINGS = 12  # largest number of halvings of a step
MOST_STEPS = 60  # nine sizes of the linkage; then the studio reads the place of the pointer anew
NEAR = 1e-13  # distance from the target that only rounding leaves
RESTING = 1e-8  # size of a tiny step: the next step, of the order of its square, would be rounding
REACHED = 1e-10  # distance at which the point counts as being at its target
FLAT = 1e-9  # share of the largest curvature below which a curvature counts as zero
MARGIN = 1e-3  # smallest |det P|: about one degree before an arm is stretched, 1e-4 of its length
STANDING = 5e-3  # smallest move of the point per move of the linkage in a direction in which it can move; above MARGIN


@dataclass(frozen=True)
class Locks:
    """Parts that a drag must not move.

    Attributes:
        links: names of links that keep their angle.
        points: points "link.point" that keep their place.
        slides: names of prismatic joints that do not slide.
        joints: names of pin joints whose links keep their relative angle.
    """

    links: tuple[str, ...] = ()
    points: tuple[str, ...] = ()
    slides: tuple[str, ...] = ()
    joints: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class Dragged:
    """The result of a drag.

    Attributes:
        q: (n,) the position.
        reached: whether the point is at its target.
        apart: distance of the point from its target [m].
        note: the reason why the point is not at its target; empty if it is.
    """

    q: Array
    reached: bool
    apart: float
    note: str


def lock(mechanism: Mechanism, q: Array, locks: Locks) -> Mechanism:
    """Return the linkage without its drivers, with all locked parts fixed at their positions in q (n,).

    Raises:
        ValueError: there is no link, point, slide or joint of that name.
    """
    pins, drivers = [], []  # joints that fix points, and drivers that hold angles and slides at constant values
    for reference in locks.points:
        point = find_point(mechanism, reference)
        at = Point(GROUND, np.array(position(q, point)), f"ground at {reference}")
        if point.link != GROUND:  # a point on the ground keeps its place in any case
            pins.append(Revolute(f"lock of {reference}", f"lock of {reference}", at, point))
    for name in locks.joints:
        own = [x for x in mechanism.pins if x.joint == name]
        _check_found(own, "pin joint", name)
        pins += [_second_pin(mechanism, q, x) for x in own]
    for name in locks.links:
        _check_found([x for x in mechanism.whole.links if x.name == name], "link", name)
        body, _ = mechanism.find_body(name)
        drivers.append(AngleDriver(f"lock of {name}", constant(float(angle_at(q, body)), 0.0), body))
    for name in locks.slides:
        slides = [x for x in mechanism.slides if x.name == name]
        _check_found(slides, "slide", name)
        for slide in slides:
            drivers.append(SlideDriver(f"lock of {name}", constant(float(value(slide.motion, q)), 0.0), slide))  # type: ignore[arg-type]
    return replace(mechanism, joints=(*mechanism.joints, *pins), drivers=tuple(drivers))


def _check_found(found: list[Any], kind: str, name: str) -> None:
    """Raise ValueError if no part of that name was found."""
    if not found:
        raise ValueError(f"no {kind} {name!r} that could be locked")


def _second_pin(mechanism: Mechanism, q: Array, joint: Revolute) -> Revolute:
    """Return a second pin between the two links of a pin, away from it, so that both pins connect the links rigidly."""
    at = position(q, joint.a) + np.array([mechanism.size, 0.0])
    ends = []
    for link in (joint.a.link, joint.b.link):
        local = rotate(at - place_at(q, link), -angle_at(q, link))
        ends.append(Point(link, local, f"lock of {joint.joint}"))
    return Revolute(f"lock of {joint.name}", f"lock of {joint.joint}", ends[0], ends[1])


def find_point(mechanism: Mechanism, reference: str) -> Point:
    """Return the point "link.point".

    Raises:
        ValueError: there is no such point.
    """
    try:
        return mechanism.find_point(reference)
    except (KeyError, StopIteration) as error:
        raise ValueError(f"no point {reference!r}") from error


class Drag:
    """A drag of one point; each call of `to` continues from the last position.

    Below, N (n, f) is the basis of the free motions at the present position in scaled coordinates, as in `Freedom`, and y (f,) a
    step in this basis.

    Attributes:
        place: present position.
        side: sign of det P, which the linkage keeps; 0 until |det P| has exceeded MARGIN, and unless P is square.
        directions: number of directions in which the point could move at the beginning, at least 1.
    """

    def __init__(self, mechanism: Mechanism, q: Array, point: str | Point, locks: Locks = Locks(), onto: Point | None = None):
        """Begin a drag of the point "link.point" at an assembled q (n,).

        Targets are places in the world or, if a point `onto` of another link is given, vectors from `onto` to the point.

        Raises:
            ValueError: the point is on the ground, a name is unknown, or the joints are open at q.
        """
        self.point = find_point(mechanism, point) if isinstance(point, str) else point
        self.onto = onto
        if self.point.link == GROUND and onto is None:
            raise ValueError(f"{point} is fixed to the ground: moving it changes the linkage, it does not drag it")
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
        """Drag the point towards a target (2,) [m] in at most `most` steps."""
        target, size = np.asarray(target, dtype=float), self.freedom.size
        apart, is_stuck = self._apart(self.place, target), not self.place.free.shape[1]  # stuck if there is no free motion
        for _ in range(most):
            if apart <= NEAR * size or is_stuck:
                break
            is_stuck = not self._step(target, apart)
            apart = self._apart(self.place, target)
        if apart <= REACHED * size:
            return Dragged(self.q, True, apart, "")
        if not is_stuck:
            return Dragged(self.q, False, apart, "the target is too far away for one drag")
        why = f"{self.point.name} cannot come nearer to the target" if self.place.free.shape[1] else "nothing is left to move"
        return Dragged(self.q, False, apart, why)

    def is_at_limit(self) -> bool:
        """Tell whether the point is at the end of its path or the edge of its area: it can move in fewer directions than before."""
        return self._count_directions() < self.directions

    def _count_directions(self) -> int:
        """Return the number of independent directions in which the point can move."""
        P = self._point_jacobian(self.place)
        return int(np.sum(np.linalg.svd(P, compute_uv=False) > STANDING)) if P.size else 0

    def _apart(self, place: Place, target: Array) -> float:
        """Return the distance of the point from the target [m]."""
        return float(np.hypot(*(self.at(place) - target)))

    def _step(self, target: Array, apart: float) -> bool:
        """Take the first proposed step that brings the point nearer to its target than now, and tell whether another may help.

        `apart` is the present distance of the point from its target [m].
        """
        bends = self._bends()
        for y in self._propose_steps(self.at(self.place) - target, bends):
            place = self._try_step(y, bends)
            is_tiny = bool(np.abs(y).max() < RESTING * self.freedom.size)
            if place is not None and self._apart(place, target) < apart:
                self.place = place
                self.side = self.side or self._side()
                return not is_tiny
            if is_tiny:
                break
        return False

    def _bends(self) -> Array:
        """Return the second derivatives (f, f, n) of the scaled coordinates with respect to the free motions."""
        N = self.place.free
        f = N.shape[1]
        i, j = np.triu_indices(f)
        # `bend` is quadratic in a direction; mixed derivatives follow from x_i x_j = ((x_i + x_j)^2 - (x_i - x_j)^2) / 4
        both = np.concatenate([N[:, i] + N[:, j], N[:, i] - N[:, j]], axis=1).T
        quarters = self.freedom.bend(self.place, both) / 4
        bends = np.zeros((f, f, len(self.q)))
        bends[i, j] = bends[j, i] = quarters[: len(i)] - quarters[len(i) :]
        return bends

    def _propose_steps(self, r: Array, bends: Array) -> Iterator[Array]:
        """Yield HALVINGS steps y (f,) that bring the point nearer to its target, each half as long as the one before.

        The first solves the equation at the top of this file. It is shortened to LARGEST_STEP, and changed if it leaves its side.

        Args:
            r: (2,) vector from the target to the point [m].
            bends: (f, f, n) as from `_bends`.
        """
        P, limit = self._point_jacobian(self.place), LARGEST_STEP * self.freedom.size
        N = self.place.free / self.freedom.scale[:, None]  # (n, f) free motions in absolute coordinates
        states, rates = np.broadcast_to(self.q, bends.shape), bends / self.freedom.scale
        # second derivatives (f, f, 2) of the point: from those of the coordinates, and from turns of its arm
        bent = velocity(states, rates, self.point) - self._centripetal(N, self.point)
        if self.onto:
            bent = bent - velocity(states, rates, self.onto) + self._centripetal(N, self.onto)
        gradient, H = P.T @ r, P.T @ P + bent @ r  # of |r|^2 / 2 by y
        curvature, V = np.linalg.eigh(H)
        largest = float(np.abs(curvature).max())
        # mu makes the smallest curvature positive, and as large as its size if it is negative
        mu = max(0.0, FLAT * largest - 2.0 * float(curvature[0])) if curvature[0] < FLAT * largest else 0.0
        y: Array = -V @ ((V.T @ gradient) / (curvature + mu))
        if curvature[0] < -FLAT * largest and np.abs(y).max() < RESTING * self.freedom.size:
            y = limit * V[:, 0]  # the point is at the maximum of its distance: either direction leads nearer
        if self.side:
            y = self._stay_on_side(y, P, bent, gradient, H)
        y = y * min(1.0, limit / max(float(np.abs(self.place.free @ y).max()), np.finfo(float).tiny))
        for _ in range(HALVINGS):
            yield y
            y = y / 2

    def _stay_on_side(self, y: Array, P: Array, bent: Array, gradient: Array, H: Array) -> Array:
        """Return the step y (2,) if, to first order, it stays on this side of det P = 0, else another step that does.

        With s the side and d the gradient of s det P by y, a step stays if d . y >= MARGIN - s det P. The other step lies on the
        limiting line, d . y = MARGIN - s det P, at the smallest value of gradient . y + y . H y / 2 there.

        Args:
            P: (2, 2) Jacobian of the point by y.
            bent: (2, 2, 2) second derivatives of the point: bent[j, k] by y_j and y_k.
            gradient, H: (2,) and (2, 2) derivatives of half the squared distance from the target by y.
        """
        least = MARGIN - self.side * float(np.linalg.det(P))
        # d det P / dy_k: one column of P at a time is replaced by its derivative
        d = self.side * np.array([np.linalg.det([bent[k, 0], P[:, 1]]) + np.linalg.det([P[:, 0], bent[k, 1]]) for k in (0, 1)])
        if d @ y >= least or not d.any():
            return y
        base, along = d * least / (d @ d), np.array([-d[1], d[0]])  # a point of the line, and its direction
        curved = abs(float(along @ H @ along))
        return np.asarray(base - along * float(along @ (gradient + H @ base)) / max(curved, FLAT * float(along @ along)))

    def _try_step(self, y: Array, bends: Array) -> Place | None:
        """Return the position after a step y (f,), or None if the linkage might have jumped to another assembly.

        `bends` (f, f, n) is the result of `_bends`.
        """
        N, scale = self.place.free, self.freedom.scale
        move = N @ y  # (n,) first-order displacement in scaled coordinates
        guess = self.q + (move + np.einsum("i,ijk,j->k", y, bends, y) / 2) / scale  # to second order
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
        # a step stays on its side to first order with MARGIN to spare, of which half is left for higher orders
        return None if self.side and self.side * self._det(place) < MARGIN / 2 else place

    def _det(self, place: Place) -> float:
        """Return det P; 0 if P is not square, or if targets are vectors from a point `onto`."""
        return float(np.linalg.det(self._point_jacobian(place))) if place.free.shape[1] == 2 and self.onto is None else 0.0

    def _side(self) -> float:
        """Return the sign of det P, which distinguishes the two sides of a singular position; 0 near it."""
        det = self._det(self.place)
        return float(np.sign(det)) if abs(det) > MARGIN else 0.0

    def at(self, place: Place) -> Array:
        """Return the place (2,) of the point [m], or the vector to it from a point `onto`, at a position of the linkage."""
        here = position(place.q, self.point)
        return here if self.onto is None else here - position(place.q, self.onto)

    def _point_jacobian(self, place: Place) -> Array:
        """Return P (2, f): the derivatives of the point, or of the vector to it from `onto`, by the amounts of the free motions."""
        motions = place.free.T / self.freedom.scale  # (f, n) in absolute coordinates
        states = np.broadcast_to(place.q, motions.shape)
        rates = velocity(states, motions, self.point)
        return (rates if self.onto is None else rates - velocity(states, motions, self.onto)).T

    def _centripetal(self, N: Array, point: Point) -> Array:
        """Return the centripetal part (f, f, 2) of a point's second derivatives: omega_i omega_j times its arm.

        N (n, f) has the free motions in absolute coordinates; omega_i is the turn of the point's link in the free motion i.
        """
        turns = N[angle_slot(point.link)]  # for the ground this is a meaningless row, but its arm is zero
        return np.outer(turns, turns)[..., None] * arm(self.q, point)
