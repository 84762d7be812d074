"""A graph of machine arithmetic in which equal expressions are one value (value numbering by hash-consing).

Functions written into it at the same arguments share what they have in common: sines, entries of the Jacobian, its factors. Signs
are moved outwards, so that a - b and b - a are one value too. Operands are always older than their users, so that the numbers of
the values are an order in which they can be computed.
Source: Briggs, Cooper and Simpson, Value numbering, Software: Practice and Experience 27 (1997).
"""

from collections.abc import Callable, Sequence

from gauss_bench.compiler.elimination.function import Function

Pair = tuple[int, int]
Payload = float | int | str | None


class Graph:
    """Values as numbers of nodes; a node is an operation, its operands, and a payload such as the number of a constant.

    Real operations: const, leaf, add, sub, mul, div, fma (a b + c), neg, abs, sqrt, select (mask, a, b), real (of an integer).
    Integers: bits (of a real), and, plus, shl (each with a number as payload), xor. Masks: lt, le, nonzero (of an integer), both.
    """

    def __init__(self) -> None:
        self.operation: list[str] = []
        self.operands: list[tuple[int, ...]] = []
        self.payload: list[Payload] = []
        self._known: dict[tuple[str, tuple[int, ...], Payload], int] = {}

    def make(self, operation: str, *operands: int, payload: Payload = None) -> int:
        """The value of an operation, the same number for the same operation."""
        key = (operation, operands, payload)
        found = self._known.get(key)
        if found is None:
            found = self._known[key] = len(self.operation)
            self.operation.append(operation)
            self.operands.append(operands)
            self.payload.append(payload)
        return found

    def leaf(self, name: str) -> int:
        """A value from outside, by its name."""
        return self.make("leaf", payload=name)

    def const(self, x: float) -> int:
        return self.make("const", payload=float(x) + 0.0)  # adding 0.0 turns -0.0 into 0.0

    def number(self, a: int) -> float | None:
        """The number a constant holds, else None."""
        x = self.payload[a]
        return x if self.operation[a] == "const" and isinstance(x, float) else None

    def unsigned(self, a: int) -> tuple[int, bool]:
        """A value without its sign, and whether it had one."""
        if self.operation[a] == "neg":
            return self.operands[a][0], True
        x = self.number(a)
        return (self.const(-x), True) if x is not None and x < 0 else (a, False)

    def neg(self, a: int) -> int:
        x = self.number(a)
        if x is not None:
            return self.const(-x)
        return self.operands[a][0] if self.operation[a] == "neg" else self.make("neg", a)

    def add(self, a: int, b: int) -> int:
        x, y = self.number(a), self.number(b)
        if x is not None and y is not None:
            return self.const(x + y)
        if x == 0 or y == 0:
            return b if x == 0 else a
        (a, minus_a), (b, minus_b) = self.unsigned(a), self.unsigned(b)
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
        x, y = self.number(a), self.number(b)
        if x is not None and y is not None:
            return self.const(x * y)
        if x == 0 or y == 0:
            return self.const(0.0)
        (a, minus_a), (b, minus_b) = self.unsigned(a), self.unsigned(b)
        if self.number(a) == 1 or self.number(b) == 1:
            product = b if self.number(a) == 1 else a
        else:
            product = self.make("mul", min(a, b), max(a, b))
        return self.neg(product) if minus_a != minus_b else product

    def div(self, a: int, b: int) -> int:
        y = self.number(b)
        if y is not None:
            return self.mul(a, self.const(1 / y))
        (a, minus_a), (b, minus_b) = self.unsigned(a), self.unsigned(b)
        ratio = self.make("div", a, b)
        return self.neg(ratio) if minus_a != minus_b else ratio

    def fma(self, a: int, b: int, c: int) -> int:
        """A b + c with one rounding, never taken apart."""
        return self.make("fma", a, b, c)

    def abs(self, a: int) -> int:
        return self.make("abs", self.unsigned(a)[0])

    def both(self, masks: Sequence[int]) -> int | None:
        """Where all masks hold; None, for everywhere, without any."""
        found = None
        for mask in dict.fromkeys(masks):
            found = mask if found is None else self.make("both", found, mask)
        return found

    def total(self, values: Sequence[int]) -> int:
        found = self.const(0.0)
        for x in values:
            found = self.add(found, x)
        return found

    def squares(self, values: Sequence[int]) -> int:
        return self.total([self.mul(x, x) for x in values])


def inline(g: Graph, function: Function, arguments: Sequence[Sequence[int]], sincos: Callable[[int], Pair]) -> list[list[int]]:
    """Write a function into a graph; `sincos` supplies sine and cosine of a value. Returns its results."""
    values: list[int] = []
    for operation, operands, number in function.instructions:
        match operation:
            case "INPUT":
                values.append(arguments[operands[0]][operands[1]])
            case "CONST":
                values.append(g.const(number))
            case _:
                values.append(apply(g, operation, [values[k] for k in operands], sincos))
    return [[values[k] for k in output] for output in function.outputs]


def apply(g: Graph, operation: str, x: Sequence[int], sincos: Callable[[int], Pair]) -> int:
    """An operation of a function in machine arithmetic."""
    match operation:
        case "ADD":
            return g.add(*x)
        case "SUB":
            return g.sub(*x)
        case "MUL":
            return g.mul(*x)
        case "DIV":
            return g.div(*x)
        case "INV":
            return g.div(g.const(1.0), x[0])
        case "NEG":
            return g.neg(x[0])
        case "SQRT":
            return g.make("sqrt", x[0])
        case "SIN" | "COS":
            return sincos(x[0])[operation == "COS"]
        case "FMIN":
            return g.make("select", g.make("lt", x[0], x[1]), x[0], x[1])
        case "FMAX":
            return g.make("select", g.make("lt", x[1], x[0]), x[0], x[1])
        case "LE":
            return g.make("select", g.make("le", x[0], x[1]), g.const(1.0), g.const(0.0))
        case "SUM":
            return g.total(x)
        case "IS" | "OUT":
            return x[0]
    raise ValueError(f"no machine arithmetic for {operation}")
