"""Compute a motion in basic coordinates, those of points: positions by a root search, rates from the differentiated equations.

Let p be the coordinates of the unknown points, x the inputs, phi(p, x) = 0 the equations of `point_equations`, and J = dphi/dp.

    prediction:     J dp = -(dphi/dx) dx, for the change dx of the inputs from the previous state
    positions:      phi(p, x) = 0, by a root search that starts at the prediction
    velocities:     J p' = -phi_t, where phi_t is the rate of phi if the unknown points rest and the inputs move
    accelerations:  J p'' = gamma = -(known points' part of phi'') - (products of velocities)

Redundant equations are solved in the least-squares sense. With A, B the places of two points of a link in the world, a, b those in
its frame, and E = (B - A) / (b - a), the angle of the link is arg E plus the whole turns that bring it nearest to its predicted
value, and its rates are omega = Im(E' conj E) and alpha = Im(E'' conj E).

A step is halved if the search fails, or ends far from the prediction or on the other side of a singular position. The motion
therefore follows an input up to its limit, and never changes to another assembly.

Sources: Men, Feng, He (see `point_equations`), section 2; Nikravesh, Computer-Aided Analysis of Mechanical Systems (1988), section
3.2.
"""

from collections.abc import Mapping

import numpy as np

from gauss_bench.kinematics.motion import LimitOfMotion, Motion, MotionError, SingularPosition, describe_drivers
from gauss_bench.kinematics.point_equations import PointModel
from gauss_bench.kinematics.root_finding import ExitFlag, gauss_newton, levenberg_marquardt
from gauss_bench.mechanism.close import walk
from gauss_bench.mechanism.equations import LEVELS
from gauss_bench.mechanism.model import Mechanism
from gauss_bench.mechanism.spaces import angles
from gauss_bench.terms import Array, largest

LARGEST_TURN = np.radians(10.0)  # [rad] largest change of an input in one step: the error of a prediction is a small part of it
LARGEST_SLIDE = 0.1  # [sizes of a link] the same for an input that is a length
SHORTEST = 2.0**-20  # shortest step as a share of the largest: a limit of motion is found to 2e-7 rad
STRAY = 0.5  # largest correction of a prediction: of points as a share of their predicted change, of angles in [rad]
TOLERANCE = 1e-14  # largest residual, as a share of the largest coordinate: 50 times the rounding of a number
RANK_TOLERANCE = 1e-4  # smallest ratio r of singular values: the error of positions is 1e-14 / r, that of rates 1e-14 / r^2 = 1e-6
PROBE = 1e-3  # share of the largest step by which the inputs move on to examine a failure: far above SHORTEST

Branch = Mapping[str, int]


def basic_motion(mechanism: Mechanism, times: Array) -> Motion:
    """Compute the motion at times (k,) [s] under the mechanism's drivers, the inputs, from the assembled start q0.

    Between two times the inputs are interpolated linearly.

    Raises:
        ValueError: the mechanism has couplings or knife edges, or drivers that do not fit it.
        LimitOfMotion: a limit of motion lies between two times.
        SingularPosition: at some time the rates are undetermined, or two assemblies meet on the way.
    """
    follower = _Follower(PointModel(mechanism))
    states: list[Array] = []
    corrections: list[int] = []
    try:
        for t in np.asarray(times, dtype=float):
            # (i, 3): value, first and second time derivative of each driver; the shape is given because there may be no driver
            laws = np.array([driver.law(t) for driver in mechanism.drivers], dtype=float).reshape(-1, LEVELS)
            follower.move_to(laws[:, 0])
            states.append(follower.state(laws[:, 1], laws[:, 2]))
            corrections.append(follower.corrections)
    except MotionError as error:
        error.reached = _motion(mechanism, states, corrections)
        raise
    return _motion(mechanism, states, corrections)


def _motion(mechanism: Mechanism, states: list[Array], corrections: list[int]) -> Motion:
    """Return the motion through states (3, n), each with the rows q, v and a; `corrections` are `Motion.iterations`."""
    q, v, a = np.array(states).reshape(-1, 3, mechanism.n).swapaxes(0, 1)
    return Motion(q, v, a, np.array(corrections, dtype=int))


def branch_of(mechanism: Mechanism, q: Array) -> Branch:
    """Return group of points -> side (+1 or -1) at the position q (n,); sides distinguish assemblies.

    The side of a group of `find_groups` is the sign of the determinant of its equations: for a dyad, the side of the line between
    its known joints. A larger group may have several assemblies with the same sign. Groups with one assembly, or with more
    equations than unknowns, are left out.
    """
    model = PointModel(mechanism)
    _, J = model.residual(model.points.inputs_at(q))(model.points.unknown_at(q))
    return {group.name: int(sign) for group, sign in zip(model.groups, model.signs(J), strict=True)}


class _StepTooLong(ArithmeticError):
    """A step of the inputs failed, or its result may belong to another assembly: a shorter step has to be tried."""


class _Follower:
    """A linkage that follows its i inputs from the assembled start, by a prediction and a root search in each step.

    Attributes:
        x, p, theta: present inputs (i,) [rad, m], coordinates (2 u,) of the unknown points [m], and angles of the links [rad].
        max_change: (i,) largest change of each input in one step [rad, m].
        signs: (g,) `PointModel.signs` of the assembly that the motion must not leave.
        tolerance: largest residual of a solution [m].
        corrections: number of iterations of all root searches since the beginning of the last call of `move_to`.
    """

    def __init__(self, model: PointModel):
        self.model = model
        q0 = model.points.mechanism.q0
        self.x, self.p, self.theta = model.points.inputs_at(q0), model.points.unknown_at(q0), angles(q0).copy()
        slide = LARGEST_SLIDE * model.size
        self.max_change = np.array([LARGEST_TURN if x.coordinate.unit == "rad" else slide for x in model.points.drivers])
        _, J = model.residual(self.x)(self.p)
        self.signs = model.signs(J)
        places = model.z_at(self.x, self.p)[model.points.first :]
        self.tolerance = TOLERANCE * max(model.size, largest(places))
        self.corrections = 0

    def move_to(self, goal: Array) -> None:
        """Move to the inputs `goal` (i,) [rad, m], in steps that are halved if necessary.

        Raises:
            ValueError: the inputs are not finite.
            LimitOfMotion, SingularPosition: the inputs cannot be followed to the goal.
        """
        if not np.isfinite(goal).all():
            raise ValueError(f"inputs are not finite: {goal}")
        start, change = self.x, goal - self.x
        # smallest number of equal steps in which no input changes by more than its `max_change`; 1e-9: rounding must not add a step
        count = max(1, int(np.ceil(largest(change / self.max_change) - 1e-9)))
        max_share = 1 / count  # the largest step, as a share of the whole change
        self.corrections = 0

        def advance(share: float) -> None:
            self._step(goal if share == 1.0 else start + share * change)

        try:
            walk(advance, SHORTEST * max_share, max_share)
        except _StepTooLong as error:  # even the shortest step failed: find out why
            raise self._failure(max_share * change) from error

    def _step(self, x: Array) -> None:
        """Move to the inputs x (i,) by one prediction and one root search.

        Raises:
            _StepTooLong: the search fails, or its result may belong to another assembly; the old position is then kept.
        """
        model = self.model
        # prediction to first order, with dphi = Re(r dz): with the change of the inputs as their rate, Z[0] is z and Z[1] dz
        Z = model.points.evaluate_known(self.x, x - self.x, np.zeros_like(x))
        Z[0] = model.fill(Z[0], self.p)
        r = model.rows(Z[0])  # complex derivatives of phi by z
        dp = -self._inverse(model.jacobian(r)) @ (r @ Z[1]).real
        Z[1] = model.fill(Z[1], dp)
        # correction: a root search from the prediction, which must end near it
        root = gauss_newton(model.residual(x), self.p + dp, self.tolerance)
        self.corrections += root.iterations
        # sqrt(tolerance) [m] is for steps that move no point: it is the accuracy of points near a double root
        max_correction = STRAY * largest(Z[1, model.points.first :]) + np.sqrt(self.tolerance)
        if root.flag != ExitFlag.CONVERGED or largest(root.x - self.p - dp) > max_correction:
            raise _StepTooLong
        # angles: they must be near their prediction too, and no group of points may have changed its side (see `branch_of`)
        E, dE = model.directions @ Z[0], model.directions @ Z[1]  # exp(i theta) of every link, and its change
        near = self.theta + (dE * E.conj()).imag  # predicted angles
        turn = np.angle(model.directions @ model.z_at(x, root.x) * np.exp(-1j * near))
        if largest(turn) > STRAY or np.any(model.signs(model.residual(x)(root.x)[1]) != self.signs):
            raise _StepTooLong
        self.x, self.p, self.theta = x, root.x, near + turn

    def _inverse(self, J: Array) -> Array:
        """Return the pseudo-inverse (2 u, m) of the Jacobian J (m, 2 u).

        Raises:
            _StepTooLong: the columns of J are dependent: a step from this position has no unique prediction.
        """
        if not J.shape[1]:
            return np.zeros(J.T.shape)
        U, s, Vt = np.linalg.svd(J, full_matrices=False)
        if len(s) < J.shape[1] or s[-1] < RANK_TOLERANCE * s[0]:
            raise _StepTooLong
        return np.asarray(Vt.T / s @ U.T)

    def state(self, rate: Array, second: Array) -> Array:
        """Return q, v, a (3, n) at the present position, for first and second time derivatives (i,) of the inputs.

        Raises:
            SingularPosition: J has lost rank, so that the rates are undetermined.
        """
        model = self.model
        Z = model.points.evaluate_known(self.x, rate, second)  # rows z, z', z'', to which `fill` adds the unknown points
        Z[0] = model.fill(Z[0], self.p)
        r = model.rows(Z[0])
        J = model.jacobian(r)
        try:
            inverse = self._inverse(J)
        except _StepTooLong as error:
            raise self._singular(J) from error
        Z[1] = model.fill(Z[1], -inverse @ (r @ Z[1]).real)
        Z[2] = model.fill(Z[2], -inverse @ ((r @ Z[2]).real + model.bias(Z[1])))
        # (3, links) each: exp(i theta) and centres of mass, with two derivatives
        E, centre = Z @ model.directions.T, Z @ model.centres.T
        turns = (self.theta, *(E[1:] * E[0].conj()).imag)
        return np.stack([centre.real, centre.imag, turns], axis=-1).reshape(3, -1)

    def _failure(self, step: Array) -> MotionError:
        """Return the exception that tells why the motion ends here: at a limit, or else at a singular position.

        At a limit the equations have no solution if the inputs move on by a small part of `step` (i,), the largest step in the
        direction of the motion.
        """
        # a solution just ahead counts only if it is near the present points, in the same assembly;
        # Levenberg-Marquardt comes as near as the links reach, where Gauss-Newton would diverge
        ahead = levenberg_marquardt(self.model.residual(self.x + PROBE * step), self.p, self.tolerance)
        same_branch = largest(ahead.x - self.p) < LARGEST_SLIDE * self.model.size
        if ahead.flag == ExitFlag.CONVERGED and same_branch:
            return self._singular(self.model.residual(self.x)(self.p)[1])
        opening = f"just ahead the equations stay open by {ahead.residual:.2g} m"
        return LimitOfMotion(f"no solution beyond {self._inputs()}: a limit of motion; {opening}", self.x)

    def _inputs(self) -> str:
        """Return a text with the names and present values of the inputs."""
        points = self.model.points
        return describe_drivers(points.mechanism, {d.name: x for d, x in zip(points.drivers, self.x, strict=True)})

    def _singular(self, J: Array) -> SingularPosition:
        """Return the exception for the present position, at which the Jacobian J has lost rank."""
        s = np.linalg.svd(J, compute_uv=False)
        rank = int((s >= RANK_TOLERANCE * s.max(initial=0.0)).sum())
        counts = f"rank {rank} of {J.shape[1]}, smallest singular value {s.min(initial=np.inf):.2g}"
        return SingularPosition(f"singular position near {self._inputs()}: {counts}", self.x)
