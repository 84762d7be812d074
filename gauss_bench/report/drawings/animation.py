"""Shows a linkage in motion: one SVG that moves by itself, in a loop, in any page and without a script.

A link is drawn once, in its own frame, and carried by its centre of mass z and its angle theta at every kept state,

    x = z + R(theta) local   as   translate(z) rotate(-theta), since y points down on the page,

both straight lines in time in between. A point at a distance r of z then leaves its circle by at most r d_theta^2 / 8, so that
joints stay together as long as no link turns much from one kept state to the next.

Whoever asks for less motion, or prints, sees the start instead, with the names of its parts.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from xml.sax.saxutils import escape

import numpy as np

from gauss_bench.mechanism.coordinates import position
from gauss_bench.mechanism.model import GROUND, Link, Mechanism, Point, Revolute
from gauss_bench.report.drawings.drawing import (
    BEYOND,
    Canvas,
    block_shape,
    dot_shape,
    fit,
    free_corner,
    guide_line,
    guide_shape,
    guides,
    joints,
    link_shape,
    links,
    names_of,
    page,
    paths,
    pin_shape,
    pivots,
    rail,
    scale_bar,
    scale_line,
    slides,
)
from gauss_bench.report.drawings.forces import Mark, marks
from gauss_bench.report.drawings.lettering import LETTER, obstacles
from gauss_bench.report.palette import INK, MUTED, PAPER
from gauss_bench.terms import Array

TURN = np.radians(4.0)  # of any link between two kept states: 0.1 px off the circle at a radius of 170 px
FRAMES = 60  # least number of kept steps, where there are as many
SLOWEST = 4.0  # [s] a loop takes at least: a shorter motion is slowed down to be seen
REST = 0.8  # [s] at the end of a motion that does not return to where it began
SAME = 0.5  # [px, degrees] the end of a motion is its beginning
HELD = 0.005  # [px] below what is written: does not move
STYLE = "@media print,(prefers-reduced-motion:reduce){.motion-film{display:none}.motion-still{display:inline}}"


def animate(mechanism: Mechanism, t: Array, q: Array, points: Sequence[Point] = ()) -> str:
    """SVG text of a linkage moving through states q (k, n) at times t (k,) [s], with the paths of points.

    Its size grows with the motion: some 6 kB for each link and turn of the fastest one.

    Raises:
        ValueError: fewer than two states, or times that do not increase.
    """
    if len(q) < 2 or len(t) != len(q) or not np.all(np.diff(t) > 0):
        raise ValueError("a motion needs two or more states at increasing times")
    shown = replace(mechanism, observed_points=tuple(points))
    kept = thin(t, q)
    states = q[kept]
    rails = [end for joint in slides(shown) if joint.guide.link != GROUND for end in rail(joint, states, 0.0)]
    canvas = fit(shown, states, (*points, *rails))
    film, slower = film_runs(t[kept], states, canvas)
    swept = np.vstack([obstacles(shown, x, canvas.at, _ground_guides(shown, states, canvas)) for x in states])
    acting = marks(shown, film.states, canvas.at)
    length, bar = scale_line(canvas, swept)
    parts = [
        f"<style>{STYLE}</style>",
        *pivots(shown, canvas),
        *paths(points, states, canvas),
        '<g class="motion-film">',
        *moving(shown, film, canvas, acting),
        "</g>",
        '<g class="motion-still" display="none">',
        *still(shown, states, canvas, length, bar),
        "</g>",
        *scale_bar(length, bar),
        *pace(slower, canvas, np.vstack([swept, bar[None]])),
    ]
    return page(canvas, mechanism.title or mechanism.name, parts)


def thin(t: Array, q: Array) -> list[int]:
    """States (k, n) to keep, both ends among them: as few as TURN and FRAMES allow."""
    theta = np.unwrap(q[:, 2::3], axis=0)
    longest = (t[-1] - t[0]) / FRAMES * (1 + 1e-9)  # rounding leaves even spacing even
    kept = [0]
    for i in range(1, len(t) - 1):
        turned = np.abs(theta[i + 1] - theta[kept[-1]]).max(initial=0.0)
        if turned > TURN or t[i + 1] - t[kept[-1]] > longest:
            kept.append(i)
    return [*kept, len(t) - 1]


@dataclass(frozen=True, eq=False)
class Film:
    """Kept states (f, n), angles unwrapped, and what every animated attribute has in common.

    Attributes:
        timing: duration, repetition and times of the states as SVG attributes.
    """

    states: Array
    timing: str

    def track(self, kind: str, values: Iterable[str]) -> str:
        """An animation of the transform of the element it stands in; a second one applies within the first."""
        more = 'additive="sum" ' if kind != "translate" else ""
        return f'<animateTransform attributeName="transform" type="{kind}" {more}values="{";".join(values)}" {self.timing}/>'


def film_runs(t: Array, q: Array, canvas: Canvas) -> tuple[Film, float]:
    """A film of states q (f, n) at times t (f,) on a canvas, and how many times slower than the motion it runs."""
    states = q.copy()
    states[:, 2::3] = np.unwrap(q[:, 2::3], axis=0)
    slower = max(1.0, SLOWEST / float(t[-1] - t[0]))
    seconds = (t - t[0]) * slower
    if not _returns(states, canvas):
        states, seconds = np.vstack([states, states[-1]]), np.append(seconds, seconds[-1] + REST)
    timing = f'dur="{seconds[-1]:.6g}s" repeatCount="indefinite"'
    parts = seconds / seconds[-1]
    if np.abs(parts - np.linspace(0, 1, len(parts))).max() > 1e-6:
        timing += f' keyTimes="{";".join(f"{x:.5g}" for x in parts)}"'
    return Film(states, timing), slower


def _returns(states: Array, canvas: Canvas) -> bool:
    way = states[-1] - states[0]
    turn = np.degrees(way[2::3])
    shift = np.hypot(way[0::3], way[1::3]) * canvas.scale
    return bool(shift.max(initial=0) < SAME and np.abs(turn - 360 * np.round(turn / 360)).max(initial=0) < SAME)


def _ground_guides(mechanism: Mechanism, states: Array, canvas: Canvas) -> list[Array]:
    return [guide_line(j, states[0], states, canvas) for j in slides(mechanism) if j.guide.link == GROUND]


def moving(mechanism: Mechanism, film: Film, canvas: Canvas, acting: Sequence[Mark]) -> list[str]:
    """Guides, links with the guides and blocks they carry, what acts on them, pins, and points with their names."""
    shapes = [part for line in _ground_guides(mechanism, film.states, canvas) for part in guide_shape(line, grounded=True)]
    blocks = {joint.block.link for joint in slides(mechanism)}
    for i in sorted(range(len(mechanism.links)), key=lambda i: (i not in blocks, i)):  # a block lies under the bar it slides on
        shapes += carry(
            mechanism.links[i], i, film, canvas, [*slide_parts(mechanism, i, film, canvas), *bars(mechanism, i, canvas)]
        )
    shapes += [part for mark in acting for part in mark_points(mark, film)]
    pins = {joint.joint: joint.a for joint in mechanism.joints if isinstance(joint, Revolute)}
    pin_ways = [canvas.at(position(film.states, p)) for p in pins.values()]
    shapes += [part for way in pin_ways for part in follow(way, film, [pin_shape(0, 0)])]
    for point in mechanism.observed_points:
        way = canvas.at(position(film.states, point))
        on_pin = any(np.abs(way - other).max() < SAME for other in pin_ways)
        shapes += follow(way, film, [dot_shape(0, 0, on_pin), *_name(point)])
    return shapes


def bars(mechanism: Mechanism, i: int, canvas: Canvas) -> list[str]:
    link = mechanism.links[i]
    return link_shape(link, {name: canvas.offset(x - link.com) for name, x in link.points.items()}, i == mechanism.crank)


def slide_parts(mechanism: Mechanism, i: int, film: Film, canvas: Canvas) -> list[str]:
    """Guides and blocks fixed in link i, in its frame."""
    shapes = []
    for joint in slides(mechanism):
        if joint.guide.link == i:
            ends = rail(joint, film.states, BEYOND / canvas.scale)
            shapes += guide_shape(canvas.offset(np.array([end.local for end in ends])), grounded=False)
        if joint.block.link == i:
            shapes.append(block_shape(canvas.offset(joint.block.local), joint.angle - joint.turn))
    return shapes


def _name(point: Point) -> list[str]:
    """The name of a point beside it, with a halo that keeps it legible over bars."""
    name = escape(point.name.partition(".")[2] or point.name)
    halo = f'paint-order="stroke" stroke="{PAPER}" stroke-width="3" stroke-linejoin="round"'
    return [f'<text x="8" y="-8" fill="{INK}" font-style="italic" {halo}>{name}</text>'] if name else []


def carry(link: Link, i: int, film: Film, canvas: Canvas, shapes: Sequence[str]) -> list[str]:
    """Shapes in the frame of link i, moved with it."""
    where = [f"{x:.2f} {y:.2f}" for x, y in canvas.at(film.states[:, 3 * i : 3 * i + 2])]
    turns = [f"{x:.2f}" for x in -np.degrees(film.states[:, 3 * i + 2])]
    start = f'<g transform="translate({where[0]}) rotate({turns[0]})"><title>{escape(link.name)}</title>'
    return [start, film.track("translate", where), film.track("rotate", turns), *shapes, "</g>"]


def follow(way: Array, film: Film, shapes: Sequence[str]) -> list[str]:
    """Shapes around the origin, moved along pixels (f, 2) without turning."""
    where = [f"{x:.2f} {y:.2f}" for x, y in way]
    start = f'<g transform="translate({where[0]})">'
    track = [film.track("translate", where)] if np.ptp(way, axis=0).max() > HELD else []
    return [start, *track, *shapes, "</g>"]


def mark_points(mark: Mark, film: Film) -> list[str]:
    """A mark carried, turned and stretched as it acts."""
    where = [f"{x:.2f} {y:.2f}" for x, y in mark.place]
    start = f'<g transform="translate({where[0]}) rotate({mark.turn[0]:.2f})">'
    tracks = [film.track("translate", where), film.track("rotate", [f"{x:.2f}" for x in mark.turn])]
    if np.ptp(mark.stretch) > 1e-4:
        tracks.append(film.track("scale", [f"{x:.4f} 1" for x in mark.stretch]))
    return [start, *tracks, *mark.shapes, "</g>"]


def still(mechanism: Mechanism, states: Array, canvas: Canvas, length: float, bar: Array) -> list[str]:
    """The first state as it is drawn elsewhere, with names."""
    q, acting = states[0], marks(mechanism, states[:1], canvas.at)
    avoid = obstacles(mechanism, q, canvas.at, [guide_line(j, q, states, canvas) for j in slides(mechanism)])
    avoid = np.vstack([avoid, *(mark.reach for mark in acting)])
    names = names_of(mechanism, q, canvas, avoid, acting, length, bar)
    parts = [*guides(mechanism, q, states, canvas), *links(mechanism, q, canvas), *(mark.standing for mark in acting)]
    return [*parts, *joints(mechanism, q, canvas), *names]


def pace(slower: float, canvas: Canvas, avoid: Array) -> list[str]:
    """The slowness of the film against the motion, in the corner with most room; nothing where it keeps time."""
    if slower < 1.05:
        return []
    text = f"slowed {slower:.2g} times"
    x, y = free_corner(canvas, 0.5 * LETTER * len(text), avoid)
    return [f'<text x="{x:.1f}" y="{y:.1f}" text-anchor="middle" font-size="11" fill="{MUTED}">{text}</text>']
