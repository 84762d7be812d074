"""Choose the coordinates that a start should hold: those that best determine the freedoms left by the joints at a position.

Importers of models and the studio use it to write a start into a file from a position.
"""

import numpy as np

from gauss_bench.linkage.closure import null_space
from gauss_bench.mechanism.coordinates import gradient
from gauss_bench.mechanism.model import GROUND, Along, Angle, Mechanism, Point, Prismatic
from gauss_bench.terms import Array

CLEAR = 0.3  # share of the best coordinate's sensitivity that is good enough: the first such coordinate is taken
HELD = {"angle": ("angles", "speeds"), "slide": ("slides", "slide_speeds"), "point": ("points", "point_velocities")}  # of a start
Candidate = tuple[str, str, list[Angle | Along]]


def candidates(mechanism: Mechanism, q: Array) -> list[Candidate]:
    """List the coordinates that a start may hold: angles of links, slides, and points of links."""
    world = Point(GROUND, np.zeros(2), "ground.")
    candidates: list[Candidate] = [("angle", link.name, [Angle(GROUND, k)]) for k, link in enumerate(mechanism.links)]
    candidates += [("slide", j.name, [j.motion]) for j in mechanism.joints if isinstance(j, Prismatic)]
    for k, link in enumerate(mechanism.links):
        point = mechanism.point(k, next(iter(link.points)))
        candidates.append(("point", point.name, [Along(world, point, 0.0), Along(world, point, 0.0, across=True)]))
    return candidates


def surest(offered: list[Candidate], q: Array, free: Array) -> list[Candidate]:
    """Return candidates that together fix the free directions (n, dof) at q (n,).

    Each one taken is the first whose sensitivity to the remaining freedoms is at least CLEAR times the largest.
    """
    rows = [np.array([gradient(x, q) for x in coordinates]) @ free for _, _, coordinates in offered]
    left, chosen = np.eye(free.shape[1]), list[Candidate]()  # columns: an orthonormal basis of what is still free
    while left.shape[1]:
        # sensitivity: largest change of the candidate over unit motions in the freedoms that are left
        sensitivity = [float(np.linalg.norm(x @ left, 2)) for x in rows]
        k = next(k for k, x in enumerate(sensitivity) if x >= CLEAR * max(sensitivity))
        chosen.append(offered[k])
        left = left @ null_space(rows[k] @ left, left.shape[1])
    return chosen
