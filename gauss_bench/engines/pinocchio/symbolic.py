"""Pinocchio with its symbolic scalar, which its authors recommend for speed; the engine reports that the wheel has none.

`pinocchio.casadi` is built with conda, Nix or from source. The wheel does not contain it, because CasADi's wheel cannot be linked
against (https://github.com/stack-of-tasks/pinocchio/issues/2759). As long as that is so, the suite cannot try it, and makes no
claim about its speed.
"""

from importlib.util import find_spec

from gauss_bench.engines.base import Choice
from gauss_bench.mechanism.model import Mechanism
from gauss_bench.trajectory import RunFailure, Status

SETTINGS: dict[str, dict[str, object]] = {"default": {"code": "generated C"}}


class PinocchioCasadi:
    """An engine that refuses every linkage, with the reason."""

    name = "pinocchio_casadi"
    integrators = ("rk4", "dop853_fixed")
    stabilizations = ("none",)
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

    def in_python(self, mechanism: Mechanism, choice: Choice) -> str:
        return ""

    def build(self, mechanism: Mechanism, choice: Choice) -> "PinocchioCasadi":
        raise RunFailure(Status.SKIP, str(self.skip(mechanism, choice)))

    def _is_installed(self) -> bool:
        return bool(find_spec("pinocchio") and find_spec("pinocchio.casadi"))
