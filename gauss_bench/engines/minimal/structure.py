"""The order in which a linkage closes from one coordinate, dyad after dyad: numbers of the file and nothing that moves.

A dyad is two links and three joints: one joins them, the others hold them to links that are placed already. With pins R and slides
P there are three kinds that linkages of pins and slides commonly have,

    RRR   two pins and a pin between:       B on two circles about A and C
    RRP   a pin, a pin between, a slide:    B on a circle about A and on a line
    RPR   two pins and a slide between:     a line at a given distance of A passes C

each with two solutions, of which the start picks one by a sign. From which link the way begins decides which dyads there are.
Source: Assur, Issledovanie ploskikh sterzhnevykh mekhanizmov (1913); Artobolevskii, Theory of Mechanisms and Machines (1975).
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import permutations

import numpy as np

from gauss_bench.mechanism.coordinates import rate, value
from gauss_bench.mechanism.model import GROUND, Along, Angle, Mechanism, Point, Prismatic, Revolute
from gauss_bench.terms import Array, Vectors


class NoWay(ValueError):
    """A linkage that has no equation in one coordinate here; the message says why."""


@dataclass(frozen=True, eq=False)
class Pin:
    """Links that share one point: link -> the point in its own frame, from the centre of mass."""

    points: Mapping[int, Point]

    def of(self, links: set[int]) -> Point | None:
        """The point as it belongs to the first of some links, or None."""
        return next((point for link, point in sorted(self.points.items()) if link in links), None)


@dataclass(frozen=True, eq=False)
class Held:
    """A joint between a link of a dyad and one that is placed: the link's own point, and that of the other; or the slide."""

    link: int
    to: int
    own: Point
    other: Point
    slide: Prismatic | None = None


@dataclass(frozen=True, eq=False)
class RRR:
    """Two links, each pinned to something placed at A and C, and to each other at B."""

    first: Held
    second: Held
    middle: tuple[Point, Point]  # B on the first and on the second link

    @property
    def links(self) -> tuple[int, int]:
        return self.first.link, self.second.link

    def lengths(self) -> tuple[float, float]:
        """|AB| and |CB| [m]."""
        return _length(self.middle[0], self.first.own), _length(self.middle[1], self.second.own)


@dataclass(frozen=True, eq=False)
class RRP:
    """A rod pinned at A, and at B to a link that slides along something placed.

    B stays at the distance `height` to the left of a line through the point `line` of the placed link, at `angle` [rad] in its
    frame; `turn` is the angle of the sliding link less that of the placed one.
    """

    first: Held
    second: Held
    middle: tuple[Point, Point]
    line: Point
    angle: float
    height: float
    turn: float

    @property
    def links(self) -> tuple[int, int]:
        return self.first.link, self.second.link

    @property
    def length(self) -> float:
        """|AB| [m]."""
        return _length(self.middle[0], self.first.own)


@dataclass(frozen=True, eq=False)
class RPR:
    """A link with a guide, pinned at C, and one with its block, pinned at A.

    A is at the distance `height` to the left of a line through C along the guide, at `angle` [rad] in the first link's frame;
    `turn` is the angle of the block's link less that of the guide's.
    """

    guide: Held
    block: Held
    angle: float
    height: float
    turn: float

    @property
    def links(self) -> tuple[int, int]:
        return self.guide.link, self.block.link


Dyad = RRR | RRP | RPR


@dataclass(frozen=True, eq=False)
class Way:
    """A linkage from one of its links on the ground.

    Attributes:
        joint: between that link and the ground; its motion is the coordinate.
        fixed, moved: the joint's point of the ground, and of the link.
        dyads: in the order in which they are closed.
    """

    link: int
    joint: Revolute | Prismatic
    fixed: Point
    moved: Point
    dyads: tuple[Dyad, ...]

    @property
    def coordinate(self) -> Angle | Along:
        return Angle(GROUND, self.link) if isinstance(self.joint, Revolute) else self.joint.motion

    def state(self, q: Array, v: Array) -> tuple[Array, Array]:
        """The coordinate and its rate (...) at states q, v (..., n)."""
        return value(self.coordinate, q), rate(self.coordinate, q, v)

    def scales(self, q: Array) -> Array:
        """(dyads,) what an opening is measured by: 1, of RPR the largest way of the block at positions q (k, n)."""
        largest = np.abs(self.opening(q)).max(axis=0)
        return np.array([x if isinstance(dyad, RPR) else 1.0 for dyad, x in zip(self.dyads, largest, strict=False)])

    def opening(self, q: Array) -> Array:
        """The distance of every dyad from its dead centre, signed by branch, (..., dyads) at positions q (..., n).

        The sine of the angle between the links (RRR), the cosine of the rod against the line (RRP), of RPR the way of the block
        from where it meets the pin [m].
        """
        return np.stack([opening(dyad, q) for dyad in self.dyads], axis=-1) if self.dyads else np.ones((*q.shape[:-1], 0))


def opening(dyad: Dyad, q: Array) -> Array:
    """The distance of a dyad from its dead centre (...) at positions q (..., n), as `Way.opening` tells it."""
    match dyad:
        case RRR():
            a = _vector(q, dyad.first.own, dyad.middle[0])
            c = _vector(q, dyad.second.own, dyad.middle[1])
            r1, r2 = dyad.lengths()
            return np.asarray((a.conj() * c).imag / (r1 * r2))
        case RRP():
            along = np.exp(1j * (_angle(q, dyad.line.link) + dyad.angle))
            return np.asarray((along.conj() * _vector(q, dyad.first.own, dyad.middle[0])).real / dyad.length)
        case RPR():
            along = np.exp(1j * (_angle(q, dyad.guide.link) + dyad.angle))
            return np.asarray((along.conj() * (_place(q, dyad.block.own) - _place(q, dyad.guide.own))).real)


def _angle(q: Array, link: int) -> Array:
    return np.zeros(q.shape[:-1]) if link == GROUND else q[..., 3 * link + 2]


def _vector(q: Array, a: Point, b: Point) -> Vectors:
    """From a to b of one link, in world axes."""
    return np.asarray(np.exp(1j * _angle(q, a.link)) * complex(*(b.local - a.local)))


def _place(q: Array, point: Point) -> Vectors:
    centre = 0.0 if point.link == GROUND else q[..., 3 * point.link] + 1j * q[..., 3 * point.link + 1]
    return np.asarray(centre + np.exp(1j * _angle(q, point.link)) * complex(*point.local))


def _length(a: Point, b: Point) -> float:
    return float(np.hypot(*(a.local - b.local)))


def ways(mechanism: Mechanism) -> tuple[Way, ...]:
    """Every way from a link on the ground, the crank's first.

    Raises:
        NoWay: there is none, or forces or constraints that one coordinate does not hold.
    """
    if mechanism.drivers:
        raise NoWay("the motion is prescribed: nothing is left of an equation of motion in one coordinate")
    if mechanism.knife_edges:
        raise NoWay("a knife edge holds velocities, which no closure of dyads does")
    if mechanism.couplings:
        raise NoWay(f"no closure of dyads has a {type(mechanism.couplings[0]).__name__} ({mechanism.couplings[0].name})")
    if mechanism.has_friction:
        raise NoWay("dry friction needs the forces in the joints, which an equation in one coordinate does not have")
    if mechanism.dof != 1:
        raise NoWay(f"one coordinate does not describe {mechanism.dof} degrees of freedom")
    if mechanism.redundant:
        raise NoWay(f"redundant constraint rows ({mechanism.redundant}): no sequence of dyads has them")
    complete, left = [], "no link of one degree of freedom is held to the ground by a pin or slide"
    for link, joint, fixed, moved in sorted(_inputs(mechanism), key=lambda x: x[0] != mechanism.crank):
        dyads, open_links = closed_from(mechanism, {link})
        if not open_links:
            complete.append(Way(link, joint, fixed, moved, tuple(dyads)))
        elif not complete:
            names = ", ".join(mechanism.link_name(k) for k in sorted(open_links))
            left = f"no dyad of pins and slides closes the loops of {names}, whichever link is given"
    if not complete:
        raise NoWay(left)
    return tuple(complete)


def _inputs(mechanism: Mechanism) -> Iterator[tuple[int, Revolute | Prismatic, Point, Point]]:
    """Links that one joint holds to the ground: the link, the joint, its point of the ground and of the link."""
    for joint in mechanism.joints:
        a, b = (joint.guide, joint.block) if isinstance(joint, Prismatic) else (joint.a, joint.b)
        if GROUND in (a.link, b.link) and a.link != b.link:
            fixed, moved = (a, b) if a.link == GROUND else (b, a)
            yield moved.link, joint, fixed, moved


class _Joints:
    """Pins with all links they join, and slides."""

    def __init__(self, mechanism: Mechanism):
        pins: dict[str, dict[int, Point]] = {}
        for joint in mechanism.joints:
            if isinstance(joint, Revolute):
                pins.setdefault(joint.joint, {}).update({point.link: point for point in (joint.a, joint.b)})
        self.pins = [Pin(points) for points in pins.values()]
        self.slides = [joint for joint in mechanism.joints if isinstance(joint, Prismatic)]

    def held(self, link: int, placed: set[int]) -> list[Held]:
        """All joints of a link with what is placed."""
        held = []
        for pin in self.pins:
            other = pin.of(placed)
            if link in pin.points and other is not None:
                held.append(Held(link, other.link, pin.points[link], other))
        for slide in self.slides:
            for own, other in ((slide.guide, slide.block), (slide.block, slide.guide)):
                if own.link == link and other.link in placed:
                    held.append(Held(link, other.link, own, other, slide))
        return held

    def between(self, one: int, two: int, placed: set[int]) -> tuple[Point, Point] | Prismatic | None:
        """The points of a pin of both links, or a slide between them."""
        for pin in self.pins:
            if one in pin.points and two in pin.points and pin.of(placed) is None:
                return pin.points[one], pin.points[two]
        return next((s for s in self.slides if {s.guide.link, s.block.link} == {one, two}), None)


def closed_from(mechanism: Mechanism, given: set[int]) -> tuple[list[Dyad], set[int]]:
    """Dyads in the order in which they close on the given links, and the links that none of them reaches."""
    joints, placed = _Joints(mechanism), {GROUND, *given}
    left, dyads = set(range(len(mechanism.links))) - placed, list[Dyad]()
    while left:
        tried = (_dyad(joints, (a, b), placed) for a, b in permutations(sorted(left), 2))
        dyad = next((x for x in tried if x is not None), None)
        if dyad is None:
            break
        dyads.append(dyad)
        placed |= set(dyad.links)
        left -= placed
    return dyads, left


def _dyad(joints: _Joints, pair: tuple[int, int], placed: set[int]) -> Dyad | None:
    """The dyad of two links in this order, or None."""
    held, middle = [joints.held(link, placed) for link in pair], joints.between(*pair, placed)
    if middle is None or [len(x) for x in held] != [1, 1]:
        return None
    first, second = held[0][0], held[1][0]
    if isinstance(middle, Prismatic):
        if first.slide or second.slide or middle.guide.link != first.link:
            return None
        # in the guide's frame, from its pin C: block point on the line, and from it to the block's pin A
        block = _turn(second.own.local - middle.block.local, middle.turn)
        height = middle.offset + _beside(block, middle.angle) + _beside(middle.guide.local - first.own.local, middle.angle)
        return RPR(first, second, middle.angle, height, middle.turn)
    if first.slide or not second.slide:
        return None if first.slide or second.slide else RRR(first, second, middle)
    slide = second.slide
    if slide.guide.link == second.to:  # the line rests in the placed link
        arm = _turn(middle[1].local - slide.block.local, slide.turn)
        return RRP(first, second, middle, slide.guide, slide.angle, slide.offset + _beside(arm, slide.angle), slide.turn)
    arm = middle[1].local - slide.guide.local  # the line moves with the second link, whose angle is known
    height = _beside(arm, slide.angle) - slide.offset
    return RRP(first, second, middle, slide.block, slide.angle - slide.turn, height, -slide.turn)


def _turn(x: Array, angle: float) -> Array:
    c, s = np.cos(angle), np.sin(angle)
    return np.array([c * x[0] - s * x[1], s * x[0] + c * x[1]])


def _beside(x: Array, angle: float) -> float:
    """The distance of x to the left of a direction."""
    return float(np.cos(angle) * x[1] - np.sin(angle) * x[0])
