"""The order in which the values of a graph are computed: most urgent first.

The longer the chain of operations that waits for a value, the more urgent the value.

List scheduling by height (Hennessy and Patterson, Computer Architecture, appendix H): an out-of-order processor looks a few hundred
instructions ahead, and a step of a linkage has more instructions.
"""

from collections.abc import Iterable, Mapping

from gauss_bench.compiler.machine.graph import LATENCY, Graph, live

# Number of passes over the body of a loop. Each pass carries the times found at the end of an iteration to the beginning of the
# next; the times relative to the iteration are steady after two or three passes.
ROUNDS = 6


def period(g: Graph, values: list[int], carried: Mapping[str, int]) -> float:
    """Return the steady number of cycles per iteration of a loop, on a processor with unlimited execution units.

    An iteration waits only for the variables that it uses. The times at which these are ready are therefore computed for ROUNDS
    iterations, after which the increment per iteration is steady.

    `carried` maps the name of each variable of the loop to its value in the next iteration.
    """
    # [cycles] at which each variable is ready, relative to the beginning of the iteration that uses it
    arrival = dict.fromkeys(carried, 0.0)
    cycles = 0.0
    for _ in range(ROUNDS):
        times: dict[int, float] = {}  # at which each value is ready; leaves that are not carried are ready at 0
        for x in values:
            if g.operation[x] == "leaf":
                times[x] = arrival.get(str(g.payload[x]), 0.0)
            else:
                times[x] = max((times[k] for k in g.operands[x]), default=0.0) + LATENCY[g.operation[x]]
        cycles = max((times[x] for x in carried.values()), default=0.0)
        arrival = {name: times[x] - cycles for name, x in carried.items()}
    return cycles


def order(g: Graph, roots: Iterable[int], carried: Mapping[str, int], plain: bool = False) -> list[int]:
    """Return the roots (results) and all values that they depend on, the most urgent first, or if `plain` in the order of indices.

    The urgency of a value is its height: the length [cycles] of the longest path of operations that wait for the value. A path may
    continue in later iterations of the loop; for each of these, one period (the cycles per iteration) is subtracted:

        height(k) = max over users x of k of (height(x) + latency(x))
        height(next value of a variable) = height(the variable) - period
    """
    values = live(g, roots)
    if plain:
        return values
    leaves = {str(g.payload[x]): x for x in values if g.operation[x] == "leaf"}
    cycles = period(g, values, carried)
    carried_height = dict.fromkeys(carried.values(), 0.0)  # heights that follow from the next iteration
    for _ in range(ROUNDS):  # each pass lets paths continue through one iteration more
        height = dict.fromkeys(values, -cycles) | carried_height  # -cycles: no operation waits for the value
        for x in reversed(values):  # users before their operands
            for k in g.operands[x]:
                height[k] = max(height[k], height[x] + LATENCY[g.operation[x]])
        # a carried value is as urgent as its leaf in the next iteration, which begins one period later
        carried_height = dict.fromkeys(carried.values(), -cycles)
        for name, x in carried.items():
            if name in leaves:
                carried_height[x] = max(carried_height[x], height[leaves[name]] - cycles)
    return sorted(values, key=lambda x: (-height[x], x))
