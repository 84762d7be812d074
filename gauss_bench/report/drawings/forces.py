"""Draw the symbols of forces and drivers, as parts that move and turn with the linkage.

spring                zigzag between its points; a damper, if any, beside it
damper                dashpot between its points; a dotted ring around a pin whose turning is damped
rotational spring     spiral around the pin
constant torque       curved arrow around the pin, in the sense of the torque
prescribed rotation   a motor: curved arrow and a ring
prescribed slide      arrow along the guide
prescribed length     a cylinder with the barrel at the first point
force at a point      arrow whose head is at the point
"""

from collections.abc import Iterable, Iterator

import numpy as np

from gauss_bench.mechanism import model
from gauss_bench.mechanism.coordinates import position, value
from gauss_bench.report.drawings.canvas import Canvas, Part, direction, make_part, path_data, stroke
from gauss_bench.report.palette import BODY_EDGE, CRANK_EDGE, INK, PAPER
from gauss_bench.terms import Array

HALF = 6.0  # [px] half width of a spring
SIDE = 8.0  # [px] offset of a spring and a damper from the line between their points if both act
LOAD = 38.0  # [px] length of a force's arrow
BARREL = 0.55  # length of the barrel as a share of the cylinder's shortest length
UNSCALED = 'vector-effect="non-scaling-stroke"'  # keeps the width of lines in a stretched part
LINE = f'fill="none" stroke="{INK}" stroke-width="1.4" stroke-linejoin="round" stroke-linecap="round" {UNSCALED}'
PUSH = f'fill="none" stroke="{CRANK_EDGE}" stroke-width="2" stroke-linecap="round"'
LEAD = 0.14  # share of the length, at each end, that spring and damper have in common
# points of a spring, and of a damper's pot and piston, as (share of the length, px beside the line)
COILS = np.stack([np.linspace(0.2, 0.8, 29)[1::2], HALF * (-1.0) ** np.arange(14)], axis=-1)  # (14, 2)
POT = (((0.62, -6), (0.4, -6), (0.4, 6), (0.62, 6)), ((0.52, -4), (0.52, 4)))
RING = f'<circle r="9" fill="none" stroke="{BODY_EDGE}" stroke-width="2.4" stroke-dasharray="2.2 2.5"/>'
MOTOR = f'<circle r="9" {PUSH}/>'
SPIRAL = np.linspace(6.5, 13.5, 40)[:, None] * direction(-np.linspace(0, 4.5 * np.pi, 40))  # radius from 6.5 to 13.5 px
COIL = stroke(LINE, SPIRAL)
LEFT = (  # an arrow along three quarters of a circle with a radius of 21 px, open below
    f'<path d="M16.1 13.5A21 21 0 1 0 -19.7 7.2" {PUSH}/>',
    f'<path d="M-16.7 15.6L-24.2 8.8L-15.2 5.5Z" fill="{CRANK_EDGE}"/>',
)
RIGHT = tuple(f'<g transform="scale(-1 1)">{x}</g>' for x in LEFT)
PIN = f'<circle r="2.8" fill="{INK}"/>'


def attachments(mechanism: model.Mechanism) -> list[model.Point]:
    """Return the points of the ground to which springs, dampers and cylinders are attached."""
    lines = [x for x in (*mechanism.forces, *mechanism.drivers) if isinstance(x, (model.SpringDamper, model.LengthDriver))]
    return [point for x in lines for point in (x.a, x.b) if point.link == model.GROUND]


def force_parts(mechanism: model.Mechanism, states: Array, canvas: Canvas) -> Iterator[Part]:
    """Yield the symbols of all forces and drivers at states (k, n); a joint damper is drawn at the first pair that it acts on."""

    def at(point: model.Point) -> Array:
        """Return the positions (k, 2) [px] of a point."""
        return canvas.at(position(states, point))

    def angle(link: int) -> Array:
        """Return the angle (k,) [rad] of a link."""
        return np.zeros(len(states)) if link == model.GROUND else states[:, 3 * link + 2]

    for item in (*mechanism.forces, *mechanism.drivers):
        match item:
            case model.SpringDamper():
                yield from spring_damper(item.name, at(item.a), at(item.b), item.k, item.c)
            case model.AxisSpringDamper():
                axis = direction(angle(item.origin.link) + item.angle)  # (k, 2)
                along_axis = value(model.Along(item.origin, item.point, item.angle), states)  # (k,) [m]
                foot = canvas.at(position(states, item.point) - along_axis[:, None] * axis)
                yield from spring_damper(item.name, foot, at(item.point), item.k, item.c)
            case model.RotationalSpringDamper():
                shapes = [shape for shape, factor in ((COIL, item.k), (RING, item.c)) if factor]  # spring, damper
                yield ring_part(item.name, shapes, at(_pin(mechanism, item.a, item.b)), 14.0, -np.degrees(angle(item.b)))
            case model.JointDamping():
                for pair in item.pairs[:1]:
                    yield ring_part(item.name, [RING], at(pair.block if isinstance(pair, model.Prismatic) else pair.a), 11.0)
            case model.Torque() if item.value:
                yield ring_part(item.name, LEFT if item.value > 0 else RIGHT, at(_pin(mechanism, item.reaction, item.link)))
            case model.AngleDriver():
                shapes = [*(LEFT if _sense(item) > 0 else RIGHT), MOTOR]
                yield ring_part(item.name, shapes, at(_pin(mechanism, model.GROUND, item.link)))
            case model.SlideDriver():
                turn = -np.degrees(angle(item.joint.guide.link) + item.joint.angle)
                yield make_part(arrow(24.0, 52.0, _sense(item)), at(item.joint.block), turn, name=item.name)
            case model.LengthDriver():
                yield from cylinder(item.name, at(item.a), at(item.b))
            case model.PointForce() if np.hypot(*item.value):
                turn = angle(item.frame) + float(np.arctan2(item.value[1], item.value[0]))
                reach = np.array([[(-LOAD, 0.0), (0.0, 0.0)]])
                yield make_part(arrow(-LOAD, -6.0), at(item.point), -np.degrees(turn), name=item.name, reach=reach)


def _sense(driver: model.AngleDriver | model.SlideDriver) -> float:
    """Return the sign of the driver's first nonzero rate at 0, 1 ms and 100 ms; 1 if all three are zero."""
    rates = (driver.law(t)[1] for t in (0.0, 1e-3, 0.1))
    return next((float(np.sign(rate)) for rate in rates if rate), 1.0)


def _pin(mechanism: model.Mechanism, a: int, b: int) -> model.Point:
    """Return a point around which torques between links a and b are drawn.

    The point is the first pin that joins a and b; without such a pin, the first pin that joins b to the ground; without either, the
    centre of mass of b (of a if b is the ground).
    """
    # reversed, so that of several pins between the same links the first is kept
    pins = {frozenset((j.a.link, j.b.link)): j.a for j in reversed(mechanism.joints) if isinstance(j, model.Revolute)}
    centre = model.Point(b if b != model.GROUND else a, np.zeros(2), "")
    return pins.get(frozenset((a, b))) or pins.get(frozenset((model.GROUND, b)), centre)


def ring_part(name: str, shapes: Iterable[str], centre: Array, radius: float = 24.0, turn: Array | float = 0.0) -> Part:
    """Return a symbol of fixed size around a centre (k, 2) [px]; names keep away from a circle of the given radius [px]."""
    corners = radius * direction(np.linspace(0, 2 * np.pi, 7))  # a hexagon
    return make_part(shapes, centre, turn, name=name, reach=np.stack([corners[:-1], corners[1:]], axis=1))


def motion_along(a: Array, b: Array) -> tuple[float, dict[str, Array]]:
    """Return the length of a symbol that is drawn from a to b (k, 2) [px], and the motion of the symbol over the k states.

    Returns:
        The length at the first state [px], and the fields `place`, `turn` and `stretch` of a `Part`: the position of a [px], the
        angle of the line [deg], and its length divided by that at the first state.
    """
    line = b - a
    length = np.maximum(np.hypot(*line.T), 1.0)
    turn = np.degrees(np.unwrap(np.arctan2(line[:, 1], line[:, 0])))
    return float(length[0]), {"place": a, "turn": turn, "stretch": length / length[0]}


def spring_damper(name: str, a: Array, b: Array, k: float, c: float) -> Iterator[Part]:
    """Yield the symbols of a spring (if k is not 0) and of a damper (if c is not 0) between a and b (n, 2) [px].

    A spring and a damper are drawn side by side from LEAD to 1 - LEAD of the length, with short lines that join them at both ends.
    """
    length, motion = motion_along(a, b)
    side, ends = (SIDE, (LEAD, 1 - LEAD)) if k and c else (0.0, (0.0, 1.0))
    lines = []  # points as (share of the length, px beside the line)
    if k:
        lines.append([(ends[0], -side), (0.2, -side), *(COILS - (0, side)), (0.8, -side), (ends[1], -side)])
    if c:
        lines += [[(x, y + side) for x, y in line] for line in POT]
        lines += [[(ends[0], side), (0.4, side)], [(0.52, side), (ends[1], side)]]
    if side:
        lines += [[(x, -side), (x, side)] for x in ends] + [[(0, 0), (LEAD, 0)], [(1 - LEAD, 0), (1, 0)]]
    shape = stroke(LINE, *(np.array(line) * (length, 1) for line in lines))
    # names keep away from the middle line and from both sides of the symbol
    reach = np.array([[(0.0, y), (length, y)] for y in (0.0, side + HALF, -side - HALF)])
    yield make_part([shape], **motion, name=name, reach=reach)
    yield from (make_part([PIN], x) for x in (a, b))


def cylinder(name: str, a: Array, b: Array) -> Iterator[Part]:
    """Yield the symbol of a hydraulic cylinder between a and b (n, 2) [px].

    A rod extends from a to b, and its length changes. The barrel around the rod begins at a; the length of the barrel is constant,
    BARREL times the smallest distance of a and b.
    """
    length, motion = motion_along(a, b)
    rod = f'<path d="M0 0H{length:.1f}" fill="none" stroke="{CRANK_EDGE}" stroke-width="4" {UNSCALED}/>'
    yield make_part([rod], **motion, name=name, reach=np.array([[(0.0, 0.0), (length, 0.0)]]))
    barrel = BARREL * length * float(motion["stretch"].min())  # [px]
    box = f'x="8" y="-7.5" width="{barrel:.1f}" height="15" rx="2.5" fill="{PAPER}" stroke="{CRANK_EDGE}" stroke-width="1.8"'
    yield make_part([f"<rect {box}/>"], a, motion["turn"])
    yield from (make_part([PIN], x) for x in (a, b))


def arrow(start: float, end: float, sense: float = 1.0) -> list[str]:
    """Return the SVG elements of an arrow along the x axis from `start` to `end` [px]; the sense -1 mirrors it about x = 0."""
    line = f'<path d="M{sense * start:.1f} 0H{sense * (end - 8):.1f}" {PUSH}/>'
    head = path_data(np.array([(end, 0), (end - 9, 4.5), (end - 9, -4.5)]) * (sense, 1), closed=True)
    return [line, f'<path d="{head}" fill="{CRANK_EDGE}"/>']
