"""Make the runs of a diagnosis: one motion with steps h, h/2 and h/4, each sampled three times around every checkpoint.

Checkpoints are the times at which errors are analysed, the same in all runs. The engine's step after a checkpoint is compared
with the exact motion over this step, which begins at the engine's own state. The state one step before shows whether the engine
used constraint data of the previous step. If an integrator chooses its own steps, the runs have different tolerances.
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
COUNT = 50  # largest number of checkpoints
FEWEST = 4  # smallest number of steps of a run
GRID = 1e-2  # [s] spacing of the references' samples; checkpoints on this grid need no flow between samples
REFINED = (1e-11, 1e-12)  # tolerances of the finer runs if the integrator chooses its own steps

Runner = Callable[[Choice, Sampling], Run]  # runs one engine on one linkage


@dataclass(frozen=True, eq=False)
class Burst:
    """The samples of one run at its start, and one step before, at, and one step after each of its k checkpoints.

    Attributes:
        step: the requested step [s]; tolerance: the tolerance if the integrator chooses its own steps, else None.
        start: the first sample of the run; stepped: the sample after the first step. Both are a single state.
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
        """Return the burst at those checkpoints that a mask or an array of indices chooses."""
        return replace(self, before=self.before[chosen], at=self.at[chosen], after=self.after[chosen], a=self.a[chosen])


def checkpoints(step: float, until: float) -> Array:
    """Return the times (k,) [s] of at most COUNT evenly spaced checkpoints, each at least one step before the end of the run.

    The times are multiples of the step, and also of GRID if enough times are.

    Raises:
        ChoiceError: the run has fewer than FEWEST steps.
    """
    steps = int(np.floor(until / step * (1 + 1e-12)))
    if steps < FEWEST:
        raise ChoiceError(f"a diagnosis needs {FEWEST} steps, and {until:g} s are {steps} steps of {step:g} s: take a smaller step")
    # `to_grid` is the smallest number of steps whose length is a multiple of GRID; 1 if this number exceeds 100
    to_grid = next((m for m in range(1, 101) if abs(m * step / GRID - round(m * step / GRID)) < 1e-9), 1)
    # the grid is not used where it would leave less than a quarter of COUNT checkpoints
    unit = to_grid if to_grid * COUNT <= 4 * steps and to_grid < steps else 1
    between = unit * max(1, int(np.ceil((steps - 1) / unit / COUNT)))  # steps from one checkpoint to the next
    return step * np.arange(between, steps, between)


def ladder(choice: Choice, adaptive: bool) -> list[Choice]:
    """Return the requested setting, followed by the same setting with two smaller steps, or with two tolerances if `adaptive`."""
    if adaptive:
        return [choice, *(replace(choice, tolerance=x) for x in REFINED)]
    return [replace(choice, step=choice.step / 2**k) for k in range(HALVINGS)]


def sample(step: float, at: Array) -> Sampling:
    """Return the sampling at the start, after the first step, and around the checkpoints `at` (k,) [s]."""
    steps = np.unique(np.concatenate([[0, 1], *(np.round(at / step) + k for k in (-1, 0, 1))]))  # numbers of the sampled steps
    return sampling_at(step, steps * step)


def burst(choice: Choice, at: Array, trajectory: Trajectory) -> Burst:
    """Return the burst of a run at those checkpoints `at` (k,) [s] after which the run has at least one more step."""
    steps = np.round(trajectory.t / choice.step).astype(int)  # number of the step after which each sample was taken
    wanted = np.round(at / choice.step).astype(int)
    wanted = wanted[wanted + 1 <= steps[-1]]
    x = States(trajectory.t, trajectory.q, trajectory.v)
    before, here, after = (np.searchsorted(steps, wanted + k) for k in (-1, 0, 1))
    return Burst(
        step=choice.step,
        tolerance=choice.tolerance,
        start=x[:1],
        stepped=x[1:2],
        before=x[before],
        at=x[here],
        after=x[after],
        a=trajectory.a[here],
    )


def observe(
    run: Runner, choices: Sequence[Choice], until: float, told: Callable[[str], object]
) -> tuple[tuple[Burst, ...], tuple[Run, ...]]:
    """Run the engine with each setting, up to the time `until` [s].

    Return a burst for every run that reached a checkpoint, also before a failure, and all runs. If the first run reaches no
    checkpoint, no further runs are made. The step of the first setting determines the checkpoints of all runs.
    """
    checkpoint_times, bursts, runs = checkpoints(choices[0].step, until), list[Burst](), list[Run]()
    for choice in choices:
        setting = f"tolerance {choice.tolerance:g}" if choice.tolerance else f"steps of {choice.step:g} s"
        told(f"a run with {setting}")
        runs.append(run(choice, sample(choice.step, checkpoint_times)))
        samples = runs[-1].samples  # of a failed run, those before its failure
        observed = burst(choice, checkpoint_times, samples) if samples else None
        if observed and len(observed.at):
            bursts.append(observed)
        elif not bursts:
            break
    return tuple(bursts), tuple(runs)
