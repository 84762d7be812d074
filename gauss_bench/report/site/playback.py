"""Two engines' runs of a linkage, played side by side with magnified differences from the reference.

Tables `motions` and `poses` store the pose of a link in a run as truth + ahead + gap. `ahead` is the part of the difference that
leaves all loops closed; it is magnified along the motion of the linkage, so that a late crank is drawn later together with all
other links. `gap` is the rest, which opens loops; it is magnified in a straight line. At a factor of one, links are drawn where the
run has them.

If the crank can turn fully, the magnified pose is taken from the states of a turn. With the reference angle c of the crank, the
angle a by which the run is ahead, and the factor f,

    pose(f) = turn(c + f a) + rest + f gap,    rest = truth + ahead - turn(c + a),

where the rest is zero unless the run has changed to another assembly. Without a full turn, pose(f) = truth + f (ahead + gap).
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
SEEN = 0.1  # [px, degrees] smaller differences are not stored
REACH = 60.0  # [px] largest drawn difference from the reference with the initial factor
DIGITS = 3  # significant digits of a stored difference


@dataclass(frozen=True, eq=False)
class Played:
    """A stored run.

    Attributes:
        label: engine and setting in words; plain: whether the setting is the default.
        ahead, gap: (frames, links, 3) [m, m, rad]; a run that ended early has fewer frames.
    """

    engine: str
    label: str
    plain: bool
    ahead: Array
    gap: Array

    @property
    def off(self) -> Array:
        """Return the largest distance (frames,) of any link from the reference [m]."""
        return _furthest(self.ahead + self.gap)

    @property
    def open(self) -> Array:
        """Return the largest distance (frames,) of any link from its place with closed loops [m]."""
        return _furthest(self.gap)


def _furthest(x: Array) -> Array:
    return np.asarray(np.hypot(x[..., 0], x[..., 1]).max(axis=-1))


def truth_of(run: Run, name: str, scenario: str, links: Sequence[str]) -> tuple[Array, Array] | None:
    """Return times (k,) and reference states (k, n); None if they are not stored."""
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
    """Return the stored runs with poses, sorted by engine, default settings first."""
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
    """Return engine and setting in words, and a mark if the run is not valid."""
    said = " ".join(str(row[k]) for k in ("settings", "integrator", "stabilization") if row[k] not in ("", "default", "none"))
    return f"{row['engine']} {said}".strip() + ("" if row["status"] == "ok" else " (not valid)")


def side_by_side(run: Run, name: str, scenario: str) -> tuple[dict[str, Any], dict[str, Any]] | None:
    """Return the player of two stored runs and its data; None if fewer than two runs are stored."""
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
    """States (k, n) of a full turn of the crank, angles unwrapped."""

    mechanism: Mechanism
    states: Array

    def at(self, crank: Array) -> Array:
        """Return states (k, n) at crank angles (k,) [rad]; angles of links may be off by a whole turn."""
        own = crank_angles(self.mechanism, self.states)
        sense = np.sign(own[-1] - own[0])
        place = np.mod((crank - own[0]) * sense, 2 * np.pi)
        return np.stack([np.interp(place, (own - own[0]) * sense, column) for column in self.states.T], axis=-1)


def _along(x: Played, turn: Turn, truth: Array, canvas: Canvas) -> dict[str, Any]:
    """Return the data of a run that the page draws along the turn of the crank."""
    ahead = x.ahead.reshape(len(x.ahead), -1)
    own = truth[: len(ahead)] + ahead
    rest = (own - turn.at(crank_angles(turn.mechanism, own))).reshape(x.ahead.shape)
    # angles of the turn are known up to whole turns only
    rest[..., 2] = (rest[..., 2] + np.pi) % (2 * np.pi) - np.pi
    shown = differences(canvas, rest)
    more: dict[str, Any] = {"rest": np.round(shown, 2).swapaxes(0, 1).tolist()} if np.abs(shown).max(initial=0.0) > SEEN else {}
    gap = differences(canvas, x.gap)
    if np.abs(gap).max(initial=0.0) * MAGNIFIED[-1] > SEEN:
        more["gap"] = _list(gap)
    return _describe(x) | {"ahead": [_short(a) for a in crank_angles(turn.mechanism, ahead)]} | more


def _straight(x: Played, canvas: Canvas) -> dict[str, Any]:
    """Return the data of a run whose differences the page magnifies in straight lines."""
    return _describe(x) | {"moved": _list(differences(canvas, x.ahead + x.gap))}


def _describe(x: Played) -> dict[str, Any]:
    """Return name, error and loop opening of a run [mm]."""
    return {"name": x.label, "off": [_short(1e3 * y) for y in x.off], "open": [_short(1e3 * y) for y in x.open]}


def differences(canvas: Canvas, x: Array) -> Array:
    """Convert differences (k, links, 3) from [m, m, rad] to [px, px, degrees], y down."""
    return np.concatenate((canvas.offset(x[..., :2]), -np.degrees(x[..., 2:])), axis=-1)


def _list(x: Array) -> list[Any]:
    """Return an array (k, links, 3) as lists by link, each number with DIGITS digits."""
    return [[[_short(v) for v in frame] for frame in link] for link in x.swapaxes(0, 1)]


def _short(x: float) -> float:
    return short(x, DIGITS)


def stage(svg: str, runs: Sequence[Played], scale: float, frames: int) -> dict[str, Any]:
    """Return both stages: their runs, factors and times; the initial factor is the largest that keeps both runs in the picture."""
    a = next((i for i, x in enumerate(runs) if x.engine == "gauss-native"), 0)
    b = next((i for i, x in enumerate(runs) if x.engine == "mujoco"), 1 if a == 0 else 0)
    reach = scale * max(float(runs[i].off.max()) for i in (a, b))
    begun = max((x for x in MAGNIFIED if x * reach <= REACH), default=MAGNIFIED[0])
    labels = [*enumerate(x.label for x in runs)]
    return {"svg": svg, "labels": labels, "first": (a, b), "factors": MAGNIFIED, "begun": begun, "last": frames - 1}
