"""Find how far an engine reaches on a linkage, that is whether it meets a requirement, from the rows of a run.

A run stores the trials of its searches in `search_ladder`. For runs of older versions, which did not, the races answer.
"""

import math
from collections.abc import Sequence
from functools import lru_cache

from gauss_bench.reach import Kind, Reach, Requirement, Trial, reach, trial_of
from gauss_bench.report.rows import METHOD, Row, Run, group_by, number
from gauss_bench.trajectory import Status

Ladders = dict[str, dict[str, list[list[Trial]]]]  # linkage -> engine -> trials of each variant


def answer(run: Run, mechanism: str, engine: str, wanted: Sequence[Requirement]) -> Reach:
    """Return how far an engine reaches on a linkage; if a race tried it, the answer says that it was timed, or why not.

    Args:
        wanted: requirements that a setting must hold together. Races are known for a single requirement alone.
    """
    race = find_race(run, mechanism, engine, wanted[0]) if len(wanted) == 1 else None
    ladders = _ladders(run).get(mechanism, {}).get(engine, [])
    if race is None or (ladders and race["status"] == Status.SKIP):
        return reach(ladders, wanted, "no race took it in")
    if not ladders:
        return _reach_of_race(race)
    if race["status"] == Status.OK:
        return reach(ladders, wanted)
    return reach(ladders, wanted, race["message"].removeprefix(f"{Kind.UNTIMED}: "))


def engines_of(run: Run, mechanism: str) -> list[str]:
    """Return the engines whose trials on a linkage are stored."""
    return list(_ladders(run).get(mechanism, ()))


def find_race(run: Run, mechanism: str, engine: str, wanted: Requirement, scenario: str = "") -> Row | None:
    """Return the row of `search_winners` of an engine at a requirement, or None if there was no race at it.

    Without a scenario, the first of several scenarios counts.
    """
    races = _races(run).get((mechanism, engine, wanted.kind), [])
    races = [r for r in races if scenario in ("", r["scenario"])]
    return next((r for r in races if math.isclose(number(r, "accuracy"), wanted.limit, rel_tol=1e-6)), None)


def _reach_of_race(row: Row) -> Reach:
    """Return the reach that a row of `search_winners` states."""
    status, message = row["status"], row.get("message") or ""
    if status == Status.OK:
        return Reach(Kind.TIMED)
    if status == Status.SKIP:
        # a single trial with this status tells why the engine was skipped
        return reach([[Trial(math.nan, {}, 0, Status.SKIP, message)]], [])
    steps = number(row, "steps")
    # a status such as "not reached" says all, and its message repeats it
    return Reach(Kind.NOT_REACHED, "" if "reach" in status else message, 0 if math.isnan(steps) else int(steps))


@lru_cache(maxsize=2)
def _ladders(run: Run) -> Ladders:
    """Return linkage -> engine -> a list of trials, at several steps or tolerances, for each variant that a search evaluated."""
    ladders: Ladders = {}
    for (mechanism, engine, *_), rows in group_by(run.table("search_ladder"), "mechanism", *METHOD).items():
        trials = [trial_of(r) for r in rows]
        ladders.setdefault(mechanism, {}).setdefault(engine, []).append(trials)
    return ladders


@lru_cache(maxsize=2)
def _races(run: Run) -> dict[tuple[str, str, str], list[Row]]:
    """Return (linkage, engine, kind of error) -> the rows of the races of the engine's cheapest settings."""
    return group_by((r for r in run.table("search_winners") if r["required"]), "mechanism", "engine", "required")
