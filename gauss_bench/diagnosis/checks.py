"""Checks of the suite itself with known answers: each check returns None if all is correct, or a sentence on the fault it detects.

The checks call the functions that judge engines, certify references, compare figures with the baseline and measure times. Small
linkages and short motions are used, so that all checks together take seconds. The gate (`bench/gate.py`) is the regression test
that compares figures, such as errors, with those of a stored baseline.
"""

import gc
import math
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from functools import cache
from typing import Any
from unittest.mock import patch

import numpy as np
import pandas as pd

from gauss_bench import judge as judging
from gauss_bench import metrics
from gauss_bench import terms as algebra
from gauss_bench.bench import clock, gate
from gauss_bench.engines.base import Choice
from gauss_bench.engines.interpreted import Interpreted
from gauss_bench.formulations import FORMULATIONS
from gauss_bench.integrate import BAUMGARTE_RATE, fixed_step
from gauss_bench.linkage.load import load
from gauss_bench.mechanism.coordinates import position
from gauss_bench.mechanism.evaluate import Evaluator
from gauss_bench.mechanism.model import Mechanism
from gauss_bench.mechanism.spaces import SIZE, angles, bodies, places
from gauss_bench.reference.build import random_states
from gauss_bench.reference.certificate import ARRAYS, as_reference, certificate_path, read_certificate
from gauss_bench.reference.verification import verify
from gauss_bench.runs import blocks, one_run
from gauss_bench.runs.offers import describe
from gauss_bench.tables import KEY
from gauss_bench.terms import Array
from gauss_bench.trajectory import Reference, Samples, Trajectory

FOUR_BAR, CRANK_SLIDER, DRIVEN = ("four_bar", "torque"), ("crank_slider", "paper"), ("four_bar", "cycloid")
SHAPER = ("shaper", "torque")  # slides that carry moments
AGREES = 1e-10  # relative tolerance; formulations agree to about 1e-13
FIRST_SAMPLES = 5  # number of samples of a certificate that are verified, which are enough to detect a fault
MOVED = 1e-3  # [m] known displacement of a link
ORDERS = {"rk4": 4, "semi_implicit_euler": 1, "dop853_fixed": 8, "gauss_legendre": 6}
Figures = dict[str, float | str]


def alter(
    mechanism: Mechanism, of: str = "", gravity: float = 1.0, joint: str = "", by: float = 0.0, **factors: float
) -> Mechanism:
    """Return an altered linkage.

    Args:
        of: name of the link or force whose attributes are multiplied; "" for none.
        factors: attribute of this link or force -> factor by which the attribute is multiplied.
        gravity: factor by which gravity is multiplied.
        joint: name of the pin that is displaced; "" for none.
        by: displacement [m] of this pin in the direction x of the frame of its second link.
    """

    def scale(x: Any) -> Any:
        """Return a link or force with its attributes multiplied by `factors` if it has the given name, and otherwise unchanged."""
        return replace(x, **{key: getattr(x, key) * factor for key, factor in factors.items()}) if x.name == of else x

    def move_pin(x: Any) -> Any:
        """Return a joint, displaced if it has the given name, and unchanged otherwise."""
        return replace(x, b=replace(x.b, local=x.b.local + np.array([by, 0.0]))) if x.name == joint else x

    return replace(
        mechanism,
        links=tuple(map(scale, mechanism.links)),
        forces=tuple(map(scale, mechanism.forces)),
        joints=tuple(map(move_pin, mechanism.joints)),
        gravity=gravity * np.asarray(mechanism.gravity),
    )


@cache
def states(which: tuple[str, str]) -> Samples:
    """Return random states of a linkage in a scenario with true accelerations, computed from the crank's angle alone."""
    return random_states(load(*which), count=16)


@cache
def truth(which: tuple[str, str], until: float = 0.5) -> Reference:
    """Return the certified motion of a linkage in a scenario up to `until` [s]."""
    path = certificate_path(load(*which))
    assert path is not None
    return as_reference(read_certificate(path), until)


def shift(x: Trajectory, level: str, column: int, by: float) -> Trajectory:
    """Return a trajectory with a number added to one column of its array "q", "v" or "a", which is `level`."""
    return replace(x, **{level: getattr(x, level) + by * np.eye(x.q.shape[1])[column]})


def off(figure: Any, expected: float, tolerance: float) -> bool:
    """Tell whether a number, or the largest of several, differs from its expected value by more than the tolerance; NaN differs.

    The tolerance is relative if the magnitude of the expected value is larger than 1, and absolute otherwise.
    """
    return not abs(float(np.max(figure)) - expected) <= tolerance * max(1.0, abs(expected))


def ask_gate(figures: Figures, baseline: Figures) -> str | None:
    """Run the gate (the regression test) on the figures of one invented case, each name -> value.

    Return the first message on a figure that the gate rejects against the baseline, or None if it accepts all of them.
    """
    # any values for the columns that identify a case; they are the same in both tables
    key = dict(zip(KEY, ("linkage", "scenario", "engine", "default", "rk4", "none", 1e-3, 1.0), strict=True))

    def frame(some: Figures) -> pd.DataFrame:
        """Return figures, name -> value, as a table that `gate.compare` accepts, with one row for each figure."""
        texts = {k: x if isinstance(x, str) else f"{x:.15g}" for k, x in some.items()}
        return pd.DataFrame([key | {"metric": k, "value": x, "message": "", "accepted": ""} for k, x in texts.items()])

    verdicts = list(gate.failures(gate.compare(frame(figures), frame(baseline))))
    return str(verdicts[0]) if verdicts else None


# models


def check_model(which: tuple[str, str] = FOUR_BAR, alter: Mapping[str, Any] | None = None) -> str | None:
    """Compare accelerations of the engine `gauss`, which models an altered linkage, with the true ones at known states.

    Return the message of the gate (the regression test) if it rejects the error, or None if it accepts the error. The gate's
    baseline is the error with the unaltered linkage.

    Args:
        which: linkage and scenario.
        alter: arguments by which the function `alter` changes the modelled linkage; None for the true linkage.
    """

    def measure_error(modelled: Mechanism) -> Figures:
        """Return a dict of one figure: the median relative error of the accelerations if the engine models `modelled`."""
        # x: states of the unaltered linkage, with its true accelerations x.a
        x, engine = states(which), Interpreted("gauss").build(modelled, Choice(integrator="rk4"))
        accelerations = np.array([engine.acceleration(float(t), q, v) for t, q, v in zip(x.t, x.q, x.v, strict=True)])
        return {"acceleration_error_median": float(np.median(metrics.relative_acceleration_error(accelerations, x.a)))}

    unaltered = load(*which)
    return ask_gate(measure_error(change(unaltered, alter)), measure_error(unaltered))


def change(mechanism: Mechanism, how: Mapping[str, Any] | None) -> Mechanism:
    """Return a linkage changed by the function `alter` with the arguments `how`, or unchanged if there are none."""
    return alter(mechanism, **how) if how else mechanism


def check_sample_times(late: float) -> str | None:
    """Ask the gate (the regression test) about a correct motion of the four-bar linkage whose samples are `late` [s] too late.

    Return None if the gate accepts the errors of these samples, and otherwise the gate's message.
    """
    reference = truth(FOUR_BAR)
    correct = reference.samples
    # the states at the time t + late, by Taylor's series to second order
    delayed = replace(correct, q=correct.q + late * correct.v + late**2 / 2 * correct.a, v=correct.v + late * correct.a)

    def measure_errors(x: Trajectory) -> Figures:
        """Return name -> value of the largest position error and the largest velocity error of a motion."""
        errors = metrics.state_errors(load(*FOUR_BAR), x, reference)
        return {"position_error": float(errors.position.max()), "velocity_error": float(errors.velocity.max())}

    return ask_gate(measure_errors(delayed), measure_errors(correct))


# formulations and integrators


def check_formulations() -> str | None:
    """Check accelerations, multipliers and rank of every formulation at known states; return the first fault or None."""
    for which in (FOUR_BAR, CRANK_SLIDER):
        x, evaluator = states(which), Evaluator(load(*which))
        for name, solve in FORMULATIONS.items():
            if name == "yuan_ge_eq16":  # the formula as printed is known to be wrong
                continue
            for k in range(4):
                terms = evaluator.terms(0.0, x.q[k], x.v[k])
                solution = solve(terms)
                scale = float(np.abs(x.a[k]).max())
                if not np.abs(solution.a - x.a[k]).max() <= AGREES * scale:
                    return f"{name}: accelerations are not those of {which[0]}"
                if solution.multipliers is not None:
                    residual = terms.M @ solution.a + terms.J.T @ solution.multipliers - terms.Q
                    if not np.abs(residual).max() <= AGREES * max(1.0, float(np.abs(terms.Q).max()), scale):
                        return f"{name}: multipliers do not balance the forces"
                if solution.rank != len(terms.J):
                    return f"{name}: rank {solution.rank} of {len(terms.J)} independent rows"
    return None


def check_integrators() -> str | None:
    """Check the order of convergence of every integrator with q'' = -q, whose solution is q = cos t; return a fault or None."""

    def error_of(step: Callable[..., tuple[Array, Array]], count: int) -> float:
        """Return the error of (q, v) at t = 1 after `count` equal steps from q = 1, v = 0; step(f, t, q, v, h) -> (q, v)."""
        q, v, h = np.array([1.0]), np.array([0.0]), 1.0 / count
        for k in range(count):
            q, v = step(lambda t, q, v: -q, k * h, q, v, h)
        return float(np.hypot(q[0] - math.cos(1.0), v[0] + math.sin(1.0)))

    for name, order in ORDERS.items():
        few = 3 if order > 4 else 20  # more steps of a high order would only show rounding
        coarse, fine = (max(error_of(fixed_step.STEPS[name], count), 1e-300) for count in (few, 2 * few))
        observed = math.log2(coarse / fine)
        if off(observed, order, 0.1):
            return f"{name} converges by order {observed:.2f}, not {order}"
    return None


def check_stabilizations() -> str | None:
    """Check Baumgarte's terms and the projection at a state that violates its constraints; return the first fault or None."""
    evaluator, x = Evaluator(load(*FOUR_BAR)), states(FOUR_BAR)
    q = x.q[0].copy()
    q[0] += MOVED
    v = x.v[0] + MOVED
    terms = evaluator.terms(0.0, q, v)
    rate = BAUMGARTE_RATE
    expected = -2 * rate * terms.phi_dot - rate**2 * terms.phi  # of gamma, by Baumgarte
    if np.abs(algebra.baumgarte(terms, rate, rate).gamma - terms.gamma - expected).max() > AGREES * np.abs(expected).max():
        return "Baumgarte's terms do not lead back to the constraints"
    at, speed = evaluator.project(0.0, q, x.v[0])
    rows = evaluator.constraints(0.0, at, speed)
    if np.abs(rows.phi).max() > 1e-12 or np.abs(rows.J @ speed).max() > 1e-10:
        return "projection does not lead back to the constraints"
    return None


# metrics and judge


def check_metrics() -> str | None:
    """Check the metrics of motions with known, planted errors; return a sentence on the first wrong metric, or None.

    Each planted error is followed by the metrics that must have its size.
    """
    mechanism, reference = load(*FOUR_BAR), truth(FOUR_BAR)
    evaluator, sound = Evaluator(mechanism), reference.samples  # `sound`: the correct motion
    x, y = SIZE, SIZE + 1  # columns of the second link's centre of mass

    def errors(reported: Trajectory) -> metrics.Errors:
        """Return the errors of reported samples against the reference."""
        return metrics.state_errors(mechanism, reported, reference)

    for column in (x, y):
        moved = shift(sound, "q", column, MOVED)
        gaps = metrics.drift(evaluator, moved).position, errors(moved).length, errors(moved).position
        if any(off(gap, MOVED, 1e-6) for gap in gaps):
            return f"a link that is moved by {MOVED:g} m has a gap or an error of another size"
    faster = shift(sound, "v", y, MOVED)
    if off(metrics.drift(evaluator, faster).velocity, MOVED, 1e-6) or off(errors(faster).velocity, MOVED, 1e-6):
        return f"a velocity of a link that is wrong by {MOVED:g} m/s has a drift or an error of another size"
    if off(metrics.drift(evaluator, shift(sound, "a", y, 1.0)).acceleration, 1.0, 1e-6):
        return "accelerations off the constraints leave no residual"
    (gained, bar), moves = metrics.energy_error(evaluator, sound), metrics.energy_scale(evaluator, sound)
    if not np.abs(gained).max() <= bar + 1e-6 * moves:
        return "a true motion gains energy"
    if not metrics.energy_error(evaluator, replace(sound, v=1.1 * sound.v))[0].max() > 0.1 * moves:
        return "a motion with velocities 10 % too large gains no energy"
    if off(metrics.relative_acceleration_error(1.01 * sound.a, sound.a), 0.01, 1e-9):
        return "accelerations that are 1 % too large have an error other than 1 %"
    steps, rounding = np.array([4e-3, 2e-3, 1e-3]), np.full(3, 1e-12)
    if off(metrics.observed_order(steps, steps**3, np.zeros(3))[1], 3.0, 1e-9):
        return "an error proportional to the third power of the step has an order other than three"
    # errors as large as the error bar are rounding, from which no order can be computed
    return "rounding has an order" if np.isfinite(metrics.observed_order(steps, rounding, rounding)[1]) else None


def check_joint_forces() -> str | None:
    """Check that the joint forces and applied forces on each link balance its inertia (Newton's laws); return a fault or None."""
    for which in (FOUR_BAR, CRANK_SLIDER, SHAPER):
        mechanism, reference = load(*which), truth(which)
        evaluator = Evaluator(mechanism)
        by_joint = metrics.joint_forces(evaluator, reference.samples)  # force of the first link of a joint on its second link
        required = reference.a * evaluator.mass - evaluator.applied.generalised(reference.q, reference.v)  # M a - Q (k, n)
        unbalanced = bodies(required).copy()  # (k, links, 3): what the joints must exert, less what they do exert
        for joint in mechanism.joints:
            (first, second), exerted = joint.ends, by_joint[joint.name]
            force, at = np.stack([exerted["fx"], exerted["fy"]], axis=1), position(reference.q, second)
            for body, sign in ((first.link, -1.0), (second.link, 1.0)):
                if body >= 0:  # not the ground
                    arm = at - places(reference.q)[:, body]  # from the centre of mass to the joint
                    moment = exerted["moment"] + arm[:, 0] * force[:, 1] - arm[:, 1] * force[:, 0]
                    unbalanced[:, body] -= sign * np.column_stack([force, moment])
        if not np.abs(unbalanced).max() <= 1e-8 * max(1.0, float(np.abs(required).max())):
            return f"forces in the joints of {which[0]} do not balance the inertia of its links"
    return None


def check_judge() -> str | None:
    """Check that the judge accepts a correct motion and rejects each of several invalid ones; return the first fault or None."""
    mechanism, reference = load(*FOUR_BAR), truth(FOUR_BAR)
    evaluator, sound = Evaluator(mechanism), reference.samples
    turned = sound.q.copy()
    angles(turned)[...] += 0.2

    def verdict(x: Trajectory, acceleration_error: float = 0.0) -> judging.Judgement:
        """Judge a motion, given the median relative error of the engine's accelerations at known states."""
        return judging.judge(judging.examine(evaluator, x, reference, acceleration_error))

    if not verdict(sound).valid:
        return f"the judge objects to the certified motion: {verdict(sound).sentence}"
    spoilt = {
        judging.Subject.LOOPS: verdict(shift(sound, "q", SIZE, 0.05 * mechanism.size)),
        judging.Subject.MOTION: verdict(replace(sound, q=turned)),
        judging.Subject.ENERGY: verdict(replace(sound, v=1.1 * sound.v)),
        judging.Subject.MODEL: verdict(sound, 0.05),
        judging.Subject.COMPLETENESS: judging.completeness(replace(sound, t=sound.t + 1e-6), sound.t, mechanism.n),
        judging.Subject.NUMBERS: judging.completeness(replace(sound, v=sound.v * np.nan), sound.t, mechanism.n),
    }
    for subject, judgement in spoilt.items():
        if subject not in [x.subject for x in judgement.objections]:
            return f"the judge does not object to {subject}"
    short = judging.completeness(replace(sound, q=sound.q[:, :-1]), sound.t, mechanism.n)
    return "the judge accepts a state without its last coordinate" if short.valid else None


def check_run() -> str | None:
    """Check a run by `one_run`: its sample times, number of steps and acceleration error; return the first fault or None."""
    mechanism = load(*FOUR_BAR)
    wanted = one_run.sampling(1e-2, 0.1, [0.05])
    run = one_run.one_run(Interpreted("gauss"), mechanism, Choice(integrator="rk4", step=1e-2), wanted)
    if (
        wanted.count != 10
        or run.trajectory is None
        or run.trajectory.steps != 10
        or not np.array_equal(run.trajectory.t, wanted.times)
    ):
        return "a run of 0.1 s by steps of 0.01 s is not ten steps"
    error = one_run.acceleration_error(mechanism, run.trajectory)
    if error is None or error > AGREES:
        return "a sound engine has wrong accelerations"
    wrong = one_run.acceleration_error(mechanism, replace(run.trajectory, a=1.05 * run.trajectory.a))
    if wrong is None or off(wrong, 0.05, 1e-6):
        return "accelerations that are 5 % too large have another error"
    late = one_run.sampling(3e-3, 0.1)
    if not late.shortened or off(late.times[-1], 0.1, 1e-12):
        return "a run whose end is no multiple of the step ends elsewhere"
    return None if describe("gauss").usable else "an engine of the suite cannot be used"


# references


def check_certificate(
    which: tuple[str, str] = FOUR_BAR, nudge: Mapping[str, float] | None = None, alter: Mapping[str, Any] | None = None
) -> str | None:
    """Check the first samples of a certificate (a reference motion with guaranteed digits) against the equations of a linkage.

    Return None if the samples satisfy the equations, and otherwise a sentence with the errors.

    Args:
        which: linkage and scenario of the certificate.
        nudge: planted error of the samples. "q", "v", "a" or "multipliers" -> number that is added to the largest entry of the
            middle sample of this array; "late" -> delay of all samples [s].
        alter: arguments by which the function `alter` changes the linkage whose equations are used; None for the true linkage.
    """
    mechanism = load(*which)
    path = certificate_path(mechanism)
    assert path is not None
    whole = read_certificate(path)
    x = replace(whole, **{name: getattr(whole, name)[:FIRST_SAMPLES] for name in ARRAYS})
    for level, by in (nudge or {}).items():
        if level == "late":
            x = replace(x, q=x.q + by * x.v + by**2 / 2 * x.a, v=x.v + by * x.a)
        else:
            values = getattr(x, level).copy()
            at = len(values) // 2
            values[at, int(np.abs(values[at]).argmax())] += by
            x = replace(x, **{level: values})
    verification = verify(x, change(mechanism, alter))
    if verification.passed:
        return None
    errors = f"states {verification.state_error:.1e}, balance {verification.balance_error:.1e}"
    return f"the certificate of {which[0]} does not hold: {errors}"


# clock


@contextmanager
def ticking() -> Iterator[Callable[[float], None]]:
    """Replace the processor's clock by an artificial one; the yielded function advances it by seconds."""
    now = [0]  # [ns]

    def spend(seconds: float) -> None:
        """Advance the clock."""
        now[0] += round(seconds * 1e9)

    with patch.multiple(time, process_time_ns=lambda: now[0], process_time=lambda: now[0] * 1e-9):
        yield spend


def check_clocks() -> str | None:
    """Check the measurement of times with an artificial clock, and the ratios of known times; return the first fault or None."""
    with ticking() as spend:
        if off(one_run.measure_seconds(lambda: spend(1.0)), 1.0, 1e-9):
            return "a second is measured as another time"
        # preparation, 5 s, must not be timed; 500 steps in 0.5 s, done twice, are 1 ms each
        block = blocks.Block("steps", ready=lambda: spend(5.0), go=lambda: spend(0.5), count=500, again=2)
        if off(block.seconds(), 1e-3, 1e-9):
            return "a thousand steps in a second take another time than a millisecond each"
        # a block repeats a short call until it lasts some milliseconds; each call counts as `work` repetitions
        for duration, work in ((1e-7, 1), (3e-5, 40)):
            repeated = blocks.lasting("call", lambda duration=duration: spend(duration), work)  # type: ignore[misc]
            whole = one_run.measure_seconds(repeated.go)
            if off(whole / repeated.count / duration * work, 1.0, 1e-6) or not 1e-3 <= whole <= 5e-3:
                return "the time of a call is wrong, or its block is too short"
        # four entries in eight rounds: each takes its turn in every round, in changing order, without the garbage collector
        turns = [blocks.Block(name, lambda: None, lambda: spend(0.2 if gc.isenabled() else 0.01), 1) for name in "abcd"]
        timed = [(block.entry, number, seconds) for block, number, seconds in clock.interleave(turns, 8)]
        orders = {tuple(entry for entry, number, _ in timed if number == k) for k in range(8)}
        if len(orders) < 3 or any(sorted(map(str, x)) != list("abcd") for x in orders):
            return "blocks do not take turns in changing order"
        if any(off(seconds, 0.01, 1e-9) for _, _, seconds in timed):
            return "the garbage collector works while it is timed"
    # a ratio compares the lower quartiles: 2 and 0.5
    samples = np.array([4.0, 1.0, 3.0, 2.0, 5.0])
    if off(clock.ratio(samples, np.full(5, 0.5))[0], 4.0, 1e-12):
        return "a ratio is not that of the lower quartiles"
    # a delay that slows both entries in the same rounds leaves their ratio unchanged
    wandering = np.random.default_rng(3).uniform(1.0, 2.0, 40)
    if max(abs(x - 3.0) for x in clock.ratio(3.0 * wandering, wandering)) > 1e-12:
        return "a delay of both entries in one round counts as spread"
    # `ratio` returns the ratio and its spread, low to high, which is to hold nine tenths of the distribution of the ratio
    n = 4000
    _, low, high = clock.ratio(np.random.default_rng(5).uniform(0.0, 1.0, n) + 1.0, np.ones(n))
    # The lower quartile of n uniform numbers is nearly normal with variance p (1 - p) / n, p = 1/4; nine tenths of a normal
    # distribution lie within 1.645 standard deviations of its mean.
    expected = 2 * 1.645 * math.sqrt(3 / 16 / n)
    return "a spread does not hold nine tenths" if off((high - low) / expected, 1.0, 0.3) else None


# gate


def check_gate() -> str | None:
    """Check the gate, the regression test that compares figures with a stored baseline; return the first fault or None.

    The gate must accept unchanged figures, and reject each of several changed ones. Each figure has a tolerance of its own, and
    the changed figures lie just inside or just outside this tolerance. A figure that became much better must be rejected too.
    """
    base: Figures = {"status": "ok", "valid": "True", "position_error": 1e-6, "position_drift": 1e-9}
    base |= {"observed_order": 4.0, "measured_t1": 12.0, "acceleration_error_median": 1e-10}
    if said := ask_gate(base, base):
        return f"the gate rejects unchanged figures: {said}"
    # inside the tolerances: an error less than twice as large, an order less than 0.2 lower, a reference value changed by rounding
    near: Figures = base | {"position_error": 1.5e-6, "observed_order": 3.9, "measured_t1": 12.0 + 1e-10}
    if said := ask_gate(near, base):
        return f"the gate rejects differences between machines: {said}"
    # outside the tolerances; the drift is a hundred times smaller than before, which may come from a fault of the metric
    wrong: Figures = {"position_error": 2.1e-6, "position_drift": 1e-11, "observed_order": 3.7}
    wrong |= {"measured_t1": 12.0 + 1e-7, "status": "nan", "valid": "False", "acceleration_error_median": math.nan}
    for key, value in wrong.items():
        if not ask_gate(base | {key: value}, base):
            return f"the gate accepts {key} = {value}, which was {base[key]}"
        missing = {k: x for k, x in base.items() if k != key}
        # an order may be missing, as of a run whose errors are rounding; a status never is, since every run gets one
        if key not in ("observed_order", "status") and not ask_gate(missing, base):
            return f"the gate accepts that {key} is missing"
    floor = gate.RULES["acceleration_error_median"].floor  # errors up to it are rounding and may change freely
    if ask_gate({"acceleration_error_median": 0.9 * floor}, {"acceleration_error_median": floor / 100}):
        return "the gate rejects rounding"
    if not ask_gate({"acceleration_error_median": 1.5 * floor}, {"acceleration_error_median": floor / 100}):
        return "the gate accepts an error above rounding"
    # a floor that was raised by mistake would let errors pass
    return None if abs(floor - 1e-12) <= 1e-15 else "the gate's floor for accelerations has changed"
