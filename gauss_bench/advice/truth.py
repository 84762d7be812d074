"""The truth about any motion, in seconds: equal steps, halved until that changes little of what is asked for.

The steps are those of order eight of the suite's own formulation, compiled where that can be. Half the step is the truth, and what
halving changed is its error bar, which at order eight is some two hundred times too large. That the equations are the linkage's is
shown by its own accelerations in numpy at every sample, and where a certificate tells the motion, by that: the bar then holds what
the two differ by. Between samples, which lie as densely as the coarser steps, positions and speeds are polynomials of degree five
through both ends' positions, speeds and accelerations; what that leaves out is part of the bar too.
"""

import math
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from importlib.util import find_spec

import numpy as np

from gauss_bench.bench.apart import Request, run_apart
from gauss_bench.bench.one_run import Sampling
from gauss_bench.bench.search import UNITS
from gauss_bench.bench.ways import Run
from gauss_bench.bench.worker import Worker
from gauss_bench.engines.base import Choice
from gauss_bench.mechanism.evaluate import Evaluator
from gauss_bench.metrics import Drift, drift, joint_force_errors, relative_acceleration_error, state_errors
from gauss_bench.reference.absolute import AbsoluteCoordinates
from gauss_bench.reference.store import certified_reference
from gauss_bench.terms import Array
from gauss_bench.trajectory import Reference, Trajectory

METHOD = "dop853_fixed"
COARSEST = {"gauss-native": 1600, "gauss": 100}  # steps of the coarser run at first
COMPILED = 0.5  # of the budget at most, for a kernel that compiles again on its way: numpy serves where it comes to no end
MOST = 400_000  # steps of a run
SAMPLES = 3200  # of the truth at most
AGREEMENT = 1e-6  # relative, of accelerations against those in numpy: rounding leaves 1e-9, a wrong term about 1
SIXTH = 16.0  # what a polynomial through every second sample is off by, over what one through all is: 64, of which a quarter counts


class NoTruth(ArithmeticError):
    """Nothing is known well enough to judge by."""


@dataclass(frozen=True, eq=False)
class Truth:
    """A motion to judge by.

    Attributes:
        reference: its samples, equally spaced.
        bars: kind of error -> how far the truth itself may be off [m], [rad], [N]; no force where redundant rows leave it open.
        halving: kind -> what halving the steps changed; steps: before that.
        certified: whether a certificate vouches for it.
        told: one line on how it was made.
    """

    reference: Reference
    bars: Mapping[str, float]
    halving: Mapping[str, float]
    steps: int
    certified: bool
    told: str

    def at(self, run: Run, times: Array) -> Reference:
        """The truth at any times (k,) of the run, accelerations included."""
        known = self.reference
        q, v = between(known, times)
        a = AbsoluteCoordinates(run.mechanism).acceleration(times, q, v)
        bar = np.full(len(times), max(self.bars["position"], self.bars["angle"]))
        none = np.zeros(len(times))
        return Reference(times, q, v, a, bar, bar, bar, none, none, none, known.method)


def between(known: Reference, times: Array) -> tuple[Array, Array]:
    """q and v (k, n) at times between equally spaced samples, by polynomials of degree five in q."""
    h = float(known.t[1] - known.t[0])
    k = np.clip(np.floor(times / h + 1e-9).astype(int), 0, len(known.t) - 2)
    s = ((times - known.t[k]) / h)[:, None]
    p, u, b = known.q[k], h * known.v[k], h * h * known.a[k]
    P, U, B = known.q[k + 1] - p - u - b / 2, h * known.v[k + 1] - u - b, h * h * known.a[k + 1] - b
    c3, c4, c5 = 10 * P - 4 * U + B / 2, -15 * P + 7 * U - B, 6 * P - 3 * U + B / 2
    q = p + s * (u + s * (b / 2 + s * (c3 + s * (c4 + s * c5))))
    return q, (u + s * (b + s * (3 * c3 + s * (4 * c4 + s * 5 * c5)))) / h


def truth(run: Run, wanted: Mapping[str, float], budget: float, worker: Worker, told: Callable[[str], object]) -> Truth:
    """A truth whose bars are within `wanted` (kind -> m, rad or N), or as near to that as `budget` seconds and rounding allow.

    Raises:
        NoTruth: no run came to an end, its accelerations are not the linkage's, or it is not where its certificate says.
    """
    started = time.monotonic()
    if find_spec("llvmlite") and not run.mechanism.has_friction:
        try:
            return _followed(run, wanted, COMPILED * budget, worker, told, "gauss-native")
        except NoTruth as reason:
            told(f"truth: compiled: {reason}; in numpy instead")
    return _followed(run, wanted, budget - (time.monotonic() - started), worker, told, "gauss")


def _followed(
    run: Run, wanted: Mapping[str, float], budget: float, worker: Worker, told: Callable[[str], object], engine: str
) -> Truth:
    """`truth` by one engine."""
    started, steps, fine, reasons = time.monotonic(), COARSEST[engine], None, ""
    best: Truth | None = None
    judge = Evaluator(run.mechanism)
    while steps <= MOST:
        left = budget - (time.monotonic() - started)
        if left <= 0:
            reasons = reasons or f"not within {budget:g} s"
            break
        coarse = fine if fine is not None else _run(run, engine, steps, max(left * 0.7, 1.0), worker)
        left = budget - (time.monotonic() - started)
        finer = _run(run, engine, 2 * steps, left, worker) if left > 0 else f"no answer within {budget:.3g} s"
        if isinstance(coarse, Trajectory) and isinstance(finer, Trajectory):
            found = _compared(run, judge, coarse, finer, steps, engine)
            told(
                f"truth: {2 * steps} steps, known to "
                + ", ".join(f"{found.bars[k]:.1e} {UNITS[k]}" for k in wanted if k in found.bars)
            )
            if best is not None and found.bars["position"] >= best.bars["position"] and found.bars["angle"] >= best.bars["angle"]:
                break  # rounding
            best = found
            if all(found.bars.get(k, 0.0) <= x for k, x in wanted.items()):
                break
        else:
            reasons = str(finer if isinstance(finer, str) else coarse)
        fine, steps = (finer if isinstance(finer, Trajectory) else None), 2 * steps
    if best is None:
        raise NoTruth(f"the motion cannot be followed: {reasons or 'no number of steps serves'}")
    return _certified(run, judge, best)


def _run(run: Run, engine: str, steps: int, limit: float, worker: Worker) -> Trajectory | str:
    """So many steps, or why not; samples at most SAMPLES, every so many whole steps."""
    every = max(1, math.ceil(steps / SAMPLES))
    kept = steps // every
    times = run.until / kept * np.arange(kept + 1)
    choice = Choice("default", METHOD, "none", run.until / steps)
    request = Request(run.linkage, run.mechanism.scenario, engine, choice, Sampling(times, choice.step, steps, 0))
    found = run_apart(request, run.mechanism, limit, worker, again=True)
    return found.trajectory or found.message


def _compared(run: Run, judge: Evaluator, coarse: Trajectory, fine: Trajectory, steps: int, engine: str) -> Truth:
    """The finer run, with what it differs from the coarser by as its bar."""
    every = (len(fine.t) - 1) // (len(coarse.t) - 1)
    kept = [x[::every] for x in (fine.t, fine.q, fine.v, fine.a)]
    true = AbsoluteCoordinates(run.mechanism).acceleration(*kept[:3])
    off = float(np.median(relative_acceleration_error(kept[3], true)))
    if not off <= AGREEMENT:
        raise NoTruth(f"accelerations of {engine} differ from those of the linkage by {off:.1e} of themselves")
    none = np.zeros(len(kept[0]))
    how = f"step-halved ({2 * steps} steps of order eight by {engine}, and {steps})"
    t, q, v, _ = kept
    found = Reference(t, q, v, true, none, none, none, none, none, none, how)
    errors, gaps = state_errors(run.mechanism, coarse, found), _gaps(judge, fine)
    bars = {"position": float(errors.length.max()), "angle": float(errors.angle.max())}
    force = float(joint_force_errors(judge, coarse, found).max())
    halving = bars | ({} if math.isnan(force) else {"force": force})
    bars = {kind: x + _between_bar(found, kind) + gaps for kind, x in bars.items()}
    return Truth(found, halving | bars, halving, steps, False, how)


def _gaps(judge: Evaluator, fine: Trajectory) -> float:
    """How far joints have opened [m, rad]."""
    found: Drift = drift(judge, fine)
    return float(found.position.max())


def _between_bar(known: Reference, kind: str) -> float:
    """How far polynomials between the samples may be off."""
    half = replace(known, **{x: getattr(known, x)[::2] for x in ("t", "q", "v", "a")})
    if len(half.t) < 2:
        return math.inf
    missed = np.abs(between(half, known.t[1:-1:2])[0] - known.q[1:-1:2])
    columns = np.arange(known.q.shape[1]) % 3 == 2
    return float(missed[:, columns if kind == "angle" else ~columns].max(initial=0.0)) / SIXTH


def _certified(run: Run, judge: Evaluator, found: Truth) -> Truth:
    """The same truth with what a certificate says of it.

    Raises:
        NoTruth: the certificate tells another motion.
    """
    certificate = certified_reference(run.mechanism, run.until)
    if certificate is None:
        return found
    q, v = between(found.reference, certificate.t)
    errors = state_errors(run.mechanism, Trajectory(certificate.t, q, v, certificate.a, 0), certificate)
    own = float(np.fmax(certificate.error_q, certificate.floor_q).max())
    off = {"position": float(errors.length.max()), "angle": float(errors.angle.max())}
    if max(off.values()) > 1e3 * max(found.bars["position"], found.bars["angle"], own):
        raise NoTruth(f"the motion found and the certified one differ by {max(off.values()):.1e}")
    bars = {**found.bars, **{kind: max(x, found.bars[kind] / 256) + own for kind, x in off.items()}}
    return replace(found, bars=bars, certified=True, told=f"certified to {own:.0e}, and so says what was run here: {found.told}")
