"""Lower bounds for the time of a step on this processor, for one trajectory and for many, and the share of them that is reached.

    one trajectory: cycles of the longest chain through a step * length of a cycle
    many:           operations of a step / peak rate

The chain is the longest one from one turn of the compiled loop to the next, at the latencies that the code generator assumes.
Cycle and rate are measured in the same race. No code reaches the peak rate: most operations cannot be fused, and a division, which
counts as one operation here, takes the time of eight or more. Source: Hennessy and Patterson, Computer
Architecture, sections 1.8 and 3.10 (bounds, limits of parallelism).
"""

from gauss_bench.bench.clock import Key, Measured, Row, pad, row, spread
from gauss_bench.bench.measurements.cost import BATCH, NATIVE, gather_by_linkage
from gauss_bench.bench.measurements.processor import CYCLES, LATENCY_KEY, RATE_KEY, name_machine, processor_rows
from gauss_bench.bench.tasks import Context, Tables, Task
from gauss_bench.compiler.elimination.program import known_program
from gauss_bench.compiler.errors import KernelError
from gauss_bench.compiler.machine import native_code
from gauss_bench.compiler.machine.code import read_code
from gauss_bench.compiler.machine.graph import find_dependents
from gauss_bench.compiler.machine.schedule import period
from gauss_bench.compiler.stepping.rollout import Body, bodies
from gauss_bench.compiler.stepping.steps import REACHES
from gauss_bench.linkage.load import load
from gauss_bench.suites.schema import Suite

FLOPS = {"add": 1, "sub": 1, "mul": 1, "div": 1, "sqrt": 1, "fma": 2}
ONE, MANY = "one trajectory", "a batch"
QUANTITIES = {ONE: (NATIVE, LATENCY_KEY, "cycles"), MANY: (BATCH, RATE_KEY, "flops")}


def exact_tasks(suite: Suite, context: Context) -> list[Task]:
    """Return the tasks that find chain and operations of a compiled step, one for each linkage of the races."""
    if not suite.bounds:
        return []
    places = dict.fromkeys(x for part in suite.cost if part.processor for x in part.linkages.items())
    return [context.task("kernel_bounds", count_operations, x, *x) for x in places]


def count_operations(linkage: str, scenario: str) -> Tables:
    """Return one row for each kind of bound, still without times; none where the linkage cannot be compiled."""
    mechanism = load(linkage, scenario or None)
    start: Row = {"mechanism": mechanism.name, "scenario": mechanism.scenario}
    try:
        (body,) = bodies(read_code(known_program(mechanism, "gauss", (), None, None), "none"), "rk4", REACHES["rk4"][:1])
    except KernelError:
        return {"kernel_bounds": []}  # the row of the race has the reason
    counts = {"cycles": period(body.step.graph, body.values, body.step.carried), "flops": flops(body)}
    return {"kernel_bounds": [start | {"quantity": quantity} | counts for quantity in (ONE, MANY)]}


def complete(suite: Suite, tables: Tables) -> None:
    """Fill in times, bounds and shares, and add the processor's latency and rate over all races."""
    races = gather_by_linkage(tables)
    for part in suite.bounds:
        rows = tables.get("kernel_bounds", [])
        for number, start in enumerate(rows):
            measured = races.get((start["mechanism"], start["scenario"]), Measured({}, {}))
            rows[number] = row(start, limit, start, part.own, measured)
        samples = {k: [row for m in races.values() if k in m.samples for row in m.samples[k]] for k in (LATENCY_KEY, RATE_KEY)}
        tables["kernel_machine"] = processor_rows(Measured({k: pad(x) for k, x in samples.items() if x}, {})) + name_machine()


def limit(start: Row, own: str, measured: Measured) -> Row:
    """Return the time of a step, its lower bound, and the bound over the time.

    Raises:
        Failure: something was not measured.
    """
    quantity, machine, count = QUANTITIES[start["quantity"]]
    times = spread("seconds", measured.of(Key(quantity, own)))
    unit = measured.time(machine)
    bound = start[count] * unit / (CYCLES if count == "cycles" else 2 * native_code.best_lanes())
    return times | {"bound": bound, "share": bound / times["seconds"]}


def flops(body: Body) -> int:
    """Count additions, multiplications and divisions in one turn of the loop; a fused multiply-add counts twice."""
    g = body.step.graph
    varying = find_dependents(g, [g.leaf(name) for name in (*body.step.carried, "%t")])
    return sum(FLOPS.get(g.operation[x], 0) for x in body.values if x in varying)
