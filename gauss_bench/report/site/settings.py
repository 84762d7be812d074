"""Settings that meet a requirement, and their costs: the data of the first page of the report's website.

A setting is a variant of an engine at a step or tolerance on one linkage, with its errors over the whole stored run. Its time was
measured in a race (a timed comparison), or is estimated from a race of the same variant at another step, in proportion to the
number of steps. On a linkage without a search the cases of the accuracy suite count as settings.
"""

import json
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from itertools import product
from operator import itemgetter
from typing import Any

from gauss_bench.reach import BY_AUTHORS, Kind, Reach, Requirement, Trial, reach, trial_of
from gauss_bench.report.cases import chose_steps, may_rank, run_time
from gauss_bench.report.content import to_json
from gauss_bench.report.rows import METHOD, Key, Row, Run, first_number, group_by, is_known, number, spread, with_number
from gauss_bench.report.words import round_digits
from gauss_bench.trajectory import Status

POSITIONS = (1e-2, 1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8, 1e-9)  # [m] errors of positions that a reader can require
FORCES = (math.inf, 10.0, 1.0, 0.1, 0.01, 1e-3)  # [N] errors of joint forces that a reader can require; infinity requires nothing
USUAL = 1e-4  # [m] the accuracy that a page shows before a reader chooses one
NUMBERS = ("step", "tolerance", "steps", "seconds", "low", "high", "position", "force", "until")  # fields of a setting
VARIANT = ("mechanism", "scenario", *METHOD)  # columns that identify a variant; they are equal at all steps
HORIZONS = (0.5, 1.0, 2.0, 5.0, 10.0)  # [s] durations that a reader can choose, up to that of the stored run
INTEGRATORS = {"rk4": "RK4", "dop853": "DOP853", "dop853_fixed": "DOP853 at fixed steps", "idas": "IDAS", "idas_ggl": "IDAS, GGL"}
COMMENTS = ("remark",)  # options of a variant that are comments


@dataclass(frozen=True)
class Setting:
    """A setting of an engine with known errors.

    Attributes:
        step, tolerance: size of the steps [s] and tolerance of the integrator. A setting has one of the two; the other is NaN.
        steps: number of steps of the run; NaN if the engine does not count its steps.
        seconds, low, high: processor time of the run [s], and both ends of its range if it was measured in a race; NaN if unknown.
        estimated: whether `seconds` is estimated from a race at another step.
        position, force: largest errors of positions [m] and joint forces [N]; NaN for a force that was not measured.
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

    def holds(self, position: float, force: float = math.inf) -> bool:
        """Tell whether the errors are known to be at most `position` [m] and `force` [N]; an infinite force requires nothing."""
        return self.position <= position and (math.isinf(force) or self.force <= force)

    @cached_property
    def cost(self) -> tuple[float, float, str]:
        """The sort key by cost: settings of known time come first, by this time; then the others by their numbers of steps."""
        steps = self.steps if is_known(self.steps) else math.inf
        return (self.seconds, 0.0, self.words) if is_known(self.seconds) else (math.inf, steps, self.words)

    @property
    def choice(self) -> tuple[Any, ...]:
        """The values on which a program for the setting depends."""
        return tuple(getattr(self, k) for k in (*VARIANT, "step", "tolerance", "until"))

    @cached_property
    def words(self) -> str:
        """Variant, integrator and stabilisation in words, without "none" and without words that the variant's name contains."""
        known = ("", "none", *self.settings.split("/"))
        words = [x for x in (self.integrator, self.stabilization) if x not in known]
        return " · ".join(filter(None, (self.settings, *words)))


def describe_size(x: Setting) -> str:
    """Return the step or tolerance of a setting in words; "own" if it has neither."""
    if is_known(x.step):
        return f"{1e3 * x.step:.4g} ms"
    return f"tolerance {x.tolerance:.0e}" if is_known(x.tolerance) else "own"


def describe_setting(run: Run, x: Setting) -> str:
    """Return integrator, stabilisation and changed options of a setting; `Setting.words` if its variant was not searched."""
    options = _changed_options(run).get((x.engine, x.settings, x.integrator, x.stabilization))
    if options is None:
        return x.words
    integrator = INTEGRATORS.get(x.integrator, x.integrator.replace("_", " "))
    stabilization = "" if x.stabilization == "none" else x.stabilization
    return ", ".join(filter(None, (integrator, stabilization, *options)))


@lru_cache(maxsize=2)
def _changed_options(run: Run) -> dict[tuple[str, ...], list[str]]:
    """Return variant (its columns METHOD) -> its options, in words, that differ from those of the engine as shipped."""
    words: dict[tuple[str, ...], list[str]] = {}
    for rows in group_by(run.table("search_space"), "engine").values():
        # rows with an `owner` have settings that the engine's authors sent; the first other row is the engine as shipped
        ours = [row for row in rows if not row.get("owner")] or rows
        shipped = json.loads(ours[0]["options"])
        for row in rows:
            options = json.loads(row["options"]).items()
            changed = [_describe_option(k, v) for k, v in options if k not in COMMENTS and v != shipped.get(k)]
            words[tuple(row[k] for k in METHOD)] = [*changed, BY_AUTHORS] if row.get("owner") else changed
    return words


def _describe_option(name: str, value: Any) -> str:
    """Return an option with its value, or its list of values, in words."""
    if isinstance(value, bool):
        value = "on" if value else "off"
    values = value if isinstance(value, list) else [value]
    words = [f"{v:g}" if isinstance(v, float) else str(v) for v in values]
    return " ".join([name, *words])


variant_of = itemgetter(*VARIANT)  # values of a row in the columns VARIANT


def setting_key(row: Row) -> tuple[Any, ...]:
    """Return the variant, step and tolerance of a row as a tuple that identifies a setting.

    Numbers are rounded, so that rows of different tables that describe the same setting give equal tuples; an unknown number is -1.
    """
    sizes = (round_digits(row[k], 6) if is_known(row.get(k)) else -1.0 for k in ("step", "tolerance"))
    return (*variant_of(row), *sizes)


def make_setting(row: Row, **more: Any) -> Setting:
    """Return the setting of a row; `more` replaces fields, and missing numbers are NaN."""
    fields: dict[str, Any] = {k: row[k] for k in VARIANT} | {k: number(row, k) for k in NUMBERS} | {"estimated": False}
    return Setting(**fields | more)


def race_time(row: Row) -> dict[str, float]:
    """Return the time of a race [s] and the ends of its range, as fields of `Setting`."""
    time = spread(row, "seconds")
    return {"seconds": time.value, "low": time.low, "high": time.high}


@lru_cache(maxsize=2)
def all_settings(run: Run) -> dict[str, list[Setting]]:
    """Return linkage -> all settings with a known position error, timed or not."""
    searched = {r["mechanism"] for r in run.table("search_ladder")}
    others = [x for x in _case_settings(run) if x.mechanism not in searched]
    return group_by((*_searched_settings(run), *others), lambda x: x.mechanism)


@lru_cache(maxsize=2)
def _settings_by_key(run: Run) -> dict[tuple[Any, ...], Setting]:
    """Return key by `setting_key` -> the first setting with it; cached, because searches took half the time of a build."""
    every = [x for settings in all_settings(run).values() for x in settings]
    return {setting_key(vars(x)): x for x in reversed(every)}  # reversed: of several the first is kept


def _searched_settings(run: Run) -> Iterator[Setting]:
    """Yield the settings of searches, each with its time: measured in a race, estimated from one, or NaN."""
    raced = [r for r in with_number(run.table("search_times"), "seconds") if r["status"] == "ok"]
    races = group_by(raced, variant_of)
    raced_at = {setting_key(r): r for r in reversed(raced)}  # reversed: of several rows the first is kept
    steps_at = {setting_key(r): number(r, "steps") for r in run.table("search_ladder")}
    for row in with_number(run.table("search_ladder"), "position_error"):
        steps = number(row, "steps")
        if row["status"] != "ok" or steps == 0:
            continue
        raced_row = raced_at.get(setting_key(row))
        if raced_row is not None:
            time = race_time(raced_row)
        else:
            # estimate the time from that of a step, in the race of the same variant with the nearest number of steps on a log scale
            seconds = {steps_at.get(setting_key(r), math.nan): r["seconds"] for r in races.get(variant_of(row), ())}
            counted = [n for n in seconds if is_known(n)]
            nearest = min(counted, key=lambda n: abs(math.log(max(n, 1.0) / steps)), default=math.nan)
            time = {"seconds": seconds.get(nearest, math.nan) / max(nearest, 1.0) * steps}
        errors = {"position": row["position_error"], "force": number(row, "force_error")}
        yield make_setting(row, **time, **errors, estimated=raced_row is None)


def _case_settings(run: Run) -> Iterator[Setting]:
    """Yield the valid cases of the accuracy suite as settings with estimated times."""
    for row in run.results:
        error = first_number(number(row, "length_error"), number(row, "position_error"))
        if may_rank(row) and is_known(error) and is_known(run_time(row)):
            step = math.nan if chose_steps(row) else number(row, "step")
            costs = {"step": step, "seconds": run_time(row), "until": number(row, "t_end")}
            yield make_setting(row, **costs, position=error, estimated=True)


def cheapest(settings: Iterable[Setting], position: float, force: float = math.inf) -> dict[str, Setting]:
    """Return engine -> its cheapest setting, by `Setting.cost`, whose errors are at most `position` [m] and `force` [N]."""
    groups = group_by((x for x in settings if x.holds(position, force)), lambda x: x.engine)
    return {engine: min(group, key=lambda x: x.cost) for engine, group in groups.items()}


@lru_cache(maxsize=1024)
def cheapest_stored(run: Run, mechanism: str, position: float, force: float = math.inf) -> Mapping[str, Setting]:
    """Return engine -> its cheapest setting on a linkage, for each engine with a setting that meets the requirement.

    If a race was run at exactly this requirement, the engine's setting in this race is returned instead.

    Args:
        position, force: largest allowed errors [m], [N]; infinity allows any error of forces.
    """
    settings = all_settings(run).get(mechanism, [])
    leaders = cheapest(settings, position, force)
    if not math.isinf(force):  # no race has requirements on positions and forces together
        return leaders
    # times of different races cannot be compared: a race at exactly this requirement decides
    for row in with_number(run.table("search_winners"), "seconds"):
        is_same = row["required"] == "position" and math.isclose(row["accuracy"], position, rel_tol=1e-6)
        if is_same and row["mechanism"] == mechanism and row["status"] == "ok":
            stored = _settings_by_key(run).get(setting_key(row))
            more = {"force": stored.force, "until": stored.until} if stored else {}
            leaders[row["engine"]] = make_setting(row, **race_time(row), **more, position=number(row, "error"))
    return leaders


def fastest_first(run: Run, mechanism: str, position: float) -> list[Setting]:
    """Return the cheapest timed setting of each engine within `position` [m], the fastest first."""
    settings = cheapest_stored(run, mechanism, position).values()
    return sorted((x for x in settings if is_known(x.seconds)), key=lambda x: x.seconds)


def multiples(seconds: Mapping[Key, float]) -> dict[Key, float]:
    """Return key -> its time divided by the smallest time of all; unknown times are left out."""
    least = min(filter(is_known, seconds.values()), default=math.nan)
    return {k: x / least for k, x in seconds.items() if is_known(x)}


def race_multiples(run: Run) -> dict[tuple[str, str, float, str], float]:
    """Return (linkage, kind of error, accuracy, engine) -> the engine's time in a race divided by that of the fastest engine."""
    quotients: dict[tuple[str, str, float, str], float] = {}
    timed = [r for r in with_number(run.table("search_winners"), "seconds") if r["status"] == "ok"]
    for race, rows in group_by(timed, "mechanism", "required", "accuracy").items():
        least = min(r["seconds"] for r in rows)  # an engine may have rows of several scenarios
        quotients |= {(*race, r["engine"]): r["seconds"] / least for r in rows}
    return quotients


def collect_choices(run: Run, mechanism: str) -> dict[str, Any]:
    """Return the first page's data on a linkage: which settings meet which requirement.

    A requirement "i,j" is a position error of at most POSITIONS[i] together with a force error of at most FORCES[j].

    Returns:
        A dictionary with these keys:
        settings: data of all settings that are the cheapest of an engine for some requirement.
        chosen: these settings themselves, in the same order.
        picks: requirement -> for each engine that meets it, [index in `settings`, time divided by that of the fastest engine].
        none: engine -> for each requirement, the index in `words` of the reason why the engine does not meet it, -1 if it does.
        words: the reasons.
        until: duration of the longest stored run [s].
        horizons: the durations [s] that a reader can choose.
    """
    picked: dict[Setting, int] = {}  # setting -> its index on the page
    picks: dict[str, list[Any]] = {}
    reasons: dict[str, list[int]] = {}  # engine -> for each requirement the index of its reason in `words`, -1 if it is met
    words: dict[str, int] = {}  # reason -> its index
    for requirement, ((i, position), (j, force)) in enumerate(product(enumerate(POSITIONS), enumerate(FORCES))):
        chosen = cheapest_stored(run, mechanism, position, force)
        over = multiples({engine: x.seconds for engine, x in chosen.items()})
        ordered = sorted(chosen.values(), key=lambda x: (not is_known(x.seconds), x.seconds, x.engine))
        picks[f"{i},{j}"] = [[picked.setdefault(x, len(picked)), to_json(over.get(x.engine, math.nan))] for x in ordered]
        for engine, missed in engines_short_of(run, mechanism, position, force).items():
            indices = reasons.setdefault(engine, [-1] * len(POSITIONS) * len(FORCES))
            indices[requirement] = words.setdefault(missed.words, len(words))
    until = max((x.until for x in all_settings(run).get(mechanism, []) if is_known(x.until)), default=math.nan)
    horizons = [h for h in HORIZONS if h < until] + ([until] if is_known(until) else [])
    data = []
    for x in picked:  # `until` is left out, because the page states the duration once for the linkage
        numbers = {k: to_json(getattr(x, k)) for k in (*NUMBERS, "estimated") if k != "until"}
        known = {k: v for k, v in numbers.items() if v not in (None, False)}  # zeros are left out too: 0 == False
        data.append({"engine": x.engine, "words": describe_setting(run, x)} | known)
    return {
        "settings": data,
        "picks": picks,
        "none": reasons,
        "words": list(words),
        "until": until,
        "horizons": horizons,
        "chosen": list(picked),
    }


def engines_short_of(run: Run, mechanism: str, position: float, force: float = math.inf) -> dict[str, Reach]:
    """Return engine -> why it does not meet a requirement on errors [m], [N], for all engines without a setting that meets it."""
    settings = all_settings(run).get(mechanism, [])
    holding = {x.engine for x in settings if x.holds(position, force)}
    engines = dict.fromkeys((*engines_of(run, mechanism), *sorted({x.engine for x in settings})))  # each once
    return {engine: reach_of_engine(run, mechanism, engine, position, force) for engine in engines if engine not in holding}


def reach_of_engine(run: Run, mechanism: str, engine: str, position: float, force: float = math.inf) -> Reach:
    """Return whether an engine meets a requirement [m], [N] on a linkage and, if not, how close it comes.

    The answer follows from the engine's search or, without a search, from its cases.
    """
    wanted = [Requirement("position", position), *([] if math.isinf(force) else [Requirement("force", force)])]
    cases = [x for x in all_settings(run).get(mechanism, []) if x.engine == engine]
    if not cases or engine in engines_of(run, mechanism):
        return reach_of_search(run, mechanism, engine, wanted)
    if len(wanted) > 1 and not any(is_known(x.force) for x in cases):
        return Reach(Kind.NOT_TRIED, "joint forces were not compared here")
    variants = group_by(cases, lambda x: (x.settings, x.integrator, x.stabilization)).values()

    def as_trial(x: Setting) -> Trial:
        """Return a case as a trial of a search."""
        steps = int(x.steps) if is_known(x.steps) else None
        return Trial(x.step, {"position": x.position, "force": x.force}, steps)

    return reach([[as_trial(x) for x in variant] for variant in variants], wanted)


@lru_cache(maxsize=2)
def scenarios(run: Run) -> Mapping[str, str]:
    """Return linkage -> its first scenario, for all linkages that were run or searched, sorted."""
    rows = (*run.results, *run.table("search_ladder"))
    first = {row["mechanism"]: row["scenario"] for row in reversed(rows)}  # reversed: the first row is kept
    return dict(sorted(first.items()))


def reach_of_search(run: Run, mechanism: str, engine: str, wanted: Sequence[Requirement]) -> Reach:
    """Return whether an engine's search meets requirements on a linkage, and whether a race timed it.

    Args:
        wanted: requirements that one setting must meet together. A race compares engines at a single requirement; no engine
            was timed at several.
    """
    race = find_race(run, mechanism, engine, wanted[0]) if len(wanted) == 1 else None
    ladders = _ladders(run).get((mechanism, engine), [])
    if race is None or (ladders and race["status"] == Status.SKIP):
        return reach(ladders, wanted, "it took part in no race")
    if not ladders:
        return _read_race(race)
    untimed = None if race["status"] == Status.OK else race["message"].removeprefix(f"{Kind.UNTIMED}: ")
    return reach(ladders, wanted, untimed)


def engines_of(run: Run, mechanism: str) -> list[str]:
    """Return the engines whose trials on a linkage are stored."""
    return [engine for linkage, engine in _ladders(run) if linkage == mechanism]


def find_race(run: Run, mechanism: str, engine: str, wanted: Requirement, scenario: str = "") -> Row | None:
    """Return the row of `search_winners` of an engine at a requirement, in any scenario by default; None without a race."""
    races = [r for r in _races_by_kind(run).get((mechanism, engine, wanted.kind), []) if scenario in ("", r["scenario"])]
    return next((r for r in races if math.isclose(number(r, "accuracy"), wanted.limit, rel_tol=1e-6)), None)


def _read_race(row: Row) -> Reach:
    """Return the result of an engine from its row of `search_winners`: timed, skipped or not reached."""
    status, message = row["status"], row.get("message") or ""
    if status == Status.OK:
        return Reach(Kind.TIMED)
    if status == Status.SKIP:
        # a single trial that was skipped for this reason has this result
        return reach([[Trial(math.nan, {}, status=Status.SKIP, message=message)]], [])
    steps = number(row, "steps")
    reason = "" if "reach" in status else message  # the message of the status "not reached" repeats it
    return Reach(Kind.NOT_REACHED, reason, 0 if math.isnan(steps) else int(steps))


@lru_cache(maxsize=2)
def _ladders(run: Run) -> dict[tuple[str, str], list[list[Trial]]]:
    """Return (linkage, engine) -> for each searched variant its trials at several steps or tolerances."""
    variants = group_by(run.table("search_ladder"), "mechanism", *METHOD).values()
    engines = group_by(variants, lambda rows: (rows[0]["mechanism"], rows[0]["engine"]))
    return {key: [list(map(trial_of, rows)) for rows in engine_variants] for key, engine_variants in engines.items()}


@lru_cache(maxsize=2)
def _races_by_kind(run: Run) -> dict[tuple[str, str, str], list[Row]]:
    """Return (linkage, engine, kind of error) -> the rows of `search_winners`, at all accuracies and scenarios."""
    return group_by((r for r in run.table("search_winners") if r["required"]), "mechanism", "engine", "required")
