"""The race of settings that meet a requirement, in a worker; the first choices of all engines come first, while there is time."""

import time
from collections.abc import Sequence
from typing import Any

from gauss_bench.bench.clock import Race
from gauss_bench.bench.survived import watching
from gauss_bench.bench.tasks import Tables
from gauss_bench.bench.ways import Run, Way, pace_run
from gauss_bench.linkage.load import load
from gauss_bench.runs.blocks import Models

ROUNDS = (3, 10)  # fewest and most rounds of the race
LEAD = 0.03  # [s] length of the part of a run with equal steps that is timed
SLOW = 0.3  # [s] a run that takes longer is timed only once


def race_there(
    linkage: str,
    scenario: str,
    until: float,
    samples: int,
    rows: Sequence[Sequence[Any]],
    deadline: float,
    engines: Sequence[str],
    path: str,
) -> Tables:
    """Race settings, each with its number of steps, in the worker's process until `deadline`; the most important come first.

    Args:
        samples: number of samples of a run whose integrator chooses its own steps.
        deadline: in terms of time.monotonic, which all processes share and which does not jump with the time of day.
    """
    run = Run(linkage, load(linkage, scenario), until)
    race, round_time = Race(watching(path)), 0.0
    slow: dict[str, tuple[Way, float]] = {}
    models: Models = {}
    for row in (r for r in rows if r[0] in engines):
        way, steps = Way(*row[:5]), row[5]
        left = deadline - time.monotonic() - ROUNDS[0] * round_time
        if (race.blocks and left <= 0) or way.engine in slow:
            continue
        race.add(way, pace_run, run, way, steps, LEAD, samples, models)
        if not (race.blocks and race.blocks[-1].entry == way):
            continue
        begun = time.monotonic()
        seconds = race.blocks[-1].seconds()
        taken = time.monotonic() - begun
        if taken > SLOW:  # too slow to compete: one measurement is enough
            slow[way.engine] = way, seconds
            race.blocks.pop()
        else:
            round_time += taken
    rounds = int(min(max((deadline - time.monotonic()) / max(round_time, 1e-3), ROUNDS[0]), ROUNDS[1]))
    measured = race.run(rounds)
    told = [{"way": list(way), "seconds": x.tolist()} for way, x in measured.samples.items() if isinstance(way, Way)]
    failed = [{"engine": way.engine, "message": str(x)} for way, x in measured.failed.items() if isinstance(way, Way)]
    return {"failed": failed, "race": told + [{"way": list(way), "seconds": [x]} for way, x in slow.values()]}
