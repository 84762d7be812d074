"""Draws a linkage as SVG: links as rounded bars, pins as circles, slides as blocks on their guides, the ground hatched.

Plain text in, plain text out: lengths are turned into pixels, rounded to a tenth, so that equal states give equal files.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from xml.sax.saxutils import escape

import numpy as np

from gauss_bench.mechanism.forces import position
from gauss_bench.mechanism.load import built_in
from gauss_bench.mechanism.model import GROUND, Link, Mechanism, Point, Prismatic, Revolute
from gauss_bench.report.lettering import distance, lettering, obstacles
from gauss_bench.report.palette import BODY, BODY_EDGE, CRANK, CRANK_EDGE, INK, MUTED, PAPER, TRACE
from gauss_bench.report.pose import posed
from gauss_bench.results import write_text
from gauss_bench.terms import Array

WIDTH, LONGEST, MARGIN = 640.0, 500.0, 52.0  # page width, largest drawing height and margin [px]
BAR = 13.0  # width of a link [px]
ROUND = (1e-3, 1e-2, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0)  # lengths of the scale bar [m]


def draw(mechanism: Mechanism, q: Array | None = None, trace: Array | None = None) -> str:
    """SVG text of a linkage at state q (n,), its start if not given, with the paths of observed points over `trace` (k, n)."""
    q = mechanism.q0 if q is None else q
    canvas = fit(mechanism, q, trace)
    avoid = obstacles(mechanism, q, canvas.at, [guide_line(j, q, trace, canvas) for j in _slides(mechanism)])
    parts = [
        *guides(mechanism, q, trace, canvas),
        *pivots(mechanism, canvas),
        *(paths(mechanism, trace, canvas) if trace is not None else ()),
        *(part for i in range(len(mechanism.links)) for part in link_shape(mechanism, i, q, canvas)),
        *joints(mechanism, q, canvas),
        *lettering(mechanism, q, canvas.at, (canvas.width, canvas.height), avoid),
        *scale_bar(canvas, avoid),
    ]
    size = f"{canvas.width:.0f} {canvas.height:.0f}"
    title = escape(mechanism.title or mechanism.name)
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {size}" width="{canvas.width:.0f}" height="{canvas.height:.0f}" '
        f'role="img" font-family="Helvetica, Arial, sans-serif" font-size="13"><title>{title}</title>\n'
        f'<rect width="100%" height="100%" fill="{PAPER}"/>\n' + "\n".join(parts) + "\n</svg>\n"
    )


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


def fit(mechanism: Mechanism, q: Array, trace: Array | None) -> Canvas:
    """A canvas that holds every named point at every drawn state."""
    states = q[None] if trace is None else np.vstack([q[None], trace])
    named = [position(states, mechanism.point(i, p)) for i, link in enumerate(mechanism.links) for p in link.points]
    used = [x[None] for x in (p.local for p in _ground_ends(mechanism))]
    everything = np.vstack([*named, *used])
    low, high = everything.min(axis=0), everything.max(axis=0)
    span = np.maximum(high - low, 1e-9)
    scale = float(min((WIDTH - 2 * MARGIN) / span[0], (LONGEST - 2 * MARGIN) / span[1]))
    width, height = (float(round(x)) for x in np.maximum(span * scale + 2 * MARGIN, 200.0))
    return Canvas(low, scale, width, height)


def _ground_ends(mechanism: Mechanism) -> list[Point]:
    ends = [p for j in mechanism.joints for p in ((j.a, j.b) if isinstance(j, Revolute) else (j.guide, j.block))]
    return [p for p in ends if p.link == GROUND]


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


def link_shape(mechanism: Mechanism, i: int, q: Array, canvas: Canvas) -> list[str]:
    """A link: the faint hull of its points, then its bars with round ends."""
    link = mechanism.links[i]
    fill, edge = (CRANK, CRANK_EDGE) if i == mechanism.crank else (BODY, BODY_EDGE)
    where = {name: canvas.at(position(q, mechanism.point(i, name))) for name in link.points}
    bars = [_path(np.array([where[a], where[b]])) for a, b in bar_ends(link)]
    found = []
    outline = hull(np.array(list(where.values())))
    if len(outline) > 2:
        shape = f'd="{_path(outline, closed=True)}" stroke-linejoin="round"'
        found.append(f'<path {shape} fill="{fill}" fill-opacity="0.45" stroke="{edge}" stroke-opacity="0.35"/>')
    for width, colour in ((BAR, edge), (BAR - 3, fill)):
        if bars:
            style = f'fill="none" stroke="{colour}" stroke-width="{width:g}" stroke-linecap="round"'
            found.append(f'<path d="{"".join(bars)}" {style}/>')
    return found


def _slides(mechanism: Mechanism) -> list[Prismatic]:
    return [joint for joint in mechanism.joints if isinstance(joint, Prismatic)]


def _guide_angle(joint: Prismatic, q: Array) -> float:
    return joint.angle + (0.0 if joint.guide.link == GROUND else float(q[3 * joint.guide.link + 2]))


def guide_line(joint: Prismatic, q: Array, trace: Array | None, canvas: Canvas) -> Array:
    """Both ends (2, 2) of a guide in pixels: what the block travels over the trace, and a little more."""
    theta = _guide_angle(joint, q)
    axis = np.array([np.cos(theta), np.sin(theta)])
    line = position(q, joint.guide) + joint.offset * np.array([-axis[1], axis[0]])
    states = q[None] if trace is None or joint.guide.link != GROUND else trace
    travel = (position(states, joint.block) - line) @ axis
    more = 36.0 / canvas.scale
    return canvas.at(line + np.array([[travel.min() - more], [travel.max() + more]]) * axis)


def guides(mechanism: Mechanism, q: Array, trace: Array | None, canvas: Canvas) -> list[str]:
    """Each slide: its guide line, hatched where it is on the ground, and the block."""
    found = []
    for joint in _slides(mechanism):
        a, b = ends = guide_line(joint, q, trace, canvas)
        theta = _guide_angle(joint, q)
        if joint.guide.link == GROUND:
            right = 11 * np.array([np.sin(theta), np.cos(theta)])  # of the direction, y down
            found += hatched(a + right, b + right)
        found.append(f'<path d="{_path(ends)}" stroke="{MUTED}" stroke-dasharray="9 3 2 3"/>')
        x, y = canvas.at(position(q, joint.block))
        turn = f'transform="translate({x:.1f} {y:.1f}) rotate({-np.degrees(theta):.2f})"'
        style = f'rx="3" fill="{BODY}" stroke="{BODY_EDGE}" stroke-width="1.5"'
        found.append(f'<rect {turn} x="-19" y="-11" width="38" height="22" {style}/>')
    return found


def hatched(a: Array, b: Array) -> list[str]:
    """A ground line from a to b with strokes on its right, in pixels."""
    length = float(np.hypot(*(b - a)))
    along = (b - a) / length
    slant = 7 * np.array([-along[1], along[0]]) - 5 * along
    starts = a + np.arange(6.0, length, 8.0)[:, None] * along
    strokes = "".join(_path(np.array([s, s + slant])) for s in starts)
    return [f'<path d="{_path(np.array([a, b]))}" stroke="{INK}" stroke-width="1.5"/>', f'<path d="{strokes}" stroke="{MUTED}"/>']


def pivots(mechanism: Mechanism, canvas: Canvas) -> list[str]:
    """A foot under every pin on the ground."""
    found = []
    for where in dict.fromkeys((float(p.local[0]), float(p.local[1])) for p in _pins(mechanism) if p.link == GROUND):
        x, y = canvas.at(np.array(where))
        foot = _path(np.array([[x, y], [x - 12, y + 22], [x + 12, y + 22]]), closed=True)
        found.append(f'<path d="{foot}" fill="{PAPER}" stroke="{INK}" stroke-width="1.5" stroke-linejoin="round"/>')
        found += hatched(np.array([x - 20, y + 22]), np.array([x + 20, y + 22]))
    return found


def _pins(mechanism: Mechanism) -> list[Point]:
    return [p for j in mechanism.joints if isinstance(j, Revolute) for p in (j.a, j.b)]


def joints(mechanism: Mechanism, q: Array, canvas: Canvas) -> list[str]:
    """Pins as open circles, observed points that are no pins as filled ones."""
    pins = {tuple(np.round(canvas.at(position(q, p)), 1)) for p in _pins(mechanism)}
    seen = {tuple(np.round(canvas.at(position(q, p)), 1)) for p in mechanism.observed_points}
    found = [
        f'<circle cx="{x:.1f}" cy="{y:.1f}" r="4.5" fill="{PAPER}" stroke="{INK}" stroke-width="1.6"/>' for x, y in sorted(pins)
    ]
    found += [f'<circle cx="{x:.1f}" cy="{y:.1f}" r="{2 if (x, y) in pins else 4}" fill="{TRACE}"/>' for x, y in sorted(seen)]
    return found


def paths(mechanism: Mechanism, trace: Array, canvas: Canvas) -> list[str]:
    """The paths of observed points over the states of `trace`."""
    lines = [_path(canvas.at(position(trace, p))) for p in mechanism.observed_points if p.link != GROUND]
    style = f'fill="none" stroke="{TRACE}" stroke-width="1.4" stroke-dasharray="1.5 4" stroke-linecap="round"'
    return [f'<path d="{d}" {style}/>' for d in lines]


def scale_bar(canvas: Canvas, avoid: Array) -> list[str]:
    """A bar of a round length in the corner with most room."""
    length = max(x for x in ROUND if x * canvas.scale < 120 or x == ROUND[0])
    half = length * canvas.scale / 2
    corners = [np.array([x, y]) for y in (canvas.height - 18, 26) for x in (canvas.width - 20 - half, 20 + half)]
    x, y = max(corners, key=lambda c: min(100.0, round(distance(c + np.array([[-half, 0], [0, 0], [half, 0]]), avoid))))
    bar = f'<path d="M{x - half:.1f} {y - 4:.1f}V{y:.1f}H{x + half:.1f}V{y - 4:.1f}" fill="none" stroke="{MUTED}"/>'
    return [bar, f'<text x="{x:.1f}" y="{y - 6:.1f}" text-anchor="middle" font-size="11" fill="{MUTED}">{length:g} m</text>']


def write_drawings(folder: Path) -> list[Path]:
    """Draw every built-in linkage into `folder`/NAME.svg."""
    written = []
    for name in built_in():
        path = folder / f"{name}.svg"
        write_text(path, draw(*posed(name)))
        written.append(path)
    return written
