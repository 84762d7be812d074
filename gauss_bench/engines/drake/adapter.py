"""Drake: a tree of joints, closed by constraints in discrete plants, or by stiff bushings in discrete or continuous plants.

A plant is Drake's model of a multibody system. Discrete plants take steps of a fixed size, and integrators step continuous plants.
Only the solver SAP of discrete plants handles constraints. A continuous plant accepts a constraint, but fails at the first
evaluation; so loops of continuous plants are closed by bushings. The contact approximations kSap, kSimilar and kLagged and SAP's
near-rigid threshold change no bit of a run without contacts, and kTamsi refuses constraints, so none of them is a knob.

A bushing is a stiff spring and damper, so it exerts no force at a state with exactly closed loops. Drake's accelerations at such a
state are therefore those of the tree without closures. In a simulated motion, they approach those of the linkage only after some
periods of the bushing's vibration.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np

from gauss_bench.engines.base import Choice
from gauss_bench.engines.drake.program import write
from gauss_bench.engines.drake.stepping import HALVINGS, Runner, Stepper, settled_acceleration
from gauss_bench.engines.drake.translate import BALL, OPEN, Built, Closure, explain_refusal, load_library
from gauss_bench.engines.shared import LibraryEngine, beyond_a_tree, joint_tree, unsteady
from gauss_bench.engines.tree import Tree
from gauss_bench.engines.tree_model import OpenModel, TreeModel, verify
from gauss_bench.mechanism.model import Mechanism
from gauss_bench.terms import Array
from gauss_bench.trajectory import RunFailure, Status, Trajectory, in_a_sentence, with_accelerations

SAP = "sap"  # the step of a discrete plant; the other integrators are for continuous plants
ADAPTIVE = "_adaptive"  # ending of the integrators that choose their steps
SCHEMES = {"runge_kutta3": "runge_kutta3", "radau3": "radau3"}  # integrator -> Drake's name of its scheme
SCHEMES |= {f"{name}{ADAPTIVE}": scheme for name, scheme in SCHEMES.items()}
AGREEMENT = 1e-9  # relative: rounding causes about 1e-15, a wrong sign or factor about 1


class Drake(LibraryEngine, beside=__file__):
    """Drake's discrete plants with constraints, and its integrators of continuous plants with bushings."""

    name = "drake"
    integrators = (SAP, *SCHEMES)
    adaptive = tuple(x for x in SCHEMES if x.endswith(ADAPTIVE))
    native_loop = True
    python_loop = False
    resizable = True

    def version(self) -> str:
        from importlib.metadata import version

        load_library()  # fails if the installation is broken
        return f"Drake {version('drake')}"

    def skip(self, mechanism: Mechanism, choice: Choice) -> str | None:
        if reason := beyond_a_tree(mechanism, "Drake") or unsteady(mechanism, "Drake"):
            return reason
        options = self.file.options(choice.settings)
        tree = joint_tree(mechanism, options)
        if tree.closures and options["closure"] == BALL and choice.integrator in SCHEMES:
            return f"Drake supports constraints in discrete plants only: use the integrator {SAP}, or bushings as closures"
        return explain_refusal(mechanism, tree)

    def build(self, mechanism: Mechanism, choice: Choice) -> "DrakeModel":
        return DrakeModel(mechanism, choice)

    def program(self, mechanism: Mechanism, choice: Choice) -> str:
        options = self.file.options(choice.settings)
        tree, scheme = joint_tree(mechanism, options), SCHEMES.get(choice.integrator, "")
        return write(mechanism, tree, choice, choose_closure(tree, options), scheme, choose_accuracy(choice, options))


def choose_closure(tree: Tree, options: Mapping[str, Any]) -> Closure:
    """Return how the options close the pins outside the tree; the kind of closure is OPEN if there are none."""
    kind = options["closure"] if tree.closures else OPEN
    return Closure(kind, options["bushing_period_s"], options["bushing_damping_ratio"])


def choose_accuracy(choice: Choice, options: Mapping[str, Any]) -> float | None:
    """Return the accuracy of an integrator that chooses its steps, or None for steps of equal size."""
    accuracy, _ = choice.tolerances(options["accuracy"], 0.0)
    return accuracy if choice.integrator in Drake.adaptive else None


class DrakeModel(TreeModel):
    """A mechanism in Drake, run with one setting of the engine (`Choice`).

    Attributes:
        closure: how loops are closed; its kind is OPEN if there are no loops.
        is_continuous: whether the plant that is simulated is continuous; it is discrete if the integrator is SAP.
        runners: step size [s], or 0 for a continuous plant -> simulation; a discrete plant has only one step size.
        steppers: step size [s], or 0 for a continuous plant -> plant that is evaluated at given states.
    """

    library = "Drake"

    def __init__(self, mechanism: Mechanism, choice: Choice):
        """Compare the open tree with the linkage, at states at which the loops are open; then build the plants."""
        super().__init__(mechanism, choice, Drake.file.options(choice.settings))
        self.drake = load_library()
        open_tree = Stepper(self._build(0.0, Closure()))  # a continuous plant without closures

        def describe(y: Array, dy: Array) -> OpenModel:
            """Return gaps and accelerations of the open tree at a tree state y, dy (n,), as Drake computes them."""
            accelerations = open_tree.reported_acceleration(y, dy)
            return OpenModel(open_tree.built.gaps(open_tree.context), accelerations=accelerations)

        verify(mechanism, self.tree, describe, AGREEMENT)
        self.closure = choose_closure(self.tree, self.options)
        self.runners: dict[float, Runner] = {}
        self.steppers: dict[float, Stepper] = {}
        self.is_continuous = choice.integrator not in ("", SAP)  # an empty name stands for SAP
        self._get_runner(choice.step)  # builds the plant now, so that a linkage that Drake refuses fails here

    def _build(self, step: float, closure: Closure) -> Built:
        """Return a discrete plant with the given step size [s], or a continuous plant if `step` is 0.

        Raises:
            RunFailure: Drake refuses the linkage.
        """
        try:
            return Built(self.drake, self.mechanism, self.tree, step, closure)
        except (RuntimeError, ValueError) as error:
            raise RunFailure(Status.ERROR, f"Drake cannot build the plant: {in_a_sentence(error)}") from error

    def _get_runner(self, size: float) -> Runner:
        """Return the simulation that takes steps of `size` [s]; a discrete plant is built at the first call for each step size."""
        if self.is_continuous:
            size = 0.0  # one plant for all step sizes
        key = round(size, 15)  # two sizes that differ only by rounding share one plant
        if key not in self.runners:
            self.runners[key] = Runner(self._build(size, self.closure))
        return self.runners[key]

    def _get_stepper(self, size: float) -> Stepper:
        """Return the plant for evaluations at given states, with steps of `size` [s], or continuous if `size` is 0."""
        if size not in self.steppers:
            self.steppers[size] = Stepper(self._build(size, self.closure))
        return self.steppers[size]

    def tree_acceleration(self, t: float, y: Array, dy: Array) -> Array:
        """Return the accelerations (n,) at a tree state y, dy (n,).

        If constraints close the loops, the accelerations are extrapolated from the steps of discrete plants; otherwise a continuous
        plant reports them.
        """
        try:
            if self.closure.kind == BALL:
                divisors = [2**k for k in range(HALVINGS + 1)]
                return settled_acceleration(lambda longest: [self._get_stepper(longest / x) for x in divisors], y, dy)
            return self._get_stepper(0.0).reported_acceleration(y, dy)
        except RunFailure:  # a RuntimeError too
            raise
        except RuntimeError as error:
            raise RunFailure(Status.ERROR, f"t = {t:.6g} s: Drake: {in_a_sentence(error)}") from error

    def prepare(self, times: Array, native: bool = True) -> None:
        """Reset to the start; `native` has no effect, because Drake takes the steps."""
        super().prepare(times, native)
        for stretch in self.plan:
            self._get_runner(stretch.size)  # builds the plant for this step size and keeps it, so that no timed run builds one
        if self.is_continuous:
            self._get_runner(0.0).set_integrator(SCHEMES[self.choice.integrator], choose_accuracy(self.choice, self.options))

    def run(self) -> None:
        # a discrete plant has one step size: when the step size changes, another simulation starts from the present state
        y, dy = self.y0, self.dy0
        running: Runner | None = None
        for stretch in self.plan:
            runner = self._get_runner(stretch.size)
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
        return int(self._get_runner(0.0).integrator.get_num_steps_taken()) if self.is_continuous else super().count_steps()

    def read(self) -> Trajectory:
        """Return the samples with their accelerations.

        If ball constraints close the loops, the accelerations at a sample are those that Drake reports there for a step of the
        run's step size. The steps of a run leave small gaps in the loops, and the next step closes a part of each gap. The shorter
        steps of `tree_acceleration` would close the same part of a gap in a shorter time, so that the accelerations would contain a
        fast motion that the run does not have. At the first sample the loops have no gaps, so `tree_acceleration` is used there.
        """
        if self.closure.kind != BALL:  # no closures, or bushings
            return super().read()
        q, v, _ = self.tree.absolute(self.y, self.dy, np.zeros_like(self.y))
        # index of a sample -> the simulation that took the steps to it; simulation -> its plant, for evaluation
        runners = {stretch.row: self._get_runner(stretch.size) for stretch in self.plan}
        steppers = {runner: Stepper(runner.built) for runner in {*runners.values()}}

        def acceleration_of_sample(k: int) -> Array:
            """Return the absolute accelerations (3 links,) at sample k, as the discrete plant that stepped to it reports them."""
            y, dy = self.y[k], self.dy[k]
            if k == 0:  # no step leads to the first sample
                return self.accelerate(float(self.times[0]), y, dy)
            ddy = steppers[runners[k]].reported_acceleration(y, dy)
            return self.tree.absolute(y, dy, ddy).a

        return with_accelerations(self.times, q, v, acceleration_of_sample, self.count_steps())
