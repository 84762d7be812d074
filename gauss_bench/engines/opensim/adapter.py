"""OpenSim: a tree of Simbody's mobilised bodies, closed by point constraints; every evaluation solves for their multipliers.

Simbody's integrators project states onto the constraints. The setting `accuracy` decides when the integrators project, even if
their steps are equal.
"""

from collections.abc import Mapping
from functools import cached_property
from typing import Any

import numpy as np

from gauss_bench.engines.base import Choice
from gauss_bench.engines.opensim.forces import JointForces
from gauss_bench.engines.opensim.program import write
from gauss_bench.engines.opensim.translate import ADAPTIVE, METHODS, Built, explain_refusal, make_manager
from gauss_bench.engines.shared import LibraryEngine, beyond_a_tree, joint_tree, unsteady
from gauss_bench.engines.tree_model import OpenModel, TreeModel, verify
from gauss_bench.mechanism.model import Mechanism
from gauss_bench.terms import Array
from gauss_bench.trajectory import RunFailure, Status, in_a_sentence

AGREEMENT = 1e-9  # relative: rounding causes about 1e-13, a wrong sign or factor about 1


class OpenSim(LibraryEngine, beside=__file__):
    """OpenSim with Simbody's explicit integrators, which take equal steps or choose their steps.

    Simbody's integrator CPodes is not offered: on the eight-bar after 1 s, its error is 5e-7 rad at the tolerance 1e-9, and that of
    Merson's method is 7e-9 rad at 1e-8. If a run takes too many steps, CPodes only prints a message about mxstep, and continues.
    """

    name = "opensim"
    integrators = tuple(METHODS)
    adaptive = tuple(x for x in METHODS if x.endswith(ADAPTIVE))
    native_loop = True
    python_loop = False
    resizable = True

    def version(self) -> str:
        import opensim

        return f"OpenSim {opensim.GetVersion()}"

    def skip(self, mechanism: Mechanism, choice: Choice) -> str | None:
        reason = beyond_a_tree(mechanism, "OpenSim") or unsteady(mechanism, "OpenSim")
        return reason or explain_refusal(mechanism, joint_tree(mechanism, self.file.options(choice.settings)))

    def build(self, mechanism: Mechanism, choice: Choice) -> "OpenSimModel":
        return OpenSimModel(mechanism, choice)

    def program(self, mechanism: Mechanism, choice: Choice) -> str:
        return write(mechanism, choice, self.file.options(choice.settings))


class OpenSimModel(TreeModel):
    """A mechanism in OpenSim, run with one setting of the engine (`Choice`)."""

    library = "OpenSim"

    def __init__(self, mechanism: Mechanism, choice: Choice):
        import opensim

        super().__init__(mechanism, choice, OpenSim.file.options(choice.settings))
        self.opensim: Any = opensim
        opensim.Logger.setLevelString("Off")
        open_tree = Built(opensim, mechanism, self.tree, constrained=False)

        def describe(y: Array, dy: Array) -> OpenModel:
            """Return the gaps of the loops and the accelerations of the open tree at y, dy (n,), as OpenSim computes them."""
            state = self._make_state(open_tree, 0.0, y, dy)
            accelerations = self._find_accelerations(open_tree, state)  # computes positions too, which `gaps` needs
            return OpenModel(open_tree.gaps(state), accelerations=accelerations)

        verify(mechanism, self.tree, describe, AGREEMENT)
        self.built = Built(opensim, mechanism, self.tree)

    def _make_state(self, built: Built, t: float, y: Array, dy: Array) -> Any:
        """Return OpenSim's state at time t [s] and a tree state y, dy (n,)."""
        state = self.opensim.State(built.start)
        state.setTime(float(t))
        for coordinate, value, rate in zip(built.coordinates, y, dy, strict=True):
            coordinate.setValue(state, float(value), False)  # without False OpenSim would close the loops
            coordinate.setSpeedValue(state, float(rate))
        return state

    def _find_accelerations(self, built: Built, state: Any) -> Array:
        """Return the accelerations (n,) of the tree coordinates; RunFailure is raised if Simbody finds none."""
        try:
            built.model.realizeAcceleration(state)
        except RuntimeError as error:
            raise RunFailure(Status.ERROR, f"t = {state.getTime():.6g} s: Simbody: {in_a_sentence(error)}") from error
        return np.array([x.getAccelerationValue(state) for x in built.coordinates])

    def tree_acceleration(self, t: float, y: Array, dy: Array) -> Array:
        return self._find_accelerations(self.built, self._make_state(self.built, t, y, dy))

    @cached_property
    def _joint_forces(self) -> JointForces:
        return JointForces(self.mechanism, self.tree, self.built)

    def joint_forces(self, t: float, q: Array, v: Array) -> Mapping[str, Array]:
        state = self._make_state(self.built, t, *self.tree.relative(q, v))
        self._find_accelerations(self.built, state)  # OpenSim computes joint forces from accelerations
        return self._joint_forces.read(state, q, v)

    def prepare(self, times: Array, native: bool = True) -> None:
        super().prepare(times, native)
        self.manager = self._make_manager(recorded=False)

    def _make_manager(self, recorded: bool) -> Any:
        """Return OpenSim's manager, which integrates from the start; if `recorded`, it stores the state after every step."""
        manager = make_manager(self.opensim, self.built.model, self.choice, self.options, self.choice.step, recorded)
        manager.initialize(self._make_state(self.built, self.times[0], self.y0, self.dy0))
        return manager

    def run(self) -> None:
        self._step_through(self.manager, self.y, self.dy)

    def _step_through(self, manager: Any, y: Array, dy: Array) -> None:
        """Integrate to every sample time, and store tree coordinates and rates in y, dy (k, n), whose first row is the start."""
        for k, t in enumerate(self.times[1:], start=1):
            try:
                state = manager.integrate(float(t))
            except RuntimeError as error:
                reason = f"Simbody stopped before t = {t:.6g} s: {in_a_sentence(error)}"
                raise RunFailure(Status.NOT_CONVERGED, reason) from error
            y[k] = [x.getValue(state) for x in self.built.coordinates]
            dy[k] = [x.getSpeedValue(state) for x in self.built.coordinates]

    def count_steps(self) -> int:
        """Return the number of steps of the run.

        OpenSim does not count steps that an integrator chooses. Such a run is repeated, and its recorded states are counted.

        Raises:
            RunFailure: the repeated run differs.
        """
        if self.choice.integrator not in OpenSim.adaptive:
            return super().count_steps()
        # the repeated run overwrites the copies y, dy, which must then still equal the samples of the run
        manager, y, dy = self._make_manager(recorded=True), self.y.copy(), self.dy.copy()
        self._step_through(manager, y, dy)
        if not (np.array_equal(y, self.y) and np.array_equal(dy, self.dy)):
            raise RunFailure(Status.WARNING, "Simbody's run differs when it is repeated to count its steps")
        return int(manager.getStatesTable().getNumRows()) - 1
