"""The example of Yuan & Ge (2016), section 4, in the paper's own seven coordinates, with its misprints corrected.

    q = [x1, y1, theta1, x2, y2, theta2, x3]: centres of mass and angles of crank and rod, position of the slider

The paper leaves out the slider's height and angle, which the linkage file `crank_slider` keeps. The accelerations of `states` are
computed from that file in the crank angle alone, independently of the equations here. Most functions also take complex numbers, for
derivatives by the complex-step method.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gauss_bench.linkage.load import load
from gauss_bench.mechanism.evaluate import Evaluator
from gauss_bench.mechanism.model import Mechanism
from gauss_bench.reference.build import random_states
from gauss_bench.reference.minimal import MinimalCoordinate
from gauss_bench.terms import Array

Number = NDArray[Any]

KEPT = (0, 1, 2, 3, 4, 5, 6)  # indices of the paper's coordinates in the linkage file, which also has the slider's y and theta
TINY = 1e-30  # imaginary step of the complex-step method: its square underflows and nothing cancels
M1, M2, M3 = 0.37, 0.77, 0.1  # [kg]
L1, L2 = 0.15, 0.56  # [m]
STIFFNESS, DAMPING, TORQUE = 5.0, 1.0, -0.5  # [N/m], [N s/m], [N m]
I1, I2 = M1 * L1**2 / 12, M2 * L2**2 / 12  # [kg m^2] not given in the paper: uniform bars are assumed
GRAVITY = 9.81  # [m/s^2] not given in the paper


@dataclass(frozen=True, eq=False)
class ExampleState:
    """The state of the crank-slider at one instant: q, v, a and the applied force Q, each (7,) in the paper's coordinates."""

    q: Array
    v: Array
    a: Array
    Q: Array


@cache
def linkage() -> Mechanism:
    """Load the linkage file in the paper's scenario."""
    return load("crank_slider", "paper")


@cache
def states(count: int = 24) -> tuple[ExampleState, ...]:
    """Return the start of the example and `count` random states (fixed seed, speeds up to 30 rad/s) with true accelerations."""
    mechanism, kept = linkage(), list(KEPT)
    applied = Evaluator(mechanism).applied
    random, crank = random_states(mechanism, count), MinimalCoordinate(mechanism)
    start = crank.free_state(mechanism.q0[[crank.crank]], mechanism.v0[[crank.crank]])
    rows = [*zip(*start, strict=True), *zip(random.q, random.v, random.a, strict=True)]  # q, v, a of each state
    return tuple(ExampleState(q[kept], v[kept], a[kept], applied.generalised(q, v)[kept]) for q, v, a in rows)


def moving_states() -> tuple[ExampleState, ...]:
    """Return all states except the start, which is at rest."""
    return states()[1:]


def derivative(function: Callable[[Any], Number], x: Array | float, direction: Array | float) -> Array:
    """Return the derivative of a function at x along a direction, d/dt function(x + t direction) at t = 0, exact to rounding.

    Complex-step method: f'(x) d = Im f(x + i h d) / h, which subtracts nothing, so that h can be as small as TINY.
    """
    return np.asarray(function(x + 1j * TINY * direction).imag / TINY)


def gradient(function: Callable[[Any], Number], x: Array) -> Array:
    """Return the derivatives (..., n) of a function of x (n,), exact to rounding."""
    return np.stack([derivative(function, x, unit) for unit in np.eye(len(x))], axis=-1)


def residual(q: Number) -> Number:
    """Return the constraints (6,) of eq. (21): crank on its pin, rod on the crank, slider on the rod and in its guide."""
    x1, y1, t1, x2, y2, t2, x3 = q
    crank, rod = (L1 * np.cos(t1), L1 * np.sin(t1)), (L2 * np.cos(t2), L2 * np.sin(t2))
    pins = [x1 - crank[0] / 2, y1 - crank[1] / 2, crank[0] - x2 + rod[0] / 2, crank[1] - y2 + rod[1] / 2]
    return np.array([*pins, x2 + rod[0] / 2 - x3, y2 + rod[1] / 2])


def jacobian(q: Number) -> Number:
    """Return the Jacobian (6, 7) of `residual` by q, eq. (22), with entry (6, 6) corrected: the paper prints a sine."""
    # the sines and cosines are multiplied by the length of the crank, and by half that of the rod
    s1, c1 = L1 * np.sin(q[2]), L1 * np.cos(q[2])
    s2, c2 = L2 / 2 * np.sin(q[5]), L2 / 2 * np.cos(q[5])
    return np.array(
        [
            [1, 0, s1 / 2, 0, 0, 0, 0],
            [0, 1, -c1 / 2, 0, 0, 0, 0],
            [0, 0, -s1, -1, 0, -s2, 0],
            [0, 0, c1, 0, -1, c2, 0],
            [0, 0, 0, 1, 0, -s2, -1],
            [0, 0, 0, 0, 1, c2, 0],
        ]
    )


def bias(q: Array, v: Array) -> Array:
    """Return the right-hand side g (6,) of J a = g, eq. (23); in rows 3, 5 and 6 the paper squares accelerations."""
    # q[2], q[5]: angles of crank and rod
    x1, y1 = L1 * np.cos(q[2]) * v[2] ** 2, L1 * np.sin(q[2]) * v[2] ** 2
    x2, y2 = L2 / 2 * np.cos(q[5]) * v[5] ** 2, L2 / 2 * np.sin(q[5]) * v[5] ** 2
    return np.array([-x1 / 2, -y1 / 2, x1 + x2, y1 + y2, x2, y2])


def mass() -> Array:
    """Return the diagonal of the mass matrix M (7,), eq. (17) of the paper."""
    return np.array([M1, M1, I1, M2, M2, I2, M3])


def forces(q: Array, v: Array) -> Array:
    """Return the applied forces (7,) of eq. (19): weights, the torque, spring and damper of the slider."""
    push = STIFFNESS * (L1 + L2 - q[6]) - DAMPING * v[6]
    return np.array([0.0, -M1 * GRAVITY, TORQUE, 0.0, -M2 * GRAVITY, 0.0, push])
