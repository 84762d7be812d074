"""Start a worker under the interpreter of another environment: `PYTHON -I elsewhere.py`.

The worker imports this package from the path of this file, because the package is not installed in the other environment; the
worker can import no other package of this environment. If the interpreter cannot run a worker (too old, or no numpy), the program
prints the reason in one sentence and exits with EX_CONFIG. Old interpreters, from Python 3.6 on, must be able to parse this file.
"""

import importlib.util
import os
import runpy
import sys

OLDEST = (3, 11)


def why_unfit() -> str:
    """Return why this interpreter cannot run a worker, or an empty text."""
    here = f"Python {sys.version_info[0]}.{sys.version_info[1]} at {sys.executable}"
    if sys.version_info < OLDEST:
        return f"an engine's environment needs Python >= {OLDEST[0]}.{OLDEST[1]}; this is {here}"
    try:
        import numpy
    except ImportError as error:
        return f"an engine's environment needs numpy >= 2; {here} cannot import it ({error})"
    if int(numpy.__version__.split(".")[0]) < 2:
        return f"an engine's environment needs numpy >= 2; {here} has {numpy.__version__}"
    return ""


def start() -> None:
    """Import this package by its path, and run `worker.py` as the main program."""
    package = os.path.dirname(os.path.dirname(os.path.abspath(__file__)))
    name = os.path.basename(package)
    spec = importlib.util.spec_from_file_location(name, os.path.join(package, "__init__.py"), submodule_search_locations=[package])
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module  # before any import, because the environment may have another copy of the package
    spec.loader.exec_module(module)
    runpy.run_module(f"{name}.runs.worker", run_name="__main__", alter_sys=True)


if __name__ == "__main__":
    reason = why_unfit()
    if reason:
        sys.stderr.write(reason + "\n")
        sys.exit(os.EX_CONFIG)
    start()
