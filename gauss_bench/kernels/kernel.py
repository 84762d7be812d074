"""Deprecated: `gauss_bench.compile_kernel` and `gauss_bench.Kernel`."""

import warnings
from typing import Any

from gauss_bench.compiler.kernel import Kernel, compile_kernel

__all__ = ["Kernel", "compile"]


def compile(*arguments: Any, **options: Any) -> Kernel:
    """As compile_kernel, with a warning."""
    text = "gauss_bench.kernels.kernel.compile is now gauss_bench.compile_kernel, and goes with the next release"
    warnings.warn(text, DeprecationWarning, stacklevel=2)
    return compile_kernel(*arguments, **options)
