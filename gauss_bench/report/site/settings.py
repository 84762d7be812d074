"""Settings that hold a requirement, and what each costs: what the first screen answers from.

A setting is an engine's variant at a step or tolerance on one linkage, with its errors over the whole stored run. Its time was
raced at that step, or follows from the time of a step of the same variant that was raced at another one; then it is `estimated`.
Where a linkage was not searched, its settings are the cases of the accuracy suite. The cheapest of each engine that holds what is
required is picked here, for every requirement that can be chosen, so that a page only has to look it up.
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
    """One way to run an engine, whose errors are known.

    Attributes:
        seconds, low, high: processor time until `until`, with its spread where it was raced; NaN where nothing tells it.
        position, force: largest errors until `until` [m, N]; force NaN where it was not measured.
        until: end of that run [s].
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
        """By which the cheapest is chosen: its time, and the number of its steps where it has none."""
        return (self.seconds, 0.0, self.words) if is_known(self.seconds) else (math.inf, self.steps, self.words)

    @property
    def choice(self) -> tuple[Any, ...]:
        """Everything that a program of it depends on."""
        return tuple(getattr(self, k) for k in (*METHOD, "step", "tolerance", "until"))

    @property
    def words(self) -> str:
        """Variant, integrator and stabilisation, without what says nothing or stands in the variant's name."""
        return _name_setting(self.settings, self.integrator, self.stabilization)


@cache
def _name_setting(settings: str, *more: str) -> str:
    return " · ".join(filter(None, (settings, *(x for x in more if x not in ("", "none", *settings.split("/"))))))


def size_in_words(x: Setting) -> str:
    """Step or tolerance; or that the engine chooses it."""
    if is_known(x.step):
        return f"{1e3 * x.step:.4g} ms"
    return f"tolerance {x.tolerance:.0e}" if is_known(x.tolerance) else "own"


INTEGRATORS = {"rk4": "RK4", "dop853": "DOP853", "dop853_fixed": "DOP853 at fixed steps", "idas": "IDAS", "idas_ggl": "IDAS, GGL"}


def in_words(run: Run, x: Setting) -> str:
    """Return integrator, stabilisation and the engine's own options that differ from those it is shipped with."""
    return row_in_words(run, vars(x)) or x.words


def row_in_words(run: Run, row: Row) -> str:
    """Return the same for the row of a setting; nothing where its options are not stored."""
    choice = tuple(str(row[k]) for k in ("engine", "settings", "integrator", "stabilization"))
    options = _options_in_words(run).get(choice)
    if options is None:
        return ""
    *_, integrator, stabilization = choice
    first = [INTEGRATORS.get(integrator, integrator.replace("_", " ")), "" if stabilization == "none" else stabilization]
    return ", ".join(filter(None, (*first, *options)))


@lru_cache(maxsize=2)
def _options_in_words(run: Run) -> dict[tuple[str, ...], list[str]]:
    """Engine, variant, integrator and stabilisation -> its options besides those of the engine's first variant."""
    found: dict[tuple[str, ...], list[str]] = {}
    for engine, rows in group_rows(run.table("search_space"), lambda r: str(r["engine"])).items():
        first = json.loads(str(rows[0]["options"]))
        for row in rows:
            options = json.loads(str(row["options"]))
            apart = {k: v for k, v in options.items() if k not in UNSAID and v != first.get(k)}
            key = (engine, *(str(row[k]) for k in ("settings", "integrator", "stabilization")))
            found[key] = [_option_in_words(k, v) for k, v in apart.items()]
    return found


UNSAID = ("remark",)  # of options: words about them


def _option_in_words(name: str, value: Any) -> str:
    if isinstance(value, bool):
        value = "on" if value else "off"
    values = value if isinstance(value, list) else [value]
    return f"{name} {' '.join(f'{v:g}' if isinstance(v, float) else str(v) for v in values)}"


def method_of(row: Row) -> tuple[str, ...]:
    """What METHOD names of a row."""
    return tuple(str(row[k]) for k in METHOD)


def _size(row: Row) -> tuple[float, ...]:
    return tuple(short(row[k], 6) if is_known(row.get(k)) else -1.0 for k in ("step", "tolerance"))


def make_setting(row: Row, **more: Any) -> Setting:
    """A setting from a row and what the row does not say; numbers that neither knows are NaN."""
    known: dict[str, Any] = dict(zip(METHOD, method_of(row), strict=True)) | {k: number(row, k) for k in NUMBERS}
    return Setting(**{"estimated": False} | known | more)


@lru_cache(maxsize=2)
def all_settings(run: Run) -> tuple[Setting, ...]:
    """Every setting with known errors, of all linkages; those whose time nothing tells have none."""
    searched = {str(r["mechanism"]) for r in run.table("search_ladder")}
    return (*_search(run), *(x for x in _cases(run) if x.mechanism not in searched))


def _search(run: Run) -> Iterable[Setting]:
    raced = group_rows((r for r in run.table("search_times") if r["status"] == "ok" and is_known(r.get("seconds"))), method_of)
    steps_of: dict[tuple[Any, ...], float] = {(method_of(r), _size(r)): number(r, "steps") for r in run.table("search_ladder")}
    for row in run.table("search_ladder"):
        times = raced.get(method_of(row), [])
        if row["status"] != "ok" or not is_known(row.get("position_error")) or not number(row, "steps") > 0:
            continue
        same = next((t for t in times if _size(t) == _size(row)), None)
        if same is not None:
            raced_at = {
                "seconds": number(same, "seconds"),
                "low": number(same, "seconds_low"),
                "high": number(same, "seconds_high"),
            }
        else:
            steps = number(row, "steps")
            by = {steps_of.get((method_of(t), _size(t)), math.nan): number(t, "seconds") for t in times}
            near = min(by, key=lambda n: abs(math.log(max(n, 1.0) / steps)), default=math.nan)
            raced_at = {"seconds": by.get(near, math.nan) / max(near, 1.0) * steps}
        errors = {"position": number(row, "position_error"), "force": number(row, "force_error")}
        yield make_setting(row, **raced_at, **errors, estimated=same is None)


def _cases(run: Run) -> Iterable[Setting]:
    for row in run.results:
        error = number(row, "length_error") if is_known(row.get("length_error")) else number(row, "position_error")
        if may_rank(row) and is_known(error) and is_known(run_time(row)):
            step = math.nan if own_steps(row) else number(row, "step")
            costs = {"step": step, "seconds": run_time(row), "until": number(row, "t_end")}
            yield make_setting(row, **costs, position=error, estimated=True)


def cheapest(settings: Sequence[Setting], position: float, force: float = math.inf) -> dict[str, Setting]:
    """Engine -> its cheapest setting that holds, of equal ones the first by name; where none has a time, that of fewest steps."""
    leaders: dict[str, Setting] = {}
    for one in settings:
        if one.holds(position, force) and (one.engine not in leaders or one.cost < leaders[one.engine].cost):
            leaders[one.engine] = one
    return leaders


def cheapest_stored(run: Run, mechanism: str, settings: Sequence[Setting], position: float, force: float) -> dict[str, Setting]:
    """The same, with the winner of a race where just this was raced: it alone was told from what ties it."""
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
    """Return times over the least of them, whoever it belongs to."""
    least = min((x for x in seconds.values() if is_known(x)), default=math.nan)
    return {k: x / least for k, x in seconds.items() if is_known(x)}


def answers(run: Run, mechanism: str, settings: Sequence[Setting]) -> dict[str, Any]:
    """The answers of the first screen for a linkage: settings, each engine's pick for each requirement, or why there is none."""
    own = [x for x in settings if x.mechanism == mechanism]
    listed: list[Setting] = []
    picks: dict[str, list[Any]] = {}
    beyond: dict[str, list[int]] = {}  # engine -> for each requirement the place of its answer in `words`, -1 where it holds
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
    told = [_describe(run, x) for x in listed]
    until = max((x.until for x in own if is_known(x.until)), default=math.nan)
    horizons = [h for h in HORIZONS if h < until] + ([until] if is_known(until) else [])
    return {
        "settings": told,
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
    """Engine -> the answer, of those none of whose settings on a linkage holds what is required."""
    held = {x.engine for x in settings if x.holds(position, force)}
    engines = dict.fromkeys((*engines_of(run, mechanism), *sorted({x.engine for x in settings})))
    return {e: answer_of(run, mechanism, e, settings, position, force) for e in engines if e not in held}


def answer_of(
    run: Run, mechanism: str, engine: str, settings: Sequence[Setting], position: float, force: float = math.inf
) -> Reach:
    """Return the answer of an engine: from its ladders, or from its cases on a linkage that was not searched."""
    wanted = [Requirement("position", position), *([] if math.isinf(force) else [Requirement("force", force)])]
    cases = [x for x in settings if x.engine == engine]
    if cases and engine not in engines_of(run, mechanism):
        return _answer_of_cases(cases, wanted)
    return answer(run, mechanism, engine, wanted)


def _answer_of_cases(cases: Sequence[Setting], wanted: Sequence[Requirement]) -> Reach:
    """Return the answer of an engine on a linkage that was not searched, from its cases of the accuracy suite."""
    if len(wanted) > 1 and not any(is_known(x.force) for x in cases):
        return Reach(Kind.NOT_TRIED, "joint forces were not compared here")
    ladders: dict[tuple[str, ...], list[Trial]] = {}
    for x in cases:
        trial = Trial(x.step, {"position": x.position, "force": x.force}, int(x.steps))
        ladders.setdefault((x.settings, x.integrator, x.stabilization), []).append(trial)
    return reach(ladders.values(), wanted)


def linkages(run: Run) -> tuple[str, ...]:
    """Those that were searched or run, in order of their names."""
    return tuple(sorted({str(r["mechanism"]) for r in (*run.results, *run.table("search_ladder"))}))


def scenario_of(run: Run, mechanism: str) -> str:
    rows: Iterable[Mapping[str, Any]] = (r for r in (*run.results, *run.table("search_ladder")) if r["mechanism"] == mechanism)
    return next((str(r["scenario"]) for r in rows), "")
