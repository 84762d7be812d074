"""Whether a drawn linkage can be put together and, if not, which loop stays open, how far, and which length would close it.

Without the pairs that close the loops the linkage is a tree, which can always be put together. The loops are then closed one after
the other: the two ends of the pin that closes the next are drawn together as near as they come, those before it staying closed. At
the nearest, with the gap g from the one end to the other and w the way of the loop through a link,

    |g| = |sum w|,    d|g| / d|w| = (w / |w|) . g / |g|

so that a link along the gap closes it by as much as the gap is long, and one across it never does.
"""

from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np

from gauss_bench.kinematics.dragging import Drag
from gauss_bench.kinematics.freedom import Freedom, Place
from gauss_bench.kinematics.topology import Loop, find_graph, held_coordinates
from gauss_bench.linkage.closure import CLOSED
from gauss_bench.mechanism.coordinates import position
from gauss_bench.mechanism.model import Joint, Mechanism
from gauss_bench.mechanism.spaces import angles
from gauss_bench.terms import Array

TRIES = 6  # from the drawing, then from drawings with links turned by lot: the nearest of all is told
TURNED = 1.0  # [rad] at most
ALONG = 0.5  # cosine from which a link counts as lying along the gap
GENERIC = 0.03  # of the linkage's size, or [rad]: off a position where the rank is lower than elsewhere
MOVED = 0.5  # of a step along what is free: a linkage that is less far on afterwards has not moved


@dataclass(frozen=True)
class Length:
    """A length that closes a loop: between two points of a link, what it is and what it would have to be [m]."""

    link: str
    points: tuple[str, str]
    now: float
    needed: float


@dataclass(frozen=True)
class OpenLoop:
    """A loop that does not close.

    Attributes:
        joints: of the loop, in order. links: that they join, the frame as "ground".
        at: the pin whose ends stay apart. apart: how far, at best [m].
        alone: whether the loop stays open by itself, and not only because of the loops before it.
        lengths: what would close it, the smallest change first.
    """

    joints: tuple[str, ...]
    links: tuple[str, ...]
    at: str
    apart: float
    alone: bool
    lengths: tuple[Length, ...]

    def __str__(self) -> str:
        among = "" if self.alone else " while the loops before it are closed"
        told = f"the loop {'-'.join(self.links)} does not close{among}: at {self.at} its ends stay {self.apart:.4g} m apart"
        if not self.lengths:
            return told
        x = self.lengths[0]
        return f"{told}; it would with {x.link} ({x.points[0]} to {x.points[1]}) of {x.needed:.4g} m instead of {x.now:.4g} m"


@dataclass(frozen=True, eq=False)
class Assembly:
    """The result of assembling a linkage.

    Attributes:
        q: (n,) the position with all loops closed, or with those before the open one.
        open: the first loop that does not close, or None.
        dof, redundant: degrees of freedom, and rows of the joints beyond their rank, at a position near q that is not singular;
            the joint that stays open is left out.
        loops: links of every independent loop, in order.
    """

    q: Array
    open: OpenLoop | None
    dof: int
    redundant: int
    loops: tuple[tuple[str, ...], ...]


def put_together(mechanism: Mechanism) -> Assembly:
    """Close the loops of a linkage, starting from its drawn position q0; drivers are ignored.

    Raises:
        ValueError: the tree of its joints cannot be put together, which numbers that are not finite alone bring about.
    """
    graph = find_graph(held_coordinates(mechanism))
    names = tuple(tuple(_links(mechanism, loop)) for loop in graph.loops)
    bare = replace(mechanism, drivers=(), knife_edges=())
    chords = [_open(mechanism, loop, graph.loops[:k]) for k, loop in enumerate(graph.loops)]
    joints = [x for x in mechanism.joints if x not in chords]
    place, open_loop = _close(bare, joints, mechanism.q0), None
    for loop, chord in zip(graph.loops, chords, strict=True):
        nearer, gap = _nearest(bare, joints, chord, place)
        if gap > CLOSED:
            alone = _nearest(bare, [x for x in _joints(mechanism, loop) if x is not chord], chord, place)
            open_loop = _describe(mechanism, loop, chord, nearer.q, gap, alone[1] > CLOSED)
            break
        joints = [x for x in mechanism.joints if x in joints or x is chord]
        place = _close(bare, joints, nearer.q)
    rank = _rank(replace(bare, joints=tuple(joints)), place)
    return Assembly(place.q, open_loop, mechanism.n - rank, 2 * len(joints) - rank, names)


def _links(mechanism: Mechanism, loop: Loop) -> list[str]:
    return [mechanism.link_name(x.link) for x in loop.passages]


def _joints(mechanism: Mechanism, loop: Loop) -> list[Joint]:
    names = {x.leave.name for x in loop.passages}
    return [x for x in mechanism.joints if x.name in names]


def _open(mechanism: Mechanism, loop: Loop, before: tuple[Loop, ...]) -> Joint:
    """Return the pair at which a loop is cut open: the last pin in the file that no earlier loop uses, else the last pair."""
    earlier = {x.name for other in before for x in _joints(mechanism, other)}
    own = [x for x in _joints(mechanism, loop) if x.name not in earlier] or _joints(mechanism, loop)
    return next((x for x in reversed(own) if not x.slides), own[-1])


def _close(mechanism: Mechanism, joints: list[Joint], q: Array) -> Place:
    place = Freedom(replace(mechanism, joints=tuple(joints))).close(q)
    if place is None:
        raise ValueError(f"{mechanism.name}: its joints cannot be put together from the drawing")
    return place


def _nearest(mechanism: Mechanism, joints: list[Joint], chord: Joint, place: Place) -> tuple[Place, float]:
    """Return the position in which the ends of a pair are nearest to each other, and their distance there [m]."""
    part = replace(mechanism, joints=tuple(joints))
    if chord.slides:  # a loop of slides alone
        closed = Freedom(replace(part, joints=(*joints, chord))).close(place.q)
        return (place, np.inf) if closed is None else (closed, 0.0)
    best, apart, rng = place, np.inf, np.random.default_rng(0)
    onto, point = chord.ends
    for attempt in range(TRIES):
        q = np.array(place.q)
        angles(q)[:] += rng.uniform(-TURNED, TURNED, size=len(mechanism.links)) if attempt else 0.0
        with suppress(ValueError):
            drag = Drag(part, q, point, onto=onto)
            dragged = drag.to(np.zeros(2), most=200)
            if dragged.reached:
                return drag.place, 0.0
            if dragged.apart < apart:
                best, apart = drag.place, dragged.apart
    return best, apart


def _describe(mechanism: Mechanism, loop: Loop, chord: Joint, q: Array, apart: float, alone: bool) -> OpenLoop:
    lengths: list[Length] = []
    if not chord.slides:
        a, b = chord.ends
        gap = position(q, b) - position(q, a)
        at = next(k for k, x in enumerate(loop.passages) if x.leave.name == chord.name)
        sense = -1.0 if loop.passages[at].link == a.link else 1.0  # the loop passes from a to b: its ways add up to a - b
        pins = {pin.name: pin.ends for pin in mechanism.pins}
        for passage in loop.passages:
            pairs = (passage.enter.name, passage.leave.name)
            points = [end for pair in pairs for end in pins.get(pair, ()) if end.link == passage.link]
            if len(points) < 2:
                continue
            way = position(q, points[1]) - position(q, points[0])
            now = float(np.hypot(*way))
            cosine = sense * float(way @ gap) / (now * apart) if now else 0.0
            needed = now - apart / cosine if abs(cosine) > ALONG else 0.0
            if needed > 0.0:
                names = [point.name.partition(".")[2] for point in points]
                lengths.append(Length(mechanism.link_name(passage.link), (names[0], names[1]), now, needed))
    lengths.sort(key=lambda x: (x.link == "ground", abs(x.needed / x.now - 1.0)))
    return OpenLoop(loop.joints, tuple(_links(mechanism, loop)), chord.joint, apart, alone, tuple(lengths))


def rank_about(mechanism: Mechanism, q: Array) -> int:
    """Return the rank of the joint rows at a generic position near q (n,), or at q itself if the joints are open there."""
    bare = replace(mechanism, drivers=(), knife_edges=())
    place = Freedom(bare).close(q)
    if place is None:
        return mechanism.n - int(Freedom(bare).at(q)[1].free.shape[1])
    return _rank(bare, place)


def _rank(mechanism: Mechanism, place: Place) -> int:
    """Return the rank of the joint rows at a generic position: the largest of those at the place and beside it.

    Bars in one line seem free by their rank but cannot move, so there is no position beside them. Then the rank is computed with
    slightly rotated links: it is that of a linkage with slightly different lengths.
    """
    freedom, rng = Freedom(mechanism), np.random.default_rng(0)
    here = rank = mechanism.n - int(place.free.shape[1])
    moves = not place.free.size
    for _ in range(3):
        way = place.free @ rng.normal(size=place.free.shape[1])
        size = float(np.abs(way).max(initial=0.0)) or 1.0
        step = way * (GENERIC * freedom.size / size) / freedom.scale
        beside = freedom.close(place.q + step)
        if beside is None or np.abs((beside.q - place.q) * freedom.scale).max() < MOVED * np.abs(step * freedom.scale).max():
            continue
        moves, rank = True, max(rank, mechanism.n - int(beside.free.shape[1]))
    if moves or here == len(place.J):
        return rank
    turned = np.array(place.q)
    angles(turned)[:] += rng.uniform(-GENERIC, GENERIC, size=len(mechanism.links))
    return max(rank, mechanism.n - int(freedom.at(turned)[1].free.shape[1]))
