"""Run suites (files that list measurements), write their reports, and compare results with the committed baseline."""

import shlex
import sys
from argparse import Namespace
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Annotated, Any

from gauss_bench.api.files import usable_folder
from gauss_bench.api.programs import programs
from gauss_bench.api.telling import Answer, Told, render
from gauss_bench.bench import cases, gate
from gauss_bench.bench.differences import Clocked, Differences, accuracy_rows, compare_times, differences
from gauss_bench.bench.measurements.search import engines_of
from gauss_bench.bench.provenance import check_publishable
from gauss_bench.bench.runner import measure_all
from gauss_bench.bench.runner import run as run_suite
from gauss_bench.bench.tasks import CASE_LIMIT
from gauss_bench.engines import require
from gauss_bench.engines.authors import read_settings
from gauss_bench.linkage.load import load
from gauss_bench.report.build import build_report, refuse_pages_of_others
from gauss_bench.report.field_run import folders_of
from gauss_bench.runs.apart import build_first, leave_unaltered
from gauss_bench.runs.offers import ChoiceError, check_budget, offers
from gauss_bench.suites.read import join_entries, of_engines, read_suite, restrict, scenario_of
from gauss_bench.suites.schema import Suite
from gauss_bench.tables import TABLES, read_environment

LOCAL = Path("reports/local")  # default folder of a user's runs, inside the folder of the published rows
ENTRIES = ("README.md", "index.html")  # first pages of a report
Tables = Mapping[str, Sequence[Mapping[str, Any]]]


@dataclass(frozen=True)
class Changes:
    """The differences between two runs.

    Attributes:
        accuracy: differences of the figures of accuracy.
        compared: number of ratios of times, targets and claims that both runs have.
        times: ratios of times, targets and claims that differ.
        where: content of `environment.json` of this run and of the other run.
    """

    accuracy: Differences
    compared: int
    times: tuple[Clocked, ...]
    where: tuple[dict[str, Any], ...]


@dataclass(frozen=True)
class Checked:
    """The comparison of the accuracy cases with the baseline.

    Attributes:
        passed: true if every figure (a number that is compared) passes.
        verdicts: one verdict for each figure.
    """

    passed: bool
    verdicts: tuple[gate.Verdict, ...]


@dataclass(frozen=True)
class Accepted:
    """The new baseline, after --accept.

    Attributes:
        changed: number of figures that are new or changed.
        refused: a sentence for each case that was not accepted.
    """

    changed: int
    refused: tuple[str, ...]


def choose_suite(options: Namespace, names: Sequence[str]) -> Any:
    """Join the named suites, restrict them to the linkages and engines in the options, and add the settings of engines' authors.

    Raises:
        SuiteError, LinkageError, KeyError: a suite, linkage or engine cannot be used.
    """
    suite = join_entries([read_suite(name) for name in names])
    asked = getattr(options, "scenario", None)  # not every verb has the options --scenario and --authors
    scenarios = {x: load(x, asked or scenario_of(suite, x)).scenario for x in options.linkages}
    offers(options.engines or [])  # raises KeyError for an unknown engine
    suite = restrict(suite, scenarios) if scenarios else suite
    suite = of_engines(suite, options.engines) if options.engines else suite
    return with_authors(suite, getattr(options, "authors", []))


def with_authors(suite: Suite, files: Sequence[Path]) -> Suite:
    """Return a suite whose searches also time the settings in files that engines' authors contributed.

    Raises:
        SettingsFault: a file has a fault.
        ChoiceError: a file is for an engine whose settings the suite does not search.
    """
    searched = {x.name for part in suite.search for x in engines_of(part)}
    for path in files:
        engine = read_settings(path).engine
        if engine not in searched:
            raise ChoiceError(f"{path}: engine: the suite searches no settings of {engine}; `--suite search` does")
    names = tuple(str(path) for path in files)
    searches = tuple(part.model_copy(update={"authors": part.authors + names}) for part in suite.search)
    return suite.model_copy(update={"search": searches})


def run(options: Namespace, told: Told) -> Answer[Annotated[Tables, TABLES]]:
    """Run suites, and write their tables and pages; all options are checked first, before hours of computing."""
    usable_folder(options.out, LOCAL)
    if options.report:
        refuse_pages_of_others(options.out)
    names = options.suite or ["quick"]
    suite, limit = choose_suite(options, names), check_budget(options.budget, CASE_LIMIT)
    cases.adapt_cases(cases.cases(suite), options.until, options.steps)  # raises ChoiceError before anything is run
    if options.against:
        accuracy_rows(options.against)  # raises an error if there is no other run to compare with
    if suite.steps and not suite.accuracy:  # a suite that measures compiled code alone needs the compiler
        require("llvmlite")
    if suite.hours:
        print(f"{suite.title}: all of it takes up to {suite.hours:g} h on two quiet cores", file=sys.stderr, flush=True)
    for engine in (x for part in suite.search for x in engines_of(part)):
        build_first(engine.name, engine.variants, told)
    limits = (options.until, options.steps, limit)
    tables = run_suite(suite, options.out, options.jobs, not options.no_costs, " ".join(names), *limits)
    pages = build_report(options.out, programs) if options.report else []
    remarks = [str(path) for path in pages if path.name in ENTRIES]
    if options.against:
        remarks.append(render("differences", differences(options.out, options.against), there=str(options.against)))
    return Answer(tables, text=format_run(tables, options.out), notices=tuple(remarks))


def format_run(tables: Tables, folder: Path) -> str:
    """Return the summary of a run as text: how its cases ended, and which targets were missed."""
    results, targets, missed = tables.get("results", ()), 0, []
    for name, rows in tables.items():
        keys = [c.name for c in TABLES[name].key if c.kind == "text"]  # columns whose texts name a row
        judged = [x for x in rows if isinstance(x.get("met"), bool)]  # rows with a target
        targets += len(judged)
        missed += [" ".join(str(row[key]) for key in keys if row.get(key)) for row in judged if not row["met"]]
    counts = sorted(Counter(str(row["status"]) for row in results).items())
    valid = sum(bool(row.get("valid")) for row in results)
    return render("run", counts, valid=valid, targets=targets, missed=missed, folder=str(folder))


def report(options: Namespace, told: Told) -> Answer[list[Path]] | Answer[Changes]:
    """Write the pages of a run's report; with `--against`, list the differences from another run instead."""
    if options.publish:
        for folder in folders_of(options.out):
            check_publishable(folder)
    if options.against:
        folders = options.out, options.against
        accuracy, (count, changed) = differences(*folders), compare_times(*folders)
        changes = Changes(accuracy, count, changed, tuple(read_environment(x) for x in folders))
        matters, rest = [x.row for x in changed if x.matters], [x.row for x in changed if not x.matters]
        return Answer(changes, text=render("changes", changes, matters=matters, rest=rest))
    return Answer(build_report(options.out, programs, told))


def check(options: Namespace, told: Told) -> Answer[Checked] | Answer[Accepted]:
    """Compare the figures of the accuracy cases with the baseline, or accept them as a new baseline with `--accept`."""
    chosen = asked = cases.cases(choose_suite(options, ["gate"]))
    if not options.accept and not options.baseline.exists():
        raise ChoiceError(f"{options.baseline}: no baseline there; write one with --accept REASON")
    baseline = None if options.accept else gate.read_baseline(options.baseline)
    # if linkages or engines were asked for, run only the cases that the baseline contains
    if baseline is not None and (options.linkages or options.engines):
        chosen = gate.known_cases(asked, baseline)
        if not chosen:
            named = " by ".join(", ".join(x) for x in (options.linkages, options.engines) if x)
            raise ChoiceError(f"{options.baseline} has no figure of {named}; --accept REASON writes them there")
        if len(chosen) < len(asked):
            told(f"{len(asked) - len(chosen)} of {len(asked)} cases are not in the baseline and are not run")
    alter = partial(gate.scale_inertia, options.plant_inertia) if options.plant_inertia else leave_unaltered
    rows, references = measure_all(chosen, options.baseline.parent, options.jobs, alter)
    figures = gate.figures_of(rows, references)
    if baseline is None:
        changed, refused = gate.accept(figures, options.baseline, options.accept)
        remarks = tuple(f"not accepted, because it failed: {reason}" for reason in refused)
        text = f"{options.baseline}: {changed} figures new or changed"
        return Answer(Accepted(changed, tuple(refused)), not refused, text, remarks)
    # figures of the baseline whose linkage or engine was not asked for are not compared
    expected = gate.restrict(baseline, {row["mechanism"] for row in rows}, {x.engine for x in asked})
    verdicts = gate.compare(figures, expected)
    outcome = Checked(not any(gate.failures(verdicts)), tuple(verdicts))
    engines = [x for name in options.engines or [] for x in ("--engine", name)]
    again = shlex.join(["gauss-bench", "check", *options.linkages, *engines, "--baseline", str(options.baseline)])
    text = render("check", outcome, lines=[str(v) for v in verdicts if v.outcome != "ok"], again=again)
    return Answer(outcome, outcome.passed, text)
