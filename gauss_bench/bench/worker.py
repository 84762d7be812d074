"""A process of its own for what may crash or hang: functions go in, results come out, and its death is an answer too.

Tasks and answers are pickled over a pair of pipes. The worker's standard output is given to its error stream first, so that a
library that prints cannot spoil the answers; what it prints stands in a file and is quoted when it dies. A task that outlives its
limit is stopped by the parent and, should the parent be gone, by an alarm that no library can block.
"""

import os
import pickle
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
from typing import Any, BinaryIO

from gauss_bench.trajectory import Status

HEADER = struct.Struct("<Q")
THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "VECLIB_MAXIMUM_THREADS")
GRACE = 5.0  # [s] by which the worker's own alarm comes after the parent's limit


class WorkerFailure(RuntimeError):
    """A task without an answer, with a status and a sentence."""

    def __init__(self, status: Status, message: str):
        self.status = status
        super().__init__(message)


class Worker:
    """One process, started when first needed and again after it has died."""

    def __init__(self) -> None:
        self.process: subprocess.Popen[bytes] | None = None
        self.log = tempfile.TemporaryFile()

    def __enter__(self) -> "Worker":
        return self

    def __exit__(self, *_: object) -> None:
        self.stop()
        self.log.close()

    def start(self) -> subprocess.Popen[bytes]:
        if self.process is None or self.process.poll() is not None:
            self.log.truncate(0)
            environment = os.environ | dict.fromkeys(THREADS, "1")
            command = [sys.executable, "-m", "gauss_bench.bench.worker"]
            self.process = subprocess.Popen(
                command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=self.log, env=environment
            )
        return self.process

    def stop(self) -> None:
        if self.process is not None:
            self.process.kill()
            self.process.wait()
            for pipe in (self.process.stdin, self.process.stdout):
                if pipe:
                    pipe.close()
            self.process = None

    def call(self, function: Callable[..., Any], arguments: tuple[Any, ...], limit: float) -> Any:
        """function(*arguments), run in the worker.

        Raises:
            WorkerFailure: the worker crashed, exceeded `limit` seconds, or the function raised.
        """
        process = self.start()
        assert process.stdin is not None
        assert process.stdout is not None
        try:
            _send(process.stdin, (function, arguments, limit))
            kind, answer = _receive_within(process.stdout, limit)
        except TimeoutError as error:
            self.stop()
            raise WorkerFailure(Status.TIMEOUT, f"no answer within {limit:g} s") from error
        except (EOFError, BrokenPipeError) as error:
            code = process.wait()
            said = self._last_words()
            self.stop()
            how = f"signal {signal.Signals(-code).name}" if code < 0 else f"exit code {code}"
            raise WorkerFailure(Status.CRASHED, f"the process died with {how}{said}") from error
        if kind == "raised":
            raise WorkerFailure(Status.ERROR, answer)
        return answer

    def _last_words(self) -> str:
        self.log.seek(0)
        lines = self.log.read()[-4000:].decode(errors="replace").strip().splitlines()
        return f": {lines[-1].strip()}" if lines else ""


def _send(pipe: BinaryIO | Any, item: object) -> None:
    content = pickle.dumps(item)
    pipe.write(HEADER.pack(len(content)) + content)
    pipe.flush()


def _receive_within(pipe: Any, limit: float) -> Any:
    deadline = time.monotonic() + limit
    descriptor = pipe.fileno()
    buffer = b""
    needed = HEADER.size
    while len(buffer) < needed:
        if not select.select([descriptor], [], [], max(0.0, deadline - time.monotonic()))[0]:
            raise TimeoutError
        part = os.read(descriptor, 1 << 20)
        if not part:
            raise EOFError
        buffer += part
        if needed == HEADER.size and len(buffer) >= needed:
            needed += HEADER.unpack(buffer[: HEADER.size])[0]
    return pickle.loads(buffer[HEADER.size :])


def _leave_with_parent() -> None:
    parent = os.getppid()
    while os.getppid() == parent:
        time.sleep(1.0)
    os._exit(1)


def main() -> None:
    """Answer tasks until the parent closes the pipe."""
    answers = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)
    threading.Thread(target=_leave_with_parent, daemon=True).start()
    tasks = sys.stdin.buffer
    while header := tasks.read(HEADER.size):
        function, arguments, limit = pickle.loads(tasks.read(HEADER.unpack(header)[0]))
        signal.setitimer(signal.ITIMER_REAL, limit + GRACE)  # nobody handles SIGALRM: it ends the process even inside a library
        try:
            answer = ("ok", function(*arguments))
        except Exception as error:
            where = traceback.extract_tb(error.__traceback__)[-1]
            answer = ("raised", f"{type(error).__name__}: {error} ({os.path.basename(where.filename)}:{where.lineno})")
        signal.setitimer(signal.ITIMER_REAL, 0)
        _send(answers, answer)


if __name__ == "__main__":
    main()
