"""Settings that meet a requirement, and their costs: the data of the first page of the report's website.

A setting is an engine's variant at a step or tolerance on one linkage, with its errors over the whole stored run. Its time was
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
USUAL = 1e-4  # [m] the accuracy that is chosen at first
NUMBERS = ("step", "tolerance", "steps", "seconds", "low", "high", "position", "force", "until")  # fields of a setting
VARIANT = ("mechanism", "scenario", *METHOD)  # columns that are equal at all steps
HORIZONS = (0.5, 1.0, 2.0, 5.0, 10.0)  # [s] durations that a reader can choose, up to that of the stored run
INTEGRATORS = {"rk4": "RK4", "dop853": "DOP853", "dop853_fixed": "DOP853 at fixed steps", "idas": "IDAS", "idas_ggl": "IDAS, GGL"}
COMMENTS = ("remark",)  # options that are comments


@dataclass(frozen=True)
class Setting:
    """A setting of an engine with known errors.

    Attributes:
        step, tolerance: size of the steps [s] and tolerance of the integrator. A setting has one of the two; the other is NaN.
        steps: number of steps of the run; NaN if the engine does not count its steps.
        seconds, low, high: processor time of the run [s], and both ends of its range if it was measured in a race; NaN if unknown.
        estimated: whether `seconds` is estimated from a race at another step.
        position, force: largest errors of the run [m], [N]; NaN for a force that was not measured.
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
        """Tell whether both errors are known to be within the requirement; an infinite force requires nothing."""
        return self.position <= position and (math.isinf(force) or self.force <= force)

    @cached_property
    def cost(self) -> tuple[float, float, str]:
        """Sort key: settings with a known time of a run come first, by this time; the others follow by their numbers of steps."""
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
        return " · ".join(filter(None, (self.settings, *(x for x in (self.integrator, self.stabilization) if x not in known))))


def describe_size(x: Setting) -> str:
    """Return step or tolerance of a setting in words, "own" if the engine chooses its steps."""
    if is_known(x.step):
        return f"{1e3 * x.step:.4g} ms"
    return f"tolerance {x.tolerance:.0e}" if is_known(x.tolerance) else "own"


def describe_setting(run: Run, x: Setting) -> str:
    """Return a setting in words: integrator, stabilisation, and the options that differ from those as shipped."""
    options = _changed_options(run).get((x.engine, x.settings, x.integrator, x.stabilization))
    if options is None:
        return x.words
    integrator = INTEGRATORS.get(x.integrator, x.integrator.replace("_", " "))
    stabilization = "" if x.stabilization == "none" else x.stabilization
    return ", ".join(filter(None, (integrator, stabilization, *options)))


@lru_cache(maxsize=2)
def _changed_options(run: Run) -> dict[tuple[str, ...], list[str]]:
    """Return variant (its columns METHOD) -> the options, in words, in which it differs from the engine's first variant."""
    words: dict[tuple[str, ...], list[str]] = {}
    for rows in group_by(run.table("search_space"), "engine").values():
        # rows with an `owner` have settings that the engine's authors sent; the first other row is the engine as shipped
        shipped = next((row for row in rows if not row.get("owner")), rows[0])
        first = json.loads(shipped["options"])
        for row in rows:
            options = json.loads(row["options"]).items()
            changed = [_describe_option(k, v) for k, v in options if k not in COMMENTS and v != first.get(k)]
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
    """Return the variant, step and tolerance of a row, which identify a setting.

    Numbers are rounded, so that rows of different tables that describe the same setting give equal tuples; an unknown number is -1.
    """
    sizes = (round_digits(row[k], 6) if is_known(row.get(k)) else -1.0 for k in ("step", "tolerance"))
    return (*variant_of(row), *sizes)


def make_setting(row: Row, **more: Any) -> Setting:
    """Return the setting of a row with further fields; missing numbers are NaN."""
    fields: dict[str, Any] = {k: row[k] for k in VARIANT} | {k: number(row, k) for k in NUMBERS} | {"estimated": False}
    return Setting(**fields | more)


def race_time(row: Row) -> dict[str, float]:
    """Return the time of a race [s] and the ends of its range, as fields of `Setting`."""
    time = spread(row, "seconds")
    return {"seconds": time.value, "low": time.low, "high": time.high}


@lru_cache(maxsize=2)
def all_settings(run: Run) -> dict[str, list[Setting]]:
    """Return linkage -> all settings with known errors, timed or not."""
    searched = {r["mechanism"] for r in run.table("search_ladder")}
    return group_by((*_search(run), *(x for x in _cases(run) if x.mechanism not in searched)), lambda x: x.mechanism)


@lru_cache(maxsize=2)
def _settings_by_key(run: Run) -> dict[tuple[Any, ...], Setting]:
    """Return the first setting with each key of `setting_key`; a search through thousands of settings takes half of the build."""
    every = [x for settings in all_settings(run).values() for x in settings]
    return {setting_key(vars(x)): x for x in reversed(every)}


def _search(run: Run) -> Iterator[Setting]:
    """Yield the settings of searches, each with its time: measured in a race, or estimated from one."""
    raced = [r for r in with_number(run.table("search_times"), "seconds") if r["status"] == "ok"]
    races = group_by(raced, variant_of)
    raced_at = {setting_key(r): r for r in reversed(raced)}  # reversed: of several rows of one setting the first stays
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
            near = min(counted, key=lambda n: abs(math.log(max(n, 1.0) / steps)), default=math.nan)
            time = {"seconds": seconds.get(near, math.nan) / max(near, 1.0) * steps}
        errors = {"position": row["position_error"], "force": number(row, "force_error")}
        yield make_setting(row, **time, **errors, estimated=raced_row is None)


def _cases(run: Run) -> Iterator[Setting]:
    """Yield the valid cases of the accuracy suite as settings with estimated times."""
    for row in run.results:
        error = first_number(number(row, "length_error"), number(row, "position_error"))
        if may_rank(row) and is_known(error) and is_known(run_time(row)):
            step = math.nan if chose_steps(row) else number(row, "step")
            costs = {"step": step, "seconds": run_time(row), "until": number(row, "t_end")}
            yield make_setting(row, **costs, position=error, estimated=True)


def cheapest(settings: Iterable[Setting], position: float, force: float = math.inf) -> dict[str, Setting]:
    """Return engine -> its cheapest setting, by `Setting.cost`, whose errors are at most `position` [m] and `force` [N]."""
    holding = group_by((x for x in settings if x.holds(position, force)), lambda x: x.engine)
    return {engine: min(some, key=lambda x: x.cost) for engine, some in holding.items()}


@lru_cache(maxsize=1024)
def cheapest_stored(run: Run, mechanism: str, position: float, force: float = math.inf) -> Mapping[str, Setting]:
    """Return engine -> its cheapest setting on a linkage, for each engine with a setting that meets the requirement.

    If a race was run at exactly this requirement, the engine's setting in this race replaces the one found from estimated times.

    Args:
        position, force: largest allowed errors [m], [N]; infinity allows any error of forces.
    """
    settings = all_settings(run).get(mechanism, [])
    leaders = cheapest(settings, position, force)
    if not math.isinf(force):  # no race has requirements on positions and forces together
        return leaders
    # times of different races cannot be compared: a race at exactly this requirement decides
    for row in with_number(run.table("search_winners"), "seconds"):
        asked = row["required"] == "position" and math.isclose(row["accuracy"], position, rel_tol=1e-6)
        if asked and row["mechanism"] == mechanism and row["status"] == "ok":
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
    over: dict[tuple[str, str, float, str], float] = {}
    timed = [r for r in with_number(run.table("search_winners"), "seconds") if r["status"] == "ok"]
    for race, rows in group_by(timed, "mechanism", "required", "accuracy").items():
        least = min(r["seconds"] for r in rows)  # an engine may have rows of several scenarios
        over |= {(*race, r["engine"]): r["seconds"] / least for r in rows}
    return over


def answers(run: Run, mechanism: str) -> dict[str, Any]:
    """Return the data that the first page of the site needs for a linkage.

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
    reasons: dict[str, list[int]] = {}  # engine -> per requirement the index of its reason in `words`, -1 if it is met
    words: dict[str, int] = {}
    for place, ((i, position), (j, force)) in enumerate(product(enumerate(POSITIONS), enumerate(FORCES))):
        chosen = cheapest_stored(run, mechanism, position, force)
        over = multiples({engine: x.seconds for engine, x in chosen.items()})
        ordered = sorted(chosen.values(), key=lambda x: (not is_known(x.seconds), x.seconds, x.engine))
        picks[f"{i},{j}"] = [[picked.setdefault(x, len(picked)), to_json(over.get(x.engine, math.nan))] for x in ordered]
        for engine, missed in engines_short_of(run, mechanism, position, force).items():
            of_engine = reasons.setdefault(engine, [-1] * len(POSITIONS) * len(FORCES))
            of_engine[place] = words.setdefault(missed.words, len(words))
    until = max((x.until for x in all_settings(run).get(mechanism, []) if is_known(x.until)), default=math.nan)
    horizons = [h for h in HORIZONS if h < until] + ([until] if is_known(until) else [])
    data = []
    for x in picked:  # `until` is left out, because the page states the duration once for the linkage
        numbers = {k: to_json(getattr(x, k)) for k in (*NUMBERS, "estimated") if k != "until"}
        known = {k: v for k, v in numbers.items() if v not in (None, False)}  # this leaves out zeros, too
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
    hold = {x.engine for x in settings if x.holds(position, force)}
    engines = dict.fromkeys((*engines_of(run, mechanism), *sorted({x.engine for x in settings})))
    return {e: answer_of(run, mechanism, e, position, force) for e in engines if e not in hold}


def answer_of(run: Run, mechanism: str, engine: str, position: float, force: float = math.inf) -> Reach:
    """Return whether an engine meets a requirement on a linkage and, if not, how close it comes; by its search or its cases.

    Args:
        position, force: largest allowed errors [m], [N]; infinity allows any error of forces.
    """
    wanted = [Requirement("position", position), *([] if math.isinf(force) else [Requirement("force", force)])]
    cases = [x for x in all_settings(run).get(mechanism, []) if x.engine == engine]
    if not cases or engine in engines_of(run, mechanism):
        return answer(run, mechanism, engine, wanted)
    if len(wanted) > 1 and not any(is_known(x.force) for x in cases):
        return Reach(Kind.NOT_TRIED, "joint forces were not compared here")
    variants = group_by(cases, lambda x: (x.settings, x.integrator, x.stabilization)).values()

    def as_trial(x: Setting) -> Trial:
        """Return a case as a trial of a search."""
        return Trial(x.step, {"position": x.position, "force": x.force}, int(x.steps) if is_known(x.steps) else None)

    return reach([[as_trial(x) for x in some] for some in variants], wanted)


@lru_cache(maxsize=2)
def scenarios(run: Run) -> Mapping[str, str]:
    """Return linkage -> scenario of all linkages that were run or searched, sorted."""
    first: dict[str, str] = {}
    for row in (*run.results, *run.table("search_ladder")):
        first.setdefault(row["mechanism"], row["scenario"])
    return dict(sorted(first.items()))


def answer(run: Run, mechanism: str, engine: str, wanted: Sequence[Requirement]) -> Reach:
    """Return whether an engine meets requirements on a linkage, and whether it was timed in a race.

    Args:
        wanted: requirements that one setting must meet together. A race compares engines at a single requirement; if there are
            several, no engine was timed.
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
    """Return the row of the table `search_winners` of an engine at a requirement, or None without a race at it."""
    races = _races(run).get((mechanism, engine, wanted.kind), [])
    races = [r for r in races if scenario in ("", r["scenario"])]
    return next((r for r in races if math.isclose(number(r, "accuracy"), wanted.limit, rel_tol=1e-6)), None)


def _read_race(row: Row) -> Reach:
    """Return the answer for a row of `search_winners`: timed, skipped or not reached."""
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
def _ladders(run: Run) -> dict[tuple[str, str], list[list[Trial]]]:
    """Return (linkage, engine) -> for each searched variant its trials at several steps or tolerances."""
    variants = group_by(run.table("search_ladder"), "mechanism", *METHOD).values()
    engines = group_by(variants, lambda rows: (rows[0]["mechanism"], rows[0]["engine"]))
    return {key: [list(map(trial_of, rows)) for rows in some] for key, some in engines.items()}


@lru_cache(maxsize=2)
def _races(run: Run) -> dict[tuple[str, str, str], list[Row]]:
    """Return (linkage, engine, kind of error) -> the rows of `search_winners`, at all accuracies and scenarios."""
    return group_by((r for r in run.table("search_winners") if r["required"]), "mechanism", "engine", "required")
