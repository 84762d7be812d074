"""Faults planted in the suite itself, in memory: each spoils one function, limit or number while the check that must see it runs.

No file is touched, and what is spoilt is put back. A fault is data: where it is, what is put there, which check must speak.
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from gauss_bench import judge, metrics
from gauss_bench.bench import clock, gate
from gauss_bench.diagnosis import checks
from gauss_bench.diagnosis.checks import CRANK_SLIDER, FOUR_BAR, Alteration
from gauss_bench.diagnosis.faults import force_scaled, gravity_turned, same, scale
from gauss_bench.formulations import FORMULATIONS
from gauss_bench.integrate import fixed_step, stabilization
from gauss_bench.mechanism.evaluate import Evaluator
from gauss_bench.mechanism.model import Mechanism, Revolute
from gauss_bench.reference.certificate import Certificate
from gauss_bench.runs import one_run

Check = Callable[[], str | None]


@dataclass(frozen=True)
class Planted:
    """One fault and the check that must see it.

    Attributes:
        kind: what it is planted in: models, formulations, metrics, references, clocks or gate.
        sentence: what is wrong.
        sound: the check without the fault, which must be silent; check: the same with it, which must speak.
    """

    kind: str
    sentence: str
    sound: Check
    check: Check


@contextmanager
def patch(owner: Any, name: str, made: Callable[[Any], Any]) -> Iterator[None]:
    """Let an attribute, or an entry of a dictionary, be what `made` makes of it."""
    there = isinstance(owner, dict)
    true = owner[name] if there else owner.__dict__[name] if isinstance(owner, type) else getattr(owner, name)

    def put(value: Any) -> None:
        if there:
            owner[name] = value
        else:
            setattr(owner, name, value)

    put(made(true))
    try:
        yield
    finally:
        put(true)


def spoilt(owner: Any, name: str, made: Callable[[Any], Any], check: Check) -> Check:
    def checked() -> str | None:
        with patch(owner, name, made):
            return check()

    return checked


def fault(kind: str, sentence: str, owner: Any, name: str, made: Callable[[Any], Any], check: Check) -> Planted:
    return Planted(kind, sentence, check, spoilt(owner, name, made, check))


def constant(value: Any) -> Callable[[Any], Any]:
    """A function that returns this value whatever it is given."""
    return lambda _: value


def scale_result(factor: float) -> Callable[[Any], Any]:
    return lambda f: lambda *a, **k: factor * f(*a, **k)


def of_solution(**changes: Callable[[Any], Any]) -> Callable[[Any], Any]:
    """A formulation whose solution is spoilt."""
    return lambda f: lambda terms: (lambda x: replace(x, **{k: c(getattr(x, k)) for k, c in changes.items()}))(f(terms))


def of_terms(**changes: Callable[[Any], Any]) -> Callable[[Any], Any]:
    """A formulation that is given spoilt terms."""
    return lambda f: lambda terms: f(replace(terms, **{k: c(getattr(terms, k)) for k, c in changes.items()}))


def of_fields(**changes: Callable[[Any], Any]) -> Callable[[Any], Any]:
    """A function whose result has spoilt fields."""
    return lambda f: lambda *a, **o: (lambda x: replace(x, **{k: c(getattr(x, k)) for k, c in changes.items()}))(f(*a, **o))


# models


def com_moved(mechanism: Mechanism) -> Mechanism:
    """The coupler's pins 1 um further along it."""
    return longer("coupler", 1e-6, mechanism)


def longer(name: str, by: float, mechanism: Mechanism) -> Mechanism:
    """A pin of a link `by` [m] further out along the link, in the joints alone."""
    joints: list[Any] = []
    at = next(k for k, link in enumerate(mechanism.links) if link.name == name)
    for joint in mechanism.joints:
        if isinstance(joint, Revolute) and joint.b.link == at:
            joint = replace(joint, b=replace(joint.b, local=joint.b.local + np.array([by, 0.0])))
        joints.append(joint)
    return replace(mechanism, joints=tuple(joints))


def model(sentence: str, alter: Alteration, which: tuple[str, str] = FOUR_BAR) -> Planted:
    return Planted("models", sentence, partial(checks.model, which, same), partial(checks.model, which, alter))


MODELS = (
    model("the crank's inertia is a millionth too large", scale("crank", inertia=1 + 1e-6)),
    model("the coupler's mass is a millionth too large", scale("coupler", mass=1 + 1e-6)),
    model("the rod's inertia is 1 % too small", scale("rod", inertia=0.99), CRANK_SLIDER),
    model("gravity has the wrong sign", gravity_turned),
    model("a damper is a millionth too strong", force_scaled("brake", "c", 1 + 1e-6)),
    model("a spring is a millionth too stiff", force_scaled("spring", "k", 1 + 1e-6), CRANK_SLIDER),
    model("a spring rests a millionth too far out", force_scaled("spring", "rest", 1 + 1e-6), CRANK_SLIDER),
    model("a torque has the wrong sign", force_scaled("motor", "value", -1.0)),
    model("the coupler is a micrometre longer", com_moved),
)

# formulations and integrators


def formula(name: str, sentence: str, made: Callable[[Any], Any]) -> Planted:
    return fault("formulations", f"{name}: {sentence}", FORMULATIONS, name, made, checks.formulations)


def without_half(step: Any) -> Any:
    """Runge and Kutta's last stage at the middle."""
    return lambda f, t, q, v, h: (lambda x, y: ((x[0] + y[0]) / 2, (x[1] + y[1]) / 2))(
        step(f, t, q, v, h), step(f, t, q, v, h * (1 + h))
    )


FORMULAS = (
    formula("gauss", "the bias of the constraints has the wrong sign", of_terms(gamma=np.negative)),
    formula("gauss", "velocity terms of the constraints are left out", of_terms(gamma=np.zeros_like)),
    formula("gauss_pinv", "applied forces are left out", of_terms(Q=np.zeros_like)),
    formula("lagrange", "multipliers have the wrong sign", of_solution(multipliers=np.negative)),
    formula("lagrange", "a row of the constraints is dropped", of_terms(J=lambda J: J[:-1], gamma=lambda g: g[:-1])),
    formula("schur", "the rank is one too small", of_solution(rank=lambda r: r - 1)),
    formula("udwadia_kalaba", "masses count as one", of_terms(M=lambda M: np.eye(len(M)))),
    formula("schur", "accelerations are 1e-9 too large", of_solution(a=lambda a: a * (1 + 1e-9))),
    fault("formulations", "Runge and Kutta's method loses its order", fixed_step.STEPS, "rk4", without_half, checks.integrators),
    fault(
        "formulations",
        "steps of Euler's method are those of Runge and Kutta",
        fixed_step.STEPS,
        "semi_implicit_euler",
        constant(fixed_step.rk4),
        checks.integrators,
    ),
    fault(
        "formulations",
        "Baumgarte's terms lead away from the constraints",
        stabilization,
        "baumgarte",
        lambda f: lambda x: f(x, -20.0),
        checks.stabilizations,
    ),
    fault(
        "formulations",
        "projection does nothing",
        Evaluator,
        "project",
        constant(lambda self, t, q, v: (q, v)),
        checks.stabilizations,
    ),
)

# metrics, judge and the recipe of a run


def measure(sentence: str, name: str, made: Callable[[Any], Any]) -> Planted:
    return fault("metrics", sentence, metrics, name, made, checks.measures)


def turn_moments(f: Any) -> Any:
    return lambda *a: {k: x | {"moment": -x["moment"]} for k, x in f(*a).items()}


def swap_forces(f: Any) -> Any:
    return lambda *a: {k: {"fx": -x["fy"], "fy": x["fx"], "moment": x["moment"]} for k, x in f(*a).items()}


METRICS = (
    measure("gaps count a tenth", "drift", of_fields(position=lambda x: 0.1 * x)),
    measure("drift of velocity is left out", "drift", of_fields(velocity=np.zeros_like)),
    measure("residuals of accelerations are left out", "drift", of_fields(acceleration=np.zeros_like)),
    measure("errors of places count a half", "state_errors", of_fields(length=lambda x: 0.5 * x)),
    measure("errors of velocities are left out", "state_errors", of_fields(velocity=np.zeros_like)),
    measure("energy is never gained", "energy_error", lambda f: lambda *a: (0 * f(*a)[0], f(*a)[1])),
    measure("accelerations are compared ten times too kindly", "relative_acceleration_error", scale_result(0.1)),
    measure("orders are told of rounding too", "observed_order", lambda f: lambda h, e, floor: f(h, e, 0 * floor)),
    measure("orders are one too high", "observed_order", lambda f: lambda *a: f(*a) + 1.0),
    measure("moments in slides have the wrong sign", "joint_forces", turn_moments),
    measure("forces in joints are turned by a quarter", "joint_forces", swap_forces),
    fault("metrics", "the work of dampers is gained", metrics, "_work", scale_result(-1.0), checks.measures),
    fault("metrics", "loops may open by the linkage's size", judge, "OFF_DRIFT", constant(1.0), checks.judge_case),
    fault("metrics", "the judge looks at no motion", judge, "OFF_MOTION", constant(np.inf), checks.judge_case),
    fault("metrics", "energy may be gained", judge, "OFF_ENERGY", constant(1e3), checks.judge_case),
    fault("metrics", "wrong accelerations are another's affair", judge, "OFF_ACCELERATION", constant(1.0), checks.judge_case),
    fault("metrics", "samples may be told for other times", judge, "OFF_TIME", constant(1.0), checks.judge_case),
    fault(
        "metrics", "what is no number is finite", judge, "completeness", constant(lambda *_: judge.Judgement()), checks.judge_case
    ),
    fault(
        "metrics",
        "a run's steps count twice",
        one_run,
        "step_counts",
        lambda f: lambda t, h: [(2 * n, x / 2) for n, x in f(t, h)],
        checks.recipe,
    ),
    fault(
        "metrics",
        "accelerations are held against themselves",
        one_run,
        "relative_acceleration_error",
        lambda f: lambda a, true: f(true, true),
        checks.recipe,
    ),
)

# references


def reference(
    sentence: str, made: Callable[[Certificate], Certificate] = same, alter: Alteration = same, which: tuple[str, str] = FOUR_BAR
) -> Planted:
    return Planted(
        "references",
        sentence,
        partial(checks.read_certified, which, same, same),
        partial(checks.read_certified, which, made, alter),
    )


def nudge(level: str, by: float) -> Callable[[Certificate], Certificate]:
    """One sample of a level, moved in its largest entry."""

    def made(x: Certificate) -> Certificate:
        values = getattr(x, level).copy()
        at = len(values) // 2
        values[at, int(np.abs(values[at]).argmax())] += by
        return replace(x, **{level: values})

    return made


def late_samples(x: Certificate) -> Certificate:
    """Every state told a microsecond late."""
    late = 1e-6
    return replace(x, q=x.q + late * x.v + late**2 / 2 * x.a, v=x.v + late * x.a)


REFERENCES = (
    reference("a position is 10 nanometres off", nudge("q", 1e-8)),
    reference("a velocity is off by 1e-7", nudge("v", 1e-7)),
    reference("an acceleration is off by 1e-6", nudge("a", 1e-6)),
    reference("a force in a joint is off by a micronewton", nudge("multipliers", 1e-6)),
    reference("all samples are a microsecond late", late_samples),
    reference("it was made for a crank a ten-millionth heavier", alter=scale("crank", mass=1 + 1e-7, inertia=1 + 1e-7)),
    reference("it was made for another gravity", alter=gravity_turned),
)

# clock


def timing(sentence: str, name: str, made: Callable[[Any], Any], owner: Any = clock) -> Planted:
    return fault("clocks", sentence, owner, name, made, checks.clocks)


def with_getting_ready(f: Any) -> Any:
    def seconds(self: Any) -> float:
        whole = sum(clock.measure_seconds(lambda: (self.ready(), self.go())) for _ in range(self.again))
        return float(whole / (self.count * self.again))

    return seconds


def of_medians(f: Any) -> Any:
    return lambda x, y: (float(np.median(x) / np.median(y)), *f(x, y)[1:])


def narrow(f: Any) -> Any:
    return lambda *a, **k: (lambda x, low, high: (x, x - (x - low) / 2, x + (high - x) / 2))(*f(*a, **k))


def in_one_order(f: Any) -> Any:
    return lambda blocks, rounds, *a, **k: ((b, n, b.seconds()) for n in range(rounds) for b in blocks)


class Wakeful:
    """A collector that is never at rest."""

    def __getattr__(self, name: str) -> Callable[[], None]:
        return lambda: None


CLOCKS = (
    timing("the clock runs ten times too slowly", "measure_seconds", scale_result(0.1)),
    timing("repetitions are not counted", "seconds", lambda f: lambda self: f(self) * self.count, clock.Block),
    timing("getting ready is timed too", "seconds", with_getting_ready, clock.Block),
    timing("a call's work is counted twice", "lasting", lambda f: lambda e, c, work=1: f(e, c, 2 * work)),
    timing("blocks are a hundred times too short", "BLOCK", constant(2e-5)),
    timing("ratios are those of medians", "ratio", of_medians),
    timing("spreads hold a half", "ratio", narrow),
    timing("blocks take turns in one order", "interleave", in_one_order),
    timing("the garbage collector works while it is timed", "gc", constant(Wakeful())),
)

# gate


def guard(sentence: str, name: str, made: Callable[[Any], Any], owner: Any = gate) -> Planted:
    return fault("gate", sentence, owner, name, made, checks.check_guard)


def lenient(f: Any) -> Any:
    """Figures that are no number pass."""
    return lambda case, metric, value, base, *rest: f(
        case, metric, base if value == "nan" and metric != "status" else value, base, *rest
    )


GATE = (
    guard("errors may grow fourfold", "position_error", constant(gate.Rule(4.0, 1e-10)), gate.RULES),
    guard("errors may not grow at all", "position_error", constant(gate.Rule(1.0, 1e-10)), gate.RULES),
    guard("a metric that flatters passes", "FLATTERING", constant(np.inf)),
    guard("orders may fall by two", "ORDER_MARGIN", constant(2.0)),
    guard("a truth may move by a microradian", "TRUTH_MARGIN", constant(1e-6)),
    guard("a floor ten times higher", "acceleration_error_median", constant(gate.Rule(2.0, 1e-11)), gate.RULES),
    guard("what is no number passes", "_verdict", lenient),
    guard("what is missing passes", "_verdict", lambda f: lambda c, m, x, b, *rest: f(c, m, x or b, b or x, *rest)),
    guard("nothing fails", "failures", constant(lambda verdicts: iter(()))),
)

PLANTED: tuple[Planted, ...] = (*MODELS, *FORMULAS, *METRICS, *REFERENCES, *CLOCKS, *GATE)


def smallest(check: Callable[[float], str | None], sound: float, seen: float, factor: float = 1.05) -> float:
    """The smallest size of a fault that a check sees, to `factor`, by halving its exponent between one unseen and one seen.

    Raises:
        ValueError: the larger is not seen, or the smaller is.
    """
    if check(seen) is None or check(sound) is not None:
        raise ValueError(f"a fault of {seen:g} is not seen, or one of {sound:g} is")
    while seen > sound * factor:
        middle = float(np.sqrt(sound * seen))
        if check(middle) is None:
            sound = middle
        else:
            seen = middle
    return seen


def of_inertia(size: float) -> str | None:
    """The four-bar's crank, by a share of its inertia."""
    return checks.model(FOUR_BAR, scale("crank", inertia=1 + size))


def of_length(size: float) -> str | None:
    """The four-bar's coupler, by metres."""
    return checks.model(FOUR_BAR, partial(longer, "coupler", size))


def of_damping(size: float) -> str | None:
    """The four-bar's brake, by a share of its damping."""
    return checks.model(FOUR_BAR, force_scaled("brake", "c", 1 + size))


def of_time(size: float) -> str | None:
    """Samples of the four-bar, by seconds."""
    return checks.in_time(FOUR_BAR, size)


SIZES: dict[str, tuple[str, Callable[[float], str | None]]] = {
    "inertia": ("of the crank's inertia", of_inertia),
    "length": ("m of the coupler's length", of_length),
    "damping": ("of the brake's damping", of_damping),
    "time": ("s of every sample's time", of_time),
}
UNSEEN, SEEN = 1e-17, 1e-2  # between which the smallest fault that is seen is looked for
