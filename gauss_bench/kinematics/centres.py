"""Find instant centres, and ratios of velocities and forces, of a linkage with one free motion.

Let the complex numbers z and u be the place and the velocity of the centre of mass of a link, and omega its angular speed. At the
instant centre c of two links a and b, both have the same velocity:

    u_a + i omega_a (c - z_a) = u_b + i omega_b (c - z_b).

Two links with the same angular speed have no instant centre at a finite distance: one of them translates relative to the other.
Only ratios of velocities matter, so that the linkage may be at rest. The three instant centres of any three links lie on one line
(Aronhold, Kennedy).

With the free motion x (n,) and the gradients g_in, g_out (n,) of two coordinates, the ratio of their rates is

    d out / d in = (g_out . x) / (g_in . x) = F_in / F_out,

because without losses and weights the power that enters at the input leaves at the output. The mechanical advantage F_out / F_in is
infinite where the output is at rest (at a toggle, a dead centre), and zero where the input is at rest (at a limit of its motion).

Source: Kennedy, The Mechanics of Machinery (1886); Uicker, Pennock, Shigley, Theory of Machines and Mechanisms, chapter 3.
"""

from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import combinations

import numpy as np

from gauss_bench.kinematics.freedom import Freedom
from gauss_bench.kinematics.singular import driving_coordinates, input_coordinate
from gauss_bench.mechanism.coordinates import gradient, position
from gauss_bench.mechanism.model import GROUND, Measured, Mechanism, pins_of_all_pairs
from gauss_bench.mechanism.spaces import angle_at, angles, place_at
from gauss_bench.terms import Array, largest

STILL = 1e-9  # a relative motion below this share of the fastest motion in the linkage is rounding
ZERO = 1e-12  # a divisor below this share of its dividend is rounding, and counts as zero
FARTHEST = 1e6  # a centre farther away than this many sizes of the linkage counts as infinitely far


@dataclass(frozen=True, eq=False)
class Centre:
    """The instant centre of two links, whose indices are in ascending order; the ground has the smallest, GROUND.

    Attributes:
        at: place (2,) of the centre [m]; None if it is infinitely far away, or if the links do not move relative to each other.
        along: unit vector (2,) of the relative translation if the centre is infinitely far away, else None.
    """

    links: tuple[int, int]
    at: Array | None
    along: Array | None = None


def free_motion(mechanism: Mechanism, q: Array) -> Array:
    """Return the only velocity (n,) that the joints permit at q (n,); its magnitude is arbitrary.

    Raises:
        ValueError: the joints leave no motion free, or more than one.
    """
    freedom = _undriven(mechanism)
    _, place = freedom.evaluate(q)
    count = place.free.shape[1]
    if count != 1:
        raise ValueError(f"{mechanism.name} has {count} free motions here; instant centres need exactly one")
    return np.asarray(place.free[:, 0] / freedom.scale)


@lru_cache(maxsize=1)  # `centres` is called for the same linkage at every sample of a motion
def _undriven(mechanism: Mechanism) -> Freedom:
    """Return the constraints of the joints of a linkage, without its drivers, in scaled coordinates."""
    return Freedom(replace(mechanism, drivers=()))


def centres(mechanism: Mechanism, q: Array) -> tuple[Centre, ...]:
    """Return the instant centre of every pair of links (bodies, if some are welded) in the free motion at q (n,).

    A centre that is infinitely far away has the direction of the relative translation instead of a place.

    Raises:
        ValueError: the joints leave no motion free, or more than one.
    """
    v, size = free_motion(mechanism, q), mechanism.size
    # a turn of one radian counts as a displacement of the linkage's own size
    displacements = np.array(v)
    angles(displacements)[:] *= size
    fastest = largest(displacements)
    meeting = [x for x in mechanism.joints if x.ends_meet]
    pins = {}  # indices of two links -> place (2,) of the pin that joins them, which is their centre
    for name in {x.joint for x in meeting}:
        for pair in pins_of_all_pairs(tuple(x for x in meeting if x.joint == name)):
            links = sorted(end.link for end in pair.ends)
            pins[links[0], links[1]] = position(q, pair.ends[0])
    centres = []
    for a, b in combinations(range(GROUND, len(mechanism.links)), 2):
        if (a, b) in pins:
            centres.append(Centre((a, b), pins[a, b]))
            continue
        # sorted by c, the equation is  i turn c = -slip, with the relative angular speed `turn`, and the relative velocity `slip`
        # of the points of both links at the origin
        turn = float(angle_at(v, b) - angle_at(v, a))
        slip = _velocity_at_origin(q, v, b) - _velocity_at_origin(q, v, a)
        if abs(turn) * size > STILL * fastest and abs(slip) < FARTHEST * size * abs(turn):
            c = 1j * slip / turn
            centres.append(Centre((a, b), np.array([c.real, c.imag])))
        else:
            along = np.array([slip.real, slip.imag]) / abs(slip) if abs(slip) > STILL * fastest else None
            centres.append(Centre((a, b), None, along))
    return tuple(centres)


def _velocity_at_origin(q: Array, v: Array, link: int) -> complex:
    """Return the velocity u - i omega z of that point of a link which is at the origin of the world."""
    return complex(*place_at(v, link)) - 1j * float(angle_at(v, link)) * complex(*place_at(q, link))


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
    driving = input_coordinate(mechanism)
    if mechanism.drivers:
        driving = Measured(mechanism.drivers[0].name, mechanism.drivers[0].coordinate)
    outputs = [x for x in driving_coordinates(mechanism) if x.name != driving.name]
    rates = np.zeros((len(positions), 1 + len(outputs)))  # of the input, then of the outputs
    for k, q in enumerate(positions):
        x = free_motion(mechanism, q)
        rates[k] = [gradient(c.coordinate, q) @ x for c in (driving, *outputs)]
    ratios = []
    for output, rate in zip(outputs, rates[:, 1:].T, strict=True):
        velocity, mechanical = _divide(rate, rates[:, 0]), _divide(rates[:, 0], rate)
        ratios.append(Advantage(driving.name, output.name, (driving.unit, output.unit), velocity, mechanical))
    return tuple(ratios)


def _divide(a: Array, b: Array) -> Array:
    """Return a / b, and infinity where b is zero up to rounding."""
    still = np.abs(b) <= ZERO * np.abs(a)
    return np.where(still, np.inf, a / np.where(still, 1.0, b))
