"""The common parts of adapters to libraries of free bodies, whose states are absolute."""

from abc import ABC, abstractmethod
from collections.abc import Mapping
from typing import Any

from gauss_bench.engines.base import Choice, sample_arrays
from gauss_bench.integrate.fixed_step import stretches
from gauss_bench.mechanism.model import Mechanism
from gauss_bench.terms import Array
from gauss_bench.trajectory import Trajectory, with_accelerations


class BodyModel(ABC):
    """A mechanism in a library of free bodies, run with one setting of the engine (`Choice`); a base class of models.

    A subclass supplies `acceleration`, and `run`, which takes the steps of `plan` and stores states in `q` and `v`. The interface
    of models is `Model` in `base.py`.

    Attributes:
        options: name of an option of the engine -> value.
        plan: intervals of time, each with steps of equal size; `prepare` sets it.
        q, v: (k, n) absolute states at the sample times.
    """

    def __init__(self, mechanism: Mechanism, choice: Choice, options: Mapping[str, Any]):
        self.mechanism, self.choice, self.options = mechanism, choice, options

    @abstractmethod
    def acceleration(self, t: float, q: Array, v: Array) -> Array: ...

    @abstractmethod
    def run(self) -> None: ...

    def prepare(self, times: Array, native: bool = True) -> None:
        self.times, self.plan = times, list(stretches(times, self.choice.step, self.mechanism.kinks))
        self.q, self.v = sample_arrays(times, self.mechanism.q0, self.mechanism.v0)

    def count_steps(self) -> int:
        """Return the number of steps of a run."""
        return sum(stretch.steps for stretch in self.plan)

    def note(self) -> str:
        """Return a remark on the run for readers; an empty text if there is none."""
        return ""

    def read(self) -> Trajectory:
        """Return the samples of the last run, with accelerations that are computed at each sample."""

        def acceleration_of_sample(k: int) -> Array:
            return self.acceleration(float(self.times[k]), self.q[k], self.v[k])

        return with_accelerations(self.times, self.q, self.v, acceleration_of_sample, self.count_steps(), note=self.note())
