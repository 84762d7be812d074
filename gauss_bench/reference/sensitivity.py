"""The floor of double precision: the change of a motion if every parameter of its linkage changes by a relative 1e-16.

An engine that rounds decimals such as 0.37 to double precision computes the motion of a slightly different linkage. The distance
between the two motions is the floor: errors below it say nothing about the engine.

To find the floor, all parameters are multiplied by 1 + delta xi with random xi in -1..1, and the motion is computed again. The
perturbation delta is far above the rounding of both computations, and so small that the change of the motion is proportional to it.
"""

import copy
from collections.abc import Sequence
from typing import Any

import numpy as np

from gauss_bench.linkage.errors import AssemblyError
from gauss_bench.mechanism.model import Mechanism
from gauss_bench.reference.taylor.series import taylor_motion
from gauss_bench.terms import Array

ROUNDING = 1e-16  # relative change of a number that is rounded to a double
DELTA = 1e-9  # relative change of the numbers of a neighbouring linkage
DRAWS = 6  # number of neighbouring linkages
SEED = 20161231
DYNAMIC = ("mass", "inertia", "kg_per_m", "value", "k", "c", "rest")  # keys of numbers that do not change the geometry
TABLES = ("ground", "links", "joints", "constraints", "forces", "gravity")  # keys of the document under which parameters stand
STARTS = ("start", "driver", "drivers")  # keys of a scenario under which parameters stand


def floors(document: dict[str, Any], mechanism: Mechanism, times: Sequence[str]) -> dict[str, Array]:
    """Return "q", "v" or "a" -> the floor (k,) at k times (decimal texts [s]).

    The floor is the largest change up to each time in DRAWS motions of changed linkages, multiplied by ROUNDING / DELTA. It is NaN
    at times that none of these motions reaches.
    """
    rng = np.random.default_rng(SEED)
    # double precision suffices, because DELTA is much larger than its rounding
    base = taylor_motion(document, mechanism.scenario, times, double=True)
    levels = {level: np.full(len(times), np.nan) for level in ("q", "v", "a")}
    for _ in range(DRAWS):
        try:
            perturbed = taylor_motion(perturb(document, mechanism, rng), mechanism.scenario, base.times, double=True)
        except (AssemblyError, ArithmeticError):
            continue  # near a limit of motion, a changed linkage may be impossible to assemble or to start
        k = min(len(base.times), len(perturbed.times))
        for level, floor in levels.items():
            change = np.abs(getattr(perturbed, level)[:k] - getattr(base, level)[:k]).max(axis=-1, initial=0.0)
            floor[:k] = np.fmax(floor[:k], np.maximum.accumulate(change) * (ROUNDING / DELTA))
    return levels


def perturb(document: dict[str, Any], mechanism: Mechanism, rng: np.random.Generator) -> dict[str, Any]:
    """Return a copy of the document in which every parameter is multiplied by 1 + DELTA xi, with its own random xi in -1..1.

    If constraint rows are redundant, geometry and start are kept, because a parallelogram with unequal bars, for example, cannot be
    assembled.
    """
    perturbed = copy.deepcopy(document)
    scenario = perturbed["scenarios"][mechanism.scenario]
    keep_geometry = mechanism.redundant > 0

    def perturb_item(item: Any, key: str) -> Any:
        """Return a copy of the part of the document under `key` with changed numbers; if geometry is kept, only DYNAMIC ones."""
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
