"""Loop coordinates: every point of a linkage as a sum of turned vectors.

    P = sum_k c_k l_k e_k,    e_k = exp(i theta_k)

with constants c_k of the plane, l_k either 1 or a displacement, theta_k the angle of a group of links or none (e = 1). Links joined
by slides turn together and share one angle; links that slides tie to the ground have none. A spanning tree, breadth first from the
ground, takes slides before pins and adds one vector per step; a link without a way to the ground starts from two displacements of
its own. Every slide has a displacement along its line, whether the tree takes it or not. What the tree leaves open is a closure:

    pin    P_b - P_a = 0,        slide    P_block - P_guide - (s + i offset) u = 0,    u the direction of the guide

Source: Nikravesh, Planar Multibody Dynamics (2nd ed. 2018), on vector loops; Haug, Computer-Aided Kinematics and Dynamics of
Mechanical Systems (1989), chapter 2, on complex numbers in the plane.
"""

from collections import deque
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from gauss_bench.mechanism.model import GROUND, Joint, Mechanism, Point, Prismatic
from gauss_bench.mechanism.numbers import direction
from gauss_bench.terms import Array

NONE = -1  # instead of the index of an angle: the world's axes; instead of that of a displacement: length 1

Key = tuple[int, int]  # (angle, displacement): what vectors have in common that differ by a constant


class VectorTerm(NamedTuple):
    """One vector: the constant (x, y), times a displacement, turned by an angle; both by the index of the coordinate, or NONE."""

    x: Any
    y: Any
    angle: int
    length: int

    @property
    def key(self) -> Key:
        return self.angle, self.length


Sum = tuple[VectorTerm, ...]


def merge(terms: Iterable[VectorTerm], less: Iterable[VectorTerm] = ()) -> Sum:
    """One term per key, without those that cancel; `less` is taken away."""
    sums: dict[Key, tuple[Any, Any]] = {}
    for sign, part in ((1, terms), (-1, less)):
        for term in part:
            x, y = sums.get(term.key, (term.x - term.x, term.y - term.y))
            sums[term.key] = (x + sign * term.x, y + sign * term.y)
    return tuple(VectorTerm(x, y, *key) for key, (x, y) in sums.items() if x != 0 or y != 0)


@dataclass(frozen=True, eq=False)
class LoopCoordinates:
    """The coordinates of one mechanism, angles before displacements, and what they make of links, points and open joints.

    Attributes:
        n, angles: how many coordinates there are, and how many of them are angles.
        roots: link whose own angle each angle coordinate is.
        angle: coordinate of every link's angle, or NONE; turn: what is added to it [rad].
        centres: centre of mass of every link.
        slides: name of a slide -> its displacement; free: (link, displacement x, displacement y) of links that start on their own.
        closures: (name of the joint, sum that must vanish) of the joints the tree leaves open.
        turn_gaps: (name of the slide, constant angle [rad] that must vanish) where slides close a circle.
    """

    mechanism: Mechanism
    n: int
    angles: int
    roots: tuple[int, ...]
    angle: tuple[int, ...]
    turn: tuple[Any, ...]
    centres: tuple[Sum, ...]
    slides: dict[str, int]
    free: tuple[tuple[int, int, int], ...]
    closures: tuple[tuple[str, Sum], ...]
    turn_gaps: tuple[tuple[str, Any], ...]

    def turned(self, vector: Any, link: int, length: int = NONE) -> Sum:
        """A vector (2,) in a link's frame, as a sum of one term."""
        if link == GROUND:
            return (VectorTerm(vector[0], vector[1], NONE, length),)
        c, s = direction(self.turn[link])
        return (VectorTerm(c * vector[0] - s * vector[1], s * vector[0] + c * vector[1], self.angle[link], length),)

    def point(self, point: Point) -> Sum:
        """World position of a link-fixed point."""
        arm = self.turned(point.local, point.link)
        return arm if point.link == GROUND else merge([*self.centres[point.link], *arm])

    def along(self, slide: Prismatic) -> Sum:
        """From the guide point to the block point of a slide."""
        u = direction(slide.angle)
        left = np.array([-u[1], u[0]])
        guide = slide.guide.link
        return merge([*self.turned(u, guide, self.slides[slide.name]), *self.turned(slide.offset * left, guide)])

    def start(self, q: Array) -> Array:
        """Loop coordinates (n,) of an assembled state q (3 links,), in double precision."""
        x = np.zeros(self.n)
        z, theta = q[0::3] + 1j * q[1::3], q[2::3]
        x[: self.angles] = [theta[i] for i in self.roots]
        for link, i, j in self.free:
            x[i], x[j] = z[link].real, z[link].imag

        def world(p: Point) -> complex:
            local = complex(*(float(c) for c in p.local))
            return local if p.link == GROUND else complex(z[p.link] + np.exp(1j * theta[p.link]) * local)

        for joint in self.mechanism.joints:
            if isinstance(joint, Prismatic):
                angle = float(joint.angle) + (0.0 if joint.guide.link == GROUND else theta[joint.guide.link])
                x[self.slides[joint.name]] = (np.exp(-1j * angle) * (world(joint.block) - world(joint.guide))).real
        return x


def ends(joint: Joint) -> tuple[Point, Point]:
    """The two points of a pair: guide and block, or a and b."""
    return (joint.guide, joint.block) if isinstance(joint, Prismatic) else (joint.a, joint.b)


class TreeStep(NamedTuple):
    """A step of the spanning tree, from a link already reached to a new one; without a joint the link starts on its own."""

    parent: int
    link: int
    joint: Joint | None


def spanning_tree(mechanism: Mechanism) -> list[TreeStep]:
    """Breadth first from the ground; whatever slides tie to a link comes directly after it."""
    slides = [j for j in mechanism.joints if isinstance(j, Prismatic)]
    pins = [j for j in mechanism.joints if not isinstance(j, Prismatic)]
    reached: set[int] = set()
    steps: list[TreeStep] = []

    def neighbours(link: int, joints: Iterable[Joint]) -> Iterator[tuple[int, Joint]]:
        for joint in joints:
            links = [p.link for p in ends(joint)]
            if link in links:
                yield links[1 - links.index(link)], joint

    def reach(step: TreeStep) -> list[int]:
        if step.link in reached:
            return []
        reached.add(step.link)
        steps.append(step)
        group = [step.link]
        for other, joint in neighbours(step.link, slides):
            group += reach(TreeStep(step.link, other, joint))
        return group

    for root in (GROUND, *range(len(mechanism.links))):
        queue = deque(reach(TreeStep(GROUND, root, None)))
        while queue:
            link = queue.popleft()
            for other, joint in neighbours(link, pins):
                queue += reach(TreeStep(link, other, joint))
    return steps[1:]


def loop_coordinates(mechanism: Mechanism) -> LoopCoordinates:
    """The loop coordinates of a mechanism, in the type of number it is built in."""
    none = mechanism.gravity[0] - mechanism.gravity[0]
    steps = spanning_tree(mechanism)
    leaders, turns, gaps = _groups(mechanism, none)
    roots = tuple(dict.fromkeys(leaders[i] for i in range(len(mechanism.links)) if leaders[i] != GROUND))
    angle = tuple(NONE if leaders[i] == GROUND else roots.index(leaders[i]) for i in range(len(mechanism.links)))
    slides = [j.name for j in mechanism.joints if isinstance(j, Prismatic)]
    free = [step.link for step in steps if step.joint is None]
    count = len(roots)
    at = {name: count + k for k, name in enumerate(slides)}
    count += len(slides)
    alone = tuple((link, count + 2 * k, count + 2 * k + 1) for k, link in enumerate(free))
    count += 2 * len(free)
    empty: tuple[Sum, ...] = ((),) * len(mechanism.links)
    turn = tuple(turns[i] for i in range(len(mechanism.links)))
    bare = LoopCoordinates(mechanism, count, len(roots), roots, angle, turn, empty, at, alone, (), tuple(gaps))
    return _with_centres(bare, steps, none)


def _groups(mechanism: Mechanism, none: Any) -> tuple[dict[int, int], dict[int, Any], list[tuple[str, Any]]]:
    """Leader of every link, its angle relative to the leader, and what circles of slides leave open."""
    slides = [j for j in mechanism.joints if isinstance(j, Prismatic)]
    leader: dict[int, int] = {}
    turn: dict[int, Any] = {}
    used: set[str] = set()

    def spread(link: int) -> None:
        for j in slides:
            for here, there, sign in ((j.guide.link, j.block.link, 1), (j.block.link, j.guide.link, -1)):
                if here == link and there not in leader:
                    used.add(j.name)
                    leader[there], turn[there] = leader[link], turn[link] + sign * j.turn
                    spread(there)

    for root in (GROUND, *range(len(mechanism.links))):
        if root not in leader:
            leader[root], turn[root] = root, none
            spread(root)
    gaps = [(j.name, turn[j.block.link] - turn[j.guide.link] - j.turn) for j in slides if j.name not in used]
    return leader, turn, gaps


def _with_centres(bare: LoopCoordinates, steps: list[TreeStep], none: Any) -> LoopCoordinates:
    """The coordinates with the vectors that the steps of the tree add up, and the closures of the joints it leaves open."""
    centres = list(bare.centres)
    now = bare
    for step in steps:
        if step.joint is None:
            i, j = next((i, j) for link, i, j in bare.free if link == step.link)
            centres[step.link] = (VectorTerm(none + 1, none, NONE, i), VectorTerm(none, none + 1, NONE, j))
        else:
            first, second = ends(step.joint)
            forward = second.link == step.link
            near, far = (first, second) if forward else (second, first)
            path, less = list(now.point(near)), list(now.turned(far.local, far.link))
            if isinstance(step.joint, Prismatic):
                (path if forward else less).extend(now.along(step.joint))
            centres[step.link] = merge(path, less)
        now = replace(now, centres=tuple(centres))
    taken = {id(step.joint) for step in steps}
    closures = []
    for joint in bare.mechanism.joints:
        if id(joint) not in taken:
            first, second = ends(joint)
            less = [*now.point(first), *(now.along(joint) if isinstance(joint, Prismatic) else ())]
            closures.append((joint.name, merge(now.point(second), less)))
    return replace(now, closures=tuple(closures))
