"""A user's wishes for a run, against what a suite says: the one rule of how long and by which steps."""

import math
from collections.abc import Sequence

import numpy as np

from gauss_bench.runs.offers import ChoiceError

MOST_STEPS = 1e10  # an hour of the quickest compiled step
MOST_SAMPLES = 5e6  # half a GiB of a four-bar's states, in each of their copies


def duration(own: float, suite: float | None = None, until: float | None = None) -> float:
    """The duration of a run [s]: as asked, else as a suite says that lists the linkage, else its scenario's own.

    Raises:
        ChoiceError: no positive time.
    """
    if until is not None and until > (most := MOST_SAMPLES * 1e-3):
        raise ChoiceError(f"the end of a run must be at most {most:g} s, not {until:g}: more samples are not kept")
    end = next(x for x in (until, suite, own) if x is not None)
    if not (math.isfinite(end) and end > 0):
        raise ChoiceError(f"the end of a run must be a positive number of seconds, not {end:g}")
    return end


def countable(step: float, t_end: float, spacing: float = 1e-3) -> None:
    """Take a run of these steps, sampled about every `spacing` [s], for one that can be made.

    Raises:
        ChoiceError: it is not; how many steps or samples there would be.
    """
    with np.errstate(all="ignore"):
        steps, samples = np.float64(t_end) / np.float64(step), np.float64(t_end) / np.float64(max(step, spacing))
    if not steps <= MOST_STEPS:
        raise ChoiceError(f"{steps:.2g} steps of {step:g} s up to {t_end:g} s; {MOST_STEPS:.0e} are the most that are taken")
    if not samples <= MOST_SAMPLES:
        raise ChoiceError(f"{samples:.2g} samples up to {t_end:g} s; {MOST_SAMPLES:.0e} are the most that are kept")


def affordable(step: float, t_end: float, seconds_a_step: float, budget: float) -> None:
    """Take a run that may end within its budget [s].

    Args:
        seconds_a_step: what a step takes at least, of the quickest linkage.

    Raises:
        ChoiceError: it cannot; what it takes at least.
    """
    countable(step, t_end)
    least = t_end / step * seconds_a_step
    if least > budget:
        raise ChoiceError(
            f"{t_end / step:.2g} steps take {least:.2g} s at least, and the budget is {budget:g} s: take longer steps, an earlier "
            "end or a larger budget"
        )


def usable_steps(steps: Sequence[float], t_end: float) -> tuple[float, ...]:
    """The steps [s], from large to small, each once.

    Raises:
        ChoiceError: one is not positive, or longer than the run: then it would not be the step that is taken.
    """
    for step in steps:
        if not (math.isfinite(step) and step > 0):
            raise ChoiceError(f"the step must be a positive number of seconds, not {step:g}")
        countable(step, t_end)
        if step > t_end * (1 + 1e-12):
            raise ChoiceError(f"the step {step:g} s is longer than the run of {t_end:g} s")
    return tuple(sorted(set(steps), reverse=True))


def check_budget(seconds: float | None, usual: float) -> float:
    """Seconds that one case may take.

    Raises:
        ChoiceError: no positive time.
    """
    if seconds is not None and not (math.isfinite(seconds) and seconds > 0):
        raise ChoiceError(f"the budget must be a positive number of seconds, not {seconds:g}")
    return usual if seconds is None else seconds
