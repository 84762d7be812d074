"""When values can be ready, and in which order to write their instructions.

A processor that reorders looks a few hundred instructions ahead, less than a step of a linkage has. So the text should already
stand in an order that keeps the chain of dependent operations moving: each instruction as late as the end of the loop allows, the
most urgent first (list scheduling by height; Hennessy and Patterson, Computer Architecture, appendix H).
"""

from collections.abc import Iterable, Mapping

from gauss_bench.compiler.machine.graph import Graph

LATENCY = {
    "const": 0, "leaf": 0, "neg": 0, "bits": 0, "real": 0, "abs": 1, "and": 1, "plus": 1, "shl": 1, "xor": 1, "both": 1, "select":
    1, "add": 3, "sub": 3, "mul": 3, "fma": 4, "lt": 3, "le": 3, "nonzero": 3, "div": 13, "sqrt": 20,
}  # fmt: skip
ROUNDS = 6  # of the feedback from the end of a loop to its beginning; urgency settles after two or three


def live(g: Graph, roots: Iterable[int]) -> list[int]:
    """The values that the roots need, oldest first."""
    found: set[int] = set()
    waiting = list(roots)
    while waiting:
        x = waiting.pop()
        if x not in found:
            found.add(x)
            waiting += g.operands[x]
    return sorted(found)


def ready_times(g: Graph, values: Iterable[int], arrival: Mapping[str, float]) -> dict[int, float]:
    """When each value is ready on a machine without limits [cycles]; leaves arrive as given, or at 0."""
    times: dict[int, float] = {}
    for x in values:
        if g.operation[x] == "leaf":
            times[x] = arrival.get(str(g.payload[x]), 0.0)
        else:
            times[x] = max((times[k] for k in g.operands[x]), default=0.0) + LATENCY[g.operation[x]]
    return times


def period(g: Graph, values: list[int], carried: Mapping[str, int]) -> float:
    """Cycles that a turn of a loop needs without limits; `carried` maps the name of a leaf to the value that becomes it."""
    arrival = dict.fromkeys(carried, 0.0)
    found = 0.0
    for _ in range(ROUNDS):
        times = ready_times(g, values, arrival)
        found = max((times[x] for x in carried.values()), default=0.0)
        arrival = {name: times[x] - found for name, x in carried.items()}
    return found


def order(g: Graph, values: list[int], carried: Mapping[str, int]) -> list[int]:
    """The values in the order of their urgency: the longest way from them to the end, through further turns of the loop."""
    leaves = {str(g.payload[x]): x for x in values if g.operation[x] == "leaf"}
    turn = period(g, values, carried)
    late = dict.fromkeys(carried.values(), 0.0)
    for _ in range(ROUNDS):
        height = dict.fromkeys(values, -turn) | late
        for x in reversed(values):
            for k in g.operands[x]:
                height[k] = max(height[k], height[x] + LATENCY[g.operation[x]])
        late = dict.fromkeys(carried.values(), -turn)
        for name, x in carried.items():
            if name in leaves:
                late[x] = max(late[x], height[leaves[name]] - turn)
    return sorted(values, key=lambda x: (-height[x], x))
