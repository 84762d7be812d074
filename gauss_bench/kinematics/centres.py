"""Instant centres: for every two links the point at which both have the same velocity.

With z, u and omega the place, velocity and angular speed of the links' centres of mass, as complex numbers,

    u_a + i omega_a (c - z_a) = u_b + i omega_b (c - z_b)

is linear in c; where both turn alike there is none, and their relative motion is a translation. Only ratios of velocities count, so
that a linkage of one degree of freedom has its centres at rest too. Those of any three links lie in a line (Aronhold, Kennedy).
Source: Kennedy, The Mechanics of Machinery (1886); Uicker, Pennock, Shigley, Theory of Machines and Mechanisms, chapter 3.
"""

from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from gauss_bench.kinematics.freedom import Freedom
from gauss_bench.mechanism.coordinates import position
from gauss_bench.mechanism.model import GROUND, Mechanism, every_two
from gauss_bench.mechanism.spaces import angle_at, place_at
from gauss_bench.terms import Array

STILL = 1e-9  # of the fastest motion of the linkage, a turn counted as a way of its size: what rounding leaves of none
FARTHEST = 1e6  # of the linkage's size: a centre beyond counts as infinitely far


@dataclass(frozen=True, eq=False)
class Centre:
    """The instant centre of two links, indices with GROUND first.

    Attributes:
        at: (2,) [m], or None: at infinity, or the links do not move relative to each other.
        along: unit vector (2,) of the relative translation where the centre is at infinity (across to `along`), else None.
        pinned: whether a pin fixes it permanently.
    """

    links: tuple[int, int]
    at: Array | None
    along: Array | None = None
    pinned: bool = False


def free_motion(mechanism: Mechanism, q: Array) -> Array:
    """Return the velocity (n,) that the joints leave free at q, of arbitrary size.

    Raises:
        ValueError: there is none, or more than one; a velocity must then be given.
    """
    freedom = Freedom(replace(mechanism, drivers=()))
    free = freedom.at(q)[1].free
    if free.shape[1] != 1:
        raise ValueError(f"{mechanism.name} has {free.shape[1]} free motions here; its instant centres depend on which it does")
    return np.asarray(free[:, 0] / freedom.scale)


def centres(mechanism: Mechanism, q: Array, v: Array | None = None) -> tuple[Centre, ...]:
    """Return the centre of every two links (bodies, if some are welded) at q (n,), for the velocity v (n,) or the only free one.

    Raises:
        ValueError: no velocity is given, and more or less than one motion is free.
    """
    freedom = Freedom(replace(mechanism, drivers=()))
    v, size = free_motion(mechanism, q) if v is None else v, freedom.size
    fastest = float(np.abs(v * freedom.scale).max(initial=0.0))
    pins = {}
    for name in {pin.joint for pin in mechanism.pins}:
        for pair in every_two(tuple(x for x in mechanism.pins if x.joint == name)):
            links = sorted(end.link for end in pair.ends)
            pins[links[0], links[1]] = position(q, pair.ends[0])
    centres = []
    for a, b in combinations(range(GROUND, len(mechanism.links)), 2):
        if (a, b) in pins:
            centres.append(Centre((a, b), pins[a, b], pinned=True))
            continue
        (z_a, u_a), (z_b, u_b) = ([complex(*place_at(x, link)) for x in (q, v)] for link in (a, b))
        w_a, w_b = (float(angle_at(v, link)) for link in (a, b))
        turn, way = w_b - w_a, (u_b - 1j * w_b * z_b) - (u_a - 1j * w_a * z_a)
        if abs(turn) * size > STILL * fastest and abs(way) < FARTHEST * size * abs(turn):
            c = 1j * way / turn
            centres.append(Centre((a, b), np.array([c.real, c.imag])))
        else:
            moving = abs(way) > STILL * fastest
            centres.append(Centre((a, b), None, np.array([way.real, way.imag]) / abs(way) if moving else None))
    return tuple(centres)
