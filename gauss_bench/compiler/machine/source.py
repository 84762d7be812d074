"""Routines as source text: Python on arrays, for hosts without a compiler, and plain C for any other machine.

Sines are left to the target's own functions. A routine in C does one trajectory and returns 0, or 1 where it is not sound:

    int NAME(arrays, numbers, counts)

In Python it is that of the native code, with as many trajectories in a group as arrays have columns.
"""

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import numpy as np

from gauss_bench.compiler.machine.graph import (
    COUNTS,
    MASKS,
    TRUTHS,
    Emitter,
    If,
    Load,
    Loop,
    Routine,
    Scatter,
    Statement,
    Store,
)

C_HEADER = "#include <math.h>\n\n"


@dataclass(frozen=True)
class Language:
    """The phrases of a language for the parts of a routine: `{0}`, `{1}` ... are operands, `{p}` a payload."""

    calls: Mapping[str, str]
    assign: str
    forever: str
    leave: str
    branch: str
    close: str


SAME_IN_BOTH = {
    "add": "{0} + {1}", "sub": "{0} - {1}", "mul": "{0} * {1}", "div": "{0} / {1}", "lt": "{0} < {1}", "le": "{0} <= {1}",
    "neg": "-{0}", "sqrt": "sqrt({0})", "sin": "sin({0})", "cos": "cos({0})", "whole": "{p}", "sum": "{0} + {1}",
    "times": "{0} * {p}", "below": "{0} < {1}", "same": "{0} == {1}", "everywhere": "{0}",
}  # fmt: skip
PYTHON = Language(
    SAME_IN_BOTH
    | {
        "abs": "abs({0})", "sqrt": "np.sqrt({0})", "sin": "np.sin({0})", "cos": "np.cos({0})", "select": "np.where({0}, {1}, {2})",
        "both": "{0} & {1}", "not": "np.logical_not({0})", "any": "np.any({0})", "also": "{0} and {1}", "number": "float({0})",
        "least": "min({0}, {1})", "nowhere": "not np.any({0})",
    },
    assign="{0} = {1}",
    forever="while True:",
    leave="if not {0}: break",
    branch="if {0}:",
    close="",
)  # fmt: skip
C = Language(
    SAME_IN_BOTH
    | {
        "abs": "fabs({0})", "select": "{0} ? {1} : {2}", "both": "{0} && {1}", "not": "!{0}", "any": "{0}", "also": "{0} && {1}",
        "number": "(double){0}", "least": "{0} < {1} ? {0} : {1}", "fma": "fma({0}, {1}, {2})", "nowhere": "!{0}",
    },
    assign="{0} = {1};",
    forever="for (;;) {{",
    leave="if (!{0}) break;",
    branch="if ({0}) {{",
    close="}",
)  # fmt: skip


class Source(Emitter):
    """Lines of one function.

    Attributes:
        variables: name -> its type in C.
    """

    def __init__(self, routine: Routine, language: Language):
        super().__init__(routine)
        self.routine, self.language = routine, language
        self.lines: list[str] = []
        self.variables: dict[str, str] = {}
        self.depth = 1
        for x, (operation, payload) in enumerate(zip(self.graph.operation, self.graph.payload, strict=True)):
            if operation in ("leaf", "count") and str(payload)[1:] in (*routine.numbers, *routine.counts):
                self.names[x] = str(payload)[1:]

    def line(self, text: str) -> None:
        self.lines.append("    " * self.depth + text)

    @contextmanager
    def block(self, head: str, *given: str) -> Iterator[None]:
        self.line(head.format(*given))
        self.depth += 1
        with self.within():
            yield
        self.depth -= 1
        if self.language.close:
            self.line(self.language.close)

    def let(self, x: int, text: str, letter: str = "r") -> str:
        """Assign to the variable of a value."""
        name, operation = f"{letter}{x}", self.graph.operation[x]
        self.variables[name] = "long" if operation in COUNTS else "int" if operation in (*MASKS, *TRUTHS) else "double"
        self.line(self.language.assign.format(name, text))
        return name

    def value(self, x: int) -> str:
        operation, payload, number = self.graph.operation[x], self.graph.payload[x], self.graph.number(x)
        c = self.language is C
        if number is not None:
            text = number.hex() if c else repr(number)
            return text if number >= 0 else f"({text})"
        if operation == "all":
            return str(int(bool(payload))) if c else str(payload)
        operands = [self.names[k] for k in self.graph.operands[x]]
        return self.let(x, self.language.calls[operation].format(*operands, p=payload))

    def moved(self, values: Mapping[int, str], letter: str) -> None:
        """Assign to leaves, all at once."""
        held = {x: self.let(x, name, "n") for x, name in values.items()} if len(values) > 1 else values
        for x, name in held.items():
            self.names[x] = self.let(x, name, letter)

    def statement(self, s: Statement) -> None:
        match s:
            case Load():
                for x, row in self.rows(s).items():
                    self.names[x] = self.let(x, f"{s.array}[{self._row(s.start, row)}]")
            case Store():
                held = [self.let(x, name, "n") for x, name in zip(s.values, self.compute(s.values), strict=True)]
                for row, name in enumerate(held):
                    self.line(self.language.assign.format(f"{s.array}[{self._row(s.start, row)}]", name))
            case Scatter():
                values, (start, block, last) = self.compute(s.values), self.compute([s.start, s.block, s.last])
                lanes = f"np.arange({next(iter(self.routine.arrays))}.shape[-1])"
                place = self.let(s.start, f"np.minimum({lanes} * {block}, {last}) + {start}", "place")
                for row, name in enumerate(values):
                    self.line(f"{s.array}[{place} + {row}] = {name}")
            case Loop():
                carried = self.carried(s)
                self.moved(dict(zip(carried, self.first, strict=True)), "v")
                self.line(self.language.forever.format())
                self.depth += 1
                self.statements(s.body)
                self.line(self.language.leave.format(self.need(s.again)))
                with self.within():
                    self.statements(s.after)
                    self.compute([b for _, b in carried.values()])
                    self.moved({x: self.names[b] for x, (_, b) in carried.items()}, "v")
                self.depth -= 1
                if self.language.close:
                    self.line(self.language.close)
            case If():
                old = self.compute([b for _, b in s.merged.values()])
                self.moved(dict(zip(s.merged, old, strict=True)), "v")
                names = {x: self.names[x] for x in s.merged}
                with self.block(self.language.branch, self.need(s.condition)):
                    self.statements(s.body)
                    self.compute([a for a, _ in s.merged.values()])
                    self.moved({x: self.names[a] for x, (a, _) in s.merged.items()}, "v")
                self.names |= names

    def _row(self, start: int | None, row: int) -> str:
        return str(row) if start is None else f"{self.need(start)} + {row}"


def in_c(routine: Routine) -> str:
    """A routine as a function in C, for one trajectory."""
    s = Source(routine, C)
    s.statements(routine.body)
    s.line(f"return !{s.need(routine.sound)};")
    given = [f"double *{name}" for name in routine.arrays]
    given += [f"double {x}" for x in routine.numbers] + [f"long {x}" for x in routine.counts]
    kinds: dict[str, list[str]] = {}
    for name, kind in s.variables.items():
        kinds.setdefault(kind, []).append(name)
    declared = [f"{kind} {', '.join(names)};" for kind, names in kinds.items()]
    body = [f"    {x}" for x in declared] + s.lines
    return "\n".join([f"int {routine.name}({', '.join(given)})\n{{", *body, "}\n"])


def in_python(routine: Routine) -> Callable[..., None]:
    """A routine on arrays (groups, rows, trajectories), flat where they are scattered into."""
    s = Source(routine, PYTHON)
    s.statements(routine.body)
    given = ", ".join([*routine.arrays, *routine.numbers, *routine.counts])
    space: dict[str, Any] = {"np": np}
    exec("\n".join([f"def {routine.name}({given}):", *s.lines, "    return"]), space)
    one: Callable[..., None] = space[routine.name]

    def call(*arguments: Any) -> None:
        arrays, numbers = arguments[: len(routine.arrays)], arguments[len(routine.arrays) : -1]
        with np.errstate(all="ignore"):
            for k in range(arguments[-1]):
                one(*(x[k] if a.rows else x for x, a in zip(arrays, routine.arrays.values(), strict=True)), *numbers)

    return call
