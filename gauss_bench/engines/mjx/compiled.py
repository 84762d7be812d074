"""Compile the model whose numbers MJX uses, by MuJoCo's compiler."""

from collections.abc import Mapping, Sequence
from typing import Any

from gauss_bench.engines.base import Choice
from gauss_bench.engines.mjcf.across_releases import find_integrator
from gauss_bench.engines.mjcf.draft import Draft
from gauss_bench.engines.mjcf.drives import Drive, find_drives, set_armatures
from gauss_bench.engines.mjcf.settings import configure


def compile_model(
    mujoco: Any, draft: Draft, choice: Choice, options: Mapping[str, Any], driven: bool = True
) -> tuple[Any, Sequence[Drive]]:
    """Return MuJoCo's model of a draft under a choice, whose settings have these options, and the model's drives.

    Args:
        driven: whether driven coordinates get their armatures; otherwise there are no drives.
    """
    model = draft.spec.compile()
    share = float(options["armature_of_a_driven_hinge_over_inertia"])
    drives = find_drives(model, draft, share) if driven else []
    if drives:
        set_armatures(mujoco, model, drives)  # laws of constant speed need no force besides
    configure(mujoco, model, options, choice.step)
    model.opt.timestep = choice.step
    model.opt.integrator = find_integrator(mujoco, choice.integrator or "rk4")
    return model, drives
