"""Routines as text of LLVM's intermediate representation: each value a double, or a vector of W doubles, one trajectory a lane.

The text is the same for one lane and for many but for its types. No instruction carries a flag that would allow rounding to change.
Source: LLVM Language Reference Manual.

    void NAME(arrays, numbers, counts, i64 groups)

does `groups` groups of W trajectories each, one after the other. Arrays are C-contiguous doubles with the lane last.

Numbers of W lanes are scattered lane by lane: blocks of W rows are transposed in registers, in log2 W rounds of exchanges.
"""

import struct
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from gauss_bench.compiler.machine.graph import (
    Array,
    Emitter,
    If,
    Load,
    Loop,
    Routine,
    Scatter,
    Statement,
    Store,
    nest,
)

BINARY = {"add": "fadd", "sub": "fsub", "mul": "fmul", "div": "fdiv"}
INTEGER = {"and": "and", "plus": "add", "shl": "shl"}
COMPARISON = {"lt": "olt", "le": "ole"}
COUNTS = {"sum": "add i64", "below": "icmp slt i64", "same": "icmp eq i64", "also": "and i1"}
LONGEST_BLOCK = 4000  # values
CALLS = {"fma": ("fma", 3), "abs": ("fabs", 1), "sqrt": ("sqrt", 1)}
BLOCK = 8  # rows and lanes of the largest transposition


def hexadecimal(x: float) -> str:
    """Return a double in LLVM's hexadecimal form, which loses no digit."""
    return f"0x{struct.unpack('<Q', struct.pack('<d', x))[0]:016X}"


@dataclass(frozen=True, eq=False)
class Listing:
    """Code for native_code.py.

    Attributes:
        text: of a module. name, signature: of its function.
        operations: in one turn of the loop or in one evaluation.
        packed: name of the function that takes the address of all these arguments, 8 bytes each; empty where there is none.
    """

    text: str
    name: str
    signature: str
    operations: int
    packed: str = ""


def listing(routine: Routine, lanes: int) -> Listing:
    """The module of a routine for so many trajectories at once."""
    text, packed = Writer(routine, lanes).text(), ""
    if lanes == 1:
        packed = f"{routine.name}_packed"
        text += "\n" + _pack(packed, routine.name, routine.signature)
    return Listing(text, routine.name, routine.signature, routine.operations, packed)


def _pack(name: str, called: str, signature: str) -> str:
    """A function whose only argument is the address of the arguments of another: a single one costs a host language the least."""
    kinds = [{"p": "ptr", "d": "double", "i": "i64"}[kind] for kind in signature]
    lines = [f"define void @{name}(ptr %block) {{"]
    for k, kind in enumerate(kinds):
        lines += [f"  %a{k} = getelementptr i64, ptr %block, i64 {k}", f"  %x{k} = load {kind}, ptr %a{k}"]
    given = ", ".join(f"{kind} %x{k}" for k, kind in enumerate(kinds))
    return "\n".join([*lines, f"  call void @{called}({given})", "  ret void", "}"])


class Writer(Emitter):
    """Lines of one function.

    Attributes:
        lanes: W. real, integer, mask: types of values.
        block: label of the basic block that is being written.
    """

    def __init__(self, routine: Routine, lanes: int):
        super().__init__(routine)
        self.routine, self.lanes = routine, lanes
        self.lines: list[str] = []
        self.block, self._count, self._labels, self._values = "entry", 0, 0, 0
        self.real, self.integer, self.mask = (t if lanes == 1 else f"<{lanes} x {t}>" for t in ("double", "i64", "i1"))
        self.suffix = "f64" if lanes == 1 else f"v{lanes}f64"

    def text(self) -> str:
        r = self.routine
        given = [f"ptr noalias %{x}" for x in r.arrays] + [f"double %{x}.0" for x in r.numbers] + [f"i64 %{x}" for x in r.counts]
        self.line(f"define void @{r.name}({', '.join([*given, 'i64 %groups'])}) align 64 {{\nentry:")
        for x, (operation, payload) in enumerate(zip(self.graph.operation, self.graph.payload, strict=True)):
            name = str(payload)[1:]
            if operation == "leaf" and name in r.numbers:
                self.names[x] = self.broadcast(f"%{name}.0")
            elif operation == "count" and name in r.counts:
                self.names[x] = f"%{name}"
        sizes = {x: self._size(array) for x, array in r.arrays.items()}
        self._go_to("group")
        header = self._open()
        self.base = {x: self.at(f"%{x}", self.let(f"mul i64 %at, {size}")) for x, size in sizes.items()}
        self.places = [place for s in nest(r.body) if isinstance(s, Scatter) for place in self._places(s)]
        self.statements(r.body)
        self.lines[header] = f"  %at = phi i64 [0, %entry], [%at_next, %{self.block}]"
        self.line("  %at_next = add i64 %at, 1\n  %more = icmp slt i64 %at_next, %groups")
        self.line("  br i1 %more, label %group, label %done\ndone:\n  ret void\n}")
        declared = ["declare i64 @llvm.smin.i64(i64, i64)"]
        for name, count in CALLS.values():
            declared.append(f"declare {self.real} @llvm.{name}.{self.suffix}({', '.join([self.real] * count)})")
        return "\n".join([*declared, *self.lines])

    def _size(self, array: Array) -> str:
        """Elements of an array in one group."""
        return self.let(f"mul i64 %{array.by}, {array.rows}") if array.by else str(array.rows)

    def at(self, base: str, row: int | str) -> str:
        return self.address(base, row, self.real)

    def line(self, text: str) -> None:
        self.lines.append(text)

    def label(self, name: str) -> None:
        """Begin a basic block."""
        self.lines.append(f"{name}:")
        self.block = name

    def fresh(self, name: str) -> str:
        """A label that is not there yet."""
        self._labels += 1
        return f"{name}{self._labels}"

    def _go_to(self, label: str) -> None:
        self.line(f"  br label %{label}")
        self.label(label)

    def _open(self) -> int:
        """A line to be filled in later."""
        self.line("")
        return len(self.lines) - 1

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

    def broadcast(self, scalar: str, kind: str = "double") -> str:
        """A number in every lane."""
        if self.lanes == 1:
            return scalar
        vector = f"<{self.lanes} x {kind}>"
        one = self.let(f"insertelement {vector} poison, {kind} {scalar}, i32 0")
        return self.let(f"shufflevector {vector} {one}, {vector} poison, <{self.lanes} x i32> zeroinitializer")

    def address(self, base: str, row: int | str, kind: str) -> str:
        return self.let(f"getelementptr {kind}, ptr {base}, i64 {row}")

    def select(self, mask: str, a: str, b: str) -> str:
        return self.let(f"select {self.mask} {mask}, {self.real} {a}, {self.real} {b}")

    def value(self, x: int) -> str:
        self._values += 1
        if self._values % LONGEST_BLOCK == 0:  # the time to compile a basic block grows faster than its length
            self._go_to(self.fresh("cut"))
        g = self.graph
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
        if operation in COUNTS:
            return self.let(f"{COUNTS[operation]} {a[0]}, {a[1]}")
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
            case "not":
                return self.let(f"xor {self.mask} {a[0]}, {self.splat('true', 'i1')}")
            case "all":
                return self.splat(str(payload).lower(), "i1")
            case "everywhere":
                return self.broadcast(a[0], "i1")
            case "any":
                return a[0] if self.lanes == 1 else self._any(a[0])
            case "nowhere":
                return self.let(f"xor i1 {a[0] if self.lanes == 1 else self._any(a[0])}, true")
            case "number":
                return self.broadcast(self.let(f"sitofp i64 {a[0]} to double"))
            case "whole":
                return str(payload)
            case "times":
                return self.let(f"mul i64 {a[0]}, {payload}")
            case "least":
                return self.let(f"call i64 @llvm.smin.i64(i64 {a[0]}, i64 {a[1]})")
        raise ValueError(f"no text for {operation} {payload}")

    def _any(self, mask: str) -> str:
        bits = self.let(f"bitcast {self.mask} {mask} to i{self.lanes}")
        return self.let(f"icmp ne i{self.lanes} {bits}, 0")

    def statement(self, s: Statement) -> None:
        match s:
            case Load():
                base = self._from(s.array, s.start)
                rows = {x: self.at(base, row) for x, row in self.rows(s).items()}
                self.names |= {x: self.let(f"load {self.real}, ptr {place}, align 8") for x, place in rows.items()}
            case Store():
                values, base = self.compute(s.values), self._from(s.array, s.start)
                for row, x in enumerate(values):
                    self.line(f"  store {self.real} {x}, ptr {self.at(base, row)}, align 8")
            case Scatter():
                self._scatter(s)
            case Loop():
                self._loop(s)
            case If():
                self._if(s)

    def _from(self, array: str, start: int | None) -> str:
        """The address where an array begins, or a row of it."""
        return self.base[array] if start is None else self.at(self.base[array], self.need(start))

    def _kind(self, x: int) -> str:
        return {"leaf": self.real, "mask": self.mask, "count": "i64"}[self.graph.operation[x]]

    def _loop(self, s: Loop) -> None:
        carried, label, first, above = self.carried(s), self.fresh("loop"), self.first, self.block
        self._go_to(label)
        header, inside = self._open(), {x: f"%{label}_{k}" for k, x in enumerate(carried)}
        self.names |= inside
        self.statements(s.body)
        again, last, on = self.need(s.again), self.fresh("end"), label
        if s.after:
            on = self.fresh("on")
            self.line(f"  br i1 {again}, label %{on}, label %{last}")
            before = dict(self.names)
            self.label(on)
            self.statements(s.after)
            following, below = self.compute([b for _, b in carried.values()]), self.block
            self.line(f"  br label %{label}")
            self.names = before
        else:
            following, below = self.compute([b for _, b in carried.values()]), self.block
            self.line(f"  br i1 {again}, label %{label}, label %{last}")
        self.label(last)
        self.lines[header] = "\n".join(
            f"  {inside[x]} = phi {self._kind(x)} [{a}, %{above}], [{b}, %{below}]"
            for x, a, b in zip(carried, first, following, strict=True)
        )

    def _if(self, s: If) -> None:
        condition, old = self.need(s.condition), self.compute([b for _, b in s.merged.values()])
        above, then, join = self.block, self.fresh("then"), self.fresh("join")
        self.line(f"  br i1 {condition}, label %{then}, label %{join}")
        with self.within():
            self.label(then)
            self.statements(s.body)
            new, below = self.compute([a for a, _ in s.merged.values()]), self.block
        self._go_to(join)
        for k, (x, a, b) in enumerate(zip(s.merged, new, old, strict=True)):
            self.names[x] = f"%{join}_{k}"
            self.line(f"  %{join}_{k} = phi {self._kind(x)} [{a}, %{below}], [{b}, %{above}]")

    def _places(self, s: Scatter) -> Iterator[str]:
        """The addresses where each trajectory's numbers begin."""
        first, block, last = self.let(f"mul i64 %at, {self.lanes}"), self.need(s.block), self.need(s.last)
        for lane in range(self.lanes):
            begin = self.let(f"mul i64 {self.let(f'add i64 {first}, {lane}')}, {block}")
            yield self.address(self.base[s.array], self.let(f"call i64 @llvm.smin.i64(i64 {begin}, i64 {last})"), "double")

    def _scatter(self, s: Scatter) -> None:
        """One row of numbers for each trajectory, of which there are more than lanes in a block."""
        row, start = self.compute(s.values), self.need(s.start)
        for low in range(0, self.lanes, BLOCK):
            size = min(BLOCK, self.lanes - low)
            kind = "double" if size == 1 else f"<{size} x double>"
            places = [self.address(place, start, "double") for place in self.places[low : low + size]]
            part = row if size == self.lanes else [self.let(_shuffle(self.real, x, x, range(low, low + size))) for x in row]
            for k in sorted({*range(0, len(row) - size, size), len(row) - size}):  # the last block may overlap the one before
                for place, x in zip(places, self._transpose(part[k : k + size]), strict=True):
                    self.line(f"  store {kind} {x}, ptr {self.address(place, k, 'double')}, align 8")

    def _transpose(self, rows: list[str]) -> list[str]:
        """Vectors of as many lanes as there are rows, exchanged so that lane l of row k becomes lane k of row l."""
        size, distance = len(rows), 1
        while distance < size:
            low = [k if not k & distance else size + k - distance for k in range(size)]
            high = [k + distance if not k & distance else size + k for k in range(size)]
            new = list(rows)
            for k in (k for k in range(size) if not k & distance):
                pair, kind = (rows[k], rows[k + distance]), f"<{size} x double>"
                new[k], new[k + distance] = (self.let(_shuffle(kind, *pair, which)) for which in (low, high))
            rows, distance = new, 2 * distance
        return rows


def _shuffle(kind: str, a: str, b: str, lanes: Sequence[int]) -> str:
    picked = ", ".join(f"i32 {k}" for k in lanes)
    return f"shufflevector {kind} {a}, {kind} {b}, <{len(lanes)} x i32> <{picked}>"
