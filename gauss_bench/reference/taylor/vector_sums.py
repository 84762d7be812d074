"""Loop coordinates, in which the position P of every point of a linkage is a sum of vectors.

    P = sum_k c_k l_k e_k,    e_k = exp(i theta_k)

Vectors of the plane are complex numbers: c_k is a constant, l_k a displacement or 1, and theta_k the angle of a group of links that
slides connect, which turn together, or zero. A spanning tree, built breadth first from the ground with slides before pins, gives
the position of each link; each joint outside the tree closes a loop:

    pin:     P_b - P_a = 0
    slide:   P_block - P_guide - (s + i offset) u = 0, with s the displacement along the guide and u its unit vector

An `Instant` evaluates such sums, their first-order changes and their second time derivatives:

    d(l e)  = i l e dtheta + e dl
    (l e)'' = i l e theta'' + e l'' + (2 i l' theta' - l theta'^2) e

Sources: Nikravesh, Planar Multibody Dynamics (2nd ed. 2018), on vector loops; Haug, Computer-Aided Kinematics and Dynamics of
Mechanical Systems (1989), chapter 2, on complex numbers in the plane.
"""

from collections import deque
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import cache
from typing import Any, NamedTuple

import numpy as np

from gauss_bench.mechanism.frames import unit
from gauss_bench.mechanism.model import GROUND, Joint, Mechanism, Point, Prismatic
from gauss_bench.reference.taylor.arithmetic import NUMBERS, Arithmetic, Long, Value, Vector, perp, plus, product, scale_by, total
from gauss_bench.terms import Array

NONE = -1  # as the index of an angle: the vector does not turn; as the index of a displacement: the length of the vector is 1

Key = tuple[int, int]  # (angle, displacement): vectors with the same key differ by a constant factor


class VectorTerm(NamedTuple):
    """One term of a sum: the constant vector (x, y), multiplied by a displacement and turned by an angle.

    Attributes:
        angle: index of the coordinate by which the vector is turned, or NONE for no turn.
        length: index of the displacement by which the vector is multiplied, or NONE for the factor 1.
    """

    x: Any
    y: Any
    angle: int
    length: int

    @property
    def key(self) -> Key:
        """The indices of angle and displacement; terms with the same key are added."""
        return self.angle, self.length


Sum = tuple[VectorTerm, ...]
Vectors = Callable[[Key], Vector]  # key -> the vector l e, its change or its acceleration


def merge(terms: Iterable[VectorTerm], less: Iterable[VectorTerm] = ()) -> Sum:
    """Return the sum of `terms` minus the sum of `less`, with one term for each key and without terms that cancel."""
    sums: dict[Key, tuple[Any, Any]] = {}
    for sign, part in ((1, terms), (-1, less)):
        for term in part:
            x, y = sums.get(term.key, (term.x - term.x, term.y - term.y))  # by default zeros, in the type of number of the term
            sums[term.key] = (x + sign * term.x, y + sign * term.y)
    return tuple(VectorTerm(x, y, *key) for key, (x, y) in sums.items() if x != 0 or y != 0)


class LoopCoordinates:
    """The loop coordinates x of one mechanism, and the positions of its links and points as functions of x.

    The order of x is: angles, displacements of slides, then two displacements of each link that is not connected to the ground. All
    constants in the sums have the type of number with which the mechanism was built.

    Attributes:
        n: number of coordinates.
        roots: for every angle coordinate the link whose angle it is.
        angle: for every link the index of its angle coordinate, or NONE if slides connect it to the ground.
        turn: for every link the constant that must be added to this coordinate to get the angle of the link [rad].
        centres: centre of mass of every link, as a sum of vectors.
        slides: name of a slide -> index of its displacement.
        free: link that is not connected to the ground -> index of its displacement in x; its displacement in y is the next.
        closures: (name of the joint, sum of vectors that must vanish) for each joint that is not in the tree.
        turn_gaps: constant angles [rad] that must vanish where slides connect links in a circle.
    """

    def __init__(self, mechanism: Mechanism):
        self.mechanism = mechanism
        steps = spanning_tree(mechanism)
        in_tree = {id(step.joint) for step in steps}
        zero = mechanism.gravity[0] - mechanism.gravity[0]  # in the type of number of the mechanism
        links, slides = range(len(mechanism.links)), [j for j in mechanism.joints if isinstance(j, Prismatic)]
        # angles: links that slides connect have the angle of their leader, the first of them in the tree, plus a constant turn
        leader, turn = {GROUND: GROUND}, {GROUND: zero}
        for step in steps:
            leader[step.link], turn[step.link] = step.link, zero
            if isinstance(slide := step.joint, Prismatic):
                sign = 1 if slide.block.link == step.link else -1
                leader[step.link], turn[step.link] = leader[step.parent], turn[step.parent] + sign * slide.turn
        self.roots = [i for i in links if leader[i] == i]
        self.angle = [NONE if leader[i] == GROUND else self.roots.index(leader[i]) for i in links]
        self.turn = [turn[i] for i in links]
        self.turn_gaps = [turn[j.block.link] - turn[j.guide.link] - j.turn for j in slides if id(j) not in in_tree]
        self.slides = {j.name: k for k, j in enumerate(slides, start=len(self.roots))}
        unconnected = [step.link for step in steps if step.joint is None]
        first = len(self.roots) + len(slides)
        self.free = {link: first + 2 * k for k, link in enumerate(unconnected)}
        self.n = first + 2 * len(unconnected)
        self.centres: list[Sum] = [()] * len(mechanism.links)
        for step in steps:  # from the ground outwards
            self.centres[step.link] = self._centre(step, zero)
        self.closures: list[tuple[str, Sum]] = []
        for joint in mechanism.joints:
            if id(joint) not in in_tree:
                first_point, second_point = joint.ends
                gap = merge(self.point(second_point), less=[*self.point(first_point), *self.along(joint)])
                self.closures.append((joint.name, gap))

    def _centre(self, step: "TreeStep", zero: Any) -> Sum:
        """Return the centre of mass of the link that `step` adds to the tree; `zero` is 0 in the mechanism's type of number."""
        if step.joint is None:  # (1, 0) x + (0, 1) y, in world axes
            x = self.free[step.link]
            return VectorTerm(zero + 1, zero, NONE, x), VectorTerm(zero, zero + 1, NONE, x + 1)
        first, second = step.joint.ends
        along = self.along(step.joint)
        if second.link == step.link:
            return merge([*self.point(first), *along], less=self.turn_vector(second.local, second.link))
        return merge(self.point(second), less=[*self.turn_vector(first.local, first.link), *along])

    def turn_vector(self, vector: Any, link: int, displacement: int = NONE) -> Sum:
        """Return a vector (2,) in the frame of a link as a sum in world axes; it is multiplied by the coordinate `displacement`."""
        if link == GROUND:
            return (VectorTerm(vector[0], vector[1], NONE, displacement),)
        c, s = unit(self.turn[link])  # the constant turn; the angle coordinate turns the vector further
        return (VectorTerm(c * vector[0] - s * vector[1], s * vector[0] + c * vector[1], self.angle[link], displacement),)

    def point(self, point: Point) -> Sum:
        """Return the position of a link-fixed point, as a sum of vectors."""
        arm = self.turn_vector(point.local, point.link)
        return arm if point.link == GROUND else merge([*self.centres[point.link], *arm])

    def along(self, joint: Joint) -> Sum:
        """Return the vector from a joint's first point to its second: zero in a pin, displacement and offset in a slide."""
        if not isinstance(joint, Prismatic):
            return ()
        u, guide = unit(joint.angle), joint.guide.link
        aside = joint.offset * unit(joint.angle, across=True)
        return merge([*self.turn_vector(u, guide, self.slides[joint.name]), *self.turn_vector(aside, guide)])

    def start(self, q: Array) -> Array:
        """Return the loop coordinates (n,) of an assembled state q (3 links,), in double precision."""
        x = np.zeros(self.n)
        z, theta = q[0::3] + 1j * q[1::3], q[2::3]  # centres of mass as complex numbers, and angles
        x[: len(self.roots)] = theta[self.roots]
        for link, k in self.free.items():
            x[k : k + 2] = z[link].real, z[link].imag

        def world(p: Point) -> complex:
            """Return the position [m] of a point in the world as a complex number."""
            local = complex(*(float(c) for c in p.local))
            return local if p.link == GROUND else complex(z[p.link] + np.exp(1j * theta[p.link]) * local)

        for joint in self.mechanism.joints:
            if isinstance(joint, Prismatic):
                angle = float(joint.angle) + (0.0 if joint.guide.link == GROUND else theta[joint.guide.link])
                x[self.slides[joint.name]] = (np.exp(-1j * angle) * (world(joint.block) - world(joint.guide))).real
        return x


class TreeStep(NamedTuple):
    """One edge of the spanning tree, which adds `link`; without a joint this link moves freely relative to the ground."""

    parent: int
    link: int
    joint: Joint | None


def spanning_tree(mechanism: Mechanism) -> list[TreeStep]:
    """Return the steps that add the links to the tree, breadth first from the ground.

    Links that slides connect to a link come directly after this link.
    """
    # link -> its neighbours, each with the joint; the ground, -1, comes first
    neighbours: dict[int, list[tuple[int, Joint]]] = {i: [] for i in range(GROUND, len(mechanism.links))}
    for joint in mechanism.joints:
        a, b = (point.link for point in joint.ends)
        neighbours[a].append((b, joint))
        neighbours[b].append((a, joint))
    reached: set[int] = set()  # links
    steps: list[TreeStep] = []

    def reach(step: TreeStep) -> list[int]:
        """Add a step to the tree, and the steps to all links that slides connect to the new link; return all added links."""
        if step.link in reached:
            return []
        reached.add(step.link)
        steps.append(step)
        added = [step.link]
        for other, joint in neighbours[step.link]:
            if isinstance(joint, Prismatic):
                added += reach(TreeStep(step.link, other, joint))
        return added

    for root in neighbours:  # the ground first, then every link that is not yet reached
        queue = deque(reach(TreeStep(GROUND, root, None)))
        while queue:
            link = queue.popleft()
            for other, joint in neighbours[link]:
                if not isinstance(joint, Prismatic):
                    queue += reach(TreeStep(link, other, joint))
    return steps[1:]  # without the step to the ground itself


class Instant:
    """The vectors l e (length times unit vector) at coordinates x; each vector is computed when it is first needed.

    Attributes:
        x: values of all coordinates, arrays over states or symbols.
        known: key -> vector that was computed before.
    """

    def __init__(self, x: Sequence[Value], arithmetic: Arithmetic):
        self.x, self.arithmetic = x, arithmetic
        self.known: dict[Key, Vector] = {(NONE, NONE): (1, 0)}

    def __call__(self, key: Key) -> Vector:
        """Return the vector l e for the key (index of the angle coordinate, index of the length coordinate), as (x, y)."""
        if key not in self.known:
            angle, length = key
            if length != NONE:
                self.known[key] = scale_by(self.x[length], self((angle, NONE)))
            else:
                self.known[key] = (self.arithmetic.cos(self.x[angle]), self.arithmetic.sin(self.x[angle]))
        return self.known[key]

    def variation(self, dx: Mapping[int, Value]) -> Vectors:
        """Return the function key -> change of the vector l e, i l e dtheta + e dl, for changes dx (index -> change).

        With velocities for dx it gives velocities, and with accelerations that part of (l e)'' which is linear in x''.
        """

        @cache
        def change_of(key: Key) -> Vector:
            """Return the change of the vector l e with a key."""
            angle, length = key
            turn = scale_by(dx.get(angle, 0), perp(self(key)))
            return plus(turn, scale_by(dx.get(length, 0), self((angle, NONE))))

        return change_of

    def bias(self, v: Mapping[int, Value]) -> Vectors:
        """Return the function key -> centripetal plus Coriolis acceleration of l e, at velocities v (index -> velocity)."""

        @cache
        def bias_of(key: Key) -> Vector:
            """Return the centripetal plus Coriolis acceleration of the vector l e with a key."""
            angle, length = key
            w = v.get(angle, 0)
            inward = scale_by(-(w * w), self(key))
            return plus(inward, scale_by(2 * (v.get(length, 0) * w), perp(self((angle, NONE)))))

        return bias_of

    def combine(self, terms: Sum, vectors: Vectors | None = None) -> Vector:
        """Return sum_k c_k vectors(key_k) for the terms of a sum; by default `vectors` gives the vectors l e themselves."""
        vector_of, constant = vectors or self, self.arithmetic.constant
        products = [product((constant(t.x), constant(t.y)), vector_of(t.key)) for t in terms]
        return total(x for x, _ in products), total(y for _, y in products)

    def gradient(self, terms: Sum) -> dict[int, Vector]:
        """Return coordinate -> partial derivative of a sum of vectors l e, for every coordinate on which the sum depends."""
        moving = {index for t in terms for index in t.key if index != NONE}
        return {j: self.combine(tuple(t for t in terms if j in t.key), self.variation({j: 1})) for j in sorted(moving)}


def at_states(x: Long) -> Instant:
    """Return the vectors l e at k states with loop coordinates x (k, n), as arrays (k,)."""
    return Instant(list(x.T), NUMBERS)
