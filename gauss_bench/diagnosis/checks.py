"""Check the suite itself with known answers: each check returns None if all is correct, or a sentence on the fault it detects.

Small linkages and short motions are used, so that all checks together take seconds. The gate (`bench/gate.py`) is the regression
test that compares figures, such as errors, with those of a stored baseline.
"""

import gc
import math
import time
from collections.abc import Callable, Generator, Iterator, Mapping
from contextlib import closing, contextmanager
from dataclasses import replace
from functools import cache, wraps
from typing import Any
from unittest.mock import patch

import numpy as np

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
from gauss_bench.tables import KEY, Row
from gauss_bench.terms import Array
from gauss_bench.trajectory import Reference, Samples, Trajectory

FOUR_BAR, CRANK_SLIDER, DRIVEN = ("four_bar", "torque"), ("crank_slider", "paper"), ("four_bar", "cycloid")
SHAPER = ("shaper", "torque")  # slides that carry moments
AGREES = 1e-10  # relative tolerance; formulations agree to about 1e-13
FIRST_SAMPLES = 5  # number of samples of a certificate that are verified, which are enough to detect a fault
MOVED = 1e-3  # [m] known displacement of a link
ORDERS = {"rk4": 4, "semi_implicit_euler": 1, "dop853_fixed": 8, "gauss_legendre": 6}
Figures = dict[str, float | str]
Findings = Generator[tuple[bool | np.bool_, str], None, None]  # (whether a fault shows, sentence on this fault)


def check(findings: Callable[[], Findings]) -> Callable[[], str | None]:
    """Turn a function that yields findings into a check, which returns the sentence of the first fault that shows, or None."""

    @wraps(findings)
    def first_fault() -> str | None:
        with closing(findings()) as found:  # exits the contexts inside a generator that is not run to its end
            return next((sentence for is_wrong, sentence in found if is_wrong), None)

    return first_fault


def alter(
    mechanism: Mechanism, of: str = "", gravity: float = 1.0, joint: str = "", by: float = 0.0, **factors: float
) -> Mechanism:
    """Return an altered linkage.

    Args:
        of: name of the link or force whose attributes are multiplied; "" for none.
        gravity: factor by which gravity is multiplied.
        joint: name of the pin that is displaced; "" for none.
        by: displacement [m] of this pin in the direction x of the frame of its second link.
        factors: attribute of the link or force `of` -> factor by which the attribute is multiplied.
    """

    def scale(x: Any) -> Any:
        return replace(x, **{key: getattr(x, key) * factor for key, factor in factors.items()}) if x.name == of else x

    def displace(x: Any) -> Any:
        return replace(x, b=replace(x.b, local=x.b.local + np.array([by, 0.0]))) if x.name == joint else x

    links, forces, joints = map(scale, mechanism.links), map(scale, mechanism.forces), map(displace, mechanism.joints)
    scaled_gravity = gravity * np.asarray(mechanism.gravity)
    return replace(mechanism, links=tuple(links), forces=tuple(forces), joints=tuple(joints), gravity=scaled_gravity)


change = alter  # the function `alter` where an argument `alter` hides this name


@cache
def states(which: tuple[str, str]) -> Samples:
    """Return 16 random states of a linkage, with their true accelerations; `which` has the names of linkage and scenario."""
    return random_states(load(*which), count=16)


@cache
def truth(which: tuple[str, str], until: float = 0.5) -> Reference:
    """Return the certified motion of a linkage in a scenario up to `until` [s]."""
    path = certificate_path(load(*which))
    assert path is not None
    return as_reference(read_certificate(path), until)


def shift(x: Trajectory, level: str, column: int, by: float) -> Trajectory:
    """Return a trajectory with the number `by` added to the coordinate `column` of its array `level`: "q", "v" or "a"."""
    return replace(x, **{level: getattr(x, level) + by * np.eye(x.q.shape[1])[column]})


def delay(x: Any, late: float) -> Any:
    """Return a motion with the states at the times t + late [s], by Taylor's series to second order."""
    return replace(x, q=x.q + late * x.v + late**2 / 2 * x.a, v=x.v + late * x.a)


def differs(figure: Any, expected: float, tolerance: float) -> bool:
    """Tell whether a number, or the largest of several, differs from its expected value by more than the tolerance; NaN differs.

    The tolerance is relative if the magnitude of the expected value is larger than 1, and absolute otherwise.
    """
    return not abs(float(np.max(figure)) - expected) <= tolerance * max(1.0, abs(expected))


def ask_gate(figures: Figures, baseline: Figures) -> str | None:
    """Return the gate's first message on the figures of one invented case, or None if the gate accepts all of them."""
    # any values for the columns that identify a case; they are the same in both tables
    key = dict(zip(KEY, ("linkage", "scenario", "engine", "default", "rk4", "none", 1e-3, 1.0), strict=True))

    def rows_of(case: Figures) -> list[Row]:
        """Return a row for each figure, with numbers as texts, as in the stored baseline."""
        return [key | {"metric": k, "value": x if isinstance(x, str) else f"{x:.15g}"} for k, x in case.items()]

    return next(map(str, gate.failures(gate.compare(rows_of(figures), rows_of(baseline)))), None)


# models


def check_model(which: tuple[str, str] = FOUR_BAR, alter: Mapping[str, Any] | None = None) -> str | None:
    """Return the message with which the gate rejects accelerations of the engine `gauss` on an altered linkage, else None.

    `alter` has the arguments of the function `alter`; None stands for the true linkage.
    """

    def measure_error(modelled: Mechanism) -> Figures:
        """Return the median relative error of the accelerations if the engine models `modelled`."""
        # x: states of the unaltered linkage, with its true accelerations x.a
        x, engine = states(which), Interpreted("gauss").build(modelled, Choice(integrator="rk4"))
        accelerations = np.array([engine.acceleration(float(t), q, v) for t, q, v in zip(x.t, x.q, x.v, strict=True)])
        return {"acceleration_error_median": float(np.median(metrics.relative_acceleration_error(accelerations, x.a)))}

    unaltered = load(*which)
    return ask_gate(measure_error(change(unaltered, **alter or {})), measure_error(unaltered))


def check_sample_times(late: float) -> str | None:
    """Return the message with which the accuracy gate rejects a correct motion that is sampled `late` [s] too late, else None."""
    reference = truth(FOUR_BAR)
    correct = reference.samples

    def measure_errors(x: Trajectory) -> Figures:
        errors = metrics.state_errors(load(*FOUR_BAR), x, reference)
        return {"position_error": float(errors.position.max()), "velocity_error": float(errors.velocity.max())}

    return ask_gate(measure_errors(delay(correct, late)), measure_errors(correct))


# formulations and integrators


@check
def check_formulations() -> Findings:
    """Check accelerations, multipliers and rank of every formulation at known states."""
    for which in (FOUR_BAR, CRANK_SLIDER):
        x, evaluator = states(which), Evaluator(load(*which))
        for name, solve in FORMULATIONS.items():
            if name == "yuan_ge_eq16":  # the formula as printed is known to be wrong
                continue
            for k in range(4):
                terms = evaluator.terms(0.0, x.q[k], x.v[k])
                solution = solve(terms)
                scale = float(np.abs(x.a[k]).max())
                error = np.abs(solution.a - x.a[k]).max()
                yield not error <= AGREES * scale, f"{name}: accelerations are not those of {which[0]}"
                if solution.multipliers is not None:
                    residual = np.abs(terms.M @ solution.a + terms.J.T @ solution.multipliers - terms.Q).max()
                    allowed = AGREES * max(1.0, float(np.abs(terms.Q).max()), scale)
                    yield not residual <= allowed, f"{name}: multipliers do not balance the forces"
                rank, rows = solution.rank, len(terms.J)
                yield rank != rows, f"{name}: rank {rank} of {rows} independent rows"


@check
def check_integrators() -> Findings:
    """Check the order of convergence of every integrator with q'' = -q, whose solution is q = cos t."""

    def error_of(step: Callable[..., tuple[Array, Array]], count: int) -> float:
        """Return the error of (q, v) at t = 1 s after `count` equal steps from q = 1, v = 0; step(f, t, q, v, h) -> (q, v)."""
        q, v, h = np.array([1.0]), np.array([0.0]), 1.0 / count
        for k in range(count):
            q, v = step(lambda t, q, v: -q, k * h, q, v, h)
        return float(np.hypot(q[0] - math.cos(1.0), v[0] + math.sin(1.0)))

    for name, order in ORDERS.items():
        count = 3 if order > 4 else 20  # more steps of a high order would only show rounding
        coarse, fine = (max(error_of(fixed_step.STEPS[name], n), 1e-300) for n in (count, 2 * count))
        observed = math.log2(coarse / fine)
        yield differs(observed, order, 0.1), f"{name} converges by order {observed:.2f}, not {order}"


@check
def check_stabilizations() -> Findings:
    """Check Baumgarte's terms and the projection at a state that violates its constraints."""
    evaluator, x, rate = Evaluator(load(*FOUR_BAR)), states(FOUR_BAR), BAUMGARTE_RATE
    q = x.q[0].copy()
    q[0] += MOVED
    terms = evaluator.terms(0.0, q, x.v[0] + MOVED)
    expected = -2 * rate * terms.phi_dot - rate**2 * terms.phi  # Baumgarte's change of gamma
    error = np.abs(algebra.baumgarte(terms, rate, rate).gamma - terms.gamma - expected).max()
    yield error > AGREES * np.abs(expected).max(), "Baumgarte's terms do not lead back to the constraints"
    projected_q, projected_v = evaluator.project(0.0, q, x.v[0])
    rows = evaluator.constraints(0.0, projected_q, projected_v)
    is_off = np.abs(rows.phi).max() > 1e-12 or np.abs(rows.J @ projected_v).max() > 1e-10
    yield is_off, "projection does not lead back to the constraints"


# metrics and judge


@check
def check_metrics() -> Findings:
    """Check that the metrics of motions with planted errors have the known sizes of these errors."""
    mechanism, reference = load(*FOUR_BAR), truth(FOUR_BAR)
    evaluator, sound = Evaluator(mechanism), reference.samples  # `sound`: the correct motion
    x, y = SIZE, SIZE + 1  # columns of the second link's centre of mass
    for column in (x, y):
        moved = shift(sound, "q", column, MOVED)
        errors = metrics.state_errors(mechanism, moved, reference)
        gaps = metrics.drift(evaluator, moved).position, errors.length, errors.position
        wrong = any(differs(gap, MOVED, 1e-6) for gap in gaps)
        yield wrong, f"a link is moved by {MOVED:g} m, and its gap or error has another size"
    faster = shift(sound, "v", y, MOVED)
    drift, error = metrics.drift(evaluator, faster).velocity, metrics.state_errors(mechanism, faster, reference).velocity
    wrong = differs(drift, MOVED, 1e-6) or differs(error, MOVED, 1e-6)
    yield wrong, f"a velocity is wrong by {MOVED:g} m/s, and its drift or error has another size"
    residual = metrics.drift(evaluator, shift(sound, "a", y, 1.0)).acceleration
    yield differs(residual, 1.0, 1e-6), "accelerations that violate the constraints have a wrong residual"
    (gained, work_bar), scale = metrics.energy_error(evaluator, sound), metrics.energy_scale(evaluator, sound)
    yield not np.abs(gained).max() <= work_bar + 1e-6 * scale, "a true motion gains energy"
    gained = metrics.energy_error(evaluator, replace(sound, v=1.1 * sound.v))[0]
    yield not gained.max() > 0.1 * scale, "a motion with velocities 10 % too large gains no energy"
    error = metrics.relative_acceleration_error(1.01 * sound.a, sound.a)
    yield differs(error, 0.01, 1e-9), "accelerations that are 1 % too large have an error other than 1 %"
    steps, rounding = np.array([4e-3, 2e-3, 1e-3]), np.full(3, 1e-12)
    order = metrics.observed_order(steps, steps**3, np.zeros(3))[1]
    yield differs(order, 3.0, 1e-9), "an error proportional to the third power of the step has an order other than three"
    # errors as large as the error bar are rounding, from which no order can be computed
    yield np.isfinite(metrics.observed_order(steps, rounding, rounding)[1]), "an order is computed from rounding errors"


@check
def check_joint_forces() -> Findings:
    """Check that the joint forces and applied forces on each link balance its inertia (Newton's laws)."""
    for which in (FOUR_BAR, CRANK_SLIDER, SHAPER):
        mechanism, reference = load(*which), truth(which)
        evaluator = Evaluator(mechanism)
        by_joint = metrics.joint_forces(evaluator, reference.samples)  # force of the first link of a joint on its second link
        required = reference.a * evaluator.mass - evaluator.applied.generalised(reference.q, reference.v)  # M a - Q (k, n)
        unbalanced = bodies(required).copy()  # (k, links, 3): force that the joints must exert, minus their force
        for joint in mechanism.joints:
            (first, second), exerted = joint.ends, by_joint[joint.name]
            force, place = np.stack([exerted["fx"], exerted["fy"]], axis=1), position(reference.q, second)
            for body, sign in ((first.link, -1.0), (second.link, 1.0)):
                if body >= 0:  # not the ground
                    arm = place - places(reference.q)[:, body]  # from the centre of mass to the joint
                    moment = exerted["moment"] + arm[:, 0] * force[:, 1] - arm[:, 1] * force[:, 0]
                    unbalanced[:, body] -= sign * np.column_stack([force, moment])
        balanced = np.abs(unbalanced).max() <= 1e-8 * max(1.0, float(np.abs(required).max()))
        yield not balanced, f"forces in the joints of {which[0]} do not balance the inertia of its links"


@check
def check_judge() -> Findings:
    """Check that the judge accepts a correct motion and rejects each of several invalid ones."""
    mechanism, reference = load(*FOUR_BAR), truth(FOUR_BAR)
    evaluator, sound = Evaluator(mechanism), reference.samples
    turned = sound.q.copy()
    angles(turned)[...] += 0.2

    def judge_motion(x: Trajectory, acceleration_error: float = 0.0) -> judging.Judgement:
        """Judge a motion, given the median relative error of the engine's accelerations at known states."""
        return judging.judge(judging.examine(evaluator, x, reference, acceleration_error))

    accepted = judge_motion(sound)
    yield not accepted.valid, f"the judge objects to the certified motion: {accepted.sentence}"
    spoilt = {
        judging.Subject.LOOPS: judge_motion(shift(sound, "q", SIZE, 0.05 * mechanism.size)),
        judging.Subject.MOTION: judge_motion(replace(sound, q=turned)),
        judging.Subject.ENERGY: judge_motion(replace(sound, v=1.1 * sound.v)),
        judging.Subject.MODEL: judge_motion(sound, 0.05),
        judging.Subject.COMPLETENESS: judging.completeness(replace(sound, t=sound.t + 1e-6), sound.t, mechanism.n),
        judging.Subject.NUMBERS: judging.completeness(replace(sound, v=sound.v * np.nan), sound.t, mechanism.n),
    }
    for subject, judgement in spoilt.items():
        yield subject not in [x.subject for x in judgement.objections], f"the judge does not object to {subject}"
    short = judging.completeness(replace(sound, q=sound.q[:, :-1]), sound.t, mechanism.n)
    yield short.valid, "the judge accepts a state without its last coordinate"


@check
def check_run() -> Findings:
    """Check a run by `one_run`: its sample times, number of steps and acceleration error."""
    mechanism = load(*FOUR_BAR)
    sampling = one_run.sampling(1e-2, 0.1, [0.05])
    x = one_run.one_run(Interpreted("gauss"), mechanism, Choice(integrator="rk4", step=1e-2), sampling).trajectory
    if x is None or sampling.count != 10 or x.steps != 10 or not np.array_equal(x.t, sampling.times):
        yield True, "a run of 0.1 s by steps of 0.01 s does not take ten"
        return
    error, wrong = (one_run.acceleration_error(mechanism, replace(x, a=factor * x.a)) for factor in (1.0, 1.05))
    yield error is None or error > AGREES, "a sound engine has wrong accelerations"
    yield wrong is None or differs(wrong, 0.05, 1e-6), "accelerations that are 5 % too large have an error other than 5 %"
    uneven = one_run.sampling(3e-3, 0.1)  # 0.1 s is no multiple of 3 ms, so that the last step is shortened
    ends_elsewhere = not uneven.shortened or differs(uneven.times[-1], 0.1, 1e-12)
    yield ends_elsewhere, "a run whose end is no multiple of the step ends at another time"
    yield not describe("gauss").usable, "an engine of the suite cannot be used"


# references


def check_certificate(
    which: tuple[str, str] = FOUR_BAR, nudge: Mapping[str, float] | None = None, alter: Mapping[str, Any] | None = None
) -> str | None:
    """Check the first samples of a certificate (a reference motion with guaranteed digits) against the equations of a linkage.

    Return None if the samples satisfy the equations, and otherwise a sentence with the errors.

    Args:
        nudge: planted error of the samples. "q", "v", "a" or "multipliers" -> number that is added to the largest entry of the
            middle sample of this array; "late" -> delay of all samples [s].
        alter: arguments by which the function `alter` changes the linkage whose equations are used; None for the true linkage.
    """
    mechanism = load(*which)
    path = certificate_path(mechanism)
    assert path is not None
    certificate = read_certificate(path)
    x = replace(certificate, **{name: getattr(certificate, name)[:FIRST_SAMPLES] for name in ARRAYS})
    for level, by in (nudge or {}).items():
        if level == "late":
            x = delay(x, by)
        else:
            values = getattr(x, level).copy()
            middle = len(values) // 2
            values[middle, int(np.abs(values[middle]).argmax())] += by
            x = replace(x, **{level: values})
    verification = verify(x, change(mechanism, **alter or {}))
    if verification.passed:
        return None
    errors = f"states {verification.state_error:.1e}, balance {verification.balance_error:.1e}"
    return f"the certificate of {which[0]} does not hold: {errors}"


# clock


@contextmanager
def ticking() -> Iterator[Callable[[float], None]]:
    """Replace the processor's clock by an artificial clock, which the yielded function advances by seconds."""
    now = [0]  # [ns]

    def spend(seconds: float) -> None:
        now[0] += round(seconds * 1e9)

    with patch.multiple(time, process_time_ns=lambda: now[0], process_time=lambda: now[0] * 1e-9):
        yield spend


@check
def check_clocks() -> Findings:
    """Check the measurement of times with an artificial clock, and the ratios of known times."""
    with ticking() as spend:
        second = one_run.measure_seconds(lambda: spend(1.0))
        yield differs(second, 1.0, 1e-9), "a second is not measured as a second"
        # preparation, 5 s, must not be timed; 500 steps in 0.5 s, done twice, are 1 ms each
        block = blocks.Block("steps", ready=lambda: spend(5.0), go=lambda: spend(0.5), count=500, calls=2)
        yield differs(block.seconds(), 1e-3, 1e-9), "a step of a millisecond is not measured as a millisecond"
        # a block repeats a short call until the block lasts some milliseconds; each call counts as `work` repetitions
        for duration, work in ((1e-7, 1), (3e-5, 40)):
            repeated = blocks.calls_block("call", lambda duration=duration: spend(duration), work)  # type: ignore[misc]
            seconds = one_run.measure_seconds(repeated.go)
            wrong = differs(seconds / repeated.count / duration * work, 1.0, 1e-6) or not 1e-3 <= seconds <= 5e-3
            yield wrong, "the time of a call is wrong, or its block is too short"
        # four entries in eight rounds: each takes its turn in every round, in changing order, without the garbage collector
        turns = [blocks.Block(name, lambda: None, lambda: spend(0.2 if gc.isenabled() else 0.01), 1) for name in "abcd"]
        timed = [(block.entry, number, seconds) for block, number, seconds in clock.interleave(turns, 8)]
        orders = {tuple(entry for entry, number, _ in timed if number == k) for k in range(8)}
        wrong = len(orders) < 3 or any(sorted(map(str, x)) != list("abcd") for x in orders)
        yield wrong, "blocks do not take turns in changing order"
        yield any(differs(seconds, 0.01, 1e-9) for _, _, seconds in timed), "the garbage collector runs during timing"
    # a ratio compares the lower quartiles: 2 and 0.5
    quartiles = clock.ratio(np.array([4.0, 1.0, 3.0, 2.0, 5.0]), np.full(5, 0.5))[0]
    yield differs(quartiles, 4.0, 1e-12), "a ratio is not that of the lower quartiles"
    # a delay that slows both entries in the same rounds leaves their ratio unchanged
    wandering = np.random.default_rng(3).uniform(1.0, 2.0, 40)
    spread = max(abs(x - 3.0) for x in clock.ratio(3.0 * wandering, wandering))
    yield spread > 1e-12, "a delay of both entries in one round counts as spread"
    # `ratio` returns the ratio and its spread, an interval that must contain nine tenths of the distribution of the ratio
    n = 4000
    _, low, high = clock.ratio(np.random.default_rng(5).uniform(0.0, 1.0, n) + 1.0, np.ones(n))
    # The lower quartile of n uniform numbers is nearly normal with variance p (1 - p) / n, p = 1/4; nine tenths of a normal
    # distribution lie within 1.645 standard deviations of its mean.
    expected = 2 * 1.645 * math.sqrt(3 / 16 / n)
    yield differs((high - low) / expected, 1.0, 0.3), "a spread does not contain nine tenths of the ratios"


# gate


@check
def check_gate() -> Findings:
    """Check the gate, the regression test that compares figures with a stored baseline.

    The gate must accept unchanged figures, and reject figures just outside their tolerances, also much better ones.
    """
    base: Figures = {"status": "ok", "valid": "True", "position_error": 1e-6, "position_drift": 1e-9}
    base |= {"observed_order": 4.0, "measured_t1": 12.0, "acceleration_error_median": 1e-10}
    message = ask_gate(base, base)
    yield message is not None, f"the gate rejects unchanged figures: {message}"
    # inside the tolerances: an error less than twice as large, an order less than 0.2 lower, a reference value changed by rounding
    message = ask_gate(base | {"position_error": 1.5e-6, "observed_order": 3.9, "measured_t1": 12.0 + 1e-10}, base)
    yield message is not None, f"the gate rejects differences between machines: {message}"
    # outside the tolerances; the drift is a hundred times smaller than before, which may come from a fault of the metric
    wrong: Figures = {"position_error": 2.1e-6, "position_drift": 1e-11, "observed_order": 3.7}
    wrong |= {"measured_t1": 12.0 + 1e-7, "status": "nan", "valid": "False", "acceleration_error_median": math.nan}
    for key, value in wrong.items():
        yield not ask_gate(base | {key: value}, base), f"the gate accepts {key} = {value}, which was {base[key]}"
        # an order may be missing, for example if all errors are rounding; every run has a status, which cannot be missing
        if key not in ("observed_order", "status"):
            missing = {k: x for k, x in base.items() if k != key}
            yield not ask_gate(missing, base), f"the gate accepts that {key} is missing"
    floor = gate.RULES["acceleration_error_median"].floor  # errors up to the floor are rounding and may change

    def rejects(factor: float) -> bool:
        """Tell whether the gate rejects an error that grows from 1 % of the floor to `factor` times the floor."""
        return ask_gate({"acceleration_error_median": factor * floor}, {"acceleration_error_median": floor / 100}) is not None

    yield rejects(0.9), "the gate rejects rounding"
    yield not rejects(1.5), "the gate accepts an error above rounding"
    # a floor that was raised by mistake would let errors pass
    yield not abs(floor - 1e-12) <= 1e-15, "the gate's floor for accelerations has changed"
