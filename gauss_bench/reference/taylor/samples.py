"""States in loop coordinates as samples of a motion in absolute coordinates, with joint forces and residuals."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from gauss_bench.mechanism.numbers import Number
from gauss_bench.reference.motion import Motion
from gauss_bench.reference.taylor.arithmetic import Value
from gauss_bench.reference.taylor.forces import Loads
from gauss_bench.reference.taylor.joint_forces import joint_forces, reactions
from gauss_bench.reference.taylor.moving_vectors import Instant, Vectors, at_states
from gauss_bench.reference.taylor.rows import LoopRows
from gauss_bench.reference.taylor.solve import Long, epsilon, multiply, split_columns, stack_arrays
from gauss_bench.reference.taylor.vector_sums import NONE, LoopCoordinates

BALANCE = 1e-25  # largest relative residual of the equations of motion in 128 bit; in proportion to the rounding of other numbers
ROUNDING = 2.0**-112  # relative rounding of numbers with 128 bit


class Inconsistent(ArithmeticError):
    """Loops have opened or forces do not balance: the motion cannot be used."""


@dataclass(frozen=True, eq=False)
class LoopStates:
    """Loop coordinates x and their rates v, a (k, n) at times t (k,), all in one type of number."""

    t: Long
    x: Long
    v: Long
    a: Long


def join(parts: Sequence[LoopStates]) -> LoopStates:
    """Return the states of all parts, one after the other."""
    return LoopStates(*(np.concatenate([getattr(p, name) for p in parts]) for name in ("t", "x", "v", "a")))


def _absolute(coordinates: LoopCoordinates, at: Instant, vectors: Vectors, angles: Mapping[int, Value], zero: Long) -> Long:
    """Return absolute coordinates (k, n) of all links, or their time derivatives if `vectors` and `angles` are derivatives.

    Args:
        coordinates: the loop coordinates; at: their values at k states.
        vectors: key -> vector l e of `moving_vectors`, or a derivative of it; centres of mass are sums of such vectors.
        angles: loop coordinate -> its value, or a derivative of it, for the angles of the links.
        zero: (k,) zeros in the type of number of the states.
    """
    values: list[Value] = []
    for centre, index in zip(coordinates.centres, coordinates.angle, strict=True):
        values += [*at.combine(centre, vectors), 0 if index == NONE else angles.get(index, 0)]
    return stack_arrays(values, zero)


def sample(
    rows: LoopRows, states: LoopStates, times: Sequence[str], redundant: int, stopped: str, method: str, number: Number
) -> Motion:
    """Return a motion in absolute coordinates with joint forces, given states in loop coordinates; check its residuals.

    Args:
        rows: the constraint rows of the linkage.
        states: loop coordinates x and their time derivatives v, a at k times.
        times: these times as decimal texts [s].
        redundant: number of redundant constraint rows.
        stopped: the reason why the motion ends early, or empty; method: the method in words.
        number: type of number of the states.

    Raises:
        Inconsistent: residuals of the loops or of the equations of motion are larger than rounding errors.
    """
    coordinates, eps = rows.coordinates, epsilon(number)
    mechanism = coordinates.mechanism
    # positions, velocities and accelerations of the links
    at = at_states(states.x)
    v, a = (dict(enumerate(split_columns(x))) for x in (states.v, states.a))
    zero = states.t - states.t  # (k,) in the type of number of the states
    q = _absolute(coordinates, at, at, dict(enumerate(at.x)), zero)
    for i, turn in enumerate(coordinates.turn):  # constant angles between links that share an angle coordinate
        q[:, 3 * i + 2] = q[:, 3 * i + 2] + turn
    linear, bias = at.variation(a), at.bias(v)  # the parts of second derivatives that depend on x'', and that do not
    velocity = _absolute(coordinates, at, at.variation(v), v, zero)
    acceleration = _absolute(coordinates, at, linear, a, zero) + _absolute(coordinates, at, bias, {}, zero)
    # residuals of the loops, then joint forces and the residual of the equations of motion
    Q = stack_arrays(Loads(coordinates, at, v).flat(), zero)
    drift = residuals(rows, states, at)  # of positions, and of velocities
    fastest = float(np.abs(states.v).astype(float).max(initial=0.0))
    # the residuals are usually a thousand roundings, but 1e-12 if decimals of the file contradict each other
    if not max(drift[0], drift[1] / (1.0 + fastest)) < eps**0.5:
        raise Inconsistent(f"the loops come open by {drift[0]:.1e} m or rad, their rates by {drift[1]:.1e} per second")
    multipliers, imbalance = joint_forces(reactions(coordinates, at), Q - mechanism.mass * acceleration, redundant, eps)
    if not imbalance < BALANCE / ROUNDING * eps:  # BALANCE holds for 128 bit; it is scaled to the rounding of this type
        raise Inconsistent(f"the equations of motion are met only to {imbalance:.1e} of the joint forces")
    return Motion(tuple(times), q, velocity, acceleration, None if redundant else multipliers, drift, stopped, method)


def residuals(rows: LoopRows, states: LoopStates, at: Instant) -> tuple[float, float]:
    """Return the largest residual of positions and that of velocities, over all states and constraint rows.

    Redundant rows are included. `at` has the vectors l e of `moving_vectors` at the states.
    """
    laws = rows.laws(states.t)
    zero = states.t - states.t  # (k,) in the type of number of the states
    position = stack_arrays([*rows.residuals(at, laws), *rows.coordinates.turn_gaps], zero)
    rate = multiply(rows.entries(at), states.v) - stack_arrays(rows.rates(laws), zero)
    off, rate_off = (float(np.abs(x).astype(float).max(initial=0.0)) for x in (position, rate))
    return off, rate_off
