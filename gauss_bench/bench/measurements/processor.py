"""Measure the speed of the processor by two small compiled loops, which are timed in turn with the engines (`cost.py`).

The first loop is a chain of fused multiply-adds, each of which needs the result of the one before. It shows the latency of a
multiply-add: CYCLES cycles on every x86 processor since 2015. The second loop has CHAINS independent chains of multiply-adds of
vectors. It shows the peak rate, in which a multiply-add counts as two operations for each number of the vector.
"""

from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path

import numpy as np
from jinja2 import Template

from gauss_bench.bench.clock import NO_KEY, Key, Measured, Row, row, spread
from gauss_bench.bench.provenance import environment
from gauss_bench.bench.tasks import Rows
from gauss_bench.compiler.machine import native_code
from gauss_bench.compiler.machine.graph import LATENCY
from gauss_bench.compiler.machine.llvm import Listing
from gauss_bench.runs.blocks import Block, calls_block
from gauss_bench.trajectory import RunFailure, Status

CYCLES = LATENCY["fma"]
CHAINS = 16  # enough to fill two pipes of four cycles each, twice
LINKS = 16  # multiply-adds of a chain in one iteration of the loop
TURNS = 2_000  # iterations of the loop in one call
TEMPLATE = Path(__file__).parent / "chain.ll.jinja"
PROCESSOR = "processor"
LATENCY_KEY, RATE_KEY = Key("latency", PROCESSOR, "", "", ""), Key("rate", PROCESSOR, "", "", "")
FACTS = ("date", "commit", "dirty", "cpu", "cores", "python", "platform")  # on the machine, for the table


def chain_text(chains: int, links: int, lanes: int) -> str:
    """Return the text of an LLVM module whose function `accelerate` repeats x = x / 2 + 1 for vectors x of `lanes` numbers.

    Each iteration of its loop does this operation `links` times for each of `chains` independent vectors.
    """
    half, one = (f"<{', '.join([f'double {x}'] * lanes)}>" for x in (0.5, 1.0))
    numbers = {"chains": chains, "links": links, "lanes": lanes, "real": f"<{lanes} x double>", "half": half, "one": one}
    text: str = Template(TEMPLATE.read_text(encoding="utf-8"), trim_blocks=True).render(numbers)
    return text


def processor() -> Iterator[tuple[Key, Callable[[], Block]]]:
    """Yield the keys of both loops, and the functions that make their blocks; one repetition is one multiply-add of vectors."""
    yield LATENCY_KEY, partial(_loop, 1, 2)
    yield RATE_KEY, partial(_loop, CHAINS, None)


def _loop(chains: int, lanes: int | None) -> Block:
    """Return the timing block of a loop with chains of multiply-adds; vectors have `lanes` numbers, None for the widest.

    Raises:
        RunFailure: there is no compiler.
    """
    if not native_code.available():
        raise RunFailure(Status.SKIP, "the loops that measure the processor need the package llvmlite")
    width = native_code.best_lanes() if lanes is None else lanes
    signature = "ppppi"  # four pointers and an integer
    code = native_code.NativeCode(Listing(chain_text(chains, LINKS, width), "accelerate", signature, chains * LINKS))
    out = np.empty(width)

    def call() -> None:
        code.call(None, None, None, out.ctypes.data, TURNS)  # `out` lives as long as this function

    return calls_block(NO_KEY, call, chains * LINKS * TURNS)


def name_machine() -> Rows:
    """Return a row for each fact of the machine and each version of a library."""
    facts = environment()
    rows: Rows = [{"key": x, "status": "ok", "statement": str(facts[x])} for x in FACTS]
    return rows + [{"key": name, "status": "ok", "statement": x} for name, x in sorted(facts["versions"].items())]


def processor_rows(measured: Measured) -> Rows:
    """Return one row each for latency, length of a cycle and peak rate, from the measured times of the latency and rate loops."""
    lanes = native_code.best_lanes() if native_code.available() else 0

    def value(factor: float) -> Row:
        """Return the columns of the latency [s] and its spread, multiplied by a factor."""
        return spread("value", np.asarray(measured.of(LATENCY_KEY) * factor))

    def rate() -> Row:
        """Return the columns of the operations per second and their spread: the longest time gives the lowest rate."""
        seconds = spread("value", measured.of(RATE_KEY))  # time of a multiply-add of vectors: two operations in each lane
        pairs = (("value", "value"), ("value_low", "value_high"), ("value_high", "value_low"))  # column of the rate and of its time
        return {name: 2 * lanes / seconds[time] for name, time in pairs}

    latency = {"key": "latency", "quantity": "a fused multiply-add that waits for the one before", "unit": "s"}
    cycle = {"key": "cycle", "quantity": f"a clock cycle: the latency of a fused multiply-add divided by {CYCLES}", "unit": "s"}
    peak = {"key": "rate", "quantity": f"peak rate of operations on vectors of {lanes}, with two per multiply-add", "unit": "1/s"}
    return [row(latency, partial(value, 1.0)), row(cycle, partial(value, 1 / CYCLES)), row(peak, rate)]
