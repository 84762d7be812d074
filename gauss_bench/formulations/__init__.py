"""The algebra of one textbook page each: Terms -> Solution. A formulation knows numpy and nothing of linkages.

Those in CONTROLS are wrong on purpose: the suite must flag them, and they are kept out of every ranking.
"""

from collections.abc import Callable

from gauss_bench.formulations.gauss import gauss
from gauss_bench.formulations.gauss_pinv import gauss_pinv
from gauss_bench.formulations.lagrange import lagrange
from gauss_bench.formulations.schur import schur
from gauss_bench.formulations.udwadia_kalaba import udwadia_kalaba
from gauss_bench.formulations.yuan_ge_eq16 import yuan_ge_eq16
from gauss_bench.terms import Solution, Terms

Formulation = Callable[[Terms], Solution]

FORMULATIONS: dict[str, Formulation] = {
    "gauss": gauss,
    "gauss_pinv": gauss_pinv,
    "lagrange": lagrange,
    "schur": schur,
    "udwadia_kalaba": udwadia_kalaba,
    "yuan_ge_eq16": yuan_ge_eq16,
}
CONTROLS = frozenset({"yuan_ge_eq16"})
