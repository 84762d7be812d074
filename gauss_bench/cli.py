"""The command line: verbs, exit codes, stdout for results and stderr for everything else.

Exit codes: 0 done, 1 an accuracy regression or a failed case, 2 bad usage or bad input, 130 interrupted. Rooms are imported inside
the verbs, so that help answers at once.
"""

import argparse
import json
import math
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from gauss_bench import __version__

BAD_INPUT = 2


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one verb and return the exit code."""
    options = parser().parse_args(arguments)
    try:
        return int(options.verb(options))
    except KeyboardInterrupt:
        print("interrupted; the same command goes on where it stopped", file=sys.stderr)
        return 130
    except BrokenPipeError:
        sys.stderr.close()  # the reader left; nothing more can be said
        return 1
    except Exception as error:
        if not is_bad_input(error):
            raise
        print(f"error: {error.args[0] if isinstance(error, KeyError) else error}", file=sys.stderr)
        return BAD_INPUT


def is_bad_input(error: Exception) -> bool:
    """Whether the user can mend it: a faulty file, an unknown name, a folder that cannot be written."""
    from gauss_bench.bench.journal import Busy
    from gauss_bench.mechanism.errors import LinkageError
    from gauss_bench.simulation import ChoiceError

    named = isinstance(error, KeyError) and "unknown engine" in str(error)
    return named or isinstance(error, (LinkageError, ChoiceError, Busy, OSError))


def parser() -> argparse.ArgumentParser:
    """All verbs with their options."""
    top = argparse.ArgumentParser(
        prog="gauss-bench", description="Validation and benchmarking of closed-loop planar linkage dynamics."
    )
    top.add_argument("--version", action="version", version=f"gauss-bench {__version__}")
    verbs = top.add_subparsers(title="verbs", required=True, metavar="VERB")

    def verb(name: str, run: Any, help: str) -> argparse.ArgumentParser:
        added = verbs.add_parser(name, help=help, description=help)
        added.set_defaults(verb=run)
        return added

    one = verb("list", list_all, "linkages, engines, integrators and settings")
    one.add_argument("--json", action="store_true")

    one = verb("show", show, "check a linkage file and say what it describes")
    one.add_argument("linkage", metavar="FILE-OR-NAME")
    one.add_argument("--scenario")
    one.add_argument("--svg", type=Path, metavar="FILE", help="draw the linkage, with the paths of its observed points")
    one.add_argument("--json", action="store_true")

    one = verb("simulate", simulate, "run one linkage in one engine")
    one.add_argument("linkage", metavar="FILE-OR-NAME")
    one.add_argument("--engine", default="gauss")
    one.add_argument("--scenario", help="default: the first with a start")
    one.add_argument("--settings", help="of the engine: default, tuned, ...")
    one.add_argument("--integrator", help="of the engine; its first by default")
    one.add_argument("--stabilization", choices=("none", "baumgarte", "projection"), default="none")
    one.add_argument("--dt", type=float, default=1e-3, metavar="H", help="step in seconds (default 0.001)")
    one.add_argument("--at", type=times, metavar="T1,T2,...", help="times to report (default: 0 and the duration)")
    one.add_argument("--json", action="store_true")

    one = verb("kinematics", kinematics, "move one linkage through a law, without forces")
    one.add_argument("linkage", metavar="FILE-OR-NAME")
    one.add_argument("--scenario", help="a driven one (default: the first)")
    one.add_argument("--driver", metavar="LAW", help="constant, sine, cosine, poly345 or table, as LAW or LAW:key=value,...")
    one.add_argument("--steps", type=int, default=360, metavar="N", help="equal parts of the duration (default 360)")
    one.add_argument(
        "--points", type=lambda text: text.split(","), metavar="LINK.POINT,...", help="default: those the file observes"
    )
    one.add_argument("--method", choices=("loop", "basic"), default="loop", help="link units, or point coordinates")
    one.add_argument("--plot", type=Path, metavar="SVG", help="paths, velocities and accelerations of the points")
    one.add_argument("--animate", type=Path, metavar="SVG", help="the linkage moving")
    form = one.add_mutually_exclusive_group()
    form.add_argument("--json", action="store_true")
    form.add_argument("--out", metavar="CSV", help="a table: to this file, or to stdout where it is 'csv'")

    one = verb("run", run, "run a suite and write its tables; finished cases are not repeated")
    suite_options(one)
    one.add_argument("--suite", choices=("quick", "full", "gate"), default="quick")
    one.add_argument("--scenario", help="of the linkages named (default: the first with a start)")
    one.add_argument("--no-costs", action="store_true", help="leave out the timing")
    one.add_argument("--out", type=Path, default=Path("reports"), metavar="DIR")

    one = verb("report", report, "write the pages from the tables of a run")
    one.add_argument("--out", type=Path, default=Path("reports"), metavar="DIR")

    one = verb("check", check, "hold the accuracy cases against the committed baseline")
    suite_options(one)
    one.add_argument("--baseline", type=Path, default=Path("reports/baseline.csv"), metavar="CSV")
    one.add_argument("--accept", metavar="REASON", help="write a new baseline, dated, with this reason")
    one.add_argument("--plant-inertia", type=float, metavar="FACTOR", help="scale the crank's inertia in every engine: must fail")
    return top


def suite_options(verb: argparse.ArgumentParser) -> None:
    verb.add_argument("linkages", nargs="*", metavar="FILE-OR-NAME", help="default: the four built-in ones")
    verb.add_argument("--engine", action="append", dest="engines", metavar="NAME", help="may be repeated; default: all")
    verb.add_argument("--jobs", type=int, default=2, metavar="N", help="worker processes (default 2)")
    verb.add_argument("--json", action="store_true")


def times(text: str) -> list[float]:
    """Argument of --at."""
    found = [float(x) for x in text.split(",")]
    if not all(math.isfinite(x) and x >= 0 for x in found):
        raise argparse.ArgumentTypeError("times must be numbers that are not negative")
    return found


def print_json(item: Any) -> None:
    """One object on stdout; what is not finite becomes null, because JSON has no word for it."""
    print(json.dumps(plain(item)))


def plain(item: Any) -> Any:
    """Arrays, numpy numbers and tuples as what JSON knows."""
    if hasattr(item, "tolist"):
        item = item.tolist()
    if isinstance(item, dict):
        return {str(k): plain(v) for k, v in item.items()}
    if isinstance(item, (list, tuple)):
        return [plain(v) for v in item]
    return None if isinstance(item, float) and not math.isfinite(item) else item


def list_all(options: argparse.Namespace) -> int:
    from gauss_bench import text

    found = text.catalogue()
    if options.json:
        print_json(found)
    else:
        print(text.format_catalogue(found))
    return 0


def show(options: argparse.Namespace) -> int:
    from gauss_bench import text
    from gauss_bench.mechanism.load import load

    first = load(options.linkage, options.scenario)
    others = [load(options.linkage, name) for name in first.scenarios if options.scenario is None and name != first.scenario]
    found = text.description(first, others)
    if options.svg:
        from gauss_bench.report.drawing import draw
        from gauss_bench.report.pose import posed
        from gauss_bench.results import write_text

        write_text(options.svg, draw(*posed(options.linkage)))
    if options.json:
        print_json(found)
    else:
        print(text.format_description(found))
    return 0


def simulate(options: argparse.Namespace) -> int:
    from gauss_bench import text
    from gauss_bench.simulation import simulate as simulated

    result = simulated(
        options.linkage,
        options.engine,
        options.scenario,
        options.settings,
        options.integrator,
        options.stabilization,
        options.dt,
        options.at,
    )
    if options.json:
        print_json(result)
    else:
        print(text.format_simulation(plain(result)))
    return 0 if result["status"] in ("ok", "skip") else 1


def kinematics(options: argparse.Namespace) -> int:
    from gauss_bench import motion, text

    asked = (options.scenario, options.driver, options.steps, options.points, options.method)
    result = motion.kinematics(options.linkage, *asked)
    pictures(options, result)
    if options.json:
        print_json(result)
    elif options.out:
        csv = motion.table(result).to_csv(index=False, lineterminator="\n")
        if options.out == "csv":
            print(csv, end="")
        else:
            from gauss_bench.results import write_text

            write_text(Path(options.out), csv)
    else:
        print(text.format_kinematics(plain(result)))
    if result["status"] != "ok":
        print(result["message"], file=sys.stderr)
    return 0 if result["status"] == "ok" else 1


def pictures(options: argparse.Namespace, result: dict[str, Any]) -> None:
    """Write the plot and the animation that were asked for."""
    from gauss_bench import motion
    from gauss_bench.report.animation import animate
    from gauss_bench.report.curves import curves
    from gauss_bench.results import write_text

    if not (options.plot or options.animate):
        return
    mechanism = motion.driven(options.linkage, options.scenario, options.driver)
    points, states = motion.observed(mechanism, options.points), motion.states(result)
    if options.plot:
        write_text(options.plot, curves(mechanism, states.t, states.q, states.v, states.a, points))
    if options.animate:
        write_text(options.animate, animate(mechanism, states.t, states.q, points))


def chosen_cases(options: argparse.Namespace, suite: str) -> list[Any]:
    """The cases of a suite, for the linkages and engines asked for.

    Raises:
        LinkageError, KeyError: a linkage or an engine that cannot be used; before anything is run.
    """
    from gauss_bench.bench.cases import SCENARIOS, SUITES
    from gauss_bench.engines import get
    from gauss_bench.mechanism.load import load

    asked = getattr(options, "scenario", None)
    linkages = {x: load(x, asked or SCENARIOS.get(x)).scenario for x in options.linkages} or None
    for name in options.engines or []:
        get(name)
    return SUITES[suite](linkages, options.engines)


def run(options: argparse.Namespace) -> int:
    from gauss_bench import text
    from gauss_bench.bench.runner import run as run_suite

    cases = chosen_cases(options, options.suite)
    rows = run_suite(cases, options.out, options.suite, options.jobs, not options.no_costs, driven=not options.linkages)
    if options.json:
        print_json(rows.to_dict("records"))
    else:
        print(text.format_run(rows, options.out))
    return 0


def report(options: argparse.Namespace) -> int:
    from gauss_bench.report.build import build_report

    for path in build_report(options.out):
        print(path)
    return 0


def check(options: argparse.Namespace) -> int:
    from functools import partial

    from gauss_bench import text
    from gauss_bench.bench import check as gate
    from gauss_bench.bench.measure import unaltered
    from gauss_bench.bench.runner import measure_all

    cases = chosen_cases(options, "gate")
    if not options.accept and not options.baseline.exists():
        print(f"error: {options.baseline}: no baseline there; write one with --accept REASON", file=sys.stderr)
        return BAD_INPUT
    alter = partial(gate.scaled_inertia, options.plant_inertia) if options.plant_inertia else unaltered
    rows, references = measure_all(cases, options.baseline.parent, options.jobs, alter)
    found = gate.facts(rows, references)
    if options.accept:
        print(f"{options.baseline}: {gate.accept(found, options.baseline, options.accept)} figures new or changed")
        return 0
    baseline = gate.restricted(gate.read_baseline(options.baseline), set(rows["mechanism"]), set(rows["engine"]))
    verdicts = gate.compare(found, baseline)
    failed = list(gate.failures(verdicts))
    if options.json:
        print_json({"passed": not failed, "verdicts": [vars(v) for v in verdicts]})
    else:
        print(text.format_check(verdicts))
    return 1 if failed else 0
