"""The former name of the module `interpreted`, which is kept for one release."""

import warnings

from gauss_bench.engines.interpreted import Interpreted as Native
from gauss_bench.engines.interpreted import InterpretedModel as NativeModel

__all__ = ["Native", "NativeModel"]

warnings.warn("gauss_bench.engines.native is now gauss_bench.engines.interpreted", DeprecationWarning, stacklevel=2)
