"""MJX: MuJoCo's tree of links and soft `connect` constraints between sites, computed in JAX on one processor core.

The model is that of `engines/mjcf`, which the engine `mujoco` runs too.

Trap: MJX leaves out the velocity term gamma = -dJ/dt v of a closure. A closure is the constraint J a = r, where r is the reference
acceleration:

    MuJoCo:   r = gamma - b J v - k phi
    MJX:      r = -b J v - k phi

The accelerations of MJX and MuJoCo agree at rest, but not in motion: in MJX only the spring k and the damper b keep the loops
closed. So the errors of a motion become smaller with the step size only if k and b become larger.
"""

from gauss_bench.engines.base import Choice
from gauss_bench.engines.mjcf.draft import Draft
from gauss_bench.engines.mjcf.drives import compile_model
from gauss_bench.engines.mjcf.forces import refuse_forces
from gauss_bench.engines.mjx.program import write
from gauss_bench.engines.mjx.xla import Device, load_libraries
from gauss_bench.engines.shared import LibraryEngine, beyond_a_tree, joint_tree, undriven, unsteady
from gauss_bench.engines.tree_model import OpenModel, TreeModel, verify
from gauss_bench.mechanism.model import Mechanism
from gauss_bench.terms import Array
from gauss_bench.trajectory import RunFailure, Status

AGREEMENT = 1e-10  # relative: rounding causes about 1e-14, a wrong sign or factor about 1


class Mjx(LibraryEngine, beside=__file__):
    """MJX, with the integrators and settings of MuJoCo that MJX supports."""

    name = "mjx"
    integrators = ("rk4", "euler", "implicitfast")
    native_loop = True
    python_loop = True
    resizable = True  # a built model can run with another step
    packages = ("mujoco-mjx", "mujoco", "jax")

    def version(self) -> str:
        from importlib.metadata import version

        return f"mujoco-mjx {version('mujoco-mjx')} (mujoco {version('mujoco')}, jax {version('jax')})"

    def skip(self, mechanism: Mechanism, choice: Choice) -> str | None:
        tree = joint_tree(mechanism, self.file.options(choice.settings))
        if reason := beyond_a_tree(mechanism, "MJX") or unsteady(mechanism, "MJX"):
            return reason
        # constant speeds only, because MJX cannot call Python at the stages of a step
        return undriven(mechanism, tree, "MJX", any_law=False) or refuse_forces(mechanism, tree)

    def build(self, mechanism: Mechanism, choice: Choice) -> "MjxModel":
        return MjxModel(mechanism, choice)

    def program(self, mechanism: Mechanism, choice: Choice) -> str:
        return write(mechanism, choice, self.file.options(choice.settings))


class MjxModel(TreeModel):
    """A mechanism in MJX under one integrator and setting.

    Attributes:
        draft: the document from which MuJoCo compiles the model.
        uploaded_step: step [s] for which the numbers on the device were computed.
        bodies: MuJoCo's indices of the links' bodies.
    """

    library = "MJX"

    def __init__(self, mechanism: Mechanism, choice: Choice):
        """Compile the model without drivers, compare it with the linkage, and then compile it with drivers for the chosen step."""
        super().__init__(mechanism, choice, Mjx.file.options(choice.settings))
        self.libraries = load_libraries()
        try:
            self.draft = Draft(mechanism, self.tree)
            model, _ = compile_model(self.libraries.mujoco, self.draft, choice, self.options, driven=False)
            self.device = Device(self.libraries, model, self.draft.torque)
        except (ValueError, NotImplementedError) as error:
            raise RunFailure(Status.ERROR, f"MJX cannot take the model: {error}") from error
        self.bodies = self.draft.find_bodies(model)
        verify(mechanism, self.tree, self.describe, AGREEMENT)
        self._upload_for_step()

    def _upload_for_step(self) -> None:
        """Compile the model with its drives for the chosen step, on which the softness of closures may depend, and upload it."""
        model, _ = compile_model(self.libraries.mujoco, self.draft, self.choice, self.options)
        self.device.set(model)
        self.uploaded_step = self.choice.step

    def describe(self, y: Array, dy: Array) -> OpenModel:
        """Return MJX's quantities for the open tree without drivers at a tree state y, dy (n,)."""
        x = self.device.evaluate(y, dy)
        return OpenModel(-x.gaps[:, :2], x.mass, x.forces, positions=x.centres[self.bodies][:, :2])  # MJX's gaps are a minus b

    def tree_acceleration(self, t: float, y: Array, dy: Array) -> Array:
        return self.device.evaluate(y, dy).acceleration

    def prepare(self, times: Array, native: bool = True) -> None:
        """Reset to the start; if `native`, a compiled loop of JAX takes the steps, otherwise Python calls JAX for each step."""
        super().prepare(times, native)
        if self.choice.step != self.uploaded_step:
            self._upload_for_step()
        self.models = {stretch.size: self.device.with_step(stretch.size) for stretch in self.plan}
        self.state = self.device.start(self.y0, self.dy0, float(times[0]))
        for model in self.models.values():  # the first call compiles the loop, and so must not be timed
            self.device.take_steps(model, self.state, 0)

    def run(self) -> None:
        take_steps, state = self.device.take_steps, self.state
        for stretch in self.plan:
            model = self.models[stretch.size]
            calls, steps = (1, stretch.steps) if self.native else (stretch.steps, 1)  # one call for all steps, or one for each
            for _ in range(calls):
                state = take_steps(model, state, steps)
            if stretch.row is not None:
                self.y[stretch.row], self.dy[stretch.row] = self.device.tree_state(state)
