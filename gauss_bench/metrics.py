"""Every number of the table except times, computed from a mechanism, a trajectory and a reference: no engine grades itself.

Drift and energy are evaluated in absolute coordinates, so that the joints of a tree engine count as exact and the drift of its cut
pin is seen. Errors are the larger of metres and radians over all links unless stated otherwise.
"""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gauss_bench.mechanism.coordinates import Placed, position, spread, state, value
from gauss_bench.mechanism.evaluate import Evaluator
from gauss_bench.mechanism.model import AngleDriver, Mechanism
from gauss_bench.mechanism.spaces import angle_at, angles, bodies, place_at, places, wedge
from gauss_bench.terms import Array
from gauss_bench.trajectory import Curve, Group, Reference, Trajectory

CHECKPOINTS = (0.5, 1.0, 2.0)  # [s]
REST = 1e-9  # [m/s^2, rad/s^2] accelerations below it are rounding of a mechanism at rest
CHUNK = 2000  # states evaluated at once: bounds the memory of long runs


@dataclass(frozen=True, eq=False)
class Drift:
    """The distance of each sample from the constraints.

    Attributes:
        position: (k,) max |phi| [m, rad] of the rows that have a position level.
        velocity: (k,) max |J v + phi_t| [m/s, rad/s].
        acceleration: (k,) max |J a - gamma| [m/s^2, rad/s^2].
    """

    position: Array
    velocity: Array
    acceleration: Array


def drift(evaluator: Evaluator, trajectory: Trajectory) -> Drift:
    """Compute the residuals of position, velocity and acceleration at every sample."""
    blocks = []
    h = evaluator.constraints.holonomic
    for start in range(0, len(trajectory.t), CHUNK):
        part = trajectory[start : start + CHUNK]
        rows = evaluator.constraints(part.t, part.q, part.v)
        velocity = (rows.J @ part.v[..., None])[..., 0] + rows.phi_t
        acceleration = (rows.J @ part.a[..., None])[..., 0] - rows.gamma
        blocks.append([np.abs(x).max(axis=-1, initial=0.0) for x in (rows.phi[:, :h], velocity, acceleration)])
    return Drift(*(np.concatenate(x) for x in zip(*blocks, strict=True)))


@dataclass(frozen=True, eq=False)
class RateGaps:
    """The gaps between a motion and the integrals of its own rates; largest of the links at each sample.

    Attributes:
        place, turn: (k,) |q - q(0) - int v dt| [m], [rad].
        speed, spin: (k,) |v - v(0) - int a dt| [m/s], [rad/s].
        bars: error bars of these four: the change of the integrals when every second sample is left out.
        fastest: largest |v| of the motion [m/s] and [rad/s].
    """

    place: Array
    turn: Array
    speed: Array
    spin: Array
    bars: tuple[float, float, float, float]
    fastest: tuple[float, float]


def rate_gaps(trajectory: Trajectory) -> RateGaps:
    """Integrate velocities and accelerations through the samples and compare with positions and velocities."""
    t, gaps, bars = trajectory.t, [], []
    half = np.unique([*range(0, len(t), 2), len(t) - 1])
    for level, rate in ((trajectory.q, trajectory.v), (trajectory.v, trajectory.a)):
        fine, coarse = integral(t, rate), integral(t[half], rate[half])
        # with only two samples no coarser integral exists: the bar is the difference of the left and right rectangle rules
        unknown = np.diff(rate, axis=0) * np.diff(t)[:, None] if len(t) == 2 else coarse - fine[half]
        for part in (places, angles):
            gaps.append(_largest(part(level - level[:1] - fine)))
            bars.append(float(_largest(part(unknown)).max(initial=0.0)))
    fastest = tuple(float(np.abs(part(trajectory.v)).max(initial=0.0)) for part in (places, angles))
    return RateGaps(gaps[0], gaps[1], gaps[2], gaps[3], (bars[0], bars[1], bars[2], bars[3]), (fastest[0], fastest[1]))


def start_gaps(mechanism: Mechanism, trajectory: Trajectory) -> tuple[float, float, float, float]:
    """Return the distance of the first sample from the start: places [m], angles [rad], velocities [m/s], spins [rad/s]."""
    gaps = ((trajectory.q[:1] - mechanism.q0), (trajectory.v[:1] - mechanism.v0))
    place, turn, speed, spin = (float(np.abs(part(x)).max(initial=0.0)) for x in gaps for part in (places, angles))
    return place, turn, speed, spin


def _largest(x: Array) -> Array:
    """Return the largest |x| (k,) of each sample (k, ...)."""
    return np.asarray(np.abs(x).reshape(len(x), -1).max(axis=1, initial=0.0))


def integral(t: Array, x: Array) -> Array:
    """Integrate x (k, n) from t[0] to each of the times t (k,) by trapezia with Gregory's end correction.

    int x dt = h (x0 + x1) / 2 + h^2 (x0' - x1') / 12, the derivatives from differences of neighbours.
    """
    if len(t) < 2:
        return np.zeros_like(x)
    h, slope = np.diff(t)[:, None], np.gradient(x, t, axis=0)
    pieces = h * (x[1:] + x[:-1]) / 2 + h * h * (slope[:-1] - slope[1:]) / 12
    whole: Array = np.concatenate([np.zeros_like(x[:1]), np.cumsum(pieces, axis=0)])
    return whole


def reactions(evaluator: Evaluator, trajectory: Trajectory) -> Array:
    """Multipliers (k, m) of M a + J^T lambda = Q from the trajectory's own accelerations.

    Where rows are redundant only J^T lambda is determined; the shortest lambda is given. Dry friction in joints is part of Q and
    follows from the same multipliers.

    Raises:
        UndeterminedLoads: friction with redundant rows.
        Jammed: the friction does not settle.
    """
    rows = evaluator.constraints(trajectory.t, trajectory.q, trajectory.v)
    free = evaluator.applied.generalised(trajectory.q, trajectory.v, trajectory.t) - trajectory.a * evaluator.mass
    if evaluator.friction and len(trajectory.t):
        return _reactions_with_friction(evaluator, trajectory, rows.J, free)
    inverse = np.linalg.pinv(np.swapaxes(rows.J, -1, -2), rcond=1e-10)
    return np.asarray((inverse @ free[..., None])[..., 0])


def _reactions_with_friction(evaluator: Evaluator, trajectory: Trajectory, J: Array, free: Array) -> Array:
    """Return multipliers as `reactions` does, weighted by M^(-1/2): the iteration then converges where that of the motion does."""
    evaluator.check_loads()
    root = np.sqrt(evaluator.mass)
    inverse = np.linalg.pinv(np.swapaxes(J / root, -1, -2), rcond=1e-10)
    directions = evaluator.friction.directions(trajectory.q, trajectory.v) / root[:, None]
    return evaluator.friction.consistent((inverse @ (free / root)[..., None])[..., 0], inverse @ directions)


def joint_forces(evaluator: Evaluator, trajectory: Trajectory) -> dict[str, dict[str, Array]]:
    """Return for each pair of a joint the force (fx, fy) [N] on the second-named link and its moment [N m] about the joint's point.

    The second link is the later one in `at`, or the block of a slide. Springs, damping and friction in the joint count as applied
    forces and are not included.
    """
    multipliers = reactions(evaluator, trajectory)
    forces: dict[str, dict[str, Array]] = {}
    columns = iter(multipliers.T)
    at = Placed(trajectory.q)
    for joint in evaluator.mechanism.joints:
        arm = at.end(joint.ends[1]).arm
        fx, fy, moment = np.zeros((3, len(trajectory.t)))
        for coordinate, _ in joint.held:
            multiplier, (_, n, lever) = next(columns), state(coordinate, at).entries[1]
            if n is not None:
                x, y = n.parts
                fx, fy = fx - multiplier * x, fy - multiplier * y
                lever = lever - wedge(arm, n)  # about the joint's point, no longer about the centre of mass
            moment = moment - multiplier * lever
        forces[joint.name] = {"fx": fx, "fy": fy, "moment": moment}
    return forces


def compare_joint_forces(evaluator: Evaluator, states: Trajectory, told: Array) -> tuple[float, float]:
    """Return the largest error of joint forces that an engine tells itself, and the largest true force; both [N, N m].

    The true forces follow from the accelerations of the states by Newton's laws. The error is NaN if the engine tells none, or if
    redundant rows leave them undetermined.

    Args:
        told: (k, joints, 3) fx, fy and moment as `joint_forces` has them; NaN where the engine tells none.
    """
    if evaluator.mechanism.redundant or not np.isfinite(told).any():
        return np.nan, np.nan
    found = joint_forces(evaluator, states)
    true = np.array([[x["fx"], x["fy"], x["moment"]] for x in found.values()]).transpose(2, 0, 1)  # (k, joints, 3)
    known = np.isfinite(told)
    return float(np.abs(told - true)[known].max()), float(np.abs(true).max())


def weld_forces(evaluator: Evaluator, trajectory: Trajectory) -> dict[str, dict[str, Array]]:
    """Return for each weld the force (fx, fy) [N] on the welded link and the moment [N m] about the point of the weld.

    That point is the first that the weld names, else the origin of the link's own frame. It is what the links beyond the weld lack
    of Newton's and Euler's equations, with all forces, joints and drivers that act on them:  M a - Q + J^T lambda.
    """
    mechanism = evaluator.mechanism
    if not mechanism.welds:
        return {}
    told, multipliers = spread(mechanism, trajectory), reactions(evaluator, trajectory)
    apart = Evaluator(mechanism.whole)
    J = apart.constraints(told.t, told.q, told.v).J
    acting = apart.applied.generalised(told.q, told.v, told.t)
    if apart.friction:
        acting = acting + apart.friction.generalised(told.q, told.v, multipliers)
    lacking = told.a * apart.mass - acting + np.einsum("kmn,km->kn", J, multipliers)
    forces: dict[str, dict[str, Array]] = {}
    for weld in mechanism.welds:
        at = position(told.q, weld.at)
        force, moment = np.zeros((len(told.t), 2)), np.zeros(len(told.t))
        for i in weld.beyond:
            push, arm = place_at(lacking, i), place_at(told.q, i) - at
            force = force + push
            moment = moment + angle_at(lacking, i) + arm[:, 0] * push[:, 1] - arm[:, 1] * push[:, 0]
        forces[weld.name] = {"fx": force[:, 0], "fy": force[:, 1], "moment": moment}
    return forces


def driving_forces(evaluator: Evaluator, trajectory: Trajectory) -> Array:
    """Return the torque [N m] or force [N] (k, drivers) that each driver exerts along its coordinate."""
    rows = evaluator.constraints
    return -reactions(evaluator, trajectory)[:, rows.joint_rows : rows.holonomic]


def load_curves(evaluator: Evaluator, trajectory: Trajectory) -> Iterator[Curve]:
    """Yield the loads of a motion: components and magnitudes of joint and weld forces, then what each driver exerts.

    The force of a slide is normal to its guide. Its magnitude is called `normal`: `force` of a driven slide is its driver's.
    """
    mechanism = evaluator.mechanism
    slides = {joint.name for joint in mechanism.slides}
    joints, welds = joint_forces(evaluator, trajectory), weld_forces(evaluator, trajectory)
    for name, x in [*joints.items(), *welds.items()]:
        magnitude = "normal" if name in slides else "force"
        yield Curve(Group.JOINT, name, "fx", "N", x["fx"])
        yield Curve(Group.JOINT, name, "fy", "N", x["fy"])
        yield Curve(Group.JOINT, name, magnitude, "N", np.hypot(x["fx"], x["fy"]))
        if name in slides or name not in joints:  # a pin has no moment
            yield Curve(Group.JOINT, name, "moment", "N m", x["moment"])
    if mechanism.drivers:
        exerted = driving_forces(evaluator, trajectory)
        for k, driver in enumerate(mechanism.drivers):
            turns = isinstance(driver, AngleDriver)
            yield Curve(Group.MOTOR, driver.name, "torque" if turns else "force", "N m" if turns else "N", exerted[:, k])


@dataclass(frozen=True)
class Peak:
    """One load over a motion, by its magnitude.

    Attributes:
        unit: "N" or "N m".
        largest: magnitude at the sample where it is largest; t: time of that sample [s].
        crank, crank_deg: angle of the crank then [rad], and the same in degrees, within one turn; None without a crank.
        mean, rms: of the magnitude, over time.
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
        until: end of the samples that they are taken from [s]; None if there are none.
        acting: "gravity" and the forces of the file that act.
        determined: whether the loads of single joints are determined; with redundant rows they are not, and those of least norm
            are given.
        peaks: load by name: "PIN.force", "SLIDE.normal", "SLIDE.moment", "WELD.force", "WELD.moment", "DRIVER.torque",
            "DRIVER.force".
    """

    until: float | None
    acting: tuple[str, ...]
    determined: bool
    peaks: dict[str, Peak]


def summarise_loads(mechanism: Mechanism, trajectory: Trajectory, curves: Iterable[Curve]) -> Loads:
    """Return the largest and mean loads of the curves, which `load_curves` gave for the samples of a trajectory."""
    t, peaks = trajectory.t, dict[str, Peak]()
    crank = None if mechanism.crank is None else angle_at(trajectory.q, mechanism.crank)
    for curve in curves:
        if curve.key in ("fx", "fy") or not len(t):
            continue
        size = np.abs(curve.values)
        k = int(size.argmax())
        turned = None if crank is None else float(crank[k])
        # a weld may have the name of a joint or of a driven slide: no load may take the place of another
        name = curve.name if curve.name not in peaks else f"{curve.group}.{curve.name}"
        peaks[name] = Peak(
            unit=curve.unit,
            largest=float(size[k]),
            t=float(t[k]),
            crank=turned,
            crank_deg=None if turned is None else float(np.degrees(turned) % 360.0),
            mean=_mean_over_time(t, size),
            rms=float(np.sqrt(_mean_over_time(t, size * size))),
        )
    acting = (*(("gravity",) if np.any(mechanism.gravity) else ()), *(x.name for x in (*mechanism.forces, *mechanism.frictions)))
    return Loads(float(t[-1]) if len(t) else None, acting, mechanism.redundant == 0, peaks)


def _mean_over_time(t: Array, x: Array) -> float:
    """Return the mean of samples x (k,) over the times t (k,), which need not be equally far apart, by trapezia."""
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
    """Energy gained beyond the work done since the start (k,) [J], and the error bar of that work.

    Springs, gravity, constant torques and world-fixed forces have potentials. The work of everything else (dampers, friction,
    turning forces, a driver) is the integral of its power through the samples.
    """
    t = trajectory.t
    energy = evaluator.energy(trajectory.q, trajectory.v)
    power = evaluator.applied.power(trajectory.q, trajectory.v, trajectory.t)
    if evaluator.mechanism.drivers:
        rates = np.stack([np.broadcast_to(driver.law(t)[1], t.shape) for driver in evaluator.mechanism.drivers], axis=-1)
        power = power + (driving_forces(evaluator, trajectory) * rates).sum(-1)
    if evaluator.friction:
        power = power + friction_power(evaluator, trajectory)
    rounding = energy_rounding(energy)
    gain = energy - energy[0]
    if not np.any(power) or len(t) < 2:
        return gain, rounding
    done, bar = work(t, power)
    return gain - done, float(bar) + rounding


def energy_rounding(energy: Array) -> float:
    """Return the largest change of energies (k,) that rounding can cause [J]."""
    return 8 * float(np.finfo(float).eps) * (1.0 + float(np.abs(energy).max(initial=0.0)))


def energy_scale(evaluator: Evaluator, trajectory: Trajectory) -> float:
    """Return the scale of a motion's energy [J]: the largest kinetic energy or the range of the potential energy, if larger."""
    kinetic = 0.5 * (trajectory.v * trajectory.v) @ evaluator.mass
    potential = evaluator.applied.potential(trajectory.q)
    return max(float(kinetic.max(initial=0.0)), float(np.ptp(potential)) if len(potential) else 0.0)


def without_loss(t: Array, gain: Array, spacing: float) -> Array:
    """Remove from the energy error (k,) [J] every loss between samples further apart than `spacing` [s].

    Between such samples a damper may dissipate energy unseen, so a loss is no evidence of an error. Gains are kept.
    """
    change = np.diff(gain)
    unseen = (np.diff(t) > spacing) & (change < 0)
    lost: Array = np.append(0.0, np.cumsum(np.where(unseen, change, 0.0)))
    return gain - lost


def work(t: Array, power: Array) -> tuple[Array, Array]:
    """Return the work (k, ...) [J] done since t[0] by powers (k, ...) [W] at times t (k,), and its error bar (...).

    The power is integrated by a quintic spline through the samples. The largest difference from the spline through every second
    sample is the error bar: generous if the samples resolve the motion, and large if they do not.
    """
    from scipy.interpolate import make_interp_spline  # imported here: it takes as long as all other imports together

    def integrate(t_known: Array, known: Array) -> Array:
        spline = make_interp_spline(t_known, known, k=min(5, 2 * ((len(t_known) - 2) // 2) + 1))
        primitive: Callable[[Array], Array] = spline.antiderivative()
        return np.asarray(primitive(t) - primitive(t[:1]))

    half = np.unique([*range(0, len(t), 2), len(t) - 1])
    fine, coarse = integrate(t, power), integrate(t[half], power[half])
    return fine, np.asarray(np.abs(fine - coarse).max(axis=0))


@dataclass(frozen=True, eq=False)
class Errors:
    """Errors of a trajectory relative to its reference, at the reference's times.

    Attributes:
        t: (k,) times compared.
        measured: (k,) |error| of the linkage's measured coordinate [rad or m, as its unit says].
        length, angle: (k, links) largest |error| of a link's centre of mass [m] and of its angle [rad].
        velocity: (k, links) largest |error| per link [m/s, rad/s].
        position_bar, velocity_bar: errors below them are not significant: the reference's own error or the floor of double
            precision.
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
        """(k, links) the larger of the two per link."""
        return np.maximum(self.length, self.angle)

    @property
    def largest(self) -> dict[str, float]:
        """The largest error of all: "position" of any link's centre of mass [m], and "angle" of any link [rad]."""
        return {"position": float(self.length.max()), "angle": float(self.angle.max())}


def common_times(t: Array, true: Array) -> tuple[NDArray[np.intp], NDArray[np.bool_]]:
    """Return the indices in t (k,) of the times that `true` (j,) has too, and a mask (j,) of these; times increase."""
    near = np.minimum(np.searchsorted(t, true - 1e-9), len(t) - 1)
    both = np.abs(t[near] - true) < 1e-9
    return near[both], both


def state_errors(mechanism: Mechanism, trajectory: Trajectory, reference: Reference) -> Errors:
    """Compute the errors at every time of the reference that the trajectory has sampled."""
    mine, both = common_times(trajectory.t, reference.t)
    dq = np.abs(trajectory.q[mine] - reference.q[both])
    dv = np.abs(trajectory.v[mine] - reference.v[both])
    coordinate = mechanism.measured.coordinate
    return Errors(
        reference.t[both],
        np.abs(value(coordinate, trajectory.q[mine]) - value(coordinate, reference.q[both])),
        places(dq).max(axis=-1),
        angles(dq),
        bodies(dv).max(axis=-1),
        np.fmax(reference.error_q, reference.floor_q)[both],
        np.fmax(reference.error_v, reference.floor_v)[both],
    )


def joint_force_errors(evaluator: Evaluator, trajectory: Trajectory, reference: Reference) -> Array:
    """Return the largest error (k,) [N] of any joint's force components, at the times of the reference that were sampled.

    It is NaN if redundant rows leave the forces undetermined. `joint_forces` computes both from the accelerations by Newton's laws.
    """
    mine, both = common_times(trajectory.t, reference.t)
    if evaluator.mechanism.redundant:
        return np.full(len(mine), np.nan)
    own, true = (joint_forces(evaluator, samples) for samples in (trajectory[mine], reference.samples[both]))
    gaps = [np.abs(own[name][x] - true[name][x]) for name in true for x in ("fx", "fy")]
    return np.max(gaps, axis=0, initial=0.0) if gaps else np.zeros(len(mine))


def relative_acceleration_error(a: Array, true: Array) -> Array:
    """Return max |a - a_true| / max |a_true| (k,) of accelerations (k, n); the absolute error where the mechanism is at rest."""
    scale = np.abs(true).max(axis=-1)
    return np.asarray(np.abs(a - true).max(axis=-1) / np.where(scale > REST, scale, 1.0))


def observed_order(steps: Array, errors: Array, floors: Array) -> Array:
    """Observed order (k,) of each run against the one with the next larger step; NaN where an error is at its floor.

    `steps` must decrease. Errors within ten times their floor say nothing about the integrator and are left out.
    """
    order = np.full(len(steps), np.nan)
    usable = (errors > 10 * floors) & np.isfinite(errors)
    k = 1 + np.flatnonzero(usable[1:] & usable[:-1])
    order[k] = np.log(errors[k - 1] / errors[k]) / np.log(steps[k - 1] / steps[k])
    return order
