"""Routines: what a machine runs, in no machine's words.

A routine is statements over the values of one graph. Values are computed where a statement needs them first; `Compute` only says
in which order. Whatever a loop needs that does not change in it is computed before it.

    Compute(values)                      values in this order
    Load(array, rows, start)             rows of an array become leaves
    Store(array, values, start)          values become rows of an array
    Scatter(array, places, values, start)   each lane's values, side by side, at a place of its own
    Loop(carried, body, again, after)    body; if again: after, and once more with the next values of what is carried
    If(condition, body, merged)          leaves that have one value after the body, and another without it
    Over(lanes, ...)                     the same operations in many lanes of an array: equal operations of different links

A value is a double or a mask for each trajectory, and a routine is written for one trajectory or for a vector of them without a
difference; counts and truths are one for all. An array has rows, the trajectories of a group last in memory; each group of
trajectories has its own part of it. The emitters are `llvm.py` and `source.py`.
"""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field

from gauss_bench.compiler.machine.graph import Graph, depending


@dataclass(frozen=True)
class Array:
    """An argument.

    Attributes:
        rows: of one group, each with one number for each trajectory; 0 where groups share the array.
        by: name of a count by which `rows` is multiplied; "" for 1.
        whole: whether its numbers are whole.
        scratch: whether it is only worked in: groups share it, and C has its own.
    """

    rows: int
    by: str = ""
    whole: bool = False
    scratch: bool = False


@dataclass(frozen=True, eq=False)
class Compute:
    """Values in this order, their operands first."""

    values: Sequence[int]


@dataclass(frozen=True, eq=False)
class Load:
    """Leaf -> row of an array, behind the row `start`, a count."""

    array: str
    rows: Mapping[int, int]
    start: int | None = None


@dataclass(frozen=True, eq=False)
class Store:
    """Values in neighbouring rows of an array, from the row `start` on, a count."""

    array: str
    values: Sequence[int]
    start: int | None = None


@dataclass(frozen=True, eq=False)
class Scatter:
    """Each trajectory's values side by side in an array, where the array `places` of whole numbers says, and `start` behind it."""

    array: str
    places: str
    values: Sequence[int]
    start: int


@dataclass(frozen=True, eq=False)
class Loop:
    """Leaf -> its first and its next value; goes on while the truth `again` holds after `body`, and then does `after`."""

    carried: Mapping[int, tuple[int, int]]
    body: Sequence["Statement"]
    again: int
    after: Sequence["Statement"] = ()


@dataclass(frozen=True, eq=False)
class If:
    """Leaf -> its value after `body`, and the one it has where the truth `condition` does not hold."""

    condition: int
    body: Sequence["Statement"]
    merged: Mapping[int, tuple[int, int]]


@dataclass(frozen=True)
class Places:
    """Elements of an array by lane, behind the element `start`, a count; `room` where nothing is lost behind the last."""

    array: str
    by_lane: tuple[int, ...]
    room: bool = False
    start: int | None = None


@dataclass(frozen=True, eq=False)
class Over:
    """The same operations in each of some lanes, in any order.

    Attributes:
        graph, order: values of one lane, in the order in which to write them.
        loads: leaf -> what it is by lane: elements or numbers.
        given: leaf -> a value of the routine, the same in all lanes.
        stores: values, and the elements they become.
        sums: values, and the single element that their sum over all lanes becomes.
    """

    lanes: int
    graph: Graph
    order: Sequence[int]
    loads: Mapping[int, Places | tuple[float, ...]]
    given: Mapping[int, int] = field(default_factory=dict)
    stores: Sequence[tuple[int, Places]] = ()
    sums: Sequence[tuple[int, Places]] = ()


Statement = Compute | Load | Store | Scatter | Loop | If | Over


@dataclass(frozen=True, eq=False)
class Routine:
    """A function.

    Attributes:
        arrays, numbers, counts: arguments in this order, by name; numbers are the leaves "%name", counts those of their kind.
        sound: mask where everything asked for was done; C returns 1 where it does not hold.
        operations: in one turn of its loop or in one evaluation.
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
        """Kinds of arguments as native_code.py names them; groups are the last."""
        return "p" * len(self.arrays) + "d" * len(self.numbers) + "i" * (len(self.counts) + 1)


def nested(statements: Sequence[Statement]) -> Iterator[Statement]:
    """All statements, also those within others."""
    for s in statements:
        yield s
        match s:
            case Loop():
                yield from nested([*s.body, *s.after])
            case If():
                yield from nested(s.body)


def unchanging(g: Graph, loop: Loop) -> list[int]:
    """Values that a loop computes and that are the same in every turn."""
    defined = set(loop.carried)
    inner = list(nested([*loop.body, *loop.after]))
    for s in inner:
        defined |= set(s.carried if isinstance(s, Loop) else s.merged if isinstance(s, If) else s.rows if isinstance(s, Load) else ())
    changing = depending(g, defined)
    return [x for s in inner if isinstance(s, Compute) for x in s.values if x not in changing]


class Emitter:
    """What emitters share: a name in the text for every value, found where it is needed first.

    Attributes:
        graph, names: of the function or lane that is being written.
    """

    def __init__(self, graph: Graph) -> None:
        self.graph = graph
        self.names: dict[int, str] = {}

    def value(self, x: int) -> str:
        """Write a value whose operands have names; its own."""
        raise NotImplementedError

    def statement(self, s: Statement) -> None:
        """Write one statement."""
        raise NotImplementedError

    def statements(self, body: Sequence[Statement]) -> None:
        for s in body:
            if isinstance(s, Compute):
                self.compute(s.values)
            else:
                if isinstance(s, Loop):
                    self.compute(unchanging(self.graph, s))
                self.statement(s)

    def compute(self, values: Sequence[int]) -> list[str]:
        """Names of values, which are written if they are not there yet."""
        return [self.need(x) for x in values]

    def need(self, x: int) -> str:
        """The name of a value, which is written with all it needs if it is not there yet."""
        waiting = [x]
        while x not in self.names:
            missing = [k for k in self.graph.operands[waiting[-1]] if k not in self.names]
            if missing:
                waiting += missing
            else:
                y = waiting.pop()
                if y not in self.names:
                    self.names[y] = self.value(y)
        return self.names[x]

    @contextmanager
    def within(self) -> Iterator[None]:
        """What is written here is not known afterwards."""
        before = dict(self.names)
        yield
        self.names = before
