"""The two pictures of README as SVG files: the motion of one linkage by two engines, and the errors of all engines against time.

Both pictures are made from stored rows alone, follow the reader's dark mode, and are reproducible byte for byte. `make publish` and
`make field` run `python -m gauss_bench.report.pictures REPORTS README.md`, which writes both and README's first table.
"""

import math
import re
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any
from xml.sax.saxutils import escape

import numpy as np
import vl_convert
from scipy.interpolate import PchipInterpolator

from gauss_bench.atomic import write_text
from gauss_bench.mechanism.coordinates import position
from gauss_bench.mechanism.model import GROUND, Mechanism
from gauss_bench.report.drawings.animation import STYLE, Film, make_film
from gauss_bench.report.drawings.canvas import Canvas, make_part
from gauss_bench.report.drawings.drawing import PIN, canvas_of, link_part, linkage_parts
from gauss_bench.report.drawings.pose import crank_angles, pose_in
from gauss_bench.report.first_table import FIRST, group_by_loop, mark_own, renew
from gauss_bench.report.palette import DARK, INK, MUTED, PAPER, VARIABLES, declare, declare_hues, inline
from gauss_bench.report.rows import Run
from gauss_bench.report.site.charts import GRAMMAR, VEGA_LITE, specify_points
from gauss_bench.report.site.linkage import pareto_front
from gauss_bench.report.site.playback import StoredRun, Turn, find_turn, read_reference, read_runs
from gauss_bench.report.site.settings import Setting, all_settings, cheapest
from gauss_bench.report.words import itemise, length_text
from gauss_bench.terms import Array

FOLDER = "reports/pictures"  # path relative to README
LINKAGE, SCENARIO = "four_bar", "torque"
PLAYED = ("gauss-native rk4", "mujoco rk4 (not valid)")  # labels of the left and the right run, both at a step of 1 ms
NAMES = ("gauss-native", "MuJoCo, loops as shipped")  # their names in the picture
END = 1.0  # [s] end of the drawn motion
MAGNIFICATION = 100.0  # of loop openings, the same in both runs
SPACING = math.radians(8)  # turn of the crank between two drawn poses
OPEN = 1.0  # [px] a joint is drawn open if its ends are farther apart
RED = "#c62828"
GAP, TOP, LINE, TEXTS = 20.0, 20.0, 26.0, 78.0  # [px] gap between both halves, space above, line height, height of texts
COARSEST = 1e-2  # [m] larger errors are not drawn: the linkage is half a metre long
# [px] wider on the right, so that the legend also fits in fonts that are wider than the one in which it was measured
PADDING = {"left": 16, "top": 16, "right": 52, "bottom": 16}
LOOK = {"font": "Arial, sans-serif", "legend": {"title": None, "labelColor": "var(--ink)", "labelFontSize": 13, "labelLimit": 260}}


def motion_picture(run: Run) -> str:
    """Return the SVG of the runs PLAYED side by side, with loop openings magnified MAGNIFICATION times."""
    turn = find_turn(run, LINKAGE)
    assert turn is not None, f"the crank of {LINKAGE} does not turn fully"
    mechanism = turn.mechanism
    links = [link.name for link in mechanism.links]
    motion = read_reference(run, LINKAGE, SCENARIO, links)
    assert motion is not None, "no reference motion is stored"
    times, reference = motion  # (l,) [s] and (l, n)
    by_label = {x.label: x for x in read_runs(run, LINKAGE, SCENARIO, links)}
    played = [by_label[label] for label in PLAYED]
    t = spread_times(times, crank_angles(mechanism, reference))
    motions = [magnify_openings(x, turn, times, reference, t) for x in played]  # (k, n) each
    canvas = canvas_of(mechanism, np.vstack([turn.states, *motions]))
    _, pose, _ = pose_in(run, LINKAGE)
    still = [*linkage_parts(mechanism, pose[None], None, canvas, forces=False)]
    parts = []
    for i, (stored, name, states) in enumerate(zip(played, NAMES, motions, strict=True)):
        opening = f"a joint opens by {length_text(largest_gap(mechanism, stored, reference, times))} at most"
        film, slower = make_film(t, states, canvas)  # both films are equally slow, since they have the same times
        parts += [
            f'<g transform="translate({i * (canvas.width + GAP):.0f} {TOP:.0f})">',
            # the ground symbols and the guides on the ground
            *(part.draw() for part in still if part.link == GROUND and part.local is None),
            '<g class="motion-film">',
            *film_parts(mechanism, film, canvas),
            '</g><g class="motion-still" display="none">',
            *(part.draw() for part in still if part.title),  # links: only these have a title
            "</g>",
            draw_text(canvas.width / 2, canvas.height, name, INK, 21),
            draw_text(canvas.width / 2, canvas.height + LINE, opening, MUTED, 18),
            "</g>",
        ]
    caption = f"openings drawn {MAGNIFICATION:g} times as wide, time {slower:g} times as slow"
    width, height = 2 * canvas.width + GAP, canvas.height + TOP + TEXTS
    parts.append(draw_text(width / 2, height - 14, caption, MUTED, 16))
    runs = itemise(f"{x.label} at a step of 1 ms" for x in played)
    title = f"The four-bar of this suite, the same start and torque, in two engines: {runs}; rows of the table poses"
    return write_svg(title, width, height, parts, STYLE)


def spread_times(times: Array, crank: Array) -> Array:
    """Return times from 0 to END [s] between which the crank turns by equal angles of at most SPACING.

    Args:
        times, crank: (k,) times [s] and angles of the crank at them [rad].
    """
    crank_at: Any = PchipInterpolator(times, crank)
    fine = np.linspace(0.0, END, 2001)  # [s]
    # the travelled angle never falls, even if the crank swings back: so time can be interpolated at equal parts of this angle
    travelled = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(crank_at(fine))))])  # (2001,) [rad]
    return np.interp(np.linspace(0.0, travelled[-1], 1 + math.ceil(travelled[-1] / SPACING)), travelled, fine)


def magnify_openings(run: StoredRun, turn: Turn, times: Array, reference: Array, t: Array) -> Array:
    """Return the states (k, n) of a run at times t (k,) [s], with the openings of its joints magnified MAGNIFICATION times.

    The stored difference of the run from the reference is the sum `run.ahead + run.gap`. Adding `run.ahead` to the reference keeps
    all loops closed, as when the crank is merely ahead of the reference; `run.gap` opens the loops. Only `gap` is magnified here.

    Args:
        times, reference: (l,) times of the stored poses [s], and reference states (l, n) at these times.
    """
    ahead, gap = (x.reshape(len(times), -1) for x in (run.ahead, run.gap))  # (l, n) each
    crank = PchipInterpolator(times, crank_angles(turn.mechanism, reference + ahead))(t)
    states = turn.at(crank)
    # add the whole turns that `turn` leaves out; the other links only swing
    angle = crank_angles(turn.mechanism, states)  # a view: `+=` changes the states
    angle += 2 * np.pi * np.round((crank - angle) / (2 * np.pi))
    return np.asarray(states + MAGNIFICATION * PchipInterpolator(times, gap, axis=0)(t))


def largest_gap(mechanism: Mechanism, run: StoredRun, reference: Array, times: Array) -> float:
    """Return the largest distance [m] between the two ends of a joint, over the stored poses of a run up to END.

    Args:
        reference, times: states (l, n) of the reference, and their times (l,) [s].
    """
    shown = times <= END
    # states of the reference, without and with the difference `run.gap`, which opens joints
    closed, opened = reference[shown], (reference + run.gap.reshape(len(reference), -1))[shown]
    gaps = []
    for joint in mechanism.joints:
        a, b = joint.ends
        # the reference is stored with few digits, which opens its joints a little: subtract these openings
        apart = (position(opened, a) - position(opened, b)) - (position(closed, a) - position(closed, b))
        gaps.append(float(np.hypot(*apart.T).max()))
    return max(gaps)


def film_parts(mechanism: Mechanism, film: Film, canvas: Canvas) -> Iterator[str]:
    """Yield the SVG of the moving links and joints; an open joint has both ends and a red line between them."""
    yield from (film.draw(link_part(mechanism, i, film.states, canvas)) for i in range(len(mechanism.links)))
    for joint in mechanism.joints:
        a, b = (canvas.at(position(film.states, end)) for end in joint.ends)  # (f, 2) pixels each
        ends = [a]
        if np.abs(a - b).max() > OPEN:
            ends.append(b)
            moved = ""
            for name, values in zip(("x1", "y1", "x2", "y2"), (*a.T, *b.T), strict=True):  # values (f,) [px]
                track = ";".join(f"{x:.1f}" for x in values)
                moved += f'<animate attributeName="{name}" values="{track}" {film.timing}/>'
            yield f'<line stroke="{RED}" stroke-width="5" stroke-linecap="round">{moved}</line>'
        yield from (film.draw(make_part([PIN], end)) for end in ends)


def cost_picture(run: Run) -> str:
    """Return the SVG figure of error against processor time of every engine on LINKAGE."""
    fronts = pareto_fronts(run)
    rows: list[dict[str, Any]] = []
    for loop, settings in fronts.items():
        rows += [{"engine": mark_own(run, loop), "line": loop, "x": x.seconds, "y": x.position} for x in settings]
    until = max(x.until for settings in fronts.values() for x in settings)
    axes = f"processor time of {until:g} s of motion [s]", "largest error of any link [m]"
    spec = specify_points(rows, *axes, height=430, engines=[mark_own(run, loop) for loop in fronts])
    spec |= {"data": {"values": rows}, "width": 900, "padding": PADDING, "config": GRAMMAR["config"] | LOOK}
    drawn = vl_convert.vegalite_to_svg(spec, vl_version=VEGA_LITE)
    width, height = (float(x) for x in re.findall(r'(?:width|height)="([\d.]+)"', drawn)[:2])
    inside = drawn[drawn.index(">") + 1 : drawn.rindex("</svg>")]  # content of its <svg> element
    title = (
        "Error against time on the four-bar: the settings of each engine that none of its others beats in both; "
        f"{len(rows)} settings of {len(fronts)} engines"
    )
    return write_svg(title, width, height, [inside], "")


def pareto_fronts(run: Run) -> dict[str, list[Setting]]:
    """Return name of an engine (`loop_of`) -> its Pareto-optimal settings on LINKAGE with errors of at most COARSEST [m].

    Engines are sorted by the least time of their settings with an error of at most FIRST [m].
    """
    settings = group_by_loop(x for x in all_settings(run)[LINKAGE] if 0 < x.position <= COARSEST)
    fronts = {loop: pareto_front(group, lambda x: x.seconds, lambda x: x.position) for loop, group in settings.items()}

    def sort_key(loop: str) -> tuple[float, str]:
        """Return the least time of an engine within FIRST (infinity if none), and its name."""
        within = cheapest(fronts[loop], FIRST).values()
        return min((x.seconds for x in within), default=math.inf), loop

    return {loop: fronts[loop] for loop in sorted(fronts, key=sort_key) if fronts[loop]}


def draw_text(x: float, y: float, text: str, colour: str, size: int) -> str:
    """Return the SVG of a line of text whose middle is at x, y [px]; `size` is the size of its letters [px]."""
    return f'<text x="{x:.1f}" y="{y:.1f}" text-anchor="middle" font-size="{size}" fill="{colour}">{escape(text)}</text>'


def write_svg(title: str, width: float, height: float, parts: Sequence[str], style: str) -> str:
    """Return an SVG file whose colours follow the reader's choice of light or dark; `style` has further CSS rules."""
    light = declare({name: colour for colour, name in VARIABLES.items()}) + declare_hues(dark=False)
    dark = declare(DARK) + declare_hues(dark=True)
    size = f'viewBox="0 0 {width:.0f} {height:.0f}" width="{width:.0f}" height="{height:.0f}"'
    look = f"svg{{{light}}}@media (prefers-color-scheme:dark){{svg{{{dark}}}}}{style}"
    start = f'<svg xmlns="http://www.w3.org/2000/svg" {size} role="img" font-family="Helvetica, Arial, sans-serif">'
    paper = f'<rect width="100%" height="100%" rx="12" fill="{PAPER}"/>'
    drawn = "\n".join([f"{start}<title>{escape(title)}</title>", paper, *parts, "</svg>\n"])
    # `inline` replaces colours by CSS variables; the style that defines these variables is added later, so that its colours stay
    return inline(drawn, "picture").replace("<title>", f"<style>{look}</style><title>", 1)


def write_pictures(run: Run, folder: Path) -> list[Path]:
    """Write both pictures into a folder, and return their paths."""
    paths = [folder / "two_engines.svg", folder / "error_against_time.svg"]
    for path, text in zip(paths, (motion_picture(run), cost_picture(run)), strict=True):
        write_text(path, text)
    return paths


if __name__ == "__main__":
    from gauss_bench.report.build import read_run

    rows, page = map(Path, sys.argv[1:])
    stored = read_run(rows)
    write_text(page, renew(page.read_text(encoding="utf-8"), stored))
    write_pictures(stored, page.parent / FOLDER)
