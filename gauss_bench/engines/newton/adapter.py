"""Newton with its solver Kamino, on one processor core: steps of the semi-implicit Euler method in single precision.

It has no accelerations; `accelerations.py` finds those that its steps imply.
"""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from gauss_bench.engines.base import Choice, Model, sample_arrays
from gauss_bench.engines.newton.accelerations import Accelerations
from gauss_bench.engines.newton.kernels import PACKAGES, are_compiled, load_libraries, mark_compiled
from gauss_bench.engines.newton.sample import sample_linkage
from gauss_bench.engines.newton.world import World
from gauss_bench.engines.shared import common_refusal, finite_acceleration
from gauss_bench.engines.variants import read_variants
from gauss_bench.integrate.fixed_step import stretches
from gauss_bench.mechanism.forces import AppliedForces
from gauss_bench.mechanism.model import Mechanism
from gauss_bench.terms import Array
from gauss_bench.trajectory import Trajectory, with_accelerations

VARIANTS = read_variants(Path(__file__).parent)


def refusal(mechanism: Mechanism) -> str | None:
    """Return the reason why Newton cannot model a mechanism, or None if it can."""
    if reason := common_refusal(mechanism, "Newton"):
        return reason
    if mechanism.knife_edges:
        return f"Newton has no constraint on velocities alone ({mechanism.knife_edges[0].name})"
    if mechanism.drivers:
        return f"Kamino drives joints by springs and dampers, so that {mechanism.drivers[0].name} would not follow its law"
    return None


class Newton:
    """Newton's solver Kamino with the semi-implicit Euler method, the only one that it has without collisions."""

    name = "newton"
    integrators = ("semi_implicit_euler",)
    stabilizations = ("none",)
    settings = VARIANTS.settings
    variants, knobs, first = VARIANTS.space, VARIANTS.knobs, VARIANTS.first
    packages = PACKAGES
    resizable = True
    native_loop = False
    python_loop = True

    def version(self) -> str:
        from importlib.metadata import version

        return f"newton {version('newton')} (warp {version('warp-lang')})"

    def skip(self, mechanism: Mechanism, choice: Choice) -> str | None:
        return refusal(mechanism)

    def in_python(self, mechanism: Mechanism, choice: Choice) -> str:
        return "a call for every step, and the forces"

    def unbuilt(self, settings: str) -> str:
        return "" if are_compiled() else "Newton's kernels, which takes minutes"

    def build_once(self) -> None:
        """Compile the kernels of every solver that settings name, by steps of a crank-slider."""
        for options in VARIANTS.settings.values():
            compile_kernels(options)
        mark_compiled()

    def build(self, mechanism: Mechanism, choice: Choice) -> Model:
        return NewtonModel(mechanism, choice)


def compile_kernels(options: Mapping[str, Any]) -> None:
    """Take a step of the sample linkage under a setting, for which all kernels are compiled that are not yet."""
    world = World(load_libraries(), sample_linkage(), options)
    world.step(np.zeros(9), 1e-3)


class NewtonModel:
    """A mechanism in Newton under one choice.

    Attributes:
        unconverged: steps of a run after which Kamino's solver told that it had not converged.
    """

    def __init__(self, mechanism: Mechanism, choice: Choice):
        self.mechanism, self.choice = mechanism, choice
        self.options = VARIANTS.options(choice.settings)
        self.libraries = load_libraries()
        self.forces = AppliedForces(replace(mechanism, gravity=np.zeros(2))).generalised  # gravity is Newton's
        self.accelerations = Accelerations(self.libraries, mechanism)

    def acceleration(self, t: float, q: Array, v: Array) -> Array:
        return finite_acceleration(t, self.accelerations(q, v, self.forces(q, v, t)), "Newton")

    def prepare(self, times: Array, native: bool = True) -> None:
        self.times, self.plan = times, list(stretches(times, self.choice.step, self.mechanism.kinks))
        self.q, self.v = sample_arrays(times, self.mechanism.q0, self.mechanism.v0)
        self.unconverged = 0
        self.world = World(self.libraries, self.mechanism, self.options)  # a new one, which knows nothing of the run before
        for size in {stretch.size for stretch in self.plan}:
            self.world.record(size)

    def run(self) -> None:
        q, v = self.mechanism.q0, self.mechanism.v0
        for begin, count, h, last, row in self.plan:
            for k in range(count):
                converged = self.world.step(self.forces(q, v, min(begin + k * h, last)), h)
                self.unconverged += not converged
                q, v = self.world.state()
            if row is not None:
                self.q[row], self.v[row] = q, v

    def read(self) -> Trajectory:
        def acceleration_of_sample(k: int) -> Array:
            return self.acceleration(float(self.times[k]), self.q[k], self.v[k])

        steps = sum(stretch.steps for stretch in self.plan)
        note = f"Kamino's solver did not converge in {self.unconverged} of {steps} steps" if self.unconverged else ""
        return with_accelerations(self.times, self.q, self.v, acceleration_of_sample, steps, note=note)
