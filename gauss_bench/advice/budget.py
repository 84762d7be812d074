"""A time budget that does not count seconds in which other programs had the processor, up to a limit.

If elapsed time alone counted, a search on a busy machine would lose answers, because engines whose turn comes late would never be
tried. The budget counts the seconds that a quiet machine would have taken. These are the elapsed seconds less the seconds that the
processes of the search waited for a processor, divided by the number of processes that work side by side. If the system does not
report waits, all seconds count. In any case a part of the search ends when the elapsed time reaches WALL times its share of the
budget.
"""

import contextlib
import os
import threading
import time
from pathlib import Path

from gauss_bench.runs.worker import read_waits

LANES = 2  # number of processes that a recommendation runs side by side
WALL = 1.4  # elapsed time of a share of the budget is at most WALL times that share
END = 1.45  # elapsed time of the whole recommendation is at most END times the budget


class Budget:
    """A budget of seconds that starts when the object is made.

    The seconds that count are the elapsed ones, less the waiting of all threads for a processor divided by `lanes`, the number of
    processes that work side by side.
    """

    def __init__(self, seconds: float, lanes: int = LANES):
        self.seconds, self.lanes, self.started = seconds, lanes, time.monotonic()
        self._seen = waiting_times()  # thread -> its waiting [s] when it was last read
        self._lost, self._looking = 0.0, threading.Lock()  # [s] sum of all waiting so far; several threads read it

    def wall_time(self) -> float:
        """Return the elapsed seconds."""
        return time.monotonic() - self.started

    def seconds_used(self) -> float:
        """Return the seconds that count against the budget."""
        with self._looking:
            now = waiting_times()
            self._lost += sum(max(0.0, x - self._seen.get(task, 0.0)) for task, x in now.items())
            self._seen |= now
            passed = self.wall_time()
            return passed - min(self._lost / self.lanes, passed)

    def remaining(self, share: float = 1.0) -> float:
        """Return the seconds left until a share of the budget is used, or until its limit of elapsed time if that comes first."""
        return min(share * self.seconds - self.seconds_used(), self.remaining_wall_time(share))

    def remaining_wall_time(self, share: float = 1.0) -> float:
        """Return the seconds of elapsed time that remain until the work of a share of the budget must end."""
        return min(WALL * share, END) * self.seconds - self.wall_time()


def waiting_times() -> dict[int, float]:
    """Return thread -> seconds that it has waited for a processor: all threads of this process, the main thread of each child."""
    seconds = read_waits(os.getpid())
    for thread in [*seconds]:
        with contextlib.suppress(OSError):  # a thread may end meanwhile
            children = Path(f"/proc/{os.getpid()}/task/{thread}/children").read_text(encoding="ascii").split()
            for child in map(int, children):
                seconds |= {k: x for k, x in read_waits(child).items() if k == child}
    return seconds
