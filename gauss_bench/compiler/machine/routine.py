"""Routines, and the base class of the emitters: the classes that write a routine as text in a target language.

A routine is a function with loops and branches, independent of the target machine: a list of statements that use the values of one
graph of arithmetic (`graph.py`). A value is computed immediately before the first statement that uses it, or where a `Compute`
statement lists it. A leaf is a value without operands: an argument, an element that `Load` reads, or a variable that a loop or a
branch sets. A count (integer) or truth (boolean) is the same for all trajectories that are computed together. Values that do not
change in a loop are computed before it.

    Compute(values): compute values in this order.
    Load(array, rows, start): read rows of an array into leaves.
    Store(array, values, start): write values into rows of an array.
    Scatter(array, values, start, block, last): write all values of each trajectory to consecutive places of an array.
    Loop(carried, body, again): execute the body, and repeat it with the next values of the variables while `again` is true.
    If(condition, body, merged): execute the body if the condition is true; the condition also selects the values of variables.

The same routine computes one trajectory, or a group of trajectories with one in each lane of a vector. Each row of an array has one
number for each trajectory of a group, side by side in memory. Each group of trajectories has its own part of an array. The emitters
are in `llvm.py` and `source.py`.
"""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass

from gauss_bench.compiler.machine.graph import Graph, find_dependents, live


@dataclass(frozen=True)
class Array:
    """An array among the arguments of a routine.

    Attributes:
        rows: number of rows for one group of trajectories; 0 if all groups share the array.
        by: name of an integer argument of the routine by which `rows` is multiplied, such as the number of samples; "" if none.
    """

    rows: int
    by: str = ""


@dataclass(frozen=True, eq=False)
class Compute:
    """Compute values in this order, their operands first."""

    values: Sequence[int]


@dataclass(frozen=True, eq=False)
class Load:
    """Read leaves from an array: the leaf x is in the row with the index start + rows[x]; a `start` of None stands for 0."""

    array: str
    rows: Mapping[int, int]
    start: int | None = None


@dataclass(frozen=True, eq=False)
class Store:
    """Write values to consecutive rows of an array, the first to the row with the index `start` (None: 0)."""

    array: str
    values: Sequence[int]
    start: int | None = None


@dataclass(frozen=True, eq=False)
class Scatter:
    """Write all values of each trajectory to consecutive places in a flat array.

    The values of trajectory k begin at the index min(k * block, last) + start; `block`, `last` and `start` are counts.
    """

    array: str
    values: Sequence[int]
    start: int
    block: int
    last: int


@dataclass(frozen=True, eq=False)
class Loop:
    """Execute `body`, and repeat it as long as the boolean `again` is true at the end.

    `carried` maps each variable (a leaf) to its values in the first and in the next iteration.
    """

    carried: Mapping[int, tuple[int, int]]
    body: Sequence["Statement"]
    again: int


@dataclass(frozen=True, eq=False)
class If:
    """Execute `body` if the boolean `condition` is true; `merged`: variable (a leaf) -> its value after `body`, and without it."""

    condition: int
    body: Sequence["Statement"]
    merged: Mapping[int, tuple[int, int]]


Statement = Compute | Load | Store | Scatter | Loop | If


@dataclass(frozen=True, eq=False)
class Routine:
    """A function as a list of statements.

    Attributes:
        arrays, numbers, counts: names of the arguments, in this order: arrays, real numbers, integers. A number or a count named
            `x` is the leaf "%x" of the graph.
        sound: mask that is true for each trajectory that the routine has computed completely. A routine in C computes one
            trajectory, and returns 0 if the mask is true, else 1.
    """

    name: str
    graph: Graph
    arrays: Mapping[str, Array]
    numbers: tuple[str, ...]
    counts: tuple[str, ...]
    body: Sequence[Statement]
    sound: int
    operations: int

    @property
    def signature(self) -> str:
        """The kinds of all arguments as letters (`TYPES` in llvm.py); the last argument is the number of groups."""
        return "p" * len(self.arrays) + "d" * len(self.numbers) + "i" * (len(self.counts) + 1)


def flatten(statements: Sequence[Statement]) -> Iterator[Statement]:
    """Yield each statement, and after each loop or branch all statements inside it, at any depth."""
    for s in statements:
        yield s
        if isinstance(s, Loop | If):
            yield from flatten(s.body)


def find_needed(r: Routine) -> set[int]:
    """Return all values on which results of the routine depend; loads of other values, and other variables, can be omitted."""
    roots = [r.sound]  # a routine in C returns this mask
    for s in flatten(r.body):
        match s:
            case Compute() | Store():
                roots += s.values
            case Scatter():
                roots += [*s.values, s.start, s.block, s.last]
            case Loop():
                roots += [s.again, *(x for pair in s.carried.values() for x in pair)]
            case If():
                roots += [s.condition, *(x for pair in s.merged.values() for x in pair)]
    return set(live(r.graph, roots))


def find_changing(g: Graph, loop: Loop) -> set[int]:
    """Return the values that may differ between iterations of a loop: all that depend on leaves that the loop sets or loads."""
    defined = set(loop.carried)
    for s in flatten(loop.body):
        match s:
            case Loop():
                defined |= set(s.carried)
            case If():
                defined |= set(s.merged)
            case Load():
                defined |= set(s.rows)
    return find_dependents(g, defined)


class Emitter:
    """Base class of emitters: it writes the operation of a value where the value is first needed, and gives the result a name.

    Attributes:
        names: value of the graph -> name of its result in the text.
        needed: values on which results of the routine depend.
        first: for the loop that is written next: names of its variables' first values, in the order of `select_carried`.
    """

    def __init__(self, routine: Routine) -> None:
        """Prepare to write a routine."""
        self.graph, self.needed = routine.graph, find_needed(routine)
        self.names: dict[int, str] = {}
        self.first: list[str] = []

    def write_value(self, x: int) -> str:
        """Write the operation that computes x, whose operands have names already; return the name of the result."""
        raise NotImplementedError

    def write_statement(self, s: Statement) -> None:
        """Write one statement."""
        raise NotImplementedError

    def write_statements(self, body: Sequence[Statement]) -> None:
        """Write statements in their order, and in front of each loop the values that do not change in it (`_write_before`)."""
        for s in body:
            if isinstance(s, Compute):
                self.compute(s.values)
            else:
                if isinstance(s, Loop):
                    self._write_before(s)
                self.write_statement(s)

    def _write_before(self, s: Loop) -> None:
        """Write the code in front of a loop: the first values of its variables, and all values that do not change in the loop."""
        self.first = self.compute([first for first, _ in self.select_carried(s).values()])
        changing = find_changing(self.graph, s)
        for inner in flatten(s.body):
            if isinstance(inner, Compute):
                self.compute([x for x in inner.values if x not in changing])
        # a value that changes in this loop may have a name from an earlier loop: its name is removed, so that it is computed anew
        self.names = {x: name for x, name in self.names.items() if x not in changing}

    def select_carried(self, loop: Loop) -> dict[int, tuple[int, int]]:
        """Return the variables of a loop on which results depend: leaf -> its value in the first and in the next iteration."""
        return {x: pair for x, pair in loop.carried.items() if x in self.needed}

    def select_rows(self, load: Load) -> dict[int, int]:
        """Return the leaves that a statement loads and on which results depend: leaf -> its row in the array that is read."""
        return {x: row for x, row in load.rows.items() if x in self.needed}

    def compute(self, values: Sequence[int]) -> list[str]:
        """Return the names of values; first write the values that have no name yet."""
        return [self.need(x) for x in values]

    def need(self, x: int) -> str:
        """Return the name of value x; if x has no name yet, first write the operations of x and of its operands without names."""
        waiting = [x]
        while x not in self.names:
            missing = [k for k in self.graph.operands[waiting[-1]] if k not in self.names]
            if missing:
                waiting += missing
            else:
                y = waiting.pop()
                if y not in self.names:
                    self.names[y] = self.write_value(y)
        return self.names[x]

    @contextmanager
    def within(self) -> Iterator[None]:
        """Forget, at the end of a `with` statement, the names given inside it: values of a branch are not defined after it."""
        names_before = dict(self.names)
        yield
        self.names = names_before
