"""The suite's own formulations as engines in numpy, each run with a stabilisation and an integrator.

Dry friction in joints depends on the multipliers, and is found by a fixed-point iteration around the formulation. If a formulation
returns no multipliers, they are computed from J^T lambda = Q - M a.
"""

from dataclasses import replace
from pkgutil import resolve_name
from typing import Any

import numpy as np

from gauss_bench import __version__
from gauss_bench.engines.base import Choice, sample_arrays
from gauss_bench.engines.own_options import OptionTable
from gauss_bench.formulations import FORMULATIONS
from gauss_bench.integrate import ADAPTIVE, BAUMGARTE_RATE, STABILIZATIONS, StepFailure
from gauss_bench.integrate.fixed_step import STEPS, held_back, stretches
from gauss_bench.mechanism.evaluate import Evaluator, UndeterminedLoads
from gauss_bench.mechanism.forces import JAMMED
from gauss_bench.mechanism.model import Mechanism
from gauss_bench.terms import Array, SingularSystem, Solution, Terms, baumgarte, recover_multipliers
from gauss_bench.trajectory import RunFailure, Status, Trajectory, with_accelerations

SETTINGS = {"default": {"baumgarte_alpha_beta_per_s": BAUMGARTE_RATE, "dop853_rtol": 1e-10, "dop853_atol": 1e-12}}
KNOWN = OptionTable(SETTINGS, dict.fromkeys(SETTINGS["default"], ()))


class Interpreted:
    """One formulation as an engine."""

    integrators = ("rk4", "semi_implicit_euler", "dop853", "dop853_fixed")
    stabilizations = STABILIZATIONS
    settings = SETTINGS
    options = KNOWN.options
    resizable = True  # a built model can run with another step or tolerance
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


class OwnSteps:
    """A model whose steps are taken in Python; a subclass supplies the accelerations and the projection after a step.

    Attributes:
        start: coordinates and rates (n,) at the beginning.
        x, dx: (k, n) samples of coordinates and rates.
        stabilized: function (t, x, dx) -> the acceleration (n,) that is integrated, with Baumgarte's terms if they are chosen.
        tolerances: relative and absolute tolerance of an adaptive integrator if the choice has none.
    """

    mechanism: Mechanism
    choice: Choice
    start: tuple[Array, Array]
    tolerances: tuple[float, float]
    stabilized: Any
    steps = evaluations = 0

    def project(self, t: float, x: Array, dx: Array) -> tuple[Array, Array]:
        """Return the state nearest to x, dx (n,) that satisfies the constraints on positions and velocities at time t [s]."""
        raise NotImplementedError

    def prepare(self, times: Array, native: bool = True) -> None:
        self.times, self.steps, self.evaluations = times, 0, 0
        self.x, self.dx = sample_arrays(times, *self.start)

    def run(self) -> None:
        with np.errstate(all="ignore"):  # no warnings: the steps check for values that are not finite
            if self.choice.integrator not in ADAPTIVE:
                self._run_fixed()
            elif self.times[-1] != self.times[0]:
                try:
                    self.steps = self._run_adaptive(*self.choice.tolerances(*self.tolerances))
                except StepFailure as error:
                    raise RunFailure(Status.NOT_CONVERGED, f"DOP853 could not continue: {error}") from error

    def _run_adaptive(self, rtol: float, atol: float) -> int:
        """Compute the samples x, dx by an adaptive integrator, and return the number of its steps."""
        integrate = resolve_name(ADAPTIVE[self.choice.integrator])  # not at the head: importing scipy takes longer than most runs
        steps, *_ = integrate(self.stabilized, self.times, self.x, self.dx, rtol, atol, kinks=self.mechanism.kinks)
        return int(steps)

    def _run_fixed(self) -> None:
        """Take the fixed steps of a run, and store its samples; a stretch is a sequence of equal steps up to a sample or a kink."""
        x, dx = self.start
        for begin, count, h, last, row in stretches(self.times, self.choice.step, self.mechanism.kinks):
            x, dx = self._advance(begin, x, dx, h, count, last)
            if not np.isfinite(x).all():
                raise RunFailure(Status.NAN, f"not finite at t = {begin + count * h:.6g} s; a smaller step may help")
            if row is not None:
                self.x[row], self.dx[row] = x, dx
            self.steps += count

    def _advance(self, begin: float, x: Array, dx: Array, h: float, count: int, last: float) -> tuple[Array, Array]:
        """Return the state after `count` steps of h [s]; accelerations for later times than `last` [s] are evaluated at `last`."""
        # without `held_back`, a step that ends where a force jumps would also use the force after the jump
        step, rate = STEPS[self.choice.integrator], held_back(self.stabilized, last)
        for i in range(count):
            t = begin + i * h
            x, dx = step(rate, t, x, dx, h)
            if self.choice.stabilization == "projection":
                x, dx = self.project(t + h, x, dx)
        return x, dx


class InterpretedModel(OwnSteps):
    """A mechanism with one formulation, integrator and stabilisation."""

    def __init__(self, name: str, mechanism: Mechanism, choice: Choice):
        """Prepare the equations of a mechanism, and check that the joint forces on which dry friction depends are unique."""
        options = KNOWN.resolve(choice.settings)
        self.mechanism, self.choice, self.start = mechanism, choice, (mechanism.q0, mechanism.v0)
        self.tolerances = options["dop853_rtol"], options["dop853_atol"]
        self.rate = float(options["baumgarte_alpha_beta_per_s"])  # [1/s] both alpha and beta of Baumgarte's terms
        self.formulation = FORMULATIONS[name]
        self.evaluator = Evaluator(mechanism)
        self.friction = self.evaluator.friction
        try:
            self.evaluator.check_loads()
        except UndeterminedLoads as error:
            raise RunFailure(Status.RANK_LOST, str(error)) from error
        # number of independent constraint rows at the start
        self.rank = mechanism.n - mechanism.dof + len(mechanism.drivers) + len(mechanism.knife_edges)

    def acceleration(self, t: float, q: Array, v: Array) -> Array:
        """Return the accelerations (n,) at time t [s] and a state q, v (n,), without Baumgarte's terms."""
        return self._accelerate(t, q, v, self.evaluator.terms(t, q, v))

    def stabilized(self, t: float, q: Array, v: Array) -> Array:
        """Return the acceleration (n,) that is integrated, with Baumgarte's terms if they are chosen."""
        self.evaluations += 1
        terms = self.evaluator.terms(t, q, v)
        if self.choice.stabilization == "baumgarte":
            terms = baumgarte(terms, self.rate, self.rate)  # alpha = beta: gaps decay with critical damping
        return self._accelerate(t, q, v, terms)

    def _accelerate(self, t: float, q: Array, v: Array, terms: Terms) -> Array:
        """Return the acceleration (n,) that follows from the terms of the equations of motion and from friction in joints."""
        solution = self._solve(t, terms)
        return self._add_friction(t, self.friction.directions(q, v), terms, solution) if self.friction else solution.a

    def _add_friction(self, t: float, W: Array, terms: Terms, solution: Solution) -> Array:
        """Return the acceleration (n,) with friction: the fixed point of a = solve(Q + W N(lambda(a))).

        The iteration begins with `solution`, which is without friction. N (p,) are the loads of the p joints with friction, which
        depend on the multipliers lambda. W (n, p) has each joint's generalised friction force per unit of load.

        Raises:
            RunFailure: the iteration does not converge (the joints jam), or values are not finite.
        """
        if not np.isfinite(solution.a).all():
            raise RunFailure(Status.NAN, f"not finite at t = {t:.6g} s; a smaller step may help")
        loads: Array = np.zeros(W.shape[1])
        loaded, change = terms, np.inf
        for _ in range(self.friction.ITERATIONS):
            multipliers = solution.multipliers
            if multipliers is None:
                multipliers = recover_multipliers(loaded, solution.a)
            previous_loads, previous_change = loads, change
            loads = self.friction.loads(multipliers)
            change, scale = float(np.abs(loads - previous_loads).max()), float(np.abs(multipliers).max())
            if change <= self.friction.TOLERANCE * scale:
                return solution.a
            if previous_change <= change <= self.friction.STALLED * scale:  # rounding keeps the change from shrinking further
                return solution.a
            loaded = replace(terms, Q=terms.Q + W @ loads)
            solution = self._solve(t, loaded)
        raise RunFailure(Status.NOT_CONVERGED, f"t = {t:.6g} s: {JAMMED.format(self.friction.ITERATIONS)}")

    def _solve(self, t: float, terms: Terms) -> Solution:
        """Solve the equations of motion at time t [s], given by `terms`, by the chosen formulation."""
        try:
            solution = self.formulation(terms)
        except (SingularSystem, np.linalg.LinAlgError) as error:
            if np.isfinite(terms.J).all() and np.isfinite(terms.gamma).all():
                raise RunFailure(Status.RANK_LOST, f"t = {t:.6g} s: {error}") from error
            raise RunFailure(Status.NAN, f"not finite at t = {t:.6g} s; a smaller step may help") from error
        # Redundant rows that have drifted apart contradict each other: if they count as independent, the linkage is locked.
        if self.mechanism.redundant and solution.rank > self.rank:
            message = f"t = {t:.6g} s: redundant rows have drifted apart and count as independent "
            message += f"(rank {solution.rank}, {self.rank} at the start): the linkage would lock; use projection"
            raise RunFailure(Status.RANK_LOST, message)
        return solution

    def project(self, t: float, x: Array, dx: Array) -> tuple[Array, Array]:
        return self.evaluator.project(t, x, dx)

    def read(self) -> Trajectory:
        def accelerate(k: int) -> Array:
            return self.acceleration(float(self.times[k]), self.x[k], self.dx[k])

        return with_accelerations(self.times, self.x, self.dx, accelerate, self.steps, self.evaluations)
