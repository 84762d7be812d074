"""Pinocchio with symbolic scalars, which its authors recommend for speed; the engine reports that the wheel does not have them.

Conda and Nix have builds with the module `pinocchio.casadi`, and a build from source can have it. Pinocchio's wheel does not have
`pinocchio.casadi`, because nothing can be linked against CasADi's wheel (https://github.com/stack-of-tasks/pinocchio/issues/2759).
So the suite cannot run Pinocchio with symbolic scalars, and makes no claim about their speed.
"""

from importlib.util import find_spec

from gauss_bench.engines.base import Choice
from gauss_bench.engines.shared import LibraryEngine
from gauss_bench.mechanism.model import Mechanism
from gauss_bench.trajectory import RunFailure, Status

SETTINGS: dict[str, dict[str, object]] = {"default": {"code": "generated C"}}


class PinocchioCasadi(LibraryEngine):
    """An engine that refuses every linkage and says why."""

    name = "pinocchio_casadi"
    integrators = ("rk4", "dop853_fixed")
    settings = SETTINGS
    native_loop = True
    python_loop = False

    def version(self) -> str:
        import pinocchio

        return f"Pinocchio {pinocchio.__version__}, {'with' if self._is_installed() else 'without'} pinocchio.casadi"

    def skip(self, mechanism: Mechanism, choice: Choice) -> str | None:
        if not self._is_installed():
            return "pinocchio.casadi is not in this build of Pinocchio: wheels have none yet (its tracker, issue 2759)"
        return "pinocchio.casadi is here, but the model that would use it is not written"

    def build(self, mechanism: Mechanism, choice: Choice) -> "PinocchioCasadi":
        raise RunFailure(Status.SKIP, str(self.skip(mechanism, choice)))

    def _is_installed(self) -> bool:
        return bool(find_spec("pinocchio") and find_spec("pinocchio.casadi"))
