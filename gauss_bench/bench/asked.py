"""What a user asks of a run, against what a suite says: the one rule of how long and by which steps."""

import math
from collections.abc import Sequence

from gauss_bench.bench.offers import ChoiceError


def duration(own: float, suite: float | None = None, until: float | None = None) -> float:
    """How long a linkage runs [s]: as long as asked, else as long as a suite says that lists it, else its scenario's own duration.

    Raises:
        ChoiceError: no positive time.
    """
    found = next(x for x in (until, suite, own) if x is not None)
    if not (math.isfinite(found) and found > 0):
        raise ChoiceError(f"the end of a run must be a positive number of seconds, not {found:g}")
    return found


def usable_steps(steps: Sequence[float], t_end: float) -> tuple[float, ...]:
    """The steps [s], from large to small, each once.

    Raises:
        ChoiceError: one is not positive, or longer than the run: then it would not be the step that is taken.
    """
    for step in steps:
        if not (math.isfinite(step) and step > 0):
            raise ChoiceError(f"the step must be a positive number of seconds, not {step:g}")
        if step > t_end * (1 + 1e-12):
            raise ChoiceError(f"the step {step:g} s is longer than the run of {t_end:g} s")
    return tuple(sorted(set(steps), reverse=True))


def checked_budget(seconds: float | None, usual: float) -> float:
    """Seconds that one case may take.

    Raises:
        ChoiceError: no positive time.
    """
    if seconds is not None and not (math.isfinite(seconds) and seconds > 0):
        raise ChoiceError(f"the budget must be a positive number of seconds, not {seconds:g}")
    return usual if seconds is None else seconds
