"""The terms of a linkage at one state as a straight line of Python: what the equations come to, written out once and compiled.

The equations are asked once with symbols in the place of numbers; every operation on them is kept, equal ones once, zeros and ones
not at all. What is left is a function of floats without a loop, an index or an array, a tenth as long on its way as arrays are.
"""

import math
from collections.abc import Callable, Iterable, Sequence
from typing import Any

import numpy as np

from gauss_bench.mechanism.equations import generalised, rows
from gauss_bench.mechanism.frames import Direction, End, Frame
from gauss_bench.mechanism.model import GROUND, Mechanism, Point, factor_of, loads
from gauss_bench.mechanism.coordinates import unit
from gauss_bench.mechanism.motion_laws import MotionLaw
from gauss_bench.mechanism.spaces import PLANE, Vec
from gauss_bench.terms import Array, Terms


class Symbol:
    """A number that is not known yet: a name in the program, or a constant."""

    __slots__ = ("number", "program", "text")

    def __init__(self, program: "Program", text: str, number: float | None = None):
        self.program, self.text, self.number = program, text, number

    @property
    def zero(self) -> bool:
        return self.number == 0.0

    def __add__(self, other: "Symbol | float") -> "Symbol":
        return self.program.added(self, other)

    __radd__ = __add__

    def __sub__(self, other: "Symbol | float") -> "Symbol":
        return self.program.subtracted(self, other)

    def __rsub__(self, other: float) -> "Symbol":
        return self.program.subtracted(other, self)

    def __mul__(self, other: "Symbol | float") -> "Symbol":
        return self.program.multiplied(self, other)

    __rmul__ = __mul__

    def __neg__(self) -> "Symbol":
        return self.program.negated(self)


class Program:
    """Lines of Python in the order in which they are needed, each value once."""

    def __init__(self) -> None:
        self.lines: list[str] = []
        self.known: dict[str, Symbol] = {}

    def symbol(self, x: Symbol | float) -> Symbol:
        return x if isinstance(x, Symbol) else Symbol(self, repr(float(x)), float(x))

    def input(self, text: str) -> Symbol:
        return self.known.setdefault(text, Symbol(self, text))

    def added(self, a: Symbol | float, b: Symbol | float) -> Symbol:
        a, b = self.symbol(a), self.symbol(b)
        if a.number is not None and b.number is not None:
            return self.symbol(a.number + b.number)
        if a.zero or b.zero:
            return b if a.zero else a
        return self.kept(f"{a.text} + {b.text}")

    def subtracted(self, a: Symbol | float, b: Symbol | float) -> Symbol:
        a, b = self.symbol(a), self.symbol(b)
        if a.number is not None and b.number is not None:
            return self.symbol(a.number - b.number)
        if b.zero:
            return a
        return self.negated(b) if a.zero else self.kept(f"{a.text} - {b.text}")

    def multiplied(self, a: Symbol | float, b: Symbol | float) -> Symbol:
        a, b = self.symbol(a), self.symbol(b)
        if a.number is not None and b.number is not None:
            return self.symbol(a.number * b.number)
        for one, other in ((a, b), (b, a)):
            if one.number is not None and abs(one.number) in (0.0, 1.0):
                return self.symbol(0.0) if one.zero else other if one.number > 0 else self.negated(other)
        return self.kept(f"{a.text} * {b.text}")

    def negated(self, a: Symbol) -> Symbol:
        return self.symbol(-a.number) if a.number is not None else self.kept(f"-{a.text}")

    def sqrt(self, a: Symbol | float) -> Symbol:
        return self._function("sqrt", math.sqrt, a)

    def sin(self, a: Symbol | float) -> Symbol:
        return self._function("sin", math.sin, a)

    def cos(self, a: Symbol | float) -> Symbol:
        return self._function("cos", math.cos, a)

    def inverse(self, a: Symbol | float) -> Symbol:
        a = self.symbol(a)
        return self.symbol(1.0 / a.number) if a.number else self.kept(f"1.0 / {a.text}")

    def _function(self, name: str, function: Callable[[float], float], a: Symbol | float) -> Symbol:
        a = self.symbol(a)
        return self.symbol(function(a.number)) if a.number is not None else self.kept(f"{name}({a.text})")

    def kept(self, text: str) -> Symbol:
        if text not in self.known:
            name = f"x{len(self.lines)}"
            self.lines.append(f"{name} = {text}")
            self.known[text] = Symbol(self, name)
        return self.known[text]


class Symbols:
    """The bodies of a mechanism with symbols in the place of their coordinates."""

    space = PLANE

    def __init__(self, program: Program, mechanism: Mechanism):
        self.arithmetic, self.mechanism = program, mechanism
        self.frames: dict[int, Frame] = {}
        self.ends: dict[int, End] = {}
        self.laws: list[MotionLaw] = []

    def frame(self, body: int) -> Frame:
        if body not in self.frames:
            self.frames[body] = self._frame(body)
        return self.frames[body]

    def _frame(self, body: int) -> Frame:
        if body == GROUND:
            none = self.arithmetic.symbol(0.0)
            return Frame(body, Vec(none, none), Vec(none, none), none, none, True)
        (x, y, angle), (u, w, omega) = ([self.arithmetic.input(f"{name}{3 * body + k}") for k in range(3)] for name in "qv")
        return Frame(body, Vec(x, y), Vec(u, w), omega, angle)

    def _turned(self, frame: Frame, s: Vec) -> Vec:
        return s if frame.rests else PLANE.turned(Vec(self.arithmetic.cos(frame.angle), self.arithmetic.sin(frame.angle)), s)

    def end(self, point: Point) -> End:
        if id(point) not in self.ends:
            frame = self.frame(point.link)
            self.ends[id(point)] = End(frame, self._turned(frame, Vec(*map(float, point.local))))
        return self.ends[id(point)]

    def direction(self, body: int, angle: float, across: bool = False) -> Direction:
        return self.vector(body, unit(angle, across))

    def vector(self, body: int, value: Sequence[float]) -> Direction:
        frame = self.frame(body)
        return Direction(frame, self._turned(frame, Vec(*(self.arithmetic.symbol(x) for x in value))))

    def held(self, joint: str, place: int, value: Any) -> Symbol:
        return self.arithmetic.symbol(value)

    def law(self, law: MotionLaw) -> tuple[Symbol, Symbol, Symbol]:
        self.laws.append(law)
        first = 3 * (len(self.laws) - 1)
        x, rate, second = (self.arithmetic.input(f"g{first + k}") for k in range(3))
        return x, rate, second


class StraightTerms:
    """M, J, Q, gamma and the residuals of a mechanism, one state at a time; forces that vary are left to whoever calls."""

    def __init__(self, mechanism: Mechanism):
        program = Program()
        at, zero = Symbols(program, mechanism), program.symbol(0.0)
        every = list(rows(mechanism, at))
        forces = [[zero] for _ in range(mechanism.n)]
        for i, link in enumerate(mechanism.links):
            for axis in range(2):
                forces[3 * i + axis].append(program.symbol(link.mass * mechanism.gravity[axis]))
        for load in loads(f for f in mechanism.forces if not factor_of(f)):
            for k, x in generalised(at, load).items():
                forces[k].append(program.symbol(x))
        Q = [sum(terms[1:], start=terms[0]) for terms in forces]
        entries = {(i, k): program.symbol(x) for i, row in enumerate(every) for k, x in row.entries.items()}
        self.n, self.m, self.laws = mechanism.n, len(every), at.laws
        self.J = np.zeros((self.m, self.n))
        for place, x in entries.items():
            self.J[place] = x.number or 0.0
        varying = {place: x for place, x in entries.items() if x.number is None}
        self.places = np.array([i * self.n + k for i, k in varying], dtype=int)
        residuals = [zero if row.phi is None else program.symbol(row.phi) for row in every]
        told = [varying.values(), Q, [program.symbol(row.gamma) for row in every], residuals, [program.symbol(r.phi_t) for r in every]]
        self.source = _written(program, self.n, 3 * len(self.laws), told)
        names = {"sin": math.sin, "cos": math.cos, "sqrt": math.sqrt}
        exec(self.source, names)
        self.function: Callable[..., tuple[tuple[float, ...], ...]] = names["terms"]  # type: ignore[assignment]
        self.M = np.diag(mechanism.mass)

    def __call__(self, t: float, q: Array, v: Array) -> Terms:
        given = [float(x) for law in self.laws for x in law(t)]
        entries, Q, gamma, phi, phi_t = self.function(q.tolist(), v.tolist(), given)
        J = self.J.copy()
        J.ravel()[self.places] = entries
        return Terms(self.M, J, np.array(Q), np.array(gamma), np.array(phi), J @ v + np.array(phi_t))


def _written(program: Program, n: int, given: int, told: Sequence[Iterable[Symbol]]) -> str:
    """The program as the text of a function of q, v (n,) and what laws of time give."""
    inputs = [f"{', '.join(f'{name}{k}' for k in range(count))}, = {name}" for name, count in (("q", n), ("v", n), ("g", given)) if count]
    groups = [f"({''.join(f'{x.text}, ' for x in some)})" for some in told]
    return "\n    ".join(["def terms(q, v, g):", *inputs, *program.lines, f"return {', '.join(groups)}"])
