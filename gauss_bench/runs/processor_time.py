"""Processor time: what every cost is measured in."""

import time
from collections.abc import Callable


def measure_seconds(go: Callable[[], object]) -> float:
    """Seconds of the processor, in all threads of this process, that a call takes."""
    start = time.process_time_ns()
    go()
    return (time.process_time_ns() - start) * 1e-9
