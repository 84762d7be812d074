"""Text of LLVM's intermediate representation: each value a double, or a vector of W doubles with one trajectory in each lane.

The text is the same for one lane and for many but for its types. No instruction carries a flag that would allow rounding to change.
Source: LLVM Language Reference Manual.

Loops over lanes: several lanes at once for one trajectory, or one lane after the other for several trajectories.

one trajectory      an element is a double, a vector holds neighbouring lanes: elements k, k + 1, ... of an array
    W trajectories      an element is a vector with one double for each trajectory

Operands that stand side by side are loaded as they stand, others through tables of places. The code is as long as there are
different operations; how many lanes they have changes its tables alone.
"""

import struct
from collections.abc import Iterable
from dataclasses import dataclass

from gauss_bench.compiler.machine.graph import Graph
from gauss_bench.compiler.machine.loops import Block, LaneGroup, LaneGroups, Loop, Memory, needed_outside

BINARY = {"add": "fadd", "sub": "fsub", "mul": "fmul", "div": "fdiv"}
INTEGER = {"and": "and", "plus": "add", "shl": "shl"}
COMPARISON = {"lt": "olt", "le": "ole"}
LONGEST_BLOCK = 4000  # values
CALLS = {"fma": ("fma", 3), "abs": ("fabs", 1), "sqrt": ("sqrt", 1)}


def hexadecimal(x: float) -> str:
    """A double as LLVM writes it exactly."""
    return f"0x{struct.unpack('<Q', struct.pack('<d', x))[0]:016X}"


@dataclass(frozen=True, eq=False)
class Listing:
    """Code for native_code.py: the text of a module, and operations in one turn of the loop or in one evaluation."""

    text: str
    operations: int


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


class Text(Writer):
    """Lines of a function in which the width changes from loop to loop, and the tables they refer to.

    Attributes:
        across: lanes of a loop that one vector holds; 1 where a vector holds trajectories.
        element: type of one element of memory.
    """

    def __init__(self, across: int, trajectories: int):
        super().__init__(trajectories)
        self.across, self.trajectories = across, trajectories
        self.element = self.real
        self.tables: dict[str, str] = {}

    def width(self, lanes: int) -> None:
        """From here on, values of so many lanes."""
        fresh = Writer(lanes)
        self.lanes, self.real, self.integer, self.mask = fresh.lanes, fresh.real, fresh.integer, fresh.mask
        self.suffix = fresh.suffix

    def table(self, kind: str, values: list[str]) -> str:
        """Name of a constant array, one for equal contents; its last entry is repeated to fill the last vector."""
        values = values + values[-1:] * (-len(values) % 8)
        text = f"private unnamed_addr constant [{len(values)} x {kind}] [{', '.join(f'{kind} {x}' for x in values)}], align 64"
        return self.tables.setdefault(text, f"@table{len(self.tables)}")

    def table_lines(self) -> list[str]:
        return [f"{name} = {text}" for text, name in self.tables.items()]


@dataclass(frozen=True, eq=False)
class Wide:
    """How one loop is written: its index k, how many lanes are done at once, and an element to waste."""

    text: Text
    k: str
    lanes: int
    at_once: int
    spare: int

    @property
    def vector(self) -> bool:
        """Whether a value holds several lanes."""
        return self.at_once > 1

    def element(self, first: int) -> str:
        """Address of element `first` + k."""
        row = self.k if not first else f"{first}" if self.k == "0" else self.text.let(f"add i64 {self.k}, {first}")
        return self.text.address("%a", row, self.text.element)

    def get(self, address: str) -> str:
        return self.text.let(f"load {self.text.real}, ptr {address}, align 8")

    def rest(self) -> str | None:
        """Mask of the lanes that exist; None where all do."""
        if not self.vector or self.lanes % self.at_once == 0:
            return None
        w = self.text
        numbers = "<" + ", ".join(f"i64 {x}" for x in range(self.at_once)) + ">"
        one = w.let(f"insertelement {w.integer} poison, i64 {self.k}, i32 0")
        every = w.let(f"shufflevector {w.integer} {one}, {w.integer} poison, <{w.lanes} x i32> zeroinitializer")
        return w.let(f"icmp ult {w.integer} {w.let(f'add {w.integer} {every}, {numbers}')}, {w.splat(str(self.lanes), 'i64')}")

    def places(self, places: list[int], spare: int | None = None) -> list[str]:
        """Addresses of this turn's elements; those of lanes that do not exist are `spare`, or the last one's."""
        w = self.text
        missing = -len(places) % self.at_once
        table = w.address(
            w.table("i32", [str(x) for x in places + [places[-1] if spare is None else spare] * missing]), self.k, "i32"
        )
        addresses = []
        for lane in range(self.at_once):
            entry = w.let(f"load i32, ptr {w.address(table, lane, 'i32')}, align 4")
            addresses.append(w.address("%a", w.let(f"sext i32 {entry} to i64"), w.element))
        return addresses

    def load(self, places: list[int]) -> str:
        """The values at places by lane."""
        w = self.text
        if len(set(places)) == 1:
            address = w.address("%a", places[0], w.element)
            return w.broadcast(w.let(f"load double, ptr {address}, align 8")) if self.vector else self.get(address)
        if _side_by_side(places):
            return self.get(self.element(places[0]))
        if not self.vector:
            return self.get(self.places(places)[0])
        vector = "poison"
        for lane, address in enumerate(self.places(places)):
            one = w.let(f"load double, ptr {address}, align 8")
            vector = w.let(f"insertelement {w.real} {vector}, double {one}, i32 {lane}")
        return vector

    def numbers(self, values: list[float]) -> str:
        """Numbers by lane."""
        w = self.text
        address = w.address(w.table("double", [hexadecimal(x) for x in values]), self.k, "double")
        if self.vector:
            return self.get(address)
        return w.broadcast(w.let(f"load double, ptr {address}, align 8"))

    def store(self, value: str, places: list[int], room: bool) -> None:
        """Store by lane; `room` where nothing is lost behind the last."""
        w = self.text
        if not _side_by_side(places):
            self._scatter(value, places)
            return
        mask = None if room else self.rest()
        address = self.element(places[0])
        if mask is None:
            w.line(f"  store {w.real} {value}, ptr {address}, align 8")
        else:
            w.line(f"  call void @llvm.masked.store.{w.suffix}.p0({w.real} {value}, ptr {address}, i32 8, {w.mask} {mask})")

    def _scatter(self, value: str, places: list[int]) -> None:
        w = self.text
        for lane, address in enumerate(self.places(places, self.spare)):
            one = w.let(f"extractelement {w.real} {value}, i32 {lane}") if self.vector else value
            w.line(f"  store {w.element} {one}, ptr {address}, align 8")


def _side_by_side(places: list[int]) -> bool:
    return places == list(range(places[0], places[0] + len(places)))


class LoopWriter:
    """Writes loops one after the other into a function of the pointer %a."""

    def __init__(self, text: Text, groups: LaneGroups, program_loops: list[Loop], memory: Memory):
        self.text, self.groups, self.memory = text, groups, memory
        self.needed = needed_outside(program_loops)
        self.block = "entry"
        self.count = 0

    def write(self, loop: Loop) -> None:
        """One loop; without a branch where one turn does it."""
        w, turns_by = self.text, min(self.text.across, 1 << (loop.lanes - 1).bit_length())
        w.width(turns_by if w.across > 1 else w.trajectories)
        body = _Body(self, loop)
        self.count += 1
        if loop.lanes <= turns_by:
            sums = body.write(Wide(w, "0", loop.lanes, turns_by, self.memory.spare), {})
        else:
            sums = self._turns(body, loop, turns_by)
        for value, total in sums.items():
            self._keep_sum(value, total)

    def _turns(self, body: "_Body", loop: Loop, at_once: int) -> dict[int, str]:
        w, label = self.text, f"loop{self.count}"
        w.line(f"  br label %{label}\n{label}:")
        header = len(w.lines)
        w.line("")
        k, following = f"%k{self.count}", f"%n{self.count}"
        before = {x: f"%s{self.count}_{i}" for i, x in enumerate(body.sums())}
        sums = body.write(Wide(w, k, loop.lanes, at_once, self.memory.spare), before)
        phis = [f"  {k} = phi i64 [0, %{self.block}], [{following}, %{label}]"]
        zero = w.const(0.0)
        phis += [f"  {name} = phi {w.real} [{zero}, %{self.block}], [{sums[x]}, %{label}]" for x, name in before.items()]
        w.lines[header] = "\n".join(phis)
        w.line(f"  {following} = add i64 {k}, {at_once}")
        more = w.let(f"icmp ult i64 {following}, {loop.lanes}")
        self.block = f"after{self.count}"
        w.line(f"  br i1 {more}, label %{label}, label %{self.block}\n{self.block}:")
        return sums

    def _keep_sum(self, value: int, total: str) -> None:
        """Add up the lanes of a vector, and store the sum."""
        w = self.text
        if value not in self.memory.place:
            return
        if w.across > 1 and w.lanes > 1:
            half = w.lanes // 2
            while half:
                picks = ", ".join(f"i32 {x}" for x in [*range(half, 2 * half), *[0] * (w.lanes - half)])
                moved = w.let(f"shufflevector {w.real} {total}, {w.real} poison, <{w.lanes} x i32> <{picks}>")
                total = w.let(f"fadd {w.real} {total}, {moved}")
                half //= 2
            total = w.let(f"extractelement {w.real} {total}, i32 0")
        address = w.address("%a", self.memory.place[value], w.element)
        w.line(f"  store {w.element} {total}, ptr {address}, align 8")


class _Body:
    """One loop as text."""

    def __init__(self, writer: "LoopWriter", loop: Loop):
        self.writer = writer
        self.block = Block(loop, writer.groups, writer.needed)

    def sums(self) -> list[int]:
        return self.block.sums()

    def write(self, wide: Wide, before: dict[int, str]) -> dict[int, str]:
        """The lines of one turn; returns the sums after it, from those `before` it."""
        w = wide.text
        w.names = {x: self._load(wide, values) for x, values in self.block.loads.items()}
        w.write(self.block.graph, self.block.order)
        sums = {}
        for group, x in self.block.kept:
            if group.operation == "SUM":
                sums[group.results[0]] = self._added(wide, w.names[x], before.get(group.results[0]))
            else:
                self._store(wide, group, w.names[x])
        return sums

    def _added(self, wide: Wide, value: str, before: str | None) -> str:
        w, mask = wide.text, wide.rest()
        value = value if mask is None else w.select(mask, value, w.const(0.0))
        return value if before is None else w.let(f"fadd {w.real} {before}, {value}")

    def _load(self, wide: Wide, values: tuple[int, ...]) -> str:
        numbers, place = self.writer.groups.numbers, self.writer.memory.place
        if values[0] in numbers:
            return wide.numbers([numbers[v] for v in values])
        return wide.load([place[v] for v in values])

    def _store(self, wide: Wide, group: LaneGroup, value: str) -> None:
        places = self.writer.memory.stored(group)
        wide.store(value, places, self.writer.memory.room(places))


def declarations(widths: set[int]) -> list[str]:
    """Of the functions of LLVM itself that the text may call."""
    lines = [Writer(1).declarations()]
    for lanes in sorted(widths - {1}):
        w = Writer(lanes)
        lines += [w.declarations(), f"declare void @llvm.masked.store.{w.suffix}.p0({w.real}, ptr, i32, {w.mask})"]
    return lines
