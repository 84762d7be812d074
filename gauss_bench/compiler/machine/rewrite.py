"""Rewriting of a graph of machine arithmetic, so that its values are ready earlier.

Sums and products are regrouped according to the times at which their operands are ready, and products are fused with additions. No
compiler does this, so that a trajectory has bitwise the same results alone and in the lanes of a vector. The rules are:

  sums:       the two terms that are ready earliest are added, again and again, as in Huffman's code
  products:   the two factors that are ready earliest are multiplied, again and again
  a b + c:    one fused operation with one rounding, wherever the product is used in sums only
  a / b:      a (1/b) where b is ready long before a, or where several values are divided by b
"""

import heapq
from collections import Counter
from typing import NamedTuple

from gauss_bench.compiler.machine.graph import LATENCY, Graph, Pair, live

SUMS = ("add", "sub")
EARLIER = LATENCY["div"] - LATENCY["mul"]  # [cycles] lead of a divisor on the numerator at which its reciprocal costs no time


class Summand(NamedTuple):
    """A signed term of a sum: a value, or a product not yet multiplied out (factor is None for a value)."""

    negative: bool
    value: int
    factor: int | None


class _Rewriter:
    """Copies given values (the roots) of an old graph, and all values that they depend on, into a new graph, and regroups them.

    Some sums and products of the old graph are merged into their users, and have no value of their own in the new graph: a sum that
    only one other sum or difference uses, whose terms become terms of the other sum; a product that only sums use, which is fused
    with an addition in each; and a product that only one other product uses, whose factors become factors of the other product.

    Attributes:
        copies: value of the old graph -> the value of the new graph that corresponds to it.
        merged: values of the old graph that are merged into their users.
        shared_divisors: values of the old graph by which several values are divided.
    """

    def __init__(self, old: Graph, roots: list[int], new: Graph):
        """Copy and regroup the roots of the old graph, and all values that they depend on."""
        self.old, self.new = old, new
        self.copies: dict[int, int] = {}
        needed = [x for x in live(old, roots) if old.operation[x] != "neg"]
        users: dict[int, list[int]] = {x: [] for x in needed}
        for x in needed:
            for k in old.operands[x]:
                base, _ = self._strip(k)
                users[base].append(x)
        self.merged = {x for x in needed if self._can_merge(x, [old.operation[k] for k in users[x]])}
        self.merged -= {base for base, _ in map(self._strip, roots)}  # roots must keep values of their own
        divisors = Counter(old.operands[x][1] for x in needed if old.operation[x] == "div")
        self.shared_divisors = {x for x, count in divisors.items() if count > 1}
        for x in needed:
            if x not in self.merged:
                self.get(x)

    def _strip(self, x: int) -> tuple[int, bool]:
        """Return the operand of a negation of the old graph and True, or any other value unchanged and False."""
        return (self.old.operands[x][0], True) if self.old.operation[x] == "neg" else (x, False)

    def _can_merge(self, x: int, users: list[str]) -> bool:
        """Tell whether a value x of the old graph can be merged into the values that use it, whose operations are `users`."""
        operation, only_in_sums = self.old.operation[x], all(user in SUMS for user in users)
        if operation in SUMS:
            return len(users) == 1 and only_in_sums
        return operation == "mul" and bool(users) and (only_in_sums or users == ["mul"])

    def get(self, x: int) -> int:
        """Return the value of the new graph that corresponds to the value x of the old graph; write it first if necessary."""
        base, negative = self._strip(x)
        if base not in self.copies:
            self.copies[base] = self._write(base)
        return self.new.neg(self.copies[base]) if negative else self.copies[base]

    def _write(self, x: int) -> int:
        """Write the value x of the old graph, which is not a negation, into the new graph; return its index there."""
        operation, operands = self.old.operation[x], self.old.operands[x]
        if operation in SUMS:
            return self._add_terms(self._list_terms(x))
        if operation == "mul":
            return self.new.mul(*self._reduce_to_two(x))
        if operation == "div":
            numerator, denominator = map(self.get, operands)
            # a (1 / b) if several values are divided by b, or if 1 / b is ready before a, so that only a multiplication follows
            early = self.new.ready[numerator] > self.new.ready[denominator] + EARLIER
            if self.new.number(numerator) != 1 and (operands[1] in self.shared_divisors or early):
                return self.new.mul(numerator, self.new.div(self.new.const(1.0), denominator))
            return self.new.div(numerator, denominator)
        return self.new.make(operation, *map(self.get, operands), payload=self.old.payload[x])

    def _list_terms(self, x: int) -> list[Summand]:
        """Return the signed terms of the sum x of the old graph, as values of the new graph; merged sums are expanded."""
        terms, waiting = [], [(x, False)]  # waiting: old values, and whether each is subtracted
        while waiting:
            y, negative = waiting.pop()
            base, minus = self._strip(y)
            negative ^= minus
            operation, operands = self.old.operation[base], self.old.operands[base]
            if operation in SUMS and (base == x or base in self.merged):  # its terms are terms of x
                waiting += [(operands[0], negative), (operands[1], negative ^ (operation == "sub"))]
            elif base in self.merged:  # a product, which may be fused with the addition
                (a, minus_a), (b, minus_b) = map(self.new.split_sign, self._reduce_to_two(base))
                terms.append(Summand(negative ^ minus_a ^ minus_b, a, b))
            else:
                value, minus = self.new.split_sign(self.get(base))
                terms.append(Summand(negative ^ minus, value, None))
        return terms

    def _reduce_to_two(self, x: int) -> Pair:
        """Return two values of the new graph whose product equals the product x of the old graph.

        The factors that are ready first are multiplied first, until two factors are left, whose product the caller may fuse.
        """
        factors, waiting, ready = [], [x], self.new.ready
        while waiting:
            y = waiting.pop()
            if self.old.operation[y] == "mul" and (y == x or y in self.merged):
                waiting += self.old.operands[y]
            else:
                factors.append(self.get(y))
        heap = [(ready[f], f) for f in factors]
        heapq.heapify(heap)
        while len(heap) > 2:
            (_, first), (_, second) = heapq.heappop(heap), heapq.heappop(heap)
            product = self.new.mul(first, second)
            heapq.heappush(heap, (ready[product], product))
        (_, first), (_, second) = heap
        return first, second

    def _add_terms(self, terms: list[Summand]) -> int:
        """Return the value of the new graph that is the sum of terms, added two at a time, those that are ready earliest first."""
        heap = [(self._ready(term), n, term) for n, term in enumerate(terms)]
        heapq.heapify(heap)
        # of terms that are ready at the same time, the one with the smaller n is added first
        for n in range(len(heap), 2 * len(heap) - 1):
            term = self._add_two(heapq.heappop(heap)[2], heapq.heappop(heap)[2])
            heapq.heappush(heap, (self._ready(term), n, term))
        negative, value, factor = heap[0][2]
        total = value if factor is None else self.new.mul(value, factor)
        return self.new.neg(total) if negative else total

    def _ready(self, term: Summand) -> int:
        """Return the time [cycles] at which the value of a term, or both factors of a product, are ready."""
        return max(self.new.ready[k] for k in (term.value, term.factor) if k is not None)

    def _add_two(self, early: Summand, late: Summand) -> Summand:
        """Return the sum of two terms as one term; a product among them is computed by a fused multiply-add.

        `late` is the term that is ready later. If both terms are products, `early` is multiplied first, and `late` is fused with
        the addition.
        """
        g = self.new
        # if exactly one term is a product, let it be `late`, which can be fused with the addition
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


def rewrite(g: Graph, roots: list[int], into: Graph | None = None) -> tuple[Graph, dict[int, int]]:
    """Copy given values (the roots) of graph g, regrouped, into another graph; return that graph, and root -> its value there.

    The other graph is `into`, or a new one if `into` is None.
    """
    rewriter = _Rewriter(g, roots, Graph() if into is None else into)
    return rewriter.new, {x: rewriter.get(x) for x in roots}
