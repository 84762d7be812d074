"""Pinocchio by its own symbolic scalar, as its authors advise where speed counts: for now a row that says what is missing.

`pinocchio.casadi` is built with conda, Nix or from source; the wheel has none yet, because CasADi's own wheel cannot be linked with
(https://github.com/stack-of-tasks/pinocchio/issues/2759). While that is so nothing can be tried here, and nothing is claimed.
"""

from importlib.util import find_spec

from gauss_bench.engines.base import Choice
from gauss_bench.mechanism.model import Mechanism
from gauss_bench.trajectory import RunFailure, Status

SETTINGS: dict[str, dict[str, object]] = {"default": {"code": "generated C"}}


class PinocchioCasadi:
    """The engine that would be."""

    name = "pinocchio_casadi"
    integrators = ("rk4", "dop853_fixed")
    stabilizations = ("none",)
    settings = SETTINGS
    native_loop = True
    python_loop = False

    def version(self) -> str:
        import pinocchio

        return f"Pinocchio {pinocchio.__version__}, {'with' if self._there() else 'without'} pinocchio.casadi"

    def skip(self, mechanism: Mechanism, choice: Choice) -> str | None:
        if not self._there():
            return "pinocchio.casadi is not in this build of Pinocchio: wheels have none yet (its tracker, issue 2759)"
        return "pinocchio.casadi is here, but the model that would use it is not written"

    def in_python(self, mechanism: Mechanism, choice: Choice) -> str:
        return ""

    def build(self, mechanism: Mechanism, choice: Choice) -> "PinocchioCasadi":
        raise RunFailure(Status.SKIP, str(self.skip(mechanism, choice)))

    def _there(self) -> bool:
        return bool(find_spec("pinocchio") and find_spec("pinocchio.casadi"))
