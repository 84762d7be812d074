"""Make engines with one known fault each; the self-test runs them, and the diagnosis must name the fault.

Each faulty engine is one of the suite's formulations with its integrators. `planted.toml` lists the faults.
"""

import tomllib
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from gauss_bench.diagnosis.causes import Cause
from gauss_bench.diagnosis.checks import FOUR_BAR, alter
from gauss_bench.engines.base import Choice
from gauss_bench.engines.interpreted import Interpreted, InterpretedModel
from gauss_bench.engines.tree import spanning_tree
from gauss_bench.mechanism.model import Mechanism
from gauss_bench.mechanism.spaces import angles, bodies
from gauss_bench.terms import Array, Solution, Terms, baumgarte, recover_multipliers
from gauss_bench.trajectory import Trajectory

TABLES: dict[str, list[dict[str, Any]]] = tomllib.loads(Path(__file__).with_name("planted.toml").read_text(encoding="utf-8"))
State = tuple[Array, Array]
FORMULATION = "lagrange"  # the fastest formulation that is not compiled
RESET_AT = 0.23  # [s] time at which `reset` acts


def same(item: Any, *_: Any) -> Any:
    """Return the first argument unchanged: the default of each function in a fault."""
    return item


@dataclass(frozen=True)
class Fault:
    """One planted fault: an error that is put into an engine on purpose, by functions that replace correct values.

    Attributes:
        cause: the cause that the diagnosis must name.
        linkage: mechanism -> the mechanism that is modelled instead.
        terms: (terms, model, t, q, v) -> terms that are solved for accelerations instead.
        solved: (solution, terms, model) -> solution that is used instead.
        stepped: (state, model, t) -> state with which the engine goes on after the step that ended at t.
        times: (requested times, step) -> equally many times, at which samples are taken instead.
        read: (trajectory, mechanism) -> the trajectory that the engine returns.
        where: linkage and scenario in which the fault shows.
    """

    name: str
    sentence: str
    cause: Cause
    linkage: Callable[[Mechanism], Mechanism] = same
    terms: Callable[[Terms, "FaultyModel", float, Array, Array], Terms] = same
    solved: Callable[[Solution, Terms, "FaultyModel"], Solution] = same
    stepped: Callable[[State, "FaultyModel", float], State] = same
    times: Callable[[Array, float], Array] = same
    read: Callable[[Trajectory, Mechanism], Trajectory] = same
    where: tuple[str, str] = FOUR_BAR


class FaultyModel(InterpretedModel):
    """The model of a linkage by an engine that has a planted fault.

    Attributes:
        true: the linkage without the fault.
        asked: requested times [s].
        recent: (J, gamma) at the beginnings of the last two steps; first: those at the start.
        running: whether the run is under way; otherwise the model computes the accelerations that the engine reports.
    """

    def __init__(self, fault: Fault, mechanism: Mechanism, choice: Choice):
        super().__init__(FORMULATION, fault.linkage(mechanism), choice)
        self.fault, self.true, self.running = fault, mechanism, False
        self.first = self.rows(0.0, self.mechanism.q0, self.mechanism.v0)

    def rows(self, t: float, q: Array, v: Array) -> tuple[Array, Array]:
        """Return J (m, n) and gamma (m,) of J a = gamma at a state."""
        constraints = self.evaluator.constraints(t, q, v)
        return constraints.J, constraints.gamma

    def acceleration(self, t: float, q: Array, v: Array) -> Array:
        """Return the accelerations (n,) that the engine computes with its fault."""
        return self._solve(t, self.fault.terms(self.evaluator.terms(t, q, v), self, t, q, v)).a

    def stabilized(self, t: float, q: Array, v: Array) -> Array:
        """Return the accelerations (n,) of a stage of a step, which are not stabilised here."""
        self.evaluations += 1
        return self.acceleration(t, q, v)

    def _solve(self, t: float, terms: Terms) -> Solution:
        """Return the solution for the terms, as the fault changes it."""
        return self.fault.solved(super()._solve(t, terms), terms, self)

    def prepare(self, times: Array, native: bool = True) -> None:
        """Prepare a run that takes its samples at the wrong times of the fault, but labels them by the requested times."""
        self.asked, self.reset, self.recent = times, False, [self.first, self.first]
        super().prepare(self.fault.times(times, self.choice.step), native)

    def run(self) -> None:
        self.running = True
        super().run()
        self.running = False

    def _advance(self, begin: float, x: Array, dx: Array, h: float, count: int, last: float) -> State:
        """Advance `count` steps of length h [s] one by one, so that the planted fault can change the state after each step."""
        for i in range(count):
            t = begin + i * h
            self.recent = [self.recent[1], self.rows(t, x, dx)]  # J and gamma at the beginnings of the last two steps
            x, dx = super()._advance(t, x, dx, h, 1, last)
            x, dx = self.fault.stepped((x, dx), self, t + h)
        return x, dx

    def read(self) -> Trajectory:
        """Return the samples, labelled by the requested times and changed by the planted fault."""
        trajectory = replace(super().read(), t=self.asked)
        return self.fault.read(trajectory, self.true)


class Faulty(Interpreted):
    """An engine with one planted fault."""

    def __init__(self, fault: Fault):
        super().__init__(FORMULATION)
        self.fault, self.name = fault, fault.name

    def build(self, mechanism: Mechanism, choice: Choice) -> FaultyModel:
        return FaultyModel(self.fault, mechanism, choice)


# faults in the terms


def rows_of_last_pin(mechanism: Mechanism) -> list[int]:
    """Return the indices of the constraint rows of the linkage's last pin."""
    ends = np.cumsum([len(joint.held) for joint in mechanism.joints])  # one row for each held coordinate
    last = max(k for k, joint in enumerate(mechanism.joints) if joint.ends_meet)
    return list(range(ends[last] - len(mechanism.joints[last].held), ends[last]))


def without(terms: Terms, rows: list[int]) -> Terms:
    """Return the terms without the constraint rows that have these indices."""
    kept = np.delete(np.arange(len(terms.J)), rows)
    return replace(terms, J=terms.J[kept], gamma=terms.gamma[kept], phi=terms.phi[kept], phi_dot=terms.phi_dot[kept])


def soft_loop(terms: Terms, model: FaultyModel, *_: object) -> Terms:
    """Replace the last pin by a spring and a damper between its two points."""
    rows = rows_of_last_pin(model.mechanism)
    # stiffness [N/m] and damping [N s/m]
    Q = terms.Q - terms.J[rows].T @ (2e4 * terms.phi[rows] + 40.0 * terms.phi_dot[rows])
    return replace(without(terms, rows), Q=Q)


def ignore_joint(terms: Terms, model: FaultyModel, *_: object) -> Terms:
    """Leave out the constraints of the last pin."""
    return without(terms, rows_of_last_pin(model.mechanism))


def ignore_constraints(terms: Terms, *_: object) -> Terms:
    """Leave out all constraints."""
    return without(terms, list(range(len(terms.J))))


def stale(terms: Terms, model: FaultyModel, *_: object) -> Terms:
    """Use the constraint data J and gamma of the previous step during the run, but not for the accelerations that are reported."""
    J, gamma = model.recent[0] if model.running else (terms.J, terms.gamma)
    return replace(terms, J=J, gamma=gamma)


def keep_first_jacobian(terms: Terms, model: FaultyModel, *_: object) -> Terms:
    """Use the Jacobian at the start state for all later states."""
    return replace(terms, J=model.first[0])


def without_velocity_terms(terms: Terms, *_: object) -> Terms:
    """Leave out -J' v, which is all of gamma in a linkage without drivers."""
    return replace(terms, gamma=0 * terms.gamma)


def without_second_rate(terms: Terms, model: FaultyModel, t: float, *_: object) -> Terms:
    """Leave out the second time derivative of the drivers' laws."""
    gamma = terms.gamma.copy()
    for row, driver in enumerate(model.mechanism.drivers, model.evaluator.constraints.joint_rows):
        gamma[row] -= float(driver.law(t)[2])
    return replace(terms, gamma=gamma)


def compliant(solution: Solution, terms: Terms, model: FaultyModel) -> Solution:
    """Solve with regularised constraints, J a = gamma + lambda / 2; gamma has Baumgarte's terms with a rate of 50 1/s."""
    n, m = len(terms.Q), len(terms.gamma)
    K = np.block([[terms.M, terms.J.T], [terms.J, -0.5 * np.eye(m)]])
    x = np.linalg.solve(K, np.concatenate([terms.Q, baumgarte(terms, 50.0, 50.0).gamma]))
    return Solution(x[:n], x[n:], m)


def too_large(solution: Solution, terms: Terms, model: FaultyModel) -> Solution:
    """Return accelerations 30 % too large, with the multipliers that belong to them."""
    return Solution(1.3 * solution.a, recover_multipliers(terms, solution.a), solution.rank)


# faults in the steps


def reset(state: State, model: FaultyModel, t: float) -> State:
    """Reset the state to the start, at rest, as some engines do after a NaN."""
    if not model.reset and t >= RESET_AT:
        model.reset = True
        return model.mechanism.q0, 0 * model.mechanism.v0
    return state


def single_precision(state: State, *_: object) -> State:
    """Round the state to single precision after every step."""
    q, v = (x.astype(np.float32).astype(float) for x in state)
    return q, v


# faults in the samples


def resample(times: Array, step: float, late: float = 0.0, rate: float = 1.0) -> Array:
    """Return the requested times multiplied by `rate` and increased by `late` steps; the time 0 is not changed."""
    return np.where(times > 0, rate * times + late * step, times)


def standing_still(trajectory: Trajectory, *_: object) -> Trajectory:
    """Report the first position, at rest, at all times."""
    return replace(trajectory, q=0 * trajectory.q + trajectory.q[0], v=0 * trajectory.v, a=0 * trajectory.a)


def within_a_turn(trajectory: Trajectory, *_: object) -> Trajectory:
    """Wrap all angles into the interval from -pi to pi."""
    q = trajectory.q.copy()
    angles(q)[...] = (angles(q) + np.pi) % (2 * np.pi) - np.pi
    return replace(trajectory, q=q)


def backwards(trajectory: Trajectory, *_: object) -> Trajectory:
    """Report velocities with the wrong sign."""
    return replace(trajectory, v=-trajectory.v)


def links_in_another_order(trajectory: Trajectory, mechanism: Mechanism) -> Trajectory:
    """Exchange the first two links."""
    order = bodies(np.arange(mechanism.n, dtype=float)).astype(int)  # (links, 3): index of every coordinate
    order[[0, 1]] = order[[1, 0]]
    return replace(trajectory, **{level: getattr(trajectory, level)[:, order.ravel()] for level in "qva"})


def breadth_first_joints(trajectory: Trajectory, mechanism: Mechanism) -> Trajectory:
    """Report joint coordinates in the order of their depth in the tree, as if they were in the order of the branches.

    If both orders are equal, the coordinates are reported in reverse. Joint accelerations are taken as zero.
    """
    tree = spanning_tree(mechanism)
    depth = {-1: 0}  # index of a link -> number of joints between it and the ground, whose index is -1
    for branch in tree.branches:
        depth[branch.link] = depth[branch.parent] + 1
    order = sorted(range(tree.n), key=lambda k: depth[tree.branches[k].link])
    if order == list(range(tree.n)):
        order = order[::-1]
    y, dy = tree.relative(trajectory.q, trajectory.v)
    q, v, a = tree.absolute(y[:, order], dy[:, order], 0 * dy)
    return replace(trajectory, q=q, v=v, a=a)


def read_engine(name: str, sentence: str, cause: str, where: Any = FOUR_BAR, **spoils: Any) -> Fault:
    """Return the fault of an engine that one [[engine]] table of `planted.toml` describes.

    `spoils` has attributes of `Fault` with names of functions in this file, or the keys `alter` or `resample` with arguments of the
    function of this name.
    """
    functions: Any = {key: globals()[x] for key, x in spoils.items() if key not in ("alter", "resample")}
    if "alter" in spoils:
        functions["linkage"] = partial(alter, **spoils["alter"])
    if "resample" in spoils:
        functions["times"] = partial(resample, **spoils["resample"])
    return Fault(name, sentence, Cause(cause), **functions, where=(where[0], where[1]))


ENGINES = tuple(read_engine(**x) for x in TABLES["engine"])
CLEAN = Fault("clean", "nothing is wrong", Cause.NONE)
