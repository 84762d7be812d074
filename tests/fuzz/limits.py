"""Compute how far a motion is from the limits of "ok" in the documentation, without the suite's judge and metrics.

Joints, energies and accelerations are those of `mechanics`, integrals are sums of trapezia, and every number is in
`gauss_bench/docs/pages/beyond.md`. A share above 1 is beyond the limit of a row, with everything that the row allows besides.
"""

from dataclasses import dataclass

import numpy as np

from tests.fuzz.mechanics import Array, Mechanics

START, LOOPS, ENERGY, ACCELERATIONS, RATES, TRUTH, REPETITION = 1e-5, 1e-2, 1e-2, 1e-2, 2.5e-2, 5e-2, 2.5e-2
MORE = 2.0  # limits that samples allow beside a limit, and a repetition beside the rates'
FEW = 0.1  # of the samples: where all others are beyond a limit, so is the median of any twenty


@dataclass(frozen=True)
class Motion:
    """Samples of positions, velocities and accelerations (k, n) at times t (k,)."""

    t: Array
    q: Array
    v: Array
    a: Array


def shares(
    mechanics: Mechanics, size: float, start: Motion, x: Motion, again: Motion | None, truth: Motion | None
) -> dict[str, float]:
    """Return row of the table -> the largest value of a motion over the most that the row allows.

    Args:
        size: of the linkage [m].
        start: the scenario's start, as one sample.
        again: the repetition of a motion whose truth is not known.
        truth: the motion itself, where it is known.
    """
    found = {
        "start": _off_start(size, start, x),
        "loops": max(np.abs(mechanics.rows(q, v)[0]).max(initial=0.0) for q, v in zip(x.q, x.v, strict=True))
        / (LOOPS * min(1.0, size)),
        "energy": _gained(mechanics, x),
        "accelerations": _off_accelerations(mechanics, x),
        "rates": _off_rates(size, x, again),
    }
    if truth is not None:
        found["truth"] = _apart(size, x, truth, TRUTH)
    elif again is not None:
        found["repetition"] = _apart(size, x, again, REPETITION)
    return {row: float(share) for row, share in found.items()}


def parts(x: Array) -> tuple[Array, Array]:
    """Return lengths (k, 2 links) and angles (k, links) of x (k, 3 links)."""
    each = x.reshape(len(x), -1, 3)
    return each[..., :2].reshape(len(x), -1), each[..., 2]


def slowest(size: float, x: Motion) -> tuple[float, float]:
    """Return the speeds [m/s], [rad/s] for limits: the largest of the run, but at least the size or 1 rad in the duration."""
    speed, spin = (float(np.abs(part).max()) for part in parts(x.v))
    duration = float(x.t[-1] - x.t[0])
    return max(speed, size / duration), max(spin, 1.0 / duration)


def _off_start(size: float, start: Motion, x: Motion) -> float:
    scales = (size, 1.0, *slowest(size, x))
    gaps = (*parts(x.q[:1] - start.q), *parts(x.v[:1] - start.v))
    return max(float(np.abs(gap).max()) / (START * scale) for gap, scale in zip(gaps, scales, strict=True))


def _gained(mechanics: Mechanics, x: Motion) -> float:
    """Return the energy gained beyond the work of torques and dampers, over three hundredths of the energy scale."""
    kinetic = 0.5 * (x.v**2 * mechanics.mass).sum(axis=1)
    potential = np.array([mechanics.potential(q) for q in x.q])
    power = np.array([mechanics.power(q, v) for q, v in zip(x.q, x.v, strict=True)])
    gained = kinetic + potential - [mechanics.torque_work(q) for q in x.q] - _integral(x.t, power[:, None])[:, 0]
    moving = max(float(kinetic.max()), float(np.ptp(potential)))
    most, allowed = float((gained - gained[0]).max()), (1 + MORE) * ENERGY * moving
    return most / allowed if allowed else float(np.inf if most > 0 else 0.0)


def _off_accelerations(mechanics: Mechanics, x: Motion) -> float:
    """Return the relative error that nine tenths of the samples exceed, over the limit of the median."""
    mechanics.evaluations = 0
    true = np.array([mechanics.acceleration(q, v) for q, v in zip(x.q, x.v, strict=True)])
    errors = np.abs(x.a - true).max(axis=1) / np.abs(true).max(axis=1)
    return float(np.quantile(errors, FEW)) / ACCELERATIONS


def _off_rates(size: float, x: Motion, again: Motion | None) -> float:
    """Return the largest difference of levels from the integrals of their rates, over the limit with its allowances."""
    worst = 0.0
    for motion, other, limits in (
        ((x.q, x.v), again and (again.q, again.v), (RATES * size, RATES)),
        ((x.v, x.a), again and (again.v, again.a), tuple(RATES * scale for scale in slowest(size, x))),
    ):
        for k, limit in enumerate(limits):
            gap, seen = _gap(x.t, *(parts(y)[k] for y in motion))
            repeated = 0.0
            if again is not None and other is not None:
                repeated = float(np.abs(gap - _gap(again.t, *(parts(y)[k] for y in other))[0]).max())
            allowed = limit + min(2 * seen, MORE * limit) + min(2 * repeated, MORE * limit)
            worst = max(worst, float(gap.max()) / allowed)
    return worst


def _gap(t: Array, value: Array, rate: Array) -> tuple[Array, float]:
    """Return the largest |value - start - integral of the rate| of all columns (k,), and its change with half of the samples."""
    whole = np.abs(value - value[0] - _integral(t, rate)).max(axis=1)
    some = np.abs(_integral(t, rate)[::2] - _integral(t[::2], rate[::2])).max()
    return whole, float(some)


def _integral(t: Array, rate: Array) -> Array:
    """Return the integral of columns (k, n) up to each time (k,), by trapezia with corrected ends."""
    steps = np.diff(t)[:, None]
    slopes = np.gradient(rate, t, axis=0, edge_order=2)
    pieces = steps / 2 * (rate[1:] + rate[:-1]) - steps**2 / 12 * np.diff(slopes, axis=0)
    return np.vstack([np.zeros(rate.shape[1]), np.cumsum(pieces, axis=0)])


def _apart(size: float, x: Motion, other: Motion, limit: float) -> float:
    return max(float(np.abs(gap).max()) / (limit * scale) for gap, scale in zip(parts(x.q - other.q), (size, 1.0), strict=True))
