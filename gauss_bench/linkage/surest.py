"""Which coordinates a start should hold: those that say most of what the joints leave free where the linkage is.

For whoever writes a start into a file from a position: importers of models, and drawings.
"""

import numpy as np

from gauss_bench.linkage.closure import null_space
from gauss_bench.mechanism.coordinates import gradient
from gauss_bench.mechanism.model import GROUND, Along, Angle, Mechanism, Point, Prismatic
from gauss_bench.terms import Array

CLEAR = 0.3  # of the most that any coordinate says: the first of several that are nearly as good is what a reader expects
HELD = {"angle": ("angles", "speeds"), "slide": ("slides", "slide_speeds"), "point": ("points", "point_velocities")}  # of a start
Candidate = tuple[str, str, list[Angle | Along]]


def candidates(mechanism: Mechanism, q: Array) -> list[Candidate]:
    """List the coordinates that a start may hold: links' angles, ways along slides, and points of links."""
    world = Point(GROUND, np.zeros(2), "ground.")
    candidates: list[Candidate] = [("angle", link.name, [Angle(GROUND, k)]) for k, link in enumerate(mechanism.links)]
    candidates += [("slide", j.name, [j.motion]) for j in mechanism.joints if isinstance(j, Prismatic)]
    for k, link in enumerate(mechanism.links):
        point = mechanism.point(k, next(iter(link.points)))
        candidates.append(("point", point.name, [Along(world, point, 0.0), Along(world, point, 0.0, across=True)]))
    return candidates


def surest(offered: list[Candidate], q: Array, free: Array) -> list[Candidate]:
    """Candidates that together fix the free directions (n, dof) at q.

    Each is the first that says at least CLEAR as much of what is still free as any other does.
    """
    rows = [np.array([gradient(x, q) for x in coordinates]) @ free for _, _, coordinates in offered]
    left, chosen = np.eye(free.shape[1]), list[Candidate]()  # columns: an orthonormal basis of what is still free
    while left.shape[1]:
        said = [float(np.linalg.norm(x @ left, 2)) for x in rows]
        k = next(k for k, x in enumerate(said) if x >= CLEAR * max(said))
        chosen.append(offered[k])
        left = left @ null_space(rows[k] @ left, left.shape[1])
    return chosen
