"""The common parts of adapters to libraries that model mechanisms as trees of joints."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from gauss_bench.engines.base import Choice, sample_arrays
from gauss_bench.engines.shared import OpenTree, finite_acceleration, joint_tree, open_tree, require_agreement, tree_states
from gauss_bench.engines.tree import Tree
from gauss_bench.integrate.fixed_step import stretches
from gauss_bench.mechanism.evaluate import evaluator_of
from gauss_bench.mechanism.model import Mechanism
from gauss_bench.mechanism.spaces import places
from gauss_bench.terms import Array
from gauss_bench.trajectory import Trajectory, with_accelerations


class TreeModel(ABC):
    """Base class of models of a mechanism in a library that models trees of joints, run with one setting of the engine (`Choice`).

    A subclass calls this `__init__` and then builds the library's model. It supplies `tree_acceleration` and `run`, and may extend
    `prepare` and `read`.

    Attributes:
        library: the library's name in messages.
        options: name of an option of the engine -> value; the option "tree" selects the spanning tree.
        y0, dy0: (n,) tree coordinates and rates at the start.
        plan: the `Stretch`es of a run: sequences of equal steps up to a sample or a kink of a force.
        y, dy: (k, n) tree coordinates and rates at the sample times, which `run` stores.
    """

    library: str

    def __init__(self, mechanism: Mechanism, choice: Choice, options: Mapping[str, Any]):
        self.mechanism, self.choice, self.options = mechanism, choice, options
        self.tree = joint_tree(mechanism, options)
        self.y0, self.dy0 = self.tree.relative(mechanism.q0, mechanism.v0)

    @abstractmethod
    def tree_acceleration(self, t: float, y: Array, dy: Array) -> Array:
        """Return the library's accelerations y'' (n,) at time t [s] and a tree state y, dy (n,) whose loops are closed.

        Raises:
            RunFailure: the library finds no accelerations at that state.
        """

    @abstractmethod
    def run(self) -> None:
        """Take the steps of `plan`, and store the tree states at the samples."""

    def accelerate(self, t: float, y: Array, dy: Array) -> Array:
        """Return the library's accelerations (3 links,) in absolute coordinates at time t [s] and a tree state y, dy (n,).

        Raises:
            RunFailure: the library finds no accelerations at that state, or they are not finite.
        """
        with np.errstate(all="ignore"):  # no warnings of numpy, because values that are not finite are refused here
            return finite_acceleration(t, self.tree.absolute(y, dy, self.tree_acceleration(t, y, dy)).a, self.library)

    def accelerate_sample(self, t: float, y: Array, dy: Array) -> Array:
        """Return the accelerations (3 links,) that `read` reports for a sample; a subclass may compute them in another way."""
        return self.accelerate(t, y, dy)

    def acceleration(self, t: float, q: Array, v: Array) -> Array:
        """Return the library's accelerations (3 links,) at time t [s] and an absolute state q, v (3 links,)."""
        return self.accelerate(t, *self.tree.relative(q, v))

    def prepare(self, times: Array, native: bool = True) -> None:
        """Plan the steps to the samples at `times` (k,) [s]; `native` tells whether the library's own loop takes them."""
        self.times, self.native = times, native
        self.plan = list(stretches(times, self.choice.step, self.mechanism.kinks))
        self.y, self.dy = sample_arrays(times, self.y0, self.dy0)

    def read(self) -> Trajectory:
        return self.trajectory(self.y, self.dy, self.count_steps())

    def count_steps(self) -> int:
        """Return the number of steps in `plan`; a subclass whose library chooses its steps returns another number."""
        return sum(stretch.steps for stretch in self.plan)

    def trajectory(self, y: Array, dy: Array, steps: int, evaluations: int | None = None, note: str = "") -> Trajectory:
        """Return the samples y, dy (k, n) in absolute coordinates, with the accelerations that the library computes for them.

        Raises:
            RunFailure: the library finds no accelerations at a sample; the exception holds the samples before this one.
        """
        q, v, _ = self.tree.absolute(y, dy, np.zeros_like(y))

        def acceleration_of_sample(k: int) -> Array:
            return self.accelerate_sample(float(self.times[k]), y[k], dy[k])

        return with_accelerations(self.times, q, v, acceleration_of_sample, steps, evaluations, note)


@dataclass(frozen=True, eq=False)
class OpenModel:
    """Quantities that a library computes for the open tree of a linkage, without closures and drivers, at a tree state y, dy.

    Either `mass` and `forces` must be given, or `accelerations`.

    Attributes:
        gaps: (pins, 2) point b minus point a of each closing pin [m], by the library's own kinematics.
        mass: (n, n) mass matrix.
        forces: (n,) generalised forces and velocity terms, so that mass y'' = forces.
        accelerations: (n,) y''.
        positions: (links, 2) centres of mass [m].
    """

    gaps: Array
    mass: Array | None = None
    forces: Array | None = None
    accelerations: Array | None = None
    positions: Array | None = None

    def __post_init__(self) -> None:
        """Check that the quantities determine the motion."""
        if (self.mass is None or self.forces is None) and self.accelerations is None:
            raise TypeError("give the mass matrix and the forces, or the accelerations: they determine the motion")


def verify(mechanism: Mechanism, tree: Tree, describe: Callable[[Array, Array], OpenModel], tolerance: float) -> None:
    """Compare a library's model of the tree with the suite's, at the start and at random tree states, where loops are open.

    Args:
        describe: function of a tree state y, dy (n,) that returns the library's quantities at this state.

    Raises:
        RunFailure: a quantity differs by more than the tolerance times its scale.
    """
    evaluator = evaluator_of(mechanism)
    for y, dy in tree_states(tree, *tree.relative(mechanism.q0, mechanism.v0)):
        require_agreement(comparison(describe(y, dy), open_tree(evaluator, tree, y, dy)), tolerance)


def comparison(model: OpenModel, own: OpenTree) -> dict[str, tuple[Array, Array, float]]:
    """Return name of a quantity -> the library's value, the suite's own value, and the scale of a difference."""
    extent, load = float(np.abs(own.q).max()), own.load or 1.0  # 1.0 replaces a load of zero as the scale
    pairs = {"gaps of open pins": (model.gaps, own.gaps, extent)}
    if model.positions is not None:
        pairs["positions of links"] = (model.positions, places(own.q), extent)
    if model.mass is not None:
        pairs["mass matrix"] = (model.mass, own.mass, float(own.mass.max()))
    if model.forces is not None:
        pairs["forces and velocity terms"] = (model.forces, own.forces, load)
    if model.accelerations is not None:
        pairs["forces of the open tree"] = (own.mass @ model.accelerations, own.forces, load)
    return pairs


TwoSteps = Callable[[float, Array, Array, float], tuple[Array, Array]]  # (t, y, dy, step) -> rates after one step and after two


def acceleration_by_steps(rates: TwoSteps, t: float, y: Array, dy: Array, steps: Sequence[float]) -> Array:
    """Return the acceleration (n,) at time t [s] and a tree state y, dy (n,), extrapolated from a library's steps [s].

    In a step of size h the rates change by h D(h), with D(h) = a + b h + ... The polynomial through D at all step sizes gives a =
    D(0). If a library treats springs and dampers implicitly, b changes, but not a. An error e of a rate changes D by about e / h.

    In a library whose constraints act on velocities, the velocities v1 after a step satisfy J v1 = 0, with J at the beginning of
    the step. The velocities before and after a single step from a state with J v = 0 would give J a = 0 in place of J a = gamma.
    Therefore D(h) is computed from the second of two steps, of which the first begins at t - h and y - h dy. The library must not
    correct the gaps of that state, which are of order h^2: a correction within one step adds an acceleration independent of h.

    Args:
        rates: function (t, y, dy, h) that returns the rates (n,) after one step of h [s], and the rates after two such steps.
    """
    changes = []  # D(h) of each step size
    for h in steps:
        before, after = rates(t - h, y - h * dy, dy, h)
        changes.append((after - before) / h)
    return extrapolate(steps, changes)


def extrapolate(steps: Sequence[float], values: Sequence[Array]) -> Array:
    """Return the limit at step 0 of values (n,) at several steps, by the polynomial through them (Aitken and Neville)."""
    row = list(values)  # row[k] of an order: value at 0 of the polynomial through the steps k to k + order
    for order in range(1, len(steps)):
        row = [(steps[k] * row[k + 1] - steps[k + order] * row[k]) / (steps[k] - steps[k + order]) for k in range(len(row) - 1)]
    return row[0]
