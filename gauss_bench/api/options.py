"""Build the parser of the command line from `verbs.toml`, without importing the functions that carry out the subcommands.

A verb is a subcommand, such as `run` in `gauss-bench run`.
"""

import argparse
import math
import tomllib
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from gauss_bench import __version__
from gauss_bench.untrusted import harmless

MOST_JOBS = 512  # largest number of workers, each of which takes a quarter of a GiB of memory
DESCRIPTION = "Validation and benchmarking of closed-loop planar linkage dynamics."
EXIT_CODES = (
    "Exit codes: 0 done, 1 an accuracy regression or a failed case, 2 bad usage or a faulty file, 70 a fault of gauss-bench "
    "itself, 74 stdout is closed or full, 130 interrupted."
)


def read_verbs() -> dict[str, dict[str, Any]]:
    """Return name of a subcommand -> its table in `verbs.toml`.

    If an option of a subcommand is only the name of a shared option, the table of the shared option replaces the name.
    """
    verbs: dict[str, dict[str, Any]] = tomllib.loads(Path(__file__).with_name("verbs.toml").read_text(encoding="utf-8"))
    shared = verbs.pop("shared")
    for verb in verbs.values():
        options = verb.get("options", {})
        options |= {names: shared[option] for names, option in options.items() if isinstance(option, str)}
    return verbs


VERBS = read_verbs()
Verb = Callable[[argparse.Namespace], int]


class Parser(argparse.ArgumentParser):
    """A parser that escapes control characters in its messages, because messages repeat the user's input."""

    def _print_message(self, message: str, file: Any = None) -> None:
        super()._print_message(harmless(message), file)


def parser(actions: Mapping[str, Verb]) -> argparse.ArgumentParser:
    """Return the parser of all subcommands; `actions` is name of a subcommand -> function that carries it out."""
    top = Parser(prog="gauss-bench", description=DESCRIPTION, epilog=EXIT_CODES)
    top.add_argument("--version", action="version", version=f"gauss-bench {__version__}")
    verbs = top.add_subparsers(title="verbs", required=True, metavar="VERB")
    for name, verb in VERBS.items():
        added = verbs.add_parser(name, help=verb["help"], description=verb["help"])
        added.set_defaults(verb=actions[name])
        add_options(added, verb)
    return top


def add_options(parser: argparse.ArgumentParser, verb: Mapping[str, Any]) -> None:
    """Add the options of a subcommand to its parser; `verb` is the subcommand's table in VERBS."""
    has_json = verb.get("json", True)
    alternatives = parser.add_mutually_exclusive_group() if has_json else parser
    for names, option in verb.get("options", {}).items():
        arguments = {key: value for key, value in option.items() if key != "flag"}
        if "type" in arguments:
            arguments["type"] = TYPES[arguments["type"]]
        if "flag" in option:
            arguments["action"] = "store_true"
        group = alternatives if names == verb.get("instead_of_json") else parser
        group.add_argument(*names.split(", "), **arguments)
    if has_json:
        alternatives.add_argument(
            "--json", action="store_true", help="print one JSON object; `gauss-bench list --schema VERB` prints its schema"
        )


def jobs(text: str) -> int:
    """Return the number of workers, from 1 to MOST_JOBS, in the text of an option."""
    if not text.isdecimal() or not 1 <= int(text) <= MOST_JOBS:
        raise argparse.ArgumentTypeError(f"{text[:40]!r} is no number of workers from 1 to {MOST_JOBS}")
    return int(text)


def numbers(text: str) -> list[float]:
    """Return the numbers in a text such as "0.1,0.2", in which commas separate them."""
    try:
        return [float(x) for x in text.split(",")]
    except ValueError as error:
        raise argparse.ArgumentTypeError(f"{text[:40]!r} is not a list of numbers with commas between them") from error


def steps(text: str) -> list[float]:
    """Return the numbers in a comma-separated text; each must be finite and positive."""
    values = numbers(text)
    if not all(math.isfinite(x) and x > 0 for x in values):
        raise argparse.ArgumentTypeError("steps must be positive numbers")
    return values


TYPES: dict[str, Callable[[str], Any]] = {
    "float": float,
    "int": int,
    "path": Path,
    "jobs": jobs,
    "numbers": numbers,
    "steps": steps,
    "names": lambda text: text.split(","),
}
