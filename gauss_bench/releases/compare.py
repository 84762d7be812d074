"""Compare the answers of two releases: equal answers, differences by rounding, and real changes.

An answer is an array, and the difference of two answers is relative to the size of each row. Rounding is the largest difference
that a start changed by 1e-14 makes in either release. A difference is real if it exceeds MARGIN times the rounding, and FLOOR,
because a library that was compiled again may add in another order. If one release's answer is steady and the other's scatters, only
the rounding of the steady release counts: that the other scatters is a real change.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

import numpy as np

from gauss_bench.terms import Array

# An iterative solver may stop one iteration earlier, which multiplies rounding, by up to 40 in MuJoCo's PGS with welds.
MARGIN = 50.0
FLOOR = 1e-12  # relative: another order of sums changes some units of the last place, times the condition number
STEADY, SCATTERED = 1e-6, 1e-3  # relative: an answer with rounding below STEADY is steady, above SCATTERED it is arbitrary
FLOOR_OF_COUNTS = 0.02  # relative, for numbers of steps: by rounding an integrator may reject one step more
SMALL = 0.05  # a row is compared with its own size, but at least with this share of the largest row
STEPS, DEFAULT, CLOSURE = "steps over 1 s", "default", "closure"
OK = "ok"

Key = tuple[str, str, str]


@dataclass(frozen=True, eq=False)
class Figure:
    """An answer of a release.

    Attributes:
        quantity, case, setting: names of the question; together they are the figure's key.
        status, message: "ok", or the kind and reason of a failure.
        values: (k, n) the answer.
        shifted: (s, k, n) the answers from s changed starts.
        error: error against the truth.
        text: the answer if it is no array but a default value.
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
        """The names of the question."""
        return self.quantity, self.case, self.setting

    @property
    def rounding(self) -> float:
        """The largest relative difference that a changed start makes; infinite without an answer from a changed start."""
        return max((relative_difference(self.values, x) for x in self.shifted), default=float("inf"))


@dataclass(frozen=True)
class Change:
    """The comparison of one figure of two neighbouring releases.

    Attributes:
        quantity, case, setting: key of the figure.
        is_real: whether the change is more than rounding.
        difference, rounding: relative; NaN for texts and failures.
        error_before, error_after: errors of both answers against the truth.
        was, now: texts of defaults, and of figures for which one release has no answer.
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
    """Return the largest difference of two arrays (k, n) relative to the size of the row; infinite if the shapes differ."""
    if a.shape != b.shape:
        return float("inf")
    sizes = np.maximum(np.abs(a), np.abs(b)).max(axis=1, initial=0.0)
    sizes = np.maximum(sizes, SMALL * sizes.max(initial=0.0))
    gaps = np.abs(a - b).max(axis=1, initial=0.0)
    shares = np.divide(gaps, sizes, out=np.zeros_like(gaps), where=sizes > 0)
    return float(shares.max(initial=0.0))


def compare_figures(before: Figure, after: Figure) -> Change | None:
    """Return the comparison of a figure in two releases; None if neither has an answer, or if both have the same text.

    An answer counts as changed if only one release has it, if its text differs, or if its numbers differ by more than rounding.
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
    """Return the comparisons of all figures that both releases were asked for, and of defaults that at least one has."""
    old, new = ({x.key: x for x in figures} for figures in (before, after))
    changes = []
    for key in dict.fromkeys((*old, *new)):
        pair = old.get(key) or _lacking(key), new.get(key) or _lacking(key)
        if (key in old and key in new) or key[0] == DEFAULT:
            change = compare_figures(*pair)
            if change:
                changes.append(change)
    return changes


def _lacking(key: Key) -> Figure:
    """Return a figure without an answer, in place of a default value that a release does not have."""
    return Figure(*key, status="skip", message="not there")


def real(changes: Sequence[Change]) -> list[Change]:
    """Return the real changes, the largest first, and last those without a size, such as new defaults."""
    found = [x for x in changes if x.is_real]
    return sorted(found, key=lambda x: (-x.difference if np.isfinite(x.difference) else 0.0, x.quantity, x.case, x.setting))
