"""Call after call in one process: the memory and the handles that it has stay what they are."""

import os
import random
import resource
from collections.abc import Callable, Iterator
from pathlib import Path

from gauss_bench.api.simulate import simulate
from gauss_bench.engines import get
from gauss_bench.linkage.load import load
from gauss_bench.runs.offers import offer
from gauss_bench.trajectory import Status

LINKAGES = ("four_bar", "crank_slider", "pendulum", "six_bar", "shaper")
ENGINES = ("gauss", "lagrange", "schur", "gauss-native", "minimal")
FOREIGN = ("mujoco", "pinocchio")  # which have a process each for a call, and that is dear
SELDOM = 50  # calls from one of a foreign engine to the next
EVERY = 100  # calls from one look to the next
HELD, MORE = 1 << 18, 200  # bytes by which memory may differ, and grow with each call: a trajectory has ten times as many


def simulated(seed: int) -> Callable[[int], str]:
    """The call of each number, of a linkage, engine, stabilisation and step by lot; it tells what is wrong, or nothing."""
    engines = [x for x in ENGINES if offer(x).usable]
    foreign = [x for x in FOREIGN if offer(x).usable] or engines

    def call(number: int) -> str:
        chance = random.Random(f"call {seed} {number}")
        linkage = chance.choice(LINKAGES)
        engine = chance.choice(foreign if number % SELDOM == SELDOM - 1 else engines)
        step, told = chance.choice((1e-3, 2e-3, 5e-3)), offer(engine)
        choice = told.choose(None, "rk4", chance.choice(("none", told.stabilizations[-1])), step)
        if get(engine).skip(load(linkage), choice):
            choice, engine = offer("gauss").choose(None, "rk4", "none", step), "gauss"
        found = simulate(linkage, engine, step=step, integrator="rk4", stabilization=choice.stabilization, at=[0.0, 0.02])
        judged = found.valid or (engine in foreign and found.status == Status.INVALID)  # soft loops at long steps are no fault here
        return "" if judged else f"{linkage} by {engine}: {found.status}: {found.message}"

    return call


def held() -> tuple[int, int, int]:
    """Bytes in memory, open handles, and processes started that have not ended."""
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    children = Path(f"/proc/self/task/{os.getpid()}/children").read_text().split()
    return pages * resource.getpagesize(), len(os.listdir("/proc/self/fd")), len(children)


def over_calls(call: Callable[[int], str], count: int) -> Iterator[tuple[int, str, str]]:
    """Number of a call, a word, and a sentence where it ended badly, or where in the end more is held than at half of the calls."""
    looks: list[tuple[int, int, int]] = []
    for number in range(count):
        if sentence := call(number):
            yield number, "not ok", sentence
        if number % EVERY == EVERY - 1:
            looks.append(held())
            yield number, f"{EVERY} made", ""
    if len(looks) < 2:
        return
    middle, last, calls = looks[len(looks) // 2], looks[-1], EVERY * (len(looks) - 1 - len(looks) // 2)
    faults = [f"{(last[0] - middle[0]) / 1e6:.2f} MB more"] if last[0] - middle[0] > HELD + MORE * calls else []
    faults += [f"{b - a} {what} more" for what, a, b in zip(("handles", "processes"), middle[1:], last[1:], strict=True) if b > a]
    said = "{:.2f} MB, {} handles and {} processes".format(last[0] / 1e6, *last[1:])
    yield count, f"in the end {said}", f"in {calls} calls {', '.join(faults)}: {said}" if faults else ""
