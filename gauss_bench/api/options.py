"""The command line's options: every verb, what it takes, and nothing of what it does."""

import argparse
import math
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from gauss_bench import __version__
from gauss_bench.linkage.limits import harmless

LOCAL = Path("reports/local")  # what a user runs; beside it lies what is published
MOST_JOBS = 512  # workers: each takes a quarter of a GiB
DESCRIPTION = "Validation and benchmarking of closed-loop planar linkage dynamics."
EXIT_CODES = (
    "Exit codes: 0 done, 1 an accuracy regression or a failed case, 2 bad usage or a faulty file, 70 a fault of gauss-bench "
    "itself, 74 stdout is closed or full, 130 interrupted."
)
Verb = Callable[[argparse.Namespace], int]


class Parser(argparse.ArgumentParser):
    """A parser whose sentences are harmless, whatever was typed."""

    def _print_message(self, message: str, file: Any = None) -> None:
        super()._print_message(harmless(message), file)


def parser(actions: Mapping[str, Verb]) -> argparse.ArgumentParser:
    """All verbs with their options; `actions` maps the name of a verb to what it does."""
    top = Parser(prog="gauss-bench", description=DESCRIPTION, epilog=EXIT_CODES)
    top.add_argument("--version", action="version", version=f"gauss-bench {__version__}")
    verbs = top.add_subparsers(title="verbs", required=True, metavar="VERB")
    for name, (help, options) in VERBS.items():
        verb = verbs.add_parser(name, help=help, description=help)
        verb.set_defaults(verb=actions[name])
        options(verb)
    return top


def _list(verb: argparse.ArgumentParser) -> None:
    verb.add_argument("--json", action="store_true")


def _doctor(verb: argparse.ArgumentParser) -> None:
    verb.add_argument("--json", action="store_true")


def _conformance(verb: argparse.ArgumentParser) -> None:
    verb.add_argument("engine", metavar="NAME|MODULE:CLASS", help="an engine, or the class of an adapter that is not installed yet")
    verb.add_argument("--json", action="store_true")


def _show(verb: argparse.ArgumentParser) -> None:
    verb.add_argument("linkage", metavar="FILE-OR-NAME")
    verb.add_argument("--scenario")
    verb.add_argument("--svg", type=Path, metavar="FILE", help="draw the linkage, with the paths of its observed points")
    verb.add_argument("--replace", action="store_true", help="write over FILE if it is there already")
    verb.add_argument("--json", action="store_true")


def _simulate(verb: argparse.ArgumentParser) -> None:
    verb.add_argument("linkage", metavar="FILE-OR-NAME")
    verb.add_argument("--engine", default="gauss")
    verb.add_argument("--scenario", help="default: the first with a start")
    verb.add_argument("--settings", metavar="NAME,KEY=VALUE,...", help="of the engine: a name, its own options, or both")
    verb.add_argument("--integrator", help="of the engine; its first by default")
    verb.add_argument("--stabilization", choices=("none", "baumgarte", "projection"), default="none")
    verb.add_argument("--step", "--dt", type=float, default=1e-3, metavar="H", help="in seconds (default 0.001); formerly --dt")
    verb.add_argument("--at", type=_times, metavar="T1,T2,...", help="times to report (default: 0 and the duration)")
    verb.add_argument("--budget", type=float, default=600.0, metavar="S", help="seconds until an engine is stopped (default 600)")
    verb.add_argument("--plot", type=Path, metavar="FILE", help="observed points, energies, forces over time: .svg or .png")
    verb.add_argument("--animate", type=Path, metavar="FILE", help="the linkage moving: .svg, .gif, or .html with all curves")
    verb.add_argument("--out", type=Path, metavar="FILE", help="all samples, with units: .csv")
    verb.add_argument("--replace", action="store_true", help="write over files that are there already")
    verb.add_argument("--json", action="store_true")


def _diagnose(verb: argparse.ArgumentParser) -> None:
    verb.add_argument("linkage", metavar="FILE-OR-NAME")
    verb.add_argument("--engine", required=True, metavar="NAME")
    verb.add_argument("--scenario", help="default: the first with a start")
    verb.add_argument("--settings", help="of the engine: default, tuned, ...")
    verb.add_argument("--integrator", help="of the engine; its first by default")
    verb.add_argument("--stabilization", choices=("none", "baumgarte", "projection"), default="none")
    verb.add_argument("--step", "--dt", type=float, default=1e-3, metavar="H", help="in seconds (default 0.001)")
    verb.add_argument(
        "--until", type=float, metavar="T", help="seconds (default: 1, or the scenario's duration where it is shorter)"
    )
    verb.add_argument("--budget", type=float, metavar="S", help="seconds for everything (default 120)")
    verb.add_argument("--json", action="store_true")


def _selftest(verb: argparse.ArgumentParser) -> None:
    verb.add_argument(
        "--only", action="append", default=[], metavar="KIND", help="models, formulations, metrics, ...; may be repeated"
    )
    verb.add_argument("--json", action="store_true")


def _kinematics(verb: argparse.ArgumentParser) -> None:
    verb.add_argument("linkage", metavar="FILE-OR-NAME")
    verb.add_argument("--scenario", help="a driven one (default: the first)")
    verb.add_argument("--driver", metavar="LAW", help="constant, sine, cosine, poly345 or table, as LAW or LAW:key=value,...")
    verb.add_argument(
        "--hold", action="append", metavar="NAME[=VALUE]", help="a link, slide or pin that is not to move, at degrees or metres"
    )
    verb.add_argument(
        "--intervals",
        "--steps",
        type=int,
        default=360,
        metavar="N",
        help="equal parts of the duration (default 360), formerly --steps",
    )
    verb.add_argument(
        "--points", type=lambda text: text.split(","), metavar="LINK.POINT,...", help="default: those the file observes"
    )
    verb.add_argument("--method", choices=("loop", "basic", "native"), default="loop", help="link units, points, or compiled loops")
    verb.add_argument("--plot", type=Path, metavar="SVG", help="paths, velocities and accelerations of the points")
    verb.add_argument("--animate", type=Path, metavar="SVG", help="the linkage moving")
    verb.add_argument("--replace", action="store_true", help="write over files that are there already")
    form = verb.add_mutually_exclusive_group()
    form.add_argument("--json", action="store_true")
    form.add_argument("--out", type=Path, metavar="CSV", help="a table: to this file, or to stdout where it is 'csv'")


def _recommend(verb: argparse.ArgumentParser) -> None:
    verb.add_argument("linkage", metavar="FILE-OR-NAME")
    verb.add_argument("--position", type=float, metavar="E", help="largest error of a link's centre of mass, in m")
    verb.add_argument("--angle", type=float, metavar="E", help="of a link's angle, in rad")
    verb.add_argument("--force", type=float, metavar="E", help="of a joint's force, in N")
    verb.add_argument("--until", type=float, metavar="T", help="seconds (default: the scenario's duration)")
    verb.add_argument("--scenario", help="default: the first with a start")
    verb.add_argument("--engine", action="append", dest="engines", metavar="NAME,...", help="may be repeated; default: all")
    verb.add_argument("--settings", metavar="NAME,KEY=VALUE,...", help="of the only engine: which step holds with them")
    verb.add_argument("--budget", type=float, metavar="S", help="wall-clock seconds that it may take (default 60)")
    verb.add_argument("--out", type=Path, metavar="FOLDER", help="write a program for each engine that holds it: ENGINE.py")
    verb.add_argument("--replace", action="store_true", help="write over programs that are there already")
    verb.add_argument("--json", action="store_true")


def _export(verb: argparse.ArgumentParser) -> None:
    verb.add_argument("linkage", metavar="FILE-OR-NAME")
    verb.add_argument("--engine", required=True, metavar="KIND", help="mujoco (MJCF), pinocchio, exudyn, casadi (Python), or c")
    verb.add_argument("--out", required=True, type=Path, metavar="FILE", help="to write")
    verb.add_argument("--replace", action="store_true", help="write over FILE if it is there already")
    verb.add_argument("--scenario", help="default: the first with a start")
    verb.add_argument("--tuned", action="store_true", help="find the largest step that holds, and say what was measured")
    verb.add_argument("--step", type=float, metavar="H", help="of the file's integration, in seconds (default 0.001)")
    verb.add_argument("--budget", type=float, metavar="S", help="seconds to look for a step with --tuned (default 60)")
    verb.add_argument("--json", action="store_true")


def _import(verb: argparse.ArgumentParser) -> None:
    verb.add_argument("model", metavar="FILE", help="MJCF (read by MuJoCo's compiler) or URDF, planar")
    verb.add_argument("--out", required=True, type=Path, metavar="NAME.toml", help="the linkage file to write")
    verb.add_argument("--replace", action="store_true", help="write over NAME.toml if it is there already")
    verb.add_argument(
        "--close", action="append", default=[], metavar="LINK.FRAME=LINK.FRAME", help="join two frames of a URDF; may be repeated"
    )
    verb.add_argument("--json", action="store_true")


def _sweep(verb: argparse.ArgumentParser) -> None:
    verb.add_argument("linkage", metavar="FILE-OR-NAME")
    verb.add_argument(
        "--vary",
        action="append",
        required=True,
        metavar="PATH=VALUES",
        help="a number of the file, or links.NAME.length, as a:b:n, uniform(a,b) or normal(mean,deviation); may be repeated",
    )
    verb.add_argument("--out", required=True, type=Path, metavar="FOLDER", help="where rows go; the same sweep goes on there")
    verb.add_argument("--samples", type=int, metavar="N", help="how many; of grids alone their product")
    verb.add_argument("--sampling", choices=("random", "sobol"), default="random", help="of what is no grid (default random)")
    verb.add_argument("--seed", type=int, default=0, metavar="N", help="of what is random (default 0)")
    verb.add_argument(
        "--engine", action="append", dest="engines", metavar="NAME,...", help="may be repeated; default: gauss-native"
    )
    verb.add_argument("--scenario", help="default: the first with a start")
    verb.add_argument("--settings", metavar="NAME,KEY=VALUE,...", help="of the engines")
    verb.add_argument("--integrator", help="of the engines; default: dop853_fixed of native code, else their first")
    verb.add_argument("--stabilization", choices=("none", "baumgarte", "projection"), default="none")
    verb.add_argument(
        "--step", type=float, metavar="H", help="in seconds, at most (default 0.001; native code by dop853_fixed 0.002)"
    )
    verb.add_argument("--until", type=float, metavar="T", help="seconds (default: the scenario's duration)")
    verb.add_argument("--budget", type=float, metavar="S", help="seconds that one sample may take in a worker (default 60)")
    verb.add_argument("--backend", choices=("local", "dask"), default="local", help="who runs batches (default local)")
    verb.add_argument(
        "--scheduler", metavar="ADDRESS", help="of a Dask cluster, such as tcp://HOST:8786; default: one of this machine"
    )
    verb.add_argument(
        "--jobs", type=_jobs, default=2, metavar="N", help="batches at once (default 2); a cluster has its own number"
    )
    verb.add_argument("--json", action="store_true")


def _studio(verb: argparse.ArgumentParser) -> None:
    verb.add_argument("linkage", nargs="?", metavar="FILE-OR-NAME", help="what to open (default: an empty drawing)")
    verb.add_argument("--port", type=int, default=0, metavar="N", help="of the page on this machine (default: a free one)")
    verb.add_argument("--no-browser", action="store_true", help="print the address and open nothing")


def _certify(verb: argparse.ArgumentParser) -> None:
    verb.add_argument("linkage", nargs="?", metavar="FILE-OR-NAME")
    verb.add_argument("--scenario", help="default: the first with a start")
    verb.add_argument("--digits", type=int, default=12, metavar="D", help="of positions and velocities to vouch for (default 12)")
    verb.add_argument("--until", type=float, metavar="T", help="seconds, instead of the scenario's duration")
    verb.add_argument("--out", type=Path, metavar="FILE", help="where to write the certificate (.npz); else it is only described")
    verb.add_argument("--built-in", action="store_true", help="every scenario of every built-in linkage, in place")
    verb.add_argument("--jobs", type=_jobs, default=2, metavar="N", help="worker processes for --built-in (default 2)")
    verb.add_argument("--json", action="store_true")


def _verify(verb: argparse.ArgumentParser) -> None:
    verb.add_argument("certificates", nargs="*", type=Path, metavar="FILE", help="default: those of the built-in linkages")
    verb.add_argument("--linkage", metavar="FILE-OR-NAME", help="default: the one beside the certificate's folder, or built-in")
    verb.add_argument("--jobs", type=_jobs, default=2, metavar="N", help="worker processes (default 2)")
    verb.add_argument("--json", action="store_true")


def _atlas(verb: argparse.ArgumentParser) -> None:
    verb.add_argument("--engine", action="append", dest="engines", metavar="NAME", help="may be repeated; default: all")
    axes = "singular, redundancy, mass, stiffness, speed, step or size; may be repeated (default: all)"
    verb.add_argument("--axis", action="append", dest="axes", metavar="NAME", help=axes)
    verb.add_argument("--budget", type=float, metavar="S", help="seconds in all (default 600); what they do not reach stays open")
    verb.add_argument("--jobs", type=_jobs, default=2, metavar="N", help="worker processes (default 2)")
    verb.add_argument("--out", type=Path, metavar="DIR", help="write atlas.csv, atlas.svg and index.html there")
    verb.add_argument("--into", type=Path, metavar="DIR", help="write the table alone into the folder of a run, for its report")
    verb.add_argument("--json", action="store_true")


def _run(verb: argparse.ArgumentParser) -> None:
    _suite(verb)
    verb.add_argument("--suite", action="append", metavar="NAME", help="a suite's name or .toml file; may be given again (quick)")
    verb.add_argument("--report", action="store_true", help="write the pages too")
    verb.add_argument("--scenario", help="of the linkages named (default: the first with a start)")
    verb.add_argument("--until", type=float, metavar="T", help="seconds (default: the suite's for its own, else the scenario's)")
    verb.add_argument("--steps", type=_steps, metavar="H1,H2,...", help="in seconds, instead of the suite's")
    verb.add_argument("--budget", type=float, metavar="S", help="seconds that one case may take (default 120)")
    verb.add_argument("--no-costs", action="store_true", help="leave out the timing")
    verb.add_argument("--out", type=Path, default=LOCAL, metavar="DIR", help=f"where the tables go ({LOCAL})")
    verb.add_argument("--against", type=Path, metavar="DIR", help="tell what differs from the run there")


def _report(verb: argparse.ArgumentParser) -> None:
    verb.add_argument("--out", type=Path, default=LOCAL, metavar="DIR", help=f"the folder of the run ({LOCAL})")
    told = "write no pages, but say as Markdown what the run found otherwise than the one there, of this or an earlier format"
    verb.add_argument("--against", type=Path, metavar="DIR", help=told)
    verb.add_argument("--publish", action="store_true", help="refuse a run that may not be published: of changed code, or unnamed")
    verb.add_argument("--json", action="store_true")


def _check(verb: argparse.ArgumentParser) -> None:
    _suite(verb)
    verb.add_argument("--baseline", type=Path, default=Path("reports/baseline.csv"), metavar="CSV")
    verb.add_argument("--accept", metavar="REASON", help="write a new baseline, dated, with this reason")
    verb.add_argument("--plant-inertia", type=float, metavar="FACTOR", help="scale the crank's inertia in every engine: must fail")


def _suite(verb: argparse.ArgumentParser) -> None:
    verb.add_argument("linkages", nargs="*", metavar="FILE-OR-NAME", help="default: the four built-in ones")
    verb.add_argument("--engine", action="append", dest="engines", metavar="NAME", help="may be repeated; default: all")
    verb.add_argument("--jobs", type=_jobs, default=2, metavar="N", help="worker processes (default 2)")
    verb.add_argument("--json", action="store_true")


def _jobs(text: str) -> int:
    """Argument of --jobs."""
    if not text.isdecimal() or not 1 <= int(text) <= MOST_JOBS:
        raise argparse.ArgumentTypeError(f"{text[:40]!r} is no number of workers from 1 to {MOST_JOBS}")
    return int(text)


def _numbers(text: str) -> list[float]:
    """Numbers between commas."""
    try:
        return [float(x) for x in text.split(",")]
    except ValueError as error:
        raise argparse.ArgumentTypeError(f"{text[:40]!r} is not a list of numbers with commas between them") from error


def _times(text: str) -> list[float]:
    """Argument of --at."""
    times = _numbers(text)
    if not all(math.isfinite(x) and x >= 0 for x in times):
        raise argparse.ArgumentTypeError("times must be numbers that are not negative")
    return times


def _steps(text: str) -> list[float]:
    """Argument of --steps of run."""
    steps = _numbers(text)
    if not all(math.isfinite(x) and x > 0 for x in steps):
        raise argparse.ArgumentTypeError("steps must be positive numbers")
    return steps


VERBS: dict[str, tuple[str, Callable[[argparse.ArgumentParser], None]]] = {
    "list": ("linkages, engines, integrators and settings", _list),
    "doctor": ("what this machine has, and whether each engine runs on it", _doctor),
    "conformance": ("whether an engine's adapter keeps to what engines must", _conformance),
    "show": ("check a linkage file and say what it describes", _show),
    "simulate": ("run one linkage in one engine", _simulate),
    "diagnose": ("split an engine's error by its causes, and name the one that dominates", _diagnose),
    "kinematics": ("move one linkage through a law, without forces", _kinematics),
    "recommend": ("find the cheapest setting of each engine that holds an accuracy on one linkage", _recommend),
    "sweep": (
        "run one linkage with many different numbers: grids, tolerances, sensitivities; rows are judged by loops and energy",
        _sweep,
    ),
    "studio": ("draw a linkage in the browser, drag it, watch its curves and save its file", _studio),
    "export": ("write one linkage as a model, script or program that runs without this package", _export),
    "import": ("make a linkage file of a planar model in MJCF or URDF", _import),
    "certify": ("compute a motion with its own error bar, and how many digits can be vouched for", _certify),
    "verify": ("check certificates in double precision", _verify),
    "atlas": ("find how far each engine goes: near singular positions, fast, stiff, uneven, redundant, large", _atlas),
    "run": ("run a suite and write its tables; finished cases are not repeated", _run),
    "report": ("write the pages from the tables of a run", _report),
    "check": ("hold the accuracy cases against the committed baseline", _check),
    "selftest": ("plant known faults in the suite and show that each is seen", _selftest),
}
