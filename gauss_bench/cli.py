"""The command line: run a verb (subcommand), print results on stdout and all else on stderr, and return the exit code.

Exit codes: 0 done, 1 an accuracy regression or a failed case, 2 bad usage or bad input, 70 a fault of this program itself, 74
stdout is closed or full, 130 interrupted.
"""

import argparse
import contextlib
import inspect
import io
import json
import os
import resource
import sys
import traceback
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from pkgutil import resolve_name

from gauss_bench.api.options import VERBS, Verb, parser
from gauss_bench.api.telling import cancel_sentences, plain, render, tell, tell_if_long
from gauss_bench.untrusted import BadInput, harmless

BAD_INPUT, OWN_FAULT, NO_OUTPUT, INTERRUPTED = 2, 70, 74, 130  # exit codes; 70 and 74 as in sysexits.h, 130 as shells have it
EPOCH, LONGEST_EPOCH = "SOURCE_DATE_EPOCH", 12  # libraries write this variable, a time [s], into files; largest number of digits
LEAST_MEMORY = 700 << 20  # bytes of address space: with less, the import of OpenBLAS may hang
SHOWN = 40  # characters of a faulty argument that a message quotes
FILES = "gauss_bench.api.files:check_files"
TRACE = "GAUSS_BENCH_TRACEBACK"  # environment variable: if set, a fault of the program shows its traceback


class OutputLost(Exception):
    """Results cannot be written: stdout is closed or full."""


class Results(io.TextIOWrapper):
    """The stream stdout. A failed write raises OutputLost, because an OSError would be reported as that of an input file.

    Raises:
        OutputLost: from write and flush.
    """

    def write(self, text: str) -> int:
        """Write a text."""
        try:
            return super().write(text)
        except OSError as error:
            raise OutputLost(error.strerror) from error

    def flush(self) -> None:
        """Flush the stream."""
        try:
            super().flush()
        except OSError as error:
            raise OutputLost(error.strerror) from error


class Remarks(io.TextIOWrapper):
    """The stream stderr; if it is full or closed, remarks are lost without an error and the command keeps its exit code."""

    def write(self, text: str) -> int:
        """Write a text and return its length, even if writing fails."""
        with contextlib.suppress(OSError):
            return super().write(text)
        return len(text)

    def flush(self) -> None:
        """Flush, and ignore a failure."""
        with contextlib.suppress(OSError):
            super().flush()


def command() -> int:
    """Run `gauss-bench` and return the exit code; output that libraries print to stdout is sent to stderr."""
    if sys.stderr is None:  # the caller closed it
        sys.stderr = open(os.devnull, "w")
    # Unbuffered: otherwise Python flushes a failed write again at exit, and the exit code becomes 120.
    unbuffered = os.fdopen(sys.stderr.fileno(), "wb", buffering=0, closefd=False)
    sys.stderr = Remarks(unbuffered, encoding=sys.stderr.encoding, errors="backslashreplace", write_through=True)
    if sys.stdout is None:
        print("error: stdout is closed: results cannot be written", file=sys.stderr)
        return NO_OUTPUT
    # keep the real stdout under a new descriptor, and redirect descriptor 1, to which libraries print, to stderr
    results = os.dup(sys.stdout.fileno())
    with contextlib.suppress(OSError):  # stderr is closed
        os.dup2(2, 1)
    sys.stdout = Results(os.fdopen(results, "wb"), encoding=sys.stdout.encoding, errors="backslashreplace")
    try:
        try:
            return main()
        except SystemExit as end:  # raised by the parser after --help or bad usage
            return int(end.code or 0)
        finally:
            sys.stdout.flush()
    except OutputLost as error:
        return report_lost_output(error)


def report_lost_output(error: OutputLost) -> int:
    """Report that results were lost and return the exit code; stdout is redirected, so that Python does not write again at exit."""
    print(f"error: stdout: {error}: results are lost", file=sys.stderr)
    with contextlib.suppress(OSError, ValueError):
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    return NO_OUTPUT


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the verb that `arguments` (by default those of the process) name, and return the exit code."""
    given = sys.argv[1:] if arguments is None else list(arguments)
    try:
        check_start(given)
        options = parser(ACTIONS).parse_args(given)
        check_memory()  # after the parser, so that --help works with less memory
        return int(options.verb(options))
    except KeyboardInterrupt:
        print("interrupted; finished cases are kept", file=sys.stderr)
        return INTERRUPTED
    except OutputLost as error:
        return report_lost_output(error)
    except MemoryError:
        print("error: there is not enough memory for this request", file=sys.stderr)
        return BAD_INPUT
    except (BadInput, OSError) as error:
        if isinstance(error, OSError) and error.filename is not None:
            message = f"{error.filename}: {error.strerror}"
        else:  # str() of a KeyError puts its message in quotes
            message = str(error.args[0] if isinstance(error, KeyError) else error)
        print(harmless(f"error: {message}"), file=sys.stderr)
        return BAD_INPUT
    except Exception as error:
        if TRACE in os.environ:
            raise
        place = traceback.extract_tb(error.__traceback__)[-1]
        message = harmless(" ".join(str(error).split())[:500])
        fault = f"{type(error).__name__}: {message} ({Path(place.filename).name}:{place.lineno})"
        hint = f"set {TRACE}=1 to see the traceback"
        print(f"error: a fault of gauss-bench itself, not of its input: {fault}; {hint}", file=sys.stderr)
        return OWN_FAULT
    finally:
        cancel_sentences()


def check_start(arguments: Sequence[str]) -> None:
    """Check the arguments and the environment before they are parsed.

    Raises:
        BadInput: an argument cannot be the name of a file, or SOURCE_DATE_EPOCH is not a number of seconds.
    """
    for text in arguments:
        try:
            is_name = b"\0" not in os.fsencode(text)
        except UnicodeError:
            is_name = False
        if not is_name:
            raise BadInput(f"the argument {harmless(text[:SHOWN])!r} contains characters that no command line can have")
    epoch = os.environ.get(EPOCH, "0")
    if not (epoch.isascii() and epoch.isdecimal() and len(epoch) <= LONGEST_EPOCH):
        raise BadInput(f"{EPOCH}={harmless(epoch[:SHOWN])!r} in the environment: it must be a whole number of seconds")


def check_memory() -> None:
    """Check that the process may use the address space that the libraries need.

    Raises:
        BadInput: the memory limit is too low.
    """
    limit, _ = resource.getrlimit(resource.RLIMIT_AS)
    if limit != resource.RLIM_INFINITY and limit < LEAST_MEMORY:
        least = f"{LEAST_MEMORY >> 10} kB"
        raise BadInput(f"`ulimit -v` leaves {limit >> 10} kB of memory; the libraries need {least}")


def perform(name: str, options: argparse.Namespace) -> int:
    """Call the function of the verb `name`, print its answer and return the exit code; `verbs.toml` explains the keys of a verb."""
    verb, given = VERBS[name], vars(options)
    endings = verb.get("files", {})
    instead_of_json = verb.get("instead_of_json", "").lstrip("-")  # the only option with which a file may go to stdout
    to_stdout = {x: given[x] for x in endings if x == instead_of_json and str(given[x]) == verb.get("printed")}
    to_file = {x: given[x] for x in endings if given[x] and x not in to_stdout}
    files = to_stdout | (resolve_name(FILES)(to_file, endings, options.replace, options.linkage) if to_file else {})
    function = resolve_name(verb["call"])
    # arguments that are not options: `told` prints progress; `whole` asks for all samples, which a file needs
    available = given | {"options": options, "told": tell_if_long if verb.get("quick") else tell, "whole": bool(files)}
    answer = function(**{x: available[x] for x in inspect.signature(function).parameters if x in available})
    if files:
        resolve_name(verb["write"])(answer, files)
    for sentence in answer.notices:
        tell(sentence)
    if given.get("json"):
        if answer.data is not None:
            print(json.dumps(plain(answer.data)))
        return 0 if answer.succeeded else 1
    text = render(name, answer.data) if answer.text is None else answer.text
    if text and not files.get(instead_of_json):  # else the file replaces the text
        print(harmless(text))
    return 0 if answer.succeeded else 1


ACTIONS: dict[str, Verb] = {name: partial(perform, name) for name in VERBS}
