"""Singular positions of a linkage with one degree of freedom: limits of motion and dead centres, solved exactly.

The positions form a curve q(s) with the tangent x, J x = 0. A coordinate c(q) with gradient g cannot drive the linkage where
g . x = 0: there it reverses. For the crank that is a limit of its motion, for any other coordinate a dead centre. The curve is
followed by its own length, which passes such points without noticing them; a change of sign of g . x is refined by Newton on

    phi(q) = 0,    J(q) x = 0,    g(q) . x = 0,    |x|^2 = 1

in the 2 n unknowns (q, x). The derivative of J x along y is the bilinear form that gamma is the quadratic form of:

    d(J x)/dq y = (gamma(q, x - y) - gamma(q, x + y)) / 4

Source: Govaerts, Numerical Methods for Bifurcations of Dynamical Equilibria (2000), sections 2.4 and 3.2 (fold points).
"""

from dataclasses import dataclass, replace

import numpy as np

from gauss_bench.mechanism.close import project
from gauss_bench.mechanism.constraints import Constraints
from gauss_bench.mechanism.coordinates import gradient, value
from gauss_bench.mechanism.model import GROUND, Along, Angle, Coordinate, Mechanism, Prismatic
from gauss_bench.terms import Array

STEP = 0.02  # [rad, m] along the curve: a fiftieth of a radian of the fastest link
LONGEST = 4000  # steps: more than ten turns of the fastest link
NEWTON_STEPS = 30
TOLERANCE = 1e-12
RANK_TOLERANCE = 1e-7  # of the largest singular value: the curve forks there


class ChangePoint(ArithmeticError):
    """The curve of positions forks: the joint rows lose rank, and the motion can go on in more than one way."""


@dataclass(frozen=True, eq=False)
class DrivingCoordinate:
    """A coordinate that may drive the linkage."""

    name: str
    scalar: Coordinate

    def of(self, q: Array) -> tuple[float, Array]:
        """Value and gradient (n,) at q (n,)."""
        return float(value(self.scalar, q)), gradient(self.scalar, q)


@dataclass(frozen=True, eq=False)
class Singular:
    """A position at which a coordinate reverses.

    Attributes:
        coordinate: name of the link (its angle) or slide (its place).
        kind: "limit" for what drives, "dead centre" for any other coordinate.
        value: of the coordinate [rad, m]; input: of what drives, there [rad, m].
        driving: what drives: the crank's angle or, without a crank, the measured coordinate.
        q: (n,) the position.
    """

    coordinate: str
    kind: str
    value: float
    input: float
    driving: DrivingCoordinate
    q: Array

    @property
    def crank(self) -> float:
        """Angle of the crank there [rad]; not a number where no angle drives."""
        return self.input if isinstance(self.driving.scalar, Angle) else float("nan")


def input_coordinate(mechanism: Mechanism) -> DrivingCoordinate:
    """The coordinate taken to drive: the crank's angle, or the measured coordinate of a linkage without crank."""
    if mechanism.crank is not None:
        return DrivingCoordinate(mechanism.links[mechanism.crank].name, Angle(GROUND, mechanism.crank))
    measured = mechanism.measured
    same = (x.name for x in driving_coordinates(mechanism) if _alike(x.scalar, measured.coordinate))
    return DrivingCoordinate(next(same, measured.name), measured.coordinate)


def _alike(a: Coordinate, b: Coordinate) -> bool:
    """Tell whether two coordinates are one: the same angle of a link, or the way along the same slide."""
    if isinstance(a, Angle) and isinstance(b, Angle):
        return (a.a, a.b) == (b.a, b.b)
    return isinstance(a, Along) and isinstance(b, Along) and (a.origin, a.point, a.angle) == (b.origin, b.point, b.angle)


def driving_coordinates(mechanism: Mechanism) -> list[DrivingCoordinate]:
    """Angles of links with a pin on the ground, and places along slides on the ground: what a motor or a cylinder can hold."""
    coordinates: list[DrivingCoordinate] = []
    for joint in mechanism.joints:
        if isinstance(joint, Prismatic):
            if GROUND in (joint.guide.link, joint.block.link):
                coordinates.append(DrivingCoordinate(joint.name, joint.motion))
        elif GROUND in (joint.a.link, joint.b.link):
            link = max(joint.a.link, joint.b.link)
            coordinates.append(DrivingCoordinate(mechanism.links[link].name, Angle(GROUND, link)))
    return coordinates


class Curve:
    """The curve of positions of a linkage with one degree of freedom."""

    def __init__(self, mechanism: Mechanism):
        if mechanism.dof != 1:
            raise ValueError(f"{mechanism.name} has {mechanism.dof} degrees of freedom; singular positions are found for one")
        self.mechanism = mechanism
        self.constraints = Constraints(replace(mechanism, drivers=(), knife_edges=()))

    def rows(self, q: Array) -> tuple[Array, Array]:
        """phi (m,) and J (m, n)."""
        rows = self.constraints(0.0, q, np.zeros_like(q))
        return rows.phi, rows.J

    def tangent(self, q: Array, along: Array | None = None) -> Array:
        """Unit tangent (n,), turned to the side of `along`.

        Raises:
            ChangePoint: J has lost rank.
        """
        _, s, Vt = np.linalg.svd(self.rows(q)[1])
        rank = int((s > RANK_TOLERANCE * s[0]).sum())
        if rank < self.mechanism.n - 1:
            raise ChangePoint("the joint rows lose rank: a change point, where the motion can go on in more than one way")
        x: Array = Vt[-1]
        return -x if along is not None and x @ along < 0 else x

    def orientation(self, q: Array, x: Array) -> float:
        """Sign of det [J; x], which changes where another curve crosses; 0 where J is not one row short of square."""
        A = np.vstack([self.rows(q)[1], x])
        return float(np.linalg.slogdet(A)[0]) if A.shape[0] == A.shape[1] else 0.0

    def step(self, q: Array, x: Array) -> Array:
        """The next position: along the tangent, then back to the constraints."""

        def shortest(J: Array, phi: Array) -> Array:
            return np.asarray(np.linalg.lstsq(J, phi, rcond=RANK_TOLERANCE)[0])

        return project(q + STEP * x, self.rows, shortest, NEWTON_STEPS, still=lambda _, size: bool(size < TOLERANCE))

    def refine(self, coordinate: DrivingCoordinate, q: Array, x: Array) -> Array:
        """The position near q at which g . x = 0.

        Raises:
            ChangePoint: Newton does not converge, as happens where the curve forks.
        """
        n = self.mechanism.n
        basis = np.eye(n)
        for _ in range(NEWTON_STEPS):
            phi, J = self.rows(q)
            _, g = coordinate.of(q)
            both = self.constraints(0.0, np.tile(q, (2 * n, 1)), np.concatenate([x - basis, x + basis])).gamma
            bent = (both[:n] - both[n:]).T / 4
            h = 1e-6  # the gradient of a slide turns with its guide; g is exact, only its own slope is by differences
            slope = np.array([(coordinate.of(q + h * e)[1] - coordinate.of(q - h * e)[1]) @ x / (2 * h) for e in basis])
            F = np.concatenate([phi, J @ x, [g @ x], [(x @ x - 1) / 2]])
            zero = np.zeros_like(J)
            A = np.block([[J, zero], [bent, J], [slope[None], g[None]], [np.zeros((1, n)), x[None]]])
            change = np.linalg.lstsq(A, F, rcond=1e-12)[0]
            q, x = q - change[:n], x - change[n:]
            if np.abs(change).max() < TOLERANCE:
                return q
        raise ChangePoint(f"no isolated singular position of {coordinate.name} near here: the curve forks")


def singular_positions(mechanism: Mechanism, coordinates: list[DrivingCoordinate] | None = None) -> list[Singular]:
    """All positions at which a driving coordinate reverses, in the order in which the curve from q0 meets them.

    Raises:
        ValueError: more or fewer than one degree of freedom.
        ChangePoint: the curve forks on the way.
    """
    curve = Curve(mechanism)
    coordinates = coordinates or driving_coordinates(mechanism)
    driving = input_coordinate(mechanism)
    positions: list[Singular] = []
    q, x = mechanism.q0, curve.tangent(mechanism.q0)
    x = -x if driving.of(q)[1] @ x < 0 else x
    first = x
    side = curve.orientation(q, x)
    signs = [c.of(q)[1] @ x for c in coordinates]
    for count in range(LONGEST):
        q = curve.step(q, x)
        x = curve.tangent(q, x)
        if curve.orientation(q, x) * side < 0:
            raise ChangePoint(f"change point near {_describe(driving, q)}: the curve forks, the motion can go on in two ways")
        for k, coordinate in enumerate(coordinates):
            sign = coordinate.of(q)[1] @ x
            if sign * signs[k] < 0 or (count == 0 and abs(signs[k]) < TOLERANCE):
                positions.append(_singular(curve, coordinate, q, x, driving))
            signs[k] = sign
        if count > 2 and _close(q, mechanism.q0, STEP) and x @ first > 0:
            break
    return _distinct(positions)


def _describe(driving: DrivingCoordinate, q: Array) -> str:
    """Name the place of the driving coordinate, in words."""
    x = driving.of(q)[0]
    return f"{driving.name} at {np.degrees(x):.1f} deg" if isinstance(driving.scalar, Angle) else f"{driving.name} = {x:.4g} m"


def _singular(curve: Curve, coordinate: DrivingCoordinate, q: Array, x: Array, driving: DrivingCoordinate) -> Singular:
    at = curve.refine(coordinate, q, x)
    kind = "limit" if coordinate.name == driving.name else "dead centre"
    return Singular(coordinate.name, kind, coordinate.of(at)[0], driving.of(at)[0], driving, at)


def _close(q: Array, start: Array, step: float) -> bool:
    gap = q - start
    gap[2::3] = np.angle(np.exp(1j * gap[2::3]))
    return bool(np.linalg.norm(gap) < 0.75 * step)


def _distinct(positions: list[Singular]) -> list[Singular]:
    """Without repeated positions: a start at a dead centre is found a second time when the curve closes."""
    kept: list[Singular] = []
    for one in positions:
        if not any(k.coordinate == one.coordinate and _close(one.q.copy(), k.q, 1e-6) for k in kept):
            kept.append(one)
    return kept
