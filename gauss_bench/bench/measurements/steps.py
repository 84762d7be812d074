"""A step of Runge-Kutta in each engine's own loop: the compiled formulations against MuJoCo at the same step.

The same thousand steps from the scenario's start are repeated in every block. Forces, springs and the guards of the pivots are in
what is timed, and so is the call from Python, a share of about three in a hundred of the kernel's time.
"""

import numpy as np

from gauss_bench.bench.clock import Block, lasting
from gauss_bench.bench.kernel_timing import Key, Measured, Race, Row, row
from gauss_bench.bench.targets import PROJECTED, STEP, at_least
from gauss_bench.compiler.kernel import Kernel, compile_kernel
from gauss_bench.engines import get
from gauss_bench.engines.base import Choice
from gauss_bench.mechanism.model import Mechanism

H = 1e-4  # [s]
STEPS = 1000
FORMULATIONS = ("gauss", "lagrange")
STABILIZATIONS = ("none", "projection")
RIVAL_SETTINGS = ("tuned", "default")
TARGETS = {"none": STEP, "projection": PROJECTED}
QUANTITY = "step"


def enter(race: Race, mechanism: Mechanism, formulation: str, stabilization: str) -> Kernel | None:
    """Enter the steps of one formulation; its kernel, or None where it has none."""
    kept: list[Kernel] = []

    def make() -> Block:
        kernel = compile_kernel(mechanism, formulation, stabilization, backend="llvm")
        kept.append(kernel)
        return lasting(None, lambda: kernel.rollout(mechanism.q0, mechanism.v0, H, STEPS), STEPS)

    race.add(Key(QUANTITY, formulation, "default", stabilization), make)
    return kept[0] if kept else None


def enter_rival(race: Race, mechanism: Mechanism, settings: str) -> None:
    """Enter MuJoCo's steps."""

    def make() -> Block:
        model = get("mujoco").build(mechanism, Choice(settings, "rk4", "none", H))
        times = np.array([0.0, STEPS * H])
        return Block(None, lambda: model.prepare(times), model.run, STEPS)

    race.add(Key(QUANTITY, "mujoco", settings), make)


def step_rows(mechanism: Mechanism, measured: Measured) -> list[Row]:
    """One row for each formulation, stabilisation and setting of MuJoCo; those of Gauss have targets."""
    rows = []
    for formulation in FORMULATIONS:
        for stabilization in STABILIZATIONS:
            for settings in RIVAL_SETTINGS:
                start: Row = {"mechanism": mechanism.name, "scenario": mechanism.scenario, "formulation": formulation}
                start |= {"stabilization": stabilization, "rival": "mujoco", "settings": settings, "step": H}
                keys = Key(QUANTITY, formulation, "default", stabilization), Key(QUANTITY, "mujoco", settings)
                found = row(start, measured.compared, *keys)
                target = TARGETS[stabilization].get(mechanism.name) if formulation == "gauss" else None
                rows.append(at_least(found, "ratio", target))
    return rows
