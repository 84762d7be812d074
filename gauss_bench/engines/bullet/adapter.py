"""Bullet, through PyBullet: a tree of Featherstone's joints, closed by point-to-point constraints on velocities.

Every step is one of the semi-implicit Euler method: velocities follow from the forces at the beginning of the step and from impulses
that keep loops closed, and positions from these velocities. Impulses are found one by one (sequential impulses, which is a projected
Gauss-Seidel method), or by Dantzig's direct method. The generated model is compared with the suite's own terms before it is used, at
tree states at which loops are open.
"""

from pathlib import Path
from typing import Any

import numpy as np

from gauss_bench.engines.base import Choice, sample_arrays
from gauss_bench.engines.bullet.accelerations import CONVERGED, Accelerations
from gauss_bench.engines.bullet.translate import joint_forces, list_drives, refusal
from gauss_bench.engines.bullet.world import World
from gauss_bench.engines.shared import (
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
AGREEMENT = 1e-9  # relative: rounding causes about 1e-13, a wrong sign or factor about 1


class Bullet:
    """Bullet with the semi-implicit Euler method, the only one that it has for joints."""

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
        return "a call for every step, and the forces of joints, which Bullet forgets after a step"

    def build(self, mechanism: Mechanism, choice: Choice) -> "BulletModel":
        return BulletModel(mechanism, choice)


class BulletModel:
    """A mechanism in Bullet under one choice."""

    def __init__(self, mechanism: Mechanism, choice: Choice):
        import pybullet

        self.pybullet: Any = pybullet
        self.mechanism, self.choice, self.options = mechanism, choice, VARIANTS.options(choice.settings)
        self.tree, self.evaluator = joint_tree(mechanism, self.options), Evaluator(mechanism)
        self.y0, self.dy0 = self.tree.relative(mechanism.q0, mechanism.v0)
        self.forces, self.drives = joint_forces(mechanism, self.tree), list_drives(mechanism, self.tree)
        self._verify()
        self.world = World(pybullet, mechanism, self.tree, self.options)
        self.world.damp(self.forces.joint_damping)
        still = World(pybullet, mechanism, self.tree, {**self.options, **CONVERGED})
        still.damp(self.forces.joint_damping)
        self.accelerations = Accelerations(still, self.forces, self.drives)

    def _verify(self) -> None:
        """Compare the open tree with the suite's own terms.

        Raises:
            RunFailure: its accelerations differ.
        """
        world = World(self.pybullet, self.mechanism, self.tree, {**self.options, "damping": 0.0, "substeps": 0}, closed=False)
        world.damp(self.forces.joint_damping)
        world.set_step(1.0)  # without constraints the change of velocities is in proportion to the step, and exact
        for y, dy in tree_states(self.tree, self.y0, self.dy0):
            own = open_tree(self.evaluator, self.tree, y, dy)
            world.put(y, dy)
            world.step(self.forces(0.0, y, dy).tolist())
            acceleration = world.state()[1] - dy
            require_agreement({"forces of the open tree": (own.mass @ acceleration, own.forces, own.load or 1.0)}, AGREEMENT)

    def acceleration(self, t: float, q: Array, v: Array) -> Array:
        """Return the accelerations (3 links,) at the state on the constraints that is nearest to q, v (3 links,).

        Where loops are open, redundant closures would contradict each other, and Bullet's solver would not converge.
        """
        y, dy = self.tree.relative(*self.evaluator.project(t, q, v))
        return finite_acceleration(t, self.tree.absolute(y, dy, self.accelerations(t, y, dy))[2], "Bullet")

    def prepare(self, times: Array, native: bool = True) -> None:
        self.times = times
        self.y, self.dy = sample_arrays(times, self.y0, self.dy0)
        self.plan = list(stretches(times, self.choice.step, self.mechanism.kinks))
        self.world = World(self.pybullet, self.mechanism, self.tree, self.options)  # Bullet keeps impulses of the steps before
        self.world.damp(self.forces.joint_damping)
        self.world.put(self.y0, self.dy0)

    def run(self) -> None:
        world, forces, drives = self.world, self.forces, self.drives
        same = forces.constant.tolist() if forces.are_constant else None
        length = 0.0
        for begin, count, size, last, row in self.plan:
            if size != length:
                world.set_step(size)
                length = size
            for k in range(count):
                t = begin + k * size
                y, dy = world.state() if same is None or drives else (self.y0, self.dy0)
                for drive in drives:
                    # the rate by which the joint is where the law has it at the end of the step
                    world.drive(drive.joint, (float(drive.law(t + size)[0]) - y[drive.joint]) / size)
                world.step(same if same is not None else forces(min(t, last), y, dy).tolist())
            if row is not None:
                self.y[row], self.dy[row] = world.state()

    def read(self) -> Trajectory:
        q, v, _ = self.tree.absolute(self.y, self.dy, np.zeros_like(self.y))
        steps = sum(stretch.steps for stretch in self.plan)

        def acceleration_of_sample(k: int) -> Array:
            return self.acceleration(float(self.times[k]), q[k], v[k])

        return with_accelerations(self.times, q, v, acceleration_of_sample, steps)
