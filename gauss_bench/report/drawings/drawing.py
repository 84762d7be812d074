"""Draws a linkage as SVG: links as rounded bars, pins as circles, slides as blocks on their guides, the ground hatched.

Plain text in, plain text out: lengths are turned into pixels, rounded to a tenth, so that equal states give equal files.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from xml.sax.saxutils import escape

import numpy as np

from gauss_bench.linkage.load import built_in
from gauss_bench.mechanism.coordinates import position, value
from gauss_bench.mechanism.model import GROUND, Link, Mechanism, Point, Prismatic, Revolute
from gauss_bench.report.drawings.forces import Mark, holder_of, marks
from gauss_bench.report.drawings.lettering import box_of, distance, lettering, obstacles
from gauss_bench.report.drawings.pose import pose_links
from gauss_bench.report.palette import BODY, BODY_EDGE, CRANK, CRANK_EDGE, INK, MUTED, PAPER, TRACE
from gauss_bench.tables import write_text
from gauss_bench.terms import Array

WIDTH, LONGEST, MARGIN = 640.0, 500.0, 52.0  # page width, largest drawing height and margin [px]
BAR = 13.0  # width of a link [px]
BEYOND = 36.0  # length of a guide beyond what its block travels [px]
ROUND = (1e-3, 1e-2, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0)  # lengths of the scale bar [m]


@dataclass(frozen=True, eq=False)
class Canvas:
    """Metres to pixels: x right, y up in metres, down in pixels."""

    low: Array
    scale: float
    width: float
    height: float

    def at(self, x: Array) -> Array:
        """Pixels (..., 2) of world positions (..., 2) [m]."""
        shift = (x - self.low) * self.scale + MARGIN
        return np.stack((shift[..., 0], self.height - shift[..., 1]), axis=-1)

    def offset(self, x: Array) -> Array:
        """Pixels (..., 2) of vectors (..., 2) [m], such as positions in a link's own frame."""
        return np.asarray(x * (self.scale, -self.scale))


def draw(mechanism: Mechanism, q: Array | None = None, trace: Array | None = None) -> str:
    """SVG text of a linkage at state q (n,), its start if not given, with the paths of observed points over `trace` (k, n)."""
    q = mechanism.q0 if q is None else q
    canvas = fit(mechanism, q[None] if trace is None else np.vstack([q[None], trace]))
    acting = marks(mechanism, q[None], canvas.at)
    avoid = obstacles(mechanism, q, canvas.at, [guide_line(j, q, trace, canvas) for j in slides(mechanism)])
    avoid = np.vstack([avoid, *(mark.reach for mark in acting)])
    length, bar = scale_line(canvas, avoid)
    parts = [
        *guides(mechanism, q, trace, canvas),
        *pivots(mechanism, canvas),
        *(paths(mechanism.observed_points, trace, canvas) if trace is not None else ()),
        *links(mechanism, q, canvas),
        *(mark.standing for mark in acting),
        *joints(mechanism, q, canvas),
        *names_of(mechanism, q, canvas, avoid, acting, length, bar),
        *scale_bar(length, bar),
    ]
    return page(canvas, mechanism.title or mechanism.name, parts)


def names_of(
    mechanism: Mechanism, q: Array, canvas: Canvas, avoid: Array, acting: Sequence[Mark], length: float, bar: Array
) -> list[str]:
    """The names of all parts at state q (n,), clear of the scale bar of a length [m] between two pixels (2, 2)."""
    told = [(mark.name, mark.reach) for mark in acting if mark.name and len(mark.reach)]
    lines = np.vstack([avoid, bar[None]])
    taken = [box_of(f"{length:g} m", bar.mean(axis=0) - np.array([0.0, 10.0]), 11.0)]
    return lettering(mechanism, q, canvas.at, (canvas.width, canvas.height), lines, told, taken)


def draw_at(mechanism: Mechanism, q: Array, trace: Array, canvas: Canvas) -> str:
    """One picture of a film: state q (n,) on a canvas that others share, with the paths over `trace` (k, n) and no names."""
    parts = [
        *guides(mechanism, q, trace, canvas),
        *pivots(mechanism, canvas),
        *paths(mechanism.observed_points, trace, canvas),
        *links(mechanism, q, canvas),
        *(mark.standing for mark in marks(mechanism, q[None], canvas.at)),
        *joints(mechanism, q, canvas),
    ]
    return page(canvas, mechanism.title or mechanism.name, parts)


def page(canvas: Canvas, title: str, parts: Iterable[str]) -> str:
    """SVG text of the parts on paper."""
    size = f"{canvas.width:.0f} {canvas.height:.0f}"
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {size}" width="{canvas.width:.0f}" height="{canvas.height:.0f}" '
        f'role="img" font-family="Helvetica, Arial, sans-serif" font-size="13"><title>{escape(title)}</title>\n'
        f'<rect width="100%" height="100%" fill="{PAPER}"/>\n' + "\n".join(parts) + "\n</svg>\n"
    )


def fit(mechanism: Mechanism, states: Array, points: Sequence[Point] = ()) -> Canvas:
    """A canvas that holds every named point, and the given ones, at every drawn state (k, n)."""
    named = [mechanism.point(i, name) for i, link in enumerate(mechanism.links) for name in link.points]
    everything = np.vstack([position(states, p) for p in (*named, *_ground_ends(mechanism), *points)])
    low, high = everything.min(axis=0), everything.max(axis=0)
    span = np.maximum(high - low, 1e-9)
    scale = float(min((WIDTH - 2 * MARGIN) / span[0], (LONGEST - 2 * MARGIN) / span[1]))
    width, height = (float(round(x)) for x in np.maximum(span * scale + 2 * MARGIN, 200.0))
    return Canvas(low, scale, width, height)


def _ground_ends(mechanism: Mechanism) -> list[Point]:
    ends = [p for j in mechanism.joints for p in ((j.a, j.b) if isinstance(j, Revolute) else (j.guide, j.block))]
    return [*(p for p in ends if p.link == GROUND), *holder_of(mechanism)]


def _path(points: Array, closed: bool = False) -> str:
    return "M" + "L".join(f"{x:.1f} {y:.1f}" for x, y in points) + ("Z" if closed else "")


def hull(points: Array) -> Array:
    """Corners (k, 2) of the convex hull, in order; fewer than three where all points lie on a line."""
    ordered = sorted({(float(x), float(y)) for x, y in points})

    def chain(xs: Iterable[tuple[float, float]]) -> list[tuple[float, float]]:
        kept: list[tuple[float, float]] = []
        for p in xs:
            while len(kept) > 1 and _turn(kept[-2], kept[-1], p) <= 1e-9:
                kept.pop()
            kept.append(p)
        return kept[:-1]

    return np.array(chain(ordered) + chain(reversed(ordered)) or ordered)


def _turn(a: tuple[float, float], b: tuple[float, float], c: tuple[float, float]) -> float:
    return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])


def bar_ends(link: Link) -> list[tuple[str, str]]:
    """Pairs of points to join: the bars, or the points in turn where the link has none."""
    names = list(link.points)
    return list(link.bars) or list(pairwise(names))


def links(mechanism: Mechanism, q: Array, canvas: Canvas) -> list[str]:
    """Every link at state q (n,)."""
    shapes = []
    for i, link in enumerate(mechanism.links):
        where = {name: canvas.at(position(q, mechanism.point(i, name))) for name in link.points}
        shapes += link_shape(link, where, i == mechanism.crank)
    return shapes


def link_shape(link: Link, where: Mapping[str, Array], crank: bool) -> list[str]:
    """A link whose points are at the given pixels: their faint hull, then the bars with round ends."""
    fill, edge = (CRANK, CRANK_EDGE) if crank else (BODY, BODY_EDGE)
    bars = [_path(np.array([where[a], where[b]])) for a, b in bar_ends(link)]
    shapes = []
    outline = hull(np.array(list(where.values())))
    if len(outline) > 2:
        shape = f'd="{_path(outline, closed=True)}" stroke-linejoin="round"'
        shapes.append(f'<path {shape} fill="{fill}" fill-opacity="0.45" stroke="{edge}" stroke-opacity="0.35"/>')
    for width, colour in ((BAR, edge), (BAR - 3, fill)):
        if bars:
            style = f'fill="none" stroke="{colour}" stroke-width="{width:g}" stroke-linecap="round"'
            shapes.append(f'<path d="{"".join(bars)}" {style}/>')
    return shapes


def slides(mechanism: Mechanism) -> list[Prismatic]:
    return [joint for joint in mechanism.joints if isinstance(joint, Prismatic)]


def rail(joint: Prismatic, states: Array, more: float) -> tuple[Point, Point]:
    """Both ends of a guide in its own link: what the block travels over the states (k, n), and `more` [m] at either end."""
    travel = value(joint.motion, states)
    axis = np.array([np.cos(joint.angle), np.sin(joint.angle)])
    line = joint.guide.local + joint.offset * np.array([-axis[1], axis[0]])
    first, last = (Point(joint.guide.link, line + x * axis, "") for x in (travel.min() - more, travel.max() + more))
    return first, last


def guide_line(joint: Prismatic, q: Array, trace: Array | None, canvas: Canvas) -> Array:
    """Both ends (2, 2) of a guide in pixels; one that moves is drawn only around its block."""
    states = q[None] if trace is None or joint.guide.link != GROUND else trace
    return canvas.at(np.array([position(q, end) for end in rail(joint, states, BEYOND / canvas.scale)]))


def guides(mechanism: Mechanism, q: Array, trace: Array | None, canvas: Canvas) -> list[str]:
    """Each slide: its guide and the block on it."""
    shapes = []
    for joint in slides(mechanism):
        theta = joint.angle + (0.0 if joint.guide.link == GROUND else float(q[3 * joint.guide.link + 2]))
        shapes += guide_shape(guide_line(joint, q, trace, canvas), joint.guide.link == GROUND)
        shapes.append(block_shape(canvas.at(position(q, joint.block)), theta))
    return shapes


def guide_shape(ends: Array, grounded: bool) -> list[str]:
    """A guide line between pixels (2, 2), hatched on its right where it is on the ground."""
    line = f'<path d="{_path(ends)}" stroke="{MUTED}" stroke-dasharray="9 3 2 3"/>'
    along = (ends[1] - ends[0]) / np.hypot(*(ends[1] - ends[0]))
    right = 11 * np.array([-along[1], along[0]])
    return [*(hatch(*(ends + right)) if grounded else ()), line]


def block_shape(where: Array, theta: float) -> str:
    """The block of a slide at a pixel (2,), turned by theta [rad]."""
    turn = f'transform="translate({where[0]:.1f} {where[1]:.1f}) rotate({-np.degrees(theta):.2f})"'
    style = f'rx="3" fill="{BODY}" stroke="{BODY_EDGE}" stroke-width="1.5"'
    return f'<rect {turn} x="-19" y="-11" width="38" height="22" {style}/>'


def hatch(a: Array, b: Array) -> list[str]:
    """A ground line from a to b with strokes on its right, in pixels."""
    length = float(np.hypot(*(b - a)))
    along = (b - a) / length
    slant = 7 * np.array([-along[1], along[0]]) - 5 * along
    starts = a + np.arange(6.0, length, 8.0)[:, None] * along
    strokes = "".join(_path(np.array([s, s + slant])) for s in starts)
    return [f'<path d="{_path(np.array([a, b]))}" stroke="{INK}" stroke-width="1.5"/>', f'<path d="{strokes}" stroke="{MUTED}"/>']


def pivots(mechanism: Mechanism, canvas: Canvas) -> list[str]:
    """A foot under every pin on the ground, and where springs and cylinders take hold of it."""
    shapes = []
    fixed = [p for p in (*_pins(mechanism), *holder_of(mechanism)) if p.link == GROUND]
    for where in dict.fromkeys((float(p.local[0]), float(p.local[1])) for p in fixed):
        x, y = canvas.at(np.array(where))
        foot = _path(np.array([[x, y], [x - 12, y + 22], [x + 12, y + 22]]), closed=True)
        shapes.append(f'<path d="{foot}" fill="{PAPER}" stroke="{INK}" stroke-width="1.5" stroke-linejoin="round"/>')
        shapes += hatch(np.array([x - 20, y + 22]), np.array([x + 20, y + 22]))
    return shapes


def _pins(mechanism: Mechanism) -> list[Point]:
    return [p for j in mechanism.joints if isinstance(j, Revolute) for p in (j.a, j.b)]


def joints(mechanism: Mechanism, q: Array, canvas: Canvas) -> list[str]:
    """Pins as open circles, observed points that are no pins as filled ones."""
    pins = {tuple(np.round(canvas.at(position(q, p)), 1)) for p in _pins(mechanism)}
    seen = {tuple(np.round(canvas.at(position(q, p)), 1)) for p in mechanism.observed_points}
    shapes = [pin_shape(x, y) for x, y in sorted(pins)]
    return shapes + [dot_shape(x, y, (x, y) in pins) for x, y in sorted(seen)]


def pin_shape(x: float, y: float) -> str:
    return f'<circle cx="{x:.1f}" cy="{y:.1f}" r="4.5" fill="{PAPER}" stroke="{INK}" stroke-width="1.6"/>'


def dot_shape(x: float, y: float, on_pin: bool) -> str:
    return f'<circle cx="{x:.1f}" cy="{y:.1f}" r="{2 if on_pin else 4}" fill="{TRACE}"/>'


def paths(points: Iterable[Point], trace: Array, canvas: Canvas) -> list[str]:
    """The paths of points over the states of `trace` (k, n)."""
    lines = [_path(canvas.at(position(trace, p))) for p in points if p.link != GROUND]
    style = f'fill="none" stroke="{TRACE}" stroke-width="1.4" stroke-dasharray="1.5 4" stroke-linecap="round"'
    return [f'<path d="{d}" {style}/>' for d in lines]


def scale_line(canvas: Canvas, avoid: Array) -> tuple[float, Array]:
    """A round length [m] and both ends (2, 2) of its scale bar in the corner with most room, in pixels."""
    length = max(x for x in ROUND if x * canvas.scale < 120 or x == ROUND[0])
    half = np.array([length * canvas.scale / 2, 0.0])
    middle = free_corner(canvas, float(half[0]), avoid)
    return length, np.array([middle - half, middle + half])


def scale_bar(length: float, ends: Array) -> list[str]:
    """A bar of a length [m] between two pixels (2, 2)."""
    (a, y), (b, _) = ends
    bar = f'<path d="M{a:.1f} {y - 4:.1f}V{y:.1f}H{b:.1f}V{y - 4:.1f}" fill="none" stroke="{MUTED}"/>'
    style = f'text-anchor="middle" font-size="11" fill="{MUTED}"'
    return [bar, f'<text x="{(a + b) / 2:.1f}" y="{y - 6:.1f}" {style}>{length:g} m</text>']


def free_corner(canvas: Canvas, half: float, avoid: Array) -> Array:
    """The middle (2,) of a line of half length `half` in the corner farthest from the segments `avoid` (k, 2, 2), in pixels."""
    corners = [np.array([x, y]) for y in (canvas.height - 18, 26) for x in (canvas.width - 20 - half, 20 + half)]
    return max(corners, key=lambda c: min(100.0, round(distance(c + np.array([[-half, 0], [0, 0], [half, 0]]), avoid))))


def write_drawings(folder: Path) -> list[Path]:
    """Draw every built-in linkage into `folder`/NAME.svg."""
    written = []
    for name in built_in():
        path = folder / f"{name}.svg"
        write_text(path, draw(*pose_links(name)))
        written.append(path)
    return written
