"""The spanning tree of a linkage and the joints that close its loops, for engines in relative coordinates.

A branch connects a link to its parent by a joint, and has one coordinate y; the branch of a free link has three coordinates.
Vectors of the plane are complex numbers: z is the centre of mass of the link, theta its angle, r = exp(i theta) anchor the vector
from z to the joint, and E = exp(i theta_parent). The kinds of branches, with the names of the attributes of `Branch`, are:

    revolute:    theta = theta_parent + y,      z + r = z_parent + E parent_anchor
    prismatic:   theta = theta_parent + turn,   z + r = z_parent + E (parent_anchor + base + y axis)
    free:        The coordinates are x, y and theta of the centre of mass.

Slides enter the tree before pins, so loops are closed by pins wherever possible. Branches are listed depth first. The map to
absolute coordinates computes with Python numbers for a single state (n,), which is fastest, and with numpy for a batch of states
(..., n).
"""

import cmath
from collections import defaultdict
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from heapq import heappop, heappush
from typing import Any, NamedTuple

import numpy as np

from gauss_bench.mechanism.coordinates import state
from gauss_bench.mechanism.equations import Symbols
from gauss_bench.mechanism.frames import unit
from gauss_bench.mechanism.model import GROUND, Along, Angle, Coordinate, Joint, Mechanism, Point, Prismatic
from gauss_bench.mechanism.spaces import SIZE
from gauss_bench.terms import Array


@dataclass(frozen=True, eq=False)
class Branch:
    """A link and the joint that connects it to its parent, or to the ground (GROUND); `kind` is "revolute", "prismatic" or "free".

    Attributes:
        joint: the joint of the linkage; None for a free link.
        at: index of the branch's tree coordinate, or of the first of three.
        parent_anchor, anchor: (2,) [m] the joint's point in the parent's frame and in the link's frame; the origin of a frame is
            the centre of mass.
        base: (2,) [m] for a slide: vector from parent_anchor to the line of the moving anchor, in the parent's frame; else zero.
        axis: (2,) for a slide: unit vector along this line, in the parent's frame; otherwise zero.
        turn: [rad] for a slide: constant angle of the link relative to the parent; otherwise zero.
    """

    link: int
    parent: int
    kind: str
    joint: Joint | None
    at: int
    parent_anchor: Array
    anchor: Array
    base: Array
    axis: Array
    turn: float

    @property
    def coordinates(self) -> tuple[Coordinate, ...]:
        """The tree coordinates of this link's joint: relative angles and displacements between the parent and the link.

        A pin has an angle, a slide a displacement along its axis, and a free link both displacements and the angle.
        """
        if self.kind == "revolute":
            return (Angle(self.parent, self.link),)
        # a free link is displaced along the x and y axes of its parent, the ground
        near, far = Point(self.parent, self.parent_anchor, ""), Point(self.link, self.anchor, "")
        if self.kind == "prismatic":
            return (Along(near, far, float(np.arctan2(self.axis[1], self.axis[0]))),)
        return Along(near, far, 0.0), Along(near, far, 0.0, across=True), Angle(self.parent, self.link)

    @cached_property
    def vectors(self) -> tuple[complex, complex, complex, complex]:
        """The vectors parent_anchor, anchor, base and axis as complex numbers."""
        near, far, base, axis = (complex(*x) for x in (self.parent_anchor, self.anchor, self.base, self.axis))
        return near, far, base, axis


class AbsoluteState(NamedTuple):
    """Positions q, velocities v and accelerations a of all links, (..., 3 links) each."""

    q: Array
    v: Array
    a: Array


@dataclass(frozen=True, eq=False)
class Tree:
    """A spanning tree of the joints of a linkage.

    Attributes:
        branches: in depth-first order, so that a parent comes before its children.
        closures: the joints that are not in the tree and close loops.
        n: number of tree coordinates.
    """

    branches: tuple[Branch, ...]
    closures: tuple[Joint, ...]
    n: int
    links: int

    def absolute(self, y: Array, dy: Array, ddy: Array) -> AbsoluteState:
        """Map tree states y, y', y'' (..., n) to absolute q, v, a (..., 3 links), link by link from the ground outwards."""
        exp = exponential(y)
        Y, dY, ddY = columns(y), columns(dy), columns(ddy)
        # link -> complex position of its centre of mass, and its angle; then likewise velocities and accelerations
        rest = (0j, 0.0)
        q, v, a = {GROUND: rest}, {GROUND: rest}, {GROUND: rest}
        for b in self.branches:
            k, i, p = b.at, b.link, b.parent
            if b.kind == "free":
                q[i], v[i], a[i] = ((x[k] + 1j * x[k + 1], x[k + 2]) for x in (Y, dY, ddY))
                continue
            near, far, base, axis = b.vectors
            (z, theta), (u, w), (c, alpha) = q[p], v[p], a[p]
            E = exp(1j * theta)
            # arm: from the parent's centre of mass to the joint; slip, slip_rate: velocity and acceleration along the axis
            if b.kind == "revolute":
                arm, slip, slip_rate = E * near, 0.0, 0.0
                theta_i, w_i, alpha_i = theta + Y[k], w + dY[k], alpha + ddY[k]
            else:
                arm, slip, slip_rate = E * (near + base + Y[k] * axis), E * axis * dY[k], E * axis * ddY[k]
                theta_i, w_i, alpha_i = theta + b.turn, w, alpha
            r = exp(1j * theta_i) * far  # from the child's centre of mass to the joint
            # acceleration of the joint relative to the parent's centre: Euler, centripetal, Coriolis and relative terms
            relative = (1j * alpha - w * w) * arm + 2j * w * slip + slip_rate
            q[i] = (z + arm - r, theta_i)
            v[i] = (u + 1j * w * arm + slip - 1j * w_i * r, w_i)
            a[i] = (c + relative - (1j * alpha_i - w_i * w_i) * r, alpha_i)
        shape = y.shape[:-1]
        return AbsoluteState(self._stack(q, shape), self._stack(v, shape), self._stack(a, shape))

    def _stack(self, states: dict[int, Any], shape: tuple[int, ...]) -> Array:
        """Return an array (*shape, 3 links) with x, y and angle of each link, or their rates.

        Args:
            states: link -> (x + i y, angle).
            shape: shape of these numbers; empty for a single state.
        """
        stacked = np.empty((*shape, self.links, 3))
        for i in range(self.links):
            z, theta = states[i]
            stacked[..., i, 0], stacked[..., i, 1], stacked[..., i, 2] = z.real, z.imag, theta
        return stacked.reshape(*shape, -1)

    @cached_property
    def _coordinates(self) -> Callable[..., list[Array]]:
        """A generated function (t, q, v) -> tree coordinates (..., n), their rates (..., n)."""
        symbols = Symbols(SIZE * self.links)  # of q and v
        states = [state(coordinate, symbols) for b in self.branches for coordinate in b.coordinates]
        return symbols.generate([x.value for x in states], [x.rate for x in states])

    def relative(self, q: Array, v: Array) -> tuple[Array, Array]:
        """Map absolute states q, v (..., 3 links) to tree coordinates and rates (..., n).

        Gaps at joints of the tree have no effect.
        """
        y, dy = self._coordinates(0.0, q, v)  # at t = 0: the time has no effect
        return y, dy

    def forces(self, q: Array, Q: Array) -> Array:
        """Return the generalised forces V^T Q (..., n) on the tree coordinates for absolute forces Q (..., 3 links) at q."""
        y, _ = self.relative(q, np.zeros_like(q))
        return np.asarray((self.unit_speeds(y) @ Q[..., None])[..., 0])

    def unit_speeds(self, y: Array) -> Array:
        """Return V^T (..., n, 3 links): row k holds the absolute speeds if tree rate k is 1 and all others are 0, at y (..., n)."""
        repeated, zeros = np.broadcast_to(y[..., None, :], (*y.shape, self.n)), np.zeros((*y.shape, self.n))
        return self.absolute(repeated, zeros + np.eye(self.n), zeros).v


def exponential(x: Array) -> Callable[[Any], Any]:
    """Return the function that computes complex exponentials: cmath.exp for a single state x (n,), numpy.exp for a batch."""
    return cmath.exp if x.ndim == 1 else np.exp


def columns(x: Array) -> Any:
    """Return the n coordinates of x one by one, as Python numbers for a state (n,) or arrays (...) for a batch (..., n)."""
    return x.tolist() if x.ndim == 1 else np.moveaxis(x, -1, 0)


@dataclass(frozen=True, eq=False)
class Turning:
    """The angles of all links as sums of tree coordinates: theta = rows . y + constants.

    Attributes:
        rows: (links + 1, n) matrix of zeros and ones; the last row belongs to the ground.
        constants: (links + 1,) [rad]; the last entry belongs to the ground.
    """

    rows: Array
    constants: Array

    def together(self, a: int, b: int) -> bool:
        """Tell whether two links never turn relative to each other: the same hinges turn both."""
        return bool((self.rows[a] == self.rows[b]).all())

    def turns_with(self, a: int, b: int) -> bool:
        """Tell whether every hinge that turns link a also turns link b."""
        return bool((self.rows[a] <= self.rows[b]).all())

    def apart(self, a: int, b: int) -> bool:
        """Tell whether the paths of two links to the ground have no hinge in common."""
        return not (self.rows[a] * self.rows[b]).any()


def turning(tree: Tree) -> Turning:
    """Return the links' angles as functions of the tree coordinates."""
    rows, constants = np.zeros((tree.links + 1, tree.n)), np.zeros(tree.links + 1)
    for b in tree.branches:  # a parent's row is complete before its children use it; GROUND = -1 is the last row, of zeros
        rows[b.link], constants[b.link] = rows[b.parent], constants[b.parent] + b.turn
        if b.kind != "prismatic":
            rows[b.link, b.at + (2 if b.kind == "free" else 0)] = 1.0
    return Turning(rows, constants)


def ends(joint: Joint) -> tuple[int, int]:
    """Return the indices of a joint's two links: guide and block of a slide, a and b of a pin."""
    first, second = joint.ends
    return first.link, second.link


def spanning_tree(mechanism: Mechanism, least_depth: bool = False) -> Tree:
    """Return a spanning tree that takes slides first, then pins; a group of links without a path to the ground has one free link.

    Args:
        least_depth: whether the tree has the pins with which the path of every link to the ground has the fewest joints. If not,
            pins are taken in the order of the linkage's file unless they close a loop, which makes long chains.
    """
    slides = _without_loops(mechanism, mechanism.slides)
    chosen = _nearest(mechanism, slides) if least_depth else _without_loops(mechanism, [*slides, *mechanism.pins])
    neighbours = _neighbours(joint for joint in mechanism.joints if joint in chosen)  # in the order of the file
    branches: dict[int, Branch] = {}  # link -> its branch
    n = 0  # number of tree coordinates so far

    def descend(parent: int) -> None:
        """Add a branch, with one coordinate, for each link joined to `parent` that has none yet, and go on from there."""
        nonlocal n
        for joint, child in neighbours[parent]:
            if child != GROUND and child not in branches:
                branches[child] = _branch(joint, parent, child, n)
                n += 1
                descend(child)

    descend(GROUND)
    origin = np.zeros(2)  # also stands for the vectors that a free link does not have
    for link in range(len(mechanism.links)):
        if link not in branches:
            branches[link] = Branch(link, GROUND, "free", None, n, origin, origin, origin, origin, 0.0)
            n += 3
            descend(link)
    closures = tuple(joint for joint in mechanism.joints if joint not in chosen)
    return Tree(tuple(branches.values()), closures, n, len(mechanism.links))


def _without_loops(mechanism: Mechanism, joints: Sequence[Joint]) -> list[Joint]:
    """Return the joints, in order, without those that close a loop with earlier ones (Kruskal's algorithm)."""
    group = {i: i for i in range(GROUND, len(mechanism.links))}  # link -> number of its group; joints connect the links of a group
    chosen = []
    for joint in joints:
        a, b = (group[i] for i in ends(joint))
        if a != b:
            chosen.append(joint)
            group = {i: a if g == b else g for i, g in group.items()}
    return chosen


def _nearest(mechanism: Mechanism, slides: Sequence[Joint]) -> list[Joint]:
    """Return all slides, and the pins that give every link the path with the fewest joints to the ground (Dijkstra's algorithm).

    When the search reaches a link, it also reaches all links that slides connect to it, because a pin to one of them would close a
    loop that contains a slide. Paths of a group of links without a connection to the ground start from its first link.
    """
    by_slides, by_pins = _neighbours(slides), _neighbours(mechanism.pins)
    chosen: list[Joint] = []
    reached: set[int] = set()
    waiting: list[tuple[int, int]] = []  # (depth, link), nearest first

    def reach(link: int, depth: int) -> None:
        """Mark a link at `depth` joints from the ground as reached and queue it; choose its slides, and go on along them."""
        reached.add(link)
        heappush(waiting, (depth, link))
        for joint, other in by_slides[link]:
            if other not in reached:
                chosen.append(joint)
                reach(other, depth + 1)

    for root in range(GROUND, len(mechanism.links)):
        if root not in reached:
            reach(root, 0)
        while waiting:
            depth, link = heappop(waiting)
            for joint, other in by_pins[link]:
                if other not in reached:
                    chosen.append(joint)
                    reach(other, depth + 1)
    return chosen


def _neighbours(joints: Iterable[Joint]) -> defaultdict[int, list[tuple[Joint, int]]]:
    """Return link -> pairs of a joint of the link and the link at the joint's other end."""
    neighbours: defaultdict[int, list[tuple[Joint, int]]] = defaultdict(list)
    for joint in joints:
        a, b = ends(joint)
        neighbours[a].append((joint, b))
        neighbours[b].append((joint, a))
    return neighbours


def _branch(joint: Joint, parent: int, child: int, at: int) -> Branch:
    """Return the branch from `parent` to `child`, whose coordinate has the index `at`.

    If the parent is the second link of a slide, the slide's offset, direction and turn change their signs, and the direction is
    converted to the parent's frame.
    """
    zero = np.zeros(2)
    first, second = joint.ends
    forward = first.link == parent
    near, far, sign = (first, second, 1.0) if forward else (second, first, -1.0)
    if not isinstance(joint, Prismatic):
        return Branch(child, parent, "revolute", joint, at, near.local, far.local, base=zero, axis=zero, turn=0.0)
    # direction of the slide in the parent's frame [rad]; base: from the near point to the line on which the far point moves
    theta = joint.angle if forward else joint.angle - joint.turn
    base, axis = sign * joint.offset * unit(theta, across=True), sign * unit(theta)
    return Branch(child, parent, "prismatic", joint, at, near.local, far.local, base=base, axis=axis, turn=sign * joint.turn)
