"""Encode a run as one file: its curves as SVG or PNG, or the moving linkage as SVG, GIF or an HTML page with all curves."""

import io

import numpy as np
import vl_convert
from PIL import Image

from gauss_bench.mechanism.model import Mechanism
from gauss_bench.report.drawings.animation import SHORTEST, animate, choose_frames
from gauss_bench.report.drawings.drawing import draw_at, fit_canvas
from gauss_bench.report.drawings.history import LEFT, RIGHT, WIDTH, plot
from gauss_bench.report.pages import make_environment
from gauss_bench.report.palette import inline
from gauss_bench.report.plotting import png, svg
from gauss_bench.terms import Array
from gauss_bench.trajectory import Caption, History, Trajectory

RATE = 20.0  # pictures per second of a GIF
MOST = 160  # largest number of pictures of a GIF; a film that would need more is played faster


def encode_curves(kind: str, caption: Caption, history: History) -> bytes:
    """Return the file with the curves of a run; `kind` is ".svg" or ".png"."""
    figure = plot(history, caption)
    return svg(figure).encode() if kind.lower() == ".svg" else png(figure)


def encode_film(kind: str, caption: Caption, history: History, mechanism: Mechanism, trajectory: Trajectory) -> bytes:
    """Return the file (".svg", ".gif" or ".html") with the moving linkage, up to the time until which the run is trusted."""
    count = len(trajectory.t)
    if caption.trusted is not None:
        count = int(np.searchsorted(trajectory.t, caption.trusted, "right"))
    t, q = trajectory.t[:count], trajectory.q[:count]
    if count < 2:  # too few samples for a motion: show the start, standing still
        t, q = np.array([0.0, SHORTEST]), np.vstack([trajectory.q[:1]] * 2)
    if kind.lower() == ".gif":
        return _encode_gif(mechanism, t, q)
    moving = animate(mechanism, t, q, mechanism.observed_points)
    return (moving if kind.lower() == ".svg" else _write_page(caption, history, moving, t)).encode()


def _encode_gif(mechanism: Mechanism, t: Array, q: Array) -> bytes:
    """Return a GIF of the states q (k, n) at times t (k,) [s], with pictures at equal intervals.

    A motion of less than SHORTEST seconds is slowed down to SHORTEST. The GIF of a long motion has MOST pictures and runs faster
    than the motion.
    """
    slower = max(1.0, SHORTEST / float(t[-1] - t[0]))
    count = int(np.clip(round(RATE * float(t[-1] - t[0]) * slower), 2, MOST))
    shown = np.searchsorted(t, np.linspace(t[0], t[-1], count)).clip(0, len(t) - 1)  # indices of the drawn states
    trace = q[choose_frames(t, q)]
    canvas = fit_canvas(mechanism, q)
    files = (vl_convert.svg_to_png(draw_at(mechanism, q[k], trace, canvas), scale=1.0, ppi=72) for k in shown)
    pictures = [Image.open(io.BytesIO(png_file)).convert("RGB") for png_file in files]
    # all pictures share the palette of the first, so that the file is small and colours do not flicker
    palette = pictures[0].quantize(128)
    frames = [picture.quantize(palette=palette, dither=Image.Dither.NONE) for picture in pictures]
    # [s] duration of a picture: an equal part of the film, but at least 1 / RATE. If the number of pictures was limited to MOST,
    # each lasts 1 / RATE, and the film is faster than the motion
    seconds = max(float(t[-1] - t[0]) * slower / count, 1 / RATE) if count < MOST else 1 / RATE
    buffer = io.BytesIO()
    frames[0].save(buffer, "GIF", save_all=True, append_images=frames[1:], duration=round(1000 * seconds), loop=0, optimize=True)
    return buffer.getvalue()


def _write_page(caption: Caption, history: History, moving: str, t: Array) -> str:
    """Return an HTML page with the moving linkage, its curves, and a line that marks the current time in them.

    Args:
        t: times of the states of the moving linkage (k,) [s].
    """
    duration = float(t[-1] - t[0])
    return (
        make_environment("gauss_bench.report")
        .get_template("run.html")
        .render(
            caption=caption,
            film=inline(moving, "film"),
            curves=inline(svg(plot(history, caption, head=False)), "curves"),
            left=100 * LEFT / WIDTH,  # [%] left end of the time axis, and its width
            wide=100 * (WIDTH - LEFT - RIGHT) / WIDTH,
            until=float(t[-1]),
            share=duration / (caption.until - float(t[0]) or 1.0),  # share of the time axis that the film covers
            length=max(SHORTEST, duration),  # [s] of the film
        )
    )
