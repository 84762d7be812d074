"""Build the parser of the command line from `verbs.toml`; the functions behind the verbs are not imported here."""

import argparse
import math
import tomllib
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from gauss_bench import __version__
from gauss_bench.untrusted import harmless

MOST_JOBS = 512  # workers: each takes a quarter of a GiB
DESCRIPTION = "Validation and benchmarking of closed-loop planar linkage dynamics."
EXIT_CODES = (
    "Exit codes: 0 done, 1 an accuracy regression or a failed case, 2 bad usage or a faulty file, 70 a fault of gauss-bench "
    "itself, 74 stdout is closed or full, 130 interrupted."
)


def read_verbs() -> dict[str, dict[str, Any]]:
    """Return the verbs of `verbs.toml`; an option that is a text stands for the shared option of that name."""
    verbs: dict[str, dict[str, Any]] = tomllib.loads(Path(__file__).with_name("verbs.toml").read_text(encoding="utf-8"))
    shared = verbs.pop("shared")
    for verb in verbs.values():
        options = verb.get("options", {})
        options |= {names: shared[option] for names, option in options.items() if isinstance(option, str)}
    return verbs


VERBS = read_verbs()
Verb = Callable[[argparse.Namespace], int]


class Parser(argparse.ArgumentParser):
    """A parser that escapes control characters in its messages, which repeat what the user typed."""

    def _print_message(self, message: str, file: Any = None) -> None:
        super()._print_message(harmless(message), file)


def parser(actions: Mapping[str, Verb]) -> argparse.ArgumentParser:
    """Return the parser of all verbs; `actions` maps the name of a verb to its function."""
    top = Parser(prog="gauss-bench", description=DESCRIPTION, epilog=EXIT_CODES)
    top.add_argument("--version", action="version", version=f"gauss-bench {__version__}")
    verbs = top.add_subparsers(title="verbs", required=True, metavar="VERB")
    for name, verb in VERBS.items():
        added = verbs.add_parser(name, help=verb["help"], description=verb["help"])
        added.set_defaults(verb=actions[name])
        add_options(added, verb)
    return top


def add_options(parser: argparse.ArgumentParser, verb: Mapping[str, Any]) -> None:
    """Add the options of a verb of VERBS to a parser."""
    has_json = verb.get("json", True)
    alternatives = parser.add_mutually_exclusive_group() if has_json else parser
    for names, option in verb.get("options", {}).items():
        given = {key: value for key, value in option.items() if key != "flag"}
        if "type" in given:
            given["type"] = TYPES[given["type"]]
        if "flag" in option:
            given["action"] = "store_true"
        group = alternatives if names == verb.get("instead_of_json") else parser
        group.add_argument(*names.split(", "), **given)
    if has_json:
        alternatives.add_argument(
            "--json", action="store_true", help="print one JSON object; `gauss-bench list --schema VERB` prints its schema"
        )


def jobs(text: str) -> int:
    """Parse a number of workers."""
    if not text.isdecimal() or not 1 <= int(text) <= MOST_JOBS:
        raise argparse.ArgumentTypeError(f"{text[:40]!r} is no number of workers from 1 to {MOST_JOBS}")
    return int(text)


def numbers(text: str) -> list[float]:
    """Parse numbers separated by commas."""
    try:
        return [float(x) for x in text.split(",")]
    except ValueError as error:
        raise argparse.ArgumentTypeError(f"{text[:40]!r} is not a list of numbers with commas between them") from error


def numbers_that(hold: Callable[[float], bool], said: str) -> Callable[[str], list[float]]:
    """Return a parser of finite numbers separated by commas that all satisfy `hold`; else its error is `said`."""

    def read(text: str) -> list[float]:
        if not all(math.isfinite(x) and hold(x) for x in numbers(text)):
            raise argparse.ArgumentTypeError(said)
        return numbers(text)

    return read


def names(text: str) -> list[str]:
    """Parse names separated by commas."""
    return text.split(",")


TYPES: dict[str, Callable[[str], Any]] = {
    "float": float,
    "int": int,
    "path": Path,
    "jobs": jobs,
    "times": numbers_that(lambda x: x >= 0, "times must be numbers that are not negative"),
    "steps": numbers_that(lambda x: x > 0, "steps must be positive numbers"),
    "names": names,
}
