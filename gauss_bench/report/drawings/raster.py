"""Turns our own drawings into pixels: of SVG just what they consist of, so that a picture and a film are drawn by the same lines.

Paths of straight lines (M, L, H, V, Z), rectangles, circles, texts and groups that are moved, turned and stretched. Anything else
is refused, so that nothing is left out without a word.
"""

import io
import re
import xml.etree.ElementTree as ET
from collections.abc import Sequence
from typing import Any, Literal

import numpy as np
from matplotlib.backends.backend_agg import RendererAgg
from matplotlib.colors import to_rgba
from matplotlib.font_manager import FontProperties
from matplotlib.path import Path
from matplotlib.transforms import Affine2D, Transform
from PIL import Image

SHARP = 1.5  # pixels for each unit of the drawing
SVG = "{http://www.w3.org/2000/svg}"
NUMBER = re.compile(r"-?\d+\.?\d*(?:e-?\d+)?")
STEPS = re.compile(r"([MLHVZ])([^MLHVZ]*)")


def pixels(svg: str, sharp: float = SHARP) -> Image.Image:
    """The picture of a drawing.

    Raises:
        ValueError: an element or a step of a path that drawings do not have.
    """
    root = ET.fromstring(svg)
    width, height = (float(root.attrib[x]) for x in ("width", "height"))
    agg: Any = RendererAgg
    renderer = agg(round(width * sharp), round(height * sharp), 72.0 * sharp)
    to_page = Affine2D().translate(0.0, -height).scale(sharp, -sharp)
    sheet = _Sheet(renderer, sharp, round(height * sharp), (width, height))
    for element in root:
        sheet.draw(element, to_page)
    return Image.fromarray(np.asarray(renderer.buffer_rgba())).convert("RGB")


def gif(frames: Sequence[str], seconds: float) -> bytes:
    """Drawings of one size as a film that repeats, each shown for a number of seconds."""
    pictures = [pixels(frame, 1.0) for frame in frames]
    first = pictures[0].quantize(128)
    kept = [picture.quantize(palette=first, dither=Image.Dither.NONE) for picture in pictures]
    buffer = io.BytesIO()
    kept[0].save(buffer, "GIF", save_all=True, append_images=kept[1:], duration=round(1000 * seconds), loop=0, optimize=True)
    return buffer.getvalue()


class _Sheet:
    """Draws elements on a renderer."""

    def __init__(self, renderer: Any, sharp: float, tall: int, size: tuple[float, float]):
        self.renderer, self.sharp, self.tall, self.size = renderer, sharp, tall, size

    def draw(self, element: ET.Element, to_page: Transform) -> None:
        kind, x = element.tag.removeprefix(SVG), element.attrib
        here = _move(x.get("transform", "")) + to_page
        match kind:
            case "g":
                for child in element:
                    self.draw(child, here)
            case "path":
                self._fill_and_stroke(_path(x["d"]), x, here)
            case "rect":
                wide, high = (self.size[i] if x[k] == "100%" else float(x[k]) for i, k in enumerate(("width", "height")))
                left, top = float(x.get("x", 0)), float(x.get("y", 0))
                corners = [(left, top), (left + wide, top), (left + wide, top + high), (left, top + high), (left, top)]
                self._fill_and_stroke(Path(np.array(corners), closed=True), x, here)
            case "circle":
                centre, radius = (float(x.get("cx", 0)), float(x.get("cy", 0))), float(x["r"])
                self._fill_and_stroke(Path.circle(centre, radius), x, here)
            case "text":
                self._write(element.text or "", x, here)
            case "title" | "style" | "animateTransform":
                pass
            case _:
                raise ValueError(f"no drawing of ours has an element {kind}")

    def _fill_and_stroke(self, path: Path, x: dict[str, str], here: Transform) -> None:
        fill, stroke = x.get("fill", "black"), x.get("stroke", "none")
        if fill != "none":
            gc = self.renderer.new_gc()
            gc.set_linewidth(0.0)
            self.renderer.draw_path(gc, path, here, to_rgba(fill, float(x.get("fill-opacity", 1))))
        if stroke != "none":
            gc = self.renderer.new_gc()
            gc.set_foreground(to_rgba(stroke, float(x.get("stroke-opacity", 1))), isRGBA=True)
            gc.set_linewidth(float(x.get("stroke-width", 1)))
            gc.set_capstyle("round" if x.get("stroke-linecap") == "round" else "butt")
            gc.set_joinstyle("round" if x.get("stroke-linejoin") == "round" else "miter")
            if dashes := [float(y) for y in NUMBER.findall(x.get("stroke-dasharray", ""))]:
                gc.set_dashes(0, [y * self.sharp for y in dashes])
            self.renderer.draw_path(gc, path, here)

    def _write(self, text: str, x: dict[str, str], here: Transform) -> None:
        style: Literal["italic", "normal"] = "italic" if x.get("font-style") == "italic" else "normal"
        font = FontProperties("DejaVu Sans", style=style, size=float(x.get("font-size", 13)) * 0.88)  # as wide as Helvetica
        wide, _, _ = self.renderer.get_text_width_height_descent(text, font, False)
        left, up = here.transform((float(x["x"]), float(x["y"])))
        left -= {"middle": 0.5, "end": 1.0}.get(x.get("text-anchor", ""), 0.0) * wide
        halo = [(a, b) for a in (-1.5, 0, 1.5) for b in (-1.5, 0, 1.5)] if x.get("paint-order") == "stroke" else []
        for colour, places in ((x.get("stroke", "white"), halo), (x.get("fill", "black"), [(0, 0)])):
            gc = self.renderer.new_gc()
            gc.set_foreground(colour)
            for a, b in places:
                self.renderer.draw_text(gc, left + a * self.sharp, self.tall - up + b * self.sharp, text, font, 0.0)


def _path(text: str) -> Path:
    """A path of straight lines."""
    if strange := set(re.findall(r"[A-Za-df-z]", text)) - set("MLHVZ"):
        raise ValueError(f"no drawing of ours has a path with {min(strange)}")
    corners: list[tuple[float, float]] = []
    codes: list[int] = []
    x = y = 0.0
    begin = (0.0, 0.0)
    for letter, rest in STEPS.findall(text):
        numbers = [float(n) for n in NUMBER.findall(rest)]
        if letter == "Z":
            corners.append(begin)
            codes.append(int(Path.CLOSEPOLY))
            continue
        flat = [(n, y) if letter == "H" else (x, n) for n in numbers]
        pairs = list(zip(numbers[::2], numbers[1::2], strict=True)) if letter in "ML" else flat
        for k, (x, y) in enumerate(pairs):
            first = letter == "M" and k == 0
            begin = (x, y) if first else begin
            corners.append((x, y))
            codes.append(int(Path.MOVETO if first else Path.LINETO))
    return Path(np.array(corners), codes)


def _move(text: str) -> Affine2D:
    """The transform of an attribute; the last one named acts first."""
    transform = Affine2D()
    for kind, rest in reversed(re.findall(r"(\w+)\(([^)]*)\)", text)):
        numbers = [float(n) for n in NUMBER.findall(rest)]
        match kind:
            case "translate":
                transform.translate(*numbers)
            case "rotate":
                transform.rotate_deg(*numbers)
            case "scale":
                transform.scale(*numbers)
            case _:
                raise ValueError(f"no drawing of ours is moved by {kind}")
    return transform
