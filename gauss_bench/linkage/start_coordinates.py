"""Choose the coordinates that a start should hold: those that best determine the position that the joints leave free.

The import of models and the studio write the start of a file with it.
"""

from dataclasses import dataclass

import numpy as np

from gauss_bench.linkage.closure import null_space
from gauss_bench.mechanism.coordinates import gradient
from gauss_bench.mechanism.model import GROUND, Along, Angle, Mechanism, Point
from gauss_bench.terms import Array

GOOD = 0.3  # the first coordinate is taken that has at least this share of the best one's sensitivity
TABLES = {"angle": ("angles", "speeds"), "slide": ("slides", "slide_speeds"), "point": ("points", "point_velocities")}


@dataclass(frozen=True)
class Candidate:
    """A coordinate that a start may hold: an "angle", a "slide" or a "point", which is x and y.

    Attributes:
        name: link, joint or LINK.POINT.
    """

    kind: str
    name: str
    coordinates: list[Angle | Along]

    @property
    def tables(self) -> tuple[str, str]:
        """The tables of `start` for its value and for its rate."""
        return TABLES[self.kind]


def candidates(mechanism: Mechanism) -> list[Candidate]:
    """List the coordinates that a start may hold: angles of links, slides, and one point of every link."""
    world = Point(GROUND, np.zeros(2), "ground.")
    candidates = [Candidate("angle", link.name, [Angle(GROUND, k)]) for k, link in enumerate(mechanism.links)]
    candidates += [Candidate("slide", joint.name, [joint.motion]) for joint in mechanism.slides]
    for k, link in enumerate(mechanism.links):
        point = mechanism.point(k, next(iter(link.points)))
        candidates.append(Candidate("point", point.name, [Along(world, point, 0.0), Along(world, point, 0.0, across=True)]))
    return candidates


def choose_held(mechanism: Mechanism, q: Array, free: Array) -> list[Candidate]:
    """Return candidates that together fix the free directions (n, dof) at q (n,).

    Each time the first candidate is taken whose sensitivity to the remaining freedoms is at least GOOD times the largest one.
    """
    offered = candidates(mechanism)
    rows = [np.array([gradient(x, q) for x in candidate.coordinates]) @ free for candidate in offered]
    chosen: list[Candidate] = []
    remaining = np.eye(free.shape[1])  # columns: an orthonormal basis of the freedoms that are not yet held
    while remaining.shape[1]:
        # sensitivity: largest change of the candidate over unit motions in the remaining freedoms
        sensitivity = [float(np.linalg.norm(x @ remaining, 2)) for x in rows]
        k = next(k for k, x in enumerate(sensitivity) if x >= GOOD * max(sensitivity))
        chosen.append(offered[k])
        remaining = remaining @ null_space(rows[k] @ remaining, remaining.shape[1])
    return chosen
