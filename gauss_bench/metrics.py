"""Compute every figure of a run except times from its trajectory, by our own code, so that no engine judges itself.

Drift and energy are evaluated in absolute coordinates. An engine that describes the linkage as a tree of joints with one pin cut
open therefore has all of its drift in that pin.
"""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gauss_bench.mechanism.coordinates import Placed, motion_of_links, position, state, value
from gauss_bench.mechanism.evaluate import Evaluator
from gauss_bench.mechanism.model import Mechanism
from gauss_bench.mechanism.spaces import angle_at, angles, bodies, place_at, places, wedge
from gauss_bench.terms import Array, largest
from gauss_bench.trajectory import Curve, Group, Reference, Trajectory

CHECKPOINTS = (0.5, 1.0, 2.0)  # [s] times at which tables list errors
REST = 1e-9  # [m/s^2, rad/s^2] smaller accelerations are rounding errors of a mechanism at rest
CHUNK = 2000  # states that are evaluated at once: limits the memory for long runs
SAME_TIME = 1e-9  # [s] times that differ by less are the same sample time


@dataclass(frozen=True, eq=False)
class Drift:
    """The distance of each sample from the constraints: (k,) largest |phi| [m, rad], |J v + phi_t| [m/s, rad/s] and |J a - gamma|.

    Rows without a position level do not count in `position`. The unit of `acceleration` is [m/s^2, rad/s^2].
    """

    position: Array
    velocity: Array
    acceleration: Array


def drift(evaluator: Evaluator, trajectory: Trajectory) -> Drift:
    """Return the largest absolute residual of the constraints at every sample, for positions, velocities and accelerations."""
    blocks = []
    h = evaluator.constraints.holonomic  # number of rows that have a position level; they come first
    for start in range(0, len(trajectory.t), CHUNK):
        part = trajectory[start : start + CHUNK]
        rows = evaluator.constraints(part.t, part.q, part.v)
        velocity = (rows.J @ part.v[..., None])[..., 0] + rows.phi_t
        acceleration = (rows.J @ part.a[..., None])[..., 0] - rows.gamma
        blocks.append([np.abs(x).max(axis=-1, initial=0.0) for x in (rows.phi[:, :h], velocity, acceleration)])
    return Drift(*(np.concatenate(x) for x in zip(*blocks, strict=True)))


class MotionGap(NamedTuple):
    """The largest differences between two motions over all links: of positions [m], angles [rad] and their rates."""

    place: float
    turn: float
    speed: float
    spin: float


@dataclass(frozen=True, eq=False)
class RateGaps:
    """The gaps between a motion and the integrals of its own rates; at each sample, the gap of the link with the largest gap.

    Attributes:
        place, turn: (k,) |q - q(0) - int v dt| [m], [rad]; speed, spin: (k,) |v - v(0) - int a dt| [m/s], [rad/s].
        bars: error bars of the four gaps: the largest change of the integrals if every second sample is left out.
        fastest: largest |v| of the motion [m/s] and [rad/s].
    """

    place: Array
    turn: Array
    speed: Array
    spin: Array
    bars: MotionGap
    fastest: tuple[float, float]


def rate_gaps(trajectory: Trajectory) -> RateGaps:
    """Return the gaps between positions and integrated velocities, and velocities and integrated accelerations, at every sample."""
    t = trajectory.t
    gaps, bars = [], []  # of positions, angles, velocities and angular velocities
    half = every_second(t)
    for level, rate in ((trajectory.q, trajectory.v), (trajectory.v, trajectory.a)):
        fine, coarse = integral(t, rate), integral(t[half], rate[half])
        # with only two samples no coarser integral exists: the bar is the difference of the left and right rectangle rules
        bar = np.diff(rate, axis=0) * np.diff(t)[:, None] if len(t) == 2 else coarse - fine[half]
        for part in (places, angles):
            gaps.append(_largest(part(level - level[:1] - fine)))
            bars.append(largest(part(bar)))
    fastest = largest(places(trajectory.v)), largest(angles(trajectory.v))
    place, turn, speed, spin = gaps
    return RateGaps(place, turn, speed, spin, MotionGap(*bars), fastest)


def start_gap(mechanism: Mechanism, trajectory: Trajectory) -> MotionGap:
    """Return the distance of the first sample from the start q0, v0 of the mechanism."""
    q, v = trajectory.q[:1] - mechanism.q0, trajectory.v[:1] - mechanism.v0
    return MotionGap(largest(places(q)), largest(angles(q)), largest(places(v)), largest(angles(v)))


def every_second(t: Array) -> NDArray[np.intp]:
    """Return the indices of every other sample of t (k,), beginning with the first, and of the last one."""
    return np.unique([*range(0, len(t), 2), len(t) - 1])


def _largest(x: Array) -> Array:
    """Return the largest |x| of each sample, (k,), for an array (k, ...) of k samples."""
    return np.asarray(np.abs(x).reshape(len(x), -1).max(axis=1, initial=0.0))


def integral(t: Array, x: Array) -> Array:
    """Integrate x (k, n) from t[0] to each of the times t (k,) by the trapezoidal rule with Gregory's end correction.

    Between two samples the integral of x is h (x0 + x1) / 2 + h^2 (x0' - x1') / 12, with derivatives x' by finite differences.
    """
    if len(t) < 2:
        return np.zeros_like(x)
    h, slope = np.diff(t)[:, None], np.gradient(x, t, axis=0)
    pieces = h * (x[1:] + x[:-1]) / 2 + h * h * (slope[:-1] - slope[1:]) / 12  # (k - 1, n)
    return np.asarray(np.concatenate([np.zeros_like(x[:1]), np.cumsum(pieces, axis=0)]))


def reactions(evaluator: Evaluator, trajectory: Trajectory) -> Array:
    """Return the multipliers (k, m) of M a + J^T lambda = Q for the accelerations of a trajectory, of least norm if not unique.

    Dry friction, a part of the generalised forces Q, depends on the multipliers, which are therefore found by iteration.

    Raises:
        UndeterminedLoads: friction with redundant rows.
        Jammed: the iteration for the friction does not converge.
    """
    J = evaluator.constraints(trajectory.t, trajectory.q, trajectory.v).J
    applied = evaluator.applied.generalised(trajectory.q, trajectory.v, trajectory.t)  # Q without dry friction
    remainder = applied - trajectory.a * evaluator.mass  # Q - M a, which the constraint forces J^T lambda balance
    has_friction = bool(evaluator.friction) and len(trajectory.t) > 0
    # with the weight M^(-1/2) the iteration for friction converges in the same states as in the integration of a motion
    root = np.sqrt(evaluator.mass) if has_friction else np.ones_like(evaluator.mass)
    inverse = np.linalg.pinv(np.swapaxes(J / root, -1, -2), rcond=1e-10)  # (k, m, n)
    multipliers = (inverse @ (remainder / root)[..., None])[..., 0]
    if not has_friction:
        return np.asarray(multipliers)
    evaluator.check_loads()
    directions = evaluator.friction.directions(trajectory.q, trajectory.v) / root[:, None]
    return evaluator.friction.solve_multipliers(multipliers, inverse @ directions)


def joint_forces(evaluator: Evaluator, trajectory: Trajectory) -> dict[str, dict[str, Array]]:
    """Return, by name of the joint, the force on its second link: fx, fy (k,) [N], and moment (k,) [N m] about the joint's point.

    The second link is the one with the second point of a pin, or the block of a slide. Springs, damping and friction in the joint
    count as applied forces.
    """
    forces: dict[str, dict[str, Array]] = {}
    columns = iter(reactions(evaluator, trajectory).T)  # multipliers (k,) of each row; the rows of joints come first
    at = Placed(trajectory.q)
    for joint in evaluator.mechanism.joints:
        arm = at.end(joint.ends[1]).arm
        fx, fy, moment = np.zeros((3, len(trajectory.t)))
        for coordinate, _ in joint.held:
            multiplier = next(columns)
            # the force on the second body is -J^T lambda; the gradient has a direction n (None for an angle) and a lever
            _, n, lever = state(coordinate, at).entries[1]
            if n is not None:
                x, y = n.parts
                fx, fy = fx - multiplier * x, fy - multiplier * y
                lever = lever - wedge(arm, n)  # about the joint's point instead of the centre of mass
            moment = moment - multiplier * lever
        forces[joint.name] = {"fx": fx, "fy": fy, "moment": moment}
    return forces


def compare_joint_forces(evaluator: Evaluator, states: Trajectory, reported: Array) -> tuple[float, float]:
    """Return the largest error of the joint forces that an engine reports, and the largest true joint force, both [N, N m].

    The true forces follow from the accelerations of the states. Both results are NaN if the engine reports no force, or if
    redundant rows leave the true forces undetermined.

    Args:
        reported: (k, joints, 3) fx, fy and moment of each joint as the engine reports them, with the signs and reference points of
            `joint_forces`; NaN for a missing number.
    """
    is_known = np.isfinite(reported)
    if evaluator.mechanism.redundant or not is_known.any():
        return np.nan, np.nan
    forces = joint_forces(evaluator, states).values()
    true = np.array([[x["fx"], x["fy"], x["moment"]] for x in forces]).transpose(2, 0, 1)  # (k, joints, 3)
    return float(np.abs(reported - true)[is_known].max()), float(np.abs(true).max())


def weld_forces(evaluator: Evaluator, trajectory: Trajectory) -> dict[str, dict[str, Array]]:
    """Return, by name of the weld, the force on the welded link: fx, fy (k,) [N], and moment (k,) [N m] about the weld's point.

    It is the part of M a that forces, joints and drivers do not explain, M a - Q + J^T lambda, summed over the links that the weld
    carries. The weld's point is the first in its definition, or the origin of the link's frame.
    """
    mechanism = evaluator.mechanism
    if not mechanism.welds:
        return {}
    links = motion_of_links(mechanism, trajectory)  # the states of every link, also of links that are welded into one body
    unwelded, multipliers = Evaluator(mechanism.whole), reactions(evaluator, trajectory)
    J = unwelded.constraints(links.t, links.q, links.v).J
    acting = unwelded.applied.generalised(links.q, links.v, links.t)
    if unwelded.friction:
        acting = acting + unwelded.friction.generalised(links.q, links.v, multipliers)
    unexplained = links.a * unwelded.mass - acting + np.einsum("kmn,km->kn", J, multipliers)
    forces: dict[str, dict[str, Array]] = {}
    for weld in mechanism.welds:
        point = position(links.q, weld.at)  # (k, 2)
        force, moment = np.zeros((len(links.t), 2)), np.zeros(len(links.t))
        for i in weld.beyond:  # links that the weld carries
            push, arm = place_at(unexplained, i), place_at(links.q, i) - point
            force = force + push
            # the link's own moment, and that of its force about the weld's point: arm x push
            moment = moment + angle_at(unexplained, i) + arm[:, 0] * push[:, 1] - arm[:, 1] * push[:, 0]
        forces[weld.name] = {"fx": force[:, 0], "fy": force[:, 1], "moment": moment}
    return forces


def driving_forces(evaluator: Evaluator, trajectory: Trajectory) -> Array:
    """Return the torque [N m] or force [N] (k, drivers) that each driver exerts along its coordinate."""
    rows = evaluator.constraints  # rows of drivers come after those of joints and before those of knife edges
    return -reactions(evaluator, trajectory)[:, rows.joint_rows : rows.holonomic]


def load_curves(evaluator: Evaluator, trajectory: Trajectory) -> Iterator[Curve]:
    """Yield the loads of a motion: components and magnitudes of joint and weld forces, then the force or torque of each driver.

    The magnitude of a slide's force has the key `normal`, because `force` is that of its driver.
    """
    mechanism = evaluator.mechanism
    sliding = {joint.name for joint in mechanism.joints if joint.motion.unit == "m"}
    pinned = {joint.name for joint in mechanism.joints if joint.ends_meet}
    joints, welds = joint_forces(evaluator, trajectory), weld_forces(evaluator, trajectory)
    for name, x in [*joints.items(), *welds.items()]:
        magnitude = "normal" if name in sliding else "force"
        yield Curve(Group.JOINT, name, "fx", "N", x["fx"])
        yield Curve(Group.JOINT, name, "fy", "N", x["fy"])
        yield Curve(Group.JOINT, name, magnitude, "N", np.hypot(x["fx"], x["fy"]))
        if name not in pinned:  # a pin has no moment
            yield Curve(Group.JOINT, name, "moment", "N m", x["moment"])
    if mechanism.drivers:
        exerted = driving_forces(evaluator, trajectory)
        for k, driver in enumerate(mechanism.drivers):
            turns = driver.coordinate.unit == "rad"
            yield Curve(Group.MOTOR, driver.name, "torque" if turns else "force", "N m" if turns else "N", exerted[:, k])


@dataclass(frozen=True)
class Peak:
    """The peak and the means of the magnitude of one load over a motion.

    Attributes:
        unit: "N" or "N m".
        largest: largest magnitude of all samples.
        t: time of the sample with the largest magnitude [s].
        crank: angle of the crank at that time [rad]; None for a linkage without a crank.
        crank_deg: the same angle in degrees, from 0 to 360.
        mean, rms: mean and root mean square of the magnitude over time.
    """

    unit: str
    largest: float
    t: float
    crank: float | None
    crank_deg: float | None
    mean: float
    rms: float


@dataclass(frozen=True)
class Loads:
    """The largest and mean loads of a motion.

    Attributes:
        until: time of the last sample [s]; None if there are no samples.
        acting: "gravity" and the names of the forces that act.
        determined: whether the motion determines the loads of single joints. With redundant rows it does not, and the peaks are
            those of the smallest loads that agree with the motion.
        peaks: peak of each load by its name, such as "PIN.force", "SLIDE.normal", "SLIDE.moment", "WELD.force" or "DRIVER.torque".
    """

    until: float | None
    acting: tuple[str, ...]
    determined: bool
    peaks: dict[str, Peak]


def summarise_loads(mechanism: Mechanism, trajectory: Trajectory, curves: Iterable[Curve]) -> Loads:
    """Return the largest and mean value of each load over a trajectory.

    The curves are those of `load_curves`; the components fx and fy are skipped.
    """
    t = trajectory.t
    peaks: dict[str, Peak] = {}
    crank = None if mechanism.crank is None else angle_at(trajectory.q, mechanism.crank)
    for curve in curves:
        if curve.key in ("fx", "fy") or not len(t):
            continue
        size = np.abs(curve.values)
        k = int(size.argmax())
        crank_angle = None if crank is None else float(crank[k])
        # a weld may have the name of a joint, or of a driven slide
        name = curve.name if curve.name not in peaks else f"{curve.group}.{curve.name}"
        peaks[name] = Peak(
            unit=curve.unit,
            largest=float(size[k]),
            t=float(t[k]),
            crank=crank_angle,
            crank_deg=None if crank_angle is None else float(np.degrees(crank_angle) % 360.0),
            mean=_mean_over_time(t, size),
            rms=float(np.sqrt(_mean_over_time(t, size * size))),
        )
    acting = (*(("gravity",) if np.any(mechanism.gravity) else ()), *(x.name for x in (*mechanism.forces, *mechanism.frictions)))
    return Loads(float(t[-1]) if len(t) else None, acting, mechanism.redundant == 0, peaks)


def _mean_over_time(t: Array, x: Array) -> float:
    """Return the mean over time of samples x (k,) at times t (k,), by the trapezoidal rule."""
    if len(t) < 2:
        return float(x.mean())
    return float(np.trapezoid(x, t) / (t[-1] - t[0]))


def friction_power(evaluator: Evaluator, trajectory: Trajectory) -> Array:
    """Return the power (k,) [W] of the dry friction in all joints; never positive."""
    if not evaluator.friction:
        return np.zeros(len(trajectory.t))
    resisting = evaluator.friction.generalised(trajectory.q, trajectory.v, reactions(evaluator, trajectory))
    return np.asarray((resisting * trajectory.v).sum(-1))


def energy_error(evaluator: Evaluator, trajectory: Trajectory) -> tuple[Array, float]:
    """Return the energy gained beyond the work done since the start (k,) [J], and the error bar of the work [J].

    Springs, gravity, constant torques and world-fixed forces have potentials. All other work is the integral of its power.
    """
    t = trajectory.t
    energy = evaluator.energy(trajectory.q, trajectory.v)
    power = evaluator.applied.power(trajectory.q, trajectory.v, trajectory.t)
    if evaluator.mechanism.drivers:
        rates = np.stack([np.broadcast_to(driver.law(t)[1], t.shape) for driver in evaluator.mechanism.drivers], axis=-1)
        power = power + (driving_forces(evaluator, trajectory) * rates).sum(-1)
    power = power + friction_power(evaluator, trajectory)
    rounding = energy_rounding(energy)
    gain = energy - energy[0]
    if not np.any(power) or len(t) < 2:
        return gain, rounding
    done, bar = work(t, power)
    return gain - done, float(bar) + rounding


def energy_rounding(energy: Array) -> float:
    """Return the change of energies (k,) [J] that rounding can cause: 8 units in the last place of (1 J + largest |energy|)."""
    return 8 * float(np.finfo(float).eps) * (1.0 + largest(energy))


def energy_scale(evaluator: Evaluator, trajectory: Trajectory) -> float:
    """Return the scale of a motion's energy [J]: its largest kinetic energy, or the range of its potential energy if larger."""
    kinetic = 0.5 * (trajectory.v * trajectory.v) @ evaluator.mass
    potential = evaluator.applied.potential(trajectory.q)
    return max(float(kinetic.max(initial=0.0)), float(np.ptp(potential)) if len(potential) else 0.0)


def without_loss(t: Array, energy_error: Array, spacing: float) -> Array:
    """Return `energy_error` (k,) [J] without its drops between samples that are more than `spacing` [s] apart.

    Between such samples a damper may dissipate energy that no sample shows.
    """
    change = np.diff(energy_error)
    is_hidden = (np.diff(t) > spacing) & (change < 0)
    return np.asarray(energy_error - np.append(0.0, np.cumsum(np.where(is_hidden, change, 0.0))))


def work(t: Array, power: Array) -> tuple[Array, Array]:
    """Return the work (k, ...) [J] done since t[0] by powers (k, ...) [W] at times t (k,), and its error bar (...).

    The power is integrated by a quintic spline. The error bar is the largest difference from the spline through every second
    sample: far larger than the true error if the samples are dense enough for the motion, and large if they are not.
    """
    from scipy.interpolate import make_interp_spline  # imported here: it takes as long as all other imports together

    def integrate(t_known: Array, known: Array) -> Array:
        """Return the integral of the spline through samples `known` (l, ...) at times (l,), from t[0] to every time of t."""
        # with few samples the largest odd degree below their number
        spline = make_interp_spline(t_known, known, k=min(5, 2 * ((len(t_known) - 2) // 2) + 1))
        primitive: Callable[[Array], Array] = spline.antiderivative()
        return np.asarray(primitive(t) - primitive(t[:1]))

    half = every_second(t)
    fine, coarse = integrate(t, power), integrate(t[half], power[half])
    return fine, np.asarray(np.abs(fine - coarse).max(axis=0))


@dataclass(frozen=True, eq=False)
class Errors:
    """The errors of a trajectory against a reference, at the k times that both have.

    Attributes:
        measured: (k,) |error| of the linkage's measured coordinate [rad or m].
        length: (k, links) |error| of a link's centre of mass, the larger of x and y [m].
        angle: (k, links) |error| of a link's angle [rad].
        velocity: (k, links) largest |error| of a link's velocities [m/s, rad/s].
        position_bar, velocity_bar: (k,) smallest significant error: the error bar of the reference or, if larger, its floor.
    """

    t: Array
    measured: Array
    length: Array
    angle: Array
    velocity: Array
    position_bar: Array
    velocity_bar: Array

    @property
    def position(self) -> Array:
        """(k, links) the larger of position error [m] and angle error [rad]."""
        return np.maximum(self.length, self.angle)

    @property
    def largest(self) -> dict[str, float]:
        """The largest errors of all times and links: "position" of centres of mass [m], and "angle" [rad]."""
        return {"position": float(self.length.max()), "angle": float(self.angle.max())}


def common_times(t: Array, true: Array) -> tuple[NDArray[np.intp], NDArray[np.bool_]]:
    """Return the times in `true` (j,) that are also in t (k,), up to SAME_TIME: their indices in t, and a mask (j,) of `true`."""
    near = np.minimum(np.searchsorted(t, true - SAME_TIME), len(t) - 1)  # (j,) index of the first time in t that is not earlier
    both = np.abs(t[near] - true) < SAME_TIME
    return near[both], both


def state_errors(mechanism: Mechanism, trajectory: Trajectory, reference: Reference) -> Errors:
    """Return the errors of a trajectory at every time of the reference at which it has a sample."""
    own_rows, reference_rows = common_times(trajectory.t, reference.t)
    dq = np.abs(trajectory.q[own_rows] - reference.q[reference_rows])
    dv = np.abs(trajectory.v[own_rows] - reference.v[reference_rows])
    coordinate = mechanism.measured.coordinate
    return Errors(
        t=reference.t[reference_rows],
        measured=np.abs(value(coordinate, trajectory.q[own_rows]) - value(coordinate, reference.q[reference_rows])),
        length=places(dq).max(axis=-1),
        angle=angles(dq),
        velocity=bodies(dv).max(axis=-1),
        position_bar=np.fmax(reference.error_q, reference.floor_q)[reference_rows],
        velocity_bar=np.fmax(reference.error_v, reference.floor_v)[reference_rows],
    )


def joint_force_errors(evaluator: Evaluator, trajectory: Trajectory, reference: Reference) -> Array:
    """Return the largest error (k,) [N] over all joints and force components, at the k times that trajectory and reference share.

    It is NaN if redundant rows leave the joint forces undetermined. Joint forces follow from accelerations by Newton's laws.
    """
    own_rows, reference_rows = common_times(trajectory.t, reference.t)
    if evaluator.mechanism.redundant:
        return np.full(len(own_rows), np.nan)
    own, true = (joint_forces(evaluator, samples) for samples in (trajectory[own_rows], reference.samples[reference_rows]))
    gaps = [np.abs(own[name][x] - true[name][x]) for name in true for x in ("fx", "fy")]
    return np.max(gaps, axis=0, initial=0.0) if gaps else np.zeros(len(own_rows))


def relative_acceleration_error(a: Array, true: Array) -> Array:
    """Return max |a - a_true| / max |a_true| (k,) for accelerations (k, n); max |a - a_true| where all |a_true| are below REST."""
    scale = np.abs(true).max(axis=-1)
    return np.asarray(np.abs(a - true).max(axis=-1) / np.where(scale > REST, scale, 1.0))


def observed_order(steps: Array, errors: Array, floors: Array) -> Array:
    """Return the order of convergence p (k,) of error ~ step^p, from each of k runs and the run before it.

    `steps` must decrease. The order is NaN for the first run, and where the error of one of the two runs is not finite or at most
    ten times its floor, the error of the reference.
    """
    order = np.full(len(steps), np.nan)
    usable = (errors > 10 * floors) & np.isfinite(errors)
    k = 1 + np.flatnonzero(usable[1:] & usable[:-1])
    order[k] = np.log(errors[k - 1] / errors[k]) / np.log(steps[k - 1] / steps[k])
    return order
