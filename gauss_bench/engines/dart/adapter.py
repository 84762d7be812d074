"""DART: a skeleton of joints, closed by ball constraints that an LCP on velocities solves; one method, semi-implicit Euler.

A step of size h from y, v ends at velocities that leave the loops as they are where the step began, and open loops are drawn shut by
a share `erp` of the gap a step:

    M (v' - v) = h f + J^T impulse,    J v' = -erp gap / h,    y' = y + h v'

So DART has no accelerations. `DartModel.acceleration` measures them as differences of velocities over short steps. The generated
skeleton is compared with the suite's own terms before it is used, at tree states at which loops are open.
"""

from pathlib import Path
from typing import Any

import numpy as np

from gauss_bench.engines.base import Choice, sample_arrays
from gauss_bench.engines.dart.given import GivenForces
from gauss_bench.engines.dart.messages import Messages
from gauss_bench.engines.dart.translate import Builder, Built, driven, refusal, select_solver
from gauss_bench.engines.shared import (
    beyond_a_tree,
    finite_acceleration,
    joint_tree,
    open_tree,
    require_agreement,
    tree_states,
    with_accelerations,
)
from gauss_bench.engines.variants import read_variants
from gauss_bench.integrate.fixed_step import stretches
from gauss_bench.mechanism.evaluate import Evaluator
from gauss_bench.mechanism.model import Mechanism
from gauss_bench.terms import Array
from gauss_bench.trajectory import Trajectory

VARIANTS = read_variants(Path(__file__).parent)
METHOD = "semi_implicit_euler"
AGREEMENT = 1e-9  # relative: rounding causes about 1e-13, a wrong sign or factor about 1
INSTANT = 1e-300  # [s] time step in which implicit springs and dampers do nothing
WATCHED = 100  # steps after which DART's messages are looked at
SHORT = (4e-4, 2e-4, 1e-4)  # [s] steps by which accelerations are measured


class Dart:
    """DART's world, stepped from Python: it has no call for several steps."""

    name = "dart"
    integrators = (METHOD,)
    stabilizations = ("none",)
    settings = VARIANTS.settings
    variants, knobs, first = VARIANTS.space, VARIANTS.knobs, VARIANTS.first
    soft, unfinished = VARIANTS.soft, VARIANTS.unfinished
    native_loop = False
    python_loop = True
    resizable = True

    def version(self) -> str:
        import dartpy

        return f"DART {dartpy.__version__}"

    def skip(self, mechanism: Mechanism, choice: Choice) -> str | None:
        return beyond_a_tree(mechanism, "DART") or refusal(mechanism, joint_tree(mechanism, VARIANTS.options(choice.settings)))

    def in_python(self, mechanism: Mechanism, choice: Choice) -> str:
        options = VARIANTS.options(choice.settings)
        forces = GivenForces(mechanism, joint_tree(mechanism, options), options["joint_forces"])
        told = ["motion laws"] * bool(mechanism.drivers) + ["the forces for which DART has no element"] * forces.change
        return f"{' and '.join(told)}, once a step" if told else ""

    def build(self, mechanism: Mechanism, choice: Choice) -> "DartModel":
        return DartModel(mechanism, choice)


class DartModel:
    """A mechanism in DART under one choice.

    Attributes:
        moving: the world that runs; still: another, in which accelerations are measured.
    """

    def __init__(self, mechanism: Mechanism, choice: Choice):
        import dartpy

        self.dartpy: Any = dartpy
        self.mechanism, self.choice, self.options = mechanism, choice, VARIANTS.options(choice.settings)
        self.tree = joint_tree(mechanism, self.options)
        self.y0, self.dy0 = self.tree.relative(mechanism.q0, mechanism.v0)
        self.forces = GivenForces(mechanism, self.tree, self.options["joint_forces"])
        self.driven = driven(mechanism, self.tree)
        with Messages() as messages:
            self._verify(Builder(dartpy, mechanism, self.tree, self.forces, whole=False).build())
            self.moving, self.still = (Builder(dartpy, mechanism, self.tree, self.forces).build() for _ in range(2))
            if self.options["lcp"] == "PGS":
                for built in (self.moving, self.still):
                    select_solver(dartpy, built, self.options["pgs_iterations"])
            messages.check()

    def _verify(self, opened: Built) -> None:
        """Compare the open tree with the suite's own terms; the anchors of pins are not compared.

        Raises:
            RunFailure: its accelerations differ.
        """
        evaluator = Evaluator(self.mechanism)
        opened.world.setTimeStep(INSTANT)
        for y, dy in tree_states(self.tree, self.y0, self.dy0):
            own = open_tree(evaluator, self.tree, y, dy)
            opened.put(y, dy)
            opened.command(self.forces(0.0, y, dy))
            opened.skeleton.computeForwardDynamics()
            forces = own.mass @ opened.skeleton.getAccelerations()[opened.order]
            require_agreement({"forces of the open tree": (forces, own.forces, own.load or 1.0)}, AGREEMENT)

    def _restart(self, built: Built, erp: float) -> None:
        """Put a world to its start, with the options of its closures.

        Trap: they are static in DART: a closure that is told one changes those of every world in this process.
        """
        built.restart(self.dartpy.constraint)
        self._set_options(built, erp)

    def _set_options(self, built: Built, erp: float) -> None:
        for closure in built.closures[:1]:
            closure.setErrorReductionParameter(erp)
            closure.setConstraintForceMixing(self.options["cfm"])
            closure.setMaxErrorReductionVelocity(self.options["max_error_reduction_velocity"])
            closure.setErrorAllowance(0.0)

    def _command(self, built: Built, t: float, end: float) -> None:
        """Set the forces at the time t [s] with which a step begins, and the driven speeds at its end."""
        values = self.forces(t, built.y, built.dy)
        for at, law in self.driven:
            values[at] = law(end)[1]
        built.command(values)

    def _measure(self, t: float, y: Array, dy: Array, h: float) -> Array:
        """Return the change of velocities (n,) per second over a step of h [s] from a tree state y, dy (n,).

        A step leaves J v' = 0 where it began, so that a step from a state with J v = 0 would give J a = 0 and not gamma. Therefore
        a step before it begins at y - h dy. Gaps there, of the size h^2, are not drawn shut.
        """
        built = self.still
        self._restart(built, erp=0.0)
        built.world.setTimeStep(h)
        built.put(y - h * dy, dy)
        self._command(built, t - h, t)
        built.world.step(False)
        before = built.dy
        self._command(built, t, t + h)
        built.world.step(False)
        return (built.dy - before) / h

    def _accelerate(self, t: float, y: Array, dy: Array) -> Array:
        """Return the accelerations in absolute coordinates (3 links,) at a tree state y, dy (n,)."""
        with Messages() as messages:
            measured = [self._measure(t, y, dy, h) for h in SHORT]
            messages.check()
        return finite_acceleration(t, self.tree.absolute(y, dy, extrapolate(SHORT, measured))[2], "DART")

    def acceleration(self, t: float, q: Array, v: Array) -> Array:
        return self._accelerate(t, *self.tree.relative(q, v))

    def prepare(self, times: Array, native: bool = True) -> None:
        self.times = times
        self.plan = list(stretches(times, self.choice.step, self.mechanism.kinks))
        self.y, self.dy = sample_arrays(times, self.y0, self.dy0)
        self._restart(self.moving, self.options["erp"])
        self._command(self.moving, times[0], times[0])

    def run(self) -> None:
        self._set_options(self.moving, self.options["erp"])
        with Messages() as messages:
            self._run(messages)
            messages.check()

    def _run(self, messages: Messages) -> None:
        """Take all steps, and store the samples.

        Raises:
            RunFailure: DART prints a message.
        """
        built, changing = self.moving, self.forces.change or bool(self.driven)
        step = built.world.step
        for begin, count, size, last, row in self.plan:
            built.world.setTimeStep(size)
            for k in range(count):
                if changing:
                    self._command(built, min(begin + k * size, last), min(begin + (k + 1) * size, last))
                step(False)  # False: the commands stay
                if k % WATCHED == 0:
                    messages.check()
            if row is not None:
                self.y[row], self.dy[row] = built.y, built.dy

    def read(self) -> Trajectory:
        q, v, _ = self.tree.absolute(self.y, self.dy, np.zeros_like(self.y))

        def acceleration_of_sample(k: int) -> Array:
            return self._accelerate(float(self.times[k]), self.y[k], self.dy[k])

        return with_accelerations(self.times, q, v, acceleration_of_sample, sum(stretch.steps for stretch in self.plan))


def extrapolate(steps: tuple[float, ...], values: list[Array]) -> Array:
    """Return the limit at step 0 of values (n,) measured at several steps, by the polynomial through them (Aitken and Neville)."""
    row = list(values)
    for order in range(1, len(steps)):
        row = [
            (steps[k] * row[k + 1] - steps[k + order] * row[k]) / (steps[k] - steps[k + order]) for k in range(len(row) - 1)
        ]
    return row[0]
