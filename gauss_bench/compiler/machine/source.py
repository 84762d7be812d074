"""Programs as source text: Python, on floats or arrays, for hosts without a compiler, and plain C for any other machine.

Sines are left to the target's own functions. Functions in C return 0, or 1 where a guard fails and nothing was written:

    int accelerate(double t, const double *q, const double *v, const double *p, double *a)

both from straight-line code and from loops over lanes, whose memory stands on the stack.
"""

from collections.abc import Callable, Mapping, Sequence
from itertools import pairwise
from typing import Any

import numpy as np

from gauss_bench.compiler.elimination.function import Function
from gauss_bench.compiler.machine.graph import Graph, inline, live
from gauss_bench.compiler.machine.graph import leaves as graph_leaves
from gauss_bench.compiler.machine.loops import Block, LoopedProgram, Memory, needed_outside
from gauss_bench.terms import Array

SYMBOLS = {"add": "+", "sub": "-", "mul": "*", "div": "/", "lt": "<", "le": "<=", "both": "&"}
CALLS = {
    "neg": "-{0}",
    "abs": "abs({0})",
    "sqrt": "sqrt({0})",
    "sin": "sin({0})",
    "cos": "cos({0})",
    "select": "where({0}, {1}, {2})",
}


def expression(g: Graph, x: int, names: Mapping[int, str]) -> str:
    """One value as an expression of Python."""
    a = [names[k] for k in g.operands[x]]
    operation = g.operation[x]
    return f"{a[0]} {SYMBOLS[operation]} {a[1]}" if operation in SYMBOLS else CALLS[operation].format(*a)


def source(g: Graph, roots: list[int], arguments: Sequence[str], inputs: Mapping[str, str]) -> str:
    """`evaluate(arguments)`; `inputs` tells how a leaf is read from them. A temporary is freed after its last use."""
    values = live(g, roots)
    last = {k: x for x in values for k in g.operands[x]} | dict.fromkeys(roots, -1)
    names: dict[int, str] = {}
    lines, free, used = [], list[str](), 0
    for x in values:
        number = g.number(x)
        if number is not None:
            names[x] = repr(number) if number >= 0 else f"({number!r})"
        elif g.operation[x] == "leaf":
            names[x] = inputs[str(g.payload[x])]
        else:
            text = expression(g, x, names)
            free += {names[k] for k in g.operands[x] if last[k] == x and names[k].startswith("r")}
            used += not free
            names[x] = free.pop() if free else f"r{used}"
            lines.append(f"    {names[x]} = {text}")
    return "\n".join((f"def evaluate({', '.join(arguments)}):", *lines, f"    return [{', '.join(names[x] for x in roots)}]"))


def function(g: Graph, roots: list[int], arguments: Sequence[str], inputs: Mapping[str, str]) -> Callable[..., list[Any]]:
    """The compiled source, on floats or arrays."""
    space: dict[str, Any] = {"sin": np.sin, "cos": np.cos, "sqrt": np.sqrt, "abs": np.abs, "where": np.where}
    exec(source(g, roots, arguments, inputs), space)
    evaluate: Callable[..., list[Any]] = space["evaluate"]
    return evaluate


def on_arrays(given: Function) -> Callable[..., list[Array]]:
    """A function as one of arrays (k, size), one for each argument; its results are arrays (k, size)."""
    g = Graph()
    leaves = [[g.leaf(f"%{a}_{i}") for i in range(size)] for a, size in enumerate(given.sizes)]
    results = inline(g, given, leaves, lambda x: (g.make("sin", x), g.make("cos", x)))
    inputs = {f"%{a}_{i}": f"x{a}[{i}]" for a, size in enumerate(given.sizes) for i in range(size)}
    arguments = [f"x{a}" for a in range(len(given.sizes))]
    evaluate = function(g, [x for result in results for x in result], arguments, inputs)

    def call(*arrays: Array) -> list[Array]:
        with np.errstate(all="ignore"):
            values = evaluate(*(x.T for x in arrays))
        shape = arrays[0].shape[:1]
        columns = [np.broadcast_to(x, shape) for x in values]
        cuts = np.cumsum([0, *(len(result) for result in results)]).tolist()
        return [np.array(columns[a:b]).reshape(b - a, *shape).T for a, b in pairwise(cuts)]

    return call


C_CALLS = {
    "add": "{0} + {1}", "sub": "{0} - {1}", "mul": "{0} * {1}", "div": "{0} / {1}", "lt": "{0} < {1}", "le": "{0} <= {1}",
    "both": "{0} && {1}", "neg": "-{0}", "abs": "fabs({0})", "sqrt": "sqrt({0})", "sin": "sin({0})", "cos": "cos({0})",
    "fma": "fma({0}, {1}, {2})", "select": "{0} ? {1} : {2}",
}  # fmt: skip
MASKS = ("lt", "le", "both")
C_HEADER = "#include <math.h>\n\n"


def c_lines(g: Graph, values: Sequence[int], leaves: Mapping[int, str]) -> tuple[list[str], dict[int, str]]:
    """Declarations of values in C, and what each is called; `leaves` are called already."""
    names, lines = dict(leaves), list[str]()
    for x in values:
        number = g.number(x)
        if number is not None:
            names[x] = number.hex() if number >= 0 else f"({number.hex()})"
        elif x not in names:
            kind = "int" if g.operation[x] in MASKS else "double"
            names[x] = f"r{x}"
            lines.append(f"const {kind} r{x} = {C_CALLS[g.operation[x]].format(*(names[k] for k in g.operands[x]))};")
    return lines, names


def c_function(head: str, g: Graph, results: Mapping[str, int], guard: int | None, inputs: Mapping[str, str]) -> str:
    """A function in C that sets `results`, by what is assigned to, where `guard` holds; `inputs` tells how a leaf is read."""
    values = live(g, [*results.values(), *([] if guard is None else [guard])])
    lines, names = c_lines(g, values, {x: inputs[name] for name, x in graph_leaves(g, values).items()})
    refused = [] if guard is None else [f"if (!({names[guard]})) return 1;"]
    stored = [f"const double s{k} = {names[x]};" for k, x in enumerate(results.values())]  # before anything is overwritten
    stored += [f"{place} = s{k};" for k, place in enumerate(results)]
    return "\n    ".join([f"int {head}\n{{", *lines, *refused, *stored, "return 0;"]) + "\n}\n"


def c_loops(program: LoopedProgram) -> str:
    """The accelerations of a looped program in C."""
    m, body = program.memory, list[str]()
    needed = needed_outside(program.loops)
    for loop in program.loops:
        body += _c_block(Block(loop, program.groups, needed, library=True), loop.lanes, m)
    place = f"(j % 3) * {m.stride} + j / 3"
    n, guard = 3 * m.links, m.a + m.coordinate(3 * m.links)
    lines = [
        "int accelerate(double t, const double *q, const double *v, const double *p, double *a)\n{",
        f"double m[{m.size}] = {{0}};",
        "(void)p;",
        f"for (int j = 0; j < {n}; ++j) {{ m[{place}] = q[j]; m[{3 * m.stride} + {place}] = v[j]; }}",
        f"m[{m.t}] = t;",
        *body,
        f"if (m[{guard}] != {float(program.guards)!r}) return 1;",
        f"for (int j = 0; j < {n}; ++j) a[j] = m[{m.a} + {place}];",
        "return 0;",
    ]
    return C_HEADER + "\n    ".join(lines) + "\n}\n"


def _c_block(block: Block, lanes: int, m: Memory) -> list[str]:
    """A loop over lanes; operands that do not stand side by side are found through tables."""
    tables, numbers = list[str](), block.groups.numbers

    def element(places: list[int]) -> str:
        if len(set(places)) == 1:
            return f"m[{places[0]}]"
        if places == list(range(places[0], places[0] + lanes)):
            return f"m[{places[0]} + k]"
        tables.append(f"static const int places{len(tables)}[] = {{{', '.join(map(str, places))}}};")
        return f"m[places{len(tables) - 1}[k]]"

    def leaf(values: tuple[int, ...]) -> str:
        if values[0] not in numbers:
            return element([m.place[v] for v in values])
        tables.append(f"static const double numbers{len(tables)}[] = {{{', '.join(numbers[v].hex() for v in values)}}};")
        return f"numbers{len(tables) - 1}[k]"

    lines, names = c_lines(block.graph, block.order, {x: leaf(values) for x, values in block.loads.items()})
    sums = {g.results[0]: x for g, x in block.kept if g.operation == "SUM"}
    lines += [f"sum{value} += {names[x]};" for value, x in sums.items()]
    lines += [f"{element(m.stored(g))} = {names[x]};" for g, x in block.kept if g.operation != "SUM"]
    before = [f"double sum{value} = 0.0;" for value in sums]
    after = [f"m[{m.place[value]}] = sum{value};" for value in sums if value in m.place]
    return ["{", *tables, *before, f"for (int k = 0; k < {lanes}; ++k) {{", *("    " + x for x in lines), "}", *after, "}"]
