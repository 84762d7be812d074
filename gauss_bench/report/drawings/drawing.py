"""Draw a linkage as SVG: links are rounded bars, pins are circles, slides are blocks on their guides, the ground is hatched.

A link is drawn once, in its own frame, with its guides and blocks. Pixels are rounded, so that equal states give equal files.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import pairwise

import numpy as np
from scipy.spatial import ConvexHull

from gauss_bench.mechanism.coordinates import position, value
from gauss_bench.mechanism.model import GROUND, Link, Mechanism, Point, Prismatic, Revolute
from gauss_bench.report.drawings.canvas import MARGIN, Canvas, Part, direction, make_part, make_svg, path_data, stroke, turn_left
from gauss_bench.report.drawings.forces import attachments, force_parts
from gauss_bench.report.drawings.lettering import box_of, distance, draw_names
from gauss_bench.report.palette import BODY, BODY_EDGE, CRANK, CRANK_EDGE, INK, MUTED, PAPER, TRACE
from gauss_bench.terms import Array

WIDTH, LONGEST = 640.0, 500.0  # page width and largest drawing height [px]
BAR = 13.0  # width of a link [px]
BEYOND = 36.0  # length of a guide beyond the travel of its block [px]
FLAT = 1e-6  # relative to a link's size: points that are closer than this to one line have no hull
ON_PIN = 0.5  # [px] an observed point that stays this near to a pin gets a smaller dot, inside the pin
ROUND = (1e-3, 1e-2, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0)  # lengths of the scale bar [m]
PIN = f'<circle r="4.5" fill="{PAPER}" stroke="{INK}" stroke-width="1.6"/>'
BLOCK = f'<rect x="-19" y="-11" width="38" height="22" rx="3" fill="{BODY}" stroke="{BODY_EDGE}" stroke-width="1.5"/>'
FOOT = f'<path d="M0 0L-12 22L12 22Z" fill="{PAPER}" stroke="{INK}" stroke-width="1.5" stroke-linejoin="round"/>'
GUIDE = f'stroke="{MUTED}" stroke-dasharray="9 3 2 3"'


def draw(mechanism: Mechanism, q: Array | None = None, trace: Array | None = None) -> str:
    """Return the SVG of a linkage with the names of its parts.

    Args:
        q: state (n,) to draw; by default the start.
        trace: states (k, n) over which the paths of observed points are drawn.
    """
    q = mechanism.q0 if q is None else q
    canvas = fit_canvas(mechanism, q[None] if trace is None else np.vstack([q[None], trace]))
    parts = [*linkage_parts(mechanism, q[None], trace, canvas)]
    scale, taken, ends = place_scale(canvas, np.vstack([part.lines() for part in parts]))
    names = draw_names(mechanism, q, canvas, parts, taken, ends)
    return make_svg(canvas, mechanism.title or mechanism.name, [*draw_shapes(mechanism, trace, canvas, parts), *names, *scale])


def draw_at(mechanism: Mechanism, q: Array, trace: Array, canvas: Canvas) -> str:
    """Return one picture of an animation as SVG: state q (n,), no names, and paths of observed points over `trace` (k, n)."""
    parts = linkage_parts(mechanism, q[None], trace, canvas)
    return make_svg(canvas, mechanism.title or mechanism.name, draw_shapes(mechanism, trace, canvas, parts))


def draw_shapes(mechanism: Mechanism, trace: Array | None, canvas: Canvas, parts: Iterable[Part]) -> list[str]:
    """Return the SVG of the paths of observed points over `trace` (k, n), if given, and of all parts on top."""
    tracks = [] if trace is None else draw_paths(mechanism.observed_points, trace, canvas)
    return [*tracks, *(part.draw() for part in parts)]


def place_scale(canvas: Canvas, avoid: Array) -> tuple[list[str], Array, Array]:
    """Return a scale bar of a round length below 120 px, in the corner farthest from the segments `avoid` (k, 2, 2) [px].

    Returns:
        Its SVG elements, the box (4,) [px] of its text, and both ends of the bar (2, 2) [px].
    """
    length = max(x for x in ROUND if x * canvas.scale < 120 or x == ROUND[0])  # [m]
    half = np.array([length * canvas.scale / 2, 0.0])
    middle = free_corner(canvas, float(half[0]), avoid)
    ends = np.array([middle - half, middle + half])
    (a, y), (b, _) = ends
    bar = f'<path d="M{a:.1f} {y - 4:.1f}V{y:.1f}H{b:.1f}V{y - 4:.1f}" fill="none" stroke="{MUTED}"/>'
    style = f'text-anchor="middle" font-size="11" fill="{MUTED}"'
    text = f'<text x="{(a + b) / 2:.1f}" y="{y - 6:.1f}" {style}>{length:g} m</text>'
    return [bar, text], box_of(f"{length:g} m", ends.mean(axis=0) - np.array([0.0, 10.0]), 11.0), ends


def free_corner(canvas: Canvas, half: float, avoid: Array) -> Array:
    """Return the middle (2,) [px] of a horizontal line in the corner of the picture that is farthest from given segments.

    Args:
        half: half the length of the line [px].
        avoid: segments (k, 2, 2) [px].
    """
    # middles of the line, for margins of 20 px at the sides, 18 px at the bottom and 26 px at the top
    corners = [np.array([x, y]) for y in (canvas.height - 18, 26) for x in (canvas.width - 20 - half, 20 + half)]
    line = np.array([[-half, 0.0], [0.0, 0.0], [half, 0.0]])  # around its middle

    def room(corner: Array) -> float:
        """Return the distance [px] between the line and the segments, as a whole number of at most 100."""
        # corners at 100 px or more are equally good: `max` takes the first
        return min(100.0, round(distance(corner + line, avoid)))

    return max(corners, key=room)


def fit_canvas(mechanism: Mechanism, states: Array, points: Sequence[Point] = ()) -> Canvas:
    """Return a canvas that contains the points of links, the used points of the ground, and `points`, at all states (k, n)."""
    named = [mechanism.point(i, name) for i, link in enumerate(mechanism.links) for name in link.points]
    ends = [p for j in mechanism.joints for p in j.ends]
    ground = [p for p in (*ends, *attachments(mechanism)) if p.link == GROUND]
    positions = np.vstack([position(states, p) for p in (*named, *ground, *points)])  # (..., 2) [m]
    low, high = positions.min(axis=0), positions.max(axis=0)
    span = np.maximum(high - low, 1e-9)
    scale = float(min((WIDTH - 2 * MARGIN) / span[0], (LONGEST - 2 * MARGIN) / span[1]))
    width, height = np.maximum(span * scale + 2 * MARGIN, 200.0).round().tolist()
    return Canvas(low, scale, width, height)


def canvas_of(mechanism: Mechanism, states: Array) -> Canvas:
    """Return a canvas that contains a linkage, its observed points and the guides on its links, at all states (k, n)."""
    slides = [joint for joint in mechanism.joints if isinstance(joint, Prismatic) and joint.guide.link != GROUND]
    # guides on the ground may be cut off, because the canvas contains their blocks
    ends = [end for joint in slides for end in guide_ends(joint, states, extension=0.0)]
    return fit_canvas(mechanism, states, (*mechanism.observed_points, *ends))


def linkage_parts(
    mechanism: Mechanism, states: Array, trace: Array | None, canvas: Canvas, forces: bool = True, letters: Mapping[str, str] = {}
) -> Iterator[Part]:
    """Yield all parts of the drawing of a linkage at states (k, n), from the background to the front.

    Args:
        trace: states (l, n) over which blocks travel along guides on the ground, which cover this travel. By default `states`.
        forces: whether forces and drivers are drawn.
        letters: name of an observed point -> an SVG text that moves with it.
    """
    yield from ground_parts(mechanism, states if trace is None else trace, canvas)
    blocks = {joint.block.link for joint in mechanism.joints if isinstance(joint, Prismatic)}
    # links with a block come first, so that a block lies under the bar on which it slides
    for i in sorted(range(len(mechanism.links)), key=lambda i: (i not in blocks, i)):
        yield link_part(mechanism, i, states, canvas)
    if forces:
        yield from force_parts(mechanism, states, canvas)
    yield from point_parts(mechanism, states, canvas, letters)


def ground_parts(mechanism: Mechanism, states: Array, canvas: Canvas) -> Iterator[Part]:
    """Yield the ground symbols under pins on the ground, and the guides on the ground.

    Args:
        states: (k, n) states of the motion. A guide extends by BEYOND [px] past the travel of its block at each end.
    """
    ends = [end for joint in mechanism.joints if isinstance(joint, Revolute) for end in (joint.a, joint.b)]
    fixed = [point for point in (*ends, *attachments(mechanism)) if point.link == GROUND]
    for place in dict.fromkeys(tuple(point.local.tolist()) for point in fixed):  # each place once
        # [px] a hatched line of 40 px under the triangle FOOT, and three lines through both for `reach`
        shapes = (FOOT, *hatch(np.array([-20.0, 22.0]), np.array([20.0, 22.0])))
        yield make_part(shapes, canvas.at(np.array(place)), reach=np.array([[(0.0, 0.0), (x, 26.0)] for x in (-14.0, 0.0, 14.0)]))
    for joint in mechanism.joints:
        if isinstance(joint, Prismatic) and joint.guide.link == GROUND:
            line = np.array([canvas.at(end.local) for end in guide_ends(joint, states, BEYOND / canvas.scale)])
            # the line is in pixels of the picture, so the frame of the part is that of the picture
            yield make_part([*hatch(*lines_beside(line)[0]), stroke(GUIDE, line)], np.zeros(2), reach=lines_beside(line))


def point_parts(mechanism: Mechanism, states: Array, canvas: Canvas, letters: Mapping[str, str]) -> Iterator[Part]:
    """Yield the symbols of pins and observed points at states (k, n)."""
    pins = [joint.a for joint in mechanism.joints if isinstance(joint, Revolute)]
    tracks = [canvas.at(position(states, pin)) for pin in pins]  # pixels (k, 2) of each pin
    # a pin through several links consists of several joints that begin at one place: draw it once
    distinct = {tuple(np.round(track[0], 1)): (pin, track) for pin, track in zip(pins, tracks, strict=True)}
    for pin, track in distinct.values():
        yield make_part([PIN], track, link=pin.link, local=canvas.offset(pin.local))
    for point in mechanism.observed_points:
        track = canvas.at(position(states, point))
        on_pin = any(np.abs(track - other).max() < ON_PIN for other in tracks)
        dot = f'<circle r="{2 if on_pin else 4}" fill="{TRACE}"/>'
        yield make_part([dot, letters.get(point.name, "")], track, link=point.link, local=canvas.offset(point.local))


def link_part(mechanism: Mechanism, i: int, states: Array, canvas: Canvas) -> Part:
    """Return link i at states (k, n): guides and blocks, a faint hull of its points, and bars with round ends."""
    link = mechanism.links[i]
    shapes, reach = [], []  # reach: lines (2, 2) [px] in the link's frame, from which names keep away
    for joint in (j for j in mechanism.joints if isinstance(j, Prismatic)):
        if joint.guide.link == i:
            line = canvas.offset(np.array([end.local for end in guide_ends(joint, states, BEYOND / canvas.scale)]))
            shapes.append(stroke(GUIDE, line))
            reach += [*lines_beside(line)]
        if joint.block.link == i:
            # direction of the guide in the frame of the block's link
            (x, y), turn = canvas.offset(joint.block.local), -np.degrees(joint.angle - joint.turn)
            shapes.append(BLOCK.replace("<rect ", f'<rect transform="translate({x:.1f} {y:.1f}) rotate({turn:.2f})" '))
            # the middle line of the rectangle BLOCK, and a line 3 px beyond each long side
            reach += [[(x - 18, y + side), (x + 18, y + side)] for side in (-14, 0, 14)]
    corners = {name: canvas.offset(x - link.com) for name, x in link.points.items()}
    bars = [np.array([corners[a], corners[b]]) for a, b in bar_ends(link)]
    fill, edge = (CRANK, CRANK_EDGE) if i == mechanism.crank else (BODY, BODY_EDGE)
    outline = hull(np.array([*corners.values()]))
    if len(outline):
        shape = f'd="{path_data(outline, closed=True)}" stroke-linejoin="round"'
        shapes.append(f'<path {shape} fill="{fill}" fill-opacity="0.45" stroke="{edge}" stroke-opacity="0.35"/>')
    # a bar is a wide line in the edge colour with a narrower line over it
    for width, colour in ((BAR, edge), (BAR - 3, fill)) if bars else ():
        shapes.append(stroke(f'fill="none" stroke="{colour}" stroke-width="{width:g}" stroke-linecap="round"', *bars))
    place, turn = canvas.at(states[:, 3 * i : 3 * i + 2]), -np.degrees(states[:, 3 * i + 2])
    return make_part(shapes, place, turn, title=link.name, link=i, reach=np.array([*reach, *bars]).reshape(-1, 2, 2))


def hull(points: Array) -> Array:
    """Return the corners (k, 2) of the convex hull of points (l, 2), in order; no corners if all points lie on a line."""
    flat = len(points) < 3 or np.linalg.matrix_rank(points[1:] - points[0], tol=FLAT * np.ptp(points)) < 2
    return np.zeros((0, 2)) if flat else points[ConvexHull(points).vertices]


def bar_ends(link: Link) -> list[tuple[str, str]]:
    """Return the names of the end points of each bar of a link; without bars, of each pair of consecutive points."""
    return list(link.bars) or list(pairwise(link.points))


def guide_ends(joint: Prismatic, states: Array, extension: float) -> tuple[Point, Point]:
    """Return both ends of a guide as points of its link: the block's travel over states (k, n), plus `extension` [m]."""
    travel = value(joint.motion, states)
    axis = direction(joint.angle)
    start = joint.guide.local + joint.offset * turn_left(axis)
    first, last = (Point(joint.guide.link, start + x * axis, "") for x in (travel.min() - extension, travel.max() + extension))
    return first, last


def lines_beside(line: Array) -> Array:
    """Return two lines (2, 2, 2) beside a guide (2, 2) [px], from which names keep away: along its block and along its hatching."""
    along = (line[1] - line[0]) / max(float(np.hypot(*(line[1] - line[0]))), 1e-9)
    # 11 px is half the height of BLOCK, where the hatching of a guide on the ground begins; it ends 7 px farther
    return np.array([line + side * turn_left(along) for side in (11, 17)])


def hatch(a: Array, b: Array) -> list[str]:
    """Return the SVG elements of a ground line from a to b (2,) [px], with hatching on its right."""
    length = float(np.hypot(*(b - a)))
    along = (b - a) / length
    slant = 7 * turn_left(along) - 5 * along  # y points down in pixels: `turn_left` turns right on the screen
    starts = a + np.arange(6.0, length, 8.0)[:, None] * along  # (strokes, 2), 8 px apart
    strokes = [np.array([start, start + slant]) for start in starts]
    return [stroke(f'stroke="{INK}" stroke-width="1.5"', np.array([a, b])), stroke(f'stroke="{MUTED}"', *strokes)]


def draw_paths(points: Iterable[Point], trace: Array, canvas: Canvas) -> list[str]:
    """Return the SVG elements of the paths of points over states `trace` (k, n)."""
    style = f'fill="none" stroke="{TRACE}" stroke-width="1.4" stroke-dasharray="1.5 4" stroke-linecap="round"'
    return [stroke(style, canvas.at(position(trace, p))) for p in points if p.link != GROUND]
