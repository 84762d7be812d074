"""Expressions that know their values: a graph in which equal expressions are one node.

Every node carries its values at states of the linkage, where pivots are chosen, and at a few random points off the constraints
(but not far off, where the factors of a long chain would overflow).
Two expressions that agree at the random points agree everywhere (an identity of analytic functions that fails, fails almost
everywhere). A new node is therefore first compared with the old ones by these values: c^2 + s^2 becomes 1, terms that cancel
become 0, and a multiple k x of a known x becomes k times x, whatever operations it came from. Source of the argument: Schwartz,
Fast probabilistic algorithms for verification of polynomial identities, J. ACM 27 (1980).

Signs and constant factors are kept outside: -(x y), never (-x) y, so that sums can absorb them.
"""

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from heapq import heapify, heappop, heappush
from typing import Any

import numpy as np

from gauss_bench.terms import Array

GENERIC = 3  # random points: an accidental agreement in one ratio has a chance of 1e-10, in two of 1e-20
VANISHES = 1e-13  # of the larger summand: a few hundred rounding units
SAME = 1e-12  # relative: values of equal expressions differ by rounding alone

# Cycles until a result can be used, on Zen 4/5 and about the same on others; SIN and COS are mostly computed by a rotation.
LATENCY = {"DIV": 13.0, "INV": 13.0, "SQRT": 20.0, "SIN": 25.0, "COS": 25.0, "NEG": 0.0, "INPUT": 0.0, "CONST": 0.0}
STEP = 4.0  # [cycles] of every other operation

VALUE: dict[str, Callable[..., Array]] = {
    "ADD": np.add,
    "SUB": np.subtract,
    "MUL": np.multiply,
    "INV": np.reciprocal,
    "NEG": np.negative,
    "SQRT": np.sqrt,
    "SIN": np.sin,
    "COS": np.cos,
}
Generic = tuple[float, float, float]  # values at the random points


class Node:
    """One expression.

    Attributes:
        op, args: operation and operands. number: the value of a constant, else None.
        generic: values at the random points. Those at the samples (`at`) are computed when they are first needed.
        ready: [cycles] the earliest time at which its value can be there.
    """

    __slots__ = ("_at", "args", "generic", "graph", "index", "number", "op", "ready")

    def __init__(
        self,
        graph: "ExpressionGraph",
        op: str,
        args: tuple[Any, ...],
        generic: Generic,
        number: float | None,
        ready: float,
        at: Array | None = None,
    ):
        self.graph, self.op, self.args, self.generic, self.number, self.ready = graph, op, args, generic, number, ready
        self._at = at
        self.index = graph.count
        graph.count += 1

    @property
    def at(self) -> Array:
        """The values at the samples, followed by those at the random points."""
        waiting = [] if self._at is not None else [self]
        while waiting:
            node = waiting[-1]
            missing = [x for x in node.args if x._at is None]
            waiting += missing
            if not missing:
                node._at = node._value()
                waiting.pop()
        return self._at  # type: ignore[return-value]

    def _value(self) -> Array:
        """Return the node's values (samples + GENERIC,): at the sampled states, then at GENERIC random ones off the constraints."""
        if self.number is not None:
            return np.full(self.graph.samples + GENERIC, self.number)
        return VALUE[self.op](*(x._at for x in self.args))

    def __add__(self, other: "Node | float") -> "Node":
        return self.graph.add(self, self.graph.node(other))

    def __sub__(self, other: "Node | float") -> "Node":
        return self.graph.add(self, self.graph.neg(self.graph.node(other)))

    def __mul__(self, other: "Node | float") -> "Node":
        return self.graph.mul(self, self.graph.node(other))

    def __truediv__(self, other: "Node | float") -> "Node":
        return self.graph.mul(self, self.graph.inverse(self.graph.node(other)))

    def __rsub__(self, other: float) -> "Node":
        return self.graph.node(other) - self

    def __neg__(self) -> "Node":
        return self.graph.neg(self)

    def sin(self) -> "Node":
        return self.graph.sin(self)

    def cos(self) -> "Node":
        return self.graph.cos(self)

    __radd__ = __add__
    __rmul__ = __mul__

    @property
    def zero(self) -> bool:
        return self.number == 0.0

    @property
    def unit(self) -> bool:
        return self.number is not None and abs(self.number) == 1.0


class ExpressionGraph:
    """All expressions of one program, with their values at a number of sample states.

    Attributes:
        known: (operation, operands) -> node. ratios: the first node of those whose values have the same ratios.
        trail: entries of both, in the order in which they were made.
    """

    def __init__(self, samples: int):
        self.samples = samples
        self.count = 0
        self.known: dict[tuple[Any, ...], Node] = {}
        self.ratios: dict[str, Node] = {}
        self.trail: list[tuple[dict[Any, Node], Any]] = []
        self.random = np.random.default_rng(19800427)

    def node(self, x: "Node | float") -> Node:
        return x if isinstance(x, Node) else self.constant(float(x))

    def constant(self, number: float) -> Node:
        """Return the node of a number."""
        number += 0.0  # no negative zero
        known = self.known.get(("CONST", number))
        if known is None:
            known = self._keep(Node(self, "CONST", (), (number, number, number), number, 0.0), ("CONST", number))
        return known

    def input(self, name: str, index: int, values: Array, size: float) -> Node:
        """Return an input with its values at the samples; each random point is that of a sample plus a random part of `size`."""
        known = self.known.get(("INPUT", name, index))
        if known is None:
            near = values[np.linspace(0, self.samples - 1, GENERIC).astype(int)]
            at = np.concatenate([values, near + size * self.random.uniform(0.1, 0.3, GENERIC)])
            g = _generic(at)
            known = self._new("INPUT", (name, index), g, _ratio_key(g), 0.0, ("INPUT", name, index), at)
        return known

    def opaque(self, op: str, args: tuple[Node, ...], at: Array) -> Node:
        """Return an operation with kinks or jumps, with its values; at the random points it counts as one more input."""
        key = (op, *(a.index for a in args))
        known = self.known.get(key)
        if known is None:
            if all(a.number is not None for a in args):
                return self.constant(float(at[0]))
            values = np.concatenate([at[: self.samples], self.random.uniform(0.4, 1.6, GENERIC)])
            g = _generic(values)
            known = self._new(op, args, g, _ratio_key(g), max(a.ready for a in args) + STEP, key, values)
        return known

    def neg(self, a: Node) -> Node:
        """Return -a; no node is negated twice."""
        if a.number is not None:
            return self.constant(-a.number)
        if a.op == "NEG":
            return a.args[0]  # type: ignore[no-any-return]
        key = ("NEG", a.index)
        known = self.known.get(key)
        if known is None:
            x, y, z = a.generic
            known = self._keep(Node(self, "NEG", (a,), (-x, -y, -z), None, a.ready), key)
        return known

    def add(self, a: Node, b: Node) -> Node:
        """Return a + b; the operands of commutative operations are put in order, so that a + b and b + a are one node."""
        if a.zero or b.zero:
            return b if a.zero else a
        if a.number is not None and b.number is not None:
            return self.constant(a.number + b.number)
        if a.op == "NEG":
            if b.op == "NEG":
                return self.neg(self.add(a.args[0], b.args[0]))
            a, b = b, a
        if b.op == "NEG":
            return self._make("SUB", a, b.args[0])
        return self._make("ADD", a, b) if a.index <= b.index else self._make("ADD", b, a)

    def mul(self, a: Node, b: Node) -> Node:
        """Return a b, its sign and constant factors outside."""
        if a.number is not None or b.number is not None:
            return self.scale_by(a.number, b) if a.number is not None else self.scale_by(b.number or 0.0, a)
        if a.op == "NEG" or b.op == "NEG":
            product = self.mul(a.args[0] if a.op == "NEG" else a, b.args[0] if b.op == "NEG" else b)
            return product if a.op == b.op else self.neg(product)
        return self._make("MUL", a, b) if a.index <= b.index else self._make("MUL", b, a)

    def scale_by(self, factor: float, x: Node) -> Node:
        """Return factor x, with the constant factors of x multiplied out and the sign outside."""
        if x.number is not None or factor == 0.0:
            return self.constant(factor * (x.number or 0.0))
        own, base = factor_out(x)
        factor *= own
        size = abs(factor)
        product = base
        if abs(size - 1.0) > SAME:
            number = self.constant(size)
            key = ("MUL", number.index, base.index)
            known = self.known.get(key)
            if known is None:
                g = product_of(number.generic, base.generic)
                known = self._keep(Node(self, "MUL", (number, base), g, None, base.ready + STEP), key)
            product = known
        return product if factor > 0 else self.neg(product)

    def inverse(self, a: Node) -> Node:
        """Return 1 / a, its sign and constant factor outside."""
        if a.number is not None:
            return self.constant(1.0 / a.number)
        own, base = factor_out(a)
        return self.scale_by(1.0 / own, self._make("INV", base))

    def sqrt(self, a: Node) -> Node:
        return self._of_one("SQRT", a)

    def sin(self, a: Node) -> Node:
        return self._of_one("SIN", a)

    def cos(self, a: Node) -> Node:
        return self._of_one("COS", a)

    def _of_one(self, op: str, a: Node) -> Node:
        """Return a function of a; numpy computes it for all points at once, as its last digit may depend on the array's length."""
        old = self.known.get((op, a.index))
        if old is not None:
            return old
        at = VALUE[op](a.at)
        return self._make(op, a, at=at)

    def _make(self, op: str, *args: Node, at: Array | None = None) -> Node:
        """Return the node for an operation: an old one of the same form or values, a multiple of one, a constant, or a new one."""
        key = (op, *[a.index for a in args])
        old = self.known.get(key)
        if old is not None:
            return old
        g = GENERIC_VALUE[op](*[a.generic for a in args]) if at is None else _generic(at)
        if None not in [a.number for a in args]:
            return self.constant(g[0] if at is None else float(at[0]))
        ratio = _ratio_key(g)
        known = self.recognise(g, args[0].generic if op in ("ADD", "SUB") else None, ratio)
        if known is not None:
            return self._keep(known, key)
        ready = _sum_ready(*args) if op in ("ADD", "SUB") else max([a.ready for a in args]) + LATENCY.get(op, STEP)
        return self._new(op, args, g, ratio, ready, key, at)

    def recognise(self, g: Generic, summand: Generic | None, ratio: str) -> Node | None:
        """Return the node with these values at the random points: a constant or a multiple of a known node; else None.

        `summand` is one of the two terms of a sum: a sum that is tiny beside it cancels, and what is left is rounding.
        """
        x, y, z = g
        if summand is not None:
            a, b, c = summand
            if abs(x) <= VANISHES * abs(a) and abs(y) <= VANISHES * abs(b) and abs(z) <= VANISHES * abs(c):
                return self.constant(0.0)
        # a constant has the same value at all points, a multiple of a known node the same factor
        close = SAME * abs(x)
        if abs(y - x) <= close and abs(z - x) <= close:
            return self.constant(_round(x))
        base = self.ratios.get(ratio)
        if base is None:
            return None
        a, b, c = base.generic
        factor = x / a
        if max(abs(y / b - factor), abs(z / c - factor)) > SAME * abs(factor):
            return None
        return self.scale_by(_round(factor), base)

    def _new(
        self, op: str, args: tuple[Any, ...], g: Generic, ratio: str, ready: float, key: tuple[Any, ...], at: Array | None = None
    ) -> Node:
        made = Node(self, op, args, g, None, ready, at)
        if ratio not in self.ratios:
            self.ratios[ratio] = made
            self.trail.append((self.ratios, ratio))
        return self._keep(made, key)

    def _keep(self, node: Node, key: tuple[Any, ...]) -> Node:
        """Enter a node under a form (operation and operands)."""
        self.known[key] = node
        self.trail.append((self.known, key))
        return node

    def forget(self, mark: int) -> None:
        """Forget every node made since the trail was `mark` long, so that another attempt finds the same nodes as the last."""
        while len(self.trail) > mark:
            where, key = self.trail.pop()
            del where[key]

    def total(self, terms: Iterable[Node], pairs: int = 6) -> Node:
        """Return the sum of the terms, those that are ready earliest added first.

        Multiples of the same node are joined before, and terms not more than `pairs` apart whose sum is known are replaced by it.
        """
        joined = self._join(terms)
        if len(joined) > 2:
            joined = self._join(self._pair(joined, pairs))
        heap = [(x.ready, x.index, x) for x in joined]
        heapify(heap)
        while len(heap) > 1:
            a, b = heappop(heap)[2], heappop(heap)[2]
            x = self.add(a, b)
            heappush(heap, (x.ready, x.index, x))
        return heap[0][2] if heap else self.constant(0.0)

    def _join(self, terms: Iterable[Node]) -> list[Node]:
        """Return one term for each node that the terms are multiples of; terms that vanish are left out."""
        factors: dict[int, float] = {}
        bases: dict[int, Node] = {}
        for term in terms:
            own, base = (term.number, self.constant(1.0)) if term.number is not None else factor_out(term)
            factors[base.index] = factors.get(base.index, 0.0) + own
            bases[base.index] = base
        scaled = (self.scale_by(factor, bases[i]) for i, factor in factors.items() if abs(factor) > 0.0)
        return [x for x in scaled if not x.zero]

    def _pair(self, terms: Sequence[Node], reach: int) -> list[Node]:
        """Replace pairs of terms by their sums where these are known, zero or constant; pairs are at most `reach` terms apart."""
        left, done = list(terms), []
        while left:
            a = left.pop(0)
            for k, b in enumerate(left[:reach]):
                total = sum_of(a.generic, b.generic)
                known = self.recognise(total, a.generic, _ratio_key(total))
                if known is not None:
                    left[k] = known
                    break
            else:
                done.append(a)
        return done


def minimum(a: Node, b: Node) -> Node:
    return a.graph.opaque("FMIN", (a, b), np.minimum(a.at, b.at))


def maximum(a: Node, b: Node) -> Node:
    return a.graph.opaque("FMAX", (a, b), np.maximum(a.at, b.at))


def factor_out(x: Node) -> tuple[float, Node]:
    """Write x as a number times a node without a constant factor."""
    sign = 1.0
    if x.op == "NEG":
        sign, x = -1.0, x.args[0]
    if x.op == "MUL" and x.args[0].number is not None:
        return sign * x.args[0].number, x.args[1]
    return sign, x


def sum_of(a: Generic, b: Generic) -> Generic:
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


def product_of(a: Generic, b: Generic) -> Generic:
    return a[0] * b[0], a[1] * b[1], a[2] * b[2]


def _difference(a: Generic, b: Generic) -> Generic:
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


def _reciprocal(a: Generic) -> Generic:
    x, y, z = [1.0 / x if x else math.copysign(math.inf, x) for x in a]
    return x, y, z


GENERIC_VALUE: dict[str, Callable[..., Generic]] = {"ADD": sum_of, "SUB": _difference, "MUL": product_of, "INV": _reciprocal}


def _generic(at: Array) -> Generic:
    x, y, z = at[-GENERIC:].tolist()
    return x, y, z


def _ratio_key(g: Generic) -> str:
    """Return the ratios of the values at the random points, to ten digits: equal for multiples of the same expression."""
    first = g[0] or 1e-300
    return f"{g[1] / first:.9e} {g[2] / first:.9e}"


def _round(x: float) -> float:
    """Return the number of few digits that x equals up to rounding, or x if there is none."""
    short = float(f"{x:.12g}")
    return short if abs(short - x) <= SAME * abs(x) and len(f"{x:.12g}") < 9 else x


def _sum_ready(a: Node, b: Node) -> float:
    """Return the time at which a + b is ready if a product among the two is fused with the addition."""
    times = [max(a.ready, b.ready)]
    for x, y in ((a, b), (b, a)):
        if x.op == "MUL":
            times.append(max(y.ready, *(operand.ready for operand in x.args)))
    return min(times) + STEP


@dataclass(frozen=True, eq=False)
class Vector:
    """A vector of the plane as a complex number x + i y; multiplication by i turns it by a quarter."""

    x: Node
    y: Node

    def __add__(self, other: "Vector") -> "Vector":
        return Vector(self.x + other.x, self.y + other.y)

    def __sub__(self, other: "Vector") -> "Vector":
        return Vector(self.x - other.x, self.y - other.y)

    def __neg__(self) -> "Vector":
        return Vector(-self.x, -self.y)

    def __mul__(self, factor: "Vector | Node | float") -> "Vector":
        if isinstance(factor, Vector):
            return Vector(factor.x * self.x - factor.y * self.y, factor.y * self.x + factor.x * self.y)
        return Vector(self.x * factor, self.y * factor)

    def dot(self, other: "Vector") -> Node:
        return self.x * other.x + self.y * other.y

    def turned(self, factor: Node | float = 1.0) -> "Vector":
        """Return i times the vector times a number, such as the velocity of an arm at an angular speed."""
        return Vector(-self.y * factor, self.x * factor)
