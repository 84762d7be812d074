"""A document as MuJoCo's own compiler reads it: defaults, classes, frames and masses of shapes worked out, as plain data."""

from typing import Any

import numpy as np

FIELDS = """
body_parentid body_mass body_gravcomp body_mocapid
jnt_type jnt_bodyid jnt_stiffness jnt_stiffnesspoly jnt_springyield jnt_limited jnt_qposadr jnt_dofadr qpos0 qpos_spring
dof_armature dof_damping dof_dampingpoly dof_frictionloss
eq_type eq_objtype eq_obj1id eq_obj2id eq_active0 eq_data
tendon_adr tendon_num tendon_stiffness tendon_stiffnesspoly tendon_damping tendon_dampingpoly tendon_springyield
tendon_lengthspring tendon_limited tendon_frictionloss tendon_armature wrap_type wrap_objid wrap_prm
actuator_trntype actuator_trnid actuator_gear actuator_dyntype actuator_gaintype actuator_gainprm actuator_biastype
actuator_biasprm actuator_ctrllimited actuator_ctrlrange actuator_forcelimited actuator_actnum actuator_armature
actuator_damping actuator_dampingpoly
site_bodyid geom_contype geom_conaffinity key_qpos key_qvel key_ctrl
"""
COUNTED = {  # kind -> how many there are, and the object's name
    "body": ("nbody", "mjOBJ_BODY"),
    "jnt": ("njnt", "mjOBJ_JOINT"),
    "site": ("nsite", "mjOBJ_SITE"),
    "eq": ("neq", "mjOBJ_EQUALITY"),
    "tendon": ("ntendon", "mjOBJ_TENDON"),
    "actuator": ("nu", "mjOBJ_ACTUATOR"),
    "key": ("nkey", "mjOBJ_KEY"),
}
OTHERS = ("nflex", "nplugin", "nsensor", "npair")
TYPES = {  # kind -> the enumeration whose numbers tell sorts of it apart
    "jnt": "mjtJoint",
    "eq": "mjtEq",
    "wrap": "mjtWrap",
    "trn": "mjtTrn",
    "gain": "mjtGain",
    "bias": "mjtBias",
    "dyn": "mjtDyn",
}


class DoesNotCompile(ValueError):
    """MuJoCo refuses a document; the message is its own."""


def compile_document(text: str) -> dict[str, Any]:
    """Fields of the compiled model, names by kind, and where everything is at qpos0.

    Beside FIELDS: `xpos`, `xmat`, `xipos`, `inertia` (3, 3 in world axes) of bodies, `xanchor`, `xaxis` of joints, `site_xpos`,
    `site_xmat`; `names` by kind; `types`, the words for numbers of joints, equalities, tendon parts, transmissions, gains and
    biases; `gravity`, `medium` (density, viscosity) and `disabled`.

    Raises:
        DoesNotCompile: MuJoCo refuses the document.
        ImportError: MuJoCo is not installed.
    """
    import mujoco

    try:
        model = mujoco.MjModel.from_xml_string(text)
        data = mujoco.MjData(model)
    except ValueError as error:
        raise DoesNotCompile(str(error)) from error
    except (MemoryError, RuntimeError) as error:  # the latter knows no more than "an unknown exception"
        raise DoesNotCompile("its compiler failed, as it does where memory does not suffice") from error
    mujoco.mj_kinematics(model, data)
    turns = np.array(data.ximat).reshape(-1, 3, 3)
    placed = {
        "xpos": np.array(data.xpos),
        "xmat": np.array(data.xmat).reshape(-1, 3, 3),
        "xipos": np.array(data.xipos),
        "inertia": np.einsum("kij,kj,klj->kil", turns, np.array(model.body_inertia), turns),
        "xanchor": np.array(data.xanchor),
        "xaxis": np.array(data.xaxis),
        "site_xpos": np.array(data.site_xpos),
        "site_xmat": np.array(data.site_xmat).reshape(-1, 3, 3),
    }

    def name(kind: str, k: int) -> str:
        return mujoco.mj_id2name(model, int(getattr(mujoco.mjtObj, COUNTED[kind][1])), k) or ""

    def words(enumeration: str) -> dict[str, str]:
        return {str(int(x)): name.partition("_")[2].lower() for name, x in getattr(mujoco, enumeration).__members__.items()}

    flags = {key.removeprefix("mjDSBL_").lower(): x for key, x in mujoco.mjtDisableBit.__members__.items() if "DSBL_" in key}
    return {
        **{key: np.array(getattr(model, key)) for key in FIELDS.split()},
        **{key: int(getattr(model, key)) for key in (*(x for x, _ in COUNTED.values()), *OTHERS)},
        **placed,
        "names": {kind: [name(kind, k) for k in range(getattr(model, count))] for kind, (count, _) in COUNTED.items()},
        "types": {kind: words(enumeration) for kind, enumeration in TYPES.items()},
        "gravity": np.array(model.opt.gravity),
        "medium": [float(model.opt.density), float(model.opt.viscosity)],
        "disabled": [key for key, bit in flags.items() if model.opt.disableflags & int(bit)],
        "site_object": int(mujoco.mjtObj.mjOBJ_SITE),
    }
