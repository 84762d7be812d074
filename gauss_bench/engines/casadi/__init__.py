"""CasADi with SUNDIALS.

`equations` writes the equations of motion in CasADi's symbols, and `functions` makes casadi.Function objects of them. `adapter`
integrates them with IDAS and CVODES, and `equal_steps` with equal steps in generated C.
"""

from gauss_bench.engines.casadi.functions import Functions, functions

__all__ = ["Functions", "functions"]
