"""Settings that hold a requirement, and their costs: the data of the first screen.

A setting is an engine's variant at a step or tolerance on one linkage, with its errors over the whole stored run. Its time was
raced, or is `estimated`: scaled by the number of steps from a race of the same variant at another step. The settings of a linkage
that was not searched are the cases of the accuracy suite. The cheapest setting of each engine is picked here for every requirement
that a reader can choose, so that the page only looks it up.
"""

import json
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache, lru_cache
from typing import Any

from gauss_bench.reach import Kind, Reach, Requirement, Trial, reach
from gauss_bench.report.content import seen, short
from gauss_bench.report.reaches import answer, engines_of
from gauss_bench.report.rows import Key, Row, Run, group_rows, is_known, may_rank, number, own_steps, run_time

POSITIONS = (1e-2, 1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8, 1e-9)  # [m] that can be required
FORCES = (math.inf, 10.0, 1.0, 0.1, 0.01, 1e-3)  # [N]
USUAL = 1e-4  # [m]
NUMBERS = ("step", "tolerance", "steps", "seconds", "low", "high", "position", "force", "until")
RACED = {"seconds": "seconds", "low": "seconds_low", "high": "seconds_high"}  # a setting's and a race's names
METHOD = ("mechanism", "scenario", "engine", "settings", "integrator", "stabilization")
HORIZONS = (0.5, 1.0, 2.0, 5.0, 10.0)  # [s], those within the stored run


@dataclass(frozen=True)
class Setting:
    """A setting of an engine with known errors.

    Attributes:
        step [s], tolerance: NaN if the setting has none; steps: number of steps of the run.
        seconds, low, high: processor time of the run [s], with its spread if it was raced; NaN if unknown.
        estimated: whether `seconds` was scaled from a race at another step.
        position, force: largest errors of the run [m, N]; force is NaN if it was not measured.
        until: end of the run [s].
    """

    mechanism: str
    scenario: str
    engine: str
    settings: str
    integrator: str
    stabilization: str
    step: float
    tolerance: float
    steps: float
    seconds: float
    low: float
    high: float
    estimated: bool
    position: float
    force: float
    until: float

    def holds(self, position: float, force: float) -> bool:
        return self.position <= position and (math.isinf(force) or self.force <= force)

    @property
    def cost(self) -> tuple[float, float, str]:
        """Sort key: the time, or the number of steps of a setting without a time; settings with a time come first."""
        return (self.seconds, 0.0, self.words) if is_known(self.seconds) else (math.inf, self.steps, self.words)

    @property
    def choice(self) -> tuple[Any, ...]:
        """Everything on which a program for the setting depends."""
        return tuple(getattr(self, k) for k in (*METHOD, "step", "tolerance", "until"))

    @property
    def words(self) -> str:
        """Variant, integrator and stabilisation, without "none" and parts that the variant's name contains."""
        return _name_setting(self.settings, self.integrator, self.stabilization)


@cache
def _name_setting(settings: str, *more: str) -> str:
    return " · ".join(filter(None, (settings, *(x for x in more if x not in ("", "none", *settings.split("/"))))))


def size_in_words(x: Setting) -> str:
    """Return the step or tolerance in words; "own" if the engine chooses its steps."""
    if is_known(x.step):
        return f"{1e3 * x.step:.4g} ms"
    return f"tolerance {x.tolerance:.0e}" if is_known(x.tolerance) else "own"


INTEGRATORS = {"rk4": "RK4", "dop853": "DOP853", "dop853_fixed": "DOP853 at fixed steps", "idas": "IDAS", "idas_ggl": "IDAS, GGL"}


def in_words(run: Run, x: Setting) -> str:
    """Return integrator, stabilisation and the engine's own options that differ from those it is shipped with."""
    return row_in_words(run, vars(x)) or x.words


def row_in_words(run: Run, row: Row) -> str:
    """Return the words of `in_words` for a row; empty if its options are not stored."""
    choice = tuple(str(row[k]) for k in ("engine", "settings", "integrator", "stabilization"))
    options = _options_in_words(run).get(choice)
    if options is None:
        return ""
    *_, integrator, stabilization = choice
    first = [INTEGRATORS.get(integrator, integrator.replace("_", " ")), "" if stabilization == "none" else stabilization]
    return ", ".join(filter(None, (*first, *options)))


@lru_cache(maxsize=2)
def _options_in_words(run: Run) -> dict[tuple[str, ...], list[str]]:
    """Return (engine, variant, integrator, stabilisation) -> its options that differ from the engine's first variant."""
    found: dict[tuple[str, ...], list[str]] = {}
    for engine, rows in group_rows(run.table("search_space"), lambda r: str(r["engine"])).items():
        first = json.loads(str(rows[0]["options"]))
        for row in rows:
            options = json.loads(str(row["options"]))
            apart = {k: v for k, v in options.items() if k not in UNSAID and v != first.get(k)}
            key = (engine, *(str(row[k]) for k in ("settings", "integrator", "stabilization")))
            found[key] = [_option_in_words(k, v) for k, v in apart.items()]
    return found


UNSAID = ("remark",)  # options that are comments


def _option_in_words(name: str, value: Any) -> str:
    if isinstance(value, bool):
        value = "on" if value else "off"
    values = value if isinstance(value, list) else [value]
    return f"{name} {' '.join(f'{v:g}' if isinstance(v, float) else str(v) for v in values)}"


def method_of(row: Row) -> tuple[str, ...]:
    """Return the values of a row in the columns METHOD."""
    return tuple(str(row[k]) for k in METHOD)


def _size(row: Row) -> tuple[float, ...]:
    return tuple(short(row[k], 6) if is_known(row.get(k)) else -1.0 for k in ("step", "tolerance"))


def make_setting(row: Row, **more: Any) -> Setting:
    """Make a setting from a row and further fields; numbers that both lack are NaN."""
    known: dict[str, Any] = dict(zip(METHOD, method_of(row), strict=True)) | {k: number(row, k) for k in NUMBERS}
    return Setting(**{"estimated": False} | known | more)


@lru_cache(maxsize=2)
def all_settings(run: Run) -> tuple[Setting, ...]:
    """Return every setting with known errors, of all linkages, with or without a time."""
    searched = {str(r["mechanism"]) for r in run.table("search_ladder")}
    return (*_search(run), *(x for x in _cases(run) if x.mechanism not in searched))


def _search(run: Run) -> Iterable[Setting]:
    """Yield the settings of the searched linkages, each with its raced or estimated time."""
    raced = group_rows((r for r in run.table("search_times") if r["status"] == "ok" and is_known(r.get("seconds"))), method_of)
    steps_of: dict[tuple[Any, ...], float] = {(method_of(r), _size(r)): number(r, "steps") for r in run.table("search_ladder")}
    for row in run.table("search_ladder"):
        times = raced.get(method_of(row), [])
        if row["status"] != "ok" or not is_known(row.get("position_error")) or not number(row, "steps") > 0:
            continue
        same = next((t for t in times if _size(t) == _size(row)), None)  # the race at this very step or tolerance
        if same is not None:
            raced_at = {
                "seconds": number(same, "seconds"),
                "low": number(same, "seconds_low"),
                "high": number(same, "seconds_high"),
            }
        else:
            steps = number(row, "steps")
            # estimate: time per step in the race of the same variant whose number of steps is nearest on a log scale
            by = {steps_of.get((method_of(t), _size(t)), math.nan): number(t, "seconds") for t in times}
            near = min(by, key=lambda n: abs(math.log(max(n, 1.0) / steps)), default=math.nan)
            raced_at = {"seconds": by.get(near, math.nan) / max(near, 1.0) * steps}
        errors = {"position": number(row, "position_error"), "force": number(row, "force_error")}
        yield make_setting(row, **raced_at, **errors, estimated=same is None)


def _cases(run: Run) -> Iterable[Setting]:
    """Yield the valid cases of the accuracy suite as settings with estimated times."""
    for row in run.results:
        error = number(row, "length_error") if is_known(row.get("length_error")) else number(row, "position_error")
        if may_rank(row) and is_known(error) and is_known(run_time(row)):
            step = math.nan if own_steps(row) else number(row, "step")
            costs = {"step": step, "seconds": run_time(row), "until": number(row, "t_end")}
            yield make_setting(row, **costs, position=error, estimated=True)


def cheapest(settings: Sequence[Setting], position: float, force: float = math.inf) -> dict[str, Setting]:
    """Return engine -> its cheapest setting that holds the requirement; without a time, the one with the fewest steps."""
    leaders: dict[str, Setting] = {}
    for one in settings:
        if one.holds(position, force) and (one.engine not in leaders or one.cost < leaders[one.engine].cost):
            leaders[one.engine] = one
    return leaders


def cheapest_stored(run: Run, mechanism: str, settings: Sequence[Setting], position: float, force: float) -> dict[str, Setting]:
    """Return engine -> its cheapest setting; the winner of a race at exactly this requirement replaces the estimate."""
    leaders = cheapest(settings, position, force)
    if not math.isinf(force):
        return leaders
    for row in run.table("search_winners"):
        exact = row["required"] == "position" and math.isclose(number(row, "accuracy"), position, rel_tol=1e-6)
        if row["mechanism"] == mechanism and exact and row["status"] == "ok" and is_known(row.get("seconds")):
            alike = (x for x in settings if method_of(row) == method_of(vars(x)) and _size(row) == _size(vars(x)))
            like = next(alike, None)
            more = {"force": like.force, "until": like.until} if like else {}
            ends = {k: number(row, x) for k, x in RACED.items()}
            leaders[str(row["engine"])] = make_setting(row, **ends, **more, position=number(row, "error"))
    return leaders


def multiples(seconds: Mapping[Key, float]) -> dict[Key, float]:
    """Return each time divided by the smallest time."""
    least = min((x for x in seconds.values() if is_known(x)), default=math.nan)
    return {k: x / least for k, x in seconds.items() if is_known(x)}


def answers(run: Run, mechanism: str, settings: Sequence[Setting]) -> dict[str, Any]:
    """Return the data of the first screen for a linkage: settings, and for each requirement every engine's pick or its reason."""
    own = [x for x in settings if x.mechanism == mechanism]
    listed: list[Setting] = []
    picks: dict[str, list[Any]] = {}
    beyond: dict[str, list[int]] = {}  # engine -> per requirement the index of its reason in `words`, -1 if it holds
    words: dict[str, int] = {}
    for i, position in enumerate(POSITIONS):
        for j, force in enumerate(FORCES):
            chosen = cheapest_stored(run, mechanism, own, position, force)
            over = multiples({engine: x.seconds for engine, x in chosen.items()})
            line: list[Any] = []
            for one in sorted(chosen.values(), key=lambda x: (not is_known(x.seconds), x.seconds, x.engine)):
                if one not in listed:
                    listed.append(one)
                line.append([listed.index(one), seen(over.get(one.engine, math.nan))])
            picks[f"{i},{j}"] = line
            for engine, missed in not_held(run, mechanism, own, position, force).items():
                places = beyond.setdefault(engine, [-1] * len(POSITIONS) * len(FORCES))
                places[i * len(FORCES) + j] = words.setdefault(missed.words, len(words))
    described = [_describe(run, x) for x in listed]
    until = max((x.until for x in own if is_known(x.until)), default=math.nan)
    horizons = [h for h in HORIZONS if h < until] + ([until] if is_known(until) else [])
    return {
        "settings": described,
        "picks": picks,
        "none": beyond,
        "words": list(words),
        "until": until,
        "horizons": horizons,
        "chosen": listed,
    }


def _describe(run: Run, x: Setting) -> dict[str, Any]:
    known = {k: seen(getattr(x, k)) for k in NUMBERS if k != "until"} | {"estimated": x.estimated}
    return {"engine": x.engine, "words": in_words(run, x)} | {k: v for k, v in known.items() if v not in (None, False)}


def not_held(run: Run, mechanism: str, settings: Sequence[Setting], position: float, force: float = math.inf) -> dict[str, Reach]:
    """Return engine -> its reach, for the engines without a setting that holds the requirement."""
    held = {x.engine for x in settings if x.holds(position, force)}
    engines = dict.fromkeys((*engines_of(run, mechanism), *sorted({x.engine for x in settings})))
    return {e: answer_of(run, mechanism, e, settings, position, force) for e in engines if e not in held}


def answer_of(
    run: Run, mechanism: str, engine: str, settings: Sequence[Setting], position: float, force: float = math.inf
) -> Reach:
    """Return the reach of an engine from its ladders, or from its cases if the linkage was not searched."""
    wanted = [Requirement("position", position), *([] if math.isinf(force) else [Requirement("force", force)])]
    cases = [x for x in settings if x.engine == engine]
    if cases and engine not in engines_of(run, mechanism):
        return _answer_of_cases(cases, wanted)
    return answer(run, mechanism, engine, wanted)


def _answer_of_cases(cases: Sequence[Setting], wanted: Sequence[Requirement]) -> Reach:
    """Return the reach of an engine from its cases of the accuracy suite."""
    if len(wanted) > 1 and not any(is_known(x.force) for x in cases):
        return Reach(Kind.NOT_TRIED, "joint forces were not compared here")
    ladders: dict[tuple[str, ...], list[Trial]] = {}
    for x in cases:
        trial = Trial(x.step, {"position": x.position, "force": x.force}, int(x.steps))
        ladders.setdefault((x.settings, x.integrator, x.stabilization), []).append(trial)
    return reach(ladders.values(), wanted)


def linkages(run: Run) -> tuple[str, ...]:
    """Return the names of the linkages that were searched or run, sorted."""
    return tuple(sorted({str(r["mechanism"]) for r in (*run.results, *run.table("search_ladder"))}))


def scenario_of(run: Run, mechanism: str) -> str:
    rows: Iterable[Mapping[str, Any]] = (r for r in (*run.results, *run.table("search_ladder")) if r["mechanism"] == mechanism)
    return next((str(r["scenario"]) for r in rows), "")
