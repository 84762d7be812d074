"""Generate straight-line Python code from equations; the code computes every common subexpression once.

The equations are evaluated once, with symbols in place of numbers. Operations on symbols are recorded in order, equal operations
only once, and simplified where they involve 0, 1 or constants. The result is the source text of one function without loops or
indices, which works on floats and on arrays of states, in double precision or in types with more digits. For a single state,
floats take a tenth of the time of arrays.
"""

import math
from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from types import CodeType
from typing import Any, NamedTuple

import numpy as np

from gauss_bench.terms import Array

FEW = 20  # number of states below which a loop over floats is faster than arrays
FUNCTIONS = ("sqrt", "sin", "cos", "tanh")
Number = Any  # a float, or a number of a longer type


class Symbol:
    """A number of a program: its name or literal `text`, and the value `number` of a constant; None for a number that varies."""

    __slots__ = ("number", "program", "text")

    def __init__(self, program: "Program", text: str, number: Number | None = None):
        self.program, self.text, self.number = program, text, number

    @property
    def zero(self) -> bool:
        """Whether the symbol is the constant 0."""
        return self.number is not None and bool(self.number == 0)

    def __add__(self, other: "Symbol | Number") -> "Symbol":
        """Return the sum; a + -x is recorded as the difference a - x."""
        program, other = self.program, self.program.symbol(other)
        if self.number is not None and other.number is not None:
            return program.symbol(self.number + other.number)
        if self.zero or other.zero:
            return other if self.zero else self
        for a, b in ((self, other), (other, self)):
            if b.text in program.opposites:
                opposite = program.opposites[b.text]
                return program.record(f"{a.text} - {opposite.text}", a, opposite)
        return program.record(f"{self.text} + {other.text}", self, other)

    __radd__ = __add__

    def __sub__(self, other: "Symbol | Number") -> "Symbol":
        """Return the difference: the sum with the negative, which `lines_for` leaves out if no other operation uses it."""
        return self + -self.program.symbol(other)

    def __rsub__(self, other: Number) -> "Symbol":
        """Return a constant less this symbol."""
        return self.program.symbol(other) - self

    def __mul__(self, other: "Symbol | Number") -> "Symbol":
        """Return the product; a constant factor is recorded first, and a factor 1 or -1 is left out."""
        a, b = self, self.program.symbol(other)
        if a.number is not None and b.number is not None:
            return self.program.symbol(a.number * b.number)
        if b.number is not None:
            a, b = b, a
        if a.zero:
            return self.program.symbol(0.0)
        if a.number is not None and abs(a.number) == 1:
            return b if a.number > 0 else -b
        return self.program.record(f"{a.text} * {b.text}", a, b)

    __rmul__ = __mul__

    def __neg__(self) -> "Symbol":
        """Return the negative; that of -x is x itself."""
        if self.number is not None:
            return self.program.symbol(-self.number)
        if self.text in self.program.opposites:
            return self.program.opposites[self.text]
        negative = self.program.record(f"-{self.text}", self)
        self.program.opposites[negative.text] = self
        return negative


class Line(NamedTuple):
    """One operation: the name of its result, its text, and its operands."""

    name: str
    text: str
    operands: tuple[Symbol, ...]


class Program:
    """The recorded operations in order, each once; a program implements the protocol `Arithmetic` (frames.py) for its symbols.

    Attributes:
        constants: name -> number, for constants with more digits than a float.
        lines: the operations.
        known: text of an operation, such as "x1 + q0", or name of an input -> the symbol of its value.
        opposites: name of the symbol of -x -> the symbol of x.
    """

    def __init__(self) -> None:
        self.lines: list[Line] = []
        self.constants: dict[str, Number] = {}
        self.known: dict[str, Symbol] = {}
        self.opposites: dict[str, Symbol] = {}

    def symbol(self, x: Symbol | Number) -> Symbol:
        """Return x as a symbol of the program: a number becomes a constant, a symbol is returned unchanged."""
        if isinstance(x, Symbol):
            return x
        if float(x) == x:  # exact in double precision: a literal
            return Symbol(self, f"({float(x)!r})" if x < 0 else repr(float(x)), x)
        # a number of a longer type: a named constant, which the generated function gets beside its text
        name = f"c{len(self.constants)}"
        self.constants[name] = x
        return Symbol(self, name, x)

    def input(self, name: str) -> Symbol:
        """Return the symbol of an input of the program."""
        return self.known.setdefault(name, Symbol(self, name))

    def inverse(self, a: Symbol | Number) -> Symbol:
        """Return 1 / a, and 0 for a = 0, so that a force between coincident points, which has no direction, is 0."""
        a = self.symbol(a)
        if a.number is not None:
            return self.symbol(1.0 / a.number if a.number else 0.0)
        return self.record(f"inverse({a.text})", a)

    def __getattr__(self, name: str) -> Callable[[Symbol | Number], Symbol]:
        """Return a method for one of FUNCTIONS, such as `sin`, which records a call of this function."""
        if name not in FUNCTIONS:
            raise AttributeError(name)

        def apply(a: Symbol | Number) -> Symbol:
            a = self.symbol(a)
            return self.record(f"{name}({a.text})", a) if a.number is None else self.symbol(getattr(np, name)(a.number))

        return apply

    def record(self, text: str, *operands: Symbol) -> Symbol:
        """Return the symbol of an operation's result; the operation becomes a new line unless it is recorded already."""
        if text not in self.known:
            line = Line(f"x{len(self.lines)}", text, operands)
            self.lines.append(line)
            self.known[text] = Symbol(self, line.name)
        return self.known[text]

    def lines_for(self, results: Iterable[Symbol]) -> list[Line]:
        """Return the lines of the program on which the given results depend, in the order in which they were recorded."""
        wanted, lines = {x.text for x in results}, []
        for line in reversed(self.lines):
            if line.name in wanted:
                wanted |= {x.text for x in line.operands}
                lines.append(line)
        return lines[::-1]


class GeneratedFunction:
    """A function that is generated from a program; `source` is its text."""

    def __init__(self, program: Program, inputs: Sequence[tuple[str, int]], groups: Sequence[Sequence[Symbol]]):
        """Generate the function.

        Args:
            inputs: name and length of each argument, an array.
            groups: for each array that the function returns, the symbols of its entries.
        """
        names = ", ".join(name for name, _ in inputs)
        # each argument is unpacked into scalars q0, q1, ... : reading a local variable is faster than indexing
        heads = []
        for name, count in inputs:
            if count:
                scalars = "".join(f"{name}{k}, " for k in range(count))
                heads.append(f"{scalars.rstrip()} = {name}")
        # the source of each returned tuple, such as "(x3, q0, )"
        tuples = [f"({''.join(f'{x.text}, ' for x in group)})" for group in groups]
        needed = program.lines_for(x for group in groups for x in group)
        lines = [f"{line.name} = {line.text}" for line in needed]
        self.source = "\n    ".join([f"def function({names}):", *heads, *lines, f"return ({', '.join(tuples)},)"])
        self.sizes = [len(group) for group in groups]
        code = compile(self.source, "<equations>", "exec")
        floats = {name: getattr(math, name) for name in FUNCTIONS} | {"inverse": lambda x: 1.0 / x if x else 0.0}
        arrays = {name: getattr(np, name) for name in FUNCTIONS} | {"inverse": inverse} | program.constants
        self._of_floats, self._of_arrays = _define_function(code, floats), _define_function(code, arrays)
        self._fits_floats = not program.constants  # named constants have more digits than a float

    def __call__(self, *inputs: Array) -> list[Array]:
        """Return, for each group of k symbols, the array (..., k) of their values, from the values (..., n) of the inputs."""
        shape, dtype = inputs[0].shape[:-1], np.result_type(*(x.dtype for x in inputs))
        if self._fits_floats and dtype == np.float64 and math.prod(shape) < FEW:
            # math.sin(inf) raises, whereas np.sin(inf) below returns nan
            with suppress(ValueError, OverflowError):
                return self._state_by_state(shape, inputs)
        results = []
        for group in self._of_arrays(*(np.moveaxis(x, -1, 0) for x in inputs)):
            out = np.empty((*shape, len(group)), dtype=dtype)
            for k, x in enumerate(group):
                out[..., k] = x
            results.append(out)
        return results

    def _state_by_state(self, shape: tuple[int, ...], inputs: Sequence[Array]) -> list[Array]:
        """Return the result of `__call__`, computed with floats for each state of the batch in turn."""
        if not shape:
            return [np.array(group) for group in self._of_floats(*(x.tolist() for x in inputs))]
        count = math.prod(shape)
        if count == 0:
            return [np.empty((*shape, size)) for size in self.sizes]
        states = zip(*(x.reshape(count, x.shape[-1]).tolist() for x in inputs), strict=True)
        groups = zip(*(self._of_floats(*state) for state in states), strict=True)
        return [np.array(group).reshape(*shape, size) for group, size in zip(groups, self.sizes, strict=True)]


def _define_function(code: CodeType, names: dict[str, Any]) -> Callable[..., tuple[tuple[Any, ...], ...]]:
    """Return the function that the compiled source text defines; `names` has the functions and constants that it uses."""
    exec(code, names)  # the code contains only names and numbers of `Program`, no text of a user
    return names["function"]  # type: ignore[no-any-return]


def inverse(x: Array) -> Array:
    """Return 1 / x, and 0 for entries that are 0, as `Program.inverse` does."""
    zero = np.equal(x, 0)
    return np.where(zero, 0, 1 / np.where(zero, 1, x)) if zero.any() else 1 / x
