"""Options of a compiled MuJoCo model: the softness of its closures, its solver, and the features that it does not use."""

import copy
from collections.abc import Callable, Mapping
from typing import Any

from gauss_bench.engines.mjcf.across_releases import disable

FLAGS: Mapping[str, Callable[[Any], bool]] = {  # flag that disables a feature -> function that tells whether a model uses it
    "mjDSBL_ISLAND": lambda model: False,  # a linkage is one island: searching for islands only costs time
    "mjDSBL_CONTACT": lambda model: bool(model.ngeom),
    "mjDSBL_MIDPHASE": lambda model: bool(model.ngeom),
    "mjDSBL_SENSOR": lambda model: bool(model.nsensor),
    "mjDSBL_LIMIT": lambda model: bool(model.jnt_limited.any() or model.tendon_limited.any()),
    "mjDSBL_FRICTIONLOSS": lambda model: bool(model.dof_frictionloss.any() or model.tendon_frictionloss.any()),
    "mjDSBL_CLAMPCTRL": lambda model: bool(model.actuator_ctrllimited.any()),
}


def configure(mujoco: Any, model: Any, options: Mapping[str, Any], step: float) -> None:
    """Set the options of a newly compiled model that takes steps of `step` [s].

    Trap: a second call scales the inverse weights again, unless MuJoCo's mj_setConst has computed them anew in between.
    """
    unit = step if options["solref_unit"] == "step" else 1.0  # [s] unit of the closures' time constant, solref[0]
    model.eq_solref[:] = [options["solref"][0] * unit, options["solref"][1]]
    model.eq_solimp[:] = options["solimp"]
    model.opt.tolerance, model.opt.iterations = options["tolerance"], options["iterations"]
    model.opt.solver = getattr(mujoco.mjtSolver, f"mjSOL_{options['solver'].upper()}")
    model.opt.jacobian = getattr(mujoco.mjtJacobian, f"mjJAC_{options['jacobian'].upper()}")
    model.body_invweight0[:] *= options["body_invweight0_factor"]
    if options["unused_features"] == "off":
        disable(mujoco, model, (flag for flag, uses in FLAGS.items() if not uses(model)))


def copy_to_evaluate(mujoco: Any, model: Any) -> Any:
    """Return a copy of a compiled model whose accelerations depend only on the given state."""
    # with the integrator `discrete`, qacc is a difference of velocities; with a warm start, it depends on the previous state
    still = copy.copy(model)
    still.opt.integrator = mujoco.mjtIntegrator.mjINT_EULER
    still.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_WARMSTART)
    return still
