"""The order in which the positions of links follow from one coordinate, dyad after dyad, and the geometry of each dyad.

A link is placed if its position has been computed. A dyad is two links and three joints: the inner joint connects the two links,
and each outer joint connects one of them to a placed link. R denotes a pin and P a slide; the middle letter is the inner joint:

    RRR:   The outer joints are pins at A and C. The inner pin B lies on circles about A and C.
    RRP:   The outer joints are a pin at A and a slide. The inner pin B lies on a circle about A and on a line.
    RPR:   The outer joints are pins at A and C, at given distances from the line of the inner slide.

Each dyad has two solutions (branches); a sign selects one. Sources: Assur, Issledovanie ploskikh sterzhnevykh mekhanizmov
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
PinPoints = Mapping[int, Point]  # the links that a pin joins -> the pin's point on each


class NoSequence(ValueError):
    """A sequence of dyads in one coordinate cannot describe the motion of the linkage; the message gives the reason."""


@dataclass(frozen=True, eq=False)
class Links:
    """Poses and velocities of all links at one state or many, as complex numbers; the last entry of every list is the ground (-1).

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
        """Return the `Links` at states q, v (..., n), which have x, y and angle of each link."""
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
        """Return the position [m] of a point of a link."""
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
    """Two links that are joined to each other, and each of them to a placed link; in RRP and RPR, the second link is the slider.

    Attributes:
        kind: "RRR", "RRP" or "RPR".
        first, second: the outer joints, which connect the two links to placed links.
        middle: points of the inner pin B on the first link and on the second; in an RPR dyad, the pin C of the guide (the first
            link) and the pin A of the block.
        line: a point on the line of the slide, fixed in the link that carries this line; in an RRR dyad, the point B.
        angle: direction [rad] of the line in the frame of the link that carries it.
        height: distance [m] of B from the line (RRP), or of A from the parallel line through C (RPR), positive to the left.
        turn: constant angle [rad] of the second link relative to the link that carries the line.
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
class DyadSequence:
    """An input link, whose motion at its joint with the ground is the independent coordinate, and dyads of all other links.

    Attributes:
        joint: the joint between the input link and the ground.
        fixed, moved: the joint's point on the ground, and its point on the input link.
        dyads: in the order in which the positions of their links are computed.
    """

    joint: Joint
    fixed: Point
    moved: Point
    dyads: tuple[Dyad, ...]

    @property
    def link(self) -> int:
        """Index of the input link."""
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
        """Return the openings (..., dyads) of all dyads at one state or many; see `Dyad.opening`."""
        if not self.dyads:
            return np.zeros((*np.shape(at.w[self.link]), 0))
        return np.stack([dyad.opening(at) for dyad in self.dyads], axis=-1)


def find_sequences(mechanism: Mechanism) -> tuple[DyadSequence, ...]:
    """Return a sequence of dyads for each input link from which dyads reach all other links, beginning with the crank.

    Raises:
        NoSequence: there is none, or an equation in one coordinate does not cover the linkage's forces or constraints.
    """
    if mechanism.drivers:
        raise NoSequence("the motion is prescribed, so there is no equation of motion in a free coordinate")
    if mechanism.knife_edges:
        raise NoSequence("a knife edge constrains velocities only, which dyads cannot")
    if mechanism.couplings:
        raise NoSequence(f"dyads cannot contain a {type(mechanism.couplings[0]).__name__} ({mechanism.couplings[0].name})")
    if mechanism.has_friction:
        raise NoSequence("dry friction depends on the forces in the joints, which an equation in one coordinate does not contain")
    if mechanism.dof != 1:
        raise NoSequence(f"one coordinate does not describe {mechanism.dof} degrees of freedom")
    if mechanism.redundant:
        raise NoSequence(f"redundant constraint rows ({mechanism.redundant}) do not occur in a sequence of dyads")
    complete, reason = [], "no pin or slide joins a link to the ground"
    on_ground = [(joint, a, b) for joint in mechanism.joints for a, b in permutations(joint.ends) if a.link == GROUND]
    # False sorts before True: the crank is the first input link
    for joint, fixed, moved in sorted(on_ground, key=lambda joint_and_ends: joint_and_ends[2].link != mechanism.crank):
        dyads, open_links = close_from(mechanism, {moved.link})
        if not open_links:
            complete.append(DyadSequence(joint, fixed, moved, tuple(dyads)))
        elif not complete:
            names = ", ".join(mechanism.link_name(k) for k in sorted(open_links))
            reason = f"no dyad of pins and slides closes the loops of {names}, for any choice of the input link"
    if not complete:
        raise NoSequence(reason)
    return tuple(complete)


def close_from(mechanism: Mechanism, start_links: set[int]) -> tuple[list[Dyad], set[int]]:
    """Return the dyads that can be placed one after another from the ground and the start links, and the links that remain."""
    pins: dict[str, dict[int, Point]] = {}  # name of a joint, which may pin more than two links -> link -> its point
    for pin in mechanism.pins:
        for point in pin.ends:
            pins.setdefault(pin.joint, {})[point.link] = point
    placed = {GROUND, *start_links}
    unplaced, dyads = set(range(len(mechanism.links))) - placed, list[Dyad]()
    while unplaced:
        candidates = (_find_dyad([*pins.values()], mechanism.slides, pair, placed) for pair in permutations(sorted(unplaced), 2))
        dyad = next(filter(None, candidates), None)  # of the first pair of links that form a dyad
        if dyad is None:
            break
        dyads.append(dyad)
        placed |= set(dyad.links)
        unplaced -= placed
    return dyads, unplaced


def _find_dyad(pins: Sequence[PinPoints], slides: Sequence[Prismatic], pair: tuple[int, int], placed: set[int]) -> Dyad | None:
    """Return the dyad of two links, in this order, and their joints with placed links; None if they form none (see `Dyad`).

    Args:
        placed: indices of the links that are placed already.
    """
    link1, link2 = pair
    joints1, joints2 = (_outer_joints(pins, slides, link, placed) for link in pair)
    # Each link must have just one joint with placed links. Only the second link's may be a slide, so a pair matches in one order.
    if len(joints1) != 1 or len(joints2) != 1 or joints1[0].slide:
        return None
    first, second = joints1[0], joints2[0]
    inner_pin = next((pin for pin in pins if link1 in pin and link2 in pin and not placed & pin.keys()), None)
    if inner_pin is None:
        slide = next((s for s in slides if {s.guide.link, s.block.link} == {*pair}), None)
        if slide is None or second.slide or slide.guide.link != link1:
            return None
        # height: distance of the block's pin A from the parallel to the slide's line through the guide's pin C. Vectors in the
        # guide's frame: from the block's point of the slide to A, and from C to the guide's point of the slide.
        to_pin = turn_vector(second.own.local - slide.block.local, slide.turn)
        to_line = slide.guide.local - first.own.local
        height = slide.offset + _left_of(slide.angle, to_pin) + _left_of(slide.angle, to_line)
        ends = first.own, second.own
        return Dyad("RPR", first, second, ends, line=slide.guide, angle=slide.angle, height=height, turn=slide.turn)
    middle = inner_pin[link1], inner_pin[link2]
    slide = second.slide
    if slide is None:
        return Dyad("RRR", first, second, middle, line=middle[0])
    if slide.guide.link == second.other.link:  # the line rests in the placed link
        arm = turn_vector(middle[1].local - slide.block.local, slide.turn)
        height = slide.offset + _left_of(slide.angle, arm)
        return Dyad("RRP", first, second, middle, line=slide.guide, angle=slide.angle, height=height, turn=slide.turn)
    # The guide is on the second link, the block on the placed link. Seen from the placed link, the line goes through the block's
    # point, and the slide's offset and turn change their signs.
    arm = middle[1].local - slide.guide.local  # the line moves with the second link, whose angle is known
    height = _left_of(slide.angle, arm) - slide.offset
    angle, turn = slide.angle - slide.turn, -slide.turn
    return Dyad("RRP", first, second, middle, line=slide.block, angle=angle, height=height, turn=turn)


def _outer_joints(pins: Sequence[PinPoints], slides: Sequence[Prismatic], link: int, placed: set[int]) -> list[OuterJoint]:
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
