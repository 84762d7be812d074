"""An engine's error, split by what changes it: the step, the closure, time.

Three runs with steps h, h/2 and h/4 give the order p of the integration error, and an estimate x of the motion at step zero
(Richardson extrapolation):

    p = log2 |x_1 - x_2| / |x_2 - x_3|,    x = x_3 + (x_3 - x_2) / (2^p - 1)

The error of x does not come from the integrator. The rest of the error does; the part of it that violates the constraints is
drift. Sizes are root mean squares over the checkpoints of the largest error of a coordinate [m, rad], as far as errors are
small enough to add up (REGIME). All of it is the suite's own arithmetic on samples.
"""

from dataclasses import dataclass

import numpy as np

from gauss_bench.diagnosis.motion import OwnMotion
from gauss_bench.diagnosis.observations import Burst
from gauss_bench.metrics import relative_acceleration_error
from gauss_bench.terms import Array
from gauss_bench.trajectory import States

REGIME = 0.1  # [m, rad] beyond it errors of one run no longer add up, and those of two steps have no ratio
FEWEST = 5  # checkpoints that are looked at in any case
CONVERGES = 0.4  # order below which runs of smaller steps do not approach anything
STAYS = 0.75  # of a gap that is left at half the step, between the two smallest: even order 1 takes off a half
PERIODS = 3  # of a run: the first is early, the last is late
GROWS = 3.0  # times as wide late as early


def size(x: Array) -> float:
    """Root mean square over the samples (k, n) of their largest entries."""
    return float(np.sqrt(np.mean(np.abs(x).max(axis=1) ** 2))) if x.size else 0.0


@dataclass(frozen=True, eq=False)
class Steps:
    """The effect of the step size on a motion.

    Attributes:
        order: at which the motion converges; NaN where it does not, or only one step was run.
        limit: (k, n) what the motion without any step is off by; by_step: (k, n) what the step adds, of the first run.
        horizon: how many checkpoints are looked at.
    """

    order: float
    limit: Array
    by_step: Array
    horizon: int

    @property
    def converges(self) -> bool:
        return bool(self.order > CONVERGES)


def horizon_of(errors: list[Array]) -> int:
    """Return the number of checkpoints before any run's error (k, n) grows too large for errors to add up."""
    beyond = np.any([~(np.abs(e).max(axis=1) <= REGIME) for e in errors], axis=0)
    first = int(beyond.argmax()) if beyond.any() else len(beyond)
    return max(first, min(FEWEST, len(beyond)))


def by_steps(bursts: tuple[Burst, ...], true: States, adaptive: bool) -> Steps:
    """Compare runs of decreasing step size."""
    k = min(len(b.at) for b in bursts)
    h = horizon_of([b.at.q[:k] - true.q[:k] for b in bursts])
    x, q, order = [b.at.q[:h] for b in bursts], true.q[:h], np.nan
    limit = x[-1]
    if len(x) > 2 and not adaptive:
        one, other = size(x[0] - x[1]), size(x[1] - x[2])
        if one > 0:
            order = float(np.log2(one / other)) if other > 0 else np.inf
        if order > CONVERGES:
            limit = limit + (x[2] - x[1]) / (2.0 ** min(order, 12.0) - 1.0)
    return Steps(order, limit - q, x[0] - limit, h)


@dataclass(frozen=True)
class Closure:
    """The opening of loops [m, rad], and the error of drivers, over the run.

    Attributes:
        closure: largest gap, of every run; closure_early, closure_late: of the first run, in the first and in the last third.
        closure_stays: whether smaller steps leave it as it is.
        closure_joint: where the gap is largest.
        closure_share: of the error, by how much it leaves the constraints.
        held: correlation of gaps with the forces that should close them, 0..1; compliance: gap over force [m/N].
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
        return self.closure_late > GROWS * self.closure_early


def closure_of(own: OwnMotion, bursts: tuple[Burst, ...], errors: Array) -> Closure:
    """The closure's residuals, along runs of ever smaller steps."""
    gaps = [np.abs(own.gaps(b.at)) for b in bursts]
    opened = tuple(float(g.max(initial=0.0)) for g in gaps)
    sizes, third = gaps[0].max(axis=1, initial=0.0), max(1, len(gaps[0]) // PERIODS)
    at = bursts[0].at[slice(0, len(errors))]
    with np.errstate(all="ignore"):
        share = size(at.q - own.project(at).q) / max(size(errors), 1e-300)
    worst = int(gaps[-1].max(axis=0).argmax()) if gaps[-1].shape[1] else 0
    rows = [x.name for x in (*own.mechanism.joints, *own.mechanism.couplings) for _ in x.held]
    name = [*rows, *(x.name for x in own.mechanism.drivers), ""][worst]
    stays = len(opened) > 1 and opened[-1] >= STAYS * opened[-2]
    early, late = float(sizes[:third].max()), float(sizes[-third:].max())
    return Closure(opened, early, late, stays, name, min(share, 1.0), *_hold(own, bursts[-1], worst))


def _hold(own: OwnMotion, b: Burst, worst: int) -> tuple[float, float]:
    """Measure how well the gap of the worst row follows the force in it, and by how much it yields."""
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
    """An engine's accelerations at its own states against the linkage's there, and its steps against the linkage's flow.

    Attributes:
        told: (k, n) accelerations that it tells, minus the linkage's; moved: (k, n) those by which its velocities change in a
            step, minus what the linkage's would.
        euler: (k, n) what an explicit first-order step would be off by.
        relative_told, relative_moved: medians over the states, relative to the largest acceleration of each.
    """

    told: Array
    moved: Array
    euler: Array
    relative_told: float
    relative_moved: float


def local(own: OwnMotion, b: Burst) -> Local:
    """One run, one step at a time."""
    h = b.after.t - b.at.t
    true = own.accelerations(b.at)
    mean = (own.flow(b.at, h).v - b.at.v) / h[:, None]
    moved = (b.after.v - b.at.v) / h[:, None]
    off = [float(np.median(relative_acceleration_error(*pair))) for pair in ((b.a, true), (moved, mean))]
    return Local(b.a - true, moved - mean, true - mean, off[0], off[1])


def usable(own: OwnMotion, b: Burst, most: float) -> Array:
    """The checkpoints of a run that are finite and not opened by more than `most` [m, rad]."""
    with np.errstate(all="ignore"):
        gaps = np.abs(own.gaps(b.at)).max(axis=1, initial=0.0)
    sound = np.all([np.isfinite(x).all(axis=1) for x in (b.at.q, b.at.v, b.a, b.after.v)], axis=0)
    return np.asarray(sound & (gaps <= most))
