"""Singular positions of a linkage with one degree of freedom: limits of motion and dead centres, solved exactly.

The positions form a curve q(s) with the tangent x, J x = 0. A coordinate c(q) with gradient g cannot drive the linkage where
g . x = 0: there it reverses. For the crank that is a limit of its motion, for any other coordinate a dead centre. The curve is
followed by its own length, which passes such points without noticing them. Where g . x changes its sign between two positions, the
root lies on the curve between them: one unknown, the way back along the tangent, with the constraints closed at every trial.
Source: Govaerts, Numerical Methods for Bifurcations of Dynamical Equilibria (2000), sections 2.4 and 3.2 (fold points).
"""

from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import brentq

from gauss_bench.mechanism.close import project
from gauss_bench.mechanism.coordinates import gradient, value
from gauss_bench.mechanism.evaluate import Constraints
from gauss_bench.mechanism.model import GROUND, Along, Angle, Coordinate, Measured, Mechanism
from gauss_bench.mechanism.spaces import angles
from gauss_bench.terms import Array

STEP = 0.02  # [rad, m] along the curve: a fiftieth of a radian of the fastest link
LONGEST = 4000  # steps: more than ten turns of the fastest link
ENDS = (-0.1 * STEP, 1.1 * STEP)  # back along the tangent, between which a reversal lies that a step has passed
NEWTON_STEPS = 30
TOLERANCE = 1e-12
REVERSED = 1e-9  # g . x at a reversal, where a curve that forks leaves a jump
SAME = 1e-6  # two positions as near as that are one
RANK_TOLERANCE = 1e-7  # of the largest singular value: the curve forks there


class ChangePoint(ArithmeticError):
    """The curve of positions forks: the joint rows lose rank, and the motion can go on in more than one way."""


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
    driving: Measured
    q: Array

    @property
    def crank(self) -> float:
        """Angle of the crank there [rad]; not a number where no angle drives."""
        return self.input if isinstance(self.driving.coordinate, Angle) else float("nan")


def input_coordinate(mechanism: Mechanism) -> Measured:
    """The coordinate taken to drive: the crank's angle, or the measured coordinate of a linkage without crank."""
    if mechanism.crank is not None:
        return Measured(mechanism.links[mechanism.crank].name, Angle(GROUND, mechanism.crank))
    measured = mechanism.measured
    return next((x for x in driving_coordinates(mechanism) if _alike(x.coordinate, measured.coordinate)), measured)


def _alike(a: Coordinate, b: Coordinate) -> bool:
    """Tell whether two coordinates are one: the same angle of a link, or the way along the same slide."""
    if isinstance(a, Angle) and isinstance(b, Angle):
        return (a.a, a.b) == (b.a, b.b)
    return isinstance(a, Along) and isinstance(b, Along) and (a.origin, a.point, a.angle) == (b.origin, b.point, b.angle)


def driving_coordinates(mechanism: Mechanism) -> list[Measured]:
    """Angles of links with a pin on the ground, and places along slides on the ground: what a motor or a cylinder can hold."""
    coordinates = []
    for joint in mechanism.joints:
        links = [end.link for end in joint.ends]
        if GROUND in links:
            turning = max(links)
            pin = Measured(mechanism.links[turning].name, Angle(GROUND, turning))
            coordinates.append(Measured(joint.name, joint.motion) if joint.slides else pin)
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
        return self._closed(q + STEP * x)

    def _closed(self, q: Array) -> Array:
        def shortest(J: Array, phi: Array) -> Array:
            return np.asarray(np.linalg.lstsq(J, phi, rcond=RANK_TOLERANCE)[0])

        return project(q, self.rows, shortest, NEWTON_STEPS, still=lambda _, size: bool(size < TOLERANCE))

    def refine(self, coordinate: Measured, q: Array, x: Array) -> Array:
        """The position before q, at most a step away, at which g . x = 0.

        Raises:
            ChangePoint: there is none, as happens where the curve forks.
        """

        def place(back: float) -> tuple[Array, float]:
            here = self._closed(q - back * x)
            return here, float(gradient(coordinate.coordinate, here) @ self.tangent(here, x))

        ends = [place(back)[1] for back in ENDS]
        if ends[0] * ends[1] < 0:
            here, left = place(brentq(lambda back: place(back)[1], *ENDS, xtol=1e-15))
            if abs(left) < REVERSED:
                return here
        raise ChangePoint(f"no isolated singular position of {coordinate.name} near here: the curve forks")


def singular_positions(mechanism: Mechanism, coordinates: list[Measured] | None = None) -> list[Singular]:
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
    x = -x if gradient(driving.coordinate, q) @ x < 0 else x
    first, side = x, curve.orientation(q, x)
    signs = [gradient(c.coordinate, q) @ x for c in coordinates]
    for count in range(LONGEST):
        q = curve.step(q, x)
        x = curve.tangent(q, x)
        if curve.orientation(q, x) * side < 0:
            raise ChangePoint(f"change point near {_describe(driving, q)}: the curve forks, the motion can go on in two ways")
        for k, c in enumerate(coordinates):
            sign = gradient(c.coordinate, q) @ x
            if sign * signs[k] < 0 or (count == 0 and abs(signs[k]) < TOLERANCE):
                at = curve.refine(c, q, x)
                kind = "limit" if c.name == driving.name else "dead centre"
                found = Singular(c.name, kind, float(value(c.coordinate, at)), float(value(driving.coordinate, at)), driving, at)
                # a start at a dead centre is found a second time when the curve closes
                if not any(k.coordinate == c.name and _distance(at, k.q) < SAME for k in positions):
                    positions.append(found)
            signs[k] = sign
        if count > 2 and _distance(q, mechanism.q0) < 0.75 * STEP and x @ first > 0:
            break
    return positions


def _describe(driving: Measured, q: Array) -> str:
    """Describe the position of the driving coordinate in words."""
    x = float(value(driving.coordinate, q))
    return f"{driving.name} at {np.degrees(x):.1f} deg" if isinstance(driving.coordinate, Angle) else f"{driving.name} = {x:.4g} m"


def _distance(q: Array, other: Array) -> float:
    """Return the distance between two positions modulo whole turns."""
    gap = q - other
    angles(gap)[:] = np.angle(np.exp(1j * angles(gap)))
    return float(np.linalg.norm(gap))
