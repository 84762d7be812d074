"""Certification of a motion by two independent computations that share neither integrator nor equations.

Each computation (pipeline) begins with the linkage file. The first one, a Taylor series in 128-bit numbers, gives the values of the
certified motion. The second one, collocation in long double, gives the error bars: the differences between the two motions. If the
motion has a closed form, it gives the values, and both computed motions are compared with it. The certificate ends where the two
motions agree to fewer digits than are to be certified, or where one of them stops.
"""

import json
import platform
from collections.abc import Callable, Sequence
from dataclasses import fields
from decimal import Decimal
from functools import partial
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gauss_bench.linkage.load import decimal_document, load, merge
from gauss_bench.mechanism.model import Mechanism
from gauss_bench.reference.certificate import ARRAYS, FORMAT, Certificate
from gauss_bench.reference.exact import closed_form
from gauss_bench.reference.extended import extend_motion
from gauss_bench.reference.motion import Motion
from gauss_bench.reference.sensitivity import floors
from gauss_bench.reference.store import write_arrays
from gauss_bench.reference.taylor.forces import KNOWN
from gauss_bench.reference.taylor.series import taylor_motion
from gauss_bench.terms import Array

DIGITS = 12
MAX_SAMPLES = 500  # largest number of samples, so that files stay small
MIN_SAMPLES = 50  # least number of samples, so that motions over milliseconds have samples too
SPACING = Decimal("0.01")  # [s] usual distance of samples
STEPS = 100  # least number of steps of the collocation, which also halves steps that do not resolve the motion
HALVINGS = 2  # largest number of times that all steps are halved
ENOUGH = 2.0**-54  # relative rounding of the stored doubles
LEVELS = ("q", "v", "a")

Report = Callable[[str, float], None]  # a function that is called with the name of a stage and the time [s] that it has reached


class Uncertified(ArithmeticError):
    """No sample of the motion can be certified."""


def certify(
    linkage: str | Path, scenario: str | None = None, digits: int = DIGITS, until: float | None = None, report: Report | None = None
) -> Certificate:
    """Compute the certified motion of a linkage in one scenario, from 0 to the scenario's duration or to `until` [s].

    Args:
        linkage: path of a file, or name of a built-in linkage.
        scenario: name of a scenario of the file; with None the first scenario that has the table `start`.
        digits: number of digits that must be certified, of positions and of velocities relative to their largest values.
        until: end of the motion [s]; with None the scenario's duration is used.
        report: function that is called with the name of a stage and the time [s] that it has reached, or None.

    Raises:
        LinkageError: the file has faults.
        Uncertified: a force or coupling has no independent derivation, or no digits can be certified.
        ImportError: the extra that generates certificates is not installed.
    """
    mechanism = load(linkage, scenario)
    _refuse_unknown(mechanism)
    document = decimal_document(linkage)
    document = merge(document, document["scenarios"][mechanism.scenario].get("override", {}))
    duration = mechanism.duration if until is None else until
    times = sample_times(duration)
    report = report or (lambda stage, t: None)
    # `first` and `second` are the two computed motions, and `truth` is the motion whose values are certified
    first = taylor_motion(document, mechanism.scenario, times, progress=partial(report, "Taylor series"))
    exact = closed_form(mechanism, times)
    truth = first if exact is None else exact
    second, step = _collocate(document, mechanism, first, truth, report)
    bars = disagreement(truth, second) | {"multipliers": disagreement(first, second)["multipliers"]}
    count, worst, reason = len(times), 0.0, ""  # number of certified samples, and largest relative error
    if exact is None:
        count, worst, reason = _certified_part(truth, bars, (first, second), digits)
    if count < min(2, len(times)):
        raise Uncertified(f"{mechanism.name} in scenario {mechanism.scenario}: no sample can be certified: {reason}")
    stored = {level: getattr(truth, level)[:count].astype(float) for level in LEVELS}
    multipliers = first.multipliers if len(first.times) >= count else None  # not of `truth`: a closed form has none
    stored["multipliers"] = np.zeros((count, 0)) if multipliers is None else multipliers[:count].astype(float)
    report("sensitivity", 0.0)
    floor = floors(document, mechanism, truth.times[:count])
    arrays: dict[str, Any] = stored | {f"floor_{level}": floor[level] for level in LEVELS}
    for level, bar in bars.items():
        has_no_error = (level in LEVELS and exact is not None) or not stored[level].size
        arrays[f"error_{level}"] = np.zeros(count) if has_no_error else bar[:count]
    pipelines = []
    for motion in (first, second):
        entry = {"method": motion.method, "until": float(motion.times[-1]), "drift": list(motion.drift), "stopped": motion.stopped}
        if exact is not None:
            entry["off_closed_form"] = float(relative(exact, "q", disagreement(exact, motion)["q"]).max())
        pipelines.append(entry)
    return Certificate(
        name=mechanism.name,
        scenario=mechanism.scenario,
        digest=mechanism.digest,
        t=np.array([float(t) for t in truth.times[:count]]),
        digits=int(np.floor(-np.log10(max(worst, ENOUGH)))),
        duration=duration,
        stopped=reason,
        facts={
            "method": truth.method,
            "pipelines": pipelines,
            "collocation_step": step,
            "versions": {name: version(name) for name in ("gauss-bench", "heyoka", "numpy")}
            | {"python": platform.python_version()},
        },
        **arrays,
    )


def _refuse_unknown(mechanism: Mechanism) -> None:
    """Raise Uncertified if `taylor` has no derivation of a force or coupling."""
    varying = {id(force) for force in mechanism.varying}
    for word, parts in (("force", mechanism.forces), ("coupling", mechanism.couplings)):
        for part in parts:
            kind = "varies with time or direction" if id(part) in varying else f"is a {type(part).__name__}"
            if not isinstance(part, KNOWN) or id(part) in varying:
                raise Uncertified(f"{mechanism.name}: {word} {part.name} {kind}, which has no independent derivation yet")


def sample_times(duration: float) -> list[str]:
    """Return sample times as decimal texts: multiples of a spacing, and the end of the motion as the last.

    The spacing is the smallest multiple of SPACING with at most MAX_SAMPLES times; for a short motion, SPACING is divided by ten
    until there are at least MIN_SAMPLES.
    """
    end = Decimal(repr(float(duration)))
    spacing = SPACING
    while end / spacing > MAX_SAMPLES:
        spacing += SPACING
    while end > 0 and end / spacing < MIN_SAMPLES:
        spacing /= 10
    times = [k * spacing for k in range(int(end / spacing) + 1)]
    return [str(t) for t in (times if times[-1] == end else [*times, end])]


def split(values: NDArray[Any]) -> tuple[Array, Array]:
    """Return numbers of any type as sums of two doubles: the nearest double, and the remainder."""
    high = values.astype(float)
    return high, (values - high.astype(values.dtype)).astype(float)


def distance(one: NDArray[Any], other: NDArray[Any]) -> Array:
    """Return the largest difference of two arrays at each of their k common times (k,), computed with twice a double's digits.

    The arrays may have different types of number, of more digits than a double, which cannot be subtracted directly.
    """
    k = min(len(one), len(other))
    (high, low), (other_high, other_low) = split(one[:k]), split(other[:k])
    return np.asarray(np.abs((high - other_high) + (low - other_low)).max(axis=-1, initial=0.0))


def disagreement(truth: Motion, other: Motion) -> dict[str, Array]:
    """Return "q", "v", "a" or "multipliers" -> (k,) the largest distance of the motion `other` from `truth` up to each time.

    The distance is zero for multipliers that one of the motions lacks.
    """
    largest = {}
    for level in (*LEVELS, "multipliers"):
        x, y = getattr(truth, level), getattr(other, level)
        largest[level] = np.zeros(len(other.times)) if x is None or y is None else np.maximum.accumulate(distance(x, y))
    return largest


def relative(motion: Motion, level: str, bars: Array) -> Array:
    """Return error bars (k,) of "q", "v" or "a" (`level`), relative to 1 or, if larger, to the largest value up to that time."""
    largest = np.abs(getattr(motion, level)[: len(bars)].astype(float)).max(axis=-1, initial=0.0)
    return np.asarray(bars / np.maximum(1.0, np.maximum.accumulate(largest)))


def state_errors(truth: Motion, bars: dict[str, Array]) -> Array:
    """Return the relative error bars (k,) of a motion: that of positions or that of velocities, whichever is larger."""
    return np.asarray(np.maximum(*(relative(truth, level, bars[level]) for level in ("q", "v"))))


def _collocate(
    document: dict[str, Any], mechanism: Mechanism, first: Motion, truth: Motion, report: Report
) -> tuple[Motion, float]:
    """Integrate by collocation with shorter and shorter steps; return the best motion and its step [s].

    Steps are halved at most HALVINGS times, until the disagreement with `truth` is rounding, or no longer falls to a quarter.
    """
    step, before = min(float(SPACING), max(float(first.times[-1]), 1e-9) / STEPS), np.inf
    best, best_step = None, step
    is_geometry = mechanism.dof == len(mechanism.drivers)  # a motion that drivers prescribe does not depend on the step
    for _ in range(1 if is_geometry else 1 + HALVINGS):
        progress = partial(report, f"collocation at {step:.2g} s")
        motion = extend_motion(document, mechanism.scenario, truth.times, step, progress)
        worst = float(state_errors(truth, disagreement(truth, motion)).max())
        is_longer = best is None or len(motion.times) > len(best.times)  # of motions of different length, errors are not compared
        if is_longer or worst < before:
            best, best_step = motion, step
        if worst <= ENOUGH or (worst > before / 4 and not is_longer):
            break
        before, step = worst, step / 2
    assert best is not None
    return best, best_step


def _certified_part(truth: Motion, bars: dict[str, Array], pipelines: Sequence[Motion], digits: int) -> tuple[int, float, str]:
    """Return the number of certified samples, their largest relative error bar, and the reason why later ones are not certified.

    `bars` are the error bars (k,) of "q" and "v" of the motion `truth`, and `pipelines` the two computed motions.
    """
    errors = state_errors(truth, bars)
    refused = np.flatnonzero(~(errors <= 10.0**-digits))  # samples with too large or NaN errors
    count = int(refused[0]) if len(refused) else len(errors)
    worst = float(errors[:count].max(initial=0.0))
    if count == len(truth.times) and not truth.stopped:
        return count, worst, ""
    stopped = [motion.stopped for motion in pipelines if motion.stopped and len(motion.times) <= count]
    if stopped:
        return count, worst, "; ".join(stopped)
    # the growth of errors is measured from the time `earlier`, until which three more digits were correct
    last = float(truth.times[count - 1]) if count else 0.0
    earlier = float(truth.times[int(np.argmax(errors > 10.0 ** -(digits + 3)))])
    rate = f"tenfold every {(last - earlier) / 3:.2g} s" if last > earlier else "at once"
    until = f"the pipelines agree to {digits} digits until t = {last:g} s and to fewer after"
    return count, worst, f"{until}: small errors grow {rate} in this motion"


def write_certificate(certificate: Certificate, path: Path) -> None:
    """Write a certificate to a file atomically; the same certificate gives the same bytes."""
    header = {x.name: getattr(certificate, x.name) for x in fields(certificate) if x.name not in ARRAYS}
    arrays = {name: getattr(certificate, name) for name in ARRAYS}
    write_arrays(path, header=json.dumps({"format": FORMAT, **header}, sort_keys=True), **arrays)
