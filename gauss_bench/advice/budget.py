"""A time budget that does not count seconds in which other programs had the processor, up to a limit.

If elapsed time alone counted, a search on a busy machine would lose answers, because engines whose turn comes late are never tried.
So the budget counts the seconds that a quiet machine would have taken: elapsed seconds less those that the processes of the search
spent waiting for a processor, divided by the number of processes that work side by side. Where the system does not report waiting,
all seconds count. In any case a part of the search ends when the elapsed time reaches WALL times its share of the budget.
"""

import contextlib
import os
import threading
import time
from pathlib import Path

LANES = 2  # number of processes that a recommendation runs side by side
WALL = 1.4  # limit of the elapsed time of a share of the budget, in units of that share
END = 1.45  # limit of the elapsed time of everything, in units of the budget


class Budget:
    """A budget of seconds that starts now; `lanes` processes work side by side."""

    def __init__(self, seconds: float, lanes: int = LANES):
        self.seconds, self.lanes, self.started = seconds, lanes, time.monotonic()
        self._seen: dict[str, float] = wait()
        self._lost, self._looking = 0.0, threading.Lock()

    def wall_time(self) -> float:
        """Return the elapsed seconds."""
        return time.monotonic() - self.started

    def seconds_used(self) -> float:
        """Return the seconds that count against the budget."""
        with self._looking:
            now = wait()
            self._lost += sum(max(0.0, x - self._seen.get(task, 0.0)) for task, x in now.items())
            self._seen |= now
            passed = self.wall_time()
            return passed - min(self._lost / self.lanes, passed)

    def remaining(self, share: float = 1.0) -> float:
        """Return the seconds left until a share of the budget is used, or until its limit of elapsed time if that comes first."""
        return min(share * self.seconds - self.seconds_used(), self.remaining_wall_time(share))

    def remaining_wall_time(self, share: float = 1.0) -> float:
        """Return the elapsed seconds left until a share of the budget must have ended."""
        return min(WALL * share, END) * self.seconds - self.wall_time()


def wait() -> dict[str, float]:
    """Return thread -> seconds that it waited for a processor, for the threads of this process and its child processes."""
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
    """Return the content of a system file, or an empty text where the file is gone."""
    try:
        return path.read_text(encoding="ascii")
    except OSError:
        return ""
