"""MuJoCo: a tree of links in relative coordinates, closed by soft `connect` constraints between sites.

Before the model is used, its mass matrix, forces and gaps of the loops are compared with those of the suite, at the start and at
random tree states. The softness of the closures is not compared, because the settings vary it.
"""

import contextlib
from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any

import numpy as np

from gauss_bench.engines.base import Choice
from gauss_bench.engines.mjcf.across_releases import disable, mass_matrix
from gauss_bench.engines.mjcf.draft import Draft
from gauss_bench.engines.mjcf.drives import compile_model, find_drives, set_armatures
from gauss_bench.engines.mjcf.forces import refuse_forces
from gauss_bench.engines.mjcf.settings import configure, copy_to_evaluate
from gauss_bench.engines.shared import LibraryEngine, beyond_a_tree, driven_coordinates, finite, joint_tree
from gauss_bench.engines.tree_model import OpenModel, TreeModel, verify
from gauss_bench.mechanism.forces import AppliedForces
from gauss_bench.mechanism.model import Mechanism
from gauss_bench.terms import Array
from gauss_bench.trajectory import RunFailure, Status, Trajectory

AGREEMENT = 1e-10  # relative: rounding causes about 1e-14, a wrong sign or factor about 1


class Mujoco(LibraryEngine, beside=__file__):
    """MuJoCo, with settings that make its closures softer or more rigid."""

    name = "mujoco"
    integrators = ("rk4", "euler", "implicitfast", "discrete")
    native_loop = True
    python_loop = True

    def version(self) -> str:
        import mujoco

        return f"mujoco {mujoco.__version__}"

    def skip(self, mechanism: Mechanism, choice: Choice) -> str | None:
        if reason := beyond_a_tree(mechanism, "MuJoCo"):
            return reason
        tree = joint_tree(mechanism, self.file.options(choice.settings))
        if None in driven_coordinates(mechanism, tree):
            return "MuJoCo can drive a link only if the tree of joints has a pin between this link and the ground"
        return refuse_forces(mechanism, tree)

    def in_python(self, mechanism: Mechanism, choice: Choice) -> str:
        return "motion laws and varying forces, at every stage of a step" if mechanism.drivers or mechanism.varying else ""

    def build(self, mechanism: Mechanism, choice: Choice) -> "MujocoModel":
        return MujocoModel(mechanism, choice)


class MujocoModel(TreeModel):
    """A mechanism in MuJoCo with one integrator and setting.

    Attributes:
        model, data: MuJoCo's model and state that a run steps.
        still, still_data: a copy of both that only evaluates accelerations at given states.
        torque: (n,) sum of the constant generalised forces.
        bodies: MuJoCo's indices of the links' bodies.
        drives: the driven coordinates.
        varying_forces: the forces that vary with time or direction, which Python computes.
        last: latest time [s] at which forces are evaluated in the present stretch (sequence of equal steps), so that a force that
            jumps at the end of the stretch keeps its value from before the jump; infinite before the first run.
        complaints: the warnings of MuJoCo during a run.
    """

    library = "MuJoCo"

    def __init__(self, mechanism: Mechanism, choice: Choice):
        """Compile the model, compare it with the linkage, and then add the drives, whose large armatures change the mass matrix."""
        import mujoco

        super().__init__(mechanism, choice, Mujoco.file.options(choice.settings))
        self.mujoco: Any = mujoco
        draft = Draft(mechanism, self.tree)
        self.model, self.drives = compile_model(mujoco, draft, choice, self.options, driven=False)  # no drives yet
        self.torque, self.bodies = draft.torque, draft.find_bodies(self.model)
        # Trap: without this flag MuJoCo resets a diverging run to the start, and the run would look like a motion.
        disable(mujoco, self.model, ["mjDSBL_AUTORESET"])
        self.still: Any = copy_to_evaluate(mujoco, self.model)  # evaluates single states, and never steps
        self.data: Any = mujoco.MjData(self.model)
        self.still_data: Any = mujoco.MjData(self.still)
        self.still_data.qfrc_applied[:] = self.torque
        self.varying_forces = AppliedForces(replace(mechanism, forces=mechanism.varying, gravity=np.zeros(2)))
        self.last = np.inf
        verify(mechanism, self.tree, self.describe, AGREEMENT)
        self.drives = find_drives(self.model, draft, float(self.options["armature_of_a_driven_hinge_over_inertia"]))
        if self.drives:
            for driven in (self.model, self.still):
                set_armatures(mujoco, driven, self.drives)
                # set_armatures lets MuJoCo compute the inverse weights again, which `configure` had scaled
                configure(mujoco, driven, self.options, choice.step)

    @property
    def sets_forces(self) -> bool:
        """Whether Python sets forces at every stage of a step."""
        return bool(self.drives or self.varying_forces.varying)

    def _set_forces(self, data: Any, t: float) -> None:
        """Set all applied forces at time t [s]: the constant ones (`torque`), those that vary, and those of drives."""
        data.qfrc_applied[:] = self.torque
        if self.varying_forces.varying:
            y, dy = np.array(data.qpos), np.array(data.qvel)
            q, v, _ = self.tree.absolute(y, dy, np.zeros_like(y))
            data.qfrc_applied[:] += self.tree.forces(q, self.varying_forces.generalised(q, v, t))
        for drive in self.drives:
            drive.push(data, t)

    def forward(self, y: Array, dy: Array, t: float = 0.0) -> Any:
        """Evaluate the model `still` at y, dy (n,) and time t [s], with all forces, and return MuJoCo's data."""
        data = self.still_data
        data.qpos[:], data.qvel[:] = y, dy
        self._set_forces(data, t)
        self.mujoco.mj_forward(self.still, data)
        return data

    def describe(self, y: Array, dy: Array) -> OpenModel:
        """Return MuJoCo's quantities for the open tree, without the forces of closures, at a tree state y, dy (n,)."""
        data = self.forward(y, dy)
        mass = mass_matrix(self.mujoco, self.still, data)
        forces = data.qfrc_applied + data.qfrc_passive + data.qfrc_actuator - data.qfrc_bias
        # Trap: rows of closures that cannot open, such as a second pin on a hinge, are missing in data.efc_pos
        first, second = data.site_xpos[self.still.eq_obj1id], data.site_xpos[self.still.eq_obj2id]
        return OpenModel((second - first)[:, :2], mass, forces, positions=np.array(data.xipos[self.bodies])[:, :2])

    def tree_acceleration(self, t: float, y: Array, dy: Array) -> Array:
        return np.array(self.forward(y, dy, t).qacc)

    def prepare(self, times: Array, native: bool = True) -> None:
        super().prepare(times, native)
        self.complaints: list[str] = []
        self.mujoco.mj_resetData(self.model, self.data)
        self.data.time = times[0]
        self.data.qpos[:], self.data.qvel[:] = self.y0, self.dy0
        self.data.qfrc_applied[:] = self.torque

    def run(self) -> None:
        """Take the steps of every stretch in one call of MuJoCo's loop, or in one call for each step, and store the samples."""
        step, model, data = self.mujoco.mj_step, self.model, self.data
        control = self.mujoco.get_mjcb_control()  # MuJoCo has one callback per process: it is restored after the run
        if self.sets_forces:  # MuJoCo calls this function at every stage of a step, with the time of the stage
            self.mujoco.set_mjcb_control(lambda model, data: self._set_forces(data, min(data.time, self.last)))
        try:
            with collect_warnings(self.mujoco, self.complaints):
                for begin, count, size, last, row in self.plan:
                    model.opt.timestep, self.last = size, last
                    if self.mechanism.kinks:
                        data.time = begin  # MuJoCo sums step sizes, so by rounding its time may be before the kink at `begin`
                    if self.native:  # MuJoCo's own loop takes the steps
                        step(model, data, nstep=count)
                    else:
                        for _ in range(count):
                            step(model, data)
                    if row is not None:
                        self.y[row], self.dy[row] = data.qpos, data.qvel
        finally:
            self.mujoco.set_mjcb_control(control)

    def batch(self, q: Array, v: Array, count: int) -> Callable[[], Array]:
        """Return a function that takes `count` steps from each of the k states q, v (k, n), by `mujoco.rollout` on one thread.

        The function returns the last tree states as an array (k, 2, n), with y and dy of each.
        """
        from mujoco import rollout

        if self.sets_forces:
            raise RunFailure(Status.SKIP, "MuJoCo's rollout cannot set forces that vary with time at every stage")
        kinds, data = self.mujoco.mjtState, self.mujoco.MjData(self.model)
        initial = np.zeros((len(q), self.mujoco.mj_stateSize(self.model, kinds.mjSTATE_FULLPHYSICS)))
        tree_state = slice(1, 1 + 2 * self.tree.n)  # MuJoCo's full state is time, qpos, qvel and others, in this order
        initial[:, tree_state] = np.hstack(self.tree.relative(q, v))
        states = np.empty((len(q), count, initial.shape[1]))
        # the only control of the rollout is qfrc_applied, the constant `torque`
        options = {"control_spec": int(kinds.mjSTATE_QFRC_APPLIED), "nstep": count, "state": states}

        def step_all() -> Array:
            with rollout.Rollout(nthread=0) as pool:
                pool.rollout(self.model, [data], initial, self.torque[None, None], **options)
            return states[:, -1, tree_state].reshape(len(q), 2, -1)

        return step_all

    def read(self) -> Trajectory:
        """Return the samples, with notes.

        Raises:
            RunFailure: MuJoCo warned although all samples are finite; the exception holds the samples.
        """
        notes = []
        if self.sets_forces:
            subject = "the motion law is" if self.drives else "forces that vary are"
            notes.append(f"{subject} evaluated in Python at every stage, which takes longer than MuJoCo's own work")
        complaint = [f"MuJoCo: {x}" for x in self.complaints[:1]]
        with collect_warnings(self.mujoco, []):  # warnings about samples of a diverged run are dropped: `judge` rejects such runs
            trajectory = self.trajectory(self.y, self.dy, self.count_steps(), note="; ".join([*notes, *complaint]))
        has_warned = complaint or any(x.number for x in self.data.warning)
        if has_warned and finite(trajectory.q, trajectory.v) == len(self.times):
            sentences = [f"MuJoCo warned before t = {self.times[-1]:.6g} s", *complaint]
            message = "; ".join([*sentences, "a smaller step or another integrator may help"])
            raise RunFailure(Status.WARNING, message, trajectory)
        return trajectory


@contextlib.contextmanager
def collect_warnings(mujoco: Any, complaints: list[str]) -> Iterator[None]:
    """Add MuJoCo's warnings to a list; without this, MuJoCo writes them to a file in the current folder."""
    previous = mujoco.get_mju_user_warning()
    mujoco.set_mju_user_warning(complaints.append)
    try:
        yield
    finally:
        mujoco.set_mju_user_warning(previous)
