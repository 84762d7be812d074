"""Motion of the links of a file, where several of them are welded into one body."""

import numpy as np

from gauss_bench.mechanism.coordinates import acceleration, position, velocity
from gauss_bench.mechanism.model import Mechanism, Point
from gauss_bench.mechanism.spaces import PLANE, angle_at, angles, places
from gauss_bench.trajectory import Trajectory


def spread(mechanism: Mechanism, motion: Trajectory) -> Trajectory:
    """States (k, n) of the bodies as those of the links of the file, each by its own centre of mass."""
    if not mechanism.parts:
        return motion
    q, v, a = (np.empty((len(motion.t), PLANE.size * len(mechanism.parts))) for _ in range(3))
    for k, part in enumerate(mechanism.parts):
        centre = Point(part.body, part.at, part.name)
        places(q)[:, k], angles(q)[:, k] = position(motion.q, centre), angle_at(motion.q, part.body) + part.turn
        places(v)[:, k], angles(v)[:, k] = velocity(motion.q, motion.v, centre), angle_at(motion.v, part.body)
        places(a)[:, k], angles(a)[:, k] = acceleration(motion.q, motion.v, motion.a, centre), angle_at(motion.a, part.body)
    return Trajectory(motion.t, q, v, a, motion.steps)
