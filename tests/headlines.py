"""Numbers of findings computed a second time, from raw rows alone and by other code than that of report and tables.

`compared` compares every number that these findings print with its second value, and every table that has the time of a step with
the samples.
"""

import math
import re
import statistics
from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.stats import t as student

from gauss_bench.report.build import all_findings, read_run
from gauss_bench.report.rows import Run
from gauss_bench.tables import read_table

Row = Mapping[str, Any]
PRINTED = 6e-3  # three digits are printed
STORED = 6e-4  # four digits of a time are stored
SLOW = 0.1  # [s] blocks beyond it are in some rounds only
NUMBER = r"(\d+(?:\.\d+)?)"


Rounds = Mapping[int, list[float]]  # process -> seconds


def time_of(processes: Rounds) -> float:
    """Return the median over processes of their lower quartiles."""
    return statistics.median(float(np.quantile(x, 0.25)) for x in processes.values())


def least(ratios: list[float]) -> float:
    """Return the ratio below which a second race lies in 1 of 200 cases, by Student's t on the logarithms about their median."""
    logs = [math.log(x) for x in ratios]
    if len(logs) < 2:
        return math.nan
    away = student.ppf(0.995, len(logs) - 1) * statistics.stdev(logs) * math.sqrt(math.pi / len(logs))
    return min(min(ratios), math.exp(statistics.median(logs) - away))


class Samples:
    """Rounds of races by linkage and by timed work."""

    def __init__(self, rows: Iterable[Row]):
        self.seconds: dict[tuple[str, ...], dict[int, list[float]]] = defaultdict(dict)
        for r in sorted(rows, key=lambda r: float(r["round"])):
            key = tuple(str(r[k]) for k in ("mechanism", "quantity", "engine", "settings", "stabilization"))
            self.seconds[key].setdefault(int(r["process"]), []).append(r["seconds"])

    def of(self, mechanism: str, quantity: str, engine: str, settings: str = "default", stabilization: str = "none") -> Rounds:
        """Return the rounds of an engine; the samples have one integrator of each engine alone."""
        return self.seconds[mechanism, quantity, engine, settings, stabilization]

    def ratio(self, one: Rounds, other: Rounds) -> float:
        """Return the ratio of two times in the rounds that both have."""
        both = [number for number in one if number in other]
        rounds = {number: min(len(one[number]), len(other[number])) for number in both}
        first, second = ({number: x[number][: rounds[number]] for number in both} for x in (one, other))
        return time_of(first) / time_of(second)


def first_integrators(run: Run) -> Samples:
    """Return the samples of the first integrator of each engine, which the tables of the kernel compare."""
    rows = [r for r in run.table("samples") if r["integrator"] in ("rk4", "")]
    return Samples(rows)


def said(run: Run, title: str) -> list[str]:
    return [f.text for f in all_findings(run) if f.title == title]


def after(text: str, name: str) -> float:
    """Return the number that a text prints after a name."""
    found = re.search(rf"{re.escape(name)} {NUMBER}", text)
    assert found, f"no number after {name}: {text}"
    return float(found[1])


def compared(run: Run) -> list[str]:
    """Compare findings with their second values, and return the names of the checks that compared any; fail at a difference."""
    told: list[str] = []
    for check in (steps, one_value, costs, claim, search):
        if list(check(run)):
            told.append(check.__name__)
    return told


def steps(run: Run) -> Iterator[None]:
    samples = first_integrators(run)
    for text in said(run, "A step in its own loop"):
        stabilization = "projection" if "with projection" in text else "none"
        linkages = {str(r["mechanism"]) for r in run.table("kernel_steps") if r["status"] == "ok"}
        for name in linkages:
            own = samples.of(name, "native_step", "gauss-native", stabilization=stabilization)
            if not own:
                continue
            rivals = [samples.of(name, "native_step", "mujoco", x) for x in ("tuned", "default")]
            least = min(samples.ratio(x, own) for x in rivals if x)
            assert after(text, name) == pytest.approx(least, rel=PRINTED), f"{name}, {stabilization}"
            yield


def one_value(run: Run) -> Iterator[None]:
    """Check that all tables have the same time of a step of the kernel."""
    samples = first_integrators(run)
    tables = {"kernel_steps": 1.0, "kernel_bounds": 1.0, "kernel_rhs": 4.0}
    for table, factor in tables.items():
        for r in run.table(table):
            apart = {"kernel_steps": r.get("formulation") != "gauss", "kernel_bounds": r.get("quantity") != "one trajectory"}
            if r["status"] != "ok" or apart.get(table) or (table == "kernel_rhs" and r["own"] != "in its own loop"):
                continue
            own = samples.of(r["mechanism"], "native_step", "gauss-native", stabilization=r.get("stabilization") or "none")
            assert factor * r["seconds"] == pytest.approx(time_of(own), rel=STORED), f"{table} {r['mechanism']}"
            if table == "kernel_steps":
                rival = samples.of(r["mechanism"], "native_step", r["rival"], r["settings"])
                assert r["rival_seconds"] == pytest.approx(time_of(rival), rel=STORED), f"{table} {r['mechanism']}"
            yield
    for r in run.results:
        for quantity in ("native_step", "step"):
            if r["integrator"] == "rk4" and np.isfinite(r[f"{quantity}_time"]):
                raw = samples.of(r["mechanism"], quantity, r["engine"], r["settings"], r["stabilization"])
                assert r[f"{quantity}_time"] == pytest.approx(time_of(raw), rel=STORED), (
                    f"{quantity} {r['mechanism']} {r['engine']}"
                )
                yield


def costs(run: Run) -> Iterator[None]:
    samples = first_integrators(run)
    for text in said(run, "Cost of gauss against lagrange"):
        quantity = "step" if text.startswith("A step") else "acceleration"
        for name in run.linkages:
            pair = [samples.of(name, quantity, x) for x in ("gauss", "lagrange")]
            words = f"{name} rk4" if quantity == "step" else name
            if all(pair) and f"{words} " in text:
                assert after(text, words) == pytest.approx(samples.ratio(*pair), rel=PRINTED), name
                yield


def claim(run: Run) -> Iterator[None]:
    """Check the numbers of linkages and the ranges of ratios, for one free coordinate and for more."""
    unknowns = {str(r["mechanism"]): int(r["unknowns_gauss"]) for r in run.table("kernel_claim")}
    words = {"step": "a step is", "projected": "a step with projection is", "batch": "a step in a batch is"}
    raw = first_integrators(run)
    for text in said(run, "The paper's claim"):
        for name in run.linkages if "own formula" in text else ():
            pair = [raw.of(name, "step", x) for x in ("gauss_pinv", "lagrange")]
            if all(pair):
                assert after(text, name) == pytest.approx(raw.ratio(*pair), rel=2 * PRINTED), name
        for few, part in ((True, text.split("; with 2")[0]), (False, "".join(text.split("; with 2")[1:]))):
            for what, start in words.items():
                ratios: dict[str, list[float]] = defaultdict(list)
                for r in run.table("claim_races"):
                    if r["what"] == what and r["status"] == "ok" and (unknowns[r["mechanism"]] == 1) is few:
                        ratios[r["mechanism"]].append(r["rival_seconds"] / r["seconds"])
                if not ratios:
                    continue
                medians = [float(np.median(x)) for x in ratios.values()]
                faster = sum(least(x) > 1 for x in ratios.values())
                found = re.search(rf"{start} faster on (\d+) of (\d+) linkages? \(ratio {NUMBER}(?: to {NUMBER})?", part)
                assert found, part
                assert (int(found[1]), int(found[2])) == (faster, len(ratios))
                ends = (float(found[3]), float(found[4] or found[3]))
                assert ends == pytest.approx((min(medians), max(medians)), rel=PRINTED)
                yield


def search(run: Run) -> Iterator[None]:
    """Check the ratios of rivals to our engines from all blocks of all processes, and that rivals' settings are exact enough."""
    way = ("mechanism", "engine", "settings", "integrator", "stabilization")

    def key(r: Row) -> tuple[Any, ...]:
        size = next(x for x in (r["step"], r["tolerance"]) if x is not None and np.isfinite(x))
        return (*(r[k] for k in way), f"{size:.6g}")  # sizes differ by a fifth, tables keep ten digits

    raced: dict[tuple[Any, ...], dict[int, list[float]]] = defaultdict(dict)
    for r in run.table("search_races"):
        if r["status"] == "ok":
            raced[key(r)].setdefault(int(r["process"]), []).append(r["seconds"])
    told = {key(r): r["seconds"] for r in run.table("search_times") if r["status"] == "ok"}
    assert told == pytest.approx({k: time_of(x) for k, x in raced.items()}, rel=STORED)
    ladder = {key(r): r for r in run.table("search_ladder") if r["status"] == "ok"}
    ours = set(run.own_engines)
    for f in all_findings(run):
        found = re.fullmatch(r"Within (\S+) \S+ of (\w+) over \S+ s", f.title)
        if not found:
            continue
        rows = [r for r in run.table("search_winners") if r["required"] == found[2] and f"{r['accuracy']:.0e}" == found[1]]
        sentence = f.text[f.text.index("searched best of") :]
        for r in rows:
            if r["status"] != "ok" or r["engine"] in ours:
                continue
            assert ladder[key(r)][f"{found[2]}_error"] <= r["accuracy"]
            here = [time_of(raced[key(x)]) for x in rows if x["mechanism"] == r["mechanism"] and x["ours"] and x["status"] == "ok"]
            if not here:
                continue
            expected = time_of(raced[key(r)]) / min(here)
            part = re.search(rf"`{re.escape(r['engine'])}` (.*?)(?=; `|, with the spread )", sentence)
            assert part, sentence
            within = PRINTED if r["seconds"] < SLOW else 0.2  # it sat later rounds out, which its own time does not tell
            assert after(part[1], r["mechanism"]) == pytest.approx(expected, rel=within), f"{r['engine']} {r['mechanism']}"
            yield


RAW = ("samples", "claim_races", "scaling_races", "search_races", "search_times", "search_ladder")  # no section reads them


def with_raw_rows(folder: Path) -> Run:
    """Return a run with the raw rows from which its tables were computed."""
    run = read_run(folder)
    return Run(run.environment, {**run.tables, **{name: read_table(name, folder) for name in RAW}})
