"""Formulations: functions that return the `Solution` of `Terms`, with numpy and scipy, and without any knowledge of linkages.

The formulations in CONTROLS are wrong on purpose. The suite must detect that their results are wrong, and excludes them from all
rankings.
"""

from collections import UserDict
from collections.abc import Callable
from pkgutil import resolve_name
from typing import Any

from gauss_bench.terms import Solution, Terms

Formulation = Callable[[Terms], Solution]


class Formulations(UserDict[str, Any]):
    """Formulations by name; a value "module:function" names a function of this package, which is imported when it is used."""

    def __getitem__(self, name: str) -> Formulation:
        """Return the formulation with a name."""
        entry: Formulation = self.data[name]
        return resolve_name(f"{__name__}.{entry}") if isinstance(entry, str) else entry


FORMULATIONS = Formulations(
    gauss="gauss:gauss",
    gauss_pinv="gauss_pinv:gauss_pinv",
    lagrange="lagrange:lagrange",
    schur="schur:schur",
    udwadia_kalaba="udwadia_kalaba:udwadia_kalaba",
    yuan_ge_eq16="yuan_ge_eq16:yuan_ge_eq16",
)
CONTROLS = frozenset({"yuan_ge_eq16"})
