"""MJX: MuJoCo's tree of links and soft `connect` constraints between sites, computed in JAX on one processor core.

The model is that of `engines/mjcf`, so this is a comparison of two programs for one model. MJX's own terms are compared with the
suite's before they are used: mass matrix, velocity terms plus all forces, and gaps of the loops, at tree states with open loops.

Trap: MJX leaves out the velocity term of a closure, which the softness must then make up for: with the reference acceleration r of
a constraint J a = r,

    MuJoCo    r = gamma - b J v - k phi        gamma = - dJ/dt v
    MJX       r =       - b J v - k phi

Accelerations at rest agree, those at a speed do not, and errors of a motion fall with the step only as far as k and b do.
"""

from pathlib import Path

from gauss_bench.engines.base import Choice
from gauss_bench.engines.mjcf.draft import Draft
from gauss_bench.engines.mjcf.forces import native_forces
from gauss_bench.engines.mjx.compiled import INTEGRATORS, compile_model
from gauss_bench.engines.mjx.program import write
from gauss_bench.engines.mjx.xla import Device, load_libraries
from gauss_bench.engines.shared import beyond_a_tree, joint_tree, undriven, unsteady
from gauss_bench.engines.tree_model import OpenModel, TreeModel, verify
from gauss_bench.engines.variants import read_variants
from gauss_bench.mechanism.model import Mechanism
from gauss_bench.terms import Array
from gauss_bench.trajectory import RunFailure, Status

VARIANTS = read_variants(Path(__file__).parent)

AGREEMENT = 1e-10  # relative: rounding causes about 1e-14, a wrong sign or factor about 1


class Mjx:
    """MJX with MuJoCo's integrators and settings, as far as it has them."""

    name = "mjx"
    integrators = tuple(INTEGRATORS)
    stabilizations = ("none",)
    settings = VARIANTS.settings
    variants, knobs, first = VARIANTS.space, VARIANTS.knobs, VARIANTS.first
    soft, unfinished = VARIANTS.soft, VARIANTS.unfinished
    native_loop = True
    python_loop = True
    resizable = True  # a built model can run with another step
    packages = ("mujoco-mjx", "mujoco", "jax")

    def version(self) -> str:
        from importlib.metadata import version

        return f"mujoco-mjx {version('mujoco-mjx')} (mujoco {version('mujoco')}, jax {version('jax')})"

    def skip(self, mechanism: Mechanism, choice: Choice) -> str | None:
        tree = joint_tree(mechanism, VARIANTS.options(choice.settings))
        of_joints = beyond_a_tree(mechanism, "MJX") or unsteady(mechanism, "MJX")
        if reason := of_joints or undriven(mechanism, tree, "MJX", any_law=False):  # it calls nothing at the stages of a step
            return reason
        try:
            native_forces(mechanism, tree)
        except RunFailure as failure:
            return str(failure)
        return None

    def in_python(self, mechanism: Mechanism, choice: Choice) -> str:
        return ""

    def build(self, mechanism: Mechanism, choice: Choice) -> "MjxModel":
        return MjxModel(mechanism, choice)

    def program(self, mechanism: Mechanism, choice: Choice) -> str:
        return write(mechanism, choice, VARIANTS.options(choice.settings))


class MjxModel(TreeModel):
    """A mechanism in MJX under one integrator and setting.

    Attributes:
        choice: may be given another step before `prepare`.
        draft: the specification from which MuJoCo's model is compiled.
        sized: the step [s] that the numbers on the device are for.
    """

    library = "MJX"

    def __init__(self, mechanism: Mechanism, choice: Choice):
        super().__init__(mechanism, choice, VARIANTS.options(choice.settings))
        self.libraries = load_libraries()
        try:
            self.draft = Draft(self.libraries.mujoco, mechanism, self.tree)
            self.device = Device(
                self.libraries, compile_model(self.libraries.mujoco, self, choice.step, driven=False)[0], self.draft.torque
            )
        except (ValueError, NotImplementedError) as error:
            raise RunFailure(Status.ERROR, f"MJX cannot take the model: {error}") from error
        self.bodies = [self.draft.bodies[i].id for i in range(len(mechanism.links))]
        verify(mechanism, self.tree, self.describe, AGREEMENT)
        self._size(choice.step)

    def _size(self, step: float) -> None:
        """Put the numbers for steps of `step` [s] on the device: those of closures may depend on it."""
        self.device.set(compile_model(self.libraries.mujoco, self, step)[0])
        self.sized = step

    def describe(self, y: Array, dy: Array) -> OpenModel:
        """Return what MJX says of the tree at a tree state y, dy (n,), without drives; the forces of its closures are left out."""
        x = self.device.evaluate(y, dy)
        return OpenModel(-x.gaps[:, :2], x.mass, x.forces, positions=x.centres[self.bodies][:, :2])  # gaps: a minus b

    def tree_acceleration(self, t: float, y: Array, dy: Array) -> Array:
        return self.device.evaluate(y, dy).acceleration

    def prepare(self, times: Array, native: bool = True) -> None:
        super().prepare(times, native)
        if self.choice.step != self.sized:
            self._size(self.choice.step)
        self.models = {stretch.size: self.device.with_step(stretch.size) for stretch in self.plan}
        self.state = self.device.start(self.y0, self.dy0, float(times[0]))
        for model in self.models.values():  # compiles the loop unless it is compiled already
            self.device.take_steps(model, self.state, 0)

    def run(self) -> None:
        take_steps, state = self.device.take_steps, self.state
        for stretch in self.plan:
            model = self.models[stretch.size]
            if self.native:
                state = take_steps(model, state, stretch.steps)
            else:
                for _ in range(stretch.steps):
                    state = take_steps(model, state, 1)
            if stretch.row is not None:
                self.y[stretch.row], self.dy[stretch.row] = self.device.tree_state(state)
