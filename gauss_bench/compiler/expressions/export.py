"""Nodes as CasADi functions, and what such a function costs."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

from gauss_bench.compiler.expressions.node import LATENCY, STEP, Node

Inputs = Sequence[tuple[str, str, int]]  # name in the function, name in the graph, length
Outputs = Sequence[tuple[str, Sequence[Node]]]


@dataclass(frozen=True)
class Costs:
    """Operations (a sine or cosine counts as one), divisions among them, and cycles from the inputs to the last output."""

    operations: int
    divisions: int
    critical: float

    @property
    def single(self) -> float:
        """Cycles of one evaluation for one trajectory, about: its longest chain, and a quarter of a cycle for every operation."""
        return self.critical + 0.25 * self.operations + 3.0 * self.divisions

    @property
    def batch(self) -> float:
        """Cycles of one evaluation for one vector of trajectories, where no chain is waited for: two operations a cycle."""
        return 0.5 * self.operations + 9.0 * self.divisions


def reachable(outputs: Iterable[Node]) -> list[Node]:
    """All nodes the outputs need, operands before what uses them."""
    found: dict[int, Node] = {}
    left = list(outputs)
    while left:
        node = left.pop()
        if node.index not in found:
            found[node.index] = node
            left += [a for a in node.args if isinstance(a, Node)]
    return [found[k] for k in sorted(found)]


def uses(outputs: Iterable[Node]) -> dict[int, int]:
    """How often each node is an operand or an output."""
    outputs = list(outputs)
    count: dict[int, int] = {}
    for node in [*outputs, *(a for x in reachable(outputs) for a in x.args if isinstance(a, Node))]:
        count[node.index] = count.get(node.index, 0) + 1
    return count


def costs_of(outputs: Sequence[Node]) -> Costs:
    """Costs of the outputs before they are a function: as of one, a reciprocal with one use being no operation of its own."""
    nodes, count = reachable(outputs), uses(outputs)
    ops: dict[int, tuple[str, tuple[int, ...]]] = {}
    ready: dict[int, float] = {}
    merged = 0
    for x in nodes:
        args = tuple(a.index for a in x.args if isinstance(a, Node))
        if x.op == "MUL" and any(ops[k][0] == "INV" and count[k] == 1 for k in args):
            merged += 1
            ready[x.index] = max(ready[y] for k in args for y in (ops[k][1] if ops[k][0] == "INV" else (k,))) + LATENCY["DIV"]
            ops[x.index] = ("DIV", args)
        else:
            ops[x.index] = (x.op, args)
            ready[x.index] = _ready(x.op, args, ops, ready, count)
    operations = sum(x.op not in ("INPUT", "CONST") for x in nodes) - merged
    divisions = sum(x.op == "INV" for x in nodes)
    return Costs(operations, divisions, max((ready[x.index] for x in outputs), default=0.0))


class Exporter:
    """Turns nodes into functions; one exporter per program, so that all of them use the same form of each expression.

    `shared` counts the uses in all functions whose code will be merged: a reciprocal with one use becomes a division.
    """

    def __init__(self, shared: dict[int, int]):
        self.shared = shared

    def function(self, name: str, inputs: Inputs, outputs: Outputs) -> Any:
        import casadi as ca

        simplify = ca.GlobalOptions.getSimplificationOnTheFly()
        ca.GlobalOptions.setSimplificationOnTheFly(False)  # it would turn a (1/p), with 1/p at hand, back into a division
        try:
            return self._function(ca, name, inputs, outputs)
        finally:
            ca.GlobalOptions.setSimplificationOnTheFly(simplify)

    def _function(self, ca: Any, name: str, inputs: Inputs, outputs: Outputs) -> Any:
        symbols = [ca.SX.sym(own, size) for own, _, size in inputs]
        places = {graph: symbol for (_, graph, _), symbol in zip(inputs, symbols, strict=True)}
        made: dict[int, Any] = {}
        for node in reachable(x for _, nodes in outputs for x in nodes):
            made[node.index] = self._expression(ca, node, made, places)
        results = [ca.vertcat(*(made[x.index] for x in nodes)) if nodes else ca.SX(0, 1) for _, nodes in outputs]
        return ca.Function(name, symbols, results, [own for own, _, _ in inputs], [own for own, _ in outputs])

    def _expression(self, ca: Any, node: Node, made: dict[int, Any], places: dict[str, Any]) -> Any:
        if node.op == "CONST":
            return ca.SX(node.number)
        if node.op == "INPUT":
            return places[node.args[0]][node.args[1]]
        a = [made[x.index] for x in node.args]
        match node.op:
            case "ADD":
                return a[0] + a[1]
            case "SUB":
                return a[0] - a[1]
            case "MUL":
                return self._product(node, a, made)
            case "NEG":
                return self._negative(node, a, made)
            case "INV":
                return 1 / a[0]
            case "SQRT" | "SIN" | "COS":
                return getattr(ca, node.op.lower())(a[0])
            case "FMIN" | "FMAX":
                return getattr(ca, node.op.lower())(a[0], a[1])
            case "LE":
                return a[0] <= a[1]
        raise NotImplementedError(node.op)

    def _product(self, node: Node, a: list[Any], made: dict[int, Any]) -> Any:
        for k in (0, 1):
            x = node.args[k]
            if x.op == "INV" and self.shared.get(x.index, 1) == 1:
                return a[1 - k] / made[x.args[0].index]
        return a[0] * a[1]

    def _negative(self, node: Node, a: list[Any], made: dict[int, Any]) -> Any:
        x = node.args[0]
        if x.op == "SUB" and self.shared.get(x.index, 1) == 1:
            return made[x.args[1].index] - made[x.args[0].index]
        return -a[0]


def function_costs(function: Any) -> Costs:
    """Costs of a CasADi function as its instructions stand; a product with one use is fused with the sum that uses it."""
    import casadi as ca

    names = {getattr(ca, x): x[3:] for x in dir(ca) if x.startswith("OP_")}
    slots: dict[int, int] = {}
    ops: list[tuple[str, tuple[int, ...]]] = []
    used: dict[int, int] = {}
    ends: list[int] = []
    for k in range(function.n_instructions()):
        op, given, taken = names[function.instruction_id(k)], function.instruction_input(k), function.instruction_output(k)
        args = () if op in ("INPUT", "CONST") else tuple(slots[x] for x in given)
        for x in args:
            used[x] = used.get(x, 0) + 1
        if op == "OUTPUT":
            ends.append(args[0])
        else:
            slots[taken[0]] = len(ops)
            ops.append((op, args))
    ready: dict[int, float] = {}
    for k, (op, args) in enumerate(ops):
        ready[k] = _ready(op, args, ops, ready, used)
    operations = sum(op not in ("INPUT", "CONST") for op, _ in ops)
    divisions = sum(op in ("DIV", "INV") for op, _ in ops)
    return Costs(operations, divisions, max((ready[k] for k in ends), default=0.0))


def _ready(op: str, args: tuple[int, ...], ops: Any, ready: dict[int, float], used: dict[int, int]) -> float:
    """When a result is ready, given when its operands are."""
    latest = max((ready[x] for x in args), default=0.0)
    if op in ("ADD", "SUB"):
        for x, other in (args, args[::-1]):
            if ops[x][0] in ("MUL", "SQ", "TWICE") and used[x] == 1:
                latest = min(latest, max(ready[other], *(ready[y] for y in ops[x][1])))
    return latest + LATENCY.get(op, STEP)
