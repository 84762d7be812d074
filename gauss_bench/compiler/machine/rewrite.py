"""Rewriting of a graph: sums and products are regrouped by the times at which their parts are ready, and products fused into sums.

All rewriting is done here and none is left to a compiler, so that one lane and eight lanes compute the same bits.

  sums        two terms at a time, those that are ready earliest first, as in Huffman's code
  products    likewise
  a b + c     one operation with one rounding, wherever a product is used in sums only
  a / b       a (1/b) where b is ready long before a, or where several values are divided by b
"""

import heapq
from collections import Counter
from typing import NamedTuple

from gauss_bench.compiler.machine.graph import LATENCY, Graph, Pair, live

SUMS = ("add", "sub")
EARLIER = LATENCY["div"] - LATENCY["mul"]  # [cycles] by which a divisor must be ready first for its reciprocal to cost no time


class Summand(NamedTuple):
    """A signed term of a sum: a value, or a product not yet multiplied out (factor is None for a value)."""

    negative: bool
    value: int
    factor: int | None


class _Rewriter:
    """Writes the values that the roots need from one graph into another.

    A value that is used in one place only need not be computed by itself. A sum is a part of the sum or difference that uses it,
    if nothing else does: its terms become terms of that sum, which are then regrouped. A product is a part of every sum that uses
    it, if only sums do (it is fused into the additions), or of the product that uses it, if nothing else does.

    Attributes:
        known: old value -> new value.
        parts: old values that are absorbed into the values that use them, as above.
        shared: old values by which several others are divided.
    """

    def __init__(self, old: Graph, roots: list[int], new: Graph):
        """Write everything that the roots of the old graph need into the new one."""
        self.old, self.new = old, new
        self.known: dict[int, int] = {}
        needed = [x for x in live(old, roots) if old.operation[x] != "neg"]
        users: dict[int, list[int]] = {x: [] for x in needed}
        for x in needed:
            for k in old.operands[x]:
                users[self._strip(k)[0]].append(x)
        self.parts = {x for x in needed if self._is_part(x, [old.operation[k] for k in users[x]])}
        self.parts -= {self._strip(x)[0] for x in roots}
        divisors = Counter(old.operands[x][1] for x in needed if old.operation[x] == "div")
        self.shared = {x for x, count in divisors.items() if count > 1}
        for x in needed:
            if x not in self.parts:
                self.get(x)

    def _strip(self, x: int) -> tuple[int, bool]:
        """Return an old value without a minus sign in front, and whether there was one."""
        return (self.old.operands[x][0], True) if self.old.operation[x] == "neg" else (x, False)

    def _is_part(self, x: int, users: list[str]) -> bool:
        """Tell whether an old value is absorbed into the sums or products that use it; `users` are the operations that use it."""
        operation, summed = self.old.operation[x], all(user in SUMS for user in users)
        if operation in SUMS:
            return len(users) == 1 and summed
        return operation == "mul" and bool(users) and (summed or users == ["mul"])

    def get(self, x: int) -> int:
        """Return the value in the new graph that corresponds to an old one, and write it there first if necessary."""
        base, negative = self._strip(x)
        if base not in self.known:
            self.known[base] = self._write(base)
        return self.new.neg(self.known[base]) if negative else self.known[base]

    def _write(self, x: int) -> int:
        """Write an old value, which has no minus sign in front, into the new graph."""
        operation, operands = self.old.operation[x], self.old.operands[x]
        if operation in SUMS:
            return self._sum(self._terms(x))
        if operation == "mul":
            return self.new.mul(*self._reduce_to_two(x))
        if operation == "div":
            return self._ratio(*operands)
        return self.new.make(operation, *map(self.get, operands), payload=self.old.payload[x])

    def _terms(self, x: int) -> list[Summand]:
        """Return the signed terms of the old sum x, in the new graph.

        Parts, which only this sum uses, are expanded: sums into their terms, products into the two factors of a fused multiply-add.
        """
        terms, waiting = [], [(x, False)]  # waiting: old values, and whether each is subtracted
        while waiting:
            y, negative = waiting.pop()
            base, minus = self._strip(y)
            negative ^= minus
            operation, operands = self.old.operation[base], self.old.operands[base]
            if operation in SUMS and (base == x or base in self.parts):  # its terms are terms of x
                waiting += [(operands[0], negative), (operands[1], negative ^ (operation == "sub"))]
            elif base in self.parts:  # a product, which may be fused with the addition
                (a, minus_a), (b, minus_b) = map(self.new.split_sign, self._reduce_to_two(base))
                terms.append(Summand(negative ^ minus_a ^ minus_b, a, b))
            else:
                value, minus = self.new.split_sign(self.get(base))
                terms.append(Summand(negative ^ minus, value, None))
        return terms

    def _reduce_to_two(self, x: int) -> Pair:
        """Return two values of the new graph whose product is the old product x.

        Factors are multiplied until two are left, those first that are ready first. The last multiplication is left to the caller,
        which may fuse it into a sum.
        """
        factors, waiting, ready = [], [x], self.new.ready
        while waiting:
            y = waiting.pop()
            if self.old.operation[y] == "mul" and (y == x or y in self.parts):
                waiting += self.old.operands[y]
            else:
                factors.append(self.get(y))
        heap = [(ready[f], f) for f in factors]
        heapq.heapify(heap)
        while len(heap) > 2:
            product = self.new.mul(heapq.heappop(heap)[1], heapq.heappop(heap)[1])
            heapq.heappush(heap, (ready[product], product))
        return heap[0][1], heap[1][1]

    def _sum(self, terms: list[Summand]) -> int:
        """Add the terms two at a time, those that are ready earliest first."""
        heap = [(self._ready(term), n, term) for n, term in enumerate(terms)]
        heapq.heapify(heap)
        for n in range(len(heap), 2 * len(heap) - 1):  # n orders terms that are ready at the same time by their age
            term = self._join(heapq.heappop(heap)[2], heapq.heappop(heap)[2])
            heapq.heappush(heap, (self._ready(term), n, term))
        negative, value, factor = heap[0][2]
        total = value if factor is None else self.new.mul(value, factor)
        return self.new.neg(total) if negative else total

    def _ready(self, term: Summand) -> int:
        """Return the time [cycles] at which the value of a term, or both factors of a product, are ready."""
        return max(self.new.ready[k] for k in (term.value, term.factor) if k is not None)

    def _join(self, early: Summand, late: Summand) -> Summand:
        """Return the sum of two terms; if both are products, the earlier is multiplied and the other fused into the addition."""
        g = self.new
        if early.factor is not None and late.factor is None:
            early, late = late, early
        value = early.value if early.factor is None else g.mul(early.value, early.factor)
        opposite = early.negative != late.negative
        if late.factor is not None:
            total = g.fma(g.neg(late.value) if opposite else late.value, late.factor, value)
        else:
            total = g.sub(value, late.value) if opposite else g.add(value, late.value)
        total, minus = (g.operands[total][0], True) if g.operation[total] == "neg" else (total, False)
        return Summand(early.negative ^ minus, total, None)

    def _ratio(self, a: int, b: int) -> int:
        """Return the ratio of the old values a and b in the new graph.

        It is a product with the reciprocal of b if that serves several divisions, or if the reciprocal can be computed before a is
        ready, so that only the time of a multiplication passes after a.
        """
        g, numerator, denominator = self.new, self.get(a), self.get(b)
        if g.number(numerator) != 1 and (b in self.shared or g.ready[numerator] > g.ready[denominator] + EARLIER):
            return g.mul(numerator, g.div(g.const(1.0), denominator))
        return g.div(numerator, denominator)


def rewrite(g: Graph, roots: list[int], into: Graph | None = None) -> tuple[Graph, list[int]]:
    """Rewrite the roots into a new graph, or into a given one; return that graph and the roots in it."""
    rewriter = _Rewriter(g, roots, Graph() if into is None else into)
    return rewriter.new, [rewriter.get(x) for x in roots]
