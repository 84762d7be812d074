"""Instant centres: for every two links the point at which both have one velocity.

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
from gauss_bench.mechanism.model import GROUND, Mechanism, Revolute, every_two
from gauss_bench.terms import Array

STILL = 1e-9  # of the fastest motion of the linkage, a turn counted as a way of its size: what rounding leaves of none
FARTHEST = 1e6  # of the linkage's size: a centre beyond counts as infinitely far


@dataclass(frozen=True, eq=False)
class Centre:
    """The instant centre of two links, indices with GROUND first.

    Attributes:
        at: (2,) [m], or None: at infinity, or the links do not move relative to each other.
        along: unit vector (2,) of the relative translation where the centre is at infinity (across to `along`), else None.
        pinned: whether a pin keeps it for good.
    """

    links: tuple[int, int]
    at: Array | None
    along: Array | None = None
    pinned: bool = False


def free_motion(mechanism: Mechanism, q: Array) -> Array:
    """The velocity (n,) that the joints leave free at q, of no special size.

    Raises:
        ValueError: there is none, or more than one; a velocity must then be given.
    """
    freedom = Freedom(_undriven(mechanism))
    _, place = freedom.at(q)
    if place.free.shape[1] != 1:
        raise ValueError(
            f"{mechanism.name} has {place.free.shape[1]} free motions here; its instant centres depend on which it does"
        )
    return np.asarray(place.free[:, 0] / freedom.scale)


def centres(mechanism: Mechanism, q: Array, v: Array | None = None) -> tuple[Centre, ...]:
    """The centre of every two links (bodies, where some are welded) at q (n,) in the motion v (n,), or in the only free one.

    Raises:
        ValueError: no velocity is given, and more or less than one motion is free.
    """
    size = Freedom(_undriven(mechanism)).size
    v = free_motion(mechanism, q) if v is None else v
    fastest = float(np.abs(v * np.tile([1.0, 1.0, size], len(mechanism.links))).max(initial=0.0))
    pins = {}
    for name in {joint.joint for joint in mechanism.joints}:
        for pair in every_two(tuple(x for x in mechanism.joints if x.joint == name)):
            if isinstance(pair, Revolute):
                pins[tuple(sorted((pair.a.link, pair.b.link)))] = position(q, pair.a)
    centres = []
    for a, b in combinations(range(GROUND, len(mechanism.links)), 2):
        if (a, b) in pins:
            centres.append(Centre((a, b), pins[a, b], pinned=True))
            continue
        (z_a, u_a, w_a), (z_b, u_b, w_b) = _moving(q, v, a), _moving(q, v, b)
        turn, way = w_b - w_a, (u_b - 1j * w_b * z_b) - (u_a - 1j * w_a * z_a)
        if abs(turn) * size > STILL * fastest and abs(way) < FARTHEST * size * abs(turn):
            c = 1j * way / turn
            centres.append(Centre((a, b), np.array([c.real, c.imag])))
        else:
            moving = abs(way) > STILL * fastest
            centres.append(Centre((a, b), None, np.array([way.real, way.imag]) / abs(way) if moving else None))
    return tuple(centres)


def _undriven(mechanism: Mechanism) -> Mechanism:
    return replace(mechanism, drivers=())


def _moving(q: Array, v: Array, link: int) -> tuple[complex, complex, float]:
    if link == GROUND:
        return 0j, 0j, 0.0
    z, u = (complex(x[3 * link], x[3 * link + 1]) for x in (q, v))
    return z, u, float(v[3 * link + 2])
