"""Straight-line functions: the result of an elimination as a list of operations, independent of the target machine.

The operations are in the order in which their nodes were made. A reciprocal that is used once becomes a part of a division, and
the negative of a difference that is used once becomes the opposite difference.
"""

from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import cache
from typing import NamedTuple

import numpy as np

from gauss_bench.compiler.expressions.node import LATENCY, STEP, VALUE, Node
from gauss_bench.terms import Array

Inputs = Sequence[tuple[str, int]]  # for each argument its name in the graph, and its number of components
Outputs = Sequence[Sequence[Node]]

VALUES = VALUE | {"DIV": np.divide}


@dataclass(frozen=True)
class Costs:
    """The costs of one evaluation of a function.

    Attributes:
        operations, divisions: number of operations, and of divisions among them; a sine is one operation.
        critical: time [cycles] from the inputs to the last output, if operations wait for nothing but their operands.
    """

    operations: int
    divisions: int
    critical: float

    @property
    def single(self) -> float:
        """Estimate of the cycles for one trajectory: `critical`, plus 0.25 for every operation and 3 for every division."""
        return self.critical + 0.25 * self.operations + 3.0 * self.divisions


class Instruction(NamedTuple):
    """One operation of a function, which computes a value from earlier ones, or an input or constant of the function.

    Attributes:
        operation: INPUT; CONST; ADD, SUB, MUL, DIV, INV, NEG, SQRT, SIN, COS, FMIN, FMAX; or LE, which gives 1 where the first
            operand is at most the second, else 0.
        operands: indices of the instructions whose results are used; an INPUT has instead the index of the argument, and the index
            of the component in it.
        number: the value of a CONST.
    """

    operation: str
    operands: tuple[int, ...] = ()
    number: float = 0.0


@dataclass(frozen=True, eq=False)
class Function:
    """A function as a list of instructions, each after the instructions whose results it uses.

    Attributes:
        outputs: for each result the indices of the instructions that compute its components.
    """

    sizes: tuple[int, ...]
    instructions: tuple[Instruction, ...]
    outputs: tuple[tuple[int, ...], ...]

    @property
    def operations(self) -> int:
        """Number of instructions that compute something, all but inputs and constants."""
        return sum(x.operation not in ("INPUT", "CONST") for x in self.instructions)

    def angles(self, argument: int) -> set[int]:
        """Return the indices of the components of an argument of which the function computes a sine or cosine."""
        # operands of SIN and COS: index of an instruction; of INPUT: index of the argument, index of the component
        sources = [self.instructions[x.operands[0]] for x in self.instructions if x.operation in ("SIN", "COS")]
        return {s.operands[1] for s in sources if s.operation == "INPUT" and s.operands[0] == argument}

    def __call__(self, *arguments: Array | Sequence[float]) -> list[Array]:
        """Return the results (..., components) for arguments (..., components), evaluated in numpy."""
        arrays = [np.asarray(x, dtype=float) for x in arguments]
        values: list[Array] = []
        with np.errstate(all="ignore"):
            for operation, operands, number in self.instructions:
                if operation == "INPUT":
                    values.append(arrays[operands[0]][..., operands[1]])
                elif operation == "CONST":
                    values.append(np.asarray(number))
                else:
                    values.append(VALUES[operation](*(values[k] for k in operands)))
        shape = np.broadcast_shapes(*(x.shape[:-1] for x in arrays))
        results = []
        for output in self.outputs:
            components = np.array([np.broadcast_to(values[k], shape) for k in output]).reshape(len(output), *shape)
            results.append(np.moveaxis(components, 0, -1))
        return results

    @property
    def costs(self) -> Costs:
        """The costs of an evaluation in which a sum and a product used only there are computed by one fused multiply-add."""
        computed = [x for x in self.instructions if x.operation != "INPUT"]
        used = Counter(k for x in computed for k in x.operands)  # index of an instruction -> number of uses of its result
        ready: list[float] = []  # time [cycles] at which each result is ready, if nothing but its operands delays it
        for x in self.instructions:
            ready.append(0.0 if x.operation == "INPUT" else self._ready(x, ready, used))
        divisions = sum(x.operation in ("DIV", "INV") for x in self.instructions)  # also reciprocals
        return Costs(self.operations, divisions, max((ready[k] for output in self.outputs for k in output), default=0.0))

    def _ready(self, x: Instruction, ready: list[float], used: Counter[int]) -> float:
        """Return the time [cycles] at which the result of x is ready, from the times and numbers of uses of earlier results."""
        operation, operands, _ = x  # the number of a constant does not matter here
        begins = max([ready[k] for k in operands], default=0.0)  # when the last operand is ready
        if operation in ("ADD", "SUB"):
            # a product that is used only here is fused with the sum, which then waits for the product's factors and the other
            # summand; if both summands are such products, the one that lets the sum begin earlier is fused
            for k, other in (operands, operands[::-1]):
                product = self.instructions[k]
                if product.operation == "MUL" and used[k] == 1:
                    begins = min(begins, max(ready[other], *[ready[y] for y in product.operands]))
        return begins + LATENCY.get(operation, STEP)


def _operands(node: Node) -> tuple[Node, ...]:
    """Return the operands of a node; an input has none, because its `args` are a name and an index and not nodes."""
    return () if node.op == "INPUT" else node.args


def reachable(outputs: Iterable[Node]) -> list[Node]:
    """Return the outputs and all nodes that they depend on, operands before their users."""
    known: dict[int, Node] = {}
    waiting = list(outputs)
    while waiting:
        node = waiting.pop()
        if node.index not in known:
            known[node.index] = node
            waiting += _operands(node)
    return [known[k] for k in sorted(known)]  # in the order in which nodes were made


def uses(outputs: Sequence[Node], needed: Iterable[Node] | None = None) -> dict[int, int]:
    """Return index of a node -> number of times that the node is an operand or an output.

    `needed` are all nodes on which the outputs depend, if the caller knows them.
    """
    users = reachable(outputs) if needed is None else needed
    operands = [node for user in users for node in _operands(user)]
    return Counter(node.index for node in (*outputs, *operands))


def costs_of(outputs: Sequence[Node]) -> Costs:
    """Return the costs of a function that computes only the given outputs."""
    needed = reachable(outputs)
    inputs = dict.fromkeys(str(x.args[0]) for x in needed if x.op == "INPUT")
    without_sizes = [(name, 0) for name in inputs]  # numbers of components do not change the costs
    return function(without_sizes, [outputs], uses(outputs, needed)).costs


def _choose_instruction(node: Node, is_used_once: Callable[[Node], bool]) -> tuple[str, tuple[Node, ...]]:
    """Return operation and operands of the instruction that computes a node.

    The product x (1/y) becomes x/y, and -(x - y) becomes y - x, if the node 1/y or x - y has no other use.
    """
    if node.op in ("INPUT", "CONST"):
        return node.op, ()
    if node.op == "MUL":
        for x, other in (node.args, node.args[::-1]):
            if x.op == "INV" and is_used_once(x):
                return "DIV", (other, x.args[0])
    if node.op == "NEG" and node.args[0].op == "SUB" and is_used_once(node.args[0]):
        return "SUB", node.args[0].args[::-1]
    return node.op, node.args


def function(inputs: Inputs, outputs: Outputs, shared: dict[int, int] | None) -> Function:
    """Return a function that evaluates the output nodes of a graph.

    Args:
        shared: index of a node -> number of its uses in all functions whose code will be merged. A node with one use may become a
            part of the operation that uses it, such as a reciprocal that becomes a division. If `shared` is None, every node is
            computed by its own operation.
    """
    results = [x for nodes in outputs for x in nodes]
    own_uses = cache(lambda: uses(results))  # for nodes that are not in `shared`

    def is_used_once(x: Node) -> bool:
        """Tell whether the node that uses x may absorb x: this is its only use, and `shared` is given."""
        if shared is None:
            return False
        counts = shared if x.index in shared else own_uses()
        return counts[x.index] == 1

    chosen: dict[int, tuple[Node, str, tuple[Node, ...]]] = {}  # index of a node -> node, operation, operands
    waiting = list(results)
    while waiting:
        node = waiting.pop()
        if node.index not in chosen:
            operation, operands = _choose_instruction(node, is_used_once)
            chosen[node.index] = node, operation, operands
            waiting += operands
    place = {name: k for k, (name, _) in enumerate(inputs)}  # name of an argument -> its index
    number: dict[int, int] = {}  # index of a node -> index of its instruction
    instructions: list[Instruction] = []
    for index in sorted(chosen):  # nodes are numbered as they are made, so that operands come before their users
        node, operation, operands = chosen[index]
        number[index] = len(instructions)
        if operation == "INPUT":
            instructions.append(Instruction("INPUT", (place[node.args[0]], node.args[1])))
        elif node.number is not None:
            instructions.append(Instruction("CONST", (), node.number))
        else:
            instructions.append(Instruction(operation, tuple(number[x.index] for x in operands)))
    components = tuple(tuple(number[x.index] for x in nodes) for nodes in outputs)
    return Function(tuple(size for _, size in inputs), tuple(instructions), components)
