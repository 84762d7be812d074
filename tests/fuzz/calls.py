"""Make many calls in one process, whose memory and handles must not grow."""

import os
import random
import resource
from collections.abc import Callable, Iterator
from pathlib import Path

from gauss_bench.api.simulate import simulate

LINKAGES = ("four_bar", "crank_slider", "pendulum", "six_bar", "shaper")
ENGINES = ("gauss", "lagrange", "schur", "gauss-native")
EVERY = 100  # calls between two measurements
HELD, MORE = 1 << 18, 200  # bytes by which memory may differ, and grow with each call; a trajectory has ten times as many


def simulated(seed: int) -> Callable[[int], str]:
    """Return the call of each number, with a random linkage, engine and step; it returns what is wrong, or an empty text."""

    def call(number: int) -> str:
        chance = random.Random(f"call {seed} {number}")
        linkage, engine = chance.choice(LINKAGES), chance.choice(ENGINES)
        found = simulate(linkage, engine, step=chance.choice((1e-3, 2e-3, 5e-3)), at=[0.0, 0.02])
        return "" if found.valid else f"{linkage} by {engine}: {found.status}: {found.message}"

    return call


def measure() -> dict[str, int]:
    """Return the bytes in memory, and the numbers of open handles and of child processes."""
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    children = Path(f"/proc/self/task/{os.getpid()}/children").read_text().split()
    return {"bytes": pages * resource.getpagesize(), "handles": len(os.listdir("/proc/self/fd")), "processes": len(children)}


def over_calls(call: Callable[[int], str], count: int) -> Iterator[tuple[int, str, str]]:
    """Yield number, word, and a sentence if a call ended badly; at the end, compare with the middle of all calls."""
    measured: list[dict[str, int]] = []
    for number in range(count):
        if sentence := call(number):
            yield number, "not ok", sentence
        if number % EVERY == EVERY - 1:
            measured.append(measure())
            yield number, f"{EVERY} made", ""
    if len(measured) > 1:
        middle, last = len(measured) // 2, len(measured) - 1
        grown = {what: x - measured[middle][what] for what, x in measured[last].items()}
        allowed = {"bytes": HELD + MORE * EVERY * (last - middle), "handles": 0, "processes": 0}
        faults = [f"{grown[what]} {what} more" for what, most in allowed.items() if grown[what] > most]
        yield count, f"in the end {measured[last]}", ", ".join(faults)
