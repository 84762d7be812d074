"""The numbers of a linkage that the equations derived by hand need, or the reason why these equations do not cover the linkage.

A crank-slider has a crank on a ground pin, a rod, and a slider on a level guide of the ground; a four-bar has a second ground pin
in the slider's place. Loads: gravity, a constant torque and damping on the crank, and on the slider a spring and damper along x.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from gauss_bench.mechanism.coordinates import position
from gauss_bench.mechanism.model import GROUND, Along, Angle, Law, Mechanism, Point, Prismatic, Revolute, loads
from gauss_bench.mechanism.numbers import turn_vector
from gauss_bench.mechanism.spaces import angle_at
from gauss_bench.terms import Array

LEVEL = 1e-12  # [rad] largest angle of a guide or spring that counts as level


class Underived(ValueError):
    """No equation was derived by hand for this linkage; the message says what kind of linkage or load is covered."""


class Pin(NamedTuple):
    """The two points of a pin: `before` is on the previous link of the chain (or the ground), `own` on the next link."""

    before: Point
    own: Point


@dataclass(frozen=True, eq=False)
class Loop:
    """The numbers of a crank-slider or a four-bar that the equations derived by hand for this kind of linkage need.

    The links form a chain: the crank, the second link (connecting rod), and the third link (slider or rocker).

    Attributes:
        source: C file of the derived equations.
        numbers: name of a constant in this file -> value.
        links: indices of the crank, the second and the third link.
        lines: (3,) for each link the direction [rad], in the link's frame, of the line between the link's two pins: the equations
            use the angle of this line. A slider has one pin, and its line is horizontal in the world: the entry is minus the
            slider's constant angle.
        pins: for each link the pin that joins it to the previous link; for the crank, to the ground.
    """

    source: str
    numbers: Mapping[str, float]
    links: tuple[int, int, int]
    lines: Array
    pins: tuple[Pin, Pin, Pin]


def loop_of(mechanism: Mechanism) -> Loop:
    """Recognise a linkage as a crank-slider or a four-bar, and return its numbers for the equations in C.

    Names of the numbers: OX, OY are the crank's pin on the ground, R is the crank's length, DX, DY are the rocker's pin on the
    ground, and S is the rocker's length. SIDE is the sign that selects the one of two closures in which the linkage starts.

    Raises:
        Underived: the linkage is neither a crank-slider nor a four-bar, or it has a load that the derived equations do not include.
    """
    crank, pins = mechanism.crank, mechanism.pins
    constrained = mechanism.drivers or mechanism.constraints or mechanism.has_friction
    if crank is None or constrained or len(mechanism.links) != 3 or len(mechanism.joints) != 4:
        raise Underived("only loops of three links with a crank, moved by loads alone, are derived by hand")
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
    numbers |= _second_link(mechanism, second, crank_pin.own, second_line)
    lines = [_angle(crank_line), _angle(second_line)]
    if mechanism.slides:
        source = "crank_slider.c"
        lines.append(-float(angle_at(mechanism.q0, third)))
        numbers |= _slider(mechanism, mechanism.slides[0], third, far_pin.own)
        numbers |= _loads(mechanism, crank, third, far_pin.own)
        side = np.cos(angle_at(mechanism.q0, second) + lines[1])  # of the second link's line with the x axis
    else:
        source, ground_pin = "four_bar.c", _find_pin(pins, GROUND, third)
        if ground_pin is None:
            raise Underived("only a third link on a slide or a pin of the ground is derived by hand")
        rocker_line = far_pin.own.local - ground_pin.own.local
        lines.append(_angle(rocker_line))
        numbers |= {"S": float(np.linalg.norm(rocker_line))} | _vector("D", ground_pin.before.local)
        numbers |= _weights("3", mechanism, third, ground_pin.own, far_pin.own)
        numbers |= _loads(mechanism, crank, None, far_pin.own)
        start = position(mechanism.q0, crank_pin.before)
        to_ground, to_far = ground_pin.before.local - start, position(mechanism.q0, far_pin.before) - start
        # positive if the far pin is to the left of the line from the crank's pin to the ground's second pin
        side = to_ground[0] * to_far[1] - to_ground[1] * to_far[0]
    numbers["SIDE"] = float(np.sign(side))  # selects the one of the two closures in which the linkage starts
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
    """Return the components of a vector under the names that the derivations give them."""
    return {f"{name}X": float(x[0]), f"{name}Y": float(x[1])}


def _weights(k: str, mechanism: Mechanism, link: int, pivot: Point, tip: Point) -> dict[str, float]:
    """Return the numbers J, WC and WS of a link: its inertia about the pivot, and two coefficients of the moment of its weight.

    At the angle th of the line from pivot to tip, the moment of the weight about the pivot is WC cos(th) - WS sin(th).

    Args:
        k: "1" for the crank or "3" for the rocker; a part of the names, as in J1, W1C, W1S.
    """
    body, (gx, gy) = mechanism.links[link], mechanism.gravity
    # mass times the vector from pivot to centre of mass [kg m], in a frame whose x axis runs from pivot to tip
    x, y = body.mass * turn_vector(-pivot.local, -_angle(tip.local - pivot.local))
    inertia = body.inertia + body.mass * float(pivot.local @ pivot.local)
    return {f"J{k}": inertia, f"W{k}C": float(gy * x - gx * y), f"W{k}S": float(gx * x + gy * y)}


def _second_link(mechanism: Mechanism, link: int, crank_pin: Point, line: Array) -> dict[str, float]:
    """Return length, mass, inertia and centre of mass of the second link.

    The centre of mass (A2, B2) is given in a frame at the crank's pin, whose x axis runs along the line to the other pin.
    """
    body, (x, y) = mechanism.links[link], turn_vector(-crank_pin.local, -_angle(line))
    return {"L": float(np.linalg.norm(line)), "M2": body.mass, "I2": body.inertia, "A2": float(x), "B2": float(y)}


def _slider(mechanism: Mechanism, slide: Prismatic, link: int, pin: Point) -> dict[str, float]:
    """Return the height E [m] of the slider's pin and the slider's mass M3 [kg], by their names in the equations.

    Raises:
        Underived: the slide is not level, or not on the ground.
    """
    if slide.guide.link != GROUND or slide.block.link != link or abs(np.sin(slide.angle)) > LEVEL:
        raise Underived("only a slider on a level guide of the ground is derived by hand")
    return {"E": float(position(mechanism.q0, pin)[1]), "M3": mechanism.links[link].mass}


def _loads(mechanism: Mechanism, crank: int, slider: int | None, pin: Point) -> dict[str, float]:
    """Return the torque T and damping D on the crank, and K, C and X0 of the spring along x at the slider's pin.

    K, C and X0 are the stiffness, damping and rest position of the slider's spring; a four-bar (`slider` is None) has none of the
    three. Only one spring may act, and its line must be horizontal within LEVEL.

    Raises:
        Underived: another load acts.
    """
    coefficients = {"T": 0.0, "D": 0.0}
    if slider is not None:
        coefficients |= {"K": 0.0, "C": 0.0, "X0": 0.0}
    for load in loads(mechanism.forces):
        match load:
            case Law(inverse_square=s) if s:
                raise Underived("a force that falls with the square of a distance is not derived by hand")
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
                beside = turn_vector(point.local - pin.local, angle_at(mechanism.q0, point.link))
                coefficients |= {"K": k, "C": c, "X0": rest + float(origin.local[0]) - float(beside[0])}
            case _:
                raise Underived("a load acts that the derivation by hand does not have")
    return coefficients
