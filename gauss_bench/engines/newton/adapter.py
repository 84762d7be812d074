"""The library Newton with its solver Kamino, on one processor core: semi-implicit Euler steps in single precision.

Kamino computes no accelerations; `accelerations.py` finds them from steps.
"""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from gauss_bench.engines.base import Choice
from gauss_bench.engines.body_model import BodyModel
from gauss_bench.engines.newton.accelerations import Accelerations
from gauss_bench.engines.newton.kernels import PACKAGES, are_compiled, load_libraries, mark_compiled
from gauss_bench.engines.newton.sample import sample_linkage
from gauss_bench.engines.newton.world import World
from gauss_bench.engines.shared import LibraryEngine, common_refusal, finite_acceleration
from gauss_bench.mechanism.forces import AppliedForces
from gauss_bench.mechanism.model import Mechanism
from gauss_bench.terms import Array


class Newton(LibraryEngine, beside=__file__):
    """The library Newton with its solver Kamino, whose only method for models without collisions is semi-implicit Euler."""

    name = "newton"
    integrators = ("semi_implicit_euler",)
    packages = PACKAGES
    resizable = True
    native_loop = False
    python_loop = True

    def version(self) -> str:
        from importlib.metadata import version

        return f"newton {version('newton')} (warp {version('warp-lang')})"

    def skip(self, mechanism: Mechanism, choice: Choice) -> str | None:
        if reason := common_refusal(mechanism, "Newton"):
            return reason
        if mechanism.knife_edges:
            return f"Newton has no constraint on velocities alone ({mechanism.knife_edges[0].name})"
        if mechanism.drivers:
            return f"Kamino drives joints by springs and dampers, so that {mechanism.drivers[0].name} would not follow its law"
        return None

    def in_python(self, mechanism: Mechanism, choice: Choice) -> str:
        return "a call for every step, and the forces"

    def unbuilt(self, settings: str) -> str:
        return "" if are_compiled() else "Newton's kernels, which takes minutes"

    def build_once(self) -> None:
        for options in self.settings.values():
            compile_kernels(options)
        mark_compiled()

    def build(self, mechanism: Mechanism, choice: Choice) -> "NewtonModel":
        return NewtonModel(mechanism, choice)


def compile_kernels(options: Mapping[str, Any]) -> None:
    """Compile the kernels that settings with these options need: take a step, because Warp compiles kernels when they first run."""
    World(load_libraries(), sample_linkage(), options).step(forces=np.zeros(9), h=1e-3)


class NewtonModel(BodyModel):
    """A mechanism in the library Newton, run with one setting of the engine (`Choice`).

    Attributes:
        unconverged: number of steps of a run in which Kamino's solver did not converge.
    """

    def __init__(self, mechanism: Mechanism, choice: Choice):
        super().__init__(mechanism, choice, Newton.file.options(choice.settings))
        self.libraries = load_libraries()
        self.forces = AppliedForces(replace(mechanism, gravity=np.zeros(2))).generalised  # Newton itself adds gravity
        self.accelerations = Accelerations(self.libraries, mechanism)

    def acceleration(self, t: float, q: Array, v: Array) -> Array:
        return finite_acceleration(t, self.accelerations(q, v, self.forces(q, v, t)), "Newton")

    def prepare(self, times: Array, native: bool = True) -> None:
        super().prepare(times, native)
        self.unconverged = 0
        self.world = World(self.libraries, self.mechanism, self.options)  # a new world, so that no run depends on the one before
        for size in {stretch.size for stretch in self.plan}:
            self.world.record(size)  # so that no step is recorded in a timed run

    def run(self) -> None:
        q, v = self.mechanism.q0, self.mechanism.v0
        for begin, count, h, last, sample in self.plan:  # forces are evaluated no later than `last`, just before a jump
            for k in range(count):
                self.unconverged += not self.world.step(self.forces(q, v, min(begin + k * h, last)), h)
                q, v = self.world.state()
            if sample is not None:
                self.q[sample], self.v[sample] = q, v

    def note(self) -> str:
        if not self.unconverged:
            return ""
        return f"Kamino's solver did not converge in {self.unconverged} of {self.count_steps()} steps"
