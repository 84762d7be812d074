"""Drake: a tree of joints, closed by constraints in discrete plants, or by stiff bushings in plants of either kind.

Only discrete plants take part in constraints, and only in steps of the solver SAP. Its contact approximations kSap, kSimilar and
kLagged, and its near-rigid threshold, change no bit of a run without contacts, and kTamsi refuses constraints, so none of them is a
knob. A continuous plant accepts a constraint and fails at the first evaluation; there, bushings are all that Drake offers.

The generated tree is compared with the suite's own terms before it is used, at states at which loops are open.
"""

from collections.abc import Sequence
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from gauss_bench.engines.base import Choice
from gauss_bench.engines.drake.translate import BALL, OPEN, Builder, Built, Closure, Library, gaps, refusal
from gauss_bench.engines.shared import beyond_a_tree, joint_tree, size, unsteady
from gauss_bench.engines.tree_model import OpenModel, TreeModel, verify
from gauss_bench.engines.variants import read_variants
from gauss_bench.mechanism.model import Mechanism
from gauss_bench.terms import Array
from gauss_bench.trajectory import RunFailure, Status, Trajectory, in_a_sentence, with_accelerations

VARIANTS = read_variants(Path(__file__).parent)
SAP = "sap"  # the step of a discrete plant; the other integrators are for continuous plants
ADAPTIVE = "_adaptive"  # ending of the integrators that choose their steps
SCHEMES = {"runge_kutta3": "runge_kutta3", "radau3": "radau3"}
SCHEMES |= {f"{name}{ADAPTIVE}": scheme for name, scheme in SCHEMES.items()}
LONGEST_STEP = 0.1  # [s] of integrators that choose their steps, as Drake's simulator has it
AGREEMENT = 1e-9  # relative: rounding causes about 1e-15, a wrong sign or factor about 1

SHORT = tuple(1e-4 / 2**k for k in range(4))  # [s] steps from which accelerations are extrapolated
SETTLING = 9  # steps of each length
SETTLED = 1e-3  # relative change, if the shortest steps are left out, up to which an extrapolation counts


class Drake:
    """Drake's discrete plants, with constraints, and its integrators of continuous plants, with bushings."""

    name = "drake"
    integrators = (SAP, *SCHEMES)
    adaptive = tuple(x for x in SCHEMES if x.endswith(ADAPTIVE))
    stabilizations = ("none",)
    settings = VARIANTS.settings
    variants, knobs, first, soft = VARIANTS.space, VARIANTS.knobs, VARIANTS.first, VARIANTS.soft
    native_loop = True
    python_loop = False
    resizable = True

    def version(self) -> str:
        from importlib.metadata import version

        import pydrake.multibody.plant  # a broken installation has a version, too

        return f"Drake {version('drake')}" if pydrake else ""

    def skip(self, mechanism: Mechanism, choice: Choice) -> str | None:
        if reason := beyond_a_tree(mechanism, "Drake") or unsteady(mechanism, "Drake"):
            return reason
        options = VARIANTS.options(choice.settings)
        tree = joint_tree(mechanism, options)
        if tree.closures and options["closure"] == BALL and choice.integrator in SCHEMES:
            return f"Drake has constraints in discrete plants alone: take the integrator {SAP}, or settings that close loops by bushings"
        return refusal(mechanism, tree)

    def in_python(self, mechanism: Mechanism, choice: Choice) -> str:
        return ""

    def build(self, mechanism: Mechanism, choice: Choice) -> "DrakeModel":
        return DrakeModel(mechanism, choice)


class DrakeModel(TreeModel):
    """A mechanism in Drake under one choice.

    Attributes:
        closure: how loops are closed; OPEN if there are none.
        runners: step size [s] -> what runs with it; a discrete plant is built for one size. 0 stands for a continuous plant.
    """

    library = "Drake"

    def __init__(self, mechanism: Mechanism, choice: Choice):
        super().__init__(mechanism, choice, VARIANTS.options(choice.settings))
        self.drake = Library()
        self.builder = Builder(self.drake, mechanism, self.tree)
        opened = Stepper(self._build(0.0, Closure()))
        verify(mechanism, self.tree, lambda y, dy: self._describe(opened, y, dy), AGREEMENT)
        kind = self.options["closure"] if self.tree.closures else OPEN
        self.closure = Closure(kind, self.options["bushing_period_s"], self.options["bushing_damping_ratio"])
        self.runners: dict[float, Runner] = {}
        self._runner(choice.step)

    def _build(self, step: float, closure: Closure) -> Built:
        """Return a plant, with Drake's refusal as a failure of the run.

        Raises:
            RunFailure: Drake refuses the linkage.
        """
        try:
            return self.builder.build(step, closure)
        except (RuntimeError, ValueError) as error:
            raise RunFailure(Status.ERROR, f"Drake cannot build the plant: {in_a_sentence(error)}") from error

    def _describe(self, opened: "Stepper", y: Array, dy: Array) -> OpenModel:
        """Return the open tree at a tree state y, dy (n,), by Drake's own kinematics and dynamics."""
        accelerations = opened.reported_acceleration(y, dy)
        return OpenModel(gaps(opened.built, opened.context), accelerations=accelerations)

    @property
    def is_discrete(self) -> bool:
        return (self.choice.integrator or SAP) == SAP

    def _runner(self, step: float) -> "Runner":
        """Return what runs with steps of a size [s], which is built when it is first asked for."""
        key = round(step, 15) if self.is_discrete else 0.0  # equal gaps between samples give sizes that rounding tells apart
        if key not in self.runners:
            self.runners[key] = Runner(self.drake, self._build(step if self.is_discrete else 0.0, self.closure))
        return self.runners[key]

    @cached_property
    def _short_steppers(self) -> list["Stepper"]:
        return [Stepper(self._build(step, self.closure)) for step in SHORT]

    @cached_property
    def _still(self) -> "Stepper":
        return Stepper(self._build(0.0, self.closure))

    def tree_acceleration(self, t: float, y: Array, dy: Array) -> Array:
        """Return the accelerations (n,) at a tree state: those of a continuous plant, or extrapolated from steps with constraints.

        Raises:
            RunFailure: Drake finds none.
        """
        try:
            if self.closure.kind == BALL:
                return settled_acceleration(self._short_steppers, y, dy)
            return self._still.reported_acceleration(y, dy)
        except RuntimeError as error:
            if isinstance(error, RunFailure):
                raise
            raise RunFailure(Status.ERROR, f"t = {t:.6g} s: Drake: {in_a_sentence(error)}") from error

    def prepare(self, times: Array, native: bool = True) -> None:
        super().prepare(times, native)
        for stretch in self.plan:
            self._runner(stretch.size)
        if not self.is_discrete:
            runner, method = self._runner(0.0), self.choice.integrator
            accuracy, _ = self.choice.tolerances(self.options["accuracy"], 0.0)
            runner.set_integrator(SCHEMES[method], accuracy if method in Drake.adaptive else None)

    def run(self) -> None:
        """Step to every sample and store the tree states.

        Raises:
            RunFailure: Drake gives up.
        """
        y, dy = self.y0, self.dy0
        running: Runner | None = None
        for stretch in self.plan:
            runner = self._runner(stretch.size)
            try:
                if runner is not running:
                    runner.start(y, dy)
                    running = runner
                y, dy = runner.advance(stretch.steps, stretch.size)
            except RuntimeError as error:
                reason = f"Drake stopped after t = {stretch.begin:.6g} s: {in_a_sentence(error)}"
                raise RunFailure(Status.NOT_CONVERGED, reason) from error
            if stretch.row is not None:
                self.y[stretch.row], self.dy[stretch.row] = y, dy

    def count_steps(self) -> int:
        return super().count_steps() if self.is_discrete else self._runner(0.0).integrator_steps

    def read(self) -> Trajectory:
        """Return the samples.

        With constraints, the accelerations of a sample are those of the step that begins there, as Drake reports them: a short
        step would draw the gap that longer steps leave shut at once. The first sample has no gap yet.
        """
        if self.closure.kind != BALL:
            return super().read()
        q, v, _ = self.tree.absolute(self.y, self.dy, np.zeros_like(self.y))
        sizes = {stretch.row: stretch.size for stretch in self.plan}

        def acceleration_of_sample(k: int) -> Array:
            y, dy = self.y[k], self.dy[k]
            if k == 0:
                return self.accelerate(float(self.times[0]), y, dy)
            ddy = Stepper(self._runner(sizes[k]).built).reported_acceleration(y, dy)
            return self.tree.absolute(y, dy, ddy)[2]

        return with_accelerations(self.times, q, v, acceleration_of_sample, self.count_steps())


class Stepper:
    """A plant in a context of its own, which is evaluated at given states and steps from there."""

    def __init__(self, built: Built):
        self.built = built
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
        h = self.built.plant.time_step()
        return (rates[-2] - rates[-3]) / h, (rates[-1] - rates[-2]) / h


class Runner:
    """A simulation of a plant."""

    def __init__(self, drake: Library, built: Built):
        self.drake, self.built = drake, built
        self.simulator: Any = drake.analysis.Simulator(built.system)
        self.root = self.simulator.get_mutable_context()
        self.context = built.connect(self.root)
        self.discrete_step = float(built.plant.time_step())

    def set_integrator(self, scheme: str, accuracy: float | None) -> None:
        """Set the integrator of a continuous plant; with an accuracy it chooses its steps."""
        integrator = self.drake.analysis.ResetIntegratorFromFlags(self.simulator, scheme, LONGEST_STEP)
        integrator.set_fixed_step_mode(accuracy is None)
        if accuracy is not None:
            integrator.set_target_accuracy(accuracy)
        self.integrator, self.fixed = integrator, accuracy is None

    def start(self, y: Array, dy: Array) -> None:
        """Begin at time 0 and a tree state y, dy (n,): no force depends on time."""
        self.root.SetTime(0.0)
        self.built.set_state(self.context, y, dy)
        self.simulator.Initialize()
        self.taken, self.time = 0, 0.0
        if not self.discrete_step:
            self.integrator.ResetStatistics()

    def advance(self, steps: int, step: float) -> tuple[Array, Array]:
        """Take steps of a size [s] and return the tree state y, dy (n,) after them."""
        if self.discrete_step:
            # the product that Drake, too, forms: a sum of steps could end beside the last of them
            self.taken += steps
            self.simulator.AdvanceTo(self.taken * self.discrete_step)
        else:
            if self.fixed:
                self.integrator.set_maximum_step_size(step)
            self.time += steps * step
            self.simulator.AdvanceTo(self.time)
        return self.built.state(self.context)

    @property
    def integrator_steps(self) -> int:
        return int(self.integrator.get_num_steps_taken())


def settled_acceleration(steppers: Sequence[Stepper], y: Array, dy: Array) -> Array:
    """Return the acceleration (n,) that steps of a discrete plant show at a tree state y, dy (n,) with closed loops.

    A step of SAP gives the constraints' points equal velocities where they are at its beginning, which leaves a gap, and takes back
    half of the gap of the step before. From closed loops on, the change of speeds D_k in step k therefore approaches what steps of
    the length h show in a motion, and the rest halves with every step:

        D(h) = 2 D_k - D_(k-1),    a = D(0)

    where D(0) is extrapolated from the lengths h of the steppers, the longest first. A force that Drake treats implicitly changes
    D(h), but not D(0).

    Raises:
        RunFailure: without the shortest steps, the extrapolation gives another acceleration.
    """
    pairs = [stepper.last_changes(y, dy, SETTLING) for stepper in steppers]
    changes = np.array([2 * last - before for before, last in pairs])  # (lengths, n)
    lengths = np.array([stepper.built.plant.time_step() for stepper in steppers])
    found, coarser = extrapolate(lengths, changes), extrapolate(lengths[:-1], changes[:-1])
    change = float(np.abs(found - coarser).max(initial=0.0))
    if not change <= SETTLED * size(found):
        raise RunFailure(Status.NOT_CONVERGED, f"Drake's changes of speed in short steps do not settle: they differ by {change:.1e}")
    return found


def extrapolate(lengths: Array, values: Array) -> Array:
    """Return the value (n,) at 0 of the polynomial through values (k, n) at k lengths."""
    powers = np.vander(lengths / lengths[0], increasing=True)  # of lengths over the first: those in seconds are tiny
    coefficients = np.linalg.solve(powers, values)
    return np.asarray(coefficients[0])
