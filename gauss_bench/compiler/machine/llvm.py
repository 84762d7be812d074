"""Text of LLVM's intermediate representation: each value a double, or a vector of W doubles with one trajectory in each lane.

The text is the same for one lane and for many but for its types. No instruction carries a flag that would allow rounding to change.
Source: LLVM Language Reference Manual.
"""

import struct
from collections.abc import Iterable

from gauss_bench.compiler.machine.graph import Graph

BINARY = {"add": "fadd", "sub": "fsub", "mul": "fmul", "div": "fdiv"}
INTEGER = {"and": "and", "plus": "add", "shl": "shl"}
COMPARISON = {"lt": "olt", "le": "ole"}
LONGEST_BLOCK = 4000  # values
CALLS = {"fma": ("fma", 3), "abs": ("fabs", 1), "sqrt": ("sqrt", 1)}


def hexadecimal(x: float) -> str:
    """A double as LLVM writes it exactly."""
    return f"0x{struct.unpack('<Q', struct.pack('<d', x))[0]:016X}"


class Writer:
    """Lines of one function, with a fresh name for every value.

    Attributes:
        lanes: W.
        real, integer, mask: types of a value with W lanes.
        names: what a value of the graph is called in the text.
        block: label of the basic block that is being written.
    """

    def __init__(self, lanes: int):
        self.lanes = lanes
        self.real, self.integer, self.mask = (t if lanes == 1 else f"<{lanes} x {t}>" for t in ("double", "i64", "i1"))
        self.suffix = "f64" if lanes == 1 else f"v{lanes}f64"
        self.lines: list[str] = []
        self.names: dict[int, str] = {}
        self.block = "entry"
        self._count = self._cuts = 0

    def line(self, text: str) -> None:
        self.lines.append(text)

    def label(self, name: str) -> None:
        """Begin a basic block."""
        self.lines.append(f"{name}:")
        self.block = name

    def cut(self) -> None:
        """Go on in a new basic block: the time to compile one grows faster than its length."""
        self._cuts += 1
        self.line(f"  br label %cut{self._cuts}")
        self.label(f"cut{self._cuts}")

    def let(self, text: str) -> str:
        """A line whose result gets a name."""
        self._count += 1
        self.lines.append(f"  %r{self._count} = {text}")
        return f"%r{self._count}"

    def splat(self, one: str, kind: str) -> str:
        """A constant in every lane."""
        return one if self.lanes == 1 else "<" + ", ".join([f"{kind} {one}"] * self.lanes) + ">"

    def const(self, x: float) -> str:
        return self.splat(hexadecimal(x), "double")

    def broadcast(self, scalar: str) -> str:
        """A double in every lane."""
        if self.lanes == 1:
            return scalar
        one = self.let(f"insertelement {self.real} poison, double {scalar}, i32 0")
        return self.let(f"shufflevector {self.real} {one}, {self.real} poison, <{self.lanes} x i32> zeroinitializer")

    def address(self, base: str, row: int | str, kind: str | None = None) -> str:
        return self.let(f"getelementptr {kind or self.real}, ptr {base}, i64 {row}")

    def load(self, base: str, row: int) -> str:
        return self.let(f"load {self.real}, ptr {self.address(base, row)}, align 8")

    def store(self, value: str, base: str, row: int) -> None:
        self.line(f"  store {self.real} {value}, ptr {self.address(base, row)}, align 8")

    def select(self, mask: str, a: str, b: str) -> str:
        return self.let(f"select {self.mask} {mask}, {self.real} {a}, {self.real} {b}")

    def everywhere(self, mask: int | None) -> str:
        """The name of a mask of the graph; without one, all lanes."""
        return self.splat("true", "i1") if mask is None else self.names[mask]

    def any(self, mask: str) -> str:
        """Whether a mask holds in some lane."""
        if self.lanes == 1:
            return mask
        bits = self.let(f"bitcast {self.mask} {mask} to i{self.lanes}")
        return self.let(f"icmp ne i{self.lanes} {bits}, 0")

    def write(self, g: Graph, values: Iterable[int]) -> None:
        """Write values in the given order, their operands first where the order has them later; named ones are there already."""
        for count, x in enumerate(values, 1):
            if count % LONGEST_BLOCK == 0:
                self.cut()
            waiting = [x]
            while waiting:
                missing = [k for k in g.operands[waiting[-1]] if k not in self.names]
                if waiting[-1] in self.names or not missing:
                    y = waiting.pop()
                    if y not in self.names:
                        self.names[y] = self._value(g, y)
                else:
                    waiting += missing

    def _value(self, g: Graph, x: int) -> str:
        operation, payload = g.operation[x], g.payload[x]
        a = [self.names[k] for k in g.operands[x]]
        if operation == "const":
            number = g.number(x)
            assert number is not None
            return self.const(number)
        if operation in BINARY:
            return self.let(f"{BINARY[operation]} {self.real} {a[0]}, {a[1]}")
        if operation in CALLS:
            name = CALLS[operation][0]
            return self.let(f"call {self.real} @llvm.{name}.{self.suffix}({', '.join(f'{self.real} {k}' for k in a)})")
        if operation in INTEGER:
            return self.let(f"{INTEGER[operation]} {self.integer} {a[0]}, {self.splat(str(payload), 'i64')}")
        if operation in COMPARISON:
            return self.let(f"fcmp {COMPARISON[operation]} {self.real} {a[0]}, {a[1]}")
        match operation:
            case "neg":
                return self.let(f"fneg {self.real} {a[0]}")
            case "select":
                return self.select(*a)
            case "bits":
                return self.let(f"bitcast {self.real} {a[0]} to {self.integer}")
            case "real":
                return self.let(f"bitcast {self.integer} {a[0]} to {self.real}")
            case "xor":
                return self.let(f"xor {self.integer} {a[0]}, {a[1]}")
            case "nonzero":
                return self.let(f"icmp ne {self.integer} {a[0]}, {self.splat('0', 'i64')}")
            case "both":
                return self.let(f"and {self.mask} {a[0]}, {a[1]}")
        raise ValueError(f"no text for {operation} {payload}")

    def declarations(self) -> str:
        """Of the functions of LLVM itself that the text may call."""
        return "\n".join(
            f"declare {self.real} @llvm.{name}.{self.suffix}({', '.join([self.real] * count)})" for name, count in CALLS.values()
        )
