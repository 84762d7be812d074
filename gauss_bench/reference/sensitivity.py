"""The floor of double precision: the change of a motion if every parameter of its linkage changes by a relative 1e-16.

0.37 is not a double. An engine that rounds it solves a neighbouring linkage, and two engines that round differently cannot be
distinguished below the distance of such neighbours. All numbers of the document are scaled by 1 + delta xi with random xi in
-1..1. The change of the motion, divided by delta / 1e-16, is the floor. delta is far above the rounding of both runs, and small
enough for the change to be proportional to it.
"""

import copy
from collections.abc import Sequence
from typing import Any

import numpy as np

from gauss_bench.linkage.errors import AssemblyError
from gauss_bench.mechanism.model import Mechanism
from gauss_bench.reference.taylor.series import taylor_motion
from gauss_bench.terms import Array

ROUNDING = 1e-16
DELTA = 1e-9
DRAWS = 6  # number of neighbouring linkages
SEED = 20161231
DYNAMIC = ("mass", "inertia", "kg_per_m", "value", "k", "c", "rest")  # keys of numbers that do not change the geometry
TABLES = ("ground", "links", "joints", "constraints", "forces", "gravity")  # tables of the document with parameters
STARTS = ("start", "driver", "drivers")  # tables of a scenario with parameters


def floors(document: dict[str, Any], mechanism: Mechanism, times: Sequence[str]) -> dict[str, Array]:
    """Return level "q", "v" or "a" -> (k,) the floor: the largest change up to each time that rounding of the parameters causes.

    It is found by DRAWS motions with parameters changed by up to DELTA, and scaled to changes of ROUNDING. It is NaN at times that
    no changed motion reaches.
    """
    rng = np.random.default_rng(SEED)
    base = taylor_motion(document, mechanism.scenario, times, double=True)
    levels = {level: np.full(len(times), np.nan) for level in ("q", "v", "a")}
    for _ in range(DRAWS):
        try:
            perturbed = taylor_motion(perturb(document, mechanism, rng), mechanism.scenario, base.times, double=True)
        except (AssemblyError, ArithmeticError):
            continue  # a neighbour of a motion at its limit may be impossible to assemble or to start
        k = min(len(base.times), len(perturbed.times))
        for level, floor in levels.items():
            change = np.abs(getattr(perturbed, level)[:k] - getattr(base, level)[:k]).max(axis=-1, initial=0.0)
            floor[:k] = np.fmax(floor[:k], np.maximum.accumulate(change) * (ROUNDING / DELTA))
    return levels


def perturb(document: dict[str, Any], mechanism: Mechanism, rng: np.random.Generator) -> dict[str, Any]:
    """Return a copy of the document with every parameter scaled by 1 + DELTA xi, xi random in -1..1.

    If rows are redundant, only masses and forces change, and neither the geometry nor the start: a parallelogram with unequal bars
    cannot be assembled.
    """
    perturbed = copy.deepcopy(document)
    scenario = perturbed["scenarios"][mechanism.scenario]
    keep_geometry = mechanism.redundant > 0

    def perturb_item(item: Any, key: str) -> Any:
        """Return a copy of the document's item at a key, each number in it scaled by a random factor of its own."""
        if isinstance(item, dict):
            return {k: perturb_item(v, k) for k, v in item.items()}
        if isinstance(item, list):
            return [perturb_item(v, key) for v in item]
        if isinstance(item, (str, bool)) or (keep_geometry and key not in DYNAMIC):
            return item
        return float(item) * (1.0 + DELTA * rng.uniform(-1.0, 1.0))

    for table in TABLES:
        if table in perturbed:
            perturbed[table] = perturb_item(perturbed[table], table)
    for table in STARTS:
        if table in scenario and not keep_geometry:
            scenario[table] = perturb_item(scenario[table], table)
    return perturbed
