"""CasADi with SUNDIALS, and CasADi's differentiation as a second derivation of everything the suite writes by hand.

`equations` derives the equations of motion from positions alone, `functions` gives them away as casadi.Function objects, `adapter`
integrates them with IDAS and CVODES, `equal_steps` in generated C.
"""

from gauss_bench.engines.casadi.functions import Functions, functions

__all__ = ["Functions", "functions"]
