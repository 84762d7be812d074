"""Compare the results ("answers") of two releases: equal results, differences by rounding, and real changes.

A result is an array, and the difference of two results is relative to the size of each row. The rounding error of a result is
estimated by the largest change of the result, in either release, when the start is changed by a relative 1e-14. A difference counts
as real if it exceeds both MARGIN times this rounding error and FLOOR. FLOOR is needed because a library that was compiled again may
sum in another order. If the result of one release is steady and that of the other scatters, only the rounding error of the steady
release counts, so that the scatter of the other release is a real change.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

import numpy as np

from gauss_bench.terms import Array

# An iterative solver may stop one iteration earlier, which multiplies rounding, by up to 40 in MuJoCo's PGS with welds.
MARGIN = 50.0
FLOOR = 1e-12  # relative: another order of summation changes some units of the last place, times the condition number
STEADY, SCATTERED = 1e-6, 1e-3  # relative: an answer with rounding below STEADY is steady, above SCATTERED it is arbitrary
FLOOR_OF_COUNTS = 0.02  # relative, for numbers of steps: because of rounding, an integrator may reject one step more
SMALL = 0.05  # the difference in a row is divided by the row's size, but at least by this share of the largest row's size
STEPS, DEFAULT, CLOSURE = "steps over 1 s", "default", "closure"
OK = "ok"

Key = tuple[str, str, str]


@dataclass(frozen=True, eq=False)
class Figure:
    """One result of a release.

    Attributes:
        quantity, case, setting: what was computed, on which linkage, and with which setting; together they are the figure's key.
        status, message: "ok", or the kind and reason of a failure.
        values: (k, n) the result, if it is an array.
        shifted: (s, k, n) the results from s slightly changed starts.
        error: error of the result against the reference; NaN if unknown.
        text: the result, if it is the default value of an option.
    """

    quantity: str
    case: str
    setting: str
    status: str = OK
    message: str = ""
    values: Array = field(default_factory=lambda: np.zeros((0, 0)))
    shifted: Array = field(default_factory=lambda: np.zeros((0, 0, 0)))
    error: float = float("nan")
    text: str = ""

    @property
    def key(self) -> Key:
        """The names that identify this result among those of a release."""
        return self.quantity, self.case, self.setting

    @property
    def rounding(self) -> float:
        """The largest relative change of the result that a changed start causes; infinite if no changed start gave a result."""
        return max((relative_difference(self.values, x) for x in self.shifted), default=float("inf"))


@dataclass(frozen=True)
class Change:
    """The comparison of one result of two consecutive releases.

    Attributes:
        quantity, case, setting: what was computed, on which linkage, and with which setting.
        is_real: whether the change is larger than rounding explains.
        difference, rounding: relative difference between the two releases' results, and relative rounding error; both are NaN for
            texts and failures.
        error_before, error_after: error of the result of the earlier and of the later release against the reference.
        was, now: default value of an option in the earlier and in the later release; or, if only one release gave a result, "works"
            for this release and the reason of the failure for the other one.
    """

    quantity: str
    case: str
    setting: str
    is_real: bool
    difference: float = float("nan")
    rounding: float = float("nan")
    error_before: float = float("nan")
    error_after: float = float("nan")
    was: str = ""
    now: str = ""


def relative_difference(a: Array, b: Array) -> float:
    """Return the largest relative difference of two arrays (k, n); infinite if the shapes differ.

    The difference in a row is divided by the largest entry of the row, or by SMALL times the largest entry of all rows if this is
    larger.
    """
    if a.shape != b.shape:
        return float("inf")
    sizes = np.maximum(np.abs(a), np.abs(b)).max(axis=1, initial=0.0)
    sizes = np.maximum(sizes, SMALL * sizes.max(initial=0.0))
    gaps = np.abs(a - b).max(axis=1, initial=0.0)
    shares = np.divide(gaps, sizes, out=np.zeros_like(gaps), where=sizes > 0)
    return float(shares.max(initial=0.0))


def compare_figures(before: Figure, after: Figure) -> Change | None:
    """Return the comparison of a result of two releases; None if both failed, or if both have the same text.

    A change is real if only one release has a result, if texts differ, or if a difference is larger than rounding explains, as
    described at the top of this file.
    """
    if before.status != OK and after.status != OK:
        return None
    if before.status != OK or after.status != OK:
        was, now = (x.message if x.status != OK else x.text or "works" for x in (before, after))
        return Change(*before.key, True, error_before=before.error, error_after=after.error, was=was, now=now)
    if before.text or after.text:
        return None if before.text == after.text else Change(*before.key, True, was=before.text, now=after.text)
    difference = relative_difference(before.values, after.values)
    steadier, rounding = sorted((before.rounding, after.rounding))
    if steadier < STEADY and SCATTERED < rounding < np.inf:  # one release scatters and the other is steady: a change by itself
        rounding = steadier
    floor = FLOOR_OF_COUNTS if before.quantity == STEPS else FLOOR
    is_real = difference > max(MARGIN * rounding, floor)
    return Change(*before.key, is_real, difference, rounding, before.error, after.error)


def compare_releases(before: Iterable[Figure], after: Iterable[Figure]) -> list[Change]:
    """Return the comparisons of all results that both releases were to compute, and of options that only one of them has.

    Results without a comparison (`compare_figures`) are left out.
    """
    old, new = ({x.key: x for x in figures} for figures in (before, after))
    changes = []
    for key in dict.fromkeys((*old, *new)):
        quantity, *_ = key
        if (key in old and key in new) or quantity == DEFAULT:
            lacking = Figure(*key, status="skip", message="not there")  # stands for an option that a release does not have
            changes.append(compare_figures(old.get(key, lacking), new.get(key, lacking)))
    return [x for x in changes if x]


def real_changes(changes: Sequence[Change]) -> list[Change]:
    """Return the real changes, the largest first; changes without a size, such as new defaults, come last."""

    def rank(x: Change) -> tuple[float, str, str, str]:
        """Return the sort key of a change: minus its size, or 0 if it has none, and then its names."""
        return -x.difference if np.isfinite(x.difference) else 0.0, x.quantity, x.case, x.setting

    return sorted((x for x in changes if x.is_real), key=rank)
