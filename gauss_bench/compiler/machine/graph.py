"""A graph of machine arithmetic, its routines, and the base class of the emitters that write routines as text.

In the graph equal expressions are one value (value numbering by hash-consing): functions written into it at the same arguments
share sines, entries of the Jacobian and its factors. Signs are moved outwards, so that a - b and b - a are one value too. Operands
are always older than their users, so that values can be computed in the order of their numbers.
Source: Briggs, Cooper and Simpson, Value numbering, Software: Practice and Experience 27 (1997).

`rewrite` regroups sums and products by the times at which their parts are ready, and fuses products into sums. Every rewriting is
done here, on the graph, and none is left to a compiler: one lane and eight lanes then compute the same bits.

  sums        two terms at a time, those that are ready earliest first, as in Huffman's code
  products    likewise
  a b + c     one operation with one rounding, wherever a product is used in sums only
  a / b       a (1/b) where b is ready long before a, or where several values are divided by b

`order` then puts the most urgent operations first (list scheduling by height; Hennessy and Patterson, Computer Architecture,
appendix H): an out-of-order processor looks a few hundred instructions ahead, fewer than a step of a linkage has.

A routine is a function with loops and branches, independent of the target machine: a list of statements over the values of one
graph. A value is computed where a statement first needs it, or where `Compute` lists it; values that do not change in a loop are
computed before it.

    Compute(values)                      values in this order
    Load(array, rows, start)             rows of an array become leaves
    Store(array, values, start)          values become rows of an array
    Scatter(array, values, start, block, last)   the values of each lane, side by side, at a place of its own
    Loop(carried, body, again)           body; if again: once more, with the next values of the carried leaves
    If(condition, body, merged)          leaves that have one value after the body, and another without it

A value is a double or a mask for each trajectory; the same routine serves one trajectory or a vector of them, a lane each. Counts
and truths are shared by all trajectories. An array has rows, the trajectories of a group last in memory; each group of
trajectories has its own part of it. The emitters are in `llvm.py` and `source.py`.
"""

import heapq
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import NamedTuple

from gauss_bench.compiler.elimination.function import Function

Pair = tuple[int, int]
LEAVES = ("leaf", "mask", "count")
MASKS = ("mask", "all", "not", "both", "lt", "le", "nonzero", "everywhere")
COUNTS = ("count", "whole", "sum", "least", "times")
TRUTHS = ("below", "same", "any", "nowhere", "also")
Payload = float | int | str | None


class Graph:
    """Values are indices of nodes; a node has an operation, its operands, and a payload, such as the value of a constant.

    Real operations: const, leaf, add, sub, mul, div, fma (a b + c), neg, abs, sqrt, select (mask, a, b), real (of an integer).
    Integers: bits (of a real), and, plus, shl (each with a number as payload), xor. Masks: lt, le, nonzero (of an integer), both,
    not, all (True or False as payload), mask (a leaf), everywhere (of a truth).

    Control values, shared by all lanes. Counts, which are integers: count (a leaf), whole (a number as payload), sum, least,
    times (with a number as payload); `number` converts one to a real. Truths: below and same (of counts), any and
    nowhere (of a mask), also.
    """

    def __init__(self) -> None:
        self.operation: list[str] = []
        self.operands: list[tuple[int, ...]] = []
        self.payload: list[Payload] = []
        self.ready: list[int] = []  # cycles after which each value is there
        self._known: dict[tuple[str, tuple[int, ...], Payload], int] = {}

    def make(self, operation: str, *operands: int, payload: Payload = None) -> int:
        """Return the value of an operation; equal operations give the same value."""
        key = (operation, operands, payload)
        value = self._known.get(key)
        if value is None:
            value = self._known[key] = len(self.operation)
            self.operation.append(operation)
            self.operands.append(operands)
            self.payload.append(payload)
            self.ready.append(max((self.ready[k] for k in operands), default=0) + LATENCY.get(operation, 0))
        return value

    def leaf(self, name: str) -> int:
        """Return the input value with a name."""
        return self.make("leaf", payload=name)

    def const(self, x: float) -> int:
        return self.make("const", payload=float(x) + 0.0)  # adding 0.0 turns -0.0 into 0.0

    def number(self, a: int) -> float | None:
        """Return the number of a constant, None for any other value."""
        x = self.payload[a]
        return x if self.operation[a] == "const" and isinstance(x, float) else None

    def split_sign(self, a: int) -> tuple[int, bool]:
        """Return a value without its leading minus, and whether it had one; a negative constant has one too."""
        if self.operation[a] == "neg":
            return self.operands[a][0], True
        x = self.number(a)
        return (self.const(-x), True) if x is not None and x < 0 else (a, False)

    def neg(self, a: int) -> int:
        """Return -a; no value is negated twice."""
        x = self.number(a)
        if x is not None:
            return self.const(-x)
        return self.operands[a][0] if self.operation[a] == "neg" else self.make("neg", a)

    def add(self, a: int, b: int) -> int:
        """Return a + b, with signs moved outwards and constants added."""
        x, y = self.number(a), self.number(b)
        if x is not None and y is not None:
            return self.const(x + y)
        if x == 0 or y == 0:
            return b if x == 0 else a
        (a, minus_a), (b, minus_b) = self.split_sign(a), self.split_sign(b)
        if minus_a != minus_b:
            return self._difference(b, a) if minus_a else self._difference(a, b)
        total = self.make("add", min(a, b), max(a, b))
        return self.neg(total) if minus_a else total

    def _difference(self, a: int, b: int) -> int:
        if a == b:
            return self.const(0.0)
        return self.make("sub", a, b) if a < b else self.neg(self.make("sub", b, a))

    def sub(self, a: int, b: int) -> int:
        return self.add(a, self.neg(b))

    def mul(self, a: int, b: int) -> int:
        """Return a b, with signs moved outwards and constants multiplied."""
        x, y = self.number(a), self.number(b)
        if x is not None and y is not None:
            return self.const(x * y)
        if x == 0 or y == 0:
            return self.const(0.0)
        (a, minus_a), (b, minus_b) = self.split_sign(a), self.split_sign(b)
        if self.number(a) == 1 or self.number(b) == 1:
            product = b if self.number(a) == 1 else a
        else:
            product = self.make("mul", min(a, b), max(a, b))
        return self.neg(product) if minus_a != minus_b else product

    def div(self, a: int, b: int) -> int:
        """Return a / b; a constant divisor becomes a factor."""
        y = self.number(b)
        if y is not None:
            return self.mul(a, self.const(1 / y))
        (a, minus_a), (b, minus_b) = self.split_sign(a), self.split_sign(b)
        ratio = self.make("div", a, b)
        return self.neg(ratio) if minus_a != minus_b else ratio

    def fma(self, a: int, b: int, c: int) -> int:
        """Return a b + c with one rounding; later passes never split it."""
        return self.make("fma", a, b, c)

    def abs(self, a: int) -> int:
        return self.make("abs", self.split_sign(a)[0])

    def minimum(self, a: int, b: int) -> int:
        """Return the smaller of two values, b if one is NaN."""
        return self.make("select", self.make("lt", a, b), a, b)

    def maximum(self, a: int, b: int) -> int:
        """Return the larger of two values, b if one is NaN."""
        return self.make("select", self.make("lt", b, a), a, b)

    def all(self, holds: bool) -> int:
        """Return the mask that is true everywhere, or false everywhere."""
        return self.make("all", payload=holds)

    def both(self, masks: Sequence[int]) -> int:
        """Return the conjunction of masks; true everywhere if there are none."""
        every = self.all(True)
        for mask in dict.fromkeys(masks):
            if mask != self.all(True):
                every = mask if every == self.all(True) else self.make("both", every, mask)
        return every

    def flag(self, mask: int) -> int:
        """Return 1 where a mask holds, else 0."""
        return self.make("select", mask, self.const(1.0), self.const(0.0))

    def count(self, name: str) -> int:
        """Return the count that the caller of the routine gives under a name."""
        return self.make("count", payload=name)

    def whole(self, number: int) -> int:
        return self.make("whole", payload=number)

    def total(self, values: Sequence[int]) -> int:
        """Return the sum of values, in their order."""
        sum_ = self.const(0.0)
        for x in values:
            sum_ = self.add(sum_, x)
        return sum_

    def squares(self, values: Sequence[int]) -> int:
        return self.total([self.mul(x, x) for x in values])

    def largest(self, values: Sequence[int]) -> int:
        """Return the largest absolute value; NaN is ignored."""
        most = self.const(0.0)
        for size in map(self.abs, values):
            most = self.maximum(size, most)
        return most


def find_dependents(g: Graph, leaves: Iterable[int]) -> set[int]:
    """Return the leaves and all values that depend on them."""
    dependent = set(leaves)
    for x, operands in enumerate(g.operands):
        if not dependent.isdisjoint(operands):
            dependent.add(x)
    return dependent


def count_operations(g: Graph, values: list[int]) -> int:
    return sum(g.operation[x] not in ("const", "all", *LEAVES) for x in values)


def inline(g: Graph, function: Function, arguments: Sequence[Sequence[int]], sincos: Callable[[int], Pair]) -> list[list[int]]:
    """Write a function into a graph and return its outputs; `sincos` supplies sine and cosine of a value.

    Raises:
        ValueError: an operation without machine arithmetic.
    """
    values: list[int] = []
    for operation, operands, number in function.instructions:
        match operation:
            case "INPUT":
                value = arguments[operands[0]][operands[1]]
            case "CONST":
                value = g.const(number)
            case "SIN" | "COS":
                value = sincos(values[operands[0]])[operation == "COS"]
            case _ if operation in ARITHMETIC:
                value = ARITHMETIC[operation](g, *(values[k] for k in operands))
            case _:
                raise ValueError(f"no machine arithmetic for the operation {operation}")
        values.append(value)
    return [[values[k] for k in output] for output in function.outputs]


ARITHMETIC: dict[str, Callable[..., int]] = {
    "ADD": Graph.add,
    "SUB": Graph.sub,
    "MUL": Graph.mul,
    "DIV": Graph.div,
    "NEG": Graph.neg,
    "INV": lambda g, a: g.div(g.const(1.0), a),
    "SQRT": lambda g, a: g.make("sqrt", a),
    "FMIN": Graph.minimum,
    "FMAX": Graph.maximum,
    "LE": lambda g, a, b: g.flag(g.make("le", a, b)),
}


LATENCY = {  # cycles until a result can be used, on processors of today
    "const": 0, "leaf": 0, "neg": 0, "bits": 0, "real": 0, "abs": 1, "and": 1, "plus": 1, "shl": 1, "xor": 1, "both": 1, "select":
    1, "add": 3, "sub": 3, "mul": 3, "fma": 4, "lt": 3, "le": 3, "nonzero": 3, "div": 13, "sqrt": 20,
    "mask": 0, "all": 0, "not": 1, "everywhere": 1, "count": 0, "whole": 0, "sum": 1, "least": 1, "times": 3, "number": 4,
    "below": 1, "same": 1, "any": 3, "nowhere": 3, "also": 1,
}  # fmt: skip
ROUNDS = 6  # of the feedback from the end of a loop to its beginning; urgency settles after two or three


def live(g: Graph, roots: Iterable[int]) -> list[int]:
    """Return the values that the roots depend on, oldest first."""
    needed: set[int] = set()
    waiting = list(roots)
    while waiting:
        x = waiting.pop()
        if x not in needed:
            needed.add(x)
            waiting += g.operands[x]
    return sorted(needed)


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


def order(g: Graph, values: list[int], carried: Mapping[str, int]) -> list[int]:
    """Order the values by urgency: the length of the longest path from each to the end, through further turns of the loop."""
    leaves = {str(g.payload[x]): x for x in values if g.operation[x] == "leaf"}
    turn = period(g, values, carried)
    late = dict.fromkeys(carried.values(), 0.0)  # heights of the carried values
    for _ in range(ROUNDS):
        height = dict.fromkeys(values, -turn) | late
        for x in reversed(values):
            for k in g.operands[x]:
                height[k] = max(height[k], height[x] + LATENCY[g.operation[x]])
        # a carried value is as urgent as its leaf in the next turn
        late = dict.fromkeys(carried.values(), -turn)
        for name, x in carried.items():
            if name in leaves:
                late[x] = max(late[x], height[leaves[name]] - turn)
    return sorted(values, key=lambda x: (-height[x], x))


SUMS = ("add", "sub")
EARLIER = LATENCY["div"] - LATENCY["mul"]


class Summand(NamedTuple):
    """A signed term of a sum: a value, or a product not yet multiplied out (factor is None for a value)."""

    negative: bool
    value: int
    factor: int | None


class _Rewriter:
    """Writes the values that the roots need from one graph into another.

    A sum is a part of the sum that alone uses it. A product is a part of the sums that alone use it, or of the one product that
    does. Parts are regrouped together with what they belong to; a change of sign in between does not separate them.

    Attributes:
        known: old value -> new value. parts: old values that are written only as parts of others.
        shared: old values by which several others are divided.
    """

    def __init__(self, old: Graph, roots: list[int], new: Graph):
        self.old, self.new = old, new
        self.known: dict[int, int] = {}
        needed = [x for x in live(old, roots) if old.operation[x] != "neg"]
        users: dict[int, list[int]] = {x: [] for x in needed}
        for x in needed:
            for k in old.operands[x]:
                users[self._strip(k)[0]].append(x)
        self.parts = {x for x in needed if self._is_part(x, [old.operation[k] for k in users[x]])}
        self.parts -= {self._strip(x)[0] for x in roots}
        divisors = Counter(old.operands[x][1] for x in needed if old.operation[x] == "div")
        self.shared = {x for x, count in divisors.items() if count > 1}
        for x in needed:
            if x not in self.parts:
                self.get(x)

    def _strip(self, x: int) -> tuple[int, bool]:
        """Return a value without its change of sign, and whether there was one."""
        return (self.old.operands[x][0], True) if self.old.operation[x] == "neg" else (x, False)

    def _is_part(self, x: int, users: list[str]) -> bool:
        """Tell whether a value is a part of its users, given by their operations."""
        operation, summed = self.old.operation[x], all(user in SUMS for user in users)
        if operation in SUMS:
            return len(users) == 1 and summed
        return operation == "mul" and bool(users) and (summed or users == ["mul"])

    def get(self, x: int) -> int:
        """Return the value in the new graph that corresponds to an old one."""
        base, negative = self._strip(x)
        if base not in self.known:
            self.known[base] = self._write(base)
        return self.new.neg(self.known[base]) if negative else self.known[base]

    def _write(self, x: int) -> int:
        """Write an old value without its sign into the new graph."""
        operation, operands = self.old.operation[x], self.old.operands[x]
        if operation in SUMS:
            return self._sum(self._terms(x))
        if operation == "mul":
            return self.new.mul(*self._last_two(x))
        if operation == "div":
            return self._ratio(*operands)
        return self.new.make(operation, *map(self.get, operands), payload=self.old.payload[x])

    def _terms(self, x: int) -> list[Summand]:
        """Return the terms of a sum, in the new graph."""
        terms, waiting = [], [(x, False)]
        while waiting:
            y, negative = waiting.pop()
            base, minus = self._strip(y)
            negative ^= minus
            operation, operands = self.old.operation[base], self.old.operands[base]
            if operation in SUMS and (base == x or base in self.parts):  # its terms are terms of x
                waiting += [(operands[0], negative), (operands[1], negative != (operation == "sub"))]
            elif base in self.parts:  # a product, which may be fused with the addition
                (a, minus_a), (b, minus_b) = map(self.new.split_sign, self._last_two(base))
                terms.append(Summand(negative ^ minus_a ^ minus_b, a, b))
            else:
                value, minus = self.new.split_sign(self.get(base))
                terms.append(Summand(negative ^ minus, value, None))
        return terms

    def _last_two(self, x: int) -> Pair:
        """Multiply the factors of a product, earliest ready first, down to two; the last multiplication may be fused into a sum."""
        factors, waiting, ready = [], [x], self.new.ready
        while waiting:
            y = waiting.pop()
            if self.old.operation[y] == "mul" and (y == x or y in self.parts):
                waiting += self.old.operands[y]
            else:
                factors.append(self.get(y))
        heap = [(ready[f], f) for f in factors]
        heapq.heapify(heap)
        while len(heap) > 2:
            product = self.new.mul(heapq.heappop(heap)[1], heapq.heappop(heap)[1])
            heapq.heappush(heap, (ready[product], product))
        return heap[0][1], heap[1][1]

    def _sum(self, terms: list[Summand]) -> int:
        """Add the terms two at a time, those that are ready earliest first."""
        heap = [(self._ready(term), n, term) for n, term in enumerate(terms)]
        heapq.heapify(heap)
        for n in range(len(heap), 2 * len(heap) - 1):
            term = self._join(heapq.heappop(heap)[2], heapq.heappop(heap)[2])
            heapq.heappush(heap, (self._ready(term), n, term))
        negative, value, factor = heap[0][2]
        total = value if factor is None else self.new.mul(value, factor)
        return self.new.neg(total) if negative else total

    def _ready(self, term: Summand) -> int:
        return max(self.new.ready[k] for k in (term.value, term.factor) if k is not None)

    def _join(self, early: Summand, late: Summand) -> Summand:
        """Add two terms; if both are products, the earlier one is multiplied and the other fused into the addition."""
        g = self.new
        if early.factor is not None and late.factor is None:
            early, late = late, early
        value = early.value if early.factor is None else g.mul(early.value, early.factor)
        opposite = early.negative != late.negative
        if late.factor is not None:
            total = g.fma(g.neg(late.value) if opposite else late.value, late.factor, value)
        else:
            total = g.sub(value, late.value) if opposite else g.add(value, late.value)
        total, minus = (g.operands[total][0], True) if g.operation[total] == "neg" else (total, False)
        return Summand(early.negative ^ minus, total, None)

    def _ratio(self, a: int, b: int) -> int:
        """Divide, or multiply by the reciprocal where that is ready before a or serves several divisions."""
        g, above, below = self.new, self.get(a), self.get(b)
        if g.number(above) != 1 and (b in self.shared or g.ready[above] > g.ready[below] + EARLIER):
            return g.mul(above, g.div(g.const(1.0), below))
        return g.div(above, below)


def rewrite(g: Graph, roots: list[int], into: Graph | None = None) -> tuple[Graph, list[int]]:
    """Rewrite the roots into a new graph, or into a given one; leaves count as ready at the beginning."""
    rewriter = _Rewriter(g, roots, Graph() if into is None else into)
    return rewriter.new, [rewriter.get(x) for x in roots]


@dataclass(frozen=True)
class Array:
    """An argument.

    Attributes:
        rows: of one group, each with one number for each trajectory; 0 where groups share the array.
        by: name of a count by which `rows` is multiplied; "" for 1.
    """

    rows: int
    by: str = ""


@dataclass(frozen=True, eq=False)
class Compute:
    """Values in this order, their operands first."""

    values: Sequence[int]


@dataclass(frozen=True, eq=False)
class Load:
    """Leaf -> row of an array, counted from the row `start` (a count; None for 0)."""

    array: str
    rows: Mapping[int, int]
    start: int | None = None


@dataclass(frozen=True, eq=False)
class Store:
    """Values for neighbouring rows of an array, from the row `start` (a count; None for 0) on."""

    array: str
    values: Sequence[int]
    start: int | None = None


@dataclass(frozen=True, eq=False)
class Scatter:
    """Values side by side in an array, those of trajectory k from min(k `block`, `last`) + `start` on (all three are counts)."""

    array: str
    values: Sequence[int]
    start: int
    block: int
    last: int


@dataclass(frozen=True, eq=False)
class Loop:
    """A loop with leaf -> (first value, next value): does `body`, ends unless `again` (a truth) holds, repeats."""

    carried: Mapping[int, tuple[int, int]]
    body: Sequence["Statement"]
    again: int


@dataclass(frozen=True, eq=False)
class If:
    """A branch with leaf -> (value after `body`, value where the truth `condition` does not hold)."""

    condition: int
    body: Sequence["Statement"]
    merged: Mapping[int, tuple[int, int]]


Statement = Compute | Load | Store | Scatter | Loop | If


@dataclass(frozen=True, eq=False)
class Routine:
    """A function.

    Attributes:
        arrays, numbers, counts: arguments in this order, by name; a number or count `name` is the leaf or count "%name".
        sound: mask that holds where the routine has done all it should; C returns 1 where it does not hold.
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
        """The kinds of the arguments as letters (`TYPES` in llvm.py), the number of groups last."""
        return "p" * len(self.arrays) + "d" * len(self.numbers) + "i" * (len(self.counts) + 1)


def nest(statements: Sequence[Statement]) -> Iterator[Statement]:
    """Yield all statements, including nested ones."""
    for s in statements:
        yield s
        if isinstance(s, Loop | If):
            yield from nest(s.body)


def list_needed(r: Routine) -> set[int]:
    """Return all values that the routine uses; loads and carried values outside this set can be omitted."""
    roots = [r.sound]
    for s in nest(r.body):
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
    """Return the values that may change between turns of a loop."""
    defined = set(loop.carried)
    for s in nest(loop.body):
        match s:
            case Loop():
                defined |= set(s.carried)
            case If():
                defined |= set(s.merged)
            case Load():
                defined |= set(s.rows)
    return find_dependents(g, defined)


class Emitter:
    """Base class of emitters: it gives every value a name in the text, where it is first needed.

    Attributes:
        names: value -> its name in the text, for those written so far. needed: all values that the routine uses.
        first: names of the first values of the leaves that the next loop carries.
    """

    def __init__(self, routine: Routine) -> None:
        self.graph, self.needed = routine.graph, list_needed(routine)
        self.names: dict[int, str] = {}
        self.first: list[str] = []

    def value(self, x: int) -> str:
        """Write a value whose operands have names already; return its name."""
        raise NotImplementedError

    def statement(self, s: Statement) -> None:
        """Write one statement."""
        raise NotImplementedError

    def statements(self, body: Sequence[Statement]) -> None:
        """Write statements in their order."""
        for s in body:
            if isinstance(s, Compute):
                self.compute(s.values)
            else:
                if isinstance(s, Loop):
                    self._before(s)
                self.statement(s)

    def _before(self, s: Loop) -> None:
        """Write first values and loop invariants before a loop; names that an earlier loop gave to changing values are dropped."""
        self.first = self.compute([a for a, _ in self.select_carried(s).values()])
        changed = find_changing(self.graph, s)
        inner = nest(s.body)
        self.compute([x for c in inner if isinstance(c, Compute) for x in c.values if x not in changed])
        self.names = {x: name for x, name in self.names.items() if x not in changed}

    def select_carried(self, loop: Loop) -> dict[int, tuple[int, int]]:
        """Return the carried leaves of a loop that are needed."""
        return {x: pair for x, pair in loop.carried.items() if x in self.needed}

    def select_rows(self, load: Load) -> dict[int, int]:
        """Return the loaded rows that are needed."""
        return {x: row for x, row in load.rows.items() if x in self.needed}

    def compute(self, values: Sequence[int]) -> list[str]:
        """Return the names of values; write those that are missing."""
        return [self.need(x) for x in values]

    def need(self, x: int) -> str:
        """Return the name of a value; write it and its operands first if necessary."""
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
        """Context in which names are local: at its end all names given inside are dropped."""
        before = dict(self.names)
        yield
        self.names = before
