"""What this processor leaves to be gained: how long a step must take for one trajectory and for many, and the share reached.

Two tiny loops are generated, compiled and raced beside the steps. One is a chain of fused multiply-adds, each waiting for the one
before: its time per link is their latency, which is CYCLES cycles on every x86 processor since 2015, and so gives the length of a
cycle. The other has CHAINS independent chains of vectors: its rate, a fused multiply-add being two operations, is the peak rate.

    one trajectory: cycles of the longest chain through a step * length of a cycle
    many:           operations of a step / peak rate

The chain is that of the compiled step itself, carried from one turn of the loop to the next, at the latencies that the code
generator assumes. No code reaches the peak rate: most operations have nothing to be fused with, and a division, which counts as one
here, takes the place of eight or more. Source: Hennessy and Patterson, Computer Architecture, sections 1.8 and 3.10 (bounds,
limits of parallelism).
"""

from functools import partial

import numpy as np

from gauss_bench.bench.clock import Block, lasting
from gauss_bench.bench.kernel_timing import Key, Measured, Race, Row, row, spread
from gauss_bench.bench.measurements.claim import BATCH
from gauss_bench.bench.measurements.steps import QUANTITY
from gauss_bench.compiler.elimination.program import known_program
from gauss_bench.compiler.errors import KernelError
from gauss_bench.compiler.machine import native_code
from gauss_bench.compiler.machine.code import read_code
from gauss_bench.compiler.machine.graph import LATENCY, constant_values, leaves, period
from gauss_bench.compiler.stepping import rollout as loops
from gauss_bench.compiler.stepping.rollout import WrittenOut
from gauss_bench.compiler.stepping.steps import REACHES
from gauss_bench.mechanism.model import Mechanism

CYCLES = LATENCY["fma"]
CHAINS = 16  # two in flight for each of two pipes and four cycles
LINKS = 16  # of the chain in one turn of the loop
TURNS = 2_000
FLOPS = {"add": 1, "sub": 1, "mul": 1, "div": 1, "sqrt": 1, "fma": 2}
LATENCY_KEY, RATE_KEY = Key("latency", "processor"), Key("rate", "processor")
BOUNDS = {QUANTITY: "one trajectory", BATCH: "a batch"}


def chain_text(chains: int, links: int, lanes: int) -> str:
    """A module whose `accelerate` goes `groups` times through x = a x + b, `links` times for each of `chains` chains."""
    real = f"<{lanes} x double>"
    number = {x: f"<{', '.join([f'double {x}'] * lanes)}>" for x in ("0.5", "1.0")}
    lines = [f"define void @accelerate({', '.join(f'ptr %{x}' for x in ('y', 'p', 't', 'out'))}, i64 %groups) {{", "entry:"]
    lines += ["  br label %loop", "loop:", "  %k = phi i64 [0, %entry], [%next, %loop]"]
    lines += [f"  %x{c}_0 = phi {real} [{number['1.0']}, %entry], [%x{c}_{links}, %loop]" for c in range(chains)]
    for i in range(links):
        arguments = [", ".join(f"{real} {x}" for x in (f"%x{c}_{i}", number["0.5"], number["1.0"])) for c in range(chains)]
        lines += [f"  %x{c}_{i + 1} = call {real} @llvm.fma.v{lanes}f64({x})" for c, x in enumerate(arguments)]
    lines += [
        "  %next = add i64 %k, 1",
        "  %more = icmp slt i64 %next, %groups",
        "  br i1 %more, label %loop, label %done",
        "done:",
    ]
    lines += [f"  store {real} %x{c}_{links}, ptr %out, align 8" for c in range(chains)]
    lines += ["  ret void", "}", f"declare {real} @llvm.fma.v{lanes}f64({real}, {real}, {real})"]
    return "\n".join(lines)


def enter_processor(race: Race) -> None:
    """Enter both loops; a repetition is one vector operation."""

    def make(chains: int, lanes: int) -> Block:
        if not native_code.available():
            raise KernelError("the loops that measure the processor need the package llvmlite")
        code = native_code.compile_text(chain_text(chains, LINKS, lanes), "accelerate", chains * LINKS)
        out = np.empty(lanes)
        address = out.ctypes.data
        return lasting(None, lambda: (out, code.call(None, None, None, address, TURNS)), chains * LINKS * TURNS)

    race.add(LATENCY_KEY, lambda: make(1, 2))
    race.add(RATE_KEY, lambda: make(CHAINS, native_code.best_lanes()))


def processor_rows(measured: Measured) -> list[Row]:
    """Latency, length of a cycle and peak rate, as quantities."""
    lanes = native_code.best_lanes()

    def value(factor: float) -> Row:
        return spread("value", measured.of(LATENCY_KEY) * factor)

    def rate() -> Row:
        slow = spread("value", measured.of(RATE_KEY))
        return {
            "value": 2 * lanes / slow["value"],
            "value_low": 2 * lanes / slow["value_high"],
            "value_high": 2 * lanes / slow["value_low"],
        }

    return [
        row(
            {"key": "latency", "quantity": "a fused multiply-add that waits for the one before", "unit": "s"},
            partial(value, 1.0),
        ),
        row({"key": "cycle", "quantity": f"a cycle, {CYCLES} to that latency", "unit": "s"}, partial(value, 1 / CYCLES)),
        row(
            {"key": "rate", "quantity": f"most operations in vectors of {lanes}, two to a fused multiply-add", "unit": "1/s"}, rate
        ),
    ]


def bound_rows(mechanism: Mechanism, measured: Measured) -> list[Row]:
    """How near a step of Gauss's comes to either bound."""
    found = []
    for quantity, what in BOUNDS.items():
        start: Row = {"mechanism": mechanism.name, "scenario": mechanism.scenario, "quantity": what}
        found.append(row(start, partial(_bounded, mechanism, measured, quantity)))
    return found


def _bounded(mechanism: Mechanism, measured: Measured, quantity: str) -> Row:
    samples = measured.of(Key(quantity, "gauss"))
    body = loops.body(read_code(known_program(mechanism, "gauss", (), None, None), "none"), "rk4", REACHES["rk4"][0])
    if not isinstance(body, WrittenOut):
        return spread("seconds", samples) | {"message": "the step is a loop over its stages, whose chain is not one"}
    g, values, carried = body.step.graph, body.values, body.step.carried
    if quantity == QUANTITY:
        bound = period(g, values, carried) * float(np.quantile(measured.of(LATENCY_KEY), 0.25)) / CYCLES
    else:
        bound = flops(body) * float(np.quantile(measured.of(RATE_KEY), 0.25)) / (2 * native_code.best_lanes())
    times = spread("seconds", samples)
    return times | {"cycles": period(g, values, carried), "flops": flops(body), "bound": bound, "share": bound / times["seconds"]}


def flops(body: WrittenOut) -> int:
    """Additions, multiplications and divisions in one turn of the loop; a fused multiply-add counts twice."""
    g, carried = body.step.graph, body.step.carried
    fixed = {name: "" for name in leaves(g, body.values) if name not in carried and name != "%t"}
    before = set(constant_values(g, body.values, fixed))
    return sum(FLOPS.get(g.operation[x], 0) for x in body.values if x not in before)
