"""Routines written as source text: as Python on arrays, for hosts without a compiler, and as plain C, for any other machine.

A routine in C computes one trajectory. It returns 0 if the computation is complete, and 1 if not, for example because a pivot
became too small:

    int NAME(arrays, numbers, counts)
"""

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import numpy as np

from gauss_bench.compiler.machine.graph import COUNTS, MASKS, TRUTHS
from gauss_bench.compiler.machine.routine import Emitter, If, Load, Loop, Routine, Scatter, Statement, Store

C_HEADER = "#include <math.h>\n\n"
C_TYPES = dict.fromkeys(COUNTS, "long") | dict.fromkeys((*MASKS, *TRUTHS), "int")  # types of results


@dataclass(frozen=True)
class Language:
    """The syntax of a programming language: templates for the parts of a routine, in which operands replace {0}, {1} ...

    Attributes:
        operations: name of an operation -> its expression; the payload of the operation, such as a number, replaces {p}.
        assign: line that assigns {1} to the variable {0}.
        forever, close: lines that begin and that end an endless loop; `close` also ends a branch.
        leave: line that ends a loop if the condition {0} is false.
        branch: line that begins a branch, which is executed if the condition {0} is true.
    """

    operations: Mapping[str, str]
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
    forever="for (;;) {",
    leave="if (!{0}) break;",
    branch="if ({0}) {{",
    close="}",
)  # fmt: skip


class Source(Emitter):
    """Writes the lines of one function in C or Python.

    Attributes:
        variables: name of each variable written so far -> its type in C.
        depth: number of indentations of the next line.
        first: names of the initial values of the next loop's variables; the base class sets this list.
    """

    def __init__(self, routine: Routine, language: Language):
        """Prepare to write a routine in a language."""
        super().__init__(routine)
        self.routine, self.language = routine, language
        self.lines: list[str] = []
        self.variables: dict[str, str] = {}
        self.depth = 1
        # arguments keep their names
        for x, (operation, payload) in enumerate(zip(self.graph.operation, self.graph.payload, strict=True)):
            name = str(payload)[1:]  # the payload of a leaf is "%name"
            if operation in ("leaf", "count") and name in (*routine.numbers, *routine.counts):
                self.names[x] = name

    def write_line(self, text: str) -> None:
        """Write one line, indented."""
        self.lines.append("    " * self.depth + text)

    @contextmanager
    def block(self, head: str) -> Iterator[None]:
        """Write the line `head`, and indent all lines that are written inside this `with` statement below it."""
        self.write_line(head)
        self.depth += 1
        yield
        self.depth -= 1
        if self.language.close:
            self.write_line(self.language.close)

    def let(self, x: int, text: str, letter: str = "r") -> str:
        """Assign the expression `text` to a variable for value x of the graph; return its name, `letter` and x.

        The letter is r for a result, v for a variable of a loop or branch, n for a copy before its assignment.
        """
        name = f"{letter}{x}"
        self.variables[name] = C_TYPES.get(self.graph.operation[x], "double")
        self.write_line(self.language.assign.format(name, text))
        return name

    def write_value(self, x: int) -> str:
        """Return the text for value x of the graph, whose operands have names already.

        The text is a constant, or the name of a variable; a line that assigns the result to this variable is then written.
        """
        operation, payload, number = self.graph.operation[x], self.graph.payload[x], self.graph.number(x)
        is_c = self.language is C
        if number is not None:
            text = number.hex() if is_c else repr(number)
            return text if number >= 0 else f"({text})"
        if operation == "all":  # the mask that is True, or False, for all trajectories
            return str(int(bool(payload))) if is_c else str(payload)
        operands = [self.names[k] for k in self.graph.operands[x]]
        return self.let(x, self.language.operations[operation].format(*operands, p=payload))

    def assign_leaves(self, values: Mapping[int, str]) -> None:
        """Write lines that assign new values to variables (leaves of the graph), with the effect of simultaneous assignments.

        Several new values are first copied (letter n) and then assigned (letter v), because a new value may be the old value of
        another variable.
        """
        copies = {x: self.let(x, name, "n") for x, name in values.items()} if len(values) > 1 else values
        for x, name in copies.items():
            self.names[x] = self.let(x, name, "v")

    def write_statement(self, s: Statement) -> None:
        """Write the lines of one statement; `Compute` is written by the base class."""
        match s:
            case Load():
                for x, row in self.select_rows(s).items():
                    self.names[x] = self.let(x, f"{s.array}[{self._row(s.start, row)}]")
            case Store():
                # copied first: a value may be a view of the array
                copies = [self.let(x, name, "n") for x, name in zip(s.values, self.compute(s.values), strict=True)]
                for row, name in enumerate(copies):
                    self.write_line(self.language.assign.format(f"{s.array}[{self._row(s.start, row)}]", name))
            case Scatter():  # in Python only: `place` has the index at which the numbers of each trajectory begin
                values, (start, block, last) = self.compute(s.values), self.compute([s.start, s.block, s.last])
                lanes = f"np.arange({next(iter(self.routine.arrays))}.shape[-1])"
                place = self.let(s.start, f"np.minimum({lanes} * {block}, {last}) + {start}", "place")
                for row, name in enumerate(values):
                    self.write_line(f"{s.array}[{place} + {row}] = {name}")
            case Loop():
                carried = self.select_carried(s)
                self.assign_leaves(dict(zip(carried, self.first, strict=True)))  # values in the first iteration
                with self.block(self.language.forever):
                    self.write_statements(s.body)
                    self.write_line(self.language.leave.format(self.need(s.again)))
                    with self.within():
                        self._compute_and_assign({x: new for x, (_, new) in carried.items()})
            case If():  # first the values without the branch; the branch assigns others
                self._compute_and_assign({x: old for x, (_, old) in s.merged.items()})
                with self.block(self.language.branch.format(self.need(s.condition))), self.within():
                    self.write_statements(s.body)
                    self._compute_and_assign({x: new for x, (new, _) in s.merged.items()})

    def _compute_and_assign(self, values: Mapping[int, int]) -> None:
        """Write lines that compute and assign new values of variables; `values`: variable (a leaf) -> its new value."""
        self.assign_leaves(dict(zip(values, self.compute([*values.values()]), strict=True)))

    def _row(self, start: int | None, row: int) -> str:
        """Return as text the index start + row of an array's row; `start` is an integer value of the graph, or None for 0."""
        return str(row) if start is None else f"{self.need(start)} + {row}"


def write_c(routine: Routine) -> str:
    """Return the text of a C function that computes one trajectory; it returns 0, or 1 if the routine's mask `sound` is false."""
    s = Source(routine, C)
    s.write_statements(routine.body)  # writes s.lines, and notes the variables in s.variables
    s.write_line(f"return !{s.need(routine.sound)};")
    arguments = [f"double *{name}" for name in routine.arrays]
    arguments += [f"double {x}" for x in routine.numbers] + [f"long {x}" for x in routine.counts]
    of_type: dict[str, list[str]] = {}  # type -> its variables, which one line declares
    for name, kind in s.variables.items():
        of_type.setdefault(kind, []).append(name)
    declarations = [f"    {kind} {', '.join(names)};" for kind, names in of_type.items()]
    return "\n".join([f"int {routine.name}({', '.join(arguments)})\n{{", *declarations, *s.lines, "}\n"])


def make_python(routine: Routine) -> Callable[..., None]:
    """Return a routine as a Python function of arrays, numbers and counts, then the number of groups of trajectories.

    Arrays have the axes (groups, rows of the array, trajectories of a group); an array that a `Scatter` statement writes has only
    one axis.
    """
    s = Source(routine, PYTHON)
    s.write_statements(routine.body)
    names = ", ".join([*routine.arrays, *routine.numbers, *routine.counts])
    space: dict[str, Any] = {"np": np}  # names that the function can use
    exec("\n".join([f"def {routine.name}({names}):", *s.lines, "    return"]), space)
    compute_group: Callable[..., None] = space[routine.name]

    def call(*arguments: Any) -> None:
        """Compute one group after the other; the function writes its results into the arrays."""
        arrays, numbers = arguments[: len(routine.arrays)], arguments[len(routine.arrays) : -1]  # the last is the number of groups
        with np.errstate(all="ignore"):
            for k in range(arguments[-1]):
                # an array with 0 rows is shared by all groups
                of_group = [x[k] if a.rows else x for x, a in zip(arrays, routine.arrays.values(), strict=True)]
                compute_group(*of_group, *numbers)

    return call
