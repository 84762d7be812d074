"""Give the states and true accelerations of probes, which are small models that are built with a library's own functions.

Each probe has one kind of loop closure. The module `release_cases.py` in the engine's folder builds the small model, and returns
accelerations (k, n) in absolute coordinates (x, y and angle of each body) at states (k, n) in these coordinates. The true
accelerations a are those of a linkage in the folder `linkages`, or of an open chain with one additional constraint equation, which
is a row of

    M a + J^T lambda = Q,    J a = gamma.
"""

from functools import cache

import numpy as np

from gauss_bench.bench.measure import mechanism_of
from gauss_bench.engines.bars import CURVE, RATIO
from gauss_bench.mechanism.evaluate import Evaluator
from gauss_bench.mechanism.spaces import angle_slot
from gauss_bench.releases.cases import FIRST, FOLDER, SPEED, STATES, states_of, with_shifts
from gauss_bench.terms import Array
from gauss_bench.trajectory import Samples

COUPLED = "coupled_bars"
MODELS = {"wide_four_bar": FIRST} | {name: str(FOLDER / f"{name}.toml") for name in ("rod_of_one_length", "three_cranks")}


@cache
def states_of_probe(model: str) -> Samples:
    """Return the states of a probe's model: a linkage of MODELS, or COUPLED, a chain of two bars with coupled angles."""
    return coupled_states() if model == COUPLED else states_of(MODELS[model], "")


def coupled_states() -> Samples:
    """Return states of two bars whose relative angle is a function of the first bar's angle x: RATIO x + CURVE x^2."""
    mechanism = mechanism_of(str(FOLDER / "two_bars.toml"), "")
    rng = np.random.default_rng(5)
    lengths = 1.0, 0.5  # [m] from the first pin to the second, and from each bar's pin to its centre of mass
    q, v = np.zeros((2, 2 * STATES, 6))  # first the states in motion, then those at rest
    angles, speeds = rng.uniform(-1.2, 1.2, STATES), rng.uniform(-SPEED, SPEED, STATES)  # of the first bar [rad, rad/s]
    for k in range(STATES):
        q[k], v[k] = place_bars(angles[k], speeds[k], *lengths)
        q[STATES + k], v[STATES + k] = place_bars(angles[k], 0.0, *lengths)
    a = np.array([coupled_acceleration(Evaluator(mechanism), *state) for state in zip(q, v, strict=True)])
    return with_shifts(q, v, a)


def place_bars(x: float, w: float, length: float, half: float) -> tuple[Array, Array]:
    """Return the state q, v (6,) of two bars when the first bar has the angle x [rad] and the angular velocity w [rad/s].

    `length` [m] is the distance from the first pin to the second, and `half` [m] that from each pin to its bar's centre of mass.
    """
    x2, w2 = x + RATIO * x + CURVE * x * x, w * (1 + RATIO + 2 * CURVE * x)
    e, f = np.array([np.cos(x), np.sin(x)]), np.array([np.cos(x2), np.sin(x2)])  # directions of the bars
    e_rate, f_rate = w * np.array([-e[1], e[0]]), w2 * np.array([-f[1], f[0]])
    q = np.concatenate([half * e, [x], length * e + half * f, [x2]])
    v = np.concatenate([half * e_rate, [w], length * e_rate + half * f_rate, [w2]])
    return q, v


def coupled_acceleration(evaluator: Evaluator, q: Array, v: Array) -> Array:
    """Return the accelerations (6,) of the two bars whose angles are coupled.

    The coupling theta_2 - theta_1 = RATIO theta_1 + CURVE theta_1^2, differentiated twice, is an additional row of J a = gamma.
    """
    terms = evaluator.terms(0.0, q, v)
    row = np.zeros(len(q))
    first, second = angle_slot(0), angle_slot(1)
    row[second], row[first] = 1.0, -(1 + RATIO + 2 * CURVE * q[first])
    J = np.vstack([terms.J, row])  # (m + 1, n)
    gamma = np.append(terms.gamma, 2 * CURVE * v[first] ** 2)
    K = np.block([[terms.M, J.T], [J, np.zeros((len(J), len(J)))]])
    return np.linalg.solve(K, np.concatenate([terms.Q, gamma]))[: len(q)]
