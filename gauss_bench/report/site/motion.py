"""A linkage to turn by hand, and two engines' runs of it played side by side.

Links are drawn once, in their own frames; the page carries them through the states of a turn of the crank, which this project's own
kinematics solves. A run is played from its stored errors of the crank's angle: its crank stands at the true angle plus that error,
magnified, and the rest of the linkage follows from the loops, so that a difference of a thousandth of a degree can be seen.
"""

from collections.abc import Sequence
from typing import Any
from xml.sax.saxutils import escape

import numpy as np
from markupsafe import Markup

from gauss_bench.mechanism.errors import LinkageError
from gauss_bench.mechanism.load import load
from gauss_bench.mechanism.model import GROUND, Mechanism, Revolute
from gauss_bench.reference.certificate import CertificateError, certificate_path, check_holds, read_certificate
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
from gauss_bench.report.linkages import posed_in
from gauss_bench.report.palette import inline
from gauss_bench.report.rows import Row, Run, grouped, known, number, ok
from gauss_bench.terms import Array

STEP = 1e-3  # [s] of the runs that are played
PLAYED = 10  # runs to choose from
MAGNIFIED = (1, 10, 100, 1_000, 10_000, 100_000, 1_000_000)


class Film:
    """What `slide_parts` asks of a film: the states."""

    timing = ""

    def __init__(self, states: Array) -> None:
        self.states = states


def turned(run: Run, name: str) -> tuple[Mechanism, Array] | None:
    """A linkage and the states of a turn of its crank; None without a file, or where it does not come round."""
    try:
        mechanism, _, trace = posed_in(run, name, 0.0)
        if trace is None:
            mechanism, _, trace = posed_in(run, name)
    except LinkageError:
        return None
    if trace is None or mechanism.crank is None or mechanism.crank < 0:
        return None
    turn = trace[-1, 3 * mechanism.crank + 2] - trace[0, 3 * mechanism.crank + 2]
    return (mechanism, trace) if abs(abs(turn) - 2 * np.pi) < 1e-6 else None


def drawn(run: Run, name: str) -> tuple[Markup, dict[str, Any]] | None:
    """A linkage's SVG whose parts carry numbers, and where every part is in each state [px, degrees]."""
    found = turned(run, name)
    if found is None:
        return None
    mechanism, states = found
    assert mechanism.crank is not None
    states = states.copy()
    states[:, 2::3] = np.unwrap(states[:, 2::3], axis=0)
    rails = [end for joint in slides(mechanism) if joint.guide.link != GROUND for end in rail(joint, states, 0.0)]
    canvas = fit(mechanism, states, (*mechanism.observed_points, *rails))
    text = svg_of(mechanism, states, canvas)
    poses = []
    for i in range(len(mechanism.links)):
        where, angle = canvas.at(states[:, 3 * i : 3 * i + 2]), -np.degrees(states[:, 3 * i + 2])
        poses.append([[round(float(v), 2) for v in (x, y, a)] for (x, y), a in zip(where, angle, strict=True)])
    first = float(states[0, 3 * mechanism.crank + 2])
    sense = float(np.sign(states[-1, 3 * mechanism.crank + 2] - first))
    return Markup(inline(text, name.replace("_", "-"))), {"poses": poses, "first": round(first, 9), "sense": sense}


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
        shapes += carried(mechanism, pin.link, pin.local, states, canvas, [pin_shape(0, 0)])
    for point in mechanism.observed_points:
        shapes += carried(mechanism, point.link, point.local, states, canvas, [dot_shape(0, 0, False)])
    size = f'viewBox="0 0 {canvas.width:g} {canvas.height:g}"'
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" {size} role="img" aria-label="{escape(mechanism.name)}">{"".join(shapes)}</svg>'
    )


def carried(mechanism: Mechanism, link: int, local: Array, states: Array, canvas: Canvas, shapes: Sequence[str]) -> list[str]:
    """Shapes at a point of a link, which moves but does not turn with it."""
    if link == GROUND:
        x, y = canvas.at(np.asarray(local))
        return [f'<g transform="translate({x:.2f} {y:.2f})">', *shapes, "</g>"]
    x, y = canvas.offset(np.asarray(local))
    return [f'<g data-link="{link}" data-x="{x:.2f}" data-y="{y:.2f}">', *shapes, "</g>"]


def turning(run: Run, name: str, title: str) -> tuple[Markup, dict[str, Any]] | None:
    """The player with a slider for the crank's angle."""
    found = drawn(run, name)
    if found is None:
        return None
    svg, data = found
    text = Markup(
        '<section class="player" id="turn" aria-label="Turn the crank"><div class="stage"><div class="pair">{}</div></div>'
        '<div class="controls"><button type="button" data-play>Play</button>'
        '<input type="range" min="0" max="360" step="1" value="60" aria-label="Crank angle of {} in degrees">'
        "<output>60°</output></div></section>"
    ).format(svg, title)
    return text, data


def played_runs(run: Run, name: str) -> list[tuple[str, list[Row]]]:
    """Label and series of cases at STEP, the plainest of each engine first."""
    cases = {_case(r): r for r in run.of(name) if ok(r) and not r["control"]}
    found = []
    for key, rows in grouped((r for r in run.table("series") if r["mechanism"] == name), _case).items():
        row = cases.get(key)
        if row is not None and abs(number(row, "step") - STEP) < 1e-9 and all(known(r["measured_error"]) for r in rows):
            said = " ".join(
                str(row[k]) for k in ("settings", "integrator", "stabilization") if row[k] not in ("", "default", "none")
            )
            found.append((f"{row['engine']} {said}".strip(), str(row["engine"]), sorted(rows, key=lambda r: number(r, "t"))))
    found.sort(key=lambda x: (len(x[0].split()), x[0]))
    first = {engine: (label, rows) for label, engine, rows in reversed(found)}
    rest = [(label, rows) for label, engine, rows in found if first[engine][0] != label]
    return [*sorted(first.values(), key=lambda x: x[0]), *rest][:PLAYED]


def _case(row: Row) -> tuple[Any, ...]:
    return tuple(row[k] for k in ("mechanism", "scenario", "engine", "settings", "integrator", "stabilization", "step"))


def truth_of(name: str, scenario: str, times: Array) -> Array | None:
    """The true angle of the crank [rad] at times [s], from the certificate that comes with the suite."""
    try:
        mechanism = load(name, scenario)
        path = certificate_path(mechanism)
        if path is None or not path.exists() or mechanism.crank is None:
            return None
        certificate = read_certificate(path)
        check_holds(certificate, mechanism, path)
    except (LinkageError, CertificateError):
        return None
    if certificate.t[-1] < times[-1] - 1e-9:
        return None
    return np.interp(times, certificate.t, np.unwrap(certificate.q[:, 3 * mechanism.crank + 2]))


def side_by_side(run: Run, name: str, scenario: str, svg: Markup) -> tuple[Markup, dict[str, Any]] | None:
    """The player of two runs, whose errors are magnified."""
    runs = played_runs(run, name)
    if len(runs) < 2 or str(runs[0][1][0].get("scenario", "")) != scenario:
        return None
    times = np.array([number(r, "t") for r in runs[0][1]])
    truth = truth_of(name, scenario, times)
    if truth is None or len(times) < 2:
        return None
    labels = [label for label, _ in runs]
    a = next((i for i, x in enumerate(labels) if x.startswith("gauss-native")), 0)
    b = next((i for i, x in enumerate(labels) if x.startswith("mujoco")), 1 if a == 0 else 0)

    def choice(which: str, chosen: int) -> Markup:
        options = Markup("").join(
            Markup('<option value="{}"{}>{}</option>').format(i, Markup(" selected") if i == chosen else "", x)
            for i, x in enumerate(labels)
        )
        return Markup('<label>{} <select data-run="{}">{}</select></label>').format(
            "Left" if which == "a" else "Right", which, options
        )

    factors = Markup("").join(
        Markup('<option value="{}"{}>{} times</option>').format(x, Markup(" selected") if x == 10 else "", f"{x:,}")
        for x in MAGNIFIED
    )
    twice = [
        Markup('<div class="pair" data-side="{}">{}<p></p></div>').format(x, Markup(str(svg).replace('id="', f'id="{x}-')))
        for x in "ab"
    ]
    text = Markup(
        '<section class="player" id="pair" aria-label="Two engines side by side">'
        '<div class="stage">{}{}</div><div class="controls">{}{}'
        "<label>Difference <select data-factor>{}</select></label></div>"
        '<div class="controls"><button type="button" data-play>Play</button>'
        '<input type="range" min="0" max="{}" step="1" value="{}" aria-label="Time"><output></output></div></section>'
    ).format(*twice, choice("a", a), choice("b", b), factors, len(times) - 1, len(times) - 1)
    data = {
        "times": [round(float(t), 6) for t in times],
        "truth": [round(float(x), 9) for x in truth],
        "runs": [{"name": label, "error": [float(f"{number(r, 'measured_error'):.4g}") for r in rows]} for label, rows in runs],
    }
    return text, data
