"""A linkage whose crank a reader turns on the page.

Links are drawn once, in their own frames. A script moves the drawn links through the states of a full turn of the crank. The suite
has computed the states of the turn by closing the loops at each crank angle.
"""

from dataclasses import dataclass
from typing import Any
from xml.sax.saxutils import escape

import numpy as np
from markupsafe import Markup

from gauss_bench.linkage.errors import LinkageError
from gauss_bench.mechanism.model import Mechanism
from gauss_bench.report.drawings.canvas import Canvas, Part
from gauss_bench.report.drawings.drawing import canvas_of, draw_paths, linkage_parts
from gauss_bench.report.drawings.pose import crank_angles, unwrap_angles
from gauss_bench.report.linkages import pose_in
from gauss_bench.report.palette import inline
from gauss_bench.report.rows import Run
from gauss_bench.terms import Array


@dataclass(frozen=True, eq=False)
class Turn:
    """States (k, n) of a linkage over a full turn of its crank, with continuous angles."""

    mechanism: Mechanism
    states: Array

    def at(self, crank: Array) -> Array:
        """Return states (l, n) at crank angles (l,) [rad], by linear interpolation; angles of links may be off by whole turns."""
        own = crank_angles(self.mechanism, self.states)  # (k,)
        sense = np.sign(own[-1] - own[0])
        turned = np.mod((crank - own[0]) * sense, 2 * np.pi)  # (l,) [rad] since the first state
        return np.stack([np.interp(turned, (own - own[0]) * sense, column) for column in self.states.T], axis=-1)


def find_turn(run: Run, name: str) -> Turn | None:
    """Return the states of a linkage over a full turn of its crank, beginning at the crank angle 0 if possible."""
    try:
        mechanism, _, trace = pose_in(run, name, 0.0)
        if trace is None:  # the linkage cannot start at 0 degrees: try the angle of the drawings
            mechanism, _, trace = pose_in(run, name)
    except LinkageError:
        return None
    # a negative index is the ground
    if trace is None or mechanism.crank is None or mechanism.crank < 0:
        return None
    turn = Turn(mechanism, unwrap_angles(trace))
    first, last = crank_angles(mechanism, turn.states)[[0, -1]]
    return turn if abs(abs(last - first) - 2 * np.pi) < 1e-6 else None


def draw_turn(run: Run, name: str) -> tuple[Markup, dict[str, Any]] | None:
    """Return the SVG of a linkage with numbered links, and the data of its motion: places of all links in each state."""
    turn = find_turn(run, name)
    if turn is None:
        return None
    canvas = canvas_of(turn.mechanism, turn.states)
    text = draw_numbered(turn.mechanism, turn.states, canvas)
    first, last = crank_angles(turn.mechanism, turn.states)[[0, -1]].tolist()
    data = {"poses": list_frames(in_pixels(canvas, turn.states)), "first": round(first, 9), "sense": np.sign(last - first)}
    return Markup(inline(text, name.replace("_", "-"))), data


def in_pixels(canvas: Canvas, states: Array) -> Array:
    """Return x, y and angle of links as drawn, (k, links, 3) [px, px, degrees], at states (k, n)."""
    links = states.reshape(len(states), -1, 3)
    return np.concatenate((canvas.at(links[..., :2]), -np.degrees(links[..., 2:])), axis=-1)


def list_frames(places: Array) -> list[Any]:
    """Return places (k, links, 3) [px, px, degrees] as a list of k places for each link, rounded to 0.01."""
    return list(np.round(places, 2).swapaxes(0, 1).tolist())


def draw_numbered(mechanism: Mechanism, states: Array, canvas: Canvas) -> str:
    """Return the SVG of the first of states (k, n); each moving part has the number of its link as an attribute."""
    parts = linkage_parts(mechanism, states, None, canvas, forces=False)
    shapes = [*draw_paths(mechanism.observed_points, states, canvas), *(part.draw(_number_link(part)) for part in parts)]
    size = f'viewBox="0 0 {canvas.width:g} {canvas.height:g}"'
    start = f'<svg xmlns="http://www.w3.org/2000/svg" {size} role="img" aria-label="{escape(mechanism.name)}">'
    return f"{start}{''.join(shapes)}</svg>"


def _number_link(part: Part) -> str:
    """Return the attributes by which a script moves a part: its link, and its place on the link if the part stays upright."""
    if part.link < 0:
        return ""
    place = "" if part.local is None else ' data-x="{:.2f}" data-y="{:.2f}"'.format(*part.local)
    return f' data-link="{part.link}"{place}'
