"""Progress, told to people on stderr: at once, or only once it takes long."""

import contextlib
import sys
import threading
from collections.abc import Callable

from gauss_bench.linkage.limits import harmless

LONG = 2.0  # [s] after which what takes so long says what it is
Told = Callable[[str], object]
_later: list[threading.Timer] = []


def nobody(sentence: str) -> None:
    """Tell nobody."""


def tell(sentence: str) -> None:
    """Tell people; names of theirs may hold what drives a terminal."""
    print(harmless(sentence), file=sys.stderr, flush=True)


def tell_if_long(sentence: str) -> None:
    """Tell people, unless `no_longer` is called within LONG seconds: what ends soon needs no words."""
    timer = threading.Timer(LONG, tell, (sentence,))
    timer.daemon = True
    with contextlib.suppress(RuntimeError):  # a machine that has no thread left can still do what was asked for
        timer.start()
        _later.append(timer)


def no_longer() -> None:
    """Withdraw a message that was to be told only if it took long."""
    while _later:
        _later.pop().cancel()
