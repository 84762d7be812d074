"""Compare runs of random linkages, also stiff and uneven ones, with other mechanics: no wrong run may be called ok."""

import copy
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from gauss_bench import judge
from gauss_bench.api.simulate import simulate
from gauss_bench.linkage.errors import LinkageError
from tests.drawn_linkages import random_linkage
from tests.fuzz.judged import MOTIONS, read
from tests.fuzz.mechanics import NoMotion, true_end

UNTIL = 0.2  # [s]
KINDS = ("as drawn", "stiff", "uneven masses", "fast", "stiff and uneven")
ENGINES = ("gauss", "lagrange", "schur")


def drawn(seed: int) -> tuple[str, dict[str, Any]]:
    """Return a kind and a random linkage of this kind."""
    document, rng, kind = copy.deepcopy(random_linkage(seed)), np.random.default_rng([seed, 12]), KINDS[seed % len(KINDS)]
    if "stiff" in kind:
        for force in document["forces"].values():
            if "k" in force:
                force["k"] *= float(10 ** rng.uniform(1.0, 5.0))
    if "uneven" in kind:
        for link in document["links"].values():
            factor = float(10 ** rng.uniform(-6.0, 6.0))
            link["mass"] *= factor
            link["inertia"] *= factor
    if kind == "fast":
        speeds = document["scenarios"]["run"]["start"]["speeds"]
        for name in speeds:
            speeds[name] *= 10.0
    return kind, document


def ending(seed: int, folder: Path) -> tuple[str, str]:
    """Return how the run with this number ended, in a word, and a sentence if it is wrong and yet called ok."""
    kind, document = drawn(seed)
    try:
        mechanism = read(document, folder)
    except LinkageError:
        return "not assembled", ""
    rng = np.random.default_rng([seed, 11])
    engine, step = ENGINES[int(rng.integers(len(ENGINES)))], float(10 ** rng.uniform(-3.0, -1.7))
    stabilization = ("none", "projection")[int(rng.integers(2))]
    found = simulate(mechanism.source, engine, step=step, at=[0.0, UNTIL], stabilization=stabilization)
    if not found.valid or found.trajectory is None:
        return f"not ok: {found.status}", ""
    try:
        true, bar = true_end(document, "run", mechanism.q0, mechanism.v0, UNTIL)
    except NoMotion:
        return "ok, the truth is not known", ""
    size = mechanism.size
    if bar > judge.OFF_MOTION * min(1.0, size) / 2:
        return "ok, the truth is not known", ""
    off = np.abs(found.trajectory.q[-1] - true).reshape(-1, 3)
    length, turn = float(off[:, :2].max()), float(off[:, 2].max())
    if length > judge.OFF_MOTION * size + bar or turn > judge.OFF_MOTION + bar:
        said = f"{kind}, {engine}, step {step:.3g} s, {stabilization}: off by {length:.2g} m of {size:.2g}, {turn:.2g} rad"
        return "wrong, and called ok", f"seed {seed}: {said}"
    return "ok, and right", ""


def over_motions(seed: int, count: int) -> Iterator[tuple[int, str, str]]:
    """Yield number, word and sentence of each of `count` runs."""
    with tempfile.TemporaryDirectory() as folder:
        for k in range(count):
            number = MOTIONS * seed + k
            yield (number, *ending(number, Path(folder)))
