"""Puts the names of links and points into a drawing, each where it is farthest from lines and other names."""

from collections.abc import Callable, Sequence
from itertools import pairwise
from xml.sax.saxutils import escape

import numpy as np

from gauss_bench.mechanism.coordinates import position
from gauss_bench.mechanism.model import GROUND, Mechanism, Prismatic, Revolute
from gauss_bench.report.palette import INK, MUTED
from gauss_bench.terms import Array

LETTER = 6.6  # mean width of a letter at 13 px
FAR = 22.0  # [px] clearance beyond which a place is as good as any


Pixels = Callable[[Array], Array]


def lettering(mechanism: Mechanism, q: Array, at: Pixels, size: tuple[float, float], segments: Array) -> list[str]:
    """SVG texts of all names; `at` turns world positions into pixels, `segments` (k, 2, 2) are the lines to keep away from."""
    taken: list[Array] = []
    texts = []
    for name, where in _points(mechanism, q, at):
        turns = np.linspace(0, 2 * np.pi, 16, endpoint=False)
        places = [where + r * np.array([np.cos(a), -np.sin(a)]) for r in (16.0, 21.0) for a in turns]
        place = _best(places, name, segments, taken, size)
        texts.append(_text(name, place, INK, 'font-style="italic"'))
    for name, middles in _links(mechanism, q, at):
        place = _best(middles, name, segments, taken, size)
        texts.append(_text(name, place, MUTED, ""))
    return texts


def _text(name: str, place: Array, colour: str, style: str) -> str:
    x, y = place[0], place[1] + 4.5
    return f'<text x="{x:.1f}" y="{y:.1f}" text-anchor="middle" fill="{colour}" {style}>{escape(name)}</text>'.replace(" >", ">")


def obstacles(mechanism: Mechanism, q: Array, at: Pixels, guides: Sequence[Array]) -> Array:
    """(k, 2, 2) lines a name should keep away from: bars, feet, blocks and guides."""
    lines = []
    for a, b in guides:
        along = (b - a) / max(float(np.hypot(*(b - a))), 1e-9)
        right = np.array([-along[1], along[0]])
        lines += [[a + side * right, b + side * right] for side in (11, 17)]
    for i, link in enumerate(mechanism.links):
        where = {name: at(position(q, mechanism.point(i, name))) for name in link.points}
        names = list(where)
        lines += [[where[a], where[b]] for a, b in link.bars or list(zip(names, names[1:] or names, strict=False))]
    for joint in mechanism.joints:
        if isinstance(joint, Prismatic):
            x = at(position(q, joint.block))
            lines += [[x + np.array([-18, side]), x + np.array([18, side])] for side in (-14, 0, 14)]
        else:
            feet = [at(p.local) for p in (joint.a, joint.b) if p.link == GROUND]
            lines += [[x, x + np.array([dx, 26])] for x in feet for dx in (-14, 0, 14)]
    return np.array(lines, dtype=float)


def _points(mechanism: Mechanism, q: Array, at: Pixels) -> list[tuple[str, Array]]:
    """Names and pixels of joints and observed points, each place once."""
    named = [(j.joint, j.a if isinstance(j, Revolute) else j.block) for j in mechanism.joints]
    named += [(p.name.partition(".")[2], p) for p in mechanism.observed_points]
    once: dict[tuple[float, float], str] = {}
    for name, point in named:
        x, y = np.round(at(position(q, point)), 1)
        once.setdefault((float(x), float(y)), name)
    return [(name, np.array(where)) for where, name in once.items()]


def _links(mechanism: Mechanism, q: Array, at: Pixels) -> list[tuple[str, list[Array]]]:
    """Names of links and the pixels they could stand at: beside the middle of a bar, or around a block."""
    lettered = []
    for i, link in enumerate(mechanism.links):
        where = {name: at(position(q, mechanism.point(i, name))) for name in link.points}
        names = list(where)
        places: list[Array] = []
        for a, b in link.bars or list(pairwise(names)):
            along = (where[b] - where[a]) / max(float(np.hypot(*(where[b] - where[a]))), 1e-9)
            reach = 13 + 0.5 * LETTER * len(link.name) * abs(along[1])
            normal = np.array([-along[1], along[0]])
            for part in (0.5, 0.4, 0.6, 0.3, 0.7):
                middle = where[a] + part * (where[b] - where[a])
                places += [middle + side * (reach + more) * normal for side in (-1, 1) for more in (0, 6)]
        centre = np.mean(list(where.values()), axis=0)
        if len(names) > 2:
            places.append(centre)
        if not places:
            places = [centre + np.array([dx, dy]) for dy in (-26, 30) for dx in (0, 24, -24, 44, -44)]
        lettered.append((link.name, places))
    return lettered


def _best(places: Sequence[Array], name: str, segments: Array, taken: list[Array], size: tuple[float, float]) -> Array:
    """The place with most room for a name, and from then on taken; earlier places win a tie."""
    half = 0.5 * LETTER * len(name)
    spread = np.linspace(-half, half, max(3, len(name)))

    def room(place: Array) -> float:
        letters = place + np.stack([spread, np.zeros_like(spread)], axis=-1)
        inside = min(place[0] - half, size[0] - place[0] - half, place[1] - 8, size[1] - place[1] - 8)
        others = min((float(np.hypot(*(letters[:, None] - x[None]).T).min()) for x in taken), default=FAR)
        return float(min(distance(letters, segments), others - 6, inside, FAR))

    best = max(places, key=lambda place: round(room(place), 1))
    taken.append(best + np.stack([spread, np.zeros_like(spread)], axis=-1))
    return best


def distance(points: Array, segments: Array) -> float:
    """Shortest distance of points (k, 2) to segments (l, 2, 2)."""
    start, along = segments[:, 0], segments[:, 1] - segments[:, 0]
    square = np.maximum((along**2).sum(-1), 1e-12)
    part = np.clip(((points[:, None] - start) * along).sum(-1) / square, 0, 1)
    gap = points[:, None] - start - part[..., None] * along
    return float(np.hypot(gap[..., 0], gap[..., 1]).min())
