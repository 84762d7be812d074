"""Motion of the links of a file, where several of them are welded into one body."""

import numpy as np

from gauss_bench.mechanism.model import Mechanism
from gauss_bench.mechanism.spaces import slots
from gauss_bench.terms import Array
from gauss_bench.trajectory import Trajectory


def spread(mechanism: Mechanism, motion: Trajectory) -> Trajectory:
    """States (k, n) of the bodies as those of the links of the file, each by its own centre of mass."""
    if not mechanism.parts:
        return motion
    levels: tuple[list[Array], ...] = ([], [], [])
    for part in mechanism.parts:
        q, v, a = (x[..., slots(part.body)] for x in (motion.q, motion.v, motion.a))
        c, s = np.cos(q[..., 2]), np.sin(q[..., 2])
        x, y = c * part.at[0] - s * part.at[1], s * part.at[0] + c * part.at[1]
        w, alpha = v[..., 2], a[..., 2]
        levels[0].append(q + np.stack([x, y, np.full_like(x, part.turn)], axis=-1))
        levels[1].append(v + np.stack([-w * y, w * x, 0 * x], axis=-1))
        levels[2].append(a + np.stack([-alpha * y - w * w * x, alpha * x - w * w * y, 0 * x], axis=-1))
    q, v, a = (np.concatenate(level, axis=-1) for level in levels)
    return Trajectory(motion.t, q, v, a, motion.steps)
