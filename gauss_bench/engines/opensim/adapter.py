"""OpenSim: a tree of Simbody's mobilised bodies, closed by point constraints whose multipliers it solves for at every evaluation.

Simbody's integrators project states onto the constraints. With equal steps, too, the accuracy decides when they do so. The
generated model is compared with the suite's own terms before it is used, at tree states at which loops are open.
"""

from pathlib import Path
from typing import Any

import numpy as np

from gauss_bench.engines.base import Choice, sample_arrays
from gauss_bench.engines.opensim.translate import Builder, Built, gaps, refusal
from gauss_bench.engines.shared import (
    beyond_a_tree,
    finite_acceleration,
    joint_tree,
    open_tree,
    require_agreement,
    tree_states,
    unsteady,
    with_accelerations,
)
from gauss_bench.engines.variants import read_variants
from gauss_bench.integrate.fixed_step import stretches
from gauss_bench.mechanism.evaluate import Evaluator
from gauss_bench.mechanism.model import Mechanism
from gauss_bench.terms import Array
from gauss_bench.trajectory import RunFailure, Status, Trajectory, in_a_sentence

VARIANTS = read_variants(Path(__file__).parent)
ADAPTIVE = "_adaptive"  # ending of the integrators that choose their steps
METHODS = {"rk_merson": "RungeKuttaMerson", "rk3": "RungeKutta3", "verlet": "Verlet", "semi_explicit_euler2": "SemiExplicitEuler2"}
METHODS |= {f"rk_merson{ADAPTIVE}": "RungeKuttaMerson", f"rk3{ADAPTIVE}": "RungeKutta3"}
AGREEMENT = 1e-9  # relative: rounding causes about 1e-13, a wrong sign or factor about 1


class OpenSim:
    """OpenSim with Simbody's explicit integrators, which take equal steps or choose them.

    CPodes is not offered: after a failure it returns a state that is wrong, without an exception.
    """

    name = "opensim"
    integrators = tuple(METHODS)
    adaptive = tuple(x for x in METHODS if x.endswith(ADAPTIVE))
    stabilizations = ("none",)
    settings = VARIANTS.settings
    variants, knobs, first = VARIANTS.space, VARIANTS.knobs, VARIANTS.first
    native_loop = True
    python_loop = False
    resizable = True

    def version(self) -> str:
        import opensim

        return f"OpenSim {opensim.GetVersion()}"

    def skip(self, mechanism: Mechanism, choice: Choice) -> str | None:
        reason = beyond_a_tree(mechanism, "OpenSim") or unsteady(mechanism, "OpenSim")
        return reason or refusal(mechanism, joint_tree(mechanism, VARIANTS.options(choice.settings)))

    def in_python(self, mechanism: Mechanism, choice: Choice) -> str:
        return ""

    def build(self, mechanism: Mechanism, choice: Choice) -> "OpenSimModel":
        return OpenSimModel(mechanism, choice)


class OpenSimModel:
    """A mechanism in OpenSim under one choice."""

    def __init__(self, mechanism: Mechanism, choice: Choice):
        import opensim

        self.opensim: Any = opensim
        opensim.Logger.setLevelString("Off")
        self.mechanism, self.choice, self.options = mechanism, choice, VARIANTS.options(choice.settings)
        self.tree = joint_tree(mechanism, self.options)
        self.y0, self.dy0 = self.tree.relative(mechanism.q0, mechanism.v0)
        self._verify(Builder(opensim, mechanism, self.tree, whole=False).build())
        self.built = Builder(opensim, mechanism, self.tree).build()

    def _verify(self, opened: Built) -> None:
        """Compare the open tree with the suite's own terms.

        Raises:
            RunFailure: its accelerations, or the gaps of its pins, differ.
        """
        evaluator = Evaluator(self.mechanism)
        for y, dy in tree_states(self.tree, self.y0, self.dy0):
            own, state = open_tree(evaluator, self.tree, y, dy), self._state(opened, 0.0, y, dy)
            forces = own.mass @ self._tree_acceleration(opened, state)
            pairs = {
                "forces of the open tree": (forces, own.forces, own.load or 1.0),
                "gaps of open pins": (gaps(opened, state), own.gaps, float(np.abs(own.q).max())),
            }
            require_agreement(pairs, AGREEMENT)

    def _state(self, built: Built, t: float, y: Array, dy: Array) -> Any:
        """Return OpenSim's state at time t [s] and a tree state y, dy (n,)."""
        state = self.opensim.State(built.start)
        state.setTime(float(t))
        for coordinate, value, rate in zip(built.coordinates, y, dy, strict=True):
            coordinate.setValue(state, float(value), False)  # without False it would assemble the loops
            coordinate.setSpeedValue(state, float(rate))
        return state

    def _tree_acceleration(self, built: Built, state: Any) -> Array:
        """Return the accelerations (n,) of the tree coordinates.

        Raises:
            RunFailure: Simbody finds none.
        """
        try:
            built.model.realizeAcceleration(state)
        except RuntimeError as error:
            raise RunFailure(Status.ERROR, f"t = {state.getTime():.6g} s: Simbody: {in_a_sentence(error)}") from error
        return np.array([x.getAccelerationValue(state) for x in built.coordinates])

    def _accelerate(self, t: float, y: Array, dy: Array) -> Array:
        """Return the accelerations in absolute coordinates (3 links,) at a tree state y, dy (n,)."""
        ddy = self._tree_acceleration(self.built, self._state(self.built, t, y, dy))
        return finite_acceleration(t, self.tree.absolute(y, dy, ddy)[2], "OpenSim")

    def acceleration(self, t: float, q: Array, v: Array) -> Array:
        return self._accelerate(t, *self.tree.relative(q, v))

    def prepare(self, times: Array, native: bool = True) -> None:
        self.times = times
        self.y, self.dy = sample_arrays(times, self.y0, self.dy0)
        self.manager = self._manager(recorded=False)

    def _manager(self, recorded: bool) -> Any:
        """Return an integration from the start; if it is recorded, every step is kept, which takes time and memory."""
        manager, method = self.opensim.Manager(self.built.model), self.choice.integrator or "rk_merson"
        manager.setWriteToStorage(recorded)
        manager.setPerformAnalyses(False)
        manager.setIntegratorMethod(getattr(self.opensim.Manager, f"IntegratorMethod_{METHODS[method]}"))
        self.chooses_steps, accuracy = method in OpenSim.adaptive, self.options["accuracy"]
        if self.chooses_steps:
            accuracy, _ = self.choice.tolerances(accuracy, 0.0)
        else:
            manager.setIntegratorFixedStepSize(self.choice.step)
        manager.setIntegratorAccuracy(accuracy)
        if self.options["constraint_tolerance"]:
            manager.setIntegratorConstraintTolerance(self.options["constraint_tolerance"])
        manager.initialize(self._state(self.built, self.times[0], self.y0, self.dy0))
        return manager

    def run(self) -> None:
        self._step_through(self.manager, self.y, self.dy)

    def _step_through(self, manager: Any, y: Array, dy: Array) -> None:
        """Integrate to every sample time and store the tree states.

        Raises:
            RunFailure: Simbody gives up.
        """
        for k, t in enumerate(self.times[1:], start=1):
            try:
                state = manager.integrate(float(t))
            except RuntimeError as error:
                reason = f"Simbody stopped before t = {t:.6g} s: {in_a_sentence(error)}"
                raise RunFailure(Status.NOT_CONVERGED, reason) from error
            y[k] = [x.getValue(state) for x in self.built.coordinates]
            dy[k] = [x.getSpeedValue(state) for x in self.built.coordinates]

    def read(self) -> Trajectory:
        q, v, _ = self.tree.absolute(self.y, self.dy, np.zeros_like(self.y))

        def acceleration_of_sample(k: int) -> Array:
            return self._accelerate(float(self.times[k]), self.y[k], self.dy[k])

        return with_accelerations(self.times, q, v, acceleration_of_sample, self._count_steps())

    def _count_steps(self) -> int:
        """Return the number of steps of the run; one with chosen steps is repeated and recorded, as OpenSim does not count.

        Raises:
            RunFailure: the repeated run differs.
        """
        if not self.chooses_steps:
            return sum(stretch.steps for stretch in stretches(self.times, self.choice.step))
        manager, y, dy = self._manager(recorded=True), self.y.copy(), self.dy.copy()
        self._step_through(manager, y, dy)
        if not (np.array_equal(y, self.y) and np.array_equal(dy, self.dy)):
            raise RunFailure(Status.WARNING, "Simbody's run differs when it is repeated to count its steps")
        return int(manager.getStatesTable().getNumRows()) - 1
