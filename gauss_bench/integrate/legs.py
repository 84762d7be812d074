"""Equal steps over times at which an acceleration has a kink or jumps, while samples stay where they are.

    | h | h | a b | h | h |          a kink inside a step: the step is taken in parts that end there, a + b = h

so that steps keep their order.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

from gauss_bench.integrate.fixed_step import ROUNDING


@dataclass(frozen=True)
class Leg:
    """Equal steps without a kink in them.

    Attributes:
        t: start time [s]. h: step size [s]. n: number of steps.
        every: steps between samples. slots: numbers of samples before and after these steps.
    """

    t: float
    h: float
    n: int
    every: int
    slots: tuple[int, int]

    @property
    def middle(self) -> float:
        """A time in the interior, where the open parameters have the values of all steps of the leg."""
        return self.t + self.h * self.n / 2


def legs(t0: float, h: float, n: int, every: int, kinks: Sequence[float]) -> Iterator[Leg]:
    """Divide n steps of h from t0 on at the kinks; there is a sample after every `every` steps and after the last."""
    at = 0
    for step, inside in _meet(t0, h, n, kinks):
        yield from _undivided(t0, h, at, step, every, n)
        at = step
        if inside:
            ends = [t0 + step * h, *inside, t0 + (step + 1) * h]
            for k, (begin, end) in enumerate(pairwise(ends)):
                last = k == len(inside)
                yield Leg(begin, end - begin, 1, 1, (_slots(step, every, n), _slots(step + last, every, n)))
            at += 1
    yield from _undivided(t0, h, at, n, every, n)


def _meet(t0: float, h: float, n: int, kinks: Sequence[float]) -> list[tuple[int, list[float]]]:
    """Return the steps that kinks affect, as (step, kinks inside it); the list is empty if a kink lies at the step's beginning."""
    met: dict[int, list[float]] = {}
    for kink in kinks:
        nearest = round((kink - t0) / h)
        at = t0 + nearest * h
        if abs(kink - at) <= ROUNDING * max(abs(kink), abs(t0), h):
            if 0 < nearest < n:
                met.setdefault(nearest, [])
        elif t0 < kink < t0 + n * h:
            met.setdefault(nearest - (kink < at), []).append(kink)
    return sorted(met.items())


def _undivided(t0: float, h: float, begin: int, end: int, every: int, n: int) -> Iterator[Leg]:
    """Yield the legs of undivided steps from `begin` to `end`: up to the next sample, between samples, and after the last one."""
    first = min(-(-begin // every) * every, end)
    last = max(first, end // every * every)
    for a, b in ((begin, first), (first, last), (last, end)):
        if a < b:
            yield Leg(t0 + a * h, h, b - a, every if (a, b) == (first, last) else b - a, (_slots(a, every, n), _slots(b, every, n)))


def _slots(step: int, every: int, n: int) -> int:
    """Count the samples within the first `step` steps."""
    return step // every + (step == n and n % every > 0)
