"""Two engines' runs of a linkage played side by side, their differences from the true motion magnified.

A run is drawn from its own stored poses (tables `motions` and `poses`): a link stands at truth + ahead + gap. Both differences are
magnified, each in its way: `ahead`, which leaves all loops closed, along the motion of the linkage, so that a late crank is drawn
later with all that hangs on it; `gap` in a straight line, so that loops are drawn open as far as they are, times the factor, and
nowhere else. At a factor of one a link is drawn where the run has it.

Where the crank comes round, the page follows the turn that it has anyway: with c the true angle of the crank, a what the run's
is ahead and f the factor,

    pose(f) = turn(c + f a) + rest + f gap,    rest = truth + ahead - turn(c + a),

the rest being nothing but for a run that has gone over to another assembly. Without such a turn: pose(f) = truth + f (ahead + gap).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from gauss_bench.linkage.errors import LinkageError
from gauss_bench.linkage.load import load_document
from gauss_bench.mechanism.model import Mechanism
from gauss_bench.report.content import short
from gauss_bench.report.drawings.canvas import Canvas
from gauss_bench.report.drawings.drawing import canvas_of
from gauss_bench.report.drawings.pose import crank_angles, unwrap_angles
from gauss_bench.report.linkages import document_in
from gauss_bench.report.palette import inline
from gauss_bench.report.rows import KEYS, Row, Run, group_rows, number
from gauss_bench.report.site.motion import in_pixels, svg_of, turn_frames
from gauss_bench.terms import Array

MAGNIFIED = (1, 10, 100, 1_000, 10_000, 100_000, 1_000_000)
SEEN = 0.1  # [px, degrees] below it a run stays in the assembly that the turn goes through
REACH = 60.0  # [px] that the furthest link is drawn off the true motion at first, at most
DIGITS = 3  # of a difference


@dataclass(frozen=True, eq=False)
class Played:
    """A stored run.

    Attributes:
        engine, label: and its setting in words; plain: whether that is its default.
        ahead, gap: (frames, links, 3) [m, m, rad]; fewer frames where the run ended early.
    """

    engine: str
    label: str
    plain: bool
    ahead: Array
    gap: Array

    @property
    def off(self) -> Array:
        """(frames,) how far the furthest link is off the true motion [m]."""
        return _furthest(self.ahead + self.gap)

    @property
    def open(self) -> Array:
        """(frames,) how far the furthest link is off where its loops are closed [m]."""
        return _furthest(self.gap)


def _furthest(x: Array) -> Array:
    return np.asarray(np.hypot(x[..., 0], x[..., 1]).max(axis=-1))


def truth_of(run: Run, name: str, scenario: str, links: Sequence[str]) -> tuple[Array, Array] | None:
    """Times (k,) and the true states (k, n) at them; None where they are not stored."""
    rows = [r for r in run.table("motions") if (r["mechanism"], r["scenario"]) == (name, scenario)]
    times = sorted({number(r, "t") for r in rows})
    at = {(number(r, "t"), str(r["link"])): r for r in rows}
    if len(times) < 2 or any((t, link) not in at for t in times for link in links):
        return None
    states = _fill(at, times, links, "")
    return np.array(times), unwrap_angles(states.reshape(len(times), -1))


def _fill(at: dict[tuple[float, str], Row], times: Sequence[float], links: Sequence[str], part: str) -> Array:
    return np.array([[[number(at[t, link], f"{axis}{part}") for axis in ("x", "y", "angle")] for link in links] for t in times])


def play_runs(run: Run, name: str, scenario: str, links: Sequence[str], times: Array) -> list[Played]:
    """The stored runs that have poses, by engine, those with its default settings first."""
    cases = {tuple(r[k] for k in KEYS): r for r in run.of(name) if r["scenario"] == scenario}
    rows = [r for r in run.table("poses") if (r["mechanism"], r["scenario"]) == (name, scenario)]
    played = []
    for key, own in group_rows(rows, lambda r: tuple(r[k] for k in KEYS)).items():
        at = {(number(r, "t"), str(r["link"])): r for r in own}
        reached = [t for t in times.tolist() if all((t, link) in at for link in links)]
        if not reached or key not in cases:
            continue
        row = cases[key]
        parts = (_fill(at, reached, links, part) for part in ("_ahead", "_gap"))
        played.append(Played(str(row["engine"]), label_of(row), row["settings"] == "default", *parts))
    return sorted(played, key=lambda x: (x.engine, not x.plain, x.label))


def label_of(row: Row) -> str:
    """Engine and setting in words, and whether the run may be used."""
    said = " ".join(str(row[k]) for k in ("settings", "integrator", "stabilization") if row[k] not in ("", "default", "none"))
    return f"{row['engine']} {said}".strip() + ("" if row["status"] == "ok" else " (not valid)")


def side_by_side(run: Run, name: str, scenario: str) -> tuple[dict[str, Any], dict[str, Any]] | None:
    """The player of two stored runs and its data; None where fewer than two are stored."""
    motion = turn_frames(run, name)
    try:
        mechanism = motion[0] if motion else load_document(*_document(run, name, scenario))
    except LinkageError:
        return None
    links = [link.name for link in mechanism.links]
    truth = truth_of(run, name, scenario, links)
    if truth is None:
        return None
    times, states = truth
    runs = play_runs(run, name, scenario, links, times)
    if len(runs) < 2:
        return None
    drawn = motion[1] if motion else states
    canvas = canvas_of(mechanism, drawn)
    svg = inline(svg_of(mechanism, drawn, canvas), f"{name.replace('_', '-')}-pair")
    data: dict[str, Any] = {"times": [round(float(t), 6) for t in times]}
    if motion:
        turn = Turn(mechanism, drawn)
        data["crank"] = [round(float(x), 6) for x in crank_angles(mechanism, states)]
        data["runs"] = [_along(x, turn, states, canvas) for x in runs]
    else:
        data["poses"] = np.round(in_pixels(canvas, states), 2).swapaxes(0, 1).tolist()
        data["runs"] = [_straight(x, canvas) for x in runs]
    return stage(svg, runs, canvas.scale, len(times)), data


def _document(run: Run, name: str, scenario: str) -> tuple[dict[str, Any], str, str, str]:
    document, digest, path = document_in(run, name)
    return document, scenario, str(path), digest


@dataclass(frozen=True, eq=False)
class Turn:
    """States (k, n) of a turn of a crank, angles unwrapped."""

    mechanism: Mechanism
    states: Array

    def at(self, crank: Array) -> Array:
        """States (k, n) at angles (k,) [rad] of the crank; links that turn with it are at most a turn off."""
        own = crank_angles(self.mechanism, self.states)
        sense = np.sign(own[-1] - own[0])
        place = np.mod((crank - own[0]) * sense, 2 * np.pi)
        return np.stack([np.interp(place, (own - own[0]) * sense, column) for column in self.states.T], axis=-1)


def _along(x: Played, turn: Turn, truth: Array, canvas: Canvas) -> dict[str, Any]:
    """A run that the page carries along the turn."""
    ahead = x.ahead.reshape(len(x.ahead), -1)
    own = truth[: len(ahead)] + ahead
    rest = (own - turn.at(crank_angles(turn.mechanism, own))).reshape(x.ahead.shape)
    rest[..., 2] = (rest[..., 2] + np.pi) % (2 * np.pi) - np.pi
    shown = differences(canvas, rest)
    more: dict[str, Any] = {"rest": np.round(shown, 2).swapaxes(0, 1).tolist()} if np.abs(shown).max(initial=0.0) > SEEN else {}
    gap = differences(canvas, x.gap)
    if np.abs(gap).max(initial=0.0) * MAGNIFIED[-1] > SEEN:
        more["gap"] = _list(gap)
    return _describe(x) | {"ahead": [_short(a) for a in crank_angles(turn.mechanism, ahead)]} | more


def _straight(x: Played, canvas: Canvas) -> dict[str, Any]:
    """A run that the page carries in straight lines."""
    return _describe(x) | {"moved": _list(differences(canvas, x.ahead + x.gap))}


def _describe(x: Played) -> dict[str, Any]:
    """Describe a difference, in millimetres."""
    return {"name": x.label, "off": [_short(1e3 * y) for y in x.off], "open": [_short(1e3 * y) for y in x.open]}


def differences(canvas: Canvas, x: Array) -> Array:
    """Differences (k, links, 3) [m, m, rad] in [px, px, degrees], y down."""
    return np.concatenate((canvas.offset(x[..., :2]), -np.degrees(x[..., 2:])), axis=-1)


def _list(x: Array) -> list[Any]:
    """(k, links, 3) by link, DIGITS digits each."""
    return [[[_short(v) for v in frame] for frame in link] for link in x.swapaxes(0, 1)]


def _short(x: float) -> float:
    return short(x, DIGITS)


def stage(svg: str, runs: Sequence[Played], scale: float, frames: int) -> dict[str, Any]:
    """Two stages, who is on them, the factor and the time; at first as large a factor as leaves both runs on the stage."""
    a = next((i for i, x in enumerate(runs) if x.engine == "gauss-native"), 0)
    b = next((i for i, x in enumerate(runs) if x.engine == "mujoco"), 1 if a == 0 else 0)
    reach = scale * max(float(runs[i].off.max()) for i in (a, b))
    begun = max((x for x in MAGNIFIED if x * reach <= REACH), default=MAGNIFIED[0])
    labels = [*enumerate(x.label for x in runs)]
    return {"svg": svg, "labels": labels, "first": (a, b), "factors": MAGNIFIED, "begun": begun, "last": frames - 1}
