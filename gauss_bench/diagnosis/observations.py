"""The runs of a diagnosis: one motion with steps h, h/2 and h/4, sampled in bursts of three samples.

A burst holds the state at a checkpoint, one step before it, and one step after it. The step after it is compared with the linkage's
flow from the engine's own state, however far the motion is off. The step before it shows whether the engine used old data. All runs
have the same checkpoints. An integrator that chooses its own steps runs with smaller tolerances instead.
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
FEWEST = 4  # fewest steps of a run that has checkpoints
GRID = 1e-2  # [s] spacing of the references; checkpoints on it need no further integration
REFINED = (1e-11, 1e-12)  # tolerances of the finer runs, if the integrator chooses its own steps

Runner = Callable[[Choice, Sampling], Run]


@dataclass(frozen=True, eq=False)
class Burst:
    """The samples of one run.

    Attributes:
        step: the requested step [s]; tolerance: the tolerance, if the integrator chooses its own steps.
        start: the first sample (1); stepped: the sample after one step (1).
        before, at, after: states (k) one step before the checkpoints, there, and one step after.
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
    """Return times (k,) [s] after whole steps, at least one step before the end, and on the references' grid if possible.

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
    """Return the requested choice, and two with smaller steps or tolerances."""
    if adaptive:
        return [choice, *(replace(choice, tolerance=x) for x in REFINED)]
    return [replace(choice, step=choice.step / 2**k) for k in range(HALVINGS)]


def sample(step: float, at: Array) -> Sampling:
    """Return the sample times of the start, the first step and the bursts."""
    whole = np.unique(np.concatenate([[0, 1], *(np.round(at / step) + k for k in (-1, 0, 1))]))
    return sampling_at(step, whole * step)


def burst(choice: Choice, at: Array, trajectory: Trajectory) -> Burst:
    """Return the bursts around the checkpoints that a trajectory has reached."""
    whole = np.round(trajectory.t / choice.step).astype(int)
    wanted = np.round(at / choice.step).astype(int)
    wanted = wanted[wanted + 1 <= whole[-1]]
    x = States(trajectory.t, trajectory.q, trajectory.v)
    before, here, after = (np.searchsorted(whole, wanted + k) for k in (-1, 0, 1))
    return Burst(choice.step, choice.tolerance, x[:1], x[1:2], x[before], x[here], x[after], trajectory.a[here])


def observe(
    run: Runner, choices: Sequence[Choice], until: float, told: Callable[[str], object]
) -> tuple[tuple[Burst, ...], tuple[Run, ...]]:
    """Run all choices; return the bursts of those that reached a checkpoint, and all runs.

    A run that fails counts up to its failure, and the others still take place. If the first reaches no checkpoint, no other is run.
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
