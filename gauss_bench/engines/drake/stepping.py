"""Step Drake's plants (models): simulate runs, and find accelerations from steps with constraints."""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from gauss_bench.engines.drake.translate import Built
from gauss_bench.engines.shared import size
from gauss_bench.engines.tree_model import extrapolate
from gauss_bench.terms import Array
from gauss_bench.trajectory import RunFailure, Status

LONGEST_STEP = 0.1  # [s] limit for integrators that choose their steps, as in Drake's SimulatorConfig
LENGTHS = (1e-4, 4e-4)  # [s] longest step of an extrapolation; the second is tried if the first fails
HALVINGS = 3  # number of shorter steps of an extrapolation, each half of the one before
SETTLING = 9  # number of steps of each length
SETTLED = 1e-3  # largest relative change of an accepted extrapolation if its shortest step is left out


class Stepper:
    """A plant that is evaluated at given states and takes steps from them; `length` [s] is its step, 0 if it is continuous."""

    def __init__(self, built: Built):
        self.built = built
        self.length = float(built.plant.time_step())
        self.context = built.connect(built.system.CreateDefaultContext())

    def reported_acceleration(self, y: Array, dy: Array) -> Array:
        """Return the accelerations y'' (n,) that Drake's output port reports at a tree state y, dy (n,).

        A discrete plant reports the change of the speeds in the next step, divided by the step length.
        """
        self.built.set_state(self.context, y, dy)
        reported = self.built.plant.get_generalized_acceleration_output_port().Eval(self.context)
        return np.asarray(np.array(reported)[self.built.order])

    def last_changes(self, y: Array, dy: Array, steps: int) -> tuple[Array, Array]:
        """Take `steps` >= 2 steps from a tree state y, dy (n,).

        Return, for each of the last two steps, the change of dy (n,) in this step divided by the step length.
        """
        self.built.set_state(self.context, y, dy)
        rates = [dy]  # dy at the beginning, and after each step
        for _ in range(steps):
            self.context.SetDiscreteState(self.built.plant.EvalUniquePeriodicDiscreteUpdate(self.context))
            _, rate = self.built.state(self.context)
            rates.append(rate)
        return (rates[-2] - rates[-3]) / self.length, (rates[-1] - rates[-2]) / self.length


class Runner:
    """A simulation of a plant: of a discrete plant with its own step size, or of a continuous plant by an integrator.

    Attributes:
        integrator: Drake's object for the integrator; None for a discrete plant, which needs none.
        taken: number of steps since the start.
    """

    def __init__(self, built: Built):
        self.built = built
        self.simulator: Any = built.drake.analysis.Simulator(built.system)
        self.root = self.simulator.get_mutable_context()
        self.context = built.connect(self.root)
        self.integrator: Any = None

    def set_integrator(self, scheme: str, accuracy: float | None) -> None:
        """Set the integrator of a continuous plant to one of Drake's schemes; if `accuracy` is given, it chooses its own steps."""
        self.integrator = self.built.drake.analysis.ResetIntegratorFromFlags(self.simulator, scheme, LONGEST_STEP)
        self.takes_equal_steps = accuracy is None
        self.integrator.set_fixed_step_mode(self.takes_equal_steps)
        if accuracy is not None:
            self.integrator.set_target_accuracy(accuracy)

    def start(self, y: Array, dy: Array) -> None:
        """Begin at a tree state y, dy (n,), and at time 0, because no force depends on time."""
        self.root.SetTime(0.0)
        self.built.set_state(self.context, y, dy)
        self.simulator.Initialize()
        self.taken = 0
        if self.integrator is not None:
            self.integrator.ResetStatistics()

    def advance(self, steps: int, size: float) -> tuple[Array, Array]:
        """Simulate `steps` times `size` [s], in steps of this size unless an integrator chooses them; return y, dy (n,)."""
        self.taken += steps
        # Drake computes the time of a step of a discrete plant by the same product; a sum of sizes could differ by rounding
        end = self.taken * self.built.plant.time_step()
        if self.integrator is not None:
            end = self.root.get_time() + steps * size
            if self.takes_equal_steps:
                self.integrator.set_maximum_step_size(size)
        self.simulator.AdvanceTo(end)
        return self.built.state(self.context)


def settled_acceleration(steppers: Callable[[float], Sequence[Stepper]], y: Array, dy: Array) -> Array:
    """Return the acceleration (n,) at a tree state y, dy (n,) with closed loops, found from steps of discrete plants.

    A step of SAP, the solver of discrete plants, makes the velocities of both points of a closing pin equal, evaluated with the
    positions at the beginning of the step. So the step leaves a gap at its end. It also closes half of the gap that the step before
    left. Let D_k be the change of the speeds in step k, divided by the step length h. The distance of D_k from the limit D(h) is
    halved in every step, so that

        D(h) = 2 D_k - D_(k-1),    a = D(0)

    The acceleration D(0) is extrapolated from several lengths h. Forces that Drake treats implicitly change D(h), but not D(0).

    Trap: if a step would change the speeds by less than a millionth, SAP does not change them at all. So if the results of short
    steps do not agree, longer steps are tried.

    Args:
        steppers: longest step size [s] of LENGTHS -> plants with this step size and shorter ones, the longest first.

    Raises:
        RunFailure: the extrapolation changes by more than SETTLED if the shortest step is left out.
    """
    for longest in LENGTHS:
        chosen = steppers(longest)
        pairs = [stepper.last_changes(y, dy, SETTLING) for stepper in chosen]
        changes = [2 * last - before for before, last in pairs]  # D(h)
        lengths = [stepper.length for stepper in chosen]
        acceleration = extrapolate(lengths, changes)
        # largest change of a component if the shortest step is left out
        change = float(np.abs(acceleration - extrapolate(lengths[:-1], changes[:-1])).max(initial=0.0))
        if change <= SETTLED * size(acceleration):
            return acceleration
    raise RunFailure(Status.NOT_CONVERGED, f"Drake's changes of speed in short steps do not settle: they differ by {change:.1e}")
