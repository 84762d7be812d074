"""CasADi's integrators on a linkage in absolute coordinates: IDAS for differential-algebraic equations, CVODES for ordinary ones.

    idas          q' = v,  v' = a        with a, lambda from   M a + J^T lambda = Q,  J a = gamma             (index 1: it drifts)
    idas_ggl      q' = v - H^T mu,  v' = a,                    M a + J^T lambda = Q,  c = 0,  phi = 0         (stabilised index 2)
    cvodes_bdf    q' = v,  v' = a(t, q, v) in closed form, by BDF and Newton's method
    cvodes_adams  the same by Adams' method and functional iteration
    rk4, dop853_fixed   the closed form at equal steps, in CasADi's generated C (`equal_steps`)

H holds the holonomic rows of J. SUNDIALS (IDAS and CVODES) chooses steps and orders, so `Choice.step` does not affect it. With
projection, its method is restarted with order 1 and a small step after every sample. Multipliers and accelerations are left out of
the error test, as the documentation of IDAS advises for algebraic variables beyond index 1.

Sources: Gear, Leimkuhler and Gupta, Automatic integration of Euler-Lagrange equations with constraints, J. Comput. Appl. Math.
12-13 (1985); Hindmarsh et al., SUNDIALS, ACM Trans. Math. Softw. 31 (2005).
"""

import re
from typing import Any

import numpy as np

from gauss_bench.engines.base import Choice, sample_arrays
from gauss_bench.engines.c_code import METHODS
from gauss_bench.engines.casadi.equal_steps import EqualSteps
from gauss_bench.engines.casadi.functions import reason_to_refuse
from gauss_bench.engines.shared import LibraryEngine, finite, finite_acceleration
from gauss_bench.integrate import STABILIZATIONS
from gauss_bench.mechanism.evaluate import Evaluator
from gauss_bench.mechanism.model import Mechanism
from gauss_bench.terms import Array
from gauss_bench.trajectory import RunFailure, Status, Trajectory

# Absolute tolerance of algebraic variables, so large that Newton's convergence test ignores them. In index 2 their errors grow like
# 1/h. At a state that was just projected they are exact already, and the iteration by which IDAS would correct them fails.
LOOSE = 1e9
REASONS = {  # error code of SUNDIALS without its prefix IDA_ or CV_ -> its meaning
    "TOO_MUCH_WORK": "too many steps between two samples",
    "CONV_FAIL": "Newton's iteration does not converge, perhaps because constraint rows lose their rank",
    "CONV_FAILURE": "the iteration does not converge, perhaps because constraint rows lose their rank",
    "ERR_FAIL": "the error test fails even with the smallest step",
    "ERR_FAILURE": "the error test fails even with the smallest step",
    "LSETUP_FAIL": "the matrix of Newton's iteration is singular",
    "LSOLVE_FAIL": "the matrix of Newton's iteration is singular",
    "TOO_MUCH_ACC": "the tolerances are smaller than the rounding error of doubles",
}


class Casadi(LibraryEngine, beside=__file__):
    """CasADi's symbolic equations, integrated by SUNDIALS, or with equal steps in generated C."""

    name = "casadi"
    adaptive = ("idas", "idas_ggl", "cvodes_bdf", "cvodes_adams")  # SUNDIALS chooses its own steps
    integrators = (*adaptive, *METHODS)
    stabilizations = STABILIZATIONS
    resizable = True  # a built model can run with another step or tolerance
    native_loop = True
    python_loop = False

    def version(self) -> str:
        import casadi

        return f"CasADi {casadi.CasadiMeta.version()} with SUNDIALS"

    def skip(self, mechanism: Mechanism, choice: Choice) -> str | None:
        if choice.integrator == "idas_ggl" and choice.stabilization != "none":
            return "the stabilised index 2 form satisfies the constraints without a stabilisation"
        if choice.integrator in METHODS and choice.stabilization == "projection":
            return "equal steps are generated without a projection"
        return reason_to_refuse(mechanism)

    def in_python(self, mechanism: Mechanism, choice: Choice) -> str:
        return "projection, at every sample" if choice.stabilization == "projection" else ""

    def build(self, mechanism: Mechanism, choice: Choice) -> "CasadiModel | EqualSteps":
        if choice.integrator in METHODS:
            return EqualSteps(mechanism, choice, self.file.options(choice.settings))
        return CasadiModel(mechanism, choice)


class CasadiModel:
    """A mechanism as a system of differential-algebraic or of ordinary differential equations, integrated by SUNDIALS.

    Attributes:
        solve: function (t, q, v) -> accelerations (n,), multipliers (m,).
        system: the system in the form of CasADi's integrators: ode, alg, x, z, t and the parameter p.
        x: (k, 2n) samples, each q and then v.
        spans: with projection, lengths [s] of the intervals between samples; otherwise empty: one call integrates the whole run.
        integrators: length [s] of an interval between samples -> the interval's integrator; the key 0 stands for the whole run.
    """

    def __init__(self, mechanism: Mechanism, choice: Choice):
        """Write the accelerations as a CasADi function, and the equations of motion as a system for CasADi's integrators."""
        import casadi

        from gauss_bench.engines.casadi.equations import equations, solution

        self.ca: Any = casadi
        self.mechanism, self.choice, self.options = mechanism, choice, Casadi.file.options(choice.settings)
        self.evaluator = Evaluator(mechanism)
        e = equations(mechanism)
        self.solve = casadi.Function("solve", [e.t, e.q, e.v], [*solution(e)])  # reported accelerations have no Baumgarte terms
        self.system = self._write_system(e)

    def _write_system(self, e: Any) -> dict[str, Any]:
        """Return the system for CasADi's integrators, as written at the head of this file; `e` are the `Equations`.

        The start time of the system is a parameter, so intervals of equal length share an integrator.
        """
        from gauss_bench.engines.casadi.equations import solution, stabilize

        ca, n = self.ca, self.mechanism.n
        if self.choice.stabilization == "baumgarte":
            e = stabilize(e, self.options["baumgarte_alpha_beta_per_s"])
        if self.choice.integrator.startswith("cvodes"):
            system = {"ode": ca.vertcat(e.v, solution(e)[0])}
        else:
            a, multipliers = ca.SX.sym("a", n), ca.SX.sym("multipliers", e.c.shape[0])
            motion = e.mass * a + e.J.T @ multipliers - e.Q
            system = {"z": ca.vertcat(a, multipliers), "ode": ca.vertcat(e.v, a), "alg": ca.vertcat(motion, e.J @ a - e.gamma)}
            # Gear, Gupta and Leimkuhler: -H^T mu is added to q'; mu enforces phi = 0, and the multipliers enforce c = 0
            if self.choice.integrator == "idas_ggl":
                mu = ca.SX.sym("mu", e.phi.shape[0])
                system["z"] = ca.vertcat(system["z"], mu)
                system["ode"] = ca.vertcat(e.v - ca.jacobian(e.phi, e.q).T @ mu, a)
                system["alg"] = ca.vertcat(motion, e.c, e.phi)
        begin = ca.SX.sym("begin")
        shifted = {key: ca.substitute(x, e.t, begin + e.t) for key, x in system.items()}
        return shifted | {"t": e.t, "x": ca.vertcat(e.q, e.v), "p": begin}

    def acceleration(self, t: float, q: Array, v: Array) -> Array:
        return finite_acceleration(t, np.array(self.solve(t, q, v)[0])[:, 0], "CasADi")

    def prepare(self, times: Array, native: bool = True) -> None:
        """Reset to the start and make the integrators; `native` has no effect."""
        self.times, self.steps, self.evaluations = times, 0, 0
        (self.x,) = sample_arrays(times, np.concatenate([self.mechanism.q0, self.mechanism.v0]))
        grids: dict[float, list[float]] = {}  # key of an integrator -> times [s] at which it returns states
        self.spans: list[float] = []
        if self.choice.stabilization == "projection":
            self.spans = [float(f"{x:.12g}") for x in np.diff(times)]  # rounded, so that equal intervals share an integrator
            grids = {x: [x] for x in self.spans}
        elif len(times) > 1:
            grids = {0.0: list(times[1:] - times[0])}  # one integrator returns all samples
        self.integrators = {x: self._make_integrator(grid) for x, grid in grids.items()}

    def _make_integrator(self, grid: list[float]) -> Any:
        """Return a CasADi integrator that starts at time 0 and returns the states at the times `grid` [s] after the start."""
        relative, absolute = self.choice.tolerances(self.options["reltol"], self.options["abstol"])
        options: dict[str, Any] = {"reltol": relative, "abstol": absolute}
        kind, _, method = self.choice.integrator.partition("_")
        if kind == "idas":
            options |= {k.removeprefix("idas."): x for k, x in self.options.items() if k.startswith("idas.")}
        if method == "adams":
            options |= {"linear_multistep_method": "adams", "nonlinear_solver_iteration": "functional"}
        if method == "ggl":  # IDAS can compute consistent initial values only in index 1; those given here are consistent
            a0 = self._solve_algebraic(float(self.times[0]), self.x[0])[: self.mechanism.n]
            options |= {"calc_ic": False, "init_xdot": [*self.mechanism.v0, *a0]}
        if method == "ggl" or (kind == "idas" and self.spans):  # in index 2, and with projection: see LOOSE
            options["abstolv"] = [options["abstol"]] * (2 * self.mechanism.n) + [LOOSE] * self.system["z"].shape[0]
        return self.ca.integrator("integrator", kind, self.system, 0.0, grid, options)

    def _solve_algebraic(self, t: float, x: Array) -> Array:
        """Return the algebraic variables at time t [s] and a state x (2n,): accelerations, multipliers, and corrections mu = 0."""
        if "z" not in self.system:
            return np.zeros(0)
        n, size = self.mechanism.n, self.system["z"].shape[0]
        a_and_multipliers = np.concatenate([np.array(part)[:, 0] for part in self.solve(t, x[:n], x[n:])])
        return np.pad(a_and_multipliers, (0, size - len(a_and_multipliers)))  # only the system of idas_ggl has corrections

    def run(self) -> None:
        """Integrate the whole run in one call, or from sample to sample with projection."""
        n = self.mechanism.n
        if self.integrators and not self.spans:  # no projection, and more than one sample
            self.x[1:] = self._integrate(0.0, float(self.times[0]), self.x[0])
        for k, span in enumerate(self.spans):
            x = self._integrate(span, float(self.times[k]), self.x[k])[-1]
            if not np.isfinite(x).all():
                return  # all later samples stay NaN
            self.x[k + 1] = np.concatenate(self.evaluator.project(float(self.times[k + 1]), x[:n], x[n:]))

    def _integrate(self, span: float, t: float, x: Array) -> Array:
        """Return the states (k, 2n) at the k times of an integrator's grid, from the state x (2n,) at time t [s].

        Args:
            span: key of the integrator in `integrators`.

        Raises:
            RunFailure: SUNDIALS cannot reach the end of the grid.
        """
        integrator = self.integrators[span]
        try:
            states = integrator(x0=x, z0=self._solve_algebraic(t, x), p=t)["xf"]
        except RuntimeError as error:
            raise RunFailure(Status.NOT_CONVERGED, explain(str(error), self.choice.integrator)) from error
        counts = integrator.stats()
        self.steps += counts["nsteps"]
        self.evaluations += counts["nfevals"]
        return np.array(states).T

    def read(self) -> Trajectory:
        """Return the samples; the accelerations are computed from the states, without Baumgarte's terms.

        Samples after a failure of the integrator stay NaN.
        """
        n = self.mechanism.n
        q, v = self.x[:, :n], self.x[:, n:]
        # `finite` returns the number of samples before the first one that is not finite
        reached, a = slice(finite(self.x)), np.full_like(q, np.nan)
        a[reached] = np.array(self.solve.map(reached.stop)(self.times[reached], q[reached].T, v[reached].T)[0]).T
        return Trajectory(self.times, q, v, a, self.steps, self.evaluations, "steps and orders are the integrator's own choice")


def explain(text: str, integrator: str) -> str:
    """Return a sentence for the text of a CasADi exception: the meaning of its SUNDIALS error code, or its last line."""
    code = re.search(r'"(?:IDA|CV)_(\w+)"', text)  # such as "IDA_TOO_MUCH_WORK"
    reason = REASONS.get(code[1], code[0].strip('"')) if code else text.strip().splitlines()[-1]
    return f"{integrator} gave up: {reason}"
