"""The runs asked of an engine: the same motion by three steps, each half the one before, sampled in bursts of three steps.

A burst is a checkpoint, one step before it and one after it: from the step after, an engine's own steps can be held against the
linkage's flow, wherever its motion has got to meanwhile; from the step before follows whether it used old data. Checkpoints are
the same for all steps. An integrator that chooses its own steps is asked for smaller tolerances instead.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gauss_bench.engines.base import Choice
from gauss_bench.runs.offers import ChoiceError
from gauss_bench.runs.one_run import Run, Sampling, sampling_at
from gauss_bench.terms import Array
from gauss_bench.trajectory import States, Trajectory

HALVINGS = 3  # runs: an order needs three
COUNT = 50  # checkpoints at most
FEWEST = 4  # steps that a run must have, so that there are checkpoints
GRID = 1e-2  # [s] of the references: what falls on it needs no flow
REFINED = (1e-11, 1e-12)  # tolerances of an integrator that chooses its own steps

Runner = Callable[[Choice, Sampling], Run]


@dataclass(frozen=True, eq=False)
class Burst:
    """The samples of one run.

    Attributes:
        step: [s] that was asked for; tolerance: instead, where the integrator chooses its own.
        start: the first sample (1); stepped: the next, one step on.
        before, at, after: states (k) one step before the checkpoints, there, and one step after.
        a: (k, n) accelerations that the engine tells at the checkpoints.
    """

    step: float
    tolerance: float | None
    start: States
    stepped: States
    before: States
    at: States
    after: States
    a: Array

    def __getitem__(self, chosen: NDArray[Any]) -> "Burst":
        return replace(self, before=self.before[chosen], at=self.at[chosen], after=self.after[chosen], a=self.a[chosen])


def checkpoints(step: float, until: float) -> Array:
    """Return times (k,) [s] that whole steps reach, a step before the end at the latest; on the references' grid if possible.

    Raises:
        ChoiceError: the run has too few steps.
    """
    steps = int(np.floor(until / step * (1 + 1e-12)))
    if steps < FEWEST:
        raise ChoiceError(f"a diagnosis needs {FEWEST} steps, and {until:g} s have {steps} of {step:g} s: take a smaller step")
    beat = next((m for m in range(1, 101) if abs(m * step / GRID - round(m * step / GRID)) < 1e-9), 1)
    beat = beat if beat * COUNT <= 4 * steps and beat < steps else 1
    each = beat * max(1, int(np.ceil((steps - 1) / beat / COUNT)))
    return step * np.arange(each, steps, each)


def ladder(choice: Choice, adaptive: bool) -> list[Choice]:
    """Return the choice asked for, and two finer ones."""
    if adaptive:
        return [choice, *(replace(choice, tolerance=x) for x in REFINED)]
    return [replace(choice, step=choice.step / 2**k) for k in range(HALVINGS)]


def sample(step: float, at: Array) -> Sampling:
    """Return the sampling of the bursts, the start and the first step."""
    whole = np.unique(np.concatenate([[0, 1], *(np.round(at / step) + k for k in (-1, 0, 1))]))
    return sampling_at(step, whole * step)


def burst(choice: Choice, at: Array, trajectory: Trajectory) -> Burst:
    """The bursts around those checkpoints that a trajectory has reached."""
    whole = np.round(trajectory.t / choice.step).astype(int)
    wanted = np.round(at / choice.step).astype(int)
    wanted = wanted[wanted + 1 <= whole[-1]]
    x = States(trajectory.t, trajectory.q, trajectory.v)
    before, here, after = (np.searchsorted(whole, wanted + k) for k in (-1, 0, 1))
    return Burst(choice.step, choice.tolerance, x[:1], x[1:2], x[before], x[here], x[after], trajectory.a[here])


def observe(
    run: Runner, choices: Sequence[Choice], until: float, told: Callable[[str], object]
) -> tuple[tuple[Burst, ...], tuple[Run, ...]]:
    """Run all choices and return the bursts of those that reached a checkpoint, and all runs.

    Of a run that fails what it reached is kept, and the others still run; where the first reached nothing there are no others.
    """
    at, bursts, runs = checkpoints(choices[0].step, until), list[Burst](), list[Run]()
    for choice in choices:
        told(f"a run by {f'tolerance {choice.tolerance:g}' if choice.tolerance else f'steps of {choice.step:g} s'}")
        runs.append(run(choice, sample(choice.step, at)))
        trajectory = runs[-1].trajectory or runs[-1].reached
        made = trajectory and burst(choice, at, trajectory)
        if made and len(made.at):
            bursts.append(made)
        elif not bursts:
            break
    return tuple(bursts), tuple(runs)
