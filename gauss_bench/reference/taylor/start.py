"""The start of a motion to the last digit: loop coordinates and rates that obey the rows and the decimals of the file.

The assembly in double precision is the first guess; angles, slides, points and drivers are then held at exactly what is written.
"""

from collections.abc import Sequence
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from gauss_bench.mechanism.model import Mechanism
from gauss_bench.mechanism.numbers import Number, angle_of, exact, pair, radians
from gauss_bench.reference.taylor.arithmetic import NUMBERS, Value
from gauss_bench.reference.taylor.moving_vectors import Instant
from gauss_bench.reference.taylor.rows import LoopRows
from gauss_bench.reference.taylor.solve import Long, apply, columns, correct, dense, epsilon, pseudo_inverse, stack_arrays
from gauss_bench.reference.taylor.vector_sums import NONE, Sum
from gauss_bench.terms import Array


class Held(NamedTuple):
    """A coordinate (plus a constant) or a point that starts at a target, with a rate: one value each, or two."""

    coordinate: int
    turn: Any
    point: Sum
    target: tuple[Any, ...]
    rate: tuple[Any, ...]

    def entries(self, at: Instant) -> list[dict[int, Value]]:
        if self.point:
            gradient = at.gradient(self.point)
            return [{j: g[axis] for j, g in gradient.items()} for axis in (0, 1)]
        return [{} if self.coordinate == NONE else {self.coordinate: 1}]

    def residual(self, at: Instant) -> list[Value]:
        here = (
            at.combined(self.point, at) if self.point else ((0 if self.coordinate == NONE else at.x[self.coordinate]) + self.turn,)
        )
        return [x - target for x, target in zip(here, self.target, strict=True)]


def hold_start(rows: LoopRows, scenario: dict[str, Any], number: Number) -> list[Held]:
    """The coordinates that the start of a scenario holds, besides its drivers."""
    coordinates, start = rows.coordinates, scenario.get("start", {})
    mechanism = coordinates.mechanism
    holds = []
    for link, (target, rate) in _list_held_angles(mechanism, start, number).items():
        holds.append(Held(coordinates.angle[link], coordinates.turn[link], (), (target,), (rate,)))
    for name, target in start.get("slides", {}).items():
        rate = exact(number, start.get("slide_speeds", {}).get(name, 0))
        holds.append(Held(coordinates.slides[name], number("0"), (), (exact(number, target),), (rate,)))
    for reference, target in start.get("points", {}).items():
        point = coordinates.point(mechanism.named_point(reference))
        rate = start.get("point_velocities", {}).get(reference, (0, 0))
        holds.append(Held(NONE, 0, point, tuple(pair(number, target)), tuple(pair(number, rate))))
    return holds


def _list_held_angles(mechanism: Mechanism, start: dict[str, Any], number: Number) -> dict[int, tuple[Any, Any]]:
    """Link -> angle [rad] and speed [rad/s]; `crank` and `speed` are those of the crank."""
    angles = {name: radians(number, x) for name, x in start.get("angles_deg", {}).items()}
    angles |= {name: exact(number, x) for name, x in start.get("angles", {}).items()}
    speeds = {name: exact(number, x) for name, x in start.get("speeds", {}).items()}
    if mechanism.crank is not None:
        crank = mechanism.links[mechanism.crank].name
        if "crank" in start or "crank_deg" in start:
            angles[crank] = angle_of(start, "crank", number)
        if "speed" in start:
            speeds.setdefault(crank, exact(number, start["speed"]))
    held = {}
    for name, x in angles.items():
        link, turn = mechanism.placed(name)
        held[link] = x - turn, speeds.get(name, number("0"))
    return held


def start_state(rows: LoopRows, scenario: dict[str, Any], guess: Array, number: Number) -> tuple[Long, Long]:
    """Coordinates and rates (1, n) at t = 0, from a guess (n,) in double precision.

    Raises:
        Unsolved: the rows and the held values cannot be met together near the guess.
    """
    n, eps = rows.coordinates.n, epsilon(number)
    holds = hold_start(rows, scenario, number)
    laws = [driver.law(number("0")) for driver in rows.coordinates.mechanism.drivers]
    x = np.array([[exact(number, value) for value in guess.tolist()]]).reshape(1, n)
    like = np.array([number("0")])

    def entries(x: Long, holds: Sequence[Held]) -> list[dict[int, Value]]:
        at = Instant(columns(x), NUMBERS)
        return [*rows.entries(at), *(row for hold in holds for row in hold.entries(at))]

    def residual(holds: Sequence[Held], x: Long) -> Long:
        at = Instant(columns(x), NUMBERS)
        residuals = [*rows.residuals(at, laws), *(0 for _ in rows.edges), *(y for hold in holds for y in hold.residual(at))]
        return stack_arrays(residuals, like)

    for group in (holds, []):  # what is held may contradict the loops in its last digits; the loops must close to the last
        P = pseudo_inverse(dense(entries(x, group), 1, n))
        x = correct(partial(residual, group), P, x, eps)
    A = entries(x, holds)
    rates = stack_arrays([*rows.rates(laws), *(y for hold in holds for y in hold.rate)], like)
    P = pseudo_inverse(dense(A, 1, n))
    return x, correct(lambda v: apply(A, v) - rates, P, np.zeros((1, n), dtype=like.dtype), eps)
