"""Start long jobs, each in its own process, and send their events to the page as they arrive."""

import contextlib
import json
import os
import signal
import subprocess
import sys
import threading
import tomllib
from collections.abc import Callable
from typing import Any

from gauss_bench.studio.autosave import temporary_file
from gauss_bench.studio.messages import Refused
from gauss_bench.trajectory import in_a_sentence

MOST = 3  # largest number of jobs at once
GRACE = 2.0  # [s] longest wait for the end of a stopped job


class Jobs:
    """The running jobs.

    Attributes:
        tell: function that sends an event to all pages.
        running: number of a job -> its process.
        followers: number of a job -> thread that reads its events.
        count: number of jobs started so far.
    """

    def __init__(self, tell: Callable[[dict[str, Any]], object]):
        """Begin without jobs."""
        self.tell = tell
        self.running: dict[int, subprocess.Popen[bytes]] = {}
        self.followers: dict[int, threading.Thread] = {}
        self.count, self.lock = 0, threading.Lock()

    def start(self, text: str, request: dict[str, Any], done: str) -> int:
        """Start a job with the request that `job.py` reads, on a linkage file; return its number. `done` names its last event."""
        with self.lock:
            if len(self.running) >= MOST:
                raise Refused(f"{MOST} jobs are running already: stop one, or wait")
            self.count += 1
            job, environment = self.count, os.environ | dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"), "1")
            command, pipe = [sys.executable, "-m", "gauss_bench.studio.job"], subprocess.PIPE
            self.running[job] = subprocess.Popen(
                command, stdin=pipe, stdout=pipe, stderr=subprocess.DEVNULL, env=environment, start_new_session=True
            )
            follower = threading.Thread(target=self._follow, args=(job, text, request, done), daemon=True)
            self.followers[job] = follower
        follower.start()
        return job

    def _follow(self, job: int, text: str, request: dict[str, Any], done: str) -> None:
        """Send the events of a job as they arrive, then the event `done` with comparisons, or with the reason of the failure."""
        process = self.running[job]
        # the event after the job has ended; its error stays unless an event of the job changes or removes it
        last: dict[str, Any] = {"event": done, "job": job, "error": "it was stopped"}
        assert process.stdin is not None
        assert process.stdout is not None
        try:
            with temporary_file(text, tomllib.loads(text).get("name")) as path:
                with contextlib.suppress(BrokenPipeError):  # the job was stopped before it began
                    process.stdin.write(json.dumps(request | {"path": str(path)}).encode() + b"\n")
                    process.stdin.flush()
                for line in process.stdout:
                    event = json.loads(line) | {"job": job}
                    match event["event"]:
                        case "failed":
                            last["error"] = event["text"].replace(f"{path}: ", "")
                        case "compared":
                            last.setdefault("compare", event["compare"])  # the first comparison
                            last.setdefault("compared", []).append(event["compare"])
                        case "done":
                            del last["error"]
                        case _:
                            self.tell(event)
        except (OSError, ValueError) as error:
            last["error"] = f"the job could not be run: {in_a_sentence(error)}"
        self.stop(job)
        for pipe in (process.stdin, process.stdout):
            with contextlib.suppress(OSError):
                pipe.close()
        process.wait()
        with self.lock:
            del self.running[job], self.followers[job]
        self.tell(last)

    def stop(self, job: int) -> None:
        """Kill a job and all processes that it has started; do nothing if the job has ended."""
        # PermissionError: on macOS, for a process group that has ended
        with contextlib.suppress(KeyError, ProcessLookupError, PermissionError):
            os.killpg(self.running[job].pid, signal.SIGKILL)

    def stop_all(self) -> None:
        """Kill all jobs, and wait at most GRACE for the end of each."""
        followers = [*self.followers.values()]
        for job in [*self.running]:
            self.stop(job)
        for follower in followers:
            if follower.ident is not None:  # None: the thread that follows a job has not been started, and cannot be joined
                follower.join(GRACE)
