"""Equal operations joined: from a straight-line function to loops over lanes, and places in memory.

Expressions are gone through level by level, a level being what can be computed once those before are. Two expressions of a level
belong to one group where they are the same operation on operands of the same groups; what finds no company is joined by operation
alone, and its operands are gathered. The members of a group are its lanes, ordered as their operands are, so that the k-th lane
mostly needs the k-th lane of another group, or the one after: then it can be loaded without gathering.

The stages of the elimination bound the levels (`RoundsProgram.phases`): without them equal steps in loops that are finished in
different rounds would drift apart.

A loop does several groups at once, lane by lane, and what one of them makes and another needs in the same lane stays in registers.
A group may join a loop of its own number of lanes if everything else it needs has been made in earlier loops.

Memory is one array of elements, an element being one double or one for each trajectory. In it stand one after the other what
functions take, what they return, and places to work in (`Layout`). Each part has room behind it up to a multiple of eight, so that
whole vectors can be stored.
"""

from bisect import bisect_right
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import NamedTuple

from gauss_bench.compiler.elimination.rounds import RoundsFunction, RoundsProgram
from gauss_bench.compiler.machine.graph import Graph, Over, Pair, Places, apply, leaves, live, order, rewrite
from gauss_bench.compiler.machine.trigonometry import sincos
from gauss_bench.integrate.fixed_step import EVALUATIONS

FEW = 6  # equal operations; fewer are done one by one
ALIGNED = 12  # equal operations with operands that stand side by side, so many that gathering them with others would cost more
COMMUTATIVE = ("ADD", "MUL")
WORK = "work"  # the array in which everything stands


class Operand(NamedTuple):
    """An operand: a value, or a number, and whether it counts negative."""

    value: int
    negative: bool


@dataclass(frozen=True, eq=False)
class LaneGroup:
    """One operation in several lanes.

    Attributes:
        operation: ADD, MUL, INV, SQRT, SIN, COS, FMIN, FMAX, LE; IS, the operand itself; SUM, over all lanes of its operand; OUT,
            an acceleration or the guard.
        results: the values by lane; the one of a SUM; coordinates of an OUT.
        operands: for each operand the values by lane.
        negative: for each operand whether it counts negative.
    """

    operation: str
    results: tuple[int, ...]
    operands: tuple[tuple[int, ...], ...]
    negative: tuple[bool, ...]

    @property
    def lanes(self) -> int:
        return len(self.operands[0])


@dataclass(frozen=True, eq=False)
class LaneGroups:
    """Groups in an order in which they can be computed.

    Attributes:
        numbers: the values that are numbers; inputs: those that come from outside, by name and index.
    """

    groups: list[LaneGroup]
    numbers: dict[int, float]
    inputs: dict[int, tuple[str, int]]

    @property
    def operations(self) -> int:
        return sum(g.lanes for g in self.groups if g.operation != "OUT")


Kind = tuple[object, ...]
Member = tuple[int, tuple[Operand, ...]]  # a value, and what it is made of


class _Grouping:
    """Groups in the making; kinds and lanes tell where a value stands."""

    def __init__(self, program: RoundsFunction):
        self.program, self.instructions = program, program.function.instructions
        every = list(enumerate(self.instructions))
        self.numbers = {k: x.number for k, x in every if x.operation == "CONST"}
        self.inputs = {k: (program.inputs[x.operands[0]], x.operands[1]) for k, x in every if x.operation == "INPUT"}
        self.groups: list[LaneGroup] = []
        self.kind: dict[int, Kind] = dict.fromkeys(self.numbers, ("number",))
        self.lane: dict[int, int] = dict.fromkeys(self.numbers, 0)
        for value, (name, k) in self.inputs.items():
            self.kind[value], self.lane[value] = (name, k % 3), k // 3
        for value, (array, lane) in program.homes.items():
            self.kind[value], self.lane[value] = (array,), lane
        self.spare = len(self.instructions)

    def _term(self, value: int) -> Operand:
        x = self.instructions[value]
        return Operand(x.operands[0], True) if x.operation == "NEG" else Operand(value, False)

    def made(self) -> LaneGroups:
        for level in self._levels():
            self._level(level)
        a, (sound,) = self.program.function.outputs
        alike: dict[Kind, list[tuple[int, Operand]]] = {}
        for j, t in enumerate(map(self._term, a)):
            alike.setdefault((j % 3, self.kind[t.value], t.negative), []).append((j, t))
        for members in alike.values():
            self.groups.append(_group("OUT", [(j, (t,)) for j, t in members]))
        self.groups.append(_group("OUT", [(len(a), (self._term(sound),))]))
        return LaneGroups(self.groups, self.numbers, self.inputs)

    def _levels(self) -> Iterable[list[int]]:
        """Values by stage and depth within it."""
        depth: dict[int, tuple[int, int]] = {}
        levels: dict[tuple[int, int], list[int]] = {}
        for k, x in enumerate(self.instructions):
            if x.operation in ("CONST", "INPUT", "NEG"):
                continue
            stage = bisect_right(self.program.phases, k)
            before = [depth[t.value] for t in map(self._term, x.operands) if t.value in depth]
            depth[k] = (stage, max((d + 1 for s, d in before if s == stage), default=0))
            levels.setdefault(depth[k], []).append(k)
        return [levels[key] for key in sorted(levels)]

    def _level(self, values: list[int]) -> None:
        alike: dict[Kind, list[Member]] = {}
        for value in values:
            if self.instructions[value].operation == "SUM":
                self._sum(value)
                continue
            operation, terms = self._terms(value)
            key: Kind = (operation, *((self.kind[t.value], t.negative) for t in terms))
            alike.setdefault(key, []).append((value, terms))
        left: dict[Kind, list[Member]] = {}
        for key, members in alike.items():
            if len(members) >= FEW:
                for part in self._align(members):
                    self._keep(str(key[0]), part)
            else:
                rough = (key[0], *((t.negative, t.value in self.numbers) for t in members[0][1]))
                left.setdefault(rough, []).extend(members)
        for key, members in left.items():
            for part in [members] if len(members) >= FEW else [[x] for x in members]:
                self._keep(str(key[0]), part)

    def _align(self, members: list[Member]) -> list[list[Member]]:
        """Members whose operands are a fixed number of lanes apart by themselves, where these are many; the others together."""
        apart: dict[tuple[int, ...], list[Member]] = {}
        for x in members:
            lanes = [self.lane[t.value] for t in x[1] if t.value not in self.numbers]
            apart.setdefault(tuple(k - lanes[0] for k in lanes), []).append(x)
        many = [part for part in apart.values() if len(part) >= ALIGNED]
        rest = [x for part in apart.values() if len(part) < ALIGNED for x in part]
        return [*many, rest] if len(rest) >= FEW else [*many, *([x] for x in rest)]

    def _terms(self, value: int) -> tuple[str, tuple[Operand, ...]]:
        x = self.instructions[value]
        terms = [self._term(k) for k in x.operands]
        if x.operation == "SUB":
            terms[1] = Operand(terms[1].value, not terms[1].negative)
        operation = "ADD" if x.operation == "SUB" else x.operation
        if operation in COMMUTATIVE:
            terms.sort(key=lambda t: (repr(self.kind[t.value]), t.negative, self.lane[t.value]))
        return operation, tuple(terms)

    def _keep(self, operation: str, members: list[Member]) -> None:
        members.sort(key=lambda x: [(repr(self.kind[t.value]), self.lane[t.value]) for t in x[1]])
        number = len(self.groups)
        self.groups.append(_group(operation, members))
        for lane, (value, _) in enumerate(members):
            if value not in self.kind:
                self.kind[value], self.lane[value] = ("group", number), lane

    def _sum(self, value: int) -> None:
        """A long sum: each kind of summands by itself, and these sums one by one."""
        alike: dict[Kind, list[Operand]] = {}
        for t in map(self._term, self.instructions[value].operands):
            alike.setdefault((self.kind[t.value], t.negative), []).append(t)
        parts = []
        for terms in alike.values():
            terms.sort(key=lambda t: self.lane[t.value])
            parts.append(self._partial("SUM", [terms]))
        while len(parts) > 1:
            a, b = (Operand(p, False) for p in parts[:2])
            parts = [*parts[2:], self._partial("ADD", [[a], [b]])]
        last = self.groups.pop()
        self.groups.append(LaneGroup(last.operation, (value,), last.operands, last.negative))
        self.kind[value], self.lane[value] = ("group", len(self.groups) - 1), 0

    def _partial(self, operation: str, operands: list[list[Operand]]) -> int:
        value = self.spare
        self.spare += 1
        values, signs = (tuple(t.value for t in x) for x in operands), tuple(x[0].negative for x in operands)
        self.groups.append(LaneGroup(operation, (value,), tuple(values), signs))
        self.kind[value], self.lane[value] = ("group", len(self.groups) - 1), 0
        return value


def _group(operation: str, members: list[Member]) -> LaneGroup:
    columns = list(zip(*(terms for _, terms in members), strict=True))
    operands = tuple(tuple(t.value for t in column) for column in columns)
    return LaneGroup(operation, tuple(value for value, _ in members), operands, tuple(column[0].negative for column in columns))


def group_values(program: RoundsFunction) -> LaneGroups:
    """The groups that compute a function and its guard."""
    return _Grouping(program).made()


STAGES = EVALUATIONS["dop853_fixed"]  # of the longest step that is a loop over its stages
LONGEST = 64  # groups in a loop: beyond, registers run out
WIDEST = 8  # doubles in a vector


def pad(count: int) -> int:
    """Room for so many elements and whole vectors."""
    return -(-count // WIDEST) * WIDEST


@dataclass(frozen=True, eq=False)
class Loop:
    """Groups of equal numbers of lanes."""

    lanes: int
    groups: list[LaneGroup] = field(default_factory=list)


@dataclass(frozen=True)
class Layout:
    """The layout of memory before the places to work in: arrays of coordinates by coordinate, links side by side.

    Arrays, by name: "q", "v" what functions are evaluated at; "out" what they return, with the number of guards that hold; "q_new"
    what a correction starts from; "q_begin", "v_begin" the state a step begins with; "q_sum", "v_sum" sums over its stages;
    "stages" accelerations at each of them, and "weights" what they count.
    """

    links: int
    parameters: int

    @property
    def stride(self) -> int:
        """From one coordinate of all links to the next."""
        return pad(self.links)

    @property
    def starts(self) -> dict[str, int]:
        """First element of each array."""
        names = ("q", "v", "q_new", "q_begin", "v_begin", "q_sum", "v_sum", "out")
        starts = {name: 3 * self.stride * k for k, name in enumerate(names)}
        t = starts["out"] + 3 * self.stride + WIDEST
        stages = t + WIDEST + pad(self.parameters)
        return starts | {"t": t, "t_new": t + 1, "p": t + WIDEST, "stages": stages, "weights": stages + 3 * self.stride * STAGES}

    @property
    def top(self) -> int:
        """First element to work in."""
        return self.starts["weights"] + pad((STAGES + 1) * (2 * STAGES + 1))

    def coordinate(self, j: int) -> int:
        """Place of coordinate j of the mechanism in an array of coordinates; that of the guard behind the last."""
        return 3 * self.stride if j == 3 * self.links else j % 3 * self.stride + j // 3

    def place(self, name: str, k: int) -> int:
        """Place of one number."""
        return self.starts[name] + (self.coordinate(k) if name not in ("t", "t_new", "p") else k)

    def places(self, name: str) -> Places:
        """All coordinates in the order of the mechanism."""
        return Places(WORK, tuple(self.place(name, j) for j in range(3 * self.links)))

    def whole(self, name: str) -> Places:
        """An array of coordinates as it stands."""
        return Places(WORK, tuple(range(self.starts[name], self.starts[name] + 3 * self.stride)), room=True)


@dataclass(frozen=True, eq=False)
class Memory:
    """The places of one function's values.

    Attributes:
        place: value -> element, of inputs and of all that is stored.
        ends: last elements of arrays: behind them is room.
        size: elements.
    """

    layout: Layout
    place: dict[int, int]
    ends: set[int]
    size: int

    def stored(self, group: "LaneGroup") -> list[int]:
        """Places of a group's results."""
        if group.operation == "OUT":
            return [self.layout.place("out", j) for j in group.results]
        return [self.place[v] for v in group.results]

    def room(self, places: list[int]) -> bool:
        """Tell whether nothing is lost behind the last of some neighbouring places."""
        behind = places[0] + pad(len(places))
        return behind == places[-1] + 1 or (places[-1] in self.ends and behind <= pad(places[-1] + 1))


def loops(groups: LaneGroups) -> list[Loop]:
    """All groups in loops, in an order in which they can be done."""
    made: list[Loop] = []
    done_in: dict[int, int] = {}  # value -> loop
    in_lanes: dict[tuple[int, ...], int] = {}  # results, lane by lane -> loop
    for group in groups.groups:
        first = 0
        for values in group.operands:
            at = in_lanes.get(values)
            if at is not None and made[at].lanes == group.lanes:
                first = max(first, at)
            else:
                first = max([first, *(done_in[v] + 1 for v in values if v in done_in)])
        number = _fitting(made, group, first)
        made[number].groups.append(group)
        if group.operation != "OUT":
            done_in |= dict.fromkeys(group.results, number)
            if group.operation != "SUM":
                in_lanes[group.results] = number
    return made


def _fitting(made: list[Loop], group: LaneGroup, first: int) -> int:
    for number in range(first, len(made)):
        if made[number].lanes == group.lanes and len(made[number].groups) < LONGEST:
            return number
    made.append(Loop(group.lanes))
    return len(made) - 1


def list_needed_outside(program: Iterable[Loop]) -> set[int]:
    """Values that some loop needs that does not make them in the same lane."""
    needed: set[int] = set()
    for loop in program:
        own = {g.results for g in loop.groups if g.operation not in ("SUM", "OUT")}
        for group in loop.groups:
            for values in group.operands:
                if values not in own:
                    needed.update(values)
    return needed


def memory(layout: Layout, program: RoundsFunction, groups: LaneGroups, order: list[Loop]) -> Memory:
    """Places of everything that is stored."""
    place = {x: layout.place(name, k) for x, (name, k) in groups.inputs.items()}
    ends = {layout.place("out", 3 * layout.links - 3 + k) for k in range(3)}
    shape, top = Memory(layout, place, ends, 0), layout.top
    homes: dict[str, dict[int, int]] = {}
    for x, (name, lane) in program.homes.items():
        homes.setdefault(name, {})[x] = lane
    for array in homes.values():
        _put(shape, top, array)
        top += pad(max(array.values()) + 1)
    top = _results(shape, order, top)
    return Memory(layout, place, ends, pad(top) + WIDEST)


def _put(where: Memory, start: int, array: dict[int, int]) -> None:
    """Place an array of values, given the lane of each."""
    where.place.update({x: start + lane for x, lane in array.items()})
    where.ends.add(start + max(array.values()))


def _results(where: Memory, order: list[Loop], top: int) -> int:
    """Place the results of groups; room whose last reader is done is used again, the latest first, as it is the nearest by.

    Returns:
        the end of memory.
    """
    needed, read = list_needed_outside(order), _last_readers(order)
    free: dict[int, list[int]] = {}
    ending: dict[int, list[tuple[int, int]]] = {}
    for number, loop in enumerate(order):
        for group in loop.groups:
            own = [x for x in group.results if x not in where.place] if group.operation != "OUT" else []
            if needed.isdisjoint(own):
                continue
            size = pad(len(own)) if len(own) > 1 else 1
            if not free.get(size):
                room = pad(size)  # single values share one vector's
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


def _last_readers(order: list[Loop]) -> dict[int, int]:
    """Value -> the last loop that has it as an operand."""
    read: dict[int, int] = {}
    for number, loop in enumerate(order):
        for group in loop.groups:
            for values in group.operands:
                read |= dict.fromkeys(values, number)
    return read


class Block:
    """The arithmetic of one loop, for whatever machine.

    Attributes:
        graph, order: values of one lane, in the order in which to write them.
        loads: leaf -> what it is in every lane, values or numbers.
        library: whether sines are left to the target's own functions, and the rest to its compiler.
        kept: groups whose results are stored, added up or returned, and their values.
    """

    def __init__(self, loop: Loop, groups: LaneGroups, needed: set[int], library: bool = False):
        self.groups, self.library, self.graph, self.lanes = groups, library, Graph(), loop.lanes
        self._made: dict[tuple[int, ...], int] = {}
        self._leaves: dict[tuple[int, ...], str] = {}
        kept: list[tuple[LaneGroup, int]] = []
        for group in loop.groups:
            x = [self._operand(*operand) for operand in zip(group.operands, group.negative, strict=True)]
            value = x[0] if group.operation == "SUM" else apply(self.graph, group.operation, x, self._sincos)
            if group.operation not in ("SUM", "OUT"):
                self._made[group.results] = value
            if group.operation in ("SUM", "OUT") or needed & set(group.results):
                kept.append((group, value))
        if not library:
            self.graph, moved = rewrite(self.graph, [x for _, x in kept])
            kept = [(group, x) for (group, _), x in zip(kept, moved, strict=True)]
        self.kept = kept
        roots = list(dict.fromkeys(x for _, x in kept))
        self.order = live(self.graph, roots)
        if not library:
            self.order = order(self.graph, self.order, {str(k): x for k, x in enumerate(roots)})
        by_name = {name: values for values, name in self._leaves.items()}
        self.loads = {x: by_name[name] for name, x in leaves(self.graph, self.order).items()}

    def _sincos(self, x: int) -> Pair:
        return (self.graph.make("sin", x), self.graph.make("cos", x)) if self.library else sincos(self.graph, x)

    def sums(self) -> list[int]:
        """Values that are sums over the lanes."""
        return [g.results[0] for g, _ in self.kept if g.operation == "SUM"]

    def _operand(self, values: tuple[int, ...], negative: bool) -> int:
        numbers, g = self.groups.numbers, self.graph
        if values in self._made:
            x = self._made[values]
        elif all(v in numbers for v in values) and len({numbers[v] for v in values}) == 1:
            x = g.const(numbers[values[0]])
        else:
            x = g.leaf(self._leaves.setdefault(values, f"leaf{len(self._leaves)}"))
        return g.neg(x) if negative else x

    def over(self, m: Memory) -> Over:
        """The loop as a statement."""

        def places(values: tuple[int, ...]) -> Places | tuple[float, ...]:
            numbers = self.groups.numbers
            if values[0] in numbers:
                return tuple(numbers[v] for v in values)
            return Places(WORK, tuple(m.place[v] for v in values), room=True)

        stores, sums = [], []
        for group, x in self.kept:
            if group.operation == "SUM":
                sums.append((x, Places(WORK, (m.place.get(group.results[0], m.size - 1),))))
            else:
                at = m.stored(group)
                stores.append((x, Places(WORK, tuple(at), room=m.room(at))))
        loads = {x: places(values) for x, values in self.loads.items()}
        return Over(self.lanes, self.graph, self.order, loads, {}, stores, sums)


@dataclass(frozen=True, eq=False)
class LoopedFunction:
    """Loops that compute a function of memory; `guards` of them hold where they serve."""

    guards: int
    groups: LaneGroups
    loops: list[Loop]
    memory: Memory

    @property
    def operations(self) -> int:
        return self.groups.operations

    def statements(self, library: bool) -> list[Over]:
        """With `library`, sines are left to the target's own functions, and the rest to its compiler."""
        needed = list_needed_outside(self.loops)
        return [Block(loop, self.groups, needed, library).over(self.memory) for loop in self.loops]


def loop_over(program: RoundsFunction, layout: Layout) -> LoopedFunction:
    """The loops of a function."""
    groups = group_values(program)
    order = loops(groups)
    return LoopedFunction(program.guards, groups, order, memory(layout, program, groups, order))


@dataclass(frozen=True, eq=False)
class LoopedProgram:
    """The functions of one program as loops that share their memory; `acceleration` is what is stepped, with Baumgarte's terms."""

    source: RoundsProgram
    layout: Layout
    plain: LoopedFunction
    acceleration: LoopedFunction
    position: LoopedFunction | None
    velocity: LoopedFunction | None

    @property
    def n(self) -> int:
        return 3 * self.layout.links

    @property
    def size(self) -> int:
        """Elements of memory."""
        made = (self.plain, self.acceleration, self.position, self.velocity)
        return max(f.memory.size for f in made if f is not None)


def loop_program(source: RoundsProgram) -> LoopedProgram:
    """The loops of a program."""
    layout = Layout(len(source.acceleration.function.outputs[0]) // 3, len(source.parameters))
    plain = loop_over(source.acceleration, layout)
    more = (source.stabilized, source.position, source.velocity)
    stabilized, position, velocity = (None if f is None else loop_over(f, layout) for f in more)
    return LoopedProgram(source, layout, plain, stabilized or plain, position, velocity)
