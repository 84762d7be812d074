"""Run the self-test, which plants faults in the suite; its result is the object that `gauss-bench selftest --json` prints."""

from collections.abc import Sequence
from dataclasses import dataclass

from gauss_bench.api.telling import Result, Told, nobody
from gauss_bench.diagnosis.selftest import KINDS, SelfTest
from gauss_bench.diagnosis.selftest import selftest as plant_faults
from gauss_bench.runs.offers import ChoiceError


@dataclass(frozen=True)
class Planted(SelfTest, Result):
    """The result of a self-test, with the fields of SelfTest."""

    computed = ("planted", "detected", "passed")

    @property
    def succeeded(self) -> bool:
        return self.passed


def selftest(only: Sequence[str] = (), told: Told = nobody) -> Planted:
    """Plant known faults in memory, and test that the suite's checks detect each fault, and none in the unaltered suite.

    Args:
        only: kinds of faults; by default all.
        told: called with each sentence of progress.

    Raises:
        ChoiceError: a kind is unknown.
    """
    for kind in only:
        if kind not in KINDS:
            raise ChoiceError(f"no faults of the kind {kind!r}; there are {', '.join(KINDS)}")
    return Planted(**vars(plant_faults(only, told)))
