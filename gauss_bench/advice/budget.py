"""The seconds left to a user: those in which others had the processor do not count, as long as there is a wall.

A search that counts by the clock on the wall alone loses answers on a busy machine: engines whose turn comes late are never tried.
So the seconds count that a quiet machine would have taken: those that have passed, but for those in which the processes of the
search were ready to run and did not, each of those that work side by side for its share of them. Where the system does not tell
of waiting, all seconds count. In any case everything ends by the clock on the wall, at WALL times its share of the budget.
"""

import contextlib
import os
import threading
import time
from pathlib import Path

LANES = 2  # processes at a time, of a recommendation
WALL = 1.4  # times a share of the budget, when that ends however busy the machine is
END = 1.45  # times the budget, when everything has ended


class Budget:
    """Seconds of a user's, from now on; `lanes` processes work side by side."""

    def __init__(self, seconds: float, lanes: int = LANES):
        self.seconds, self.lanes, self.started = seconds, lanes, time.monotonic()
        self._seen: dict[str, float] = wait()
        self._lost, self._looking = 0.0, threading.Lock()

    def passed(self) -> float:
        """Seconds by the clock on the wall."""
        return time.monotonic() - self.started

    def spent(self) -> float:
        """Seconds that count."""
        with self._looking:
            now = wait()
            self._lost += sum(max(0.0, x - self._seen.get(task, 0.0)) for task, x in now.items())
            self._seen |= now
            passed = self.passed()
            return passed - min(self._lost / self.lanes, passed)

    def left(self, share: float = 1.0) -> float:
        """Seconds that count until a share of the budget is spent, or those on the wall where these end first."""
        return min(share * self.seconds - self.spent(), self.wall(share))

    def wall(self, share: float = 1.0) -> float:
        """Seconds by the clock on the wall until a share has to have ended."""
        return min(WALL * share, END) * self.seconds - self.passed()


def wait() -> dict[str, float]:
    """Thread of this process and of those that it has started -> seconds in which it was ready to run and did not."""
    own = Path(f"/proc/{os.getpid()}/task")
    seconds: dict[str, float] = {}
    with contextlib.suppress(OSError):
        threads = [own / name for name in os.listdir(own)]
        children = [Path("/proc", name) for x in threads for name in _read(x / "children").split()]
        for place in (*threads, *children):
            with contextlib.suppress(ValueError, IndexError):
                seconds[place.name] = int(_read(place / "schedstat").split()[1]) * 1e-9
    return seconds


def _read(path: Path) -> str:
    """A file of the system's, or nothing where it is gone."""
    try:
        return path.read_text(encoding="ascii")
    except OSError:
        return ""
