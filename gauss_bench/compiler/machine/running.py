"""A routine as it runs: as machine code of this host, or on arrays of numpy where there is no compiler."""

import threading
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from gauss_bench.compiler.machine import native_code
from gauss_bench.compiler.machine.llvm import listing
from gauss_bench.compiler.machine.native_code import Buffers, NativeCode, address
from gauss_bench.compiler.machine.routine import Routine
from gauss_bench.compiler.machine.source import in_python
from gauss_bench.terms import Array

CHUNK = 4096  # trajectories at a time on arrays: they share what a call of numpy costs, and a step has hundreds


@dataclass(frozen=True)
class Target:
    """Where code is to run: backend "llvm" or "numpy", trajectories in one vector, whether object code is kept on disk."""

    backend: str
    lanes: int
    cache: bool


class Loaded:
    """A routine as it runs on a target: one lane for a single trajectory, `lanes` of them for many.

    Attributes:
        codes: the machine code that has been compiled or loaded so far, by lanes.
    """

    def __init__(self, make: Callable[[bool], Routine], target: Target):
        self.make, self.target = make, target
        self.codes: dict[int, NativeCode] = {}
        self.own = Buffers()
        self._lock = threading.Lock()
        self._plain = in_python(make(True)) if target.backend == "numpy" else None

    def lanes(self, count: int) -> int:
        """Trajectories in one group, of so many."""
        return min(count, CHUNK) if self._plain else 1 if count == 1 else self.target.lanes

    def call(self, lanes: int) -> Any:
        """Takes arrays, numbers and counts of the routine, and groups."""
        if self._plain:
            return self._plain
        with self._lock:
            if lanes not in self.codes:
                made = listing(self.make(lanes > 1), lanes, native_code.best_lanes())
                self.codes[lanes] = native_code.compile_listing(made, self.target.cache)
            return self.codes[lanes].call

    def given(self, arrays: list[Array]) -> list[Any]:
        """Arrays as `call` takes them."""
        return list(arrays) if self._plain else [address(x) for x in arrays]
