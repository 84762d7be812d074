"""Deprecated: `gauss_bench.compiler.closure`."""

import warnings
from typing import Any

from gauss_bench.compiler.closure import Closure
from gauss_bench.compiler.closure import compile_closure as compile_closure_of

__all__ = ["Closure", "compile_closure"]


def compile_closure(*arguments: Any, **options: Any) -> Closure:
    """As gauss_bench.compiler.closure.compile_closure, with a warning."""
    text = "gauss_bench.kernels.closure is now gauss_bench.compiler.closure, and goes with the next release"
    warnings.warn(text, DeprecationWarning, stacklevel=2)
    return compile_closure_of(*arguments, **options)
