"""The six-bar of Wang et al. (2010), section 1.2.5: its four matrices, written down as printed.

Loops a-b-c-d and d-e-f-g, phi = [phi2, phi3, phi5, s], q = [phi1]. The dimensions are not printed: the linkage file has them.
"""

from collections.abc import Callable

import numpy as np

from gauss_bench.papers.loop_forms import turnings
from gauss_bench.papers.problems import worst
from gauss_bench.terms import Array

Blocks = tuple[Array, Array, Array, Array]
ALPHA = np.radians(50.0)  # between d-e and d-c of the ternary link
LENGTHS = (0.10, 0.30, 0.28, 0.24, 0.36)  # l1, l2, l3, l3', l5 [m]
RAIL = np.radians(-45.0)


def six_bar_blocks(phi: Array, rate: Array) -> Blocks:
    """J, J', B, B' of the six-bar as printed; phi, rate (4,): angles of links 1, 2, 3, 5."""
    l1, l2, l3, l3s, l5 = LENGTHS
    arms = np.array([l1, l2, l3s, l3, l5])
    angle, speed = phi[[0, 1, 2, 2, 3]] + np.array([0, 0, ALPHA, 0, 0]), rate[[0, 1, 2, 2, 3]]
    s, c, s_rate, c_rate = arms * np.sin(angle), arms * np.cos(angle), arms * speed * np.cos(angle), arms * speed * np.sin(angle)
    J = np.array(
        [
            [-s[1], s[2], 0, 0],
            [c[1], -c[2], 0, 0],
            [0, -s[3], -s[4], -np.cos(RAIL)],
            [0, c[3], c[4], -np.sin(RAIL)],
        ]
    )
    J_rate = np.array(
        [
            [-s_rate[1], s_rate[2], 0, 0],
            [-c_rate[1], c_rate[2], 0, 0],
            [0, -s_rate[3], -s_rate[4], 0],
            [0, -c_rate[3], -c_rate[4], 0],
        ]
    )
    return J, J_rate, np.array([[-s[0]], [c[0]], [0], [0]]), np.array([[-s_rate[0]], [-c_rate[0]], [0], [0]])


def blocks_off(form: Callable[[Array, Array], Blocks]) -> float:
    """Largest difference from the suite's matrices, the sense of each loop left free."""
    found = []
    for t in turnings():
        equations, m = t.equations, t.matrices
        if equations.mechanism.name != "six_bar":
            continue
        names = [equations.column[i] for i in (0, 1, 2, 3)]
        order = [*names[1:], len(equations.unknown) - 1]
        printed = np.hstack(form(t.x[names], t.rate[names]))
        own = np.hstack([m.J[:, order], m.J_rate[:, order], m.B, m.B_rate])
        for rows in (slice(0, 2), slice(2, 4)):
            found.append(min(float(np.abs(printed[rows] - sense * own[rows]).max()) for sense in (1.0, -1.0)))
    return worst(found)
