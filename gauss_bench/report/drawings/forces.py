"""Drawings of what acts on a linkage: springs, dampers, motors, prescribed motions and loads, as marks that move and turn.

A mark is drawn once, in pixels around its own origin, and carried there by `place`, turned by `turn` and stretched along its x axis
by `stretch`: at one state for a drawing that stands, at all states of a film for one that moves.

    spring                zigzag between its points; with a damper both side by side
    damper                dashpot between its points; a dotted ring around a pin whose turning is damped
    rotational spring     spiral around the pin
    constant torque       curved arrow around the pin, in its own sense
    prescribed rotation   curved arrow and a ring, the motor
    prescribed slide      arrow along the guide
    prescribed length     a cylinder, its barrel at the first of its points
    force at a point      arrow whose head is at the point
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from gauss_bench.mechanism.coordinates import position, value
from gauss_bench.mechanism.model import (
    GROUND,
    Along,
    AngleDriver,
    AxisSpringDamper,
    JointDamping,
    LengthDriver,
    Mechanism,
    Point,
    PointForce,
    Prismatic,
    Revolute,
    RotationalSpringDamper,
    SlideDriver,
    SpringDamper,
    Torque,
)
from gauss_bench.report.drawings.lettering import Pixels
from gauss_bench.report.palette import BODY_EDGE, CRANK_EDGE, INK, PAPER
from gauss_bench.terms import Array

WIDE, COILS = 6.0, 7  # [px] half width of a spring, its zigs
ARC = 21.0  # [px] radius of a curved arrow
LOAD = 38.0  # [px] length of a force's arrow
BARREL = 0.55  # of a cylinder's shortest length
KEPT = 'vector-effect="non-scaling-stroke"'
LINE = f'fill="none" stroke="{INK}" stroke-width="1.4" stroke-linejoin="round" stroke-linecap="round" {KEPT}'
PUSH = f'fill="none" stroke="{CRANK_EDGE}" stroke-width="2" stroke-linecap="round"'


@dataclass(frozen=True, eq=False)
class Mark:
    """Something drawn around its own origin, and where it goes.

    Attributes:
        name: of the force or driver.
        shapes: SVG elements in pixels.
        place: (k, 2) pixels of the origin at each state.
        turn: (k,) [deg] as SVG turns, to the right.
        stretch: (k,) factors along its x axis; 1 at the first state.
        reach: (l, 2, 2) lines at the first state that names keep away from, in pixels.
    """

    name: str
    shapes: tuple[str, ...]
    place: Array
    turn: Array
    stretch: Array
    reach: Array

    @property
    def standing(self) -> str:
        """The mark at its first state."""
        (x, y), turn = self.place[0], self.turn[0]
        return f'<g transform="translate({x:.1f} {y:.1f}) rotate({turn:.2f})">{"".join(self.shapes)}</g>'


def marks(mechanism: Mechanism, states: Array, at: Pixels) -> list[Mark]:
    """Every force and driver of a mechanism that has a mark, at states (k, n)."""
    places = Places(states, at)
    return [mark for item in (*mechanism.forces, *mechanism.drivers) for mark in _marks(item, mechanism, places)]


def holder_of(mechanism: Mechanism) -> list[Point]:
    """The points of the ground that springs, dampers and cylinders take hold of."""
    lines = [x for x in (*mechanism.forces, *mechanism.drivers) if isinstance(x, (SpringDamper, LengthDriver))]
    return [point for x in lines for point in (x.a, x.b) if point.link == GROUND]


@dataclass(frozen=True, eq=False)
class Places:
    """Places in pixels at states (k, n): `at` turns world positions (..., 2) [m] into pixels."""

    states: Array
    at: Pixels

    def of(self, point: Point) -> Array:
        return self.at(position(self.states, point))

    def angle(self, link: int) -> Array:
        """(k,) [rad] of a link."""
        return np.zeros(len(self.states)) if link == GROUND else self.states[:, 3 * link + 2]


def _marks(item: object, mechanism: Mechanism, x: Places) -> Iterator[Mark]:
    match item:
        case SpringDamper():
            yield from between(item.name, x.of(item.a), x.of(item.b), item.k, item.c)
        case AxisSpringDamper():
            way = Along(item.origin, item.point, item.angle)
            turn = x.angle(item.origin.link) + item.angle
            axis = np.stack([np.cos(turn), np.sin(turn)], axis=-1)
            foot = position(x.states, item.point) - value(way, x.states)[:, None] * axis
            yield from between(item.name, x.at(foot), x.of(item.point), item.k, item.c)
        case RotationalSpringDamper():
            centre = x.of(_pin(mechanism, item.a, item.b))
            shapes = ([spiral()] if item.k else []) + ([ring()] if item.c else [])
            yield still(item.name, shapes, centre, -np.degrees(x.angle(item.b)), 14.0)
        case JointDamping():
            for pair in item.pairs[:1]:
                centre = x.of(pair.block if isinstance(pair, Prismatic) else pair.a)
                yield still(item.name, [ring()], centre, np.zeros(len(centre)), 11.0)
        case Torque() if item.value:
            centre = x.of(_pin(mechanism, item.reaction, item.link))
            yield still(item.name, draw_curved_arrow(item.value > 0), centre, np.zeros(len(centre)), ARC + 3)
        case AngleDriver():
            centre = x.of(_pin(mechanism, GROUND, item.link))
            shapes = [*draw_curved_arrow(_rate(item) >= 0), f'<circle r="9" {PUSH}/>']
            yield still(item.name, shapes, centre, np.zeros(len(centre)), ARC + 3)
        case SlideDriver():
            turn = -np.degrees(x.angle(item.joint.guide.link) + item.joint.angle)
            sense = 1.0 if _rate(item) >= 0 else -1.0
            yield still(item.name, arrow(sense * 24.0, sense * 52.0), x.of(item.joint.block), turn, 0.0)
        case LengthDriver():
            yield from cylinder(item.name, x.of(item.a), x.of(item.b))
        case PointForce() if np.hypot(*item.value):
            turn = x.angle(item.frame) + float(np.arctan2(item.value[1], item.value[0]))
            tip = x.of(item.point)
            reach = np.array([[tip[0] - LOAD * np.array([np.cos(turn[0]), -np.sin(turn[0])]), tip[0]]])
            yield Mark(item.name, tuple(arrow(-LOAD, -6.0)), tip, -np.degrees(turn), np.ones(len(tip)), reach)


def _rate(driver: AngleDriver | SlideDriver) -> float:
    """The first rate that is not zero, which gives the sense of the arrow."""
    rates = [float(driver.law(t)[1]) for t in (0.0, 1e-3, 0.1)]
    return next((rate for rate in rates if rate), 1.0)


def _pin(mechanism: Mechanism, a: int, b: int) -> Point:
    """The pin of two links; of links that share none, one of b's with the ground, or b's centre of mass."""
    pins = [joint for joint in mechanism.joints if isinstance(joint, Revolute)]
    for pair in ({a, b}, {GROUND, b}):
        for joint in pins:
            if {joint.a.link, joint.b.link} == pair:
                return joint.a
    return Point(b if b != GROUND else a, np.zeros(2), "")


def still(name: str, shapes: Sequence[str], centre: Array, turn: Array, radius: float) -> Mark:
    """A mark that keeps its size; names keep a square of this radius clear."""
    turns = np.linspace(0, 2 * np.pi, 7)
    corners = centre[0] + radius * np.stack([np.cos(turns), np.sin(turns)], axis=-1)
    reach = np.stack([corners[:-1], corners[1:]], axis=1)
    return Mark(name, tuple(shapes), centre, turn, np.ones(len(centre)), reach if radius else np.zeros((0, 2, 2)))


def between(name: str, a: Array, b: Array, k: float, c: float) -> Iterator[Mark]:
    """A spring of stiffness k and a damper c between pixels a and b (n, 2)."""
    way = b - a
    length = np.maximum(np.hypot(*way.T), 1.0)
    shapes, side = [], 8.0 if k and c else 0.0
    if k:
        shapes.append(spring(float(length[0]), -side))
    if c:
        shapes.append(damper(float(length[0]), side))
    if side:
        first, last = 0.14 * float(length[0]), 0.86 * float(length[0])
        shapes.append(f'<path d="{"".join(f"M{x:.1f} {-side:g}V{side:g}" for x in (first, last))}" {LINE}/>')
        shapes.append(f'<path d="M0 0H{first:.1f}M{last:.1f} 0H{length[0]:.1f}" {LINE}/>')
    turn = np.degrees(np.unwrap(np.arctan2(way[:, 1], way[:, 0])))
    normal = np.array([-way[0, 1], way[0, 0]]) / length[0] * (side + WIDE)
    reach = np.array([[a[0] + x, b[0] + x] for x in (0 * normal, normal, -normal)])
    yield Mark(name, tuple(shapes), a, turn, length / length[0], reach)
    yield from ends(a, b)


def ends(*places: Array) -> Iterator[Mark]:
    """Small pins where something takes hold, at pixels (n, 2)."""
    pin = f'<circle r="2.8" fill="{INK}"/>'
    for x in places:
        yield Mark("", (pin,), x, np.zeros(len(x)), np.ones(len(x)), np.zeros((0, 2, 2)))


def spring(length: float, y: float) -> str:
    """A zigzag from 0 to `length`, at the height y; with y its leads are left to whoever joins it with a damper."""
    begin, end = 0.2 * length, 0.8 * length
    zigs = begin + (np.arange(2 * COILS) + 0.5) * (end - begin) / (2 * COILS)
    heights = y + WIDE * (-1.0) ** np.arange(2 * COILS)
    first, last = (0.14 * length, 0.86 * length) if y else (0.0, length)
    points = "".join(f"L{x:.1f} {h:.1f}" for x, h in zip(zigs, heights, strict=True))
    return f'<path d="M{first:.1f} {y:g}L{begin:.1f} {y:g}{points}L{end:.1f} {y:g}L{last:.1f} {y:g}" {LINE}/>'


def damper(length: float, y: float) -> str:
    """A dashpot from 0 to `length`, at the height y."""
    first, last = (0.14 * length, 0.86 * length) if y else (0.0, length)
    left, right, piston = 0.4 * length, 0.62 * length, 0.52 * length
    pot = f"M{right:.1f} {y - 6:g}L{left:.1f} {y - 6:g}L{left:.1f} {y + 6:g}L{right:.1f} {y + 6:g}"
    rods = f"M{first:.1f} {y:g}L{left:.1f} {y:g}M{piston:.1f} {y - 4:g}L{piston:.1f} {y + 4:g}M{piston:.1f} {y:g}L{last:.1f} {y:g}"
    return f'<path d="{pot}{rods}" {LINE}/>'


def cylinder(name: str, a: Array, b: Array) -> Iterator[Mark]:
    """A rod between pixels a and b (n, 2), and a barrel around its first part that keeps its length."""
    way = b - a
    length = np.maximum(np.hypot(*way.T), 1.0)
    turn = np.degrees(np.unwrap(np.arctan2(way[:, 1], way[:, 0])))
    barrel = BARREL * float(length.min())
    rod = f'<path d="M0 0H{length[0]:.1f}" fill="none" stroke="{CRANK_EDGE}" stroke-width="4" {KEPT}/>'
    yield Mark(name, (rod,), a, turn, length / length[0], np.array([[a[0], b[0]]]))
    box = f'fill="{PAPER}" stroke="{CRANK_EDGE}" stroke-width="1.8"'
    shape = f'<rect x="8" y="-7.5" width="{barrel:.1f}" height="15" rx="2.5" {box}/>'
    yield Mark("", (shape,), a, turn, np.ones(len(a)), np.zeros((0, 2, 2)))
    yield from ends(a, b)


def spiral() -> str:
    """A spring wound around the origin."""
    turns = np.linspace(0, 2.25 * 2 * np.pi, 40)
    radius = 6.5 + 7.0 * turns / turns[-1]
    points = "L".join(f"{r * np.cos(t):.1f} {-r * np.sin(t):.1f}" for t, r in zip(turns, radius, strict=True))
    return f'<path d="M{points}" {LINE}/>'


def ring() -> str:
    """A damped pin."""
    return f'<circle r="9" fill="none" stroke="{BODY_EDGE}" stroke-width="2.4" stroke-dasharray="2.2 2.5"/>'


def arrow(start: float, end: float) -> list[str]:
    """An arrow along the x axis, from one place to another, in pixels."""
    sense = 1.0 if end > start else -1.0
    head = f"M{end:.1f} 0L{end - 9 * sense:.1f} 4.5L{end - 9 * sense:.1f} -4.5Z"
    return [f'<path d="M{start:.1f} 0H{end - 8 * sense:.1f}" {PUSH}/>', f'<path d="{head}" fill="{CRANK_EDGE}"/>']


def draw_curved_arrow(left: bool) -> list[str]:
    """Three quarters of a circle around the origin with a head, to the left or to the right, open below."""
    first, last = (-40.0, 200.0) if left else (220.0, -20.0)
    turns = np.radians(np.linspace(first, last, 25))
    points = ARC * np.stack([np.cos(turns), -np.sin(turns)], axis=-1)
    along = points[-1] - points[-2]
    along = along / np.hypot(*along)
    across = np.array([-along[1], along[0]])
    tip = points[-1] + 9 * along
    head = "L".join(f"{x:.1f} {y:.1f}" for x, y in (tip, points[-1] + 4.8 * across, points[-1] - 4.8 * across))
    line = "L".join(f"{x:.1f} {y:.1f}" for x, y in points)
    return [f'<path d="M{line}" {PUSH}/>', f'<path d="M{head}Z" fill="{CRANK_EDGE}"/>']
