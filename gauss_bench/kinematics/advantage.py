"""Velocity ratios and mechanical advantage of a linkage with one degree of freedom.

With the free motion x (n,) of the linkage and the gradients g_in, g_out (n,) of two coordinates, the ratio of their rates is

    d out / d in = (g_out . x) / (g_in . x) = F_in / F_out,

because without losses and weights the power that enters at the input leaves at the output. The mechanical advantage F_out / F_in is
infinite where the output is at rest (at a toggle, a dead centre), and zero where the input is at rest (at a limit of its motion).
"""

from dataclasses import dataclass

import numpy as np

from gauss_bench.kinematics.centres import free_motion
from gauss_bench.kinematics.singular import driving_coordinates, input_coordinate
from gauss_bench.mechanism.coordinates import gradient
from gauss_bench.mechanism.model import Measured, Mechanism
from gauss_bench.terms import Array

STILL = 1e-12  # a rate below this share of the other one is a zero that rounding has changed


@dataclass(frozen=True, eq=False)
class Advantage:
    """Velocity ratio and mechanical advantage between one input and one output at k positions.

    Attributes:
        input, output: names of links (for their angles) or slides; units: "rad" or "m" of each.
        velocity: (k,) d output / d input; infinite at a limit of the input.
        mechanical: (k,) force or torque at the output over that at the input; infinite where the output stands still.
    """

    input: str
    output: str
    units: tuple[str, str]
    velocity: Array
    mechanical: Array


def advantages(mechanism: Mechanism, positions: Array) -> tuple[Advantage, ...]:
    """Return the `Advantage` between the input and every other link or slide on the ground, at positions (k, n).

    The input is the first driver of the scenario, else the crank, else the measured coordinate.

    Raises:
        ValueError: the linkage has more or less than one degree of freedom.
    """
    given = input_coordinate(mechanism)
    if mechanism.drivers:
        given = Measured(mechanism.drivers[0].name, mechanism.drivers[0].coordinate)
    outputs = [x for x in driving_coordinates(mechanism) if x.name != given.name]
    rates = np.zeros((len(positions), 1 + len(outputs)))  # of the input, then of the outputs
    for k, q in enumerate(positions):
        x = free_motion(mechanism, q)
        rates[k] = [gradient(c.coordinate, q) @ x for c in (given, *outputs)]
    ratios = []
    for output, rate in zip(outputs, rates[:, 1:].T, strict=True):
        velocity, mechanical = _divide(rate, rates[:, 0]), _divide(rates[:, 0], rate)
        ratios.append(Advantage(given.name, output.name, (given.unit, output.unit), velocity, mechanical))
    return tuple(ratios)


def _divide(a: Array, b: Array) -> Array:
    """Return a / b, and infinity where b is zero up to rounding."""
    still = np.abs(b) <= STILL * np.abs(a)
    return np.where(still, np.inf, a / np.where(still, 1.0, b))
