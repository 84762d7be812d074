"""The self-test, which shows whether the suite notices faults: what `gauss-bench selftest` prints."""

from collections.abc import Callable, Sequence
from dataclasses import asdict
from typing import Any

from gauss_bench.diagnosis.selftest import KINDS, SelfTest
from gauss_bench.diagnosis.selftest import selftest as planted
from gauss_bench.runs.offers import ChoiceError


def selftest(only: Sequence[str] = (), told: Callable[[str], object] = id) -> SelfTest:
    """Plant known faults in memory and see whether the suite's own checks speak, and are silent where there is none.

    Args:
        only: kinds of faults; all where not given.
        told: is told how far things are.

    Raises:
        ChoiceError: an unknown kind.
    """
    for kind in only:
        if kind not in KINDS:
            raise ChoiceError(f"no faults of the kind {kind!r}; there are {', '.join(KINDS)}")
    return planted(only, told)


def as_dict(selftest: SelfTest) -> dict[str, Any]:
    """As `--json` prints it."""
    return asdict(selftest) | {"planted": selftest.planted, "detected": selftest.detected, "passed": selftest.passed}
