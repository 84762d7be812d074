"""Sound motions by lot: every engine, integrator, stabilisation and step of the gate, held against a truth that no judge has seen.

A motion is sound where it stays, over all samples of the truth, within NEAR of what links travel, of their speeds and of their
accelerations. That is less than any limit of the judge, so that it may refuse none. Every second one is of a linkage whose
certificate is left behind, as the linkages of users are: there only its repetition and its rates speak for it. The truth is a
certificate, read as numbers, or a run of another formulation at a sixteenth of the step.
"""

import shutil
from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np

from gauss_bench.api.simulate import simulate
from gauss_bench.bench.cases import Case, cases
from gauss_bench.linkage.load import built_in, load
from gauss_bench.suites.read import read_suite
from gauss_bench.terms import Array

NEAR = (5e-3, 4e-3, 1e-2)  # of the longest way (at most the size, or 1 rad), of the largest speed, of the largest acceleration
SHORTER = 16
ENDS = (0.05, 0.1, 0.2, 0.5)  # [s], beside the end that the gate has


@dataclass(frozen=True)
class Truth:
    """Samples at times t (k,): of places, velocities and accelerations (k, n)."""

    t: Array
    levels: tuple[Array, Array, Array]


@lru_cache(maxsize=64)
def truth_of(linkage: str, scenario: str, engine: str, step: float, until: float) -> Truth:
    """The certified motion where the linkage has one, else a run by a formulation that the engine does not have."""
    if linkage in built_in():
        path = built_in()[linkage].parent / "certificates" / f"{linkage}.{scenario}.npz"
        if path.exists():
            with np.load(path, allow_pickle=False) as data:
                return Truth(data["t"], (data["q"], data["v"], data["a"]))
    other = "gauss" if engine.startswith("lagrange") else "lagrange"
    at = list(np.arange(1, 21) * until / 20)
    run = simulate(linkage, other, scenario, stabilization="projection", step=step / SHORTER, at=[0.0, *at]).trajectory
    if run is None:
        raise ValueError(f"no truth of {linkage}, {scenario}")
    return Truth(run.t, (run.q, run.v, run.a))


def distance(size: float, t: Array, levels: tuple[Array, Array, Array], truth: Truth) -> float:
    """How far a motion is from the truth, in units of NEAR; infinite where they have no samples in common."""
    k, j = np.nonzero(np.abs(t[:, None] - truth.t) < 1e-9)
    if len(k) < 2:
        return float("inf")
    largest, slow = 0.0, 1e-2 / t[-1]
    for columns, unit in ((slice(0, 2), size), (slice(2, 3), 1.0)):
        parts = [
            (x[k].reshape(len(k), -1, 3)[..., columns], y[j].reshape(len(k), -1, 3)[..., columns])
            for x, y in zip(levels, truth.levels, strict=True)
        ]
        (_, way), (_, speed), _ = parts
        scales = (
            np.clip(np.abs(way - way[:1]).max(), 1e-2 * unit, unit),
            max(np.abs(speed).max(), slow * unit),
            np.abs(truth.levels[2][j]).max() or 1.0,
        )
        off = [np.abs(x - y).max() / (near * scale) for (x, y), near, scale in zip(parts, NEAR, scales, strict=True)]
        largest = max(largest, *map(float, off))
    return largest


def ending(case: Case, until: float, alone: bool, folder: Path) -> tuple[str, str]:
    """How a case of the gate ended, in a word, and a sentence where it is sound and yet refused."""
    files = built_in()
    path = str(shutil.copy(files[case.linkage], folder)) if alone and case.linkage in files else case.linkage
    found = simulate(path, case.engine, case.scenario, case.settings, case.integrator, case.stabilization, case.step, [0.0, until])
    if found.trajectory is None:
        return f"not run: {found.status}", ""
    x = found.trajectory
    truth = truth_of(case.linkage, case.scenario, case.engine, min(case.step, 1e-3), until)
    off = distance(load(path, case.scenario).size, x.t, (x.q, x.v, x.a), truth)
    judged = "ok" if found.valid else "refused"
    if not off <= 1.0:
        return f"further off, {judged}", ""
    who = f"{case}, until {until:g}, {'alone' if alone else 'certified'}, off by {off:.2g} of what is near"
    return f"sound, {judged}", "" if found.valid else f"{who}: {found.message}"


def over_sound(seed: int, count: int, folder: Path, fewer: int = 10) -> Iterator[tuple[int, str, str]]:
    """Number, word and sentence of each motion, until `count` sound ones were met or `fewer` times as many were drawn."""
    rng, drawn = np.random.default_rng([seed, 24]), cases(read_suite("gate"))
    order, number, met = rng.permutation(len(drawn)), 0, 0
    while met < count and number < fewer * count:
        if number and number % len(order) == 0:
            order = rng.permutation(len(drawn))
        case = drawn[order[number % len(order)]]
        ends = [x for x in (*ENDS, case.t_end) if 2 * case.step < x <= case.t_end]
        word, sentence = ending(case, float(rng.choice(ends)), bool(rng.integers(2)), folder)
        met += word.startswith("sound")
        yield number, f"{word} ({case.engine})", sentence
        number += 1
