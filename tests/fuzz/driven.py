"""Lists of arguments, run through the command line's own function, many in one forked process: what each one ended with.

A process that dies takes nothing along but the list it was at: that is told, and the rest goes on in another process.
"""

import contextlib
import faulthandler
import io
import json
import os
import resource
import signal
import sys
import traceback
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from types import FrameType
from typing import Any

from gauss_bench import cli

LATE = 5.0  # [s] of processor time until a refusal must be there
WORKING, STUCK = 4.0, 120.0  # [s] of wall-clock time: what has begun its work is not waited for longer, nothing else sleeps so long
PATIENCE = 4.0  # more before a process that does not hear is ended
MEMORY = 1 << 30  # bytes beyond what the process has when it begins
DOCUMENTED = (0, 1, 2)
BAD_INPUT = 2
NOISE = ("Warning:", "LAPACK", "DLASCL", "parameter number", "Traceback", "leaked")


@dataclass(frozen=True)
class Ending:
    """How one list of arguments ended.

    Attributes:
        arguments: given.
        fault: what is wrong with it, or an empty text; at_work: it was doing what it was asked for when its time was over.
        code: exit code, None where there is none.
        seconds: of processor time.
        said: the end of what it wrote to stderr, or the place of the fault.
    """

    arguments: list[str]
    fault: str
    code: int | None
    seconds: float
    said: str
    at_work: bool = False


class Late(BaseException):
    """The time of one list is over."""


class Heard(io.StringIO):
    """What a verb tells people; with the first line that is neither a refusal nor a warning it has begun its work.

    From then on it is not waited for longer than WORKING seconds, where it may work at all.
    """

    def __init__(self, may_work: bool):
        super().__init__()
        self.may_work = may_work

    @property
    def begun(self) -> bool:
        return bool(self.lines_of_work(self.getvalue()))

    @staticmethod
    def lines_of_work(said: str) -> list[str]:
        """What neither refuses nor warns, nor goes on with what does."""
        found, refusing = list[str](), False
        for x in filter(None, said.splitlines()):
            refusing = x.startswith(("error:", "warning:", "usage:", "gauss-bench ")) or (refusing and x.startswith(" "))
            found += [] if refusing else [x]
        return found

    def write(self, text: str, /) -> int:
        before = self.begun
        count = super().write(text)
        if self.may_work and self.begun and not before and signal.getitimer(signal.ITIMER_REAL)[0] > WORKING:
            signal.setitimer(signal.ITIMER_REAL, WORKING)
        return count


def _late(number: int, frame: FrameType | None) -> None:
    raise Late


def run_one(arguments: list[str], late: float = LATE, may_work: bool = False) -> Ending:
    """One list in this process.

    `may_work`: what has told that it has begun its work may take as long as it takes, and is broken off. What is refused is refused
    in time, whatever it told before.
    """
    out, told = io.StringIO(), Heard(may_work)
    code: int | None = None
    fault, place = "", ""
    began = _processor_time()
    signal.signal(signal.SIGVTALRM, _late)
    signal.signal(signal.SIGALRM, _late)
    signal.setitimer(signal.ITIMER_REAL, STUCK)
    signal.setitimer(signal.ITIMER_VIRTUAL, late)
    signal.setitimer(signal.ITIMER_PROF, late + PATIENCE)  # ends the process where a library does not come back
    try:
        with contextlib.redirect_stdout(out), contextlib.redirect_stderr(told):
            code = cli.main(arguments)
    except SystemExit as end:
        code = end.code if isinstance(end.code, int) else BAD_INPUT
    except Late as error:
        place = _place(error)
        fault = "" if may_work and told.begun else f"still at it after {late:g} s" if told.begun else f"silent for {late:g} s"
    except BaseException as error:
        place = f"{type(error).__name__}: {str(error)[:300]} {_place(error)}"
        fault = "traceback"
    finally:
        for timer in (signal.ITIMER_REAL, signal.ITIMER_VIRTUAL):
            signal.setitimer(timer, 0)
        signal.setitimer(signal.ITIMER_PROF, 0)
    said = told.getvalue()
    if not fault and not place:
        fault = judged(code, said, out.getvalue())
    seconds = _processor_time() - began
    if not fault and code == BAD_INPUT and seconds > late:
        fault = f"refused after {late:g} s"
    return Ending(arguments, fault, code, seconds, place or said[-400:], bool(place) and not fault)


def _processor_time() -> float:
    """Seconds of this process and of those that it has started and seen end."""
    return sum(x.ru_utime + x.ru_stime for x in map(resource.getrusage, (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)))


def judged(code: int | None, said: str, out: str) -> str:
    """What is wrong with an ending, or an empty text."""
    if code not in DOCUMENTED:
        return f"exit code {code}"
    if code == BAD_INPUT and "error: " not in said:
        return "refused without a sentence"
    if any(x in said for x in NOISE):
        return "noise on stderr"
    if any(_is_control(x) for x in said + out):
        return "control characters"
    return ""


def _is_control(x: str) -> bool:
    return (
        (ord(x) < 32 and x not in "\n\t")
        or 127 <= ord(x) < 160
        or x in "\u2028\u2029\u202a\u202b\u202d\u202e\u2066\u2067\u2068\ufffe\uffff"
    )


def _place(error: BaseException) -> str:
    frames = [x for x in traceback.extract_tb(error.__traceback__) if "gauss_bench" in x.filename or "site-packages" in x.filename]
    own = [x for x in frames if "/gauss_bench/" in x.filename][-2:] + frames[-1:]
    return " < ".join(dict.fromkeys(f"{Path(x.filename).name}:{x.lineno} {x.name}" for x in reversed(own)))


def endings(
    lists: list[tuple[list[str], bool]], folder: Path, late: float = LATE, before: Callable[[int], None] = lambda i: None
) -> Iterator[Ending]:
    """What each list (with whether it `may_work`) ended with, in order; run in forked processes whose folder is `folder`."""
    at = 0
    while at < len(lists):
        read, write = os.pipe()
        parent = os.getpid()
        child = os.fork()
        if child == 0:
            os.close(read)
            _child(lists, at, folder, write, late, before, parent)
        os.close(write)
        with os.fdopen(read, encoding="utf-8") as pipe:
            for line in pipe:
                try:
                    yield Ending(**json.loads(line))
                except ValueError:
                    break  # it died while it wrote
                at += 1
        _, status = os.waitpid(child, 0)
        with contextlib.suppress(ProcessLookupError):
            os.killpg(child, signal.SIGKILL)  # what it may have left behind
        if at < len(lists) and status:
            arguments, _ = lists[at]
            how = f"signal {os.WTERMSIG(status)}" if os.WIFSIGNALED(status) else f"exit {os.WEXITSTATUS(status)}"
            late_end = os.WIFSIGNALED(status) and os.WTERMSIG(status) == signal.SIGPROF
            yield Ending(arguments, "deaf to its alarm" if late_end else f"the process died: {how}", None, float("nan"), "")
            at += 1


def _child(lists: Any, at: int, folder: Path, write: int, late: float, before: Callable[[int], None], parent: int) -> None:
    try:
        os.setsid()
        os.environ[cli.TRACE] = "1"
        os.chdir(folder)
        faulthandler.disable()
        nothing = os.open(os.devnull, os.O_RDWR)
        os.dup2(nothing, 0)
        noise = os.open(folder / "noise.txt", os.O_CREAT | os.O_RDWR | os.O_TRUNC)
        os.dup2(noise, 1)
        os.dup2(noise, 2)
        held = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
        resource.setrlimit(resource.RLIMIT_AS, (held + MEMORY, -1))
        with os.fdopen(write, "w", encoding="utf-8") as pipe:
            for i in range(at, len(lists)):
                if os.getppid() != parent:
                    os.killpg(0, signal.SIGKILL)  # nobody reads what follows
                before(i)
                size = os.fstat(noise).st_size
                found = vars(run_one(lists[i][0], late, lists[i][1])).copy()
                if not found["fault"] and os.fstat(noise).st_size > size:
                    found |= {
                        "fault": "noise of a library",
                        "said": (folder / "noise.txt").read_text(errors="replace")[size : size + 300],
                    }
                pipe.write(json.dumps(found) + "\n")
                pipe.flush()
                if found["at_work"]:
                    break  # what was broken off leaves threads and workers behind; the next list finds none of them
        os._exit(0)
    except BaseException:
        traceback.print_exc(file=sys.__stderr__)
        os._exit(99)
