"""A linkage to turn by hand.

Links are drawn once, in their own frames; the page carries them through the states of a turn of the crank, which this project's own
kinematics solves.
"""

from collections.abc import Sequence
from typing import Any
from xml.sax.saxutils import escape

import numpy as np
from markupsafe import Markup

from gauss_bench.linkage.errors import LinkageError
from gauss_bench.mechanism.model import GROUND, Mechanism, Revolute
from gauss_bench.report.drawings.animation import bars, slide_parts
from gauss_bench.report.drawings.drawing import (
    Canvas,
    dot_shape,
    fit,
    guide_line,
    guide_shape,
    paths,
    pin_shape,
    pivots,
    rail,
    slides,
)
from gauss_bench.report.linkages import pose_in
from gauss_bench.report.palette import inline
from gauss_bench.report.rows import Run
from gauss_bench.terms import Array


class Film:
    """The states of a film, as `slide_parts` asks for them."""

    timing = ""

    def __init__(self, states: Array) -> None:
        self.states = states


def turn_frames(run: Run, name: str) -> tuple[Mechanism, Array] | None:
    """A linkage and the states of a turn of its crank; None without a file, or where it does not come round."""
    try:
        mechanism, _, trace = pose_in(run, name, 0.0)
        if trace is None:
            mechanism, _, trace = pose_in(run, name)
    except LinkageError:
        return None
    if trace is None or mechanism.crank is None or mechanism.crank < 0:
        return None
    turn = trace[-1, 3 * mechanism.crank + 2] - trace[0, 3 * mechanism.crank + 2]
    return (mechanism, trace) if abs(abs(turn) - 2 * np.pi) < 1e-6 else None


def turning(run: Run, name: str) -> tuple[Markup, dict[str, Any]] | None:
    """A linkage's SVG whose parts carry numbers, and where every part is in each state [px, degrees]."""
    motion = turn_frames(run, name)
    if motion is None:
        return None
    mechanism, states = motion
    assert mechanism.crank is not None
    states = unwrap_angles(states)
    canvas = canvas_of(mechanism, states)
    text = svg_of(mechanism, states, canvas)
    poses = np.round(in_pixels(canvas, states), 2).swapaxes(0, 1).tolist()
    first = float(states[0, 3 * mechanism.crank + 2])
    sense = float(np.sign(states[-1, 3 * mechanism.crank + 2] - first))
    return Markup(inline(text, name.replace("_", "-"))), {"poses": poses, "first": round(first, 9), "sense": sense}


def unwrap_angles(states: Array) -> Array:
    """States (k, n) whose angles go on where they pass half a turn."""
    states = states.copy()
    states[:, 2::3] = np.unwrap(states[:, 2::3], axis=0)
    return states


def canvas_of(mechanism: Mechanism, states: Array) -> Canvas:
    """A canvas that holds a linkage with its rails at all states (k, n)."""
    rails = [end for joint in slides(mechanism) if joint.guide.link != GROUND for end in rail(joint, states, 0.0)]
    return fit(mechanism, states, (*mechanism.observed_points, *rails))


def in_pixels(canvas: Canvas, states: Array) -> Array:
    """The drawn places of links (k, links, 3) [px, px, degrees] at states (k, n)."""
    links = states.reshape(len(states), -1, 3)
    return np.concatenate((canvas.at(links[..., :2]), -np.degrees(links[..., 2:])), axis=-1)


def svg_of(mechanism: Mechanism, states: Array, canvas: Canvas) -> str:
    """The linkage, every link and pin a group of its own at the first state."""
    film: Any = Film(states)
    shapes = list(pivots(mechanism, canvas))
    shapes += paths(mechanism.observed_points, states, canvas)
    for joint in slides(mechanism):
        if joint.guide.link == GROUND:
            shapes += guide_shape(guide_line(joint, states[0], states, canvas), grounded=True)
    blocks = {joint.block.link for joint in slides(mechanism)}
    for i in sorted(range(len(mechanism.links)), key=lambda i: (i not in blocks, i)):
        inside = [*slide_parts(mechanism, i, film, canvas), *bars(mechanism, i, canvas)]
        shapes += [f'<g data-link="{i}"><title>{escape(mechanism.links[i].name)}</title>', *inside, "</g>"]
    for pin in {joint.joint: joint.a for joint in mechanism.joints if isinstance(joint, Revolute)}.values():
        shapes += carry(mechanism, pin.link, pin.local, states, canvas, [pin_shape(0, 0)])
    for point in mechanism.observed_points:
        shapes += carry(mechanism, point.link, point.local, states, canvas, [dot_shape(0, 0, False)])
    size = f'viewBox="0 0 {canvas.width:g} {canvas.height:g}"'
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" {size} role="img" aria-label="{escape(mechanism.name)}">{"".join(shapes)}</svg>'
    )


def carry(mechanism: Mechanism, link: int, local: Array, states: Array, canvas: Canvas, shapes: Sequence[str]) -> list[str]:
    """Shapes at a point of a link, which moves but does not turn with it."""
    if link == GROUND:
        x, y = canvas.at(np.asarray(local))
        return [f'<g transform="translate({x:.2f} {y:.2f})">', *shapes, "</g>"]
    x, y = canvas.offset(np.asarray(local))
    return [f'<g data-link="{link}" data-x="{x:.2f}" data-y="{y:.2f}">', *shapes, "</g>"]
