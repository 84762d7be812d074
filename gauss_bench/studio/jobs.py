"""Work that goes on while drawing does: each piece in a process of its own, with its events told to the page as they come."""

import contextlib
import json
import os
import signal
import subprocess
import sys
import threading
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

from gauss_bench.studio.autosave import workplace
from gauss_bench.studio.errors import Refused
from gauss_bench.trajectory import in_a_sentence

MOST = 3  # at once
GRACE = 2.0  # [s] for what is left of a piece of work that is stopped


class Jobs:
    """The work that is going on, by number."""

    def __init__(self, tell: Callable[[dict[str, Any]], object]):
        self.tell = tell
        self.running: dict[int, subprocess.Popen[bytes]] = {}
        self.followers: dict[int, threading.Thread] = {}
        self.count, self.lock = 0, threading.Lock()

    def start(self, text: str, request: dict[str, Any], done: str) -> int:
        """Begin a piece of work on a text; its number. Its last event is called `done`.

        Raises:
            Refused: too much is going on already.
        """
        with self.lock:
            if len(self.running) >= MOST:
                raise Refused(f"{MOST} things are going on already: stop one, or wait")
            self.count += 1
            job = self.count
            environment = os.environ | dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"), "1")
            self.running[job] = subprocess.Popen(
                [sys.executable, "-m", "gauss_bench.studio.job"],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=subprocess.DEVNULL,
                env=environment,
                start_new_session=True,
            )
            follower = threading.Thread(target=self._follow, args=(job, text, request, done), daemon=True)
            self.followers[job] = follower
        follower.start()
        return job

    def _follow(self, job: int, text: str, request: dict[str, Any], done: str) -> None:
        process = self.running[job]
        last: dict[str, Any] = {"event": done, "job": job}
        try:
            with workplace(text, tomllib.loads(text).get("name")) as path:
                last |= self._tell(process, path, request | {"path": str(path)}, job)
        except (OSError, ValueError) as error:
            last |= {"error": f"it could not be run: {in_a_sentence(error)}"}
        self._end(process)
        with self.lock:
            self.running.pop(job, None)
            self.followers.pop(job, None)
        self.tell(last)

    def _tell(self, process: "subprocess.Popen[bytes]", path: Path, request: dict[str, Any], job: int) -> dict[str, Any]:
        """Tell what the process finds as it comes; what its last event has besides."""
        last: dict[str, Any] = {}
        ended = False
        assert process.stdin is not None
        assert process.stdout is not None
        with contextlib.suppress(BrokenPipeError):  # it was stopped before it began
            process.stdin.write(json.dumps(request).encode() + b"\n")
            process.stdin.flush()
        for line in process.stdout:
            event = json.loads(line) | {"job": job}
            match event["event"]:
                case "failed":
                    last |= {"error": event["text"].replace(f"{path}: ", "")}
                    ended = True
                case "compared":
                    last.setdefault("compare", event["compare"])
                    last.setdefault("compared", []).append(event["compare"])
                case "done":
                    ended = True
                case _:
                    self.tell(event)
        return last if ended else last | {"error": "it was stopped"}

    @staticmethod
    def _end(process: "subprocess.Popen[bytes]") -> None:
        """End a process and what it has started."""
        with contextlib.suppress(ProcessLookupError, PermissionError):
            os.killpg(process.pid, signal.SIGKILL)
        for pipe in (process.stdin, process.stdout):
            if pipe is not None:
                with contextlib.suppress(OSError):
                    pipe.close()
        process.wait()

    def stop(self, job: int) -> None:
        """End a piece of work; nothing where it is over."""
        process = self.running.get(job)
        if process is not None:
            with contextlib.suppress(ProcessLookupError, PermissionError):
                os.killpg(process.pid, signal.SIGKILL)

    def stop_all(self) -> None:
        """End everything that goes on, and wait until nothing of it is left."""
        followers = [*self.followers.values()]
        for job in [*self.running]:
            self.stop(job)
        for follower in followers:
            if follower.ident is not None:
                follower.join(GRACE)
