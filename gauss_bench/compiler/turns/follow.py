"""Native loop over the samples of whole turns: each lane follows a part of a turn, or a linkage of its own.

    void follow(ptr x, ptr signs, ptr inputs, ptr p, ptr out, ptr where, ptr report, double tolerance, i64 samples, i64 shift,
                i64 groups)

Arrays are C-contiguous, the lane last; U unknowns, K inputs, G guards, R numbers stored at each sample:

    x        (groups, U, W)                 guess at the first sample; afterwards the last closed sample
    signs    (groups, G, W)                 that the guards must keep; 0 for any
    inputs   (groups, samples + 1, 3 K, W)  values, rates, second rates; the next group's begin `shift` further on, 0 if shared
    p        (groups, n_p, W)               open parameters
    where    (groups, W)                    integers: where in `out` a lane's samples begin
    out      a lane's samples, one after the other: R numbers each
    report   (groups, 1 + G, W)             samples closed before the first that could not be, guards at the last of them

A sample is closed where |A|^2 <= tolerance sum |R|^2 after at most LIMIT corrections, none of which left the reach of the rotation;
the guess was not far from the sample before; and every guard keeps its sign and is not too small. A lane that fails keeps its last
closed state; what it goes on to store is void.

Numbers of W lanes are stored lane by lane: blocks of W rows are transposed in registers, in log2 W rounds of exchanges.

Newton starts at the guess, whose sines come from nothing, so that no rounding is carried from sample to sample. A correction
moves x by z and rotates its sines, which is exact while z is short.

Leaves: %x0, %s0, %c0 ... iterate and sines of its angles, %X0 ... guess, %l0 ... the sample before, %u0, %w0, %b0 ... inputs with
their rates and second rates, %n0 ... the inputs at the next sample, %p0 ... open parameters.

Without a compiler generated source on arrays does the same. Nobody here decides what follows where a lane stops: tracker.py does.
"""

import threading
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from gauss_bench.compiler.elimination.loop_program import ClosureProgram
from gauss_bench.compiler.machine import native_code, trigonometry
from gauss_bench.compiler.machine.graph import Graph, Pair, constant_values, count_operations, inline, leaves, live, order, rewrite
from gauss_bench.compiler.machine.llvm import Listing, Writer
from gauss_bench.compiler.machine.native_code import NativeCode, address, in_lanes, out_of_lanes, shared
from gauss_bench.compiler.machine.source import function
from gauss_bench.terms import Array

REACH = 0.0065  # [rad, lengths] norm of one correction: two terms of the rotation are exact so far, and no other assembly is near
LARGEST = trigonometry.LARGEST  # [rad]
TURN = 0.3  # [rad, lengths] norm of the way to the guess: far less than lies between two assemblies

Outputs = Literal["states", "path"]


@dataclass(frozen=True, eq=False)
class ClosingCode:
    """A program in machine arithmetic.

    Attributes:
        start: sines and cosines of the guess's angles, by unknown.
        score: sum of squares of A; square: of the lengths of the vectors in it.
        moved: by leaf of the iterate ("%x0", "%s0", "%c0" ...), its value after a correction.
        near: mask, the correction is short enough for that.
        turn: mask, the guess is not far from the sample before; regular: mask, no guard is too small.
        guards: by guard, its value.
        guess: by unknown, at the next sample.
        outputs: the row to be stored.
    """

    graph: Graph
    start: dict[int, Pair]
    score: int
    square: int
    moved: dict[str, int]
    near: int
    turn: int
    regular: int
    guards: list[int]
    guess: list[int]
    outputs: list[int]

    def roots(self) -> list[int]:
        """Everything that must be computed."""
        pairs = [x for pair in self.start.values() for x in pair]
        masks = [self.near, self.turn, self.regular]
        return [*pairs, self.score, self.square, *self.moved.values(), *masks, *self.guards, *self.guess, *self.outputs]

    def replaced(self, graph: Graph, roots: list[int]) -> "ClosingCode":
        """The same code in another graph, for its roots there."""
        new = iter(roots)
        start = {k: (next(new), next(new)) for k in self.start}
        score, square, moved = next(new), next(new), {name: next(new) for name in self.moved}
        near, turn, regular = next(new), next(new), next(new)
        guards, guess = [next(new) for _ in self.guards], [next(new) for _ in self.guess]
        return ClosingCode(graph, start, score, square, moved, near, turn, regular, guards, guess, list(new))


def written(program: ClosureProgram, outputs: Outputs, library: bool = False) -> ClosingCode:
    """A program as code that stores states, or the unknowns x alone ("path"); with `library`, sines are left to the target."""
    g = Graph()

    def sincos(x: int) -> Pair:
        return (g.make("sin", x), g.make("cos", x)) if library else trigonometry.sincos(g, x)

    turning = [k for k, angle in enumerate(program.angles) if angle]
    x, guess, last = ([g.leaf(f"%{letter}{k}") for k in range(program.unknowns)] for letter in "xXl")
    u, w, second, following = ([g.leaf(f"%{letter}{j}") for j in range(program.inputs)] for letter in "uwbn")
    p = [g.leaf(f"%p{i}") for i in range(program.parameters)]
    pairs = {x[k]: (g.leaf(f"%s{k}"), g.leaf(f"%c{k}")) for k in turning}
    pairs |= {u[j]: sincos(u[j]) for j, angle in enumerate(program.known_angles) if angle}
    way = [g.sub(b, a) for a, b in zip(u, following, strict=True)]
    function = program.states if outputs == "states" else program.path
    results = inline(g, function, (x, u, w, second, way, p), pairs.__getitem__)
    residual, (square,), z, guards, limits, advance, stored = results
    moved = {f"%x{k}": g.add(x[k], z[k]) for k in range(program.unknowns)}
    for k in turning:
        pair = sincos(moved[f"%x{k}"]) if library else trigonometry.rotated(g, pairs[x[k]], z[k], REACH)
        moved |= {f"%s{k}": pair[0], f"%c{k}": pair[1]}
    scale = [g.const(1.0 / length) for length in program.lengths]
    jump = [g.mul(c, g.sub(a, b)) for c, a, b in zip(scale, guess, last, strict=True)]
    return ClosingCode(
        g,
        {k: sincos(guess[k]) for k in turning},
        g.squares(residual),
        square,
        moved,
        _within(g, [g.mul(c, a) for c, a in zip(scale, z, strict=True)], REACH),
        _within(g, jump, TURN),
        _regular(g, list(zip(guards, limits, strict=True))),
        guards,
        [g.add(a, b) for a, b in zip(x, advance, strict=True)],
        stored or list(x),
    )


def _regular(g: Graph, guards: list[Pair]) -> int:
    """Mask where the square of every guard is at least what it must be."""
    mask = g.both([g.make("le", least, g.mul(x, x)) for x, least in guards])
    return g.make("le", g.const(0.0), g.const(1.0)) if mask is None else mask


def _within(g: Graph, values: list[int], bound: float) -> int:
    """Mask where the norm of some values is at most a bound."""
    return g.make("le", g.squares(values), g.const(bound * bound))


LIMIT = 8  # corrections; quadratic convergence needs four from the farthest guess that is taken
ARRAYS = ("x", "signs", "inputs", "p", "out", "where", "report")
BLOCK = 8  # rows and lanes of the largest transposition


def follow(program: ClosureProgram, outputs: Outputs, lanes: int) -> Listing:
    """The module that follows `lanes` lanes at a time."""
    code = written(program, outputs)
    code = code.replaced(*rewrite(code.graph, code.roots()))
    loop = _FollowWriter(program, code, lanes)
    operations = count_operations(code.graph, live(code.graph, code.roots()))
    return Listing("\n".join((loop.w.declarations(), loop.text(), _over_groups(program, lanes))), operations)


@dataclass(frozen=True, eq=False)
class _Blocks:
    """Values by where they are computed, each block in the order in which it is written.

    Attributes:
        fixed: before the loop. first: once for a sample, before its iteration.
        iterated: with every iterate; all that both a correction and a closed sample need is among it.
        corrected, closed: after an iterate that is not closed, or is.
    """

    fixed: list[int]
    first: list[int]
    iterated: list[int]
    corrected: list[int]
    closed: list[int]


def _blocks(code: ClosingCode) -> _Blocks:
    g, values = code.graph, live(code.graph, code.roots())
    iterate = {f"%{letter}{k}" for k in range(len(code.guess)) for letter in "xsc"}
    varying = _depending(g, iterate)
    fixed = set(constant_values(g, values, {name: name for name in leaves(g, values) if name.startswith("%p")}))
    score = set(live(g, [code.score, code.square]))
    corrected = set(live(g, [*code.moved.values(), code.near]))
    closed = set(live(g, [code.turn, code.regular, *code.guards, *code.guess, *code.outputs]))
    early = score | corrected | set(live(g, [x for pair in code.start.values() for x in pair]))
    iterated = (score | (corrected & closed)) & varying
    written = order(g, values, {name: x for name, x in code.moved.items() if name in iterate})

    def chosen(which: set[int]) -> list[int]:
        return [x for x in written if x in which]

    return _Blocks(
        chosen(fixed),
        chosen(early - varying - fixed),
        chosen(iterated),
        chosen((corrected & varying) - iterated),
        chosen(closed - early - fixed | (closed & varying) - iterated),
    )


def _depending(g: Graph, names: set[str]) -> set[int]:
    """Values that depend on leaves of these names."""
    dependent: set[int] = set()
    for x in range(len(g.operation)):
        if str(g.payload[x]) in names if g.operation[x] == "leaf" else any(k in dependent for k in g.operands[x]):
            dependent.add(x)
    return dependent


class _FollowWriter:
    """Writes the function that follows one group."""

    def __init__(self, program: ClosureProgram, code: ClosingCode, lanes: int):
        self.program, self.code, self.w = program, code, Writer(lanes)
        self.leaves = leaves(code.graph, live(code.graph, code.roots()))
        self.blocks = _blocks(code)
        self.unknowns, self.guards = range(program.unknowns), range(len(code.guards))

    def text(self) -> str:
        w = self.w
        arguments = ", ".join(f"ptr noalias %{name}" for name in ARRAYS)
        w.line(f"define internal void @group({arguments}, double %tolerance, i64 %samples) {{\nentry:")
        first = self._entry()
        w.line("  br label %loop\nloop:")
        header = len(w.lines)
        w.line("")
        self._load_inputs()
        w.write(self.code.graph, self.blocks.first)
        w.line("  br label %newton")
        closed = self._newton()
        following = self._closed(closed)
        w.lines[header] = "\n".join(
            f"  {name} = phi {kind} [{first[name][1]}, %entry], [{following[name]}, %closed]" for name, (kind, _) in first.items()
        )
        self._finish(following)
        return "\n".join(w.lines)

    def _entry(self) -> dict[str, tuple[str, str]]:
        """Load what does not change; type and first value of everything carried."""
        w = self.w
        w.names = {x: name for name, x in self.leaves.items()}
        start = [w.load("%x", k) for k in self.unknowns]
        self.signs = [w.load("%signs", k) for k in self.guards]
        w.names |= {x: w.load("%p", int(name[2:])) for name, x in self.leaves.items() if name.startswith("%p")}
        w.write(self.code.graph, self.blocks.fixed)
        self.tolerance = w.broadcast("%tolerance")
        places = [w.let(f"load i64, ptr {w.address('%where', lane, 'i64')}") for lane in range(w.lanes)]
        self.places = [w.address("%out", place, "double") for place in places]
        carried = {f"%{letter}{k}": (w.real, start[k]) for letter in "Xl" for k in self.unknowns}
        carried |= {f"%guard{k}": (w.real, w.const(0.0)) for k in self.guards}
        return carried | {"%alive": (w.mask, w.splat("true", "i1")), "%done": (w.real, w.const(0.0)), "%i": ("i64", "0")}

    def _load_inputs(self) -> None:
        w, K = self.w, self.program.inputs
        base = w.address("%inputs", w.let(f"mul i64 %i, {3 * K * w.lanes}"), "double")
        rows = {f"%{letter}{j}": k * K + j for k, letter in enumerate("uwbn") for j in range(K)}
        w.names |= {x: w.load(base, rows[name]) for name, x in self.leaves.items() if name in rows}

    def _newton(self) -> str:
        """Correct until every lane that goes on is closed; the mask of those that are."""
        w, code = self.w, self.code
        start = {f"%{letter}{k}": w.names[x] for k, pair in code.start.items() for letter, x in zip("sc", pair, strict=True)}
        start |= {f"%x{k}": f"%X{k}" for k in self.unknowns}
        w.line("newton:")
        header = len(w.lines)
        w.line("")
        w.write(code.graph, self.blocks.iterated)
        enough = w.let(f"fmul {w.real} {w.names[code.square]}, {self.tolerance}")
        closed = w.let(f"fcmp ole {w.real} {w.names[code.score]}, {enough}")
        going = w.let(f"and {w.mask} %alive, %near")
        open_lanes = w.let(f"and {w.mask} {going}, {w.let(f'xor {w.mask} {closed}, ' + w.splat('true', 'i1'))}")
        w.line(f"  %few = icmp ult i64 %j, {LIMIT}\n  %again = and i1 {w.any(open_lanes)}, %few")
        w.line("  br i1 %again, label %correct, label %closed\ncorrect:")
        known = dict(w.names)
        w.write(code.graph, self.blocks.corrected)
        near = w.let(f"and {w.mask} %near, {w.names[code.near]}")
        w.line("  %j_next = add i64 %j, 1\n  br label %newton\nclosed:")
        phis = [f"  {k} = phi {w.real} [{x}, %loop], [{w.names[code.moved[k]]}, %correct]" for k, x in start.items()]
        phis += [f"  %near = phi {w.mask} [{w.splat('true', 'i1')}, %loop], [{near}, %correct]"]
        w.lines[header] = "\n".join([*phis, "  %j = phi i64 [0, %loop], [%j_next, %correct]"])
        w.names = known
        return w.let(f"and {w.mask} {going}, {closed}")

    def _closed(self, closed: str) -> Mapping[str, str]:
        """Store the sample and go on; the next value of everything carried."""
        w, code = self.w, self.code
        w.write(code.graph, self.blocks.closed)
        good = w.let(f"and {w.mask} {closed}, {w.names[code.turn]}")
        good = w.let(f"and {w.mask} {good}, {w.names[code.regular]}")
        for guard, sign in zip(code.guards, self.signs, strict=True):
            side = w.let(f"fmul {w.real} {w.names[guard]}, {sign}")
            good = w.let(f"and {w.mask} {good}, {w.let(f'fcmp oge {w.real} {side}, ' + w.const(0.0))}")
        self._store([w.names[x] for x in code.outputs])
        following = {f"%X{k}": w.names[x] for k, x in enumerate(code.guess)}
        following |= {f"%l{k}": w.select(good, f"%x{k}", f"%l{k}") for k in self.unknowns}
        following |= {f"%guard{k}": w.select(good, w.names[x], f"%guard{k}") for k, x in enumerate(code.guards)}
        done = w.let(f"fadd {w.real} %done, {w.select(good, w.const(1.0), w.const(0.0))}")
        w.line("  %i_next = add i64 %i, 1\n  %more = icmp ult i64 %i_next, %samples")
        w.line(f"  %go = and i1 {w.any(good)}, %more\n  br i1 %go, label %loop, label %finish")
        return following | {"%alive": good, "%done": done, "%i": "%i_next"}

    def _store(self, row: list[str]) -> None:
        """One row of numbers for each lane."""
        w = self.w
        shift = w.let(f"mul i64 %i, {len(row)}")
        places = [w.address(place, shift, "double") for place in self.places]
        if w.lanes == 1:
            for k, x in enumerate(row):
                w.store(x, places[0], k)
            return
        for block in range(0, w.lanes, BLOCK):
            size = min(BLOCK, w.lanes - block)
            part = [self._lanes(x, block, size) for x in row]
            starts = range(0, len(row) - size + 1, size) if len(row) >= size else []
            for k in [*starts, *([len(row) - size] if starts and len(row) % size else [])]:
                for lane, x in enumerate(self._transposed(part[k : k + size])):
                    at = w.address(places[block + lane], k, "double")
                    w.line(f"  store <{size} x double> {x}, ptr {at}, align 8")
            if not starts:
                self._store_singly(part, places[block : block + size])

    def _lanes(self, x: str, first: int, size: int) -> str:
        """A part of the lanes of a value."""
        w = self.w
        return x if size == w.lanes else w.let(_shuffle(w.real, x, x, range(first, first + size)))

    def _transposed(self, rows: list[str]) -> list[str]:
        """Vectors of as many lanes as there are rows, exchanged so that lane l of row k becomes lane k of row l."""
        w, size = self.w, len(rows)
        distance = 1
        while distance < size:
            low = [k if not k & distance else size + k - distance for k in range(size)]
            high = [k + distance if not k & distance else size + k for k in range(size)]
            new = list(rows)
            for k in (k for k in range(size) if not k & distance):
                pair, kind = (rows[k], rows[k + distance]), f"<{size} x double>"
                new[k], new[k + distance] = (w.let(_shuffle(kind, *pair, which)) for which in (low, high))
            rows, distance = new, 2 * distance
        return rows

    def _store_singly(self, row: list[str], places: list[str]) -> None:
        """Fewer numbers than lanes."""
        w = self.w
        for lane, place in enumerate(places):
            for k, x in enumerate(row):
                one = w.let(f"extractelement <{len(places)} x double> {x}, i32 {lane}")
                w.line(f"  store double {one}, ptr {w.address(place, k, 'double')}, align 8")

    def _finish(self, following: Mapping[str, str]) -> None:
        w = self.w
        w.line("finish:")
        for k in self.unknowns:
            w.store(following[f"%l{k}"], "%x", k)
        w.store(following["%done"], "%report", 0)
        for k in self.guards:
            w.store(following[f"%guard{k}"], "%report", 1 + k)
        w.line("  ret void\n}")


def _shuffle(kind: str, a: str, b: str, lanes: "range | list[int]") -> str:
    picked = ", ".join(f"i32 {k}" for k in lanes)
    return f"shufflevector {kind} {a}, {kind} {b}, <{len(lanes)} x i32> <{picked}>"


def _over_groups(program: ClosureProgram, lanes: int) -> str:
    """The exported function: one group after the other."""
    guards, n_p = program.guards, program.parameters
    strides = {
        "x": program.unknowns * lanes, "signs": guards * lanes, "inputs": "%shift", "p": n_p * lanes,
        "where": lanes, "report": (1 + guards) * lanes,
    }  # fmt: skip
    moves = "".join(
        f"  %{name}_at = mul i64 %k, {stride}\n  %{name}_k = getelementptr double, ptr %{name}, i64 %{name}_at\n"
        for name, stride in strides.items()
    )
    given = ", ".join(f"ptr %{name}_k" if name in strides else f"ptr %{name}" for name in ARRAYS)
    arguments = ", ".join(f"ptr noalias %{name}" for name in ARRAYS)
    return f"""define void @follow({arguments}, double %tolerance, i64 %samples, i64 %shift, i64 %groups) {{
entry:
  br label %loop
loop:
  %k = phi i64 [0, %entry], [%next, %loop]
{moves}  call void @group({given}, double %tolerance, i64 %samples)
  %next = add i64 %k, 1
  %more = icmp slt i64 %next, %groups
  br i1 %more, label %loop, label %done
done:
  ret void
}}"""


Counts = NDArray[np.integer[Any]]


@dataclass(frozen=True, eq=False)
class Course:
    """What lanes are to follow.

    Attributes:
        x: (lanes, U) guess at each lane's first sample.
        signs: (lanes, G) that the guards must keep; 0 for any.
        inputs: (lanes or 1, samples + 1, 3 K) values, rates, second rates; of the row after the last only the values count.
        parameters: (lanes, n_p).
        where: (lanes,) row of each lane's first sample in `rows`.
        rows: (any, R) where samples are stored.
        tolerance: |A|^2 of a closed sample, of the squared lengths of the vectors in it.
    """

    x: Array
    signs: Array
    inputs: Array
    parameters: Array
    where: Counts
    rows: Array
    tolerance: float

    @property
    def samples(self) -> int:
        return int(self.inputs.shape[1]) - 1


@dataclass(frozen=True, eq=False)
class Followed:
    """What became of the lanes: samples closed before the first that was not, x (lanes, U) and guards (lanes, G) at the last."""

    closed: Counts
    x: Array
    guards: Array


class Follower(Protocol):
    """Follows lanes."""

    def run(self, course: Course, threads: int = 1) -> Followed: ...


class NativeFollower:
    """Machine code, `lanes` lanes at a time."""

    def __init__(self, program: ClosureProgram, outputs: Outputs, lanes: int, cached: bool):
        self.program, self.outputs, self.lanes, self.cached = program, outputs, lanes, cached
        self._loaded: NativeCode | None = None
        self._lock = threading.Lock()

    @property
    def native(self) -> NativeCode:
        with self._lock:
            if self._loaded is None:
                listing = follow(self.program, self.outputs, self.lanes)
                self._loaded = native_code.compile_text(listing.text, "follow", listing.operations, self.cached)
            return self._loaded

    def run(self, course: Course, threads: int = 1) -> Followed:
        lanes, count = self.lanes, len(course.x)
        x = in_lanes(course.x.copy(), lanes)  # is written to; one lane would be a view
        signs, p = (in_lanes(a, lanes) for a in (course.signs, course.parameters))
        where = in_lanes(np.asarray(course.where, dtype=np.int64)[:, None] * course.rows.shape[1], lanes)
        inputs, shift = _input_lanes(course.inputs, lanes)
        report = np.empty((len(x), 1 + self.program.guards, lanes))
        call, rows, samples = self.native.call, address(course.rows), course.samples

        def part(low: int, high: int) -> None:
            given = address(inputs) + 8 * shift * low
            arrays = [address(a[low:high]) for a in (x, signs, p, where, report)]
            call(*arrays[:2], given, arrays[2], rows, *arrays[3:], course.tolerance, samples, shift, high - low)

        shared(part, len(x), threads)
        found = out_of_lanes(report, count)
        last = out_of_lanes(x, count) if x.size else course.x  # an open chain has no unknowns
        return Followed(found[:, 0].astype(int), last, found[:, 1:])


def _input_lanes(inputs: Array, lanes: int) -> tuple[Array, int]:
    """(lanes or 1, rows, columns) as (groups, rows, columns, lanes), and the numbers between groups: 0 where one serves all."""
    count, rows, columns = inputs.shape
    if count == 1:
        return np.repeat(inputs[0][:, :, None], lanes, axis=2), 0
    missing = -count % lanes
    full = np.concatenate([inputs, np.repeat(inputs[-1:], missing, axis=0)]) if missing else inputs
    return np.ascontiguousarray(full.reshape(-1, lanes, rows, columns).transpose(0, 2, 3, 1)), rows * columns * lanes


class ArrayFollower:
    """Generated source on arrays, all lanes side by side."""

    def __init__(self, program: ClosureProgram, outputs: Outputs):
        self.program, self.lanes = program, 0
        code = written(program, outputs, library=True)
        names = {f"%{letter}{k}": f"{letter}[{k}]" for letter in "xXlsc" for k in range(program.unknowns)}
        names |= {f"%{letter}{j}": f"{letter}[{j}]" for letter in "uwbn" for j in range(program.inputs)}
        names |= {f"%p{i}": f"p[{i}]" for i in range(program.parameters)}
        turning = list(code.start)
        known = ("u", "p")
        self.turning = turning
        self._start = function(code.graph, [x for k in turning for x in code.start[k]], ("X",), names)
        self._score = function(code.graph, [code.score, code.square], ("x", "s", "c", *known), names)
        moved = [code.moved[f"%x{k}"] for k in range(program.unknowns)]
        moved += [code.moved[f"%{letter}{k}"] for letter in "sc" for k in turning]
        self._moved = function(code.graph, [*moved, code.near], ("x", "s", "c", *known), names)
        self._checks = function(code.graph, [code.turn, code.regular, *code.guards], ("x", "s", "c", "X", "l", *known), names)
        self._closed = function(code.graph, [*code.guess, *code.outputs], ("x", "s", "c", "w", "b", "n", *known), names)

    def run(self, course: Course, threads: int = 1) -> Followed:
        """Follow; `threads` make no difference."""
        lanes, U, K = len(course.x), self.program.unknowns, self.program.inputs
        inputs = np.broadcast_to(course.inputs, (lanes, *course.inputs.shape[1:])).transpose(1, 2, 0)
        guess, last, p = course.x.T.copy(), course.x.T.copy(), course.parameters.T
        guards, closed = np.zeros((self.program.guards, lanes)), np.zeros(lanes, int)
        alive = np.ones(lanes, bool)
        with np.errstate(all="ignore"):
            for i in range(course.samples):
                u, w, b = (inputs[i, k * K : (k + 1) * K] for k in range(3))
                x, s, c, good = self._newton(guess, u, p, course.tolerance, alive)
                turn, regular, *values = self._checks(x, s, c, guess, last, u, p)
                at = _stacked(values, lanes)
                alive = alive & good & turn & regular & (course.signs.T * at >= 0.0).all(axis=0)
                rows = _stacked(self._closed(x, s, c, w, b, inputs[i + 1, :K], u, p), lanes)
                course.rows[course.where[alive] + i] = rows[U:].T[alive]
                last, guards, guess = np.where(alive, x, last), np.where(alive, at, guards), rows[:U]
                closed += alive
                if not alive.any():
                    break
        return Followed(closed, last.T.copy(), guards.T.copy())

    def _newton(self, guess: Array, u: Array, p: Array, tolerance: float, alive: Any) -> tuple[Array, Array, Array, Any]:
        """Iterate and sines, and which lanes are closed."""
        lanes, U = guess.shape[1], len(guess)
        x, s, c = guess, np.zeros_like(guess), np.zeros_like(guess)
        pairs = _stacked(self._start(guess), lanes)
        s[self.turning], c[self.turning] = pairs[::2], pairs[1::2]
        near = np.ones(lanes, bool)
        for _ in range(LIMIT + 1):
            score, square = self._score(x, s, c, u, p)
            closed = np.broadcast_to(score <= tolerance * square, lanes)
            if not (alive & near & ~closed).any():
                break
            *new, short = self._moved(x, s, c, u, p)
            moved, near = _stacked(new, lanes), near & short
            x, half = moved[:U], U + len(self.turning)
            s, c = s.copy(), c.copy()
            s[self.turning], c[self.turning] = moved[U:half], moved[half:]
        return x, s, c, near & closed


def _stacked(values: list[Any], lanes: int) -> Array:
    """Numbers and arrays of lanes as rows."""
    return np.array([np.broadcast_to(x, lanes) for x in values]).reshape(len(values), lanes)
