"""The runs of a diagnosis: one motion with steps h, h/2 and h/4, each sampled three times around every checkpoint.

The three samples are the states at a checkpoint, one step before it and one step after it. A `Burst` has those of all checkpoints
of a run. The step after a checkpoint is compared with the linkage's true step from the engine's own state, however far the motion
is off. The step before it shows whether the engine used old data. All runs have the same checkpoints. An integrator that chooses
its own steps runs with three tolerances instead.
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
    """The samples of one run around its checkpoints.

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
        """Return the samples around some of the checkpoints, given by their indices or a mask (k,)."""
        return replace(self, before=self.before[chosen], at=self.at[chosen], after=self.after[chosen], a=self.a[chosen])


def checkpoints(step: float, until: float) -> Array:
    """Return the times (k,) [s] of the checkpoints, each at least one step before the end of the run.

    They are multiples of the step, and on the references' grid if that is possible.

    Raises:
        ChoiceError: the run has too few steps.
    """
    steps = int(np.floor(until / step * (1 + 1e-12)))
    if steps < FEWEST:
        raise ChoiceError(f"a diagnosis needs {FEWEST} steps, and {until:g} s have {steps} of {step:g} s: take a smaller step")
    # smallest number of steps that is a multiple of the grid's spacing; 1 if it would leave too few checkpoints
    to_grid = next((m for m in range(1, 101) if abs(m * step / GRID - round(m * step / GRID)) < 1e-9), 1)
    unit = to_grid if to_grid * COUNT <= 4 * steps and to_grid < steps else 1
    each = unit * max(1, int(np.ceil((steps - 1) / unit / COUNT)))  # steps between two checkpoints
    return step * np.arange(each, steps, each)


def ladder(choice: Choice, adaptive: bool) -> list[Choice]:
    """Return the requested choice and two choices with smaller steps or tolerances."""
    if adaptive:
        return [choice, *(replace(choice, tolerance=x) for x in REFINED)]
    return [replace(choice, step=choice.step / 2**k) for k in range(HALVINGS)]


def sample(step: float, at: Array) -> Sampling:
    """Return the sampling at the start, after the first step, and one step before, at and after the checkpoints `at` (k,) [s]."""
    whole = np.unique(np.concatenate([[0, 1], *(np.round(at / step) + k for k in (-1, 0, 1))]))
    return sampling_at(step, whole * step)


def burst(choice: Choice, at: Array, trajectory: Trajectory) -> Burst:
    """Return the samples before, at and after those checkpoints `at` (k,) [s] after which a trajectory has one step more."""
    whole = np.round(trajectory.t / choice.step).astype(int)
    wanted = np.round(at / choice.step).astype(int)
    wanted = wanted[wanted + 1 <= whole[-1]]
    x = States(trajectory.t, trajectory.q, trajectory.v)
    before, here, after = (np.searchsorted(whole, wanted + k) for k in (-1, 0, 1))
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
    """Run all choices; return the samples around the checkpoints of those runs that reached one, and all runs.

    A failed run counts up to its failure. If the first run reaches no checkpoint, the others do not take place.

    Args:
        run: function that runs the engine: (choice, sampling) -> Run.
        choices: the choice of every run, the first of which sets the checkpoints; until: end of the runs [s].
        told: called with each sentence of progress.
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
