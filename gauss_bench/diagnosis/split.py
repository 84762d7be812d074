"""Split an engine's error by its dependence on the step and on the closure of the loops.

Three runs with steps h, h/2 and h/4 give the order p of the integration error, and an estimate x of the motion at step zero
(Richardson extrapolation):

    p = log2 |x_1 - x_2| / |x_2 - x_3|,    x = x_3 + (x_3 - x_2) / (2^p - 1)

The error of x does not depend on the step, and the integrator causes the rest of the error. The part of the error that violates the
constraints is drift. At each checkpoint, the largest error of any coordinate is taken [m, rad]; the size of an error is the root
mean square of these largest errors over the checkpoints. Only checkpoints before the errors exceed 0.1 m or rad (REGIME) are used.
"""

from dataclasses import dataclass

import numpy as np

from gauss_bench.diagnosis.motion import OwnMotion
from gauss_bench.diagnosis.observations import Burst
from gauss_bench.metrics import relative_acceleration_error
from gauss_bench.terms import Array
from gauss_bench.trajectory import States

REGIME = 0.1  # [m, rad] larger errors no longer add up linearly, and their ratio gives no order
FEWEST = 5  # number of checkpoints that always count
CONVERGES = 0.4  # order below which the runs do not converge
STAYS = 0.75  # a gap is independent of the step if half the step leaves this share; an error of order 1 falls to a half
HALF = 0.5  # difference of two orders that is significant
PERIODS = 3  # number of parts of a run; the first is "early", the last "late"
GROWS = 3.0  # a gap grows if it is GROWS times larger late than early


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
        horizon: number k of checkpoints that are used, from the first one on; at later checkpoints the errors are too large to be
            split.
    """

    order: float
    limit: Array
    by_step: Array
    horizon: int

    @property
    def converges(self) -> bool:
        """Whether the error decreases, with an order above CONVERGES, when the step is reduced."""
        return bool(self.order > CONVERGES)


def horizon_of(errors: list[Array]) -> int:
    """Return the number of checkpoints before the error (k, n) of any run grows beyond REGIME, but at least FEWEST."""
    beyond = np.any([~(np.abs(e).max(axis=1) <= REGIME) for e in errors], axis=0)
    first = int(beyond.argmax()) if beyond.any() else len(beyond)
    return max(first, min(FEWEST, len(beyond)))


def by_steps(bursts: tuple[Burst, ...], true: States, adaptive: bool) -> Steps:
    """Split the errors of runs with smaller and smaller steps into the limit at step zero and the error that the step causes.

    The step is halved from run to run. The motion at step zero (limit) is Richardson's extrapolation of the last two of three runs.
    With fewer than three runs, or if the runs do not converge (`order` <= CONVERGES), the last run is taken as the limit.

    Args:
        bursts: for each run the samples at its checkpoints.
        true: reference states at these checkpoints.
        adaptive: whether the integrator chooses its own steps, so that no order of convergence can be computed.
    """
    k = min(len(b.at) for b in bursts)
    horizon = horizon_of([b.at.q[:k] - true.q[:k] for b in bursts])
    x, order = [b.at.q[:horizon] for b in bursts], np.nan
    limit = x[-1]  # (horizon, n) positions at step zero
    if len(x) > 2 and not adaptive:
        first_change, second_change = size(x[0] - x[1]), size(x[1] - x[2])
        if first_change > 0:
            order = float(np.log2(first_change / second_change)) if second_change > 0 else np.inf
        if order > CONVERGES:  # an order beyond 12 is that of rounding
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
        """Whether the largest gap of a loop in the last third of the first run is more than GROWS times that in the first third."""
        return self.closure_late > GROWS * self.closure_early

    def falls_faster(self, order: float) -> bool:
        """Tell whether the largest gap decreases with the step by a clearly higher order than `order`, that of the motion's error.

        Clearly means by more than HALF. A gap that decreases so fast cannot cause the error. The last two runs are compared, of
        which the last has half the step.
        """
        if len(self.closure) < 2 or self.closure[-2] == 0.0:
            return False
        return bool(self.closure[-1] < self.closure[-2] / 2.0 ** (order + HALF))


def closure_of(own: OwnMotion, bursts: tuple[Burst, ...], errors: Array) -> Closure:
    """Return how far loops and drivers are open in runs with smaller and smaller steps, and what the gaps depend on.

    Args:
        own: the equations of motion of the linkage.
        bursts: for each run the samples at its checkpoints.
        errors: (k, n) position errors of the first run at its first k checkpoints, at which the errors are small enough to be
            split.
    """
    gaps = [np.abs(own.gaps(b.at)) for b in bursts]  # each (checkpoints, rows)
    opened = tuple(float(g.max(initial=0.0)) for g in gaps)
    # sizes: largest gap of the first run at each checkpoint; third: number of checkpoints in one third of the run
    sizes, third = gaps[0].max(axis=1, initial=0.0), max(1, len(gaps[0]) // PERIODS)
    at = bursts[0].at[slice(0, len(errors))]
    with np.errstate(all="ignore"):  # the part of the error that leads off the constraints, which projection would remove
        share = size(at.q - own.project(at).q) / max(size(errors), 1e-300)
    worst = int(gaps[-1].max(axis=0).argmax()) if gaps[-1].shape[1] else 0  # the row with the largest gap
    rows = [x.name for x in (*own.mechanism.joints, *own.mechanism.couplings) for _ in x.held]
    name = [*rows, *(x.name for x in own.mechanism.drivers), ""][worst]
    stays = len(opened) > 1 and opened[-1] >= STAYS * opened[-2]
    early, late = float(sizes[:third].max()), float(sizes[-third:].max())
    # correlation and ratio of gap and force, of the run with the smallest step
    held, compliance = _compare_gap_with_force(own, bursts[-1], worst)
    return Closure(
        closure=opened,
        closure_early=early,
        closure_late=late,
        closure_stays=stays,
        closure_joint=name,
        closure_share=min(share, 1.0),
        held=held,
        compliance=compliance,
    )


def _compare_gap_with_force(own: OwnMotion, b: Burst, worst: int) -> tuple[float, float]:
    """Return the correlation between the gap and the force of the constraint row `worst`, and the ratio of gap to force [m/N].

    The correlation and the ratio are computed over the checkpoints of the run `b`. They are zero if the gap or the force is zero at
    all checkpoints.
    """
    phi = own.gaps(b.at)
    if not phi.shape[1]:
        return 0.0, 0.0
    force, gap = own.parts(b.at).multipliers(b.a)[:, worst], phi[:, worst]
    if not (np.isfinite(force).all() and force.any() and gap.any()):
        return 0.0, 0.0
    along = abs(float(force @ gap))
    return along / float(np.sqrt((force @ force) * (gap @ gap))), along / float(force @ force)


@dataclass(frozen=True, eq=False)
class Local:
    """Errors of an engine's accelerations and steps at its own states, on which earlier errors of the motion have no influence.

    Attributes:
        reported: (k, n) error of the accelerations that the engine reports.
        implied: (k, n) error of the mean acceleration in a step, which is the change of velocities divided by the step.
        euler: (k, n) error that this mean acceleration would have if the step were an explicit Euler step.
        relative_reported, relative_implied: the first two errors, divided by the largest acceleration of each state, as medians
            over the states.
    """

    reported: Array
    implied: Array
    euler: Array
    relative_reported: float
    relative_implied: float


def local(own: OwnMotion, b: Burst) -> Local:
    """Compare an engine's accelerations with those from the linkage's equations of motion, at checkpoints of the run `b`.

    Two kinds of accelerations are compared: those that the engine reports, and mean accelerations over one step. The correct values
    are computed from the state of the engine itself at the checkpoint.
    """
    h = b.after.t - b.at.t  # (k,)
    true = own.accelerations(b.at)
    true_mean = (own.flow(b.at, h).v - b.at.v) / h[:, None]  # mean accelerations of the linkage's flow in a step
    mean = (b.after.v - b.at.v) / h[:, None]
    relative_reported = float(np.median(relative_acceleration_error(b.a, true)))
    relative_implied = float(np.median(relative_acceleration_error(mean, true_mean)))
    # an explicit Euler step would have the acceleration `true` at its beginning as its mean acceleration
    return Local(b.a - true, mean - true_mean, true - true_mean, relative_reported, relative_implied)


def usable(own: OwnMotion, b: Burst, largest_gap: float) -> Array:
    """Return a mask (k,) of the checkpoints at which all values are finite and no loop has a gap above `largest_gap` [m, rad]."""
    with np.errstate(all="ignore"):
        gaps = np.abs(own.gaps(b.at)).max(axis=1, initial=0.0)
    is_finite = np.all([np.isfinite(x).all(axis=1) for x in (b.at.q, b.at.v, b.a, b.after.v)], axis=0)
    return np.asarray(is_finite & (gaps <= largest_gap))
