"""The order in which the values of a graph are computed: most urgent first.

A value is the more urgent, the longer the chain of operations that waits for it.

List scheduling by height (Hennessy and Patterson, Computer Architecture, appendix H): an out-of-order processor looks a few hundred
instructions ahead, which is less than a step of a linkage has.
"""

from collections.abc import Iterable, Mapping

from gauss_bench.compiler.machine.graph import LATENCY, Graph, live

ROUNDS = 6  # passes over a loop, each of which carries times across its end to its beginning; they settle after two or three


def ready_times(g: Graph, values: Iterable[int], arrival: Mapping[str, float]) -> dict[int, float]:
    """Return the time [cycles] at which each value is ready with unlimited execution units.

    `arrival` has the times at which leaves are there, by name; others are there at 0.
    """
    times: dict[int, float] = {}
    for x in values:
        if g.operation[x] == "leaf":
            times[x] = arrival.get(str(g.payload[x]), 0.0)
        else:
            times[x] = max((times[k] for k in g.operands[x]), default=0.0) + LATENCY[g.operation[x]]
    return times


def period(g: Graph, values: list[int], carried: Mapping[str, int]) -> float:
    """Return the cycles per iteration of a loop with unlimited execution units.

    `carried` maps the name of each leaf that the loop changes to its value in the next iteration.
    """
    arrival = dict.fromkeys(carried, 0.0)  # [cycles] of the carried leaves, relative to the beginning of an iteration
    cycles = 0.0
    for _ in range(ROUNDS):
        times = ready_times(g, values, arrival)
        cycles = max((times[x] for x in carried.values()), default=0.0)
        arrival = {name: times[x] - cycles for name, x in carried.items()}
    return cycles


def order(g: Graph, roots: Iterable[int], carried: Mapping[str, int], plain: bool = False) -> list[int]:
    """Return all values that the roots need, the most urgent first, or the oldest first if `plain`.

    The urgency of a value is its height: the length [cycles] of the longest path from it to the end of the iteration, or into later
    iterations of the loop, each of which counts one period less. `carried` maps the name of each leaf that the loop changes to its
    value in the next iteration.
    """
    values = live(g, roots)
    if plain:
        return values
    leaves = {str(g.payload[x]): x for x in values if g.operation[x] == "leaf"}
    cycles = period(g, values, carried)
    carried_height = dict.fromkeys(carried.values(), 0.0)
    for _ in range(ROUNDS):  # each pass carries heights through one iteration more
        height = dict.fromkeys(values, -cycles) | carried_height  # -cycles: nothing in this iteration or a later one waits for it
        for x in reversed(values):  # users before their operands
            for k in g.operands[x]:
                height[k] = max(height[k], height[x] + LATENCY[g.operation[x]])
        # a carried value is as urgent as its leaf in the next iteration, which begins one period later
        carried_height = dict.fromkeys(carried.values(), -cycles)
        for name, x in carried.items():
            if name in leaves:
                carried_height[x] = max(carried_height[x], height[leaves[name]] - cycles)
    return sorted(values, key=lambda x: (-height[x], x))
