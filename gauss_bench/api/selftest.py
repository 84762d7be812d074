"""The self-test, which shows whether the suite notices faults: what `gauss-bench selftest` prints."""

from collections.abc import Sequence
from dataclasses import asdict

from gauss_bench.api.telling import Answer, Told, nobody
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


def plant(only: Sequence[str], told: Told) -> Answer:
    """Run the self-test for the command line."""
    found = selftest(only, told)
    return Answer(asdict(found) | {"planted": found.planted, "detected": found.detected, "passed": found.passed}, found.passed)
