"""Split an engine's error by its dependence on the step and on the closure of the loops.

Three runs with steps h, h/2 and h/4 give the order p of the integration error, and an estimate x of the motion at step zero
(Richardson extrapolation):

    p = log2 |x_1 - x_2| / |x_2 - x_3|,    x = x_3 + (x_3 - x_2) / (2^p - 1)

The error of x does not depend on the step, and the integrator causes the rest of the error. The part of the error that violates the
constraints is drift. The size of an error is the root mean square, over the checkpoints, of its largest entry [m, rad].

If an engine has a pin of link a displaced by d (2,) in the frame of that link, the gap of this pin by the file's dimensions is

    phi(t) = R(theta_a(t)) d + c

for any step and force. c (2,) is 0 if the engine closes its loops at the start, and -R(theta_a(0)) d if it keeps the gap that they
have there. A displaced pin of the ground causes a constant gap, which is not detected.
"""

from dataclasses import dataclass

import numpy as np

from gauss_bench.diagnosis.motion import OwnMotion
from gauss_bench.diagnosis.observations import Burst
from gauss_bench.mechanism.model import GROUND
from gauss_bench.mechanism.spaces import angle_at
from gauss_bench.metrics import relative_acceleration_error
from gauss_bench.terms import Array
from gauss_bench.trajectory import States

REGIME = 0.1  # [m, rad] larger errors no longer add up linearly, and their ratio gives no order
FEWEST = 5  # number of checkpoints that are always used, however large their errors are
CONVERGES = 0.4  # order below which the runs do not converge
STAYS = 0.75  # a gap is independent of the step if at least this share remains with half the step; an error of order 1 falls to 0.5
HALF = 0.5  # least difference of two orders of convergence that is significant
PERIODS = 3  # number of parts of a run; the first is "early", the last "late"
FITS = 0.999  # share of the squared gaps that a displaced pin must explain
SAME = 0.05  # largest relative difference of a pin's displacement between two runs
TURNS = 1e-2  # [rad] least turn of a link that distinguishes a turning gap from a constant one
GROWS = 3.0  # a gap grows if its late value is above GROWS times its early value


def size(x: Array) -> float:
    """Return the root mean square, over k samples, of the largest entry of each sample x (k, n)."""
    return float(np.sqrt(np.mean(np.abs(x).max(axis=1) ** 2))) if x.size else 0.0


@dataclass(frozen=True, eq=False)
class Steps:
    """The error of the first run, split into the error that its step causes and the error that would remain at step zero.

    Attributes:
        order: order of convergence; NaN if there are fewer than three runs, or if the integrator chooses its own steps.
        limit: (k, n) error extrapolated to step zero.
        by_step: (k, n) part of the first run's error that its step causes.
        horizon: number k of checkpoints until the errors are too large to be split.
    """

    order: float
    limit: Array
    by_step: Array
    horizon: int

    @property
    def converges(self) -> bool:
        """Whether the motion converges when the step is reduced; False if the order is NaN."""
        return bool(self.order > CONVERGES)


def horizon_of(errors: list[Array]) -> int:
    """Return the number of checkpoints before the error (k, n) of any run grows beyond REGIME, but at least FEWEST."""
    beyond = np.any([~(np.abs(e).max(axis=1) <= REGIME) for e in errors], axis=0)  # `not <=` is also true for NaN
    first = int(beyond.argmax()) if beyond.any() else len(beyond)
    return max(first, min(FEWEST, len(beyond)))


def by_steps(bursts: tuple[Burst, ...], true: States, adaptive: bool) -> Steps:
    """Split the errors of runs with halved steps into the limit at step zero and the error that the step causes.

    `true` has the reference states at the checkpoints. With fewer than three runs, with runs that do not converge, or if
    `adaptive`, the last run is the limit.
    """
    k = min(len(b.at) for b in bursts)
    horizon = horizon_of([b.at.q[:k] - true.q[:k] for b in bursts])
    x, order = [b.at.q[:horizon] for b in bursts], np.nan
    limit = x[-1]  # (horizon, n) positions at step zero
    if len(x) > 2 and not adaptive:
        first_change, second_change = size(x[0] - x[1]), size(x[1] - x[2])
        if first_change > 0:
            order = float(np.log2(first_change / second_change)) if second_change > 0 else np.inf
        if order > CONVERGES:  # an order above 12 comes from rounding
            limit = limit + (x[2] - x[1]) / (2.0 ** min(order, 12.0) - 1.0)
    return Steps(order, limit - true.q[:horizon], x[0] - limit, horizon)


@dataclass(frozen=True)
class Closure:
    """The gaps of loops and drivers over the run.

    Attributes:
        closure: largest gap of every run, each with half the step of the run before [m, rad].
        closure_early, closure_late: largest gap of the first run in its first third and in its last third [m, rad].
        closure_stays: whether the largest gap is independent of the step.
        closure_joint: name of the joint with the largest gap.
        closure_share: share of the error that violates the constraints.
        held: correlation of the largest gap with its constraint force, from 0 to 1: near 1 the constraint yields like a spring.
        compliance: ratio of this gap to this force [m/N].
    """

    closure: tuple[float, ...]
    closure_early: float
    closure_late: float
    closure_stays: bool
    closure_joint: str
    closure_share: float
    held: float
    compliance: float

    @property
    def grows(self) -> bool:
        """Whether the largest gap in the last third of the first run is more than GROWS times that in the first third."""
        return self.closure_late > GROWS * self.closure_early

    def falls_faster(self, order: float) -> bool:
        """Tell whether the gap falls faster with the step than the motion's error: by an order above `order` + HALF.

        Such a gap cannot cause the error.
        """
        if len(self.closure) < 2 or self.closure[-2] == 0.0:
            return False
        return bool(self.closure[-1] < self.closure[-2] / 2.0 ** (order + HALF))


def closure_of(own: OwnMotion, bursts: tuple[Burst, ...], errors: Array) -> Closure:
    """Return the gaps of loops and drivers in runs with halved steps, given position errors (k, n) of the first run."""
    gaps = [np.abs(own.gaps(b.at)) for b in bursts]  # each (checkpoints, rows)
    largest = tuple(float(g.max(initial=0.0)) for g in gaps)  # of every run
    first_run = gaps[0].max(axis=1, initial=0.0)  # (checkpoints,) largest gap of the first run
    third = max(1, len(first_run) // PERIODS)
    at = bursts[0].at[slice(0, len(errors))]
    with np.errstate(all="ignore"):  # the part of the error that projection would remove
        share = size(at.q - own.project(at).q) / max(size(errors), 1e-300)
    worst = int(gaps[-1].max(axis=0).argmax()) if gaps[-1].shape[1] else 0  # the row with the largest gap
    names = [*own.mechanism.held_names, *(x.name for x in own.mechanism.drivers), ""]  # of the rows; "" if there are no rows
    # correlation and ratio of gap and force in the run with the smallest step
    held, compliance = _compare_gap_with_force(own, bursts[-1], worst)
    return Closure(
        closure=largest,
        closure_early=float(first_run[:third].max()),
        closure_late=float(first_run[-third:].max()),
        closure_stays=len(largest) > 1 and largest[-1] >= STAYS * largest[-2],
        closure_joint=names[worst],
        closure_share=min(share, 1.0),
        held=held,
        compliance=compliance,
    )


def _compare_gap_with_force(own: OwnMotion, b: Burst, worst: int) -> tuple[float, float]:
    """Return the correlation between the gap and the force of the constraint row `worst`, and the ratio of gap to force [m/N].

    Both are zero if the gap or the force is zero at all checkpoints.
    """
    phi = own.gaps(b.at)
    if not phi.shape[1]:
        return 0.0, 0.0
    force, gap = own.parts(b.at).multipliers(b.a)[:, worst], phi[:, worst]
    if not (np.isfinite(force).all() and force.any() and gap.any()):
        return 0.0, 0.0
    product = abs(float(force @ gap))
    return product / float(np.sqrt((force @ force) * (gap @ gap))), product / float(force @ force)


@dataclass(frozen=True, eq=False)
class LocalErrors:
    """Errors of an engine's accelerations and steps at its own states; they do not contain earlier errors of the motion.

    Attributes:
        reported: (k, n) error of the accelerations that the engine reports.
        implied: (k, n) error of the mean acceleration in a step, which is the change of velocities divided by the step.
        euler: (k, n) error that the mean acceleration would have if the step were a correct explicit Euler step.
        relative_reported, relative_implied: medians over the states, relative to the largest acceleration.
    """

    reported: Array
    implied: Array
    euler: Array
    relative_reported: float
    relative_implied: float


def measure_local_errors(own: OwnMotion, b: Burst) -> LocalErrors:
    """Compare the accelerations of a run with those of the linkage's equations of motion, at the engine's own states."""
    h = b.after.t - b.at.t  # (k,)
    true = own.accelerations(b.at)
    true_mean = (own.flow(b.at, h).v - b.at.v) / h[:, None]  # mean accelerations of the linkage's flow in a step
    mean = (b.after.v - b.at.v) / h[:, None]
    relative_reported = float(np.median(relative_acceleration_error(b.a, true)))
    relative_implied = float(np.median(relative_acceleration_error(mean, true_mean)))
    # an explicit Euler step would have the acceleration `true` at its beginning as its mean acceleration
    return LocalErrors(b.a - true, mean - true_mean, true - true_mean, relative_reported, relative_implied)


def usable(own: OwnMotion, b: Burst, largest_gap: float) -> Array:
    """Return a mask (k,) of the checkpoints at which all values are finite and no loop has a gap above `largest_gap` [m, rad]."""
    with np.errstate(all="ignore"):
        gaps = np.abs(own.gaps(b.at)).max(axis=1, initial=0.0)
    is_finite = np.all([np.isfinite(x).all(axis=1) for x in (b.at.q, b.at.v, b.a, b.after.v)], axis=0)
    return np.asarray(is_finite & (gaps <= largest_gap))


@dataclass(frozen=True)
class Misplaced:
    """A pin of a link that is displaced by `off` (2,) [m] in the frame of the link, and explains a `share` of all squared gaps."""

    joint: str
    link: str
    off: Array
    share: float

    @property
    def sentence(self) -> str:
        """The displacement in words."""
        off = ", ".join(f"{x:.2e}" for x in self.off)
        return f"the pin {self.joint} of {self.link} is elsewhere than the file says, by [{off}] m in the frame of {self.link}"


def find_displaced_pin(own: OwnMotion, coarse: States, fine: States) -> Misplaced | None:
    """Return the pin whose displacement alone accounts for the gaps of all joints in two runs with different steps, or None.

    The displacement must be about the same in both runs, because a wrong dimension does not depend on the step.
    """
    first, second = (_fit_pins(own, x) for x in (coarse, fine))
    if first is None or second is None or (first.joint, first.link) != (second.joint, second.link):
        return None
    return second if np.hypot(*(first.off - second.off)) <= SAME * np.hypot(*second.off) else None


def _fit_pins(own: OwnMotion, x: States) -> Misplaced | None:
    """Return the pin whose displacement best explains the gaps of the joints at states x; None if it explains less than FITS."""
    mechanism, gaps = own.mechanism, own.gaps(x)  # (k, rows)
    squares = float((gaps**2).sum())
    fits: list[Misplaced] = []
    row = 0
    for joint in mechanism.joints:
        gap = gaps[:, row : row + len(joint.held)]
        row += len(joint.held)
        if not joint.ends_meet or not squares:
            continue
        others = squares - float((gap**2).sum())  # squared gaps of other joints, which this pin does not explain
        for point, sign in zip(joint.ends, (1.0, -1.0), strict=True):  # the gap is the second end minus the first
            if point.link != GROUND:
                d, left = _fit_turning(gap, angle_at(x.q, point.link))
                share = 1.0 - (left + others) / squares
                fits.append(Misplaced(joint.name, mechanism.link_name(point.link), sign * d, share))
    best = max(fits, key=lambda x: x.share, default=None)
    return best if best is not None and best.share >= FITS else None


def _fit_turning(gap: Array, theta: Array) -> tuple[Array, float]:
    """Fit gap (k, 2) = R(theta) d + c at angles theta (k,) [rad]; return d (2,) [m] and the squared residual [m^2].

    If the link turns by less than TURNS, d and c cannot be distinguished; then d = 0 without a fit.
    """
    cosine, sine, one, none = np.cos(theta), np.sin(theta), np.ones_like(theta), np.zeros_like(theta)
    # (2 k, 4): first the rows of x, then the rows of y; the unknowns are d_x, d_y, c_x, c_y
    A = np.concatenate([np.stack([cosine, -sine, one, none], axis=1), np.stack([sine, cosine, none, one], axis=1)])
    b = gap.T.ravel()
    if np.ptp(theta) < TURNS:
        return np.zeros(2), float(b @ b)
    solution = np.linalg.lstsq(A, b, rcond=None)[0]
    residual = b - A @ solution
    return solution[:2], float(residual @ residual)
