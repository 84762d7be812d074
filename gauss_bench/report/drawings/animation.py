"""Animate a linkage as one SVG that moves by itself in a loop, without a script.

A link is drawn once, in its own frame, and an SVG transform moves it by its centre of mass z and its angle theta:

    x = z + R(theta) local   as   translate(z) rotate(-theta), since y points down on the page.

The browser interpolates linearly between the frames, the states in the file. If a link turns by d_theta between two frames, a point
at the distance r from z is drawn off its circular path by at most r d_theta^2 / 8. In print, and in browsers set to reduced
motion, a still picture of the start is shown.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from xml.sax.saxutils import escape

import numpy as np

from gauss_bench.mechanism.model import Mechanism, Point
from gauss_bench.report.drawings.canvas import Canvas, Part, make_svg
from gauss_bench.report.drawings.drawing import canvas_of, draw_paths, free_corner, linkage_parts, place_scale
from gauss_bench.report.drawings.lettering import LETTER, draw_names
from gauss_bench.report.drawings.pose import unwrap_angles
from gauss_bench.report.palette import INK, MUTED, PAPER
from gauss_bench.terms import Array

TURN = np.radians(4.0)  # largest turn of a link between two frames: 0.1 px off the circle at a radius of 170 px
FRAMES = 60  # smallest number of intervals between frames, if the motion has enough states
SHORTEST = 4.0  # [s] length of the shortest film; a shorter motion is slowed down
REST = 0.8  # [s] rest at the end of a motion that does not return to its beginning
CLOSED = 0.5  # [px, degrees] a motion returns to its beginning if its end differs by less
STILL = 0.005  # [px, degrees] a part that moves by less is drawn at rest: the file has two decimals
STYLE = "@media print,(prefers-reduced-motion:reduce){.motion-film{display:none}.motion-still{display:inline}}"
HALO = f'paint-order="stroke" stroke="{PAPER}" stroke-width="3" stroke-linejoin="round"'  # keeps a name legible over bars


def animate(mechanism: Mechanism, t: Array, q: Array, points: Sequence[Point] = ()) -> str:
    """Return the SVG of a linkage moving through states q (k, n) at times t (k,) [s], with the paths of points.

    Raises:
        ValueError: fewer than two states, or times that do not match or do not increase.
    """
    if len(q) < 2 or len(t) != len(q) or not np.all(np.diff(t) > 0):
        raise ValueError("a motion needs two or more states at increasing times")
    shown = replace(mechanism, observed_points=tuple(points))
    frames = choose_frames(t, q)
    states = q[frames]
    canvas = canvas_of(shown, states)
    film, slower = make_film(t[frames], states, canvas)
    # names of points move with their points; "link.point" is printed without the link
    names = {p.name: escape(p.name.partition(".")[2] or p.name) for p in points if p.name}
    look = f'x="8" y="-8" fill="{INK}" font-style="italic" {HALO}'
    letters = {point: f"<text {look}>{name}</text>" for point, name in names.items()}
    # the animated parts, and the parts at the start, which are shown if animations are switched off
    moving = [*linkage_parts(shown, film.states, trace=None, canvas=canvas, letters=letters)]
    still = [*linkage_parts(shown, states[:1], trace=states, canvas=canvas)]
    # (l, 2, 2) lines [px] of the moving parts at all states, from which the scale bar keeps away
    swept = np.vstack([part.lines(k) for part in moving for k in range(len(part.place))])
    scale, taken, ends = place_scale(canvas, swept)
    parts = [
        f"<style>{STYLE}</style>",
        *draw_paths(points, states, canvas),
        '<g class="motion-film">',
        *map(film.draw, moving),
        '</g><g class="motion-still" display="none">',
        *(part.draw() for part in still),
        *draw_names(shown, states[0], canvas, still, taken, ends),
        "</g>",
        *scale,
        *draw_pace(slower, canvas, np.vstack([swept, ends[None]])),
    ]
    return make_svg(canvas, mechanism.title or mechanism.name, parts)


def choose_frames(t: Array, q: Array) -> list[int]:
    """Return the indices of the states q (k, n) that become frames of an animation, with the first and the last state.

    There are as few frames as possible. From frame to frame a link turns by at most TURN, and the time is at most the duration /
    FRAMES, unless neighbouring states are farther apart.

    Args:
        t: times (k,) of the states [s].
    """
    theta = np.unwrap(q[:, 2::3], axis=0)  # (k, links)
    # the margin for rounding gives frames at equal intervals if the states are at equal intervals
    longest = (t[-1] - t[0]) / FRAMES * (1 + 1e-9)
    frames = [0]
    for i in range(1, len(t) - 1):
        # state i becomes a frame if the next state is too far from the last frame
        turned = np.abs(theta[i + 1] - theta[frames[-1]]).max(initial=0.0)
        if turned > TURN or t[i + 1] - t[frames[-1]] > longest:
            frames.append(i)
    return [*frames, len(t) - 1]


@dataclass(frozen=True, eq=False)
class Film:
    """The frames of an animation, and the timing of all its animated attributes.

    Attributes:
        states: (f, n) the states of the frames, with continuous angles.
        timing: duration, repetition and times of the frames, as text with attributes of an SVG animation.
    """

    states: Array
    timing: str

    def draw(self, part: Part) -> str:
        """Return the SVG of a part with its animated translation, rotation and stretch, applied in this order from the outside."""

        def animate_transform(kind: str, values: Sequence[str], more: str = 'additive="sum" ') -> str:
            """Return the SVG of a track: the values of a transform such as "rotate" in each frame."""
            return f'<animateTransform attributeName="transform" type="{kind}" {more}values="{";".join(values)}" {self.timing}/>'

        is_stretched = np.ptp(part.stretch) > 1e-4
        is_moved = np.ptp(part.place, axis=0).max() > STILL or np.ptp(part.turn) > STILL or is_stretched
        tracks = []
        # The track of translations replaces the whole transform of `Part.draw`, and the other tracks multiply it. So every part
        # that moves has a translation, and a rotation unless it is upright. Links (parts with a title) always have both.
        if part.title or is_moved:
            tracks.append(animate_transform("translate", [f"{x:.2f} {y:.2f}" for x, y in part.place], ""))
            if part.title or part.turn.any():
                tracks.append(animate_transform("rotate", [f"{x:.2f}" for x in part.turn]))
        if is_stretched:  # along the x axis alone
            tracks.append(animate_transform("scale", [f"{x:.4f} 1" for x in part.stretch]))
        return part.draw(inside="".join(tracks))


def make_film(t: Array, q: Array, canvas: Canvas) -> tuple[Film, float]:
    """Return the animation of states q (f, n) at times t (f,) [s], and the factor by which it is slower than the motion."""
    states = unwrap_angles(q)
    slower = max(1.0, SHORTEST / float(t[-1] - t[0]))
    seconds = (t - t[0]) * slower
    change = (states[-1] - states[0]).reshape(-1, 3)
    turn, shift = np.degrees(change[:, 2]), np.hypot(change[:, 0], change[:, 1]) * canvas.scale
    difference = np.concatenate([shift, np.abs(turn - 360 * np.round(turn / 360))])  # [px, degrees] without whole turns
    if not (difference < CLOSED).all():  # rest at the end before the film begins again
        states, seconds = np.vstack([states, states[-1]]), np.append(seconds, seconds[-1] + REST)
    timing = f'dur="{seconds[-1]:.6g}s" repeatCount="indefinite"'
    shares = seconds / seconds[-1]  # of the duration
    if np.abs(shares - np.linspace(0, 1, len(shares))).max() > 1e-6:  # SVG assumes equal intervals unless times are given
        timing += f' keyTimes="{";".join(f"{x:.5g}" for x in shares)}"'
    return Film(states, timing), slower


def draw_pace(slower: float, canvas: Canvas, avoid: Array) -> list[str]:
    """Return the SVG of the caption "slowed x times" in the corner with most room; nothing without slowing.

    Args:
        avoid: segments (k, 2, 2) [px] from which the caption keeps away.
    """
    if slower < 1.05:
        return []
    text = f"slowed {slower:.2g} times"
    x, y = free_corner(canvas, 0.5 * LETTER * len(text), avoid)
    return [f'<text x="{x:.1f}" y="{y:.1f}" text-anchor="middle" font-size="11" fill="{MUTED}">{text}</text>']
