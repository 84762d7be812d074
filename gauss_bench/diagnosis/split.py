"""An engine's error, split by what changes it: the step, the closure, time.

Three runs by h, h/2 and h/4 give the order p of what the step does and the motion that is left when the step has gone to nothing
(Richardson):

    p = log2 |x_1 - x_2| / |x_2 - x_3|,    x = x_3 + (x_3 - x_2) / (2^p - 1)

What x is off by has nothing to do with the integrator. The rest is the integrator's, and drift as far as it leaves the
constraints. Sizes are root mean squares over the checkpoints of the largest error of a coordinate [m, rad], as far as errors are
small enough to add up (REGIME). All of it is the suite's own arithmetic on samples.
"""

from dataclasses import dataclass

import numpy as np

from gauss_bench.diagnosis.motion import OwnMotion, Truth
from gauss_bench.diagnosis.observations import Burst
from gauss_bench.metrics import relative_acceleration_error
from gauss_bench.terms import Array
from gauss_bench.trajectory import States

REGIME = 0.1  # [m, rad] beyond it errors of one run no longer add up, and those of two steps have no ratio
FEWEST = 5  # checkpoints that are looked at in any case
CONVERGES = 0.4  # order below which runs of smaller steps do not approach anything


def size(x: Array) -> float:
    """Root mean square over the samples (k, n) of their largest entries."""
    return float(np.sqrt(np.mean(np.abs(x).max(axis=1) ** 2))) if x.size else 0.0


@dataclass(frozen=True, eq=False)
class Steps:
    """What the step does to a motion.

    Attributes:
        order: at which the motion converges; NaN where it does not, or only one step was run.
        limit: (k, n) what the motion without any step is off by; by_step: (k, n) what the step adds, of the first run.
        scatter: change between the two smallest steps.
        horizon: how many checkpoints are looked at.
    """

    order: float
    limit: Array
    by_step: Array
    scatter: float
    horizon: int

    @property
    def converges(self) -> bool:
        return bool(self.order > CONVERGES)


def horizon_of(errors: list[Array]) -> int:
    """Checkpoints until the first at which an error (k, n) of any run leaves the regime in which errors add up."""
    beyond = np.any([~(np.abs(e).max(axis=1) <= REGIME) for e in errors], axis=0)
    first = int(beyond.argmax()) if beyond.any() else len(beyond)
    return max(first, min(FEWEST, len(beyond)))


def by_steps(bursts: tuple[Burst, ...], true: States, adaptive: bool) -> Steps:
    """Compare runs of ever smaller steps."""
    k = min(len(b.at) for b in bursts)
    x = [b.at.q[:k] for b in bursts]
    h = horizon_of([one - true.q[:k] for one in x])
    x, q = [one[:h] for one in x], true.q[:h]
    if len(x) < 3:
        last = x[-1]
        return Steps(np.nan, last - q, x[0] - last, size(x[0] - last), h)
    first, second = x[0] - x[1], x[1] - x[2]
    one, other = size(first), size(second)
    order = float(np.log2(one / other)) if one > 0 and other > 0 else np.inf if one > 0 else np.nan
    if adaptive or not order > CONVERGES:
        return Steps(np.nan if adaptive else order, x[2] - q, x[0] - x[2], other, h)
    limit = x[2] + (x[2] - x[1]) / (2.0 ** min(order, 12.0) - 1.0)
    return Steps(order, limit - q, x[0] - limit, other, h)


@dataclass(frozen=True)
class Closure:
    """How far loops are open [m, rad] (and drivers off), over the run.

    Attributes:
        opened: largest, of every run; early, late: of the first run, in the first and in the last third.
        stays: whether smaller steps leave it as it is.
        share: of the error, by how much it leaves the constraints.
        held: correlation of gaps with the forces that should close them, 0..1; compliance: gap over force [m/N].
        joint: where the gap is largest.
    """

    opened: tuple[float, ...]
    early: float
    late: float
    stays: bool
    share: float
    held: float
    compliance: float
    joint: str

    @property
    def grows(self) -> bool:
        return self.late > 3.0 * self.early


STAYS = 0.75  # of a gap that is left at half the step, between the two smallest: even order 1 takes off a half


def closure_of(own: OwnMotion, bursts: tuple[Burst, ...], errors: Array) -> Closure:
    """The closure's residuals, along runs of ever smaller steps."""
    k = len(errors)
    gaps = [np.abs(own.gaps(b.at)) for b in bursts]
    opened = tuple(float(g.max(initial=0.0)) for g in gaps)
    third = max(1, len(gaps[0]) // 3)
    sizes = gaps[0].max(axis=1, initial=0.0)
    at = bursts[0].at[slice(0, k)]
    with np.errstate(all="ignore"):
        normal = at.q - own.projected(at).q
    share = size(normal) / max(size(errors), 1e-300)
    phi = own.gaps(bursts[-1].at)
    worst = int(gaps[-1].max(axis=0, initial=0.0).argmax()) if phi.shape[1] else 0
    held, compliance = _hold(own, bursts[-1], phi, worst)
    joints, drivers = own.mechanism.joints, own.mechanism.drivers
    name = joints[worst // 2].name if worst < 2 * len(joints) else drivers[worst - 2 * len(joints)].name if drivers else ""
    stays = len(opened) > 1 and opened[-1] >= STAYS * opened[-2]
    return Closure(opened, float(sizes[:third].max()), float(sizes[-third:].max()), stays, min(share, 1.0), held, compliance, name)


def _hold(own: OwnMotion, b: Burst, phi: Array, worst: int) -> tuple[float, float]:
    """Measure how well the gap of the worst row follows the force in it, and by how much it yields."""
    if not phi.shape[1]:
        return 0.0, 0.0
    force = own.parts(b.at).multipliers(b.a)[:, worst]
    gap = phi[:, worst]
    if not (np.isfinite(force).all() and force.any() and gap.any()):
        return 0.0, 0.0
    together = float(force @ gap) / float(np.sqrt((force @ force) * (gap @ gap)))
    return abs(together), abs(float(force @ gap) / float(force @ force))


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
    mean = (own.moved(b.at, h).v - b.at.v) / h[:, None]
    moved = (b.after.v - b.at.v) / h[:, None]
    return Local(
        b.a - true,
        moved - mean,
        true - mean,
        float(np.median(relative_acceleration_error(b.a, true))),
        float(np.median(relative_acceleration_error(moved, mean))),
    )


def usable(own: OwnMotion, b: Burst, most: float) -> Array:
    """The checkpoints of a run that are finite and not opened by more than `most` [m, rad]."""
    with np.errstate(all="ignore"):
        gaps = np.abs(own.gaps(b.at)).max(axis=1, initial=0.0)
    sound = np.all([np.isfinite(x).all(axis=1) for x in (b.at.q, b.at.v, b.a, b.after.v)], axis=0)
    return np.asarray(sound & (gaps <= most))


def errors_of(truth: Truth, b: Burst) -> tuple[States, Array]:
    """The true states at the checkpoints, and the errors (k, n) of positions."""
    true = truth.at(b.at.t)
    return true, b.at.q - true.q
