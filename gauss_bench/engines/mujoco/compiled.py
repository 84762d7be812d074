"""An MJCF document with its defaults, classes, frames and masses resolved by MuJoCo's compiler, as plain data."""

import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

READ = tomllib.loads((Path(__file__).parent / "fields.toml").read_text(encoding="utf-8"))


class DoesNotCompile(ValueError):
    """MuJoCo rejects a document; the message is MuJoCo's own."""


def compile_document(text: str) -> dict[str, Any]:
    """Compile a document, which opens no other file, and return what `describe_model` does.

    Raises:
        DoesNotCompile: MuJoCo rejects the document.
        ImportError: MuJoCo is not installed.
    """
    import mujoco

    return describe_model(mujoco, lambda: mujoco.MjModel.from_xml_string(text))


def compile_file(path: Path) -> dict[str, Any]:
    """Compile a file with all that it includes and refers to, and return what `describe_model` does.

    Raises:
        DoesNotCompile, ImportError: as `compile_document`.
    """
    import mujoco

    return describe_model(mujoco, lambda: mujoco.MjModel.from_xml_path(str(path)))


def describe_model(mujoco: Any, compiler: Callable[[], Any]) -> dict[str, Any]:
    """Return a compiled model's fields, the names of its parts, and all poses at qpos0.

    The result holds the fields that `fields.toml` lists and these:

        xpos, xmat, xipos, inertia    poses of bodies; inertia (3, 3) in world axes
        xanchor, xaxis                of joints
        site_xpos, site_xmat          poses of sites
        names                         by kind of part
        types                         words for MuJoCo's numbers of joints, equalities, tendon parts, transmissions, gains, biases
        gravity, medium, disabled     medium is (density, viscosity); `disabled` lists flags
        disabled_groups               groups of actuators that are switched off

    Raises:
        DoesNotCompile: MuJoCo rejects the model.
    """
    try:
        model = compiler()
        data = mujoco.MjData(model)
    except ValueError as error:
        raise DoesNotCompile(str(error)) from error
    except (MemoryError, RuntimeError) as error:  # a RuntimeError says only "an unknown exception"
        raise DoesNotCompile("its compiler failed, as it does where memory does not suffice") from error
    mujoco.mj_kinematics(model, data)
    poses = {key: np.array(getattr(data, key)) for key in ("xpos", "xipos", "xanchor", "xaxis", "site_xpos")}
    poses |= {key: np.array(getattr(data, key)).reshape(-1, 3, 3) for key in ("xmat", "site_xmat")}
    turns = np.array(data.ximat).reshape(-1, 3, 3)  # from the principal axes of each body
    poses["inertia"] = np.einsum("kij,kj,klj->kil", turns, np.array(model.body_inertia), turns)

    def name(kind: str, k: int) -> str:
        return mujoco.mj_id2name(model, int(getattr(mujoco.mjtObj, READ["counted"][kind][1])), k) or ""

    def words(enumeration: str) -> dict[str, str]:
        return {str(int(x)): name.partition("_")[2].lower() for name, x in getattr(mujoco, enumeration).__members__.items()}

    flags = {key.removeprefix("mjDSBL_").lower(): x for key, x in mujoco.mjtDisableBit.__members__.items() if "DSBL_" in key}
    return {
        **{key: np.array(getattr(model, key)) for key in READ["fields"].split()},
        **{key: int(getattr(model, key)) for key in (*(x for x, _ in READ["counted"].values()), *READ["others"])},
        **poses,
        "names": {kind: [name(kind, k) for k in range(getattr(model, count))] for kind, (count, _) in READ["counted"].items()},
        "types": {kind: words(enumeration) for kind, enumeration in READ["types"].items()},
        "gravity": np.array(model.opt.gravity),
        "medium": [float(model.opt.density), float(model.opt.viscosity)],
        "disabled": [key for key, bit in flags.items() if model.opt.disableflags & int(bit)],
        "disabled_groups": [k for k in range(31) if int(model.opt.disableactuator) >> k & 1],
        "site_object": int(mujoco.mjtObj.mjOBJ_SITE),
    }
