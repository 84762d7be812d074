"""Whether an engine holds a requirement on a linkage, from the rows of a run; rows without stored ladders are read too."""

import math
from collections.abc import Sequence
from functools import lru_cache

from gauss_bench.reach import Kind, Reach, Requirement, Trial, reach, trial_of
from gauss_bench.report.rows import Row, Run, group_rows, is_known, number
from gauss_bench.trajectory import Status

Ladders = dict[str, dict[str, list[list[Trial]]]]  # linkage -> engine -> trials of each variant


def answer(run: Run, mechanism: str, engine: str, wanted: Sequence[Requirement], timed: bool = False) -> Reach:
    """Return how far an engine reaches; `timed` tells that a time is known even without a race at this requirement."""
    races = (
        [r for w in wanted for r in _winners(run).get((mechanism, engine, w.kind), []) if _asks(r, w)] if len(wanted) == 1 else []
    )
    race = races[0] if races else None
    ladders = _ladders(run).get(mechanism, {}).get(engine, [])
    if not ladders and race is not None:
        return _describe(race)
    untimed = str(race["message"]) if race is not None and race["status"] not in ("ok", "skip") else "no race took it in"
    raced = race is not None and race["status"] == Status.OK
    return reach(ladders, wanted, None if timed or raced else untimed.removeprefix(f"{Kind.UNTIMED}: "))


def engines_of(run: Run, mechanism: str) -> list[str]:
    """Return the engines whose ladders on a linkage are stored."""
    return list(_ladders(run).get(mechanism, ()))


def _asks(row: Row, wanted: Requirement) -> bool:
    return math.isclose(number(row, "accuracy"), wanted.limit, rel_tol=1e-6)


def _describe(row: Row) -> Reach:
    """Return the reach that a row of `search_winners` states, for runs that stored no ladders."""
    status, message = str(row["status"]), str(row.get("message") or "")
    if status == Status.OK:
        return Reach(Kind.TIMED)
    if status == Status.SKIP:
        return reach([[Trial(math.nan, {}, 0, Status.SKIP, message)]], [])
    steps = int(number(row, "steps")) if is_known(row.get("steps")) else 0
    return Reach(Kind.NOT_REACHED, "" if "reach" in status else message, steps)


@lru_cache(maxsize=2)
def _ladders(run: Run) -> Ladders:
    methods = group_rows(
        run.table("search_ladder"), lambda r: (r["mechanism"], r["engine"], r["settings"], r["integrator"], r["stabilization"])
    )
    ladders: Ladders = {}
    for (mechanism, engine, *_), rows in methods.items():
        ladders.setdefault(str(mechanism), {}).setdefault(str(engine), []).append([trial_of(r) for r in rows])
    return ladders


@lru_cache(maxsize=2)
def _winners(run: Run) -> dict[tuple[str, str, str], list[Row]]:
    return group_rows(
        (r for r in run.table("search_winners") if r["required"]),
        lambda r: (str(r["mechanism"]), str(r["engine"]), str(r["required"])),
    )
