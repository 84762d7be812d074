"""Everything that is timed on one linkage, in one interleaved run of one process: steps, formulations, right-hand sides, bounds."""

from typing import Any

from gauss_bench.bench.kernel_chains import mechanism_named
from gauss_bench.bench.kernel_effort import Effort
from gauss_bench.bench.kernel_timing import Race
from gauss_bench.bench.measurements import limits as kernel_limits
from gauss_bench.bench.measurements import right_hand_sides as kernel_rhs
from gauss_bench.bench.measurements.claim import claim_row, enter_batch, enter_textbook
from gauss_bench.bench.measurements.steps import FORMULATIONS, RIVAL_SETTINGS, STABILIZATIONS, enter, enter_rival, step_rows


def kernel_costs(linkage: str, scenario: str, effort: Effort) -> dict[str, Any]:
    """Rows of a linkage against MuJoCo and Pinocchio, and of both formulations; by table. Call it in a process of its own."""
    mechanism, race = mechanism_named(linkage, scenario), Race()
    kernels = {(f, s): enter(race, mechanism, f, s) for f in FORMULATIONS for s in STABILIZATIONS}
    plain = {f: kernels[f, "none"] for f in FORMULATIONS}
    for formulation, kernel in plain.items():
        enter_textbook(race, mechanism, formulation)
        if kernel is not None:
            enter_batch(race, mechanism, formulation, kernel)
    if plain["gauss"] is not None:
        kernel_rhs.enter_call(race, mechanism, plain["gauss"])
    for settings in RIVAL_SETTINGS:
        enter_rival(race, mechanism, settings)
    for settings in kernel_rhs.RIVAL_SETTINGS:
        kernel_rhs.enter_rival(race, mechanism, settings)
    kernel_limits.enter_processor(race)
    measured = race.run(effort.rounds)
    return {
        "kernel_steps": step_rows(mechanism, measured),
        "kernel_claim": [claim_row(mechanism, plain, measured)],
        "kernel_rhs": kernel_rhs.rhs_rows(mechanism, measured),
        "kernel_bounds": kernel_limits.bound_rows(mechanism, measured),
    }


def chain_costs(linkage: str, scenario: str, effort: Effort) -> dict[str, Any]:
    """The row of both formulations alone, {"kernel_claim": [...]}: for a chain of pendulums."""
    mechanism, race = mechanism_named(linkage, scenario), Race()
    kernels = {f: enter(race, mechanism, f, "none") for f in FORMULATIONS}
    for formulation, kernel in kernels.items():
        enter_textbook(race, mechanism, formulation)
        if kernel is not None:
            enter_batch(race, mechanism, formulation, kernel)
    return {"kernel_claim": [claim_row(mechanism, kernels, race.run(effort.rounds))]}


def processor(effort: Effort) -> dict[str, Any]:
    """The processor's latency and rate, {"kernel_machine": [...]}."""
    race = Race()
    kernel_limits.enter_processor(race)
    return {"kernel_machine": kernel_limits.processor_rows(race.run(effort.rounds))}
