"""Graphs of machine arithmetic as source of Python, on floats or on arrays of numpy: the way without a compiler.

Sines are left to the target's own functions.
"""

from collections.abc import Callable, Mapping, Sequence
from itertools import pairwise
from typing import Any

import numpy as np

from gauss_bench.compiler.elimination.function import Function
from gauss_bench.compiler.machine.graph import Graph, inline, live
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
    found: Callable[..., list[Any]] = space["evaluate"]
    return found


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
            found = evaluate(*(x.T for x in arrays))
        shape = arrays[0].shape[:1]
        columns = [np.broadcast_to(x, shape) for x in found]
        cuts = np.cumsum([0, *(len(result) for result in results)]).tolist()
        return [np.array(columns[a:b]).reshape(b - a, *shape).T for a, b in pairwise(cuts)]

    return call
