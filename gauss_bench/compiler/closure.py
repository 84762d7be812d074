"""The kinematics of a linkage as native code: positions, velocities and accelerations at thousands of samples of its inputs.

closure = compile_closure(mechanism)
turn = closure.turn(3600)             # derivatives by the crank angle
sweep = closure.sweep(levels)         # angles, speeds and accelerations of the inputs
"""

from dataclasses import dataclass, replace
from math import ceil

import numpy as np

from gauss_bench.compiler.elimination.closing import ClosingProgram
from gauss_bench.compiler.machine.native_code import Target, choose_target
from gauss_bench.compiler.turns.tracker import Loss, Tracker
from gauss_bench.kinematics.loop_equations import LoopEquations
from gauss_bench.mechanism.model import AngleDriver, Mechanism
from gauss_bench.mechanism.motion_laws import constant
from gauss_bench.terms import Array

PARTS = 32  # number of samples that the backend numpy computes at once, so that they share the overhead of its calls


@dataclass(frozen=True, eq=False)
class Sweep:
    """States of a linkage at k samples.

    Attributes:
        q, v, a: (k, n) positions, velocities, accelerations of all links in the mechanism's absolute coordinates [m, rad]; angles
            are continuous from the start. All values are NaN at samples where the motion is lost.
        loss: sample at which the motion ended, and why; None if all samples were closed.
    """

    q: Array
    v: Array
    a: Array
    loss: Loss | None


def compile_closure(mechanism: Mechanism, lanes: int | None = None, backend: str | None = None) -> "Closure":
    """Compile the closure of a mechanism: code that computes its positions, velocities and accelerations from given inputs.

    The inputs are the coordinates that the scenario drives, or the crank's angle if the scenario drives none.

    Args:
        lanes: number of samples in one SIMD vector, a power of 2; if None, the number of doubles in the widest vector register of
            this machine is used, or PARTS with the backend "numpy".
        backend: "llvm", or "numpy", which needs no compiler; if None, llvm is used if it is installed, else numpy.

    Raises:
        KernelError: no usable pivots are found, the start is a singular position, or the backend is not installed.
        ValueError: the mechanism has knife edges, or its number of drivers differs from its number of degrees of freedom.
    """
    target = choose_target(backend, lanes, cache=True)
    if target.backend == "numpy" and lanes is None:
        target = replace(target, lanes=PARTS)
    if not mechanism.drivers and mechanism.crank is not None:
        crank = AngleDriver(mechanism.link_name(mechanism.crank), constant(0.0, 1.0), mechanism.crank)
        mechanism = replace(mechanism, drivers=(crank,))
    return Closure(mechanism, target)


class Closure:
    """Compiled closure of one linkage.

    Attributes:
        mechanism: the compiled mechanism, whose drivers are the inputs; their laws are not used.
        backend: "llvm" or "numpy".
        inputs: names of the drivers, in the order of the last axis of the argument `levels` of `sweep`.
    """

    def __init__(self, mechanism: Mechanism, target: Target):
        """Generate and compile the code."""
        self.mechanism, self.backend = mechanism, target.backend
        LoopEquations(mechanism)  # not kept: it raises ValueError if the drivers do not fit the degrees of freedom
        self._tracker = Tracker(ClosingProgram(mechanism), target)
        self.inputs = tuple(driver.name for driver in mechanism.drivers)
        self._tracker.loaded.call(target.lanes)  # compiles now, so that the first sweep does not have to

    def turn(self, samples: int) -> Sweep:
        """Compute one full turn of the input in equal steps from its start, without the end point.

        v and a are derivatives with respect to the input.

        Raises:
            ValueError: the linkage has several inputs.
        """
        if len(self.inputs) != 1:
            raise ValueError(f"{self.mechanism.name} has the inputs {', '.join(self.inputs)}, but a turn needs a single one")
        levels = np.zeros((samples, 3, 1))
        levels[:, 0, 0] = self._tracker.u[0] + 2 * np.pi / samples * np.arange(samples)
        levels[:, 1] = 1.0
        return self.sweep(levels)

    def sweep(self, levels: Array) -> Sweep:
        """Compute the states at given samples of the inputs; between two samples each input changes linearly.

        Args:
            levels: (k, 3, inputs) values [rad, m], first and second derivatives of the inputs at the samples.

        Raises:
            ValueError: the shape does not fit, or a number is not finite.
        """
        if levels.shape[1:] != (3, len(self.inputs)) or not len(levels):
            raise ValueError(f"levels of shape {levels.shape} must have the shape (samples, 3, {len(self.inputs)})")
        if not np.isfinite(levels).all():
            raise ValueError("inputs or their derivatives are not finite")
        # if samples are too far apart for one step, further samples are put between them, and removed from the result below
        stride = self._tracker.longest_stride(levels[:, 0])
        divided = max(1, ceil(stride))
        if divided > 1:
            levels = _divide(levels, divided)
        rows = np.empty((len(levels), self._tracker.program.width))
        loss = self._tracker.track(levels, stride / divided, rows)
        if loss is not None:
            loss = replace(loss, sample=ceil(loss.sample / divided))  # the caller's first sample from there on
        q, v, a = rows[::divided].reshape(-1, 3, self.mechanism.n).swapaxes(0, 1)
        return Sweep(q, v, a, loss)


def _divide(levels: Array, parts: int) -> Array:
    """Divide each step between two samples of `levels` (k, 3, K) into equal parts; return ((k - 1) parts + 1, 3, K).

    All numbers are interpolated linearly; derivatives are therefore meaningful at the original samples only.
    """
    before, after = levels[:-1, None], levels[1:, None]  # (k - 1, 1, 3, K)
    steps = before + (np.arange(parts) / parts)[:, None, None] * (after - before)
    return np.concatenate([steps.reshape(-1, *levels.shape[1:]), levels[-1:]])
