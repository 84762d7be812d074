"""Find the limits of motion and the dead centres of a linkage with one degree of freedom, with an error of the order of rounding.

The positions of the linkage form a curve q(s), whose tangent x satisfies J x = 0 for the Jacobian J of the joints. A coordinate
c(q) with the gradient g reverses where g . x = 0, and cannot drive the linkage there. Such a position is a limit of motion if c is
the driving coordinate (the crank's angle, else the measured coordinate), and a dead centre if c is another coordinate.

The curve is followed in steps of equal length, because q(s) is smooth even where a coordinate reverses. If g . x changes its sign,
a root finder searches along the tangent for g . x = 0, and solves the constraints at every trial.

Source: Govaerts, Numerical Methods for Bifurcations of Dynamical Equilibria (2000), sections 2.4 and 3.2 (fold points).
"""

from dataclasses import dataclass, replace
from functools import partial
from threading import Event

import numpy as np
from scipy.optimize import brentq

from gauss_bench.mechanism.close import minimum_norm, project
from gauss_bench.mechanism.coordinates import gradient, value
from gauss_bench.mechanism.evaluate import Constraints
from gauss_bench.mechanism.model import GROUND, Angle, Measured, Mechanism
from gauss_bench.mechanism.spaces import angles
from gauss_bench.terms import Array

STEP = 0.02  # [rad, m] length of a step along the curve
LONGEST = 4000  # largest number of steps: more than ten turns of the fastest link
ENDS = (-0.1 * STEP, 1.1 * STEP)  # distances back along the tangent between which the last step has passed a reversal
NEWTON_STEPS = 30  # largest number of corrections of a position
TOLERANCE = 1e-12  # [rad, m] largest last correction; a smaller |g . x| counts as zero
REVERSED = 1e-9  # largest |g . x| at a root; at a fork of the curve the search ends at a jump of g . x instead
SAME = 1e-6  # [rad, m] distance below which two positions are the same
RANK_TOLERANCE = 1e-7  # share of the largest singular value below which a singular value counts as zero


class ChangePoint(ArithmeticError):
    """The curve of positions forks, because the Jacobian of the joints loses rank; or another thread has ended the search."""


@dataclass(frozen=True, eq=False)
class Singular:
    """A position q (n,) at which a coordinate reverses its direction.

    Attributes:
        coordinate: name of the link (for its angle) or slide that reverses.
        kind: "limit" if this coordinate is the driving one, else "dead centre".
        value, input: values of the coordinate and of the driving coordinate at the position [rad, m].
        driving: the driving coordinate: the crank's angle or, without a crank, the measured coordinate.
    """

    coordinate: str
    kind: str
    value: float
    input: float
    driving: Measured
    q: Array

    @property
    def crank(self) -> float:
        """The angle of the crank at the position [rad]; NaN if the driving coordinate is not an angle."""
        return self.input if self.driving.unit == "rad" else float("nan")


def input_coordinate(mechanism: Mechanism) -> Measured:
    """Return the driving coordinate: the crank's angle, or the measured coordinate of a linkage without crank.

    If the measured coordinate is one of `driving_coordinates`, the member of this list is returned, which has a shorter name.
    """
    if mechanism.crank is not None:
        return Measured(mechanism.links[mechanism.crank].name, Angle(GROUND, mechanism.crank))
    for x in driving_coordinates(mechanism):
        # the measured coordinate is named "angle of LINK" or "slide NAME", a driving coordinate LINK or NAME alone
        if mechanism.measured.name == f"{'angle of' if x.unit == 'rad' else 'slide'} {x.name}":
            return x
    return mechanism.measured


def driving_coordinates(mechanism: Mechanism) -> list[Measured]:
    """Return the coordinates that a motor or cylinder on the ground can drive: those of pins and slides on the ground."""
    coordinates = []
    for joint in mechanism.joints:
        links = [end.link for end in joint.ends]
        if GROUND in links and joint.motion.unit == "rad":
            link = max(links)  # the other link: the ground has the smallest index, -1
            coordinates.append(Measured(mechanism.links[link].name, Angle(GROUND, link)))
        elif GROUND in links:
            coordinates.append(Measured(joint.name, joint.motion))
    return coordinates


class Curve:
    """The curve of positions of a linkage with one degree of freedom."""

    def __init__(self, mechanism: Mechanism):
        """Set up the constraints of the joints, without drivers and knife edges.

        Raises:
            ValueError: more or fewer than one degree of freedom.
        """
        if mechanism.dof != 1:
            raise ValueError(f"{mechanism.name} has {mechanism.dof} degrees of freedom; singular positions are found for one only")
        self.mechanism = mechanism
        self.constraints = Constraints(replace(mechanism, drivers=(), knife_edges=()))

    def tangent(self, q: Array, along: Array | None = None) -> Array:
        """Return the unit tangent (n,) of the curve at q (n,); its product with the vector `along` (n,) is not negative.

        Raises:
            ChangePoint: J has lost rank.
        """
        _, s, Vt = np.linalg.svd(self.constraints.residual(q)[1])
        rank = int((s > RANK_TOLERANCE * s[0]).sum())
        if rank < self.mechanism.n - 1:
            raise ChangePoint("the joint rows lose rank: a change point, where the motion can go on in more than one way")
        x: Array = Vt[-1]
        return -x if along is not None and x @ along < 0 else x

    def orientation(self, q: Array, x: Array) -> float:
        """Return the sign of det [J; x] for the unit tangent x (n,) at q (n,), which changes at a fork; 0 if [J; x] has no det."""
        A = np.vstack([self.constraints.residual(q)[1], x])
        return float(np.linalg.slogdet(A)[0]) if A.shape[0] == A.shape[1] else 0.0

    def step(self, q: Array, x: Array) -> Array:
        """Return the next position on the curve: a step from q along the unit tangent x, projected back onto the constraints."""
        return self._close(q + STEP * x)

    def _close(self, q: Array) -> Array:
        """Return the position (n,) near q that satisfies the constraints, by Gauss-Newton."""
        shortest = partial(minimum_norm, tolerance=RANK_TOLERANCE)
        return project(q, self.constraints.residual, shortest, NEWTON_STEPS, stop_after=lambda _, size: bool(size < TOLERANCE))

    def refine(self, coordinate: Measured, q: Array, x: Array) -> Array:
        """Return the position (n,) on the last step of a curve, which ended at q (n,), at which a coordinate reverses.

        There g . x = 0, with g (n,) the coordinate's gradient and x (n,) the unit tangent of the curve.

        Raises:
            ChangePoint: the coordinate does not reverse at a single position near here, because the curve forks.
        """

        def rate(back: float) -> float:
            """Return g . x at the closed position near q - `back` x, a step back along the tangent."""
            closed = self._close(q - back * x)
            return float(gradient(coordinate.coordinate, closed) @ self.tangent(closed, x))

        if rate(ENDS[0]) * rate(ENDS[1]) < 0:
            back = brentq(rate, *ENDS, xtol=1e-15)
            # at a fork the tangent jumps, and brentq returns the place of a jump of g . x, where it is not zero
            if abs(rate(back)) < REVERSED:
                return self._close(q - back * x)
        raise ChangePoint(f"no isolated singular position of {coordinate.name} near here: the curve forks")


def singular_positions(mechanism: Mechanism, ended: Event | None = None) -> list[Singular]:
    """Return the positions at which a coordinate of `driving_coordinates` reverses, in the order of the curve from q0.

    Another thread may set the event `ended` to end the search.

    Raises:
        ValueError: the linkage has more or fewer than one degree of freedom.
        ChangePoint: the curve of positions forks before it is closed, or the search was ended.
    """
    curve = Curve(mechanism)
    coordinates, driving = driving_coordinates(mechanism), input_coordinate(mechanism)
    positions: list[Singular] = []
    q = mechanism.q0
    tangent = curve.tangent(q, gradient(driving.coordinate, q))  # in the direction in which the driving coordinate grows
    first_tangent, orientation = tangent, curve.orientation(q, tangent)
    rates = [gradient(c.coordinate, q) @ tangent for c in coordinates]  # g . x of each coordinate at the last position
    for count in range(LONGEST):
        if ended is not None and ended.is_set():
            raise ChangePoint("the search was ended")
        q = curve.step(q, tangent)
        tangent = curve.tangent(q, tangent)
        if curve.orientation(q, tangent) * orientation < 0:
            raise ChangePoint(f"change point near {_describe(driving, q)}: the curve forks, the motion can go on in two ways")
        for k, c in enumerate(coordinates):
            rate = gradient(c.coordinate, q) @ tangent
            if rate * rates[k] < 0 or (count == 0 and abs(rates[k]) < TOLERANCE):  # a reversal since the last position, or at q0
                reversal = curve.refine(c, q, tangent)
                kind = "limit" if c.name == driving.name else "dead centre"
                # a start at a dead centre is found a second time when the curve closes
                if not any(known.coordinate == c.name and _distance(reversal, known.q) < SAME for known in positions):
                    own_value, input_value = (float(value(x.coordinate, reversal)) for x in (c, driving))
                    positions.append(Singular(c.name, kind, own_value, input_value, driving, reversal))
            rates[k] = rate
        # the curve is closed where it comes back to its start in the same direction; the first steps are still near the start
        if count > 2 and _distance(q, mechanism.q0) < 0.75 * STEP and tangent @ first_tangent > 0:
            break
    return positions


def _describe(driving: Measured, q: Array) -> str:
    """Return the name and the value of the driving coordinate at a position."""
    x = float(value(driving.coordinate, q))
    return f"{driving.name} at {np.degrees(x):.1f} deg" if driving.unit == "rad" else f"{driving.name} = {x:.4g} m"


def _distance(q: Array, other: Array) -> float:
    """Return the distance [m, rad] between two positions (n,) up to whole turns of the links."""
    gap = q - other
    angles(gap)[:] = np.angle(np.exp(1j * angles(gap)))
    return float(np.linalg.norm(gap))
