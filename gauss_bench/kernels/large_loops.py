"""Groups joined to loops, and places in memory.

A loop does several groups at once, lane by lane, and what one of them makes and another needs in the same lane never touches memory.
A group may join a loop of its own number of lanes if everything else it needs has been made in earlier loops.

Memory is one array of elements, an element being one double or one for each trajectory:

    q (x, y, theta of all links), v likewise, t, a likewise, guard, solutions by coordinate, results of groups
"""

from dataclasses import dataclass, field

from gauss_bench.kernels.large_algebra import Equations
from gauss_bench.kernels.large_groups import Group, Groups

LONGEST = 64  # groups in a loop: beyond, registers run out
PADDING = 16  # elements: the widest vector may be loaded and stored at the end of every array


@dataclass(frozen=True, eq=False)
class Loop:
    """Groups of equal numbers of lanes."""

    lanes: int
    groups: list[Group] = field(default_factory=list)


@dataclass(frozen=True, eq=False)
class Memory:
    """Where values stand.

    Attributes:
        place: value -> element, of inputs and of all that is stored.
        padded: results of groups that have room behind them.
        t, a: elements of the time, and of the first acceleration; the guard follows the accelerations.
        spare: an element that nobody reads.
        size: elements.
    """

    place: dict[int, int]
    padded: set[tuple[int, ...]]
    t: int
    a: int
    spare: int
    size: int


def loops(groups: Groups) -> list[Loop]:
    """All groups in loops, in an order in which they can be done."""
    found: list[Loop] = []
    done_in: dict[int, int] = {}  # value -> loop
    in_lanes: dict[tuple[int, ...], int] = {}  # results, lane by lane -> loop
    for group in groups.groups:
        first, own = 0, False
        for values in group.operands:
            at = in_lanes.get(values)
            if at is not None and found[at].lanes == group.lanes:
                own, first = (True, at) if at >= first else (own, first)
            else:
                after = max((done_in[v] + 1 for v in values if v in done_in), default=0)
                own, first = (False, after) if after > first else (own, first)
        number = _fitting(found, group, first)
        found[number].groups.append(group)
        if group.operation != "OUT":
            done_in |= dict.fromkeys(group.results, number)
            if group.operation != "SUM":
                in_lanes[group.results] = number
    return found


def _fitting(found: list[Loop], group: Group, first: int) -> int:
    for number in range(first, len(found)):
        if found[number].lanes == group.lanes and len(found[number].groups) < LONGEST:
            return number
    found.append(Loop(group.lanes))
    return len(found) - 1


def needed_outside(found: list[Loop]) -> set[int]:
    """Values that some loop needs that does not make them in the same lane."""
    needed: set[int] = set()
    for loop in found:
        own = {g.results for g in loop.groups if g.operation not in ("SUM", "OUT")}
        for group in loop.groups:
            for values in group.operands:
                if values not in own:
                    needed.update(values)
    return needed


def memory(equations: Equations, groups: Groups, found: list[Loop]) -> Memory:
    """Places of everything that is stored."""
    n = equations.mechanism.n
    links = n // 3
    t, a = 2 * n, 2 * n + PADDING
    starts = {"q": 0, "v": n}
    place = {x: t if name == "t" else starts[name] + k % 3 * links + k // 3 for x, (name, k) in groups.inputs.items()}
    top = a + n + PADDING
    size: dict[str, int] = {}
    for array, lane in equations.homes.values():
        size[array] = max(size.get(array, 0), lane + 1)
    start = {}
    for array in sorted(size):
        start[array] = top
        top += size[array] + PADDING
    place |= {x: start[array] + lane for x, (array, lane) in equations.homes.items()}
    padded = set()
    needed = needed_outside(found)
    for loop in found:
        for group in loop.groups:
            if group.operation != "OUT" and not place.keys() & set(group.results) and needed & set(group.results):
                place |= {x: top + k for k, x in enumerate(group.results)}
                padded.add(group.results)
                top += -(-len(group.results) // 8) * 8
    for group in (g for loop in found for g in loop.groups if g.operation != "OUT"):
        for x in group.results:
            if x in needed and x not in place:
                place[x] = top
                top += 1
    return Memory(place, padded, t, a, t + 1, top + PADDING)
