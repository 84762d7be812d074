"""Recognise a crank-slider or a four-bar, and compute the numbers that the equations derived by hand need.

A crank-slider has a crank on a ground pin, a rod, and a slider on a level guide of the ground; a four-bar has a rocker on a second
ground pin instead of the slider. The loads may be gravity, a constant torque and damping on the crank, and on the slider a spring
and damper along x.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from gauss_bench.mechanism.coordinates import position
from gauss_bench.mechanism.model import GROUND, Along, Angle, Law, Mechanism, Point, Revolute, loads
from gauss_bench.mechanism.numbers import turn_vector
from gauss_bench.mechanism.spaces import angle_at
from gauss_bench.terms import Array

LEVEL = 1e-12  # [rad] largest angle of a guide or spring that counts as level


class Underived(ValueError):
    """No equation was derived by hand for this linkage; the message gives the reason."""


class Pin(NamedTuple):
    """The two points of a pin: `before` is on the previous link of the chain (or the ground), `own` on the next link."""

    before: Point
    own: Point


@dataclass(frozen=True, eq=False)
class Loop:
    """The numbers of a crank-slider or a four-bar that the equations derived by hand need.

    The links form a chain: the crank, the second link (connecting rod), and the third link (slider or rocker).

    Attributes:
        source: C file of the derived equations.
        numbers: name of a constant in this file -> value.
        links: indices of the crank, the second and the third link.
        lines: (3,) for each link the direction [rad], in the link's frame, of the line between the link's two pins: the equations
            use the angle of this line. For a slider, which has one pin, the line is horizontal in the world, so the entry is minus
            the slider's constant angle.
        pins: for each link the pin that joins it to the previous link; for the crank, to the ground.
    """

    source: str
    numbers: Mapping[str, float]
    links: tuple[int, int, int]
    lines: Array
    pins: tuple[Pin, Pin, Pin]


def loop_of(mechanism: Mechanism) -> Loop:
    """Recognise a linkage as a crank-slider or a four-bar, and return its numbers, whose names the C files explain.

    Raises:
        Underived: the linkage is neither a crank-slider nor a four-bar, or it has a load that the derived equations do not include.
    """
    crank, pins = mechanism.crank, mechanism.pins
    is_constrained = mechanism.drivers or mechanism.constraints or mechanism.has_friction
    if crank is None or is_constrained or len(mechanism.links) != 3 or len(mechanism.joints) != 4:
        raise Underived("only loops of three links with a crank, without drivers, couplings and dry friction, are derived by hand")
    # the link that is pinned to the crank; if there is none, the crank, which is refused below, because it has no pin with itself
    second = next((k for k in range(3) if k != crank and _find_pin(pins, crank, k)), crank)
    third = 3 - crank - second  # the indices of the three links are 0, 1 and 2
    pivot, crank_pin, far_pin = _find_pin(pins, GROUND, crank), _find_pin(pins, crank, second), _find_pin(pins, second, third)
    if not (pivot and crank_pin and far_pin):
        raise Underived("only a crank between a ground pin and a second link is derived by hand")
    crank_line = crank_pin.before.local - pivot.own.local
    second_line = far_pin.before.local - crank_pin.own.local
    numbers = {"R": float(np.linalg.norm(crank_line))}
    numbers |= _vector("O", pivot.before.local) | _vector("G", mechanism.gravity)
    numbers |= _weights("1", mechanism, crank, pivot.own, crank_pin.before)
    # of the second link: length, mass, inertia, and centre of mass in a frame at the crank's pin with x axis to the far pin
    body, centre = mechanism.links[second], turn_vector(-crank_pin.own.local, -_angle(second_line))
    numbers |= {"L": float(np.linalg.norm(second_line)), "M2": body.mass, "I2": body.inertia}
    numbers |= {"A2": float(centre[0]), "B2": float(centre[1])}
    lines = [_angle(crank_line), _angle(second_line)]
    if mechanism.slides:
        source, slide = "crank_slider.c", mechanism.slides[0]
        lines.append(-float(angle_at(mechanism.q0, third)))
        if slide.guide.link != GROUND or slide.block.link != third or abs(np.sin(slide.angle)) > LEVEL:
            raise Underived("only a slider on a level guide of the ground is derived by hand")
        numbers |= {"E": float(position(mechanism.q0, far_pin.own)[1]), "M3": mechanism.links[third].mass}
        numbers |= _loads(mechanism, crank, third, far_pin.own)
        side = np.cos(angle_at(mechanism.q0, second) + lines[1])  # positive if the second link's line points to +x
    else:
        source, ground_pin = "four_bar.c", _find_pin(pins, GROUND, third)
        if ground_pin is None:
            raise Underived("only a third link on a slide or a pin of the ground is derived by hand")
        rocker_line = far_pin.own.local - ground_pin.own.local
        lines.append(_angle(rocker_line))
        numbers |= {"S": float(np.linalg.norm(rocker_line))} | _vector("D", ground_pin.before.local)
        numbers |= _weights("3", mechanism, third, ground_pin.own, far_pin.own)
        numbers |= _loads(mechanism, crank, None, far_pin.own)
        crank_end = position(mechanism.q0, crank_pin.before)
        to_ground, to_far = ground_pin.before.local - crank_end, position(mechanism.q0, far_pin.before) - crank_end
        # positive if the far pin is to the left of the line from the crank's pin to the ground's second pin
        side = to_ground[0] * to_far[1] - to_ground[1] * to_far[0]
    numbers["SIDE"] = float(np.sign(side))  # selects the closure in which the linkage starts
    return Loop(source, numbers, (crank, second, third), np.array(lines), (pivot, crank_pin, far_pin))


def _find_pin(pins: Sequence[Revolute], before: int, link: int) -> Pin | None:
    """Return the pin between the link `before` and the link `link`, or None if there is none."""
    for pin in pins:
        for a, b in ((pin.a, pin.b), (pin.b, pin.a)):
            if (a.link, b.link) == (before, link):
                return Pin(a, b)
    return None


def _angle(x: Array) -> float:
    """Return the direction [rad] of a vector."""
    return float(np.arctan2(x[1], x[0]))


def _vector(name: str, x: Array) -> dict[str, float]:
    """Return the components of a vector as constants of the C file: `name` followed by X and by Y."""
    return {f"{name}X": float(x[0]), f"{name}Y": float(x[1])}


def _weights(k: str, mechanism: Mechanism, link: int, pivot: Point, tip: Point) -> dict[str, float]:
    """Return the numbers of link k ("1" or "3"): its inertia Jk about the pivot, and the coefficients WkC, WkS of its weight.

    At the angle th of the line from pivot to tip, the moment of the weight about the pivot is WkC cos(th) - WkS sin(th).
    """
    body, (gx, gy) = mechanism.links[link], mechanism.gravity
    # mass times the vector from pivot to centre of mass [kg m], in a frame whose x axis runs from pivot to tip
    x, y = body.mass * turn_vector(-pivot.local, -_angle(tip.local - pivot.local))
    inertia = body.inertia + body.mass * float(pivot.local @ pivot.local)
    return {f"J{k}": inertia, f"W{k}C": float(gy * x - gx * y), f"W{k}S": float(gx * x + gy * y)}


def _loads(mechanism: Mechanism, crank: int, slider: int | None, pin: Point) -> dict[str, float]:
    """Return the torque T and damping D on the crank, and stiffness K, damping C and rest position X0 of a spring along x.

    The spring acts at the slider's pin; a four-bar (`slider` is None) has none.

    Raises:
        Underived: another load or a second spring acts.
    """
    coefficients = {"T": 0.0, "D": 0.0}
    if slider is not None:
        coefficients |= {"K": 0.0, "C": 0.0, "X0": 0.0}
    for name, load in ((force.name, load) for force in mechanism.forces for load in loads([force])):
        match load:
            case Law(inverse_square=s) if s:
                raise Underived(f"the derivation by hand does not include the inverse square law {name}")
            case Law(Angle(a, b), k=0, c=c, bias=bias) if {a, b} == {GROUND, crank}:
                coefficients["T"] += bias if b == crank else -bias
                coefficients["D"] += c
            case Law(Along(origin, point, angle, across=False), k=k, c=c, rest=rest, bias=0) if (
                origin.link == GROUND
                and point.link == slider
                and abs(angle) < LEVEL
                and coefficients["K"] == coefficients["C"] == 0
            ):
                # from the slider's pin to the point on which the spring acts [m], in the world's axes
                from_pin = turn_vector(point.local - pin.local, angle_at(mechanism.q0, point.link))
                coefficients |= {"K": k, "C": c, "X0": rest + float(origin.local[0]) - float(from_pin[0])}
            case _:
                raise Underived(f"the derivation by hand does not include the load {name}")
    return coefficients
