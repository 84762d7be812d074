"""Machine code of this host: parse LLVM's text, generate object code, load it, and call it.

This is the only file that imports llvmlite. Object code is kept in the user's cache folder (`user_cache.py`), so that a linkage is
compiled once on a machine. The arithmetic of a routine has already been regrouped (`rewrite.py`): LLVM only generates code, and
runs no pass that could change rounding.
"""

import ctypes
import hashlib
import os
import threading
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cache, lru_cache
from importlib.util import find_spec
from itertools import count as numbers_from
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gauss_bench.compiler import user_cache
from gauss_bench.compiler.errors import KernelError
from gauss_bench.compiler.machine.llvm import Listing, write_listing
from gauss_bench.compiler.machine.routine import Routine
from gauss_bench.compiler.machine.source import make_python
from gauss_bench.terms import Array

Flags = NDArray[np.bool_]

BACKENDS = ("llvm", "numpy")
VERSION = "1"  # version of the entries in the cache
LARGE = 10_000  # number of operations above which code is generated at a lower level of optimisation, in a tenth of the time
QUICK = "GAUSS_BENCH_QUICK_CODE"  # environment variable: if it is set, code compiles sooner and runs longer, with the same results
KEPT = 64  # number of functions that stay loaded; unloading a function frees only a part of its memory
_numbers = numbers_from()  # 0, 1, 2 ... for the names of loaded modules, which must be unique
KINDS = {"p": ctypes.c_void_p, "d": ctypes.c_double, "i": ctypes.c_int64}  # types of arguments, by letters of a signature


def available() -> bool:
    """Tell whether llvmlite can be imported."""
    return find_spec("llvmlite") is not None


class NativeCode:
    """The function of an LLVM module, compiled or from the cache, and loaded.

    Attributes:
        call: the function, with arguments of the kinds in `signature` (letters of KINDS). Python's global interpreter lock is
            released while the function runs.
        packed: a variant of `call` with one argument, the address of a block with all arguments; None if the compiled text has no
            such variant.
        seconds: time [s] that was needed to compile or to load the function.
        owner: object that keeps the machine code in memory.
    """

    def __init__(self, listing: Listing, cached: bool = True):
        """Compile an LLVM module given as text, or load its object code from the cache."""
        start = time.perf_counter()
        level = 3 if listing.operations <= LARGE else 1  # of LLVM's optimisation; no level changes rounding
        if os.environ.get(QUICK):
            level = 0
        key = _key(listing.text, level)
        code = user_cache.load(f"{key}.o") if cached else None
        self.from_cache, self.signature = code is not None, listing.signature
        if code is None:
            module = _binding().parse_assembly(listing.text)
            module.verify()
            code = bytes(_target_machine(level).emit_object(module))
            if cached:
                user_cache.store(f"{key}.o", code)
        load = _load_once if cached else _load
        self.call, self.packed, self.owner = load(code, listing.name, listing.packed, listing.signature)
        self.seconds = time.perf_counter() - start


@cache
def _binding() -> Any:
    """Return the module llvmlite.binding, prepared to generate code for this host."""
    import llvmlite.binding as llvm

    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    return llvm


@cache
def host() -> tuple[str, str]:
    """Return LLVM's name of the processor, and the processor's features, such as "+avx2,+fma", as one text."""
    llvm = _binding()
    return str(llvm.get_host_cpu_name()), str(llvm.get_host_cpu_features().flatten())


def best_lanes() -> int:
    """Return the number of doubles in the widest vector of the host: 8 with AVX-512, 4 with AVX2, 2 elsewhere."""
    if not available():  # without llvmlite there is no native code, and results in numpy do not depend on the number of lanes
        return 8
    _, features = host()
    if "+avx512f" in features.split(","):
        return 8
    return 4 if "+avx2" in features.split(",") else 2


def _key(text: str, level: int) -> str:
    """Return the name of object code in the cache: a hash of the module's text, the optimisation level, LLVM and the processor."""
    import llvmlite

    parts = (VERSION, llvmlite.__version__, str(_binding().llvm_version_info), *host(), str(level), text)
    return hashlib.sha256("\0".join(parts).encode()).hexdigest()


def _target_machine(level: int) -> Any:
    """Return LLVM's generator of code for this processor, at a level of optimisation from 0 to 3."""
    cpu, features = host()
    target = _binding().Target.from_default_triple()
    return target.create_target_machine(cpu=cpu, features=features, opt=level, reloc="pic", codemodel="small")


@cache
def _linker() -> Any:
    """Return the linker of object code; it puts all code of a module side by side, as the small code model requires."""
    return _binding().create_lljit_compiler(_target_machine(1), use_jit_link=True)


def _load(code: bytes, name: str, packed: str, signature: str) -> tuple[Any, Any, Any]:
    """Load object code.

    Return the function `name`, its variant `packed` that takes the address of a block of all arguments (None if `packed` is ""),
    and the object that must be kept alive so that both functions stay in memory.
    """
    unit = _binding().JITLibraryBuilder().add_object_img(code).export_symbol(name)
    if packed:
        unit.export_symbol(packed)
    unit.add_current_process()  # finds fma() of the C library, which code for a processor without fused multiply-add calls
    owner = unit.link(_linker(), f"{name}{next(_numbers)}")
    prototype = ctypes.CFUNCTYPE(None, *(KINDS[kind] for kind in signature))
    # no argument types are declared for the packed variant: its one argument, a c_void_p, needs no conversion
    compact = ctypes.CFUNCTYPE(None)(owner[packed]) if packed else None
    return prototype(owner[name]), compact, owner


_load_once = lru_cache(KEPT)(_load)


def in_lanes(x: Array, lanes: int) -> Array:
    """Return states (k, rows) as an array (groups, rows, lanes) with one state per lane.

    The last state is repeated to fill the last group of lanes.
    """
    missing = -len(x) % lanes
    full = np.concatenate([x, np.repeat(x[-1:], missing, axis=0)]) if missing else x
    return np.ascontiguousarray(full.reshape(len(full) // lanes, lanes, x.shape[1]).transpose(0, 2, 1))


def out_of_lanes(x: Array, count: int) -> Array:
    """Return the first `count` trajectories of an array (groups, ..., rows, lanes) as an array (count, ..., rows)."""
    moved = np.moveaxis(x, -1, 1)
    return np.ascontiguousarray(moved.reshape(-1, *moved.shape[2:])[:count])


def share(compute: Callable[[int, int], None], groups: int, threads: int) -> None:
    """Divide groups of trajectories among threads: each thread calls compute(low, high) for the groups low to high - 1."""
    count = min(threads, groups)
    if count < 2:  # no pool of threads, because its start takes as long as a hundred samples
        compute(0, groups)
        return
    bounds = np.linspace(0, groups, count + 1).astype(int).tolist()
    with ThreadPoolExecutor(count) as pool:
        list(pool.map(compute, bounds[:-1], bounds[1:]))  # the list waits for all of them, and raises their errors


def address(x: Array) -> int:
    """Return the address in memory of an array's first number."""
    return int(x.__array_interface__["data"][0])


def aligned_zeros(size: int) -> Array:
    """Return zeros (size,) aligned to 64 bytes, so that no vector straddles two cache lines."""
    room = np.zeros(size + 8)  # 64 bytes are 8 doubles
    start = -(address(room) // room.itemsize) % 8  # number of doubles up to the next multiple of 64 bytes
    return room[start : start + size]


class Single:
    """A routine in native code with memory for its arguments, for calls that compute one trajectory.

    The arguments are in a block of 8-byte words, whose address is passed to the code: addresses of arrays, then real numbers,
    then counts (integers). A caller changes them in place, because a conversion of new arguments takes as long as several steps.

    Attributes:
        q, v: views of the two halves of the first array, which is a state: positions and velocities.
        numbers, counts: views of the real numbers and of the counts in the block of arguments, to be set before a call. All counts
            are 1 at first; the last count is the number of groups of trajectories, and stays 1.
    """

    __slots__ = ("_block", "_code", "_packed", "arrays", "counts", "numbers", "q", "v")

    def __init__(self, code: NativeCode, sizes: Sequence[int]):
        """Prepare the arguments of a routine; `sizes` are the numbers of doubles in its arrays."""
        self.arrays = [aligned_zeros(size) for size in sizes]
        block = aligned_zeros(len(code.signature))  # addresses of arrays, then real numbers, then counts
        integers, first_number = block.view(np.int64), len(sizes)
        first_count = first_number + code.signature.count("d")
        integers[:first_number] = [address(x) for x in self.arrays]
        self.numbers, self.counts = block[first_number:first_count], integers[first_count:]
        self.counts[:] = 1
        half = sizes[0] // 2
        self.q, self.v = self.arrays[0][:half], self.arrays[0][half:]
        self._block, self._packed, self._code = ctypes.c_void_p(address(block)), code.packed, code

    def run(self) -> None:
        """Call the code; results are in `arrays`."""
        self._packed(self._block)


class OfThread(threading.local):
    """The `Single` of a routine that belongs to the calling thread; None before the thread's first call."""

    single: Single | None = None


CHUNK = 4096  # trajectories that numpy steps at a time: they share the fixed cost of its calls, and a step has hundreds of calls


@dataclass(frozen=True)
class Target:
    """The target for which code is generated.

    Attributes:
        backend: "llvm" or "numpy".
        lanes: number of trajectories in one SIMD vector.
        cache: whether object code is kept on disk.
    """

    backend: str
    lanes: int
    cache: bool


def choose_target(backend: str | None, lanes: int | None, cache: bool) -> Target:
    """Choose the target of code: by default llvm if it is installed, else numpy, and lanes for the widest vector register.

    Raises:
        KernelError: the backend is unknown or not installed, or the number of lanes is below 1 or, with llvm, not a power of 2.
    """
    if backend not in (None, *BACKENDS):
        raise KernelError(f"no backend {backend}; there are {', '.join(BACKENDS)}")
    if backend == "llvm" and not available():
        raise KernelError("the backend llvm needs the package llvmlite: pip install 'gauss-bench[kernel]'")
    chosen = backend or ("llvm" if available() else "numpy")
    width = best_lanes() if lanes is None else lanes
    if width < 1 or (chosen == "llvm" and width.bit_count() != 1):
        raise KernelError(f"the number of lanes must be a power of 2, not {width}")
    return Target(chosen, width, cache)


class Loaded:
    """A routine that can be called: as machine code, or as a Python function if the backend is numpy.

    Machine code has one lane for a single trajectory, and `target.lanes` for several; `make` is called with True for several.

    Attributes:
        codes: number of lanes -> machine code, which is compiled, or loaded from the cache, when it is first needed.
    """

    def __init__(self, make: Callable[[bool], Routine], target: Target):
        """Prepare a routine; with the backend numpy, it is written as a Python function at once."""
        self.make, self.target = make, target
        self.codes: dict[int, NativeCode] = {}
        self.of_thread = OfThread()
        self._lock = threading.Lock()
        self._python = make_python(make(True)) if target.backend == "numpy" else None  # replaces machine code

    def lanes(self, count: int) -> int:
        """Return how many of `count` trajectories are computed together, as one group."""
        if self._python:  # numpy computes arrays of any length
            return min(count, CHUNK)
        return 1 if count == 1 else self.target.lanes

    def call(self, lanes: int) -> Any:
        """Return the function that computes groups of `lanes` trajectories; if necessary, compile its machine code first.

        Its arguments are those of the routine, followed by the number of groups.
        """
        if self._python:  # the Python function computes any number of trajectories
            return self._python
        with self._lock:
            if lanes not in self.codes:
                self.codes[lanes] = NativeCode(write_listing(self.make(lanes > 1), lanes), self.target.cache)
            return self.codes[lanes].call

    def as_arguments(self, arrays: list[Array]) -> list[Any]:
        """Return arrays as arguments of the function that `call` returns: addresses for machine code, unchanged for Python."""
        return list(arrays) if self._python else [address(x) for x in arrays]

    def single(self, *sizes: int) -> Single:
        """Return this thread's `Single`, made in the thread's first call; `sizes` are the numbers of doubles in the arrays."""
        if self.of_thread.single is None:
            self.call(1)  # compiles the code with one lane, if it is not there yet
            self.of_thread.single = Single(self.codes[1], sizes)
        return self.of_thread.single
