"""Text of LLVM becomes machine code of this host: parse, optimise, emit an object, load it.

The only file that knows llvmlite. Object code is kept in the user's cache folder (object_cache.py), so that a linkage compiles
once on a machine. What the graph has rewritten already is not optimised again: code generation alone does the work, and no pass
may touch rounding.
"""

import ctypes
import hashlib
import time
from dataclasses import dataclass, field
from functools import cache
from importlib.util import find_spec
from typing import Any

from gauss_bench.compiler.machine import object_cache

VERSION = "1"  # of what is kept in the cache
LARGE = 10_000  # operations; beyond it the cheaper code generator, which takes a tenth of the time
SIGNATURES = {
    "rollout": ("ppddiippii"),
    "accelerate": ("ppppi"),
    "follow": ("pppppppdiii"),
}
KINDS = {"p": ctypes.c_void_p, "d": ctypes.c_double, "i": ctypes.c_int64}


def available() -> bool:
    """Whether llvmlite can be imported."""
    return find_spec("llvmlite") is not None


@dataclass(frozen=True, eq=False)
class NativeCode:
    """A loaded function.

    Attributes:
        call: takes addresses and numbers; the lock of the interpreter is free while it runs.
        seconds: to compile or to load.
        from_cache: whether the object code was there.
        owner: keeps the machine code in memory.
    """

    call: Any
    seconds: float
    from_cache: bool
    owner: Any = field(repr=False)


@cache
def _binding() -> Any:
    import llvmlite.binding as llvm

    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    return llvm


@cache
def host() -> tuple[str, str]:
    """Name and features of the processor."""
    llvm = _binding()
    return str(llvm.get_host_cpu_name()), str(llvm.get_host_cpu_features().flatten())


def best_lanes() -> int:
    """Doubles in the widest vector of the host: 8 with AVX-512, 4 with AVX2, 2 elsewhere."""
    if not available():
        return 8
    features = _binding().get_host_cpu_features()
    return 8 if features.get("avx512f") else 4 if features.get("avx2") else 2


def compile_text(text: str, name: str, operations: int, cached: bool = True) -> NativeCode:
    """The function `name` of a module given as text."""
    start = time.perf_counter()
    machine = _target_machine(3 if operations <= LARGE else 1)
    key = _key(text, operations)
    code = object_cache.load(key) if cached else None
    found = code is not None
    if code is None:
        module = _binding().parse_assembly(text)
        module.verify()
        code = bytes(machine.emit_object(module))
        if cached:
            object_cache.store(key, code)
    call, owner = _loaded(code, name, machine)
    return NativeCode(call, time.perf_counter() - start, found, owner)


def _key(text: str, operations: int) -> str:
    import llvmlite

    parts = (VERSION, llvmlite.__version__, str(_binding().llvm_version_info), *host(), str(operations > LARGE), text)
    return hashlib.sha256("\0".join(parts).encode()).hexdigest()


def _target_machine(level: int) -> Any:
    cpu, features = host()
    target = _binding().Target.from_default_triple()
    return target.create_target_machine(cpu=cpu, features=features, opt=level, reloc="pic", codemodel="small")


def _loaded(code: bytes, name: str, machine: Any) -> tuple[Any, Any]:
    llvm = _binding()
    engine = llvm.create_mcjit_compiler(llvm.parse_assembly(""), machine)
    engine.add_object_file(llvm.ObjectFileRef.from_data(code))
    engine.finalize_object()
    prototype = ctypes.CFUNCTYPE(None, *(KINDS[kind] for kind in SIGNATURES[name]))
    return prototype(engine.get_function_address(name)), engine
