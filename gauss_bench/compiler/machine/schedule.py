"""When values can be ready: the same arithmetic with shorter chains, and the order in which to write it.

A processor that reorders looks a few hundred instructions ahead, less than a step of a linkage has. So the text should already
stand in an order that keeps the chain of dependent operations moving: each instruction as late as the end of the loop allows, the
most urgent first (list scheduling by height; Hennessy and Patterson, Computer Architecture, appendix H).

Before that, sums and products are regrouped by when their parts are ready, and products fused into sums. Every rewriting is done
here, on the graph, and none is left to a compiler: one lane and eight lanes then compute the same bits.

  sums        terms meet in the order in which they are ready, two earliest first, as in Huffman's code
  products    likewise
  a b + c     one operation with one rounding, wherever a product is used in sums only
  a / b       a (1/b) where b is ready long before a, or where several values are divided by b
"""

import heapq
from collections.abc import Iterable, Mapping
from typing import NamedTuple

from gauss_bench.compiler.machine.graph import Graph, Pair

LATENCY = {
    "const": 0, "leaf": 0, "neg": 0, "bits": 0, "real": 0, "abs": 1, "and": 1, "plus": 1, "shl": 1, "xor": 1, "both": 1, "select":
    1, "add": 3, "sub": 3, "mul": 3, "fma": 4, "lt": 3, "le": 3, "nonzero": 3, "div": 13, "sqrt": 20,
}  # fmt: skip
ROUNDS = 6  # of the feedback from the end of a loop to its beginning; urgency settles after two or three


def live(g: Graph, roots: Iterable[int]) -> list[int]:
    """The values that the roots need, oldest first."""
    found: set[int] = set()
    waiting = list(roots)
    while waiting:
        x = waiting.pop()
        if x not in found:
            found.add(x)
            waiting += g.operands[x]
    return sorted(found)


def ready_times(g: Graph, values: Iterable[int], arrival: Mapping[str, float]) -> dict[int, float]:
    """When each value is ready on a machine without limits [cycles]; leaves arrive as given, or at 0."""
    times: dict[int, float] = {}
    for x in values:
        if g.operation[x] == "leaf":
            times[x] = arrival.get(str(g.payload[x]), 0.0)
        else:
            times[x] = max((times[k] for k in g.operands[x]), default=0.0) + LATENCY[g.operation[x]]
    return times


def period(g: Graph, values: list[int], carried: Mapping[str, int]) -> float:
    """Cycles that a turn of a loop needs without limits; `carried` maps the name of a leaf to the value that becomes it."""
    arrival = dict.fromkeys(carried, 0.0)
    found = 0.0
    for _ in range(ROUNDS):
        times = ready_times(g, values, arrival)
        found = max((times[x] for x in carried.values()), default=0.0)
        arrival = {name: times[x] - found for name, x in carried.items()}
    return found


def order(g: Graph, values: list[int], carried: Mapping[str, int]) -> list[int]:
    """The values in the order of their urgency: the longest way from them to the end, through further turns of the loop."""
    leaves = {str(g.payload[x]): x for x in values if g.operation[x] == "leaf"}
    turn = period(g, values, carried)
    late = dict.fromkeys(carried.values(), 0.0)
    for _ in range(ROUNDS):
        height = dict.fromkeys(values, -turn) | late
        for x in reversed(values):
            for k in g.operands[x]:
                height[k] = max(height[k], height[x] + LATENCY[g.operation[x]])
        late = dict.fromkeys(carried.values(), -turn)
        for name, x in carried.items():
            if name in leaves:
                late[x] = max(late[x], height[leaves[name]] - turn)
    return sorted(values, key=lambda x: (-height[x], x))


SUMS = ("add", "sub")
EARLIER = LATENCY["div"] - LATENCY["mul"]


class Term(NamedTuple):
    """A signed term of a sum: a value, or a product not yet multiplied out (factor is None for a value)."""

    negative: bool
    value: int
    factor: int | None


class Timed(Graph):
    """A graph that knows when each of its values is ready."""

    def __init__(self) -> None:
        super().__init__()
        self.ready: list[int] = []

    def make(self, operation: str, *operands: int, payload: float | int | str | None = None) -> int:
        found = super().make(operation, *operands, payload=payload)
        if found == len(self.ready):
            self.ready.append(max((self.ready[k] for k in operands), default=0) + LATENCY[operation])
        return found


class Rewriter:
    """Writes the values that the roots need from one graph into another."""

    def __init__(self, old: Graph, roots: list[int]):
        self.old, self.new = old, Timed()
        self.known: dict[int, int] = {}
        needed = live(old, roots)
        self.users: dict[int, list[int]] = {x: [] for x in needed}
        for x in needed:
            for k in old.operands[x]:
                self.users[k].append(x)
        for x in roots:
            self.users[x].append(-1)  # a use of its own, that nothing can absorb
        self.inner = {x for x in needed if self._inside(x)}
        for x in needed:
            if x not in self.inner:
                self.known[x] = self._write(x)

    def _ends(self, x: int) -> list[int]:
        """Users of a value, seen through changes of sign."""
        ends = []
        for user in self.users[x]:
            ends += self._ends(user) if user >= 0 and self.old.operation[user] == "neg" else [user]
        return ends

    def _inside(self, x: int) -> bool:
        """Whether a value disappears in the sum or product that uses it."""
        operation = self.old.operation[x]
        if operation in SUMS or operation == "mul":
            ends = self._ends(x)
            if all(e >= 0 and self.old.operation[e] in SUMS for e in ends):
                return operation == "mul" or len(ends) == 1
            if operation == "mul" and len(ends) == 1:
                return ends[0] >= 0 and self.old.operation[ends[0]] == "mul" and self.users[x] == ends
        return operation == "neg" and self.old.operation[self.old.operands[x][0]] in (*SUMS, "mul") and self._passes(x)

    def _passes(self, x: int) -> bool:
        """Whether a change of sign is only met on the way into sums."""
        return all(e >= 0 and self.old.operation[e] in SUMS for e in self._ends(x))

    def _write(self, x: int) -> int:
        operation, operands = self.old.operation[x], self.old.operands[x]
        if operation in SUMS:
            return self._sum(self._terms(x))
        if operation == "mul":
            return self._product(self._factors(x))
        if operation == "neg":
            return self.new.neg(self._get(operands[0]))
        if operation == "div":
            return self._ratio(*operands)
        return self.new.make(operation, *(self.known[k] for k in operands), payload=self.old.payload[x])

    def _get(self, x: int) -> int:
        if x not in self.known:
            self.known[x] = self._write(x)
        return self.known[x]

    def _terms(self, x: int) -> list[Term]:
        terms = []
        waiting = [(x, False)]
        while waiting:
            y, negative = waiting.pop()
            operation, operands = self.old.operation[y], self.old.operands[y]
            if operation in SUMS and (y == x or y in self.inner):
                waiting += [(operands[0], negative), (operands[1], negative != (operation == "sub"))]
            elif operation == "neg":
                waiting.append((operands[0], not negative))
            elif operation == "mul" and y in self.inner:
                (a, minus_a), (b, minus_b) = map(self.new.unsigned, self._last_two(self._factors(y)))
                terms.append(Term(negative ^ minus_a ^ minus_b, a, b))
            else:
                value, minus = self.new.unsigned(self._get(y))
                terms.append(Term(negative ^ minus, value, None))
        return terms

    def _factors(self, x: int) -> list[int]:
        factors, waiting = [], [x]
        while waiting:
            y = waiting.pop()
            if self.old.operation[y] == "mul" and (y == x or (y in self.inner and len(self.users[y]) == 1)):
                waiting += self.old.operands[y]
            else:
                factors.append(self._get(y))
        return factors

    def _last_two(self, factors: list[int]) -> Pair:
        """A product up to its last multiplication."""
        heap = [(self.new.ready[f], f) for f in factors]
        heapq.heapify(heap)
        while len(heap) > 2:
            product = self.new.mul(heapq.heappop(heap)[1], heapq.heappop(heap)[1])
            heapq.heappush(heap, (self.new.ready[product], product))
        return heap[0][1], heap[1][1]

    def _product(self, factors: list[int]) -> int:
        return self.new.mul(*self._last_two(factors))

    def _sum(self, terms: Iterable[Term]) -> int:
        heap = [(self._ready(term), n, term) for n, term in enumerate(terms)]
        heapq.heapify(heap)
        n = len(heap)
        while len(heap) > 1:
            term = self._joined(heapq.heappop(heap)[2], heapq.heappop(heap)[2])
            heapq.heappush(heap, (self._ready(term), n, term))
            n += 1
        negative, value, factor = heap[0][2]
        found = value if factor is None else self.new.mul(value, factor)
        return self.new.neg(found) if negative else found

    def _ready(self, term: Term) -> int:
        return max(self.new.ready[k] for k in (term.value, term.factor) if k is not None)

    def _joined(self, early: Term, late: Term) -> Term:
        """The sum of two terms; of two products the earlier is multiplied out."""
        g = self.new
        if early.factor is not None and late.factor is None:
            early, late = late, early
        elif early.factor is not None:
            early = Term(early.negative, g.mul(early.value, early.factor), None)
        opposite = early.negative != late.negative
        if late.factor is not None:
            found = g.fma(g.neg(late.value) if opposite else late.value, late.factor, early.value)
        else:
            found = g.sub(early.value, late.value) if opposite else g.add(early.value, late.value)
        if g.operation[found] == "neg":
            return Term(not early.negative, g.operands[found][0], None)
        return Term(early.negative, found, None)

    def _ratio(self, a: int, b: int) -> int:
        g = self.new
        above, below = self._get(a), self._get(b)
        shared = sum(self.old.operation[u] == "div" and self.old.operands[u][1] == b for u in self.users[b] if u >= 0) > 1
        if g.number(above) != 1 and (shared or g.ready[above] > g.ready[below] + EARLIER):
            return g.mul(above, g.div(g.const(1.0), below))
        return g.div(above, below)


def rewrite(g: Graph, roots: list[int]) -> tuple[Graph, list[int]]:
    """The roots in a new graph; leaves count as ready at the beginning."""
    rewriter = Rewriter(g, roots)
    return rewriter.new, [rewriter.known[x] for x in roots]
