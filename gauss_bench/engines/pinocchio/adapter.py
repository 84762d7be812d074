"""Pinocchio: a tree of joints in relative coordinates, closed by rigid point constraints and integrated by the suite.

Its proximal iterations solve

    M y'' + h = tau + J^T f,    J y'' + mu (f - f_before) = gamma

so that mu times the last change of the forces f is what the constraints are still missed by. f itself is never read: its sign and
frame do not matter here. A prescribed rotation is the torque that makes it so, found by one further solution for each driver.

Pinocchio has no springs and dampers, and no integrator for constrained systems: forces other than gravity reach it as tau, and the
steps are the suite's, in tree coordinates. Baumgarte's terms are Pinocchio's own. Projection is the suite's, in absolute
coordinates; mapped back to the tree it closes the open pins. Redundant rows that have drifted apart contradict each other: the
iterations then do not settle, and the run is given up rather than followed. Projection keeps them together.
"""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from gauss_bench.engines.base import Choice
from gauss_bench.engines.pinocchio.forces import DrivingTorques, TreeForces
from gauss_bench.engines.pinocchio.tree import Multibody, verify
from gauss_bench.engines.shared import beyond_a_tree, finite, finite_acceleration, joint_tree, with_accelerations
from gauss_bench.engines.variants import read_variants
from gauss_bench.integrate.adaptive import StepFailure, dop853
from gauss_bench.integrate.fixed_step import STEPS, held_back, stretches
from gauss_bench.integrate.stabilization import STABILIZATIONS
from gauss_bench.mechanism.evaluate import Evaluator
from gauss_bench.mechanism.model import Mechanism
from gauss_bench.terms import Array
from gauss_bench.trajectory import RunFailure, Status, Trajectory

VARIANTS = read_variants(Path(__file__).parent)
SOLVED = 1e-6  # of the largest acceleration: independent rows are met to 1e-13; redundant ones that part pass this on their way


class Pinocchio:
    """The engine."""

    name = "pinocchio"
    integrators = ("rk4", "semi_implicit_euler", "dop853", "dop853_fixed")
    stabilizations = STABILIZATIONS
    settings = VARIANTS.settings
    variants, knobs, first = VARIANTS.space, VARIANTS.knobs, VARIANTS.first
    resizable = True  # a model takes another step or tolerance
    native_loop = False
    python_loop = True

    def version(self) -> str:
        import pinocchio

        return f"Pinocchio {pinocchio.__version__}"

    def skip(self, mechanism: Mechanism, choice: Choice) -> str | None:
        reason = beyond_a_tree(mechanism, "Pinocchio")
        if reason:
            return reason
        if choice.integrator == "dop853" and choice.stabilization == "projection":
            return "projection between steps needs a fixed-step integrator"
        return None

    def build(self, mechanism: Mechanism, choice: Choice) -> "PinocchioModel":
        return PinocchioModel(mechanism, choice)


class ConstrainedDynamics:
    """Tree accelerations (n,) of a tree state, as the integrators of the suite call them; `evaluations` counts the calls."""

    def __init__(self, body: Multibody, forces: TreeForces, options: Mapping[str, Any], gains: tuple[float, float]):
        pin = body.pin
        self.model, self.forces, self.solve = body.model, forces, getattr(pin, options["algorithm"])
        self.data: Any = body.model.createData()
        self.rows: Any = body.constraints(gains)
        self.row_data: Any = pin.StdVec_RigidConstraintData()
        for row in self.rows:
            self.row_data.append(row.createData())
        if options["algorithm"] == "lcaba":
            pin.computeJointMinimalOrdering(self.model, self.data, self.rows)
        else:
            pin.initConstraintDynamics(self.model, self.data, self.rows, self.row_data)
        accuracies = options["absolute_accuracy"], options["relative_accuracy"]
        self.prox: Any = pin.ProximalSettings(*accuracies, options["mu"], int(options["max_iter"]))
        self.limit = SOLVED / options["mu"]
        self.drive = DrivingTorques(forces, gains)
        self.evaluations = 0

    def __call__(self, t: float, y: Array, dy: Array) -> Array:
        self.evaluations += 1
        tau = self.forces(y, dy, t)
        return self.drive(self._solved, t, y, dy, tau) if self.drive.laws else self._solved(t, y, dy, tau)

    def bare(self, y: Array, dy: Array) -> Callable[[], Array]:
        """A call of constraintDynamics at a tree state, with nothing of the suite in it."""
        tau = np.ascontiguousarray(self.forces(y, dy, 0.0))
        return lambda: self.solve(self.model, self.data, y, dy, tau, self.rows, self.row_data, self.prox)

    def _solved(self, t: float, y: Array, dy: Array, tau: Array) -> Array:
        a: Array = self.solve(self.model, self.data, y, dy, tau, self.rows, self.row_data, self.prox)
        if not self.prox.relative_residual <= self.limit:
            self._doubt(t, a)
        return a

    def _doubt(self, t: float, a: Array) -> None:
        """Second look, relative to the accelerations.

        `relative_residual` is the last change of the forces f. `absolute_residual` is no help: at exact accelerations it is as
        large as they are (4.1). `iter` is none either: with redundant rows f wanders along directions that move nothing.

        Raises:
            RunFailure: not finite, or the constraints are missed.
        """
        finite_acceleration(t, a, "Pinocchio")
        missed, size = self.prox.mu * self.prox.relative_residual, max(1.0, float(np.abs(a).max()))
        if not missed <= SOLVED * size:
            raise RunFailure(
                Status.NOT_CONVERGED,
                f"t = {t:.6g} s: proximal iteration {self.prox.iter} still misses the constraints by {missed:.1e} m/s^2 where "
                f"accelerations are {size:.1e}; redundant rows that have drifted apart do this: try projection or a smaller step",
            )


class PinocchioModel:
    """A mechanism in Pinocchio under one integrator and stabilisation of the suite."""

    def __init__(self, mechanism: Mechanism, choice: Choice):
        import pinocchio

        self.pin: Any = pinocchio
        self.mechanism, self.choice = mechanism, choice
        self.options = VARIANTS.options(choice.settings)
        self.tree, self.evaluator = joint_tree(mechanism, self.options), Evaluator(mechanism)
        body = Multibody(pinocchio, mechanism, self.tree)
        verify(body, mechanism, self.tree)
        self.forces, corrector = TreeForces(mechanism, self.tree, body), ("baumgarte_Kp_per_s2", "baumgarte_Kd_per_s")
        proportional, rate = (float(self.options[x]) if choice.stabilization == "baumgarte" else 0.0 for x in corrector)
        self.plain = ConstrainedDynamics(body, self.forces, self.options, (0.0, 0.0))  # what is reported has no Baumgarte terms
        self.stabilized = ConstrainedDynamics(body, self.forces, self.options, (proportional, rate))

    def acceleration(self, t: float, q: Array, v: Array) -> Array:
        with np.errstate(all="ignore"):
            y, dy = self.tree.relative(q, v)
            return finite_acceleration(t, self.tree.absolute(y, dy, self.plain(t, y, dy))[2], "Pinocchio")

    def bare_calls(self) -> tuple[Callable[[], Array], Callable[[], Array]]:
        """At the start: constraintDynamics alone, and what calling costs: a difference of two vectors by Pinocchio."""
        y, dy = self.tree.relative(self.mechanism.q0, self.mechanism.v0)
        return self.plain.bare(y, dy), lambda: self.pin.difference(self.plain.model, y, dy)

    def prepare(self, times: Array, native: bool = True) -> None:
        """There is only the suite's own loop, whatever `native` says."""
        self.times, self.steps, self.stabilized.evaluations = times, 0, 0
        start = self.tree.relative(self.mechanism.q0, self.mechanism.v0)
        self.y, self.dy = np.full((2, len(times), self.tree.n), np.nan)
        self.y[0], self.dy[0] = start

    def run(self) -> None:
        with np.errstate(all="ignore"):  # what is not finite is found afterwards
            if self.choice.integrator == "dop853":
                self._adaptive()
            else:
                self._fixed()

    def _adaptive(self) -> None:
        if self.times[-1] == self.times[0]:
            return
        tolerances = self.choice.tolerances(self.options["dop853_rtol"], self.options["dop853_atol"])
        try:
            self.steps, _ = dop853(self.stabilized, self.times, self.y, self.dy, *tolerances, kinks=self.mechanism.kinks)
        except StepFailure as error:
            raise RunFailure(Status.NOT_CONVERGED, f"DOP853 could not continue: {error}") from error

    def _fixed(self) -> None:
        step = STEPS[self.choice.integrator]
        projected = self.choice.stabilization == "projection"
        y, dy = self.y[0], self.dy[0]
        for begin, count, h, last, row in stretches(self.times, self.choice.step, self.mechanism.kinks):
            dynamics = held_back(self.stabilized, last)
            for i in range(count):
                t = begin + i * h
                y, dy = step(dynamics, t, y, dy, h)
                if projected:
                    y, dy = self._projected(t + h, y, dy)
            if row is not None:
                self.y[row], self.dy[row] = y, dy
            self.steps += count

    def _projected(self, t: float, y: Array, dy: Array) -> tuple[Array, Array]:
        q, v, _ = self.tree.absolute(y, dy, dy)
        try:
            return self.tree.relative(*self.evaluator.project(t, q, v))
        except np.linalg.LinAlgError as error:
            raise RunFailure(Status.NAN, f"t = {t:.6g} s: nothing finite left to project; a smaller step may help") from error

    def read(self) -> Trajectory:
        slow = ", ".join(f.name for f in self.forces.others)
        note = f"forces evaluated in Python at every step, which takes longer than Pinocchio does: {slow}" if slow else ""
        q, v, _ = self.tree.absolute(self.y, self.dy, np.zeros_like(self.y))

        def at(k: int) -> Array:
            ddy = self.plain(float(self.times[k]), self.y[k], self.dy[k])
            return np.asarray(self.tree.absolute(self.y[k : k + 1], self.dy[k : k + 1], ddy[None])[2][0])

        trajectory = with_accelerations(self.times, q, v, at, self.steps, self.stabilized.evaluations, note)
        if finite(q, v, trajectory.a) == len(q):
            self._check(trajectory)
        return trajectory

    def _check(self, x: Trajectory) -> None:
        """The accelerations of the samples satisfy the suite's own constraint rows.

        Raises:
            RunFailure: they do not; with the samples before.
        """
        a = x.a
        rows = self.evaluator.constraints(x.t, x.q, x.v)
        missed = np.abs(np.einsum("kij,kj->ki", rows.J, a) - rows.gamma).max(axis=1, initial=0.0)
        missed /= np.maximum(1.0, np.abs(a).max(axis=1))
        if (missed > SOLVED).any():
            k = int(np.argmax(missed > SOLVED))
            text = f"t = {self.times[k]:.6g} s: the accelerations miss the constraints by {missed[k]:.1e} of their size"
            before = Trajectory(x.t[:k], x.q[:k], x.v[:k], a[:k], x.steps, x.evaluations, x.note)
            raise RunFailure(Status.NOT_CONVERGED, text, before)
