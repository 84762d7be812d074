"""Draw the names of links, points and forces in a drawing, as far from lines as possible and not over other names."""

from collections.abc import Sequence
from xml.sax.saxutils import escape

import numpy as np

from gauss_bench.mechanism.coordinates import position
from gauss_bench.mechanism.model import Mechanism, Revolute
from gauss_bench.report.drawings.canvas import Canvas, Part, direction
from gauss_bench.report.palette import CRANK_EDGE, INK, MUTED
from gauss_bench.terms import Array

LETTER = 6.6  # [px] mean width of a letter at a size of 13 px
# letter -> its width [px] at a size of 13 px, in the widest of the fonts
WIDTHS = {letter: width for letters, width in (("il.,'|j", 3.6), ("frtI-()", 5.0), ("mwMW_", 11.0)) for letter in letters}
OTHERS = 8.3  # [px] width of all other letters
TALL = 13.0  # [px] height of a name
FAR = 22.0  # [px] places of a link's name that are farther than this from all lines are equally good
NEAR = 8.0  # [px] the same for names of points and forces, which must stay near their parts
EDGE = 3.0  # [px] smallest distance of a name from the edge of the picture, or from another name
AROUND = direction(-np.linspace(0, 2 * np.pi, 24, endpoint=False))  # (24, 2) unit vectors


def width_of(name: str, size: float = 13.0) -> float:
    """Return an upper estimate of the width [px] of a name in letters of a size [px]."""
    return size / 13 * sum(WIDTHS.get(letter, OTHERS) for letter in name)


def box_of(name: str, middle: Array, size: float = 13.0) -> Array:
    """Return the box (left, top, right, bottom) [px] of a name whose middle is at `middle` (2,) [px]."""
    half = np.array([width_of(name, size) / 2, TALL / 2 * size / 13])
    return np.concatenate([middle - half, middle + half])


def draw_names(mechanism: Mechanism, q: Array, canvas: Canvas, parts: Sequence[Part], taken: Array, bar: Array) -> list[str]:
    """Return the SVG texts of the names of joints, observed points, links, forces and drivers at state q (n,).

    Names of joints and observed points are placed first, then those of links, then those of forces and drivers. A force or driver
    has no name in the drawing if every place overlaps another name, the edge of the picture or a line.

    Args:
        taken: box (4,) [px] that is occupied already.
        bar: a further line (2, 2) [px] from which names keep away.
    """
    boxes, size = [taken], (canvas.width, canvas.height)
    segments = np.vstack([*(part.lines() for part in parts), bar[None]])
    named = []  # name, candidate places, room beyond which places are equally good, style, whether the name may be left out
    for name, point in _named_points(mechanism, q, canvas):
        wide = np.array([width_of(name) / 2 - 4.0, 0.0])  # half a name minus 4 px, so that a name beside a point is close to it
        # candidates around the point: at these distances [px] in all directions, and further to the sides for a wide name
        places = [point + r * unit + wide * unit for r in (15.0, 18.0, 21.0, 27.0, 34.0) for unit in AROUND]
        named.append((name, places, NEAR, f'fill="{INK}" font-style="italic"', False))
    for part in parts:  # links
        if part.title:
            # a part whose `reach` is empty counts as a line of zero length at its origin
            lines = part.lines() if len(part.reach) else np.tile(part.place[0], (1, 2, 1))
            named.append((part.title, _beside_lines(part.title, lines), FAR, f'fill="{MUTED}"', False))
    for part in parts:  # forces and drivers
        if part.name and len(part.reach):
            named.append((part.name, _beside_lines(part.name, part.lines()), NEAR, f'fill="{CRANK_EDGE}"', True))
    texts = []
    for name, places, enough, style, is_optional in named:
        place, room = _choose_place(places, name, segments, boxes, size, enough)
        if room > 0 or not is_optional:
            boxes.append(box_of(name, place))
            x, y = place[0], place[1] + 4.5  # SVG places the base line, 4.5 px below the middle
            texts.append(f'<text x="{x:.1f}" y="{y:.1f}" text-anchor="middle" {style}>{escape(name)}</text>')
    return texts


def _beside_lines(name: str, lines: Array) -> list[Array]:
    """Return places (2,) [px] for the middle of a name, around several points of each of the lines (l, 2, 2) [px].

    `_choose_place` takes the first of equally good places: places near a line, and near the middle of the line, come first.
    """
    # the middle of a name to the right or left of a point is half the name's width farther away than that of a name above it
    wide = np.array([width_of(name) / 2, 0.0])
    spots = [a + share * (b - a) for share in (0.5, 0.35, 0.65, 0.2, 0.8) for a, b in lines]
    # at these distances r [px], in every second direction of AROUND
    return [spot + r * unit + wide * unit for r in (13.0, 19.0, 27.0) for spot in spots for unit in AROUND[::2]]


def _named_points(mechanism: Mechanism, q: Array, canvas: Canvas) -> list[tuple[str, Array]]:
    """Return (name, place (2,) [px]) of joints and observed points; of several at one place, only the first."""
    named = [(j.joint, j.a if isinstance(j, Revolute) else j.block) for j in mechanism.joints]
    named += [(p.name.partition(".")[2], p) for p in mechanism.observed_points]
    name_at: dict[tuple[float, float], str] = {}  # place -> the first name there
    for name, point in named:
        x, y = np.round(canvas.at(position(q, point)), 1)
        name_at.setdefault((float(x), float(y)), name)
    return [(name, np.array(place)) for place, name in name_at.items()]


def _choose_place(
    places: Sequence[Array], name: str, segments: Array, boxes: list[Array], size: tuple[float, float], enough: float
) -> tuple[Array, float]:
    """Return the place with the most room for a name (the first of equal places), and this room [px].

    The room of a place is the distance [px] between the name and the nearest line; it is negative if the name overlaps a line,
    another name or the edge of the picture. Places with more room than `enough` are equally good. `segments` (l, 2, 2) are the
    lines [px], `boxes` the boxes (4,) of the names so far, and `size` is that of the picture.
    """
    half = width_of(name) / 2
    samples = np.linspace(-half, half, max(3, len(name)))
    middle_line = np.stack([samples, np.zeros_like(samples)], axis=-1)  # (..., 2) points of the name, from left to right
    others = np.array(boxes)

    def room(place: Array) -> float:
        """Return the room [px] of the name with its middle at `place` (2,) [px]; -10 times the overlap with a name or edge."""
        box = box_of(name, place)
        inside = min(box[0], box[1], size[0] - box[2], size[1] - box[3]) - EDGE
        # distances from other boxes along the axis on which they are farther apart; negative for boxes that overlap
        gaps = np.maximum(others[:, :2] - box[2:], box[:2] - others[:, 2:]).max(axis=1) - EDGE
        free = min(float(inside), float(gaps.min(initial=FAR)))
        if free < 0:
            return 10 * free  # overlapping another name is worse than crossing a line
        return float(min(distance(place + middle_line, segments) - TALL / 2, enough))

    rooms = [round(room(place), 1) for place in places]
    best = int(np.argmax(rooms))
    return places[best], rooms[best]


def distance(points: Array, segments: Array) -> float:
    """Return the shortest distance between points (k, 2) and segments (l, 2, 2)."""
    start, along = segments[:, 0], segments[:, 1] - segments[:, 0]
    square = np.maximum((along**2).sum(-1), 1e-12)
    # (k, l) foot of the perpendicular from a point, as a share of the segment, limited to the segment
    share = np.clip(((points[:, None] - start) * along).sum(-1) / square, 0, 1)
    gap = points[:, None] - start - share[..., None] * along  # (k, l, 2)
    return float(np.hypot(gap[..., 0], gap[..., 1]).min())
