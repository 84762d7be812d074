"""Divide the equal steps of compiled code at the times at which an acceleration has a kink or jumps.

If there is a kink inside a step of the size h, this step is taken in two parts of the sizes a and b, with a + b = h:

    | h | h | a b | h | h |

No part has a kink inside, so that the method keeps its order of convergence, and samples keep their times.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

from gauss_bench.integrate.fixed_step import ROUNDING


@dataclass(frozen=True)
class Leg:
    """A part of a run: n equal steps of h from t [s], inside which no acceleration has a kink or jumps.

    Attributes:
        every: number of steps from sample to sample.
        slots: number of samples of the run up to the start of this part, and up to its end.
    """

    t: float
    h: float
    n: int
    every: int
    slots: tuple[int, int]

    @property
    def middle(self) -> float:
        """The time [s] in the middle of this part, at which the code's arguments that depend on time are evaluated."""
        return self.t + self.h * self.n / 2


def legs(t0: float, h: float, n: int, every: int, kinks: Sequence[float]) -> Iterator[Leg]:
    """Yield the parts of a run of n steps of size h from t0, divided at the kinks [s].

    A sample is taken after every `every` steps and after the last one.
    """
    done = 0  # number of steps
    for step, inside in _find_divided_steps(t0, h, n, kinks):
        yield from _yield_undivided(t0, h, done, step, every, n)
        done = step
        if inside:  # the parts of a divided step, which end at its kinks
            ends = [t0 + step * h, *inside, t0 + (step + 1) * h]
            for k, (begin, end) in enumerate(pairwise(ends)):
                last = k == len(inside)
                slots = _count_samples(step, every, n), _count_samples(step + last, every, n)
                yield Leg(t=begin, h=end - begin, n=1, every=1, slots=slots)
            done += 1
    yield from _yield_undivided(t0, h, done, n, every, n)


def _find_divided_steps(t0: float, h: float, n: int, kinks: Sequence[float]) -> list[tuple[int, list[float]]]:
    """Return, for each step at which an acceleration has a kink, the index of the step and the list of kinks [s] inside it.

    The list is empty if the only kink is at the beginning of the step.
    """
    divided: dict[int, list[float]] = {}
    for kink in kinks:
        nearest = round((kink - t0) / h)  # index of the step that begins nearest to the kink
        begin = t0 + nearest * h  # its time
        if abs(kink - begin) <= ROUNDING * max(abs(kink), abs(t0), h):
            if 0 < nearest < n:
                divided.setdefault(nearest, [])
        elif t0 < kink < t0 + n * h:
            inside = nearest - 1 if kink < begin else nearest  # the step that contains the kink
            divided.setdefault(inside, []).append(kink)
    return sorted(divided.items())


def _yield_undivided(t0: float, h: float, begin: int, end: int, every: int, n: int) -> Iterator[Leg]:
    """Yield the steps with the indices `begin` to `end` - 1, which are not divided and have the size h, as at most three legs.

    The legs end at the first stored sample, at the last one, and at `end`.
    """
    first = min(-(-begin // every) * every, end)  # rounded up to a sample
    last = max(first, end // every * every)  # rounded down to a sample
    for a, b in ((begin, first), (first, last), (last, end)):
        if a < b:
            spacing = every if (a, b) == (first, last) else b - a
            yield Leg(t=t0 + a * h, h=h, n=b - a, every=spacing, slots=(_count_samples(a, every, n), _count_samples(b, every, n)))


def _count_samples(step: int, every: int, n: int) -> int:
    """Return the number of samples taken during the first `step` of n steps: after every `every` steps, and after step n."""
    return step // every + (step == n and n % every > 0)
