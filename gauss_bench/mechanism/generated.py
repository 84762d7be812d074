"""Generated equations: straight-line Python for floats or arrays, with every common subexpression computed once.

The equations are evaluated once with symbols for numbers. Operations on symbols are recorded in order, equal ones once; zeros, ones
and constants are folded. The result is a function without loops or indices: with floats it takes a tenth of the time of arrays,
and the same text works on arrays of states, in double or longer types.
"""

import math
from collections.abc import Callable, Iterable, Sequence
from types import CodeType
from typing import Any, NamedTuple

import numpy as np

from gauss_bench.terms import Array

FEW = 20  # states: below this number a loop over floats is faster than arrays
FUNCTIONS = ("sqrt", "sin", "cos", "tanh")
Number = Any  # a float, or one of a longer type


class Symbol:
    """A number of a program: a name in it, or a constant."""

    __slots__ = ("number", "program", "text")

    def __init__(self, program: "Program", text: str, number: Number | None = None):
        self.program, self.text, self.number = program, text, number

    @property
    def zero(self) -> bool:
        return self.number is not None and bool(self.number == 0)

    def __add__(self, other: "Symbol | Number") -> "Symbol":
        return self.program.add(self, other)

    __radd__ = __add__

    def __sub__(self, other: "Symbol | Number") -> "Symbol":
        return self.program.subtract(self, other)

    def __rsub__(self, other: Number) -> "Symbol":
        return self.program.subtract(other, self)

    def __mul__(self, other: "Symbol | Number") -> "Symbol":
        return self.program.multiply(self, other)

    __rmul__ = __mul__

    def __neg__(self) -> "Symbol":
        return self.program.negate(self)


class Line(NamedTuple):
    """One operation: the name of its result, its text, and the operands that stand in it."""

    name: str
    text: str
    operands: tuple[Symbol, ...]


class Program:
    """The recorded operations in order, each once. It is also the `Arithmetic` of its symbols: their operators call its methods."""

    def __init__(self) -> None:
        self.lines: list[Line] = []
        self.constants: dict[str, Number] = {}
        self.known: dict[str, Symbol] = {}
        self.opposites: dict[str, Symbol] = {}  # name of -x: x

    def symbol(self, x: Symbol | Number) -> Symbol:
        """Return x as a symbol; a constant is written as a float literal, or gets a name if a float has too few digits."""
        if isinstance(x, Symbol):
            return x
        if float(x) == x:
            return Symbol(self, f"({float(x)!r})" if x < 0 else repr(float(x)), x)
        name = f"c{len(self.constants)}"
        self.constants[name] = x
        return Symbol(self, name, x)

    def input(self, name: str) -> Symbol:
        return self.known.setdefault(name, Symbol(self, name))

    def add(self, a: Symbol | Number, b: Symbol | Number) -> Symbol:
        a, b = self.symbol(a), self.symbol(b)
        if a.number is not None and b.number is not None:
            return self.symbol(a.number + b.number)
        if a.zero or b.zero:
            return b if a.zero else a
        if (opposite := self.opposites.get(b.text)) is not None:
            return self.subtract(a, opposite)
        if (opposite := self.opposites.get(a.text)) is not None:
            return self.subtract(b, opposite)
        return self._keep(f"{a.text} + {b.text}", a, b)

    def subtract(self, a: Symbol | Number, b: Symbol | Number) -> Symbol:
        a, b = self.symbol(a), self.symbol(b)
        if a.number is not None and b.number is not None:
            return self.symbol(a.number - b.number)
        if b.zero:
            return a
        if a.zero:
            return self.negate(b)
        if (opposite := self.opposites.get(b.text)) is not None:
            return self.add(a, opposite)
        return self._keep(f"{a.text} - {b.text}", a, b)

    def multiply(self, a: Symbol | Number, b: Symbol | Number) -> Symbol:
        a, b = self.symbol(a), self.symbol(b)
        if a.number is not None and b.number is not None:
            return self.symbol(a.number * b.number)
        if b.number is not None:
            a, b = b, a
        if a.number is not None and abs(a.number) in (0, 1):
            return self.symbol(0.0) if a.zero else b if a.number > 0 else self.negate(b)
        return self._keep(f"{a.text} * {b.text}", a, b)

    def negate(self, a: Symbol) -> Symbol:
        if a.number is not None:
            return self.symbol(-a.number)
        if (opposite := self.opposites.get(a.text)) is not None:
            return opposite
        found = self._keep(f"-{a.text}", a)
        self.opposites[found.text] = a
        return found

    def inverse(self, a: Symbol | Number) -> Symbol:
        """Return 1 / a, and 0 for a = 0: the distance of two coincident points has no direction."""
        a = self.symbol(a)
        if a.number is not None:
            return self.symbol(1.0 / a.number if a.number else 0.0)
        return self._keep(f"inverse({a.text})", a)

    def __getattr__(self, name: str) -> Callable[[Symbol | Number], Symbol]:
        if name not in FUNCTIONS:
            raise AttributeError(name)
        return lambda a: self._of_one(name, self.symbol(a))

    def _of_one(self, name: str, a: Symbol) -> Symbol:
        return self.symbol(getattr(np, name)(a.number)) if a.number is not None else self._keep(f"{name}({a.text})", a)

    def _keep(self, text: str, *operands: Symbol) -> Symbol:
        if text not in self.known:
            line = Line(f"x{len(self.lines)}", text, operands)
            self.lines.append(line)
            self.known[text] = Symbol(self, line.name)
        return self.known[text]

    def lines_for(self, results: Iterable[Symbol]) -> list[Line]:
        """Return the lines that these symbols depend on, in order."""
        names, lines = {x.text for x in results}, []
        for line in reversed(self.lines):
            if line.name in names:
                names |= {x.text for x in line.operands}
                lines.append(line)
        return lines[::-1]


class GeneratedFunction:
    """A generated function of lists of numbers: `inputs` are (name, length) of each list, `groups` the symbols that it returns.

    Attributes:
        source: text of the function.
    """

    def __init__(self, program: Program, inputs: Sequence[tuple[str, int]], groups: Sequence[Sequence[Symbol]]):
        names = ", ".join(name for name, _ in inputs)
        # each list is unpacked into scalars q0, q1, ... : reading a local variable is faster than indexing
        heads = [f"{', '.join(f'{name}{k}' for k in range(count))}, = {name}" for name, count in inputs if count]
        tuples = [f"({''.join(f'{x.text}, ' for x in group)})" for group in groups]
        needed = program.lines_for(x for group in groups for x in group)
        lines = [f"{line.name} = {line.text}" for line in needed]
        self.source = "\n    ".join([f"def function({names}):", *heads, *lines, f"return ({', '.join(tuples)},)"])
        self.sizes = [len(group) for group in groups]
        floats = {name: getattr(math, name) for name in FUNCTIONS} | {"inverse": _inverse}
        arrays = {name: getattr(np, name) for name in FUNCTIONS} | {"inverse": inverse}
        code = compile(self.source, "<equations>", "exec")
        self._of_floats, self._of_arrays = (_function(code, names | program.constants) for names in (floats, arrays))
        self._in_floats = not program.constants  # named constants have more digits than a float

    def __call__(self, *given: Array) -> list[Array]:
        """Evaluate the groups (..., k) at inputs (..., n)."""
        first = given[0]
        shape, dtype = first.shape[:-1], np.result_type(*(x.dtype for x in given))
        if self._in_floats and dtype == np.float64 and math.prod(shape) < FEW:
            try:
                return self._one_by_one(shape, given)
            except (ValueError, OverflowError):  # sine of inf raises for floats; arrays return nan
                pass
        found = []
        for group in self._of_arrays(*(np.moveaxis(x, -1, 0) for x in given)):
            out = np.empty((*shape, len(group)), dtype=dtype)
            for k, x in enumerate(group):
                out[..., k] = x
            found.append(out)
        return found

    def _one_by_one(self, shape: tuple[int, ...], given: Sequence[Array]) -> list[Array]:
        if not shape:
            return [np.array(group) for group in self._of_floats(*(x.tolist() for x in given))]
        count = math.prod(shape)
        states = zip(*(x.reshape(count, x.shape[-1]).tolist() for x in given), strict=True)
        groups = list(zip(*(self._of_floats(*state) for state in states), strict=True))
        found = groups or [()] * len(self.sizes)
        return [np.array(group).reshape(*shape, size) for group, size in zip(found, self.sizes, strict=True)]


def _function(code: CodeType, names: dict[str, Any]) -> Callable[..., tuple[tuple[Any, ...], ...]]:
    exec(code, names)  # of names and numbers alone
    return names["function"]  # type: ignore[no-any-return]


def _inverse(x: float) -> float:
    return 1.0 / x if x else 0.0


def inverse(x: Array) -> Array:
    """Return 1 / x, and 0 where x is 0, as `Program.inverse` does."""
    zero = np.equal(x, 0)
    return np.where(zero, 0, 1 / np.where(zero, 1, x)) if zero.any() else 1 / x
