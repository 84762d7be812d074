"""Export for CasADi: the accelerations in closed form as a serialised casadi.Function, and an integrator."""

from textwrap import wrap

from gauss_bench.engines.base import Choice
from gauss_bench.exchange.scripts import write_program
from gauss_bench.mechanism.model import Mechanism
from gauss_bench.trajectory import RunFailure, Status

WIDTH = 120  # characters in a line of the serialised function
METHODS = {
    "rk4": "the classical method of Runge and Kutta in CasADi's virtual machine",
    "dop853_fixed": "the twelve stages of DOP853 without error control, in CasADi's virtual machine",
    "cvodes_adams": "CVODES with Adams' method",
    "cvodes_bdf": "CVODES with BDF",
}


def write(mechanism: Mechanism, choice: Choice, head: list[str]) -> str:
    """Return a Python script that simulates the mechanism with CasADi.

    Raises:
        RunFailure: a script for CasADi cannot be written with this integrator or stabilisation.
        ImportError: CasADi is not installed.
    """
    from gauss_bench.engines.casadi import functions

    if choice.integrator not in METHODS or choice.stabilization != "none":
        raise RunFailure(Status.SKIP, f"CasADi scripts have no {choice.integrator} with stabilization {choice.stabilization}")
    rtol, atol = choice.tolerances(1e-6, 1e-8)  # the defaults of CVODES
    options: dict[str, object] = {"reltol": rtol, "abstol": atol}
    if choice.integrator == "cvodes_adams":
        options |= {"linear_multistep_method": "adams", "nonlinear_solver_iteration": "functional"}
    return write_program(
        "casadi.py.jinja",
        mechanism,
        choice,
        [*head, "acceleration(t, q, v) gives a and the multipliers of M a + J^T lambda = Q, J a = gamma."],
        function=wrap(functions(mechanism).acceleration.serialize(), WIDTH),
        method=METHODS[choice.integrator],
        options=options,
    )
