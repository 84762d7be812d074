"""DART: a skeleton of joints, closed by ball constraints, and stepped by the semi-implicit Euler method.

An LCP on velocities gives the impulses of the constraints. A step of size h from positions y and velocities v to y1 and v1 keeps
the gaps of the loops, or reduces them by the share `erp`:

    M (v1 - v) = h f + J^T impulse,    J v1 = -erp gap / h,    y1 = y + h v1

So DART computes no accelerations of closed loops; the adapter finds them from differences of velocities over short steps.
"""

from typing import Any

from gauss_bench.engines.base import Choice
from gauss_bench.engines.dart.messages import Messages
from gauss_bench.engines.dart.program import write
from gauss_bench.engines.dart.translate import World, forces_of
from gauss_bench.engines.shared import LibraryEngine, beyond_a_tree, drivers_by_coordinate, joint_tree, undriven
from gauss_bench.engines.tree_model import OpenModel, TreeModel, acceleration_by_steps, verify
from gauss_bench.mechanism.model import Mechanism
from gauss_bench.terms import Array

AGREEMENT = 1e-9  # relative: rounding causes about 1e-13, a wrong sign or factor about 1
INSTANT = 1e-300  # [s] step so short that implicit springs and dampers give the same forces as explicit ones
CHECK_EVERY = 100  # number of steps between two checks of DART's messages
SHORT = (4e-5, 2e-5, 1e-5)  # [s] steps from which accelerations are found: rounding causes errors of 1e-11


class Dart(LibraryEngine, beside=__file__):
    """DART's world, stepped from Python, because DART has no call for several steps."""

    name = "dart"
    integrators = ("semi_implicit_euler",)
    native_loop = False
    python_loop = True
    resizable = True

    def version(self) -> str:
        import dartpy

        return f"DART {dartpy.__version__}"

    def skip(self, mechanism: Mechanism, choice: Choice) -> str | None:
        tree = joint_tree(mechanism, self.file.options(choice.settings))
        return beyond_a_tree(mechanism, "DART") or undriven(mechanism, tree, "DART")

    def in_python(self, mechanism: Mechanism, choice: Choice) -> str:
        options = self.file.options(choice.settings)
        forces = forces_of(mechanism, joint_tree(mechanism, options), options["joint_forces"])
        names = ["motion laws"] if mechanism.drivers else []
        names += [] if forces.are_constant else ["forces that are none of DART's own"]
        return f"{' and '.join(names)}, once a step" if names else ""

    def build(self, mechanism: Mechanism, choice: Choice) -> "DartModel":
        return DartModel(mechanism, choice)

    def program(self, mechanism: Mechanism, choice: Choice) -> str:
        return write(mechanism, choice, self.file.options(choice.settings))


class DartModel(TreeModel):
    """A mechanism in DART, run with one setting of the engine (`Choice`).

    Attributes:
        laws: index of a driven tree coordinate -> its motion law.
        moving: the simulation world (`World`) that is stepped in a run.
        still: an equal world, in which accelerations at given states are measured.
    """

    library = "DART"

    def __init__(self, mechanism: Mechanism, choice: Choice):
        """Build the worlds, after DART's model of the open tree has been compared with the linkage."""
        import dartpy

        super().__init__(mechanism, choice, Dart.file.options(choice.settings))
        self.dartpy: Any = dartpy
        self.forces = forces_of(mechanism, self.tree, self.options["joint_forces"])
        self.laws = {index: driver.law for index, driver in drivers_by_coordinate(mechanism, self.tree).items()}
        with Messages() as messages:
            # the loops are open until `World.restart` closes them; with the step INSTANT, implicit springs and dampers do not
            # change DART's accelerations
            open_tree = World(dartpy, mechanism, self.forces, self.options, motors=False)
            open_tree.world.setTimeStep(INSTANT)

            def describe(y: Array, dy: Array) -> OpenModel:
                """Return gaps and accelerations of the open tree at a tree state y, dy (n,), as DART computes them."""
                open_tree.put(y, dy)
                self._apply_forces(open_tree, t=0.0)
                open_tree.skeleton.computeForwardDynamics()
                return OpenModel(open_tree.gaps(), accelerations=open_tree.skeleton.getAccelerations()[open_tree.order])

            verify(mechanism, self.tree, describe, AGREEMENT)
            self.moving, self.still = (World(dartpy, mechanism, self.forces, self.options) for _ in range(2))
            messages.check()

    def _apply_forces(self, built: World, t: float) -> None:
        """Set the forces of a world for the next step to those at time t [s] and at its present state."""
        y, dy = built.state()
        built.command(self.forces.on_joints(y, dy))
        if (on_links := self.forces.on_links(t, y, dy)) is not None:
            built.push(on_links)

    def _command(self, built: World, t: float, end: float) -> None:
        """Set the forces for a step from time t [s] to `end` [s], and the speeds of driven coordinates at `end`."""
        self._apply_forces(built, t)
        for index, law in self.laws.items():
            built.skeleton.setCommand(int(built.order[index]), float(law(end)[1]))

    def _step_rates(self, t: float, y: Array, dy: Array, h: float) -> tuple[Array, Array]:
        """Return the rates (n,) after one and after two steps of h [s] from a tree state y, dy (n,).

        With erp = 0 the steps keep the gaps of the loops, so the rates contain no motion that closes a gap.
        """
        built = self.still
        built.restart()
        built.set_options(erp=0.0)
        built.world.setTimeStep(h)
        built.put(y, dy)
        rates = []
        for begin in (t, t + h):
            self._command(built, begin, begin + h)
            built.world.step(False)
            _, rate = built.state()
            rates.append(rate)
        return rates[0], rates[1]

    def tree_acceleration(self, t: float, y: Array, dy: Array) -> Array:
        """Return the accelerations (n,) of the closed loops at a tree state y, dy (n,), from short steps."""
        with Messages() as messages:
            measured = acceleration_by_steps(self._step_rates, t, y, dy, SHORT)
            messages.check()
        return measured

    def prepare(self, times: Array, native: bool = True) -> None:
        """Reset to the start; `native` has no effect, because Python calls DART for every step."""
        super().prepare(times, native)
        self.moving.restart()
        self._command(self.moving, times[0], times[0])

    def run(self) -> None:
        # no force may be evaluated after `last` [s], because a force may jump at the end of a stretch
        built, has_changing_forces = self.moving, not self.forces.are_constant or bool(self.laws)
        built.set_options(self.options["erp"])
        step = built.world.step
        with Messages() as messages:
            for begin, count, size, last, sample in self.plan:
                built.world.setTimeStep(size)
                for k in range(count):
                    if has_changing_forces:
                        self._command(built, min(begin + k * size, last), min(begin + (k + 1) * size, last))
                    step(False)  # False: the forces stay for the next step
                    if k % CHECK_EVERY == CHECK_EVERY - 1:
                        messages.check()
                messages.check()
                if sample is not None:
                    self.y[sample], self.dy[sample] = built.state()
