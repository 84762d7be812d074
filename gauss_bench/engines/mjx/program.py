"""Write a program for MJX: the model as MJCF, which MuJoCo compiles, and a loop in JAX that takes MJX's steps."""

from collections.abc import Mapping
from typing import Any
from xml.etree.ElementTree import indent, tostring

from gauss_bench.engines.base import Choice
from gauss_bench.engines.mjcf.document import write_document
from gauss_bench.engines.mjcf.draft import Draft
from gauss_bench.engines.mjcf.drives import compile_model
from gauss_bench.engines.mjcf.settings import copy_to_evaluate
from gauss_bench.engines.programs import write_tree_program
from gauss_bench.engines.shared import joint_tree
from gauss_bench.engines.transcript import Script
from gauss_bench.mechanism.model import Mechanism
from gauss_bench.terms import Array

IMPORTS = ("import jax", "import mujoco", "from mujoco import mjx")
MODEL = """jax.config.update("jax_platforms", "cpu")
jax.config.update("jax_enable_x64", True)
model = mujoco.MjModel.from_xml_string(MJCF)
for joint, armature in DRIVES:  # far above all masses, so that the joint keeps its speed
    model.dof_armature[joint] = armature
if DRIVES:
    mujoco.mj_setConst(model, mujoco.MjData(model))
model.body_invweight0[:] *= INVERSE_WEIGHTS  # makes closures rigid; a factor 1 keeps the softness that MuJoCo compiled
model.opt.timestep = step
if SOLREF_IN_STEPS:
    model.eq_solref[:, 0] = SOLREF_IN_STEPS * step
data, twist = mujoco.MjData(model), np.empty(6)
mujoco.mj_resetDataKeyframe(model, data, 0)
device, state = mjx.put_model(model), mjx.put_data(model, data)

def take_step(_, old):  # with tendons MJX returns integers of another size, which JAX's loop refuses
    return jax.tree.map(lambda new, kept: new.astype(kept.dtype), mjx.step(device, old), old)

advance = jax.jit(lambda state: jax.lax.fori_loop(0, every, take_step, state))
bodies = [model.body(name).id for name in BODIES]"""
RUN = """    for k in range(every, steps + 1, every):
        state = advance(state)
        data.qpos[:], data.qvel[:] = state.qpos, state.qvel
        for look in (mujoco.mj_kinematics, mujoco.mj_comPos, mujoco.mj_comVel):
            look(model, data)
        speeds = []
        for body in bodies:
            mujoco.mj_objectVelocity(model, data, mujoco.mjtObj.mjOBJ_BODY, body, twist, 0)
            speeds.append([*twist[3:]])
        rows.append([k * step, *absolute(data.qpos, data.qvel, [data.xipos[body] for body in bodies], speeds)])
"""


class OnMujoco:
    """The model that MJX gets, evaluated by MuJoCo itself; it has the members of `Built` in `engines/mjcf/document.py`."""

    def __init__(self, mujoco: Any, mechanism: Mechanism, choice: Choice, options: Mapping[str, Any]):
        self.mujoco, self.mechanism, self.choice, self.options = mujoco, mechanism, choice, options
        self.tree = joint_tree(mechanism, options)
        self.y0, self.dy0 = self.tree.relative(mechanism.q0, mechanism.v0)
        self.draft = Draft(mechanism, self.tree)
        self.model, self.drives = compile_model(mujoco, self.draft, choice, options)
        self.still = copy_to_evaluate(mujoco, self.model)

    def forward(self, y: Array, dy: Array) -> Any:
        """Return MuJoCo's data, with the accelerations, evaluated at a tree state y, dy (n,)."""
        data = self.mujoco.MjData(self.still)
        data.qpos[:], data.qvel[:], data.qfrc_applied[:] = y, dy, self.draft.torque
        self.mujoco.mj_forward(self.still, data)
        return data


def write(mechanism: Mechanism, choice: Choice, options: Mapping[str, Any]) -> str:
    """Return the text of a program that runs a mechanism.

    Raises:
        RunFailure: MJCF cannot express the mechanism, or MuJoCo's model of the document differs.
        ImportError: MuJoCo is not installed.
    """
    import mujoco

    built = OnMujoco(mujoco, mechanism, choice, options)
    root = write_document(built, edited=True).root
    indent(root)
    lines = tostring(root, encoding="unicode").splitlines(keepends=True)
    text = "\n".join(["(", *(f"    {line!a}" for line in lines), ")"])  # Python source of a string, one line for each line of MJCF
    numbers = {
        "MJCF": Script({}).stand_in(text),
        "BODIES": [built.draft.bodies[i].attrib["name"] for i in range(len(mechanism.links))],
        "DRIVES": [[x.at, x.armature] for x in built.drives],
        "INVERSE_WEIGHTS": float(options["body_invweight0_factor"]),
        "SOLREF_IN_STEPS": float(options["solref"][0]) if options["solref_unit"] == "step" else 0.0,
    }
    return write_tree_program(mechanism, built.tree, choice, imports=IMPORTS, numbers=numbers, model=MODEL.splitlines(), run=RUN)
