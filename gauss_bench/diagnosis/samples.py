"""Detect wrong samples of a correct motion: taken at wrong times, of exchanged links, or after a restart.

A fit of times or an order of links is reported if the true motion with these times, or in this order, agrees with the reported
samples except for a small share of the error.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from gauss_bench.diagnosis.motion import OwnMotion, TrueMotion
from gauss_bench.engines.tree import spanning_tree
from gauss_bench.mechanism.model import Mechanism
from gauss_bench.mechanism.spaces import angles, bodies
from gauss_bench.terms import Array
from gauss_bench.trajectory import States

LEFT = 0.2  # largest share of the error (median over the samples) that a map of time or a new order may leave
ITERATIONS = 12  # largest number of iterations of a fit
LOOKED_AT = 20  # number of samples to which a time map is fitted
JUMP = 10.0  # smallest jump, relative to the median displacement and to the travel that velocities allow in a step
SUSPICIOUS = 0.03  # [rad, m] displacement between two checkpoints that velocities and accelerations do not explain


@dataclass(frozen=True)
class TimeMap:
    """A map of time: the state that an engine reports at the time t is the true state at the time shift + rate t.

    Attributes:
        shift: shift of time [s]; rate: factor by which time is multiplied.
        left: share of the error that remains if the map is applied, as the median over the samples.
    """

    shift: float
    rate: float
    left: float


def _state(x: States, pace: float) -> Array:
    """Return positions and velocities (k, 2 n) in equal units: velocities are multiplied by the time `pace` [s]."""
    return np.hstack([x.q, x.v * pace])


def fit_time_map(truth: TrueMotion, reported: States, stretch: bool) -> TimeMap | None:
    """Fit the map true time = shift + rate * reported time to reported samples by Gauss-Newton steps.

    The error is the distance of a reported state from the true state, with velocities in units of positions. Return None if the fit
    leaves more than the share LEFT of the error (median over the samples). Without `stretch`, `rate` is 1.
    """
    reference = truth.reference
    rms = [float(np.sqrt(np.mean(x * x))) for x in (reference.v, reference.a)]
    if not all(rms):
        return None
    pace = rms[0] / rms[1]  # [s] ratio of the root mean squares of velocities and accelerations
    shift, rate = 0.0, _first_rate(truth, reported, pace) if stretch else 1.0
    inside = reported.t * rate <= truth.until
    x = reported[inside][:: max(1, int(inside.sum()) // LOOKED_AT)]  # about LOOKED_AT samples, whose true times have a reference
    if len(x) < 3:
        return None
    state, best = _state(x, pace), TimeMap(shift, rate, np.inf)
    before = np.linalg.norm(state - _state(truth.at(x.t), pace), axis=1)  # errors without a map
    for _ in range(ITERATIONS):
        # the reference can be continued only a little before its start and beyond its end
        mapped = truth.at(np.clip(shift + rate * x.t, -0.05 * truth.until, 1.05 * truth.until))
        error = state - _state(mapped, pace)
        left = float(np.median(np.linalg.norm(error, axis=1) / np.maximum(before, 1e-9 * before.max(initial=1e-300))))
        if not left < 0.99 * best.left:  # the last iteration improved the fit by at most 1 %
            break
        best = TimeMap(shift, rate, left)
        slope = np.hstack([mapped.v, truth.motion.accelerations(mapped) * pace])  # derivative of the state by time
        columns = [slope, slope * x.t[:, None]] if stretch else [slope]  # with respect to shift and rate
        change = np.linalg.lstsq(np.array([c.ravel() for c in columns]).T, error.ravel(), rcond=None)[0]
        steps = np.clip(change, -pace, pace).tolist()  # for larger changes the linearisation does not hold
        shift, rate = shift + steps[0], rate + sum(steps[1:])  # steps[1] exists only with `stretch`
    return best if best.left <= LEFT else None


def _first_rate(truth: TrueMotion, reported: States, pace: float) -> float:
    """Estimate the ratio of true time to reported time, limited to the range from 0.2 to 5, as a first guess for the fit.

    The true time of a reported state is that of the nearest sample of the reference. `pace` [s] makes velocities comparable with
    positions.
    """
    r = truth.reference
    true = _state(States(r.t, r.q, r.v), pace)
    nearest = np.array([r.t[np.linalg.norm(true - x, axis=1).argmin()] for x in _state(reported, pace)])
    rates = nearest[reported.t > 0] / reported.t[reported.t > 0]
    return float(np.clip(np.median(rates), 0.2, 5.0)) if len(rates) else 1.0


def find_order(mechanism: Mechanism, truth: States, reported: States) -> tuple[str, float] | None:
    """Find a permutation of the reported links or joint coordinates that fits the true motion much better than the reported order.

    Return the wrong order in words and the share of the error that the permutation leaves; None if no permutation leaves LEFT or
    less. `truth` and `reported` are states at the same times.
    """
    from scipy.optimize import linear_sum_assignment  # its import takes longer than most diagnoses

    best: tuple[str, float] | None = None
    for words, reported_columns, true_columns, names in _columns(mechanism, truth, reported):
        # cost[i, j]: difference of reported column i from true column j, root mean square over the samples
        cost = np.array([[np.sqrt(np.mean((x - y) ** 2)) for y in true_columns] for x in reported_columns])
        _, assigned = linear_sum_assignment(cost)  # the true column of each reported one, with the least sum of costs
        as_reported, reordered = float(np.trace(cost)), float(cost[np.arange(len(cost)), assigned].sum())
        wrong = [k for k, x in enumerate(assigned) if x != k]  # columns that hold the values of another column
        if wrong and reordered <= LEFT * as_reported and (best is None or reordered / as_reported < best[1]):
            listed = ", ".join(f"{names[k]} holds {names[assigned[k]]}" for k in wrong)
            best = f"{words} are in another order: {listed}", reordered / as_reported
    return best


def _columns(mechanism: Mechanism, truth: States, reported: States) -> Iterator[tuple[str, Array, Array, list[str]]]:
    """Yield, for each kind of coordinate, the values whose order an engine may confuse, one row for each link or joint.

    Each item has the name of the kind, the reported and the true values (columns, ...), and the names of the links or joints.
    """

    def links(x: Array) -> Array:
        return bodies(x).transpose(1, 0, 2)  # (links, samples, 3)

    names = [link.name for link in mechanism.links]
    for words, values, true in (("links", reported.q, truth.q), ("velocities of links", reported.v, truth.v)):
        yield words, links(values), links(true), names
        yield f"angles in {words}", angles(values).T, angles(true).T, names
    for shallow in (False, True):  # a tree of long chains and a tree of least depth have different joint coordinates
        tree = spanning_tree(mechanism, shallow)
        named = [""] * tree.n
        for b in tree.branches:
            for k in range(b.at, b.at + len(b.coordinates)):
                named[k] = b.joint.name if b.joint else names[b.link]
        (y, dy), (true_y, true_dy) = tree.relative(reported.q, reported.v), tree.relative(truth.q, truth.v)
        yield "joint coordinates", y.T, true_y.T, named
        yield "joint velocities", dy.T, true_dy.T, named


def find_suspicious_interval(reported: States, a: Array) -> int | None:
    """Return the index of the checkpoint after which the state may have jumped, or None.

    The state may have jumped if velocities and accelerations a (k, n) at two checkpoints leave more than SUSPICIOUS [m, rad] of the
    displacement between these checkpoints unexplained.
    """
    h = np.diff(reported.t)[:, None]
    v, q = reported.v, reported.q
    # (k - 1,) displacement less the integral of the velocity by the corrected trapezoidal rule
    unexplained = np.abs(np.diff(q, axis=0) - h / 2 * (v[1:] + v[:-1]) + h**2 / 12 * np.diff(a, axis=0)).max(axis=1)
    k = int(unexplained.argmax()) if len(unexplained) else 0
    return k if len(unexplained) and unexplained[k] > SUSPICIOUS else None


def find_jump(own: OwnMotion, dense: States) -> tuple[float, float, bool] | None:
    """Return time [s] and size [m, rad] of a jump of the state, and whether the jump leads to the start; None without a jump.

    `dense` has the start, and then samples at every step. Of the displacements in one step that the mean velocity does not explain,
    the largest is a jump if it is far above the median, and also above SUSPICIOUS or far above the travel that velocities allow.
    """
    x = dense[1:]  # samples at every step; dense[0] may lie long before them
    h = np.diff(x.t)[:, None]
    unexplained = np.abs(np.diff(x.q, axis=0) - h / 2 * (x.v[1:] + x.v[:-1])).max(axis=1)
    allowed = (h * np.maximum(np.abs(x.v[1:]), np.abs(x.v[:-1]))).max(axis=1)  # displacement that the velocities allow
    if not len(unexplained):
        return None
    usual, k = float(np.median(unexplained)), int(unexplained.argmax())
    if unexplained[k] <= max(JUMP * usual, min(JUMP * (allowed[k] + usual), SUSPICIOUS)):
        return None
    from_start = float(np.abs(x.q[k + 1] - own.mechanism.q0).max())
    return float(x.t[k + 1]), float(unexplained[k]), bool(from_start <= 0.1 * unexplained[k])
