"""CasADi: the accelerations in closed form as a serialised casadi.Function, and steps of Runge and Kutta with it."""

from textwrap import wrap

from gauss_bench.engines.base import Choice
from gauss_bench.exchange.scripts import HEADING, MAIN, PLAN, constants
from gauss_bench.exchange.text import python_comment
from gauss_bench.mechanism.model import Mechanism
from gauss_bench.trajectory import RunFailure, Status

WIDTH = 120  # of the lines that the function is written in
IMPORTS = """import math

import casadi as ca
import numpy as np

"""
HEAD = '''
acceleration = ca.Function.deserialize(FUNCTION)  # (t, q, v) -> a, multipliers; acceleration.save("FILE") for other languages

def simulate(end=END, step=STEP):
    """Rows [t, *q, *v] at equally spaced times, by {method}."""
'''
EQUAL = """    steps, every = plan(end, step)
    n, h = len(Q0), end / steps
    x = ca.SX.sym("x", 2 * n + 1)  # q, v, t

    def rate(x):
        return ca.vertcat(x[n : 2 * n], acceleration(x[2 * n], x[:n], x[n : 2 * n])[0], 1)

{stages}
    several = ca.Function("step", [x], [after]).mapaccum(every)
    rows, state = [[0.0, *Q0, *V0]], np.array([*Q0, *V0, 0.0])
    for k in range(steps // every):
        state = np.array(several(state))[:, -1]
        rows.append([(k + 1) * every * h, *state[:-1]])
    return rows
"""
STAGES = {
    "rk4": """    k1 = rate(x)
    k2 = rate(x + h / 2 * k1)
    k3 = rate(x + h / 2 * k2)
    k4 = rate(x + h * k3)
    after = x + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)""",
    "dop853_fixed": """    rates = []
    for row in DOP853.A[:12]:
        rates.append(rate(x + h * sum((c * k for c, k in zip(row.tolist(), rates)), 0 * x)))
    after = x + h * sum(c * k for c, k in zip(DOP853.B.tolist(), rates))""",
}
SUNDIALS = """    n, count = len(Q0), max(1, math.ceil(end / step - 1e-9))  # `step` is the rows' distance
    t, x = ca.SX.sym("t"), ca.SX.sym("x", 2 * n)
    motion = {{"t": t, "x": x, "ode": ca.vertcat(x[n:], acceleration(t, x[:n], x[n:])[0])}}
    times = np.linspace(0.0, end, count + 1)
    run = ca.integrator("run", "cvodes", motion, 0.0, times[1:].tolist(), {options})
    states = np.array(run(x0=[*Q0, *V0])["xf"]).T
    return [[0.0, *Q0, *V0], *([t, *state] for t, state in zip(times[1:], states))]
"""
METHODS = {
    "rk4": "the classical method of Runge and Kutta in CasADi's virtual machine",
    "dop853_fixed": "the twelve stages of DOP853 without error control, in CasADi's virtual machine",
    "cvodes_adams": "CVODES with Adams' method",
    "cvodes_bdf": "CVODES with BDF",
}


def write_casadi(mechanism: Mechanism, choice: Choice, head: list[str]) -> str:
    """The script.

    Raises:
        RunFailure: steps that the script cannot take.
        ImportError: CasADi is not installed.
    """
    from gauss_bench.engines.casadi import functions

    if choice.integrator not in METHODS or choice.stabilization != "none":
        raise RunFailure(Status.SKIP, f"{choice.integrator} with stabilization {choice.stabilization} is not written for CasADi")
    told = [
        *head,
        "acceleration(t, q, v) gives a and the multipliers of M a + J^T lambda = Q, J a = gamma.",
    ]
    text = "\n".join(f'    "{part}"' for part in wrap(functions(mechanism).acceleration.serialize(), WIDTH))
    given = constants(mechanism, choice) + f"FUNCTION = (\n{text}\n)\n"
    return "".join([HEADING, python_comment(told), "\n", _imports(choice), given, _run(choice), PLAN, MAIN])


def _imports(choice: Choice) -> str:
    """With SciPy, where its tableau is used."""
    return IMPORTS.rstrip("\n") + ("\nfrom scipy.integrate import DOP853\n\n" if choice.integrator == "dop853_fixed" else "\n\n")


def _run(choice: Choice) -> str:
    """The function that integrates."""
    head = HEAD.format(method=METHODS[choice.integrator])
    if choice.integrator in STAGES:
        return head + EQUAL.format(stages=STAGES[choice.integrator])
    reltol, abstol = choice.tolerances(1e-6, 1e-8)
    options: dict[str, object] = {"reltol": reltol, "abstol": abstol}
    if choice.integrator == "cvodes_adams":
        options |= {"linear_multistep_method": "adams", "nonlinear_solver_iteration": "functional"}
    return head + SUNDIALS.format(options=repr(options))
