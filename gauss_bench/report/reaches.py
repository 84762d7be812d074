"""Find from the rows of a run whether an engine meets a requirement on a linkage and, if not, how close it comes.

This answer, a `gauss_bench.reach.Reach`, follows from the trials of the searches, which are runs at several steps or tolerances in
the table `search_ladder`. Runs of older versions of this suite did not store trials; then the answer follows from the races (timed
comparisons of the best settings), which are in the table `search_winners`.
"""

import math
from collections.abc import Sequence
from functools import lru_cache

from gauss_bench.reach import Kind, Reach, Requirement, Trial, reach, trial_of
from gauss_bench.report.rows import METHOD, Row, Run, group_by, number
from gauss_bench.trajectory import Status

Ladders = dict[str, dict[str, list[list[Trial]]]]  # linkage -> engine -> trials of each variant


def answer(run: Run, mechanism: str, engine: str, wanted: Sequence[Requirement]) -> Reach:
    """Return whether an engine meets requirements on a linkage, and whether it was timed in a race, or why not.

    Args:
        wanted: requirements that one setting must meet together. A race compares engines at a single requirement; if there are
            several, no engine was timed.
    """
    race = find_race(run, mechanism, engine, wanted[0]) if len(wanted) == 1 else None
    ladders = _ladders(run).get(mechanism, {}).get(engine, [])
    if race is None or (ladders and race["status"] == Status.SKIP):
        return reach(ladders, wanted, "no race took it in")
    if not ladders:
        return _read_race(race)
    if race["status"] == Status.OK:
        return reach(ladders, wanted)
    return reach(ladders, wanted, race["message"].removeprefix(f"{Kind.UNTIMED}: "))


def engines_of(run: Run, mechanism: str) -> list[str]:
    """Return the engines whose trials on a linkage are stored."""
    return list(_ladders(run).get(mechanism, ()))


def find_race(run: Run, mechanism: str, engine: str, wanted: Requirement, scenario: str = "") -> Row | None:
    """Return the row of the table `search_winners` of an engine at a requirement, or None without a race at it."""
    races = _races(run).get((mechanism, engine, wanted.kind), [])
    races = [r for r in races if scenario in ("", r["scenario"])]
    return next((r for r in races if math.isclose(number(r, "accuracy"), wanted.limit, rel_tol=1e-6)), None)


def _read_race(row: Row) -> Reach:
    """Return the answer for a row of `search_winners`, which follows from the row's status: timed, skipped or not reached."""
    status, message = row["status"], row.get("message") or ""
    if status == Status.OK:
        return Reach(Kind.TIMED)
    if status == Status.SKIP:
        # a single trial that was skipped for this reason gives the right kind of answer
        return reach([[Trial(math.nan, {}, status=Status.SKIP, message=message)]], [])
    steps = number(row, "steps")
    # a status such as "not reached" says all, and its message repeats it
    return Reach(Kind.NOT_REACHED, "" if "reach" in status else message, 0 if math.isnan(steps) else int(steps))


@lru_cache(maxsize=2)
def _ladders(run: Run) -> Ladders:
    """Return linkage -> engine -> a list with one entry for each searched variant: its trials at several steps or tolerances."""
    ladders: Ladders = {}
    for (mechanism, engine, *_), rows in group_by(run.table("search_ladder"), "mechanism", *METHOD).items():
        trials = [trial_of(r) for r in rows]
        ladders.setdefault(mechanism, {}).setdefault(engine, []).append(trials)
    return ladders


@lru_cache(maxsize=2)
def _races(run: Run) -> dict[tuple[str, str, str], list[Row]]:
    """Return a dictionary: (linkage, engine, kind of error) -> the rows of `search_winners`, at all accuracies and scenarios."""
    return group_by((r for r in run.table("search_winners") if r["required"]), "mechanism", "engine", "required")
