"""Run lists of arguments through the command line's own function, each in a forked process, and judge how each ends."""

import contextlib
import faulthandler
import os
import resource
import signal
import sys
import time
import traceback
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

from gauss_bench import cli

LATE = 5.0  # [s] processor time until a refusal must be there
WORKING, STUCK = 4.0, 120.0  # [s] elapsed time after which a verb that works is stopped, and after which every verb is
MEMORY = 1 << 30  # bytes beyond the memory of the process when it begins
BAD_INPUT = 2
FAULT = 99  # exit code of a traceback
DOCUMENTED = (0, 1, BAD_INPUT)
NOISE = ("Warning:", "LAPACK", "DLASCL", "parameter number", "Traceback", "leaked")
SAID, PRINTED, LIBRARIES = "said.txt", "printed.txt", "noise.txt"  # stderr and stdout of the verb, and of libraries


@dataclass(frozen=True)
class Ending:
    """The end of one list of arguments.

    Attributes:
        arguments: the list.
        fault: what is wrong with the end, or an empty text.
        code: exit code; None if the process was stopped or died.
        seconds: processor time [s].
        said: the end of the verb's stderr.
        at_work: whether the verb was stopped while it did what it was asked for.
    """

    arguments: list[str]
    fault: str
    code: int | None
    seconds: float
    said: str
    at_work: bool = False


def endings(
    lists: list[tuple[list[str], bool]], folder: Path, late: float = LATE, before: Callable[[int], None] = lambda i: None
) -> Iterator[Ending]:
    """Yield the ending of each list, given with whether it may work for long; `before` prepares the folder for a list."""
    for i, (arguments, may_work) in enumerate(lists):
        before(i)
        yield run_list(arguments, folder, late, may_work)


def run_list(arguments: list[str], folder: Path, late: float = LATE, may_work: bool = False) -> Ending:
    """Run a list in a forked process in a folder; a verb that may work is stopped WORKING seconds after it began its work."""
    child = os.fork()
    if child == 0:
        _run_here(arguments, folder, late)
    begin, status, begun, used = time.monotonic(), None, False, None
    while status is None:
        time.sleep(0.002)
        done, ended, used = os.wait4(child, os.WNOHANG)
        begun = begun or (may_work and has_begun(_read(folder / SAID)))
        if done:
            status = ended
        elif time.monotonic() - begin > (WORKING if begun else STUCK):
            os.kill(child, signal.SIGKILL)
            _, _, used = os.wait4(child, 0)
            break
    with contextlib.suppress(ProcessLookupError):
        os.killpg(child, signal.SIGKILL)  # processes that the verb left behind
    assert used is not None
    seconds, said = used.ru_utime + used.ru_stime, _read(folder / SAID)
    code = os.waitstatus_to_exitcode(status) if status is not None else -signal.SIGKILL
    stopped = code in (-signal.SIGKILL, -signal.SIGXCPU)
    if stopped and may_work and (begun or has_begun(said)):
        return Ending(arguments, "", None, seconds, said[-400:], at_work=True)
    return Ending(arguments, find_fault(folder, code, seconds, late), None if code < 0 else code, seconds, said[-400:])


def find_fault(folder: Path, code: int, seconds: float, late: float) -> str:
    """Return what is wrong with an exit code (negative for a signal) and with what was written, or an empty text."""
    said, printed = _read(folder / SAID), _read(folder / PRINTED)
    if code in (-signal.SIGKILL, -signal.SIGXCPU):
        return f"silent for {late:g} s"
    if code < 0:
        return f"the process died: signal {-code}"
    if code not in DOCUMENTED:
        return "traceback" if code == FAULT else f"exit code {code}"
    if code == BAD_INPUT and "error: " not in said:
        return "refused without a sentence"
    if code == BAD_INPUT and seconds > late:
        return f"refused after {late:g} s"
    if any(x in said for x in NOISE):
        return "noise on stderr"
    if _read(folder / LIBRARIES):
        return "noise of a library"
    return "control characters" if any(_is_control(x) for x in said + printed) else ""


def has_begun(said: str) -> bool:
    """Tell whether a verb wrote a line that neither refuses nor warns, nor continues such a line."""
    refusing = False
    for x in filter(None, said.splitlines()):
        refusing = x.startswith(("error:", "warning:", "usage:", "gauss-bench ")) or (refusing and x.startswith(" "))
        if not refusing:
            return True
    return False


def _read(path: Path) -> str:
    return path.read_text(encoding="utf-8", errors="surrogateescape") if path.exists() else ""


def _is_control(x: str) -> bool:
    special = "\u2028\u2029\u202a\u202b\u202d\u202e\u2066\u2067\u2068\ufffe\uffff"
    return (ord(x) < 32 and x not in "\n\t") or 127 <= ord(x) < 160 or x in special


def _run_here(arguments: list[str], folder: Path, late: float) -> None:
    """Run a list in this process, which ends with the verb's exit code."""
    try:
        os.setsid()
        os.environ[cli.TRACE] = "1"
        os.chdir(folder)
        faulthandler.disable()
        os.dup2(os.open(os.devnull, os.O_RDWR), 0)
        noise = os.open(LIBRARIES, os.O_CREAT | os.O_RDWR | os.O_TRUNC)
        os.dup2(noise, 1)
        os.dup2(noise, 2)
        held = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
        resource.setrlimit(resource.RLIMIT_AS, (held + MEMORY, -1))
        used = resource.getrusage(resource.RUSAGE_SELF)
        seconds = int(used.ru_utime + used.ru_stime + late + 1)
        resource.setrlimit(resource.RLIMIT_CPU, (seconds, seconds + 5))
        options: dict[str, str] = {"encoding": "utf-8", "errors": "surrogateescape"}
        with open(SAID, "w", buffering=1, **options) as said, open(PRINTED, "w", **options) as printed:  # type: ignore[call-overload]
            with contextlib.redirect_stdout(printed), contextlib.redirect_stderr(said):
                try:
                    code = cli.main(arguments)
                except SystemExit as end:
                    code = end.code if isinstance(end.code, int) else BAD_INPUT
                except BaseException:
                    traceback.print_exc()
                    code = FAULT
            said.flush()
    except BaseException:
        traceback.print_exc(file=sys.__stderr__)
        code = FAULT
    os._exit(code)
