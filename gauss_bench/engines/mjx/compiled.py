"""Compile, with MuJoCo's compiler, the model from which MJX takes its numbers."""

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
    """Return the model that MuJoCo compiles from a draft, with the integrator and step of a choice, and the model's drives.

    If `driven`, driven coordinates get armatures (large artificial rotor inertias); otherwise the model has no drives.
    """
    model = draft.spec.compile()
    share = float(options["armature_of_a_driven_hinge_over_inertia"])
    drives = find_drives(model, draft, share) if driven else []
    if drives:
        set_armatures(mujoco, model, drives)  # so large an inertia keeps a constant speed, so that no motor needs to act
    configure(mujoco, model, options, choice.step)
    model.opt.timestep = choice.step
    model.opt.integrator = find_integrator(mujoco, choice.integrator or "rk4")
    return model, drives
