"""Constraint residual, Jacobian and acceleration bias of a linkage in absolute coordinates: `equations.rows`, written out.

All functions take one state, q (n,), or a batch, q (..., n), in double or in the longer type the linkage was built in.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from gauss_bench.mechanism import equations
from gauss_bench.mechanism.model import Mechanism
from gauss_bench.mechanism.symbols import Symbols
from gauss_bench.mechanism.written import Symbol
from gauss_bench.terms import Array


@dataclass(frozen=True)
class Rows:
    """All constraint rows at a state (or batch): joints two each, then driver, then knife edges."""

    phi: Array
    J: Array
    gamma: Array
    phi_t: Array


class Constraints:
    """The constraint rows of one mechanism, with every index worked out once.

    Attributes:
        m: rows; joint_rows: of joints, which stand first; holonomic: those that have a position level.
        laws: of drivers.
    """

    def __init__(self, mechanism: Mechanism):
        self.mechanism, self.n = mechanism, mechanism.n
        at = Symbols(mechanism.n)
        every = list(equations.rows(mechanism, at))
        self.m, self.laws = len(every), at.laws
        self.holonomic = self.m - len(mechanism.knife_edges)
        self.joint_rows = self.holonomic - len(mechanism.drivers)
        self.template = np.zeros((self.m, self.n), dtype=mechanism.gravity.dtype)
        places = []
        for place, x in _entries(every, at):
            if x.number is None:
                places.append(place[0] * self.n + place[1])
            else:
                self.template[place] = x.number
        self.places = np.array(places, dtype=int)

    @cached_property
    def _written(self) -> Callable[..., list[Array]]:
        at = Symbols(self.n)
        return at.written(*self.asked(at))

    def asked(self, at: Symbols) -> tuple[list[Symbol], ...]:
        """Entries of J that vary, gamma, phi and phi_t as symbols, to be written out with others."""
        return _groups(list(equations.rows(self.mechanism, at)), at)

    def __call__(self, t: float | Array, q: Array, v: Array) -> Rows:
        """Residual, Jacobian, bias and explicit rate of all rows at state(s) q, v (..., n) and time(s) t [s]."""
        entries, gamma, phi, phi_t = self._written(t, q, v)
        return Rows(phi, self.filled(entries), gamma, phi_t)

    def filled(self, entries: Array) -> Array:
        """J (..., m, n) with the entries (..., k) that vary."""
        J = np.empty((*entries.shape[:-1], self.m * self.n), dtype=np.result_type(entries, self.template))
        J[...] = self.template.ravel()
        J[..., self.places] = entries
        return J.reshape(*entries.shape[:-1], self.m, self.n)


def _entries(every: list[equations.Row], at: Symbols) -> Iterator[tuple[tuple[int, int], Symbol]]:
    """Row, column and symbol of every entry of J."""
    return (((i, k), at.program.symbol(x)) for i, row in enumerate(every) for k, x in row.entries.items())


def _groups(every: list[equations.Row], at: Symbols) -> tuple[list[Symbol], ...]:
    symbol = at.program.symbol
    phi = [symbol(0.0 if row.phi is None else row.phi) for row in every]
    varying = [x for _, x in _entries(every, at) if x.number is None]
    return varying, [symbol(row.gamma) for row in every], phi, [symbol(row.phi_t) for row in every]
