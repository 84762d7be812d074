"""Bullet, through PyBullet: a tree of Featherstone's joints, closed by point-to-point constraints on velocities.

A step is one of the semi-implicit Euler method: velocities follow from the forces at the beginning of the step and from impulses
that keep loops closed, and positions from these velocities. Impulses are found one after the other, again and again (sequential
impulses, a projected Gauss-Seidel method), or by Dantzig's direct method. Velocities belong to the positions at the beginning of
the step: those of a run miss the constraints at its positions by the change over one step.

The generated model is compared with the suite's own terms before it is used, at tree states at which loops are open.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from gauss_bench.engines.base import Choice
from gauss_bench.engines.bullet.accelerations import CONVERGED, Accelerations
from gauss_bench.engines.bullet.translate import joint_forces, refusal
from gauss_bench.engines.bullet.world import World
from gauss_bench.engines.shared import drivers_by_coordinate, joint_tree
from gauss_bench.engines.tree_model import OpenModel, TreeModel, verify
from gauss_bench.engines.variants import read_variants
from gauss_bench.mechanism.evaluate import Evaluator
from gauss_bench.mechanism.model import Mechanism
from gauss_bench.terms import Array

VARIANTS = read_variants(Path(__file__).parent)
AGREEMENT = 1e-9  # relative: rounding causes about 1e-15, a wrong sign or factor about 1


class Bullet:
    """Bullet with the semi-implicit Euler method, the only one that PyBullet offers."""

    name = "bullet"
    integrators = ("semi_implicit_euler",)
    stabilizations = ("none",)
    settings = VARIANTS.settings
    variants, knobs, first = VARIANTS.space, VARIANTS.knobs, VARIANTS.first
    native_loop = False
    python_loop = True

    def version(self) -> str:
        from importlib.metadata import version

        return f"pybullet {version('pybullet')}"

    def skip(self, mechanism: Mechanism, choice: Choice) -> str | None:
        return refusal(mechanism, joint_tree(mechanism, VARIANTS.options(choice.settings)))

    def in_python(self, mechanism: Mechanism, choice: Choice) -> str:
        return "a call for every step, and the forces of joints, which Bullet forgets after every step"

    def build(self, mechanism: Mechanism, choice: Choice) -> "BulletModel":
        return BulletModel(mechanism, choice)


class BulletModel(TreeModel):
    """A mechanism in Bullet under one choice.

    Attributes:
        laws: index of a driven joint -> its law.
    """

    library = "Bullet"

    def __init__(self, mechanism: Mechanism, choice: Choice):
        import pybullet

        super().__init__(mechanism, choice, VARIANTS.options(choice.settings))
        self.pybullet: Any = pybullet
        self.forces, self.evaluator = joint_forces(mechanism, self.tree), Evaluator(mechanism)
        self.laws = {at: driver.law for at, driver in drivers_by_coordinate(mechanism, self.tree).items()}
        self._verify()
        self.accelerations = Accelerations(self._world({**self.options, **CONVERGED}), self.forces, self.laws)

    def _world(self, options: Mapping[str, Any], closed: bool = True) -> World:
        """Return a new world of the linkage under given options."""
        world = World(self.pybullet, self.mechanism, self.tree, options, closed)
        world.damp(self.forces.joint_damping)
        return world

    def _verify(self) -> None:
        """Compare the open tree with the linkage.

        Raises:
            RunFailure: they differ.
        """
        world = self._world({**self.options, "damping": 0.0, "substeps": 0}, closed=False)
        world.set_step(1.0)  # velocities of the open tree change in proportion to the step, so that no error depends on its length

        def describe(y: Array, dy: Array) -> OpenModel:
            world.put(y, dy)
            gaps = world.gaps()
            world.step(self.forces(0.0, y, dy).tolist())
            return OpenModel(gaps, accelerations=world.state()[1] - dy)

        verify(self.mechanism, self.tree, describe, AGREEMENT)

    def tree_acceleration(self, t: float, y: Array, dy: Array) -> Array:
        return self.accelerations(t, y, dy)

    def accelerate(self, t: float, y: Array, dy: Array) -> Array:
        """Return the accelerations (3 links,) at the state on the constraints that is nearest to a tree state y, dy (n,).

        Where loops are open, redundant closures contradict each other, and Bullet's solver would not converge.
        """
        q, v, _ = self.tree.absolute(y, dy, np.zeros_like(y))
        return super().accelerate(t, *self.tree.relative(*self.evaluator.project(t, q, v)))

    def prepare(self, times: Array, native: bool = True) -> None:
        super().prepare(times, native)
        self.world = self._world(self.options)  # a new one, which knows nothing of the run before
        self.world.put(self.y0, self.dy0)

    def run(self) -> None:
        world, forces, laws = self.world, self.forces, self.laws
        constant = forces.constant.tolist() if forces.are_constant else None
        length = 0.0
        for begin, count, size, last, row in self.plan:
            if size != length:
                world.set_step(size)
                length = size
            for k in range(count):
                if constant is not None and not laws:
                    world.step(constant)
                    continue
                t, (y, dy) = begin + k * size, world.state()
                for joint, law in laws.items():
                    # at this rate the joint is where the law has it at the end of the step
                    world.drive(joint, (float(law(t + size)[0]) - float(y[joint])) / size)
                world.step(forces(min(t, last), y, dy).tolist())
            if row is not None:
                self.y[row], self.dy[row] = world.state()
