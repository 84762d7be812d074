"""Draw a linkage as SVG: links as rounded bars, pins as circles, slides as blocks on their guides, the ground hatched.

A link is drawn once, in its own frame, with its guides and blocks. Lengths are rounded in pixels, so that equal states give equal
files.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import pairwise
from pathlib import Path

import numpy as np
from scipy.spatial import ConvexHull

from gauss_bench.linkage.load import built_in
from gauss_bench.mechanism.coordinates import position, value
from gauss_bench.mechanism.model import GROUND, Link, Mechanism, Point, Prismatic, Revolute
from gauss_bench.report.drawings.canvas import MARGIN, Canvas, Part, make_part, page, path
from gauss_bench.report.drawings.forces import holder_of, marks
from gauss_bench.report.drawings.lettering import box_of, distance, lettering
from gauss_bench.report.drawings.pose import pose_links
from gauss_bench.report.palette import BODY, BODY_EDGE, CRANK, CRANK_EDGE, INK, MUTED, PAPER, TRACE
from gauss_bench.tables import write_text
from gauss_bench.terms import Array

WIDTH, LONGEST = 640.0, 500.0  # page width and largest drawing height [px]
BAR = 13.0  # width of a link [px]
BEYOND = 36.0  # length of a guide beyond what its block travels [px]
FLAT = 1e-6  # of a link's length: points closer to one line have no hull
ON_PIN = 0.5  # [px] a point that stays as near to a pin is drawn inside it
ROUND = (1e-3, 1e-2, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0)  # lengths of the scale bar [m]
PIN = f'<circle r="4.5" fill="{PAPER}" stroke="{INK}" stroke-width="1.6"/>'
BLOCK = f'<rect x="-19" y="-11" width="38" height="22" rx="3" fill="{BODY}" stroke="{BODY_EDGE}" stroke-width="1.5"/>'
FOOT = f'<path d="M0 0L-12 22L12 22Z" fill="{PAPER}" stroke="{INK}" stroke-width="1.5" stroke-linejoin="round"/>'


def draw(mechanism: Mechanism, q: Array | None = None, trace: Array | None = None) -> str:
    """Return the SVG of a linkage at q (n,), by default its start, with the paths of observed points over `trace` (k, n)."""
    q = mechanism.q0 if q is None else q
    canvas = fit(mechanism, q[None] if trace is None else np.vstack([q[None], trace]))
    parts = [*linkage_parts(mechanism, q[None], trace, canvas)]
    length, bar = scale_line(canvas, np.vstack([part.lines() for part in parts]))
    letters = [*names_of(mechanism, q, canvas, parts, length, bar), *scale_bar(length, bar)]
    return page(canvas, mechanism.title or mechanism.name, [*shapes_of(mechanism, trace, canvas, parts), *letters])


def draw_at(mechanism: Mechanism, q: Array, trace: Array, canvas: Canvas) -> str:
    """Return one picture of a film: state q (n,) on a shared canvas, with paths over `trace` (k, n), without names."""
    parts = linkage_parts(mechanism, q[None], trace, canvas)
    return page(canvas, mechanism.title or mechanism.name, shapes_of(mechanism, trace, canvas, parts))


def shapes_of(mechanism: Mechanism, trace: Array | None, canvas: Canvas, parts: Iterable[Part]) -> list[str]:
    return [*([] if trace is None else draw_paths(mechanism.observed_points, trace, canvas)), *(part.draw() for part in parts)]


def names_of(mechanism: Mechanism, q: Array, canvas: Canvas, parts: Sequence[Part], length: float, bar: Array) -> list[str]:
    """Return the names of all parts at q (n,), placed clear of the scale bar, a length [m] between two pixels (2, 2)."""
    taken = box_of(f"{length:g} m", bar.mean(axis=0) - np.array([0.0, 10.0]), 11.0)
    return lettering(mechanism, q, canvas, parts, taken, bar)


def fit(mechanism: Mechanism, states: Array, points: Sequence[Point] = ()) -> Canvas:
    """Return a canvas that contains all named points, and the given points, at all states (k, n)."""
    named = [mechanism.point(i, name) for i, link in enumerate(mechanism.links) for name in link.points]
    ends = [p for j in mechanism.joints for p in j.ends]
    ground = [p for p in (*ends, *holder_of(mechanism)) if p.link == GROUND]
    everything = np.vstack([position(states, p) for p in (*named, *ground, *points)])
    low, high = everything.min(axis=0), everything.max(axis=0)
    span = np.maximum(high - low, 1e-9)
    scale = float(min((WIDTH - 2 * MARGIN) / span[0], (LONGEST - 2 * MARGIN) / span[1]))
    width, height = (float(round(x)) for x in np.maximum(span * scale + 2 * MARGIN, 200.0))
    return Canvas(low, scale, width, height)


def canvas_of(mechanism: Mechanism, states: Array) -> Canvas:
    """Return a canvas that contains a linkage with its guides at all states (k, n)."""
    slides = [joint for joint in mechanism.joints if isinstance(joint, Prismatic) and joint.guide.link != GROUND]
    rails = [end for joint in slides for end in rail(joint, states, 0.0)]
    return fit(mechanism, states, (*mechanism.observed_points, *rails))


def linkage_parts(
    mechanism: Mechanism, states: Array, trace: Array | None, canvas: Canvas, forces: bool = True, letters: Mapping[str, str] = {}
) -> Iterator[Part]:
    """Yield all parts of a linkage at states (k, n), from the background to the front.

    Args:
        trace: states (l, n) that give the length of guides on the ground, if they differ from the drawn states.
        letters: observed point -> an SVG text that moves with it.
    """
    slides = [joint for joint in mechanism.joints if isinstance(joint, Prismatic)]
    pins = [joint for joint in mechanism.joints if isinstance(joint, Revolute)]
    fixed = [p.local for p in (*(p for j in pins for p in (j.a, j.b)), *holder_of(mechanism)) if p.link == GROUND]
    for where in dict.fromkeys((float(x), float(y)) for x, y in fixed):
        shapes = (FOOT, *hatch(np.array([-20.0, 22.0]), np.array([20.0, 22.0])))
        yield make_part(shapes, canvas.at(np.array(where)), reach=np.array([[(0.0, 0.0), (x, 26.0)] for x in (-14.0, 0.0, 14.0)]))
    for joint in slides:
        if joint.guide.link == GROUND:
            ends = rail(joint, states if trace is None else trace, BEYOND / canvas.scale)
            line = np.array([canvas.at(end.local) for end in ends])
            yield make_part(guide_shape(line, True), np.zeros(2), reach=beside(line))
    blocks = {joint.block.link for joint in slides}
    for i in sorted(range(len(mechanism.links)), key=lambda i: (i not in blocks, i)):  # a block lies under the bar it slides on
        yield link_part(mechanism, i, states, canvas)
    if forces:
        yield from marks(mechanism, states, canvas)
    tracks = [(joint.a, canvas.at(position(states, joint.a))) for joint in pins]  # pixels (k, 2) of each pin
    # a pin through several links consists of several joints at one place: draw it once
    distinct = {tuple(np.round(track[0], 1)): (point, track) for point, track in tracks}
    for point, track in distinct.values():
        yield make_part([PIN], track, link=point.link, local=canvas.offset(point.local))
    for point in mechanism.observed_points:
        track = canvas.at(position(states, point))
        on_pin = any(np.abs(track - other).max() < ON_PIN for _, other in tracks)
        dot = f'<circle r="{2 if on_pin else 4}" fill="{TRACE}"/>'
        yield make_part([dot, letters.get(point.name, "")], track, link=point.link, local=canvas.offset(point.local))


def link_part(mechanism: Mechanism, i: int, states: Array, canvas: Canvas) -> Part:
    """Return a link: its guides and blocks, the faint hull of its points, and its bars with round ends."""
    link = mechanism.links[i]
    shapes, reach = [], []
    for joint in (j for j in mechanism.joints if isinstance(j, Prismatic)):
        if joint.guide.link == i:
            line = canvas.offset(np.array([end.local for end in rail(joint, states, BEYOND / canvas.scale)]))
            shapes += guide_shape(line, False)
            reach += [*beside(line)]
        if joint.block.link == i:
            (x, y), turn = canvas.offset(joint.block.local), -np.degrees(joint.angle - joint.turn)
            shapes.append(BLOCK.replace("<rect ", f'<rect transform="translate({x:.1f} {y:.1f}) rotate({turn:.2f})" '))
            reach += [[(x - 18, y + side), (x + 18, y + side)] for side in (-14, 0, 14)]
    where = {name: canvas.offset(x - link.com) for name, x in link.points.items()}
    bars = [np.array([where[a], where[b]]) for a, b in bar_ends(link)]
    fill, edge = (CRANK, CRANK_EDGE) if i == mechanism.crank else (BODY, BODY_EDGE)
    outline = hull(np.array([*where.values()]))
    if len(outline):
        shape = f'd="{path(outline, closed=True)}" stroke-linejoin="round"'
        shapes.append(f'<path {shape} fill="{fill}" fill-opacity="0.45" stroke="{edge}" stroke-opacity="0.35"/>')
    for width, colour in ((BAR, edge), (BAR - 3, fill)) if bars else ():
        style = f'fill="none" stroke="{colour}" stroke-width="{width:g}" stroke-linecap="round"'
        shapes.append(f'<path d="{"".join(map(path, bars))}" {style}/>')
    place, turn = canvas.at(states[:, 3 * i : 3 * i + 2]), -np.degrees(states[:, 3 * i + 2])
    return make_part(shapes, place, turn, title=link.name, link=i, reach=np.array([*reach, *bars]).reshape(-1, 2, 2))


def hull(points: Array) -> Array:
    """Return the corners (k, 2) of the convex hull, in order; none if all points lie on a line."""
    flat = len(points) < 3 or np.linalg.matrix_rank(points[1:] - points[0], tol=FLAT * np.ptp(points)) < 2
    return np.zeros((0, 2)) if flat else points[ConvexHull(points).vertices]


def bar_ends(link: Link) -> list[tuple[str, str]]:
    """Return the pairs of points to join: the bars, or consecutive points of a link without bars."""
    return list(link.bars) or list(pairwise(link.points))


def rail(joint: Prismatic, states: Array, more: float) -> tuple[Point, Point]:
    """Return both ends of a guide on its link: the travel of the block over states (k, n), extended by `more` [m] at each end."""
    travel = value(joint.motion, states)
    axis = np.array([np.cos(joint.angle), np.sin(joint.angle)])
    line = joint.guide.local + joint.offset * np.array([-axis[1], axis[0]])
    first, last = (Point(joint.guide.link, line + x * axis, "") for x in (travel.min() - more, travel.max() + more))
    return first, last


def beside(line: Array) -> Array:
    """Return two lines (2, 2, 2) to the right of a guide (2, 2), where hatching is drawn."""
    along = (line[1] - line[0]) / max(float(np.hypot(*(line[1] - line[0]))), 1e-9)
    return np.array([line + side * np.array([-along[1], along[0]]) for side in (11, 17)])


def guide_shape(line: Array, grounded: bool) -> list[str]:
    """Return a guide between two pixels (2, 2), with hatching on its right if it is on the ground."""
    drawn = f'<path d="{path(line)}" stroke="{MUTED}" stroke-dasharray="9 3 2 3"/>'
    return [*(hatch(*beside(line)[0]) if grounded else ()), drawn]


def hatch(a: Array, b: Array) -> list[str]:
    """Return a ground line from a to b with hatching on its right, in pixels."""
    length = float(np.hypot(*(b - a)))
    along = (b - a) / length
    slant = 7 * np.array([-along[1], along[0]]) - 5 * along
    starts = a + np.arange(6.0, length, 8.0)[:, None] * along
    strokes = "".join(path(np.array([s, s + slant])) for s in starts)
    return [f'<path d="{path(np.array([a, b]))}" stroke="{INK}" stroke-width="1.5"/>', f'<path d="{strokes}" stroke="{MUTED}"/>']


def draw_paths(points: Iterable[Point], trace: Array, canvas: Canvas) -> list[str]:
    """Return the paths of points over the states of `trace` (k, n)."""
    style = f'fill="none" stroke="{TRACE}" stroke-width="1.4" stroke-dasharray="1.5 4" stroke-linecap="round"'
    return [f'<path d="{path(canvas.at(position(trace, p)))}" {style}/>' for p in points if p.link != GROUND]


def scale_line(canvas: Canvas, avoid: Array) -> tuple[float, Array]:
    """Return a round length [m] and both ends (2, 2) [px] of its scale bar, in the corner with most room."""
    length = max(x for x in ROUND if x * canvas.scale < 120 or x == ROUND[0])
    half = np.array([length * canvas.scale / 2, 0.0])
    middle = free_corner(canvas, float(half[0]), avoid)
    return length, np.array([middle - half, middle + half])


def scale_bar(length: float, ends: Array) -> list[str]:
    """Return the scale bar of a length [m] between two pixels (2, 2)."""
    (a, y), (b, _) = ends
    bar = f'<path d="M{a:.1f} {y - 4:.1f}V{y:.1f}H{b:.1f}V{y - 4:.1f}" fill="none" stroke="{MUTED}"/>'
    style = f'text-anchor="middle" font-size="11" fill="{MUTED}"'
    return [bar, f'<text x="{(a + b) / 2:.1f}" y="{y - 6:.1f}" {style}>{length:g} m</text>']


def free_corner(canvas: Canvas, half: float, avoid: Array) -> Array:
    """Return the middle (2,) [px] of a line of half length `half` in the corner farthest from the segments `avoid` (k, 2, 2)."""
    corners = [np.array([x, y]) for y in (canvas.height - 18, 26) for x in (canvas.width - 20 - half, 20 + half)]
    return max(corners, key=lambda c: min(100.0, round(distance(c + np.array([[-half, 0], [0, 0], [half, 0]]), avoid))))


def write_drawings(folder: Path) -> list[Path]:
    """Draw every built-in linkage into `folder`/NAME.svg."""
    written = [folder / f"{name}.svg" for name in built_in()]
    for file in written:
        write_text(file, draw(*pose_links(file.stem)))
    return written
