"""The canvas of a drawing, which maps metres to pixels, and its parts, each drawn once in a frame of its own and then moved."""

from collections.abc import Iterable
from dataclasses import dataclass, field
from xml.sax.saxutils import escape

import numpy as np

from gauss_bench.report.palette import PAPER
from gauss_bench.terms import Array

MARGIN = 52.0  # [px]
NO_LINES = np.zeros((0, 2, 2))


@dataclass(frozen=True, eq=False)
class Canvas:
    """The map from metres to pixels: x to the right; y up in metres, down in pixels.

    Attributes:
        low: (2,) smallest x and y of the drawing [m].
        scale: pixels in a metre.
        width, height: size of the picture [px].
    """

    low: Array
    scale: float
    width: float
    height: float

    def at(self, x: Array) -> Array:
        """Return pixels (..., 2) of world positions (..., 2) [m]."""
        shift = (x - self.low) * self.scale + MARGIN
        return np.stack((shift[..., 0], self.height - shift[..., 1]), axis=-1)

    def offset(self, x: Array) -> Array:
        """Return vectors (..., 2) [m], such as positions in a link's frame, in pixels: scaled and mirrored, but not shifted."""
        return np.asarray(x * (self.scale, -self.scale))


@dataclass(frozen=True, eq=False)
class Part:
    """A part of a drawing: shapes in a frame of their own, in pixels, and the motion of this frame over k states.

    Attributes:
        place: (k, 2) position of the frame's origin in the picture [px].
        turn: (k,) angles of the frame [deg], clockwise as in SVG; zeros for a part that stays upright.
        stretch: (k,) factors of lengths along the x axis of the frame.
        reach: (l, 2, 2) line segments [px] in the frame that outline the part; names are placed away from them.
        name, title: name of a force or driver, drawn beside the part; name of a link, shown as a tooltip; else empty.
        link: index of the link that moves the part, -1 for none.
        local: (2,) place on this link [px], for a part that moves with the link and stays upright.
    """

    shapes: tuple[str, ...]
    place: Array
    turn: Array
    stretch: Array
    reach: Array = field(default_factory=lambda: NO_LINES)
    name: str = ""
    title: str = ""
    link: int = -1
    local: Array | None = None

    def lines(self, k: int = 0) -> Array:
        """Return the line segments `reach` (l, 2, 2) at state k in pixels of the picture: stretched, turned and moved."""
        c, s = np.cos(np.radians(self.turn[k])), np.sin(np.radians(self.turn[k]))
        x, y = self.reach[..., 0] * self.stretch[k], self.reach[..., 1]
        return np.asarray(self.place[k] + np.stack((c * x - s * y, s * x + c * y), axis=-1))

    def draw(self, more: str = "", inside: str = "") -> str:
        """Return the SVG of the part's shapes, moved and turned to the first state; they are never stretched.

        Args:
            more: further attributes of the group, with a space before each.
            inside: SVG elements before the shapes.
        """
        (x, y), turn = self.place[0], round(self.turn[0], 2)  # rounded first: 1e-30 on one machine may be 0 on another
        tooltip = f"<title>{escape(self.title)}</title>" if self.title else ""
        move = f"translate({x:.2f} {y:.2f})" + (f" rotate({turn:.2f})" if turn else "")
        return f'<g{more} transform="{move}">{tooltip}{inside}{"".join(self.shapes)}</g>'


def make_part(shapes: Iterable[str], place: Array, turn: Array | float = 0.0, **more: object) -> Part:
    """Return a part at pixels (k, 2) or (2,), by default neither turned nor stretched; `more` has further fields of `Part`."""
    place = np.atleast_2d(place)
    stretch = more.pop("stretch", np.ones(len(place)))
    return Part(tuple(shapes), place, np.broadcast_to(turn, len(place)), stretch, **more)  # type: ignore[arg-type]


def path_data(points: Array, closed: bool = False) -> str:
    """Return the attribute `d` of an SVG path through pixels (k, 2)."""
    return "M" + "L".join(f"{x:.1f} {y:.1f}" for x, y in points) + ("Z" if closed else "")


def stroke(style: str, *lines: Array) -> str:
    """Return one SVG element that draws polygonal lines, each (k, 2) [px]; `style` has its attributes."""
    return f'<path d="{"".join(map(path_data, lines))}" {style}/>'


def direction(angle: Array | float) -> Array:
    """Return the unit vectors (..., 2) at angles (...) [rad]."""
    return np.stack([np.cos(angle), np.sin(angle)], axis=-1)


def turn_left(vector: Array) -> Array:
    """Return a vector (2,) turned by 90 degrees, from x towards y."""
    return np.array([-vector[1], vector[0]])


def make_svg(canvas: Canvas, title: str, parts: Iterable[str]) -> str:
    """Return the text of an SVG file with a background and `parts`, which are SVG elements."""
    size = f'viewBox="0 0 {canvas.width:.0f} {canvas.height:.0f}" width="{canvas.width:.0f}" height="{canvas.height:.0f}"'
    start = f'<svg xmlns="http://www.w3.org/2000/svg" {size} role="img" font-family="Helvetica, Arial, sans-serif" font-size="13">'
    paper = f'<rect width="100%" height="100%" fill="{PAPER}"/>'
    return f"{start}<title>{escape(title)}</title>\n{paper}\n" + "\n".join(parts) + "\n</svg>\n"
