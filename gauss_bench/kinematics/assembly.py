"""Find the loop of a drawn linkage that cannot be closed, how far it stays open, and the lengths that would close it.

Without the pairs that close the loops, the linkage is a tree, which can always be assembled. The loops are then closed one after
the other: one pin of each loop (the chord) is cut, and the two ends of this pin are dragged as near to each other as possible,
while all earlier loops stay closed. The vectors w through the links of the loop add up to the gap g that is left, so that

    |g| = |sum w|,    d|g| / d|w| = (w / |w|) . g / |g|.

A link that is parallel to the gap can therefore close it if its length changes by |g|; a link at right angles to the gap cannot.
"""

from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np

from gauss_bench.kinematics.dragging import Drag
from gauss_bench.kinematics.freedom import Freedom, Place
from gauss_bench.kinematics.topology import Loop, find_graph, pin_loose_links
from gauss_bench.linkage.closure import CLOSED
from gauss_bench.mechanism.coordinates import position
from gauss_bench.mechanism.model import Joint, Mechanism
from gauss_bench.mechanism.spaces import angles
from gauss_bench.terms import Array, largest

TRIES = 6  # number of searches for the nearest position: the first from the drawing, the others after random turns of its links
TURNED = 1.0  # [rad] largest random turn of a link
STEPS = 200  # largest number of steps of a search
ALONG = 0.5  # smallest cosine of the angle between a link and the gap if a change of its length is to close the gap
GENERIC = 0.03  # [sizes of the linkage, rad] distance to a neighbouring position, at which J has its usual rank
MOVED = 0.5  # smallest displacement of a linkage that moves, as a share of the attempted step


@dataclass(frozen=True)
class Length:
    """A change of a link that would close a loop: the distance of two points of the link, now and as needed [m]."""

    link: str
    points: tuple[str, str]
    now: float
    needed: float


@dataclass(frozen=True)
class OpenLoop:
    """A loop that does not close.

    Attributes:
        links: names of the links around the loop; the fixed link is "ground".
        at, apart: the pin whose two ends cannot be brought together, and their smallest distance [m].
        alone: whether the loop stays open even if the other loops of the linkage need not be closed.
        lengths: single changes that would close the loop, smallest relative change first, changes on the ground last.
    """

    links: tuple[str, ...]
    at: str
    apart: float
    alone: bool
    lengths: tuple[Length, ...]

    def __str__(self) -> str:
        among = "" if self.alone else " while the loops before it are closed"
        text = f"the loop {'-'.join(self.links)} does not close{among}: at {self.at} its ends stay {self.apart:.4g} m apart"
        if not self.lengths:
            return text
        x = self.lengths[0]
        return f"{text}; it would close with {x.link} ({x.points[0]} to {x.points[1]}) of {x.needed:.4g} m instead of {x.now:.4g} m"


def find_open_loop(mechanism: Mechanism) -> OpenLoop | None:
    """Close the loops of a linkage, starting from its drawn position q0, and return the first that stays open, or None.

    Drivers are ignored.

    Raises:
        ValueError: the tree cannot be assembled, which happens only if numbers are not finite.
    """
    loops = find_graph(pin_loose_links(mechanism)).loops
    undriven = replace(mechanism, drivers=(), knife_edges=())
    chords = [_choose_chord(mechanism, loop, loops[:k]) for k, loop in enumerate(loops)]
    joints = [x for x in mechanism.joints if x not in chords]
    place = _close_joints(undriven, joints, mechanism.q0)
    for loop, chord in zip(loops, chords, strict=True):
        # `joints` are closed already; `chord` is the joint at which the loop is cut open, and still has to be closed
        nearest, gap = _approach(undriven, joints, chord, place)
        if gap > CLOSED:
            others = [x for x in _list_joints(mechanism, loop) if x is not chord]
            _, gap_alone = _approach(undriven, others, chord, place)  # if no other loop has to be closed
            links = tuple(mechanism.link_name(x.link) for x in loop.paths)
            lengths = _closing_lengths(mechanism, loop, chord, nearest.q, gap)
            return OpenLoop(links, chord.joint, gap, gap_alone > CLOSED, lengths)
        joints = [x for x in mechanism.joints if x in joints or x is chord]  # in the order of the file
        place = _close_joints(undriven, joints, nearest.q)
    return None


def _list_joints(mechanism: Mechanism, loop: Loop) -> list[Joint]:
    """Return the joints (pairs) around a loop, in the order of the linkage file."""
    names = {x.leave.pair for x in loop.paths}
    return [x for x in mechanism.joints if x.name in names]


def _choose_chord(mechanism: Mechanism, loop: Loop, before: tuple[Loop, ...]) -> Joint:
    """Return the pair at which a loop is cut open: the last pin in the file, or the last slide if there is no pin.

    Pairs of the loops `before` are left out, unless all pairs of this loop belong to them.
    """
    earlier = {x.name for other in before for x in _list_joints(mechanism, other)}
    own = [x for x in _list_joints(mechanism, loop) if x.name not in earlier] or _list_joints(mechanism, loop)
    return next((x for x in reversed(own) if x.ends_meet), own[-1])


def _close_joints(mechanism: Mechanism, joints: list[Joint], q: Array) -> Place:
    """Return the position near q (n,) in which the given joints are closed.

    Raises:
        ValueError: they cannot be closed by a search that begins at q.
    """
    place = Freedom(replace(mechanism, joints=tuple(joints))).close(q)
    if place is None:
        raise ValueError(f"{mechanism.name}: its joints cannot be closed from the drawing")
    return place


def _approach(mechanism: Mechanism, joints: list[Joint], chord: Joint, place: Place) -> tuple[Place, float]:
    """Return the position in which the two ends of `chord` are nearest to each other, and their distance there [m].

    The joints stay closed. The search begins at `place`, and is repeated with randomly turned links, because a drag may stop at a
    local minimum. A slide has no point to drag: its distance is 0 if it can be closed, else infinite.
    """
    opened = replace(mechanism, joints=tuple(joints))
    if not chord.ends_meet:  # a slide: there is no pin at which the loop could be cut
        closed = Freedom(replace(opened, joints=(*joints, chord))).close(place.q)
        return (place, np.inf) if closed is None else (closed, 0.0)
    best, apart, rng = place, np.inf, np.random.default_rng(0)
    onto, point = chord.ends
    for attempt in range(TRIES):
        q = np.array(place.q)
        angles(q)[:] += rng.uniform(-TURNED, TURNED, size=len(mechanism.links)) if attempt else 0.0
        with suppress(ValueError):  # the turned links do not close: the next attempt turns them differently
            drag = Drag(opened, q, point, onto=onto)
            dragged = drag.to(np.zeros(2), STEPS)  # the target is a zero vector from `onto` to `point`
            if dragged.reached:
                return drag.place, 0.0
            if dragged.apart < apart:
                best, apart = drag.place, dragged.apart
    return best, apart


def _closing_lengths(mechanism: Mechanism, loop: Loop, chord: Joint, q: Array, apart: float) -> tuple[Length, ...]:
    """Return the changes of length that would close a loop, in the order of `OpenLoop.lengths`.

    In the position q (n,) the ends of the pin `chord` are nearest to each other, at the distance `apart` [m].
    """
    if not chord.ends_meet:
        return ()
    lengths: list[Length] = []
    a, b = chord.ends
    gap = position(q, b) - position(q, a)
    leaving = next(x for x in loop.paths if x.leave.pair == chord.name)  # the path that ends at the chord
    # if this path ends at the point a, the loop goes on from a to b, and the vectors of the loop add up to a - b = -gap
    sense = -1.0 if leaving.link == a.link else 1.0
    pins = {x.name: x.ends for x in mechanism.joints if x.ends_meet}
    for path in loop.paths:
        ends = [*pins.get(path.enter.pair, ()), *pins.get(path.leave.pair, ())]
        points = [end for end in ends if end.link == path.link]
        if len(points) < 2:  # the loop enters or leaves the link by a slide
            continue
        vector = position(q, points[1]) - position(q, points[0])
        length = float(np.hypot(*vector))
        # the gap grows by `cosine` per metre of this length, so that to first order a change by -apart / cosine closes it
        cosine = sense * float(vector @ gap) / (length * apart) if length else 0.0
        needed = length - apart / cosine if abs(cosine) > ALONG else 0.0
        if needed > 0.0:
            first, second = (point.name.partition(".")[2] for point in points)
            lengths.append(Length(mechanism.link_name(path.link), (first, second), length, needed))
    return tuple(sorted(lengths, key=lambda x: (x.link == "ground", abs(x.needed / x.now - 1.0))))


def rank_about(mechanism: Mechanism, q: Array) -> int:
    """Return the rank of the Jacobian J of the joints at a generic position near q (n,), or at q if the joints are open there.

    It is the largest of the ranks at q and at neighbouring positions to which the linkage can move. Two bars that are stretched
    along one line cannot move, although J loses rank. All links of such a linkage are turned slightly, which opens the joints: J
    would have the same rank with closed joints and slightly different lengths.
    """
    freedom, rng = Freedom(replace(mechanism, drivers=(), knife_edges=())), np.random.default_rng(0)
    place = freedom.close(q)
    if place is None:
        _, here = freedom.evaluate(q)
        return _rank(here)
    rank = _rank(place)
    is_generic = not place.free.size  # without a free motion J has full column rank, the largest possible
    for _ in range(3):
        motion = place.free @ rng.normal(size=place.free.shape[1])  # in scaled coordinates
        size = largest(motion) or 1.0
        step = motion * (GENERIC * freedom.size / size) / freedom.scale
        neighbour = freedom.close(place.q + step)
        # a projection that comes back to the start shows that the linkage cannot move like this
        if neighbour is None or np.abs((neighbour.q - place.q) * freedom.scale).max() < MOVED * np.abs(step * freedom.scale).max():
            continue
        is_generic, rank = True, max(rank, _rank(neighbour))
    if is_generic or rank == len(place.J):  # the rank cannot exceed the number of rows
        return rank
    # there is no neighbouring position: turn the links and leave the joints open
    turned = np.array(place.q)
    angles(turned)[:] += rng.uniform(-GENERIC, GENERIC, size=len(mechanism.links))
    _, neighbour = freedom.evaluate(turned)
    return max(rank, _rank(neighbour))


def _rank(place: Place) -> int:
    """Return the rank of the Jacobian of the joints: the number of coordinates minus that of free motions."""
    return len(place.q) - int(place.free.shape[1])
