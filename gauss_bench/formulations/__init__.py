"""Formulations: the algebra of one textbook page each, Terms -> Solution. They know numpy and scipy, and nothing of linkages.

Those in CONTROLS are wrong on purpose: the suite must flag them, and they are kept out of every ranking.
"""

from collections import UserDict
from collections.abc import Callable
from pkgutil import resolve_name
from typing import Any

from gauss_bench.terms import Solution, Terms

Formulation = Callable[[Terms], Solution]


class Formulations(UserDict[str, Any]):
    """Formulations by name; one that is given as "module:function" of this package is imported when it is first used."""

    def __getitem__(self, name: str) -> Formulation:
        found: Formulation = self.data[name]
        return resolve_name(f"{__name__}.{found}") if isinstance(found, str) else found


FORMULATIONS = Formulations(
    gauss="gauss:gauss",
    gauss_pinv="gauss_pinv:gauss_pinv",
    lagrange="lagrange:lagrange",
    schur="schur:schur",
    udwadia_kalaba="udwadia_kalaba:udwadia_kalaba",
    yuan_ge_eq16="yuan_ge_eq16:yuan_ge_eq16",
)
CONTROLS = frozenset({"yuan_ge_eq16"})
