"""The runs of a diagnosis: one motion with steps h, h/2 and h/4, sampled in bursts of three samples.

A burst has the states at a checkpoint, one step before it and one step after it. The step after it is compared with the linkage's
flow from the engine's own state, however far the motion is off. The step before it shows whether the engine used old data. All runs
have the same checkpoints. An integrator that chooses its own steps runs with three tolerances instead.
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

HALVINGS = 3  # number of runs: an order of convergence needs three
COUNT = 50  # most checkpoints
FEWEST = 4  # smallest number of steps of a run
GRID = 1e-2  # [s] spacing of the references' samples; checkpoints on this grid need no flow between samples
REFINED = (1e-11, 1e-12)  # tolerances of the finer runs if the integrator chooses its own steps

Runner = Callable[[Choice, Sampling], Run]


@dataclass(frozen=True, eq=False)
class Burst:
    """The samples of one run.

    Attributes:
        step: the requested step [s]; tolerance: the tolerance if the integrator chooses its own steps, else None.
        start: the first sample; stepped: the sample after one step.
        before, at, after: k states, one step before the checkpoints, at the checkpoints, and one step after.
        a: (k, n) accelerations that the engine reports at the checkpoints.
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
    """Return the times (k,) [s] of the checkpoints, with one step more before the end of the run.

    They are multiples of the step, and on the references' grid if that is possible.

    Raises:
        ChoiceError: the run has too few steps.
    """
    steps = int(np.floor(until / step * (1 + 1e-12)))
    if steps < FEWEST:
        raise ChoiceError(f"a diagnosis needs {FEWEST} steps, and {until:g} s have {steps} of {step:g} s: take a smaller step")
    # smallest number of steps that is a multiple of the grid's spacing; 1 if it would leave too few checkpoints
    on_grid = next((m for m in range(1, 101) if abs(m * step / GRID - round(m * step / GRID)) < 1e-9), 1)
    on_grid = on_grid if on_grid * COUNT <= 4 * steps and on_grid < steps else 1
    each = on_grid * max(1, int(np.ceil((steps - 1) / on_grid / COUNT)))  # steps between two checkpoints
    return step * np.arange(each, steps, each)


def ladder(choice: Choice, adaptive: bool) -> list[Choice]:
    """Return the requested choice and two choices with smaller steps or tolerances."""
    if adaptive:
        return [choice, *(replace(choice, tolerance=x) for x in REFINED)]
    return [replace(choice, step=choice.step / 2**k) for k in range(HALVINGS)]


def sample(step: float, at: Array) -> Sampling:
    """Return the sampling at the start, after the first step, and at the bursts around the checkpoints `at` (k,) [s]."""
    whole = np.unique(np.concatenate([[0, 1], *(np.round(at / step) + k for k in (-1, 0, 1))]))
    return sampling_at(step, whole * step)


def burst(choice: Choice, at: Array, trajectory: Trajectory) -> Burst:
    """Return the bursts around those checkpoints `at` (k,) [s] that a trajectory has reached."""
    whole = np.round(trajectory.t / choice.step).astype(int)
    wanted = np.round(at / choice.step).astype(int)
    wanted = wanted[wanted + 1 <= whole[-1]]
    x = States(trajectory.t, trajectory.q, trajectory.v)
    before, here, after = (np.searchsorted(whole, wanted + k) for k in (-1, 0, 1))
    return Burst(choice.step, choice.tolerance, x[:1], x[1:2], x[before], x[here], x[after], trajectory.a[here])


def observe(
    run: Runner, choices: Sequence[Choice], until: float, told: Callable[[str], object]
) -> tuple[tuple[Burst, ...], tuple[Run, ...]]:
    """Run all choices; return the bursts of the runs that reached a checkpoint, and all runs.

    A failed run counts up to its failure. If the first run reaches no checkpoint, the others do not take place.
    """
    at, bursts, runs = checkpoints(choices[0].step, until), list[Burst](), list[Run]()
    for choice in choices:
        told(f"a run by {f'tolerance {choice.tolerance:g}' if choice.tolerance else f'steps of {choice.step:g} s'}")
        runs.append(run(choice, sample(choice.step, at)))
        trajectory = runs[-1].trajectory or runs[-1].reached
        found = burst(choice, at, trajectory) if trajectory else None
        if found and len(found.at):
            bursts.append(found)
        elif not bursts:
            break
    return tuple(bursts), tuple(runs)
