"""A worker process for code that may crash or hang: it calls functions and returns their results, or the reason for a failure.

Tasks are pickled for the worker. Answers are never unpickled, because a task may run foreign code: an answer is JSON, in which
each array is replaced by its type and shape, followed by the bytes of the arrays. Each task has a random token, with which its
answer must begin. The parent refuses another token and an answer larger than its caller expects, and decoded arrays never take more
memory than the bytes of the answer. The worker's standard output goes to its error stream, whose last line is quoted when it dies;
the pipe of the answers has a high file descriptor, out of the way of libraries. A worker runs under the interpreter of this
process, or under that of an engine's environment (`elsewhere.py`).

The parent stops a task that exceeds its limit; if the parent is gone, an alarm signal that no library can block does. The time
during which a task waits for a processor does not count, so that engines do not fail because the machine is busy.

When a worker ends, all processes that its tasks have started are ended. They are found by a mark, an environment variable that they
inherit, and on Linux also as descendants of the worker, which becomes the parent of orphaned processes. A process that has removed
the mark survives if the worker is killed before it can look for its descendants.
"""

import atexit
import contextlib
import ctypes
import fcntl
import json
import math
import os
import pickle
import resource
import select
import signal
import struct
import subprocess
import sys
import tempfile
import threading
import time
import traceback
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from gauss_bench.trajectory import Failure, Status, in_a_sentence

HEADER = struct.Struct("<16sQ")  # before each task and answer: token of the task, and number of bytes that follow
ANSWERS = 200  # least file descriptor of the pipes, far above those that libraries open
LARGEST = 1 << 26  # most bytes of an answer, by default
POLL = 0.5  # [s] between checks that the process is alive: its child may keep the pipe open
THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "VECLIB_MAXIMUM_THREADS")
BACKSTOP = 20.0  # a task is stopped after BACKSTOP times its limit even if it only waits for a processor
MEMORY = 6 << 30  # memory limit of a process [bytes]; engines need one or two GiB
ROUNDS = 100  # most attempts to find and end the processes of a worker
MARK = "GAUSS_BENCH_WORKER"  # environment variable of a worker, which the processes that it starts inherit
MOST_MEMORY = "GAUSS_BENCH_MEMORY"  # environment variable of a worker: bytes that it may use
SUBREAPER = 36  # PR_SET_CHILD_SUBREAPER of Linux's prctl
GRACE = 5.0  # [s] by which the worker's own alarm comes after the parent's limit
LENGTH = struct.Struct("<Q")  # at the beginning of an answer: number of bytes of its JSON
LONGEST = 1 << 26  # most bytes of JSON; its decoded objects need about 20 times as much memory
ARRAY = "array of numbers"  # key of a JSON object that stands for an array
MOST = 3  # most dimensions of an array
KINDS = {"f": np.dtype("<f8"), "i": np.dtype("<i8"), "b": np.dtype("|b1")}  # kind of numpy's types -> type in an answer


class NoAnswer(ValueError):
    """Raised if received bytes are not a valid answer, or if an object cannot be sent in an answer."""


class WorkerFailure(Failure):
    """Raised for a task without an answer."""


@dataclass(frozen=True)
class Interpreter:
    """The Python interpreter that runs a worker process: its path, and the memory limit [bytes] of each of its processes."""

    python: str = sys.executable
    memory: int = MEMORY

    @property
    def command(self) -> list[str]:
        """The command that starts a worker; under another interpreter, it can import only gauss_bench from this environment."""
        if self.python == sys.executable:
            return [self.python, "-m", "gauss_bench.runs.worker"]
        return [self.python, "-I", str(Path(__file__).with_name("elsewhere.py"))]


class Worker:
    """One worker process, which is started when it is first needed, and again after it has died."""

    def __init__(self) -> None:
        self.process: subprocess.Popen[bytes] | None = None
        self.interpreter = Interpreter()
        # the mark of a worker within a worker begins with that of the outer one, so that both end together
        self.mark = "/".join(filter(None, (os.environ.get(MARK), os.urandom(16).hex())))
        self.log = tempfile.TemporaryFile()

    def __enter__(self) -> "Worker":
        return self

    def __exit__(self, *_: object) -> None:
        self.stop()
        self.log.close()

    def under(self, interpreter: Interpreter) -> "Worker":
        """Set the Python interpreter for the next task, and return this worker; a process under another interpreter is ended."""
        if interpreter != self.interpreter:
            self.stop()
            self.interpreter = interpreter
        return self

    def start(self) -> subprocess.Popen[bytes]:
        """Return the running process, or start one.

        Raises:
            WorkerFailure: the interpreter cannot be started.
        """
        process = self.process  # local, because another thread may set it to None meanwhile
        if process is None or process.poll() is not None:
            environment = os.environ | dict.fromkeys(THREADS, "1")
            environment |= {MARK: self.mark, MOST_MEMORY: str(self.interpreter.memory)}
            try:
                process = self.process = subprocess.Popen(
                    self.interpreter.command,
                    stdin=subprocess.PIPE,
                    stdout=subprocess.PIPE,
                    stderr=self.log,
                    env=environment,
                    start_new_session=True,
                )
            except OSError as error:
                reason = f"the interpreter {self.interpreter.python} cannot be started: {error.strerror}"
                raise WorkerFailure(Status.SKIP, reason) from error
        return process

    def stop(self) -> None:
        """End the process and all processes that it has started."""
        process, self.process = self.process, None  # at once: an interrupt may call stop again
        if process is None:
            return
        if process.poll() is None:
            _end_descendants(process.pid)  # before the worker, after whose end they would have another parent
        with contextlib.suppress(ProcessLookupError, PermissionError):
            os.killpg(process.pid, signal.SIGKILL)
        process.kill()
        process.wait()
        _end_all(self.mark)  # processes that are no longer descendants have inherited the mark in their environment
        for pipe in filter(None, (process.stdin, process.stdout)):
            with contextlib.suppress(BrokenPipeError):
                pipe.close()

    def call(
        self,
        function: Callable[..., Any],
        arguments: tuple[Any, ...],
        limit: float,
        largest: int = LARGEST,
        longest: float = math.inf,
    ) -> Any:
        """Call function(*arguments) in the worker process, and return the result as plain data, in which tuples have become lists.

        Args:
            limit: time [s] after which the worker is stopped; the time during which it waits for a processor is not counted.
            largest: largest size of the result [bytes].
            longest: elapsed time [s] after which the worker is stopped too.

        Raises:
            WorkerFailure: the worker crashed, exceeded a limit or was stopped by another thread, the function raised an error, or
                the worker's Python interpreter cannot be used.
        """
        process = self.start()
        assert process.stdin is not None
        token = os.urandom(16)
        self.log.seek(0)
        self.log.truncate()  # so that the last line comes from this task
        try:
            _send(process.stdin, token, (function, arguments, limit))
            answer = _receive_within(process, token, _Clock(process.pid, limit, longest), largest)
        except TimeoutError as error:
            printed = self._last_words()
            self.stop()
            raise WorkerFailure(Status.TIMEOUT, f"no answer within {limit:.3g} s{printed}") from error
        except NoAnswer as error:
            self.stop()
            raise WorkerFailure(Status.CRASHED, f"the process sent no valid answer: {in_a_sentence(error)}") from error
        except (EOFError, OSError, ValueError) as error:
            if self.process is not process:  # another thread stopped it and closed its pipes
                raise WorkerFailure(Status.CRASHED, "the process was stopped") from error
            if not isinstance(error, (EOFError, BrokenPipeError)):
                raise
            code = _exit_code(process)
            printed = self._last_words()
            self.stop()
            if code == os.EX_CONFIG:  # `elsewhere.py` found that the interpreter cannot run a worker, and printed why
                raise WorkerFailure(Status.SKIP, printed.removeprefix(": ")) from error
            how = f"signal {signal.Signals(-code).name}" if code < 0 else f"exit code {code}"
            raise WorkerFailure(Status.CRASHED, f"the process died with {how}{printed}") from error
        match answer:
            case ["ok", returned]:
                return returned
            case ["raised", str(text)]:
                raise WorkerFailure(Status.ERROR, in_a_sentence(text))
        raise WorkerFailure(Status.ERROR, "the worker gave no answer")

    def _last_words(self) -> str:
        """Return a colon and the last line that the worker printed, or an empty text."""
        self.log.seek(0)
        lines = self.log.read()[-4000:].decode(errors="replace").strip().splitlines()
        line = in_a_sentence(lines[-1]) if lines else ""
        return f": {line}" if line else ""


def _exit_code(process: "subprocess.Popen[bytes]") -> int:
    """Return the exit code of a process, which is killed if it has closed its pipe but still runs."""
    try:
        return process.wait(GRACE)
    except subprocess.TimeoutExpired:
        process.kill()
        return process.wait()


_kept: dict[str, Worker] = {}  # engine -> its worker


def get_worker(engine: str) -> Worker:
    """Return the worker of an engine, which is kept until this process ends, because libraries take up to 3 s to import."""
    if engine not in _kept:
        _kept[engine] = Worker()
        atexit.register(_kept[engine].stop)
    return _kept[engine]


def _send(pipe: BinaryIO | Any, token: bytes, item: object) -> None:
    """Send a task after its `token`, with which the answer must begin; the worker trusts its parent and unpickles the task."""
    content = pickle.dumps(item)
    pipe.write(HEADER.pack(token, len(content)) + content)
    pipe.flush()


def _receive_within(process: "subprocess.Popen[bytes]", token: bytes, clock: "_Clock", largest: int) -> Any:
    """Return the answer to the task that was sent with `token`, as `unpack_answer` does.

    Raises:
        TimeoutError: the limit is exceeded.
        EOFError: the process died.
        NoAnswer: the data in the pipe do not answer the task, or are more than `largest` bytes.
    """
    assert process.stdout is not None
    descriptor = process.stdout.fileno()
    buffer = bytearray()
    needed, header_read = HEADER.size, False
    while len(buffer) < needed:
        left = clock.remaining()
        if not select.select([descriptor], [], [], min(POLL, max(0.0, left)))[0]:
            # nothing has come: has the process ended, with nothing left in the pipe?
            if process.poll() is not None and not select.select([descriptor], [], [], 0.0)[0]:
                raise EOFError
            if left <= 0:
                raise TimeoutError
            continue
        part = os.read(descriptor, 1 << 20)
        if not part:
            raise EOFError
        buffer += part
        # the header has the token of the task, and the number of bytes that follow
        if not header_read and len(buffer) >= HEADER.size:
            received, length = HEADER.unpack(buffer[: HEADER.size])
            if received != token:
                raise NoAnswer(f"{bytes(buffer[:40])!r}")
            if length > largest:
                raise NoAnswer(f"an answer of {length} bytes; at most {largest} are expected")
            needed, header_read = HEADER.size + length, True
    if len(buffer) > needed:
        raise NoAnswer(f"{len(buffer) - needed} bytes too many")
    return unpack_answer(bytes(memoryview(buffer)[HEADER.size :]))


def read_waits(pid: int) -> dict[int, float]:
    """Return thread ID -> time [s] for which this thread of a process has waited for a processor; empty if it is not known."""
    waits = {}
    with contextlib.suppress(OSError):
        for thread in Path(f"/proc/{pid}/task").iterdir():
            with contextlib.suppress(OSError, ValueError, IndexError):  # a thread may end meanwhile
                waits[int(thread.name)] = int((thread / "schedstat").read_text(encoding="ascii").split()[1]) * 1e-9
    return waits


class _Clock:
    """The time that is left to a task of process `pid`; the task begins when this object is made.

    The time during which the process waits for a processor does not count towards `limit` [s], if the system reports it. All
    elapsed time counts towards `longest` [s].
    """

    def __init__(self, pid: int, limit: float, longest: float = math.inf):
        self.pid, self.limit, self.longest = pid, limit, min(longest, BACKSTOP * limit)
        self.start, self.before = time.monotonic(), read_waits(pid)

    def remaining(self) -> float:
        """Return the time [s] left to the task: before its time without waits exceeds `limit`, or its elapsed time `longest`."""
        passed = time.monotonic() - self.start
        # the system counts waits by another clock: they may seem to be negative, or longer than the elapsed time
        waited = min(max(0.0, self._waiting_time()), passed)
        return min(self.limit - (passed - waited), self.longest - passed)

    def _waiting_time(self) -> float:
        """Return the time [s] for which the process has waited for a processor since the task began.

        The first thread may sleep until another one, such as one that compiles, has ended: the longest wait of the others is added.
        """
        waited = {thread: x - self.before.get(thread, 0.0) for thread, x in read_waits(self.pid).items()}
        return waited.pop(self.pid, 0.0) + max(waited.values(), default=0.0)


def _end_all(mark: str) -> None:
    """Kill every process that has inherited the mark of a worker, directly or through a worker that this worker has started.

    The process group would not be enough, because processes in sessions of their own do not belong to it.
    """
    sign = f"{MARK}={mark}".encode()
    _end_each(lambda: [pid for pid in _processes() if pid != os.getpid() and _has_mark(pid, sign)])


def _end_descendants(root: int) -> None:
    """End every descendant of a process, but not the process itself."""
    _end_each(lambda: _descendants(root))


def _end_each(find: Callable[[], list[int]]) -> None:
    """End the processes that `find` returns until it returns none: one may have started another meanwhile."""
    for _ in range(ROUNDS):
        if not (found := find()):
            return
        for pid in found:
            with contextlib.suppress(ProcessLookupError, PermissionError):
                os.kill(pid, signal.SIGKILL)
        time.sleep(0.01)  # [s] in which they end


def _processes() -> list[int]:
    """Return the IDs of all processes on this machine, or an empty list if the system does not list them."""
    with contextlib.suppress(OSError):
        return [int(name) for name in os.listdir("/proc") if name.isdigit()]
    return []


def _descendants(root: int) -> list[int]:
    """Return the descendants of a process, without zombies."""
    children: dict[int, list[int]] = {}
    ended = set()  # zombies
    for pid in _processes():
        with contextlib.suppress(OSError), open(f"/proc/{pid}/stat", "rb") as file:
            state, parent = file.read().rpartition(b")")[2].split()[:2]  # after the name, which may contain blanks and brackets
            children.setdefault(int(parent), []).append(pid)
            if state in (b"Z", b"X"):
                ended.add(pid)
    found = [root]
    for pid in found:  # the list grows in the loop
        found += children.get(pid, [])
    return [pid for pid in found[1:] if pid not in ended]


def _has_mark(pid: int, sign: bytes) -> bool:
    """Tell whether the environment variables of a process contain `sign`, the text "NAME=mark" of a worker.

    The mark of a worker that was started within it counts too: it is the worker's mark, followed by a slash and more.
    """
    try:
        with open(f"/proc/{pid}/environ", "rb") as file:
            return any(x == sign or x.startswith(sign + b"/") for x in file.read().split(b"\0"))
    except OSError:
        return False


def _leave_with_parent() -> None:
    """Wait until the parent has ended; then end this process and all that it has started."""
    parent = os.getppid()
    while os.getppid() == parent:
        time.sleep(1.0)
    _end_descendants(os.getpid())
    _end_all(os.environ.get(MARK, ""))
    os.killpg(0, signal.SIGKILL)  # this process and those of its session


def _limit_memory() -> None:
    """Limit the memory of this process, so that too large an array fails in this process and ends no other."""
    with contextlib.suppress(ValueError, OSError):
        installed = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")  # bytes
        _, hard = resource.getrlimit(resource.RLIMIT_AS)
        most = min(installed, int(os.environ.get(MOST_MEMORY, MEMORY)))
        resource.setrlimit(resource.RLIMIT_AS, (most if hard < 0 else min(most, hard), hard))  # hard < 0: no limit


def _answer(function: Callable[..., Any], arguments: tuple[Any, ...]) -> bytes:
    """Return the answer of a task as bytes: the result of function(*arguments), or its error as a sentence."""
    try:
        return pack_answer(("ok", function(*arguments)))
    except BaseException as error:
        where = traceback.extract_tb(error.__traceback__)[-1]
        sentence = f"{type(error).__name__}: {in_a_sentence(error)} ({os.path.basename(where.filename)}:{where.lineno})"
        return pack_answer(("raised", sentence))


def pack_answer(item: object) -> bytes:
    """Return an answer as bytes: the length of its JSON, the JSON, and the bytes of its arrays.

    Raises:
        NoAnswer: the answer has objects other than texts, numbers, arrays, and lists or mappings of them.
    """
    parts: list[bytes] = []  # the bytes of each array, in the order of the JSON

    def describe(x: object) -> object:
        """Return JSON for an object that JSON does not know, and keep the bytes of an array."""
        if isinstance(x, np.generic):
            return x.item()
        if isinstance(x, np.ndarray) and x.dtype.kind in KINDS:
            parts.append(np.ascontiguousarray(x, dtype=KINDS[x.dtype.kind]).tobytes())
            return {ARRAY: [x.dtype.kind, x.shape]}
        raise NoAnswer(f"a worker cannot answer with {type(x).__name__}")

    text = json.dumps(item, default=describe).encode()
    return b"".join((LENGTH.pack(len(text)), text, *parts))


def unpack_answer(content: bytes) -> Any:
    """Return the answer that `pack_answer` wrote.

    Raises:
        NoAnswer: the bytes are not a valid answer.
    """
    if len(content) < LENGTH.size:
        raise NoAnswer("it is too short")
    (length,) = LENGTH.unpack_from(content)
    text, left = content[LENGTH.size : LENGTH.size + length], memoryview(content)[LENGTH.size + length :]
    if length > LONGEST or len(text) < length:
        raise NoAnswer(f"its text should have {length} bytes")

    def restore(table: dict[str, Any]) -> Any:
        """Return the array that a JSON object describes, read from the bytes after the JSON; return other objects unchanged."""
        nonlocal left
        if table.keys() != {ARRAY}:
            return table
        match table[ARRAY]:
            case [str(kind), [*shape]] if kind in KINDS and len(shape) <= MOST and all(map(_is_length, shape)):
                size = math.prod(shape) * KINDS[kind].itemsize
                if size > len(left):
                    raise NoAnswer("it holds less than its arrays need")
                array = np.frombuffer(left[:size], KINDS[kind]).reshape(shape).copy()
                left = left[size:]
                return array
        raise NoAnswer("an array without type and shape")

    try:
        return json.loads(text.decode(), object_hook=restore)
    except (ValueError, RecursionError) as error:
        raise NoAnswer(str(error)) from error


def _is_length(x: object) -> bool:
    """Tell whether a value of an answer is an acceptable length of an array."""
    return type(x) is int and 0 <= x <= LONGEST


def main() -> None:
    """Answer tasks until the parent closes the pipe."""
    # move both pipes from descriptors 0 and 1 to ANSWERS or above, out of the way of libraries
    answers = os.fdopen(fcntl.fcntl(1, fcntl.F_DUPFD_CLOEXEC, ANSWERS), "wb")
    tasks = os.fdopen(fcntl.fcntl(0, fcntl.F_DUPFD_CLOEXEC, ANSWERS), "rb")
    os.dup2(2, 1)  # what a library prints goes to the error stream
    nothing = os.open(os.devnull, os.O_RDONLY)
    os.dup2(nothing, 0)  # a library that reads finds nothing
    os.close(nothing)
    _limit_memory()
    with contextlib.suppress(OSError, AttributeError):  # become the parent of orphaned descendants (Linux)
        ctypes.CDLL(None).prctl(SUBREAPER, 1, 0, 0, 0)
    home = os.getcwd()
    threading.Thread(target=_leave_with_parent, daemon=True).start()
    while header := tasks.read(HEADER.size):
        token, length = HEADER.unpack(header)
        content = tasks.read(length)
        try:
            function, arguments, limit = pickle.loads(content)
        except Exception as error:
            function, arguments, limit = _refuse, (f"the task cannot be read: {type(error).__name__}: {error}",), 60.0
        signal.signal(signal.SIGALRM, signal.SIG_DFL)  # the default action ends the process even inside a library
        signal.setitimer(signal.ITIMER_REAL, BACKSTOP * limit + GRACE)
        os.chdir(home)  # a library may have changed the working folder, and paths in tasks are relative
        answer = _answer(function, arguments)
        signal.setitimer(signal.ITIMER_REAL, 0)
        answers.write(HEADER.pack(token, len(answer)) + answer)
        answers.flush()
    _end_descendants(os.getpid())
    _end_all(os.environ.get(MARK, ""))  # the parent may have been killed


def _refuse(sentence: str) -> None:
    """Raise an error with this sentence: the worker calls this function instead of a task that it cannot read."""
    raise ValueError(sentence)


if __name__ == "__main__":
    main()
