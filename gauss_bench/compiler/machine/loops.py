"""Groups joined to loops, and places in memory.

A loop does several groups at once, lane by lane, and what one of them makes and another needs in the same lane stays in registers.
A group may join a loop of its own number of lanes if everything else it needs has been made in earlier loops.

Memory is one array of elements, an element being one double or one for each trajectory. In it stand one after the other

    x, y, theta of all links; their rates; t; a number to waste; accelerations in the same order; the guard; solutions; results

and each of these arrays has room behind it up to a multiple of eight, so that whole vectors can be stored.
"""

from collections.abc import Iterable
from dataclasses import dataclass, field

from gauss_bench.compiler.elimination.side_by_side import Equations
from gauss_bench.compiler.machine.groups import Group, Groups

LONGEST = 64  # groups in a loop: beyond, registers run out
WIDEST = 8  # doubles in a vector


def padded(count: int) -> int:
    """Room for so many elements and whole vectors."""
    return -(-count // WIDEST) * WIDEST


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
        ends: last elements of arrays: behind them is room.
        stride: from one coordinate of all links to the next.
        size: elements.
    """

    place: dict[int, int]
    ends: set[int]
    links: int
    stride: int
    size: int

    @property
    def state(self) -> int:
        """Elements of q and v, from the first."""
        return 6 * self.stride

    @property
    def t(self) -> int:
        return self.state

    @property
    def spare(self) -> int:
        return self.state + 1

    @property
    def a(self) -> int:
        """First acceleration; the guard follows the last."""
        return self.state + WIDEST

    @property
    def out(self) -> int:
        """Elements of accelerations and guard."""
        return 3 * self.stride + WIDEST

    def coordinate(self, j: int) -> int:
        """Place of coordinate j of the mechanism among those of all links; that of the guard behind the last."""
        return 3 * self.stride if j == 3 * self.links else j % 3 * self.stride + j // 3

    def room(self, places: list[int]) -> bool:
        """Whether nothing is lost behind the last of some neighbouring places."""
        behind = places[0] + padded(len(places))
        return behind == places[-1] + 1 or (places[-1] in self.ends and behind <= padded(places[-1] + 1))


def loops(groups: Groups) -> list[Loop]:
    """All groups in loops, in an order in which they can be done."""
    found: list[Loop] = []
    done_in: dict[int, int] = {}  # value -> loop
    in_lanes: dict[tuple[int, ...], int] = {}  # results, lane by lane -> loop
    for group in groups.groups:
        first = 0
        for values in group.operands:
            at = in_lanes.get(values)
            if at is not None and found[at].lanes == group.lanes:
                first = max(first, at)
            else:
                first = max([first, *(done_in[v] + 1 for v in values if v in done_in)])
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


def needed_outside(found: Iterable[Loop]) -> set[int]:
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
    links = equations.mechanism.n // 3
    shape = Memory({}, set(), links, padded(links), 0)
    place, ends = shape.place, shape.ends
    starts = {"q": 0, "v": 3 * shape.stride}
    place |= {x: shape.t if name == "t" else starts[name] + shape.coordinate(k) for x, (name, k) in groups.inputs.items()}
    ends |= {shape.a + k * shape.stride + links - 1 for k in range(3)}
    top = shape.a + shape.out
    homes: dict[str, dict[int, int]] = {}
    for x, (name, lane) in equations.homes.items():
        homes.setdefault(name, {})[x] = lane
    for array in homes.values():
        _put(shape, top, array)
        top += padded(max(array.values()) + 1)
    top = _results(shape, found, top)
    return Memory(place, ends, links, shape.stride, padded(top) + WIDEST)


def _put(where: Memory, start: int, array: dict[int, int]) -> None:
    """Place an array of values, given the lane of each."""
    where.place.update({x: start + lane for x, lane in array.items()})
    where.ends.add(start + max(array.values()))


def _results(where: Memory, found: list[Loop], top: int) -> int:
    """Place the results of groups; room whose last reader is done is used again, the latest first, as it is the nearest by.

    Returns:
        the end of memory.
    """
    needed, read = needed_outside(found), _last_readers(found)
    free: dict[int, list[int]] = {}
    ending: dict[int, list[tuple[int, int]]] = {}
    for number, loop in enumerate(found):
        for group in loop.groups:
            own = [x for x in group.results if x not in where.place] if group.operation != "OUT" else []
            if needed.isdisjoint(own):
                continue
            size = padded(len(own)) if len(own) > 1 else 1
            if not free.get(size):
                room = padded(size)  # single values share one vector's
                free[size] = list(range(top, top + room, size))[::-1]
                top += room
            start = free[size].pop()
            where.place.update({x: start + k for k, x in enumerate(own)})
            if size > 1:
                where.ends.add(start + len(own) - 1)
            ending.setdefault(max(read.get(x, number) for x in own), []).append((size, start))
        for size, start in ending.pop(number, []):
            free.setdefault(size, []).append(start)
    return top


def _last_readers(found: list[Loop]) -> dict[int, int]:
    """Value -> the last loop that has it as an operand."""
    read: dict[int, int] = {}
    for number, loop in enumerate(found):
        for group in loop.groups:
            for values in group.operands:
                read |= dict.fromkeys(values, number)
    return read
