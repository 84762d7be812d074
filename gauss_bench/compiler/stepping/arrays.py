"""The same steps without a compiler: arrays of numpy for many trajectories, CasADi's virtual machine for one.

Both read the graph of a step in the variant that takes every sine from the target's own functions; the guards, the projection and
the order of the operations are those of the native code, so that results agree to rounding.
"""

from collections.abc import Callable, Mapping, Sequence
from itertools import pairwise
from typing import Any

import numpy as np

from gauss_bench.compiler.elimination.function import Function
from gauss_bench.compiler.machine.graph import Graph, inline
from gauss_bench.compiler.machine.schedule import live
from gauss_bench.compiler.stepping.runners import Batch, Outcome
from gauss_bench.compiler.stepping.steps import REACHES, STEPS, Code, Step
from gauss_bench.terms import Array

CHUNK = 4096  # trajectories at a time: they share what a call of numpy costs, and a step has hundreds
FOLDED = 256  # steps in one call of CasADi's machine
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


def plain_step(code: Code, integrator: str) -> Step:
    """The step without reach, its sines left to the target."""
    return STEPS[integrator](code, REACHES[integrator][-1], library=True)


class NumpyRunner:
    """Steps by generated source on arrays."""

    def __init__(self, code: Code, integrator: str):
        self.code, self.n = code, code.program.n
        step = plain_step(code, integrator)
        always = step.graph.make("le", step.graph.const(0.0), step.graph.const(1.0))
        masks = [always if m is None else m for m in (step.regular, step.regular_out, step.within)]
        names = {f"%{a}{i}": f"{a}[{i}]" for a in "qv" for i in range(self.n)} | {"%t": "t", "%h": "h"}
        names |= {f"%p{i}": f"p[{i}]" for i in range(code.program.n_parameters)}
        order = [f"%{a}{i}" for a in "qv" for i in range(self.n)]
        roots = [*(step.carried[k] for k in order), *step.out, *masks]
        self.evaluate = function(step.graph, roots, ("q", "v", "t", "h", "p"), names)

    def run(self, batch: Batch, threads: int = 1) -> Outcome:
        count = len(batch.states)
        parts = [self._part(batch, slice(k, k + CHUNK)) for k in range(0, count, CHUNK)]
        return Outcome(*(np.concatenate([getattr(p, f) for p in parts]) for f in ("states", "samples", "done", "complete", "far")))

    def _part(self, batch: Batch, rows: slice) -> Outcome:
        y, p = np.ascontiguousarray(batch.states[rows].T), np.ascontiguousarray(batch.parameters[rows].T)
        count, size, n = y.shape[1], 2 * self.n, batch.n
        samples = np.full((batch.slots, size, count), np.nan)
        alive, complete, far = np.ones(count, bool), np.zeros(count, bool), np.zeros(count, bool)
        done = np.zeros(count, int)
        due, slot = min(batch.every, n), 0
        with np.errstate(all="ignore"):
            for i in range(n + 1):
                found = self.evaluate(y[: self.n], y[self.n :], batch.t0 + i * batch.h, batch.h, p)
                regular, regular_out, within = (np.broadcast_to(m, count) for m in found[-3:])
                if i == due:
                    samples[slot] = [np.broadcast_to(x, count) for x in found[size:-3]]
                    due, slot = min(due + batch.every, n), slot + 1
                if i == n:
                    complete = alive & regular_out
                    y = np.where(complete, samples[-1], y)
                far |= alive & regular & ~within
                alive = alive & regular & within
                if i == n or not alive.any():
                    break
                y = np.where(alive, np.array([np.broadcast_to(x, count) for x in found[:size]]), y)
                done += alive
        return Outcome(y.T.copy(), np.ascontiguousarray(samples.transpose(2, 0, 1)), done, complete, far & ~complete)
