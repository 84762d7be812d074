"""The order in which a linkage closes from one coordinate, dyad after dyad: numbers of the file and nothing that moves.

A dyad is two links and three joints: one joins them, the others hold them to links that are placed already. With pins R and slides
P there are three kinds that linkages of pins and slides commonly have,

    RRR   two pins and a pin between:       B on two circles about A and C
    RRP   a pin, a pin between, a slide:    B on a circle about A and on a line
    RPR   two pins and a slide between:     a line at a given distance of A passes C

each with two solutions, of which the start picks one by a sign. From which link the way begins decides which dyads there are.
Source: Assur, Issledovanie ploskikh sterzhnevykh mekhanizmov (1913); Artobolevskii, Theory of Mechanisms and Machines (1975).
"""

import cmath
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import permutations
from typing import Any

import numpy as np

from gauss_bench.engines.tree import exponential, states_of
from gauss_bench.mechanism.model import GROUND, Joint, Mechanism, Point, Prismatic
from gauss_bench.mechanism.numbers import turn_vector
from gauss_bench.terms import Array

Complex = Any  # of one state, or an array of them


class NoWay(ValueError):
    """A linkage that has no equation in one coordinate here; the message says why."""


@dataclass(frozen=True, eq=False)
class Links:
    """All links at a state or many, by index, in complex numbers: centres of mass z, their velocities u, directions e; spins w."""

    z: Mapping[int, Complex]
    e: Mapping[int, Complex]
    u: Mapping[int, Complex]
    w: Mapping[int, Complex]

    @staticmethod
    def of(q: Array, v: Array) -> "Links":
        """The links at states q, v (..., n)."""
        exp, places, rates = exponential(q), states_of(q), states_of(v)
        e = {link: exp(1j * angle) for link, (_, angle) in places.items()}
        return Links({k: x for k, (x, _) in places.items()}, e, *({k: x[i] for k, x in rates.items()} for i in range(2)))

    def point(self, point: Point) -> Complex:
        return self.z[point.link] + self.e[point.link] * complex(*point.local)

    def arm(self, a: Point, b: Point) -> Complex:
        """From a to b of one link."""
        return self.e[a.link] * complex(*(b.local - a.local))

    def direction(self, link: int, angle: float) -> Complex:
        return self.e[link] * cmath.exp(1j * angle)


@dataclass(frozen=True, eq=False)
class Held:
    """A joint between a link of a dyad and one that is placed: the link's own point, and that of the other; or the slide."""

    own: Point
    other: Point
    slide: Prismatic | None = None

    @property
    def link(self) -> int:
        return self.own.link


@dataclass(frozen=True, eq=False)
class Dyad:
    """Two links, each held to something placed, and to each other.

    RRP is a rod pinned at A, and at B to a link that slides along something placed: B stays at the distance `height` to the left of
    a line through the point `line` of the placed link. RPR is a link with a guide, pinned at C, and one with its block, pinned at
    A, at the distance `height` to the left of a line through C along the guide.

    Attributes:
        kind: "RRR", "RRP" or "RPR".
        middle: B on the first and on the second link; of RPR, the two pins.
        line: a point of the line, whose `angle` [rad] is in the frame of that point's link.
        turn: the angle of the second link less that of the line's [rad].
    """

    kind: str
    first: Held
    second: Held
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
        """|AB| and |CB| [m]."""
        a, b = (
            float(np.hypot(*(pin.local - held.own.local))) for pin, held in zip(self.middle, (self.first, self.second), strict=True)
        )
        return a, b

    def opening(self, at: Links) -> Any:
        """The distance from the dead centre, signed by branch.

        The sine of the angle between the links (RRR), the cosine of the rod against the line (RRP), of RPR the way of the block
        from where it meets the pin [m].
        """
        a, b = self.middle
        along = at.direction(self.line.link, self.angle).conjugate()
        if self.kind == "RPR":
            return (along * (at.point(b) - at.point(a))).real
        r1, r2 = self.lengths
        arm = at.arm(self.first.own, a)
        return (arm.conjugate() * at.arm(self.second.own, b)).imag / (r1 * r2) if self.kind == "RRR" else (along * arm).real / r1


@dataclass(frozen=True, eq=False)
class Way:
    """A linkage from one of its links on the ground.

    Attributes:
        joint: between that link and the ground; its motion is the coordinate.
        fixed, moved: the joint's point of the ground, and of the link.
        dyads: in the order in which they are closed.
    """

    joint: Joint
    fixed: Point
    moved: Point
    dyads: tuple[Dyad, ...]

    @property
    def link(self) -> int:
        return self.moved.link

    def state(self, at: Links) -> tuple[Any, Any]:
        """The coordinate, an angle but for whole turns, and its rate."""
        if not isinstance(self.joint, Prismatic):
            e = at.e[self.link]
            return np.arctan2(e.imag, e.real), at.w[self.link]
        a, b = self.joint.ends
        along = at.direction(a.link, self.joint.angle).conjugate()
        return (along * (at.point(b) - at.point(a))).real, (along * (at.u[b.link] - at.u[a.link])).real

    def openings(self, at: Links) -> Sequence[Any]:
        """Those of every dyad."""
        return [dyad.opening(at) for dyad in self.dyads]


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
    on_ground = [(joint, a, b) for joint in mechanism.joints for a, b in permutations(joint.ends) if a.link == GROUND]
    for joint, fixed, moved in sorted(on_ground, key=lambda x: x[2].link != mechanism.crank):
        dyads, open_links = closed_from(mechanism, {moved.link})
        if not open_links:
            complete.append(Way(joint, fixed, moved, tuple(dyads)))
        elif not complete:
            names = ", ".join(mechanism.link_name(k) for k in sorted(open_links))
            left = f"no dyad of pins and slides closes the loops of {names}, whichever link is given"
    if not complete:
        raise NoWay(left)
    return tuple(complete)


def closed_from(mechanism: Mechanism, given: set[int]) -> tuple[list[Dyad], set[int]]:
    """Dyads in the order in which they close on the given links, and the links that none of them reaches."""
    pins: dict[str, dict[int, Point]] = {}  # joint: link: its point
    for pin in mechanism.pins:
        pins.setdefault(pin.joint, {}).update({point.link: point for point in pin.ends})
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
    """The dyad of two links in this order, or None."""
    one, two = pair
    held = [_holds(pins, slides, link, placed) for link in pair]
    between = next((pin for pin in pins if one in pin and two in pin and not placed & pin.keys()), None)
    if [len(x) for x in held] != [1, 1] or held[0][0].slide:
        return None
    first, second = held[0][0], held[1][0]
    if between is None:
        slide = next((s for s in slides if {p.link for p in s.ends} == {*pair}), None)
        if slide is None or second.slide or slide.guide.link != one:
            return None
        # in the guide's frame, from its pin C: block point on the line, and from it to the block's pin A
        block = turn_vector(second.own.local - slide.block.local, slide.turn)
        height = slide.offset + _beside(block, slide.angle) + _beside(slide.guide.local - first.own.local, slide.angle)
        return Dyad("RPR", first, second, (first.own, second.own), slide.guide, slide.angle, height, slide.turn)
    middle = between[one], between[two]
    slide = second.slide
    if slide is None:
        return Dyad("RRR", first, second, middle, middle[0])
    if slide.guide.link == second.other.link:  # the line rests in the placed link
        arm = turn_vector(middle[1].local - slide.block.local, slide.turn)
        return Dyad("RRP", first, second, middle, slide.guide, slide.angle, slide.offset + _beside(arm, slide.angle), slide.turn)
    arm = middle[1].local - slide.guide.local  # the line moves with the second link, whose angle is known
    height = _beside(arm, slide.angle) - slide.offset
    return Dyad("RRP", first, second, middle, slide.block, slide.angle - slide.turn, height, -slide.turn)


def _holds(pins: Sequence[Mapping[int, Point]], slides: Sequence[Prismatic], link: int, placed: set[int]) -> list[Held]:
    """All joints of a link with what is placed."""
    by_pins = [Held(pin[link], pin[min(there)]) for pin in pins if link in pin and (there := placed & pin.keys())]
    ends = [Held(own, other, slide) for slide in slides for own, other in permutations(slide.ends)]
    return by_pins + [x for x in ends if x.link == link and x.other.link in placed]


def _beside(x: Array, angle: float) -> float:
    """The distance of x to the left of a direction."""
    return float(np.cos(angle) * x[1] - np.sin(angle) * x[0])
