"""A CasADi function read back as a tape in static single assignment: one value per instruction, each written once.

CasADi's virtual machine reuses its work slots; renaming every write turns the slots into values, and after that no order but the
data's own is left in the tape.
"""

from dataclasses import dataclass
from functools import cache
from typing import Any

ARITHMETIC = frozenset(
    (
        "ADD",
        "SUB",
        "MUL",
        "DIV",
        "NEG",
        "SQ",
        "TWICE",
        "INV",
        "SQRT",
        "SIN",
        "COS",
        "FABS",
        "FMIN",
        "FMAX",
        "LT",
        "LE",
        "IF_ELSE_ZERO",
    )
)
DIVISIONS = frozenset(("DIV", "INV"))


class UnknownOperation(ValueError):
    """A function holds an operation that the emitters do not know."""


@dataclass(frozen=True)
class Instruction:
    """One value of a tape.

    Attributes:
        operation: of ARITHMETIC, or INPUT or CONST.
        operands: numbers of earlier values; of an INPUT its argument and component.
        value: of a CONST.
    """

    operation: str
    operands: tuple[int, ...] = ()
    value: float = 0.0


@dataclass(frozen=True, eq=False)
class Tape:
    """The instructions, in an order in which they can be done.

    Attributes:
        sizes: components of each argument.
        outputs: the value of every component of every result, or None where it is structurally zero.
    """

    name: str
    sizes: tuple[int, ...]
    instructions: tuple[Instruction, ...]
    outputs: tuple[tuple[int | None, ...], ...]

    @property
    def operations(self) -> int:
        return sum(i.operation in ARITHMETIC for i in self.instructions)

    @property
    def divisions(self) -> int:
        return sum(i.operation in DIVISIONS for i in self.instructions)

    def turned(self, argument: int) -> set[int]:
        """Components of an argument whose sine or cosine is taken as it stands: the angles."""
        sources = [self.instructions[i.operands[0]] for i in self.instructions if i.operation in ("SIN", "COS")]
        return {s.operands[1] for s in sources if s.operation == "INPUT" and s.operands[0] == argument}


@cache
def _names() -> dict[int, str]:
    import casadi as ca

    return {getattr(ca, name): name[3:] for name in dir(ca) if name.startswith("OP_")}


def read(function: Any) -> Tape:
    """The tape of an expanded (SX) CasADi function of dense column vectors.

    Raises:
        UnknownOperation: naming the operation.
    """
    instructions: list[Instruction] = []
    slots: dict[int, int] = {}
    outputs = [dict[int, int]() for _ in range(function.n_out())]
    for k in range(function.n_instructions()):
        operation = _names()[function.instruction_id(k)]
        source, target = function.instruction_input(k), function.instruction_output(k)
        if operation == "OUTPUT":
            outputs[target[0]][target[1]] = slots[source[0]]
            continue
        instructions.append(_instruction(function, k, operation, source, slots))
        slots[target[0]] = len(instructions) - 1
    sizes = tuple(int(function.numel_in(k)) for k in range(function.n_in()))
    return Tape(function.name(), sizes, tuple(instructions), tuple(_dense(function, k, x) for k, x in enumerate(outputs)))


def _instruction(function: Any, k: int, operation: str, source: list[int], slots: dict[int, int]) -> Instruction:
    if operation == "INPUT":
        return Instruction("INPUT", (source[0], source[1]))
    if operation == "CONST":
        return Instruction("CONST", (), float(function.instruction_constant(k)))
    if operation not in ARITHMETIC:
        raise UnknownOperation(f"{function.name()} uses {operation}, which no emitter knows")
    return Instruction(operation, tuple(slots[s] for s in source))


def _dense(function: Any, k: int, found: dict[int, int]) -> tuple[int | None, ...]:
    """An output with its structural zeros put back; CasADi counts the others only."""
    rows = function.sparsity_out(k).row()
    components: list[int | None] = [None] * int(function.numel_out(k))
    for position, value in found.items():
        components[rows[position]] = value
    return tuple(components)
