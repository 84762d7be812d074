"""Validation and benchmarking of closed-loop planar linkage dynamics.

    load(name_or_path, scenario=None) -> Mechanism
    simulate(name_or_path, engine, ...) -> Simulation: one run with the judge's verdict
    history(simulation) -> History: all samples of a run as curves
    compare(name_or_path, engines=None, ...) -> DataFrame, one row per engine, setting and step
    diagnose(name_or_path, engine, ...) -> Diagnosis: an engine's error split by its causes
    tune(model, out, position=...) -> Tuned: an MJCF file with settings that reach an accuracy
    selftest(only=()) -> SelfTest: faults planted in the suite, and whether its own checks detect them
    kinematics(name_or_path, ...) -> Kinematics: the motion under a given law, and with forces=True its loads
    recommend(name_or_path, position=...) -> Recommendation: the cheapest setting of each engine that reaches an accuracy
    export(name_or_path, engine, out, ...) -> Export: a linkage as a file that runs without this package
    import_model(file, out, ...) -> Import: a planar model in MJCF or URDF as a linkage file
    certify(name_or_path, ...) -> Certificate: a reference motion with its error bar
    doctor() -> Checkup: the installed libraries, and whether each engine runs
    compile_kernel(mechanism, formulation="auto", ...) -> Kernel: native code of a linkage

Each function is imported when it is first used, so that the package is quick to import.
"""

import sys
from pkgutil import resolve_name
from types import ModuleType
from typing import Any

__version__ = "1.0.0"
_NAMES = {  # module -> the public names in it
    "linkage.load": "load",
    "api.simulate": "simulate Simulation",
    "api.history": "history",
    "trajectory": "History",
    "api.compare": "compare",
    "api.diagnose": "diagnose Diagnosis",
    "api.tune": "tune Tuned",
    "api.selftest": "selftest",
    "diagnosis.selftest": "SelfTest",
    "api.kinematics": "kinematics Kinematics",
    "api.recommend": "recommend Recommendation",
    "api.exchange": "export Export import_model Import",
    "api.doctor": "doctor Checkup",
    "reference.certify": "certify",
    "compiler.kernel": "compile_kernel Kernel",
}
_PLACES = {name: f"gauss_bench.{module}:{name}" for module, names in _NAMES.items() for name in names.split()}
__all__ = ["__version__", *_PLACES]


def __getattr__(name: str) -> Any:
    """Import a public function or class from its module when it is first used."""
    if name in _PLACES:
        return resolve_name(_PLACES[name])
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


class _Package(ModuleType):
    """The class of this package; it keeps subpackages from replacing public functions of the same name (`kinematics`)."""

    def __setattr__(self, name: str, value: object) -> None:
        # Python sets an imported submodule as an attribute of the package, which would hide the function
        if not (name in _PLACES and isinstance(value, ModuleType)):
            super().__setattr__(name, value)


sys.modules[__name__].__class__ = _Package
