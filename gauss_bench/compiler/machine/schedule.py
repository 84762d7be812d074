"""The order in which the values of a graph are computed: most urgent first.

List scheduling by height (Hennessy and Patterson, Computer Architecture, appendix H): an out-of-order processor looks a few hundred
instructions ahead, which is less than a step of a linkage has.
"""

from collections.abc import Iterable, Mapping

from gauss_bench.compiler.machine.graph import LATENCY, Graph, live

ROUNDS = 6  # passes that carry times from the end of a loop to its beginning; urgency settles after two or three


def ready_times(g: Graph, values: Iterable[int], arrival: Mapping[str, float]) -> dict[int, float]:
    """Return the time [cycles] at which each value is ready with unlimited execution units; leaves arrive as given, or at 0."""
    times: dict[int, float] = {}
    for x in values:
        if g.operation[x] == "leaf":
            times[x] = arrival.get(str(g.payload[x]), 0.0)
        else:
            times[x] = max((times[k] for k in g.operands[x]), default=0.0) + LATENCY[g.operation[x]]
    return times


def period(g: Graph, values: list[int], carried: Mapping[str, int]) -> float:
    """Return the cycles per loop turn with unlimited execution units; `carried` maps a leaf's name to its next value."""
    arrival = dict.fromkeys(carried, 0.0)  # [cycles] of the carried leaves, relative to the beginning of a turn
    turn = 0.0
    for _ in range(ROUNDS):
        times = ready_times(g, values, arrival)
        turn = max((times[x] for x in carried.values()), default=0.0)
        arrival = {name: times[x] - turn for name, x in carried.items()}
    return turn


def order(g: Graph, roots: Iterable[int], carried: Mapping[str, int], plain: bool = False) -> list[int]:
    """Return all values that the roots need, the most urgent first, or the oldest first if `plain`.

    The urgency of a value is the length [cycles] of the longest path from it to the end, through further turns of the loop;
    `carried` maps the name of a leaf to its value in the next turn.
    """
    values = live(g, roots)
    if plain:
        return values
    leaves = {str(g.payload[x]): x for x in values if g.operation[x] == "leaf"}
    turn = period(g, values, carried)
    late = dict.fromkeys(carried.values(), 0.0)  # heights of the carried values
    for _ in range(ROUNDS):
        height = dict.fromkeys(values, -turn) | late
        for x in reversed(values):  # users before their operands
            for k in g.operands[x]:
                height[k] = max(height[k], height[x] + LATENCY[g.operation[x]])
        # a carried value is as urgent as its leaf in the next turn
        late = dict.fromkeys(carried.values(), -turn)
        for name, x in carried.items():
            if name in leaves:
                late[x] = max(late[x], height[leaves[name]] - turn)
    return sorted(values, key=lambda x: (-height[x], x))
