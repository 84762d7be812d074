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
    """Base class of models in a library of free bodies; a subclass supplies `acceleration` and `run`.

    Attributes:
        options: name of an option of the engine -> value.
        plan: the `Stretch`es of a run: sequences of equal steps up to a sample or a kink of a force.
        q, v: (k, n) absolute states at the sample times, which `run` stores.
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
        return sum(stretch.steps for stretch in self.plan)

    def note(self) -> str:
        """Return a remark on the run for readers; an empty text if there is none."""
        return ""

    def read(self) -> Trajectory:
        def accelerate(k: int) -> Array:
            return self.acceleration(float(self.times[k]), self.q[k], self.v[k])

        return with_accelerations(self.times, self.q, self.v, accelerate, self.count_steps(), note=self.note())
