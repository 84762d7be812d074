"""The numbers that the two derivations by hand need, taken from a linkage, or the reason why it fits neither.

A crank-slider has a crank on a ground pin, a rod, and a slider on a level guide of the ground; a four-bar has a second ground pin
in the slider's place. Loads: gravity, a constant torque and damping on the crank, and on the slider a spring and damper along x.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from gauss_bench.mechanism.coordinates import position
from gauss_bench.mechanism.model import GROUND, Along, Angle, Law, Mechanism, Point, Prismatic, Revolute, loads
from gauss_bench.mechanism.numbers import turn_vector
from gauss_bench.mechanism.spaces import angle_at
from gauss_bench.terms import Array

LEVEL = 1e-12  # [rad] largest angle of a guide or spring that counts as level


class Underived(ValueError):
    """No equation was derived by hand for this linkage; the message gives the difference."""


@dataclass(frozen=True, eq=False)
class Loop:
    """A linkage as one of the two loops.

    Attributes:
        source: the file of the derivation.
        numbers: name in the derivation -> value.
        links: crank, second and third link (indices).
        lines: (3,) direction [rad], in each link's frame, of the line whose angle the derivation uses; a slider's minus its angle.
        pins: for each link the pin that joins it to the ground or to the link before: the point there, and the link's own.
    """

    source: str
    numbers: Mapping[str, float]
    links: tuple[int, int, int]
    lines: Array
    pins: tuple[tuple[Point, Point], ...]


def loop_of(mechanism: Mechanism) -> Loop:
    """Recognise a linkage as one of the two loops and return its numbers.

    Raises:
        Underived: it is neither of the two, or the derivations lack one of its loads.
    """
    crank = mechanism.crank
    held = mechanism.drivers or mechanism.constraints or mechanism.has_friction
    if crank is None or held or len(mechanism.links) != 3 or len(mechanism.joints) != 4:
        raise Underived("only loops of three links with a crank, moved by loads alone, are derived by hand")
    pins = mechanism.pins
    second = next((k for k in range(3) if k != crank and _pin(pins, crank, k)), 0)
    third = 3 - crank - second
    pivot, near, far = _pin(pins, GROUND, crank), _pin(pins, crank, second), _pin(pins, second, third)
    if not (pivot and near and far) or crank == second:
        raise Underived("only a crank between a ground pin and a second link is derived by hand")
    coupler, start = far[0].local - near[1].local, position(mechanism.q0, near[0])
    numbers = _weights("1", mechanism, crank, pivot[1], near[0]) | {"R": float(np.linalg.norm(near[0].local - pivot[1].local))}
    at_rest = zip(("OX", "OY", "GX", "GY"), (*pivot[0].local, *mechanism.gravity), strict=True)
    numbers |= _free(mechanism, second, near[1], coupler) | {key: float(x) for key, x in at_rest}
    links, chain = (crank, second, third), (pivot, near, far)
    lines = [_angle(near[0].local - pivot[1].local), _angle(coupler), -float(angle_at(mechanism.q0, third))]
    if mechanism.slides:
        side = np.sign(np.cos(angle_at(mechanism.q0, second) + lines[1]))
        numbers |= _slider(mechanism, mechanism.slides[0], third, far[1]) | {"SIDE": float(side)}
        numbers |= _loads(mechanism, crank, third, far[1])
        return Loop("crank_slider.c", numbers, links, np.array(lines), chain)
    other = _pin(pins, GROUND, third)
    if other is None:
        raise Underived("only a third link on a slide or a pin of the ground is derived by hand")
    rocker, e, r = far[1].local - other[1].local, other[0].local - start, position(mechanism.q0, far[0]) - start
    numbers |= _weights("3", mechanism, third, other[1], far[1]) | {"S": float(np.linalg.norm(rocker))}
    numbers |= {"DX": float(other[0].local[0]), "DY": float(other[0].local[1])}
    numbers |= _loads(mechanism, crank, None, far[1]) | {"SIDE": float(np.sign(e[0] * r[1] - e[1] * r[0]))}
    lines[2] = _angle(rocker)
    return Loop("four_bar.c", numbers, links, np.array(lines), chain)


def _pin(pins: Sequence[Revolute], a: int, b: int) -> tuple[Point, Point] | None:
    """Return the points of the pin that joins links a and b, in this order, or None."""
    ends = [pair for pin in pins for pair in ((pin.a, pin.b), (pin.b, pin.a))]
    return next(((x, y) for x, y in ends if (x.link, y.link) == (a, b)), None)


def _angle(x: Array) -> float:
    return float(np.arctan2(x[1], x[0]))


def _weights(k: str, mechanism: Mechanism, link: int, pivot: Point, tip: Point) -> dict[str, float]:
    """Return a link's inertia about its pivot, and the moments of its weight.

    The moment at the angle th of the line from pivot to tip is WC cos(th) - WS sin(th).
    """
    body, (gx, gy) = mechanism.links[link], mechanism.gravity
    x, y = body.mass * turn_vector(-pivot.local, -_angle(tip.local - pivot.local))
    inertia = body.inertia + body.mass * float(pivot.local @ pivot.local)
    return {f"J{k}": inertia, f"W{k}C": float(gy * x - gx * y), f"W{k}S": float(gx * x + gy * y)}


def _free(mechanism: Mechanism, link: int, near: Point, line: Array) -> dict[str, float]:
    """Return length, mass, inertia and centre of the second link, in a frame along its line from the crank's pin."""
    body, (x, y) = mechanism.links[link], turn_vector(-near.local, -_angle(line))
    return {"L": float(np.linalg.norm(line)), "M2": body.mass, "I2": body.inertia, "A2": float(x), "B2": float(y)}


def _slider(mechanism: Mechanism, slide: Prismatic, link: int, pin: Point) -> dict[str, float]:
    if slide.guide.link != GROUND or slide.block.link != link or abs(np.sin(slide.angle)) > LEVEL:
        raise Underived("only a slider on a level guide of the ground is derived by hand")
    return {"E": float(position(mechanism.q0, pin)[1]), "M3": mechanism.links[link].mass}


def _loads(mechanism: Mechanism, crank: int, slider: int | None, pin: Point) -> dict[str, float]:
    """Return torque and damping on the crank, and stiffness, damping and rest of the slider's pin along x."""
    coefficients = {"T": 0.0, "D": 0.0} | ({} if slider is None else {"K": 0.0, "C": 0.0, "X0": 0.0})
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
                beside = turn_vector(point.local - pin.local, angle_at(mechanism.q0, point.link))
                coefficients |= {"K": k, "C": c, "X0": rest + float(origin.local[0]) - float(beside[0])}
            case _:
                raise Underived("a load acts that the derivation by hand does not have")
    return coefficients
