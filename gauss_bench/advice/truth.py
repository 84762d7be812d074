"""The truth about any motion, in seconds: equal steps, halved until that changes little of what is asked for.

The steps are those of order eight of the suite's own formulation, compiled where that can be. Half the step is the truth, and what
halving changed is its error bar, which at order eight is some two hundred times too large. That the equations are the linkage's is
shown by its own accelerations in numpy at every sample, and where a certificate tells the motion, by that: the bar then holds what
the two differ by. Between samples, which lie as densely as the coarser steps, positions and speeds are polynomials of degree five
through both ends' positions, speeds and accelerations; what that leaves out is part of the bar too.
"""

import math
import threading
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from importlib.util import find_spec

import numpy as np

from gauss_bench.bench.ways import Run
from gauss_bench.engines.base import Choice
from gauss_bench.mechanism.evaluate import Evaluator
from gauss_bench.metrics import Drift, drift, joint_force_errors, relative_acceleration_error, state_errors
from gauss_bench.reach import UNITS
from gauss_bench.reference.absolute import AbsoluteCoordinates
from gauss_bench.reference.store import find_certified
from gauss_bench.runs.apart import Request, run_apart
from gauss_bench.runs.one_run import Sampling
from gauss_bench.runs.worker import Worker
from gauss_bench.terms import Array
from gauss_bench.trajectory import Reference, Trajectory

METHOD = "dop853_fixed"
COARSEST = {"gauss-native": 1600, "gauss": 100}  # steps of the coarser run at first
COMPILED = 0.5  # of the budget: where a kernel that compiles again on its way takes longer, numpy serves
MOST = 400_000  # steps of a run
POLL = 0.1  # [s] between looks at the clock
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


def truth(
    run: Run,
    wanted: Mapping[str, float],
    left: Callable[[], float],
    worker: Worker,
    told: Callable[[str], object],
    at_rest: Callable[[], object] = lambda: None,
) -> Truth:
    """A truth whose bars are within `wanted` (kind -> m, rad or N), or as near to that as the seconds and rounding allow.

    A kernel takes seconds to compile, and more where it changes its partition; meanwhile numpy takes steps too, in a worker of its
    own. Its first two runs, where they serve, are the truth; else the compiled ones are, and finer ones in numpy where those fail
    or take longer than COMPILED of the budget: which of them it is does not depend on who is faster, unless time ends.

    Args:
        left: how many seconds it may still take.
        worker: of the compiled formulation, whose model it keeps.
        at_rest: called once nothing of this runs in `worker`, which may be after the answer.

    Raises:
        NoTruth: no run came to an end, its accelerations are not the linkage's, or it is not where its certificate says.
    """
    budget = left()

    def serves(lane: "_Followed | None") -> bool:
        return lane is not None and lane.best is not None and all(lane.best.bars.get(k, 0.0) <= x for k, x in wanted.items())

    with Worker() as aside:
        compiled = None
        if find_spec("llvmlite") and not run.mechanism.has_friction:
            compiled = _Followed(run, wanted, left, worker, told, "gauss-native", at_rest)
        else:
            at_rest()
        plain = _Followed(run, wanted, left, aside, told, "gauss")
        while not plain.looked.wait(POLL) and left() > 0:
            pass
        if compiled is not None and not serves(plain):
            while not compiled.ended.wait(POLL) and left() > (1 - COMPILED) * budget:
                pass
        while not (serves(plain) or serves(compiled)) and left() > 0:
            waiting = [x for x in (compiled, plain) if x is not None and not x.ended.is_set()]
            if not waiting:
                break
            waiting[0].ended.wait(POLL)
        chosen = plain if plain.quick or not serves(compiled) else compiled
        plain.stop(aside)
    if compiled is not None:
        compiled.enough = True
    known = [x.best for x in (chosen, compiled, plain) if x is not None and x.best is not None]
    if not known:
        reasons = dict.fromkeys(x.reason for x in (compiled, plain) if x is not None and x.reason)
        raise NoTruth(f"the motion cannot be followed: {'; '.join(reasons) or f'not within {budget:.3g} s'}")
    best = known[0] if serves(chosen) else min(known, key=lambda x: max(x.bars.get(k, 0.0) / y for k, y in wanted.items()))
    return _certify(run, Evaluator(run.mechanism), best)


class _Followed(threading.Thread):
    """A motion, followed by one engine in ever smaller steps until that serves, time ends, or it is told that this is enough.

    Attributes:
        best: the truth so far; looked: whether there is a first one, or none to come; ended: whether there is no more to come.
        quick: whether the first one serves.
        reason: why there is none.
    """

    def __init__(
        self,
        run: Run,
        wanted: Mapping[str, float],
        left: Callable[[], float],
        worker: Worker,
        told: Callable[[str], object],
        engine: str,
        at_rest: Callable[[], object] = lambda: None,
    ):
        super().__init__(daemon=True)
        self.best: Truth | None = None
        self.looked, self.ended = threading.Event(), threading.Event()
        self.quick, self.enough, self.reason = False, False, ""
        self._run, self._wanted, self._left, self._worker = run, wanted, left, worker
        self._told, self._engine, self._at_rest = told, engine, at_rest
        self.start()

    def stop(self, worker: Worker) -> None:
        """End it and the process that works for it, whatever that is at."""
        self.enough = True
        while not self.ended.is_set():
            if (process := worker.process) is not None:
                process.kill()
            self.ended.wait(0.05)

    def run(self) -> None:
        """Take steps."""
        try:
            with np.errstate(all="ignore"):
                self._follow()
        except NoTruth as reason:
            self.reason = str(reason)
        except BaseException as error:  # a thread's own: who waits for it is told
            self.reason = f"{type(error).__name__}: {error}"
        finally:
            if self.reason and not self.enough:
                self._told(f"truth: {self._engine}: {self.reason}")
            self.ended.set()
            self.looked.set()
            self._at_rest()

    def _follow(self) -> None:
        judge, steps = Evaluator(self._run.mechanism), COARSEST[self._engine]
        fine: Trajectory | None = None
        while steps <= MOST:
            coarse = fine if fine is not None else self._take(steps)
            finer = None if coarse is None else self._take(2 * steps)
            if self.enough or self._left() <= 0:
                break
            if coarse is not None and finer is not None and self._is_enough(judge, coarse, finer, steps):
                break
            fine, steps = finer, 2 * steps

    def _is_enough(self, judge: Evaluator, coarse: Trajectory, finer: Trajectory, steps: int) -> bool:
        """Take the finer run where it is better; True where finer ones are not needed, or rounding makes them no better."""
        truth = _compare(self._run, judge, coarse, finer, steps, self._engine)
        known = ", ".join(f"{truth.bars[k]:.1e} {UNITS[k]}" for k in self._wanted if k in truth.bars)
        self._told(f"truth: {2 * steps} steps by {self._engine}, known to {known}")
        if self.best is not None and all(truth.bars[k] >= self.best.bars[k] for k in ("position", "angle")):
            return True  # rounding
        self.best = truth
        served = all(truth.bars.get(k, 0.0) <= x for k, x in self._wanted.items())
        self.quick = served and steps == COARSEST[self._engine]
        self.looked.set()
        return served

    def _take(self, steps: int) -> Trajectory | None:
        """The trajectory of so many steps; None where time ends before them, or they fail: `reason` says how."""
        left = self._left()
        if self.enough or left <= 0:
            return None
        ran = _run(self._run, self._engine, steps, left, self._worker)
        if isinstance(ran, str):
            self.reason = ran
            return None
        return ran


def _run(run: Run, engine: str, steps: int, limit: float, worker: Worker) -> Trajectory | str:
    """The trajectory of so many steps, every so many of them kept (SAMPLES at most); or a sentence why there is none."""
    every = max(1, math.ceil(steps / SAMPLES))
    kept = steps // every
    times = run.until / kept * np.arange(kept + 1)
    choice = Choice("default", METHOD, "none", run.until / steps)
    request = Request(run.linkage, run.mechanism.scenario, engine, choice, Sampling(times, choice.step, steps, 0))
    ran = run_apart(request, run.mechanism, limit, worker, again=True)
    return ran.trajectory or ran.message


def _compare(run: Run, judge: Evaluator, coarse: Trajectory, fine: Trajectory, steps: int, engine: str) -> Truth:
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
    reference = Reference(t, q, v, true, none, none, none, none, none, none, how)
    errors, gaps = state_errors(run.mechanism, coarse, reference), _gaps(judge, fine)
    bars = {"position": float(errors.length.max()), "angle": float(errors.angle.max())}
    force = float(joint_force_errors(judge, coarse, reference).max())
    halving = bars | ({} if math.isnan(force) else {"force": force})
    bars = {kind: x + _between_bar(reference, kind) + gaps for kind, x in bars.items()}
    return Truth(reference, halving | bars, halving, steps, False, how)


def _gaps(judge: Evaluator, fine: Trajectory) -> float:
    """The gaps of open joints [m, rad]."""
    opened: Drift = drift(judge, fine)
    return float(opened.position.max())


def _between_bar(known: Reference, kind: str) -> float:
    """The error bar of polynomials between the samples."""
    half = replace(known, **{x: getattr(known, x)[::2] for x in ("t", "q", "v", "a")})
    if len(half.t) < 2:
        return math.inf
    missed = np.abs(between(half, known.t[1:-1:2])[0] - known.q[1:-1:2])
    columns = np.arange(known.q.shape[1]) % 3 == 2
    return float(missed[:, columns if kind == "angle" else ~columns].max(initial=0.0)) / SIXTH


def _certify(run: Run, judge: Evaluator, truth: Truth) -> Truth:
    """The same truth with what a certificate says of it.

    Raises:
        NoTruth: the certificate tells another motion.
    """
    certificate = find_certified(run.mechanism, run.until)
    if certificate is None:
        return truth
    q, v = between(truth.reference, certificate.t)
    errors = state_errors(run.mechanism, Trajectory(certificate.t, q, v, certificate.a, 0), certificate)
    own = float(np.fmax(certificate.error_q, certificate.floor_q).max())
    off = {"position": float(errors.length.max()), "angle": float(errors.angle.max())}
    if max(off.values()) > 1e3 * max(truth.bars["position"], truth.bars["angle"], own):
        raise NoTruth(f"the motion found and the certified one differ by {max(off.values()):.1e}")
    bars = {**truth.bars, **{kind: max(x, truth.bars[kind] / 256) + own for kind, x in off.items()}}
    return replace(truth, bars=bars, certified=True, told=f"certified to {own:.0e}, and so says what was run here: {truth.told}")
