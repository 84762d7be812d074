"""Detect wrong samples of a correct motion: taken at wrong times, of exchanged links, without motion, or after a restart.

Wrong times are detected by fitting a shift and a stretch of time, and exchanged links by trying other orders of the links. A fit or
an order is reported if the true motion, changed by it, agrees with the reported samples to a small part of the error.
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
STILL = 1e-3  # largest travel of samples without motion, relative to the true travel
JUMP = 10.0  # smallest jump, relative to the displacement that the velocity allows in a step
BESIDE_TURNS = 1e-3  # [rad, m] largest error that is left after whole turns are removed
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


def time_map(truth: TrueMotion, reported: States, stretch: bool) -> TimeMap | None:
    """Fit the map true time = shift + rate * reported time to reported samples by Gauss-Newton steps.

    The error is the distance of a reported state from the true state, with velocities in units of positions. Return None if the fit
    leaves more than the share LEFT of the error (median over the samples). The factor `rate` is fitted if `stretch` is true, and is
    1 otherwise.
    """
    reference = truth.reference
    rms = [float(np.sqrt(np.mean(x * x))) for x in (reference.v, reference.a)]
    if not all(rms):
        return None
    pace = rms[0] / rms[1]  # [s] time in which velocities change
    shift, rate = 0.0, _first_rate(truth, reported, pace) if stretch else 1.0
    inside = reported.t * rate <= truth.until
    x = reported[inside][:: max(1, int(inside.sum()) // LOOKED_AT)]
    if len(x) < 3:
        return None
    state, best = _state(x, pace), TimeMap(shift, rate, np.inf)
    before = np.linalg.norm(state - _state(truth.at(x.t), pace), axis=1)  # errors without a map
    for _ in range(ITERATIONS):
        # the reference can be continued only a little before its start and beyond its end
        mapped = truth.at(np.clip(shift + rate * x.t, -0.05 * truth.until, 1.05 * truth.until))
        off = state - _state(mapped, pace)
        remaining_share = float(np.median(np.linalg.norm(off, axis=1) / np.maximum(before, 1e-9 * before.max(initial=1e-300))))
        if not remaining_share < 0.99 * best.left:  # the last step improved the fit by less than 1 %
            break
        best = TimeMap(shift, rate, remaining_share)
        slope = np.hstack([mapped.v, truth.motion.accelerations(mapped) * pace])  # derivative of the state by time
        columns = [slope, slope * x.t[:, None]] if stretch else [slope]  # derivatives by shift and rate
        change = np.linalg.lstsq(np.array([c.ravel() for c in columns]).T, off.ravel(), rcond=None)[0]
        change = np.clip(change, -pace, pace)  # farther away the linearisation does not hold
        shift, rate = shift + float(change[0]), rate + (float(change[1]) if stretch else 0.0)
    return best if best.left <= LEFT else None


def _first_rate(truth: TrueMotion, reported: States, pace: float) -> float:
    """Estimate the ratio of true time to reported time, which is 1 if the times are right, as a first guess for the fit.

    The true time of a reported state is taken from the nearest state among the reference's samples. The result is the median, over
    all samples, of the ratio of true to reported time, limited to 0.2 to 5. `pace` [s] is the factor that makes velocities
    comparable with positions.
    """
    r = truth.reference
    true = _state(States(r.t, r.q, r.v), pace)
    nearest = np.array([r.t[np.linalg.norm(true - x, axis=1).argmin()] for x in _state(reported, pace)])
    rates = nearest[reported.t > 0] / reported.t[reported.t > 0]
    return float(np.clip(np.median(rates), 0.2, 5.0)) if len(rates) else 1.0


def stands_still(truth: States, reported: States) -> bool:
    """Tell whether reported samples do not move while the reference does."""
    moved = [float(np.abs(x.q - x.q[0]).max()) for x in (reported, truth)]
    return moved[0] <= STILL * moved[1]


def whole_turns(off: Array) -> Array:
    """Return the whole turns (k, links) by which angles are wrong, given the errors `off` (k, n) of all coordinates.

    Return zeros if an error larger than BESIDE_TURNS remains in any coordinate after the whole turns are subtracted.
    """
    rest, turns = off.copy(), np.round(angles(off) / (2 * np.pi))
    angles(rest)[...] -= 2 * np.pi * turns  # `angles` returns a view of the columns of `rest` that are angles
    return turns if float(np.abs(rest).max(initial=0.0)) <= BESIDE_TURNS else np.zeros_like(turns)


def other_velocities(moved: Array, reported: Array) -> tuple[float, float, float]:
    """Compare reported velocities `reported` with the rates `moved` at which positions change, both (k, n).

    Return three numbers: the relative error of the reported velocities; the factor c with which c * moved fits them best; and the
    share of the error that remains with this factor.
    """
    error, true = float(np.sum((reported - moved) ** 2)), float(np.sum(moved**2))  # squares
    factor = float(np.sum(reported * moved)) / max(true, 1e-300)
    left = float(np.sum((reported - factor * moved) ** 2))
    return float(np.sqrt(error / max(true, 1e-300))), factor, float(np.sqrt(left / max(error, 1e-300)))


@dataclass(frozen=True)
class Order:
    """A wrong order in which an engine reports links or joint coordinates.

    Attributes:
        sentence: the order of the reported links or joints in words.
        left: share of the error that remains if the reported links or joints are put into the right order.
    """

    sentence: str
    left: float


def order(mechanism: Mechanism, truth: States, reported: States) -> Order | None:
    """Find a permutation of the reported links or joint coordinates that fits the true motion much better than the reported order.

    Return None if the reported order is the best one, or if no permutation reduces the error to the share LEFT.

    Args:
        mechanism: the linkage.
        truth, reported: true states, and the states that the engine reports at the same times.
    """
    from scipy.optimize import linear_sum_assignment  # its import takes longer than most diagnoses

    best: Order | None = None
    for words, reported_columns, true_columns, names in _columns(mechanism, truth, reported):
        # cost[i, j]: difference of reported column i from true column j, root mean square over the samples
        cost = np.array([[np.sqrt(np.mean((x - y) ** 2)) for y in true_columns] for x in reported_columns])
        _, assigned = linear_sum_assignment(cost)  # the true column of each reported one, with the least sum of costs
        as_reported, reordered = float(np.trace(cost)), float(cost[np.arange(len(cost)), assigned].sum())
        wrong = [k for k, x in enumerate(assigned) if x != k]  # columns that hold the values of another one
        if wrong and reordered <= LEFT * as_reported and (best is None or reordered / as_reported < best.left):
            listed = ", ".join(f"{names[k]} holds {names[assigned[k]]}" for k in wrong)
            best = Order(f"{words} are in another order: {listed}", reordered / as_reported)
    return best


def _columns(mechanism: Mechanism, truth: States, reported: States) -> Iterator[tuple[str, Array, Array, list[str]]]:
    """Yield, for each kind of coordinate, the values whose order an engine may confuse, one row for each link or joint.

    The kinds are positions, velocities and angles of links, and coordinates and velocities of joints. Each item has the name of the
    kind, the reported values and the true values (columns, ...), and the names of the columns, which are links or joints.
    """

    def links(x: Array) -> Array:
        """Return the coordinates x (k, n) of k states, ordered by links: (links, k, 3)."""
        return bodies(x).transpose(1, 0, 2)

    names = [link.name for link in mechanism.links]
    for words, found, true in (("links", reported.q, truth.q), ("velocities of links", reported.v, truth.v)):
        yield words, links(found), links(true), names
        yield f"angles in {words}", angles(found).T, angles(true).T, names
    for shallow in (False, True):  # trees of long chains and trees of least depth have other joint coordinates
        tree = spanning_tree(mechanism, shallow)
        named = [""] * tree.n
        for b in tree.branches:
            for k in range(b.at, min(tree.n, b.at + (3 if b.kind == "free" else 1))):  # a free link has three coordinates
                named[k] = b.joint.name if b.joint else names[b.link]
        (y, dy), (true_y, true_dy) = tree.relative(reported.q, reported.v), tree.relative(truth.q, truth.v)
        yield "joint coordinates", y.T, true_y.T, named
        yield "joint velocities", dy.T, true_dy.T, named


def suspicious_window(reported: States, a: Array) -> int | None:
    """Return the index of the checkpoint after which the state may have jumped, or None if no displacement is suspicious.

    A displacement from one checkpoint to the next is suspicious if velocities and accelerations do not explain it.

    Args:
        reported: states at k checkpoints; a: (k, n) accelerations there.
    """
    h = np.diff(reported.t)[:, None]
    v, q = reported.v, reported.q
    # displacement less its integral by the corrected trapezoidal rule (k - 1,)
    off = np.abs(np.diff(q, axis=0) - h / 2 * (v[1:] + v[:-1]) + h**2 / 12 * np.diff(a, axis=0)).max(axis=1)
    k = int(off.argmax()) if len(off) else 0
    return k if len(off) and off[k] > SUSPICIOUS else None


@dataclass(frozen=True)
class Jump:
    """A displacement in one step that velocities do not explain.

    Attributes:
        t: time of the first sample after the jump [s].
        size: size of the jump [m, rad].
        to_start: whether the jump leads back to the start.
    """

    t: float
    size: float
    to_start: bool


def jump(own: OwnMotion, dense: States) -> Jump | None:
    """Return the step in which the state jumped, or None; `dense` has the start, and then samples at every step.

    The unexplained displacement of a step is its displacement minus the step times the mean of the velocities at both ends. The
    step
    with the largest unexplained displacement is a jump under two conditions: its unexplained displacement is larger than JUMP times
    the median over all steps; and it is larger than SUSPICIOUS, or larger than JUMP times the sum of this median and the
    displacement that the velocities allow. The jump leads back to the start if the state after the jump is nearer to the start than
    a tenth of the size of the jump.
    """
    x = dense[1:]  # samples at every step; dense[0] may lie long before them
    h = np.diff(x.t)[:, None]
    unexplained = np.abs(np.diff(x.q, axis=0) - h / 2 * (x.v[1:] + x.v[:-1])).max(axis=1)
    allowed = (h * np.maximum(np.abs(x.v[1:]), np.abs(x.v[:-1]))).max(axis=1)  # displacement that the velocities allow
    if not len(unexplained):
        return None
    usual, k = float(np.median(unexplained)), int(unexplained.argmax())
    # no jump: not far above the usual size; or neither large nor far above what the velocities allow
    if unexplained[k] <= max(JUMP * usual, min(JUMP * (allowed[k] + usual), SUSPICIOUS)):
        return None
    from_start = float(np.abs(x.q[k + 1] - own.mechanism.q0).max())
    return Jump(t=float(x.t[k + 1]), size=float(unexplained[k]), to_start=from_start <= 0.1 * unexplained[k])
