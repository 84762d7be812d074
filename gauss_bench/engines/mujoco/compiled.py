"""Compile an MJCF document: MuJoCo's compiler resolves the document's defaults, classes, frames and masses."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from gauss_bench.terms import Array

PARTS = ("body", "jnt", "site", "eq", "tendon", "actuator", "key", "geom", "sensor")  # kinds, as in names of MuJoCo's fields


class DoesNotCompile(ValueError):
    """MuJoCo rejects a document; the message is MuJoCo's."""


@dataclass(frozen=True, eq=False)
class Compiled:
    """A compiled document.

    Attributes:
        data: MuJoCo's state of the model at qpos0, with the poses of all parts.
        inertia: (bodies, 3, 3) moments of inertia about the centres of mass, in world axes [kg m^2].
    """

    mujoco: Any
    model: Any
    data: Any
    inertia: Array

    def names(self, kind: str) -> list[str]:
        """Return the names of all parts of a kind of PARTS; a part without a name has an empty one."""
        text = self.model.names  # the names of all kinds, each followed by a null
        starts = getattr(self.model, f"name_{kind}adr")  # positions in this text
        return [text[start : text.index(b"\0", start)].decode() for start in starts]

    def word(self, enumeration: str, number: Any) -> str:
        """Return the name of a number in one of MuJoCo's enumerations, such as "hinge" for mjJNT_HINGE of mjtJoint."""
        return str(getattr(self.mujoco, enumeration)(int(number)).name).partition("_")[2].lower()

    def disabled(self) -> set[str]:
        """Return the names of the disabled features, such as "gravity"."""
        bits = {name: int(bit) for name, bit in self.mujoco.mjtDisableBit.__members__.items() if "DSBL_" in name}
        return {name.removeprefix("mjDSBL_").lower() for name, bit in bits.items() if self.model.opt.disableflags & bit}


def compile_document(text: str) -> Compiled:
    """Compile the text of a document that refers to no other file.

    Raises:
        DoesNotCompile: MuJoCo rejects the document.
        ImportError: MuJoCo is not installed.
    """
    return _compile(lambda mujoco: mujoco.MjModel.from_xml_string(text))


def compile_file(path: Path) -> Compiled:
    """Compile a file, together with the files that it includes and refers to; it raises as `compile_document` does."""
    return _compile(lambda mujoco: mujoco.MjModel.from_xml_path(str(path)))


def _compile(compile_model: Callable[[Any], Any]) -> Compiled:
    """Compile a document by a function that takes the module `mujoco` and returns MuJoCo's model."""
    import mujoco

    try:
        model = compile_model(mujoco)
        data = mujoco.MjData(model)
    except ValueError as error:
        raise DoesNotCompile(str(error)) from error
    except (MemoryError, RuntimeError) as error:  # a RuntimeError says only "an unknown exception"
        raise DoesNotCompile("its compiler failed, perhaps for lack of memory") from error
    mujoco.mj_kinematics(model, data)
    turns = np.array(data.ximat).reshape(-1, 3, 3)  # (bodies, 3, 3) rotations R from principal axes to world axes: R diag(I) R^T
    return Compiled(mujoco, model, data, np.einsum("kij,kj,klj->kil", turns, np.array(model.body_inertia), turns))
