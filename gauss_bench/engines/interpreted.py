"""The suite's own formulations as engines: terms, stabilisation, formulation, integrator, put together and nothing more.

Friction in joints is a loop around any formulation: its force follows from the multipliers, those from the accelerations, and a
formulation without multipliers gets them from J^T lambda = Q - M a.
"""

from dataclasses import replace

import numpy as np

from gauss_bench import __version__
from gauss_bench.engines.base import Choice
from gauss_bench.engines.own_options import Known
from gauss_bench.engines.own_steps import OwnSteps
from gauss_bench.formulations import FORMULATIONS
from gauss_bench.integrate import BAUMGARTE_RATE, STABILIZATIONS
from gauss_bench.mechanism.evaluate import Evaluator, UndeterminedLoads
from gauss_bench.mechanism.forces import JAMMED
from gauss_bench.mechanism.model import Mechanism
from gauss_bench.terms import Array, SingularSystem, Solution, Terms, baumgarte, recover_multipliers
from gauss_bench.trajectory import RunFailure, Status, Trajectory, with_accelerations

SETTINGS = {"default": {"baumgarte_alpha_beta_per_s": BAUMGARTE_RATE, "dop853_rtol": 1e-10, "dop853_atol": 1e-12}}
KNOWN = Known(SETTINGS, [*SETTINGS["default"]])


class Interpreted:
    """One formulation as an engine."""

    integrators = ("rk4", "semi_implicit_euler", "dop853", "dop853_fixed")
    stabilizations = STABILIZATIONS
    settings = SETTINGS
    options = KNOWN.options
    resizable = True  # a model takes another step or tolerance
    native_loop = False
    python_loop = True

    def __init__(self, name: str):
        self.name = name

    def in_python(self, mechanism: Mechanism, choice: Choice) -> str:
        return "terms, formulation and steps"

    def version(self) -> str:
        return f"gauss-bench {__version__}"

    def skip(self, mechanism: Mechanism, choice: Choice) -> str | None:
        if choice.integrator == "dop853" and choice.stabilization == "projection":
            return "projection between steps needs a fixed-step integrator"
        return None

    def build(self, mechanism: Mechanism, choice: Choice) -> "InterpretedModel":
        return InterpretedModel(self.name, mechanism, choice)


class InterpretedModel(OwnSteps):
    """A mechanism under one formulation, integrator and stabilisation."""

    def __init__(self, name: str, mechanism: Mechanism, choice: Choice):
        self.mechanism, self.choice, self.options = mechanism, choice, KNOWN.resolve(choice.settings)
        self.start, self.tolerances = (mechanism.q0, mechanism.v0), (self.options["dop853_rtol"], self.options["dop853_atol"])
        self.rate = float(self.options["baumgarte_alpha_beta_per_s"])
        self.formulation = FORMULATIONS[name]
        self.evaluator = Evaluator(mechanism)
        self.friction = self.evaluator.friction
        try:
            self.evaluator.check_loads()
        except UndeterminedLoads as error:
            raise RunFailure(Status.RANK_LOST, str(error)) from error
        self.rank = mechanism.n - mechanism.dof + len(mechanism.drivers) + len(mechanism.knife_edges)

    def acceleration(self, t: float, q: Array, v: Array) -> Array:
        return self._move(t, q, v, self.evaluator.terms(t, q, v))

    def stabilized(self, t: float, q: Array, v: Array) -> Array:
        """The acceleration the integrator sees."""
        self.evaluations += 1
        terms = self.evaluator.terms(t, q, v)
        return self._move(t, q, v, baumgarte(terms, self.rate, self.rate) if self.choice.stabilization == "baumgarte" else terms)

    def _move(self, t: float, q: Array, v: Array, terms: Terms) -> Array:
        solution = self._solve(t, terms)
        return self._resist(t, self.friction.directions(q, v), terms, solution) if self.friction else solution.a

    def _resist(self, t: float, W: Array, terms: Terms, solution: Solution) -> Array:
        """The fixed point a = solve(Q + W N(lambda(a))), from the solution without friction; W (n, p)."""
        if not np.isfinite(solution.a).all():
            raise RunFailure(Status.NAN, f"not finite at t = {t:.6g} s; a smaller step may help")
        loads: Array = np.zeros(W.shape[1])
        loaded, change = terms, np.inf
        for _ in range(self.friction.ITERATIONS):
            multipliers = solution.multipliers
            multipliers = recover_multipliers(loaded, solution.a) if multipliers is None else multipliers
            before, previous, loads = loads, change, self.friction.loads(multipliers)
            change, scale = float(np.abs(loads - before).max()), float(np.abs(multipliers).max())
            if change <= self.friction.TOLERANCE * scale or previous <= change <= self.friction.STALLED * scale:
                return solution.a
            loaded = replace(terms, Q=terms.Q + W @ loads)
            solution = self._solve(t, loaded)
        raise RunFailure(Status.NOT_CONVERGED, f"t = {t:.6g} s: {JAMMED.format(self.friction.ITERATIONS)}")

    def _solve(self, t: float, terms: Terms) -> Solution:
        try:
            solution = self.formulation(terms)
        except (SingularSystem, np.linalg.LinAlgError) as error:
            if np.isfinite(terms.J).all() and np.isfinite(terms.gamma).all():
                raise RunFailure(Status.RANK_LOST, f"t = {t:.6g} s: {error}") from error
            raise RunFailure(Status.NAN, f"not finite at t = {t:.6g} s; a smaller step may help") from error
        if self.mechanism.redundant and solution.rank > self.rank:
            drifted = f"t = {t:.6g} s: redundant rows have drifted apart and count as independent (rank {solution.rank}, "
            raise RunFailure(Status.RANK_LOST, f"{drifted}{self.rank} at the start): the linkage would lock; use projection")
        return solution

    def project(self, t: float, x: Array, dx: Array) -> tuple[Array, Array]:
        return self.evaluator.project(t, x, dx)

    def read(self) -> Trajectory:
        def at(k: int) -> Array:
            return self.acceleration(float(self.times[k]), self.x[k], self.dx[k])

        return with_accelerations(self.times, self.x, self.dx, at, self.steps, self.evaluations)
