"""The command line: verbs, exit codes, stdout for results and stderr for everything else.

Exit codes: 0 done, 1 an accuracy regression or a failed case, 2 bad usage or bad input, 70 a fault of this program itself, 74
stdout is closed or full, 130 interrupted. Rooms are imported inside the verbs, so that help answers at once.
"""

import argparse
import contextlib
import io
import json
import os
import shlex
import sys
import traceback
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

from gauss_bench.api.options import LOCAL, Verb, parser
from gauss_bench.api.telling import no_longer, tell, tell_if_long
from gauss_bench.linkage.limits import harmless

if TYPE_CHECKING:
    from gauss_bench.api.results import Kinematics, Simulation

BAD_INPUT, OWN_FAULT, NO_OUTPUT = 2, 70, 74  # the latter two as sysexits.h has them
EPOCH, LONGEST_EPOCH = (
    "SOURCE_DATE_EPOCH",
    12,
)  # and its digits: seconds that libraries which write pictures and programs take for now
LEAST_MEMORY = 700 << 20  # bytes of address space: with less, OpenBLAS may look for memory for ever while it is imported
TRACE = "GAUSS_BENCH_TRACEBACK"  # set, faults of the program are told with all that led to them
PRINTED = Path("csv")  # of kinematics: its table goes to stdout


class OutputLost(Exception):
    """Results cannot be written: stdout is closed or full."""


class Results(io.TextIOWrapper):
    """Stdout; what its encoding lacks is escaped, and a failure to write is OutputLost, not a faulty file of the user's.

    Raises:
        OutputLost: from write and flush.
    """

    def write(self, text: str) -> int:
        try:
            return super().write(text)
        except OSError as error:
            raise OutputLost(error.strerror) from error

    def flush(self) -> None:
        try:
            super().flush()
        except OSError as error:
            raise OutputLost(error.strerror) from error


class Remarks(io.TextIOWrapper):
    """Stderr; where it is full or closed, remarks are lost, and the exit code of the verb stays."""

    def write(self, text: str) -> int:
        with contextlib.suppress(OSError):
            return super().write(text)
        return len(text)

    def flush(self) -> None:
        with contextlib.suppress(OSError):
            super().flush()


def command() -> int:
    """`gauss-bench`: stdout is for results alone, and what libraries print there themselves goes to stderr."""
    if sys.stderr is None:  # closed by whoever calls
        sys.stderr = open(os.devnull, "w")
    # Unbuffered: what could not be written is not tried again at the end of the process, whose exit code would then be 120.
    unbuffered = os.fdopen(sys.stderr.fileno(), "wb", buffering=0, closefd=False)
    sys.stderr = Remarks(unbuffered, encoding=sys.stderr.encoding, errors="backslashreplace", write_through=True)
    if sys.stdout is None:
        print("error: stdout is closed: results have nowhere to go", file=sys.stderr)
        return NO_OUTPUT
    results = os.dup(sys.stdout.fileno())
    with contextlib.suppress(OSError):  # stderr is closed
        os.dup2(2, 1)
    sys.stdout = Results(os.fdopen(results, "wb"), encoding=sys.stdout.encoding, errors="backslashreplace")
    try:
        try:
            return main()
        except SystemExit as end:  # of the parser, after --help or bad usage
            return int(end.code or 0)
        finally:
            sys.stdout.flush()
    except OutputLost as error:
        return lose_output(error)


def lose_output(error: OutputLost) -> int:
    """Say that results were lost, and let nothing try to write them again."""
    print(f"error: stdout: {error}: results are lost", file=sys.stderr)
    with contextlib.suppress(OSError, ValueError):
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    return NO_OUTPUT


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one verb and return the exit code."""
    given = [*(sys.argv[1:] if arguments is None else arguments)]
    if bad := next((x for x in given if not is_argument(x)), None):
        print(f"error: the argument {harmless(bad[:40])!r} holds what no command line can", file=sys.stderr)
        return BAD_INPUT
    if not ((epoch := os.environ.get(EPOCH, "0")).isascii() and epoch.isdecimal() and len(epoch) <= LONGEST_EPOCH):
        print(f"error: {EPOCH}={harmless(epoch[:40])!r} in the environment: it must be a whole number of seconds", file=sys.stderr)
        return BAD_INPUT
    options = parser(ACTIONS).parse_args(given)
    if (memory := memory_limit()) < LEAST_MEMORY:
        least = f"{LEAST_MEMORY >> 10} kB"
        print(f"error: a limit leaves {memory >> 10} kB of memory (`ulimit -v`); libraries take {least} at least", file=sys.stderr)
        return BAD_INPUT
    try:
        return int(options.verb(options))
    except KeyboardInterrupt:
        print("interrupted; what a run had finished is kept", file=sys.stderr)
        return 130
    except OutputLost as error:
        return lose_output(error)
    except MemoryError:
        print("error: there is not enough memory for what was asked", file=sys.stderr)
        return BAD_INPUT
    except Exception as error:
        if is_bad_input(error):
            print(harmless(f"error: {error.args[0] if isinstance(error, KeyError) else error}"), file=sys.stderr)
            return BAD_INPUT
        if TRACE in os.environ:
            raise
        where = traceback.extract_tb(error.__traceback__)[-1]
        at = f"{type(error).__name__}: {harmless(' '.join(str(error).split())[:500])} ({Path(where.filename).name}:{where.lineno})"
        print(f"error: a fault of gauss-bench, not of what it was given: {at}; {TRACE}=1 tells how it came about", file=sys.stderr)
        return OWN_FAULT
    finally:
        no_longer()


def memory_limit() -> int:
    """Return the bytes of address space that this process may have."""
    try:
        import resource
    except ImportError:
        return sys.maxsize
    limit, _ = resource.getrlimit(resource.RLIMIT_AS)
    return sys.maxsize if limit == resource.RLIM_INFINITY else limit


def is_argument(text: str) -> bool:
    """Tell whether a text can be given on a command line, and so be the name of a file."""
    try:
        return b"\0" not in os.fsencode(text)
    except UnicodeError:
        return False


def is_bad_input(error: Exception) -> bool:
    """Tell whether the user can mend it: a faulty file, an unknown name, a folder that cannot be written."""
    from gauss_bench.bench.journal import Busy
    from gauss_bench.engines.extras import MissingExtra
    from gauss_bench.exchange.errors import ExchangeError
    from gauss_bench.linkage.errors import LinkageError
    from gauss_bench.reference.certificate import CertificateError
    from gauss_bench.report.errors import NoRun
    from gauss_bench.runs.offers import ChoiceError
    from gauss_bench.suites.read import SuiteError
    from gauss_bench.sweep.errors import SweepError
    from gauss_bench.tables import TableError

    named = isinstance(error, KeyError) and "unknown engine" in str(error)
    return named or isinstance(
        error,
        (
            LinkageError,
            ExchangeError,
            ChoiceError,
            CertificateError,
            MissingExtra,
            SuiteError,
            SweepError,
            TableError,
            NoRun,
            Busy,
            OSError,
        ),
    )


def print_json(item: Any) -> None:
    """One object on stdout; what is not finite becomes null, because JSON has no word for it."""
    from gauss_bench.api.results import plain

    print(json.dumps(plain(item)))


def list_all(options: argparse.Namespace) -> int:
    from gauss_bench.api import text

    catalogue = text.catalogue()
    if options.json:
        print_json(catalogue)
    else:
        print(text.format_catalogue(catalogue))
    return 0


def doctor(options: argparse.Namespace) -> int:
    from gauss_bench.api import text
    from gauss_bench.api.doctor import doctor as looked_at
    from gauss_bench.api.results import plain

    result = looked_at(tell)
    print(result.to_json() if options.json else text.format_checkup(plain(result.as_dict())))
    return 0 if result.usable else 1


def conformance(options: argparse.Namespace) -> int:
    from gauss_bench.api import text
    from gauss_bench.bench.conformance import conformance as checked

    checks = checked(options.engine, tell)
    passed = all(x.passed is not False for x in checks)
    if options.json:
        print_json({"engine": options.engine, "passed": passed, "checks": [vars(x) for x in checks]})
    else:
        print(text.format_conformance(options.engine, checks))
    return 0 if passed else 1


def show(options: argparse.Namespace) -> int:
    from gauss_bench.api import text
    from gauss_bench.api.files import describe_files
    from gauss_bench.linkage.load import load

    files = describe_files({"svg": options.svg}, {"svg": (".svg",)}, options.replace, options.linkage)
    first = load(options.linkage, options.scenario)
    others = [load(options.linkage, name) for name in first.scenarios if options.scenario is None and name != first.scenario]
    description = text.description(first, others)
    if files:
        from gauss_bench.report.drawings.drawing import draw
        from gauss_bench.report.drawings.pose import pose_links
        from gauss_bench.tables import write_text

        write_text(files["svg"], draw(*pose_links(options.linkage)))
    if options.json:
        print_json(description)
    else:
        print(text.format_description(description))
    return 0


def simulate(options: argparse.Namespace) -> int:
    from gauss_bench.api import text
    from gauss_bench.api.files import describe_files
    from gauss_bench.api.results import plain
    from gauss_bench.api.simulate import simulate as simulated

    kinds = {"plot": (".svg", ".png"), "animate": (".svg", ".gif", ".html"), "out": (".csv",)}
    files = describe_files({name: getattr(options, name) for name in kinds}, kinds, options.replace, options.linkage)
    result = simulated(
        options.linkage,
        options.engine,
        options.scenario,
        options.settings,
        options.integrator,
        options.stabilization,
        options.step,
        options.at,
        options.budget,
        tell_if_long,
    )
    for sentence in result.warnings:
        tell(f"warning: {sentence}")
    show_run(result, files)
    print(result.to_json() if options.json else text.format_simulation(plain(result.as_dict())))
    return 0 if result.status in ("ok", "skip") else 1


def diagnose(options: argparse.Namespace) -> int:
    from gauss_bench.api import diagnose as diagnosed
    from gauss_bench.api import text
    from gauss_bench.diagnosis.causes import Cause

    asked = (options.scenario, options.settings, options.integrator, options.stabilization, options.step, options.until)
    result = diagnosed.diagnose(options.linkage, options.engine, *asked, budget=options.budget, told=tell)
    print(result.to_json() if options.json else text.format_diagnosis(result))
    return 1 if result.cause is Cause.UNKNOWN else 0


def selftest(options: argparse.Namespace) -> int:
    from gauss_bench.api import selftest as tested
    from gauss_bench.api import text

    outcome = tested.selftest(options.only, tell)
    print_json(tested.as_dict(outcome)) if options.json else print(text.format_selftest(outcome))
    return 0 if outcome.passed else 1


def show_run(result: "Simulation", files: "dict[str, Path]") -> None:
    """Write the plot, the animation and the table of a run that were asked for, each in one move."""
    from gauss_bench.tables import write_bytes

    if not files:
        return
    if result.trajectory is None:
        tell("nothing was reached: no file is written")
        return
    from gauss_bench.api.history import history, table
    from gauss_bench.mechanism.parts import spread
    from gauss_bench.report.drawings.shown import film, picture

    curves, told = history(result), result.told()
    contents = {}
    for name, path in files.items():
        if name == "out":
            contents[path] = table(curves).encode()
        elif name == "plot":
            contents[path] = picture(path.suffix, told, curves)
        else:
            contents[path] = film(path.suffix, told, curves, result.model.whole, spread(result.model, result.trajectory))
    for path, content in contents.items():  # all of them, once all of them could be made
        write_bytes(path, content)
        tell(f"{path}")


def kinematics(options: argparse.Namespace) -> int:
    from gauss_bench.api import kinematics as moved
    from gauss_bench.api import text
    from gauss_bench.api.files import describe_files
    from gauss_bench.api.results import plain
    from gauss_bench.tables import write_text

    kinds, printed = {"plot": (".svg",), "animate": (".svg",), "out": (".csv",)}, options.out == PRINTED
    asked_files = {name: getattr(options, name) for name in kinds} | ({"out": None} if printed else {})
    files = describe_files(asked_files, kinds, options.replace, options.linkage)
    asked = (options.scenario, options.driver, options.intervals, options.points, options.method)
    result = moved.kinematics(options.linkage, *asked, hold=options.hold, told=tell_if_long)
    contents = pictures(options, result, [*files])
    table = moved.table(result).to_csv(index=False, lineterminator="\n") if options.out else ""
    if "out" in files:
        contents["out"] = table
    for name, content in contents.items():  # all of them, once all of them could be made
        write_text(files[name], content)
    if printed:
        print(table, end="")
    elif options.json:
        print(result.to_json())
    elif not options.out:
        print(text.format_kinematics(plain(result.as_dict())))
    if result.status != "ok":
        tell(result.message)
    return 0 if result.status == "ok" else 1


def pictures(options: argparse.Namespace, result: "Kinematics", wanted: list[str]) -> dict[str, str]:
    """The plot and the animation, as far as they are wanted."""
    from gauss_bench.api import kinematics as moved
    from gauss_bench.api.driven import driven
    from gauss_bench.report.drawings.animation import animate
    from gauss_bench.report.drawings.curves import curves
    from gauss_bench.runs.offers import ChoiceError

    if not {"plot", "animate"} & {*wanted}:
        return {}
    mechanism = driven(options.linkage, options.scenario, options.driver, options.hold).whole
    points, states = moved.observe(mechanism, options.points), moved.states(result)
    if "plot" in wanted and not points:
        raise ChoiceError("--plot: the file observes no point; name some with --point link.point")
    drawn = {}
    if "plot" in wanted:
        drawn["plot"] = curves(mechanism, states.t, states.q, states.v, states.a, points)
    if "animate" in wanted:
        drawn["animate"] = animate(mechanism, states.t, states.q, points)
    return drawn


def sweep(options: argparse.Namespace) -> int:
    from gauss_bench.sweep.halving import text as half
    from gauss_bench.sweep.run import How, Where
    from gauss_bench.sweep.run import sweep as swept
    from gauss_bench.sweep.summary import text

    engines = [x for names in options.engines or ["gauss-native"] for x in names.split(",")]
    asked = (
        options.scenario,
        options.settings,
        options.integrator,
        options.stabilization,
        options.step,
        options.until,
        options.budget,
    )
    where, planned = Where(options.backend, options.scheduler, options.jobs), (options.samples, options.sampling, options.seed)
    summary = swept(options.linkage, options.vary, options.out, engines, *planned, How(*asked), where, tell)
    print_json(summary) if options.json else print(text(summary["engines"]))
    for name, told in summary["engines"].items():
        tell(f"{name}: {half(told['half_the_step'])}")
    ended = summary["engines"].values()
    sound = all(x["half_the_step"] is None or x["half_the_step"]["ok"] for x in ended)
    return 0 if sound and all(set(x["status"]) <= {"ok", "not_assembled"} for x in ended) else 1


def studio(options: argparse.Namespace) -> int:
    from gauss_bench.engines.extras import require

    for library in ("starlette", "uvicorn", "websockets", "tomlkit"):
        require(library)
    from gauss_bench.studio.server import serve

    return serve(options.linkage, Path.cwd(), options.port, not options.no_browser, tell)


def export(options: argparse.Namespace) -> int:
    from gauss_bench.api import text
    from gauss_bench.api.exchange import export as exported
    from gauss_bench.api.results import plain

    asked = (options.scenario, options.tuned, options.step, options.replace, options.budget)
    result = exported(options.linkage, options.engine, options.out, *asked, told=tell)
    print(result.to_json() if options.json else text.format_export(plain(result.as_dict())))
    return 0 if result.tuning is None or result.tuning.met else 1


def recommend(options: argparse.Namespace) -> int:
    from gauss_bench.advice.truth import NoTruth
    from gauss_bench.api import text
    from gauss_bench.api.files import writable
    from gauss_bench.api.recommend import order_kinds
    from gauss_bench.api.recommend import recommend as recommended
    from gauss_bench.api.results import plain
    from gauss_bench.tables import write_text

    wanted = (options.position, options.angle, options.force, options.until)
    engines = [x for names in options.engines or [] for x in names.split(",")]
    files = (
        {
            x: writable(options.out / f"{x}.py", options.replace, suffix=".py", source=options.linkage)
            for x in engines or order_kinds()
        }
        if options.out
        else {}
    )
    try:
        result = recommended(options.linkage, *wanted, engines, options.scenario, options.settings, options.budget, tell)
    except NoTruth as reason:
        tell(f"{options.linkage}: nothing can be recommended: {reason}")
        return 1
    for answer in result.answers:
        if answer.snippet and answer.engine in files:
            write_text(files[answer.engine], answer.snippet)
            tell(f"{files[answer.engine]}")
    print(result.to_json() if options.json else text.format_recommendation(plain(result.as_dict())))
    return 0 if any(x.status == "ok" for x in result.answers) else 1


def bring_in(options: argparse.Namespace) -> int:
    from gauss_bench.api import text
    from gauss_bench.api.exchange import import_model
    from gauss_bench.api.results import plain

    result = import_model(options.model, options.out, options.close, options.replace, tell)
    print(result.to_json() if options.json else text.format_import(plain(result.as_dict())))
    return 0


def atlas(options: argparse.Namespace) -> int:
    from gauss_bench.api.files import usable_folder
    from gauss_bench.atlas import chart, survey, table
    from gauss_bench.bench.provenance import environment
    from gauss_bench.runs.asked import check_budget
    from gauss_bench.tables import refuse_foreign, write_table, write_text

    for folder in filter(None, (options.out, options.into)):
        usable_folder(folder)
        refuse_foreign({folder / "atlas.csv": table.HEAD})
    if options.out is not None:
        refuse_foreign({options.out / name: chart.TITLE for name in ("atlas.svg", "index.html")})
    chosen, along = survey.ways(options.engines), survey.axes(options.axes)
    reaches = survey.survey(chosen, along, check_budget(options.budget, survey.BUDGET), options.jobs, tell)
    rows = table.rows_of(reaches, environment()["commit"]) if options.out or options.into else []
    for folder in filter(None, (options.out, options.into)):
        tell(f"{write_table('atlas', rows, folder)[0]}")
    if options.out is not None:
        for name, content in {"atlas.svg": chart.chart(reaches), "index.html": chart.page(reaches)}.items():
            write_text(options.out / name, content)
            tell(f"{options.out / name}")
    if options.json:
        print_json([table.row(x) for x in reaches])
    else:
        print(table.text(reaches))
    return 0


def certify(options: argparse.Namespace) -> int:
    from gauss_bench.api import text
    from gauss_bench.api.files import writable
    from gauss_bench.bench.measurements import certificates
    from gauss_bench.reference.certificate import CERTIFICATES

    if options.out is not None:
        beside = Path(options.linkage).parent / CERTIFICATES if options.linkage else None
        writable(options.out, replace=True, usual=beside, suffix=".npz", source=options.linkage or "")
    if options.built_in:
        rows = certificates.certify_built_in(options.jobs)
        print_json(rows) if options.json else print(text.format_certificates(rows))
        return 0 if all(row["status"] == "ok" for row in rows) else 1
    if options.linkage is None:
        print("error: certify needs a linkage, or --built-in", file=sys.stderr)
        return BAD_INPUT
    chosen = (options.scenario, options.digits, options.until)
    certificate = certificates.certify_one(options.linkage, *chosen, options.out, tell)
    print_json(certificate) if options.json else print(text.format_certificate(certificate))
    return 0 if certificate["status"] == "ok" else 1


def verify(options: argparse.Namespace) -> int:
    from gauss_bench.api import text
    from gauss_bench.bench.measurements import certificates

    rows = certificates.verify_all(options.certificates, options.linkage, options.jobs)
    print_json(rows) if options.json else print(text.format_verification(rows))
    return 0 if rows and all(row.get("passed", False) for row in rows) else 1


def chosen_suite(options: argparse.Namespace, names: Sequence[str]) -> Any:
    """The suites of these names as one, for the linkages and engines asked for.

    Raises:
        SuiteError, LinkageError, KeyError: what cannot be used; before anything is run.
    """
    from gauss_bench.linkage.load import load
    from gauss_bench.runs.offers import offers
    from gauss_bench.suites.read import join_entries, of_engines, read_suite, restrict, scenario_of

    suite = join_entries([read_suite(name) for name in names])
    asked = getattr(options, "scenario", None)
    chosen = {x: load(x, asked or scenario_of(suite, x)).scenario for x in options.linkages}
    offers(options.engines or [])
    suite = restrict(suite, chosen) if chosen else suite
    return of_engines(suite, options.engines) if options.engines else suite


def run(options: argparse.Namespace) -> int:
    from gauss_bench.api import text
    from gauss_bench.api.files import usable_folder
    from gauss_bench.bench.cases import as_asked, cases
    from gauss_bench.bench.context import CASE_LIMIT
    from gauss_bench.bench.differences import accuracy_rows, differences
    from gauss_bench.bench.measurements.search import search_linkage
    from gauss_bench.bench.runner import run as run_suite
    from gauss_bench.engines.extras import require
    from gauss_bench.runs.asked import check_budget
    from gauss_bench.runs.first_builds import build_first

    usable_folder(options.out, LOCAL)
    if options.report:
        from gauss_bench.report.build import refuse_pages_of_others

        refuse_pages_of_others(options.out)
    names = options.suite or ["quick"]
    suite, limit = chosen_suite(options, names), check_budget(options.budget, CASE_LIMIT)
    as_asked(cases(suite), options.until, options.steps)  # refused before anything is run
    if options.against:
        accuracy_rows(options.against)
    if suite.steps and not suite.accuracy:  # about compiled code and nothing else
        require("llvmlite")
    if suite.hours:
        print(f"{suite.title}: all of it takes up to {suite.hours:g} h on two quiet cores", file=sys.stderr, flush=True)
    for engine in (x for part in suite.search for x in search_linkage(part)):
        build_first(engine.name, engine.variants, tell)
    asked = (options.until, options.steps, limit)
    tables = run_suite(suite, options.out, options.jobs, not options.no_costs, " ".join(names), *asked)
    if options.json:
        print_json(tables)
    else:
        print(harmless(text.format_run(tables, options.out)))
    if options.report:
        from gauss_bench.api.programs import programs
        from gauss_bench.report.build import build_report

        for path in build_report(options.out, programs):
            if path.name in ("README.md", "index.html"):
                tell(str(path))
    if options.against:
        tell(text.format_differences(differences(options.out, options.against), options.against))
    return 0


def report(options: argparse.Namespace) -> int:
    from gauss_bench.api import text
    from gauss_bench.api.programs import programs
    from gauss_bench.bench.differences import compare_times, differences
    from gauss_bench.bench.provenance import check_publishable
    from gauss_bench.report.build import build_report
    from gauss_bench.tables import read_environment

    if options.publish:
        check_publishable(options.out)
    if options.against:
        folders = options.out, options.against
        accuracy, moved = differences(*folders), compare_times(*folders)
        where = read_environment(options.out), read_environment(options.against)
        if options.json:
            print_json({"accuracy": asdict(accuracy), "compared": moved[0], "times": [asdict(x) for x in moved[1]], "where": where})
        else:
            print(harmless(text.format_changes(accuracy, moved, where)))
        return 0
    files = build_report(options.out, programs, tell_if_long)
    entries = [path for path in files if path.name in ("README.md", "index.html")]
    print_json([str(path) for path in files]) if options.json else print(harmless("\n".join(map(str, entries))))
    return 0


def check(options: argparse.Namespace) -> int:
    from functools import partial

    from gauss_bench.api import text
    from gauss_bench.bench import gate
    from gauss_bench.bench.cases import cases
    from gauss_bench.bench.runner import measure_all
    from gauss_bench.runs.apart import is_unaltered

    asked = cases(chosen_suite(options, ["gate"]))
    chosen = asked
    if not options.accept and not options.baseline.exists():
        tell(f"error: {options.baseline}: no baseline there; write one with --accept REASON")
        return BAD_INPUT
    baseline = None if options.accept else gate.read_baseline(options.baseline)
    if baseline is not None and (options.linkages or options.engines):  # of a part, what can be held against something
        chosen = gate.is_known(asked, baseline)
        if not chosen:
            named = " by ".join(", ".join(x) for x in (options.linkages, options.engines) if x)
            tell(f"error: {options.baseline} has no figure of {named}; --accept REASON writes them there")
            return BAD_INPUT
        if len(chosen) < len(asked):
            tell(f"{len(asked) - len(chosen)} of {len(asked)} cases are not in the baseline and are not run")
    alter = partial(gate.scale_inertia, options.plant_inertia) if options.plant_inertia else is_unaltered
    rows, references = measure_all(chosen, options.baseline.parent, options.jobs, alter)
    figures = gate.facts(rows, references)
    if baseline is None:
        changed, refused = gate.accept(figures, options.baseline, options.accept)
        print(harmless(f"{options.baseline}: {changed} figures new or changed"))
        for reason in refused:
            tell(f"not accepted, because it failed: {reason}")
        return 1 if refused else 0
    part = gate.restrict(baseline, set(rows["mechanism"]), {x.engine for x in asked})
    verdicts = gate.compare(figures, part)
    failed = list(gate.failures(verdicts))
    if options.json:
        print_json({"passed": not failed, "verdicts": [vars(v) for v in verdicts]})
    else:
        again = ["gauss-bench", "check", *options.linkages, *(x for name in options.engines or [] for x in ("--engine", name))]
        print(harmless(text.format_check(verdicts, shlex.join([*again, "--baseline", str(options.baseline)]))))
    return 1 if failed else 0


ACTIONS: dict[str, Verb] = {
    "list": list_all,
    "doctor": doctor,
    "conformance": conformance,
    "show": show,
    "simulate": simulate,
    "diagnose": diagnose,
    "kinematics": kinematics,
    "recommend": recommend,
    "sweep": sweep,
    "studio": studio,
    "export": export,
    "import": bring_in,
    "certify": certify,
    "verify": verify,
    "atlas": atlas,
    "run": run,
    "report": report,
    "check": check,
    "selftest": selftest,
}
