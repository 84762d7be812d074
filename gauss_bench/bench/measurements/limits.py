"""Compute lower bounds of the time of a step on this processor, for one trajectory and for many, and the ratio bound / time.

For one trajectory, the bound is the length of a cycle times the cycles of the longest sequence of dependent operations from one
iteration of the compiled loop to the next, at the latencies that the code generator assumes. For many trajectories, it is the
number of operations of a step divided by the peak rate of the processor. Both properties of the processor are measured in the race
of the engines. No code reaches the peak rate: most operations cannot be fused, and divisions take eight times as long or more.

Source: Hennessy and Patterson, Computer Architecture, sections 1.8 and 3.10 (bounds, limits of parallelism).
"""

from collections.abc import Hashable

from gauss_bench.bench.clock import Key, Measured, Row, pad, row, spread
from gauss_bench.bench.measurements.cost import BATCH, NATIVE, gather_by_linkage
from gauss_bench.bench.measurements.processor import CYCLES, LATENCY_KEY, RATE_KEY, name_machine, processor_rows
from gauss_bench.bench.tasks import Context, Tables, Task, place_of
from gauss_bench.compiler.elimination.program import known_program
from gauss_bench.compiler.errors import KernelError
from gauss_bench.compiler.machine import native_code
from gauss_bench.compiler.machine.code import Code
from gauss_bench.compiler.machine.graph import find_dependents
from gauss_bench.compiler.machine.schedule import period
from gauss_bench.compiler.stepping.rollout import bodies
from gauss_bench.compiler.stepping.steps import REACHES
from gauss_bench.linkage.load import load
from gauss_bench.suites.schema import Suite
from gauss_bench.terms import Array

FLOPS = {"add": 1, "sub": 1, "mul": 1, "div": 1, "sqrt": 1, "fma": 2}  # instruction -> floating-point operations
ONE, MANY = "one trajectory", "a batch"
# kind of bound -> the timed quantity, the key of the processor's limit, and the column of the count
QUANTITIES = {ONE: (NATIVE, LATENCY_KEY, "cycles"), MANY: (BATCH, RATE_KEY, "flops")}


def exact_tasks(suite: Suite, context: Context) -> list[Task]:
    """Return one task, which measures no times, for each linkage on which a suite measures the processor's speed."""
    if not suite.bounds:
        return []
    places = dict.fromkeys(x for part in suite.cost if part.processor for x in part.linkages.items())
    return [context.task("kernel_bounds", count_operations, place, *place) for place in places]


def count_operations(linkage: str, scenario: str) -> Tables:
    """Count the cycles of the longest chain of operations in a compiled step, and the floating-point operations of the step.

    There is one row for each bound, for one trajectory and for a batch, or none if the linkage cannot be compiled.
    """
    mechanism = load(linkage, scenario or None)
    shortest = REACHES["rk4"][:1]  # code for steps in which angles move little, which every run tries first
    try:
        # one reach is asked for, so that one loop body is returned
        (body,) = bodies(Code(known_program(mechanism, "gauss"), "none"), "rk4", shortest)
    except KernelError:
        return {"kernel_bounds": []}  # the row of the race has the reason
    graph = body.step.graph
    # values that do not depend on the state or the time are computed once, before the loop
    varying = find_dependents(graph, [graph.leaf(name) for name in (*body.step.carried, "%t")])
    flops = sum(FLOPS.get(graph.operation[x], 0) for x in body.values if x in varying)
    counts = {"cycles": period(graph, body.values, body.step.carried), "flops": flops}
    return {"kernel_bounds": [place_of(mechanism) | {"quantity": quantity} | counts for quantity in (ONE, MANY)]}


def complete(suite: Suite, tables: Tables) -> None:
    """Complete the rows of `kernel_bounds` with times and bounds, and add the table `kernel_machine` of all races."""
    races = gather_by_linkage(tables)
    for part in suite.bounds:
        rows = tables.get("kernel_bounds", [])
        for number, counted in enumerate(rows):
            measured = races.get((counted["mechanism"], counted["scenario"]), Measured({}, {}))  # empty without a race
            rows[number] = row(counted, compare_with_bound, counted, part.own, measured)
        samples: dict[Hashable, Array] = {}  # of all races
        for key in (LATENCY_KEY, RATE_KEY):
            processes = [rounds for race in races.values() for rounds in race.samples.get(key, ())]
            if processes:
                samples[key] = pad(processes)
        tables["kernel_machine"] = processor_rows(Measured(samples, {})) + name_machine()


def compare_with_bound(start: Row, engine: str, measured: Measured) -> Row:
    """Return the columns of the measured time of an engine's step, its lower `bound`, and `share`, the ratio bound / time.

    `start` is a row of `count_operations`.

    Raises:
        Failure: the time of a step, or the speed of the processor, was not measured.
    """
    quantity, machine, count = QUANTITIES[start["quantity"]]
    times = spread("seconds", measured.of(Key(quantity, engine)))
    # `unit` is the time of a multiply-add: a latency of CYCLES cycles, or two operations in each lane of a vector
    unit = measured.time(machine)
    bound = start[count] * unit / (CYCLES if count == "cycles" else 2 * native_code.best_lanes())
    return times | {"bound": bound, "share": bound / times["seconds"]}
