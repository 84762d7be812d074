"""A Python script for MuJoCo: the MJCF of `to_mjcf`, what no document can set, and a run."""

from xml.etree.ElementTree import indent, tostring

import numpy as np

from gauss_bench.engines.base import Choice
from gauss_bench.exchange.laws import law_functions, law_names
from gauss_bench.exchange.scripts import HEADING, MAIN, PLAN, constants
from gauss_bench.exchange.text import python_comment, python_value
from gauss_bench.mechanism.model import Mechanism

IMPORTS = """import math

import mujoco
import numpy as np

"""
ARMATURES = """for joint, armature, _ in DRIVES:  # far beyond all masses: a torque of armature law''(t) moves it as its law says
    model.dof_armature[joint] = armature
for tendon, _, mass, _ in CYLINDERS:  # lengths: the same with a tendon and its motor
    model.tendon_armature[tendon] = mass
mujoco.mj_setConst(model, mujoco.MjData(model))
"""
DRIVING = """

def drive(model, data):
    for joint, armature, law in DRIVES:
        data.qfrc_applied[joint] = armature * law(data.time)[2]
    for _, motor, mass, law in CYLINDERS:
        data.ctrl[motor] = mass * law(data.time)[2]


mujoco.set_mjcb_control(drive)  # is called at every stage of a step
"""
RUN = '''
model = mujoco.MjModel.from_xml_string(MJCF)
{armatures}model.body_invweight0[:] *= INVERSE_WEIGHTS  # which makes closures rigid; 1 leaves them as MuJoCo has compiled them
model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_AUTORESET)  # a reset would pass for a motion
bodies = [model.body(name).id for name in BODIES]


def state(seen, qpos, qvel):
    """q and v of the links."""
    seen.qpos[:], seen.qvel[:] = qpos, qvel
    for look in (mujoco.mj_kinematics, mujoco.mj_comPos, mujoco.mj_comVel):
        look(model, seen)
    q, v, twist = np.empty(3 * len(bodies)), np.empty(3 * len(bodies)), np.empty(6)
    q[2::3] = ANGLES + TURNS @ qpos
    for k, body in enumerate(bodies):
        mujoco.mj_objectVelocity(model, seen, mujoco.mjtObj.mjOBJ_BODY, body, twist, 0)
        q[3 * k : 3 * k + 2], v[3 * k : 3 * k + 3] = seen.xipos[body][:2], [twist[3], twist[4], twist[2]]
    return q, v


def simulate(end=END, step=STEP):
    """Rows [t, *q, *v] at equally spaced times."""
    steps, every = plan(end, step)
    model.opt.timestep = end / steps
    model.eq_solref[:, 0] *= 0 if SOLREF_IN_STEPS else 1
    model.eq_solref[:, 0] += SOLREF_IN_STEPS * model.opt.timestep
    data, seen = mujoco.MjData(model), mujoco.MjData(model)  # a step is not to know that it was looked at
    mujoco.mj_resetDataKeyframe(model, data, 0)
    rows = [[0.0, *Q0, *V0]]
    for k in range(steps):
        mujoco.mj_step(model, data)
        if (k + 1) % every == 0:
            q, v = state(seen, data.qpos, data.qvel)
            rows.append([(k + 1) * model.opt.timestep, *q, *v])
    return rows
'''


def write_mujoco(mechanism: Mechanism, choice: Choice, head: list[str]) -> str:
    """The script.

    Raises:
        RunFailure: MuJoCo cannot be given the mechanism.
        ImportError: MuJoCo is not installed.
    """
    from gauss_bench.engines.mujoco.adapter import VARIANTS, MujocoModel
    from gauss_bench.engines.mujoco.mjcf import mjcf

    root, built = mjcf(mechanism, choice, edited=True), MujocoModel(mechanism, choice)
    indent(root)
    lines = "\n".join(f"    {line!a}" for line in tostring(root, encoding="unicode").splitlines(keepends=True))
    options, tree = VARIANTS.options(choice.settings), built.tree
    names = law_names(mechanism.drivers)
    drives = ", ".join(f"({k}, {armature!r}, {names[id(law)]})" for k, armature, law in built.drives)
    driven = zip(built.drawn, built.cylinders, strict=True)
    cylinders = ", ".join(f"({tendon}, {motor}, {mass!r}, {names[id(law)]})" for (tendon, motor), (_, mass, law) in driven)
    none, unit = np.zeros(tree.n), np.eye(tree.n)
    angles = tree.absolute(none, none, none)[0][2::3]
    turns = tree.absolute(np.zeros_like(unit), unit, np.zeros_like(unit))[1][:, 2::3].T
    told = [*head, f"Settings: {choice.settings}, {choice.integrator}. Bodies are links; connect constraints close the loops."]
    named = {
        "BODIES": [built.model.body(k).name for k in built.bodies],
        "ANGLES": angles,
        "TURNS": turns,
        "INVERSE_WEIGHTS": float(options["body_invweight0_factor"]),
        "SOLREF_IN_STEPS": float(options["solref"][0]) if options["solref_unit"] == "step" else 0.0,
    }
    arrays = ("ANGLES", "TURNS")
    values = [f"{k} = np.array({python_value(x)})" if k in arrays else f"{k} = {python_value(x)}" for k, x in named.items()]
    values += [f"DRIVES, CYLINDERS = [{drives}], [{cylinders}]"] if names else []
    run = RUN.replace("{armatures}", ARMATURES if names else "") + (DRIVING if names else "")
    laws = law_functions(mechanism.drivers)
    given = constants(mechanism, choice) + laws + "\n" * bool(laws) + "\n".join(values) + f"\nMJCF = (\n{lines}\n)\n"
    return "".join([HEADING, python_comment(told), "\n", IMPORTS, given, run, PLAN, MAIN])
