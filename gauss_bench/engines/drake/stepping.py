"""Plants of Drake that step: simulations, and the acceleration that steps with constraints show."""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from gauss_bench.engines.drake.translate import Built
from gauss_bench.engines.shared import size
from gauss_bench.engines.tree_model import extrapolate
from gauss_bench.terms import Array
from gauss_bench.trajectory import RunFailure, Status

LONGEST_STEP = 0.1  # [s] of integrators that choose their steps, as in Drake's SimulatorConfig
LENGTHS = (1e-4, 4e-4)  # [s] longest of the steps from which accelerations are extrapolated, and what is taken where it fails
HALVINGS = 3  # each half of the one before
SETTLING = 9  # steps of each length
SETTLED = 1e-3  # relative change, if the shortest steps are left out, up to which an extrapolation counts


class Stepper:
    """A plant in a context of its own, which is evaluated at given states and steps from there."""

    def __init__(self, built: Built):
        self.built = built
        self.length = float(built.plant.time_step())  # [s]; 0 of a continuous plant
        self.root = built.system.CreateDefaultContext()
        self.context = built.connect(self.root)

    def reported_acceleration(self, y: Array, dy: Array) -> Array:
        """Return y'' (n,) as Drake reports it at a tree state y, dy (n,)."""
        self.built.set_state(self.context, y, dy)
        return self.built.reported_acceleration(self.context)

    def last_changes(self, y: Array, dy: Array, steps: int) -> tuple[Array, Array]:
        """Return the changes of the speeds (n,) in the last two of some steps from a tree state y, dy (n,), over their length."""
        self.built.set_state(self.context, y, dy)
        rates = [dy]
        for _ in range(steps):
            self.context.SetDiscreteState(self.built.plant.EvalUniquePeriodicDiscreteUpdate(self.context))
            rates.append(self.built.state(self.context)[1])
        return (rates[-2] - rates[-3]) / self.length, (rates[-1] - rates[-2]) / self.length


class Runner:
    """A simulation of a discrete plant, whose steps have one length."""

    def __init__(self, drake: Any, built: Built):
        self.built = built
        self.simulator: Any = drake.analysis.Simulator(built.system)
        self.root = self.simulator.get_mutable_context()
        self.context = built.connect(self.root)
        self.taken = 0

    def start(self, y: Array, dy: Array) -> None:
        """Begin at time 0 and a tree state y, dy (n,): no force depends on time."""
        self.root.SetTime(0.0)
        self.built.set_state(self.context, y, dy)
        self.simulator.Initialize()
        self.taken = 0

    def advance(self, steps: int, size: float) -> tuple[Array, Array]:
        """Take steps of a size [s], which is the plant's own, and return the tree state y, dy (n,) after them."""
        self.taken += steps
        # Drake, too, forms this product for the time of a step; a sum of sizes could end just beside it
        self.simulator.AdvanceTo(self.taken * self.built.plant.time_step())
        return self.built.state(self.context)


class ContinuousRunner(Runner):
    """A simulation of a continuous plant by one of Drake's integrators."""

    def set_integrator(self, drake: Any, scheme: str, accuracy: float | None) -> None:
        """Set the integrator; with an accuracy it chooses its steps."""
        self.integrator: Any = drake.analysis.ResetIntegratorFromFlags(self.simulator, scheme, LONGEST_STEP)
        self.takes_equal_steps = accuracy is None
        self.integrator.set_fixed_step_mode(self.takes_equal_steps)
        if accuracy is not None:
            self.integrator.set_target_accuracy(accuracy)

    def start(self, y: Array, dy: Array) -> None:
        super().start(y, dy)
        self.integrator.ResetStatistics()

    def advance(self, steps: int, size: float) -> tuple[Array, Array]:
        if self.takes_equal_steps:
            self.integrator.set_maximum_step_size(size)
        self.simulator.AdvanceTo(self.root.get_time() + steps * size)
        return self.built.state(self.context)

    def count_steps(self) -> int:
        """Return the number of steps since the start."""
        return int(self.integrator.get_num_steps_taken())


def settled_acceleration(steppers: Callable[[float], Sequence[Stepper]], y: Array, dy: Array) -> Array:
    """Return the acceleration (n,) that steps of a discrete plant show at a tree state y, dy (n,) with closed loops.

    A step of SAP gives the pinned points equal velocities as they lie at its beginning, which leaves a gap, and takes back half of
    the gap of the step before. From closed loops on, the changes of speed D_k in step k, over its length h, therefore approach
    those of a motion in such steps, and what is missing halves with every step:

        D(h) = 2 D_k - D_(k-1),    a = D(0)

    where D(0) is extrapolated from several lengths h. A force that Drake treats implicitly changes D(h), but not D(0).

    Trap: SAP leaves the speeds as they are where a step would change them by less than a millionth. Where short steps do not agree,
    longer ones are taken.

    Args:
        steppers: longest step [s] -> plants that take this and shorter steps, the longest first.

    Raises:
        RunFailure: without the shortest steps, the extrapolation gives another acceleration.
    """
    for longest in LENGTHS:
        found, change = extrapolate_changes(steppers(longest), y, dy)
        if change <= SETTLED * size(found):
            return found
    raise RunFailure(Status.NOT_CONVERGED, f"Drake's changes of speed in short steps do not settle: they differ by {change:.1e}")


def extrapolate_changes(steppers: Sequence[Stepper], y: Array, dy: Array) -> tuple[Array, float]:
    """Return the acceleration (n,) at a tree state y, dy (n,), and its largest change if the shortest steps are left out."""
    pairs = [stepper.last_changes(y, dy, SETTLING) for stepper in steppers]
    changes = [2 * last - before for before, last in pairs]
    lengths = [stepper.length for stepper in steppers]
    found = extrapolate(lengths, changes)
    return found, float(np.abs(found - extrapolate(lengths[:-1], changes[:-1])).max(initial=0.0))
