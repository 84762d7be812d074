"""Validation and benchmarking of closed-loop planar linkage dynamics.

    load(name_or_path, scenario=None) -> Mechanism
    simulate(name_or_path, engine, ...) -> Simulation: one run, judged; what `gauss-bench simulate --json` prints
    history(simulation) -> History: all samples of a run as curves: observed points, energies, joint forces, motors, transmission
    compare(name_or_path, engines=None, ...) -> DataFrame, one row per engine, setting and step
    diagnose(name_or_path, engine, ...) -> Diagnosis: an engine's error split by its causes, with a verdict
    selftest(only=()) -> SelfTest: faults planted in the suite, and whether its own checks see them
    kinematics(name_or_path, ...) -> Kinematics: motion through a law, without forces
    recommend(name_or_path, position=...) -> Recommendation: the cheapest setting of each engine that holds an accuracy
    export(name_or_path, engine, out, ...) -> Export: a linkage as a file that runs without this package
    import_model(file, out, ...) -> Import: a planar model in MJCF or URDF as a linkage file
    certify(name_or_path, ...) -> Certificate: the truth with its own error bar
    doctor() -> Checkup: what this machine has, and whether each engine runs on it
    compile_kernel(mechanism, formulation="auto", stabilization="none", ...) -> Kernel: native code of a linkage

Each is loaded when first asked for, so that importing the package costs nothing.
"""

import sys
from importlib import import_module
from types import ModuleType
from typing import Any

__version__ = "0.1.0"
__all__ = [
    "Checkup",
    "Diagnosis",
    "Export",
    "History",
    "Import",
    "Kernel",
    "Kinematics",
    "Recommendation",
    "SelfTest",
    "Simulation",
    "__version__",
    "certify",
    "compare",
    "compile_kernel",
    "diagnose",
    "doctor",
    "export",
    "history",
    "import_model",
    "kinematics",
    "load",
    "recommend",
    "selftest",
    "simulate",
]

_HOMES = {
    "load": "gauss_bench.linkage.load:load",
    "simulate": "gauss_bench.api.simulate:simulate",
    "history": "gauss_bench.api.history:history",
    "History": "gauss_bench.trajectory:History",
    "compare": "gauss_bench.api.compare:compare",
    "diagnose": "gauss_bench.api.diagnose:diagnose",
    "Diagnosis": "gauss_bench.api.diagnose:Diagnosis",
    "selftest": "gauss_bench.api.selftest:selftest",
    "SelfTest": "gauss_bench.diagnosis.selftest:SelfTest",
    "kinematics": "gauss_bench.api.kinematics:kinematics",
    "recommend": "gauss_bench.api.recommend:recommend",
    "Recommendation": "gauss_bench.api.recommend:Recommendation",
    "export": "gauss_bench.api.exchange:export",
    "import_model": "gauss_bench.api.exchange:import_model",
    "Import": "gauss_bench.api.exchange:Import",
    "Export": "gauss_bench.api.exchange:Export",
    "doctor": "gauss_bench.api.doctor:doctor",
    "Checkup": "gauss_bench.api.doctor:Checkup",
    "certify": "gauss_bench.reference.certify:certify",
    "compile_kernel": "gauss_bench.compiler.kernel:compile_kernel",
    "Kernel": "gauss_bench.compiler.kernel:Kernel",
    "Simulation": "gauss_bench.api.simulate:Simulation",
    "Kinematics": "gauss_bench.api.kinematics:Kinematics",
}


def __getattr__(name: str) -> Any:
    if name in _HOMES:
        module, _, item = _HOMES[name].partition(":")
        return getattr(import_module(module), item)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


class _Package(ModuleType):
    """The package, in which a room does not hide the function of the same name: rooms are found by importing them."""

    def __setattr__(self, name: str, value: object) -> None:
        if not (name in _HOMES and isinstance(value, ModuleType)):
            super().__setattr__(name, value)


sys.modules[__name__].__class__ = _Package
