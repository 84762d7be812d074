"""The suite's own formulations as machine code, generated for one mechanism.

One code generator writes the elimination of both formulations, so the two engines differ in the formulation alone.
"""

from collections.abc import Callable

import numpy as np

from gauss_bench import __version__
from gauss_bench.engines import require
from gauss_bench.engines.base import Choice, sample_arrays
from gauss_bench.engines.own_options import OptionTable
from gauss_bench.engines.shared import finite
from gauss_bench.integrate import BAUMGARTE_RATE
from gauss_bench.integrate.fixed_step import EVALUATIONS, equal_runs
from gauss_bench.mechanism.model import Mechanism
from gauss_bench.terms import Array
from gauss_bench.trajectory import RunFailure, Status, Trajectory

FORMULATIONS = {"gauss-native": "gauss", "lagrange-native": "lagrange"}
ADAPTIVE, IMPLICIT = "dop853", "gauss_legendre"
TOLERANCES = {"dop853_rtol": 1e-10, "dop853_atol": 1e-12}  # those of the interpreted engines
SETTINGS = {"default": {"baumgarte_alpha_beta_per_s": BAUMGARTE_RATE, "pivot_guard": "on", **TOLERANCES}}
KNOWN = OptionTable(SETTINGS, dict.fromkeys(("baumgarte_alpha_beta_per_s", *TOLERANCES), ()))


def compiler_version() -> str:
    """Return the versions of the suite and of the compiler library.

    Raises:
        MissingExtra: llvmlite is not installed.
    """
    from importlib.metadata import version

    require("llvmlite")
    return f"gauss-bench {__version__}, llvmlite {version('llvmlite')}"


class Compiled:
    """One compiled formulation as an engine."""

    integrators = ("rk4", "semi_implicit_euler", "dop853", "dop853_fixed", IMPLICIT)
    stabilizations = ("none", "baumgarte", "projection")
    settings = SETTINGS
    options = KNOWN.options
    resizable = True  # a built model can run with another step or tolerance
    native_loop = True
    python_loop = True

    def __init__(self, name: str):
        self.name = name

    def version(self) -> str:
        return compiler_version()

    def in_python(self, mechanism: Mechanism, choice: Choice) -> str:
        return ""

    def skip(self, mechanism: Mechanism, choice: Choice) -> str | None:
        return "dry friction is not compiled, because its forces are found by iteration" if mechanism.has_friction else None

    def build(self, mechanism: Mechanism, choice: Choice) -> "CompiledModel":
        compiler_version()  # raises if llvmlite is missing
        return CompiledModel(FORMULATIONS[self.name], mechanism, choice)


class CompiledModel:
    """A mechanism compiled under one formulation, integrator and stabilisation."""

    def __init__(self, formulation: str, mechanism: Mechanism, choice: Choice):
        """Compile the accelerations of a mechanism; `formulation` is "gauss" or "lagrange"."""
        from gauss_bench.compiler.errors import KernelError
        from gauss_bench.compiler.kernel import compile_kernel

        self.mechanism, self.choice, self.options = mechanism, choice, KNOWN.resolve(choice.settings)
        damping = (float(self.options["baumgarte_alpha_beta_per_s"]),) * 2
        try:
            self.kernel = compile_kernel(mechanism, formulation, choice.stabilization, backend="llvm", baumgarte=damping)
        except KernelError as error:
            raise RunFailure(Status.ERROR, str(error)) from error

    def acceleration(self, t: float, q: Array, v: Array) -> Array:
        return self.kernel.acceleration(q, v, t)

    def prepare(self, times: Array, native: bool = True) -> None:
        """Compile the integrator, reset to the start, and divide the times (k,) [s] into parts with equal steps."""
        self.kernel.prepare(self.choice.integrator)  # compiles here, so that no timed run compiles
        self.times, self.native = times, native
        # switches: number of changes of the independent coordinates; fallbacks: number of steps at which no choice of these
        # coordinates was usable, so the rank was decided numerically
        self.steps = self.evaluations = self.switches = self.fallbacks = 0
        self.parts, self.planned = equal_runs(times, self.choice.step), 0  # planned: number of steps of a run
        for part in self.parts:
            # if a force jumps within a step, the kernel divides this step, so a part becomes several legs of equal steps
            legs = self.kernel.legs(float(times[part.row]), part.size, part.steps * part.samples)
            self.planned += sum(leg.n for leg in legs)
        self.q, self.v = sample_arrays(times, self.mechanism.q0, self.mechanism.v0)

    def run(self) -> None:
        if self.choice.integrator != ADAPTIVE:
            self._run_fixed()
        elif self.times[-1] > self.times[0]:
            tolerances = self.choice.tolerances(self.options["dop853_rtol"], self.options["dop853_atol"])
            motion = self.kernel.integrate(self.q[0], self.v[0], self.times, *tolerances)
            self.q, self.v, self.steps, self.evaluations = motion.q, motion.v, motion.steps, motion.evaluations
            self.switches, self.fallbacks = self.kernel.switches, self.kernel.fallbacks

    def _run_fixed(self) -> None:
        """Take fixed steps; the native loop takes all steps of a part in one call: `intervals` times `count` steps of h [s]."""
        for row, count, h, intervals in self.parts:
            q, v, t = self.q[row], self.v[row], float(self.times[row])
            if self.native and intervals == 1:
                self.q[row + 1], self.v[row + 1] = self._roll(q, v, t, h, count, None)
            elif self.native:
                rows = slice(row + 1, row + 1 + intervals)
                self.q[rows], self.v[rows] = self._roll(q, v, t, h, count * intervals, count)
            else:
                for k in range(intervals):  # one call from Python per step, as a user's own loop would make
                    for i in range(count):
                        q, v = self._roll(q, v, t + (k * count + i) * h, h, 1, None)
                    self.q[row + 1 + k], self.v[row + 1 + k] = q, v
        self.steps = self.planned
        # An implicit step also evaluates finite differences for its Jacobian, in positions and in velocities.
        differences = 2 * self.kernel.directions if self.choice.integrator == IMPLICIT else 0
        self.evaluations = (EVALUATIONS[self.choice.integrator] + differences) * self.steps

    def _roll(self, q: Array, v: Array, t: float, h: float, n: int, every: int | None) -> tuple[Array, Array]:
        """Take n steps of h [s] from q, v (n_q,) at time t [s], and add the kernel's counts to `switches` and `fallbacks`.

        Return q, v after every `every`-th step, each (n / every, n_q), or if `every` is None after the last step, each (n_q,).
        """
        samples = self.kernel.rollout(q, v, h, n, t, every=every, integrator=self.choice.integrator)
        self.switches += self.kernel.switches
        self.fallbacks += self.kernel.fallbacks
        return samples

    def batch(self, q: Array, v: Array, count: int) -> Callable[[], Array]:
        """Return a function that takes `count` steps from states q, v (k, n) or (n,), and returns the last positions."""
        return lambda: np.asarray(self.kernel.rollout(q, v, self.choice.step, count, integrator=self.choice.integrator)[0])

    def read(self) -> Trajectory:
        """Return the samples, with the counts `switches` and `fallbacks` in the note."""
        reached, a = slice(finite(self.q, self.v)), np.full_like(self.q, np.nan)
        a[reached] = self.kernel.acceleration(self.q[reached], self.v[reached], self.times[reached])
        note = ""
        if self.switches or self.fallbacks:
            note = f"independent coordinates changed {self.switches} times; rank decided numerically in {self.fallbacks} steps"
        return Trajectory(self.times, self.q, self.v, a, self.steps, self.evaluations, note)
