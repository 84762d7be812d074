"""Play the runs of a linkage in two engines side by side, with magnified differences from the reference.

The tables `motions` and `poses` store the pose of a link in a run as reference + ahead + gap, where `reference` is the true pose at
the same time. `ahead` is the part of the difference that leaves all loops closed: the linkage is ahead of or behind the true
motion. `ahead` is magnified along the motion of the linkage, so that a crank that is late is drawn later, together with all other
links. `gap` is the rest of the difference, which opens loops; each coordinate of `gap` is multiplied by the factor of
magnification. With the factor one, links are drawn at their stored poses.

If the crank can turn fully, turn(c) is the state with closed loops at a crank angle c. Let c be the crank angle of the reference, a
the angle by which the crank of the run is ahead, and f the factor of magnification. The drawn pose is

    pose(f) = turn(c + f a) + rest + f gap,    rest = reference + ahead - turn(c + a),

where `rest` is zero unless the run has changed to another assembly. If the crank cannot turn fully, `ahead` and `gap` are
multiplied in the same way: pose(f) = reference + f (ahead + gap).
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any
from xml.sax.saxutils import escape

import numpy as np
from markupsafe import Markup

from gauss_bench.linkage.errors import LinkageError
from gauss_bench.linkage.load import load_document
from gauss_bench.mechanism.model import Mechanism
from gauss_bench.mechanism.spaces import DIMENSION, SIZE, angles, places
from gauss_bench.report.cases import setting_words
from gauss_bench.report.drawings.canvas import Canvas
from gauss_bench.report.drawings.drawing import canvas_of, draw_paths, linkage_parts
from gauss_bench.report.drawings.pose import crank_angles, document_in, pose_in, unwrap_angles
from gauss_bench.report.palette import inline
from gauss_bench.report.rows import KEYS, Row, Run, group_by, number
from gauss_bench.report.words import round_digits
from gauss_bench.terms import Array

MAGNIFIED = (1, 10, 100, 1_000, 10_000, 100_000, 1_000_000)  # factors that a reader can choose
VISIBLE = 0.1  # [px, degrees] differences that are drawn smaller than this are left out
REACH = 60.0  # [px] largest drawn difference from the reference with the initial factor
DIGITS = 3  # significant digits of a stored difference


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
    """Return a linkage's states over a full turn of its crank, from the angle 0 if possible; None without a full turn."""
    try:
        mechanism, _, trace = pose_in(run, name, 0.0)
        if trace is None:  # the linkage cannot start at 0 degrees: try the angle of the drawings
            mechanism, _, trace = pose_in(run, name)
    except LinkageError:
        return None
    # a negative index of the crank is the ground
    if trace is None or mechanism.crank is None or mechanism.crank < 0:
        return None
    turn = Turn(mechanism, unwrap_angles(trace))
    first, last = crank_angles(mechanism, turn.states)[[0, -1]]
    return turn if abs(abs(last - first) - 2 * np.pi) < 1e-6 else None


def draw_turn(run: Run, name: str) -> tuple[Markup, dict[str, Any]] | None:
    """Return the SVG of a linkage with numbered links, and the data with which a script turns the crank; None without a full turn.

    The data are the links' poses, the first crank angle [rad], and the sense of the turn, 1 or -1.
    """
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
    return np.concatenate((canvas.at(places(states)), -np.degrees(angles(states)[..., None])), axis=-1)


def list_frames(places: Array) -> list[Any]:
    """Return places (k, links, 3) [px, px, degrees] as a list for each link, rounded to 0.01."""
    return list(np.round(places, 2).swapaxes(0, 1).tolist())


def draw_numbered(mechanism: Mechanism, states: Array, canvas: Canvas) -> str:
    """Return the SVG of the first of states (k, n); each moving part has the number of its link."""
    parts = linkage_parts(mechanism, states, None, canvas, forces=False)
    shapes = draw_paths(mechanism.observed_points, states, canvas)
    for part in parts:
        # attributes with which a script moves a part: its link, and its place on the link if the part stays upright
        place = "" if part.local is None else ' data-x="{:.2f}" data-y="{:.2f}"'.format(*part.local)
        shapes.append(part.draw("" if part.link < 0 else f' data-link="{part.link}"{place}'))
    size = f'viewBox="0 0 {canvas.width:g} {canvas.height:g}"'
    start = f'<svg xmlns="http://www.w3.org/2000/svg" {size} role="img" aria-label="{escape(mechanism.name)}">'
    return f"{start}{''.join(shapes)}</svg>"


@dataclass(frozen=True, eq=False)
class StoredRun:
    """A run with stored poses.

    Attributes:
        label: engine and setting in words.
        ahead, gap: the part of the difference from the reference that leaves loops closed, and the part that opens them, both
            (frames, links, 3) [m, m, rad]; fewer frames if the run ended early.
    """

    engine: str
    label: str
    is_default: bool
    ahead: Array
    gap: Array


def _largest_shift(x: Array) -> Array:
    """Return the largest shift (frames,) [m] of any link, from differences (frames, links, 3) [m, m, rad]."""
    return np.asarray(np.hypot(x[..., 0], x[..., 1]).max(axis=-1))


def read_poses(rows: Iterable[Row], links: Sequence[str], *parts: str) -> tuple[Array, list[Array]]:
    """Return the times (k,) [s] at which every link has a row and, for each of `parts`, values (k, links, 3) [m, m, rad].

    Args:
        rows: rows of one run or of a reference motion, each with one link at one time.
        parts: endings of the columns "x", "y" and "angle": "_ahead" and "_gap" in the table `poses`, "" in the table `motions`.
    """
    stored = {(number(r, "t"), r["link"]): r for r in rows}
    stored_times = sorted({t for t, _ in stored})
    times = [t for t in stored_times if all((t, link) in stored for link in links)]
    shape = (len(times), len(links), SIZE)
    values = []
    for part in parts:
        columns = [f"{name}{part}" for name in ("x", "y", "angle")]
        values.append(np.reshape([number(stored[t, link], x) for t in times for link in links for x in columns], shape))
    return np.array(times), values


def read_reference(run: Run, name: str, scenario: str, links: Sequence[str]) -> tuple[Array, Array] | None:
    """Return times (k,) [s] and reference states (k, n) with continuous angles; None if fewer than two times are stored."""
    rows = (r for r in run.table("motions") if (r["mechanism"], r["scenario"]) == (name, scenario))
    times, (states,) = read_poses(rows, links, "")
    return (times, unwrap_angles(states.reshape(len(times), -1))) if len(times) > 1 else None


def read_runs(run: Run, name: str, scenario: str, links: Sequence[str]) -> list[StoredRun]:
    """Return the runs of a linkage with stored poses, sorted by engine, default settings first."""
    cases = {tuple(r[k] for k in KEYS): r for r in run.cases_of(name) if r["scenario"] == scenario}
    stored = []
    for key, rows in group_by(run.table("poses"), *KEYS).items():
        if row := cases.get(key):
            times, (ahead, gap) = read_poses(rows, links, "_ahead", "_gap")
            label = f"{row['engine']} {setting_words(row)}".strip() + ("" if row["status"] == "ok" else " (not valid)")
            if len(times):
                stored.append(StoredRun(row["engine"], label, row["settings"] == "default", ahead, gap))
    return sorted(stored, key=lambda x: (x.engine, not x.is_default, x.label))


def play_pair(run: Run, name: str, scenario: str) -> tuple[dict[str, Any], dict[str, Any]] | None:
    """Return the contents of the part of a page that plays two runs side by side, and the data for its script.

    The result is None if the linkage, its reference or two runs are missing.
    """
    turn = find_turn(run, name)
    try:
        if turn:
            mechanism = turn.mechanism
        else:
            document, digest, path = document_in(run, name)
            mechanism = load_document(document, scenario, str(path), digest)
    except LinkageError:
        return None
    links = [link.name for link in mechanism.links]
    reference = read_reference(run, name, scenario, links)
    runs = read_runs(run, name, scenario, links)
    if reference is None or len(runs) < 2:
        return None
    times, states = reference
    drawn_states = turn.states if turn else states
    canvas = canvas_of(mechanism, drawn_states)
    svg = inline(draw_numbered(mechanism, drawn_states, canvas), f"{name.replace('_', '-')}-pair")
    data: dict[str, Any] = {"times": np.round(times, 6).tolist()}
    if turn:
        data["crank"] = np.round(crank_angles(mechanism, states), 6).tolist()
        data["runs"] = [_run_along_turn(x, turn, states, canvas) for x in runs]
    else:
        data["poses"] = list_frames(in_pixels(canvas, states))
        # without a turn, differences are magnified in straight lines; the script reads them link by link
        shifts = [_round(shift_in_pixels(canvas, x.ahead + x.gap).swapaxes(0, 1)) for x in runs]
        data["runs"] = [_describe_run(x) | {"moved": shift} for x, shift in zip(runs, shifts, strict=True)]
    return make_stage(svg, runs, canvas.scale, len(times)), data


def _run_along_turn(x: StoredRun, turn: Turn, reference: Array, canvas: Canvas) -> dict[str, Any]:
    """Return the data of a run of a linkage whose crank can turn fully; `reference` (k, n) has the true states at all frames.

    The data are `ahead`, the angle by which the run's crank is ahead; `rest`, the difference that no crank angle explains (another
    assembly); and `gap`, the difference that opens loops. The last two are in [px, px, degrees], and left out if they cannot be
    seen: `gap` even at the largest magnification, `rest` at none, because it is not magnified.
    """
    ahead = x.ahead.reshape(len(x.ahead), -1)  # (frames, n)
    own = reference[: len(ahead)] + ahead
    # rest = reference + ahead - turn(c + a), with the crank angle c + a of the run
    rest = (own - turn.at(crank_angles(turn.mechanism, own))).reshape(x.ahead.shape)
    # angles of `turn` are known up to whole turns only: take the nearest ones
    rest[..., DIMENSION] = (rest[..., DIMENSION] + np.pi) % (2 * np.pi) - np.pi
    rest_in_pixels, gap = shift_in_pixels(canvas, rest), shift_in_pixels(canvas, x.gap)
    # the crank angle is one of the coordinates, so that differences of coordinates contain its difference
    data = _describe_run(x) | {"ahead": _round(crank_angles(turn.mechanism, ahead))}
    if np.abs(rest_in_pixels).max(initial=0.0) > VISIBLE:
        data["rest"] = list_frames(rest_in_pixels)
    if np.abs(gap).max(initial=0.0) * MAGNIFIED[-1] > VISIBLE:
        data["gap"] = _round(gap.swapaxes(0, 1))
    return data


def _describe_run(x: StoredRun) -> dict[str, Any]:
    """Return the name of a run and, at each frame, the largest error of a link (`off`) and loop opening (`open`) [mm]."""
    return {"name": x.label, "off": _round(1e3 * _largest_shift(x.ahead + x.gap)), "open": _round(1e3 * _largest_shift(x.gap))}


def shift_in_pixels(canvas: Canvas, x: Array) -> Array:
    """Convert differences (k, links, 3) from [m, m, rad] to [px, px, degrees] with y down."""
    return np.concatenate((canvas.offset(x[..., :DIMENSION]), -np.degrees(x[..., DIMENSION:])), axis=-1)


def _round(x: Array) -> list[Any]:
    """Return an array of any dimension as nested lists of numbers with DIGITS digits."""
    return [round_digits(float(v), DIGITS) if np.ndim(v) == 0 else _round(v) for v in x]


def make_stage(svg: str, runs: Sequence[StoredRun], scale: float, frames: int) -> dict[str, Any]:
    """Return the contents of the part of a page that plays two runs side by side (`scale` in px/m)."""
    # at first gauss-native is at the left, and MuJoCo at the right, if it has a run
    engines = [x.engine for x in runs]
    left = engines.index("gauss-native") if "gauss-native" in engines else 0
    other = 1 if left == 0 else 0
    right = engines.index("mujoco") if "mujoco" in engines else other
    shifts = [float(_largest_shift(runs[i].ahead + runs[i].gap).max()) for i in (left, right)]  # [m] of both runs
    farthest = scale * max(shifts)  # [px] at a factor of one
    initial = max((x for x in MAGNIFIED if x * farthest <= REACH), default=MAGNIFIED[0])
    labels = [*enumerate(x.label for x in runs)]
    return {"svg": svg, "labels": labels, "first": (left, right), "factors": MAGNIFIED, "begun": initial, "last": frames - 1}
