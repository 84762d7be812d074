"""Time the settings that meet a requirement, in alternation, in a worker, until a deadline."""

import time
from collections.abc import Sequence
from typing import Any

from gauss_bench.bench.clock import Race
from gauss_bench.bench.survived import write_engine_to
from gauss_bench.bench.tasks import Tables
from gauss_bench.bench.ways import Run, Way, pace_run
from gauss_bench.linkage.load import load
from gauss_bench.runs.blocks import Models

ROUNDS = (3, 10)  # fewest and most rounds of the race
LEAD = 0.03  # [s] length of the timed part of a run with equal steps
SLOW = 0.3  # [s] a setting whose first timing takes longer is not timed again


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
    """Measure the run times of several settings in alternation, in this process (a worker).

    Return two tables: "race" has a row for each timed setting, with the fields of its `Way` and its run times [s]; "failed" has a
    row for each setting that could not be timed, with the engine and a message. If the first timing of a setting takes longer than
    SLOW, it stays the only one, and no further setting of the engine is timed.

    Args:
        until: end of the runs [s].
        samples: number of samples of a run whose integrator chooses its own steps.
        rows: for each setting the fields of its `Way`, and its number of steps; the most important settings come first.
        deadline: time of time.monotonic [s] at which the race ends.
        engines: the engines whose settings are timed.
        path: the file into which the name of the running engine is written.
    """
    run = Run(linkage, load(linkage, scenario), until)
    race, round_time = Race(write_engine_to(path)), 0.0  # [s] elapsed time of one round
    slow: dict[str, tuple[Way, float]] = {}  # engine -> its setting and the seconds of one run
    models: Models = {}
    for *fields, steps in rows:
        way = Way(*fields)
        time_left = deadline - time.monotonic() - ROUNDS[0] * round_time  # [s] left after the fewest rounds of the settings so far
        if way.engine not in engines or way.engine in slow or (race.blocks and time_left <= 0):
            continue
        race.add(way, pace_run, run, way, steps, LEAD, samples, models)
        if way in race.failed:
            continue
        begun = time.monotonic()
        seconds = race.blocks[-1].seconds()  # [s] of a run
        elapsed = time.monotonic() - begun
        if elapsed > SLOW:  # too slow to compete: one measurement is enough
            slow[way.engine] = way, seconds
            race.blocks.pop()
        else:
            round_time += elapsed
    # as many rounds as the time allows, within the limits ROUNDS
    rounds = int(min(max((deadline - time.monotonic()) / max(round_time, 1e-3), ROUNDS[0]), ROUNDS[1]))
    measured = race.run(rounds)
    # the clock also times an entry of its own, which is no Way, to measure the noise
    raced = [{"way": list(way), "seconds": x.tolist()} for way, x in measured.samples.items() if isinstance(way, Way)]
    failed = [{"engine": way.engine, "message": str(x)} for way, x in measured.failed.items() if isinstance(way, Way)]
    return {"failed": failed, "race": raced + [{"way": list(way), "seconds": [x]} for way, x in slow.values()]}
