"""A mechanism with symbols in the place of its coordinates: what its equations are asked with once, to be written out.

The inputs of what is written are q and v (n,), and g, what laws of time give: value, rate and second rate of each, in the order in
which the equations ask for them.
"""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from gauss_bench.mechanism.equations import Given
from gauss_bench.mechanism.motion_laws import MotionLaw
from gauss_bench.mechanism.spaces import Vec, slots
from gauss_bench.mechanism.written import Number, Program, Symbol, Written
from gauss_bench.terms import Array

LEVELS = 3  # of a law: value, rate and second rate


class Symbols(Given):
    """The bodies of a mechanism of n coordinates; a `Given` of `equations.py`."""

    def __init__(self, n: int):
        self.n, self.program = n, Program()
        self.arithmetic = self.program
        self.laws: list[MotionLaw] = []

    def body(self, body: int) -> tuple[list[Symbol], list[Symbol]]:
        q, v = ([self.program.input(f"{name}{k}") for k in range(self.n)[slots(body)]] for name in "qv")
        return q, v

    def numbers(self, value: Any) -> Vec:
        return Vec(*map(self.program.symbol, value))

    def held(self, joint: str, place: int, value: Any) -> Symbol:
        return self.program.symbol(value)

    def law(self, law: MotionLaw) -> tuple[Symbol, Symbol, Symbol]:
        self.laws.append(law)
        x, rate, second = (self.program.input(f"g{k}") for k in range(LEVELS * len(self.laws))[-LEVELS:])
        return x, rate, second

    def written(self, *told: Sequence[Symbol | Number]) -> Callable[[float | Array, Array, Array], list[Array]]:
        """A function of t (...), q and v (..., n): each group of symbols as an array (..., k)."""
        inputs = [("q", self.n), ("v", self.n), ("g", LEVELS * len(self.laws))]
        function, laws = Written(self.program, inputs, [[self.program.symbol(x) for x in group] for group in told]), self.laws

        def at(t: float | Array, q: Array, v: Array) -> list[Array]:
            if not laws:
                return function(q, v, q[..., :0])
            now = [np.asarray(x) for law in laws for x in law(t)]
            return function(q, v, np.stack([np.broadcast_to(x, q.shape[:-1]) for x in now], axis=-1))

        return at
