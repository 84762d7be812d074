"""The self-test, which shows whether the suite notices faults: what `gauss-bench selftest` prints."""

from collections.abc import Sequence
from dataclasses import dataclass

from gauss_bench.api.telling import Result, Told, nobody
from gauss_bench.diagnosis.selftest import KINDS, SelfTest
from gauss_bench.diagnosis.selftest import selftest as planted
from gauss_bench.runs.offers import ChoiceError


def selftest(only: Sequence[str] = (), told: Told = nobody) -> SelfTest:
    """Plant known faults in memory, and test that the suite's checks report each of them and report nothing without a fault.

    Args:
        only: kinds of faults; all where not given.
        told: called with each sentence of progress.

    Raises:
        ChoiceError: an unknown kind.
    """
    for kind in only:
        if kind not in KINDS:
            raise ChoiceError(f"no faults of the kind {kind!r}; there are {', '.join(KINDS)}")
    return planted(only, told)


@dataclass(frozen=True)
class Planted(SelfTest, Result):
    """The result of a self-test, as the command line prints it; the fields are those of SelfTest."""

    computed = ("planted", "detected", "passed")

    @property
    def succeeded(self) -> bool:
        return self.passed


def plant(only: Sequence[str], told: Told) -> Planted:
    """Run the self-test for the command line."""
    return Planted(**vars(selftest(only, told)))
