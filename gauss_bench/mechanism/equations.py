"""Constraint rows and generalised forces of a linkage, for numbers of any kind: the `Placement` chooses the kind.

A joint holds scalar coordinates at constant values. A driver makes one coordinate follow a law of time. A knife edge keeps the
speed across it (a `Slip`) at zero. A force is a law on a coordinate, or a vector at a point. The constraint row that holds a
coordinate x at the value c, a constant or a law of time, has

    phi = x - c,    J = dx/dq,    gamma = c'' - bias of x,    so that J a = gamma

The order of the rows is: joints in the file's order, couplings, drivers, knife edges. `Symbols` evaluates the equations once with
symbols in place of coordinates, and generates functions of t, q and v from them.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, assert_never

import numpy as np

from gauss_bench.mechanism.coordinates import Entry, columns, energy, loss, push, slip, state
from gauss_bench.mechanism.frames import Placement
from gauss_bench.mechanism.generated import GeneratedFunction, Number, Program, Symbol
from gauss_bench.mechanism.model import GROUND, Coordinate, Law, Load, Mechanism, PointForce
from gauss_bench.mechanism.motion_laws import Motion, MotionLaw
from gauss_bench.mechanism.spaces import Real, Vec, dot, slots, wedge
from gauss_bench.terms import Array

LEVELS = 3  # number of levels of a motion law: value, first and second time derivative


class ConstraintPlacement(Placement):
    """A placement that also provides the values at which joints hold coordinates, and the values of motion laws.

    These values have the placement's type of number: numbers of the file, parameters that stay symbols in a compiled program, or
    inputs of a program.
    """

    def held(self, joint: str, index: int, value: Any) -> Real:
        """Return the constant `value` at which a joint holds its coordinate number `index`, in this type of number."""
        return value

    def law(self, law: MotionLaw) -> Motion:
        """Return the value of a law and its first and second time derivative at the present time."""
        raise NotImplementedError


@dataclass(frozen=True, eq=False)
class Row:
    """One constraint row of a joint, coupling, driver or knife edge.

    Attributes:
        entries: entries of J that are not zero, by index in a state (n,).
        gamma: right-hand side of J a = gamma.
        phi: residual of the constraint on positions; None for a knife edge, which constrains velocities only.
        phi_t: partial derivative of the residual with respect to time.
    """

    name: str
    entries: dict[int, Real]
    gamma: Real
    phi: Real | None
    phi_t: Real


def rows(mechanism: Mechanism, placement: ConstraintPlacement, on_constraints: bool = False) -> Iterator[Row]:
    """Yield the constraint rows at the state `placement`: those of joints, couplings, drivers, knife edges, in this order.

    With `on_constraints`, the state must satisfy the constraints: a distance that a constraint prescribes needs no square root.
    """
    for joint in (*mechanism.joints, *mechanism.couplings):
        held: tuple[tuple[Coordinate, float], ...] = joint.held
        for index, (coordinate, value) in enumerate(held):
            at_rest = (placement.held(joint.name, index, value), 0.0, 0.0)  # value and both derivatives
            yield _row(joint.name, placement, coordinate, at_rest, on_constraints)
    for driver in mechanism.drivers:
        yield _row(driver.name, placement, driver.coordinate, placement.law(driver.law), on_constraints)
    for edge in mechanism.knife_edges:
        gradient, bias = slip(edge.coordinate, placement)
        yield Row(edge.name, columns((gradient,)), -bias, None, 0.0)


def _row(name: str, placement: ConstraintPlacement, coordinate: Coordinate, motion: Motion, on_constraints: bool) -> Row:
    """Return the row, called `name`, of the constraint that a coordinate follows a motion; `on_constraints` as in `rows`."""
    value, rate, second = motion
    x = state(coordinate, placement, value if on_constraints else None)
    return Row(name, entries=columns(x.entries), gamma=second - x.bias, phi=x.value - value, phi_t=-rate)


def generalise(placement: Placement, load: Load) -> dict[int, Real]:
    """Return the generalised force of one load at a state, as a dict: index in a state (n,) -> number."""
    match load:
        case Law():
            return columns(push(state(load.coordinate, placement), load, placement.arithmetic))
        case PointForce():
            force, end = placement.vector(load.frame, load.value).n, placement.end(load.point)
            return columns((Entry(end.frame, force, wedge(end.arm, force)),))  # wedge: moment about the centre of mass
        case _:
            assert_never(load)


def energies(placement: Placement, load: Load) -> tuple[Real, Real]:
    """Return the potential energy [J] of one load, and the power [W] of the part of it that has no potential."""
    match load:
        case Law():
            x = state(load.coordinate, placement)
            return energy(x, load, placement.arithmetic), -loss(x, load)
        case PointForce():
            force, end = placement.vector(load.frame, load.value).n, placement.end(load.point)
            if load.frame == GROUND:  # a force with a fixed direction has the potential -F . p
                return -dot(force, end.place), 0.0
            turning = end.frame.omega * wedge(end.arm, force)
            return 0.0, dot(force, end.frame.u) + turning
        case _:
            assert_never(load)


class Symbols(ConstraintPlacement):
    """A placement of bodies with n coordinates that are symbols; it records equations, and generates functions from them.

    The inputs of a recorded program are q0, q1, ..., v0, v1, ..., and g0, g1, ...: LEVELS numbers of each motion law.
    """

    def __init__(self, n: int):
        self.n, self.program = n, Program()
        self.arithmetic = self.program  # a program also has the functions sqrt, sin, ... for its symbols
        self.laws: list[MotionLaw] = []  # the motion laws whose values are inputs of the program so far

    def body(self, body: int) -> tuple[list[Symbol], list[Symbol]]:
        """Return symbols for x, y and angle of a body, and for their rates."""
        own = range(self.n)[slots(body)]
        return [self.program.input(f"q{k}") for k in own], [self.program.input(f"v{k}") for k in own]

    def numbers(self, value: Any) -> Vec:
        """Return a vector (2,) of the file as constants of the program."""
        return Vec(*map(self.program.symbol, value))

    def held(self, joint: str, index: int, value: Any) -> Symbol:
        """Return the value at which a joint holds a coordinate, as a constant of the program."""
        return self.program.symbol(value)

    def law(self, law: MotionLaw) -> tuple[Symbol, Symbol, Symbol]:
        """Return three new inputs of the program: value, first and second time derivative of a law."""
        first = LEVELS * len(self.laws)
        self.laws.append(law)
        return self.program.input(f"g{first}"), self.program.input(f"g{first + 1}"), self.program.input(f"g{first + 2}")

    def generate(self, *groups: Sequence[Symbol | Number]) -> Callable[[float | Array, Array, Array], list[Array]]:
        """Generate a function of t (...), q and v (..., n) that returns each group of k symbols as an array (..., k).

        The function itself evaluates the motion laws at t.
        """
        inputs = [("q", self.n), ("v", self.n), ("g", LEVELS * len(self.laws))]
        function = GeneratedFunction(self.program, inputs, [[self.program.symbol(x) for x in group] for group in groups])
        laws = self.laws

        def evaluate(t: float | Array, q: Array, v: Array) -> list[Array]:
            if not laws:
                return function(q, v, q[..., :0])  # an array (..., 0) in place of the values of motion laws
            levels = [np.asarray(x) for law in laws for x in law(t)]
            return function(q, v, np.stack([np.broadcast_to(x, q.shape[:-1]) for x in levels], axis=-1))

        return evaluate
