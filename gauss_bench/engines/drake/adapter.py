"""Drake: a tree of joints, closed by constraints in discrete plants, or by stiff bushings in discrete or continuous plants.

A plant is Drake's model of a multibody system. Discrete plants take steps of a fixed size, and integrators step continuous plants.
Only the solver SAP of discrete plants handles constraints. A continuous plant accepts a constraint, but fails at the first
evaluation; so loops of continuous plants are closed by bushings. SAP's contact approximations kSap, kSimilar and kLagged and its
near-rigid threshold change no bit of a run without contacts, and kTamsi refuses constraints, so none of them is a knob.

A bushing is a stiff spring and damper, so it exerts no force at a state with exactly closed loops. Drake's accelerations at a state
with exactly closed loops are therefore those of the tree without closures. In a simulated motion, the accelerations approach those
of the linkage with exactly closed loops only after some periods of the bushing's vibration.

Before Drake's tree is used, its accelerations are compared with those that the suite computes, at states at which loops are open.
"""

from collections.abc import Mapping
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from gauss_bench.engines.base import Choice
from gauss_bench.engines.drake.program import write
from gauss_bench.engines.drake.stepping import HALVINGS, ContinuousRunner, Runner, Stepper, settled_acceleration
from gauss_bench.engines.drake.translate import BALL, OPEN, Builder, Built, Closure, gaps, load_library, refusal
from gauss_bench.engines.shared import LibraryEngine, beyond_a_tree, joint_tree, unsteady
from gauss_bench.engines.tree import Tree
from gauss_bench.engines.tree_model import OpenModel, TreeModel, verify
from gauss_bench.engines.variants import read_variants
from gauss_bench.mechanism.model import Mechanism
from gauss_bench.terms import Array
from gauss_bench.trajectory import RunFailure, Status, Trajectory, in_a_sentence, with_accelerations

VARIANTS = read_variants(Path(__file__).parent)
SAP = "sap"  # the step of a discrete plant; the other integrators are for continuous plants
ADAPTIVE = "_adaptive"  # ending of the integrators that choose their steps
SCHEMES = {"runge_kutta3": "runge_kutta3", "radau3": "radau3"}  # integrator -> Drake's name of its scheme
SCHEMES |= {f"{name}{ADAPTIVE}": scheme for name, scheme in SCHEMES.items()}
AGREEMENT = 1e-9  # relative: rounding causes about 1e-15, a wrong sign or factor about 1


class Drake(LibraryEngine, file=VARIANTS):
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
        """Return the reason why Drake cannot run a mechanism with a given setting, or None if it can."""
        if reason := beyond_a_tree(mechanism, "Drake") or unsteady(mechanism, "Drake"):
            return reason
        options = VARIANTS.options(choice.settings)
        tree = joint_tree(mechanism, options)
        if tree.closures and options["closure"] == BALL and choice.integrator in SCHEMES:
            return f"Drake supports constraints in discrete plants only: use the integrator {SAP}, or bushings as closures"
        return refusal(mechanism, tree)

    def build(self, mechanism: Mechanism, choice: Choice) -> "DrakeModel":
        return DrakeModel(mechanism, choice)

    def program(self, mechanism: Mechanism, choice: Choice) -> str:
        """Return a Python program that runs the mechanism in Drake; only integrators that choose their steps have an accuracy."""
        options = VARIANTS.options(choice.settings)
        tree = joint_tree(mechanism, options)
        accuracy = choice.tolerances(options["accuracy"], 0.0)[0] if choice.integrator in Drake.adaptive else None
        return write(mechanism, tree, choice, choose_closure(tree, options), SCHEMES.get(choice.integrator, ""), accuracy)


def choose_closure(tree: Tree, options: Mapping[str, Any]) -> Closure:
    """Return how the pins that are no joints of the tree are closed, according to the options of the engine."""
    kind = options["closure"] if tree.closures else OPEN
    return Closure(kind, options["bushing_period_s"], options["bushing_damping_ratio"])


class DrakeModel(TreeModel):
    """A mechanism in Drake, run with one setting of the engine (`Choice`).

    Attributes:
        closure: how loops are closed; the kind of closure is OPEN if there are no loops.
        runners: step size [s] -> simulation of a discrete plant; a discrete plant has only one step size.
        steppers: longest step [s] -> list of `Stepper`, one for each of several discrete plants with this step and shorter ones.
        continuous: simulation of a continuous plant; None if the integrator is SAP.
    """

    library = "Drake"

    def __init__(self, mechanism: Mechanism, choice: Choice):
        """Build the plants, after the open tree has been compared with the linkage."""
        super().__init__(mechanism, choice, VARIANTS.options(choice.settings))
        self.drake = load_library()
        self.builder = Builder(self.drake, mechanism, self.tree)
        open_tree = Stepper(self._build(0.0, Closure()))  # a continuous plant without closures
        verify(mechanism, self.tree, lambda y, dy: self._describe(open_tree, y, dy), AGREEMENT)
        self.closure = choose_closure(self.tree, self.options)
        self.runners: dict[float, Runner] = {}
        self.steppers: dict[float, list[Stepper]] = {}
        self.continuous: ContinuousRunner | None = None
        if (choice.integrator or SAP) != SAP:  # an empty name stands for SAP
            self.continuous = ContinuousRunner(self.drake, self._build(0.0, self.closure))
        self._runner(choice.step)  # builds the discrete plant now, so that a linkage that Drake refuses fails here

    def _build(self, step: float, closure: Closure) -> Built:
        """Return a discrete plant with the given step size [s], or a continuous plant if `step` is 0.

        Raises:
            RunFailure: Drake refuses the linkage.
        """
        try:
            return self.builder.build(step, closure)
        except (RuntimeError, ValueError) as error:
            raise RunFailure(Status.ERROR, f"Drake cannot build the plant: {in_a_sentence(error)}") from error

    def _describe(self, open_tree: Stepper, y: Array, dy: Array) -> OpenModel:
        """Return gaps and accelerations of the open tree at a tree state y, dy (n,), by Drake's own kinematics and dynamics."""
        accelerations = open_tree.reported_acceleration(y, dy)
        return OpenModel(gaps(open_tree.built, open_tree.context), accelerations=accelerations)

    def _runner(self, size: float) -> Runner:
        """Return the simulation that takes steps of `size` [s]; a discrete plant is built at the first call for each step size."""
        if self.continuous:
            return self.continuous  # a continuous plant serves for all step sizes
        key = round(size, 15)  # two sizes that differ only by rounding share one plant
        if key not in self.runners:
            self.runners[key] = Runner(self.drake, self._build(size, self.closure))
        return self.runners[key]

    def _short_steppers(self, longest: float) -> list[Stepper]:
        """Return HALVINGS + 1 steppers: the first has the step size `longest` [s], each other one half that of its predecessor.

        The steppers are built at the first call with the value `longest`, and stored in `self.steppers`.
        """
        if longest not in self.steppers:
            lengths = [longest / 2**k for k in range(HALVINGS + 1)]
            self.steppers[longest] = [Stepper(self._build(x, self.closure)) for x in lengths]
        return self.steppers[longest]

    @cached_property
    def _still(self) -> Stepper:
        """A continuous plant that only evaluates accelerations at given states."""
        return Stepper(self._build(0.0, self.closure))

    def tree_acceleration(self, t: float, y: Array, dy: Array) -> Array:
        """Return the accelerations (n,) at a tree state y, dy (n,).

        If constraints close the loops, the accelerations are extrapolated from the steps of discrete plants; otherwise a continuous
        plant reports them.

        Raises:
            RunFailure: Drake finds no accelerations.
        """
        try:
            if self.closure.kind == BALL:
                return settled_acceleration(self._short_steppers, y, dy)
            return self._still.reported_acceleration(y, dy)
        except RunFailure:  # is a RuntimeError too
            raise
        except RuntimeError as error:
            raise RunFailure(Status.ERROR, f"t = {t:.6g} s: Drake: {in_a_sentence(error)}") from error

    def prepare(self, times: Array, native: bool = True) -> None:
        """Reset to the start, and build all plants that the run needs; `native` has no effect, because Drake takes the steps."""
        super().prepare(times, native)
        for stretch in self.plan:
            self._runner(stretch.size)  # builds the plant for this step size and keeps it, so that no timed run builds one
        if self.continuous:
            name = self.choice.integrator
            accuracy, _ = self.choice.tolerances(self.options["accuracy"], 0.0)
            self.continuous.set_integrator(self.drake, SCHEMES[name], accuracy if name in Drake.adaptive else None)

    def run(self) -> None:
        """Step to every sample and store the tree states.

        Raises:
            RunFailure: Drake gives up.
        """
        # a runner has one step size; another runner starts from the present state when the step size changes
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
        return self.continuous.count_steps() if self.continuous else super().count_steps()

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
        # index of a sample -> the simulation that took the steps to this sample; and simulation -> evaluator of its plant
        runners = {stretch.row: self._runner(stretch.size) for stretch in self.plan}
        steppers = {runner: Stepper(runner.built) for runner in {*runners.values()}}

        def acceleration_of_sample(k: int) -> Array:
            """Return the absolute accelerations (3 links,) at sample k, as the discrete plant that stepped to it reports them."""
            y, dy = self.y[k], self.dy[k]
            if k == 0:  # no step leads to the first sample
                return self.accelerate(float(self.times[0]), y, dy)
            ddy = steppers[runners[k]].reported_acceleration(y, dy)
            return self.tree.absolute(y, dy, ddy).a

        return with_accelerations(self.times, q, v, acceleration_of_sample, self.count_steps())
