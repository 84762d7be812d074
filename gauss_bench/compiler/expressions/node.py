"""Expressions with their values at sample states of a linkage: a graph in which equal expressions are one node.

Every node has values at sample states of the linkage, for the choice of pivots, and at three random points, for the recognition of
equal expressions. The random points violate the constraints slightly; far from the constraints, products of many factors would
overflow. Expressions with equal values at the random points are equal: a difference of analytic functions that is not zero
everywhere is zero almost nowhere. A new expression is therefore first compared with the existing nodes by its values at the random
points. In this way c^2 + s^2 becomes 1, terms that cancel become 0, and a multiple k x of an existing node x becomes the product of
k and x, however it was derived.
Source: Schwartz, Fast probabilistic algorithms for verification of polynomial identities, J. ACM 27 (1980).

Signs and constant factors are moved out of products, so that sums can absorb them: -(x y) is stored, not (-x) y.
"""

import math
from collections.abc import Callable, Iterable, Sequence
from heapq import heapify, heappop, heappush
from typing import Any

import numpy as np

from gauss_bench.terms import Array

GENERIC = 3  # number of random points: their two ratios of values agree by accident with a probability of 1e-10 each
VANISHES = 1e-13  # a sum is zero if it is smaller than this fraction of a term; a few hundred rounding units
SAME = 1e-12  # largest relative difference between values that are equal except for rounding

# Latency [cycles]: time from the start of an operation until its result can be used, on Zen 4 and 5 and about the same on other
# processors. SIN and COS are mostly computed by a rotation.
LATENCY = {"DIV": 13.0, "INV": 13.0, "SQRT": 20.0, "SIN": 25.0, "COS": 25.0, "NEG": 0.0, "INPUT": 0.0, "CONST": 0.0}
STEP = 4.0  # [cycles] latency of any other operation
# `ready` of a node is the sum of these times along the longest path to it from inputs.

VALUE: dict[str, Callable[..., Array]] = {  # operation -> its function in numpy
    "ADD": np.add,
    "SUB": np.subtract,
    "MUL": np.multiply,
    "INV": np.reciprocal,
    "NEG": np.negative,
    "SQRT": np.sqrt,
    "SIN": np.sin,
    "COS": np.cos,
    "FMIN": np.minimum,
    "FMAX": np.maximum,
    "LE": lambda a, b: np.less_equal(a, b) * 1.0,
}
Key = tuple[Any, ...]  # operation, and indices of its operands
Generic = tuple[float, float, float]  # values of one expression at the GENERIC random points


class Node:
    """One expression.

    Attributes:
        op, args: operation and operands; the args of an input are its name and index.
        generic: values at the GENERIC random points, used to recognise equal expressions.
        number: value of a constant node, None for any other node.
        ready: earliest time [cycles] at which a processor has the value, if all inputs are available at 0.
    """

    __slots__ = ("_values", "args", "generic", "graph", "index", "number", "op", "ready")

    def __init__(
        self,
        graph: "ExpressionGraph",
        op: str,
        args: tuple[Any, ...],
        generic: Generic,
        number: float | None,
        ready: float,
        values: Array | None = None,
    ):
        """Make a node without entering it into the graph's tables `known` and `ratios`.

        `values` (samples + GENERIC,) are the values at the samples, then at the random points; if None, computed on first use.
        """
        self.graph, self.op, self.args, self.generic, self.number, self.ready = graph, op, args, generic, number, ready
        self._values = values
        self.index = graph.count
        graph.count += 1

    @property
    def values(self) -> Array:
        """Values (samples + GENERIC,) of the expression at the sample states, followed by its values at the random points."""
        # no recursion, because a chain of operands may be very long; inputs have their values from the beginning
        waiting = [] if self._values is not None else [self]
        while waiting:
            node = waiting[-1]
            missing = [x for x in node.args if x._values is None]
            waiting += missing
            if not missing:
                if node.number is not None:
                    node._values = np.full(node.graph.samples + GENERIC, node.number)
                else:
                    node._values = VALUE[node.op](*(x._values for x in node.args))
                waiting.pop()
        return self._values  # type: ignore[return-value]

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
    def is_zero(self) -> bool:
        """True for the constant 0, False for any other node."""
        return self.number == 0.0


class ExpressionGraph:
    """All expressions of one program.

    Attributes:
        known: table: (operation, indices of operands) -> node.
        ratios: table: ratios of a node's values at the random points, as text -> the first node with these ratios. All nodes with
            the same ratios are multiples of this first node.
        trail: (table, key) of every entry of `known` and `ratios`, oldest first, so that `forget` can remove the last ones.
    """

    def __init__(self, samples: int):
        """Make an empty graph; each of its nodes will have values at `samples` sample states of the linkage."""
        self.samples = samples
        self.count = 0
        self.known: dict[Key, Node] = {}
        self.ratios: dict[str, Node] = {}
        self.trail: list[tuple[dict[Any, Node], Any]] = []
        self.random = np.random.default_rng(19800427)

    def node(self, x: "Node | float") -> Node:
        """Return x unchanged if it is a node; if x is a number, return the node of this constant."""
        return x if isinstance(x, Node) else self.constant(float(x))

    def constant(self, number: float) -> Node:
        """Return the node of a constant; its value is `number` at all samples and random points, and its time `ready` is 0."""
        number += 0.0  # turns -0.0 into 0.0
        known = self.known.get(("CONST", number))
        if known is None:
            node = Node(self, "CONST", (), generic=(number, number, number), number=number, ready=0.0)
            known = self._enter(node, ("CONST", number))
        return known

    def input(self, name: str, index: int, values: Array, size: float) -> Node:
        """Return the node of the input with a name and an index, such as coordinate 3 of q.

        `values` (samples,) are the input's values at the samples. Each of its values at the GENERIC random points is the value at
        one of the samples plus 0.1 to 0.3 of `size`.
        """
        known = self.known.get(("INPUT", name, index))
        if known is None:
            near = values[np.linspace(0, self.samples - 1, GENERIC).astype(int)]
            values = np.concatenate([values, near + size * self.random.uniform(0.1, 0.3, GENERIC)])
            g = _generic(values)
            known = self._new("INPUT", (name, index), g, _ratio_key(g), ready=0.0, key=("INPUT", name, index), values=values)
        return known

    def opaque(self, op: str, *args: Node) -> Node:
        """Return the node of an operation that is not an analytic function, such as a minimum.

        Equal values at the random points would not prove that two expressions with such an operation are equal everywhere. At the
        random points the node therefore gets random numbers as values, like an input.
        """
        key = (op, *(a.index for a in args))
        known = self.known.get(key)
        if known is None:
            values = VALUE[op](*(a.values for a in args))
            if all(a.number is not None for a in args):
                return self.constant(float(values[0]))
            values = np.concatenate([values[: self.samples], self.random.uniform(0.4, 1.6, GENERIC)])
            g = _generic(values)
            ready = max(a.ready for a in args) + STEP
            known = self._new(op, args, g, _ratio_key(g), ready, key, values)
        return known

    def neg(self, a: Node) -> Node:
        """Return the node -a; a constant is negated, and for a negation a = -x the node x is returned."""
        if a.number is not None:
            return self.constant(-a.number)
        if a.op == "NEG":
            return a.args[0]  # type: ignore[no-any-return]
        key = ("NEG", a.index)
        known = self.known.get(key)
        if known is None:
            x, y, z = a.generic  # values at the three random points; `ready` stays the same, as a minus costs no time
            known = self._enter(Node(self, "NEG", (a,), (-x, -y, -z), None, a.ready), key)
        return known

    def add(self, a: Node, b: Node) -> Node:
        """Return a + b; its operands are put in order, so that a + b and b + a are one node."""
        if a.is_zero or b.is_zero:
            return b if a.is_zero else a
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
        """Return a b, with signs and constant factors in front; factors are in order of index, so that a b and b a are one node."""
        if a.number is not None:
            return self.scale_by(a.number, b)
        if b.number is not None:
            return self.scale_by(b.number, a)
        if a.op == "NEG" or b.op == "NEG":
            product = self.mul(a.args[0] if a.op == "NEG" else a, b.args[0] if b.op == "NEG" else b)
            return product if a.op == b.op else self.neg(product)
        return self._make("MUL", a, b) if a.index <= b.index else self._make("MUL", b, a)

    def scale_by(self, factor: float, x: Node) -> Node:
        """Return factor * x; all constant factors are collected in one, and a minus sign is moved in front of the product."""
        if x.number is not None or factor == 0.0:
            return self.constant(factor * (x.number or 0.0))
        own_factor, base = factor_out(x)
        factor *= own_factor
        size = abs(factor)
        product = base  # the product, but for the sign, if the size of the factor is 1
        if abs(size - 1.0) > SAME:
            number = self.constant(size)
            key = ("MUL", number.index, base.index)
            known = self.known.get(key)
            if known is None:
                g = product_of(number.generic, base.generic)
                known = self._enter(Node(self, "MUL", (number, base), g, None, base.ready + STEP), key)
            product = known
        return product if factor > 0 else self.neg(product)

    def inverse(self, a: Node) -> Node:
        """Return 1 / a, with the sign and the constant factor of a moved in front."""
        if a.number is not None:
            return self.constant(1.0 / a.number)
        factor, base = factor_out(a)
        return self.scale_by(1.0 / factor, self._make("INV", base))

    def sqrt(self, a: Node) -> Node:
        return self._unary("SQRT", a)

    def sin(self, a: Node) -> Node:
        return self._unary("SIN", a)

    def cos(self, a: Node) -> Node:
        return self._unary("COS", a)

    def _unary(self, op: str, a: Node) -> Node:
        """Return the node of an operation with the single operand `a`: its square root, sine or cosine."""
        known = self.known.get((op, a.index))
        if known is not None:
            return known
        # numpy gets the samples and the random points in one call: in two calls, the last digits of its results could differ,
        # because they may depend on the length of the array
        return self._make(op, a, values=VALUE[op](a.values))

    def _make(self, op: str, *args: Node, values: Array | None = None) -> Node:
        """Return a node for an operation: a constant, an existing node, a multiple of an existing node, or else a new node.

        `values` (samples + GENERIC,) are the values of the result; if None, they are computed from the operands.
        """
        key = (op, *[a.index for a in args])
        known = self.known.get(key)
        if known is not None:
            return known
        # values of the operation at the random points, which show equal expressions and multiples
        g = GENERIC_VALUE[op](*[a.generic for a in args]) if values is None else _generic(values)
        if None not in [a.number for a in args]:  # an operation on constants
            return self.constant(g[0] if values is None else float(values[0]))
        ratio = _ratio_key(g)
        # only sums and differences can cancel: their result is zero if it is tiny relative to the first term
        known = self.recognise(g, args[0].generic if op in ("ADD", "SUB") else None, ratio)
        if known is not None:
            return self._enter(known, key)
        # time [cycles] at which the result can be used
        ready = _sum_ready(*args) if op in ("ADD", "SUB") else max([a.ready for a in args]) + LATENCY.get(op, STEP)
        return self._new(op, args, g, ratio, ready, key, values)

    def recognise(self, g: Generic, summand: Generic | None, ratio: str) -> Node | None:
        """Return the node for an expression if it is a constant or a multiple of an existing node, else None.

        Args:
            ratio: `_ratio_key` of the values g, which is equal for all multiples of one expression.
            summand: values of the first term if the expression is a sum, else None. A sum that is tiny relative to its first term
                is treated as zero.
        """
        x, y, z = g
        if summand is not None:
            a, b, c = summand
            if abs(x) <= VANISHES * abs(a) and abs(y) <= VANISHES * abs(b) and abs(z) <= VANISHES * abs(c):
                return self.constant(0.0)
        # a constant has the same value at all points; a multiple of a known node has the same ratio to this node
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
        self, op: str, args: tuple[Any, ...], g: Generic, ratio: str, ready: float, key: Key, values: Array | None = None
    ) -> Node:
        """Make a node, and enter it into the tables `known` (under `key`) and `ratios`; `trail` notes it for `forget`."""
        node = Node(self, op, args, g, None, ready, values)
        if ratio not in self.ratios:
            self.ratios[ratio] = node
            self.trail.append((self.ratios, ratio))
        return self._enter(node, key)

    def _enter(self, node: Node, key: Key) -> Node:
        """Enter a node into the table `known` under a key (operation and operands); return the node."""
        self.known[key] = node
        self.trail.append((self.known, key))
        return node

    def forget(self, mark: int) -> None:
        """Remove the entries of `known` and `ratios` that were made after the list `trail` had the length `mark`.

        Each attempt of a search thus begins with the same nodes.
        """
        while len(self.trail) > mark:
            table, key = self.trail.pop()
            del table[key]

    def total(self, terms: Iterable[Node], distance: int = 6) -> Node:
        """Return the sum of the terms; the terms that are ready earliest are added first.

        Before terms are added, multiples of the same node are combined. Then two terms whose positions in the list differ by at
        most `distance` are replaced by their sum, if this sum is a constant or a multiple of an existing node.
        """
        combined = self._combine_multiples(terms)
        if len(combined) > 2:
            combined = self._combine_multiples(self._combine_pairs(combined, distance))
        heap = [(x.ready, x.index, x) for x in combined]
        heapify(heap)
        while len(heap) > 1:
            a, b = heappop(heap)[2], heappop(heap)[2]
            x = self.add(a, b)
            heappush(heap, (x.ready, x.index, x))
        return heap[0][2] if heap else self.constant(0.0)

    def _combine_multiples(self, terms: Iterable[Node]) -> list[Node]:
        """Combine the terms that are multiples of the same node into one term each; leave out terms that become zero."""
        factors: dict[int, float] = {}
        bases: dict[int, Node] = {}
        for term in terms:
            factor, base = factor_out(term) if term.number is None else (term.number, self.constant(1.0))
            factors[base.index] = factors.get(base.index, 0.0) + factor
            bases[base.index] = base
        scaled = (self.scale_by(factor, bases[i]) for i, factor in factors.items() if abs(factor) > 0.0)
        return [x for x in scaled if not x.is_zero]

    def _combine_pairs(self, terms: Sequence[Node], distance: int) -> list[Node]:
        """Return terms with the same sum; two at most `distance` places apart become one node if `recognise` finds their sum."""
        waiting, combined = list(terms), []
        while waiting:
            a = waiting.pop(0)
            for k, b in enumerate(waiting[:distance]):
                total = sum_of(a.generic, b.generic)
                known = self.recognise(total, a.generic, _ratio_key(total))
                if known is not None:
                    waiting[k] = known  # the sum replaces both a and b
                    break
            else:  # a is not combined with any term
                combined.append(a)
        return combined


def minimum(a: Node, b: Node) -> Node:
    """Return the smaller of two values."""
    return a.graph.opaque("FMIN", a, b)


def maximum(a: Node, b: Node) -> Node:
    """Return the larger of two values."""
    return a.graph.opaque("FMAX", a, b)


def factor_out(x: Node) -> tuple[float, Node]:
    """Write x as the product of a number and a node that has no sign and no constant factor; return both."""
    sign = 1.0
    if x.op == "NEG":
        sign, x = -1.0, x.args[0]
    if x.op == "MUL" and x.args[0].number is not None:
        return sign * x.args[0].number, x.args[1]
    return sign, x


def sum_of(a: Generic, b: Generic) -> Generic:
    """Return the values of the sum a + b at the random points, from the values of a and of b at these points."""
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


def product_of(a: Generic, b: Generic) -> Generic:
    """Return the values of the product a b at the random points, from the values of a and of b at these points."""
    return a[0] * b[0], a[1] * b[1], a[2] * b[2]


def _difference(a: Generic, b: Generic) -> Generic:
    """Return the values of the difference a - b at the random points, from the values of a and of b at these points."""
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


def _reciprocal(a: Generic) -> Generic:
    """Return the reciprocals of values at the random points; the reciprocal of 0 is infinite."""
    x, y, z = [1.0 / x if x else math.copysign(math.inf, x) for x in a]
    return x, y, z


GENERIC_VALUE: dict[str, Callable[..., Generic]] = {"ADD": sum_of, "SUB": _difference, "MUL": product_of, "INV": _reciprocal}


def _generic(values: Array) -> Generic:
    """Return the values at the random points: the last GENERIC of the values (samples + GENERIC,) of a node."""
    x, y, z = values[-GENERIC:].tolist()
    return x, y, z


def _ratio_key(g: Generic) -> str:
    """Return as text the ratios g[1] / g[0] and g[2] / g[0], rounded to ten digits; g has the values at the random points.

    An expression and all its multiples have the same ratios.
    """
    first = g[0] or 1e-300  # a divisor that is not zero
    return f"{g[1] / first:.9e} {g[2] / first:.9e}"


def _round(x: float) -> float:
    """Return a number of at most 8 characters that equals x but for rounding, or x if there is none: 0.4999999999999 gives 0.5."""
    text = f"{x:.12g}"
    short = float(text)
    return short if abs(short - x) <= SAME * abs(x) and len(text) < 9 else x


def _sum_ready(a: Node, b: Node) -> float:
    """Return the time [cycles] at which a + b is ready; if a or b is a product, it may be fused with the addition."""
    times = [max(a.ready, b.ready)]
    for x, y in ((a, b), (b, a)):
        if x.op == "MUL":
            times.append(max(y.ready, *(operand.ready for operand in x.args)))
    return min(times) + STEP
