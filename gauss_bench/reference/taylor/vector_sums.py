"""Loop coordinates, in which the position P of every point of a linkage is a sum of vectors.

    P = sum_k c_k l_k e_k,    e_k = exp(i theta_k)

Vectors of the plane are complex numbers. In this sum, c_k is a constant vector, l_k is a displacement or 1, and theta_k is the
angle of a group of links. A term that does not turn has e_k = 1. Links that are connected by slides turn together and share one
angle coordinate. Links that slides connect to the ground cannot turn and have no angle coordinate.

A spanning tree of links and joints is built breadth first from the ground, and takes slides before pins. Each step of the tree
reaches a new link by a joint; the position of this link is that of the previous link plus some vectors. A link that is not
connected to the ground has two displacements of its own. Every slide has a displacement s along its guide, whether the slide is in
the tree or not. Each joint that is not in the tree closes a loop and gives a constraint, the closure:

    pin:     P_b - P_a = 0
    slide:   P_block - P_guide - (s + i offset) u = 0, with u the unit vector along the guide

Sources: Nikravesh, Planar Multibody Dynamics (2nd ed. 2018), on vector loops; Haug, Computer-Aided Kinematics and Dynamics of
Mechanical Systems (1989), chapter 2, on complex numbers in the plane.
"""

from collections import deque
from collections.abc import Iterable
from typing import Any, NamedTuple

import numpy as np

from gauss_bench.mechanism.frames import unit
from gauss_bench.mechanism.model import GROUND, Joint, Mechanism, Point, Prismatic
from gauss_bench.terms import Array

NONE = -1  # in place of the index of an angle a vector in world axes; in place of the index of a displacement the length 1

Key = tuple[int, int]  # (angle, displacement): vectors with the same key differ by a constant factor


class VectorTerm(NamedTuple):
    """One vector of a sum: the constant vector (x, y), multiplied by a displacement and turned by an angle.

    Attributes:
        x, y: components of the constant vector.
        angle: index of the coordinate by which the vector is turned, or NONE for no turn.
        length: index of the displacement by which the vector is multiplied, or NONE for the factor 1.
    """

    x: Any
    y: Any
    angle: int
    length: int

    @property
    def key(self) -> Key:
        """The indices of angle and displacement."""
        return self.angle, self.length


Sum = tuple[VectorTerm, ...]


def merge(terms: Iterable[VectorTerm], less: Iterable[VectorTerm] = ()) -> Sum:
    """Return the sum of `terms` minus the sum of `less`, with one term for each key and without terms that cancel.

    The key of a term is the pair of its angle and its displacement. Terms with the same key differ only in their constant vector
    (x, y), so that these vectors can be added.
    """
    sums: dict[Key, tuple[Any, Any]] = {}
    for sign, part in ((1, terms), (-1, less)):
        for term in part:
            x, y = sums.get(term.key, (term.x - term.x, term.y - term.y))  # by default zeros, in the type of number of the term
            sums[term.key] = (x + sign * term.x, y + sign * term.y)
    return tuple(VectorTerm(x, y, *key) for key, (x, y) in sums.items() if x != 0 or y != 0)


class LoopCoordinates:
    """The loop coordinates x of one mechanism, and the positions of its links and points as functions of x.

    The order of x is: angles, displacements of slides, then two displacements of each link that is not connected to the ground.
    All constants in the sums of vectors have the number type (float, long double or 128 bit) with which the mechanism was built.

    Attributes:
        mechanism: the mechanism.
        n: number of coordinates.
        roots: for every angle coordinate the link whose angle it is; of links that slides connect, the first that the tree reaches.
        angle: for every link the index of its angle coordinate, or NONE.
        turn: for every link the constant that must be added to this coordinate to get the angle of the link [rad].
        centres: centre of mass of every link, as a sum of vectors.
        slides: name of a slide -> index of its displacement.
        free: link that is not connected to the ground -> index of its displacement in x; its displacement in y is the next.
        closures: (name of the joint, sum of vectors that must vanish) for each joint that is not in the tree.
        turn_gaps: constant angles [rad] that must vanish where slides connect links in a circle.
    """

    def __init__(self, mechanism: Mechanism):
        """Find the coordinates of a mechanism on its spanning tree, and express the links and closures by them."""
        self.mechanism = mechanism
        steps = spanning_tree(mechanism)
        in_tree = {id(step.joint) for step in steps}
        zero = mechanism.gravity[0] - mechanism.gravity[0]  # in the type of number of the mechanism
        links, slides = range(len(mechanism.links)), [j for j in mechanism.joints if isinstance(j, Prismatic)]
        # angles: links that slides connect form a group. The leader of a group is the first of its links in the tree. The angle of
        # every link of the group is the angle of the leader plus a constant turn
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
        # displacements: one of every slide, then two of every link that is not connected to the ground
        self.slides = {j.name: k for k, j in enumerate(slides, start=len(self.roots))}
        alone = [step.link for step in steps if step.joint is None]
        first = len(self.roots) + len(slides)
        self.free = {link: first + 2 * k for k, link in enumerate(alone)}
        self.n = first + 2 * len(alone)
        self.centres: list[Sum] = [()] * len(mechanism.links)
        for step in steps:  # from the ground outwards: each centre of mass follows from that of the link before
            self.centres[step.link] = self._centre(step, zero)
        self.closures = [(joint.name, self._gap(joint)) for joint in mechanism.joints if id(joint) not in in_tree]

    def _centre(self, step: "TreeStep", zero: Any) -> Sum:
        """Return the centre of mass of the link that is added to the tree by `step`, as a sum of vectors.

        The centre is the position of the joint's point on the link, minus the vector from the centre to this point. `zero` is 0 in
        the mechanism's type of number.
        """
        if step.joint is None:  # a link without a connection to the ground: (1, 0) x + (0, 1) y, in world axes
            x = self.free[step.link]
            return VectorTerm(zero + 1, zero, NONE, x), VectorTerm(zero, zero + 1, NONE, x + 1)
        first, second = step.joint.ends
        along = self.along(step.joint) if isinstance(step.joint, Prismatic) else ()
        if second.link == step.link:  # the step goes from the joint's first point to its second, or backwards
            return merge([*self.point(first), *along], less=self.turn_vector(second.local, second.link))
        return merge(self.point(second), less=[*self.turn_vector(first.local, first.link), *along])

    def _gap(self, joint: Joint) -> Sum:
        """Return the sum of vectors that must vanish if a joint is closed.

        It is the vector from the first point of the joint to its second, minus the displacement if the joint is a slide.
        """
        first, second = joint.ends
        along = self.along(joint) if isinstance(joint, Prismatic) else ()
        return merge(self.point(second), less=[*self.point(first), *along])

    def turn_vector(self, vector: Any, link: int, displacement: int = NONE) -> Sum:
        """Return a vector (2,) that is given in the frame of a link, and turns with the link, as a sum of one term in world axes.

        `displacement` is the index of the coordinate by which the vector is multiplied, or NONE for a vector of constant length.
        """
        if link == GROUND:
            return (VectorTerm(vector[0], vector[1], NONE, displacement),)
        # the link's constant turn is applied to the vector itself; the angle coordinate turns it further
        c, s = unit(self.turn[link])
        return (VectorTerm(c * vector[0] - s * vector[1], s * vector[0] + c * vector[1], self.angle[link], displacement),)

    def point(self, point: Point) -> Sum:
        """Return the position of a link-fixed point, as a sum of vectors."""
        arm = self.turn_vector(point.local, point.link)
        return arm if point.link == GROUND else merge([*self.centres[point.link], *arm])

    def along(self, slide: Prismatic) -> Sum:
        """Return the vector from the guide point to the block point of a slide: displacement along the guide, plus offset."""
        u, guide = unit(slide.angle), slide.guide.link
        aside = slide.offset * unit(slide.angle, across=True)
        return merge([*self.turn_vector(u, guide, self.slides[slide.name]), *self.turn_vector(aside, guide)])

    def start(self, q: Array) -> Array:
        """Return the loop coordinates (n,) of an assembled state, in double precision.

        The state q (3 links,) has x, y and the angle of every link. The result has the angles of the links `roots`, then the
        displacements of the slides, then x and y of the links `free`.
        """
        x = np.zeros(self.n)
        z, theta = q[0::3] + 1j * q[1::3], q[2::3]  # centres of mass as complex numbers, and angles
        x[: len(self.roots)] = theta[self.roots]
        for link, k in self.free.items():
            x[k : k + 2] = z[link].real, z[link].imag

        def world(p: Point) -> complex:
            """Return the position of a point in the world."""
            local = complex(*(float(c) for c in p.local))
            return local if p.link == GROUND else complex(z[p.link] + np.exp(1j * theta[p.link]) * local)

        for joint in self.mechanism.joints:
            if isinstance(joint, Prismatic):
                angle = float(joint.angle) + (0.0 if joint.guide.link == GROUND else theta[joint.guide.link])
                x[self.slides[joint.name]] = (np.exp(-1j * angle) * (world(joint.block) - world(joint.guide))).real
        return x


class TreeStep(NamedTuple):
    """One edge of the spanning tree, which adds a link.

    The link is connected to the link `parent` by a joint. If there is no joint, the link moves freely relative to the ground.
    """

    parent: int
    link: int
    joint: Joint | None


def spanning_tree(mechanism: Mechanism) -> list[TreeStep]:
    """Return the steps that add the links to the tree, breadth first from the ground.

    Links that slides connect to a link come directly after this link.
    """
    # link -> its neighbours, each with the joint; the ground is the link -1 and comes first
    beside: dict[int, list[tuple[int, Joint]]] = {i: [] for i in range(GROUND, len(mechanism.links))}
    for joint in mechanism.joints:
        a, b = (point.link for point in joint.ends)
        beside[a].append((b, joint))
        beside[b].append((a, joint))
    reached: set[int] = set()  # links
    steps: list[TreeStep] = []

    def reach(step: TreeStep) -> list[int]:
        """Add a step to the tree, and the steps to all links that slides connect to the new link; return all added links."""
        if step.link in reached:
            return []
        reached.add(step.link)
        steps.append(step)
        tied = [TreeStep(step.link, other, joint) for other, joint in beside[step.link] if isinstance(joint, Prismatic)]
        return [step.link, *(link for tie in tied for link in reach(tie))]

    for root in beside:  # the ground first, and then every link that is not yet reached, which is not connected to the ground
        queue = deque(reach(TreeStep(GROUND, root, None)))
        while queue:
            link = queue.popleft()
            for other, joint in beside[link]:
                if not isinstance(joint, Prismatic):
                    queue += reach(TreeStep(link, other, joint))
    return steps[1:]  # without the step to the ground itself
