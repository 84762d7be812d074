"""The order in which a linkage closes from one coordinate, dyad after dyad, and the geometry of each dyad.

A link is placed if its position is computed already. A dyad is two links and three joints: the inner joint connects the two links,
and each outer joint connects one of them to a placed link. R denotes a pin and P a slide; the middle letter is the inner joint:

    RRR:   The outer joints are pins at A and C. The inner pin B lies on circles about A and C.
    RRP:   The outer joints are a pin at A and a slide. The inner pin B lies on a circle about A and on a line.
    RPR:   The outer joints are pins at A and C. The line of the inner slide passes C and A at given distances from them.

Each dyad has two solutions (branches), of which a sign selects one. Sources: Assur, Issledovanie ploskikh sterzhnevykh mekhanizmov
(1913); Artobolevskii, Theory of Mechanisms and Machines (1975).
"""

import cmath
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import permutations
from typing import Any

import numpy as np

from gauss_bench.engines.tree import exponential
from gauss_bench.mechanism.model import GROUND, Joint, Mechanism, Point, Prismatic
from gauss_bench.mechanism.numbers import turn_vector
from gauss_bench.mechanism.spaces import bodies
from gauss_bench.terms import Array

Complex = Any  # a complex number for one state, or an array of complex numbers for many states


class NoWay(ValueError):
    """The motion of the linkage cannot be written in one coordinate by the method of this module; the message gives the reason."""


@dataclass(frozen=True, eq=False)
class Links:
    """All links at one state or many, as complex numbers; the last entry of every list is the ground, whose index is -1.

    Attributes:
        z: centres of mass [m].
        e: directions exp(i theta).
        u: velocities of the centres of mass [m/s].
        w: angular velocities [rad/s], real.
    """

    z: Sequence[Complex]
    e: Sequence[Complex]
    u: Sequence[Complex]
    w: Sequence[Complex]

    @staticmethod
    def of(q: Array, v: Array) -> "Links":
        """Compute z, e, u and w of all links from states q, v (..., n) with x, y and angle of each link."""
        exp, z, e, u, w = exponential(q), [], [], [], []
        for (x, y, angle), (dx, dy, spin) in zip(_by_body(q), _by_body(v), strict=True):
            z.append(x + 1j * y)
            e.append(exp(1j * angle))
            u.append(dx + 1j * dy)
            w.append(spin)
        return Links.with_ground(z, e, u, w)

    @staticmethod
    def with_ground(z: Iterable[Complex], e: Iterable[Complex], u: Iterable[Complex], w: Iterable[Complex]) -> "Links":
        """Return `Links` of four lists, each with one entry for each moving link, and the ground at the end."""
        return Links([*z, 0j], [*e, 1.0 + 0j], [*u, 0j], [*w, 0.0])

    def point(self, point: Point) -> Complex:
        return self.z[point.link] + self.e[point.link] * complex(*point.local)

    def arm(self, a: Point, b: Point) -> Complex:
        """Return the vector from a to b, two points of one link, in world axes [m]."""
        return self.e[a.link] * complex(*(b.local - a.local))

    def direction(self, link: int, angle: float) -> Complex:
        """Return the direction in world axes that has an angle [rad] in the link's frame."""
        return self.e[link] * cmath.exp(1j * angle)


def _by_body(x: Array) -> Any:
    """Return a state (n,) as numbers (bodies, 3), or a batch (..., n) as an array (bodies, 3, ...)."""
    return bodies(x).tolist() if x.ndim == 1 else np.moveaxis(bodies(x), (-2, -1), (0, 1))


@dataclass(frozen=True, eq=False)
class OuterJoint:
    """A joint that connects a link of a dyad to a placed link.

    Attributes:
        own, other: the joint's points on the dyad's link and on the placed link.
        slide: the joint itself if it is a slide.
    """

    own: Point
    other: Point
    slide: Prismatic | None = None

    @property
    def link(self) -> int:
        return self.own.link


@dataclass(frozen=True, eq=False)
class Dyad:
    """Two links that are joined to each other, and each of them to a placed link; the second link of RRP or RPR slides.

    Attributes:
        kind: "RRR", "RRP" or "RPR".
        first, second: the outer joints, which connect the two links to placed links.
        middle: points of the inner pin B on the first link and on the second; in an RPR dyad, the pins C and A of the guide, which
            is the first link, and of the block.
        line: a point on the line of the slide, fixed in the link that carries this line; in an RRR dyad, the point B.
        angle: direction [rad] of the line in the frame of the link that carries it.
        height: distance [m] of B (RRP) or of A (RPR) from the line, positive to its left; the line of an RPR dyad passes C.
        turn: constant angle [rad] of the second link minus that of the link that carries the line.
    """

    kind: str
    first: OuterJoint
    second: OuterJoint
    middle: tuple[Point, Point]
    line: Point
    angle: float = 0.0
    height: float = 0.0
    turn: float = 0.0

    @property
    def links(self) -> tuple[int, int]:
        return self.first.link, self.second.link

    @property
    def lengths(self) -> tuple[float, float]:
        """Lengths |AB| and |CB| of the two links [m]."""
        inner_on_first, inner_on_second = self.middle
        a, c = inner_on_first.local - self.first.own.local, inner_on_second.local - self.second.own.local
        return float(np.hypot(*a)), float(np.hypot(*c))

    @property
    def opening_is_length(self) -> bool:
        """Whether `opening` is a distance [m] instead of a sine or cosine."""
        return self.kind == "RPR"

    def opening(self, at: Links) -> Any:
        """Return a number that is zero at the dyad's dead centre and has opposite signs on its two branches.

        It is the sine of the angle between the links (RRR), the cosine of the angle between rod and line (RRP), or the distance of
        A from C along the guide [m] (RPR).
        """
        on_first, on_second = self.middle
        # for complex x and y, Re(conj(x) y) is their scalar product, and Im(conj(x) y) their cross product
        along = at.direction(self.line.link, self.angle).conjugate()
        if self.opening_is_length:
            return (along * (at.point(on_second) - at.point(on_first))).real
        r1, r2 = self.lengths
        arm = at.arm(self.first.own, on_first)  # from A to B
        if self.kind == "RRP":
            return (along * arm).real / r1
        return (arm.conjugate() * at.arm(self.second.own, on_second)).imag / (r1 * r2)


@dataclass(frozen=True, eq=False)
class Way:
    """One choice of the independent coordinate: the motion of a link at its joint with the ground.

    Attributes:
        joint: the joint between this link and the ground; its motion is the coordinate.
        fixed, moved: the joint's point on the ground, and its point on the link.
        dyads: the pairs of the other links, in the order in which their positions are computed.
    """

    joint: Joint
    fixed: Point
    moved: Point
    dyads: tuple[Dyad, ...]

    @property
    def link(self) -> int:
        """Index of the link whose angle or displacement relative to the ground is the independent coordinate."""
        return self.moved.link

    def state(self, at: Links) -> tuple[Any, Any]:
        """Return the coordinate and its rate at one state or many: angle [rad], up to whole turns, or displacement [m]."""
        if not isinstance(self.joint, Prismatic):
            e = at.e[self.link]
            return np.arctan2(e.imag, e.real), at.w[self.link]
        # No link of a slide on the ground rotates, so every point of a link has the velocity u of its centre of mass.
        a, b = self.joint.ends
        along = at.direction(a.link, self.joint.angle).conjugate()
        return (along * (at.point(b) - at.point(a))).real, (along * (at.u[b.link] - at.u[a.link])).real

    def openings(self, at: Links) -> Array:
        """Return the openings of all dyads (..., dyads): how far each is from its dead centre."""
        if not self.dyads:
            return np.zeros((*np.shape(at.w[self.link]), 0))
        return np.stack([dyad.opening(at) for dyad in self.dyads], axis=-1)


def ways(mechanism: Mechanism) -> tuple[Way, ...]:
    """Return the possible choices of the independent coordinate, that of the crank first, with dyads that place all other links.

    Raises:
        NoWay: there is none, or an equation in one coordinate does not cover the linkage's forces or constraints.
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
    complete, reason = [], "no link of one degree of freedom is held to the ground by a pin or slide"
    on_ground = [(joint, a, b) for joint in mechanism.joints for a, b in permutations(joint.ends) if a.link == GROUND]
    for joint, fixed, moved in sorted(on_ground, key=lambda x: x[2].link != mechanism.crank):
        dyads, open_links = close_from(mechanism, {moved.link})
        if not open_links:
            complete.append(Way(joint, fixed, moved, tuple(dyads)))
        elif not complete:
            names = ", ".join(mechanism.link_name(k) for k in sorted(open_links))
            reason = f"no dyad of pins and slides closes the loops of {names}, whichever link is given"
    if not complete:
        raise NoWay(reason)
    return tuple(complete)


def close_from(mechanism: Mechanism, given: set[int]) -> tuple[list[Dyad], set[int]]:
    """Return the dyads in the order in which their positions can be computed from the given links, and the links of no dyad."""
    pins: dict[str, dict[int, Point]] = {}  # name of a joint, which may pin more than two links -> link -> its point
    for pin in mechanism.pins:
        for point in pin.ends:
            pins.setdefault(pin.joint, {})[point.link] = point
    placed = {GROUND, *given}
    left, dyads = set(range(len(mechanism.links))) - placed, list[Dyad]()
    while left:
        tried = (_dyad([*pins.values()], mechanism.slides, pair, placed) for pair in permutations(sorted(left), 2))
        dyad = next((x for x in tried if x is not None), None)
        if dyad is None:
            break
        dyads.append(dyad)
        placed |= set(dyad.links)
        left -= placed
    return dyads, left


def _dyad(pins: Sequence[Mapping[int, Point]], slides: Sequence[Prismatic], pair: tuple[int, int], placed: set[int]) -> Dyad | None:
    """Return the dyad that two links form in this order (see `Dyad`), or None if they form none.

    Args:
        pins: for each pin, link -> point of the pin on this link.
        placed: indices of the links that are placed already.
    """
    one, two = pair
    firsts, seconds = (_outer_joints(pins, slides, link, placed) for link in pair)
    between = next((pin for pin in pins if one in pin and two in pin and not placed & pin.keys()), None)
    # Each link must have just one joint with placed links. A slide may only be at the second, so that a pair matches in one order.
    if len(firsts) != 1 or len(seconds) != 1 or firsts[0].slide:
        return None
    first, second = firsts[0], seconds[0]
    if between is None:
        slide = next((s for s in slides if {p.link for p in s.ends} == {*pair}), None)
        if slide is None or second.slide or slide.guide.link != one:
            return None
        # Vectors in the guide's frame: from the block's point on the line to its pin A, and from the guide's pin C to the line.
        to_pin = turn_vector(second.own.local - slide.block.local, slide.turn)
        to_line = slide.guide.local - first.own.local
        height = slide.offset + _left_of(slide.angle, to_pin) + _left_of(slide.angle, to_line)
        ends = first.own, second.own
        return Dyad("RPR", first, second, ends, line=slide.guide, angle=slide.angle, height=height, turn=slide.turn)
    middle = between[one], between[two]
    slide = second.slide
    if slide is None:
        return Dyad("RRR", first, second, middle, line=middle[0])
    if slide.guide.link == second.other.link:  # the line rests in the placed link
        arm = turn_vector(middle[1].local - slide.block.local, slide.turn)
        height = slide.offset + _left_of(slide.angle, arm)
        return Dyad("RRP", first, second, middle, line=slide.guide, angle=slide.angle, height=height, turn=slide.turn)
    # The guide is on the second link and the block on the placed one. Seen from the placed link, the line passes the block's point,
    # and angle, offset and turn of the slide change their signs.
    arm = middle[1].local - slide.guide.local  # the line moves with the second link, whose angle is known
    height = _left_of(slide.angle, arm) - slide.offset
    angle, turn = slide.angle - slide.turn, -slide.turn
    return Dyad("RRP", first, second, middle, line=slide.block, angle=angle, height=height, turn=turn)


def _outer_joints(
    pins: Sequence[Mapping[int, Point]], slides: Sequence[Prismatic], link: int, placed: set[int]
) -> list[OuterJoint]:
    """Return all joints between a link and the links that are placed; a pin of several placed links counts once."""
    joints = []
    for pin in pins:
        others = placed & pin.keys()
        if link in pin and others:
            joints.append(OuterJoint(pin[link], pin[min(others)]))
    for slide in slides:
        for own, other in permutations(slide.ends):
            if own.link == link and other.link in placed:
                joints.append(OuterJoint(own, other, slide))
    return joints


def _left_of(angle: float, x: Array) -> float:
    """Return the signed distance of a point x (2,) to the left of the line through the origin with direction `angle` [rad]."""
    return float(np.cos(angle) * x[1] - np.sin(angle) * x[0])
