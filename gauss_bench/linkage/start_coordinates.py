"""Choose the coordinates whose initial values a new linkage file (from an import or the studio) should prescribe."""

from dataclasses import dataclass

import numpy as np

from gauss_bench.linkage.closure import null_space
from gauss_bench.mechanism.coordinates import gradient
from gauss_bench.mechanism.model import GROUND, Along, Angle, Mechanism, Point
from gauss_bench.terms import Array

GOOD = 0.3  # smallest sensitivity of a chosen coordinate, as a share of the largest
TABLES = {"angle": ("angles", "speeds"), "slide": ("slides", "slide_speeds"), "point": ("points", "point_velocities")}


@dataclass(frozen=True)
class Candidate:
    """An angle of a link, a slide, or a point (x and y), whose coordinates the table `start` of a linkage file may prescribe.

    `kind` is a key of TABLES; `name` is the name of the link or joint, or "LINK.POINT".
    """

    kind: str
    name: str
    coordinates: list[Angle | Along]

    @property
    def tables(self) -> tuple[str, str]:
        """The names of the tables in `start` that hold the values and the rates of the coordinates."""
        return TABLES[self.kind]


def choose_held(mechanism: Mechanism, q: Array, free: Array) -> list[Candidate]:
    """Return coordinates that together determine q (n,), from all angles of links, slides, and the first point of every link.

    The columns of `free` (n, dof) are the motions that the joints leave free. Each choice is the first candidate whose sensitivity
    to the motions that are still free is at least GOOD times the largest.
    """
    world = Point(GROUND, np.zeros(2), "ground.")
    offered = [Candidate("angle", link.name, [Angle(GROUND, k)]) for k, link in enumerate(mechanism.links)]
    offered += [Candidate("slide", joint.name, [joint.motion]) for joint in mechanism.slides]
    for k, link in enumerate(mechanism.links):
        point = mechanism.point(k, next(iter(link.points)))
        offered.append(Candidate("point", point.name, [Along(world, point, 0.0), Along(world, point, 0.0, across=True)]))
    rows = [np.array([gradient(x, q) for x in candidate.coordinates]) @ free for candidate in offered]
    chosen: list[Candidate] = []
    remaining = np.eye(free.shape[1])  # columns: an orthonormal basis of the freedoms that no chosen candidate determines
    while remaining.shape[1]:
        # sensitivity: largest change of the candidate over unit motions in the remaining freedoms
        sensitivity = np.array([np.linalg.norm(x @ remaining, 2) for x in rows])
        k = int(np.argmax(sensitivity >= GOOD * sensitivity.max()))  # the first that is large enough
        chosen.append(offered[k])
        remaining = remaining @ null_space(rows[k] @ remaining, remaining.shape[1])
    return chosen
