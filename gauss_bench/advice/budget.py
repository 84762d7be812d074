"""A time budget that does not count seconds in which other programs had the processor, up to a limit.

If elapsed time alone counted, a search on a busy machine would lose answers, because the engines that are tried last would not be
tried at all. The budget counts the elapsed time minus the mean waiting time: the time that the processes of the search waited for a
processor, divided by the number of processes that run in parallel (zero if the system does not report it). Each part of the search
has a share of the budget, and ends in any case when the elapsed time reaches WALL times this share.
"""

import contextlib
import os
import threading
import time
from pathlib import Path

from gauss_bench.runs.worker import read_waits

LANES = 2  # number of processes that a recommendation runs in parallel
WALL = 1.4  # work that may use a share of the budget takes at most WALL times this share in elapsed time
END = 1.45  # elapsed time of the whole recommendation is at most END times the budget


class Budget:
    """A budget of seconds that starts when the object is made, for a search with `lanes` processes in parallel."""

    def __init__(self, seconds: float, lanes: int = LANES):
        self.seconds, self.lanes, self.started = seconds, lanes, time.monotonic()
        self._last_waits = waiting_times()  # thread -> time [s] that it had waited for a processor at the last reading
        # [s] waiting time of all threads since the start; several threads update it, hence the lock
        self._waited, self._lock = 0.0, threading.Lock()

    def wall_time(self) -> float:
        """Return the elapsed time since the start [s]."""
        return time.monotonic() - self.started

    def seconds_used(self) -> float:
        """Return the seconds that count against the budget: the elapsed time minus the mean waiting time."""
        with self._lock:
            now = waiting_times()
            self._waited += sum(max(0.0, x - self._last_waits.get(thread, 0.0)) for thread, x in now.items())
            self._last_waits |= now
            elapsed = self.wall_time()
            return elapsed - min(self._waited / self.lanes, elapsed)

    def remaining(self, share: float = 1.0) -> float:
        """Return the seconds left until a share of the budget is used, or until the limit on elapsed time if that comes first."""
        return min(share * self.seconds - self.seconds_used(), self.remaining_wall_time(share))

    def remaining_wall_time(self, share: float = 1.0) -> float:
        """Return the elapsed time [s] that is left for work that may use the given share of the budget."""
        return min(WALL * share, END) * self.seconds - self.wall_time()


def waiting_times() -> dict[int, float]:
    """Return thread -> seconds of waiting for a processor, for all threads of this process and the main threads of its children.

    The result is empty if the system does not report waiting times.
    """
    seconds = read_waits(os.getpid())
    for thread in [*seconds]:
        with contextlib.suppress(OSError):  # a thread may end meanwhile
            children = Path(f"/proc/{os.getpid()}/task/{thread}/children").read_text(encoding="ascii").split()
            for child in map(int, children):
                seconds |= {k: x for k, x in read_waits(child).items() if k == child}
    return seconds
