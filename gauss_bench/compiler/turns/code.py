"""A closure's expressions in machine arithmetic: what the loop over samples computes, and the masks by which it decides.

Newton starts at the guess, whose sines come from nothing, so that no rounding is carried from sample to sample. A correction
moves x by z and rotates its sines, which is exact while z is short.

Leaves: %x0, %s0, %c0 ... iterate and sines of its angles, %X0 ... guess, %l0 ... the sample before, %u0, %w0, %b0 ... inputs with
their rates and second rates, %n0 ... the inputs at the next sample, %p0 ... open parameters.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

from gauss_bench.compiler.elimination.loop_program import ClosureProgram
from gauss_bench.compiler.expressions.export import reachable
from gauss_bench.compiler.expressions.node import Node
from gauss_bench.compiler.machine import trigonometry
from gauss_bench.compiler.machine.graph import Graph, Pair

REACH = 0.0065  # [rad, lengths] norm of one correction: two terms of the rotation are exact so far, and no other assembly is near
TURN = 0.3  # [rad, lengths] norm of the way to the guess: far less than lies between two assemblies

Outputs = Literal["states", "path"]


@dataclass(frozen=True, eq=False)
class Code:
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

    def replaced(self, graph: Graph, roots: list[int]) -> "Code":
        """The same code in another graph, for its roots there."""
        new = iter(roots)
        start = {k: (next(new), next(new)) for k in self.start}
        score, square, moved = next(new), next(new), {name: next(new) for name in self.moved}
        near, turn, regular = next(new), next(new), next(new)
        guards, guess = [next(new) for _ in self.guards], [next(new) for _ in self.guess]
        return Code(graph, start, score, square, moved, near, turn, regular, guards, guess, list(new))


def written(program: ClosureProgram, outputs: Outputs, library: bool = False) -> Code:
    """A program as code that stores states, or the unknowns x alone ("path"); with `library`, sines are left to the target."""
    g = Graph()

    def sincos(x: int) -> Pair:
        return (g.make("sin", x), g.make("cos", x)) if library else trigonometry.sincos(g, x)

    turning = [k for k, angle in enumerate(program.angles) if angle]
    x, guess, last = ([g.leaf(f"%{letter}{k}") for k in range(program.unknowns)] for letter in "xXl")
    u, following = ([g.leaf(f"%{letter}{j}") for j in range(program.inputs)] for letter in "un")
    pairs = {("x", k): (g.leaf(f"%s{k}"), g.leaf(f"%c{k}")) for k in turning}
    pairs |= {("u", j): sincos(u[j]) for j, angle in enumerate(program.known_angles) if angle}
    leaves = {("x", k): a for k, a in enumerate(x)} | {("u", j): a for j, a in enumerate(u)}
    leaves |= {("g", j): g.sub(b, a) for j, (a, b) in enumerate(zip(u, following, strict=True))}
    leaves |= {(letter, j): g.leaf(f"%{letter}{j}") for letter in "wb" for j in range(program.inputs)}
    leaves |= {("p", i): g.leaf(f"%p{i}") for i in range(program.parameters)}
    stored = program.outputs if outputs == "states" else []
    guards = [x for pair in program.guards for x in pair]
    nodes = [*program.residual, program.square, *program.correction, *guards, *program.advance, *stored]
    value = lowered(g, nodes, leaves, pairs)
    z = [value(k) for k in program.correction]
    moved = {f"%x{k}": g.add(x[k], z[k]) for k in range(program.unknowns)}
    for k in turning:
        pair = sincos(moved[f"%x{k}"]) if library else trigonometry.rotated(g, pairs["x", k], z[k], REACH)
        moved |= {f"%s{k}": pair[0], f"%c{k}": pair[1]}
    scale = [g.const(1.0 / length) for length in program.lengths]
    way = [g.mul(c, g.sub(a, b)) for c, a, b in zip(scale, guess, last, strict=True)]
    return Code(
        g,
        {k: sincos(guess[k]) for k in turning},
        g.squares([value(k) for k in program.residual]),
        value(program.square),
        moved,
        _within(g, [g.mul(c, a) for c, a in zip(scale, z, strict=True)], REACH),
        _within(g, way, TURN),
        _regular(g, [(value(x), value(least)) for x, least in program.guards]),
        [value(k) for k, _ in program.guards],
        [g.add(a, value(k)) for a, k in zip(x, program.advance, strict=True)],
        [value(k) for k in stored] if stored else list(x),
    )


def _regular(g: Graph, guards: list[Pair]) -> int:
    """Mask where the square of every guard is at least what it must be."""
    found = g.both([g.make("le", least, g.mul(x, x)) for x, least in guards])
    return g.make("le", g.const(0.0), g.const(1.0)) if found is None else found


def _within(g: Graph, values: list[int], bound: float) -> int:
    """Mask where the norm of some values is at most a bound."""
    return g.make("le", g.squares(values), g.const(bound * bound))


def lowered(
    g: Graph, nodes: list[Node], leaves: dict[tuple[str, int], int], pairs: dict[tuple[str, int], Pair]
) -> Callable[[Node], int]:
    """Write nodes into a graph of machine arithmetic; `pairs` are the sines and cosines of inputs."""
    found: dict[int, int] = {}
    for node in reachable(nodes):
        if node.op == "CONST":
            found[node.index] = g.const(float(node.number or 0.0))
        elif node.op == "INPUT":
            found[node.index] = leaves[node.args]
        elif node.op in ("SIN", "COS"):
            found[node.index] = pairs[node.args[0].args][node.op == "COS"]
        else:
            found[node.index] = _lowered(g, node.op, [found[a.index] for a in node.args])
    return lambda node: found[node.index]


def _lowered(g: Graph, op: str, a: list[int]) -> int:
    match op:
        case "ADD":
            return g.add(*a)
        case "SUB":
            return g.sub(*a)
        case "MUL":
            return g.mul(*a)
        case "NEG":
            return g.neg(a[0])
        case "INV":
            return g.div(g.const(1.0), a[0])
    raise ValueError(f"no machine arithmetic for {op}")
