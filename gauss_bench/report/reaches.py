"""Whether an engine meets a requirement on a linkage, from the rows of a run; runs that stored no trials are read too."""

import math
from collections.abc import Sequence
from functools import lru_cache

from gauss_bench.reach import Kind, Reach, Requirement, Trial, reach, trial_of
from gauss_bench.report.rows import METHOD, Row, Run, group_by, number
from gauss_bench.trajectory import Status

Ladders = dict[str, dict[str, list[list[Trial]]]]  # linkage -> engine -> trials of each variant


def answer(run: Run, mechanism: str, engine: str, wanted: Sequence[Requirement]) -> Reach:
    """Return how far an engine reaches; a requirement that was raced is timed or says why it was not."""
    race = _find_race(run, mechanism, engine, wanted[0]) if len(wanted) == 1 else None
    ladders = _ladders(run).get(mechanism, {}).get(engine, [])
    if not ladders and race is not None:
        return _reach_of_race(race)
    if race is not None and race["status"] == Status.OK:
        return reach(ladders, wanted)
    untimed = "no race took it in"
    if race is not None and race["status"] != Status.SKIP:
        untimed = race["message"].removeprefix(f"{Kind.UNTIMED}: ")
    return reach(ladders, wanted, untimed)


def engines_of(run: Run, mechanism: str) -> list[str]:
    """Return the engines whose ladders on a linkage are stored."""
    return list(_ladders(run).get(mechanism, ()))


def _find_race(run: Run, mechanism: str, engine: str, wanted: Requirement) -> Row | None:
    """Return the row of `search_winners` of an engine at a requirement, None without one."""
    rows = _winners(run).get((mechanism, engine, wanted.kind), ())
    return next((r for r in rows if math.isclose(number(r, "accuracy"), wanted.limit, rel_tol=1e-6)), None)


def _reach_of_race(row: Row) -> Reach:
    """Return the reach that a row of `search_winners` states, for runs that stored no ladders."""
    status, message = row["status"], row.get("message") or ""
    if status == Status.OK:
        return Reach(Kind.TIMED)
    if status == Status.SKIP:
        return reach([[Trial(math.nan, {}, 0, Status.SKIP, message)]], [])
    steps = number(row, "steps")
    return Reach(Kind.NOT_REACHED, "" if "reach" in status else message, 0 if math.isnan(steps) else int(steps))


@lru_cache(maxsize=2)
def _ladders(run: Run) -> Ladders:
    """Return the trials of each variant that the search evaluated, at several steps or tolerances."""
    ladders: Ladders = {}
    for (mechanism, engine, *_), rows in group_by(run.table("search_ladder"), "mechanism", *METHOD).items():
        trials = [trial_of(r) for r in rows]
        ladders.setdefault(mechanism, {}).setdefault(engine, []).append(trials)
    return ladders


@lru_cache(maxsize=2)
def _winners(run: Run) -> dict[tuple[str, str, str], list[Row]]:
    """Return (linkage, engine, kind of error) -> the races of the engine's cheapest settings."""
    return group_by((r for r in run.table("search_winners") if r["required"]), "mechanism", "engine", "required")
