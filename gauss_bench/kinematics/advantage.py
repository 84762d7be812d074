"""How a linkage of one degree of freedom passes motion and force on: velocity ratios, and the mechanical advantage.

With x the free motion and g_in, g_out the gradients of two coordinates, the one moves g_out . x / g_in . x as fast as the other;
and without losses and weights the power that comes in goes out, so that a force on the one balances

    F_in / F_out = d out / d in,        advantage  F_out / F_in = d in / d out

with forces or torques as the coordinates are lengths or angles. Where what is driven stands still (a toggle, a dead centre of the
output) the advantage is infinite; where the input does (a limit of its motion) it is zero.
"""

from dataclasses import dataclass

import numpy as np

from gauss_bench.kinematics.centres import free_motion
from gauss_bench.kinematics.singular import driving_coordinates, input_coordinate
from gauss_bench.mechanism.coordinates import gradient
from gauss_bench.mechanism.model import Measured, Mechanism
from gauss_bench.terms import Array

STILL = 1e-12  # of the other rate, both in units of the free motion: what rounding leaves of none


@dataclass(frozen=True, eq=False)
class Advantage:
    """What an input gives at an output, at k positions.

    Attributes:
        input, output: names of links (angles) or slides.
        units: "rad" or "m" of input and output.
        velocity: (k,) d output / d input, infinite at a limit of the input.
        mechanical: (k,) force or torque at the output for one at the input, infinite where the output stands still.
    """

    input: str
    output: str
    units: tuple[str, str]
    velocity: Array
    mechanical: Array


def advantages(mechanism: Mechanism, positions: Array, driving: Measured | None = None) -> tuple[Advantage, ...]:
    """The ratios from what drives to every other link or slide on the ground, at positions (k, n).

    What drives is the first driver of the scenario, else the crank, else the measured coordinate.

    Raises:
        ValueError: the linkage has more or less than one degree of freedom.
    """
    given = driving or _driving(mechanism)
    outputs = [x for x in driving_coordinates(mechanism) if x.name != given.name]
    rates = np.zeros((len(positions), 1 + len(outputs)))
    for k, q in enumerate(positions):
        x = free_motion(mechanism, q)
        rates[k] = [gradient(c.coordinate, q) @ x for c in (given, *outputs)]
    told = []
    for output, rate in zip(outputs, rates[:, 1:].T, strict=True):
        units = (given.unit, output.unit)
        told.append(Advantage(given.name, output.name, units, _ratio(rate, rates[:, 0]), _ratio(rates[:, 0], rate)))
    return tuple(told)


def _driving(mechanism: Mechanism) -> Measured:
    if not mechanism.drivers:
        return input_coordinate(mechanism)
    first = mechanism.drivers[0]
    return Measured(first.name, first.coordinate)


def _ratio(a: Array, b: Array) -> Array:
    still = np.abs(b) <= STILL * np.abs(a)
    return np.where(still, np.inf, a / np.where(still, 1.0, b))
