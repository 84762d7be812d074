"""Routines (`routine.py`) as text of LLVM's intermediate representation.

A value is a double, or a vector of W doubles with one trajectory in each lane. Apart from the data types, the LLVM text of a
routine is the same for one lane and for many. No instruction carries a flag that would allow rounding to change. A routine becomes
the function

    void NAME(arrays, numbers, counts, i64 groups)

which computes `groups` groups of W trajectories each, one after the other. Arrays are C-contiguous doubles with the lane last.

`Scatter` stores the numbers of each lane at a place of its own: blocks of W rows are transposed in registers, in log2 W rounds of
exchanges, and each lane's block is then stored by one instruction.
Source: LLVM Language Reference Manual.
"""

import struct
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from gauss_bench.compiler.machine.routine import Emitter, If, Load, Loop, Routine, Scatter, Statement, Store, flatten

# Operation -> its instruction: {0}, {1} ... are operands, {number} is the payload, {numbers} the payload in every lane.
INSTRUCTIONS = {
    "add": "fadd {real} {0}, {1}",
    "sub": "fsub {real} {0}, {1}",
    "mul": "fmul {real} {0}, {1}",
    "div": "fdiv {real} {0}, {1}",
    "neg": "fneg {real} {0}",
    "fma": "call {real} @llvm.fma.{suffix}({real} {0}, {real} {1}, {real} {2})",
    "abs": "call {real} @llvm.fabs.{suffix}({real} {0})",
    "sqrt": "call {real} @llvm.sqrt.{suffix}({real} {0})",
    "select": "select {mask} {0}, {real} {1}, {real} {2}",
    "bits": "bitcast {real} {0} to {integer}",
    "real": "bitcast {integer} {0} to {real}",
    "and": "and {integer} {0}, {numbers}",
    "plus": "add {integer} {0}, {numbers}",
    "shl": "shl {integer} {0}, {numbers}",
    "xor": "xor {integer} {0}, {1}",
    "nonzero": "icmp ne {integer} {0}, {zeros}",
    "lt": "fcmp olt {real} {0}, {1}",
    "le": "fcmp ole {real} {0}, {1}",
    "both": "and {mask} {0}, {1}",
    "not": "xor {mask} {0}, {trues}",
    "sum": "add i64 {0}, {1}",
    "times": "mul i64 {0}, {number}",
    "least": "call i64 @llvm.smin.i64(i64 {0}, i64 {1})",
    "below": "icmp slt i64 {0}, {1}",
    "same": "icmp eq i64 {0}, {1}",
    "also": "and i1 {0}, {1}",
}
INTRINSICS = {"fma": 3, "fabs": 1, "sqrt": 1}  # name in LLVM -> number of operands
TYPES = {"p": "ptr", "d": "double", "i": "i64"}  # types of arguments, by the letters of a routine's signature
LONGEST_BLOCK = 4000  # largest number of values in a basic block: the time to compile a block grows faster than its length
BLOCK = 8  # number of rows and of lanes of the largest transposition


@dataclass(frozen=True, eq=False)
class Listing:
    """The text of an LLVM module with one function, which `native_code.py` compiles.

    Attributes:
        packed: name of a second function, which takes the address of all arguments, 8 bytes each; empty if there is none.
    """

    text: str
    name: str
    signature: str
    operations: int
    packed: str = ""


def write_listing(routine: Routine, lanes: int) -> Listing:
    """Write the module of a routine that computes `lanes` trajectories at once; with one lane it also has NAME_packed."""
    text, packed = Writer(routine, lanes).text(), ""
    if lanes == 1:
        # it takes the address of a block of arguments, because ctypes converts a single argument faster than many
        packed = f"{routine.name}_packed"
        lines, arguments = [f"define void @{packed}(ptr %block) {{"], []
        for k, letter in enumerate(routine.signature):
            lines += [f"  %a{k} = getelementptr i64, ptr %block, i64 {k}", f"  %x{k} = load {TYPES[letter]}, ptr %a{k}"]
            arguments.append(f"{TYPES[letter]} %x{k}")
        lines += [f"  call void @{routine.name}({', '.join(arguments)})", "  ret void", "}"]
        text = "\n".join([text, *lines])
    return Listing(text, routine.name, routine.signature, routine.operations, packed)


class Writer(Emitter):
    """Writes the lines of one function of LLVM.

    Attributes:
        lanes: number W of trajectories in a vector.
        places: addresses at which `Scatter` stores the numbers of each lane.
        block: label of the basic block that is being written.
        base: name of an array -> address of the part of the array that belongs to the group of trajectories being computed.
    """

    def __init__(self, routine: Routine, lanes: int):
        """Prepare to write a routine for groups of `lanes` trajectories."""
        super().__init__(routine)
        self.routine, self.lanes = routine, lanes
        self.lines: list[str] = []
        self.block, self._results, self._labels, self._values = "entry", 0, 0, 0  # the numbers count results, labels and values
        self.real, integer, self.mask = (t if lanes == 1 else f"<{lanes} x {t}>" for t in ("double", "i64", "i1"))
        self.suffix = "f64" if lanes == 1 else f"v{lanes}f64"
        # texts that replace the names in braces of INSTRUCTIONS
        self._words = {"real": self.real, "integer": integer, "mask": self.mask, "suffix": self.suffix}
        self._words |= {"zeros": self.splat("0", "i64"), "trues": self.splat("true", "i1")}

    def text(self) -> str:
        """Return the whole module: declarations, and the function with its loop over groups of W trajectories."""
        r = self.routine
        arguments = [f"ptr noalias %{x}" for x in r.arrays]
        arguments += [f"double %{x}.0" for x in r.numbers] + [f"i64 %{x}" for x in (*r.counts, "groups")]
        self.write_line(f"define void @{r.name}({', '.join(arguments)}) align 64 {{\nentry:")
        for x, (operation, payload) in enumerate(zip(self.graph.operation, self.graph.payload, strict=True)):
            name = str(payload)[1:]  # the payload of a leaf is "%name"
            if operation == "leaf" and name in r.numbers:
                self.names[x] = self.broadcast(f"%{name}.0")  # %name.0 is the scalar argument
            elif operation == "count" and name in r.counts:
                self.names[x] = f"%{name}"
        # number of rows of each array in one group; a row is a vector of W doubles
        sizes = {x: self.let(f"mul i64 %{a.by}, {a.rows}") if a.by else str(a.rows) for x, a in r.arrays.items()}
        self._go_to("group")
        header = self._reserve_line()  # for %at, the number of the group, which depends on the last block below
        # addresses of the group's part of each array, and of the places at which `Scatter` stores
        self.base = {x: self.at(f"%{x}", self.let(f"mul i64 %at, {size}")) for x, size in sizes.items()}
        self.places = [place for s in flatten(r.body) if isinstance(s, Scatter) for place in self._lane_addresses(s)]
        self.write_statements(r.body)
        self.lines[header] = f"  %at = phi i64 [0, %entry], [%at_next, %{self.block}]"
        self.write_line("  %at_next = add i64 %at, 1\n  %more = icmp slt i64 %at_next, %groups")
        self.write_line("  br i1 %more, label %group, label %done\ndone:\n  ret void\n}")
        declarations = ["declare i64 @llvm.smin.i64(i64, i64)"]
        for name, count in INTRINSICS.items():
            declarations.append(f"declare {self.real} @llvm.{name}.{self.suffix}({', '.join([self.real] * count)})")
        return "\n".join([*declarations, *self.lines])

    def write_line(self, text: str) -> None:
        """Write one line."""
        self.lines.append(text)

    def label(self, name: str) -> None:
        """Begin a basic block."""
        self.write_line(f"{name}:")
        self.block = name

    def _new_label(self, name: str) -> str:
        """Return a label that begins with `name` and is not in use yet."""
        self._labels += 1
        return f"{name}{self._labels}"

    def _go_to(self, label: str) -> None:
        """End the basic block with a jump to a new one, which begins here."""
        self.write_line(f"  br label %{label}")
        self.label(label)

    def _reserve_line(self) -> int:
        """Reserve an empty line for the phi instructions of a basic block, and return its index."""
        self.write_line("")
        return len(self.lines) - 1

    def let(self, text: str) -> str:
        """Write an instruction; return the name of its result."""
        self._results += 1
        self.write_line(f"  %r{self._results} = {text}")
        return f"%r{self._results}"

    def splat(self, constant: str, kind: str) -> str:
        """Return the text of a vector with the same constant in every lane, or of the constant alone if there is one lane."""
        return constant if self.lanes == 1 else "<" + ", ".join([f"{kind} {constant}"] * self.lanes) + ">"

    def broadcast(self, scalar: str, kind: str = "double") -> str:
        """Return the name of a vector with the same scalar in every lane; with one lane, the scalar's own name."""
        if self.lanes == 1:
            return scalar
        vector = f"<{self.lanes} x {kind}>"
        lane_0 = self.let(f"insertelement {vector} poison, {kind} {scalar}, i32 0")
        return self.let(f"shufflevector {vector} {lane_0}, {vector} poison, <{self.lanes} x i32> zeroinitializer")

    def address(self, base: str, row: int | str, kind: str) -> str:
        """Return the address of element number `row` of an array of LLVM's type `kind` that begins at `base`."""
        return self.let(f"getelementptr {kind}, ptr {base}, i64 {row}")

    def at(self, base: str, row: int | str) -> str:
        """Return the address of a row of an array; a row is one vector of W doubles."""
        return self.address(base, row, self.real)

    def write_value(self, x: int) -> str:
        """Write the instruction that computes node x of the graph, whose operands have names already; return the result's name."""
        self._values += 1
        if self._values % LONGEST_BLOCK == 0:  # a long block is divided
            self._go_to(self._new_label("cut"))
        operation, payload = self.graph.operation[x], self.graph.payload[x]
        operands = [self.names[k] for k in self.graph.operands[x]]
        match operation:
            case "const":  # hexadecimal digits lose nothing
                return self.splat(f"0x{struct.pack('>d', payload).hex().upper()}", "double")
            case "all":  # the constant mask that is True, or False, in all lanes
                return self.splat(str(payload).lower(), "i1")
            case "whole":  # a constant integer
                return str(payload)
            case "everywhere":  # a boolean of the whole group, as a mask
                return self.broadcast(operands[0], "i1")
            case "number":  # an integer as a real number
                return self.broadcast(self.let(f"sitofp i64 {operands[0]} to double"))
            case "any":
                return self._any(operands[0])
            case "nowhere":
                return self.let(f"xor i1 {self._any(operands[0])}, true")
        # any other operation is one instruction
        numbers = self.splat(str(payload), "i64")
        return self.let(INSTRUCTIONS[operation].format(*operands, number=payload, numbers=numbers, **self._words))

    def _any(self, mask: str) -> str:
        """Write a test of a mask; return the name of its result (i1), which is true if the mask is true in at least one lane."""
        if self.lanes == 1:
            return mask
        bits = self.let(f"bitcast {self.mask} {mask} to i{self.lanes}")
        return self.let(f"icmp ne i{self.lanes} {bits}, 0")

    def write_statement(self, s: Statement) -> None:
        """Write one statement of the routine; `Compute` statements are written by the base class."""
        match s:
            case Load():
                base = self._row_address(s.array, s.start)
                rows = {x: self.at(base, row) for x, row in self.select_rows(s).items()}
                self.names |= {x: self.let(f"load {self.real}, ptr {place}, align 8") for x, place in rows.items()}
            case Store():
                values, base = self.compute(s.values), self._row_address(s.array, s.start)
                for row, x in enumerate(values):
                    self.write_line(f"  store {self.real} {x}, ptr {self.at(base, row)}, align 8")
            case Scatter():
                self._scatter(s)
            case Loop():
                self._loop(s)
            case If():
                self._if(s)

    def _row_address(self, array: str, start: int | None) -> str:
        """Return the address of row `start` (None: 0) of an array, in the part of the group of trajectories being computed."""
        return self.base[array] if start is None else self.at(self.base[array], self.need(start))

    def _type_of(self, leaf: int) -> str:
        """Return LLVM's type of a leaf."""
        return {"leaf": self.real, "mask": self.mask, "count": "i64"}[self.graph.operation[leaf]]

    def _loop(self, s: Loop) -> None:
        """Write a loop.

        A phi instruction at the head of the loop selects the first value when the loop is entered, and the next value when it is
        repeated. The phi instructions are written last, when the names of both values are known.
        """
        carried, label = self.select_carried(s), self._new_label("loop")
        # names of the first values, which the base class has written, and the block before the loop; loops inside change both
        first, above = self.first, self.block
        self._go_to(label)
        header, inside = self._reserve_line(), {x: f"%{label}_{k}" for k, x in enumerate(carried)}
        self.names |= inside
        self.write_statements(s.body)
        again, last = self.need(s.again), self._new_label("end")
        following, below = self.compute([b for _, b in carried.values()]), self.block
        self.write_line(f"  br i1 {again}, label %{label}, label %{last}")
        self.label(last)
        self.lines[header] = "\n".join(
            f"  {inside[x]} = phi {self._type_of(x)} [{a}, %{above}], [{b}, %{below}]"
            for x, a, b in zip(carried, first, following, strict=True)
        )

    def _if(self, s: If) -> None:
        """Write a branch; phi instructions after it select the value of each variable in `s.merged`."""
        condition, old = self.need(s.condition), self.compute([b for _, b in s.merged.values()])
        above, then, join = self.block, self._new_label("then"), self._new_label("join")
        self.write_line(f"  br i1 {condition}, label %{then}, label %{join}")
        with self.within():
            self.label(then)
            self.write_statements(s.body)
            new, below = self.compute([a for a, _ in s.merged.values()]), self.block
        self._go_to(join)
        for k, (x, a, b) in enumerate(zip(s.merged, new, old, strict=True)):
            self.names[x] = f"%{join}_{k}"
            self.write_line(f"  %{join}_{k} = phi {self._type_of(x)} [{a}, %{below}], [{b}, %{above}]")

    def _lane_addresses(self, s: Scatter) -> Iterator[str]:
        """Yield for every lane the address at which a `Scatter` stores the numbers of its trajectory, without `start`."""
        first, block, last = self.let(f"mul i64 %at, {self.lanes}"), self.need(s.block), self.need(s.last)
        for lane in range(self.lanes):
            begin = self.let(f"mul i64 {self.let(f'add i64 {first}, {lane}')}, {block}")
            yield self.address(self.base[s.array], self.let(f"call i64 @llvm.smin.i64(i64 {begin}, i64 {last})"), "double")

    def _scatter(self, s: Scatter) -> None:
        """Store all values of each lane in consecutive places, beginning at the lane's own address.

        There must be at least as many values as lanes. A vector holds one value for each lane. Blocks of `size` vectors of `size`
        lanes are transposed; each vector then has `size` values of a single lane, which one instruction stores.
        """
        vectors, start = self.compute(s.values), self.need(s.start)
        for low in range(0, self.lanes, BLOCK):  # lanes low to low + size - 1
            size = min(BLOCK, self.lanes - low)
            kind = "double" if size == 1 else f"<{size} x double>"
            places = [self.address(place, start, "double") for place in self.places[low : low + size]]
            of_lanes = vectors
            if size < self.lanes:
                of_lanes = [self.let(_shuffle(self.real, x, x, range(low, low + size))) for x in vectors]
            last = len(vectors) - size
            for k in sorted({*range(0, last, size), last}):  # the last block may overlap the one before
                for place, x in zip(places, self._transpose(of_lanes[k : k + size]), strict=True):
                    self.write_line(f"  store {kind} {x}, ptr {self.address(place, k, 'double')}, align 8")

    def _transpose(self, rows: list[str]) -> list[str]:
        """Transpose W vectors of W lanes: lane l of row k becomes lane k of row l.

        In rounds d = 1, 2, 4, ..., each row k in whose binary index the bit with the value d is 0 is paired with row k + d. The two
        rows exchange lanes: row k gives the lanes whose index has the bit d set, and row k + d gives the other lanes.
        """
        size, distance = len(rows), 1
        while distance < size:
            # lanes that the two rows of a pair take; the lanes of the second row are numbered from `size` on
            low = [size + k - distance if k & distance else k for k in range(size)]
            high = [size + k if k & distance else k + distance for k in range(size)]
            kind, new = f"<{size} x double>", list(rows)
            for k in range(size):
                if not k & distance:
                    a, b = rows[k], rows[k + distance]
                    new[k], new[k + distance] = self.let(_shuffle(kind, a, b, low)), self.let(_shuffle(kind, a, b, high))
            rows, distance = new, 2 * distance
        return rows


def _shuffle(kind: str, a: str, b: str, lanes: Sequence[int]) -> str:
    """Return the instruction that picks lanes of two vectors; the lanes of b are numbered after those of a."""
    picked = ", ".join(f"i32 {k}" for k in lanes)
    return f"shufflevector {kind} {a}, {kind} {b}, <{len(lanes)} x i32> <{picked}>"
