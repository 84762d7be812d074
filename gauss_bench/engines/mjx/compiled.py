"""MuJoCo's compiled model, of which MJX takes the numbers."""

from collections.abc import Mapping, Sequence
from typing import Any, Protocol

from gauss_bench.engines.base import Choice
from gauss_bench.engines.mjcf.draft import Draft
from gauss_bench.engines.mjcf.drives import Drive, find_drives, set_armatures
from gauss_bench.engines.mjcf.settings import configure
from gauss_bench.engines.tree import Tree
from gauss_bench.mechanism.model import Mechanism

INTEGRATORS = {"rk4": "mjINT_RK4", "euler": "mjINT_EULER", "implicitfast": "mjINT_IMPLICITFAST"}


class Drafted(Protocol):
    """A mechanism under a choice, with its draft."""

    mechanism: Mechanism
    choice: Choice
    options: Mapping[str, Any]
    tree: Tree
    draft: Draft


def compile_model(mujoco: Any, drafted: Drafted, step: float, driven: bool = True) -> tuple[Any, Sequence[Drive]]:
    """Return MuJoCo's model for steps of `step` [s], and its drives; without `driven` none has an armature."""
    model, options = drafted.draft.spec.compile(), drafted.options
    share = float(options["armature_of_a_driven_hinge_over_inertia"])
    drives = find_drives(model, drafted.draft, drafted.mechanism, drafted.tree, share) if driven else []
    if drives:
        set_armatures(mujoco, model, drives)  # the second rate of their laws is zero, so that no force belongs to them
    configure(mujoco, model, options, step)
    model.opt.timestep = step
    model.opt.integrator = getattr(mujoco.mjtIntegrator, INTEGRATORS[drafted.choice.integrator or "rk4"])
    return model, drives
