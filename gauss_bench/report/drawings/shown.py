"""Write a run as one file: its curves as SVG or PNG, or the moving linkage as SVG, GIF or an HTML page with all curves."""

import io

import numpy as np
import vl_convert
from PIL import Image

from gauss_bench.mechanism.model import Mechanism
from gauss_bench.report.drawings.animation import SLOWEST, animate, thin
from gauss_bench.report.drawings.drawing import draw_at, fit
from gauss_bench.report.drawings.history import LEFT, RIGHT, WIDTH, plot
from gauss_bench.report.pages import make_environment
from gauss_bench.report.palette import inline
from gauss_bench.report.plotting import png, svg
from gauss_bench.terms import Array
from gauss_bench.trajectory import Caption, History, Trajectory

RATE = 20.0  # [1/s] pictures of a GIF
MOST = 160  # largest number of pictures of a GIF; a longer film runs faster


def picture(kind: str, told: Caption, history: History) -> bytes:
    """Return the curves of a run as ".svg" or ".png"."""
    figure = plot(history, told)
    return svg(figure).encode() if kind.lower() == ".svg" else png(figure)


def film(kind: str, told: Caption, history: History, mechanism: Mechanism, trajectory: Trajectory) -> bytes:
    """Return the moving linkage, up to the time until which the run is trusted, as ".svg", ".gif" or ".html"."""
    count = len(trajectory.t) if told.trusted is None else int(np.searchsorted(trajectory.t, told.trusted, "right"))
    t, q = trajectory.t[:count], trajectory.q[:count]
    if count < 2:  # too few samples for a motion: show the start, standing still
        t, q = np.array([0.0, SLOWEST]), np.vstack([trajectory.q[:1]] * 2)
    match kind.lower():
        case ".svg":
            return animate(mechanism, t, q, mechanism.observed_points).encode()
        case ".gif":
            return _gif(mechanism, t, q)
        case _:
            return _page(told, history, animate(mechanism, t, q, mechanism.observed_points), t).encode()


def _gif(mechanism: Mechanism, t: Array, q: Array) -> bytes:
    """Return a GIF of pictures that follow one another at equal intervals."""
    slower = max(1.0, SLOWEST / float(t[-1] - t[0]))
    count = int(np.clip(round(RATE * float(t[-1] - t[0]) * slower), 2, MOST))
    shown = np.searchsorted(t, np.linspace(t[0], t[-1], count)).clip(0, len(t) - 1)
    trace = q[thin(t, q)]
    canvas = fit(mechanism, q)
    drawn = (vl_convert.svg_to_png(draw_at(mechanism, q[k], trace, canvas), scale=1.0, ppi=72) for k in shown)
    pictures = [Image.open(io.BytesIO(x)).convert("RGB") for x in drawn]
    first = pictures[0].quantize(128)  # all pictures share this palette, so that the file is small and colours do not flicker
    kept = [picture.quantize(palette=first, dither=Image.Dither.NONE) for picture in pictures]
    seconds = max(float(t[-1] - t[0]) * slower / count, 1 / RATE) if count < MOST else 1 / RATE
    buffer = io.BytesIO()
    kept[0].save(buffer, "GIF", save_all=True, append_images=kept[1:], duration=round(1000 * seconds), loop=0, optimize=True)
    return buffer.getvalue()


def _page(told: Caption, history: History, moving: str, t: Array) -> str:
    """Return a self-contained page with the moving linkage, its curves, and a line that marks the current time in them."""
    figure = plot(history, told, head=False)
    return (
        make_environment("gauss_bench.report")
        .get_template("run.html")
        .render(
            told=told,
            film=inline(moving, "film"),
            curves=inline(svg(figure), "curves"),
            left=100 * LEFT / WIDTH,
            wide=100 * (WIDTH - LEFT - RIGHT) / WIDTH,
            until=float(t[-1]),
            share=(float(t[-1]) - float(t[0])) / (told.until - float(t[0]) or 1.0),
            length=max(SLOWEST, float(t[-1] - t[0])),
        )
    )
