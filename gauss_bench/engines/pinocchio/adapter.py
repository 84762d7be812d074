"""Pinocchio: a tree of joints in relative coordinates, closed by rigid point constraints and integrated by the suite.

Pinocchio has no springs and dampers, and no integrator for constrained systems. Forces other than gravity are given to Pinocchio as
tau, and the suite's integrators step the tree coordinates. A prescribed motion is imposed by a torque or force on the driven joint.
Pinocchio computes Baumgarte's terms. The suite projects states in absolute coordinates; mapped back to tree coordinates, projected
states close the loops.

Redundant constraint rows contradict each other when errors of the integrator have opened the loops. In this case Pinocchio's
proximal iterations do not converge, and the run fails for this reason. Projection keeps redundant rows consistent.
"""

from collections.abc import Callable
from functools import cached_property
from typing import Any

import numpy as np

from gauss_bench.engines.base import Choice
from gauss_bench.engines.interpreted import OwnSteps
from gauss_bench.engines.pinocchio import build as building
from gauss_bench.engines.pinocchio.compiled import CompiledDynamics, unsupported_by_compiled_loop
from gauss_bench.engines.pinocchio.dynamics import SOLVED, ConstrainedDynamics, TreeForces
from gauss_bench.engines.pinocchio.tree import Multibody, verify
from gauss_bench.engines.shared import LibraryEngine, beyond_a_tree, finite
from gauss_bench.engines.tree_model import TreeModel
from gauss_bench.integrate import STABILIZATIONS
from gauss_bench.mechanism.evaluate import evaluator_of
from gauss_bench.mechanism.model import Mechanism
from gauss_bench.terms import Array
from gauss_bench.trajectory import RunFailure, Status, Trajectory

NO_GAINS = (0.0, 0.0)


class Pinocchio(LibraryEngine, beside=__file__):
    """Pinocchio's constrained dynamics with the suite's integrators."""

    name = "pinocchio"
    integrators = ("rk4", "semi_implicit_euler", "dop853", "dop853_fixed")
    stabilizations = STABILIZATIONS
    resizable = True  # a built model can run with another step or tolerance
    native_loop = False
    python_loop = True

    def version(self) -> str:
        import pinocchio

        return f"Pinocchio {pinocchio.__version__}"

    def skip(self, mechanism: Mechanism, choice: Choice) -> str | None:
        if reason := beyond_a_tree(mechanism, "Pinocchio"):
            return reason
        if choice.integrator == "dop853" and choice.stabilization == "projection":
            return "projection between steps needs a fixed-step integrator"
        if is_compiled(choice.settings):
            options = self.file.options(choice.settings)
            return unsupported_by_compiled_loop(mechanism, choice, options) or building.explain_missing()
        return None

    def build(self, mechanism: Mechanism, choice: Choice) -> "PinocchioModel":
        return PinocchioModel(mechanism, choice)

    def unbuilt(self, settings: str) -> str:
        """Return the name of the compiled loop if these settings need it and it is not built yet; otherwise an empty text."""
        must_build = is_compiled(settings) and not building.explain_missing() and building.explain_absence()
        return "Pinocchio's compiled loop (about 2 minutes, once)" if must_build else ""

    def build_once(self) -> None:
        building.build_loop()

    def in_python(self, mechanism: Mechanism, choice: Choice) -> str:
        return "" if is_compiled(choice.settings) else "steps, applied forces and a call of the library for every right-hand side"


def is_compiled(settings: str) -> bool:
    """Tell whether the compiled loop takes the steps under these settings; otherwise Python does."""
    return bool(Pinocchio.file.options(settings)["loop"] == "compiled")


class PinocchioModel(OwnSteps, TreeModel):
    """A mechanism in Pinocchio with one integrator and stabilisation of the suite."""

    library = "Pinocchio"

    def __init__(self, mechanism: Mechanism, choice: Choice):
        import pinocchio

        super().__init__(mechanism, choice, Pinocchio.file.options(choice.settings))
        self.pin: Any = pinocchio
        self.evaluator = evaluator_of(mechanism)
        self.start = self.y0, self.dy0
        self.tolerances = self.options["dop853_rtol"], self.options["dop853_atol"]
        self.body = Multibody(pinocchio, mechanism, self.tree)
        verify(self.body, mechanism, self.tree)
        self.forces = TreeForces(mechanism, self.tree, self.body)
        gains = NO_GAINS  # Baumgarte's Kp [1/s^2] and Kd [1/s]
        if choice.stabilization == "baumgarte":
            gains = float(self.options["baumgarte_Kp_per_s2"]), float(self.options["baumgarte_Kd_per_s"])
        self.stabilized = self._make_dynamics(gains)

    @cached_property
    def plain(self) -> ConstrainedDynamics:
        """The dynamics without Baumgarte's terms, for the reported accelerations."""
        return self._make_dynamics(NO_GAINS)

    def _make_dynamics(self, gains: tuple[float, float]) -> ConstrainedDynamics:
        """Return Pinocchio's dynamics with Baumgarte's gains Kp [1/s^2], Kd [1/s]."""
        kind = CompiledDynamics if is_compiled(self.choice.settings) else ConstrainedDynamics
        return kind(self.body, self.forces, self.options, gains)

    def tree_acceleration(self, t: float, y: Array, dy: Array) -> Array:
        return self.plain(t, y, dy)

    def accelerate_sample(self, t: float, y: Array, dy: Array) -> Array:
        # by numpy as a batch of one state, like the states of the samples; Python numbers would differ in the last digit
        return np.asarray(self.tree.absolute(y[None], dy[None], self.plain(t, y, dy)[None]).a[0])

    def bare_calls(self) -> tuple[Callable[[], Array], Callable[[], Array]]:
        """Return calls of Pinocchio's solver at the start state, and of a trivial function, the difference of two states."""
        return self.plain.bare(*self.start), lambda: self.pin.difference(self.plain.model, *self.start)

    def run(self) -> None:
        self.stabilized.evaluations = 0
        super().run()

    def _run_adaptive(self, rtol: float, atol: float) -> int:
        """Fill the samples by an adaptive integrator, compiled if the settings say so; return the number of its steps."""
        if isinstance(self.stabilized, CompiledDynamics):
            return self.stabilized.advance_adaptive(self.times, self.x, self.dx, rtol, atol)
        return super()._run_adaptive(rtol, atol)

    def _advance(self, begin: float, x: Array, dx: Array, h: float, count: int, last: float) -> tuple[Array, Array]:
        """Return the state after `count` steps of h [s] from x, dx, in compiled code or in Python; only Python needs `last`."""
        if isinstance(self.stabilized, CompiledDynamics):
            return self.stabilized.advance(self.choice.integrator, begin, x, dx, h, count)
        return super()._advance(begin, x, dx, h, count, last)

    def project(self, t: float, x: Array, dx: Array) -> tuple[Array, Array]:
        """Return the tree state x, dx (n,) nearest to the given one that satisfies the constraints at time t [s]."""
        q, v, _ = self.tree.absolute(x, dx, dx)  # the accelerations are not used, so any values will do
        try:
            return self.tree.relative(*self.evaluator.project(t, q, v))
        except np.linalg.LinAlgError as error:
            raise RunFailure(Status.NAN, f"t = {t:.6g} s: the state is not finite; a smaller step may help") from error

    def read(self) -> Trajectory:
        """Return the samples, with a note that names the forces that Python evaluates in every step.

        Raises:
            RunFailure: the accelerations of a sample do not satisfy the constraints.
        """
        in_python = "" if is_compiled(self.choice.settings) else ", ".join(f.name for f in self.forces.others)
        note = f"forces evaluated in Python at every step, which takes longer than Pinocchio does: {in_python}" if in_python else ""
        trajectory = self.trajectory(self.x, self.dx, self.steps, self.stabilized.evaluations, note)
        if finite(trajectory.q, trajectory.v, trajectory.a) == len(self.times):  # `finite` counts the finite samples from the start
            self._check_constraints(trajectory)
        return trajectory

    def _check_constraints(self, trajectory: Trajectory) -> None:
        """Check that the accelerations of the samples satisfy the suite's own constraint rows, J a = gamma."""
        rows = self.evaluator.constraints(trajectory.t, trajectory.q, trajectory.v)
        # (k,) largest residual of each sample, relative to its accelerations
        residual = np.abs(np.einsum("kij,kj->ki", rows.J, trajectory.a) - rows.gamma).max(axis=1, initial=0.0)
        residual /= np.maximum(1.0, np.abs(trajectory.a).max(axis=1))
        if (residual > SOLVED).any():
            k = int(np.argmax(residual > SOLVED))
            text = f"t = {self.times[k]:.6g} s: the accelerations miss the constraints by {residual[k]:.1e} of their size"
            raise RunFailure(Status.NOT_CONVERGED, text, trajectory[:k])
