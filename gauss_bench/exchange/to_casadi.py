"""CasADi: the accelerations in closed form as a serialised casadi.Function, and steps of Runge and Kutta with it."""

from textwrap import wrap

from gauss_bench.engines.base import Choice
from gauss_bench.exchange.scripts import HEADING, MAIN, PLAN, constants
from gauss_bench.exchange.text import python_comment
from gauss_bench.mechanism.model import Mechanism

WIDTH = 120  # of the lines that the function is written in
IMPORTS = """import math

import casadi as ca
import numpy as np

"""
RUN = '''
acceleration = ca.Function.deserialize(FUNCTION)  # (t, q, v) -> a, multipliers; acceleration.save("FILE") for other languages


def simulate(end=END, step=STEP):
    """Rows [t, *q, *v] at equally spaced times, by the classical method of Runge and Kutta in CasADi's virtual machine."""
    steps, every = plan(end, step)
    n, h = len(Q0), end / steps
    x = ca.SX.sym("x", 2 * n + 1)  # q, v, t

    def rate(x):
        return ca.vertcat(x[n : 2 * n], acceleration(x[2 * n], x[:n], x[n : 2 * n])[0], 1)

    k1 = rate(x)
    k2 = rate(x + h / 2 * k1)
    k3 = rate(x + h / 2 * k2)
    k4 = rate(x + h * k3)
    several = ca.Function("step", [x], [x + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)]).mapaccum(every)
    rows, state = [[0.0, *Q0, *V0]], np.array([*Q0, *V0, 0.0])
    for k in range(steps // every):
        state = np.array(several(state))[:, -1]
        rows.append([(k + 1) * every * h, *state[:-1]])
    return rows
'''


def written(mechanism: Mechanism, choice: Choice, head: list[str]) -> str:
    """The script.

    Raises:
        ImportError: CasADi is not installed.
    """
    from gauss_bench.engines.casadi import functions

    told = [
        *head,
        "acceleration(t, q, v) gives a and the multipliers of M a + J^T lambda = Q, J a = gamma.",
    ]
    text = "\n".join(f'    "{part}"' for part in wrap(functions(mechanism).acceleration.serialize(), WIDTH))
    given = constants(mechanism, choice) + f"FUNCTION = (\n{text}\n)\n"
    return "".join([HEADING, python_comment(told), "\n", IMPORTS, given, RUN, PLAN, MAIN])
