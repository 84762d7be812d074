"""A graph of machine arithmetic, in which equal operations are one value.

Value numbering by hash-consing: an operation with the same operands is stored once. Functions that are written into the graph with
the same arguments therefore share values, such as sines, entries of the Jacobian, and the factors of its elimination. Minus signs
are moved to the front of expressions, so that a - b and b - a share one value, which is negated for one of them. Operands have
smaller indices than the values that use them.
Source: Briggs, Cooper and Simpson, Value numbering, Software: Practice and Experience 27 (1997).

A value is a double or a mask (a boolean) for each trajectory, or the same for all: an integer (count) or a boolean (truth).
"""

from collections.abc import Callable, Iterable, Sequence
from functools import reduce

from gauss_bench.compiler.elimination.function import Function

Pair = tuple[int, int]  # two values, such as the sine and the cosine of one angle
LEAVES = ("leaf", "mask", "count")
# operations whose results are masks, counts and truths (see `Graph`)
MASKS = ("mask", "all", "not", "both", "lt", "le", "nonzero", "everywhere")
COUNTS = ("count", "whole", "sum", "least", "times")
TRUTHS = ("below", "same", "any", "nowhere", "also")
Payload = float | int | str | None


class Graph:
    """The values of a program. A value is the index of a node, which has an operation, operands, and a payload such as a number.

    A leaf is a named value that comes from outside the graph: an argument of a routine, or a variable that a loop changes.

    Operations whose results may differ from lane to lane (each lane of a vector computes one trajectory):
        const, leaf, add, sub, mul, div, neg, abs, sqrt: real numbers.
        fma: a b + c, rounded once.
        select (mask, a, b): a where the mask is true, else b.
        real (of an integer): the real number with these bits. number (of a count): the count as a real number.
        bits (of a real number): its bits as an integer. xor: an integer.
        and, plus, shl: bitwise and, sum, left shift of an integer with a number as payload.
        lt, le: the masks a < b and a <= b. nonzero (of an integer): the mask that is true where it is not 0.
        both, not: logical operations on masks. mask: a leaf that is a mask.
        all: the mask that is the payload, True or False, in all lanes.
        everywhere (of a truth): the mask that is this truth in all lanes.

    Operations whose results are the same for all lanes:
        count: a leaf that is a count, which is an integer. whole: the count in the payload.
        sum, least: sum and minimum of two counts. times: a count times the number in the payload.
        below, same: the truths (booleans) a < b and a = b for two counts.
        any, nowhere: the truths that a mask is true in at least one lane, and in no lane.
        also: the truth that two truths are both true.
    """

    def __init__(self) -> None:
        """Make an empty graph."""
        self.operation: list[str] = []
        self.operands: list[tuple[int, ...]] = []
        self.payload: list[Payload] = []
        self.ready: list[int] = []  # earliest time [cycles] at which each value is available
        self._known: dict[tuple[str, tuple[int, ...], Payload], int] = {}

    def make(self, operation: str, *operands: int, payload: Payload = None) -> int:
        """Return the value (node index) of an operation; an equal operation that was made before is returned again."""
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
        """Return the leaf with a name: a real number that comes from outside the graph."""
        return self.make("leaf", payload=name)

    def const(self, x: float) -> int:
        """Return the value of a constant real number."""
        return self.make("const", payload=float(x) + 0.0)  # adding 0.0 turns -0.0 into 0.0

    def number(self, a: int) -> float | None:
        """Return the number of a constant, None for any other value."""
        x = self.payload[a]
        return x if self.operation[a] == "const" and isinstance(x, float) else None

    def split_sign(self, a: int) -> tuple[int, bool]:
        """Return a value without its leading minus sign, and whether it had one; a negative constant has one."""
        if self.operation[a] == "neg":
            return self.operands[a][0], True
        x = self.number(a)
        return (self.const(-x), True) if x is not None and x < 0 else (a, False)

    def neg(self, a: int) -> int:
        """Return -a; if a is a negation itself, return the operand of a."""
        x = self.number(a)
        if x is not None:
            return self.const(-x)
        return self.operands[a][0] if self.operation[a] == "neg" else self.make("neg", a)

    def add(self, a: int, b: int) -> int:
        """Return a + b, with minus signs moved to the front of the sum, and the sum of two constants as a constant."""
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
        """Return a - b; the value with the smaller index is always the minuend, and the difference is negated if needed."""
        if a == b:
            return self.const(0.0)
        return self.make("sub", a, b) if a < b else self.neg(self.make("sub", b, a))

    def sub(self, a: int, b: int) -> int:
        """Return a - b, by the rules of `add`."""
        return self.add(a, self.neg(b))

    def mul(self, a: int, b: int) -> int:
        """Return a b, with minus signs moved to the front of the product, and the product of two constants as a constant."""
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
        """Return a / b, with minus signs moved to the front; if b is a constant, a is multiplied by the constant 1 / b."""
        y = self.number(b)
        if y is not None:
            return self.mul(a, self.const(1 / y))
        (a, minus_a), (b, minus_b) = self.split_sign(a), self.split_sign(b)
        quotient = self.make("div", a, b)
        return self.neg(quotient) if minus_a != minus_b else quotient

    def fma(self, a: int, b: int, c: int) -> int:
        """Return a b + c as a fused multiply-add, which rounds once; no later pass splits it into a product and a sum."""
        return self.make("fma", a, b, c)

    def abs(self, a: int) -> int:
        """Return |a|, which is the same value for a and -a."""
        without_sign, _ = self.split_sign(a)
        return self.make("abs", without_sign)

    def minimum(self, a: int, b: int) -> int:
        """Return the smaller of two values, b if one is NaN."""
        return self.make("select", self.make("lt", a, b), a, b)

    def maximum(self, a: int, b: int) -> int:
        """Return the larger of two values, b if one is NaN."""
        return self.make("select", self.make("lt", b, a), a, b)

    def all(self, holds: bool) -> int:
        """Return the constant mask that is `holds`, True or False, in all lanes."""
        return self.make("all", payload=holds)

    def both(self, masks: Sequence[int]) -> int:
        """Return the mask that is true where all of the masks are true; without masks it is true in all lanes."""
        conjunction = always = self.all(True)
        for mask in dict.fromkeys(masks):
            if mask != always:
                conjunction = mask if conjunction == always else self.make("both", conjunction, mask)
        return conjunction

    def flag(self, mask: int) -> int:
        """Return the real number that is 1 where a mask is true, else 0."""
        return self.make("select", mask, self.const(1.0), self.const(0.0))

    def count(self, name: str) -> int:
        """Return the integer with a name: an argument of the routine, or a variable of a loop."""
        return self.make("count", payload=name)

    def whole(self, number: int) -> int:
        """Return the value of a constant integer."""
        return self.make("whole", payload=number)

    def total(self, values: Sequence[int]) -> int:
        """Return the sum of values, in their order."""
        return reduce(self.add, values, self.const(0.0))

    def sum_of_squares(self, values: Sequence[int]) -> int:
        """Return the sum of the squares of values."""
        return self.total([self.mul(x, x) for x in values])

    def largest(self, values: Sequence[int]) -> int:
        """Return the largest of the absolute values, ignoring NaN; 0 if there are no values."""
        largest = self.const(0.0)
        for size in map(self.abs, values):
            largest = self.maximum(size, largest)
        return largest


def find_dependents(g: Graph, leaves: Iterable[int]) -> set[int]:
    """Return the given leaves (values without operands), and all values of the graph that depend on one of them, as a set."""
    dependent = set(leaves)
    for x, operands in enumerate(g.operands):  # operands come before their users
        if not dependent.isdisjoint(operands):
            dependent.add(x)
    return dependent


def count_operations(g: Graph, values: list[int]) -> int:
    """Return how many of the values are results of operations, and not inputs or constants."""
    return sum(g.operation[x] not in ("const", "all", *LEAVES) for x in values)


def inline(g: Graph, function: Function, arguments: Sequence[Sequence[int]], sincos: Callable[[int], Pair]) -> list[list[int]]:
    """Write the operations of a function into a graph; return the values of its results, a list of components for each.

    Args:
        sincos: writes sine and cosine of a value into the graph, and returns them.
    """
    values: list[int] = []
    for operation, operands, number in function.instructions:
        match operation:
            case "INPUT":
                value = arguments[operands[0]][operands[1]]
            case "CONST":
                value = g.const(number)
            case "SIN" | "COS":
                sine, cosine = sincos(values[operands[0]])
                value = sine if operation == "SIN" else cosine
            case _:
                value = ARITHMETIC[operation](g, *(values[k] for k in operands))
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


LATENCY = {  # [cycles] until the result of an operation can be used, on current processors
    "const": 0, "leaf": 0, "neg": 0, "bits": 0, "real": 0, "abs": 1, "and": 1, "plus": 1, "shl": 1, "xor": 1, "both": 1, "select":
    1, "add": 3, "sub": 3, "mul": 3, "fma": 4, "lt": 3, "le": 3, "nonzero": 3, "div": 13, "sqrt": 20,
    "mask": 0, "all": 0, "not": 1, "everywhere": 1, "count": 0, "whole": 0, "sum": 1, "least": 1, "times": 3, "number": 4,
    "below": 1, "same": 1, "any": 3, "nowhere": 3, "also": 1,
}  # fmt: skip


def live(g: Graph, roots: Iterable[int]) -> list[int]:
    """Return the values `roots` and all values that they depend on, in the order of their indices, so that operands come first."""
    needed: set[int] = set()
    waiting = list(roots)
    while waiting:
        x = waiting.pop()
        if x not in needed:
            needed.add(x)
            waiting += g.operands[x]
    return sorted(needed)
