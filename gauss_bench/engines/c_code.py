"""Compile an engine's acceleration in C together with fixed-step integrators.

The engine's C source defines, for arrays q, v and a of length N,

    static void acceleration(double t, const double *q, const double *v, double *a)

This function is compiled in one file with the integrators, so that the compiler may inline it. The integrators use the methods of
`integrate/fixed_step.py`. The flag -ffast-math lets the compiler reorder sums, as a programmer who writes C for speed would do.
"""

import ctypes
import shutil
import subprocess
from collections.abc import Callable
from functools import lru_cache
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from gauss_bench.engines.base import Choice, sample_arrays
from gauss_bench.integrate.fixed_step import EVALUATIONS, step_counts, tableau
from gauss_bench.terms import Array
from gauss_bench.trajectory import RunFailure, Status, Trajectory, finite, in_a_sentence

FLAGS = ("-O3", "-march=native", "-ffast-math", "-fPIC")
LONGEST = 300.0  # [s] time limit of one run of the compiler
NO_COMPILER = "no C compiler: none of cc, gcc and clang is installed"

ACCELERATE = "void accelerate(double t, const double *q, const double *v, double *a) { acceleration(t, q, v, a); }"
METHODS = ("rk4", "dop853_fixed")


def compiler() -> str | None:
    """Return the path of a C compiler, or None if there is none."""
    return shutil.which("cc") or shutil.which("gcc") or shutil.which("clang")


def write_steps(name: str) -> str:
    """Write the C function of a Runge-Kutta method with the coefficients A, b, c, without terms whose coefficient is zero.

    Stage k evaluates x = q + h sum_j A_kj v_j, v_k = v + h sum_j A_kj a_j and a_k = acceleration(t + c_k h, x, v_k).
    """
    nodes, rows, weights = tableau(name)
    stages = ", ".join(f"v{k}[N], a{k}[N]" for k in range(len(weights)))
    lines = [
        f"void {name}(double *q, double *v, double t, double h, long steps)",
        "{",
        "    for (long k = 0; k < steps; k++) {",
        "    double at = t + k * h;",
        f"    double x[N], {stages};",
    ]
    for k, (node, row) in enumerate(zip(nodes, rows, strict=True)):
        velocity, acceleration = _write_sum(row, "v"), _write_sum(row, "a")
        stage = f"x[i] = q[i] + h * ({velocity}); v{k}[i] = v[i] + h * ({acceleration});"
        lines.append(f"    for (int i = 0; i < N; i++) {{ {stage} }}")
        lines.append(f"    acceleration(at + {node!r} * h, x, v{k}, a{k});")
    end = f"q[i] += h * ({_write_sum(weights, 'v')}); v[i] += h * ({_write_sum(weights, 'a')});"
    lines += [f"    for (int i = 0; i < N; i++) {{ {end} }}", "    }", "}", ""]
    return "\n".join(lines)


def _write_sum(row: Array, name: str) -> str:
    """Write a weighted sum of stages, such as "0.5 * v0[i] + 0.5 * v1[i]"."""
    return " + ".join(f"{float(x)!r} * {name}{k}[i]" for k, x in enumerate(row) if x) or "0.0"


class Code:
    """A compiled C function for the acceleration of N coordinates, and the compiled fixed-step integrators that call it."""

    def __init__(self, acceleration: str, n: int):
        """Compile the C source `acceleration` of a function for n coordinates, together with one integrator for each of METHODS.

        Raises:
            RunFailure: there is no compiler, or it rejects the source.
        """
        self.n = n
        self.library = _load_library("\n".join([f"#define N {n}", acceleration, ACCELERATE, *map(write_steps, METHODS)]))
        # Without these types ctypes passes an address as an int of 32 bits, and refuses a float.
        self.library.accelerate.argtypes = [ctypes.c_double, *[ctypes.c_void_p] * 3]
        for method in METHODS:
            getattr(self.library, method).argtypes = [*[ctypes.c_void_p] * 2, *[ctypes.c_double] * 2, ctypes.c_long]

    def step(self, integrator: str, q: Array, v: Array, t: float, h: float, count: int) -> None:
        """Take `count` steps of h [s] from time t [s], and overwrite q, v (n,), which must be contiguous."""
        getattr(self.library, integrator)(q.ctypes.data, v.ctypes.data, t, h, count)

    def acceleration(self, t: float, q: Array, v: Array) -> Array:
        """Return the acceleration (n,) at time t [s] and coordinates and rates q, v (n,)."""
        a, q, v = np.empty(self.n), np.ascontiguousarray(q, dtype=float), np.ascontiguousarray(v, dtype=float)
        self.library.accelerate(t, q.ctypes.data, v.ctypes.data, a.ctypes.data)
        return a


@lru_cache(maxsize=64)
def _load_library(source: str) -> ctypes.CDLL:
    """Compile a C source to a shared library, and load it into this process; a RunFailure if that is impossible."""
    program = compiler()
    if program is None:
        raise RunFailure(Status.SKIP, NO_COMPILER)
    with TemporaryDirectory() as folder:
        text, compiled, linked = f"{folder}/engine.c", f"{folder}/engine.o", f"{folder}/engine.so"
        Path(text).write_text(source)
        compiling = [program, *FLAGS, "-c", text, "-o", compiled]
        # not linked with -ffast-math, because loading such a library makes the whole process flush denormal numbers to zero
        linking = [program, "-shared", compiled, "-o", linked, "-lm"]
        for command in (compiling, linking):
            done = subprocess.run(command, capture_output=True, text=True, timeout=LONGEST, check=False)
            if done.returncode:
                raise RunFailure(Status.ERROR, f"{program} refuses the source: {in_a_sentence(done.stderr)}")
        return ctypes.CDLL(linked)


Advance = Callable[[Array, Array, float, float, int], None]  # takes (x, dx, t, h, count), and changes x and dx in place


class CompiledSteps:
    """A model whose steps from one sample to the next are compiled code; a subclass supplies the steps and the links' motion.

    Attributes:
        start: coordinates and rates (n,) at the beginning.
        advance: function that takes `count` steps of h [s] from x, dx (n,) at time t [s].
        note: the note of every trajectory.
        plan: for each interval between samples the number of steps and their size [s].
    """

    choice: Choice
    start: tuple[Array, Array]
    advance: Advance
    note: str

    def motion(self, t: Array, x: Array, dx: Array) -> tuple[Array, Array, Array]:
        """Return q, v, a (k, n_q) of the linkage at times t (k,) and states x, dx (k, n)."""
        raise NotImplementedError

    def prepare(self, times: Array, native: bool = True) -> None:
        self.times, self.plan = times, step_counts(times, self.choice.step)
        self.x, self.dx = sample_arrays(times, *self.start)

    def run(self) -> None:
        """For each interval between samples, copy the sample at its beginning, and take the steps in place in this copy."""
        for k, (count, h) in enumerate(self.plan):
            self.x[k + 1], self.dx[k + 1] = self.x[k], self.dx[k]
            self.advance(self.x[k + 1], self.dx[k + 1], float(self.times[k]), h, count)

    def read(self) -> Trajectory:
        """Return the samples in absolute coordinates; from the first sample that is not finite on, all are NaN."""
        reached = slice(finite(self.x, self.dx))  # the finite samples
        motion = np.array(self.motion(self.times[reached], self.x[reached], self.dx[reached]))  # (3, reached, n_q)
        q, v, a = np.full((3, len(self.times), motion.shape[2]), np.nan)
        q[reached], v[reached], a[reached] = motion
        steps = sum(count for count, _ in self.plan)
        return Trajectory(self.times, q, v, a, steps, EVALUATIONS[self.choice.integrator] * steps, self.note)
