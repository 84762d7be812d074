"""Bullet, through PyBullet: a tree of joints (Featherstone's method) or free bodies, closed by point constraints on velocities.

A step follows the semi-implicit Euler method: the forces at the beginning of the step and the impulses that keep loops closed give
the new velocities, and these give the new positions. Bullet finds the impulses one by one, in many rounds (sequential impulses, a
projected Gauss-Seidel method), or by Dantzig's direct method. The new velocities satisfy the constraints at the old positions, and
violate those at the new positions by an error in proportion to the step.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from gauss_bench.engines.base import Choice, Model
from gauss_bench.engines.body_model import BodyModel
from gauss_bench.engines.bullet.accelerations import CONVERGED, Accelerations
from gauss_bench.engines.bullet.program import write
from gauss_bench.engines.bullet.translate import Forces, body_forces, joint_forces
from gauss_bench.engines.bullet.world import BodyWorld, TreeWorld
from gauss_bench.engines.given_forces import GivenForces
from gauss_bench.engines.shared import (
    LibraryEngine,
    beyond_a_tree,
    drivers_by_coordinate,
    finite_acceleration,
    joint_tree,
    require_agreement,
    size,
    undriven,
)
from gauss_bench.engines.tree_model import OpenModel, TreeModel, verify
from gauss_bench.integrate.fixed_step import Stretch
from gauss_bench.mechanism.evaluate import Evaluator
from gauss_bench.mechanism.model import Mechanism
from gauss_bench.mechanism.motion_laws import MotionLaw
from gauss_bench.terms import Array

UNDAMPED = {"damping": 0.0, "substeps": 0}  # options of worlds that are compared with the linkage
SHORT = 1e-3  # [s] length of the step that verifies free bodies
AGREEMENT = 1e-9  # relative: rounding causes about 1e-15, a wrong sign or factor about 1


class Bullet(LibraryEngine, beside=__file__):
    """Bullet with the semi-implicit Euler method, the only one that PyBullet offers."""

    name = "bullet"
    integrators = ("semi_implicit_euler",)
    packages = ("pybullet",)
    resizable = True
    native_loop = False
    python_loop = True

    def version(self) -> str:
        from importlib.metadata import version

        return f"pybullet {version('pybullet')}"

    def skip(self, mechanism: Mechanism, choice: Choice) -> str | None:
        options = self.file.options(choice.settings)
        if reason := beyond_a_tree(mechanism, "Bullet"):
            return reason
        if options["coordinates"] == "bodies":
            if mechanism.slides:
                return f"Bullet has no slide between free bodies ({mechanism.slides[0].name})"
            return "Bullet has motors in the joints of a tree, but none between free bodies" if mechanism.drivers else None
        return undriven(mechanism, joint_tree(mechanism, options), "Bullet")

    def in_python(self, mechanism: Mechanism, choice: Choice) -> str:
        return "a call for every step, and the forces, which Bullet forgets after every step"

    def build(self, mechanism: Mechanism, choice: Choice) -> Model:
        has_bodies = self.file.options(choice.settings)["coordinates"] == "bodies"
        return FreeBodies(mechanism, choice) if has_bodies else JointModel(mechanism, choice)

    def program(self, mechanism: Mechanism, choice: Choice) -> str:
        return write(mechanism, choice, self.file.options(choice.settings))


def step_through(
    world: TreeWorld | BodyWorld,
    forces: Forces,
    laws: Mapping[int, MotionLaw],
    plan: Sequence[Stretch],
    samples: tuple[Array, Array],
) -> None:
    """Take all steps of a plan, and store the states in `samples`, the arrays x and dx (k, n) in the world's coordinates.

    Args:
        laws: index of a driven joint -> its motion law.
        plan: stretches of equal steps: begin [s], number of steps, their length [s], `last` [s], and the index of the sample at the
            end of the stretch, or None. No force is evaluated later than `last`; if a force jumps, `last` is just before the jump.
    """
    x_samples, dx_samples = samples
    # Constant forces on a tree need no evaluation between steps. The state of free bodies is read at every step in any case,
    # because `BodyWorld.state` counts turns and must not miss one.
    constant = forces.constant.tolist() if isinstance(forces, GivenForces) and forces.are_constant and not laws else None
    length = 0.0
    for begin, count, h, last, sample in plan:
        if h != length:
            world.set_step(h)
            length = h
        for k in range(count):
            if constant is not None:
                world.step(constant)
                continue
            t, (x, dx) = begin + k * h, world.state()
            for joint, law in laws.items():
                # at this rate the joint reaches the law's position at the end of the step
                world.drive(joint, (float(law(t + h)[0]) - float(x[joint])) / h)
            world.step(forces(min(t, last), x, dx).tolist())
        if sample is not None:
            x_samples[sample], dx_samples[sample] = world.state()


class JointModel(TreeModel):
    """A mechanism as a tree of joints in Bullet, run with one setting of the engine (`Choice`).

    Attributes:
        laws: index of a driven joint -> its motion law.
        accelerations: function (t, y, dy) -> accelerations (n,), with a world of its own, whose solver iterates to convergence.
    """

    library = "Bullet"

    def __init__(self, mechanism: Mechanism, choice: Choice):
        """Build the model, after its open tree has been compared with the linkage."""
        import pybullet

        super().__init__(mechanism, choice, Bullet.file.options(choice.settings))
        self.pybullet: Any = pybullet
        self.forces, self.evaluator = joint_forces(mechanism, self.tree), Evaluator(mechanism)
        self.laws = {joint: driver.law for joint, driver in drivers_by_coordinate(mechanism, self.tree).items()}
        open_tree = self._make_world(UNDAMPED, closed=False)
        open_tree.set_step(1.0)  # the open tree's velocities change in proportion to the step, so no step is too long

        def describe(y: Array, dy: Array) -> OpenModel:
            """Return the gaps of the loops, and Bullet's accelerations of the open tree, at t = 0 and a tree state y, dy (n,)."""
            open_tree.put(y, dy)
            gaps = open_tree.gaps()  # before the step, which moves the links
            open_tree.step(self.forces(0.0, y, dy).tolist())
            return OpenModel(gaps, accelerations=open_tree.state()[1] - dy)  # the step is 1 s

        verify(mechanism, self.tree, describe, AGREEMENT)
        self.accelerations = Accelerations(self._make_world(CONVERGED), self.forces, self.laws)

    def _make_world(self, changes: Mapping[str, Any], closed: bool = True) -> TreeWorld:
        """Return a new world that holds the linkage, with changed options; if `closed` is false, the loops stay open."""
        world = TreeWorld(self.pybullet, self.mechanism, self.tree, {**self.options, **changes}, closed)
        world.damp(self.forces.joint_damping)
        return world

    def tree_acceleration(self, t: float, y: Array, dy: Array) -> Array:
        return self.accelerations(t, y, dy)

    def accelerate(self, t: float, y: Array, dy: Array) -> Array:
        """Return the absolute accelerations (3 links,) at the state nearest to y, dy (n,) that satisfies all constraints.

        At a state with open loops, redundant closures would contradict each other, and Bullet's solver would not converge.
        """
        q, v, _ = self.tree.absolute(y, dy, np.zeros_like(y))
        q, v = self.evaluator.project(t, q, v)
        return super().accelerate(t, *self.tree.relative(q, v))

    def prepare(self, times: Array, native: bool = True) -> None:
        """Reset to the start; `native` has no effect, because Python calls Bullet for every step."""
        super().prepare(times, native)
        self.world = self._make_world({})  # a new world, so that no run depends on the one before
        self.world.put(self.y0, self.dy0)

    def run(self) -> None:
        step_through(self.world, self.forces, self.laws, self.plan, (self.y, self.dy))


class FreeBodies(BodyModel):
    """A mechanism as free bodies in Bullet, run with one setting of the engine (`Choice`)."""

    def __init__(self, mechanism: Mechanism, choice: Choice):
        """Build the model, after Bullet's forces on free bodies have been compared with the linkage's, over one step of SHORT."""
        import pybullet

        super().__init__(mechanism, choice, Bullet.file.options(choice.settings))
        self.pybullet: Any = pybullet
        self.forces, self.evaluator = body_forces(mechanism), Evaluator(mechanism)
        q, v = mechanism.q0, mechanism.v0
        world = BodyWorld(pybullet, mechanism, {**self.options, **UNDAMPED}, closed=False)
        world.set_step(SHORT)  # short, because Bullet turns no rigid body by more than a quarter of a turn in a step
        world.put(q, v)
        world.step(self.forces(0.0, q, v).tolist())
        # Bullet's force: the mass times the change of velocity, divided by the step
        exerted = self.evaluator.mass * (world.state()[1] - v) / SHORT
        expected = self.evaluator.applied.generalised(q, v, 0.0)
        require_agreement({"forces on free bodies": (exerted, expected, size(expected))}, AGREEMENT)
        # accelerations need a solver that converges, whatever the settings
        self.accelerations = Accelerations(BodyWorld(pybullet, mechanism, {**self.options, **CONVERGED}), self.forces, {})

    def acceleration(self, t: float, q: Array, v: Array) -> Array:
        """Return the accelerations (3 links,) at the state nearest to q, v (3 links,) that satisfies all constraints."""
        return finite_acceleration(t, self.accelerations(t, *self.evaluator.project(t, q, v)), "Bullet")

    def prepare(self, times: Array, native: bool = True) -> None:
        super().prepare(times, native)
        self.world = BodyWorld(self.pybullet, self.mechanism, self.options)
        self.world.put(self.mechanism.q0, self.mechanism.v0)

    def run(self) -> None:
        step_through(self.world, self.forces, {}, self.plan, (self.q, self.v))
